# SPDX-License-Identifier: MIT
"""Random bodies of revolution with a known pressure."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.stability.physics import SOLVED, certified, differs, follow, size
from fenics_mortar import energies
from meshes.mapped_grids import Grid, block, mesh

# Quadratic elements with four cells in a wall of half its inner radius: error of Lame's pressure.
OF_MESH = 5e-3


def draw_revolved(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """Draw stacked cylinders or fitted tubes."""
    return _cylinders(rng) if rng.random() < 0.6 else _tubes(rng)


def _cylinders(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """Two cylinders, hollow or not, pressed on each other: uniform stress along the axis.

    With equal ratios nu / E both widen equally, by nu s / E of their radius under the stress s, so
    that the pressure on the present area is s / (1 + nu s / E)^2.
    """
    unit, stiff = size(rng, 1e-3, 1e3), size(rng, 1e-2, 1e6)
    hole = float(rng.choice([0.0, rng.uniform(0.2, 0.8)]))
    heights, counts = rng.uniform(0.4, 1.2, 2), rng.integers(3, 9, 2)
    contrast, nu = size(rng, 0.2, 5.0), rng.uniform(0.0, 0.4)
    E = stiff * np.array([1.0, contrast]) / max(contrast, 1.0)
    nus = nu * E / E.max()
    degree, cell = int(rng.integers(1, 3)), str(rng.choice(["triangle", "quadrilateral"]))
    strain = size(rng, 1e-4, 0.03)
    about = {
        "scene": "cylinders", "hole": hole, "contrast": contrast, "nu": nu, "degree": degree,
        "cell": cell, "facets": counts.tolist(), "strain": strain,
    }  # fmt: skip

    def solve() -> Any:
        push = strain * heights.sum() * unit
        grids = [
            Grid(name, unit * block(
                degree * n, 2 * degree, width=1.0 - hole, height=h, corner=(hole, y)
            ))
            for name, n, h, y in zip(("low", "high"), counts, heights, (0.0, heights[0]))
        ]  # fmt: skip
        data = mesh(grids, cell=cell, order=degree)
        conditions = [("low/bottom", 1, 0.0), ("high/top", 1, -push)]
        conditions += [] if hole else [("low/left", 0, 0.0), ("high/left", 0, 0.0)]
        pair = fm.ContactPair(data, "high/bottom", "low/top")
        problem, load = _problem(data, degree, E, nus, conditions, [pair])
        reports = follow(problem, load, 2)
        stress = push / unit / (heights / E).sum()
        expected = stress / (1.0 + nus[0] * stress / E[0]) ** 2
        errors, remarks = certified([problem])
        errors += differs("the pressure", problem.contacts[0].pressure, expected, SOLVED)
        return reports, errors, remarks

    return about, solve


def _tubes(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """Two tubes with an interference, fixed along the axis: Lame's pressure of plane strain."""
    unit = size(rng, 1e-3, 1e3)
    radii = np.cumsum([1.0, rng.uniform(0.3, 0.6), rng.uniform(0.3, 0.6)])
    contrast, nus = size(rng, 0.2, 5.0), rng.uniform(0.0, 0.4, 2)
    E, rows = np.array([1.0, contrast]), rng.integers(1, 5, 2)
    fit = size(rng, 1e-6, 1e-4)
    slave_inside = bool(rng.random() < 0.5)
    about = {"scene": "tubes", "contrast": contrast, "facets": rows.tolist(), "fit": fit}

    def solve() -> Any:
        names = ("inner", "outer")
        grids = [
            Grid(name, unit * block(8, 2 * n, width=b - a, height=0.3, corner=(a, 0.0)))
            for name, n, a, b in zip(names, rows, radii, radii[1:])
        ]
        data = mesh(grids, order=2)
        conditions = [(f"{name}/{side}", 1, 0.0) for name in names for side in ("bottom", "top")]
        sides = ["inner/right", "outer/left"][:: 1 if slave_inside else -1]
        pair = fm.ContactPair(data, *sides, initial_gap=-fit * unit)
        problem, load = _problem(data, 2, E, nus, conditions, [pair])
        reports = follow(problem, load, 1)
        a, b, c = radii
        ring = E / (1.0 - nus**2), nus / (1.0 - nus)
        outer = ((c**2 + b**2) / (c**2 - b**2) + ring[1][1]) / ring[0][1]
        inner = ((b**2 + a**2) / (b**2 - a**2) - ring[1][0]) / ring[0][0]
        errors, remarks = certified([problem])
        errors += differs(
            "the pressure", problem.contacts[0].pressure, fit / (b * (outer + inner)), OF_MESH
        )
        return reports, errors, remarks

    return about, solve


def _problem(
    data: fm.MeshData,
    degree: int,
    E: Any,
    nus: Any,
    conditions: list[Any],
    pairs: list[fm.ContactPair],
) -> tuple[fm.ContactProblem, Callable[[float], None]]:
    """A linear elastic problem; ``conditions``: boundary, component, value at time 1."""
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    strain, r = energies.strain(u, "axisymmetric"), ufl.SpatialCoordinate(data.mesh)[0]
    residual = 0
    dx = ufl.Measure(
        "dx", data.mesh, subdomain_data=data.cell_tags, metadata={"quadrature_degree": 6}
    )
    for tag, young, nu in zip(data.bodies.values(), E, nus):
        energy = energies.linear_elastic(strain, *energies.lame(young, nu))
        residual += ufl.derivative(2.0 * np.pi * r * energy * dx(tag), u, v)
    constants = [fem.Constant(data.mesh, 0.0) for _ in conditions]
    bcs = [
        fm.dirichlet(V, data, name, constant, component=component)
        for (name, component, _), constant in zip(conditions, constants)
    ]
    problem = fm.ContactProblem(
        residual, u, pairs, bcs=bcs, petsc_options_prefix="revolved_", geometry="axisymmetric"
    )

    def load(time: float) -> None:
        for constant, (_, _, value) in zip(constants, conditions):
            constant.value = time * value

    return problem, load
