# SPDX-License-Identifier: MIT
"""Random wheels and shafts that turn with friction: work, direction of the force, no slip.

===========  ===================================================================================
problem      judge
===========  ===================================================================================
wheel        a rigid wheel under a clamped block, turned by up to three turns in a step: the work
             by slip is moment times angle, and the force has the direction of its rotation
shaft        a hollow shaft in a ring with interference, turned at its bore by less than a third
             of a turn in a step: likewise
together     the wheel and the block turn about a point: no slip
===========  ===================================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.stability.physics import SOLVED, differs, size
from fenics_mortar import energies
from meshes.mapped_grids import Grid, block, mesh, sector

# Work between two meshed sides: their facets are polygons of at least 24 sides.
OF_MESH = 2e-3


def draw_spinning(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """Draw a problem and its judge."""
    kind = str(rng.choice(["together", "shaft", "together", "wheel"]))
    unit, E, mu = size(rng, 1e-3, 1e3), size(rng, 1e-3, 1e6), rng.uniform(0.05, 0.8)
    about = {"scene": kind, "mu": mu, "degree": int(rng.integers(1, 3))}
    return (_shaft if kind == "shaft" else _wheel)(rng, about, unit, E)


def _problem(
    data: Any, about: dict[str, Any], E: float, pair: Any, sides: Sequence[str]
) -> tuple[fm.ContactProblem, dict[str, fem.Function]]:
    """A neo-Hookean problem, and functions of the displacement prescribed at the boundaries."""
    V = fm.vector_space(data.mesh, about["degree"])
    u, v = fem.Function(V), ufl.TestFunction(V)
    given = {name: fem.Function(V) for name in sides}
    psi = energies.neo_hookean(u, *energies.lame(E, 0.3))
    metadata = {"quadrature_degree": 2 * about["degree"]}
    residual = ufl.derivative(psi * ufl.dx(metadata=metadata), u, v)
    bcs = [fm.dirichlet(V, data, name, function) for name, function in given.items()]
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="turning_")
    return problem, given


def _turn(function: fem.Function, angle: float, about: Any = (0.0, 0.0)) -> None:
    """Prescribe a rotation about a point."""
    c, s = np.cos(angle), np.sin(angle)
    R, point = np.array([[c, -s], [s, c]]), np.asarray(about, float)[:, None]
    function.interpolate(lambda x: (R - np.eye(2)) @ (x[:2] - point))


def _wheel(
    rng: np.random.Generator, about: dict[str, Any], unit: float, E: float
) -> tuple[dict[str, Any], Callable[[], Any]]:
    """A wheel below a block, with any pivot if both turn."""
    radius, depth = size(rng, 0.3, 5.0), rng.uniform(0.01, 0.03)
    angle = float(rng.uniform(0.3, 6.0 * np.pi) * rng.choice([-1.0, 1.0]))
    if about["scene"] == "together":
        angle = float(rng.uniform(-1.2, 1.2))
    point = rng.uniform(-3.0, 3.0, 2) * unit
    about |= {"radius": radius, "depth": depth, "angle": angle}

    def solve() -> Any:
        degree = about["degree"]
        grid = Grid("block", unit * block(8 * degree, 4 * degree, width=1.0, height=0.5))
        data = mesh([grid], order=degree)
        wheel = fm.Circle((0.5 * unit, -radius * unit), radius * unit, name="wheel")
        pair = fm.ContactPair(data, "block/bottom", wheel, law=fm.Coulomb(about["mu"]))
        problem, given = _problem(data, about, E, pair, ("block/top",))
        reports = [_moved(problem, wheel, y=depth * unit)]
        if about["scene"] == "together":
            _turn(given["block/top"], angle, point)
            x = wheel.pivot + wheel.place[:2] - point
            c, s = np.cos(angle), np.sin(angle)
            x, y = point + np.array([[c, -s], [s, c]]) @ x - wheel.pivot
            reports.append(_moved(problem, wheel, x=x, y=y, angle=angle))
            slip = problem.contacts[0].slip[problem.contacts[0].active]
            return reports, list(differs("slip", slip / unit + 1.0, 1.0, SOLVED)), []
        reports += [_moved(problem, wheel, angle=n * angle) for n in (1, 2)]
        errors = list(_judge(problem, -wheel.reaction[2] * angle, SOLVED))
        if problem.contacts[0].total_force[0] * angle > 0.0:
            errors.append("the block is pushed backwards")
        return reports, errors, reports[-1].certificate.remarks()

    return about, solve


def _moved(problem: fm.ContactProblem, wheel: fm.Circle, **motion: float) -> Any:
    """Report of a step in which the wheel is moved."""
    wheel.move(**motion)
    return problem.solve()


def _shaft(
    rng: np.random.Generator, about: dict[str, Any], unit: float, E: float
) -> tuple[dict[str, Any], Callable[[], Any]]:
    """A shaft of radius 1 in a ring; either is the slave."""
    columns, interference = rng.integers(24, 33, 2), rng.uniform(0.02, 0.04)
    per_turn = float(rng.uniform(3.2, 16.0))
    slave = str(rng.choice(["shaft", "ring"]))
    about |= {"columns": columns.tolist(), "per turn": per_turn, "slave": slave}

    def solve() -> Any:
        degree = about["degree"]
        radii = (0.4, 1.0 + interference), (1.0, 1.4)
        grids = [
            Grid(name, unit * sector(degree * n, 2 * degree, radii=r), closed=True)
            for name, n, r in zip(("shaft", "ring"), columns.tolist(), radii, strict=True)
        ]
        data = mesh(grids, order=degree)
        sides = ["shaft/bottom", "ring/top"][:: 1 if slave == "shaft" else -1]
        pair = fm.ContactPair(data, *sides, law=fm.Coulomb(about["mu"]))
        problem, given = _problem(data, about, E, pair, ("shaft/top", "ring/bottom"))
        reports, step = [problem.solve()], 2.0 * np.pi / per_turn
        for number in (1, 2, 3):
            _turn(given["shaft/top"], number * step)
            reports.append(problem.solve())
        contact = problem.contacts[0]
        x, force = contact.positions, contact.forces
        moment = float((x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]).sum())
        errors = list(_judge(problem, abs(moment) * step, OF_MESH))
        if moment * (1.0 if slave == "shaft" else -1.0) > 0.0:
            errors.append("friction drives the shaft")
        return reports, errors, reports[-1].certificate.remarks()

    return about, solve


def _judge(problem: fm.ContactProblem, work: float, allowed: float) -> Iterator[str]:
    """Messages if the work of friction by slip is another one."""
    yield from differs("work of friction", problem.contacts[0].friction_work, work, allowed)
