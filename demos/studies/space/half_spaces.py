# SPDX-License-Identifier: MIT
"""Boxes of two half-spaces that touch at the origin, with the exact displacement far away.

Lengths are about those of the contact: radius 1. The boxes end at ``SIZE``, where the displacement
of a point force on a half-space (Boussinesq) is prescribed, so that errors are those of the mesh;
those of the point force are of order 1 / SIZE^2.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_boxes import Box, mapped, mesh

SIZE, E, NU = 30.0, 1.0, 0.3
# combined modulus of two equal bodies
E_STAR = E / (2.0 * (1.0 - NU**2))
# outer side of a box across z
OUTER = {"upper": "top", "lower": "bottom"}
# degree of quadrature, exact for affine cells
QUADRATURE = {
    ("hexahedron", 1): 3,
    ("hexahedron", 2): 5,
    ("tetrahedron", 1): 1,
    ("tetrahedron", 2): 2,
}


class Kind(NamedTuple):
    """Cells and numbers of cells along half a side of a box, on three meshes."""

    name: str
    cell: str
    degree: int
    counts: tuple[int, ...]


KINDS = [
    Kind("hexahedra", "hexahedron", 1, (6, 9, 12)),
    Kind("quadratic hexahedra", "hexahedron", 2, (3, 4, 6)),
    Kind("quadratic tetrahedra", "tetrahedron", 2, (3, 4, 6)),
]


def graded(s: np.ndarray, n: int) -> np.ndarray:
    """Coordinate of n cells between 0 and SIZE that grow, for s in [-1, 1]; linear in each cell."""
    corners = np.linspace(-1.0, 1.0, 2 * n + 1)
    return np.interp(s, corners, 2.0 * corners + (SIZE - 2.0) * corners**9)


def box(
    kind: Kind,
    counts: tuple[int, int, int],
    side: float,
    sag: Callable,
    both: tuple[bool, bool],
    stretch: float,
) -> np.ndarray:
    """Nodes of the box on the ``side`` +1 or -1 of z = 0, whose surface is z = side * sag(x, y).

    ``both`` is whether x and y are on both sides of 0.
    """

    def position(s: np.ndarray, t: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, ...]:
        x, y = (
            stretch * graded(2.0 * p - 1.0 if b else p, count // (1 + b))
            for p, b, count in zip((s, t), both, counts[:2], strict=True)
        )
        z = graded(r if side > 0.0 else 1.0 - r, counts[2])
        return x, y, side * (z + (1.0 - z / SIZE) * sag(x, y))

    return mapped(counts, position, order=kind.degree)


def two_boxes(
    kind: Kind, n: int, sags: tuple[Callable, Callable], both: bool = False
) -> fm.MeshData:
    """Mesh of the upper box with n cells in each direction, and of the lower one with n + 2.

    Args:
        kind: Cells.
        n: Number of cells from 0 to SIZE.
        sags: Distances of the surfaces from z = 0, of x and y.
        both: Whether x is on both sides of 0; y >= 0 anyway.
    """
    twice = 1 + both
    numbers = {"upper": (twice * n, n, n), "lower": (twice * (n + 2), n + 2, n)}
    boxes = [
        Box(name, box(kind, counts, side, sag, (both, False), stretch))
        for (name, counts), side, sag, stretch in zip(
            numbers.items(), (1.0, -1.0), sags, (1.0, 1.05), strict=True
        )
    ]
    return mesh(boxes, cell=kind.cell, order=kind.degree)


def boussinesq(force: float, side: float, motion: float, x: np.ndarray) -> np.ndarray:
    """Displacement (3, n) of a half-space on ``side`` that a force presses in at the origin.

    ``motion`` is that of points far away, along z.
    """
    depth, r = np.maximum(side * x[2], 0.0), np.hypot(x[0], x[1])
    rho = np.maximum(np.sqrt(depth**2 + r**2), 1.0)
    scale = force * (1.0 + NU) / (2.0 * np.pi * E * rho)
    outwards = scale * (depth / rho**2 - (1.0 - 2.0 * NU) / (rho + depth))
    inwards = scale * ((depth / rho) ** 2 + 2.0 * (1.0 - NU))
    return np.array([outwards * x[0], outwards * x[1], side * inwards + motion])


def cerruti(force: float, side: float, x: np.ndarray) -> np.ndarray:
    """Displacement (3, n) of a half-space on ``side`` that a force along x shears at the origin."""
    depth = np.maximum(side * x[2], 0.0)
    rho = np.maximum(np.sqrt(x[0] ** 2 + x[1] ** 2 + depth**2), 1.0)
    scale, k, s = force * (1.0 + NU) / (2.0 * np.pi * E * rho), 1.0 - 2.0 * NU, rho + depth
    along = scale * (1.0 + (x[0] / rho) ** 2 + k * (rho / s - (x[0] / s) ** 2))
    across = scale * x[0] * x[1] * (1.0 / rho**2 - k / s**2)
    inwards = scale * x[0] * (depth / rho**2 + k / s)
    return np.array([along, across, side * inwards])


def elastic_residual(u: fem.Function, kind: Kind) -> ufl.Form:
    """Residual of linear elasticity."""
    dx = ufl.dx(metadata={"quadrature_degree": QUADRATURE[kind.cell, kind.degree]})
    energy = fm.energies.linear_elastic(u, *fm.energies.lame(E, NU))
    return ufl.derivative(energy * dx, u, ufl.TestFunction(u.function_space))


def symmetry(V: fem.FunctionSpace, data: fm.MeshData, names: list[str]) -> list[fem.DirichletBC]:
    """Conditions of the planes x = 0 (if it is a side of the boxes) and y = 0."""
    given = [fm.dirichlet(V, data, [f"{name}/front" for name in names], 0.0, 1)]
    left = data.mesh.geometry.x[:, 0].min() > -1e-9 if len(data.mesh.geometry.x) else True
    if data.mesh.comm.allreduce(not left) == 0:
        given.append(fm.dirichlet(V, data, [f"{name}/left" for name in names], 0.0, 0))
    return given
