# SPDX-License-Identifier: MIT
"""Reference triangle and square: quadrature points, and gradients of shape functions at nodes."""

from __future__ import annotations

from typing import Any

import numpy as np

import basix

from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices

# Degree of Lagrange functions by the number of nodes of a cell.
DEGREES = {3: 1, 4: 1, 6: 2, 9: 2}


class ReferenceCell:
    """A triangle or a square, its sides and quadrature points.

    Attributes:
        sides: Vertices of each side, shape (sides, 2).
        edges: Vectors from the first to the second vertex of a side, shape (sides, 2).
        normals: Outer normals with the length of the sides, shape (sides, 2).
        s: Gauss points along a side, between 0 and 1, shape (q,).
        side_weights: Their weights with sum 1, shape (q,).
        side_points: Gauss points of all sides in the cell, shape (sides q, 2).
        points, weights: Quadrature rule of the cell, shapes (p, 2) and (p,).
        midpoint: Midpoint of the cell, shape (1, 2).
        fill: Area of the unit square over that of the cell.
    """

    def __init__(self, name: str) -> None:
        kind = getattr(basix.CellType, name)
        corners = np.asarray(basix.geometry(kind))
        self.sides: Indices = np.array(basix.topology(kind)[1], np.int64)
        self.midpoint: Array = corners.mean(axis=0, keepdims=True)
        starts, ends = corners[self.sides[:, 0]], corners[self.sides[:, 1]]
        self.edges: Array = ends - starts
        normals = np.stack([self.edges[:, 1], -self.edges[:, 0]], axis=1)
        outward = np.sign(np.einsum("kc,kc->k", normals, starts - self.midpoint))
        self.normals: Array = outward[:, None] * normals
        x, w = np.polynomial.legendre.leggauss(3)  # exact to degree 5
        self.s, self.side_weights = (x + 1) / 2, w / 2
        self.side_points: Array = (starts[:, None] + self.s[:, None] * self.edges[:, None]).reshape(
            -1, 2
        )
        s, t = (a.ravel() for a in np.meshgrid(self.s, self.s, indexing="ij"))
        weights = np.outer(self.side_weights, self.side_weights).ravel()
        triangle = len(corners) == 3
        self.fill = 2.0 if triangle else 1.0
        self.points: Array = np.stack([s, t * (1 - s) if triangle else t], axis=1)
        self.weights: Array = weights * (1 - s) if triangle else weights


def nodal_gradients(V: Any) -> Array:
    """Return the gradients of the Lagrange functions of a cell of ``V`` at its own nodes.

    Shape (nodes, functions, 2), in the reference cell [1] (local). All values are integers for
    degree 1 and 2.
    """
    element = _lagrange(V)
    return np.rint(_gradients(element, element.points))


def gradients_at(V: Any, points: Array) -> Array:
    """Gradients of the Lagrange functions of a cell of ``V`` at reference points (p, 2) (local).

    Shape (p, functions, 2), in the reference cell [1].
    """
    return _gradients(_lagrange(V), points)


def _lagrange(V: Any) -> Any:
    """Basix's element of one component of ``V``."""
    cell = getattr(basix.CellType, compat.cell_name(V.mesh))
    degree = DEGREES[V.dofmap.dof_layout.num_dofs]
    return basix.create_element(
        basix.ElementFamily.P, cell, degree, basix.LagrangeVariant.gll_warped
    )


def _gradients(element: Any, points: Array) -> Array:
    return np.ascontiguousarray(np.moveaxis(element.tabulate(1, points)[1:, :, :, 0], 0, -1))
