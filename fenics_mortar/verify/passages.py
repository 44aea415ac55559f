# SPDX-License-Identifier: MIT
"""Passages in a step: nodes through bodies and obstacles, points of obstacles through bodies.

Paths lead from the last accepted state to the present one, including rigid moves before the solve.
Since straight paths would shrink a rotating body, those past a body or an obstacle are computed in
its frame, in sections so short that their sagittas are negligible; see ``node_paths``. Those past
obstacles are in ``obstacle_passages``.

A path passes through a body if the outward normals at entry and exit are opposed. It slides along
the body if exit and entry coincide, as for chords of a curve, if the outline between them is within
a facet of the path, as at a tip, if both are on facets at one junction of cracks, or if the path
between them is near the surface, as that of a node on a wheel that turns. Paths that end deep
inside another body are reported as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fenics_mortar.kernels.passage import OPPOSED, find_events, find_passages
from fenics_mortar.utils.arrays import HALF_FACET, Array, Indices
from fenics_mortar.utils.errors import format_point
from fenics_mortar.verify.finding import LIMITS
from fenics_mortar.verify.node_paths import Alternative, Paths, StepEnds, motion_of
from fenics_mortar.verify.obstacle_passages import (
    ADVICE,
    events_on,
    in_space,
    nodes_through,
    own_frame,
    pairs_of_obstacles,
)
from fenics_mortar.verify.overlap import OutlineNames, depths_in_body

if TYPE_CHECKING:
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.contact.tied import Tie
    from fenics_mortar.interface.outline import Outline
    from fenics_mortar.obstacles.obstacle import Obstacle
    from fenics_mortar.verify.node_paths import RigidPath

# Number of points inside a body up to which a path along its surface is not recognized.
FEW_POINTS = 2
UNKNOWN = "the ends of the step do not tell how bodies turned in between"
# Alternatives to the motions of bodies that turn far, as text.
ALTERNATIVES: dict[Alternative, str] = {
    "sense": "the other way round", "centre": "about another centre",
}  # fmt: skip
# Positions of the nodes (n, 2) to overlaps of the nodes that contacts admit, (n,) [length].
AllowedOverlaps = Callable[[Array], Array]


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
        self._obstacles = pairs_of_obstacles(contacts, slaves)

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
        return Paths(ends, self.outline.bodies, motions, resolution, other)

    def _on(self, paths: Paths, ends: StepEnds, allowed: AllowedOverlaps) -> list[str]:
        """Messages on passages on given paths."""
        found, every = list[str](), np.arange(len(ends.x1))
        for i, body in enumerate([] if ends.bodies_rest else paths.motions.labels.tolist()):
            rows = self._rows(paths.seen_from(paths.frame_of(i)), every, body)
            found += self._messages(rows, body, ends.x1, allowed) if len(rows) else []
        for obstacle, *places in zip(self._obstacles, ends.before, ends.after, strict=True):
            found += self._at_obstacle(obstacle, places, paths, ends.x1)
        return found

    # Through bodies

    def _rows(self, along: Array, nodes: Indices, body: int) -> Array:
        """Rows of ``find_passages`` of ``nodes`` (k,) on paths ``along`` (m + 1, n, 2).

        The paths are those in the frame of ``body``, through which they may lead.
        """
        o, bodies = self.outline, self._segment_bodies
        at = np.flatnonzero(bodies == body)
        events = events_on(along, find_events, nodes, o.segments[at])
        events[:, 1] = at[events[:, 1].astype(np.int64)]
        lengths = o.lengths(along[-1])
        rows = find_passages(along, o.segments, *self._links, lengths, bodies, events)
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
        few = points[:: max(int(np.sqrt(count)), 1)]  # most paths are deep inside almost anywhere
        if depths_in_body(self.outline, x, body, few)[0].max() > HALF_FACET * lengths[entry]:
            return True
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

    def _messages(self, rows: Array, body: int, x1: Array, allowed: AllowedOverlaps) -> list[str]:
        """Messages on rows of ``find_passages`` through ``body``, one for each other body."""
        lengths, messages = self.outline.lengths(x1), list[str]()
        node, entry, leaves = (rows[:, k].astype(np.int64) for k in range(3))
        through, depth, others = leaves >= 0, rows[:, 3], self.outline.bodies[node]
        inside = ~through & (others != body)
        inside &= depth - allowed(x1)[node] > HALF_FACET * lengths[entry]
        for marked, ends_inside in ((through, False), (inside, True)):
            for other in np.unique(others[marked]).tolist():
                if self._excused.get((min(body, other), max(body, other))) == np.inf:
                    continue
                mine = np.flatnonzero(marked & (others == other))
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
        self, obstacle: Obstacle, places: list[Array], paths: Paths, x1: Array
    ) -> list[str]:
        """Messages on an obstacle between two places (3,): nodes through it, its points."""
        motion = motion_of(obstacle, *places)
        along = own_frame(obstacle, paths.seen_from([motion]), places[0])
        messages = []
        for contact, there in self._obstacles[obstacle]:
            given = along[:, there], contact.now.offset, contact.slave.nodal_lengths
            name, comm = f"'{contact.slave.name}'", self.outline.comm
            messages += nodes_through(comm, obstacle, given, x1[there], lambda _, n=name: n)  # type: ignore[misc]
        slaves = np.concatenate([there for _, there in self._obstacles[obstacle]])
        bodies = np.unique(self.outline.bodies[slaves])
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
        along = np.concatenate([of_nodes, of_points], axis=1)
        rows = self._rows(along, np.arange(len(o.X), along.shape[1]), body)
        rows = rows[rows[:, 2] >= 0.0]
        rows[:, 0] -= len(o.X)
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
