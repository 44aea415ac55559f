# SPDX-License-Identifier: MIT
"""Paths of the nodes of hulls in a step in space, from its ends.

Each body moves rigidly, with the rotation that fits its two positions best, at constant speeds
about the shortest way, and is strained at a constant rate in its own frame. The step is divided
into sections in which bodies turn little, so that nodes move straight within each of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fenics_mortar.utils.arrays import Array, Indices, norms
from fenics_mortar.utils.rounding import SMALL_ANGLE, TINY
from fenics_mortar.verify.finding import LIMITS


@dataclass(frozen=True)
class RigidMotion:
    """Motion of a body in a step.

    Attributes:
        start: Its centre at the start, shape (3,) [length].
        end: Its centre at the end, shape (3,) [length].
        vector: Rotation vector, shape (3,) [radian]; zero for small angles.
    """

    start: Array
    end: Array
    vector: Array

    def centre(self, time: float) -> Array:
        """Centre at a ``time`` from 0 to 1, shape (3,) [length]."""
        return (1.0 - time) * self.start + time * self.end

    def turned(self, vectors: Array, time: float) -> Array:
        """Vectors (n, 3) [any unit] turned by the rotation up to a ``time``, negative: back."""
        angle = float(np.linalg.norm(self.vector))
        if angle == 0.0:
            return vectors
        axis, a = self.vector / angle, time * angle
        across = np.cross(axis, vectors)
        along = np.outer(vectors @ axis, axis)
        return along + np.cos(a) * (vectors - along) + np.sin(a) * across


def motion_between(x0: Array, x1: Array) -> RigidMotion:
    """The rigid motion that fits two positions (n, 3) of a body best (Kabsch 1976)."""
    start, end = x0.mean(axis=0), x1.mean(axis=0)
    left, _, right = np.linalg.svd((x1 - end).T @ (x0 - start))
    sign = np.ones(3)
    sign[2] = np.sign(np.linalg.det(left) * np.linalg.det(right)) or 1.0
    rotation = (left * sign) @ right
    angle = float(np.arccos(np.clip(0.5 * (np.trace(rotation) - 1.0), -1.0, 1.0)))
    if angle < SMALL_ANGLE:
        return RigidMotion(start, end, np.zeros(3))
    from scipy.spatial.transform import Rotation  # not imported by problems without rotations

    return RigidMotion(start, end, Rotation.from_matrix(rotation).as_rotvec())


class SpacePaths:
    """Positions of all nodes at the ends of the sections of a step.

    Args:
        x0: Positions at the start, shape (n, 3) [length].
        x1: Positions at the end, shape (n, 3) [length].
        bodies: Body of each node, shape (n,).
        obstacles: Motions of obstacles, by labels that are no bodies.
        resolution: Largest distance of a path from its straight sections [length].

    Attributes:
        motions: Motions of bodies and obstacles.
        times: Ends of the sections, shape (sections + 1,), from 0 to 1.
        along: Positions at these times, shape (sections + 1, n, 3) [length].
    """

    def __init__(
        self,
        x0: Array,
        x1: Array,
        bodies: Indices,
        obstacles: Mapping[int, RigidMotion],
        resolution: float,
    ) -> None:
        self.motions: dict[int, RigidMotion] = dict(obstacles)
        for body in np.unique(bodies).tolist():
            self.motions[body] = motion_between(x0[bodies == body], x1[bodies == body])
        self.times = np.linspace(0.0, 1.0, self._count(x0, resolution) + 1)
        self.along = np.empty((len(self.times), *x0.shape))
        for body in np.unique(bodies).tolist():
            at, motion = bodies == body, self.motions[body]
            begin = x0[at] - motion.start
            strain = motion.turned(x1[at] - motion.end, -1.0) - begin
            for k, time in enumerate(self.times):
                self.along[k, at] = motion.centre(time) + motion.turned(begin + time * strain, time)

    def _count(self, x0: Array, resolution: float) -> int:
        """Number of sections: the sagitta of a chord of angle a is r a^2 / 8."""
        count = 1
        for motion in self.motions.values():
            turn, reach = np.linalg.norm(motion.vector), norms(x0 - motion.start).max(initial=TINY)
            largest = min(np.sqrt(8.0 * resolution / reach), LIMITS.section_turn)
            count = max(count, int(min(np.ceil(turn / max(largest, TINY)), LIMITS.max_points)))
        return count

    def carried(self, motion: RigidMotion, points: Array) -> Array:
        """Positions of points (k, 3) [length] at the start moved along, (sections + 1, k, 3)."""
        turned = (motion.turned(points - motion.start, time) for time in self.times)
        return np.array([motion.centre(t) + x for t, x in zip(self.times, turned, strict=True)])

    def seen_from(self, label: int, along: Array | None = None) -> Array:
        """Positions in the frame of a body or an obstacle, shape (sections + 1, n, 3) [length].

        Args:
            label: Label of the body or the obstacle.
            along: Positions in space at the ends of the sections; those of all nodes by default.
        """
        motion = self.motions[label]
        frames = zip(self.along if along is None else along, self.times, strict=True)
        return np.array([motion.turned(x - motion.centre(time), -time) for x, time in frames])
