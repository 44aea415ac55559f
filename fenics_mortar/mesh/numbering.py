# SPDX-License-Identifier: MIT
"""Function values by input node numbers of the mesh, independent of the number of ranks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import basix

from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MortarError, raise_together


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
    mine = input_nodes(space.whole)
    wrong = nodes.ndim != 2 or nodes.shape[1] != mine.shape[1]
    if not wrong:
        both, number = np.unique(np.concatenate([nodes, mine]), axis=0, return_inverse=True)
        wrong = len(both) != len(nodes)
    error = MortarError("the saved state belongs to another mesh or degree") if wrong else None
    raise_together(space.V.mesh.comm, error)
    of_name = np.empty(len(both), np.int64)
    number = number.ravel()
    of_name[number[: len(nodes)]] = np.arange(len(nodes))
    u.x.array[:] = values[of_name[number[len(nodes) :]]].ravel()


def by_cell(function: Any, values: Array) -> tuple[Indices, Array]:
    """Cells and the values in them, independent of the partition (collective).

    Args:
        function: Function whose dofs are inside the cells, as of a quadrature space.
        values: Values like those of its array, shape (local values,) [any unit].

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
    """Values like those of the array of a function, (local values,), from ``by_cell`` (local).

    Args:
        function: See ``by_cell``.
        vertices: Vertices of all cells of the same mesh, shape (cells, vertices).
        values: Values in them, shape (cells, values of a cell) [any unit].
    """
    V = function.function_space
    both, number = np.unique(
        np.concatenate([vertices, _vertices(V.mesh)]), axis=0, return_inverse=True
    )
    assert len(both) == len(vertices), "another mesh"
    row, number = np.empty(len(both), np.int64), number.ravel()
    row[number[: len(vertices)]] = np.arange(len(vertices))
    dofs, found = compat.dofmap(V), np.zeros(function.x.array.size)
    mine = values[row[number[len(vertices) :]]]
    found.reshape(-1, V.dofmap.bs)[dofs] = mine.reshape(*dofs.shape, V.dofmap.bs)
    return found


def _vertices(mesh: Any) -> Indices:
    """Input numbers of the vertices of all local cells, shape (cells, vertices) (local)."""
    numbers = np.asarray(mesh.geometry.input_global_indices, np.int64)
    return numbers[compat.geometry_dofmap(mesh)[:, : compat.num_corners(mesh)]]


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
    layout = V.dofmap.dof_layout
    if len(layout.entity_dofs(0, 0)) != 1:
        raise ValueError("expected a Lagrange space that is not mixed: one node at each vertex")
    dofs, geometry = compat.dofmap(V), compat.geometry_dofmap(V.mesh)
    corners = compat.num_corners(V.mesh)
    common = geometry.shape[1] if geometry.shape == dofs.shape else corners
    numbers = np.asarray(V.mesh.geometry.input_global_indices, np.int64)
    own, first = np.unique(dofs[:, :common], return_index=True)
    return own.astype(np.int64), numbers[geometry[:, :common].ravel()[first]]
