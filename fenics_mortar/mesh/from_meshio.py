# SPDX-License-Identifier: MIT
"""Meshes from meshio, which reads the files of many programs, with named bodies and boundaries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Any, NamedTuple

from mpi4py import MPI

import numpy as np

from fenics_mortar.mesh.data import MeshData, as_list
from fenics_mortar.mesh.from_arrays import CheckedArrays, check_dimension, checked, from_rank
from fenics_mortar.mesh.space import KINDS, Kind, codes_of, facets_of
from fenics_mortar.utils.errors import MeshError

if TYPE_CHECKING:
    from fenics_mortar.utils.arrays import Array, Indices, Numbers

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
    read = partial(_arrays, mesh, bodies, boundaries, tags)
    return from_rank("mesh_from_meshio", comm, rank, read)


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


def with_centres(points: Array, cells: Indices, dim: int) -> tuple[Array, Indices]:
    """Points and cells with centres of faces and cells, so that the shape is the same (local).

    Cells of order 2 without centres get them: quadrilaterals of 8 nodes, hexahedra of 20.

    Args:
        points: Positions, shape (n, 2) or (n, 3) [length].
        cells: Numbers of the nodes of cells, shape (m, k), in the order of ``Kind``.
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
