# SPDX-License-Identifier: MIT
"""The reference cell, and the cells of this rank: area ratios, points inside other bodies."""

from __future__ import annotations

from functools import cached_property, reduce
from math import factorial
from typing import Any

from mpi4py import MPI

import numpy as np

import basix

from fenics_mortar.interface.reference import gauss_points, tabulate
from fenics_mortar.kernels.crossing import find_inside
from fenics_mortar.kernels.facets import tabulate_volumes
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags, Indices, Numbers
from fenics_mortar.utils.errors import count_points
from fenics_mortar.utils.ranks import any_over_ranks, on_any_rank, sum_over_ranks

# Degree of Lagrange functions by the number of nodes of a cell.
DEGREES = {3: 1, 4: 1, 6: 2, 9: 2, 10: 2, 8: 1, 27: 2}


class ReferenceCell:
    """A triangle, a square, a tetrahedron or a cube, its sides and quadrature points.

    Attributes:
        sides: Vertices of each side, in space in order around it, shape (sides, c).
        rule: Points (q,), in space (q, 2), of the reference facet, and weights (q,).
        shapes: Linear functions of the vertices of a side at these points, shape (q, c) [1].
        tangents: Derivatives of the position on a side, shape (sides, q, dim - 1, dim).
        normals: Outer normals, shape (sides, dim).
        side_points: Points of all sides in the cell, shape (sides q, dim).
        side_fill: Area of the parallelogram of two edges over that of a side, 1 in the plane [1].
        points, weights: Quadrature rule of the cell, shapes (p, dim) and (p,).
        midpoint: Midpoint of the cell, shape (1, dim).
        fill: Area or volume of the unit square or cube over that of the cell [1].
    """

    def __init__(self, name: str) -> None:
        kind = getattr(basix.CellType, name)
        corners = np.asarray(basix.geometry(kind))
        dim, is_simplex = corners.shape[1], len(corners) == corners.shape[1] + 1
        sides = np.array(basix.topology(kind)[dim - 1], np.int64)
        self.sides: Indices = sides[:, [0, 1, 3, 2]] if sides.shape[1] == 4 else sides
        self.midpoint: Array = midpoint_of(name)
        self.rule: tuple[Array, Array] = gauss_points(self.sides.shape[1])
        table = tabulate(self.rule[0], self.sides.shape[1])
        self.shapes: Array = table[:, 0]
        self.tangents: Array = np.einsum("qak,skc->sqac", table[:, 1:], corners[self.sides])
        normals = normals_of(self.tangents[:, 0])
        outward = np.sign(np.einsum("kc,kc->k", normals, corners[sides[:, 0]] - self.midpoint))
        self.normals: Array = outward[:, None] * normals
        points = np.einsum("qk,skc->sqc", self.shapes, corners[self.sides])
        self.side_points: Array = points.reshape(-1, dim)
        x, w = np.polynomial.legendre.leggauss(3)  # exact to degree 5
        grid = np.meshgrid(*[(x + 1) / 2] * dim, indexing="ij")
        self.points: Array = np.stack([axis.ravel() for axis in grid], axis=1)
        self.weights: Array = reduce(np.multiply.outer, [w / 2] * dim).ravel()
        for axis in range(1, dim) if is_simplex else ():  # sides of a square or cube collapse
            rest = 1.0 - self.points[:, :axis].sum(axis=1)
            self.points[:, axis] *= rest
            self.weights *= rest
        self.fill = float(factorial(dim)) if is_simplex else 1.0
        self.side_fill = float(factorial(dim - 1)) if is_simplex else 1.0


def normals_of(tangents: Array) -> Array:
    """Vectors across one tangent of a curve, or two of a surface, as long as their area (local).

    Shape (..., dim) [area] for tangents (..., dim - 1, dim).
    """
    if tangents.shape[-1] == 2:
        return np.stack([tangents[..., 0, 1], -tangents[..., 0, 0]], axis=-1)
    return np.cross(tangents[..., 0, :], tangents[..., 1, :])


def midpoint_of(name: str) -> Array:
    """Midpoint of a reference cell of the plane or of space, shape (1, dim) [1] (local)."""
    corners = np.asarray(basix.geometry(getattr(basix.CellType, name)))
    return np.asarray(corners.mean(axis=0, keepdims=True))


def nodal_gradients(V: Any) -> Array:
    """Return the gradients of the Lagrange functions of a cell of ``V`` at its own nodes.

    Shape (nodes, functions, dim), in the reference cell [1] (local). All values are integers for
    degree 1 and 2.
    """
    element = _lagrange(V)
    return np.rint(_gradients(element, element.points))


