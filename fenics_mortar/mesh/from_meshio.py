# SPDX-License-Identifier: MIT
"""Meshes from meshio, which reads the files of many programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.mesh.data import MeshData, as_list
from fenics_mortar.mesh.edges import KINDS, codes_of, edges_of
from fenics_mortar.mesh.from_arrays import CheckedArrays, check_rank, checked, distributed
from fenics_mortar.mesh.meshio_sets import NamedSet, Part, free_numbers, key_of_tags
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MeshError, together

# Types of cells in meshio, with their numbers of nodes.
CELLS = {"triangle": 3, "triangle6": 6, "quad": 4, "quad8": 8, "quad9": 9}
# Name of the body if no cell is in a set or has a tag.
BODY = "body"


def mesh_from_meshio(
    mesh: Any,
    *,
    bodies: Sequence[str] | None = None,
    boundaries: Sequence[str] | None = None,
    tags: str | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
    rank: int = 0,
) -> MeshData:
    """Create a mesh with named bodies and boundaries from a mesh of meshio (collective).

    Bodies are sets of cells and boundaries sets of lines in ``cell_sets``, such as gmsh's physical
    groups and Abaqus's element sets. Cells and lines in no set are named by their tag in
    ``cell_data``: with its name in ``field_data`` (gmsh) or ``cell_tags`` (MED), else the number as
    a text, such as "7". Sets of points (Abaqus's node sets) are boundaries, too: the facets on the
    outline that have all nodes in the set. If no cell has a set or tag, there is one body, "body".

    Args:
        mesh: The mesh of meshio, with cells of one type: triangle, triangle6, quad, quad9 or quad8;
            the last become quad9 of the same shape. Only used on rank ``rank``.
        bodies: Names of the sets that are bodies; default: all. Each cell belongs to one body:
            choose if sets overlap, such as "steel" and "all".
        boundaries: Names of the sets that are boundaries, likewise.
        tags: Name of the tags in ``cell_data``; default: "gmsh:physical", "medit:ref", "cell_tags"
            or the only array of integers.
        comm: Communicator of the mesh.
        rank: The rank whose mesh is used; others may pass ``None``.

    Returns:
        The distributed mesh; names are equal on all ranks. Bodies and boundaries keep positive tags
        of the file, others have free numbers. Numbers of nodes, as for ``MeshData.node_dofs``,
        are rows of ``mesh.points``; points without cells are ignored.

    Raises:
        MeshError: On all ranks, if the mesh is not plane or not valid, with the names of all sets.
        ValueError: If ``comm`` is not a communicator or ``rank`` not an integer.

    Example:
        An input file of Abaqus, with node sets along the surfaces::

            mesh = meshio.read("blocks.inp") if comm.rank == 0 else None
            data = fm.mesh_from_meshio(mesh, bodies=["LOWER", "UPPER"], comm=comm)
            contact = fm.ContactPair(data, slave="UPPER_BOTTOM", master="LOWER_TOP")
    """
    check_rank("mesh_from_meshio", comm, rank)
    mine = None
    with together(comm, "mesh_from_meshio"):
        if comm.rank == rank:
            mine = _arrays(mesh, bodies, boundaries, tags)
    return distributed(comm, rank, mine)


def _arrays(mesh: Any, bodies: Any, boundaries: Any, tags: str | None) -> CheckedArrays:
    """Arrays of nodes, cells and facets with names and tags (local).

    Raises:
        MeshError: If they are not a valid mesh.
    """
    if not (hasattr(mesh, "points") and hasattr(mesh, "cell_sets")):
        raise MeshError(f"mesh is {mesh!r}; expected a mesh of meshio, such as meshio.read(path)")
    flat, lines, columns = _parts(mesh)
    points, cells = _with_centres(np.array(mesh.points, np.float64), flat.nodes(columns))
    ends, key = lines.nodes(2), key_of_tags(mesh, tags)
    given = flat.sets(key) or {BODY: NamedSet(np.arange(len(cells)), None)}
    curves = lines.sets(key)
    facets = {name: ends[curve.members] for name, curve in curves.items()}
    for name, nodes in mesh.point_sets.items():
        within = _facets_within(cells, np.ravel(nodes), len(points))
        if len(within):
            facets.setdefault(name, within)
    try:
        named = {name: given[name].members for name in _chosen("body", bodies, given)}
        named_facets = {n: facets[n] for n in _chosen("boundary", boundaries, facets)}
        arrays = checked(_on_cells(points, cells), cells, named, named_facets)
    except MeshError as error:
        raise MeshError(
            f"{error}; the mesh of meshio has the bodies {sorted(given)} and the boundaries "
            f"{sorted(facets)}, from which bodies= and boundaries= choose"
        ) from None
    tagged = arrays.tagged
    of_bodies = free_numbers([given[name].tag for name in named])
    of_facets = free_numbers([curves[n].tag if n in curves else None for n in named_facets])
    return replace(
        arrays,
        tagged=replace(
            tagged,
            bodies=dict(zip(named, of_bodies.tolist(), strict=True)),
            boundaries=dict(zip(named_facets, of_facets.tolist(), strict=True)),
            body_of_cell=of_bodies[tagged.body_of_cell - 1],
            tags=of_facets[tagged.tags - 1],
        ),
    )


def _parts(mesh: Any) -> tuple[Part, Part, int]:
    """All cells, all lines, and the number of nodes of a cell (local).

    Raises:
        MeshError: If there are no cells, several types of cells, or other types.
    """
    types = [block.type for block in mesh.cells]
    of_cells = {name for name in types if name in CELLS}
    on_lines = {name for name in types if name.startswith("line")}
    if len(of_cells) != 1 or set(types) - of_cells - on_lines - {"vertex"}:
        expected = f"cells of one of the types {', '.join(CELLS)}, beside lines and vertices"
        raise MeshError(f"the mesh of meshio has {sorted(set(types))}; expected {expected}")
    flat, lines = (
        Part(mesh, dim, [i for i, name in enumerate(types) if name in some])
        for dim, some in ((2, of_cells), (1, on_lines))
    )
    return flat, lines, CELLS[of_cells.pop()]


def _with_centres(points: Array, cells: Indices) -> tuple[Array, Indices]:
    """Points and cells; cells of 8 nodes have a ninth, so that their shape is the same (local)."""
    if cells.shape[1] != 8:
        return points, cells
    corners, middles = points[cells[:, :4]], points[cells[:, 4:]]
    centres = 0.5 * middles.sum(axis=1) - 0.25 * corners.sum(axis=1)
    numbers = len(points) + np.arange(len(cells))
    return np.concatenate([points, centres]), np.column_stack([cells, numbers])


def _on_cells(points: Array, cells: Indices) -> Array:
    """Points, those without cells moved to one of a cell: they may lie anywhere (local)."""
    used = np.isin(np.arange(len(points)), cells)
    return np.where(used[:, None], points, points[used.argmax()])


def _facets_within(cells: Indices, nodes: Indices, num_points: int) -> Indices:
    """Ends of the facets on the outline that have all nodes in a set, shape (f, 2) (local)."""
    edges, corners = edges_of(cells), KINDS[cells.shape[1]][2]
    codes = codes_of(edges.reshape(-1, 2), num_points)
    _, number, counts = np.unique(codes, return_inverse=True, return_counts=True)
    within = (counts[number] == 1).reshape(-1, corners) & np.isin(edges, nodes).all(axis=2)
    if cells.shape[1] > corners:
        within &= np.isin(cells[:, corners : 2 * corners], nodes)
    return edges[within]


def _chosen(kind: str, names: Any, known: Any) -> list[str]:
    """The names to use, all by default (local).

    Raises:
        MeshError: If one of them is unknown.
    """
    chosen = [*known] if names is None else as_list(names)
    for name in chosen:
        if name not in known:
            raise MeshError(f"no {kind} {name!r}")
    return [str(name) for name in chosen]
