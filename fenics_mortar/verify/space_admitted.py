# SPDX-License-Identifier: MIT
"""Overlaps of bodies in space: points inside bodies, their depths, and those that are admitted.

``find_overlaps`` finds the points; ``SpaceAdmitted`` has the depths that the discretization admits,
as ``overlap.AdmittedDepth`` in the plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.kernels.space.inside import depths_inside, find_piercings, winding_number
from fenics_mortar.kernels.space.triangles import nearest_triangle, square_on_triangle
from fenics_mortar.kernels.tree import build_tree
from fenics_mortar.utils.arrays import SAME_PLACE, TINY, Array, Flags, Indices, at_rows
from fenics_mortar.verify.finding import LIMITS, paired_nodes

if TYPE_CHECKING:
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.interface.outline import Hull

# Distance below an edge at which it is asked how often the body covers a point [edge lengths]:
# small beside facets, large beside rounding.
BELOW = 1e-3
# Distance of a point of an edge inside a body from an edge of the latter, over the depth of the
# point, below which these edges cross [1]: that of wedges of more than 60 degrees.
BESIDE_EDGE = 2.0
# Cosine of the angle between outward normals above which a surface faces the back of a body from
# within, rather than a side of it [1]: 60 degrees.
AWAY = 0.5


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


def find_overlaps(hull: Hull, x: Array) -> Overlaps:
    """Points of the hulls inside bodies, nodes at ``x`` (n, 3) (local).

    Nodes inside another body are found by winding numbers, and where no node is inside, as where
    edges cross each other, by the middles of the parts of edges inside it. The depth of a point is
    its distance from the surface of the body that contains it.

    Of a body that crosses itself, the middle of an edge beyond a triangle that it pierces is inside
    if the body covers the points just below it twice: at a fold, where det F < 0, it does not. The
    depth is the distance from the surface around the pierced triangle: the body's own surface at
    the edge is nearer, and the pierced triangle alone is far from an edge that lies along the
    surface.
    """
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
        found.append(at_rows(every, depths > SAME_PLACE * size))
        if own.any():
            found.append(_of_itself(hull, x, mine, boxes, rows[own]))
    return Overlaps(*(np.concatenate(values) for values in zip(*found, strict=True)))


def _distance_from_edge(p: Array, a: Array, b: Array) -> float:
    """Distance of p (3,) from the segment from a to b (3,) each [length] (local)."""
    way = b - a
    at = np.clip((p - a) @ way / max(float(way @ way), TINY), 0.0, 1.0)
    return float(np.linalg.norm(p - a - at * way))


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


def _of_itself(hull: Hull, x: Array, mine: Indices, boxes: Array, rows: Array) -> Overlaps:
    """Overlaps of a body with itself.

    Args:
        hull: The hulls.
        x: Positions of the nodes, shape (n, 3) [length].
        mine: Triangles of the body, shape (t,).
        boxes: Tree of their boxes.
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
    own, hits = hull.segments[mine], np.empty(len(boxes) // 2, np.int64)
    covered = np.array([winding_number(x, own, boxes, hits, p) for p in below])
    twice = covered > 1
    ends, triangles, points = ends[twice], triangles[twice], points[twice]
    depths = np.array([_distance_around(hull, x, p, f) for p, f in zip(points, triangles)], float)
    return Overlaps(ends, triangles, depths, points)


def _distance_around(hull: Hull, x: Array, p: Array, triangle: int) -> float:
    """Distance of p (3,) from the surface around a triangle [length].

    From triangle to neighbour as long as the distance falls.
    """
    starts, around, _ = hull.around
    square, at = np.inf, np.array([triangle])
    while True:
        squares = np.array([square_on_triangle(p, *x[hull.segments[f]]) for f in at])
        if not squares.min() < square:
            return float(np.sqrt(square))
        square, triangle = squares.min(), int(at[squares.argmin()])
        nodes = hull.segments[triangle]
        at = np.unique(np.concatenate([around[starts[j] : starts[j + 1]] for j in nodes]))


class Measured(NamedTuple):
    """Depths of points inside bodies, k of them.

    Attributes:
        depths: Distances from the surfaces, shape (k,) [length].
        triangles: Nearest triangles of the bodies that contain the points, shape (k,).
        across: Whether more than half of a thin body is above a point, shape (k,), bool.
    """

    depths: Array
    triangles: Indices
    across: Flags


def below_marked(
    hull: Hull, x: Array, points: Array, n: Array, first: Measured, marked: Flags
) -> Measured:
    """Depths of what came in by marked triangles, and may be nearer to others now (local).

    A side of a pair that has entered a thin body is nearer to the back of the body than to the side
    it came through. It faces the latter: its depth is that below the side of the pair. Where the
    nearest triangle is one of the back, points are measured from the nearest marked one of the body
    if they face it more, and are below it by no more than pairs admit.

    Args:
        hull: The hulls.
        x: Positions of the nodes, shape (n, 3) [length].
        points: The points, shape (k, 3) [length].
        n: Outward normals of the other surface at the points, shape (k, 3).
        first: Depths from the nearest triangles.
        marked: Triangles of the hulls, shape (m,), bool.
    """
    normals, sizes = hull.normals(x), hull.lengths(x)
    depths, triangles, across = first.depths.copy(), first.triangles.copy(), first.across.copy()
    facing_first = np.einsum("kc,kc->k", n, normals[triangles])
    bodies, elsewhere = hull.segment_bodies[triangles], ~marked[triangles] & (facing_first > AWAY)
    for body in np.unique(bodies[elsewhere]):
        mine = np.flatnonzero(marked & (hull.segment_bodies == body))
        if not mine.size:
            continue
        among = hull.segments[mine]
        boxes = build_tree(x, among)
        hits = np.empty(len(boxes) // 2, np.int64)
        for k in np.flatnonzero(elsewhere & (bodies == body)):
            depth, at = nearest_triangle(x, among, boxes, hits, points[k], depths[k])
            t = int(mine[at])
            if n[k] @ normals[t] < facing_first[k] and depth <= LIMITS.penetration * sizes[t]:
                depths[k], triangles[k], across[k] = depth, t, True
    return Measured(depths, triangles, across)


class Kind(IntEnum):
    """What keeps the surfaces of an overlap apart."""

    PAIRED, UNLOADED, UNPAIRED, WITHOUT_AREA, THROUGH, EDGES = range(6)


# What a pair does not see, by the kind of an overlap between its sides.
HINTS = {
    Kind.WITHOUT_AREA: "; no facets of their pair face each other there: edges or corners meet, or "
    "contact was missed",
    Kind.UNLOADED: "; no node carries force there, since the facets of the slave are too coarse "
    "for this tip or edge: refine the slave there",
    Kind.THROUGH: "; the one has gone through the other, a thin body, between the nodes of their "
    "pair, whose facets are too coarse there: refine the slave",
    Kind.EDGES: "; two edges cross there between the nodes of their pair, whose force is missing "
    "in whole or for the most part: place a node of the slave's edge at the crossing, or refine it",
}
# Further advice where nodes of the slave carry no force.
TIP = ", with a node at a sharp tip"
# Threshold of overlaps that are always a remark [facet sizes].
ALWAYS = 0.0
# Further hint where the depth is more than half the thickness of the body.
ACROSS = "; this is more than half the thickness of the body there: refine the slave"


def remark_of(kind: Kind) -> float:
    """Depth of an overlap above which there is a remark [facet sizes] (local)."""
    return LIMITS.coarse_penetration if kind == Kind.PAIRED else LIMITS.coarse_unloaded


class SpaceAdmitted:
    """Kinds of overlaps by pairs, and the depths admitted for them.

    Between the two sides of a pair, contact is enforced at the nodes: facets overlap between them,
    by less than half a facet. Beside nodes without force less is admitted: there a tip of the
    master may have entered a facet whose nodes do not see it. Elsewhere any overlap is an error,
    beyond the sagittas of both surfaces with flat triangles: L a / 8 for facets of the size L at an
    angle a. So is one of the sides of a pair where no facets of the pair face each other: edges
    that cross, a corner beside a face; and two ridges that cross, no faces of which face each
    other, where no node carries force, or the nodes beside do not keep them apart: the mean gaps of
    the nodes see nothing of the crossing, and the force is missing in whole or in part. A node at
    the crossing sees it.

    Args:
        hull: The hulls of the bodies.
        contacts: All pairs.
    """

    def __init__(self, hull: Hull, contacts: Sequence[Interface]) -> None:
        self._hull, self._contacts = hull, contacts
        self._sides = [(hull.near(c.slave), hull.near(c.master)) for c in contacts]
        self._more_functions = or_more_functions(contacts)
        exact = [(hull.are_of(c.slave), hull.are_of(c.master)) for c in contacts]
        self._ways = [way for sides in exact for way in (sides, sides[::-1])]

    def hint(self, kind: Kind, remedy: str) -> str:
        """What a pair does not see in an overlap of this kind, with a ``remedy`` without force."""
        return HINTS.get(kind, "") + (remedy + self._more_functions) * (kind == Kind.UNLOADED)

    def _between(self, number: int, overlaps: Overlaps) -> Flags:
        """Whether overlaps are between the two sides of a pair, shape (k,), bool (local)."""
        slave, master = self._sides[number]
        return (self._on(slave, overlaps) & master[overlaps.triangles]) | (
            self._on(master, overlaps) & slave[overlaps.triangles]
        )

    def _on(self, marked: Flags, overlaps: Overlaps) -> Flags:
        """Whether the points are on marked triangles (m,), or beside them, shape (k,), bool."""
        nodes = np.zeros(len(self._hull.X), bool)
        nodes[self._hull.segments[marked]] = True
        return np.asarray(nodes[overlaps.nodes].any(axis=1))

    def are_in_contact(self, overlaps: Overlaps) -> Flags:
        """Whether overlaps are between the sides of a contact pair, shape (k,), bool (local)."""
        marks = np.zeros(len(overlaps.depths), bool)
        for number, contact in enumerate(self._contacts):
            if isinstance(contact, Contact):
                marks |= self._between(number, overlaps)
        return marks

    def measured(self, x: Array, overlaps: Overlaps) -> tuple[Overlaps, Flags]:
        """Overlaps of sides of pairs measured from the other side, see ``below_marked``.

        With nodes at ``x`` (n, 3) [length]; also ``Measured.across``, shape (k,), bool (local).
        """
        depths, triangles = overlaps.depths.copy(), overlaps.triangles.copy()
        found = Measured(depths, triangles, np.zeros(len(depths), bool))
        for one, other in self._ways:
            at = np.flatnonzero(self._on(one, overlaps))
            if at.size:
                n, first = self._outward(x, one, overlaps.nodes[at]), at_rows(found, at)
                again = below_marked(self._hull, x, overlaps.points[at], n, first, other)
                for values, new in zip(found, again):
                    values[at] = new
        return overlaps._replace(depths=found.depths, triangles=found.triangles), found.across

    def _outward(self, x: Array, marked: Flags, nodes: Indices) -> Array:
        """Normals of marked triangles (m,) at the ends (k, 2) of edges, shape (k, 3)."""
        hull = self._hull
        normals = np.zeros_like(x)
        np.add.at(normals, hull.segments[marked], hull.normals(x)[marked][:, None])
        n = normals[nodes].sum(axis=1)
        return np.asarray(n / np.maximum(np.linalg.norm(n, axis=1), TINY)[:, None])

    def are_through(self, x: Array, overlaps: Overlaps) -> Flags:
        """Whether the back of a body that has a side in a pair is behind the other side, (k,)."""
        hull, marks = self._hull, np.zeros(len(overlaps.depths), bool)
        everywhere = np.ones(len(hull.segments), bool)
        n = self._outward(x, everywhere, overlaps.nodes)
        behind = np.einsum("kc,kc->k", n, hull.normals(x)[overlaps.triangles]) > AWAY
        bodies = hull.bodies[overlaps.nodes[:, 0]]
        for one, other in self._ways:
            has_side = np.isin(bodies, hull.segment_bodies[one])
            marks |= behind & has_side & other[overlaps.triangles] & ~self._on(one, overlaps)
        return marks

    def kinds(self, x: Array, overlaps: Overlaps, facets: Array) -> Indices:
        """``Kind`` of each overlap, shape (k,) (collective).

        Args:
            x: Positions of the nodes, shape (n, 3) [length].
            overlaps: The overlaps.
            facets: Their depths, shape (k,) [facet sizes].
        """
        kinds = np.full(len(overlaps.depths), int(Kind.UNPAIRED))
        edges = self._are_edges(x, overlaps)
        for number, contact in enumerate(self._contacts):
            between = self._between(number, overlaps)
            nodes = np.zeros(len(self._hull.X), bool)
            nodes[self._hull.indices_of(paired_nodes(contact))] = True
            paired = nodes[self._hull.segments].any(axis=1)
            has_area = self._on(paired, overlaps) | paired[overlaps.triangles]
            unknown = between & (kinds == Kind.UNPAIRED)
            kinds[unknown & ~has_area] = Kind.WITHOUT_AREA
            kinds[between & has_area] = Kind.UNLOADED
            loaded = self._loaded(contact)
            has_force = self._on(loaded, overlaps) | loaded[overlaps.triangles]
            kinds[between & has_area & has_force] = Kind.PAIRED
            keeps_apart = has_force & (facets <= LIMITS.unloaded)
            kinds[between & has_area & edges & ~keeps_apart] = Kind.EDGES
        return kinds

    def _are_edges(self, x: Array, overlaps: Overlaps) -> Flags:
        """Whether sharp edges of both sides cross, no faces of which face each other, (k,) (local).

        Edges of blocks that lie on each other cross, too: beside these are faces that touch. Edges
        are sharp before deformation: contact flattens them.
        """
        hull, (nodes, triangles, depths, points) = self._hull, overlaps
        (edges, beside), normals, count = hull.edges, hull.normals(x), len(hull.X)
        sharp = np.flatnonzero(hull.turns(hull.X) >= LIMITS.sharp_corner)
        keys = edges[sharp] @ [count, 1]
        marks = np.isin(np.sort(nodes, axis=1) @ [count, 1], keys)
        for k in np.flatnonzero(marks):
            mine = beside[sharp[np.searchsorted(keys, np.sort(nodes[k]) @ [count, 1])]]
            theirs = sharp[(beside[sharp] == triangles[k]).any(axis=1)]
            apart = np.array([_distance_from_edge(points[k], *x[edges[e]]) for e in theirs])
            other = beside[theirs[apart < BESIDE_EDGE * depths[k]]].ravel()
            facing = -(normals[mine] @ normals[other].T).min(initial=0.0)
            marks[k] = other.size > 0 and facing < np.cos(LIMITS.corner)
        return np.asarray(marks)

    def _loaded(self, contact: Interface) -> Flags:
        """Whether a node of each triangle's facet carries force in a pair, shape (m,), bool."""
        hull = self._hull
        nodes = np.zeros(len(hull.X), bool)
        nodes[hull.indices_of(contact.slave.nodes[contact.active])] = True
        facet = hull.ends[:, 0]
        facets = np.zeros(facet.max(initial=-1) + 1, bool)
        facets[facet[nodes[hull.segments].any(axis=1)]] = True
        return np.asarray(facets[facet])

    def of(self, x: Array, overlaps: Overlaps, kinds: Indices) -> Array:
        """Admitted depths, shape (k,) [facet sizes] (local).

        Args:
            x: Positions of the nodes, shape (n, 3) [length].
            overlaps: The overlaps.
            kinds: Their kinds, shape (k,).
        """
        sagittas = self._sagittas(x)
        at_nodes = self._hull.largest_at_nodes(sagittas)[overlaps.nodes].max(axis=1)
        return self._depths(at_nodes + sagittas[overlaps.triangles], kinds)

    def at_obstacle(self, x: Array, paired: Flags, pairs: list[Contact]) -> tuple[Indices, Array]:
        """``Kind`` of an obstacle below each triangle, and the depth admitted, (m,) each (local).

        Args:
            x: Positions of the nodes, shape (n, 3) [length].
            paired: Whether a pair keeps the obstacle apart from a triangle, shape (m,), bool.
            pairs: The pairs with the obstacle.

        Returns:
            Kinds and depths [facet sizes].
        """
        kinds = np.where(paired, int(Kind.UNLOADED), int(Kind.UNPAIRED))
        for contact in pairs:
            kinds[paired & self._loaded(contact)] = Kind.PAIRED
        return kinds, self._depths(self._sagittas(x), kinds)

    @staticmethod
    def _depths(sagittas: Array, kinds: Indices) -> Array:
        """Admitted depths of overlaps of ``kinds`` (k,) with the sum of ``sagittas`` (k,) there."""
        unloaded = np.maximum(sagittas, LIMITS.unloaded)
        are = [kinds == Kind.PAIRED, kinds == Kind.UNLOADED]
        return np.select(are, [LIMITS.penetration, unloaded], np.maximum(sagittas, LIMITS.unpaired))

    def _sagittas(self, x: Array) -> Array:
        """Sagittas of surfaces through the triangles, (m,) [facet sizes]; zero at sharp edges."""
        _, beside = self._hull.edges
        turns, before = self._hull.turns(x), self._hull.turns(self._hull.X)
        turns = np.where(np.maximum(turns, before) < LIMITS.sharp_corner, turns, 0.0)
        largest = np.zeros(len(self._hull.segments))
        np.maximum.at(largest, beside, turns[:, None])
        return largest / 8.0


def or_more_functions(contacts: Sequence[Interface]) -> str:
    """Advice for triangles with six nodes and linear multipliers; "" if no slave has these (local).

    The mean gap over all facets around a corner is open until they have been entered deeply.
    """
    coarse = any(c.slave.facets.shape[1] == 6 and c.basis == "linear" for c in contacts)
    quadratic = ", or take Discretization(basis='quadratic'), with multipliers at all six nodes"
    return f"{quadratic} of a triangle" * coarse
