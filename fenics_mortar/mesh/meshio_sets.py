# SPDX-License-Identifier: MIT
"""Sets of cells or lines in a mesh of meshio, by name: its cell sets, else its integer tags."""

from __future__ import annotations

from itertools import count
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fenics_mortar.utils.arrays import Indices
from fenics_mortar.utils.errors import MeshError

# Arrays of tags that programs write, in the order of preference: gmsh, Medit, MED (Salome).
PREFERRED = ("gmsh:physical", "medit:ref", "cell_tags")
# Arrays of gmsh about the geometry, which are no tags of bodies or boundaries.
GEOMETRY = ("gmsh:geometrical", "gmsh:bounding_entities")
# Arrays in which 0 is no tag; in others cells may have it, as in "MaterialIDs" of VTK.
ZERO_IS_NONE = ("gmsh:physical", "cell_tags")


class NamedSet(NamedTuple):
    """Numbers of cells, shape (n,), and their tag in the file, ``None`` if it has none."""

    members: Indices
    tag: int | None


class Part:
    """All cells of one dimension, those of several blocks one after the other.

    Args:
        mesh: The mesh of meshio.
        dim: The dimension.
        blocks: Numbers of the blocks.
    """

    def __init__(self, mesh: Any, dim: int, blocks: list[int]) -> None:
        self._mesh, self._dim = mesh, dim
        sizes = [len(mesh.cells[i].data) for i in blocks]
        self._first = dict(zip(blocks, np.cumsum([0, *sizes])[:-1], strict=True))
        self._size = sum(sizes)

    def nodes(self, columns: int) -> Indices:
        """Nodes of all cells, the first ``columns`` of each, shape (n, columns)."""
        none = np.empty((0, columns), np.int64)
        return np.concatenate([none, *(self._mesh.cells[i].data[:, :columns] for i in self._first)])

    def sets(self, key: str | None) -> dict[str, NamedSet]:
        """Sets of ``cell_sets`` by name, and cells without one by the names of their tags.

        Args:
            key: Name of the array of tags in ``cell_data``, or ``None``.
        """
        found = dict[str, NamedSet]()
        for name, parts in self._mesh.cell_sets.items():
            members = self._members(parts)
            if members.size and name not in GEOMETRY:
                found[name] = NamedSet(members, self._groups().get(name))
        if key is None or not self._size:
            return found
        tags = self._tags(key)
        others = np.ones(self._size, bool)
        for known in found.values():
            others[known.members] = False
        if self._dim == 1 or key in ZERO_IS_NONE:
            others &= tags != 0
        for tag in np.unique(tags[others]):
            for name in self._names(int(tag)):
                members = np.flatnonzero(others & (tags == tag))
                if name in found:
                    members = np.union1d(members, found[name].members)
                found[name] = NamedSet(members, int(tag))
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


def key_of_tags(mesh: Any, given: str | None) -> str | None:
    """Name of the array of tags in ``cell_data``, or ``None`` without one (local).

    Raises:
        MeshError: If the given one is not there, or there are several and no sets.
    """
    data = mesh.cell_data
    if given is not None:
        if given not in data:
            raise MeshError(f"tags={given!r}: cell_data has {sorted(data)}")
        return given
    found = [name for name, parts in data.items() if name not in GEOMETRY and _are_whole(parts)]
    for name in PREFERRED:
        if name in found:
            return name
    if len(found) > 1 and not mesh.cell_sets:
        raise MeshError(f"cell_data has several arrays of integers, {found}; choose by tags=")
    return found[0] if len(found) == 1 else None


def _are_whole(parts: Any) -> bool:
    """Whether arrays of cell data are integers (local)."""
    return all(np.asarray(part).dtype.kind in "iu" for part in parts)


def free_numbers(tags: list[int | None]) -> npt.NDArray[np.int32]:
    """Positive tags of 32 bits that are all different: those given, else free numbers."""
    largest = np.iinfo(np.int32).max
    kept = [
        tag if tag is not None and 0 < tag <= largest and tag not in tags[:i] else None
        for i, tag in enumerate(tags)
    ]
    free = (number for number in count(1) if number not in kept)
    return np.array([next(free) if tag is None else tag for tag in kept], np.int32)
