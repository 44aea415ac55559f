# SPDX-License-Identifier: MIT
"""Meshes of gmsh: those of its live models, and of .msh files of format 4.1.

The sections of physical names, entities, nodes and elements are read, as text or binary, without
gmsh, whose import takes longer than a small solve.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fenics_mortar.mesh.from_arrays import CheckedArrays, Tagged, check_joined
from fenics_mortar.mesh.kinds import KINDS
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MeshError

# Name and number of nodes of gmsh's element types up to order 2.
TYPES = {
    15: ("Point", 1), 1: ("Line 2", 2), 8: ("Line 3", 3),
    2: ("Triangle 3", 3), 9: ("Triangle 6", 6),
    3: ("Quadrilateral 4", 4), 16: ("Quadrilateral 8", 8), 10: ("Quadrilateral 9", 9),
    4: ("Tetrahedron 4", 4), 11: ("Tetrahedron 10", 10),
    5: ("Hexahedron 8", 8), 17: ("Hexahedron 20", 20), 12: ("Hexahedron 27", 27),
    6: ("Prism 6", 6), 7: ("Pyramid 5", 5),
}  # fmt: skip
# Nodes of gmsh's solids of order 2 in the order of ``kinds``, by their number.
TETRAHEDRON = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
HEXAHEDRON = [*range(8), 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15, 22, 23, 21, 24, 20, 25, 26]
ORDERS = {10: TETRAHEDRON, 27: HEXAHEDRON}
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
        types: Names of the element types by number.
        tags: Numbers of the nodes, shape (n,).
        x: Their positions, shape (n, 3) [length].
    """

    def __init__(self) -> None:
        self.names: dict[tuple[int, int], str] = {}
        self.groups: dict[tuple[int, int], list[int]] = {}
        self.blocks: dict[tuple[int, int], list[Block]] = {}
        self.types = {kind: name for kind, (name, _) in TYPES.items()}
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
                mesh.types[int(kind)] = model.mesh.getElementProperties(int(kind))[0]
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

    def tagged_elements(self, dim: int) -> tuple[Indices, npt.NDArray[np.int32]]:
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

    def given(self, bodies: dict[str, int], boundaries: dict[str, int]) -> CheckedArrays:
        """The mesh as arrays with names of its groups, after ``renumber_nodes``.

        Raises:
            MeshError: If a node lies inside an edge of another cell.
        """
        dim = self.dim
        cells, body_of_cell = self.tagged_elements(dim)
        if dim == 3 and cells.shape[1] in ORDERS:
            cells = cells[:, ORDERS[cells.shape[1]]]
        corners = len(KINDS[dim, cells.shape[1]].facets[0])
        facets, tags = self.tagged_elements(dim - 1)
        ends = np.sort(facets[:, :corners], axis=1) if tags.size else np.empty((0, corners), int)
        tagged = Tagged(dim, cells.shape[1], bodies, boundaries, body_of_cell, ends, tags)
        x = self.x[np.argsort(self.tags), :dim]
        check_joined(x, cells, ends, tags)
        return CheckedArrays(x, cells, tagged)

    def renumber_nodes(self) -> None:
        """Renumber the nodes from 1 without gaps, in the order of their numbers."""
        known = np.sort(self.tags)
        for blocks in self.blocks.values():
            blocks[:] = [b._replace(nodes=np.searchsorted(known, b.nodes) + 1) for b in blocks]
        self.tags = np.searchsorted(known, self.tags) + 1


def read_msh(path: Path) -> GmshMesh | None:
    """Read a file; ``None`` if it is of another format, or has elements of order 3.

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
    file = GmshMesh()
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


def _read_names(file: GmshMesh, section: str) -> None:
    for line in section.splitlines()[1:]:
        dim, tag, name = line.split(maxsplit=2)
        file.names[int(dim), int(tag)] = name.strip().strip('"')


def _read_entities(file: GmshMesh, numbers: _Numbers) -> None:
    counts = numbers.read(SIZE, 4)
    for dim, count in enumerate(counts):
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
        columns = 1 + TYPES[kind][1]
        rows = numbers.read(SIZE, count * columns).reshape(count, columns)
        file.blocks.setdefault((dim, tag), []).append(Block(kind, rows[:, 1:]))
