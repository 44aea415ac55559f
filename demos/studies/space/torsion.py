# SPDX-License-Identifier: MIT
"""Moments of friction and of twist in space against closed forms, with rates.

    python3 -m demos.studies.space.torsion
    python3 -m demos.studies.space.torsion ring

ring:   A plane is turned by a radian below a ring a < r < b under a uniform pressure:
        M = 2/3 mu F (b^3 - a^3) / (b^2 - a^2).
sphere: A rigid sphere, pressed into a half-space (Hertz), is turned by a radian about the normal:
        M = 3 pi / 16 mu F a.
bar:    A square bar, cut by an inclined plane whose sides do not match and are tied, is twisted by
        theta a length: M = 0.14058 G theta s^4 (Saint-Venant). The same with one bar.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.space.half_spaces import (
    KINDS,
    NU,
    QUADRATURE,
    E,
    Kind,
    boussinesq,
    box,
    elastic_residual,
)
from meshes.mapped_boxes import Box, mapped, mesh

MU = 0.3
# radii and height of the ring
INNER, OUTER, HEIGHT = 0.3, 1.0, 0.3
# radius of the sphere, and the force that makes a contact of radius 1
R = 1000.0
FORCE = 4.0 / 3.0 * E / (1.0 - NU**2) / R
# twist of the bar [radian / length], its side and its length
THETA, SIDE, LENGTH = 1e-3, 1.0, 2.0


def ring(kind: Kind, n: int) -> tuple[float, int]:
    """Moment over the exact one, less 1, and iterations, with n cells over the width."""

    def position(s: np.ndarray, t: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, ...]:
        """Around, outwards and up."""
        radius, angle = OUTER - (OUTER - INNER) * t, 2.0 * np.pi * s
        return radius * np.cos(angle), radius * np.sin(angle), HEIGHT * r

    around = round(2.0 * np.pi * n)
    body = Box("ring", mapped((around, n, 1), position, order=kind.degree), closed=True)
    data = mesh([body], cell=kind.cell, order=kind.degree)
    V = fm.vector_space(data.mesh, kind.degree)
    u = fem.Function(V)
    dx = ufl.dx(metadata={"quadrature_degree": 1 + QUADRATURE[kind.cell, kind.degree]})
    energy = fm.energies.neo_hookean(u, *fm.energies.lame(E, 0.0)) * dx
    plane = fm.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    problem = fm.ContactProblem(
        ufl.derivative(energy, u, ufl.TestFunction(V)), u,
        [fm.ContactPair(data, "ring/bottom", plane, law=fm.Coulomb(MU))],
        bcs=[fm.dirichlet(V, data, "ring/top", (0.0, 0.0, -1e-3 * HEIGHT))],
        petsc_options_prefix="ring_",
    )  # fmt: skip
    problem.solve()
    plane.move(angle=(0.0, 0.0, 1.0))
    iterations = problem.solve().num_iterations
    lever = 2.0 / 3.0 * (OUTER**3 - INNER**3) / (OUTER**2 - INNER**2)
    return _error(plane, lever), iterations


def sphere(kind: Kind, n: int) -> tuple[float, int]:
    """The same of a sphere that is turned; n cells along 30 contact radii."""
    problem, ball = sphere_on_half_space(kind, n)
    problem.solve()
    ball.move(z=-1.0 / R, angle=(0.0, 0.0, 1.0))
    iterations = problem.solve().num_iterations
    radius = (0.75 * ball.reaction[2] * R * (1.0 - NU**2) / E) ** (1.0 / 3.0)
    return _error(ball, 3.0 * np.pi / 16.0 * radius), iterations


def sphere_on_half_space(kind: Kind, n: int) -> tuple[fm.ContactProblem, fm.Sphere]:
    """The problem of the sphere, to be pressed in by the first solve."""
    nodes = box(kind, (2 * n, 2 * n, n), -1.0, lambda x, y: 0.0 * x, (True, True), 1.0)
    data = mesh([Box("lower", nodes)], cell=kind.cell, order=kind.degree)
    V = fm.vector_space(data.mesh, kind.degree)
    u, far = fem.Function(V), fem.Function(V)
    far.interpolate(partial(boussinesq, FORCE, -1.0, 0.0))
    outside = [f"lower/{side}" for side in ("left", "right", "front", "back", "bottom")]
    ball = fm.Sphere((0.0, 0.0, R), R)
    ball.move(z=-1.0 / R)
    problem = fm.ContactProblem(
        elastic_residual(u, kind), u,
        [fm.ContactPair(data, "lower/top", ball, law=fm.Coulomb(MU))],
        bcs=[fm.dirichlet(V, data, outside, far)], petsc_options_prefix="sphere_",
    )  # fmt: skip
    return problem, ball


def _error(obstacle: fm.Obstacle, lever: float) -> float:
    """Error of the moment about z beside mu F times a lever [1]."""
    force, moment = obstacle.reaction[2], obstacle.reaction[5]
    return float(abs(moment / (MU * force * lever)) - 1.0)


def bar(kind: Kind, n: int, *, cut: bool = True) -> tuple[float, int]:
    """The same of a bar, whose sections at the ends are turned and may warp."""

    def nodes(counts: tuple[int, int, int], ends: Callable) -> np.ndarray:
        """Nodes of a part whose ends are two functions of x."""

        def position(s: np.ndarray, t: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, ...]:
            x, y = SIDE * (s - 0.5), SIDE * (t - 0.5)
            low, high = ends(x)
            return x, y, low + (high - low) * r

        return mapped(counts, position, order=kind.degree)

    def cut_at(x: np.ndarray) -> np.ndarray:
        return 0.5 * LENGTH + 0.3 * x

    boxes, ties = [Box("bar", nodes((n, n, 2 * n), lambda x: (0.0 * x, 0.0 * x + LENGTH)))], []
    if cut:
        boxes = [
            Box("bar", nodes((n, n, n), lambda x: (0.0 * x, cut_at(x)))),
            Box("upper", nodes((n + 1, n + 1, n + 1), lambda x: (cut_at(x), 0.0 * x + LENGTH))),
        ]
    data = mesh(boxes, cell=kind.cell, order=kind.degree)
    if cut:
        ties = [fm.TiedPair(data, "upper/bottom", "bar/top")]
    V = fm.vector_space(data.mesh, kind.degree)
    u, ends, bcs = fem.Function(V), ["bar/bottom", f"{boxes[-1].name}/top"], []
    for component, of in enumerate((lambda x: -x[1], lambda x: x[0])):
        part_of_V = V.sub(component)
        turned = fem.Function(part_of_V.collapse()[0])
        turned.interpolate(lambda x, of=of: THETA * x[2] * of(x))
        bcs.append(fm.dirichlet(part_of_V, data, ends, turned))
    along = V.sub(2), V.sub(2).collapse()[0]
    middle = fem.locate_dofs_geometrical(along, lambda x: np.linalg.norm(x, axis=0) < 1e-9)
    bcs.append(fem.dirichletbc(fem.Function(along[1]), middle, along[0]))
    problem = fm.ContactProblem(
        elastic_residual(u, kind), u, ties, bcs=bcs, petsc_options_prefix="bar_"
    )
    iterations = problem.solve().num_iterations
    odd = np.arange(1, 60, 2)
    series = np.sum(np.tanh(odd * np.pi / 2.0) / odd**5)
    factor = (1.0 - 192.0 / np.pi**5 * series) / 3.0
    exact = factor * E / (2.0 * (1.0 + NU)) * THETA * SIDE**4
    return float(problem.reaction(ends[-1], data=data).moment[2] / exact - 1.0), iterations


SCENES: dict[str, Callable[[Kind, int], tuple[float, int]]] = {
    "ring": ring,
    "sphere": sphere,
    "bar": bar,
    "bar without cut": partial(bar, cut=False),
}
COUNTS = {1: (4, 8, 16), 2: (2, 4, 8)}
COUNTS_OF_SPHERE = {1: (6, 9, 12), 2: (3, 4, 6)}


def table(name: str, kind: Kind) -> str:
    """Rows of all meshes with the rates between them."""
    lines = [
        f"{name}, {kind.name}\n",
        "| n | error of M [%] | rate | iterations |",
        "|---:" * 4 + "|",
    ]
    before: tuple[int, float] | None = None
    for n in (COUNTS_OF_SPHERE if name == "sphere" else COUNTS)[kind.degree]:
        error, iterations = SCENES[name](kind, n)
        rate = np.log(abs(before[1] / error)) / np.log(n / before[0]) if before else np.nan
        lines.append(f"| {n} | {100.0 * error:.4f} | {rate:.1f} | {iterations} |")
        before = n, error
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    for name in sys.argv[1:] or SCENES:
        for some in KINDS[:2] if name in ("ring", "sphere") else KINDS:
            print(table(name, some), flush=True)
