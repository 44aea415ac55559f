# SPDX-License-Identifier: MIT
"""Crossed surfaces: overlapping outlines in a state, and passages of nodes in a step.

After each solve all exterior facets of the bodies in pairs are checked, against other bodies and
their own body, independently of the search for partners.

**State**: depth of two outlines in each other where they cross, in facets. Faceted curves in
contact overlap by their sagitta, and between nodes dual multipliers admit overlaps of this size;
the limits are those of the penetration of a pair.

**Step**: paths of nodes are straight from the last accepted state to the present one, including
rigid moves before the solve. Since straight paths would shrink a rotating body, paths relative to
it are computed in the frame that rotates with it, in several sections. A path passes through a body
if the outward normals at entry and exit are opposed. It slides along the body if exit and entry
coincide, as for chords of a curve, or if the outline between them is within a facet of the path, as
at a tip. Paths that end deep inside another body are reported as well.

Cost on two blocks (``demos.studies.performance.crossing``): 0.9 ms with 10,500 unknowns (1.9 % of a
Newton iteration), 2.6 ms with 161,000 (0.4 %). Rotating bodies cost more: 30 bricks with 1,200
segments 2 ms, rotated by more than 1 degree 10 ms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product

import numpy as np
import numpy.typing as npt

from fenics_mortar.bulk.bodies import label_bodies
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.outline import Outline, extract_outline
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.kernels.crossing import find_crossings
from fenics_mortar.kernels.passage import ALL, OTHERS, OWN, find_events, find_passages
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.utils.arrays import Array, Value
from fenics_mortar.utils.errors import call_together, format_point
from fenics_mortar.utils.rounding import HALF_FACET
from fenics_mortar.verify.node_paths import Motions, own_frame, passed_through
from fenics_mortar.verify.obstacle_points import deepest_point
from fenics_mortar.verify.outline_names import OutlineNames


@dataclass(frozen=True)
class Crossing:
    """Deepest crossing of the outlines of two bodies, or of one outline with itself.

    Attributes:
        sides: Names of the surfaces, or of the bodies outside surfaces of pairs.
        where: Position, as text.
        depth: Depth of one body in the other [length].
        facets: Depth over the facet's length [1].
    """

    sides: tuple[str, str]
    where: str
    depth: float
    facets: float

    def __str__(self) -> str:
        """The crossing as text."""
        first, second = self.sides
        who = f"{first} crosses itself" if first == second else f"{first} and {second} cross"
        return f"{who} at {self.where}, {self.depth:.3g} deep ({self.facets:.1f} facets)"


@dataclass(frozen=True)
class AcceptedPositions(Value):
    """Positions of outlines and obstacles at the last accepted state (local).

    Attributes:
        x: Positions of the outlines' nodes, shape (n, 2) [length].
        places: Places (x, y, angle) of the obstacles, shape (obstacles, 3) [length, length,
            radian].
    """

    x: Array
    places: Array


class Crossings:
    """Detection of crossings and passages; all methods are collective.

    Args:
        bulk: The bulk equations.
        contacts: All pairs.
        floating: Bodies and their names.

    Attributes:
        accepted: Positions at the start of the step.
    """

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Contact | Tie], floating: FloatingBodies
    ) -> None:
        self._bulk, self._contacts = bulk, contacts
        self._labels, _ = label_bodies(bulk.V)
        sides = [[self._bodies_of(side) for side in (c.slave, c.master)] for c in contacts]
        self._paired = {
            (min(one, other), max(one, other))
            for contact, (slave, master) in zip(contacts, sides, strict=True)
            for one, other in product(slave, master)
            if not isinstance(contact, Tie)
        }
        bodies = np.array(sorted({body for pair in sides for side in pair for body in side}))
        self.outline: Outline = extract_outline(bulk.space, self._labels, bodies)
        self._links = self.outline.neighbours()
        self._segment_bodies = self.outline.segment_bodies
        self._slaves = [self.outline.indices_of(contact.slave.nodes) for contact in contacts]
        self._free: Array = 1.0 - self.outline.gather(bulk.prescribed.astype(float))
        name_of_body = partial(floating.name_of, labels=self._labels)
        self._names = OutlineNames(self.outline, contacts, name_of_body)
        self._excused: dict[tuple[int, int], float] = {}
        self._excused = self._as_meshed()
        self.accepted = AcceptedPositions(self._positions(), np.zeros((0, 3)))
        self._left: Array = self.accepted.x
        self._restored: Array | None = None

    # A state

    def find(self) -> list[Crossing]:
        """Deepest crossing of each pair of outlines, or outline and obstacle, at present."""
        x, found = self._positions(), []
        rows = self._crossings(x, self._allowed(x))
        for pair, row in self._deepest(rows).items():
            facets = float(row[2]) - self._excused.get(pair, 0.0)
            if facets > 0.0:
                sides = self._names.segment(int(row[0])), self._names.segment(int(row[1]))
                found.append(Crossing(sides, format_point(row[4:]), float(row[3]), facets))
        for contact, slave in zip(self._contacts, self._slaves, strict=True):
            if isinstance(contact, Contact) and contact.obstacle is not None:
                depth, facets, point = deepest_point(contact, self.outline, slave, x)
                if facets > 0.0:
                    sides = f"'{contact.slave.name}'", f"obstacle '{contact.obstacle.name}'"
                    found.append(Crossing(sides, format_point(point), depth, facets))
        return sorted(found, key=lambda crossing: -crossing.facets)

    def _crossings(self, x: Array, allowed: Array) -> Array:
        """Rows of ``find_crossings`` with the nodes at ``x`` and their admitted overlaps."""
        o = self.outline
        return find_crossings(
            x, o.segments, *self._links, o.lengths(x), self._segment_bodies, allowed
        )

    def _deepest(self, rows: Array) -> dict[tuple[int, int], Array]:
        """Deepest row for each pair of bodies, in order of decreasing depth."""
        found: dict[tuple[int, int], Array] = {}
        for row in rows[np.argsort(-rows[:, 2], kind="stable")]:
            one, other = self._segment_bodies[row[:2].astype(np.int64)].tolist()
            found.setdefault((min(one, other), max(one, other)), row)
        return found

    def _as_meshed(self) -> dict[tuple[int, int], float]:
        """Overlap of unpaired bodies in the mesh [facets], inf if it is deep.

        Offsets are zero at this time. The overlap of a body with itself, such as a closed ring, is
        its value in the mesh.
        """
        found, X = {}, self.outline.X
        for pair, row in self._deepest(self._crossings(X, np.zeros(len(X)))).items():
            if pair not in self._paired:
                same, facets = pair[0] == pair[1], float(row[2])
                found[pair] = facets if same or facets <= HALF_FACET else np.inf
        return found

    def _allowed(self, x: Array) -> Array:
        """Overlap of nodes admitted by the offsets and soft layers of contacts, (n,) [length].

        The admitted overlap of a slave node applies to all nodes within this length plus the nodal
        length: to nodes of the master, and of its own body beside an end of the surface.

        Args:
            x: Positions of the nodes, shape (n, 2) [length].
        """
        allowed = np.zeros(len(x))
        for contact, there in zip(self._contacts, self._slaves, strict=True):
            overlap = np.maximum(-contact.now.offset, 0.0)
            admits = overlap.nonzero()[0]
            if not admits.size:
                continue
            from scipy.spatial import cKDTree  # not imported by problems without overlaps

            radii = overlap[admits] + contact.slave.nodal_lengths[admits]
            circles = cKDTree(x).query_ball_point(x[there[admits]], radii)
            counts = [len(nodes) for nodes in circles]
            nodes = np.concatenate(circles).astype(np.int64)
            np.maximum.at(allowed, nodes, np.repeat(overlap[admits], counts))
        return allowed

    def _bodies_of(self, surface: Surface) -> set[int]:
        """Bodies of a surface; tied bodies count separately."""
        bodies = surface.gather(self._bulk.space.spread(self._labels))[:, 0]
        return set(bodies.astype(np.int64).tolist())

    def _positions(self) -> Array:
        return self.outline.positions(self._bulk.u.x.array)

    # A step

    def accept(self, places: Array) -> None:
        """Start the next step at the present state.

        Args:
            places: Positions of the obstacles, shape (obstacles, 3).
        """
        self.accepted = AcceptedPositions(self._positions(), places.copy())
        self._left, self._restored = self.accepted.x, None

    def restore(self, accepted: AcceptedPositions, u: Array) -> None:
        """Restore the start of a step at the displacement ``u``, shape (local dofs,) [length]."""
        self.accepted, self._restored = accepted, u

    def leave(self) -> None:
        """Store the displacement after a failed solve."""
        self._left, self._restored = self._positions(), None

    def begin(self, places: Array) -> None:
        """Start a step at the accepted state, or at the present one if free dofs of ``u`` were set.

        Args:
            places: Positions of the obstacles, shape (obstacles, 3).
        """
        if self._restored is not None:
            self._left, self._restored = self.outline.positions(self._restored), None
        if (self._free * (self._left - self._positions())).any():
            self.accept(places)

    def passages(self, places: Array) -> list[str]:
        """Messages on passages through bodies and obstacles since the accepted state.

        Args:
            places: Present positions of the obstacles, shape (obstacles, 3).
        """
        x0, x1 = self.accepted.x, self._positions()
        motions = Motions(x0, x1, self.outline.bodies)
        if not len(x0) or np.array_equal(x0, x1):
            found = []
        elif motions.are_small:
            found = self._through_bodies(np.array([x0, x1]), OTHERS)
            found += self._through_bodies(np.array([motions.moved_with_own_body(), x1]), OWN)
        else:
            found = []
            for i, body in enumerate(motions.labels):
                relative = Motions(motions.moved_with(i), x1, self.outline.bodies)
                found += self._through_bodies(
                    relative.node_paths(), ALL, self._segment_bodies == body
                )
        return found + self._through_obstacles(x1, places)

    def _through_bodies(
        self, along: Array, which: int, segments: npt.NDArray[np.bool_] | None = None
    ) -> list[str]:
        """Messages on paths ``along`` (m + 1, n, 2) through marked segments (m,), bool.

        ``which``: see ``find_events``.
        """
        o, bodies, events = self.outline, self._segment_bodies, []
        marked = np.arange(len(bodies)) if segments is None else np.flatnonzero(segments)
        for k, (start, end) in enumerate(pairwise(along)):
            rows = find_events(start, end, o.segments[marked], bodies[marked], o.bodies, which)
            rows[:, 1], rows[:, 2] = marked[rows[:, 1].astype(np.int64)], rows[:, 2] + k
            events.append(rows)
        every = np.concatenate(events)
        if not len(every):
            return []
        every = every[np.lexsort((every[:, 2], bodies[every[:, 1].astype(np.int64)], every[:, 0]))]
        lengths, ends = o.lengths(along[-1]), (along[0], along[-1])
        rows = find_passages(*ends, o.segments, *self._links, lengths, bodies, every)
        return self._messages(rows, lengths, along[-1]) if len(rows) else []

    def _messages(self, rows: Array, lengths: Array, x1: Array) -> list[str]:
        """Messages on rows of ``find_passages``, one for each pair of bodies."""
        node, entry, leaves = (rows[:, k].astype(np.int64) for k in range(3))
        messages, through, depth = list[str](), leaves >= 0, rows[:, 3]
        pairs = np.stack([self.outline.bodies[node], self._segment_bodies[entry]], axis=1)
        inside = ~through & (pairs[:, 0] != pairs[:, 1])
        inside &= depth - self._allowed(x1)[node] > HALF_FACET * lengths[entry]
        for marked, ends_inside in ((through, False), (inside, True)):
            for pair in np.unique(pairs[marked], axis=0) if marked.any() else ():
                if self._excused.get((int(pair.min()), int(pair.max()))) == np.inf:
                    continue
                mine = np.flatnonzero(marked & (pairs == pair).all(axis=1))
                first = mine[np.argmax(depth[mine])]
                messages.append(self._message(rows[first], mine.size, x1, ends_inside=ends_inside))
        return messages

    def _message(self, row: Array, count: int, x1: Array, *, ends_inside: bool) -> str:
        node, entry, leaves = row[:3].astype(np.int64).tolist()
        what = f"nodes of {self._names.node(node)} went"
        body = self._names.body(int(self._segment_bodies[entry]))
        if ends_inside:
            where = format_point(x1[node])
            how = f"into {body}, and one at {where} ended {row[3]:.3g} below its surface"
        else:
            enters, exits = self._names.segment(entry), self._names.segment(leaves)
            how = (
                f"through {body}, entering at {enters} and leaving at {exits}, and "
                f"one at {format_point(x1[node])} ended {row[3]:.3g} from the facet of entry"
            )
        return f"{count} {what} {how}, straight from the last accepted state: take smaller steps"

    def _through_obstacles(self, x1: Array, places: Array) -> list[str]:
        """Messages on paths of slave nodes through the obstacles of their pairs."""
        messages = []
        obstacles = list(dict.fromkeys(c.obstacle for c in self._contacts if c.obstacle))
        for contact, there in zip(self._contacts, self._slaves, strict=True):
            obstacle = contact.obstacle
            if obstacle is None:
                continue
            number = obstacles.index(obstacle)
            start = own_frame(obstacle, self.accepted.x, self.accepted.places[number])
            end = own_frame(obstacle, x1, places[number])
            knots = Motions(start, end, self.outline.bodies).node_paths()[:, there]
            given = knots, contact.now.offset, contact.slave.nodal_lengths
            depth = call_together(
                self.outline.comm,
                f"the distance of '{obstacle.name}'",
                partial(passed_through, obstacle, *given),
            )
            through = np.flatnonzero(depth > 0.0)
            if through.size:
                first = through[np.argmax(depth[through])]
                messages.append(
                    f"{through.size} nodes of '{contact.slave.name}' went through obstacle "
                    f"'{obstacle.name}', and one at {format_point(x1[there[first]])} ended "
                    f"{depth[first]:.3g} beyond its surface, straight from the last accepted "
                    "state: take smaller steps"
                )
        return messages
