# SPDX-License-Identifier: MIT
"""Cylinder on cylinder without friction, compared with the theory of Hertz.

    python3 -m demos.studies.accuracy.cylinders

Two half cylinders of radius 8 and of one material (E = 200, nu = 0.3), plane strain; a pressure of
0.625 on the flat side of the upper one makes P = 10 per length. With 1 / R = 2 / 8 and
1 / E* = 2 (1 - nu^2) / E,

    a = sqrt(4 P R / (pi E*)) = 0.680778,    p0 = 2 P / (pi a) = 9.351351.

The theory is for half planes at small strain; its error is of order (a / 8)^2, 0.7 %. It does not
distinguish deformed and undeformed length, which differ by (1 + nu) (1 - 2 nu) p0 / E = 2.4 % at
the largest pressure. Forces are compared per undeformed length, the measure of linear stress.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import linear_elastic
from fenics_mortar.energies import lame
from meshes._shared import add_lines, add_points, add_surface, generate
from meshes.with_gmsh import gmsh

RADIUS, E, NU, PRESSURE = 8.0, 200.0, 0.3, 0.625
FORCE = 2 * RADIUS * PRESSURE
MODULUS = E / (2 * (1 - NU**2))
HALF_WIDTH = np.sqrt(4 * FORCE * (RADIUS / 2) / (np.pi * MODULUS))
PEAK = 2 * FORCE / (np.pi * HALF_WIDTH)


def half_cylinder(side: int) -> tuple[int, dict[str, list[int]]]:
    """Surface and curves of the half above (1) or below (-1) the origin, where they touch."""
    x = side * RADIUS
    start, touch, end, centre = add_points([(-x, x), (0.0, 0.0), (x, x), (0.0, x)])
    arc = [gmsh.model.geo.addCircleArc(p, centre, q) for p, q in ((start, touch), (touch, end))]
    flat = add_lines([end, start])
    return add_surface(arc + flat, "triangle"), {"arc": arc, "flat": flat}


def mesh(h: float, degree: int, half_width: float = HALF_WIDTH, kinks: Sequence[float] = ()) -> Any:
    """Both halves, with facets of length ``h`` at the contact, 0.7 ``h`` on the lower one.

    Within a half-width of x = +- a kink, facets are shorter, proportional to the root of the
    distance.
    """
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("cylinders")
    bodies, boundaries, lower = {}, {}, set()
    for name, side in (("upper", 1), ("lower", -1)):
        surface, curves = half_cylinder(side)
        bodies[name] = [surface]
        boundaries |= {f"{name}/{part}": tags for part, tags in curves.items()}
        if side < 0:
            lower = {(2, surface)} | {(1, tag) for tags in curves.values() for tag in tags}

    def size(dim: int, tag: int, x: float, y: float) -> float:
        finest = 0.7 * h if (dim, tag) in lower else h
        away = [np.hypot(abs(x) - kink, y) for kink in kinks]
        nearest = min([1.0, *(distance / half_width for distance in away)])
        finest *= max(np.sqrt(nearest), h / half_width)
        return finest + 0.2 * max(0.0, np.hypot(x, y) - 1.5 * half_width)

    model = generate(bodies, boundaries, size)
    model.mesh.setOrder(degree)
    data = fm.read_gmsh(model, MPI.COMM_SELF)
    gmsh.finalize()
    return data


def pose(h: float, degree: int) -> fm.ContactProblem:
    """The unsolved problem."""
    data = mesh(h, degree)
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    stress = linear_elastic(u, *lame(E, NU))
    rule = {"quadrature_degree": 4}
    ds = ufl.Measure("ds", data.mesh, subdomain_data=data.facet_tags, metadata=rule)
    residual = ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata=rule)
    residual += PRESSURE * v[1] * ds(data.boundary_tag("upper/flat"))
    bcs = [
        fm.dirichlet(V, data, "lower/flat", (0.0, 0.0)),
        fm.dirichlet(V, data, "upper/flat", 0.0, component=0),
    ]
    pair = fm.ContactPair(data, "upper/arc", "lower/arc")
    return fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="cylinders_")


def compare(problem: fm.ContactProblem) -> dict[str, float]:
    """Force, half-width (from the second moment of pressure) and peak over those of the theory."""
    (contact,) = problem.equations.contacts
    x, force = contact.slave.X[:, 0], contact.pressure * contact.operators.weight
    return {
        "force": contact.total_force[1] / FORCE,
        "half-width": 2 * np.sqrt((force * x**2).sum() / force.sum()) / HALF_WIDTH,
        "peak": (force / contact.slave.nodal_lengths).max() / PEAK,
    }


def main() -> None:
    print("| element | h / a | unknowns | force | half-width | peak |\n|---|" + "---:|" * 5)
    for degree in (1, 2):
        for h in (0.1, 0.05, 0.025):
            problem = pose(h, degree)
            problem.solve()
            cells = " | ".join(f"{value:.4f}" for value in compare(problem).values())
            size = problem.equations.bulk.u.x.array.size
            print(f"| P{degree} | {h / HALF_WIDTH:.3f} | {size} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
