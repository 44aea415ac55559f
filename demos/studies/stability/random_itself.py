# SPDX-License-Identifier: MIT
"""Random bodies that touch themselves: C-rings against chosen sides, folding honeycombs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import neo_hookean
from demos.studies.stability.physics import certified, differs, follow, size
from fenics_mortar.energies import lame
from meshes.mapped_grids import Grid, mesh, sector

# Largest relative difference for equal slave facets: sums are computed in another order [1].
SAME = 1e-8
# Largest sum of forces on the body over the sum of their norms, by Newton's tolerance [1].
BALANCE = 1e-9
# Largest relative change of the force of a honeycomb with friction by half the step size [1].
OF_STEPS = 0.1
ENDS = ["ring/left", "ring/right"]


def draw_itself(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """Draw a ring or a honeycomb."""
    return _ring(rng) if rng.random() < 0.6 else _comb(rng)


def _ring(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """A C-ring with a mouth, closed and slid, plane or the section of a torus."""
    mouth, wall = rng.uniform(0.06, 0.2), rng.uniform(0.12, 0.3)
    columns, rows = int(rng.integers(24, 50)), int(rng.integers(2, 5))
    mu, angle = float(rng.choice([0.0, rng.uniform(0.1, 0.8)])), rng.uniform(0.0, 2.0 * np.pi)
    unit, nu = size(rng, 1e-3, 1e3), rng.uniform(0.0, 0.4)
    slide, push = rng.uniform(-0.3, 0.3) * wall, rng.uniform(1.2, 1.6) * mouth
    order, whole = int(rng.integers(1, 3)), bool(rng.random() < 0.5)
    about = {
        "scene": "ring", "mouth": mouth, "wall": wall, "columns": columns, "rows": rows, "mu": mu,
        "degree": order,
    }  # fmt: skip

    def posed(names: Any) -> tuple[fm.ContactProblem, Any]:
        half = np.arcsin(mouth / 2.0)
        shape = sector(
            order * (columns // order), order * rows, radii=(1.0 - wall, 1.0),
            angles=(half, 2.0 * np.pi - half),
        )  # fmt: skip
        shape[0, :, 1], shape[-1, :, 1] = 0.5 * mouth, -0.5 * mouth
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, s], [-s, c]])
        data = mesh([Grid("ring", unit * shape @ turn)], order=order)

        def ends(side: float) -> Any:
            def where(x: Any) -> Any:
                own = x[:2].T @ turn.T / unit
                far = np.hypot(*own.T) > 1.0 - 1e-3
                return far & (own[:, 0] > 0.5) & (side * own[:, 1] > mouth)

            return where

        pair = fm.ContactPair(data, *names, law=fm.Coulomb(mu) if mu else None)
        motion = unit * np.array([slide, -push]) @ turn
        return _problem(data, order, nu, [pair], (ends(-1.0), ends(1.0)), motion)

    def solve() -> Any:
        every = [*ENDS, "ring/top", "ring/bottom"]
        problems, reports, places = [], [], []
        for names in (ENDS, ENDS[::-1], [ENDS], *([[every]] if whole else [])):
            problem, load = posed(names)
            reports += follow(problem, load, 5)
            problems.append(problem)
            places.append(problem.equations.bulk.u.x.array.copy())
        errors, remarks = certified(problems)
        chosen = min(places[:2], key=lambda place: np.abs(place - places[2]).max())
        errors += differs("the displacement", places[2], chosen, SAME)
        errors += [w for problem in problems for w in differs(
            "1 + resultant", 1.0 + _resultant(problem), 1.0, BALANCE
        )]  # fmt: skip
        errors += [] if _sizes(problems[2]) > 0.0 else ["the ends do not touch"]
        return reports, errors, remarks

    return about, solve


def _comb(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """A honeycomb of 2 x 2 cells, compressed until its walls touch."""
    seed, wall = int(rng.integers(1_000_000)), rng.uniform(0.12, 0.18)
    wobble, mu = rng.uniform(0.005, 0.03), rng.uniform(0.1, 0.6)
    part = rng.uniform(0.5, 0.58)
    about = {"scene": "honeycomb", "wall": wall, "wobble": wobble, "mu": mu, "part": part}

    def solve() -> Any:
        forces, reports, problems = [], [], []
        for steps in (10, 20):
            data, ends, height = honeycomb(2, wall, wobble, along=4, seed=seed)
            pair = fm.ContactPair(data, "comb/walls", law=fm.Coulomb(mu))
            motion = np.array([0.0, -part * height])
            problem, load = _problem(data, 1, 0.3, [pair], ends, motion)
            reports += follow(problem, load, steps)
            problems.append(problem)
            forces.append(_sizes(problem))
        errors, remarks = certified(problems)
        errors += differs("the force with half the steps", *forces[::-1], OF_STEPS)
        errors += differs("1 + resultant", 1.0 + _resultant(problems[0]), 1.0, BALANCE)
        errors += [] if forces[0] > 0.0 else ["no walls touch"]
        return reports, errors, remarks

    return about, solve


def honeycomb(
    cells: int, wall: float, wobble: float, *, along: int, seed: int
) -> tuple[fm.MeshData, tuple[Any, Any], float]:
    """Hexagonal cells with sides of about 1, boundary "comb/walls".

    Args:
        cells: Cells of a column, and number of columns.
        wall: Half the thickness of a wall over the distance of its axis from the cell's centre [1].
        wobble: Random change of the corners [length].
        along: Facets of the side of a cell.
        seed: Seed of the corners.

    Returns:
        The mesh; functions of x (3, n) that mark the lower ends of its columns and the upper ones;
        its height.
    """
    rng, corners = np.random.default_rng(seed), dict[tuple[float, ...], np.ndarray]()
    nodes, quads, height = dict[tuple[float, ...], int](), [], np.sqrt(3.0)
    angles = np.pi / 3 * np.arange(6)
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    low, high = list[np.ndarray](), list[np.ndarray]()
    for column, row in np.ndindex(cells, cells):
        outer = np.array([1.5 * column, height * (row + 0.5 * (column % 2))]) + around
        for k, corner in enumerate(outer):
            name = tuple(np.round(corner, 6) + 0.0)
            if name not in corners:
                corners[name] = corner + rng.uniform(-wobble, wobble, 2)
            outer[k] = corners[name]
        inner = outer.mean(axis=0) + (1.0 - wall) * (outer - outer.mean(axis=0))
        low += [outer[4:6]] if row == 0 else []
        high += [outer[1:3]] if row == cells - 1 else []
        s = np.linspace(0.0, 1.0, along + 1)[:, None]
        for k in range(6):
            sides = [(1.0 - s) * p[k] + s * p[(k + 1) % 6] for p in (outer, inner)]
            names = [[tuple(np.round(x, 9) + 0.0) for x in side] for side in sides]
            (a, b) = ([nodes.setdefault(name, len(nodes)) for name in side] for side in names)
            quads += list(zip(a[:-1], a[1:], b[1:], b[:-1], strict=True))
    edges = Counter(tuple(sorted(e)) for q in quads for e in zip(q, (*q[1:], q[0]), strict=True))
    walls = [edge for edge, count in edges.items() if count == 1]
    points = np.array(list(nodes))

    def on(sides: list[np.ndarray]) -> Any:
        return lambda x: np.any([_distance(x[:2].T, *side) < 1e-6 for side in sides], axis=0)

    bodies, boundaries = {"comb": range(len(quads))}, {"comb/walls": walls}
    data = fm.mesh_from_arrays(points, quads, bodies, boundaries)
    return data, (on(low), on(high)), float(np.ptp(points[:, 1]))


def _distance(x: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distance of points (n, 2) from the edge of a to b, shape (n,)."""
    t = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return np.linalg.norm(x - a - t[:, None] * (b - a), axis=1)


