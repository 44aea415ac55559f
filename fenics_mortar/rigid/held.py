# SPDX-License-Identifier: MIT
"""Bodies with remote loads: those that these support, and motions that pushes leave free.

A body may float along the driven motions of its rigid boundaries; sides of a section whose force is
given may float along its axis. The places of boundaries and sections follow the motion of the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fenics_mortar.bulk.bodies import FloatingBody
from fenics_mortar.bulk.residual import Bulk, mark_prescribed
from fenics_mortar.obstacles.places import place_after
from fenics_mortar.obstacles.rigid_motion import RigidMotion
from fenics_mortar.utils.arrays import Array, Flags, Indices


class HeldBodies:
    """Bodies with rigid boundaries or sections under pretension.

    Args:
        bulk: The bodies.
        remote: The remote loads of the problem, bound to the mesh.

    Attributes:
        prescribed_otherwise: Marks of the dofs with other Dirichlet conditions, (local dofs,).
        sections: Sections under pretension, with their positions among the remote loads.
    """

    def __init__(self, bulk: Bulk, remote: Sequence[Any]) -> None:
        conditions = [bc for bc in bulk.bcs if bc not in remote]
        self._boundaries = [(i, load) for i, load in enumerate(remote) if load in bulk.bcs]
        self.sections = [(i, load) for i, load in enumerate(remote) if load not in bulk.bcs]
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

    def leaders(self, labels: Indices) -> dict[int, RigidMotion]:
        """Motions of rigid boundaries by the number of a part that they lead (local).

        Args:
            labels: Body of each part, shape (parts,).
        """
        first = {label: loads[0][1].motion for label, loads in self._at.items()}
        bodies = enumerate(labels.tolist())
        return {part: first[label] for part, label in bodies if label in first}

    def restricted(self, body: FloatingBody) -> FloatingBody:
        """A body with the motions that its remote loads do not prescribe (local)."""
        loads = self._loads(body)
        if not loads:
            return body
        prescribed = [np.isnan(load.motion.load) for _, load, _ in loads]
        pairs = zip(loads, prescribed, strict=True)
        return body.without(np.hstack([rates[:, on] for (_, _, rates), on in pairs]))

    def _loads(self, body: FloatingBody) -> list[tuple[int, Any, Array]]:
        """Loads of a body: number, load, its motions due to those of the body, (motions, 3) [1]."""
        found = [(n, load, load.motions_by(body)) for n, load in self._at.get(body.label, ())]
        at_sections = dict(self.sections)
        of_body = body.motions.shape[1] - len(body.sections)
        for column, section in enumerate(body.sections, of_body):
            rates = np.outer(body.motions[:, column], np.eye(of_body)[0])
            found.append((section.number, at_sections[section.number], rates))
        return found

    def move(self, body: FloatingBody, coefficients: Array) -> None:
        """Move the remote loads of a body along with it, in driven motions (local).

        Args:
            body: The body.
            coefficients: Factors of its motions, shape (motions,) [length].
        """
        for _, load, rates in self._loads(body):
            change = np.where(np.isfinite(load.motion.load), coefficients @ rates, 0.0)
            load.motion.place = place_after(load.motion.place, change, load.arm)

    def subtract(self, body: FloatingBody, coefficients: Array, motion: Array) -> None:
        """Subtract the motions due to those of a body from increments ``motion`` (local).

        Args:
            body: The body.
            coefficients: Factors of its motions, shape (motions,) [length].
            motion: Increments of obstacles and remote loads, shape (m, 3) [length]; changed.
                Empty if all are prescribed.
        """
        for number, _, rates in self._loads(body) if motion.size else ():
            motion[self._first + number] -= coefficients @ rates
