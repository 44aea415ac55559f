# SPDX-License-Identifier: MIT
"""Random obstacles that turn far in one step past a block, judged by sampling their motion.

A paddle turns by up to 8 radian about a pivot anywhere, while the pivot may move. A block is fixed
at a side, and the paddle touches it neither at the start nor at the end. A passage has to be
reported if a slave node is on either side of the middle line of the paddle in successive samples,
a facet or more from both of its ends; none may be reported if the paddle stays away from the block.
Cases in between are drawn again. A wheel that is pressed on a block and spins in place does not go
through it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import neo_hookean
from demos.studies.stability.physics import size
from fenics_mortar.energies import lame
from meshes.mapped_grids import Grid, block, mesh

# Distance of a passage from the ends of a paddle that has to be reported; distance of a paddle
# without a report [facets].
WITHIN, AWAY = 1.0, 0.05
# Largest motion of a paddle between two samples [facets].
SPACING = 0.05
SIDES = ("bottom", "right", "top", "left")


def draw_turning(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """Draw a wheel that spins in place, or a paddle that goes past a block or through it."""
    return _wheel(rng) if rng.random() < 0.2 else _paddle(rng)


def _wheel(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """A wheel with friction that is pressed on a block and turned."""
    kind = str(rng.choice(["circle", "spline", "polygon"]))
    unit, columns, turn = size(rng, 1e-3, 1e3), int(rng.integers(16, 40)), rng.uniform(-8.0, 8.0)
    mu, depth = rng.uniform(0.0, 0.4), rng.uniform(0.01, 0.06)
    about = {"scene": "wheel", "kind": kind, "columns": columns, "turn": turn, "mu": mu}

    def solve() -> Any:
        angles = 2.0 * np.pi * np.arange(32) / 32
        points = unit * (0.5 * np.stack([np.cos(angles), np.sin(angles)], axis=1) + [0.0, 0.5])
        wheel: fm.Obstacle = fm.Circle((0.0, 0.5 * unit), 0.5 * unit)
        if kind == "spline":
            wheel = fm.Spline(points, closed=True)
        elif kind == "polygon":
            wheel = fm.Polygon(points, 0.01 * unit)
        x = unit * block(columns, columns // 2, width=2.0, height=1.0, corner=(-1.0, -1.0))
        problem = _block(x, ["top"], "bottom", wheel, fm.Coulomb(mu))
        reports = []
        for push in (0.5, 1.0):
            wheel.move(y=-push * depth * unit)
            reports.append(problem.solve())
        wheel.move(angle=turn)
        reports.append(problem.solve(accept_violations=True))
        return reports, _errors(reports[-1], False), reports[-1].certificate.remarks()

    return about, solve


def _paddle(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """A paddle past a block, neither of them touching at the start and at the end."""
    wanted, passes = bool(rng.random() < 0.5), None
    while passes is not wanted:
        length, width, h = rng.uniform(0.6, 2.0), size(rng, 0.01, 0.2), rng.uniform(0.05, 0.15)
        pivot, turn = rng.uniform((-0.3, -0.3), (1.0, 0.3)), rng.uniform(-8.0, 8.0)
        shift = rng.uniform(-1.0, 1.0, 2) * float(rng.choice([0.0, 0.5]))
        box = np.concatenate([rng.uniform(-2.0, 2.0, 2), size(rng, 0.02, 0.8) * np.ones(2)])
        box[2:] *= rng.uniform(0.3, 1.0, 2)
        counts = np.maximum(np.round(box[2:] / h), 1).astype(int)
        paddle = np.array([(0, -0.5), (1, -0.5), (1, 0.5), (0, 0.5)]) * (length, width)
        free = [side for side in SIDES if rng.random() < 0.7] or ["top"]
        fixed = str(rng.choice([s for s in SIDES if s not in free] or SIDES))
        x = block(*counts, width=box[2], height=box[3], corner=box[:2])
        places = _places(turn, shift, pivot, paddle, box, h)
        passes = _passes(x, free, fixed, paddle, pivot, places, h)
    unit, pose = size(rng, 1e-3, 1e3), rng.uniform(0.0, 2.0 * np.pi)
    about = {
        "scene": "paddle", "length": length, "width": width, "facet": h, "turn": turn,
        "shift": shift.tolist(), "sides": free, "passes": passes,
    }  # fmt: skip

    def solve() -> Any:
        posed = unit * _rotation(pose)
        corners, about_pivot = paddle @ posed.T, posed @ pivot
        obstacle = fm.Polygon(corners, 0.2 * unit * width, pivot=about_pivot, name="paddle")
        problem = _block(x @ posed.T, free, fixed, obstacle, None)
        problem.solve()
        dx, dy = posed @ shift
        obstacle.move(x=dx, y=dy, angle=turn)
        report = problem.solve(accept_violations=True)
        return [report], _errors(report, bool(passes)), report.certificate.remarks()

    return about, solve


def _block(
    x: np.ndarray, free: list[str], fixed: str, obstacle: fm.Obstacle, law: Any
) -> fm.ContactProblem:
    """A block with E = 1, its nodes at ``x``, and contact of its ``free`` sides."""
    data = mesh([Grid("block", x)])
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    residual = ufl.inner(neo_hookean(u, *lame(1.0, 0.3)), ufl.grad(v)) * dx
    pair = fm.ContactPair(data, [f"block/{side}" for side in free], obstacle, law=law)
    bcs = [fm.dirichlet(V, data, f"block/{fixed}", (0.0, 0.0))]
    return fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="turning_")


def _errors(report: Any, passes: bool) -> list[str]:
    found = report.certificate.passages
    if passes and not found:
        return ["a passage is not reported"]
    return [] if passes else [f"false: {message}" for message in found]


def _places(
    turn: float, shift: np.ndarray, pivot: np.ndarray, paddle: np.ndarray, box: np.ndarray, h: float
) -> np.ndarray:
    """Places (x, y, angle) of a paddle from start to end, shape (n, 3)."""
    reach = np.linalg.norm(paddle - pivot, axis=1).max()
    way = abs(turn) * reach + np.linalg.norm(shift)
    return np.linspace(0.0, 1.0, int(way / (SPACING * h)) + 2)[:, None] * [*shift, turn]


def _passes(
    x: np.ndarray, free: list[str], fixed: str, paddle: np.ndarray, pivot: np.ndarray,
    places: np.ndarray, h: float,
) -> bool | None:  # fmt: skip
    """Whether a paddle passes the block; ``None`` if that is not clear, or it touches at the ends.

    In the frame of the paddle its middle line is the x axis, from 0 to its length.
    """
    sides = {"bottom": x[:, 0], "right": x[-1], "top": x[:, -1], "left": x[0]}
    nodes = np.concatenate([sides[side] for side in free])
    corners = np.array([x[0, 0], x[-1, 0], x[-1, -1], x[0, -1]])
    gaps = np.array([_gap(_own(corners, place, pivot), paddle) for place in places])
    if min(gaps[0], gaps[-1]) < AWAY * h:
        return None
    if gaps.min() > AWAY * h:
        return False
    own = np.array([_own(nodes, place, pivot) for place in places])
    along, across = own[..., 0], own[..., 1]
    inside = (along > WITHIN * h) & (along < paddle[:, 0].max() - WITHIN * h)
    crosses = (across[1:] * across[:-1] < 0.0) & inside[1:] & inside[:-1]
    return True if crosses.any() else None


def _own(points: np.ndarray, place: np.ndarray, pivot: np.ndarray) -> np.ndarray:
    """Points (n, 2) in the frame of an obstacle at a place."""
    return (points - pivot - place[:2]) @ _rotation(place[2]) + pivot


def _rotation(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _gap(one: np.ndarray, other: np.ndarray) -> float:
    """Lower bound of the distance of convex polygons by separating axes, negative if they meet."""
    gaps = []
    for polygon in (one, other):
        edges = np.roll(polygon, -1, axis=0) - polygon
        axes = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        a, b = one @ axes.T, other @ axes.T
        gaps.append(np.maximum(a.min(axis=0) - b.max(axis=0), b.min(axis=0) - a.max(axis=0)).max())
    return float(max(gaps))
