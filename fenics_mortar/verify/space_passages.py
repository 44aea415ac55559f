# SPDX-License-Identifier: MIT
"""Passages in a step in space: nodes and edges of bodies through other bodies.

Paths lead from the last accepted state to the present one, and are seen from
the body that they may pass through. As in the plane, see ``passages``, a path passes through a body
if the outward normals at entry and exit are opposed, and if it leads deep below the surface: not
along it, and not round an edge. Edges of both bodies at which the surface turns are examined as
well, since two rods may cross without a node of one within the other.

Paths of the nodes of hulls in a step in space, from its ends.

Each body moves rigidly, with the rotation that fits its two positions best, at constant speeds
about the shortest way or, of a body on a rigid boundary, by the known angle, and is strained at a
constant rate in its own frame. The step is divided into sections in which bodies turn little, so
that nodes move straight within each of them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from fenics_mortar.interface.hull import Hull
from fenics_mortar.kernels.passage import OPPOSED
from fenics_mortar.kernels.space.inside import depths_inside
from fenics_mortar.kernels.space.passage import find_edge_events, find_node_events
from fenics_mortar.kernels.tree import build_tree
from fenics_mortar.obstacles.rotations import polar_rotation, vector_of
from fenics_mortar.utils.arrays import Array, Flags, Indices, norms
from fenics_mortar.utils.rounding import HALF_FACET, SMALL_ANGLE, TINY
from fenics_mortar.verify.finding import LIMITS
from fenics_mortar.verify.node_paths import NONE_KNOWN, RigidPath
from fenics_mortar.verify.overlap import OutlineNames, depths_in_body
from fenics_mortar.verify.through_obstacles import ADVICE


def motion_between(x0: Array, x1: Array) -> RigidPath:
    """The rigid motion that fits two positions (n, 3) of a body best (Kabsch 1976)."""
    start, end = x0.mean(axis=0), x1.mean(axis=0)
    turn = vector_of(polar_rotation((x1 - end).T @ (x0 - start)))
    return RigidPath(start, end, turn if np.linalg.norm(turn) >= SMALL_ANGLE else np.zeros(3))


class SpacePaths:
    """Positions of all nodes at the ends of the sections of a step.

    Args:
        x0: Positions at the start, shape (n, 3) [length].
        x1: Positions at the end, shape (n, 3) [length].
        bodies: Body of each node, shape (n,).
        obstacles: Motions of obstacles, by labels that are no bodies.
        resolution: Largest distance of a path from its straight sections [length].
        known: Known motions of bodies, with rotations of any size.
        backwards: Bodies that turn the other way than the shortest one.

    Attributes:
        motions: Motions of bodies and obstacles.
        times: Ends of the sections, shape (sections + 1,), from 0 to 1.
        along: Positions at these times, shape (sections + 1, n, 3) [length].
    """

    def __init__(
        self,
        x0: Array,
        x1: Array,
        bodies: Indices,
        obstacles: Mapping[int, RigidPath],
        resolution: float,
        known: Mapping[int, RigidPath] = NONE_KNOWN,
        backwards: Collection[int] = (),
    ) -> None:
        self.motions: dict[int, RigidPath] = {**obstacles, **known}
        for body in np.unique(bodies).tolist():
            if body not in known:
                motion = motion_between(x0[bodies == body], x1[bodies == body])
                self.motions[body] = motion.backwards() if body in backwards else motion
        self.times = np.linspace(0.0, 1.0, self._count(x0, resolution) + 1)
        self.along = np.empty((len(self.times), *x0.shape))
        for body in np.unique(bodies).tolist():
            at, motion = bodies == body, self.motions[body]
            strain = motion.back(x1[at], 1.0) - x0[at]
            for k, time in enumerate(self.times):
                self.along[k, at] = motion.carry(x0[at] + time * strain, time)

    def _count(self, x0: Array, resolution: float) -> int:
        """Number of sections: the sagitta of a chord of angle a is r a^2 / 8."""
        count = 1
        for motion in self.motions.values():
            reach = norms(x0 - motion.start).max(initial=TINY)
            largest = max(min(np.sqrt(8.0 * resolution / reach), LIMITS.section_turn), TINY)
            count = max(count, int(min(np.ceil(motion.angle / largest), LIMITS.max_points)))
        return count

    def carried(self, motion: RigidPath, points: Array) -> Array:
        """Positions of points (k, 3) [length] at the start moved along, (sections + 1, k, 3)."""
        return np.array([motion.carry(points, time) for time in self.times])

    def seen_from(self, label: int, along: Array | None = None) -> Array:
        """Positions in the frame of a body or an obstacle, shape (sections + 1, n, 3) [length].

        They are moved with it to the start of the step.

        Args:
            label: Label of the body or the obstacle.
            along: Positions in space at the ends of the sections; those of all nodes by default.
        """
        motion = self.motions[label]
        frames = zip(self.along if along is None else along, self.times, strict=True)
        return np.array([motion.back(x, time) for x, time in frames])


# Points of a path between entry and exit at which its depth is measured.
POINTS_ON_PATH = 9


class Passed(NamedTuple):
    """Paths through a body, k of them.

    Attributes:
        ends: Ends of the edge on the path; equal for a node, shape (k, 2).
        place: Coordinates on the edge at entry and exit, 0 to 1, shape (k, 2).
        times: Times of entry and exit, numbers of sections, shape (k, 2).
        enters: Nodes of the triangle or edge of entry, shape (k, 3).
        leaves: Those of exit, shape (k, 3).
    """

    ends: Indices
    place: Array
    times: Array
    enters: Indices
    leaves: Indices

    def select(self, marked: Flags) -> Passed:
        """Some of the paths."""
        each: Any = (values[marked] for values in self)
        return Passed(*each)


class SpacePassages:
    """Detection of passages; see ``passages.Passages``.

    Args:
        hull: The hulls of the bodies.
        names: Names of nodes and bodies.
        excused: Overlaps of bodies in the mesh [facets], inf for pairs without messages.
    """

    def __init__(
        self, hull: Hull, names: OutlineNames, excused: dict[tuple[int, int], float]
    ) -> None:
        self._hull, self._names, self._excused = hull, names, excused

    def find(self, paths: SpacePaths) -> list[str]:
        """Messages on passages of nodes and edges through bodies in a step (collective)."""
        hull, messages = self._hull, list[str]()
        for body in np.unique(hull.bodies).tolist():
            along = paths.seen_from(body)
            nodes, edges = self._near(along, body)
            if not edges.any():
                continue
            through_nodes = self.nodes_through(along, body, nodes)
            through_edges = self._deep(self._edges_through(along, body, edges), along, body)
            told = np.unique(hull.bodies[through_nodes.ends[:, 0]])
            new = ~np.isin(hull.bodies[through_edges.ends[:, 0]], told)
            for what, passed in (("nodes", through_nodes), ("edges", through_edges.select(new))):
                messages += self._messages(what, passed, along, body)
        return messages

    def nodes_through(self, along: Array, body: int, marked: Flags) -> Passed:
        """Paths of points that lead through a body, deep below its surface (local).

        Args:
            along: Positions of the hull's nodes, and of other points after them, in the frame of
                the body, shape (sections + 1, n + k, 3) [length].
            body: The body.
            marked: Points to follow, shape (n + k,), bool.
        """
        return self._deep(self._nodes_through(along, body, marked), along, body)

    def _near(self, along: Array, body: int) -> tuple[Flags, Flags]:
        """Nodes (n,) and edges (k,) of others whose paths meet the box of a body, bool."""
        edges, bodies = self._hull.edges[0], self._hull.bodies
        low, high = along.min(axis=0), along.max(axis=0)
        lowest, highest = low[bodies == body].min(axis=0), high[bodies == body].max(axis=0)
        nodes = ((high >= lowest) & (low <= highest)).all(axis=1)
        begins, ends = low[edges].min(axis=1), high[edges].max(axis=1)
        of_edges = ((ends >= lowest) & (begins <= highest)).all(axis=1)
        return nodes & (bodies != body), of_edges & (bodies[edges[:, 0]] != body)

    def _nodes_through(self, along: Array, body: int, nodes: Flags) -> Passed:
        """Paths of nodes with opposed normals at entry and exit."""
        hull, mine = self._hull, np.flatnonzero(self._hull.segment_bodies == body)
        triangles, at = hull.segments[mine], np.flatnonzero(nodes)
        rows = [find_node_events(*ends, at, triangles) for ends in pairwise(along)]
        every = _in_order(rows)
        node, of_triangle, time, sign = every[:, 0].astype(np.int64), every[:, 1], *every.T[2:]
        triangle = of_triangle.astype(np.int64)
        same = np.concatenate([[False], node[1:] == node[:-1]])
        exits = np.flatnonzero((sign < 0.0) & (np.roll(sign, 1) > 0.0) & same)
        begins = np.flatnonzero((sign < 0.0) & ~same)
        boxes = build_tree(along[0], triangles)
        size = float(np.median(hull.lengths(along[0])[mine]))
        _, nearest = depths_inside(along[0], triangles, boxes, along[0][node[begins]], size)
        begins, nearest = begins[nearest >= 0], nearest[nearest >= 0]
        rows_of_exit = np.concatenate([exits, begins])
        entry = np.concatenate([triangle[exits - 1], nearest])
        times = np.concatenate([time[exits - 1], np.zeros(len(begins))]), time[rows_of_exit]
        leaves = triangle[rows_of_exit]
        ends = np.repeat(node[rows_of_exit][:, None], 2, axis=1)
        place = np.zeros(ends.shape)
        passed = Passed(ends, place, np.stack(times, 1), triangles[entry], triangles[leaves])
        normals = [hull.normals(x)[mine] for x in (along[0], along[-1])]
        return passed.select(_are_opposed(normals, entry, leaves) & ~_share(passed))

    def _edges_through(self, along: Array, body: int, near: Flags) -> Passed:
        """Paths of edges with opposed normals at entry and exit at edges."""
        hull = self._hull
        edges, beside = hull.edges
        sharp = self._are_sharp(along[0])
        others = np.flatnonzero(sharp & (hull.bodies[edges[:, 0]] == body))
        at = np.flatnonzero(sharp & near)
        normals = [hull.normals(x)[beside[others]].sum(axis=1) for x in (along[0], along[-1])]
        for n in normals:
            n /= np.linalg.norm(n, axis=1)[:, None]
        every = _in_order(
            [
                find_edge_events(*ends, edges[at], edges[others], normals[0])
                for ends in pairwise(along)
            ]
        )
        edge, other = every[:, 0].astype(np.int64), every[:, 1].astype(np.int64)
        pairs = [
            (i, j)
            for j in np.flatnonzero(every[:, 3] < 0.0)
            for i in range(int(np.searchsorted(edge, edge[j])), j)
            if every[i, 3] > 0.0
        ]
        i, j = np.array(pairs, np.int64).reshape(-1, 2).T
        both = np.stack([i, j], axis=1)
        e, f = (
            np.concatenate([p, p[:, :1]], axis=1) for p in edges[others[other[both]]].swapaxes(0, 1)
        )
        passed = Passed(edges[at[edge[j]]], every[both, 4], every[both, 2], e, f)
        return passed.select(_are_opposed(normals, other[i], other[j]) & ~_share(passed))

    def _are_sharp(self, x: Array) -> Flags:
        """Whether the surface turns at edges, to the inside, nodes at ``x`` (n, 3), (k,), bool."""
        hull = self._hull
        edges, beside = hull.edges
        middles = x[hull.segments].mean(axis=1)
        normals = hull.normals(x)[beside[:, 0]]
        across = middles[beside[:, 1]] - x[edges[:, 0]]
        convex = np.einsum("ec,ec->e", normals, across) < 0.0
        return np.asarray(convex & (hull.turns(x) > SMALL_ANGLE))

    def _deep(self, passed: Passed, along: Array, body: int) -> Passed:
        """Those paths that lead deep below the surface of the body, not along it."""
        if not len(passed.ends):
            return passed
        hull = self._hull
        x = _at(along, passed.times.mean(keepdims=True)[0], np.arange(along.shape[1])[None])[0]
        points = np.moveaxis(_on_paths(passed, along), 0, 1)
        depths = depths_in_body(hull, x, body, points.reshape(-1, 3))[0].reshape(points.shape[:2])
        chords = norms(points[:, -1] - points[:, 0])
        least = np.minimum(
            HALF_FACET * hull.node_sizes(x)[passed.enters[:, 0]], LIMITS.deep * chords
        )
        return passed.select((depths.max(axis=1) > least) & (least > 0.0))

    def _messages(self, what: str, passed: Passed, along: Array, body: int) -> Iterator[str]:
        """A message on each other body of which nodes or edges passed through ``body``."""
        of_paths = self._hull.bodies[passed.ends[:, 0]]
        for other in np.unique(of_paths).tolist():
            if self._excused.get((min(body, other), max(body, other))) == np.inf:
                continue
            mine = passed.select(of_paths == other)
            who = f"{len(np.unique(mine.ends, axis=0))} {what} of "
            yield self.message(who + self._names.node(int(mine.ends[0, 0])), mine, along[-1], body)

    def message(self, who: str, passed: Passed, x: Array, body: int) -> str:
        """Message on paths through ``body`` of points that end at ``x`` (n + k, 3) [length]."""
        distances = norms(x[passed.ends].mean(axis=1) - x[passed.enters].mean(axis=1))
        first = np.argmax(distances)
        enters, leaves = (self._names.node(int(nodes[first, 0])) for nodes in passed[3:])
        return (
            f"{who} went through {self._names.body(body)}, entering at {enters} and leaving at "
            f"{leaves}, and one ended {distances[first]:.3g} from the facet of entry, {ADVICE}"
        )


def _in_order(rows: list[Array]) -> Array:
    """Events of all sections, by path and time; times become numbers of sections."""
    for k, events in enumerate(rows):
        events[:, 2] += k
    every = np.concatenate(rows)
    return every[np.lexsort((every[:, 2], every[:, 0]))]


def _are_opposed(normals: list[Array], entry: Indices, leaves: Indices) -> Flags:
    """Whether normals (m, 3) at entry and exit are opposed at both ends of the step, (k,), bool."""
    cosines = [np.einsum("kc,kc->k", n[entry], n[leaves]) for n in normals]
    return np.asarray(np.maximum(*cosines) < OPPOSED)


def _share(passed: Passed) -> Flags:
    """Whether entry and exit have a common node: the path leads round an edge, (k,), bool."""
    return np.asarray(
        (passed.enters[:, :, None] == passed.leaves[:, None, :]).any(axis=(1, 2)), bool
    )


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
