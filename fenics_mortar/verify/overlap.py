# SPDX-License-Identifier: MIT
"""Overlaps of outlines with bodies and obstacles, and those that the discretization admits.

``AdmittedDepth`` has the depths of crossing outlines that the discretization admits, ``are_folds``
finds crossings at which a body is inverted, ``obstacle_depths`` obstacles inside bodies,
``held_inside`` prescribed nodes inside obstacles, and ``OutlineNames`` has the names for messages.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.kernels.passage import depths_inside
from fenics_mortar.kernels.space.inside import depths_inside as depths_inside_hull
from fenics_mortar.kernels.tree import build_tree
from fenics_mortar.utils.arrays import Array, Flags, Indices, angles_between, first_largest, norms
from fenics_mortar.utils.errors import call_together, format_point
from fenics_mortar.verify.finding import LIMITS, Crossing

if TYPE_CHECKING:
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.interface.outline import Outline
    from fenics_mortar.obstacles.obstacle import Obstacle


class OutlineNames:
    """Names of the segments, bodies and nodes of the outlines.

    Args:
        outline: The outlines of the bodies.
        contacts: All pairs, whose surfaces have names.
        name_of_body: Function that returns the name of a body by its number (collective).
    """

    def __init__(
        self, outline: Outline, contacts: Sequence[Interface], name_of_body: Callable[[int], str]
    ) -> None:
        self._outline, self._name_of_body = outline, name_of_body
        self._bodies: dict[int, str] = {}
        self._surfaces: list[str] = []
        self._surface_of = np.full(len(outline.segments), -1)
        for contact in contacts:
            for surface in (contact.slave, contact.master):
                if surface.num_nodes and f"'{surface.name}'" not in self._surfaces:
                    self._surface_of[outline.are_of(surface)] = len(self._surfaces)
                    self._surfaces.append(f"'{surface.name}'")

    def segment(self, segment: int) -> str:
        """Name of the surface of a segment, or else of its body (collective)."""
        if self._surface_of[segment] >= 0:
            return self._surfaces[self._surface_of[segment]]
        return self.body(int(self._outline.segment_bodies[segment]))

    def body(self, body: int) -> str:
        """Name of a body (collective)."""
        if body not in self._bodies:
            self._bodies[body] = self._name_of_body(body)
        return self._bodies[body]

    def node(self, node: int) -> str:
        """Name of a surface of a node, or else of its body (collective)."""
        at = (self._outline.segments == node).any(axis=1)
        surface = self._surface_of[at].max(initial=-1)
        return self._surfaces[surface] if surface >= 0 else self.segment(int(np.argmax(at)))


def slides_little(contact: Interface) -> bool:
    """Whether the conditions of a pair are those of the undeformed surfaces (local)."""
    return isinstance(contact, Contact) and contact.pair.sliding == "small"


def are_folds(x: Array, segments: Indices, bodies: Indices, crossings: Array) -> Flags:
    """Whether crossings of outlines with themselves are folds, shape (k,), bool (local).

    At a fold the body is inverted, not overlapped. The winding number of a closed outline, the body
    on its left, is the number of times that the body covers a point, counted negative where
    det F < 0. Beside a crossing of two edges it is w + 1, w, w and w - 1 in the four sectors: w is
    1 where two parts of the body overlap, and 0 at a fold, beside which det F < 0. With linear
    strains and small sliding a fold has no meaning, since the sign of det F has none and the
    contact conditions are those of the undeformed surfaces. So below the tip of a cone the surface
    of a linear elastic body moves across the axis.

    Args:
        x: Positions of the nodes, shape (n, 2) [length].
        segments: Nodes of the segments of all outlines, shape (m, 2).
        bodies: Body of each segment, shape (m,).
        crossings: Rows of ``find_crossings``, shape (k, 6).
    """
    folds = np.empty(len(crossings), bool)
    for k, row in enumerate(crossings):
        crossed = row[:2].astype(np.int64)
        others = bodies == bodies[crossed[0]]
        others[crossed] = False
        # mean winding number: the two segments contribute opposite angles on both sides
        angles = angles_between(*np.moveaxis(x[segments[others]] - row[4:], 1, 0))
        folds[k] = round(float(angles.sum()) / (2.0 * np.pi)) < 1
    return folds


def depths_in_body(outline: Any, x: Array, body: int, points: Array) -> tuple[Array, Indices]:
    """Depths of points (k, dim) in a body, zero outside [length]; the nearest segments (local).

    Args:
        outline: Outlines or hulls of the bodies.
        x: Positions of their nodes, shape (n, dim) [length].
        body: The body.
        points: The points, shape (k, dim) [length].
    """
    mine, points = np.flatnonzero(outline.segment_bodies == body), np.ascontiguousarray(points)
    facets = outline.segments[mine]
    if x.shape[1] == 2:
        depths, nearest = depths_inside(x, facets, points).T
        return depths, mine[nearest.astype(np.int64)]
    size = float(np.median(outline.lengths(x)[mine]))
    depths, nearest = depths_inside_hull(x, facets, build_tree(x, facets), points, size)
    return depths, mine[nearest]


def obstacle_depths(
    outline: Any, x: Array, body: int, points: Array, offset: Array,
    distance: Callable[[Array], Array],
) -> tuple[Array, Array, Indices]:  # fmt: skip
    """Depths of an obstacle in a body; an error is that of ``distance``.

    Points that are not on the obstacle, since a user's function is no distance, do not count.

    Args:
        outline: See ``depths_in_body``, as ``x`` and ``body``.
        x: Positions of the nodes, shape (n, dim) [length].
        body: The body.
        points: Points of the obstacle, shape (k, dim) [length].
        offset: Lengths of which the overlap -offset is admitted, any shape [length].
        distance: Distance of points from the obstacle; where it is negative points count.

    Returns:
        Depths less the admitted overlap, of the points where they are positive, (m,) [length],
        these points (m, dim) [length], and the nearest segments or triangles (m,).
    """
    mine = x[outline.bodies == body]
    near = points[((points > mine.min(axis=0)) & (points < mine.max(axis=0))).all(axis=1)]
    depths, nearest = depths_in_body(outline, x, body, near)
    depths = depths - max(-float(offset.min(initial=0.0)), 0.0)
    off = distance(near) > LIMITS.coarse_distance * outline.lengths(x)[nearest]
    below = (depths > 0.0) & ~off
    return depths[below], near[below], nearest[below]


def depths_of_obstacle(
    contact: Contact, outline: Outline, slave: Indices, x: Array
) -> tuple[Array, Array, Indices]:
    """``obstacle_depths`` of the nearest and the salient points in the bodies of the slave (local).

    A small obstacle inside a body need not contain any node of the mesh. Therefore points of the
    obstacle are located in the bodies: the points nearest to the slave nodes and its salient
    points. If a user's function is not a distance, x + phi n may miss the obstacle; such points are
    left out.

    Args:
        contact: A pair with an obstacle, evaluated at the present state.
        outline: Outlines of the bodies.
        slave: Numbers of the slave nodes in the outlines, shape (slave nodes,).
        x: Positions of the outlines' nodes, shape (n, 2) [length].
    """
    o = contact.operators
    points = np.concatenate([o.nearest_points(), o.obstacle.to_space(o.obstacle.salient_points())])
    given = points, contact.now.offset, lambda at: o.obstacle.evaluate(at)[0]
    bodies = np.unique(outline.bodies[slave]).tolist()
    found = zip(*(obstacle_depths(outline, x, body, *given) for body in bodies), strict=True)
    depths, at, segments = map(np.concatenate, found)
    return depths, at, segments


def deepest_in_obstacle(
    obstacle: Obstacle, outline: Any, x: Array, body: int
) -> tuple[float, float, Array]:
    """The deepest overlap of an obstacle and a body, of any pair or none (collective).

    Args:
        obstacle: The obstacle, at its present place.
        outline: See ``depths_in_body``, as ``x`` and ``body``.
        x: Positions of the nodes, shape (n, dim) [length].
        body: The body.

    Returns:
        Depth [length], the same over the facet [1], place (dim,) [length]; zeros for no overlap.
    """

    def evaluate(at: Array) -> tuple[Array, Array]:
        what = f"the distance of '{obstacle.name}'"
        return call_together(outline.comm, what, partial(obstacle.evaluate, at))[:2]

    mine = np.flatnonzero(outline.bodies == body)
    nodes = x[mine]
    phi, gradient = evaluate(nodes)
    nearest = nodes - (phi / (gradient**2).sum(axis=1))[:, None] * gradient
    salient = obstacle.salient_points_near(obstacle.to_own_frame(nodes))
    points = np.concatenate([nearest, obstacle.to_space(salient)])
    at = outline, x, body, points, np.zeros(1), lambda p: np.abs(evaluate(p)[0])
    depths, inside, facets = obstacle_depths(*at)
    depths, places = np.concatenate([depths, -phi]), np.concatenate([inside, nodes])
    sizes = [outline.lengths(x)[facets], outline.node_sizes(x)[mine]]
    over = depths / np.concatenate(sizes)
    k = first_largest(over)
    return max(float(depths[k]), 0.0), max(float(over[k]), 0.0), places[k]


# What is wrong if boundary conditions move nodes into an obstacle.
LED = (
    "; boundary conditions move nodes of the body into the obstacle, {}, where no contact can keep "
    "them out: end the motion before"
)


def held_inside(
    obstacle: Obstacle, outline: Any, x: Array, held: Indices, offset: Array, names: OutlineNames
) -> list[Crossing]:
    """The deepest of the ``held`` nodes (k,) moved into an obstacle, if any (collective).

    Depths are those beyond the ones that the mesh has in the obstacle at its initial place, as
    where it gives an interference.

    Args:
        obstacle: The obstacle, at its present place.
        outline: See ``depths_in_body``, as ``x``.
        x: Positions of the nodes, shape (n, dim) [length].
        held: Nodes whose values are all prescribed.
        offset: Lengths of which the overlap -offset is admitted, any shape [length].
        names: Names of bodies.
    """

    def depths_at(points: Array) -> Array:
        what = f"the distance of '{obstacle.name}'"
        evaluate = partial(obstacle.evaluate, points)
        phi, gradient, _ = call_together(outline.comm, what, evaluate)
        return -phi / np.maximum(norms(gradient), 1.0)  # of users it need not be a distance

    of_mesh = depths_at(obstacle.to_space(outline.X[held]))
    admitted = np.maximum(of_mesh, 0.0) + max(-float(offset.min(initial=0.0)), 0.0)
    depths = depths_at(x[held]) - admitted
    facets = depths / outline.node_sizes(x)[held]
    if not facets.max(initial=0.0) > LIMITS.unpaired:
        return []
    k = first_largest(facets)
    sides = names.body(int(outline.bodies[held[k]])), f"obstacle '{obstacle.name}'"
    depth, where = float(depths[k]), format_point(x[held[k]])
    hint = LED.format(f"{depth:.3g} deep at {where}")
    limits = LIMITS.unloaded, True, hint, LIMITS.coarse_unloaded
    return [Crossing(sides, where, depth, float(facets[k]), *limits)]


class AdmittedDepth:
    """Classification of crossings by pairs, and the depths admitted for them; all are local.

    Between the two sides of a pair, contact is enforced at the nodes: facets overlap between them,
    by less than half a facet. Elsewhere nothing keeps bodies apart, and any overlap is an error,
    beyond the sagittas of both curves with straight facets: L a / 8 for facets of the length L at
    an angle a.

    A crossing is one of a pair if each of its segments touches one of the two sides: a corner at
    the end of a surface overlaps with it. Two such corners alone, as at the junction of cracks,
    overlap as the sides of pairs: contact of the sides beside them keeps them where they are. Then
    the outlines cross an even number of times beside these two nodes; if they go on inside each
    other, an odd one.

    Args:
        outline: The outlines of the bodies.
        contacts: All pairs.
    """

    def __init__(self, outline: Outline, contacts: Sequence[Interface]) -> None:
        self._outline = outline
        self._after, self._before = outline.neighbours()
        self._sides = [(outline.near(c.slave), outline.near(c.master)) for c in contacts]
        self._are_ties = [not isinstance(contact, Contact) for contact in contacts]
        self._ends = np.zeros(len(outline.X), bool)
        for surface in (side for c in contacts for side in (c.slave, c.master)):
            ends = surface.nodes[(surface.previous < 0) | (surface.following < 0)]
            self._ends[outline.indices_of(ends)] = True

    def are_paired(self, rows: Array) -> Flags:
        """Whether rows (k, 6) of ``find_crossings``, all, are between sides of pairs, (k,), bool.

        Tied pairs count, and corners that overlap alone.
        """
        return self._between(rows, ties=True) | self._corners(rows)

    def are_in_contact(self, rows: Array) -> Flags:
        """Whether rows (k, 6) are between the two sides of a contact pair, shape (k,), bool."""
        return self._between(rows, ties=False)

    def _between(self, rows: Array, *, ties: bool) -> Flags:
        e, f = rows[:, :2].astype(np.int64).T
        paired = np.zeros(len(rows), bool)
        for (slave, master), is_tie in zip(self._sides, self._are_ties, strict=True):
            if ties or not is_tie:
                paired |= (slave[e] & master[f]) | (slave[f] & master[e])
        return paired

    def _corners(self, rows: Array) -> Flags:
        """Whether rows (k, 6) are crossings of two corners at ends of surfaces, (k,), bool."""
        corners = list[set[tuple[int, int]]]()
        for e, f in self._outline.segments[rows[:, :2].astype(np.int64)]:
            mine, others = e[self._ends[e]].tolist(), f[self._ends[f]].tolist()
            corners.append({(min(a, b), max(a, b)) for a, b in product(mine, others)})
        count = Counter(pair for pairs in corners for pair in pairs)
        return np.array([any(count[pair] % 2 == 0 for pair in pairs) for pairs in corners], bool)

    def of(self, x: Array, rows: Array, paired: Flags) -> Array:
        """Admitted depths of rows (k, 6) of ``find_crossings``, shape (k,) [facet lengths].

        Args:
            x: Positions of the nodes, shape (n, 2) [length].
            rows: The crossings.
            paired: Whether they are between sides of pairs, shape (k,), bool.
        """
        unpaired = self._sagittas(x)[rows[:, :2].astype(np.int64)].sum(axis=1)
        unpaired = np.maximum(unpaired, LIMITS.unpaired)
        return np.where(paired, LIMITS.penetration, unpaired)

    def at_obstacle(self, x: Array, segment: int, pair: int) -> tuple[float, bool]:
        """Admitted depth of an obstacle below a segment, and whether the pair includes the latter.

        Args:
            x: Positions of the nodes, shape (n, 2) [length].
            segment: The segment.
            pair: Number of the pair with the obstacle.

        Returns:
            Depth [facet lengths], flag.
        """
        if self._sides[pair][0][segment]:
            return LIMITS.penetration, True
        return max(float(self._sagittas(x)[segment]), LIMITS.unpaired), False

    def _sagittas(self, x: Array) -> Array:
        """Sagittas of curves through the segments, (m,) [facet lengths]; zero at corners."""
        segments = self._outline.segments
        t = x[segments[:, 1]] - x[segments[:, 0]]
        t, sizes = t[:, 0] + 1j * t[:, 1], np.hypot(*t.T)
        turns = np.zeros(len(segments))
        for beside in (self._after, self._before):
            angles = np.abs(np.angle(t * t[beside].conj()))
            is_curve = (beside >= 0) & (angles < LIMITS.sharp_corner)
            turns = np.where(is_curve, np.maximum(turns, angles), turns)
        return np.asarray(turns * sizes / (8.0 * self._outline.lengths(x)))
