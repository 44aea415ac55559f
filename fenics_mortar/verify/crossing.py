# SPDX-License-Identifier: MIT
"""Crossed surfaces: overlapping outlines in a state, and passages of nodes in a step.

After each solve all exterior facets of the bodies in pairs are checked, against other bodies and
their own body, independently of the search for partners.

**State**: depth of two outlines in each other where they cross, in facets. Faceted curves in
contact overlap by their sagitta, and between nodes dual multipliers admit overlaps of this size;
the limits are those of the penetration of a pair, and smaller without a pair: ``overlap``.

``space_crossing`` is the counterpart in space.

**Step**: paths from the last accepted state, or the present one if free dofs of ``u`` were set; see
``passages``.

Cost on two blocks (``demos.studies.performance.crossing``): 0.9 ms with 10,500 unknowns (1.9 % of a
Newton iteration), 2.6 ms with 161,000 (0.4 %). Rotating bodies cost more: 30 bricks with 1,200
segments 2 ms, rotated by more than 1 degree 10 ms.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from fenics_mortar.bulk.bodies import label_bodies
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.leading import LEADS, Carried
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.curve_surface import Curve
from fenics_mortar.interface.outline import extract_outline
from fenics_mortar.kernels.crossing import find_crossings
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import HALF_FACET, Array, Flags, Indices, Value, norms
from fenics_mortar.utils.errors import format_point
from fenics_mortar.verify.finding import Crossing
from fenics_mortar.verify.node_paths import LedBodies, motion_of
from fenics_mortar.verify.overlap import (
    AdmittedDepth,
    OutlineNames,
    are_folds,
    deepest_point,
    slides_little,
)
from fenics_mortar.verify.passages import Passages, StepEnds


@dataclass(frozen=True)
class AcceptedPositions(Value):
    """Positions of outlines and obstacles at the last accepted state (local).

    Attributes:
        x: Positions of the outlines' nodes, shape (n, 2) [length].
        places: Places (x, y, angle) of the obstacles, shape (obstacles, 3) [length, length,
            radian].
        leaders: Those of the rigid boundaries that lead bodies, shape (leaders, 3) [as places].
    """

    x: Array
    places: Array
    leaders: Array = field(default_factory=lambda: np.zeros((0, 3)))


class Crossings:
    """Detection of crossings and passages; all methods are collective.

    Args:
        bulk: The bulk equations.
        contacts: All pairs.
        floating: Bodies and their names.

    Attributes:
        accepted: Positions at the start of the step.
        in_step: Detection of passages.
        led: Bodies that prescribed values turn.
    """

    extract: Callable[..., Any] = staticmethod(extract_outline)

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Contact | Tie], floating: FloatingBodies
    ) -> None:
        self._bulk, self._contacts = bulk, contacts
        self._labels, _ = label_bodies(bulk.V)
        sides = [[self._bodies_of(side) for side in (c.slave, c.master)] for c in contacts]
        self._in_contact = {
            (min(one, other), max(one, other))
            for contact, (slave, master) in zip(contacts, sides, strict=True)
            for one, other in product(slave, master)
            if not isinstance(contact, Tie)
        }
        self._of_pairs = [sorted(slave | master) for slave, master in sides]
        bodies = np.array(sorted({body for pair in self._of_pairs for body in pair}), np.int64)
        self.outline: Any = self.extract(bulk.space, self._labels, bodies)
        self._slaves = [self.outline.indices_of(contact.slave.nodes) for contact in contacts]
        self._free: Array = 1.0 - self.outline.gather(bulk.prescribed.astype(float))
        self._prescribed = (self._free == 0.0).all(axis=1)
        name_of_body = partial(floating.name_of, labels=self._labels)
        self._names = OutlineNames(self.outline, contacts, name_of_body)
        self._leaders = {b: m for b, m in floating.leaders.items() if b in self.outline.bodies}
        self.led = LedBodies(bulk, contacts, floating, self.outline)
        self._prepare()
        self.accepted = AcceptedPositions(self._positions(), np.zeros((0, 3)), self._led())
        self._left: Array = self.accepted.x
        self._restored: Array | None = None

    def _prepare(self) -> None:
        """Find which overlaps the mesh has, and which the discretization admits."""
        little = [body for c, pair in self._with_bodies() if slides_little(c) for body in pair]
        finite = [body for c, pair in self._with_bodies() if not slides_little(c) for body in pair]
        self._slide_little = np.setdiff1d(little, finite)
        self._links = self.outline.neighbours()
        self._segment_bodies = self.outline.segment_bodies
        self._admitted = AdmittedDepth(self.outline, self._contacts)
        self._excused = self._as_meshed()
        given = self.outline, self._contacts, self._slaves, self._names, self._excused
        self.in_step = Passages(*given)

    def _with_bodies(self) -> Iterator[tuple[Contact | Tie, list[int]]]:
        """Pairs and their bodies."""
        return zip(self._contacts, self._of_pairs, strict=True)

    # A state

    def find(self) -> list[Crossing]:
        """Deepest crossings of each pair of outlines, or outline and obstacle, at present.

        Of two outlines up to two: one between the sides of a pair, and one elsewhere.
        """
        x, found = self._positions(), list[Crossing]()
        rows = self._crossings(x, self._allowed(x))
        rows = rows[~self._are_meaningless(x, rows)]
        paired = self._admitted.are_paired(rows)
        limits = self._admitted.of(x, rows, paired)
        for are_paired in (True, False):
            mine = paired == are_paired
            found += self._found(rows[mine], limits[mine], are_paired)
        for pair, contact in enumerate(self._contacts):
            if isinstance(contact, Contact) and contact.obstacle is not None:
                deepest = deepest_point(contact, self.outline, self._slaves[pair], x)
                if deepest.facets > 0.0:
                    sides = (
                        self._names.segment(deepest.segment),
                        f"obstacle '{contact.obstacle.name}'",
                    )
                    admitted = self._admitted.at_obstacle(x, deepest.segment, pair)
                    where = format_point(deepest.point)
                    found.append(Crossing(sides, where, *deepest[:2], *admitted))
        return sorted(found, key=lambda crossing: -crossing.facets)

    def _found(self, rows: Array, admitted: Array, are_paired: bool) -> Iterator[Crossing]:
        """Deepest crossing of each pair of outlines among ``rows`` (k, 6), over ``admitted`` (k,).

        Overlaps of the mesh are left out, except those between surfaces in contact.
        """
        for pair, (row, limit) in self._deepest(rows, admitted).items():
            in_contact = self._admitted.are_in_contact(row[None])[0]
            excused = 0.0 if in_contact else self._excused.get(pair, 0.0)
            facets = float(row[2]) - excused
            if facets > 0.0:
                sides = self._names.segment(int(row[0])), self._names.segment(int(row[1]))
                where, depth = format_point(row[4:]), float(row[3])
                yield Crossing(sides, where, depth, facets, limit, are_paired)

    def _are_meaningless(self, x: Array, rows: Array) -> Flags:
        """Folds of bodies with linear strains and small sliding, see ``overlap``, (k,), bool."""
        bodies = self._segment_bodies[rows[:, :2].astype(np.int64)]
        marks = (bodies[:, 0] == bodies[:, 1]) & np.isin(bodies[:, 0], self._slide_little)
        if marks.any() and not self._bulk.form_points.any:
            marks[marks] = are_folds(x, self.outline.segments, self._segment_bodies, rows[marks])
            return marks
        return np.zeros(len(rows), bool)

    def _crossings(self, x: Array, allowed: Array) -> Array:
        """Rows of ``find_crossings`` with the nodes at ``x`` and their admitted overlaps."""
        o = self.outline
        return find_crossings(
            x, o.segments, *self._links, o.lengths(x), self._segment_bodies, allowed
        )

    def _deepest(self, rows: Array, admitted: Array) -> dict[tuple[int, int], tuple[Array, float]]:
        """Row of the largest depth over ``admitted`` (k,), and the latter, for each two bodies."""
        found: dict[tuple[int, int], tuple[Array, float]] = {}
        for k in np.argsort(-rows[:, 2] / admitted, kind="stable"):
            one, other = self._segment_bodies[rows[k, :2].astype(np.int64)].tolist()
            found.setdefault((min(one, other), max(one, other)), (rows[k], float(admitted[k])))
        return found

    def _as_meshed(self) -> dict[tuple[int, int], float]:
        """Overlap of bodies in the mesh outside contact pairs [facets], inf if it is deep.

        Offsets are zero at this time. The overlap of a body with itself, such as a closed ring, is
        its value in the mesh. Deep overlaps of bodies in contact are not excused.
        """
        found, X = {}, self.outline.X
        rows = self._crossings(X, np.zeros(len(X)))
        rows = rows[~self._admitted.are_in_contact(rows)]
        for pair, (row, _) in self._deepest(rows, np.ones(len(rows))).items():
            facets = float(row[2])
            if pair[0] == pair[1] or facets <= HALF_FACET:
                found[pair] = facets
            elif pair not in self._in_contact:
                found[pair] = np.inf
        return found

    def _allowed(self, x: Array) -> Array:
        """Overlap of nodes admitted by offsets, soft layers and jumps of ties, (n,) [length].

        The admitted overlap of a slave node applies to all nodes within this length plus the nodal
        length: to nodes of the master, and of its own body beside an end of the surface.

        Args:
            x: Positions of the nodes, shape (n, 2) [length].
        """
        allowed = np.zeros(len(x))
        for contact, there in zip(self._contacts, self._slaves, strict=True):
            overlap = np.maximum(-contact.now.offset, 0.0)
            if isinstance(contact, Tie):
                overlap = overlap + math.hypot(*contact.pair.present_jump())
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

    def nodes_inside(self) -> list[Indices] | None:
        """``None``: in the plane, cells tell which nodes are inside other bodies."""
        return None

    def _bodies_of(self, surface: Curve) -> set[int]:
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
        self.accepted = AcceptedPositions(self._positions(), places.copy(), self._led())
        self._left, self._restored = self.accepted.x, None

    def _led(self) -> Array:
        """Places of the rigid boundaries that lead bodies, shape (leaders, 3) (local)."""
        places = [motion.place for motion in self._leaders.values()]
        return np.reshape(places, (len(places), len(places[0]) if places else 3))

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

    def carried(self) -> Carried | None:
        """The outlines' nodes after the motions that lead bodies in this step; see ``leading``.

        ``None`` if no body is led to turn by more than ``LEADS``.
        """
        if not self.led.may_turn:
            return None
        values = self._bulk.values.copy()
        compat.set_prescribed(values, self._bulk.bcs)
        x0, x1 = self.accepted.x, self.outline.positions(values)
        led = zip(self._leaders.items(), self.accepted.leaders, self._led(), strict=True)
        known = {body: motion_of(leader, *ends) for (body, leader), *ends in led}
        found = self.led.carried(x0, x1, known)
        return found if norms(found.turn).max(initial=0.0) > LEADS else None

    def passages(self, places: Array) -> list[str]:
        """Messages on passages through bodies and obstacles since the accepted state.

        Args:
            places: Present positions of the obstacles, shape (obstacles, 3).
        """
        return self.passages_of_step(places)[0]

    def passages_of_step(self, places: Array) -> tuple[list[str], list[str]]:
        """Messages on passages, and if there are none on possible ones.

        The latter depend on motions that positions at the start and the end do not tell.

        Args:
            places: Present positions of the obstacles, shape (obstacles, 3).
        """
        x1 = self._positions()
        led = zip(self._leaders.items(), self.accepted.leaders, self._led(), strict=True)
        known = {body: motion_of(leader, *ends) for (body, leader), *ends in led}
        x0, before = self.accepted.x, self.accepted.places
        doubtful = self.led.parts(self.led.doubtful(x0, x1))
        ends = StepEnds(x0, x1, self._prescribed, before, places, known, doubtful)
        return self.in_step.find(ends, self._allowed)

    def uncertain_turns(self, places: Array, told: Collection[int]) -> list[str]:
        """Messages on bodies that turned by an angle that positions do not tell; see ``LedBodies``.

        Args:
            places: Present positions of the obstacles, shape (obstacles, 3).
            told: Numbers of pairs of which the turns at nodes are told.
        """
        moved = not np.array_equal(self.accepted.places, places)
        return self.led.messages(self.accepted.x, self._positions(), moved=moved, told=told)
