# SPDX-License-Identifier: MIT
"""Paths of nodes in a step: bodies and obstacles that turn, one seen from another.

``Motions`` fits a rigid motion of each body to the ends of a step, and ``Paths`` shows nodes in the
frame of a body or an obstacle. ``LedBodies`` are bodies that prescribed values turn.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Literal, NamedTuple

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.arcs import LEADS, Carried, moved_by
from fenics_mortar.contact.contact import Contact
from fenics_mortar.obstacles import rigid_motion
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import ROUNDING, SMALL_ANGLE, TINY, Array, Value, norms
from fenics_mortar.verify.finding import LIMITS

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.interface.outline import Hull, Outline
    from fenics_mortar.interface.surfaces import Surface
    from fenics_mortar.utils.arrays import Flags, Indices

# Turn of a body by prescribed values in a step [radian], 5 degrees, above which its sense is told
# to be uncertain: 72 steps for a full turn are taken for what they look like.
TOLD_TURN = np.pi / 36

OTHERWISE = (
    "the ends of the step do not tell; if bodies turned otherwise, slip and friction are those of "
    "another motion: take smaller steps, follow_path with values as a function of the time, or a "
    "RigidBoundary, whose angle is known"
)

# Rotations by the number of the body: an angle, shape (1,), in space a vector (3,) [radian].
Turns = dict[int, Array]


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


class LedBodies:
    """Bodies with prescribed nodes, and how far these turn in a step.

    The ends of a step determine the rotation of a body up to full turns: values that turn a shaft
    by 350 degrees are those that turn it back by 10. Slip, the direction of friction, wear and the
    bodies passed depend on it. Angles of rigid boundaries are known; of other prescribed values the
    shortest turn is taken, and a message reports turns larger than ``TOLD_TURN``. On a path loads
    are a function of the time, evaluated within each step as well: see ``path.stepping``.

    All methods are local but ``messages`` and the constructor.

    Args:
        bulk: The bodies.
        contacts: All pairs.
        outline: Outlines or hulls of the bodies in contact.
        labels: Body of each local node, shape (local nodes,).
        leaders: Motions of rigid boundaries by the numbers in the outlines that they lead.
        name_of: Name of a body by its number (collective).

    Attributes:
        sides: Bodies of each pair by their numbers in ``labels``, slave and master, -1 for
            an obstacle, of which prescribed values lead at least one.
        may_turn: Whether values may be those of a rotation, not one constant for each body.
        examined: Whether loads were evaluated at times within the present step.
    """

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Interface], outline: Outline | Hull, labels: Indices,
        leaders: Mapping[int, rigid_motion.RigidMotion], name_of: Callable[[int], str],
    ) -> None:  # fmt: skip
        self._bulk, self._contacts, self._outline = bulk, contacts, outline
        self._leaders = {b: m for b, m in leaders.items() if b in outline.bodies}
        self.bodies = outline.gather(bulk.space.spread(labels))[:, 0].astype(np.int64)
        self._parts = outline.bodies
        free = outline.gather(1.0 - bulk.prescribed)
        self.prescribed = (free == 0.0).all(axis=1)
        led = set(self.bodies[self.prescribed].tolist())
        self._of_pairs = [
            {sides for sides in self._sides_of(contact) if not led.isdisjoint(sides)}
            for contact in contacts
        ]
        self.sides: set[tuple[int, int]] = set().union(*self._of_pairs)
        sizes = [compat.prescribed_value(bc).size for bc in bulk.bcs]
        self.may_turn = bool(self.sides) and (0 in sizes or len(sizes) > len(led))
        known = np.isin(self._parts, list(leaders))
        self._known = set(self.bodies[known].tolist())
        names = sorted(led - self._known) if self.may_turn else []
        self._names = {body: name_of(body) for body in names}
        self.examined = False
        self._taken: dict[tuple[int, int], Array] = {}

    def _sides_of(self, contact: Interface) -> Iterable[tuple[int, int]]:
        """The bodies on both sides of a contact."""
        if not isinstance(contact, Contact):
            return ()
        both = product(self._of(contact.slave), self._of(contact.master) or [-1])
        return [sides for sides in both if sides[0] != sides[1]]

    def _of(self, surface: Surface) -> list[int]:
        """Numbers of the bodies of a surface, none for an obstacle."""
        return sorted(set(self.bodies[self._outline.indices_of(surface.nodes)].tolist()))

    def turns(self, x0: Array, x1: Array, stretched: float = np.inf) -> Turns:
        """Rotations of the prescribed nodes of bodies between two positions; see ``turn_of``.

        Args:
            x0: Positions of the nodes of the outlines, shape (n, d) [length].
            x1: Positions later.
            stretched: See ``turn_of``.
        """
        led = self.prescribed
        bodies = np.unique(self.bodies[led]).tolist()
        marks = [led & (self.bodies == body) for body in bodies]
        found = (rigid_motion.turn_of(x0[at], x1[at], stretched) for at in marks)
        return dict(zip(bodies, found, strict=True))

    @property
    def places(self) -> Array:
        """Places of the rigid boundaries that lead bodies, (leaders, 3) [length, radian]."""
        places = [motion.place for motion in self._leaders.values()]
        return np.reshape(places, (len(places), len(places[0]) if places else 3))

    def leading(self, accepted: AcceptedPositions) -> dict[int, rigid_motion.RigidPath]:
        """Motions of the rigid boundaries in a step, by the bodies that they lead."""
        led = zip(self._leaders.items(), accepted.leaders, self.places, strict=True)
        return {body: rigid_motion.motion_of(leader, *ends) for (body, leader), *ends in led}

    def positions(self) -> Array:
        """Positions of the outlines' nodes, shape (n, d) [length] (collective)."""
        return self._outline.positions(self._bulk.values)

    def prescribed_positions(self) -> Array:
        """``positions`` with prescribed nodes at their values, (n, d) [length] (collective)."""
        return self._outline.positions(self._bulk.values_as_prescribed())

    def carried(self, accepted: AcceptedPositions, *, solved: bool = False) -> Carried | None:
        """The outlines' nodes after the motions that lead bodies in this step; see ``arcs``.

        After those of all bodies to the present state if it is ``solved``. ``None`` if no body is
        led to turn by more than ``LEADS``.
        """
        if not (solved or self.may_turn):
            return None
        x1 = self.positions() if solved else self.prescribed_positions()
        found = self._carried(accepted.x, x1, self.leading(accepted), solved=solved)
        leads = np.nan_to_num(norms(found.turn)).max(initial=0.0) > LEADS
        return found if leads else None

    def carried_from_here(self) -> Carried:
        """The outlines' nodes after motions from where they are to prescribed values."""
        return self._carried(self.positions(), self.prescribed_positions(), {})

    def _carried(
        self,
        x0: Array,
        x1: Array,
        known: Mapping[int, rigid_motion.RigidPath],
        *,
        solved: bool = False,
    ) -> Carried:
        """Nodes carried along by the motions that lead their bodies between two positions.

        Rigid boundaries lead by their own motions; other prescribed nodes by one about their mean,
        which moves on a straight line, or about a fixed point inside the body. The motion of other
        bodies is known after a solve: that of their means, and their mean rotation.

        Args:
            x0: Positions of the nodes of the outlines at the start, shape (n, d) [length].
            x1: Those to which the prescribed ones move, or of a solution.
            known: Motions of rigid boundaries, by the number in the outlines that they lead.
            solved: Whether ``x1`` is a solution.

        Returns:
            The nodes; turns are nan where prescribed nodes of a body do not move as one.
        """
        size, axes = x0.shape, len(rigid_motion.TURNS[x0.shape[1]])
        x, pivots = x0.copy(), np.zeros((2, *size))
        turn, straight = np.zeros((size[0], axes)), np.zeros((size[0], 1))
        for body in np.unique(self.bodies if solved else self.bodies[self.prescribed]).tolist():
            mine = self.bodies == body
            led, parts = mine & self.prescribed, set(self._parts[mine].tolist())
            leader = next((known[part] for part in sorted(parts) if part in known), None)
            led = led if not solved or rigid_motion.tells_turn(x0[led]) else mine
            path = leader or rigid_motion.path_of(x0[led], x1[led]).about_fixed_point(x0[mine])
            apart, moved = (norms(path.carry(x0[led], 1.0) - x).max() for x in (x1[led], x0[led]))
            if leader is None and apart > rigid_motion.STRETCHED * moved and (led != mine).any():
                turn[mine] = np.nan if np.linalg.norm(path.turn) > SMALL_ANGLE else 0.0
                continue  # its prescribed nodes do not move as one
            x[mine], turn[mine] = path.carry(x0[mine], 1.0), path.turn
            pivots[:, mine] = np.stack([path.start, path.end])[:, None]
            straight[mine] = float(leader is not None)
        return Carried(x, turn, pivots[0], pivots[1], straight)

    def relative(self, sides: tuple[int, int], turns: Turns) -> Array:
        """Rotation of the slave less that of the master, as a vector [radian]."""
        still = np.zeros(len(rigid_motion.TURNS[self._bulk.space.dim]))
        slave, master = (turns.get(side, still) for side in sides)
        return np.asarray(slave - master)

    def doubtful(self, x0: Array, x1: Array, least: float = TOLD_TURN) -> Turns:
        """Turns that values determine up to full turns only, above ``least``, in a step."""
        if self.examined or not self.may_turn or np.array_equal(x0, x1):
            return {}
        found = self.turns(x0, x1, rigid_motion.STRETCHED).items()
        return {
            body: turn
            for body, turn in found
            if body in self._names and np.linalg.norm(turn) > least
        }

    def taken(self, accepted: AcceptedPositions) -> list[str]:
        """Notes on smaller turns by values, the first time and when their sense changes (local).

        With friction or wear only; see ``messages``.
        """
        x0, x1 = accepted.x, self.positions()
        of_pairs = self._rubbing()
        turns, notes = self.doubtful(x0, x1, ROUNDING) if of_pairs else {}, list[str]()
        for sides in of_pairs:
            turn = self.relative(sides, turns)
            angle, before = float(np.linalg.norm(turn)), self._taken.get(sides, 0.0 * turn)
            if not ROUNDING < angle <= TOLD_TURN:
                continue
            if turn @ before <= 0.0:
                name = next(self._names[body] for body in sides if body in turns)
                notes.append(
                    f"prescribed values turn {name} by {np.degrees(angle):.2g} degrees in the "
                    "step, and other steps likewise, if not by full turns besides, or the other "
                    "way round: their ends do not tell; follow_path and a RigidBoundary do"
                )
            self._taken[sides] = turn
        return notes

    def _rubbing(self, told: Collection[int] = ()) -> list[tuple[int, int]]:
        """``sides`` of closed pairs that depend on slip, without those with numbers ``told``."""
        pairs = enumerate(zip(self._contacts, self._of_pairs, strict=True))
        rubs = [sides for number, (c, sides) in pairs if _rubs(c) and number not in told]
        return sorted(set().union(*rubs))

    def parts(self, bodies: Iterable[int]) -> frozenset[int]:
        """Numbers in the outlines of some bodies."""
        return frozenset(self._parts[np.isin(self.bodies, list(bodies))].tolist())

    def messages(
        self, accepted: AcceptedPositions, places: Array, told: Collection[int]
    ) -> list[str]:
        """Message on turns up to which slip is uncertain, or on a step in which nothing moved.

        Collective. With friction or wear only; none if the loads were examined.

        Args:
            accepted: Positions at the start of the step.
            places: Present positions of the obstacles, shape (obstacles, 3).
            told: Numbers of pairs whose turns at nodes are reported already.
        """
        x0, x1 = accepted.x, self.positions()
        moved = not np.array_equal(accepted.places, places)
        of_pairs = self._rubbing(told)
        if self.examined or not self.may_turn or not of_pairs:
            return []
        size = float(np.abs(x1).max(initial=0.0))
        if not moved and np.abs(x1 - x0).max(initial=0.0) <= ROUNDING * size:
            names = self._of_functions(of_pairs)
            text = "nothing moved in the step; prescribed values may have turned"
            return [f"{text} {name} by full turns: {OTHERWISE}" for name in names[:1]]
        turns = self.doubtful(x0, x1)
        for sides in of_pairs:
            angle = float(np.degrees(np.linalg.norm(self.relative(sides, turns))))
            if angle > np.degrees(TOLD_TURN):
                sizes = {float(np.linalg.norm(turns[b])): b for b in sides if b in turns}
                return [
                    f"prescribed values turned {self._names[sizes[max(sizes)]]} by {angle:.0f} "
                    f"degrees in the step, if not by {360.0 - angle:.0f} the other way round: "
                    f"{OTHERWISE}"
                ]
        return []

    def _of_functions(self, of_pairs: Sequence[tuple[int, int]]) -> list[str]:
        """Names of led bodies of pairs, if functions that are not zero prescribe values."""
        bcs = [bc for bc in self._bulk.bcs if bc.g is not None]
        functions = [bc for bc in bcs if not compat.prescribed_value(bc).size]
        given = any(compat.condition_numbers(bc).any() for bc in functions)
        if not self._bulk.comm.allreduce(given, MPI.LOR):
            return []
        return [self._names[body] for sides in of_pairs for body in sides if body in self._names]


