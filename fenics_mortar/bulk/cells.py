# SPDX-License-Identifier: MIT
"""Cells: the reference cell, deformation of a rank's cells, interpolation in the cells of a body.

``ReferenceCell`` has the sides and quadrature points of a kind of cell, ``Cells`` the area ratios
of the owned cells of a space, and ``Triangles`` interpolates between the nodes of a body.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from math import factorial
from typing import TYPE_CHECKING, Any, NamedTuple

from mpi4py import MPI

import numpy as np

import basix
from dolfinx import mesh as dmesh

from fenics_mortar.interface.reference import gauss_points, tabulate
from fenics_mortar.kernels.crossing import interpolate
from fenics_mortar.kernels.facets import tabulate_volumes
from fenics_mortar.kernels.tree import build_tree, spatial_order
from fenics_mortar.utils import arrays, compat, errors, ranks

if TYPE_CHECKING:
    from fenics_mortar.mesh.space import DisplacementSpace
    from fenics_mortar.utils.arrays import Array, Flags, Indices, Numbers

# Degree of Lagrange functions by the number of nodes of a cell.
DEGREES = {3: 1, 4: 1, 6: 2, 9: 2, 10: 2, 8: 1, 27: 2}
# Degree of polynomials that the rule of a cell integrates exactly: squares of quadratic ones, and
# one more. On facets it is the same.
RULE_DEGREE = 5


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
        rule = basix.make_quadrature(kind, RULE_DEGREE)
        self.points, self.weights = (np.asarray(values) for values in rule)
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
    return np.rint(gradients_at(V, lagrange(V).points))


def gradients_at(V: Any, points: Array) -> Array:
    """Gradients of the Lagrange functions of a cell of ``V`` at reference points (p, dim) (local).

    Shape (p, functions, dim), in the reference cell [1].
    """
    return np.ascontiguousarray(np.moveaxis(lagrange(V).tabulate(1, points)[1:, :, :, 0], 0, -1))


def lagrange(V: Any) -> Any:
    """Basix's element of one component of ``V``."""
    cell = getattr(basix.CellType, compat.cell_name(V.mesh))
    degree = DEGREES[V.dofmap.dof_layout.num_dofs]
    return basix.create_element(
        basix.ElementFamily.P, cell, degree, basix.LagrangeVariant.gll_warped
    )


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

    def count(self, marks: Flags) -> tuple[int, str]:
        """Number of marked owned cells, shape (cells,), and the position of one (collective).

        The position is that of the reference state, as text.
        """
        if not ranks.on_any_rank(self._comm, bool(marks.any())):
            return 0, "nowhere"
        return errors.count_points(self._comm, self.X[self._nodes[marks]].mean(axis=1))

    def undeformed_areas(self) -> Array:
        """Areas of the cells, but for a common factor, shape (cells,) [length^dim] (local)."""
        return np.abs(np.nan_to_num(self._undeformed_areas)).mean(axis=1)

    def mean_size(self) -> float:
        """Mean length of the undeformed cells, equal on all ranks [length] (collective)."""
        sizes = self.undeformed_areas() ** (1.0 / self.X.shape[1])
        total, count = ranks.sum_over_ranks(self._comm, [sizes.sum(), float(sizes.size)])
        return float(total / count)

    def flat(self) -> tuple[int, str]:
        """Number of undeformed cells without area, and the position of one (collective)."""
        return self.count(np.isnan(self._undeformed_areas).all(axis=1))

    def twisted(self) -> tuple[int, str]:
        """Number of undeformed cells with corners of both orientations, and where (collective).

        In the plane those of the cell with straight edges.
        """
        count = self._num_corners
        if self.X.shape[1] == 2:
            polygon = self.X[self._nodes[:, :count]][:, OUTLINE[count]]
            after = np.roll(polygon, -1, axis=1) - polygon
            corners = arrays.cross_in_plane(np.roll(after, 1, axis=1), after)
        else:
            corners = np.nan_to_num(self._undeformed_areas[:, :count])
        least = arrays.SAME_PLACE * np.abs(corners).max(axis=1, initial=0.0)
        signs = np.sign(corners) * (np.abs(corners) > least[:, None])
        return self.count((signs < 0.0).any(axis=1) & (signs > 0.0).any(axis=1))

    def deformation_gradients(self, x: Array) -> Array:
        """F at positions ``x`` (n, dim), averaged over nodes, (cells, dim, dim) [1] (local)."""
        return np.einsum("eka,ekb->eab", x[self._nodes], self._shape_gradients)

    @cached_property
    def _shape_gradients(self) -> Array:
        """d(shape functions)/dX, averaged over a cell's nodes, (cells, nodes, dim) [1 / length]."""
        known = ~np.isnan(self._undeformed_areas)  # not at the tip of a quarter-point element
        jacobian = np.einsum("eka,nkb->enab", self.X[self._nodes], self._gradients)
        jacobian[~known] = np.eye(self.X.shape[1])
        weights = known / np.maximum(known.sum(axis=1), 1)[:, None]
        inverse = np.linalg.inv(jacobian) * weights[..., None, None]
        return np.einsum("nkb,enba->eka", self._gradients, inverse, optimize=True)


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
    return np.where(np.abs(areas) > arrays.ROUNDING * extent[:, None] ** X.shape[1], areas, np.nan)


