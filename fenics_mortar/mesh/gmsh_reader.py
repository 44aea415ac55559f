# SPDX-License-Identifier: MIT
"""Reader of gmsh's models and .msh files, whose physical groups name bodies and boundaries.

In the plane physical groups of dimension 2 are bodies, those of dimension 1 boundaries; in space
those of dimension 3 and 2. Wherever a name is expected, the integer tag of the group is accepted as
well.

``read_msh`` reads files of the formats 4.1 and 2.2, ``GmshMesh`` holds what was read, and
``read_gmsh`` makes the distributed mesh from it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from fenics_mortar.mesh import from_arrays
from fenics_mortar.mesh.space import KINDS
from fenics_mortar.utils.arrays import ROUNDING, Array, Indices, Numbers
from fenics_mortar.utils.errors import MeshError, refuse_in_space

if TYPE_CHECKING:
    from fenics_mortar.mesh.data import MeshData

# Dimension, name and number of nodes of gmsh's element types up to order 3.
TYPES = {
    15: (0, "Point", 1), 1: (1, "Line 2", 2), 8: (1, "Line 3", 3), 26: (1, "Line 4", 4),
    2: (2, "Triangle 3", 3), 9: (2, "Triangle 6", 6), 21: (2, "Triangle 10", 10),
    3: (2, "Quadrilateral 4", 4), 16: (2, "Quadrilateral 8", 8), 10: (2, "Quadrilateral 9", 9),
    36: (2, "Quadrilateral 16", 16), 4: (3, "Tetrahedron 4", 4), 11: (3, "Tetrahedron 10", 10),
    29: (3, "Tetrahedron 20", 20), 5: (3, "Hexahedron 8", 8), 17: (3, "Hexahedron 20", 20),
    12: (3, "Hexahedron 27", 27), 92: (3, "Hexahedron 64", 64), 6: (3, "Prism 6", 6),
    18: (3, "Prism 15", 15), 13: (3, "Prism 18", 18), 7: (3, "Pyramid 5", 5),
    19: (3, "Pyramid 13", 13), 14: (3, "Pyramid 14", 14),
}  # fmt: skip
# Nodes of gmsh's solids of order 2 in the order of ``Kind``, by their number.
TETRAHEDRON = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
HEXAHEDRON = [*range(8), 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15, 22, 23, 21, 24, 20, 25, 26]
ORDERS = {10: TETRAHEDRON, 27: HEXAHEDRON}
FORMATS = ([b"$MeshFormat", b"4.1"], [b"$MeshFormat", b"2.2"], [b"$MeshFormat", b"2.1"])
# Number of elements of a text of format 2.2 that are read at a time if they are of one type.
CHUNK = 256
# Types in binary files: size_t, int and double.
SIZE, INT, DOUBLE = "<u8", "<i4", "<f8"


class Block(NamedTuple):
    """Elements of one type of an entity: their nodes (n, k)."""

    type: int
    nodes: Indices


class GmshMesh:
    """Physical groups, elements and nodes.

    Attributes:
        names: Names of physical groups by dimension and tag.
        groups: Tags of physical groups by dimension and tag of an entity.
        blocks: Elements by dimension and tag of an entity.
        tags: Numbers of the nodes, shape (n,).
        x: Their positions, shape (n, 3) [length].
    """

    def __init__(self) -> None:
        self.names: dict[tuple[int, int], str] = {}
        self.groups: dict[tuple[int, int], list[int]] = {}
        self.blocks: dict[tuple[int, int], list[Block]] = {}
        self.tags: Indices = np.empty(0, np.int64)
        self.x: Array = np.empty((0, 3))

    @classmethod
    def of(cls, model: Any) -> GmshMesh:
        """The mesh of a live model, the module ``gmsh.model``."""
        mesh = cls()
        mesh.names = {key: model.getPhysicalName(*key) for key in model.getPhysicalGroups()}
        for key in model.getEntities():
            mesh.groups[key] = np.abs(model.getPhysicalGroupsForEntity(*key)).tolist()
            for kind, numbers, nodes in zip(*model.mesh.getElements(*key)):
                rows = np.reshape(nodes, (len(numbers), -1)).astype(np.int64)
                mesh.blocks.setdefault(key, []).append(Block(int(kind), rows))
        tags, x, _ = model.mesh.getNodes()
        mesh.tags, mesh.x = np.asarray(tags, np.int64), np.reshape(x, (-1, 3))
        return mesh

    @property
    def dim(self) -> int:
        """3 if there are solid elements, else 2."""
        return 3 if self.elements(3) else 2

    def entities(self, dim: int) -> list[int]:
        """Tags of all entities of a dimension."""
        return sorted(tag for d, tag in {*self.groups, *self.blocks} if d == dim)

    def groups_of(self, dim: int) -> list[int]:
        """Tags of all groups with entities of a dimension."""
        return sorted({tag for (d, _), tags in self.groups.items() if d == dim for tag in tags})

    def elements(self, dim: int) -> dict[int, Indices]:
        """Nodes (n, k) of all elements of a dimension by type."""
        blocks = [b for tag in self.entities(dim) for b in self.blocks.get((dim, tag), [])]
        kinds = sorted({block.type for block in blocks})
        return {kind: np.concatenate([b.nodes for b in blocks if b.type == kind]) for kind in kinds}

    def tagged_elements(self, dim: int) -> tuple[Indices, Numbers]:
        """Nodes of all groups' elements, numbered from 0, (n, k), and tags of the groups (n,)."""
        nodes, tags = [], []
        for group in self.groups_of(dim):
            for entity in self.entities(dim):
                inside = group in self.groups.get((dim, entity), [])
                for block in self.blocks.get((dim, entity), []) if inside else []:
                    nodes.append(block.nodes - 1)
                    tags.append(np.full(len(block.nodes), group, np.int32))
        if not nodes:
            return np.empty((0, 2), np.int64), np.empty(0, np.int32)
        return np.concatenate(nodes), np.concatenate(tags)

    def given(
        self, bodies: dict[str, int], boundaries: dict[str, int]
    ) -> from_arrays.CheckedArrays:
        """The mesh as arrays with names of its groups, after ``renumber_nodes``.

        Raises:
            MeshError: For duplicates, or if a node lies inside an edge of another cell.
        """
        dim = self.dim
        cells, body_of_cell = self.tagged_elements(dim)
        if dim == 3 and cells.shape[1] in ORDERS:
            cells = cells[:, ORDERS[cells.shape[1]]]
        corners = len(KINDS[dim, cells.shape[1]].facets[0])
        facets, tags = self.tagged_elements(dim - 1)
        ends = np.sort(facets[:, :corners], axis=1) if tags.size else np.empty((0, corners), int)
        tagged = from_arrays.Tagged(
            dim, cells.shape[1], bodies, boundaries, body_of_cell, ends, tags
        )
        x = self.x[np.argsort(self.tags), :dim]
        from_arrays.check_different(x, cells)
        from_arrays.check_joined(x, cells, ends, tags)
        return from_arrays.CheckedArrays(x, cells, tagged)

    def renumber_nodes(self) -> None:
        """Renumber the nodes from 1 without gaps, in the order of their numbers."""
        known = np.sort(self.tags)
        for blocks in self.blocks.values():
            blocks[:] = [b._replace(nodes=np.searchsorted(known, b.nodes) + 1) for b in blocks]
        self.tags = np.searchsorted(known, self.tags) + 1