def gradients_at(V: Any, points: Array) -> Array:
    """Gradients of the Lagrange functions of a cell of ``V`` at reference points (p, dim) (local).

    Shape (p, functions, dim), in the reference cell [1].
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


# Nodes of a cell along its outline, by the number of nodes: dolfinx orders corners, edges,
# interior; those of quadrilaterals as a tensor product.
OUTLINE = {3: [0, 1, 2], 4: [0, 1, 3, 2], 6: [0, 5, 1, 3, 2, 4], 9: [0, 4, 1, 6, 3, 7, 2, 5]}


class Cells:
    """The owned cells of a space of vectors, in the reference state.

    In space, areas are volumes.

    Args:
        V: Space of the displacement.

    Attributes:
        X: Reference positions of the local nodes, ghosts included, shape (n, dim) [length].
    """

    def __init__(self, V: Any) -> None:
        self._comm: MPI.Comm = V.mesh.comm
        dim = V.mesh.geometry.dim
        self._nodes = compat.dofmap(V)[: V.mesh.topology.index_map(dim).size_local]
        self.X: Array = V.tabulate_dof_coordinates()[:, :dim].copy()
        self._gradients = nodal_gradients(V)
        self._outline = np.array(OUTLINE[len(self._gradients)] if dim == 2 else [])
        self._num_corners = compat.num_corners(V.mesh)
        self._undeformed_areas = areas_or_nan(self.X, self._nodes, self._gradients)

    def area_ratios(self, x: Array) -> Array:
        """Deformed over undeformed area at the nodes of the cells, (cells, nodes) (local).

        Args:
            x: Positions of the local nodes, shape (n, dim) [length].

        Returns:
            Ratios; nan at nodes where the undeformed cell has no area.
        """
        return areas_at(x, self._nodes, self._gradients) / self._undeformed_areas

    def hoop_strains(self, x: Array) -> Array:
        """Mean strain around the axis x = 0 of the cells, shape (cells,) (local).

        Args:
            x: Positions of the local nodes, shape (n, 2) [length].
        """
        now, before = (place[self._nodes, 0].mean(axis=1) for place in (x, self.X))
        return now / before - 1.0

    def middles(self, x: Array) -> Array:
        """Midpoints of the cells at positions ``x`` (n, dim), (cells, dim) [length] (local)."""
        return np.asarray(x[self._nodes].mean(axis=1))

    def count(self, marks: Flags) -> tuple[int, str]:
        """Number of marked owned cells, shape (cells,), and the position of one (collective).

        The position is that of the reference state, as text.
        """
        if not on_any_rank(self._comm, bool(marks.any())):
            return 0, "nowhere"
        return count_points(self._comm, self.X[self._nodes[marks]].mean(axis=1))

    def mean_size(self) -> float:
        """Mean length of the undeformed cells, equal on all ranks [length] (collective)."""
        areas = np.abs(np.nan_to_num(self._undeformed_areas)).mean(axis=1)
        sizes = areas ** (1.0 / self.X.shape[1])
        total, count = sum_over_ranks(self._comm, [sizes.sum(), float(sizes.size)])
        return float(total / count)

    def flat(self) -> tuple[int, str]:
        """Number of undeformed cells without area, and the position of one (collective)."""
        return self.count(np.isnan(self._undeformed_areas).all(axis=1))

    def twisted(self) -> tuple[int, str]:
        """Number of undeformed cells with corners of both orientations, and where (collective)."""
        corners = self._undeformed_areas[:, : self._num_corners]
        return self.count((corners < 0.0).any(axis=1) & (corners > 0.0).any(axis=1))

    def deformation_gradients(self, x: Array) -> Array:
        """F at positions ``x`` (n, dim), averaged over nodes, (cells, dim, dim) [1] (local)."""
        return np.einsum("eka,ekb->eab", x[self._nodes], self._shape_gradients)

    @cached_property
    def _shape_gradients(self) -> Array:
        """d(shape functions)/dX, averaged over a cell's nodes, (cells, nodes, dim) [1 / length]."""
        jacobian = np.einsum("eka,nkb->enab", self.X[self._nodes], self._gradients)
        gradients = np.einsum("nkb,enba->ekna", self._gradients, np.linalg.inv(jacobian))
        return np.asarray(gradients.mean(axis=2))

    def inside_other_body(
        self, x: Array, points: Array, bodies: Indices | Array, labels: Indices
    ) -> Flags:
        """Whether points of the plane lie inside a cell of another body (collective).

        Args:
            x: Positions of the local nodes, shape (n, 2) [length].
            points: Positions, equal on all ranks, shape (p, 2) [length].
            bodies: Body of each point, shape (p,).
            labels: Body of each local node, negative for bodies that do not count, shape (n,).

        Returns:
            Flags, equal on all ranks, shape (p,).
        """
        inside = np.zeros(len(points), bool)
        if len(points) and len(self._nodes):
            find_inside(x, self._nodes, labels, self._outline, points, bodies, inside)
        return any_over_ranks(self._comm, inside)


def areas_at(x: Array, cells: Numbers, gradients: Array) -> Array:
    """Determinant of dx/dxi at points of ``cells`` (m, k), shape (m, p) [length^dim] (local).

    Args:
        x: Positions of the local nodes, shape (n, dim) [length].
        cells: Nodes of the cells, shape (m, k).
        gradients: Gradients of the shape functions at the points, shape (p, k, dim) [1].
    """
    areas = np.empty((len(cells), len(gradients)))
    tabulate_volumes(x, cells, gradients, areas)
    return areas


def areas_or_nan(X: Array, cells: Numbers, gradients: Array) -> Array:
    """Areas of ``areas_at`` in the undeformed state, nan where there is none (local).

    Units [length^dim].
    """
    areas = areas_at(X, cells, gradients)
    extent = np.ptp(X[cells], axis=1).max(axis=1, initial=0.0)
    return np.where(np.abs(areas) > ROUNDING * extent[:, None] ** X.shape[1], areas, np.nan)
