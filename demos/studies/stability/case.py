# SPDX-License-Identifier: MIT
"""A problem of bodies, pairs and prescribed motions as numbers."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from demos.studies.stability.random_bodies import Array, Body


def at_time(values: Array, time: float) -> Array:
    """Values (times, k) at times 0, 1, 2 and so on, linear in between."""
    return np.array([np.interp(time, np.arange(len(values)), column) for column in values.T])


@dataclass(frozen=True)
class Prescribed:
    """A boundary whose displacement is prescribed, linear between its values at times 0, 1, 2.

    Attributes:
        boundary: Name of the boundary.
        motion: Values, shape (3, 2) [length].
        component: 0 or 1 if only one component is prescribed.
    """

    boundary: str
    motion: Array
    component: int | None = None


@dataclass(frozen=True)
class Case:
    """A problem as numbers.

    Attributes:
        seed: Seed of the problem.
        about: Drawn values, as text.
        bodies: Bodies, from bottom to top.
        pairs: Slave and master boundaries.
        prescribed: Prescribed displacements.
        pressed: Boundary with a traction.
        traction: Values of the traction at times 0, 1, 2, shape (3, 2) [stress].
        step: First step along the path, which is the largest one by default.
        pair_options: Options of the discretization of all pairs, none in most cases.
        problem_options: Options of the problem, none in most cases.
    """

    seed: int
    about: dict[str, Any]
    bodies: list[Body]
    pairs: list[tuple[str, str]]
    prescribed: list[Prescribed]
    pressed: str
    traction: Array
    step: float
    pair_options: dict[str, Any] = field(default_factory=dict)
    problem_options: dict[str, Any] = field(default_factory=dict)

    @property
    def smallest(self) -> float:
        """Smallest step, below which a path fails, as by default in ``SteppingOptions``."""
        return 1e-6

    @property
    def cell(self) -> str:
        """Name of the cells."""
        return {3: "triangle", 4: "quadrilateral"}[self.bodies[0].cells.shape[1]]

    @property
    def stop(self) -> float:
        """Final time of the path: 1 if nothing slides."""
        motions = [prescribed.motion for prescribed in self.prescribed]
        return 2.0 if any((motion[1] != motion[2]).any() for motion in motions) else 1.0

    @property
    def first_nodes(self) -> Array:
        """Number of the first node of each body, and of all nodes, shape (bodies + 1,)."""
        return np.cumsum([0, *(len(body.x) for body in self.bodies)])

    @property
    def x(self) -> Array:
        """Positions of all nodes [length]."""
        return np.concatenate([body.x for body in self.bodies])

    @property
    def cells(self) -> Array:
        """Nodes of all cells."""
        return np.concatenate([b.cells + first for b, first in zip(self.bodies, self.first_nodes)])

    def number_of(self, boundary: str) -> int:
        """Number of the body that a boundary belongs to."""
        return [body.name for body in self.bodies].index(boundary.split("/")[0])

    def nodes_of(self, boundary: str) -> Array:
        """Nodes along a boundary."""
        number = self.number_of(boundary)
        return self.first_nodes[number] + self.bodies[number].sides[boundary.split("/")[1]]

    def outline_of(self, boundary: str) -> Array:
        """Nodes around the body that a boundary belongs to."""
        number = self.number_of(boundary)
        return self.first_nodes[number] + self.bodies[number].outline

    @property
    def can_be_swapped(self) -> bool:
        """Whether no node would be slave in two pairs."""
        masters = [master for _, master in self.pairs]
        return len(set(masters)) == len(masters)

    def swapped(self) -> Case:
        """The problem with slave and master exchanged."""
        return replace(self, pairs=[(master, slave) for slave, master in self.pairs])

    def refined(self) -> Case:
        """The problem with four times the cells."""
        return replace(self, bodies=[body.refined() for body in self.bodies])