def read_msh(path: Path) -> GmshMesh:
    """Read a file of format 4.1 or 2.2.

    The sections of physical names, entities, nodes and elements are read, as text or binary,
    without gmsh, whose import takes longer than a small solve. In format 2.2 each element has its
    entity and physical group beside its nodes.

    Raises:
        MeshError: If the file is damaged or of another format.
    """
    content = path.read_bytes()
    head = content[:64].split()
    if head[:2] not in FORMATS or head[2:4] not in ([b"0", b"8"], [b"1", b"8"]):
        given = b" ".join(head[1:4]).decode(errors="replace")
        raise MeshError(
            f"cannot read '{path}': its format is {given!r}; expected 4.1 or 2.2 of gmsh, or open "
            "it by gmsh and pass gmsh.model"
        )
    binary, is_old = head[2] == b"1", head[1] != b"4.1"
    one = content.find(b"\n", content.find(b"\n") + 1) + 1
    if binary and content[one : one + 4] != np.array(1, INT).tobytes():
        raise MeshError(f"cannot read '{path}': it was written with another byte order")
    file = GmshMesh()
    readers = {b"Entities": _read_entities, b"Nodes": _read_nodes, b"Elements": _read_elements}
    old_readers = {b"Nodes": _read_old_nodes, b"Elements": _read_old_elements}
    try:
        for name, section in _sections(content):
            if name == b"PhysicalNames":
                _read_names(file, section.decode())
            elif is_old and name in old_readers:
                count, _, section = section.partition(b"\n")  # a text in binary files, too
                numbers = _Numbers(section, binary=binary)
                old_readers[name](file, numbers, int(count))
                numbers.end()
            elif not is_old and name in readers:
                numbers = _Numbers(section, binary=binary)
                readers[name](file, numbers)
                numbers.end()
    except (ValueError, IndexError) as error:
        raise MeshError(f"cannot read '{path}': {error}") from None
    except KeyError as number:
        raise MeshError(
            f"cannot read '{path}': elements of the unknown type {number}; expected order 1 or 2"
        ) from None
    if np.unique(file.tags).size < file.tags.size:
        raise MeshError(f"cannot read '{path}': nodes have the same number")
    nodes = [block.nodes.ravel() for blocks in file.blocks.values() for block in blocks]
    if nodes and not np.isin(np.concatenate(nodes), file.tags).all():
        raise MeshError(f"cannot read '{path}': elements have nodes that are not in the file")
    return file


