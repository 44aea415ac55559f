# SPDX-License-Identifier: MIT
"""Meshes from arrays of nodes and cells, with named bodies and boundaries.

Bodies and boundaries are given by numbers of cells and nodes, never by positions: where two bodies
touch, their nodes have equal positions and different numbers, and stay separate.

Meshes from meshio, which reads the files of many programs.

Sets of cells or lines have the names of its cell sets, else of its integer tags.

Cells of order 2 without centres get them: quadrilaterals of 8 nodes, hexahedra of 20.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import mesh as dmesh

from fenics_mortar.mesh.data import MeshData, as_list
from fenics_mortar.mesh.edges import check_hanging_nodes, check_hanging_nodes_in_space
from fenics_mortar.mesh.space import KINDS, Kind, codes_of, facets_of
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import ROUNDING, Array, Indices, Numbers, values_at
from fenics_mortar.utils.errors import (
    MeshError,
    check_kind,
    check_number,
    check_same_texts,
    format_point,
    together,
)

# Shapes of the array of cells by the dimension of the points, and what to do with a plane mesh.
EXPECTED = {
    2: "(m, 3) or (m, 6) for triangles, (m, 4) or (m, 9) for quadrilaterals",
    3: "(m, 4) or (m, 10) for tetrahedra, (m, 8) or (m, 27) for hexahedra",
}
PLANE_IN_SPACE = " (z of the points varies: for a mesh of the x-y plane give (n, 2))"


def mesh_from_arrays(
    points: npt.ArrayLike,
    cells: npt.ArrayLike,
    bodies: Mapping[str, npt.ArrayLike],
    boundaries: Mapping[str, npt.ArrayLike],
    *,
    comm: MPI.Comm = MPI.COMM_WORLD,
    rank: int = 0,
) -> MeshData:
    """Create a mesh with named bodies and boundaries from arrays (collective).

    Bodies are joined where they have nodes in common. Nodes of equal positions with different
    numbers stay separate, so that bodies may touch. Hanging nodes, which lie inside an edge of
    another cell, are refused: the body would not be joined there.

    Args:
        points: Positions of the nodes, shape (n, 2) or (n, 3) [length]. Meshes with a constant last
            column of three are plane. Nodes without cells are ignored.
        cells: Numbers of the nodes of each cell, from 0 on, shape (m, k), in the order of VTK and
            meshio. In the plane triangles of 3 or 6 nodes or quadrilaterals of 4 or 9: the corners
            one after the other, then the middles of the edges from the first corner on, then the
            centre. In space tetrahedra of 4 or 10 nodes or hexahedra of 8 or 27: the corners of the
            base, the apex or the corners above, then the middles of the edges, of the base first,
            then the centres of the faces, then the centre.
        bodies: Cells of each body by name: numbers, or flags of shape (m,). Each cell belongs to
            one body.
        boundaries: Facets of each boundary by name: numbers of their corners in any order, shape
            (f, 2) in the plane, (f, 3) or (f, 4) in space; further columns, as middles of edges,
            are ignored. A facet belongs to one boundary at most.
        comm: Communicator of the mesh.
        rank: The rank whose arrays are used; others may pass ``None``.

    Returns:
        The distributed mesh with tags; names are equal on all ranks. Bodies and boundaries have the
        tags 1, 2, ... in the order given. ``MeshData.node_dofs`` and
        ``MeshData.nodal_values`` give dofs and values at the nodes.

    Raises:
        MeshError: On all ranks, if the arrays are not a valid mesh; the message states the reason.
        ValueError: If ``comm`` is not a communicator or ``rank`` not an integer.

    Example:
        Two squares that touch without being joined::

            x = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 1), (1, 1), (1, 2), (0, 2)]
            data = fm.mesh_from_arrays(
                x,
                [(0, 1, 2, 3), (4, 5, 6, 7)],
                bodies={"lower": [0], "upper": [1]},
                boundaries={"lower/top": [(2, 3)], "upper/bottom": [(4, 5)]},
            )
            contact = fm.ContactPair(data, slave="upper/bottom", master="lower/top")
    """
    check_rank("mesh_from_arrays", comm, rank)
    mine = None
    with together(comm, "mesh_from_arrays"):
        if comm.rank == rank:
            mine = checked(points, cells, bodies, boundaries)
    return distributed(comm, rank, mine)


def check_rank(what: str, comm: Any, rank: Any) -> None:
    """Reject a rank that should give the mesh, but does not exist or differs (collective).

    Raises:
        MeshError: On all ranks.
        ValueError: If ``comm`` is not a communicator or ``rank`` not an integer.
    """
    check_kind("comm", comm, MPI.Comm, "a communicator of mpi4py, e.g. MPI.COMM_WORLD")
    with together(comm, what):
        check_number("rank", rank, "an integer", lambda _: True, whole=True)
        if not 0 <= rank < comm.size:
            ranks = f"the ranks 0 to {comm.size - 1}"
            raise MeshError(f"rank {rank} should give the mesh, but there are {ranks}")
    check_same_texts(comm, what, {"rank": rank})


def distributed(comm: MPI.Comm, rank: int, mine: CheckedArrays | None) -> MeshData:
    """Create the distributed mesh from the arrays of rank ``rank`` (collective)."""
    tagged = comm.bcast(mine and mine.tagged, root=rank)
    kind = tagged.kind
    x = np.empty((0, kind.dim)) if mine is None else mine.points
    none = np.empty((0, tagged.num_nodes), np.int64)
    nodes = none if mine is None else mine.cells[:, kind.order]
    mesh = compat.create_mesh(comm, nodes, x, kind.name, kind.degree)
    mesh.topology.create_entities(kind.dim - 1)
    input_cells = np.asarray(mesh.topology.original_cell_index, np.int64)  # ghosts included
    cell_tags = _tags(mesh, kind.dim, tagged.body_of_cell[input_cells])
    facet_tags = _tags(mesh, kind.dim - 1, _tags_of_facets(mesh, tagged))
    return MeshData(mesh, cell_tags, facet_tags, tagged.bodies, tagged.boundaries)


@dataclass(frozen=True)
class Tagged:
    """Names, tags and facets, which all ranks need.

    Attributes:
        dim: Dimension of the cells.
        num_nodes: Nodes of a cell.
        bodies, boundaries: Tags by name.
        body_of_cell: Tag of each cell, shape (m,).
        facets: Corners of the facets of all boundaries, ascending, shape (f, corners).
        tags: Their tags, shape (f,).
    """

    dim: int
    num_nodes: int
    bodies: dict[str, int]
    boundaries: dict[str, int]
    body_of_cell: Numbers
    facets: Indices
    tags: Numbers

    @property
    def kind(self) -> Kind:
        """Kind of the cells."""
        return KINDS[self.dim, self.num_nodes]


@dataclass(frozen=True)
class CheckedArrays:
    """Checked arrays: positions (n, dim) [length], cells (m, k) as given, and the rest."""

    points: Array
    cells: Indices
    tagged: Tagged


def checked(points: Any, cells: Any, bodies: Any, boundaries: Any) -> CheckedArrays:
    """Check the arrays (local).

    Raises:
        MeshError: If they are not a valid mesh.
    """
    x, nodes = _points(points), _numbers("cells", cells)
    dim = x.shape[1]
    if nodes.ndim != 2 or (dim, nodes.shape[1]) not in KINDS or not len(nodes):
        raise MeshError(
            f"cells have shape {nodes.shape}; expected {EXPECTED[dim]}, with m > 0"
            + PLANE_IN_SPACE * (dim == 3 and nodes.ndim == 2 and (2, nodes.shape[1]) in KINDS)
        )
    kind = KINDS[dim, nodes.shape[1]]
    _check_cells(x, nodes)
    check_different(x, nodes)
    body_of_cell = _body_of_cell(bodies, x, nodes)
    facets, tags = _facets(boundaries, x, nodes, kind)
    check_joined(x, nodes, facets, tags)
    tag_of_body, tag_of_boundary = (
        {name: tag for tag, name in enumerate(some, 1)} for some in (bodies, boundaries)
    )
    num_nodes = nodes.shape[1]
    tagged = Tagged(dim, num_nodes, tag_of_body, tag_of_boundary, body_of_cell, facets, tags)
    return CheckedArrays(x, nodes, tagged)


def check_different(x: Array, cells: Indices) -> None:
    """Reject copies of cells (m, k), which crash dolfinx; their nodes are at ``x`` (local).

    Raises:
        MeshError: The message has the place of one.
    """
    _, first, count = np.unique(codes_of(cells, len(x)), return_index=True, return_counts=True)
    if (count > 1).any():
        where = format_point(x[cells[first[count.argmax()]]].mean(axis=0))
        raise MeshError(
            f"{(count - 1).sum()} cells are duplicates, one at {where}: remove the copies"
        )


def check_joined(x: Array, cells: Indices, facets: Indices, tags: Numbers) -> None:
    """Reject nodes inside an edge of another cell (local).

    Args:
        x: Positions of the nodes, shape (n, dim) [length].
        cells: Nodes of the cells, shape (m, k).
        facets: Corners of the facets of all boundaries, ascending, shape (f, corners).
        tags: Tags of these boundaries, shape (f,).

    Raises:
        MeshError: The message has the first node, its position, and the edge.
    """
    check = check_hanging_nodes if x.shape[1] == 2 else check_hanging_nodes_in_space
    check(x, cells, facets, tags)


def check_dimension(x: Array, dim: int) -> None:
    """Reject points (n, 2 or 3) that are not plane, or plane, for cells of a dimension (local).

    Raises:
        MeshError: If they do not fit.
    """
    if dim == 2 and not _are_flat(x):
        raise MeshError(f"z varies by {np.ptp(x[:, 2]):.3g}; expected a mesh of the x-y plane")
    if dim == 3 and _are_flat(x):
        raise MeshError("the cells are solids, but all points have the same z")


def _are_flat(x: Array) -> bool:
    """Whether points (n, 2 or 3) [length] have one z, apart from rounding (local)."""
    if x.shape[1] == 2 or not len(x):
        return True
    return bool(np.ptp(x[:, 2]) <= ROUNDING * np.ptp(x, axis=0).max())


def _points(points: Any) -> Array:
    """Positions of the nodes [length], (n, 2) if they lie in the plane, else (n, 3) (local)."""
    try:
        x = np.array(points, np.float64)
    except (TypeError, ValueError) as error:
        raise MeshError(f"points are not an array of numbers: {error}") from None
    if x.ndim != 2 or x.shape[1] not in (2, 3):
        raise MeshError(f"points have shape {x.shape}; expected (n, 2) or (n, 3)")
    if not np.isfinite(x).all():
        bad = np.flatnonzero(~np.isfinite(x).all(axis=1))
        raise MeshError(f"coordinates of {bad.size} points are not finite, e.g. of point {bad[0]}")
    return x[:, :2].copy() if _are_flat(x) else x


def _numbers(what: str, given: Any) -> Indices:
    """An array of integers (local)."""
    try:
        numbers = np.array(given)
    except ValueError as error:
        raise MeshError(f"{what} are not an array: {error}") from None
    if numbers.dtype.kind not in "iu" and numbers.size:
        raise MeshError(f"{what} are of type {numbers.dtype}; expected integers")
    return numbers.astype(np.int64)


def _check_cells(x: Array, cells: Indices) -> None:
    """Raise for unknown or repeated nodes (local)."""
    if cells.min() < 0 or cells.max() >= len(x):
        wrong = cells.min() if cells.min() < 0 else cells.max()
        raise MeshError(f"a cell has the node {wrong}; the points are 0 to {len(x) - 1}")
    rows = np.sort(cells, axis=1)
    repeated = np.flatnonzero((rows[:, 1:] == rows[:, :-1]).any(axis=1))
    if repeated.size:
        raise MeshError(f"cell {repeated[0]} has a node twice: {cells[repeated[0]].tolist()}")


def _named(what: str, given: Any) -> list[tuple[str, Any]]:
    """Items of a dictionary by name (local)."""
    if not isinstance(given, Mapping):
        raise MeshError(f"{what}={given!r}; expected a dictionary of arrays by name")
    for name in given:
        if not isinstance(name, str) or not name:
            raise MeshError(f"{what} has the name {name!r}; expected a text that is not empty")
    return list(given.items())


def _body_of_cell(bodies: Any, x: Array, cells: Indices) -> Numbers:
    """Tag of each cell, shape (m,) (local)."""
    count, tags = len(cells), np.zeros(len(cells), np.int32)
    named = _named("bodies", bodies)
    for tag, (name, given) in enumerate(named, 1):
        flags = np.array(given)
        if flags.dtype == bool and flags.shape != (count,):
            raise MeshError(f"body {name!r} has flags of shape {flags.shape}, expected ({count},)")
        numbers = (
            np.flatnonzero(flags) if flags.dtype == bool else _numbers(f"body {name!r}", given)
        )
        if numbers.size == 0 or numbers.min() < 0 or numbers.max() >= count:
            found = f"has cells {numbers.min()} to {numbers.max()}" if numbers.size else "is empty"
            raise MeshError(f"body {name!r} {found}; the cells are 0 to {count - 1}")
        taken = numbers[tags[numbers.ravel()] != 0] if numbers.ndim == 1 else numbers
        if taken.size:
            other = named[tags[taken.flat[0]] - 1][0]
            raise MeshError(f"cell {taken.flat[0]} is in the bodies {other!r} and {name!r}")
        tags[numbers] = tag
    if not tags.all():
        where = format_point(x[cells[tags.argmin()]].mean(axis=0))
        raise MeshError(f"{(tags == 0).sum()} cells are in no body, one at {where}")
    return tags


def _facets(boundaries: Any, x: Array, cells: Indices, kind: Kind) -> tuple[Indices, Numbers]:
    """Facets of all boundaries, corners ascending (f, corners), and their tags (f,) (local)."""
    corners = len(kind.facets[0])
    what = "two ends" if kind.dim == 2 else f"{corners} corners"
    known = codes_of(facets_of(cells, kind).reshape(-1, corners), len(x))
    parts, tags = [np.empty((0, corners), np.int64)], [np.empty(0, np.int32)]
    named = _named("boundaries", boundaries)
    for tag, (name, given) in enumerate(named, 1):
        ends = _numbers(f"facets of boundary {name!r}", given)
        if ends.ndim != 2 or ends.shape[1] < corners or not len(ends):
            expected = f"(f, {corners}): the numbers of the {what} of each facet, with f > 0"
            raise MeshError(f"boundary {name!r} has shape {ends.shape}; expected {expected}")
        ends = np.sort(ends[:, :corners], axis=1)
        wrong = ends[~np.isin(codes_of(ends, len(x)), known) | (ends[:, 0] < 0)]
        if len(wrong):
            sides = "edges" if kind.dim == 2 else "faces"
            raise MeshError(
                f"boundary {name!r}: {len(wrong)} facets are not {sides} of cells, one "
                f"{_described(wrong[0])}"
            )
        parts.append(np.unique(ends, axis=0))
        tags.append(np.full(len(parts[-1]), tag, np.int32))
    facets, tag_of = np.concatenate(parts), np.concatenate(tags)
    _, first, count = np.unique(codes_of(facets, len(x)), return_index=True, return_counts=True)
    if (count > 1).any():
        facet = facets[first[count.argmax()]]
        names = [named[t - 1][0] for t in tag_of[(facets == facet).all(axis=1)]]
        raise MeshError(f"the facet {_described(facet)} is in the boundaries {names}")
    return facets, tag_of


def _described(facet: Indices) -> str:
    """A facet by the numbers of its corners."""
    if len(facet) == 2:
        return f"from node {facet[0]} to node {facet[1]}"
    return f"of the nodes {', '.join(map(str, facet.tolist()))}"


def _tags_of_facets(mesh: dmesh.Mesh, tagged: Tagged) -> Numbers:
    """Tag of each local facet, 0 without boundary (local)."""
    topology, kind = mesh.topology, tagged.kind
    topology.create_connectivity(kind.dim - 1, 0)
    vertices = topology.connectivity(kind.dim, 0).array
    number_of = np.zeros(vertices.max(initial=-1) + 1, np.int64)
    numbers = np.asarray(mesh.geometry.input_global_indices, np.int64)
    number_of[vertices] = numbers[compat.geometry_dofmap(mesh)[:, : kind.corners]].ravel()
    ends = number_of[topology.connectivity(kind.dim - 1, 0).array]
    ends = ends.reshape(-1, len(kind.facets[0]))
    num_points = 1 + max(ends.max(initial=0), tagged.facets.max(initial=0))
    codes, known = codes_of(ends, num_points), codes_of(tagged.facets, num_points)
    return np.asarray(values_at(codes, known, tagged.tags, 0))


def _tags(mesh: dmesh.Mesh, dim: int, tags: Numbers) -> dmesh.MeshTags:
    """Tags of the local entities with a tag other than 0 (local)."""
    tagged = np.flatnonzero(tags).astype(np.int32)
    return dmesh.meshtags(mesh, dim, tagged, tags[tagged])


def with_centres(points: Array, cells: Indices, dim: int) -> tuple[Array, Indices]:
    """Points and cells with centres of faces and cells, so that the shape is the same (local).

    Args:
        points: Positions, shape (n, 2) or (n, 3) [length].
        cells: Numbers of the nodes of cells, shape (m, k), in the order of ``mesh.space``.
        dim: Dimension of the cells.

    Returns:
        Points and cells as given, or with 9 nodes instead of 8 in the plane, 27 instead of 20.
    """
    if (dim, cells.shape[1]) == (2, 8):
        return _with_groups(points, cells, [(cells, np.arange(len(cells)))])
    if (dim, cells.shape[1]) != (3, 20):
        return points, cells
    kind, count = KINDS[3, 27], len(cells)
    codes = codes_of(facets_of(cells, kind).reshape(-1, 4), len(points))
    _, first, number = np.unique(codes, return_index=True, return_inverse=True)
    faces = cells[:, kind.facet_nodes].reshape(-1, 8)[first]
    return _with_groups(
        points, cells, [(faces, number.reshape(count, 6)), (cells, np.arange(count))]
    )


def _with_groups(
    points: Array, cells: Indices, groups: list[tuple[Indices, Indices]]
) -> tuple[Array, Indices]:
    """Add centres of some entities (e, 8 or 20), given the numbers of these for each cell."""
    for nodes, number in groups:
        corners = 4 if nodes.shape[1] == 8 else 8
        at_corners, at_middles = points[nodes[:, :corners]], points[nodes[:, corners:]]
        weight = 0.5 if corners == 4 else 0.25  # of shape functions without centres
        centres = weight * at_middles.sum(axis=1) - 0.25 * at_corners.sum(axis=1)
        cells = np.column_stack([cells, len(points) + number])
        points = np.concatenate([points, centres])
    return points, cells


# Types of cells in meshio by dimension, with their numbers of nodes.
CELLS = {
    2: {"triangle": 3, "triangle6": 6, "quad": 4, "quad8": 8, "quad9": 9},
    3: {"tetra": 4, "tetra10": 10, "hexahedron": 8, "hexahedron20": 20, "hexahedron27": 27},
}
# How their names begin by dimension, and names of the cells of a body and of a boundary.
FAMILIES = {0: ("vertex",), 1: ("line",), 2: ("triangle", "quad")}
# Name of the body if no cell is in a set or has a tag.
BODY = "body"
# Arrays of tags that programs write, in the order of preference: gmsh, Medit, MED (Salome).
PREFERRED = ("gmsh:physical", "medit:ref", "cell_tags")
# Arrays of gmsh about the geometry, which are no tags of bodies or boundaries.
GEOMETRY = ("gmsh:geometrical", "gmsh:bounding_entities")
# Arrays in which 0 is no tag; in others cells may have it, as in "MaterialIDs" of VTK.
ZERO_IS_NONE = ("gmsh:physical", "cell_tags")


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

    Bodies are sets of cells and boundaries sets of their lines (in space of their triangles or
    quadrilaterals) in ``cell_sets``, such as gmsh's physical
    groups and Abaqus's element sets. Cells and facets in no set are named by their tag in
    ``cell_data``: with its name in ``field_data`` (gmsh) or ``cell_tags`` (MED), else the number as
    a text, such as "7". Sets of points (Abaqus's node sets) are boundaries, too: the facets on the
    outline that have all nodes in the set. If no cell has a set or tag, there is one body, "body".

    Args:
        mesh: The mesh of meshio, with cells of one type: triangle, triangle6, quad, quad9 or quad8;
            tetra, tetra10, hexahedron, hexahedron27 or hexahedron20. Those of 8 and 20 nodes of
            order 2 become quad9 and hexahedron27 of the same shape. Only used on rank ``rank``.
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
        MeshError: On all ranks, if the mesh is not valid, with the names of all sets.
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
    dim, whole, sides, columns = _parts(mesh)
    points, cells = with_centres(np.array(mesh.points, np.float64), whole.nodes(columns), dim)
    points = _on_cells(points, cells)
    check_dimension(points, dim)
    kind = KINDS[dim, cells.shape[1]]
    ends, key = sides.nodes(len(kind.facets[0])), _key_of_tags(mesh, tags)
    given = whole.sets(key) or {BODY: _NamedSet(np.arange(len(cells)), None)}
    curves = sides.sets(key)
    facets = {name: ends[curve.members] for name, curve in curves.items()}
    for name, nodes in mesh.point_sets.items():
        within = _facets_within(cells, kind, np.ravel(nodes), len(points))
        if len(within):
            facets.setdefault(name, within)
    try:
        named = {name: given[name].members for name in _chosen("body", bodies, given)}
        named_facets = {n: facets[n] for n in _chosen("boundary", boundaries, facets)}
        arrays = checked(points, cells, named, named_facets)
    except MeshError as error:
        raise MeshError(
            f"{error}; the mesh of meshio has the bodies {sorted(given)} and the boundaries "
            f"{sorted(facets)}, from which bodies= and boundaries= choose"
        ) from None
    of_bodies = _free_numbers([given[name].tag for name in named])
    of_facets = _free_numbers([curves[n].tag if n in curves else None for n in named_facets])
    tagged = replace(
        arrays.tagged,
        bodies=dict(zip(named, of_bodies.tolist(), strict=True)),
        boundaries=dict(zip(named_facets, of_facets.tolist(), strict=True)),
        body_of_cell=of_bodies[arrays.tagged.body_of_cell - 1],
        tags=of_facets[arrays.tagged.tags - 1],
    )
    return replace(arrays, tagged=tagged)


def _parts(mesh: Any) -> tuple[int, _Part, _Part, int]:
    """Dimension of the cells, all cells, all facets, and the number of nodes of a cell (local).

    Raises:
        MeshError: If there are no cells, several types of cells, or other types.
    """
    types = [block.type for block in mesh.cells]
    dim = 3 if any(name in CELLS[3] for name in types) else 2
    of_cells = {name for name in types if name in CELLS[dim]}
    lower = {d: {n for n in types if n.startswith(FAMILIES[d])} for d in range(dim)}
    if len(of_cells) != 1 or set(types) - of_cells - set().union(*lower.values()):
        kinds = [*CELLS[2], *CELLS[3]] if dim == 2 else CELLS[3]
        expected = f"cells of one of the types {', '.join(kinds)}, beside those of lower dimension"
        raise MeshError(f"the mesh of meshio has {sorted(set(types))}; expected {expected}")
    whole, sides = (
        _Part(mesh, d, [i for i, name in enumerate(types) if name in some], is_body=d == dim)
        for d, some in ((dim, of_cells), (dim - 1, lower[dim - 1]))
    )
    return dim, whole, sides, CELLS[dim][of_cells.pop()]


def _on_cells(points: Array, cells: Indices) -> Array:
    """Points, those without cells moved to one of a cell: they may lie anywhere (local)."""
    used = np.isin(np.arange(len(points)), cells)
    return np.where(used[:, None], points, points[used.argmax()])


def _facets_within(cells: Indices, kind: Kind, nodes: Indices, num_points: int) -> Indices:
    """Corners of the facets on the outline with all nodes in a set, (f, corners) (local)."""
    facets = facets_of(cells, kind)
    codes = codes_of(facets.reshape(-1, facets.shape[2]), num_points)
    _, number, counts = np.unique(codes, return_inverse=True, return_counts=True)
    within = (counts[number] == 1).reshape(facets.shape[:2])
    within &= np.isin(cells[:, kind.facet_nodes], nodes).all(axis=2)
    return facets[within]


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


class _NamedSet(NamedTuple):
    """Numbers of cells, shape (n,), and their tag in the file, ``None`` if it has none."""

    members: Indices
    tag: int | None


class _Part:
    """All cells of one dimension, those of several blocks one after the other.

    Args:
        mesh: The mesh of meshio.
        dim: The dimension.
        blocks: Numbers of the blocks.
        is_body: Whether these are the cells of bodies, not of boundaries.
    """

    def __init__(self, mesh: Any, dim: int, blocks: list[int], *, is_body: bool) -> None:
        self._mesh, self._dim, self._is_body = mesh, dim, is_body
        sizes = [len(mesh.cells[i].data) for i in blocks]
        self._first = dict(zip(blocks, np.cumsum([0, *sizes])[:-1], strict=True))
        self._size = sum(sizes)

    def nodes(self, columns: int) -> Indices:
        """Nodes of all cells, the first ``columns`` of each, shape (n, columns)."""
        none = np.empty((0, columns), np.int64)
        return np.concatenate([none, *(self._mesh.cells[i].data[:, :columns] for i in self._first)])

    def sets(self, key: str | None) -> dict[str, _NamedSet]:
        """Sets of ``cell_sets`` by name, and cells without one by the names of their tags.

        Args:
            key: Name of the array of tags in ``cell_data``, or ``None``.
        """
        found = dict[str, _NamedSet]()
        for name, parts in self._mesh.cell_sets.items():
            members = self._members(parts)
            if members.size and name not in GEOMETRY:
                found[name] = _NamedSet(members, self._groups().get(name))
        if key is None or not self._size:
            return found
        tags = self._tags(key)
        others = np.ones(self._size, bool)
        for known in found.values():
            others[known.members] = False
        if not self._is_body or key in ZERO_IS_NONE:
            others &= tags != 0
        for tag in np.unique(tags[others]):
            for name in self._names(int(tag)):
                members = np.flatnonzero(others & (tags == tag))
                if name in found:
                    members = np.union1d(members, found[name].members)
                found[name] = _NamedSet(members, int(tag))
        return found

    def _members(self, parts: Any) -> Indices:
        """Numbers of the cells in a set, given for each block; blocks may be left out."""
        mine = [
            self._first[i] + np.asarray(part, np.int64)
            for i, part in enumerate(parts)
            if i in self._first and part is not None
        ]
        return np.unique(np.concatenate([np.empty(0, np.int64), *mine]))

    def _tags(self, key: str) -> Indices:
        """Tags of all cells."""
        values = np.concatenate([np.ravel(self._mesh.cell_data[key][i]) for i in self._first])
        tags = values.astype(np.int64)
        if tags.size != self._size or (tags != values).any():
            raise MeshError(f"cell_data[{key!r}] is not one integer for each cell")
        return tags

    def _groups(self) -> dict[str, int]:
        """Tags of gmsh's physical groups of this dimension by name."""
        pairs = {name: np.ravel(value) for name, value in self._mesh.field_data.items()}
        return {n: int(v[0]) for n, v in pairs.items() if len(v) == 2 and v[1] == self._dim}

    def _names(self, tag: int) -> list[str]:
        """Names of a tag; the number if it has none."""
        named = [name for name, number in self._groups().items() if number == tag]
        return named or list(getattr(self._mesh, "cell_tags", {}).get(tag, [])) or [str(tag)]


def _key_of_tags(mesh: Any, given: str | None) -> str | None:
    """Name of the array of tags in ``cell_data``, or ``None`` without one (local).

    Raises:
        MeshError: If the given one is not there, or there are several and no sets.
    """
    data = mesh.cell_data
    if given is not None:
        if given not in data:
            raise MeshError(f"tags={given!r}: cell_data has {sorted(data)}")
        return given
    whole = [n for n, v in data.items() if all(np.asarray(part).dtype.kind in "iu" for part in v)]
    found = [name for name in whole if name not in GEOMETRY]
    for name in PREFERRED:
        if name in found:
            return name
    if len(found) > 1 and not mesh.cell_sets:
        raise MeshError(f"cell_data has several arrays of integers, {found}; choose by tags=")
    return found[0] if len(found) == 1 else None


def _free_numbers(tags: list[int | None]) -> Numbers:
    """Positive tags of 32 bits that are all different: those given, else free numbers."""
    largest = np.iinfo(np.int32).max
    kept = [
        tag if tag is not None and 0 < tag <= largest and tag not in tags[:i] else None
        for i, tag in enumerate(tags)
    ]
    free = (number for number in count(1) if number not in kept)
    return np.array([next(free) if tag is None else tag for tag in kept], np.int32)
