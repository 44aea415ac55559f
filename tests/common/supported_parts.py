# SPDX-License-Identifier: MIT
"""Parts of scenes supported by friction or adhesion, and their rigid bodies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import fenics_mortar as fm
from demos.studies.stability.limit_analysis import GROUND, Point, Structure
from demos.studies.stability.touching import normal_of, touching_lines, touching_plane
from fenics_mortar.contact.law import Stick
from meshes.mapped_grids import Grid

Array = np.ndarray
Loads = dict[str, float]


@dataclass(frozen=True)
class Body:
    """A body in the frame of its scene.

    Attributes:
        grid: Grid of the body.
        weight: Force along gravity, for gravity one.
        push: Force along the push, for a push of one.
        torque: Moment about its centre, for a torque of one.
        E: Young's modulus over that of the scene.
        clamped: Sides that are fixed.
        guided: Sides with one fixed component, and its number.
    """

    grid: Grid
    weight: float = 0.0
    push: float = 0.0
    torque: float = 0.0
    E: float = 1.0
    clamped: tuple[str, ...] = ()
    guided: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True)
class Flat:
    """A rigid plane; ``force`` drives it along its normal, its other motions are prescribed."""

    point: tuple[float, float]
    normal: tuple[float, float]
    name: str = "plane"
    force: tuple[float, float] | None = None


@dataclass(frozen=True)
class Touch:
    """A pair: slave boundary, master boundary or plane, its law.

    ``at``: contact points for limit analysis, if they do not follow from the lines.
    """

    slave: str
    master: str | Flat
    law: fm.Law | None = None
    at: Sequence[Sequence[float]] | None = None
    options: dict[str, Any] = field(default_factory=dict)


class Glue(fm.Coulomb):
    """Coulomb's friction and adhesion that decreases over a length."""

    def __init__(self, mu: float, pull: float, length: float) -> None:
        super().__init__(mu)
        self.pull, self.length = pull, length

    def adhesion(self, gap: Array) -> tuple[Array, Array]:
        """The pull across a gap."""
        pull = self.pull * np.exp(-gap / self.length)
        return pull, -pull / self.length


def flat_nodes(grid: Grid) -> Array:
    """Positions of the nodes of a grid in the order of their numbers, shape (nodes, 2)."""
    numbers = grid.numbers()
    x = np.zeros((numbers.max() + 1, 2))
    x[numbers.ravel()] = grid.x.reshape(-1, 2)
    return x


def line_of(grid: Grid, side: str) -> Array:
    """Nodes along a side, the body on the left."""
    x = grid.x
    return {"bottom": x[:, 0], "right": x[-1], "top": x[::-1, -1], "left": x[0, ::-1]}[side]


def measure(grid: Grid) -> tuple[float, Array, float]:
    """Area, centre, and polar moment of area about the centre, of the meshed polygon cells."""
    x = grid.x
    a, b, c, d = x[:-1, :-1], x[1:, :-1], x[1:, 1:], x[:-1, 1:]
    area, first, polar = 0.0, np.zeros(2), 0.0
    for p, q, r in ((a, b, c), (a, c, d)):
        p, q, r = (y.reshape(-1, 2) for y in (p, q, r))
        u, v = q - p, r - p
        S = 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        area += S.sum()
        first += (S[:, None] * (p + q + r) / 3.0).sum(axis=0)
        middles = [(p + q) / 2, (q + r) / 2, (r + p) / 2]
        polar += sum((S / 3.0 * (m**2).sum(axis=1)).sum() for m in middles)
    centre = first / area
    return float(area), centre, float(polar - area * centre @ centre)


def structure(
    bodies: list[Body], touches: list[Touch], directions: dict[str, Array], dead: Loads, live: Loads
) -> Structure:
    """Limit analysis of bodies that are not clamped, and of driven planes."""
    free = [body for body in bodies if not body.clamped]
    number = {body.grid.name: k for k, body in enumerate(free)}
    driven = {t.master.name: t.master for t in touches if isinstance(t.master, Flat)}
    driven = {name: flat for name, flat in driven.items() if flat.force is not None}
    number |= {name: len(free) + k for k, name in enumerate(driven)}
    wrenches = []
    for loads in (dead, live):
        rows = [_wrench(body, directions, loads) for body in free]
        rows += [
            np.array([*flat.force, _cross(flat.point, flat.force)]) * (loads is dead)
            for flat in driven.values()
        ]
        wrenches.append(np.array(rows).reshape(-1, 3))
    guided = np.zeros((len(number), 3), bool)
    for body in free:
        for side, component in body.guided:
            guided[number[body.grid.name], [component, 2]] = True
            if not np.ptp(line_of(body.grid, side)[:, 1 - component]) > 0.0:
                raise ValueError(f"{side}: a guide has to keep the body from turning, too")
    for name, flat in driven.items():
        along = int(np.abs(flat.normal).argmax())
        guided[number[name], [1 - along, 2]] = True
    grids = {body.grid.name: body.grid for body in bodies}
    points = [p for t in touches for p in _points(t, grids, number)]
    return Structure(points, wrenches[0], wrenches[1], guided)


def _cross(x: Any, f: Any) -> float:
    return float(x[0] * f[1] - x[1] * f[0])


def _wrench(body: Body, directions: dict[str, Array], loads: Loads) -> Array:
    """Force and moment about the origin of the loads on a body."""
    _, centre, _ = measure(body.grid)
    force = body.weight * loads.get("weight", 0.0) * directions["gravity"]
    force = force + body.push * loads.get("push", 0.0) * directions["push"]
    moment = _cross(centre, force) + body.torque * loads.get("torque", 0.0)
    return np.array([*force, moment])


def _points(touch: Touch, grids: dict[str, Grid], number: dict[str, int]) -> Iterator[Point]:
    """Contact points of a pair."""
    owner, side = touch.slave.split("/")
    one, line = number.get(owner, GROUND), line_of(grids[owner], side)
    if isinstance(touch.master, Flat):
        other = number.get(touch.master.name, GROUND)
        normal = np.array(touch.master.normal) / np.linalg.norm(touch.master.normal)
        found = touching_plane(line, np.array(touch.master.point), normal)

        def normal_at(_: Array) -> Array:
            return normal
    else:
        name, other_side = touch.master.split("/")
        other, master = number.get(name, GROUND), line_of(grids[name], other_side)
        found = touching_lines(line, master)

        def normal_at(x: Array) -> Array:
            return normal_of(master, x)

    law = touch.law or fm.Frictionless()
    mu = np.inf if isinstance(law, Stick) else getattr(law, "mu", 0.0)
    pull = float(law.adhesion(np.zeros(1))[0][0]) if law.has_adhesion else 0.0
    if touch.at is not None:
        found = [(np.array(x, float), 0.0) for x in touch.at]
    for x, share in found:
        yield Point(one, other, x, normal_at(x), mu, pull * share)
