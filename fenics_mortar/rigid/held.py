# SPDX-License-Identifier: MIT
"""Bodies with rigid boundaries: those that these support, and motions that pushes leave free.

A body may float along the driven motions of its rigid boundaries. In a rigid motion of the body the
places of the boundaries follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fenics_mortar.bulk.bodies import FloatingBody
from fenics_mortar.bulk.residual import Bulk, mark_prescribed
from fenics_mortar.utils.arrays import Array, Flags, Indices


class HeldBodies:
    """Bodies with rigid boundaries.

    Args:
        bulk: The bodies.
        remote: The remote loads of the problem, bound to the mesh.

    Attributes:
        prescribed_otherwise: Marks of the dofs with other Dirichlet conditions, (local dofs,).
    """

    def __init__(self, bulk: Bulk, remote: Sequence[Any]) -> None:
        conditions = [bc for bc in bulk.bcs if bc not in remote]
        self._boundaries = [(i, load) for i, load in enumerate(remote) if load in bulk.bcs]
        self._first = -len(remote)
        self.prescribed_otherwise: Flags = mark_prescribed(bulk.space, bulk.u, conditions)
        self._at: dict[int, list[tuple[int, Any]]] = {}

    def links(self, labels: Indices) -> list[Indices]:
        """Pairs of bodies with a common rigid boundary, (k, 2) each, from labels (collective)."""
        found = [load.labels(labels) for _, load in self._boundaries]
        return [np.stack([some[:-1], some[1:]], axis=1) for some in found]

    def set_bodies(self, labels: Indices) -> None:
        """Set the bodies of all boundaries from labels of the local nodes (collective)."""
        for number, load in self._boundaries:
            self._at.setdefault(int(load.labels(labels)[0]), []).append((number, load))

    def restricted(self, body: FloatingBody) -> FloatingBody:
        """A body with the motions that its rigid boundaries do not prescribe (local)."""
        loads = [load for _, load in self._at.get(body.label, ())]
        if not loads:
            return body
        prescribed = [np.isnan(load.motion.load) for load in loads]
        pairs = zip(loads, prescribed, strict=True)
        return body.without(np.hstack([load.motions_by(body)[:, on] for load, on in pairs]))

    def move(self, body: FloatingBody, coefficients: Array) -> None:
        """Move the rigid boundaries of a body along with it, in driven motions (local).

        Args:
            body: The body.
            coefficients: Factors of its motions, shape (motions,) [length].
        """
        for _, load in self._at.get(body.label, ()):
            change = coefficients @ load.motions_by(body) / [1.0, 1.0, load.arm]
            load.motion.place = load.motion.place + np.where(
                np.isfinite(load.motion.load), change, 0.0
            )

    def subtract(self, body: FloatingBody, coefficients: Array, motion: Array) -> None:
        """Subtract the motions due to those of a body from increments ``motion`` (local).

        Args:
            body: The body.
            coefficients: Factors of its motions, shape (motions,) [length].
            motion: Increments of obstacles and remote loads, shape (m, 3) [length]; changed.
        """
        for number, load in self._at.get(body.label, ()):
            motion[self._first + number] -= coefficients @ load.motions_by(body)
