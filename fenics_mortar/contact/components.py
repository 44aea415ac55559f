# SPDX-License-Identifier: MIT
"""What the linear systems need of each component of an interface's multipliers."""

from __future__ import annotations

from operator import attrgetter
from typing import Any

import numpy as np

from fenics_mortar.utils.arrays import Array, Flags


class Components:
    """Components of the multipliers of a contact; arrays have the shape of z (local).

    Args:
        interface: The interface; its present fields are used.

    Attributes:
        dofs: Global dofs of the slave whose equations yield the components.
        free: 0 where the dof of an acting component is prescribed, else 1.
        to_force: Factor that turns rows of the multipliers into forces.
        some_carry: Whether a slave node ever carries a component, shape (slave nodes,), bool.
        all_carry: Whether it may carry all of them, shape (slave nodes,), bool.
    """

    dofs: Any = property(attrgetter("_interface.slave.dofs"))
    free: Any = property(attrgetter("_interface.free"))
    to_force: Any = 1.0
    some_carry: Any = property(attrgetter("_interface.may_carry"))
    all_carry: Any = property(attrgetter("_interface.may_carry"))

    def __init__(self, interface: Any) -> None:
        self._interface = interface

    def set_units(self, units: Array, to_force: Array, diagonal: Array) -> None:
        """Set the scales of all unknowns, see ``bulk.residual`` (collective).

        Args:
            units: Amounts of the unknowns, shape (owned dofs,).
            to_force: Factors of the equations, shape (owned dofs,).
            diagonal: Diagonal of the tangent of the bodies, shape (owned dofs,).
        """
        for flux in self._interface.fluxes:
            flux.set_conduction(to_force, np.abs(diagonal))

    @property
    def acts(self) -> Flags:
        """Whether a component may be nonzero."""
        return np.broadcast_to(self._interface.acts[:, None], self._interface.z.shape)

    @property
    def inverse(self) -> Array:
        """1 / D_jj where a component acts and its dof is free, else 0 [1 / length]."""
        i = self._interface
        return i.free / np.where(i.acts, i.operators.diagonal, np.inf)[:, None]

    @property
    def scale(self) -> Array:
        """z_j / zeta_j, see ``la.system`` [stress / length]."""
        i = self._interface
        diagonal = np.where(i.acts, i.operators.diagonal, i.slave.nodal_areas)
        return np.broadcast_to((i.stiffness / diagonal)[:, None], i.z.shape)