def _rubs(contact: Interface) -> bool:
    """Whether a contact is closed and depends on slip."""
    rubs = isinstance(contact, Contact) and contact.depends_on_slip
    return rubs and bool(contact.active.any())


# Alternative to the motions of bodies, see ``Motions``; "" for none.
Alternative = Literal["", "sense", "centre"]
NONE_KNOWN: Mapping[int, rigid_motion.RigidPath] = {}


class StepEnds(NamedTuple):
    """Start and end of a step.

    Attributes:
        x0: Positions of the outlines' nodes at the start, shape (n, dim) [length].
        x1: Positions at the end, shape (n, dim) [length].
        prescribed: Whether all components of a node are prescribed, shape (n,), bool.
        before: Places of the obstacles at the start, shape (obstacles, m) [length, radian].
        after: Places at the end, likewise.
        known: Motions that rigid boundaries prescribe, by the body that they lead.
        doubtful: Bodies that prescribed values turn by angles that the ends do not determine.
    """

    x0: Array
    x1: Array
    prescribed: Flags | None = None
    before: Array = np.zeros((0, 3))
    after: Array = np.zeros((0, 3))
    known: Mapping[int, rigid_motion.RigidPath] = NONE_KNOWN
    doubtful: Collection[int] = ()

    @property
    def bodies_rest(self) -> bool:
        """Whether no body moves (local)."""
        turns = any(motion.angle for motion in self.known.values())
        return np.array_equal(self.x0, self.x1) and not turns

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves: no body, no obstacle (local)."""
        rests = self.bodies_rest and np.array_equal(self.before, self.after)
        return rests or not len(self.x0)


class Motions:
    """Motions of bodies in a step: rigid ones, and a strain at a constant rate (local).

    The motion of an obstacle between two places is known: its pivot moves on a straight line, and
    its angle grows from one value to the other, also by more than a full turn. So is that of a body
    on a rigid boundary. Of other bodies only the ends of the path of each node are known. Their
    motion is fitted: a centre on a straight line and a rotation, of less than half a turn.
    Meanwhile bodies are strained at a constant rate. The centre is that of the prescribed nodes, if
    there are any, or the fixed point of their motion if this point is nearer than the farthest
    node, as for a paddle that turns about its hub. The fixed point of a wheel that rolls is not: it
    is R a / (2 sin a/2) > R away. In space it moves along an axis.

    A rotation by more than a sixth of a turn may as well have had the other sense, or another
    centre: see ``Alternative``.

    Args:
        ends: Both ends of the step; rotations of ``doubtful`` bodies by more than ``TOLD_TURN`` may
            have had the other sense.
        bodies: The bodies, shape (b,), and the number of that of each node among them, shape (n,).
        other: Alternative to rotations by more than a sixth of a turn: "sense" for rotations in the
            other sense, "centre" for those about the mean of the prescribed nodes instead of the
            fixed point, or the reverse.

    Attributes:
        labels: The bodies, shape (b,).
        of_node: Number of the body of each node, shape (n,).
        paths: The rigid motions of the bodies.
        are_led: Whether a body has prescribed nodes, shape (b,), bool.
        are_known: Whether the motion of a body is known, shape (b,), bool.
        two_ways: Whether its rotation may have had the other sense, shape (b,), bool.
    """

    def __init__(
        self, ends: StepEnds, bodies: tuple[Indices, Indices], other: Alternative = ""
    ) -> None:
        self._x0, (self.labels, self.of_node) = ends.x0, bodies
        count = self.labels.size
        self._nodes = [np.flatnonzero(self.of_node == body) for body in range(count)]
        self.are_led, self.are_known, self.two_ways = np.zeros((3, count), bool)
        self.paths = [self._path(body, ends, other) for body in range(count)]
        each = (np.array(values)[self.of_node] for values in zip(*self.paths, strict=True))
        self._start, self._end, turn = each
        self._angle = self.angles[self.of_node, None]
        self._axis = turn / np.maximum(self._angle, TINY)
        self._strain = self._turned(ends.x1 - self._end, -1.0) - (ends.x0 - self._start)

    def _path(self, body: int, ends: StepEnds, other: Alternative) -> rigid_motion.RigidPath:
        """The motion of a body: a known one, or that of its prescribed nodes, or of all.

        Prescribed nodes that do not determine a rotation are a pin or a hinge line, about which all
        turn. A part without such nodes, tied to a rigid boundary, follows it if it turned as far.
        """
        (x0, x1), mine, label = ends[:2], self._nodes[body], int(self.labels[body])
        led = mine[:0] if ends.prescribed is None else mine[ends.prescribed[mine]]
        self.are_led[body] = led.size > 0
        tell = led if rigid_motion.tells_turn(x0[led]) else mine
        path = rigid_motion.path_of(x0[tell], x1[tell])
        if led.size and tell is mine:
            start, end = x0[led].mean(axis=0), x1[led].mean(axis=0)
            turn = rigid_motion.vector_of(
                rigid_motion.polar((x1[mine] - end).T @ (x0[mine] - start))[0]
            )
            path = rigid_motion.RigidPath(start, end, turn)
        known = ends.known.get(label)
        if known and (known.is_followed(x0[led], x1[led]) if tell is led else known.turns_as(path)):
            self.are_known[body] = True
            return known
        far = abs(path.angle) > LIMITS.two_ways
        turned = abs(path.angle) > TOLD_TURN  # not as seen from the body itself
        self.two_ways[body] = far or (turned and label in ends.doubtful)
        if other == "sense" and self.two_ways[body]:
            path = path.backwards()
        if not led.size:
            return path
        return path.about_fixed_point(x0[mine], inside=not (far and other == "centre"))

    @property
    def angles(self) -> Array:
        """Sizes of the rotations of the bodies, shape (b,) [radian]."""
        return np.array([abs(path.angle) for path in self.paths])

    def distances_to(self, x: Array) -> Array:
        """Root mean squares of the distances of nodes from ``x`` (n, d), by body, (b,) [length]."""
        squares = ((x - self._x0) ** 2).sum(axis=1)
        return np.sqrt(np.array([squares[mine].mean() for mine in self._nodes]))

    def at(self, t: float) -> Array:
        """Positions of the nodes at the time ``t``, 0 to 1, shape (n, d) [length]."""
        centre = self._start + t * (self._end - self._start)
        return centre + self._turned(self._x0 - self._start + t * self._strain, t)

    def _turned(self, vectors: Array, t: float) -> Array:
        """Vectors (n, d) at the nodes turned by the rotations up to ``t``, negative: back."""
        once = moved_by(self._axis, vectors)
        twice, angle = moved_by(self._axis, once), t * self._angle
        return vectors + np.sin(angle) * once + (1.0 - np.cos(angle)) * twice


class Paths:
    """Paths of all nodes in a step, as seen from bodies and obstacles (local).

    A frame is a list of rotations, to be carried out in this order. Positions in a frame are moved
    with it to the start of the step. Bodies without prescribed nodes may be carried along: their
    paths are fitted in the frame in which they move least, that of space, of an obstacle or of a
    body with prescribed nodes.

    Args:
        ends: Both ends of the step.
        bodies: Body of each node, shape (n,).
        obstacles: Motions of the obstacles, by labels that are no bodies.
        resolution: Largest distance of a path from its straight sections [length].
        other: Alternative to motions that the ends of the paths do not determine, see ``Motions``.

    Attributes:
        motions: Motions of the obstacles.
    """

    def __init__(
        self, ends: StepEnds, bodies: Indices, obstacles: Mapping[int, rigid_motion.RigidPath],
        resolution: float, other: Alternative = "",
    ) -> None:  # fmt: skip
        self._x0, self._x1, self._resolution, self._known = *ends[:2], resolution, ends.known
        both = np.concatenate([self._x0, self._x1])
        self._box = np.stack([both.min(axis=0), both.max(axis=0)])
        labels, of_node = np.unique(bodies, return_inverse=True)

        def fit(end: Array, known: Mapping[int, rigid_motion.RigidPath] = NONE_KNOWN) -> Motions:
            return Motions(ends._replace(x1=end, known=known), (labels, of_node), other)

        self._fit: Callable[..., Motions] = fit
        self.motions = obstacles
        self._bodies = fit(self._x1, ends.known)
        leaders = [self._bodies.paths[i] for i in np.flatnonzero(self._bodies.are_led)]
        origin = np.zeros(self._x0.shape[1])
        at_rest = rigid_motion.RigidPath(
            origin, origin, np.zeros(len(rigid_motion.TURNS[origin.size]))
        )
        self._carriers = [at_rest, *(c for c in (*obstacles.values(), *leaders) if c.angle)]
        self._choose_carriers()

    @property
    def alternatives(self) -> Sequence[Alternative]:
        """Alternatives to motions of bodies that turned too far for the ends to determine them."""
        return ("sense", "centre") if self._relative.two_ways.any() else ()

    def _choose_carriers(self) -> None:
        """Find the frame in which each body moves least, and its motion there."""
        if len(self._carriers) == 1:  # nothing turns that may carry others along
            self._relative, self._carrier = self._bodies, np.zeros(len(self._bodies.paths), int)
            self._least = self._bodies.distances_to(self._x1)
            self._least[self._bodies.are_known] = 0.0
            return
        i, led = self._bodies.of_node, self._bodies.are_led
        ends = np.array([carrier.back(self._x1, 1.0) for carrier in self._carriers])
        distances = np.array([self._bodies.distances_to(end) for end in ends])
        distances[1:, led | self._bodies.are_known] = np.inf
        self._carrier, self._least = distances.argmin(axis=0), distances.min(axis=0)
        self._relative = self._fit(ends[self._carrier[i], np.arange(len(i))], self._known)
        self._least[self._relative.are_known] = 0.0

    def at(self, t: float) -> Array:
        """Positions of the nodes in space at the time ``t``, 0 to 1, shape (n, d) [length]."""
        x = self._relative.at(t)
        for k in np.unique(self._carrier):
            mine = self._carrier[self._bodies.of_node] == k
            x[mine] = self._carriers[k].carry(x[mine], t)
        return x

    def seen_from(self, label: int) -> Array:
        """Paths of the nodes in the frame of a body or an obstacle, shape (m + 1, n, d) [length].

        Bodies that move less in this frame than in that of their carrier are carried by it.
        """
        frame = [self.motions[label]] if label in self.motions else self._frame_of(label)
        end, none = _back(frame, self._x1, 1.0), self._x0[:0]
        carriers = np.array([abs(carrier.angle) for carrier in self._carriers])
        angles = carriers[self._carrier] + self._relative.angles
        angles += sum(abs(rotation.angle) for rotation in frame)
        if not self._times(angles.max(initial=0.0), frame, none).size:
            return np.array([self._x0, end])  # straight, whatever carries the bodies
        inside = self._fit(end)
        carried = inside.distances_to(end) < self._least
        angle = float(np.where(carried, inside.angles, angles).max(initial=0.0))
        along, carried = list[Array](), carried[inside.of_node]
        for t in self._times(angle, frame, none):
            far = self._x0 if carried.all() else _back(frame, self.at(t), t)
            along.append(np.where(carried[:, None], inside.at(t), far))
        return np.array([self._x0, *along, end])

    def _frame_of(self, body: int) -> list[rigid_motion.RigidPath]:
        i = int(np.searchsorted(self._bodies.labels, body))
        return [self._relative.paths[i], self._carriers[self._carrier[i]]]

    def points_seen_from(self, body: int, label: int, points: Array) -> tuple[Array, Array]:
        """Paths of points of an obstacle and of a body's nodes in the frame of the body.

        Args:
            body: The body.
            label: Label of the obstacle.
            points: Positions of its points at the start, shape (k, d) [length].

        Returns:
            Of the points (m + 1, k, d) and of the nodes (m + 1, n, d) [length].
        """
        frame, obstacle = self._frame_of(body), self.motions[label]
        end, i = obstacle.back(self._x1, 1.0), int(np.searchsorted(self._bodies.labels, body))
        if self._bodies.distances_to(end)[i] < self._least[i]:
            frame = [self._fit(end).paths[i], obstacle]
        end = _back(frame, self._x1, 1.0)
        angle = abs(obstacle.angle) + sum(abs(rotation.angle) for rotation in frame)
        times = np.array([0.0, *self._times(angle, [obstacle, *frame], points), 1.0])
        along = [_back(frame, obstacle.carry(points, t), t) for t in times]
        return np.array(along), self._x0 + times[:, None, None] * (end - self._x0)

    def _times(self, angle: float, frame: Sequence[rigid_motion.RigidPath], points: Array) -> Array:
        """Times between straight sections of paths with a rotation by ``angle``, 0 to 1.

        Args:
            angle: The rotation [radian].
            frame: Rotations, whose centres count.
            points: Points besides the nodes, shape (k, d) [length].
        """
        every, centres = np.concatenate([points, self._box]), np.array([r.start for r in frame])
        reach = norms(np.abs(every[:, None] - centres).max(axis=0)).max()
        largest = np.sqrt(8.0 * self._resolution / max(reach, TINY))  # the sagitta is r a^2 / 8
        largest = max(min(largest, LIMITS.section_turn), TINY)
        sections = int(np.clip(np.ceil(angle / largest), 1, LIMITS.max_points))
        return np.arange(1, sections) / sections


def _back(frame: Sequence[rigid_motion.RigidPath], x: Array, t: float) -> Array:
    """Move positions ``x`` (n, d) [length] with a frame from the time ``t`` to the start."""
    for rotation in reversed(frame):
        x = rotation.back(x, t)
    return x
