# SPDX-License-Identifier: MIT
"""Hertz's contact in space: errors of the force, of the axes and of the pressure, with rates.

    python3 -m demos.studies.space.hertz
    python3 -m demos.studies.space.hertz sphere hexahedra

The gap of two half-spaces is A x^2 + B y^2: of a sphere on a plane, of equal cylinders crossed at
right angles, and of a surface with the curvatures of equal cylinders crossed at 60 degrees.
Errors are root mean squares over three loads, since they vary with the place of the edge of the
contact in its facet.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from dolfinx import fem

import fenics_mortar as fm
from demos.studies.space.half_spaces import (
    E_STAR,
    KINDS,
    OUTER,
    Kind,
    boussinesq,
    elastic_residual,
    symmetry,
    two_boxes,
)

R = 1000.0
NAMES = ("force", "axis a", "axis b", "peak", "pressure at 0")


class Scene(NamedTuple):
    """Gap A x^2 + B y^2 as sags of the upper and the lower surface."""

    A: float
    B: float
    upper: Callable
    lower: Callable


def _flat(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.0 * x


SCENES = {
    "sphere": Scene(0.5 / R, 0.5 / R, lambda x, y: (x**2 + y**2) / (2.0 * R), _flat),
    "crossed at 90": Scene(
        0.5 / R, 0.5 / R, lambda x, y: x**2 / (2.0 * R), lambda x, y: y**2 / (2.0 * R)
    ),
    "crossed at 60": Scene(0.25 / R, 0.75 / R, lambda x, y: (0.25 * x**2 + 0.75 * y**2) / R, _flat),
}


class Hertz(NamedTuple):
    """Axes, largest pressure, force and approach."""

    a: float
    b: float
    p0: float
    force: float
    approach: float


def exact(scene: Scene, force: float) -> Hertz:
    """Solution of Hertz for a force (Johnson, Contact Mechanics, chapter 4)."""

    def curvatures(q: float) -> tuple[float, float]:
        """A a^3 and B a^3 over 3 F / (2 pi E*) for b / a = q."""
        K, L = ellipk(1.0 - q**2), ellipe(1.0 - q**2)
        return (K - L) / (1.0 - q**2), (L / q**2 - K) / (1.0 - q**2)

    q = 1.0
    if scene.A < scene.B:
        q = brentq(lambda q: np.divide(*curvatures(q)) - scene.A / scene.B, 1e-3, 1.0 - 1e-9)
    first = curvatures(q)[0] if q < 1.0 else np.pi / 4.0
    a = (1.5 * force * first / (np.pi * E_STAR * scene.A)) ** (1.0 / 3.0)
    p0 = 1.5 * force / (np.pi * q * a**2)
    return Hertz(a, q * a, p0, force, p0 * q * a * ellipk(1.0 - q**2) / E_STAR)


class Posed(NamedTuple):
    """The problem, and the displacement far away by body."""

    problem: fm.ContactProblem
    far: dict[str, fem.Function]

    def press(self, hertz: Hertz) -> None:
        """Prescribe the displacement of a solution."""
        self.far["lower"].interpolate(partial(boussinesq, hertz.force, -1.0, 0.0))
        self.far["upper"].interpolate(partial(boussinesq, hertz.force, 1.0, -hertz.approach))


def pose(scene: Scene, kind: Kind, n: int, **options: Any) -> Posed:
    """The problem on a mesh, without displacements, with ``options`` of ``ContactProblem``."""
    data = two_boxes(kind, n, (scene.upper, scene.lower))
    V = fm.vector_space(data.mesh, kind.degree)
    u, far = fem.Function(V), {"upper": fem.Function(V), "lower": fem.Function(V)}
    bcs = symmetry(V, data, list(far))
    for name, value in far.items():
        outside = [f"{name}/{side}" for side in ("right", "back", OUTER[name])]
        bcs.append(fm.dirichlet(V, data, outside, value))
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    residual = elastic_residual(u, kind)
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=bcs, petsc_options_prefix="hertz_", **options
    )
    return Posed(problem, far)


def loads(scene: Scene) -> list[Hertz]:
    """Solutions for three loads, the contact's radius is about 1."""
    return [exact(scene, 4.0 / 3.0 * E_STAR / R * factor) for factor in (0.8, 1.0, 1.2)]


def measure(scene: Scene, kind: Kind, n: int) -> tuple[np.ndarray, list[int], int]:
    """Relative errors (five), iterations of three loads and number of dofs."""
    posed, rows, iterations = pose(scene, kind, n), [], []
    problem = posed.problem
    for hertz in loads(scene):
        posed.press(hertz)
        iterations.append(problem.solve().num_iterations)
        rows.append(errors(problem.contacts[0], scene, hertz))
    dofs = problem.equations.bulk.r.getSize()
    return np.sqrt(np.mean(np.square(rows), axis=0)), iterations, dofs


def errors(contact: fm.PairView, scene: Scene, expected: Hertz) -> list[float]:
    """Relative errors of the force, and of axes and pressures beside those of the force found."""
    f, (x, y) = contact.forces[:, 2], contact.positions[:, :2].T
    hertz = exact(scene, 4.0 * f.sum())
    axes = [np.sqrt(5.0 * f @ s**2 / f.sum()) for s in (x, y)]
    squares = (x / hertz.a) ** 2 + (y / hertz.b) ** 2
    inner = squares < 0.5
    peak = np.sqrt(np.polyfit(squares[inner], contact.pressure[inner] ** 2, 1)[1])
    found = 4.0 * f.sum(), *axes, peak, contact.pressure[squares.argmin()]
    return list(np.divide(found, (expected.force, *hertz[:3], hertz.p0)) - 1.0)


def table(name: str, kind: Kind) -> str:
    """Errors on all meshes in per cent, and the mean rates."""
    lines = [
        f"{name}, {kind.name}\n",
        "| n | dofs | " + " | ".join(f"{what} [%]" for what in NAMES) + " | iterations | s |",
        "|---" + "|---:" * (len(NAMES) + 3) + "|",
    ]
    found = []
    for n in kind.counts:
        start = perf_counter()
        error, iterations, dofs = measure(SCENES[name], kind, n)
        found.append(error)
        numbers = " | ".join(f"{100.0 * e:.2f}" for e in error)
        seconds = perf_counter() - start
        lines.append(f"| {n} | {dofs} | {numbers} | {iterations} | {seconds:.0f} |")
    rates = -np.polyfit(np.log(kind.counts), np.log(found), 1)[0]
    lines.append("| rate | | " + " | ".join(f"{r:.1f}" for r in rates) + " | | |\n")
    return "\n".join(lines)


if __name__ == "__main__":
    scenes = [s for s in SCENES if not sys.argv[1:] or s == sys.argv[1]]
    kinds = [k for k in KINDS if not sys.argv[2:] or k.name == sys.argv[2]]
    for scene_name in scenes:
        for some in kinds:
            print(table(scene_name, some), flush=True)
