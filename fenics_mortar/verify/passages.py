# SPDX-License-Identifier: MIT
"""Passages in a step: nodes through bodies and obstacles, points of obstacles through bodies.

Paths lead from the last accepted state to the present one, including rigid moves before the solve.
Since straight paths would shrink a rotating body, those past a body or an obstacle are computed in
its frame, in sections so short that their sagittas are negligible; see ``node_paths``. Those past
obstacles are in ``obstacle_passages``.

A path passes through a body if the outward normals at entry and exit are opposed, and if it leads
deep below the surface or beyond the middle of the body. It slides along the body if exit and entry
coincide, as for chords of a curve, if the outline between them is within a facet of the path, as at
a tip, if both are on facets at one junction of cracks, or if the path between them is near the
surface, as that of a node on a wheel that turns. In the plane paths that end deep inside another
body are reported as well; in space edges of both bodies at which the surface turns are examined,
since two rods may cross without a node of one within the other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fenics_mortar.kernels import passage
from fenics_mortar.kernels.passage import OPPOSED
from fenics_mortar.kernels.space.triangles import nearest_triangle
from fenics_mortar.kernels.tree import build_tree
from fenics_mortar.obstacles.obstacle import Obstacle, is_of_package
from fenics_mortar.obstacles.rigid_motion import at_place, motion_of
from fenics_mortar.utils import arrays
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.errors import format_point
from fenics_mortar.verify.finding import LIMITS
from fenics_mortar.verify.node_paths import Alternative, Paths, StepEnds
from fenics_mortar.verify.obstacle_passages import (
    ADVICE,
    nodes_off_pairs,
    nodes_through,
    pairs_of_obstacles,
)
from fenics_mortar.verify.overlap import OutlineNames, deepest_in_obstacle, depths_in_body

if TYPE_CHECKING:
    from fenics_mortar.contact.interface import Interface

# Points of a path between entry and exit at which its depth is measured.
POINTS_ON_PATH = 9
UNKNOWN = "the ends of the step do not tell how bodies turned in between"
# Alternatives to the motions of bodies that turn far, as text.
ALTERNATIVES: dict[Alternative, str] = {
    "sense": "the other way round", "centre": "about another centre",
}  # fmt: skip
# Positions of the nodes (n, 2) to overlaps of the nodes that contacts admit, (n,) [length].
AllowedOverlaps = Callable[[Array], Array]


class Passed(NamedTuple):
    """Paths through a body, k of them.

    Attributes:
        ends: Ends of the edge on the path; equal for a node, shape (k, 2).
        place: Coordinates at entry and exit, 0 to 1, on the edge, or of a node on the segments in
            the plane, shape (k, 2).
        times: Times of entry and exit, numbers of sections, shape (k, 2).
        facets: Segments or triangles of entry and exit, shape (k, 2); of an edge one beside it.
    """

    ends: Indices
    place: Array
    times: Array
    facets: Indices


class Passages:
    """Detection of passages; all methods are collective.

    Args:
        outline: The outlines of the bodies.
        contacts: All pairs.
        slaves: Numbers of the slave nodes of each pair in the outlines.
        names: Names of segments, nodes and bodies.
        excused: Overlaps of bodies in the mesh [facets], inf for pairs without messages.

    Attributes:
        without_pair: Obstacles, and bodies that have no pair with them but are clear of them in the
            mesh.
    """

    find_events: Callable[..., Array] = staticmethod(passage.find_events)

    def __init__(
        self, outline: Any, contacts: Sequence[Interface], slaves: Sequence[Indices],
        names: OutlineNames, excused: dict[tuple[int, int], float],
    ) -> None:  # fmt: skip
        self.outline, self._names, self._excused = outline, names, excused
        self._obstacles = pairs_of_obstacles(contacts, slaves)
        self._off_pairs, self._of_pairs = list[Flags](), list[Indices]()
        self.without_pair: list[tuple[Obstacle, int]] = []
        for obstacle, pairs in self._obstacles.items():
            of_pairs = np.concatenate([there for _, there in pairs])
            self._of_pairs.append(np.unique(outline.bodies[of_pairs]))
            self._off_pairs.append(np.zeros(len(outline.X), bool))
            if is_of_package(obstacle):  # a user's function need be a distance beside pairs only
                self._off_pairs[-1] = nodes_off_pairs(obstacle, outline, of_pairs)
                self._find_others(obstacle)

    def _find_others(self, obstacle: Obstacle) -> None:
        """Find the bodies without a pair with the last obstacle that are clear of it."""
        o, off = self.outline, self._off_pairs[-1]
        for body in np.setdiff1d(o.bodies[off], self._of_pairs[-1]).tolist():
            if deepest_in_obstacle(obstacle, o, o.X, body)[1] > LIMITS.unpaired:
                off &= o.bodies != body
            else:
                self.without_pair.append((obstacle, body))

    def find(self, ends: StepEnds, allowed: AllowedOverlaps) -> tuple[list[str], list[str]]:
        """Messages on passages; if there are none, on those by alternative motions of bodies.

        Passages that an alternative motion avoids are reported with this condition.

        Args:
            ends: Positions at both ends of the step.
            allowed: Function of the overlaps admitted at the end.
        """
        if ends.at_rest:
            return [], []
        paths = self._paths(ends, "")
        found, possible = list(self._on(paths, ends, allowed)), list[str]()
        for other in paths.alternatives:
            messages = list(self._on(self._paths(ends, other), ends, allowed))
            found, others = found_either_way(found, other, messages)
            possible += others
        return found, possible

    def _paths(self, ends: StepEnds, other: Alternative) -> Paths:
        """The paths of all nodes, with an alternative motion of bodies."""
        resolution = LIMITS.coarse_distance * float(self.outline.lengths(ends.x1).min())
        places = zip(self._obstacles, ends.before, ends.after, strict=True)
        motions = {-1 - number: motion_of(*each) for number, each in enumerate(places)}
        return Paths(ends, self.outline.bodies, motions, resolution, other)

    def _on(self, paths: Paths, ends: StepEnds, allowed: AllowedOverlaps) -> Iterator[str]:
        """Messages on passages on given paths."""
        bodies = [] if ends.bodies_rest else np.unique(self.outline.bodies).tolist()
        for body in bodies:
            yield from self._through_body(paths.seen_from(body), body, ends.x1, allowed)
        for number, (obstacle, place) in enumerate(zip(self._obstacles, ends.before, strict=True)):
            yield from self._at_obstacle(number, obstacle, paths, ends.x1, place)
            yield from self._past_obstacle(number, obstacle, paths, ends.x1, place)

    # Through bodies

    def _through_body(
        self, along: Array, body: int, x1: Array, allowed: AllowedOverlaps
    ) -> Iterator[str]:
        """Messages on passages through ``body``.

        Args:
            along: Positions of the nodes in its frame, shape (m + 1, n, d) [length].
            body: The body.
            x1: Positions of the nodes at the end, shape (n, d) [length].
            allowed: Function of the overlaps admitted at the end.
        """
        o = self.outline
        passed, entered = self.nodes_through(along, body, np.ones(len(x1), bool))
        yield from self._messages("nodes", passed, x1, body)
        entered = entered[o.bodies[entered] != body]
        if not entered.size:
            return
        depths, nearest = depths_in_body(o, x1, body, x1[entered])
        deep = depths - allowed(x1)[entered] > arrays.HALF_FACET * o.lengths(x1)[nearest]
        entered, depths = entered[deep], depths[deep]
        for other in self._others(body, o.bodies[entered]):
            mine = np.flatnonzero(o.bodies[entered] == other)
            first = mine[arrays.first_largest(depths[mine])]
            node = int(entered[first])
            yield (
                f"{mine.size} nodes of {self._names.node(node)} went into {self._names.body(body)}"
                f", and one at {format_point(x1[node])} ended {depths[first]:.3g} below its "
                f"surface, {ADVICE}"
            )

    def nodes_through(self, along: Array, body: int, marked: Flags) -> tuple[Passed, Indices]:
        """Paths of points that lead through a body, and points that are inside at the end (local).

        Args:
            along: Positions of the outlines' nodes, and of other points after them, in the frame of
                the body, shape (m + 1, n + k, d) [length].
            body: The body.
            marked: Points to follow, shape (n + k,), bool.

        Returns:
            The paths, and the numbers of points whose last event is an entry.
        """
        o, at = self.outline, np.flatnonzero(marked)
        mine = np.flatnonzero(o.segment_bodies == body)
        rows = events_on(along, self.find_events, at[:, None], o.segments[mine], along[0])
        point, rows[:, 1] = at[rows[:, 0].astype(np.int64)], mine[rows[:, 1].astype(np.int64)]
        begins, leaves = np.diff(rows[:, 0], prepend=-1.0) != 0.0, rows[:, 3] < 0.0
        ends = np.roll(begins, -1)
        exits = np.flatnonzero(leaves & ~begins & ~np.roll(leaves, 1))
        starts = np.flatnonzero(leaves & begins)  # inside: in contact or overlapping
        nearest, place = self._nearest(along[0], body, point[starts])
        entries = rows[starts].copy()
        entries[:, 1], entries[:, 2], entries[:, 4] = nearest, 0.0, place
        starts, entries = starts[nearest >= 0], entries[nearest >= 0]
        firsts = ~leaves & (begins | np.roll(leaves, 1))  # entries with none before, or an exit
        first = np.maximum.accumulate(np.where(firsts, np.arange(len(rows)), 0))
        entries = np.concatenate([rows[first[exits - 1]], entries])
        both = np.stack([entries, rows[np.concatenate([exits, starts])]], axis=1)
        normals = [o.normals(x, both[:, :, 1].astype(np.int64)) for x in (along[0], along[-1])]
        passed = opposed(both, at[:, None], self._corners, normals)
        return self._deep(self._off_tips(passed, along[-1]), along, body), point[ends & ~leaves]

    @cached_property
    def _corners(self) -> Indices:
        """Nodes of the segments, (m, 2), those at a junction of cracks as one node.

        Parts that meet there overlap by less than a facet.
        """
        at = self.outline.junctions()
        return np.where(at < 0, np.arange(len(at)), at)[self.outline.segments]

    def _nearest(self, x: Array, body: int, nodes: Indices) -> tuple[Indices, Array]:
        """Facets of ``body`` nearest to ``nodes`` (k,), -1 for none, coordinates on them, (k,).

        Nodes that begin on the surface up to rounding may be outside.
        """
        mine = np.flatnonzero(self.outline.segment_bodies == body)
        at, place = passage.nearest_to_nodes(x, self.outline.segments[mine], nodes).T
        return np.where(at < 0.0, -1, mine[at.astype(np.int64)]), place

    def _off_tips(self, passed: Passed, x: Array) -> Passed:
        """Paths that do not lead round a tip, nodes at ``x`` (n, 2) [length]."""
        o = self.outline
        if not len(passed.ends):
            return passed
        given = o.neighbours(), o.lengths(x), passed.facets, passed.place
        return arrays.at_rows(passed, ~passage.lead_round(x, o.segments, *given))

    def _deep(self, passed: Passed, along: Array, body: int) -> Passed:
        """Those paths that lead deep below the surface of the body, not along it."""
        if not len(passed.ends):
            return passed
        _, group = np.unique(passed.times.mean(axis=1), return_inverse=True)
        deep = np.zeros(len(group), bool)
        for number in range(group.max() + 1):  # the body deforms, and paths pass at their times
            mine = group == number
            deep[mine] = self._are_deep(arrays.at_rows(passed, mine), along, body)
        return arrays.at_rows(passed, deep)

    def _are_deep(self, passed: Passed, along: Array, body: int) -> Flags:
        """Whether paths lead deep below the surface of the body at their mean time, (k,), bool."""
        x = _at(along, passed.times.mean(keepdims=True)[0], np.arange(along.shape[1])[None])[0]
        points = np.moveaxis(_on_paths(passed, along), 0, 1)
        depths, nearest = depths_in_body(self.outline, x, body, points.reshape(-1, x.shape[1]))
        depths, nearest = depths.reshape(points.shape[:2]), nearest.reshape(points.shape[:2])
        chords = arrays.norms(points[:, -1] - points[:, 0])
        sizes = self.outline.lengths(x)[passed.facets[:, 0]]
        least = np.minimum(arrays.HALF_FACET * sizes, LIMITS.deep * chords)
        least[self._cross_the_middle(x, depths > 0.0, nearest)] = 0.0
        return np.asarray(depths.max(axis=1) > np.maximum(least, arrays.SOLVED * sizes))

    def _cross_the_middle(self, x: Array, inside: Flags, nearest: Indices) -> Flags:
        """Whether the sides of a body nearest to two successive points inside it are opposed, (k,).

        Args:
            x: Positions of the nodes, shape (n, d) [length].
            inside: Whether points of k paths are inside, shape (k, p), bool.
            nearest: The nearest facets, shape (k, p).
        """
        normals = self.outline.normals(x, nearest)
        cosines = np.einsum("kpc,kpc->kp", normals[:, 1:], normals[:, :-1])
        return np.asarray((inside[:, 1:] & inside[:, :-1] & (cosines < OPPOSED)).any(axis=1))

    def _others(self, body: int, bodies: Indices) -> list[int]:
        """Those of ``bodies`` (k,) that are not deep in ``body`` in the mesh."""
        pairs = {other: (min(body, other), max(body, other)) for other in set(bodies.tolist())}
        return sorted(other for other in pairs if self._excused.get(pairs[other]) != np.inf)

    def _messages(self, what: str, passed: Passed, x: Array, body: int) -> Iterator[str]:
        """A message on each body of which nodes or edges passed through ``body``."""
        of_paths = self.outline.bodies[passed.ends[:, 0]]
        for other in self._others(body, of_paths):
            yield self.message(what, arrays.at_rows(passed, of_paths == other), x, body)

    def message(self, what: str, passed: Passed, x: Array, body: int, owner: str = "") -> str:
        """Message on paths through a body.

        Args:
            what: Nodes, edges or points.
            passed: The paths.
            x: Positions at the end in space, shape (n + k, d) [length].
            body: The body.
            owner: What they belong to; by default its name by the path that ended farthest away.
        """
        ends = x[passed.ends].mean(axis=1)
        away = arrays.norms(ends - x[self.outline.segments[passed.facets[:, 0]]].mean(axis=1))
        first = np.argmax(away)
        enters, leaves = (self._names.segment(int(facet)) for facet in passed.facets[first])
        owner = owner or self._names.node(int(passed.ends[first, 0]))
        count = len(np.unique(passed.ends, axis=0))
        return (
            f"{count} {what} of {owner} went through {self._names.body(body)}, entering at "
            f"{enters} and leaving at {leaves}, and one at {format_point(ends[first])} ended "
            f"{away[first]:.3g} from the middle of the facet of entry, {ADVICE}"
        )

    # Obstacles

    def _at_obstacle(
        self, number: int, obstacle: Obstacle, paths: Paths, x1: Array, place: Array
    ) -> Iterator[str]:
        """Messages on nodes through obstacle ``number``, or on it through bodies.

        ``place``: its place at the start, shape (m,).
        """
        pairs, seen = self._obstacles[obstacle], paths.seen_from(-1 - number)
        with at_place(obstacle, place):
            along = obstacle.to_own_frame(seen)
            points = obstacle.to_space(obstacle.salient_points())
        for contact, there in pairs:
            given = along[:, there], contact.now.offset, contact.slave.nodal_lengths
            name, comm = f"'{contact.slave.name}'", self.outline.comm
            yield from nodes_through(comm, obstacle, given, x1[there], lambda _, n=name: n)  # type: ignore[misc]
        if len(points):
            at = -1 - number, obstacle, points
            yield from self.points_through(paths, *at, self._of_pairs[number].tolist(), x1)

    def _past_obstacle(
        self, number: int, obstacle: Obstacle, paths: Paths, x1: Array, place: Array
    ) -> Iterator[str]:
        """The same of nodes off its pairs, and of bodies without a pair with it."""
        at = np.flatnonzero(self._off_pairs[number])
        seen = paths.seen_from(-1 - number)[:, at]
        with at_place(obstacle, place):
            along = obstacle.to_own_frame(seen)
            points = obstacle.to_space(obstacle.salient_points())
        given = along, np.zeros(at.size), self.outline.node_sizes(x1)[at]
        comm, names = self.outline.comm, self._names
        yield from nodes_through(
            comm, obstacle, given, x1[at], lambda first: names.node(int(at[first]))
        )
        others = [body for each, body in self.without_pair if each is obstacle]
        if len(points) and others:
            yield from self.points_through(paths, -1 - number, obstacle, points, others, x1)

    def points_through(
        self, paths: Paths, label: int, obstacle: Obstacle, points: Array, bodies: Iterable[int],
        x1: Array,
    ) -> Iterator[str]:  # fmt: skip
        """Messages on points of an obstacle that went through bodies.

        A narrow obstacle may pass between the nodes of a body.

        Args:
            paths: Paths of the nodes and the obstacles.
            label: Label of the obstacle there.
            obstacle: The obstacle.
            points: Its points at the start, shape (k, d) [length].
            bodies: The bodies.
            x1: Positions of the nodes at the end, shape (n, d) [length].
        """
        ends = np.concatenate([x1, paths.motions[label].carry(points, 1.0)])
        for body in bodies:
            of_points, of_nodes = paths.points_seen_from(body, label, points)
            moved = np.abs(of_points - of_points[0]).max(axis=(0, 2))
            moved = moved > arrays.ROUNDING * np.abs(of_points).max(initial=0.0)
            along = np.concatenate([of_nodes, of_points], axis=1)
            marked = np.concatenate([np.zeros(len(x1), bool), moved])
            passed, _ = self.nodes_through(along, body, marked)
            if len(passed.ends):
                yield self.message("points", passed, ends, body, f"obstacle '{obstacle.name}'")


class SpacePassages(Passages):
    """Detection of passages in space; see ``Passages``.

    Args:
        given: Arguments of ``Passages``.
        obstacles: The ``SpaceObstacle`` of all pairs.
    """

    find_events = staticmethod(passage.find_events_in_space)

    def __init__(self, *given: Any, obstacles: Sequence[Any]) -> None:
        super().__init__(*given)
        self._in_space = obstacles
        for off, of_pairs in zip(self._off_pairs, self._of_pairs, strict=True):
            off &= ~np.isin(self.outline.bodies, of_pairs)  # their nodes are followed there
        self._corners = self.outline.segments

    def _through_body(self, along: Array, body: int, x1: Array, _: Any) -> Iterator[str]:
        bodies, (edges, _) = self.outline.bodies, self.outline.edges
        near = self._near(along, body, edges)
        if not near.any():
            return
        nodes, _ = self.nodes_through(
            along, body, self._near(along, body, np.arange(len(x1))[:, None])
        )
        sharp = self._edges_through(along, body, near)
        new = ~np.isin(bodies[sharp.ends[:, 0]], bodies[nodes.ends[:, 0]])
        yield from self._messages("nodes", nodes, x1, body)
        yield from self._messages("edges", arrays.at_rows(sharp, new), x1, body)

    def _near(self, along: Array, body: int, movers: Indices) -> Flags:
        """Whether paths of nodes or edges (k, c) of others meet the box of a body, (k,), bool."""
        bodies, low, high = self.outline.bodies, along.min(axis=0), along.max(axis=0)
        lowest, highest = low[bodies == body].min(axis=0), high[bodies == body].max(axis=0)
        meets = (high[movers].max(axis=1) >= lowest) & (low[movers].min(axis=1) <= highest)
        return np.asarray(meets.all(axis=1) & (bodies[movers[:, 0]] != body))

    def _nearest(self, x: Array, body: int, nodes: Indices) -> tuple[Indices, Array]:
        mine = np.flatnonzero(self.outline.segment_bodies == body)
        triangles, size = self.outline.segments[mine], self.outline.lengths(x)[mine].max()
        boxes = build_tree(x, triangles)
        at = triangles, boxes, np.empty(len(boxes) // 2, np.int64)
        nearest = [nearest_triangle(x, *at, p, size)[1] for p in x[nodes]]
        return mine[np.array(nearest, np.int64)], np.zeros(len(nodes))

    def _off_tips(self, passed: Passed, _: Array) -> Passed:
        return passed

    def _edges_through(self, along: Array, body: int, near: Flags) -> Passed:
        """Paths of edges that enter and leave a body at edges, deep below its surface."""
        hull = self.outline
        edges, beside = hull.edges
        sharp = self._are_sharp(along[0])
        others = np.flatnonzero(sharp & (hull.bodies[edges[:, 0]] == body))
        at = edges[sharp & near]
        normals = [hull.normals(x, beside[others]).sum(axis=1) for x in (along[0], along[-1])]
        normals = [n / arrays.norms(n)[:, None] for n in normals]
        rows = events_on(along, self.find_events, at, edges[others], normals[0])
        pairs = [
            (i, j)
            for j in np.flatnonzero(rows[:, 3] < 0.0)
            for i in range(int(np.searchsorted(rows[:, 0], rows[j, 0])), j)
            if rows[i, 3] > 0.0
        ]
        both = rows[np.array(pairs, np.int64).reshape(-1, 2)]
        sides = both[:, :, 1].astype(np.int64)
        passed = opposed(both, at, edges[others], [n[sides] for n in normals])
        passed = passed._replace(facets=beside[others[passed.facets], 0])
        return self._deep(passed, along, body)

    def _are_sharp(self, x: Array) -> Flags:
        """Whether the surface turns at edges, to the inside, nodes at ``x`` (n, 3), (k,), bool."""
        hull = self.outline
        edges, beside = hull.edges
        middles = x[hull.segments].mean(axis=1)
        normals = hull.normals(x)[beside[:, 0]]
        across = middles[beside[:, 1]] - x[edges[:, 0]]
        convex = np.einsum("ec,ec->e", normals, across) < 0.0
        return np.asarray(convex & (hull.turns(x) > arrays.SMALL_ANGLE))

    def _at_obstacle(
        self, number: int, obstacle: Obstacle, paths: Paths, x1: Array, place: Array
    ) -> Iterator[str]:
        found, label = self._in_space[number], -1 - number
        seen, motion = paths.seen_from(label)[:, found.counted], paths.motions[label]
        messages = found.passages(seen, place, x1)
        yield from messages
        if not messages:
            points = motion.back(found.points(x1, motion.carry(seen.reshape(-1, 3), 1.0)), 1.0)
            at = label, obstacle, points, found.bodies.tolist()
            yield from self.points_through(paths, *at, x1)


def events_on(along: Array, find: Callable[..., Array], *given: Any) -> Array:
    """Events of all sections of a step, by path and time, in numbers of sections (local).

    Args:
        along: Positions at the ends of the sections, shape (m + 1, n, d) [length].
        find: Kernel that returns rows (path, facet, time, ...) of a section.
        given: Its arguments after the positions at both ends of a section.
    """
    rows = [find(*ends, *given) for ends in pairwise(along)]
    for k, events in enumerate(rows):
        events[:, 2] += k
    every = np.concatenate(rows)
    return every[np.lexsort((every[:, 2], every[:, 0]))]


def opposed(both: Array, movers: Indices, targets: Indices, normals: Sequence[Array]) -> Passed:
    """Paths with opposed normals at entry and exit at both ends of the step (local).

    Not those that lead round an edge: entry and exit have a common node.

    Args:
        both: Rows of events at entry and exit, shape (k, 2, 5).
        movers: Nodes, shape (p, 1), or edges, shape (p, 2).
        targets: Nodes of the facets or edges, shape (m, c).
        normals: Outward normals there at the start and at the end, shape (k, 2, d) each [1].
    """
    ends = movers[both[:, 1, 0].astype(np.int64)][:, [0, -1]]
    enters, leaves = sides = both[:, :, 1].astype(np.int64).T
    cosines = [(n[:, 0] * n[:, 1]).sum(axis=1) for n in normals]
    share = targets[enters][:, :, None] == targets[leaves][:, None]
    passed = Passed(ends, both[:, :, 4], both[:, :, 2], sides.T)
    return arrays.at_rows(passed, (np.maximum(*cosines) < OPPOSED) & ~share.any(axis=(1, 2)))


def _at(along: Array, times: Array, nodes: Indices) -> Array:
    """Positions of ``nodes`` (t, n) at ``times`` (t,), numbers of sections, (t, n, 3) [length]."""
    k = np.minimum(times.astype(np.int64), len(along) - 2)[:, None]
    part = times[:, None, None] - k[..., None]
    return np.asarray((1.0 - part) * along[k, nodes] + part * along[k + 1, nodes])


def _on_paths(passed: Passed, along: Array) -> Array:
    """Points on paths between entry and exit, (POINTS_ON_PATH, k, 3) [length]."""
    found = []
    for part in np.linspace(0.0, 1.0, POINTS_ON_PATH):
        times, place = (
            (1.0 - part) * ends[:, 0] + part * ends[:, 1] for ends in (passed.times, passed.place)
        )
        ends = _at(along, times, passed.ends)
        found.append((1.0 - place)[:, None] * ends[:, 0] + place[:, None] * ends[:, 1])
    return np.array(found)


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
