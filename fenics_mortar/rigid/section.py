# SPDX-License-Identifier: MIT
"""Sections under pretension: the force in a tie as the load of its jump along an axis.

The rows of the tie are D u_s - M (u_m + s a) for the shortening s along the axis a. The force that
tightens the section is conjugate to s,

    f_q = -sum_j m_j a . z_j = push,    m = M 1,

so that column and row of the border are transposed, up to the weights of the tie's rows. Where only
contact resists the motion of the sides of a section along its axis, they float: see
``body_motions``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.pair import Pretension
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.obstacle_facets import outward_normals
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.rigid.bordered import Border
from fenics_mortar.utils.arrays import Array, norms
from fenics_mortar.utils.errors import SurfaceError
from fenics_mortar.utils.rounding import SMALL_ANGLE


def sections_of(contacts: Sequence[Any]) -> list[BoundSection]:
    """The sections under pretension among all contacts and ties (local).

    Raises:
        SurfaceError: On all ranks, if a section without an axis is not straight.
    """
    return [BoundSection(c) for c in contacts if isinstance(c.pair, Pretension)]


class BoundSection:
    """A section in the space of a problem, as a ``RemoteMotion``.

    Args:
        tie: The tie of its faces.

    Attributes:
        tie: The tie of its faces.
        motion: Shortening and force of the user's section.
        arm: One, since nothing turns [length].
    """

    arm = 1.0

    def __init__(self, tie: Tie) -> None:
        """Find the axis (local)."""
        self.tie, self._pair, self.motion = tie, tie.pair, tie.pair.motion
        if not self._pair.axis.any():
            self._pair.axis = _normal_of(tie.slave)

    def bind_forces(self, bulk: Bulk, contacts: Sequence[Any]) -> None:
        """See ``RemoteMotion``: the forces are those of the tie."""
        self._num_owned = bulk.num_owned

    def force(self) -> Array:
        """See ``RemoteMotion``."""
        return float((self._by_multipliers() * self.tie.z).sum()) * self._first

    def constant_force(self) -> Array:
        """See ``RemoteMotion``: zero."""
        return 0.0 * self._first

    @property
    def _first(self) -> Array:
        """The motion that is the shortening, (3,), in space (6,) [1]."""
        return np.eye(self.motion.place.size)[0]

    @property
    def axis(self) -> Array:
        """Direction in which the slave moves into the master, shape (dim,) [1] (local)."""
        return self._pair.axis

    def pushed_nodes(self) -> Array:
        """See ``RemoteMotion``: the part of the push beyond the tie's force, on both faces.

        The resultant on the body is zero, those on the parts beside the section drive them.
        """
        found, weights = np.zeros(self._num_owned), self._weights()
        missing = float(np.nan_to_num(self.motion.load[0] - self.force()[0]))
        z = np.outer(self.tie.active, missing / weights.sum() * self.axis)
        sides = self.tie.slave, self.tie.master
        for side, forces in zip(sides, self.tie.operators.force(z), strict=True):
            side.scatter_add(forces, found)
        return found

    def take_bulk_rows(self) -> None:
        """See ``RemoteMotion``: K has no part in the balance."""

    def _by_multipliers(self) -> Array:
        """Derivative of f_q with respect to the multipliers, of their shape [length]."""
        by_z = np.zeros_like(self.tie.z)
        by_z[:, : self.motion.dim] = -np.outer(self._weights(), self.axis)
        return by_z

    def _weights(self) -> Array:
        """M = M 1, shape (slave nodes,) [length]."""
        return np.asarray(self.tie.M @ np.ones(self.tie.master.num_nodes))

    def linearize(self, system: LinearSystem) -> Border:
        """See ``RemoteMotion``."""
        _, weight = self.tie.rows.frame()
        by_z = self._by_multipliers()
        columns, rows = (
            np.outer(self._first, self._as_vector(values, system))
            for values in (weight * by_z, by_z)
        )
        return Border(columns, rows, np.zeros((len(rows), len(rows))))

    def _as_vector(self, values: Array, system: LinearSystem) -> Array:
        """Vector (owned rows,) of ``values`` of the tie's multipliers, else zero."""
        others = (np.zeros_like(contact.z) for contact in system.contacts)
        z = [
            values if c is self.tie else none
            for c, none in zip(system.contacts, others, strict=True)
        ]
        return system.join(np.zeros(system.bulk.num_owned), z)

    def record(self) -> str:
        """See ``RemoteMotion``."""
        self.motion.reaction = self.force()
        force, shortening = self.motion.reaction[0], self._pair.shortening
        return f"section '{self.motion.name}', shortened by {shortening:.4g}: force {force:.4g}"


def _normal_of(slave: Surface) -> Array:
    """Outward normal of a straight or flat surface, shape (dim,) [1] (local, equal on all ranks).

    Raises:
        SurfaceError: If the surface is curved.
    """
    normals = outward_normals(slave.X[slave.facets])
    mean = normals.sum(axis=0)
    if np.linalg.norm(mean) < np.cos(SMALL_ANGLE) * norms(normals).sum():
        raise SurfaceError(
            f"section '{slave.name}' is not straight: give the axis= of the pretension, the "
            "direction in which the slave moves into the master"
        )
    return np.asarray(mean / np.linalg.norm(mean))
