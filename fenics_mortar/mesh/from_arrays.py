# SPDX-License-Identifier: MIT
"""Meshes from arrays of nodes and cells, with named bodies and boundaries.

Bodies and boundaries are given by numbers of cells and nodes, never by positions: where two bodies
touch, their nodes have equal positions and different numbers, and stay separate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import mesh as dmesh

from fenics_mortar.mesh.data import MeshData
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
            (f, 2) in the plane, (f, 3) or (f, 4) in space; further columns may have the middles of
            its edges, as the cells have them. A facet belongs to one boundary at most.
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
    given = points, cells, bodies, boundaries
    return from_rank("mesh_from_arrays", comm, rank, partial(checked, *given))


def from_rank(what: str, comm: Any, rank: Any, read: Callable[[], CheckedArrays]) -> MeshData:
    """Create the distributed mesh from the arrays that one rank reads (collective).

    Raises:
        MeshError: On all ranks, if that rank does not exist or differs between ranks; also the
            errors of ``read``.
        ValueError: If ``comm`` is not a communicator or ``rank`` not an integer.
    """
    check_kind("comm", comm, MPI.Comm, "a communicator of mpi4py, e.g. MPI.COMM_WORLD")
    with together(comm, what):
        check_number("rank", rank, "an integer", lambda _: True, whole=True)
        if not 0 <= rank < comm.size:
            ranks = f"the ranks 0 to {comm.size - 1}"
            raise MeshError(f"rank {rank} should give the mesh, but there are {ranks}")
    check_same_texts(comm, what, {"rank": rank})
    with together(comm, what):
        mine = read() if comm.rank == rank else None
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
    tagged = Tagged(dim, nodes.shape[1], tag_of_body, tag_of_boundary, body_of_cell, facets, tags)
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
    """Reject points (n, 2 or 3) off a plane for plane cells, and on one for solids (local).

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
        further = ends[:, corners:]
        ends = np.sort(ends[:, :corners], axis=1)
        wrong = ends[~np.isin(codes_of(ends, len(x)), known) | (ends[:, 0] < 0)]
        if len(wrong):
            sides = "edges" if kind.dim == 2 else "faces"
            raise MeshError(
                f"boundary {name!r}: {len(wrong)} facets are not {sides} of cells, one "
                f"{_described(wrong[0])}"
            )
        _check_further(name, ends, further, (x, cells, kind))
        parts.append(np.unique(ends, axis=0))
        tags.append(np.full(len(parts[-1]), tag, np.int32))
    facets, tag_of = np.concatenate(parts), np.concatenate(tags)
    _, first, count = np.unique(codes_of(facets, len(x)), return_index=True, return_counts=True)
    if (count > 1).any():
        facet = facets[first[count.argmax()]]
        names = [named[t - 1][0] for t in tag_of[(facets == facet).all(axis=1)]]
        raise MeshError(f"the facet {_described(facet)} is in the boundaries {names}")
    return facets, tag_of


def _check_further(
    name: str, ends: Indices, further: Indices, mesh: tuple[Array, Indices, Kind]
) -> None:
    """Reject columns of a boundary after the corners that are no nodes of its facets (local).

    Args:
        name: Name of the boundary.
        ends: Corners of its facets, shape (f, corners).
        further: The further columns, shape (f, k).
        mesh: Points, cells, and their kind.
    """
    x, cells, kind = mesh
    corners, columns = ends.shape[1], kind.facet_nodes.shape[1]
    nodes = cells[:, kind.facet_nodes].reshape(-1, columns)
    code = codes_of(nodes[:, :corners], len(x))
    order = np.argsort(code)
    at = order[np.searchsorted(code[order], codes_of(ends, len(x)))]
    middles = further[:, : columns - corners] if columns == 8 else further  # the ninth: a centre
    wrong = (middles[:, :, None] != nodes[at][:, None, corners:]).all(axis=2).any(axis=1)
    if wrong.any():
        first = ends[wrong][0]
        middle = "" if columns == corners else ", then the middles of its edges"
        raise MeshError(
            f"boundary {name!r} has columns after the {corners} corners that are no nodes of "
            f"{wrong.sum()} of its facets, one {_described(first)} around "
            f"{format_point(x[first].mean(axis=0))}: expected the corners of each facet{middle}, "
            f"as cells of order {kind.degree} have"
        )


def _described(facet: Indices) -> str:
    """Describe a facet by the numbers of its corners."""
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