def sum_over_cells(mesh: Any, facets: Any, values: Array) -> Array:
    """Sums over the one or two cells of each facet, on any ranks (collective).

    Args:
        mesh: The mesh.
        facets: Local facets of owned cells, one for each cell and side, shape (n,).
        values: Values of these sides, shape (n, c) [any unit].

    Returns:
        Of all local facets, shape (local facets, c) [unit of the values].
    """
    topology, comm = mesh.topology, mesh.comm
    index_map = topology.index_map(topology.dim - 1)
    size = index_map.size_local + index_map.num_ghosts
    sums = np.stack([arrays.summed(column, facets, size) for column in values.T], axis=1)
    if comm.size == 1:
        return sums
    topology.create_connectivity(topology.dim - 1, topology.dim)
    alone = np.flatnonzero(np.bincount(facets, minlength=size) == 1)
    between = np.setdiff1d(alone, dmesh.exterior_facet_indices(topology)).astype(np.int32)
    names = index_map.local_to_global(between)
    parts = comm.allgather((names, sums[between]))
    for theirs, there in parts[: comm.rank] + parts[comm.rank + 1 :]:
        _, mine, others = np.intersect1d(names, theirs, True, return_indices=True)
        sums[between[mine]] += there[others]
    return sums


# Triangles between the nodes of a cell, by the number of nodes; for their order see ``bulk.cells``.
DIVISIONS = {
    3: [[0, 1, 2]],
    4: [[0, 1, 2], [1, 3, 2]],
    6: [[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]],
    9: [
        [0, 4, 8], [4, 1, 6], [8, 4, 6], [0, 8, 5], [5, 8, 7], [5, 7, 2], [8, 6, 3], [8, 3, 7],
    ],
}  # fmt: skip


class Triangles(NamedTuple):
    """Triangles between the local nodes of a body.

    Fields are interpolated linearly between the nodes of a body, on its cells divided into
    triangles. Each rank interpolates in its own cells, so that no rank stores a whole body. Only
    points that a rank does not find there are sent to the others.

    Attributes:
        comm: Communicator.
        X: Reference positions of the local nodes, ghosts included, shape (n, 2) [length].
        nodes: Nodes of the triangles, shape (t, 3).
        boxes: Tree of their boxes, see ``kernels.tree``; empty without triangles.
    """

    comm: MPI.Comm
    X: Array
    nodes: Indices
    boxes: Array

    def interpolate(self, values: Array, points: Array) -> Array:
        """Interpolate a field at points in the body (collective).

        Args:
            values: Values at the local nodes, shape (n, 2) [unit].
            points: Points of this rank, mostly in its own cells, shape (p, 2) [length].

        Returns:
            Values at these points, nan outside of the body, shape (p, 2) [unit].
        """
        return self.on_all_ranks(self._interpolate_here, values, points)[0]

    def on_all_ranks(
        self, find: Callable[[Array, Array], tuple[Array, Array]], values: Array, points: Array
    ) -> tuple[Array, Array]:
        """Values at points in the body, or what ``find`` gives for those outside (collective).

        Args:
            find: Values (p, 2) [unit] and distances (p,) [length] by the cells of a rank, of the
                field and points that no rank has in its own cells; distances are inf for none.
            values: Values at the local nodes, shape (n, 2) [unit].
            points: Points of this rank, shape (p, 2) [length].

        Returns:
            Values, shape (p, 2) [unit], and distances from the body, shape (p,) [length].
        """
        found, distances = self._interpolate_here(values, points)
        outside = np.flatnonzero(distances > 0.0)
        requests = self.comm.allgather(points[outside])
        for at, away in self.comm.alltoall([find(values, there) for there in requests]):
            nearer = away < distances[outside]
            found[outside[nearer]], distances[outside[nearer]] = at[nearer], away[nearer]
        return found, distances

    def _interpolate_here(self, values: Array, points: Array) -> tuple[Array, Array]:
        """Values (p, 2) at points (p, 2) in the cells of this rank, and zeros, else nan and inf."""
        found = np.full((len(points), 2), np.nan)
        if len(self.nodes) and len(points):
            interpolate(points, self.boxes, self.X, self.nodes, values, found)
        return found, np.where(np.isnan(found[:, 0]), np.inf, 0.0)


def triangulate(space: DisplacementSpace, mine: Indices) -> Triangles:
    """Divide the local cells of a body into triangles (local).

    Args:
        space: Nodes of the displacement.
        mine: Local nodes of the body, ghosts included, ascending, shape (n,).
    """
    V = space.V
    X = V.tabulate_dof_coordinates()[:, :2]
    number = np.full(len(X), -1)
    number[mine] = np.arange(len(mine))
    cells = number[compat.dofmap(V)]
    triangles = cells[cells[:, 0] >= 0][:, np.array(DIVISIONS[cells.shape[1]])].reshape(-1, 3)
    return triangles_of(V.mesh.comm, X[mine], triangles)


def triangles_of(comm: MPI.Comm, X: Array, nodes: Indices) -> Triangles:
    """Triangles between nodes at ``X`` (n, 2) [length], their ``nodes`` (t, 3) (local).

    A search takes O(log t) only if neighbours in the order are neighbours in space: triangles are
    sorted along a Morton curve.
    """
    if not len(nodes):
        return Triangles(comm, X, nodes, np.empty((0, 4)))
    nodes = nodes[spatial_order(X[nodes].mean(axis=1))]
    return Triangles(comm, X, nodes, build_tree(X, nodes))
