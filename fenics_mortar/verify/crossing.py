# SPDX-License-Identifier: MIT
"""Surfaces that crossed: outlines in a state, and ways of nodes in a step.

Contact sees what it finds a partner for. Here all exterior facets of the bodies in pairs are looked
at, those of one body among each other as well, after a solve and not during it.

**Of a state**: where two outlines cross, how deep they are in one another, in facets. Faceted
curves in contact overlap by their sagitta, and dual multipliers leave as much between the nodes; so
the certificate judges this as it does the penetration of a pair.

**Of a step**: nodes are taken to have gone straight from the last accepted state to the present
one, rigid moves before the solve included. Straight ways of a body that turns shrink it in between:
so where bodies turn, each is looked at in the frame that turns with it, and the others, as seen
from there, in parts of their rotation. A way that leaves a body where the outward normal is opposed
to that where it entered went through it. One that leaves where it entered slid along, as chords of
a curve do; and so did one beside which the outline leads from entry to exit within a facet, as that
of a narrow block or round a tip. A way that ends inside of another body, deeper than a facet may,
is told as well.

Once a solve; measured on two blocks (``demos.studies.performance.crossing``):
0.9 ms with 10,500 unknowns, 1.6
to 1.9 % of one Newton iteration, 2.6 ms with 161,000, 0.4 %. Many bodies that turn cost more, since
all are looked at from each: 30 bricks with 1,200 segments 2 ms, turned by more than 1 degree 10 ms.
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
from fenics_mortar.kernels.crossing import (
    ALL,
    OTHERS,
    OWN,
    find_crossings,
    find_events,
    find_passages,
)
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import call_together, place
from fenics_mortar.verify.ways import Motions, own_frame, went_through

# Unpaired bodies that are deeper in one another than this as meshed are meant to be [facets]; and a
# way ends inside of a body if it ends deeper than this.
DEEP = 0.5


@dataclass(frozen=True)
class Crossing:
    """The deepest crossing of the outlines of two bodies, or of one.

    Attributes:
        sides: Surfaces that cross, or bodies where these are no surfaces of a pair.
        where: Place, in words.
        depth: How deep one is in the other [length].
        facets: The same over the facet's length.
    """

    sides: tuple[str, str]
    where: str
    depth: float
    facets: float

    def __str__(self) -> str:
        """In words."""
        first, second = self.sides
        who = f"{first} crosses itself" if first == second else f"{first} and {second} cross"
        return f"{who} at {self.where}, {self.depth:.3g} deep ({self.facets:.1f} facets)"


@dataclass(frozen=True)
class Standing:
    """Where outlines and obstacles were at the last accepted state.

    Attributes:
        x: Positions of the outlines' nodes, shape (n, 2) [length].
        places: Places of the obstacles, shape (obstacles, 3).
    """

    x: Array
    places: Array


class Crossings:
    """Looks for what crossed; all methods are collective.

    Args:
        bulk: The bodies.
        contacts: The pairs, bound to the same space.
        floating: What knows the bodies.

    Attributes:
        accepted: Where the step begins.
    """

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Contact | Tie], floating: FloatingBodies
    ) -> None:
        self._bulk, self._contacts, self._floating = bulk, contacts, floating
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
        self._bound = int(self._segment_bodies.max(initial=0)) + 1
        self._slaves = [self.outline.places_of(contact.slave.nodes) for contact in contacts]
        self._free: Array = 1.0 - self.outline.gather(bulk.prescribed.astype(float))
        self._names: dict[int, str] = {}
        self._surfaces, self._surface_of = self._name_segments()
        self._excused: dict[tuple[int, int], float] = {}
        self._excused = self._as_meshed()
        self.accepted = Standing(self._positions(), np.zeros((0, 3)))
        self._left: Array = self.accepted.x
        self._restored: Array | None = None

    # A state

    def find(self) -> list[Crossing]:
        """The deepest crossing of each two outlines at the present displacement."""
        rows, found = self._crossings(self._positions()), []
        for pair, row in self._deepest(rows).items():
            facets = float(row[2]) - self._excused.get(pair, 0.0)
            if facets > 0.0:
                sides = self._name(int(row[0])), self._name(int(row[1]))
                found.append(Crossing(sides, place(row[4:]), float(row[3]), facets))
        return sorted(found, key=lambda crossing: -crossing.facets)

    def _crossings(self, x: Array) -> Array:
        """Rows of ``find_crossings`` with the nodes at ``x``."""
        o = self.outline
        return find_crossings(
            x, o.segments, *self._links, o.lengths(x), self._segment_bodies, self._allowed()
        )

    def _deepest(self, rows: Array) -> dict[tuple[int, int], Array]:
        """The deepest of such rows of each two bodies, by these, the deepest first."""
        rows = rows[np.argsort(-rows[:, 2], kind="stable")]
        pairs = np.sort(self._segment_bodies[rows[:, :2].astype(np.int64)], axis=1)
        _, first = np.unique(pairs @ np.array([self._bound, 1]), return_index=True)
        return {(int(pairs[i, 0]), int(pairs[i, 1])): rows[i] for i in np.sort(first)}

    def _as_meshed(self) -> dict[tuple[int, int], float]:
        """Facets by which bodies that are no pair overlap in the mesh, without limit if deep.

        One that overlaps itself, as one that is closed upon itself, may go on to do so by as much.
        """
        found = {}
        for pair, row in self._deepest(self._crossings(self.outline.X)).items():
            if pair not in self._paired:
                same, facets = pair[0] == pair[1], float(row[2])
                found[pair] = facets if same or facets <= DEEP else np.inf
        return found

    def _allowed(self) -> Array:
        """What the contacts' offsets let nodes overlap by, shape (n,) [length]."""
        allowed = np.zeros(len(self.outline.X))
        for contact, there in zip(self._contacts, self._slaves, strict=True):
            if contact.offset.any():
                np.maximum.at(allowed, there, np.maximum(-contact.offset, 0.0))
        return allowed

    def _bodies_of(self, surface: Surface) -> set[int]:
        """Bodies of a surface; tied ones are not one here."""
        bodies = surface.gather(self._bulk.space.spread(self._labels))[:, 0]
        return set(bodies.astype(np.int64).tolist())

    def _positions(self) -> Array:
        return self.outline.positions(self._bulk.u.x.array)

    # Names

    def _name_segments(self) -> tuple[list[str], Indices]:
        """Names of the surfaces in pairs, and which one each segment is of, -1 for none."""
        names, found = list[str](), np.full(len(self.outline.segments), -1)
        for contact in self._contacts:
            for surface in (contact.slave, contact.master):
                if surface.num_nodes and f"'{surface.name}'" not in names:
                    found[self.outline.are_of(surface)] = len(names)
                    names.append(f"'{surface.name}'")
        return names, found

    def _name(self, segment: int) -> str:
        """Name of the surface or the body of a segment."""
        if self._surface_of[segment] >= 0:
            return self._surfaces[self._surface_of[segment]]
        return self._name_body(int(self._segment_bodies[segment]))

    def _name_body(self, body: int) -> str:
        if body not in self._names:
            self._names[body] = self._floating.name_of(body, self._labels)
        return self._names[body]

    def _name_node(self, node: int) -> str:
        at = (self.outline.segments == node).any(axis=1)
        surface = self._surface_of[at].max(initial=-1)
        return self._surfaces[surface] if surface >= 0 else self._name(int(np.argmax(at)))

    # A step

    def accept(self, places: Array) -> None:
        """Let the next step begin at the present state.

        Args:
            places: Those of the obstacles, shape (obstacles, 3).
        """
        self.accepted = Standing(self._positions(), places.copy())
        self._left, self._restored = self.accepted.x, None

    def restore(self, accepted: Standing, u: Array) -> None:
        """Take up where a step began; its displacement now is ``u``, which stays as it is."""
        self.accepted, self._restored = accepted, u

    def leave(self) -> None:
        """Note where a failed solve has left the displacement."""
        self._left, self._restored = self._positions(), None

    def begin(self, places: Array) -> None:
        """Begin a step: at the accepted state, or at the present one if ``u`` was set by hand.

        Who sets prescribed values only does what the solve would do.

        Args:
            places: Those of the obstacles, shape (obstacles, 3).
        """
        if self._restored is not None:
            self._left, self._restored = self.outline.positions(self._restored), None
        if (self._free * (self._left - self._positions())).any():
            self.accept(places)

    def passages(self, places: Array) -> list[str]:
        """What went through bodies and obstacles since the accepted state, in words.

        Args:
            places: Present ones of the obstacles, shape (obstacles, 3).
        """
        x0, x1 = self.accepted.x, self._positions()
        motions = Motions(x0, x1, self.outline.bodies)
        if not len(x0) or np.array_equal(x0, x1):
            found = []
        elif motions.are_small:
            found = self._through_bodies(np.array([x0, x1]), OTHERS)
            found += self._through_bodies(np.array([motions.carried(), x1]), OWN)
        else:
            found = []
            for i, body in enumerate(motions.labels):
                seen = Motions(motions.seen_from(i), x1, self.outline.bodies)
                found += self._through_bodies(seen.ways(), ALL, self._segment_bodies == body)
        return found + self._through_obstacles(x1, places)

    def _through_bodies(
        self, along: Array, which: int, segments: npt.NDArray[np.bool_] | None = None
    ) -> list[str]:
        """Ways ``along`` (m + 1, n, 2) through marked segments (m,) of ``which`` bodies, in words.

        See ``find_events``.
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
        return self._tell(rows, lengths, along[-1]) if len(rows) else []

    def _tell(self, rows: Array, lengths: Array, x1: Array) -> list[str]:
        """Rows of ``find_passages`` in words, one line for each two bodies."""
        node, entry, leaves = (rows[:, k].astype(np.int64) for k in range(3))
        told, through, depth = list[str](), leaves >= 0, rows[:, 3]
        pairs = np.stack([self.outline.bodies[node], self._segment_bodies[entry]], axis=1)
        inside = ~through & (pairs[:, 0] != pairs[:, 1])
        inside &= depth - self._allowed()[node] > DEEP * lengths[entry]
        for marked, ends_inside in ((through, False), (inside, True)):
            for pair in np.unique(pairs[marked], axis=0):
                if self._excused.get((int(pair.min()), int(pair.max()))) == np.inf:
                    continue
                mine = np.flatnonzero(marked & (pairs == pair).all(axis=1))
                first = mine[np.argmax(depth[mine])]
                told.append(self._say(rows[first], mine.size, x1, ends_inside=ends_inside))
        return told

    def _say(self, row: Array, count: int, x1: Array, *, ends_inside: bool) -> str:
        node, entry, leaves = row[:3].astype(np.int64).tolist()
        what = f"nodes of {self._name_node(node)} went"
        body = self._name_body(int(self._segment_bodies[entry]))
        if ends_inside:
            way = f"into {body}, and one at {place(x1[node])} ended {row[3]:.3g} below its surface"
        else:
            way = (
                f"through {body}, in by {self._name(entry)} and out by {self._name(leaves)}, and "
                f"one at {place(x1[node])} ended {row[3]:.3g} beyond where it went in"
            )
        return f"{count} {what} {way}, straight from the last accepted state: take smaller steps"

    def _through_obstacles(self, x1: Array, places: Array) -> list[str]:
        """Ways of slave nodes through the obstacles of their pairs, in words."""
        told, obstacles = [], list(dict.fromkeys(c.obstacle for c in self._contacts if c.obstacle))
        for contact, there in zip(self._contacts, self._slaves, strict=True):
            obstacle = contact.obstacle
            if obstacle is None:
                continue
            number = obstacles.index(obstacle)
            start = own_frame(obstacle, self.accepted.x, self.accepted.places[number])
            end = own_frame(obstacle, x1, places[number])
            knots = Motions(start, end, self.outline.bodies).ways()[:, there]
            given = knots, contact.offset, contact.nodal_lengths
            depth = call_together(
                self.outline.comm,
                f"the distance of '{obstacle.name}'",
                partial(went_through, obstacle, *given),
            )
            through = np.flatnonzero(depth > 0.0)
            if through.size:
                first = through[np.argmax(depth[through])]
                told.append(
                    f"{through.size} nodes of '{contact.slave.name}' went through obstacle "
                    f"'{obstacle.name}', and one at {place(x1[there[first]])} ended "
                    f"{depth[first]:.3g} beyond its surface, straight from the last accepted "
                    "state: take smaller steps"
                )
        return told
