# SPDX-License-Identifier: MIT
"""Passages in a step: nodes through bodies and obstacles, points of obstacles through bodies.

Paths lead from the last accepted state to the present one, including rigid moves before the solve.
In frames that do not turn they are straight. Since straight paths would shrink a rotating body,
those past a rotating body or obstacle are computed in its frame, in sections so short that their
sagittas are negligible; see ``node_paths``.

A path passes through a body if the outward normals at entry and exit are opposed. It slides along
the body if exit and entry coincide, as for chords of a curve, if the outline between them is within
a facet of the path, as at a tip, if both are on facets at one junction of cracks, or if the path
between them is near the surface, as that of a node on a wheel that turns. Paths that end deep
inside another body are reported as well.

Passages of nodes through rigid obstacles in a step.

The signed distance of an obstacle is sampled along a path in the frame of the obstacle, with steps
equal to the distance (sphere tracing, Hart 1996), and steps of a small fraction of a facet near the
surface. A path passes through the obstacle if the gradients at entry and exit are opposed, the path
between them is deep inside, not along the surface as that of a node on a round obstacle that turns,
and the obstacle extends by half a facet to both sides; otherwise the path goes round an edge. So
some path passes through each round obstacle whose radius is a facet or more.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.outline import Outline
from fenics_mortar.kernels.passage import ALL, OPPOSED, OTHERS, OWN, find_events, find_passages
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.obstacles.rigid_motion import rotation_by
from fenics_mortar.utils.arrays import HALF_FACET, TINY, Array, Flags, Indices, norms
from fenics_mortar.utils.errors import call_together, format_point
from fenics_mortar.verify.finding import LIMITS
from fenics_mortar.verify.node_paths import Alternative, Paths, RigidPath, carry, motion_of
from fenics_mortar.verify.overlap import OutlineNames, depths_in_body

ADVICE = "since the last accepted state: take smaller steps"


def passed_through(obstacle: Obstacle, knots: Array, offset: Array, lengths: Array) -> Array:
    """Distance from the surface of nodes that passed through an obstacle, else 0 (local).

    Args:
        obstacle: The obstacle; its present position is not used.
        knots: Positions of s nodes in the frame of the obstacle at start, intermediate times and
            end, shape (m + 1, s, d) [length].
        offset: Length subtracted from the distance of each node, shape (s,) [length].
        lengths: Tributary length of each node, shape (s,) [length].

    Returns:
        Shape (s,) [length].
    """
    sections = np.linalg.norm(np.diff(knots, axis=0), axis=2)
    far = np.concatenate([np.zeros((1, len(offset))), np.cumsum(sections, axis=0)])
    (start, start_slope), (end, end_slope) = (
        _distance(obstacle, knots[k], offset) for k in (0, -1)
    )
    is_hit = np.maximum(start, 0.0) + np.maximum(end, 0.0) <= far[-1]
    turned = (start_slope * end_slope).sum(axis=1) < np.cos(LIMITS.section_turn)
    is_long = far[-1] > HALF_FACET * lengths  # it may return to the side where it began
    which = np.flatnonzero(is_hit & (turned | is_long) & (far[-1] > 0.0))
    through = np.zeros(len(offset))
    if which.size:
        passed = _trace(obstacle, knots[:, which], far[:, which], offset[which], lengths[which])
        through[which] = np.where(passed, np.maximum(end[which], TINY), 0.0)
    return through


def nodes_through(
    comm: MPI.Comm, obstacle: Obstacle, paths: tuple[Array, Array, Array], x1: Array,
    name: Callable[[int], str],
) -> list[str]:  # fmt: skip
    """Message on nodes that went through an obstacle, if there are any (collective).

    Args:
        comm: Communicator.
        obstacle: The obstacle.
        paths: Knots, offset and lengths, see ``passed_through``.
        x1: Positions of the s nodes at the end, shape (s, d) [length].
        name: Function that returns the name of the surface of one of them.
    """
    what = f"the distance of '{obstacle.name}'"
    depth = call_together(comm, what, partial(passed_through, obstacle, *paths))
    count, first = int((depth > 0.0).sum()), int(np.argmax(depth)) if len(depth) else 0
    if not count:
        return []
    return [
        f"{count} nodes of {name(first)} went through obstacle '{obstacle.name}', and one at "
        f"{format_point(x1[first])} ended {depth[first]:.3g} beyond its surface, {ADVICE}"
    ]


def own_frame(obstacle: Obstacle, x: Array, place: Array) -> Array:
    """Points ``x`` (n, d) [length] in the frame of an obstacle at ``place`` (m,), shape (n, d)."""
    dim = obstacle.dim
    return (x - obstacle.pivot - place[:dim]) @ rotation_by(place[dim:]) + obstacle.pivot


def in_space(obstacle: Obstacle, x: Array, place: Array) -> Array:
    """Points ``x`` (n, d) [length] of an obstacle at ``place`` (m,), in space, shape (n, d)."""
    dim = obstacle.dim
    turned = (x - obstacle.pivot) @ rotation_by(place[dim:]).T
    return turned + obstacle.pivot + place[:dim]


def _distance(obstacle: Obstacle, x: Array, offset: Array) -> tuple[Array, Array]:
    """Distances (s,) minus offset, lower bounds if |grad phi| > 1, and unit gradients (s, d)."""
    phi, gradient, _ = obstacle.local(x)
    size = np.maximum(norms(gradient), TINY)
    return (phi - offset) / np.maximum(size, 1.0), gradient / size[:, None]


def _trace(
    obstacle: Obstacle, knots: Array, far: Array, offset: Array, lengths: Array
) -> npt.NDArray[np.bool_]:
    """Whether paths passed through; ``knots`` (m + 1, s, d) at arc lengths ``far`` (m + 1, s)."""
    total = far[-1]
    # near the surface points are as close as the smallest distance with a remark
    min_step = np.maximum(LIMITS.coarse_distance * lengths, total / LIMITS.max_points)
    at, passed = np.zeros(len(total)), np.zeros(len(total), bool)
    before = _at(knots, far, at)
    distance, slope = _distance(obstacle, before, offset)
    entry, entry_slope, inside = before.copy(), slope.copy(), distance < 0.0
    deepest, crosses = np.maximum(-distance, 0.0), np.zeros(len(total), bool)
    for _ in range(2 * LIMITS.max_points):
        if (at >= total).all():
            break
        at = np.minimum(at + np.maximum(np.abs(distance), min_step), total)
        here = _at(knots, far, at)
        distance, now = _distance(obstacle, here, offset)
        enters, leaves = ~inside & (distance < 0.0), inside & (distance >= 0.0)
        entry = np.where(enters[:, None], before, entry)
        entry_slope = np.where(enters[:, None], slope, entry_slope)
        deepest = np.maximum(np.where(enters, 0.0, deepest), -distance)
        crosses = (crosses & ~enters) | ((slope * now).sum(axis=1) < OPPOSED)
        step = here - before
        skips = ~inside & (distance >= 0.0)  # thinner than the spacing of the points
        skips &= ((step * slope).sum(axis=1) < 0.0) & ((step * now).sum(axis=1) > 0.0)
        first = np.where(leaves[:, None], entry_slope, slope)
        middle = np.where(leaves[:, None], 0.5 * (entry + here), 0.5 * (before + here))
        opposed = (leaves | skips) & ((first * now).sum(axis=1) < OPPOSED)
        least = np.minimum(HALF_FACET * lengths, LIMITS.deep * norms(here - entry))
        opposed &= skips | crosses | (deepest > least)
        if opposed.any():
            opposed[opposed] = _goes_on(
                obstacle, middle[opposed], first[opposed], lengths[opposed],
                offset[opposed] + 2.0 * min_step[opposed],
            )  # fmt: skip
        passed |= opposed
        before, slope, inside = here, now, distance < 0.0
    return passed


def _goes_on(
    obstacle: Obstacle, x: Array, normal: Array, lengths: Array, offset: Array
) -> npt.NDArray[np.bool_]:
    """Whether the obstacle extends by half a facet to both sides of points on their paths."""
    reach, sides = HALF_FACET * lengths[:, None], list[Array]()
    for along in _across(normal):
        sides += [_distance(obstacle, x + sign * reach * along, offset)[0] for sign in (1.0, -1.0)]
    return np.asarray((np.array(sides) <= 0.0).all(axis=0))


def _across(normal: Array) -> list[Array]:
    """Unit vectors across unit normals (s, d): one in the plane, two in space, each (s, d)."""
    if normal.shape[1] == 2:
        return [np.stack([-normal[:, 1], normal[:, 0]], axis=1)]
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    first /= norms(first)[:, None]
    return [first, np.cross(normal, first)]


def _at(knots: Array, far: Array, at: Array) -> Array:
    """Points at arc lengths ``at`` (s,) of paths with ``knots`` (m + 1, s, d) at ``far``."""
    k = np.clip((far <= at).sum(axis=0) - 1, 0, len(far) - 2)
    every = np.arange(len(at))
    start, end = far[k, every], far[k + 1, every]
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = np.nan_to_num((at - start) / (end - start), posinf=0.0, neginf=0.0)
    return knots[k, every] + fraction[:, None] * (knots[k + 1, every] - knots[k, every])


# Number of points inside a body up to which a path along its surface is not recognized.
FEW_POINTS = 2
UNKNOWN = "the ends of the step do not tell how bodies turned in between"
# Alternatives to the motions of bodies that turn far, as text.
ALTERNATIVES: dict[Alternative, str] = {
    "sense": "the other way round", "centre": "about another centre",
}  # fmt: skip
# Positions of the nodes (n, 2) to overlaps of the nodes that contacts admit, (n,) [length].
AllowedOverlaps = Callable[[Array], Array]


class StepEnds(NamedTuple):
    """Start and end of a step.

    Attributes:
        x0: Positions of the outlines' nodes at the start, shape (n, 2) [length].
        x1: Positions at the end, shape (n, 2) [length].
        prescribed: Whether both components of a node are prescribed, shape (n,), bool.
        before: Places of the obstacles at the start, (obstacles, 3) [length, length, radian].
        after: Places at the end, shape (obstacles, 3).
        known: Motions that rigid boundaries prescribe, by the body that they lead.
        doubtful: Bodies that prescribed values turn by angles that the ends do not tell.
    """

    x0: Array
    x1: Array
    prescribed: Flags
    before: Array
    after: Array
    known: Mapping[int, RigidPath] = {}
    doubtful: Collection[int] = ()


class Passages:
    """Detection of passages; all methods are collective.

    Args:
        outline: The outlines of the bodies.
        contacts: All pairs.
        slaves: Numbers of the slave nodes of each pair in the outlines.
        names: Names of segments, nodes and bodies.
        excused: Overlaps of bodies in the mesh [facets], inf for pairs without messages.
    """

    def __init__(
        self,
        outline: Outline,
        contacts: Sequence[Contact | Tie],
        slaves: Sequence[Indices],
        names: OutlineNames,
        excused: dict[tuple[int, int], float],
    ) -> None:
        self.outline, self._names, self._excused = outline, names, excused
        self._links = (*outline.neighbours(), outline.junctions())
        self._segment_bodies = outline.segment_bodies
        self._obstacles: list[Obstacle] = list(
            dict.fromkeys(c.obstacle for c in contacts if c.obstacle is not None)
        )
        self._on_obstacles = [
            (c, slave)
            for c, slave in zip(contacts, slaves, strict=True)
            if isinstance(c, Contact) and c.obstacle is not None
        ]

    def find(self, ends: StepEnds, allowed: AllowedOverlaps) -> tuple[list[str], list[str]]:
        """Messages on passages; if there are none, on those by alternative motions of bodies.

        Passages that an alternative motion avoids are reported with this condition.

        Args:
            ends: Positions at both ends of the step.
            allowed: Function of the overlaps admitted at the end.
        """
        still = np.array_equal(ends.before, ends.after) and np.array_equal(ends.x0, ends.x1)
        still &= not any(motion.angle for motion in ends.known.values())
        if still or not len(ends.x0):
            return [], []
        paths = self._paths(ends, "")
        found, possible = self._on(paths, ends, allowed), list[str]()
        for other in ALTERNATIVES if paths.may_differ else ():
            messages = self._on(self._paths(ends, other), ends, allowed)
            found, others = found_either_way(found, other, messages)
            possible += others
        return found, possible

    def _paths(self, ends: StepEnds, other: Alternative) -> Paths:
        """The paths of all nodes, with an alternative motion of bodies."""
        resolution = LIMITS.coarse_distance * float(self.outline.lengths(ends.x1).min())
        places = zip(self._obstacles, ends.before, ends.after, strict=True)
        motions = [motion_of(*each) for each in places]
        of_nodes = ends.x0, ends.x1, self.outline.bodies, ends.prescribed
        return Paths(*of_nodes, motions, resolution, other, ends.known, ends.doubtful)

    def _on(self, paths: Paths, ends: StepEnds, allowed: AllowedOverlaps) -> list[str]:
        """Messages on passages on given paths."""
        found, motions = list[str](), paths.motions
        if np.array_equal(ends.x0, ends.x1) and motions.are_small:
            pass
        elif motions.are_small:
            found += self._through_bodies(np.array(ends[:2]), OTHERS, allowed)
            own = np.array([motions.moved_with_own_body(), ends.x1])
            found += self._through_bodies(own, OWN, allowed)
        else:
            for i, body in enumerate(motions.labels):
                frame = paths.frame_of(i)
                along = carry(frame, paths.seen_from(frame))
                marked = self._segment_bodies == body
                found += self._through_bodies(along, ALL, allowed, marked)
        for number, obstacle in enumerate(self._obstacles):
            places = ends.before[number], ends.after[number]
            found += self._at_obstacle(obstacle, places, paths, ends.x1)
        return found

    # Through bodies

    def _through_bodies(
        self, along: Array, which: int, allowed: AllowedOverlaps, marked: Flags | None = None
    ) -> list[str]:
        """Messages on paths ``along`` (m + 1, n, 2) through marked segments (m,), bool.

        ``which``: see ``find_events``.
        """
        rows = self._rows(along, self.outline.bodies, which, marked)
        return self._messages(rows, along[-1], allowed) if len(rows) else []

    def _rows(self, along: Array, node_bodies: Indices, which: int, marked: Flags | None) -> Array:
        """Rows of ``find_passages`` of nodes on paths ``along`` (m + 1, n, 2)."""
        o, bodies, events = self.outline, self._segment_bodies, []
        at = np.arange(len(bodies)) if marked is None else np.flatnonzero(marked)
        for k, (start, end) in enumerate(pairwise(along)):
            rows = find_events(start, end, o.segments[at], bodies[at], node_bodies, which)
            rows[:, 1], rows[:, 2] = at[rows[:, 1].astype(np.int64)], rows[:, 2] + k
            events.append(rows)
        every = np.concatenate(events)
        every = every[np.lexsort((every[:, 2], bodies[every[:, 1].astype(np.int64)], every[:, 0]))]
        if not len(every):
            return np.empty((0, 4))
        lengths = o.lengths(along[-1])
        rows = find_passages(along, o.segments, *self._links, lengths, bodies, every)
        return rows[[row[2] < 0.0 or self._crosses(row, along, lengths) for row in rows]]

    def _crosses(self, row: Array, along: Array, lengths: Array) -> bool:
        """Whether a path through a body leads through its inside, not along its surface.

        Args:
            row: Row of ``find_passages``.
            along: Paths of the nodes, the last positions as those of the body, (m + 1, n, 2).
            lengths: Facet lengths of the segments, shape (segments,) [length].
        """
        node, entry, x = int(row[0]), int(row[1]), along[-1]
        knots, spacing = along[:, node], LIMITS.coarse_distance * lengths[entry]
        sizes = np.hypot(*np.diff(knots, axis=0).T)
        far = np.concatenate([[0.0], np.cumsum(sizes)])
        count = int(min(np.ceil(far[-1] / spacing), LIMITS.max_points))
        at = np.linspace(0.0, far[-1], count + 1)
        points = np.stack([np.interp(at, far, column) for column in knots.T], axis=1)
        segments, body = self.outline.segments, int(self._segment_bodies[entry])
        depths, nearest = depths_in_body(self.outline, x, body, points)
        inside = np.flatnonzero(depths > 0.0)
        if inside.size <= FEW_POINTS:
            return True
        tangents = np.diff(x[segments[nearest[inside]]], axis=1)[:, 0]
        tangents /= np.hypot(*tangents.T)[:, None]
        flips = ((tangents[1:] * tangents[:-1]).sum(axis=1) < OPPOSED)[np.diff(inside) == 1]
        chord = np.hypot(*(points[inside] - points[inside[0]]).T).max()
        least = min(HALF_FACET * lengths[entry], LIMITS.deep * chord)
        return bool(flips.any() or depths.max() > least)

    def _messages(self, rows: Array, x1: Array, allowed: AllowedOverlaps) -> list[str]:
        """Messages on rows of ``find_passages``, one for each pair of bodies."""
        lengths, messages = self.outline.lengths(x1), list[str]()
        node, entry, leaves = (rows[:, k].astype(np.int64) for k in range(3))
        through, depth = leaves >= 0, rows[:, 3]
        pairs = np.stack([self.outline.bodies[node], self._segment_bodies[entry]], axis=1)
        inside = ~through & (pairs[:, 0] != pairs[:, 1])
        inside &= depth - allowed(x1)[node] > HALF_FACET * lengths[entry]
        for marked, ends_inside in ((through, False), (inside, True)):
            for pair in np.unique(pairs[marked], axis=0) if marked.any() else ():
                if self._excused.get((int(pair.min()), int(pair.max()))) == np.inf:
                    continue
                mine = np.flatnonzero(marked & (pairs == pair).all(axis=1))
                first = mine[np.argmax(depth[mine])]
                who = f"{mine.size} nodes of {self._names.node(int(node[first]))}"
                where = x1[node[first]]
                messages.append(self._message(who, rows[first], where, ends_inside=ends_inside))
        return messages

    def _message(self, who: str, row: Array, where: Array, *, ends_inside: bool = False) -> str:
        """Message on a row of ``find_passages`` of a node that ends at ``where`` (2,)."""
        entry, leaves = int(row[1]), int(row[2])
        body, at = self._names.body(int(self._segment_bodies[entry])), format_point(where)
        if ends_inside:
            how = f"into {body}, and one at {at} ended {row[3]:.3g} below its surface"
        else:
            enters, exits = self._names.segment(entry), self._names.segment(leaves)
            how = (
                f"through {body}, entering at {enters} and leaving at {exits}, and "
                f"one at {at} ended {row[3]:.3g} from the facet of entry"
            )
        return f"{who} went {how}, {ADVICE}"

    # Obstacles

    def _at_obstacle(
        self, obstacle: Obstacle, places: tuple[Array, Array], paths: Paths, x1: Array
    ) -> list[str]:
        """Messages on an obstacle between two places (3,): nodes through it, its points."""
        motion = motion_of(obstacle, *places)
        pairs = [pair for pair in self._on_obstacles if pair[0].obstacle is obstacle]
        along = own_frame(obstacle, paths.seen_from([motion]), places[0])
        messages = []
        for contact, there in pairs:
            given = along[:, there], contact.now.offset, contact.slave.nodal_lengths
            name, comm = f"'{contact.slave.name}'", self.outline.comm
            messages += nodes_through(comm, obstacle, given, x1[there], lambda _, n=name: n)  # type: ignore[misc]
        bodies = np.unique(self.outline.bodies[np.concatenate([there for _, there in pairs])])
        points = in_space(obstacle, obstacle.salient_points(), places[0])
        for body in bodies if len(points) else ():
            rows = self._rows_of_points(paths, int(body), motion, points)
            if len(rows):
                first = rows[np.argmax(rows[:, 3])]
                where = motion.carry(points, 1.0)[int(first[0])]
                who = f"{len(rows)} points of obstacle '{obstacle.name}'"
                messages.append(self._message(who, first, where))
        return messages

    def _rows_of_points(self, paths: Paths, body: int, motion: RigidPath, points: Array) -> Array:
        """Rows of ``find_passages`` of points of an obstacle that went through a body.

        A narrow obstacle may pass between the nodes of a body. A row begins with the number of a
        point.
        """
        o, label = self.outline, int(np.searchsorted(paths.motions.labels, body))
        of_points, of_nodes = paths.points_seen_from(label, motion, points)
        mine = of_nodes[:, o.bodies == body].reshape(-1, 2)
        above = of_points.max(axis=0) > mine.min(axis=0)
        below = of_points.min(axis=0) < mine.max(axis=0)
        near = np.flatnonzero((above & below).all(axis=1))
        if not near.size:
            return np.empty((0, 4))
        along = np.concatenate([of_nodes, of_points[:, near]], axis=1)
        # nodes count as nodes of the body, which are not searched in its segments
        node_bodies = np.concatenate([np.full(len(o.X), body), np.full(near.size, -1)])
        rows = self._rows(along, node_bodies, OTHERS, self._segment_bodies == body)
        rows = rows[rows[:, 2] >= 0.0]
        rows[:, 0] = near[rows[:, 0].astype(np.int64) - len(o.X)]
        return rows


def found_either_way(
    found: list[str], other: Alternative, messages: Sequence[str]
) -> tuple[list[str], list[str]]:
    """Messages on passages, and on possible ones (local).

    Args:
        found: Messages on the motions that are taken.
        other: An alternative to these motions.
        messages: Messages on the alternative.
    """
    motion = ALTERNATIVES[other]
    if found:
        unless = "" if messages else f", unless a body turned {motion}"
        return [f"{message}{unless}" for message in found], []
    return found, [f"{UNKNOWN}: if a body turned {motion}, {text}" for text in messages]
