# SPDX-License-Identifier: MIT
"""Derivative of the equations of a contact with respect to the reference positions of its nodes.

With finite sliding, the equations depend on the present positions x = X + u: forces and rows change
as with the displacement, at fixed sets and weights of the rows. Lengths of undeformed facets occur
only in weights of rows, and in the stiffness of redundant sticks and of users' laws, which is
considered fixed. The offset is fixed, too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.interface.mortar import Block
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.sensitivity.partials.maps import Dofs, PairVector
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError


class Positions:
    """Derivative of forces and rows of a contact with respect to positions; collective methods.

    Args:
        contact: The contact, evaluated.

    Raises:
        MortarError: If the contact depends on the undeformed mesh in other ways: ties, small
            sliding, thickness or parameters of laws that are functions of the position.
    """

    def __init__(self, contact: Interface) -> None:
        check_positions(contact)
        assert isinstance(contact, Contact)
        self._contact, o = contact, contact.operators
        dofs = self._dofs = Dofs((contact.slave, contact.master))
        self._forces: Sequence[Block] = [
            Block(dofs.indices(block.rows), block.columns, block.values)
            for block in o.force_derivative(contact.z)
        ]
        self._rows = contact.rows.linearized().blocks
        self._of_obstacle = np.zeros((3, contact.slave.num_nodes, 2))
        if isinstance(o, ObstacleOperators):
            self._of_obstacle = o.motion_force_derivatives(contact.z)[0]

    def along(self, on_slave: Array, on_master: Array) -> PairVector:
        """Changes of forces [stress length], rows in place of z, and forces on the obstacle."""
        dofs, count = self._dofs, len(self._contact.z)
        values = dofs.flat(on_slave, on_master)
        forces = dofs.split(dofs.along(self._forces, values, dofs.size + 1))
        rows = dofs.along(self._rows, values, 2 * count).reshape(count, 2)
        return PairVector(*forces, rows, np.einsum("mjc,jc->m", self._of_obstacle, on_slave))

    def back(self, y: PairVector) -> tuple[Array, Array]:
        """Gradients of the product with y, at slave and master nodes, (nodes, 2) each.

        In the unit of the product over [length].
        """
        dofs = self._dofs
        total = dofs.back(self._forces, dofs.flat(y.on_slave, y.on_master))
        total += dofs.back(self._rows, y.z.ravel())
        on_slave, on_master = dofs.split(total)
        return on_slave + np.einsum("mjc,m->jc", self._of_obstacle, y.motion), on_master


def check_positions(contact: Interface) -> None:
    """Reject contacts whose equations depend on the undeformed mesh in other ways (local).

    Raises:
        MortarError: If a contact has such equations.
    """
    if not isinstance(contact, Contact) or contact.pair.sliding == "small":
        raise MortarError(
            f"{contact.pair!r} has D and M of the undeformed mesh: nodal positions as controls "
            "need contact with sliding='finite'"
        )
    for name, value in contact.pair.law.varying.items():
        if not isinstance(value, np.ndarray):
            raise MortarError(f"{name} of {contact.pair.law!r} varies with the position")
    thickness = contact.slave.thickness
    if thickness is not None and thickness.by_x == 0.0 and np.ptp(thickness.at(contact.slave.X)):
        raise MortarError(
            "the thickness depends on the position: there are no derivatives by nodal positions"
        )
