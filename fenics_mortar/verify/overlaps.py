# SPDX-License-Identifier: MIT
"""Points of hulls in space that lie inside bodies, and their depths.

Nodes inside another body are found by winding numbers, and where no node is inside, as where edges
cross each other, by the middles of the parts of edges inside it. The depth of a point is its
distance from the surface of the body that contains it.

Of a body that crosses itself, the middle of an edge beyond a triangle that it pierces is inside if
the body covers the points just below it twice: at a fold, where det F < 0, it does not. The depth
is the distance from the pierced triangle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fenics_mortar.interface.hull import Hull
from fenics_mortar.kernels.space.crossing import find_piercings
from fenics_mortar.kernels.space.inside import (
    depths_inside,
    square_on_triangle,
    winding_by_angles,
)
from fenics_mortar.kernels.tree import build_tree
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.rounding import SAME_PLACE

# Distance below an edge at which it is asked how often the body covers a point [edge lengths]:
# small beside facets, large beside rounding.
BELOW = 1e-3


class Overlaps(NamedTuple):
    """Points inside bodies, k of them.

    Attributes:
        nodes: Ends of the edge that contains each point; equal for a node, shape (k, 2).
        triangles: Nearest triangles of the bodies that contain the points, shape (k,).
        depths: Distances from the surfaces, shape (k,) [length].
        points: Shape (k, 3) [length].
    """

    nodes: Indices
    triangles: Indices
    depths: Array
    points: Array

    def select(self, marked: Flags | Indices) -> Overlaps:
        """Some of the points."""
        return Overlaps(
            self.nodes[marked], self.triangles[marked], self.depths[marked], self.points[marked]
        )


def find_overlaps(hull: Hull, x: Array) -> Overlaps:
    """Points of the hulls inside bodies, nodes at ``x`` (n, 3) (local)."""
    found = [_none()]
    sizes = hull.lengths(x)
    edges, _ = hull.edges
    middles, of_edges = x[edges].mean(axis=1), hull.bodies[edges[:, 0]]
    reach = 0.5 * np.ptp(x[edges], axis=1)
    for body in np.unique(hull.segment_bodies):
        mine = np.flatnonzero(hull.segment_bodies == body)
        triangles = hull.segments[mine]
        boxes = build_tree(x, triangles)
        low, high = boxes[1, :3], boxes[1, 3:]
        near = ((middles + reach >= low) & (middles - reach <= high)).all(axis=1)
        at = np.flatnonzero(near)
        rows = find_piercings(x, edges[at], triangles, boxes)
        rows[:, 0] = at[rows[:, 0].astype(np.int64)]
        rows = rows[np.lexsort((rows[:, 2], rows[:, 0]))]
        own = of_edges[rows[:, 0].astype(np.int64)] == body
        inside = ((x > low) & (x < high)).all(axis=1) & (hull.bodies != body)
        nodes = np.repeat(np.flatnonzero(inside)[:, None], 2, axis=1)
        of_edge, points = _middles(x, edges, rows[~own])
        nodes, points = np.concatenate([nodes, of_edge]), np.concatenate([x[nodes[:, 0]], points])
        size = float(np.median(sizes[mine]))
        depths, nearest = depths_inside(x, triangles, boxes, points, size)
        every = Overlaps(nodes, mine[nearest], depths, points)
        found.append(every.select(depths > SAME_PLACE * size))
        if own.any():
            found.append(_of_itself(hull, x, mine, rows[own]))
    return Overlaps(*(np.concatenate(values) for values in zip(*found, strict=True)))


def _none() -> Overlaps:
    nodes, points = np.empty((0, 2), np.int64), np.empty((0, 3))
    return Overlaps(nodes, np.empty(0, np.int64), np.empty(0), points)


def _middles(x: Array, edges: Indices, rows: Array) -> tuple[Indices, Array]:
    """Ends (k, 2) of edges that pass through a body, and the middles of the parts inside (k, 3).

    ``rows`` (r, 4) are those of ``find_piercings``, along the edges.
    """
    edge, place, sign = rows[:, 0].astype(np.int64), rows[:, 2], rows[:, 3]
    first = np.flatnonzero((edge[1:] == edge[:-1]) & (sign[:-1] < 0.0) & (sign[1:] > 0.0))
    ends = edges[edge[first]]
    at = 0.5 * (place[first] + place[first + 1])[:, None]
    return ends, (1.0 - at) * x[ends[:, 0]] + at * x[ends[:, 1]]


def _of_itself(hull: Hull, x: Array, mine: Indices, rows: Array) -> Overlaps:
    """Overlaps of a body with itself.

    Args:
        hull: The hulls.
        x: Positions of the nodes, shape (n, 3) [length].
        mine: Triangles of the body, shape (t,).
        rows: Rows of ``find_piercings`` of its edges along the edges, shape (r, 4).
    """
    edges, beside = hull.edges
    edge, place, enters = rows[:, 0].astype(np.int64), rows[:, 2], rows[:, 3] < 0.0
    other_end = np.where(enters, 1.0, 0.0)
    same = edge[1:] == edge[:-1]
    other_end[:-1] = np.where(enters[:-1] & same, place[1:], other_end[:-1])
    other_end[1:] = np.where(~enters[1:] & same, place[:-1], other_end[1:])
    ends, at = edges[edge], 0.5 * (place + other_end)[:, None]
    points = (1.0 - at) * x[ends[:, 0]] + at * x[ends[:, 1]]
    normals = hull.normals(x)[beside[edge]].sum(axis=1)
    below = (
        points - BELOW * np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)[:, None] * normals
    )
    triangles = mine[rows[:, 1].astype(np.int64)]
    own = hull.segments[mine]
    covered = np.array([winding_by_angles(x, own, p) for p in below])
    squares = [square_on_triangle(p, *x[hull.segments[f]]) for p, f in zip(points, triangles)]
    return Overlaps(ends, triangles, np.sqrt(np.array(squares)), points).select(covered > 1)
