# SPDX-License-Identifier: MIT
"""A problem of bodies supported by contact with friction alone: its data, no drawing."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from demos.studies.stability.case import Case
from demos.studies.stability.random_bodies import Array, Body
from demos.studies.stability.user_laws import Rule

# A point with a normal, of a rigid plane.
Plane = tuple[Array, Array]


@dataclass(frozen=True)
class SupportedCase(Case):
    """A problem of bodies supported by friction.

    Attributes:
        planes: Rigid planes by name, among the masters.
        friction: Coefficient of each pair.
        pulls: Adhesion of each pair; none if empty [stress].
        fade: Gap over which adhesion decreases to a third [length].
        loads: Force and moment about its centre of each body at times 0, 1, 2, (3, bodies, 3).
        clamped: Names of the bodies that do not move.
        end: Time at which bodies move by limit analysis; infinite if never.
        yielding: Largest elastic displacement [length].
    """

    planes: dict[str, Plane] = field(default_factory=dict)
    friction: list[float] = field(default_factory=list)
    pulls: list[float] = field(default_factory=list)
    fade: float = 1.0
    loads: Array = field(default_factory=lambda: np.zeros((3, 0, 3)))
    clamped: tuple[str, ...] = ()
    end: float = np.inf
    yielding: float = np.inf

    @property
    def rules(self) -> list[Rule]:
        """Law of each pair."""
        pulls = self.pulls or [0.0] * len(self.pairs)
        return [
            Rule("sticky" if pull else "Coulomb", mu, length=self.fade, stress=pull)
            for mu, pull in zip(self.friction, pulls, strict=True)
        ]

    @property
    def stop(self) -> float:
        """Final time: the weight until 1, then the other load."""
        return 2.0

    @property
    def smallest(self) -> float:
        """Smallest step: the accuracy of limit analysis."""
        return 0.02

    @property
    def can_be_swapped(self) -> bool:
        """Planes cannot be slaves."""
        return not self.planes and super().can_be_swapped

    @property
    def areas(self) -> list[tuple[float, Array, float]]:
        """Area, centre and polar moment about it of the bodies."""
        return [measured(body) for body in self.bodies]

    def densities(self, loads: Array) -> Array:
        """Body forces (x, y) and moment density over polar moment, shape (bodies, 3)."""
        areas = self.areas
        rows = [[x / a, y / a, m / p] for (x, y, m), (a, _, p) in zip(loads, areas)]
        return np.array(rows)


def measured(body: Body) -> tuple[float, Array, float]:
    """Area, centre and polar moment about it, of the cells as two triangles each."""
    x = body.x
    a, b, c = x[body.cells[:, :3].T]
    triangles = [(a, b, c)]
    if body.cells.shape[1] == 4:
        triangles.append((x[body.cells[:, 1]], x[body.cells[:, 3]], x[body.cells[:, 2]]))
    area, first, polar = 0.0, np.zeros(2), 0.0
    origin = x.mean(axis=0)
    for p, q, r in triangles:
        p, q, r = p - origin, q - origin, r - origin
        u, v = q - p, r - p
        S = 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        area += S.sum()
        first += (S[:, None] * (p + q + r) / 3.0).sum(axis=0)
        polar += sum((S * (m**2).sum(axis=1)).sum() for m in (p + q, q + r, r + p)) / 12.0
    centre = first / area
    return float(area), centre + origin, float(polar - area * centre @ centre)
