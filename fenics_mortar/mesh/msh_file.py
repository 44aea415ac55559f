# SPDX-License-Identifier: MIT
"""Reader of .msh files of format 4.1 without gmsh, whose import takes longer than a small solve.

The sections of physical names, entities, nodes and elements are read, as text or binary. The mesh
has the methods of ``gmsh.model`` that ``gmsh_reader`` calls to check a model.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fenics_mortar.mesh.edges import check_hanging_nodes
from fenics_mortar.mesh.from_arrays import CheckedArrays, Tagged
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MeshError

# Name and number of nodes of gmsh's element types in the plane, up to order 2.
TYPES = {
    15: ("Point", 1), 1: ("Line 2", 2), 8: ("Line 3", 3),
    2: ("Triangle 3", 3), 9: ("Triangle 6", 6),
    3: ("Quadrilateral 4", 4), 16: ("Quadrilateral 8", 8), 10: ("Quadrilateral 9", 9),
}  # fmt: skip
# Types in binary files: size_t, int and double.
SIZE, INT, DOUBLE = "<u8", "<i4", "<f8"


class _Block(NamedTuple):
    """Elements of one type of an entity: numbers (n,) and nodes (n, k)."""

    type: int
    numbers: Indices
    nodes: Indices


class MshFile:
    """A mesh, with the methods of ``gmsh.model`` and ``gmsh.model.mesh`` that are needed here.

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
        self.blocks: dict[tuple[int, int], list[_Block]] = {}
        self.tags: Indices = np.empty(0, np.int64)
        self.x: Array = np.empty((0, 3))

    @property
    def mesh(self) -> MshFile:
        """The object itself."""
        return self

    def getEntities(self, dim: int) -> list[tuple[int, int]]:
        """Dimension and tag of all entities of a dimension."""
        return sorted(key for key in {*self.groups, *self.blocks} if key[0] == dim)

    def getPhysicalGroups(self, dim: int) -> list[tuple[int, int]]:
        """Dimension and tag of all groups of a dimension."""
        found = [tags for (d, _), tags in self.groups.items() if d == dim]
        return sorted({(dim, tag) for tags in found for tag in tags})

    def getEntitiesForPhysicalGroup(self, dim: int, group: int) -> list[int]:
        """Tags of the entities of a group."""
        return [tag for d, tag in self.getEntities(dim) if group in self.groups.get((d, tag), [])]

    def getPhysicalName(self, dim: int, tag: int) -> str:
        """Name of a group, or an empty string."""
        return self.names.get((dim, tag), "")

    def getElements(
        self, dim: int, tag: int | None = None
    ) -> tuple[list[int], list[Indices], list[Indices]]:
        """Types; per type numbers (cells,) and nodes (cells times nodes per cell,), as in gmsh."""
        keys = self.getEntities(dim) if tag is None else [(dim, tag)]
        blocks = [block for key in keys for block in self.blocks.get(key, [])]
        types = sorted({block.type for block in blocks})
        numbers, nodes = (
            [np.concatenate([np.ravel(b[i]) for b in blocks if b.type == kind]) for kind in types]
            for i in (1, 2)
        )
        return types, numbers, nodes

    def getElementProperties(self, kind: int) -> tuple[str]:
        """Name of an element type."""
        return (TYPES[kind][0],)

    def getElementType(self, family: str, order: int) -> int:
        """The type of triangles or quadrilaterals of an order 1, 2 or 3."""
        return {"Triangle": (2, 9, 21), "Quadrangle": (3, 10, 36)}[family][order - 1]

    def tagged_elements(self, dim: int) -> tuple[Indices, npt.NDArray[np.int32]]:
        """Nodes of all groups' elements, numbered from 0, (n, k), and tags of the groups (n,)."""
        nodes, tags = [], []
        for _, group in self.getPhysicalGroups(dim):
            for entity in self.getEntitiesForPhysicalGroup(dim, group):
                for block in self.blocks.get((dim, entity), []):
                    nodes.append(block.nodes - 1)
                    tags.append(np.full(len(block.nodes), group, np.int32))
        if not nodes:
            return np.empty((0, 2), np.int64), np.empty(0, np.int32)
        return np.concatenate(nodes), np.concatenate(tags)

    def given(self, bodies: dict[str, int], boundaries: dict[str, int]) -> CheckedArrays:
        """The mesh as arrays with names of its groups; needs nodes numbered from 1 without gaps.

        Raises:
            MeshError: If a node lies inside an edge of another cell.
        """
        cells, body_of_cell = self.tagged_elements(2)
        facets, tags = self.tagged_elements(1)
        ends = np.sort(facets[:, :2], axis=1)
        tagged = Tagged(cells.shape[1], bodies, boundaries, body_of_cell, ends, tags)
        x = self.x[np.argsort(self.tags), :2]
        check_hanging_nodes(x, cells, ends, tags)
        return CheckedArrays(x, cells, tagged)

    def getNodes(self) -> tuple[Indices, Array, None]:
        """Numbers (n,) and positions (3 n,) [length] of all nodes, as gmsh returns them."""
        return self.tags, self.x, None

    def getNode(self, tag: int) -> tuple[Array]:
        """Position of a node, shape (3,) [length]."""
        return (self.x[self.tags == tag][0],)

    def renumberNodes(self) -> None:
        """Renumber the nodes from 1 without gaps, in the order of their numbers."""
        known = np.sort(self.tags)
        for blocks in self.blocks.values():
            blocks[:] = [b._replace(nodes=np.searchsorted(known, b.nodes) + 1) for b in blocks]
        self.tags = np.searchsorted(known, self.tags) + 1


