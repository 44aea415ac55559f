# SPDX-License-Identifier: MIT
"""Velocity of deformation: what remains of the velocity without rigid motions of the bodies."""

from __future__ import annotations

import numpy as np

from fenics_mortar.bulk.bodies import label_bodies
from fenics_mortar.bulk.inertia import Inertia
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array, Flags
from fenics_mortar.utils.rounding import ROUNDING


class DeformationRate:
    """Velocities without momentum and angular momentum of any body; all methods are collective.

    Args:
        space: The displacement's nodes and dofs.
        inertia: Mass of the bodies.
        prescribed: Marks of the local dofs with prescribed values.
    """

    def __init__(self, space: DisplacementSpace, inertia: Inertia, prescribed: Flags) -> None:
        self._space, self._inertia, self._prescribed = space, inertia, prescribed
        self._label, self._count = label_bodies(space.V)

    def of(self, velocity: Array, x: Array) -> Array:
        """The part of a velocity that is orthogonal, in mass, to rigid motions; 0 if prescribed.

        Args:
            velocity: Array of all local dofs [length / time].
            x: Positions of the local nodes, shape (n, 2) [length].

        Returns:
            An array of all local dofs [length / time].
        """
        space, inertia, size = self._space, self._inertia, self._space.num_owned
        comm, owned = space.V.mesh.comm, space.num_nodes
        centre = comm.allreduce(np.array([*x[:owned].sum(axis=0), owned]))
        r, zero = x - centre[:2] / centre[2], np.zeros(len(x))
        rigid = [(zero, zero + 1.0)]
        if not space.is_axisymmetric:
            rigid += [(zero + 1.0, zero), (-r[:, 1], r[:, 0])]
        fields = np.zeros((len(rigid), velocity.size))
        for field, components in zip(fields, rigid, strict=True):
            field[space.dofs] = np.stack(components, axis=1)
        momenta = np.array([inertia.times_mass(field) for field in fields])
        rows = [m * v[:size] for m in momenta for v in (*fields, velocity)]
        sums = self._by_body(rows).reshape(len(rigid), len(rigid) + 1, self._count)
        rates = [
            np.linalg.lstsq(body[:, :-1], body[:, -1], rcond=ROUNDING)[0]
            for body in np.moveaxis(sums, 2, 0)
        ]
        weights = np.array(rates).reshape(self._count, len(rigid))[self._label]
        rest = velocity - sum(space.spread(w) * f for w, f in zip(weights.T, fields, strict=True))
        return np.where(self._prescribed, 0.0, rest)

    def _by_body(self, rows: list[Array]) -> Array:
        """Sums of values (owned dofs,) over the nodes of each body, equal on all ranks."""
        label = self._label[: self._space.num_nodes]
        dofs = self._space.owned_dofs
        nodal = [row[dofs].sum(axis=1) for row in rows]
        mine = np.array([np.bincount(label, values, self._count) for values in nodal])
        return np.asarray(self._space.V.mesh.comm.allreduce(mine))