def _sections(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Names and contents of the sections."""
    begin = content.find(b"$")
    while begin >= 0:
        start = content.index(b"\n", begin)
        name = content[begin + 1 : start].strip()
        end = content.find(b"\n$End" + name, start)
        if end < 0:
            raise ValueError(f"section '{name.decode(errors='replace')}' has no end")
        yield name, content[start + 1 : end]
        begin = content.find(b"\n$", end + len(name) + 5) + 1 or -1


class _Numbers:
    """The numbers of a section, one after the other."""

    def __init__(self, section: bytes, *, binary: bool) -> None:
        self._binary, self._at, self._section = binary, 0, section
        if not binary:
            self._text = np.array(section.split(), np.float64)

    def read(self, kind: str, count: int = 1) -> npt.NDArray:
        """The next ``count`` numbers of a type."""
        if self._binary:
            found = np.frombuffer(self._section, kind, count, self._at)
            self._at += found.nbytes
            return found.astype(np.float64 if kind == DOUBLE else np.int64)
        found = self._text[self._at : self._at + count]
        if found.size < count:
            raise ValueError("a section has too few numbers")
        self._at += count
        return found if kind == DOUBLE else found.astype(np.int64)

    def read_nodes(self, count: int) -> tuple[Indices, Array]:
        """Numbers and positions [length] of ``count`` nodes of format 2.2."""
        if self._binary:
            kind = np.dtype([("number", INT), ("x", DOUBLE, 3)])
            found = np.frombuffer(self._section, kind, count)
            self._at += found.nbytes
            return found["number"].astype(np.int64), found["x"].copy()
        rows = self.read(DOUBLE, 4 * count).reshape(count, 4)
        return rows[:, 0].astype(np.int64), rows[:, 1:]

    def read_elements(self, most: int) -> tuple[int, Indices]:
        """The next elements of format 2.2 of one type, at most ``most`` of a text.

        Number, type and number of tags precede each of them in a text, several in a binary file.

        Returns:
            The type, and rows of physical group, entity and nodes.
        """
        if self._binary:
            kind, count, num_tags = self.read(INT, 3).tolist()
            before, columns = 1, 1 + num_tags + TYPES[kind][2]
        else:
            kind, num_tags = map(int, self._text[self._at + 1 : self._at + 3])
            before, columns = 3, 3 + num_tags + TYPES[kind][2]
            rows = self._text[self._at : self._at + min(most, CHUNK) * columns]
            rows = rows[: rows.size // columns * columns].reshape(-1, columns)
            others = np.flatnonzero((rows[:, 1:3] != (kind, num_tags)).any(axis=1))
            count = others[0] if others.size else max(len(rows), 1)
        rows = self.read(INT, count * columns).reshape(count, columns)[:, before:]
        tags = np.zeros((count, 2), np.int64)  # group and entity, 0 where an element has none
        tags[:, :num_tags] = rows[:, : min(num_tags, 2)]
        return kind, np.hstack([tags, rows[:, num_tags:]])

    def end(self) -> None:
        """Check that all numbers have been read."""
        size = len(self._section) if self._binary else self._text.size
        if self._at != size:
            raise ValueError("a section has too many numbers")


def _read_names(file: GmshMesh, section: str) -> None:
    for line in section.splitlines()[1:]:
        dim, tag, name = line.split(maxsplit=2)
        file.names[int(dim), int(tag)] = name.strip().strip('"')


def _read_entities(file: GmshMesh, numbers: _Numbers) -> None:
    for dim, count in enumerate(numbers.read(SIZE, 4)):
        for _ in range(count):
            tag = int(numbers.read(INT)[0])
            numbers.read(DOUBLE, 6 if dim else 3)  # bounding box, or a point
            groups = numbers.read(INT, int(numbers.read(SIZE)[0]))
            file.groups[dim, tag] = np.abs(groups).tolist()  # signs are directions
            if dim:
                numbers.read(INT, int(numbers.read(SIZE)[0]))  # its boundary


def _read_nodes(file: GmshMesh, numbers: _Numbers) -> None:
    num_blocks, *_ = numbers.read(SIZE, 4)
    tags, x = [file.tags], [file.x]
    for _ in range(num_blocks):
        dim, _, parametric = numbers.read(INT, 3)
        count = int(numbers.read(SIZE)[0])
        tags.append(numbers.read(SIZE, count))
        columns = 3 + dim * parametric
        x.append(numbers.read(DOUBLE, count * columns).reshape(count, columns)[:, :3])
    file.tags, file.x = np.concatenate(tags), np.concatenate(x)


def _read_elements(file: GmshMesh, numbers: _Numbers) -> None:
    num_blocks, *_ = numbers.read(SIZE, 4)
    for _ in range(num_blocks):
        dim, tag, kind = numbers.read(INT, 3).tolist()
        count = int(numbers.read(SIZE)[0])
        columns = 1 + TYPES[kind][2]
        rows = numbers.read(SIZE, count * columns).reshape(count, columns)
        file.blocks.setdefault((dim, tag), []).append(Block(kind, rows[:, 1:]))


def _read_old_nodes(file: GmshMesh, numbers: _Numbers, count: int) -> None:
    file.tags, file.x = numbers.read_nodes(count)


def _read_old_elements(file: GmshMesh, numbers: _Numbers, count: int) -> None:
    found: dict[int, list[Indices]] = {}
    while count > 0:
        kind, rows = numbers.read_elements(count)
        found.setdefault(kind, []).append(rows)
        count -= len(rows)
    for kind, parts in found.items():
        groups, entities, nodes = np.split(np.concatenate(parts), [1, 2], axis=1)
        for entity in np.unique(entities).tolist():
            key, mine = (TYPES[kind][0], entity), entities[:, 0] == entity
            file.blocks.setdefault(key, []).append(Block(kind, nodes[mine]))
            known = {*file.groups.get(key, []), *np.abs(groups[mine]).ravel().tolist()}
            file.groups[key] = sorted(known - {0})


# Gmsh's types of cells by dimension: triangles and quadrilaterals, tetrahedra and hexahedra, of
# order 1 and 2.
CELLS = {2: (2, 9, 3, 10), 3: (4, 11, 5, 12)}
CUBIC = (29, 92)  # tetrahedra and hexahedra of order 3
EXPECTED = {2: "'Triangle 6'", 3: "'Tetrahedron 10' or 'Hexahedron 8'"}


def read_gmsh(source: str | Path | Any, comm: MPI.Comm, *, rank: int = 0) -> MeshData:
    """Read a mesh with names of bodies and boundaries from gmsh (collective).

    In the plane each surface has to belong to one physical group, its body, and each curve to at
    most one, its boundary; in space each volume and each surface. Cells are of one type: triangles
    or quadrilaterals, tetrahedra or hexahedra, of order 1 or 2.

    Args:
        source: Path of a .msh file of format 4.1 or 2.2, or the module ``gmsh.model`` with a
            generated mesh. Only used on rank ``rank``; other ranks may pass ``None``.
        comm: Communicator of the mesh.
        rank: The rank that reads.

    Returns:
        The distributed mesh with tags; names are equal on all ranks.

    Raises:
        MeshError: On all ranks, if the file or the model cannot be read; the message states the
            reason.
        NotImplementedError: On all ranks, for solids of order 3.
        ValueError: If ``comm`` is not a communicator or ``rank`` not an integer.

    Example:
        A disk of gmsh's own geometry, also with the gmsh 4.8 of Debian 12, where
        ``addPhysicalGroup`` takes no name::

            if comm.rank == 0:
                gmsh.initialize()
                gmsh.model.occ.addDisk(0, 0, 0, 1, 1)
                gmsh.model.occ.synchronize()
                for dim, name in ((2, "disk"), (1, "disk/outline")):
                    gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [1]), name)
                gmsh.model.mesh.generate(2)
            data = read_gmsh(gmsh.model, comm)
    """
    return from_arrays.from_rank("read_gmsh", comm, rank, lambda: _checked(_mesh_of(source)))


def _mesh_of(source: str | Path | Any) -> GmshMesh:
    """The mesh of ``source``, a model of gmsh or a path (local)."""
    if hasattr(source, "getPhysicalGroups"):
        try:
            return GmshMesh.of(source)
        except Exception as exception:  # gmsh raises Exception itself
            raise MeshError(f"cannot read the model of gmsh: {exception}") from None
    if not isinstance(source, (str, Path)):
        raise MeshError(f"source is {source!r}; expected the path of a .msh file or gmsh.model")
    if not Path(source).is_file():
        raise MeshError(f"no file '{source}' (current folder {Path.cwd()})")
    return read_msh(Path(source))


def _checked(mesh: GmshMesh) -> from_arrays.CheckedArrays:
    """The mesh as arrays with the names of its bodies and boundaries (local)."""
    _check_cells(mesh)
    _check_nodes(mesh)
    for dim in (mesh.dim, mesh.dim - 1):
        _check_groups(mesh, dim)
    mesh.renumber_nodes()
    return mesh.given(_physical_names(mesh, mesh.dim), _physical_names(mesh, mesh.dim - 1))


def _check_cells(mesh: GmshMesh) -> None:
    """Raise unless the elements are of one type that dolfinx reads (local)."""
    dim = mesh.dim
    elements = mesh.elements(dim)
    if not (mesh.groups or mesh.blocks):
        raise MeshError("there is no geometry; was gmsh.initialize() called before it was made?")
    if not elements:
        raise MeshError("there are no elements of dimension 2; was model.mesh.generate(2) called?")
    names = sorted(TYPES[kind][1] if kind in TYPES else f"number {kind}" for kind in elements)
    if len(elements) > 1:
        shapes = "triangles or quadrilaterals" if dim == 2 else "tetrahedra or hexahedra"
        raise MeshError(f"the mesh mixes {names}; expected one type, {shapes}")
    (kind,) = elements
    if kind in CUBIC:
        refuse_in_space("cubic", names[0])
    if kind not in CELLS[dim]:
        raise MeshError(f"cells of type {names} are not supported; expected e.g. {EXPECTED[dim]}")


def _check_nodes(mesh: GmshMesh) -> None:
    """Raise for nodes with coordinates that are not finite or not plane (local)."""
    bad = mesh.tags[~np.isfinite(mesh.x).all(axis=1)]
    if bad.size:
        raise MeshError(f"coordinates of {bad.size} nodes are not finite, e.g. of node {bad[0]}")
    if mesh.dim == 3:
        return
    used = np.isin(mesh.tags, np.concatenate([n.ravel() for n in mesh.elements(2).values()]))
    extent = np.ptp(mesh.x[used], axis=0)
    if extent[2] > ROUNDING * max(extent[:2]):
        solid = "; was model.mesh.generate(3) called?" if mesh.entities(3) else ""
        raise MeshError(f"z varies by {extent[2]:.3g}; expected a mesh of the x-y plane{solid}")


def _check_groups(mesh: GmshMesh, dim: int) -> None:
    """Check that bodies are in exactly one physical group, boundaries in at most one (local)."""
    what = ("point", "curve", "surface", "volume")[dim]
    for entity in mesh.entities(dim):
        tags = sorted(mesh.groups.get((dim, entity), []))
        names = [mesh.names.get((dim, tag)) or tag for tag in tags]
        if len(tags) > 1:
            raise MeshError(f"{what} {entity} is in the physical groups {names}; expected one")
        empty = not mesh.blocks.get((dim, entity))
        if tags and empty:
            raise MeshError(f"{what} {entity} of physical group {names} has no elements")
        if dim == mesh.dim and not tags and not empty:
            raise MeshError(f"{what} {entity} is in no physical group; every cell needs a body")


def _physical_names(mesh: GmshMesh, dim: int) -> dict[str, int]:
    """Tags of the named physical groups of a dimension (local)."""
    names: dict[str, int] = {}
    for tag in mesh.groups_of(dim):
        name = mesh.names.get((dim, tag), "")
        if name in names:
            raise MeshError(
                f"the physical groups {names[name]} and {tag} have the same name {name!r}"
            )
        if name:
            names[name] = tag
    return names