def read_msh(path: Path) -> MshFile | None:
    """Read a file; ``None`` if it is of another format, or has volumes or elements of order 3.

    Raises:
        MeshError: If the file is damaged.
    """
    content = path.read_bytes()
    head = content[:64].split()
    if head[:2] != [b"$MeshFormat", b"4.1"] or head[2:4] not in ([b"0", b"8"], [b"1", b"8"]):
        return None
    binary = head[2] == b"1"
    one = content.find(b"\n", content.find(b"\n") + 1) + 1
    if binary and content[one : one + 4] != np.array(1, INT).tobytes():
        return None  # written on a machine with another byte order
    file = MshFile()
    readers = {b"Entities": _read_entities, b"Nodes": _read_nodes, b"Elements": _read_elements}
    try:
        for name, section in _sections(content):
            if name == b"PhysicalNames":
                _read_names(file, section.decode())
            elif name in readers:
                numbers = _Numbers(section, binary=binary)
                readers[name](file, numbers)
                numbers.end()
    except (ValueError, IndexError) as error:
        raise MeshError(f"cannot read '{path}': {error}") from None
    except KeyError:  # unknown element type
        return None
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

    def end(self) -> None:
        """Check that all numbers have been read."""
        size = len(self._section) if self._binary else self._text.size
        if self._at != size:
            raise ValueError("a section has too many numbers")


def _read_names(file: MshFile, section: str) -> None:
    for line in section.splitlines()[1:]:
        dim, tag, name = line.split(maxsplit=2)
        file.names[int(dim), int(tag)] = name.strip().strip('"')


def _read_entities(file: MshFile, numbers: _Numbers) -> None:
    counts = numbers.read(SIZE, 4)
    for dim, count in enumerate(counts):
        for _ in range(count):
            tag = int(numbers.read(INT)[0])
            numbers.read(DOUBLE, 6 if dim else 3)  # bounding box, or a point
            groups = numbers.read(INT, int(numbers.read(SIZE)[0]))
            file.groups[dim, tag] = np.abs(groups).tolist()  # signs are directions
            if dim:
                numbers.read(INT, int(numbers.read(SIZE)[0]))  # its boundary


def _read_nodes(file: MshFile, numbers: _Numbers) -> None:
    num_blocks, *_ = numbers.read(SIZE, 4)
    tags, x = [file.tags], [file.x]
    for _ in range(num_blocks):
        dim, _, parametric = numbers.read(INT, 3)
        count = int(numbers.read(SIZE)[0])
        tags.append(numbers.read(SIZE, count))
        columns = 3 + dim * parametric
        x.append(numbers.read(DOUBLE, count * columns).reshape(count, columns)[:, :3])
    file.tags, file.x = np.concatenate(tags), np.concatenate(x)


def _read_elements(file: MshFile, numbers: _Numbers) -> None:
    num_blocks, *_ = numbers.read(SIZE, 4)
    for _ in range(num_blocks):
        dim, tag, kind = numbers.read(INT, 3).tolist()
        count = int(numbers.read(SIZE)[0])
        columns = 1 + TYPES[kind][1]
        rows = numbers.read(SIZE, count * columns).reshape(count, columns)
        file.blocks.setdefault((dim, tag), []).append(_Block(kind, rows[:, 0], rows[:, 1:]))
