# SPDX-License-Identifier: MIT
"""Hanging nodes: inside an edge of another cell, along which the body is not joined.

``check_hanging_nodes`` and ``check_hanging_nodes_in_space`` find them among the edges of the
outline, and tell them from slits and cracks.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from fenics_mortar.mesh.space import KINDS, Kind, codes_of, facets_of
from fenics_mortar.utils.arrays import MAX_STEPS, ROUNDING, SAME_PLACE, cross_in_plane, values_at
from fenics_mortar.utils.errors import MeshError, format_point

if TYPE_CHECKING:
    from fenics_mortar.utils.arrays import Array, Flags, Indices, Numbers


def check_hanging_nodes(x: Array, cells: Indices, facets: Indices, tags: Numbers) -> None:
    """Reject nodes inside an edge of another cell (local).

    An edge of one cell only belongs to the outline of a body. Near a hanging node the outline runs
    from a node along one side of a line and back along the other one. The same is true of a slit;
    but the nodes of its sides coincide in pairs, or its sides are named boundaries: of different
    names if the two ends of the slit are nodes of both sides, as the edges at a hanging node may
    also be parts of one name. Surfaces that touch without a common node are not considered.

    Args:
        x: Positions of the nodes, shape (n, 2) [length].
        cells: Nodes of the cells, corners first and then the middles of the edges, shape (m, k).
        facets: Ends of the facets of all boundaries, ascending, shape (f, 2).
        tags: Tags of these boundaries, shape (f,).

    Raises:
        MeshError: The message has the first node, its position, and the edge.
    """
    outline = _Outline(x, cells, facets, tags)
    found = dict[int, int]()
    for one, other in outline.seams():
        found |= outline.hanging(one, other)
    if found:
        node = min(found)
        half = found[node]
        a, b = sorted((outline.start[half], outline.end[half]))
        raise MeshError(
            f"{len(found)} hanging nodes: node {node} at {format_point(x[node])} lies inside the "
            f"edge from node {a} to node {b} of cell {outline.cell[half]}, so that the body is not "
            "joined there: divide this cell at the node, too. For a slit, make its two sides "
            "boundaries of different names"
        )


class _Outline:
    """Edges of one cell only, in both directions ("half edges", h) (local).

    Attributes:
        start, end: Their nodes, (h,).
        cell: Their cells, (h,).
    """

    def __init__(self, x: Array, cells: Indices, facets: Indices, tags: Numbers) -> None:
        kind = KINDS[2, cells.shape[1]]
        corners = kind.corners
        around, ends = cells[:, :corners], facets_of(cells, kind).reshape(-1, 2)
        codes = codes_of(ends, len(x))
        codes, first, count = np.unique(codes, return_index=True, return_counts=True)
        codes, once = codes[count == 1], first[count == 1]
        cell, ends = once // corners, ends[once]
        second_order = cells.shape[1] >= 2 * corners
        middle = x[ends].mean(axis=1)
        if second_order:
            middle = x[cells[cell, corners + once % corners]]
        inward = x[around[cell]].mean(axis=1) - x[ends[:, 0]]
        side = np.sign(cross_in_plane(x[ends[:, 1]] - x[ends[:, 0]], inward))
        tag = values_at(codes, codes_of(facets, len(x)), tags, 0)
        self._x = x
        start, end = np.concatenate([ends, ends[:, ::-1]]).T
        middle = np.concatenate([middle, middle])
        tangents = 4.0 * middle - 3.0 * x[start] - x[end]
        order = np.lexsort((np.arctan2(tangents[:, 1], tangents[:, 0]), start))
        self.start, self.end = start[order], end[order]
        self.cell = np.concatenate([cell, cell])[order]
        self._side, self._tag = np.concatenate([side, -side])[order], np.tile(tag, 2)[order]
        self._middle, self._tangents = middle[order], tangents[order]

    def seams(self) -> Iterator[tuple[int, int]]:
        """Half edges with a common start of which one lies on the other, on different sides."""
        count = len(self.start)
        if not count:
            return
        first = np.searchsorted(self.start, self.start, side="left")
        after = np.searchsorted(self.start, self.start, side="right")
        one = np.arange(count)
        other = np.where(one + 1 < after, one + 1, first)  # in the order of angles, around the node
        chosen = (one != other) & (self._side[one] * self._side[other] < 0.0)
        one, other = one[chosen], other[chosen]
        same = (self._tangents[one] * self._tangents[other]).sum(axis=1) > 0.0
        one, other = one[same], other[same]
        meets = self._lie_on(one, self.end[other]) | self._lie_on(other, self.end[one])
        yield from zip(one[meets].tolist(), other[meets].tolist(), strict=True)

    def hanging(self, one: int, other: int) -> dict[int, int]:
        """Hanging nodes from a seam's start to where its sides meet or separate, with half edges.

        Empty if all nodes coincide in pairs, or if the sides are those of a slit by their names.
        """
        found, sides, meet = dict[int, int](), (set[int](), set[int]()), False
        for _ in range(len(self.start)):
            b, c = int(self.end[one]), int(self.end[other])
            meet = b == c
            on_one, on_other = self._lies_on(one, c), self._lies_on(other, b)
            if not (on_one or on_other):
                break
            for tags, half in zip(sides, (one, other), strict=True):
                tags.add(int(self._tag[half]))
            if on_one and not on_other:
                found[c] = one
            if on_other and not on_one:
                found[b] = other
            after = self._after(one) if on_other else one, self._after(other) if on_one else other
            if meet or -1 in after:
                break
            one, other = after
        named = 0 not in sides[0] | sides[1] and not (meet and sides[0] & sides[1])
        return {} if named else found

    def _after(self, half: int) -> int:
        """The half edge with the cell on the same side that continues another one, or -1."""
        node = self.end[half]
        some = np.arange(*np.searchsorted(self.start, [node, node + 1]))
        some = some[(self._side[some] == self._side[half]) & (self.end[some] != self.start[half])]
        if not some.size:
            return -1
        backwards = 4.0 * self._middle[half] - 3.0 * self._x[node] - self._x[self.start[half]]
        along = self._tangents[some] / np.linalg.norm(self._tangents[some], axis=1)[:, None]
        return int(some[np.argmin(along @ backwards)])

    def _lies_on(self, half: int, node: int) -> bool:
        return bool(self._lie_on(np.array([half]), np.array([node]))[0])

    def _lie_on(self, halves: Indices, nodes: Indices) -> Flags:
        """Whether nodes lie on half edges, which are parabolas in second order, both (k,)."""
        a, b, x = self._x[self.start[halves]], self._x[self.end[halves]], self._x[nodes]
        chord, bend = b - a, 2.0 * (a + b) - 4.0 * self._middle[halves]
        square = np.maximum((chord**2).sum(axis=1), np.finfo(float).tiny)
        along, curve = ((v * chord).sum(axis=1) / square for v in (x - a, bend))
        t = along.copy()  # of a + t chord + t (t - 1) bend
        for _ in range(MAX_STEPS if curve.any() else 0):
            slope = 1.0 + (2.0 * t - 1.0) * curve
            step = (t + t * (t - 1.0) * curve - along) / np.where(slope > 0.0, slope, 1.0)
            t = np.clip(t - step, -1.0, 2.0)  # not farther beyond the ends
            if np.abs(step).max(initial=0.0) < ROUNDING:
                break
        rest = a + t[:, None] * chord + (t * (t - 1.0))[:, None] * bend - x
        near = (rest**2).sum(axis=1) <= SAME_PLACE**2 * square
        inside = (t >= -SAME_PLACE) & (t <= 1.0 + SAME_PLACE)
        return np.asarray(near & inside)


def check_hanging_nodes_in_space(x: Array, cells: Indices, facets: Indices, tags: Numbers) -> None:
    """Reject nodes inside an edge of another cell (local).

    At a hanging node in space the edge of a cell ends inside a longer edge with the same start,
    which belongs to another cell. The same is true of the two sides of a crack with different
    meshes; but these are boundaries of different names. Nodes inside faces come with nodes inside
    the edges of these.

    Args:
        x: Positions of the nodes, shape (n, 3) [length].
        cells: Nodes of the cells, shape (m, k).
        facets: Corners of the facets of all boundaries, shape (f, corners).
        tags: Tags of these boundaries, shape (f,).

    Raises:
        MeshError: The message has the first node, its position, and the edge.
    """
    kind = KINDS[3, cells.shape[1]]
    outline = _outline(cells, kind, len(x))
    ends, middle, cell = _edges_on(outline, x, cells, kind)
    long, short = _seams(x, ends, middle)
    if not long.size:
        return
    edges = np.sort(ends, axis=1)
    slit = _are_sides_of_slit(edges[long], edges[short], outline, facets, tags, len(x))
    if slit.all():
        return
    hanging = np.unique(ends[short[~slit], 1])
    first = np.flatnonzero(~slit & (ends[short, 1] == hanging[0]))[0]
    (a, b), where = edges[long[first]], format_point(x[hanging[0]])
    raise MeshError(
        f"{hanging.size} hanging nodes: node {hanging[0]} at {where} lies inside the edge from "
        f"node {a} to node {b} of cell {cell[long[first]]}, so that the body is not joined there: "
        "divide this cell at the node, too. For a slit, make its two sides boundaries of different "
        "names"
    )


def _outline(cells: Indices, kind: Kind, num_points: int) -> Indices:
    """Corners of the facets of one cell only, shape (f, corners) (local)."""
    facets = facets_of(cells, kind).reshape(-1, len(kind.facets[0]))
    _, first, count = np.unique(codes_of(facets, num_points), return_index=True, return_counts=True)
    return np.asarray(facets[first[count == 1]])


def _edges_on(
    outline: Indices, x: Array, cells: Indices, kind: Kind
) -> tuple[Indices, Array, Indices]:
    """Edges between nodes of the outline, in both directions (local).

    Returns:
        Ends (e, 2), positions of the middles (e, 3) [length], numbers of a cell (e,), ordered by
        the start.
    """
    on = np.zeros(len(x), bool)
    on[outline] = True
    ends = cells[:, np.array(kind.edges)].reshape(-1, 2)
    _, first = np.unique(codes_of(ends, len(x)), return_index=True)
    first = first[on[ends[first]].all(axis=1)]
    ends, cell, number = ends[first], first // len(kind.edges), first % len(kind.edges)
    middle = x[ends].mean(axis=1)
    if kind.degree == 2:
        middle = x[cells[cell, kind.corners + number]]
    ends = np.concatenate([ends, ends[:, ::-1]])
    order = np.argsort(ends[:, 0], kind="stable")
    return ends[order], np.tile(middle, (2, 1))[order], np.tile(cell, 2)[order]


def _seams(x: Array, ends: Indices, middle: Array) -> tuple[Indices, Indices]:
    """Numbers of edges, and of shorter ones of the same start that end inside of them (local)."""
    first, after = (np.searchsorted(ends[:, 0], ends[:, 0], side=s) for s in ("left", "right"))
    counts = after - first
    long = np.repeat(np.arange(len(ends)), counts)
    within = np.arange(long.size) - np.repeat(np.cumsum(counts) - counts, counts)
    short = first[long] + within
    start, chord = x[ends[long, 0]], (x[ends[:, 1]] - x[ends[:, 0]])[long]
    end, square = x[ends[short, 1]], (chord**2).sum(axis=1)
    t = ((end - start) * chord).sum(axis=1) / np.where(square > 0.0, square, 1.0)
    off = ((start + t[:, None] * chord - end) ** 2).sum(axis=1)
    inside = (off <= SAME_PLACE**2 * square) & (t > SAME_PLACE) & (t < 1.0 - SAME_PLACE)
    inside |= ((middle[long] - end) ** 2).sum(axis=1) <= SAME_PLACE**2 * square
    inside &= (long != short) & (square > 0.0)
    return long[inside], short[inside]


def _are_sides_of_slit(
    long: Indices, short: Indices, outline: Indices, facets: Indices, tags: Numbers, num_points: int
) -> Flags:
    """Whether edges (k, 2) of seams are those of boundaries of different names (local)."""
    of_facet = values_at(
        codes_of(outline, num_points), codes_of(facets, num_points), np.asarray(tags), 0
    )

    def tags_at(edge: Indices) -> set[int]:
        return set(of_facet[np.isin(outline, edge).sum(axis=1) == 2].tolist())

    pairs = [(tags_at(one), tags_at(other)) for one, other in zip(long, short, strict=True)]
    return np.array([bool(a and b) and 0 not in a | b and not a & b for a, b in pairs], bool)
