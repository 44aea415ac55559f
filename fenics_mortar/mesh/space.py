# SPDX-License-Identifier: MIT
"""The space of the displacement: nodes, dofs, thickness, kinds of cells, numbers of the mesh input.

``DisplacementSpace`` has the nodes and dofs of the displacement, and the out-of-plane ``Thickness``
of the bodies, by which all integrals over the interface are weighted. ``Kind`` describes the cells
that meshes from arrays may have: corners, edges and facets. Functions such as ``by_input_node`` and
``input_nodes`` give function values and nodes by the numbers of the mesh input, independent of the
number of ranks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Literal, get_args

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem

from fenics_mortar.utils import compat, errors
from fenics_mortar.utils.arrays import Array, Indices, Numbers, values_at

Geometry = Literal["plane", "axisymmetric"]
Given = float | Callable[[Array], Any] | None


def check_geometry(geometry: Any, thickness: Any) -> None:
    """Raise an error for an invalid geometry or thickness (local).

    Raises:
        ValueError: If a value is invalid.
    """
    errors.check_choice("geometry", geometry, get_args(Geometry))
    if geometry != "plane" and thickness is not None:
        raise ValueError(
            "thickness with geometry='axisymmetric': the thickness of a body of revolution is "
            "2 pi r; expected None"
        )
    if thickness is not None and not errors.is_function(thickness):
        expected = "a positive length, or a function of reference positions (n, 2)"
        errors.check_number("thickness", thickness, expected, lambda t: 0.0 < t < np.inf)


@dataclass(frozen=True)
class Thickness:
    """Thickness of all bodies: a constant part, and its derivative with respect to the current x_0.

    ==============  ==========================================================================
    geometry        thickness at a point of current position x and reference position X
    ==============  ==========================================================================
    "plane"         one, without a unit; or a given t(X) > 0 [length]
    "axisymmetric"  2 pi x_0: the mesh is the meridian half plane, the axis is x_0 = 0
    ==============  ==========================================================================

    Tractions and multipliers are always stresses. With a thickness, D, M and weights are areas, and
    forces act on the whole body. Both sides of a contact take the thickness of the slave's point,
    as the virtual work int z . (dx_s - dx_m) t dgamma demands, so that forces and moments of the
    two sides cancel.

    The residual is the user's: its measures need the thickness of the reference configuration,
    2 pi X_0 with axisymmetry, and its strains the hoop stretch, F_33 = 1 + u_0 / X_0. Quadrature
    points inside the cells avoid division by zero.

    A body of revolution has one rigid motion, the translation along the axis: a radial translation
    strains it. Only the axial forces must balance; radial forces are balanced by hoop stresses.

    Attributes:
        constant: A length, or a function of reference positions (n, 2); 0 with axisymmetry.
        by_x: Derivative with respect to the first coordinate of the current position [1]: 2 pi or
            0.
    """

    constant: float | Callable[[Array], Any]
    by_x: float

    def at_nodes(self, X: Array, comm: MPI.Comm) -> NodalThickness:
        """Thickness at nodes ``X`` (n, 2) of a surface, equal on all ranks (collective).

        Raises:
            MortarError: On all ranks, if the user's function does not return positive lengths,
                or returns different values on different ranks.
        """
        constant = errors.call_together(comm, "thickness", partial(self._constant_at, X))
        errors.check_same(comm, [("thickness", constant)])
        return NodalThickness(constant, self.by_x)

    def _constant_at(self, X: Array) -> Array:
        if not callable(self.constant):
            return np.full(len(X), self.constant)
        found = np.asarray(self.constant(X.copy()))
        if found.shape != (len(X),) or found.dtype.kind not in "iuf":
            raise errors.MortarError(
                f"thickness returned an array of shape {found.shape} and type {found.dtype} for "
                f"{len(X)} points; expected real numbers of shape ({len(X)},)"
            )
        if not (np.isfinite(found) & (found > 0.0)).all():
            raise errors.MortarError("thickness returned values that are not positive lengths")
        return found.astype(np.float64)


@dataclass(frozen=True)
class NodalThickness:
    """Thickness at the nodes of a surface, linear in their current first coordinates.

    Attributes:
        constant: Constant part, shape (nodes,) [length].
        by_x: Derivative with respect to the first coordinate [1].
    """

    constant: Array
    by_x: float

    def at(self, x: Array) -> Array:
        """Thickness with the nodes at ``x`` (nodes, 2), shape (nodes,) [length]."""
        return self.constant + self.by_x * x[:, 0]

    def of(self, nodes: npt.NDArray[np.int64]) -> NodalThickness:
        """Thickness of some of the nodes (k,)."""
        return NodalThickness(self.constant[nodes], self.by_x)


def thickness_of(geometry: Geometry, thickness: Given) -> Thickness | None:
    """Thickness of a problem; ``None`` if it is one everywhere (local)."""
    if geometry == "axisymmetric":
        return Thickness(0.0, 2.0 * np.pi)
    return None if thickness is None else Thickness(thickness, 0.0)


class DisplacementSpace:
    """The displacement's nodes, and their dofs in the space of all unknowns.

    The constructor is collective.

    Args:
        whole: Space of the unknowns: that of the displacement itself, or a mixed one.
        part: Number of the displacement's sub-space in a mixed space.
        thickness: Out-of-plane thickness of the bodies; ``None`` if it is one.

    Attributes:
        whole, part, thickness: The arguments.
        V: The space of the displacement alone, which numbers the nodes.
        dim: Number of components of the displacement, 2 or 3.
        block_size: Dofs per node of ``whole``; 1 in a mixed space.
        dofs: Local dofs in ``whole`` of the local nodes, ghosts included, shape (n, dim).
        num_nodes: Number of nodes owned by this rank, the first ones.
        num_owned: Number of dofs of ``whole`` owned by this rank, the first ones.
        first: Global number of the first of these dofs.

    Raises:
        ValueError: If the space has no such sub-space.
    """

    def __init__(self, whole: Any, part: int = 0, thickness: Thickness | None = None) -> None:
        self.whole, self.V, self.part = whole, whole, part
        self.thickness = thickness
        self.block_size: int = whole.dofmap.index_map_bs
        if self.is_mixed:
            if part not in range(whole.num_sub_spaces):
                raise ValueError(
                    f"displacement={part!r}: the space of u has the sub-spaces 0 to "
                    f"{whole.num_sub_spaces - 1}"
                )
            self.V, dofs = compat.collapsed(whole.sub(part))
        elif part:
            raise ValueError(f"displacement={part!r}: the function u is not mixed")
        else:
            index_map = whole.dofmap.index_map
            dofs = np.arange(self.block_size * (index_map.size_local + index_map.num_ghosts))
        self.dim: int = whole.mesh.geometry.dim
        self.dofs: Indices = dofs.reshape(-1, self.V.dofmap.index_map_bs)
        self.num_nodes: int = self.V.dofmap.index_map.size_local
        self.num_owned: int = self.block_size * whole.dofmap.index_map.size_local
        self.first: int = self.block_size * whole.dofmap.index_map.local_range[0]

    @property
    def is_mixed(self) -> bool:
        """Whether there are unknowns other than the displacement (local)."""
        return self.block_size == 1 and self.whole.num_sub_spaces > 0

    @cached_property
    def fields(self) -> dict[int, tuple[Any, Indices]]:
        """Other parts of a mixed space: a space of its own, and its local dofs (collective)."""
        parts = set(range(self.whole.num_sub_spaces if self.is_mixed else 0)) - {self.part}
        return {part: compat.collapsed(self.whole.sub(part)) for part in sorted(parts)}

    @property
    def is_axisymmetric(self) -> bool:
        """Whether the mesh is the meridian half plane of bodies of revolution (local)."""
        return self.thickness is not None and self.thickness.by_x != 0.0

    @property
    def owned_dofs(self) -> Indices:
        """Local dofs of the nodes owned by this rank, shape (``num_nodes``, dim) (local)."""
        return self.dofs[: self.num_nodes]

    def positions(self) -> Array:
        """Positions of the nodes, shape (local dofs,) [length]; zero for other unknowns (local)."""
        values = np.zeros(int(self.dofs.max(initial=-1)) + 1)
        values[self.dofs] = self.V.tabulate_dof_coordinates()[:, : self.dim]
        return values

    def spread(self, nodal: npt.NDArray[Any]) -> Array:
        """Return values (n,) of the local nodes as an array of all local dofs [their unit] (local).

        All components have the value of the node; other unknowns are zero.
        """
        index_map = self.whole.dofmap.index_map
        values = np.zeros(self.block_size * (index_map.size_local + index_map.num_ghosts))
        values[self.dofs] = nodal[:, None]
        return values

    @cached_property
    def _scalar(self) -> tuple[fem.Function, Indices]:
        """A function of one component of the displacement, and the local nodes of its dofs."""
        V, dofs = compat.collapsed(self.V.sub(0))
        return fem.Function(V), dofs // self.dim

    def nodal_values(self, function: fem.Function) -> Array:
        """Values of a scalar function at the nodes as by ``spread`` [their unit] (collective)."""
        scalar, nodes = self._scalar
        scalar.interpolate(function)
        scalar.x.scatter_forward()
        values = np.zeros(len(self.dofs))
        values[nodes] = scalar.x.array
        return self.spread(values)

    def move_nodes(self, nodes: Indices, X: Array) -> None:
        """Move nodes of the mesh (collective, but without communication).

        Displacement nodes inside straight edges, which are not nodes of the geometry, move with the
        edge.

        Args:
            nodes: Global numbers of nodes of ``V``, equal on all ranks, shape (k,).
            X: New positions, shape (k, dim) [length].
        """
        index_map, mesh = self.V.dofmap.index_map, self.V.mesh
        count = index_map.size_local + index_map.num_ghosts
        here = index_map.local_to_global(np.arange(count, dtype=np.int32))
        own, geometry = compat.dofmap(self.V), compat.geometry_dofmap(mesh)
        index = np.full(count, -1)
        index[own[:, : geometry.shape[1]]] = geometry
        at = values_at(here, nodes, np.arange(nodes.size), -1)
        found = (at >= 0) & (index >= 0)
        mesh.geometry.x[index[found], : self.dim] = X[at[found]]


# Shifts and factors of the hash function splitmix64; its first factor is the last one here.
SHIFTS, FACTORS = (30, 27, 31), (0xBF58476D1CE4E5B9, 0x94D049BB133111EB, 0x9E3779B97F4A7C15)
# Nodes of triangles, quadrilaterals, tetrahedra and hexahedra of order 1 and of order 2.
NUMBERS = (3, 4, 4, 8), (6, 9, 10, 27)


@dataclass(frozen=True)
class Kind:
    """A kind of cells.

    Nodes are numbered as in VTK and meshio: corners, middles of edges, centres of faces, centre of
    the cell. Faces of hexahedra have centres with 27 nodes.

    Attributes:
        name: Name of the cell in basix.
        degree: Degree of the geometry.
        vertices: Corners in the order of basix.
        edges: Corners of each edge, in the order of the nodes in their middles.
        faces: Corners of each face one after the other, in the order of the nodes at their centres;
            the cell itself in the plane.
    """

    name: str
    degree: int
    vertices: tuple[int, ...]
    edges: tuple[tuple[int, int], ...]
    faces: tuple[tuple[int, ...], ...]

    @property
    def dim(self) -> int:
        """Dimension of the cell."""
        return 2 if len(self.faces) == 1 else 3

    @property
    def corners(self) -> int:
        """Number of corners."""
        return len(self.vertices)

    @property
    def facets(self) -> tuple[tuple[int, ...], ...]:
        """Corners of each facet."""
        return self.edges if self.dim == 2 else self.faces

    @property
    def facet_nodes(self) -> Indices:
        """Corners of each facet and the middles of its edges, shape (facets, k)."""
        if self.degree == 1:
            return np.array(self.facets)
        middles = [
            [self.corners + i for i, edge in enumerate(self.edges) if set(edge) <= set(facet)]
            for facet in self.facets
        ]
        return np.hstack([self.facets, middles])

    @cached_property
    def order(self) -> list[int]:
        """The nodes in the order of basix."""
        places = {frozenset([corner]): corner for corner in range(self.corners)}
        if self.degree == 2:
            named = [frozenset(edge) for edge in self.edges]
            named += [frozenset(face) for face in self.faces if len(face) == 4]
            named += [frozenset(range(8))] if self.corners == 8 else []
            places |= {entity: self.corners + i for i, entity in enumerate(named)}
        topology = basix.topology(getattr(basix.CellType, self.name))
        found = [frozenset(self.vertices[v] for v in ends) for same in topology for ends in same]
        return [places[entity] for entity in found if entity in places]


def _kinds() -> dict[tuple[int, int], Kind]:
    """All kinds by dimension and number of nodes."""
    triangle = (0, 1), (1, 2), (2, 0)
    square = (0, 1), (1, 2), (2, 3), (3, 0)
    lid = tuple((i + 4, j + 4) for i, j in square)
    posts = tuple((i, i + 4) for i in range(4))
    sides = (0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 1, 2, 3), (4, 5, 6, 7)
    pyramid = (0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)
    box = (0, 1, 3, 2, 4, 5, 7, 6)
    kinds: dict[tuple[int, int], Kind] = {}
    for degree, (of_triangle, of_square, of_pyramid, of_box) in enumerate(NUMBERS, 1):
        kinds |= {
            (2, of_triangle): Kind("triangle", degree, (0, 1, 2), triangle, ((0, 1, 2),)),
            (2, of_square): Kind("quadrilateral", degree, box[:4], square, ((0, 1, 2, 3),)),
            (3, of_pyramid): Kind(
                "tetrahedron", degree, (0, 1, 2, 3), (*triangle, (0, 3), (1, 3), (2, 3)), pyramid
            ),
            (3, of_box): Kind("hexahedron", degree, box, (*square, *lid, *posts), sides),
        }
    return kinds


# All kinds by dimension and number of nodes.
KINDS = _kinds()


def facets_of(cells: Indices, kind: Kind) -> Indices:
    """Corners of the facets of cells (m, k), shape (m, facets, corners of a facet) (local)."""
    return cells[:, np.array(kind.facets)]


def codes_of(facets: Indices, num_points: int) -> Indices:
    """One number for each facet or cell (f, nodes), whatever the order of its nodes, shape (f,).

    Those of edges are exact. For others it is the sum of 64 bits that a hash function gives each
    node: two of ten million faces have the same number with a probability of 3e-6.
    """
    if facets.shape[1] == 2:
        return np.asarray(facets.min(axis=1) * num_points + facets.max(axis=1))
    bits = (facets.astype(np.uint64) + np.uint64(1)) * np.uint64(FACTORS[2])
    for shift, factor in zip(SHIFTS, (*FACTORS[:2], 1), strict=True):
        bits = (bits ^ (bits >> np.uint64(shift))) * np.uint64(factor)
    return bits.sum(axis=1, dtype=np.uint64).view(np.int64)


def by_input_node(space: DisplacementSpace, u: Any) -> tuple[Indices, Array]:
    """Identifiers and values of all nodes, on all ranks (collective).

    Args:
        space: The displacement's nodes and dofs.
        u: Function of the whole space.

    Returns:
        Identifiers of the nodes, see ``input_nodes``, shape (n, k), in ascending order, and their
        values, shape (n, dim); in a mixed space each dof counts as a node, shape (n, 1).
    """
    comm, size = space.V.mesh.comm, space.block_size
    owned = space.num_owned // size
    nodes = np.concatenate(comm.allgather(input_nodes(space.whole)[:owned]))
    values = np.concatenate(comm.allgather(u.x.array.reshape(-1, size)[:owned]))
    order = np.lexsort(nodes.T[::-1])
    return nodes[order], values[order]


def set_by_input_node(space: DisplacementSpace, u: Any, nodes: Indices, values: Array) -> None:
    """Set a function from the result of ``by_input_node``, for any partition (collective).

    Args:
        space: The displacement's nodes and dofs.
        u: The function.
        nodes: Identifiers of all nodes, shape (n, k).
        values: Values there, shape (n, components of a node).

    Raises:
        MortarError: On all ranks, if the nodes belong to another mesh or degree.
    """
    rows = _rows_among(input_nodes(space.whole), nodes)
    wrong = "the saved state belongs to another mesh or degree"
    errors.raise_together(space.V.mesh.comm, errors.MortarError(wrong) if rows is None else None)
    u.x.array[:] = values[rows].ravel()


def _rows_among(mine: Indices, every: Indices) -> Indices | None:
    """Numbers (n,) of rows ``mine`` (n, c) among different ones (m, c); ``None`` if one is not."""
    if every.ndim != 2 or every.shape[1] != mine.shape[1]:
        return None
    both, number = np.unique(np.concatenate([every, mine]), axis=0, return_inverse=True)
    if len(both) != len(every):
        return None
    row, number = np.empty(len(both), np.int64), number.ravel()
    row[number[: len(every)]] = np.arange(len(every))
    return row[number[len(every) :]]


def by_cell(function: Any, values: Array) -> tuple[Indices, Array]:
    """Cells and the values in them, independent of the partition (collective).

    Args:
        function: Function whose dofs are inside the cells, as of a quadrature space.
        values: Values in the order of its array, shape (local values,) [any unit].

    Returns:
        Input numbers of the vertices of all cells, in the order of the reference cell and ascending
        by cells, shape (cells, vertices), and the values in each, shape (cells, values of a cell)
        [any unit].
    """
    V = function.function_space
    owned = V.mesh.topology.index_map(V.mesh.topology.dim).size_local
    inside = values.reshape(-1, V.dofmap.bs)[compat.dofmap(V)[:owned]]
    mine = _vertices(V.mesh)[:owned], inside.reshape(owned, math.prod(inside.shape[1:]))
    vertices, numbers = (np.concatenate(V.mesh.comm.allgather(each)) for each in mine)
    order = np.lexsort(vertices.T[::-1])
    return vertices[order], numbers[order]


def set_by_cell(function: Any, vertices: Indices, values: Array) -> Array:
    """Values in the order of a function's array, (local values,), from ``by_cell`` (local).

    Args:
        function: See ``by_cell``.
        vertices: Vertices of all cells of the same mesh, shape (cells, vertices).
        values: Values in them, shape (cells, values of a cell) [any unit].
    """
    V = function.function_space
    rows = _rows_among(_vertices(V.mesh), vertices)
    assert rows is not None, "another mesh"
    dofs, found = compat.dofmap(V), np.zeros(function.x.array.size)
    found.reshape(-1, V.dofmap.bs)[dofs] = values[rows].reshape(*dofs.shape, V.dofmap.bs)
    return found


def _vertices(mesh: Any) -> Indices:
    """Input numbers of the vertices of all local cells, shape (cells, vertices) (local)."""
    numbers = np.asarray(mesh.geometry.input_global_indices, np.int64)
    return numbers[compat.geometry_dofmap(mesh)[:, : compat.num_corners(mesh)]]


def cells_of_facets(mesh: Any, facets: Numbers) -> tuple[Indices, Indices]:
    """First cells of facets, and the facets' numbers in them, shape (m,) each (local).

    Requires the connectivities facets -> cells and cells -> facets.

    Args:
        mesh: The mesh.
        facets: Local facets, shape (m,).
    """
    topology, dim = mesh.topology, mesh.topology.dim
    to_cells, to_facets = topology.connectivity(dim - 1, dim), topology.connectivity(dim, dim - 1)
    cells = to_cells.array[to_cells.offsets[facets]].astype(np.int64)
    sides = len(basix.topology(getattr(basix.CellType, compat.cell_name(mesh)))[dim - 1])
    numbers = (to_facets.array.reshape(-1, sides)[cells] == facets[:, None]).argmax(axis=1)
    return cells, numbers


def input_nodes(V: Any) -> Indices:
    """Return identifiers of the local nodes of ``V``, independent of the partition (local).

    A node at a vertex is identified by the number of the vertex in the mesh input, a node on an
    edge or inside a cell by the numbers of the vertices of the edge or cell in ascending order.
    Shape (local nodes, largest number of vertices), padded by -1. In a mixed space every dof counts
    as a node, and a last column numbers dofs at the same position.
    """
    mesh, layout, dofs = V.mesh, V.dofmap.dof_layout, compat.dofmap(V)
    topology = basix.topology(getattr(basix.CellType, compat.cell_name(mesh)))
    vertices = _vertices(mesh)
    found = [
        (dof, number, around)
        for dim, entities in enumerate(topology)
        for i, around in enumerate(entities)
        for number, dof in enumerate(layout.entity_dofs(dim, i))
    ]
    width = max(len(around) for _, _, around in found)
    index_map = V.dofmap.index_map
    names = np.full((index_map.size_local + index_map.num_ghosts, width + 1), -1, np.int64)
    for dof, number, around in found:
        names[dofs[:, dof], : len(around)] = np.sort(vertices[:, around], axis=1)
        names[dofs[:, dof], width] = number
    return names if any(number for _, number, _ in found) else names[:, :width]


def mesh_by_input_node(mesh: Any) -> tuple[Indices, Array]:
    """Return cells and coordinates of a mesh, independent of the number of ranks (collective).

    Returns:
        Input numbers of the nodes of all cells, ascending in a cell and by cells, shape (cells,
        nodes per cell), and coordinates of all nodes in this numbering, (nodes, dim) [length].
    """
    geometry, num_cells = mesh.geometry, mesh.topology.index_map(mesh.topology.dim).size_local
    numbers = np.asarray(geometry.input_global_indices, np.int64)
    owned = geometry.index_map().size_local
    cells = np.sort(numbers[compat.geometry_dofmap(mesh)[:num_cells]], axis=1)
    cells = np.concatenate(mesh.comm.allgather(cells))
    names = np.concatenate(mesh.comm.allgather(numbers[:owned]))
    x = np.concatenate(mesh.comm.allgather(geometry.x[:owned, : geometry.dim]))
    return cells[np.lexsort(cells.T[::-1])], x[np.argsort(names)]


def numbered_dofs(V: Any) -> tuple[Indices, Indices]:
    """Local blocked dofs at nodes of the mesh input, and the numbers of these, each (n,)."""
    if len(V.dofmap.dof_layout.entity_dofs(0, 0)) != 1:
        raise ValueError("expected a Lagrange space that is not mixed: one node at each vertex")
    dofs, geometry = compat.dofmap(V), compat.geometry_dofmap(V.mesh)
    corners = compat.num_corners(V.mesh)
    common = geometry.shape[1] if geometry.shape == dofs.shape else corners
    numbers = np.asarray(V.mesh.geometry.input_global_indices, np.int64)
    own, first = np.unique(dofs[:, :common], return_index=True)
    return own.astype(np.int64), numbers[geometry[:, :common].ravel()[first]]
