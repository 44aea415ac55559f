# SPDX-License-Identifier: MIT
"""Contact surfaces in space: triangles and quadrilaterals.

The nodes of a facet are its corners, counter-clockwise seen from outside of the body, then those on
its edges, and one at the centre. Nodes are numbered in the order of the mesh input, facets by their
nodes. ``extract_faces`` makes a surface, ``space_mortar`` finds the facets that face each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fenics_mortar.interface import surfaces
from fenics_mortar.interface.reference import CORNERS, covers
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.kernels.space.normals import find_rings, padded
from fenics_mortar.mesh.space import DisplacementSpace, input_nodes
from fenics_mortar.utils.errors import SurfaceError, format_point

if TYPE_CHECKING:
    from fenics_mortar.utils.arrays import Array, Flags, Indices, Numbers

# Area of a facet over the square of its longest edge [1] below which it has no normal.
MIN_AREA = 1e-12


@dataclass(frozen=True, kw_only=True)
class Faces(Surface):
    """Facets of some boundary tags in space, seen from outside; see ``Surface``.

    Attributes:
        is_open: Whether a node is on the rim of the surface, shape (n,), bool.
    """

    is_open: Flags

    @cached_property
    def stencil(self) -> Indices:
        """Nodes on which the normal of each node depends, -1 for none, shape (n, s)."""
        return find_rings(self.facets, self.num_nodes)

    @cached_property
    def neighbours(self) -> Indices:
        """Other nodes of the facets at each node, ascending, -1 for none, shape (n, s)."""
        facets, size = self.facets, self.facets.shape[1]
        i, j = np.repeat(facets, size, axis=1).ravel(), np.tile(facets, size).ravel()
        pairs = np.unique(np.stack([i, j])[:, i != j], axis=1)
        return padded(pairs[0], pairs[1], self.num_nodes)

    @property
    def nodal_areas(self) -> Array:
        """See ``Surface``: ``full_cover``, which is positive, scaled to the area of each facet.

        Those of a facet with nine nodes are 1, 4 and 16 of 36 parts of its area, with six nodes
        equal parts.
        """
        parts, areas = covers(self.measures), self.measures.sum(axis=1)
        return self.on_nodes(parts * (areas / parts.sum(axis=1))[:, None])

    @cached_property
    def nodal_lengths(self) -> Array:
        """Root of the share of each node in the area of its facets, shape (n,) [length]."""
        equal = np.full(self.facets.shape[1], 1.0 / self.facets.shape[1])
        return np.sqrt(self.on_nodes(self.measures.sum(axis=1)[:, None] * equal))

    @property
    def mean_thickness(self) -> Array:
        """Areas over lengths of the nodes, lengths again, shape (n,) [length]."""
        return self.nodal_lengths

    @cached_property
    def distortion(self) -> tuple[float, float]:
        """Largest distance of the middles of a facet's diagonals over the root of its area [1].

        Also the largest one across the facet. Zero for parallelograms and triangles.
        """
        if CORNERS[self.facets.shape[1]] == 3 or not len(self.facets):
            return 0.0, 0.0
        x = self.X[self.facets[:, :4]]
        between = 0.5 * (x[:, 0] - x[:, 1] + x[:, 2] - x[:, 3]) / self.facet_sizes[:, None]
        n = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        across = np.abs(np.einsum("fi,fi->f", between, n))
        return float(np.linalg.norm(between, axis=1).max()), float(across.max())

    def welded(self, welds: Indices) -> Faces:
        """The surface itself: nodes of ties are not joined in space (local)."""
        return self


def extract_faces(space: DisplacementSpace, of_mesh: Numbers, name: str) -> Faces:
    """Extract facets (collective).

    Args:
        space: Nodes and dofs of the displacement, degree 1 or 2.
        of_mesh: Local facets that this rank owns, shape (m,).
        name: Name used in messages.

    Raises:
        SurfaceError: On all ranks, if there are no facets, if one has no area, or if more than two
            meet at an edge.
    """
    V = space.V
    mine = surfaces.outward_nodes(V, of_mesh)
    nodes, X, names, facets = surfaces.facets_of_all_ranks(V, mine, input_nodes(V))
    if not facets.size:
        raise SurfaceError(f"surface '{name}' has no facets")
    order = np.lexsort(names.T[::-1])
    place = np.empty(order.size, np.int64)
    place[order] = np.arange(order.size)
    nodes, X, facets = nodes[order], X[order], _ordered(place[facets])
    is_open = _rim(facets, X, name)
    _check_areas(X[facets], name)
    of_nodes = surfaces.place_of_nodes(space, nodes)
    return Faces(name=name, X=X, facets=facets, is_open=is_open, **of_nodes)


def _ordered(facets: Indices) -> Indices:
    """Facets (m, K) that begin with their smallest corner, sorted."""
    count = CORNERS[facets.shape[1]]
    start = facets[:, :count].argmin(axis=1)
    turn = (start[:, None] + np.arange(count)) % count
    parts = [facets[:, :count], facets[:, count : 2 * count], facets[:, 2 * count :]]
    parts[:2] = [np.take_along_axis(p, turn, axis=1) if p.shape[1] else p for p in parts[:2]]
    turned = np.concatenate(parts, axis=1)
    return np.ascontiguousarray(turned[np.lexsort(turned.T[::-1])])


def _rim(facets: Indices, X: Array, name: str) -> Flags:
    """Whether nodes are on the rim of the surface, shape (n,), bool.

    Raises:
        SurfaceError: If more than two facets meet at an edge, or two in opposite senses.
    """
    count = CORNERS[facets.shape[1]]
    corners = facets[:, :count]
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, number, times = np.unique(
        np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    _, of_sense = np.unique(ends, axis=0, return_counts=True)
    if (times > 2).any() or (of_sense > 1).any():
        wrong = edges[times > 2] if (times > 2).any() else edges[times == 2]
        raise SurfaceError(
            f"surface '{name}': more than two facets meet at the edge at "
            f"{format_point(X[wrong[0]].mean(axis=0))}; expected the outer surface of a body"
        )
    is_open = np.zeros(len(X), bool)
    open_edges = np.flatnonzero(times[number.ravel()] == 1)
    is_open[ends[open_edges]] = True
    if facets.shape[1] > 4:
        middles = facets[:, count : 2 * count].ravel()
        is_open[middles[open_edges]] = True
    return is_open


def _check_areas(x: Array, name: str) -> None:
    """Raise an error for facets at ``x`` (m, K, 3) without area.

    Raises:
        SurfaceError: If there is one.
    """
    areas = surfaces.shape_products(x).sum(axis=(1, 2))
    sizes = np.ptp(x, axis=1).max(axis=1)
    flat = np.flatnonzero(~(areas > MIN_AREA * sizes**2))
    if flat.size:
        raise SurfaceError(
            f"surface '{name}': the facet at {format_point(x[flat[0]].mean(axis=0))} has no area"
        )


@dataclass(frozen=True)
class FacetPairs:
    """Slave facets and the master facets that they face.

    Attributes:
        facets: Slave facets that were searched, shape (f,).
        offsets: Pairs of facet i are offsets[i]:offsets[i + 1], shape (f + 1,).
        slave: Slave nodes of each pair, shape (p, K).
        master: Master nodes of each pair, shape (p, K').
        numbers: Their facets, shape (p,).
        owner: Position in ``facets`` of the slave facet of each pair, shape (p,).
        merged: Master nodes of all pairs of a facet, -1 for none, shape (f, L).
        places: Positions in ``merged`` of the master nodes of each pair, shape (p, K').
    """

    facets: Indices
    offsets: Indices
    slave: Indices
    master: Indices
    numbers: Indices
    owner: Indices
    merged: Indices
    places: Indices

    @property
    def num_segments(self) -> int:
        """Number of pairs."""
        return len(self.slave)

    def of_facets(self, used: Flags) -> FacetPairs:
        """The facets ``used`` (f,) with their pairs."""
        pairs = used[self.owner]
        merged = self.merged[used]
        width = int((merged >= 0).sum(axis=1).max(initial=0))
        return FacetPairs(
            facets=self.facets[used], offsets=np.append(0, np.diff(self.offsets)[used].cumsum()),
            slave=self.slave[pairs], master=self.master[pairs], numbers=self.numbers[pairs],
            owner=(used.cumsum() - 1)[self.owner[pairs]], merged=merged[:, :width],
            places=self.places[pairs],
        )  # fmt: skip