def _problem(
    data: fm.MeshData, degree: int, nu: float, pairs: list[Any], ends: tuple[Any, Any], motion: Any
) -> tuple[fm.ContactProblem, Callable[[float], None]]:
    """A neo-Hookean body with E = 1, fixed where ``ends[0]`` marks it and moved at ``ends[1]``."""
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    dx = ufl.dx(metadata={"quadrature_degree": 2 * degree + 2})
    residual = ufl.inner(neo_hookean(u, *lame(1.0, nu)), ufl.grad(v)) * dx
    fixed, moved = (fem.Constant(data.mesh, (0.0, 0.0)) for _ in range(2))
    bcs = [
        fem.dirichletbc(value, fem.locate_dofs_geometrical(V, where), V)
        for value, where in zip((fixed, moved), ends)
    ]
    problem = fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="itself_")

    def load(time: float) -> None:
        moved.value[:] = time * motion

    return problem, load


def _sizes(problem: fm.ContactProblem) -> float:
    """Sum of the norms of the contact forces on slave nodes [stress length]."""
    contact = problem.equations.contacts[0]
    return float(np.linalg.norm(contact.operators.force(contact.z)[0], axis=1).sum())


def _resultant(problem: fm.ContactProblem) -> np.ndarray:
    """Resultant of the contact forces on both sides over their size, shape (2,) [1]."""
    contact = problem.equations.contacts[0]
    total = sum(force.sum(axis=0) for force in contact.operators.force(contact.z))
    return np.asarray(total) / max(_sizes(problem), np.finfo(float).tiny)
