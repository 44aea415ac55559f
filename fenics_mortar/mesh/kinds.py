# SPDX-License-Identifier: MIT
"""Kinds of cells that meshes from arrays may have: their corners, edges and facets.

Nodes are numbered as in VTK and meshio: corners, middles of edges, centres of faces, centre of the
cell. Faces of hexahedra have centres with 27 nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

import basix

from fenics_mortar.utils.arrays import Indices

# Shifts and factors of the hash function splitmix64; its first factor is the last one here.
SHIFTS, FACTORS = (30, 27, 31), (0xBF58476D1CE4E5B9, 0x94D049BB133111EB, 0x9E3779B97F4A7C15)
# Nodes of triangles, quadrilaterals, tetrahedra and hexahedra of order 1 and of order 2.
NUMBERS = (3, 4, 4, 8), (6, 9, 10, 27)


@dataclass(frozen=True)
class Kind:
    """A kind of cells.

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
        found = [
            frozenset(self.vertices[v] for v in around) for same in topology for around in same
        ]
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
    """One number for each facet (f, corners), whatever the order of its corners, shape (f,).

    Those of edges are exact. For faces it is the sum of 64 bits that a hash function gives each
    node: two of ten million faces have the same number with a probability of 3e-6.
    """
    if facets.shape[1] == 2:
        return np.asarray(facets.min(axis=1) * num_points + facets.max(axis=1))
    bits = (facets.astype(np.uint64) + np.uint64(1)) * np.uint64(FACTORS[2])
    for shift, factor in zip(SHIFTS, (*FACTORS[:2], 1), strict=True):
        bits = (bits ^ (bits >> np.uint64(shift))) * np.uint64(factor)
    return bits.sum(axis=1, dtype=np.uint64).view(np.int64)
