# SPDX-License-Identifier: MIT
"""Hanging nodes of meshes in space.

At a hanging node the edge of a cell ends inside a longer edge with the same start, which belongs to
another cell. The same is true of the two sides of a crack with different meshes; but these are
boundaries of different names. Nodes inside faces come with nodes inside the edges of these.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fenics_mortar.mesh.kinds import KINDS, Kind, codes_of, facets_of
from fenics_mortar.utils.arrays import Array, Flags, Indices, values_at
from fenics_mortar.utils.errors import MeshError, format_point
from fenics_mortar.utils.rounding import SAME_PLACE


def check_hanging_nodes_in_space(
    x: Array, cells: Indices, facets: Indices, tags: npt.NDArray[np.int32]
) -> None:
    """Reject nodes inside an edge of another cell (local).

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
    codes = codes_of(facets, num_points)
    _, first, count = np.unique(codes, return_index=True, return_counts=True)
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
    long: Indices,
    short: Indices,
    outline: Indices,
    facets: Indices,
    tags: npt.NDArray[np.int32],
    num_points: int,
) -> Flags:
    """Whether edges (k, 2) of seams are those of boundaries of different names (local)."""
    of_facet = values_at(
        codes_of(outline, num_points), codes_of(facets, num_points), np.asarray(tags), 0
    )

    def tags_at(edge: Indices) -> set[int]:
        return set(of_facet[np.isin(outline, edge).sum(axis=1) == 2].tolist())

    pairs = [(tags_at(one), tags_at(other)) for one, other in zip(long, short, strict=True)]
    return np.array([bool(a and b) and 0 not in a | b and not a & b for a, b in pairs], bool)
