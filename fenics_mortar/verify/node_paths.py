# SPDX-License-Identifier: MIT
"""Paths of nodes in a step: bodies and obstacles that turn, one seen from another.

The motion of an obstacle between two places is known: its pivot moves on a straight line, and its
angle grows from one value to the other, also by more than a full turn. So is that of a body on a
rigid boundary. Of other bodies only the ends of the path of each node are known. Their motion is
fitted: a centre on a straight line and a rotation, of less than half a turn. The centre is that of
the prescribed nodes, if there are any, or the fixed point of their motion if this point is nearer
than the farthest node, as for a paddle that turns about its hub. The fixed point of a wheel that
rolls is not: it is R a / (2 sin a/2) > R away. Bodies without prescribed nodes may be carried
along: their paths are fitted in the frame in which they move least, that of space, of an obstacle
or of a body with prescribed nodes.

A rotation by more than a sixth of a turn may as well have had the other sense, or another centre:
see ``Alternative``.

Bodies that prescribed values turn, and how far in a step.

The ends of a step tell the rotation of a body up to full turns: values that turn a shaft by 350
degrees are those that turn it back by 10. So are slip, the direction of friction, wear and the
bodies passed. Angles of rigid boundaries are known; of other prescribed values the shortest turn is
taken, and larger ones than ``TOLD_TURN`` are told. On a path loads are a function of the time,
evaluated within each step as well: see ``path.stepping``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import TYPE_CHECKING, Literal, NamedTuple

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.arcs import LEADS, Carried, rotated_by
from fenics_mortar.contact.contact import Contact
from fenics_mortar.obstacles.rigid_motion import TURNS, polar, rotation_by, vector_of
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import (
    ROUNDING,
    SMALL_ANGLE,
    TINY,
    Array,
    Value,
    cross_in_plane,
    norms,
)
from fenics_mortar.verify.finding import LIMITS

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.tied import Tie
    from fenics_mortar.interface.outline import Hull, Outline
    from fenics_mortar.interface.surfaces import Surface
    from fenics_mortar.obstacles.rigid_motion import RigidMotion
    from fenics_mortar.rigid.floating import FloatingBodies
    from fenics_mortar.utils.arrays import Flags, Indices

# Turn of a body by prescribed values in a step [radian], 5 degrees, above which its sense is told
# to be uncertain: 72 steps for a full turn are taken for what they look like.
TOLD_TURN = np.pi / 36
# Distance of prescribed nodes from a rigid motion over their motion [1], below which they turn: the
# ends of a beam that is bent do not. A stretch of 5 % beside a quarter of a turn.
STRETCHED = 0.05
# Extent of prescribed nodes, in space across a line, over their distance from the origin [1], below
# which they do not tell a rotation.
SLENDER = 1e-6

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
    """Bodies with prescribed nodes and their turns.

    All methods are local but ``messages`` and the constructor.

    Args:
        bulk: The bodies.
        contacts: All pairs.
        floating: Bodies and their names.
        outline: Outlines or hulls of the bodies in contact.

    Attributes:
        sides: Bodies of each pair by their numbers in ``floating.labels``, slave and master, -1 for
            an obstacle, of which prescribed values lead at least one.
        may_turn: Whether values may be those of a rotation, not one constant for each body.
        examined: Whether loads were evaluated at times within the present step.
    """

    def __init__(
        self,
        bulk: Bulk,
        contacts: Sequence[Contact | Tie],
        floating: FloatingBodies,
        outline: Outline | Hull,
    ) -> None:
        self._bulk, self._contacts, self._floating = bulk, contacts, floating
        self._outline = outline
        self._leaders = {b: m for b, m in floating.leaders.items() if b in outline.bodies}
        labels = outline.gather(bulk.space.spread(floating.labels))
        self.bodies = labels[:, 0].astype(np.int64)
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
        known = np.isin(self._parts, list(floating.leaders))
        self._known = set(self.bodies[known].tolist())
        names = sorted(led - self._known) if self.may_turn else []
        self._names = {body: floating.name_of(body) for body in names}
        self.examined = False
        self._taken: dict[tuple[int, int], Array] = {}

    def _sides_of(self, contact: Contact | Tie) -> Iterable[tuple[int, int]]:
        """The bodies on both sides of a contact (collective the first time)."""
        if not isinstance(contact, Contact):
            return ()
        both = product(self._of(contact.slave), self._of(contact.master) or [-1])
        return [sides for sides in both if sides[0] != sides[1]]

    def _of(self, surface: Surface) -> list[int]:
        """Numbers of the bodies of a surface, none for an obstacle."""
        return sorted(set(self._floating.labels_of(surface).astype(np.int64).tolist()))

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
        found = (turn_of(x0[at], x1[at], stretched) for at in marks)
        return dict(zip(bodies, found, strict=True))

    @property
    def places(self) -> Array:
        """Places of the rigid boundaries that lead bodies, (leaders, 3) [length, radian]."""
        places = [motion.place for motion in self._leaders.values()]
        return np.reshape(places, (len(places), len(places[0]) if places else 3))

    def leading(self, accepted: AcceptedPositions) -> dict[int, RigidPath]:
        """Motions of the rigid boundaries in a step, by the bodies that they lead."""
        led = zip(self._leaders.items(), accepted.leaders, self.places, strict=True)
        return {body: motion_of(leader, *ends) for (body, leader), *ends in led}

    def _positions(self) -> Array:
        return self._outline.positions(self._bulk.u.x.array)

    def _prescribed_positions(self) -> Array:
        """Positions of the outlines' nodes, of prescribed ones by their values."""
        values = self._bulk.values.copy()
        compat.set_prescribed(values, self._bulk.bcs)
        return self._outline.positions(values)

    def carried(self, accepted: AcceptedPositions, *, solved: bool = False) -> Carried | None:
        """The outlines' nodes after the motions that lead bodies in this step; see ``arcs``.

        After those of all bodies to the present state if it is ``solved``. ``None`` if no body is
        led to turn by more than ``LEADS``.
        """
        if not (solved or self.may_turn):
            return None
        x1 = self._positions() if solved else self._prescribed_positions()
        found = self._carried(accepted.x, x1, self.leading(accepted), solved=solved)
        leads = np.nan_to_num(norms(found.turn)).max(initial=0.0) > LEADS
        return found if leads else None

    def carried_from_here(self) -> Carried:
        """The outlines' nodes after motions from where they are to prescribed values."""
        return self._carried(self._positions(), self._prescribed_positions(), {})

    def _carried(
        self, x0: Array, x1: Array, known: Mapping[int, RigidPath], *, solved: bool = False
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
        size, axes = x0.shape, len(TURNS[x0.shape[1]])
        x, pivots = x0.copy(), np.zeros((2, *size))
        turn, straight = np.zeros((size[0], axes)), np.zeros((size[0], 1))
        for body in np.unique(self.bodies if solved else self.bodies[self.prescribed]).tolist():
            mine = self.bodies == body
            led, parts = mine & self.prescribed, set(self._parts[mine].tolist())
            leader = next((known[part] for part in sorted(parts) if part in known), None)
            led = led if not solved or tells_turn(x0[led]) else mine
            path = path_of(x0[led], x1[led], x0[mine]) if leader is None else leader
            apart, moved = (norms(path.carry(x0[led], 1.0) - x).max() for x in (x1[led], x0[led]))
            if leader is None and apart > STRETCHED * moved and (led != mine).any():
                turn[mine] = np.nan if np.linalg.norm(path.turn) > SMALL_ANGLE else 0.0
                continue  # its prescribed nodes do not move as one
            x[mine], turn[mine] = path.carry(x0[mine], 1.0), path.turn
            pivots[:, mine] = np.stack([path.start, path.end])[:, None]
            straight[mine] = float(leader is not None)
        return Carried(x, turn, pivots[0], pivots[1], straight)

    def relative(self, sides: tuple[int, int], turns: Turns) -> Array:
        """Rotation of the slave less that of the master, as a vector [radian]."""
        still = np.zeros(len(TURNS[self._bulk.space.dim]))
        slave, master = (turns.get(side, still) for side in sides)
        return np.asarray(slave - master)

    def doubtful(self, x0: Array, x1: Array, least: float = TOLD_TURN) -> Turns:
        """Turns by values that tell them up to full turns only, above ``least``, in a step."""
        if self.examined or not self.may_turn or np.array_equal(x0, x1):
            return {}
        found = self.turns(x0, x1, STRETCHED).items()
        return {
            body: turn
            for body, turn in found
            if body in self._names and np.linalg.norm(turn) > least
        }

    def taken(self, accepted: AcceptedPositions) -> list[str]:
        """Notes on smaller turns by values, the first time and when their sense changes (local).

        With friction or wear only; see ``messages``.
        """
        x0, x1 = accepted.x, self._positions()
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
        self, accepted: AcceptedPositions, places: Array, told: Collection[int] = ()
    ) -> list[str]:
        """Message on turns up to which slip is uncertain, or on a step in which nothing moved.

        Collective. With friction or wear only; none if the loads were examined.

        Args:
            accepted: Positions at the start of the step.
            places: Present positions of the obstacles, shape (obstacles, 3).
            told: Numbers of pairs of which the turns at nodes are told.
        """
        x0, x1 = accepted.x, self._positions()
        moved = not np.array_equal(accepted.places, places)
        of_pairs = self._rubbing(told)
        if self.examined or not self.may_turn or not of_pairs:
            return []
        size = float(np.abs(x1).max(initial=0.0))
        if not moved and np.abs(x1 - x0).max(initial=0.0) <= ROUNDING * size:
            names = self._of_functions(of_pairs)
            text = "nothing moved in the step; prescribed values may have turned"
            return [f"{text} {name} by full turns: {OTHERWISE}" for name in names[:1]]
        turns, found = self.doubtful(x0, x1), list[str]()
        for sides in of_pairs:
            angle = float(np.degrees(np.linalg.norm(self.relative(sides, turns))))
            if angle > np.degrees(TOLD_TURN):
                sizes = {float(np.linalg.norm(turns[b])): b for b in sides if b in turns}
                found.append(
                    f"prescribed values turned {self._names[sizes[max(sizes)]]} by {angle:.0f} "
                    f"degrees in the step, if not by {360.0 - angle:.0f} the other way round: "
                    f"{OTHERWISE}"
                )
        return found[:1]

    def _of_functions(self, of_pairs: Sequence[tuple[int, int]]) -> list[str]:
        """Names of led bodies of pairs, if functions that are not zero prescribe values."""
        bcs = [bc for bc in self._bulk.bcs if bc.g is not None]
        functions = [bc for bc in bcs if not compat.prescribed_value(bc).size]
        given = any(compat.condition_numbers(bc).any() for bc in functions)
        if not self._bulk.comm.allreduce(given, MPI.LOR):
            return []
        return [self._names[body] for sides in of_pairs for body in sides if body in self._names]


def turn_of(x0: Array, x1: Array, stretched: float) -> Array:
    """Rotation of nodes, an angle (1,) or a vector (3,), of at most half a turn [radian] (local).

    Zero for nodes that do not tell a rotation.

    Args:
        x0: Their positions, shape (n, d) [length].
        x1: Their positions later.
        stretched: Distance from a rigid motion over the motion [1] above which they do not turn.
    """
    y0, y1 = x0 - x0.mean(axis=0), x1 - x1.mean(axis=0)
    none = np.zeros(len(TURNS[x0.shape[1]]))
    if not tells_turn(x0):
        return none
    R, _ = polar(y1.T @ y0)
    apart, moved = (np.linalg.norm(y - y0 @ R.T) for y in (y1, y0))
    if apart / stretched > moved:
        return none
    return vector_of(R)


def tells_turn(x0: Array) -> bool:
    """Whether nodes (n, d) tell a rotation: not one point; in space no points on a line."""
    dim = x0.shape[1]
    if len(x0) < dim:
        return False
    extents = np.linalg.svd(x0 - x0.mean(axis=0), compute_uv=False)
    return bool(extents[dim - 2] > SLENDER * float(np.linalg.norm(x0)))


def _rubs(contact: Contact | Tie) -> bool:
    """Whether a contact is closed and depends on slip."""
    if not isinstance(contact, Contact) or contact.pair.sliding == "small":
        return False
    law = contact.pair.law
    return bool((law.has_friction or law.needs_nodal_state) and contact.active.any())


@dataclass(frozen=True)
class RigidPath:
    """Motion of a rigid frame in a step: a point on a straight line, and a rotation about it.

    Attributes:
        start: The point at the start, shape (dim,) [length].
        end: The point at the end, shape (dim,) [length].
        turn: Angle of the rotation, shape (1,), in space its vector, (3,), of any size [radian].
    """

    start: Array
    end: Array
    turn: Array

    @property
    def angle(self) -> float:
        """Angle of the rotation, in space without sign [radian]."""
        return float(self.turn[0] if self.turn.size == 1 else np.linalg.norm(self.turn))

    def turned(self, vectors: Array, t: float) -> Array:
        """Vectors (n, dim) [any unit] turned by the rotation up to ``t``, negative: back."""
        return vectors @ rotation_by(t * self.turn).T

    def carry(self, x: Array, t: float) -> Array:
        """Positions at ``t``, 0 to 1, of points at ``x`` (n, dim) at the start [length]."""
        return self._centre(t) + self.turned(x - self.start, t)

    def back(self, x: Array, t: float) -> Array:
        """Positions at the start of points that are at ``x`` (n, dim) at ``t`` [length]."""
        return self.start + self.turned(x - self._centre(t), -t)

    def _centre(self, t: float) -> Array:
        return self.start + t * (self.end - self.start)

    def backwards(self) -> RigidPath:
        """The motion to the same positions with the other sense of rotation."""
        factor = 1.0 - 2.0 * np.pi / abs(self.angle) if self.angle else 0.0
        return replace(self, turn=factor * self.turn)


def path_of(x0: Array, x1: Array, body: Array) -> RigidPath:
    """Rigid motion of nodes (n, d) from ``x0`` to ``x1``, of a body with nodes at ``body`` (m, d).

    The mean of the nodes moves on a straight line, or all turn about a fixed point, in space an
    axis, that is inside the body, as near to the mean as its farthest node (local).
    """
    turn, start, end = turn_of(x0, x1, np.inf), x0.mean(axis=0), x1.mean(axis=0)
    angle, dim = float(np.linalg.norm(turn)), x0.shape[1]
    if angle <= SMALL_ANGLE:
        return RigidPath(start, end, turn)
    axis = np.pad(turn, (3 - turn.size, 0)) / angle
    shift = np.pad(end - start, (0, 3 - dim))
    across = shift - (axis @ shift) * axis
    to_axis = 0.5 * (across + np.cross(axis, across) / np.tan(0.5 * angle))
    if np.linalg.norm(to_axis) >= norms(body - start).max():
        return RigidPath(start, end, turn)
    fixed = start + to_axis[:dim]
    return RigidPath(fixed, fixed + (shift - across)[:dim], turn)


# Alternative to the motions of bodies, see ``Motions``; "" for none.
Alternative = Literal["", "sense", "centre"]
AT_REST = RigidPath(np.zeros(2), np.zeros(2), np.zeros(1))
NONE_KNOWN: Mapping[int, RigidPath] = {}


class StepEnds(NamedTuple):
    """Start and end of a step.

    Attributes:
        x0: Positions of the outlines' nodes at the start, shape (n, dim) [length].
        x1: Positions at the end, shape (n, dim) [length].
        prescribed: Whether all components of a node are prescribed, shape (n,), bool.
        before: Places of the obstacles at the start, shape (obstacles, m) [length, radian].
        after: Places at the end, likewise.
        known: Motions that rigid boundaries prescribe, by the body that they lead.
        doubtful: Bodies that prescribed values turn by angles that the ends do not tell.
    """

    x0: Array
    x1: Array
    prescribed: Flags | None = None
    before: Array = np.zeros((0, 3))
    after: Array = np.zeros((0, 3))
    known: Mapping[int, RigidPath] = NONE_KNOWN
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


def motion_of(mover: RigidMotion, before: Array, after: Array) -> RigidPath:
    """Motion of an obstacle or a boundary between places (m,) [length, radian] (local).

    In space ``after`` is its present place.
    """
    dim = mover.dim
    turn = after[2:] - before[2:] if dim == 2 else mover.turn_since(before)
    return RigidPath(mover.pivot + before[:dim], mover.pivot + after[:dim], turn)


class Motions:
    """Rigid motions of bodies in a step, least-squares fits to the motions of nodes (local).

    Args:
        ends: Both ends of the step; rotations of ``doubtful`` bodies by more than ``TOLD_TURN`` may
            have had the other sense.
        bodies: The bodies, shape (b,), and the number of that of each node among them, shape (n,).
        other: Alternative to rotations by more than a sixth of a turn: "sense" for rotations in the
            other sense, "centre" for those about the mean of the prescribed nodes instead of the
            fixed point, or the reverse.

    Attributes:
        labels: The bodies, shape (b,).
        angles: Their rotations, shape (b,) [radian].
        are_led: Whether a body has prescribed nodes, shape (b,), bool.
        are_known: Whether the motion of a body is known, shape (b,), bool.
        two_ways: Whether its rotation may have had the other sense, shape (b,), bool.
    """

    def __init__(
        self, ends: StepEnds, bodies: tuple[Indices, Indices], other: Alternative = ""
    ) -> None:
        self._x0, self._x1 = x0, x1 = ends[:2]
        self.labels, self.of_node = bodies
        led = np.zeros(len(x0), bool) if ends.prescribed is None else ends.prescribed
        self.are_led: Flags = np.bincount(self.of_node[led], minlength=self.labels.size) > 0
        weight = np.where(self.are_led[self.of_node], led, 1.0)[:, None]
        self._start, self._end = self._mean(x0, weight), self._mean(x1, weight)
        self.angles: Array = self._fit(weight)
        far = np.abs(self.angles) > LIMITS.two_ways
        turned = np.abs(self.angles) > TOLD_TURN  # not as seen from the body itself
        self.two_ways: Flags = far | (turned & np.isin(self.labels, list(ends.doubtful)))
        if other == "sense":
            self.angles -= np.where(self.two_ways, 2.0 * np.pi * np.sign(self.angles), 0.0)
        self._turn_about_fixed_points(far & (other == "centre"))
        self.are_known: Flags = np.zeros(self.labels.size, bool)
        for i, body in enumerate(self.labels.tolist()):
            if body in ends.known:
                self._take(i, ends.known[body])

    def _take(self, i: int, known: RigidPath) -> None:
        """Take a known motion of body ``i``, if the fitted one equals it up to full turns."""
        turns = (known.angle - self.angles[i]) / (2.0 * np.pi)
        if 2.0 * np.pi * abs(turns - np.round(turns)) > SMALL_ANGLE:
            return  # nodes were not where the boundary was at the start
        self.are_known[i], self.two_ways[i] = True, False
        self._start[i], self._end[i] = known.start, known.end
        self.angles[i] = known.angle

    def _mean(self, values: Array, weight: Array) -> Array:
        """Means of values (n, 2) with weights (n, 1) over the nodes of each body, (b, 2)."""
        return self._sums(values * weight) / self._sums(weight)

    def _sums(self, values: Array) -> Array:
        """Sums of values (n, k) over the nodes of each body, shape (b, k)."""
        k = values.shape[1]
        at = (k * self.of_node[:, None] + np.arange(k)).ravel()
        sums = np.bincount(at, values.ravel(), k * self.labels.size)
        return np.asarray(sums.reshape(-1, k), float)

    def _fit(self, weight: Array) -> Array:
        """Angles of the rotations about the centres (b,); of all nodes if one is prescribed."""
        y0, y1 = self._x0 - self._start[self.of_node], self._x1 - self._end[self.of_node]
        products = np.stack([(y0 * y1).sum(axis=1), cross_in_plane(y0, y1)], 1)
        sums, every = self._sums(products * weight), self._sums(products)
        is_point = np.abs(sums).max(axis=1) <= TINY
        dot, cross = np.where(is_point[:, None], every, sums).T
        return np.asarray(np.arctan2(cross, dot))

    def _turn_about_fixed_points(self, exchanged: Flags) -> None:
        """Move the centres of bodies with prescribed nodes to fixed points inside the bodies.

        For bodies marked in ``exchanged`` (b,) to fixed points outside instead.
        """
        may = self.are_led & (np.abs(self.angles) > SMALL_ANGLE)
        if not may.any():
            return
        shift, half = self._end - self._start, 0.5 * self.angles
        with np.errstate(divide="ignore", invalid="ignore"):
            across = np.stack([-shift[:, 1], shift[:, 0]], axis=1) / np.tan(half)[:, None]
            away = 0.5 * np.hypot(*shift.T) / np.abs(np.sin(half))
        reach = np.zeros(self.labels.size)
        np.maximum.at(reach, self.of_node, np.hypot(*(self._x0 - self._start[self.of_node]).T))
        about = may & ((away < reach) != exchanged)
        fixed = 0.5 * (self._start + self._end + across)
        self._start = np.where(about[:, None], fixed, self._start)
        self._end = np.where(about[:, None], fixed, self._end)

    def of(self, body: int) -> RigidPath:
        """The motion of the body with the number ``body`` in ``labels``."""
        return RigidPath(self._start[body], self._end[body], self.angles[body : body + 1])

    def distances_to(self, x: Array) -> Array:
        """Root mean squares of the distances of nodes from ``x`` (n, 2), by body, (b,) [length]."""
        square = ((x - self._x0) ** 2).sum(axis=1)[:, None]
        return np.asarray(np.sqrt(self._mean(square, np.ones_like(square))[:, 0]))

    def at(self, t: float) -> Array:
        """Positions of the nodes at the time ``t``, 0 to 1, shape (n, 2) [length]."""
        i = self.of_node
        y0 = self._x0 - self._start[i]
        y1 = rotated_by(self._x1 - self._end[i], -self.angles[i])
        centre = self._start + t * (self._end - self._start)
        return centre[i] + rotated_by(y0 + t * (y1 - y0), t * self.angles[i])


class Paths:
    """Paths of all nodes in a step, as seen from bodies and obstacles (local).

    A frame is a list of rotations, to be carried out in this order. Positions in a frame are moved
    with it to the start of the step.

    Args:
        ends: Both ends of the step.
        bodies: Body of each node, shape (n,).
        obstacles: Motions of the obstacles, by labels that are no bodies.
        resolution: Largest distance of a path from its straight sections [length].
        other: Whether motions that the ends of the paths do not tell have the other alternative,
            see ``Motions``.

    Attributes:
        motions: Motions of the obstacles.
    """

    def __init__(
        self, ends: StepEnds, bodies: Indices, obstacles: Mapping[int, RigidPath],
        resolution: float, other: Alternative = "",
    ) -> None:  # fmt: skip
        self._x0, self._x1, self._resolution, self._known = *ends[:2], resolution, ends.known
        both = np.concatenate([self._x0, self._x1])
        self._box = np.stack([both.min(axis=0), both.max(axis=0)])
        labels, of_node = np.unique(bodies, return_inverse=True)

        def fit(end: Array, known: Mapping[int, RigidPath] = NONE_KNOWN) -> Motions:
            return Motions(ends._replace(x1=end, known=known), (labels, of_node), other)

        self._fit: Callable[..., Motions] = fit
        self.motions = obstacles
        self._bodies = fit(self._x1, ends.known)
        leaders = [self._bodies.of(i) for i in np.flatnonzero(self._bodies.are_led)]
        self._carriers = [AT_REST, *(c for c in (*obstacles.values(), *leaders) if c.angle)]
        self._choose_carriers()

    @property
    def alternatives(self) -> Sequence[Alternative]:
        """Other forms of the motions of bodies that turned too far for the ends to tell."""
        return ("sense", "centre") if self._relative.two_ways.any() else ()

    def _choose_carriers(self) -> None:
        """Find the frame in which each body moves least, and its motion there."""
        i, led = self._bodies.of_node, self._bodies.are_led
        ends = np.array([carrier.back(self._x1, 1.0) for carrier in self._carriers])
        distances = np.array([self._bodies.distances_to(end) for end in ends])
        distances[1:, led | self._bodies.are_known] = np.inf
        self._carrier: Indices = distances.argmin(axis=0)
        self._least: Array = distances.min(axis=0)
        self._relative = self._fit(ends[self._carrier[i], np.arange(len(i))], self._known)
        self._least[self._relative.are_known] = 0.0

    def at(self, t: float) -> Array:
        """Positions of the nodes in space at the time ``t``, 0 to 1, shape (n, 2) [length]."""
        x = self._relative.at(t)
        for k in np.unique(self._carrier):
            mine = self._carrier[self._bodies.of_node] == k
            x[mine] = self._carriers[k].carry(x[mine], t)
        return x

    def seen_from(self, label: int) -> Array:
        """Paths of the nodes in the frame of a body or an obstacle, shape (m + 1, n, 2) [length].

        Bodies that move less in this frame than in that of their carrier are carried by it.
        """
        frame = [self.motions[label]] if label in self.motions else self._frame_of(label)
        end, none = _back(frame, self._x1, 1.0), self._x0[:0]
        carriers = np.array([carrier.angle for carrier in self._carriers])
        angles = np.abs(carriers[self._carrier]) + np.abs(self._relative.angles)
        angles += sum(abs(rotation.angle) for rotation in frame)
        if not self._times(angles.max(initial=0.0), frame, none).size:
            return np.array([self._x0, end])  # straight, whatever carries the bodies
        inside = self._fit(end)
        carried = inside.distances_to(end) < self._least
        angle = float(np.where(carried, np.abs(inside.angles), angles).max(initial=0.0))
        along, carried = list[Array](), carried[inside.of_node]
        for t in self._times(angle, frame, none):
            far = self._x0 if carried.all() else _back(frame, self.at(t), t)
            along.append(np.where(carried[:, None], inside.at(t), far))
        return np.array([self._x0, *along, end])

    def _frame_of(self, body: int) -> list[RigidPath]:
        i = int(np.searchsorted(self._bodies.labels, body))
        return [self._relative.of(i), self._carriers[self._carrier[i]]]

    def points_seen_from(self, body: int, label: int, points: Array) -> tuple[Array, Array]:
        """Paths of points of an obstacle and of a body's nodes in the frame of the body.

        Args:
            body: The body.
            label: Label of the obstacle.
            points: Positions of its points at the start, shape (k, 2) [length].

        Returns:
            Of the points (m + 1, k, 2) and of the nodes (m + 1, n, 2) [length].
        """
        frame, obstacle = self._frame_of(body), self.motions[label]
        end, i = obstacle.back(self._x1, 1.0), int(np.searchsorted(self._bodies.labels, body))
        if self._bodies.distances_to(end)[i] < self._least[i]:
            frame = [self._fit(end).of(i), obstacle]
        end = _back(frame, self._x1, 1.0)
        angle = abs(obstacle.angle) + sum(abs(rotation.angle) for rotation in frame)
        times = np.array([0.0, *self._times(angle, [obstacle, *frame], points), 1.0])
        along = [_back(frame, obstacle.carry(points, t), t) for t in times]
        return np.array(along), self._x0 + times[:, None, None] * (end - self._x0)

    def _times(self, angle: float, frame: Sequence[RigidPath], points: Array) -> Array:
        """Times between straight sections of paths with a rotation by ``angle``, 0 to 1.

        Args:
            angle: The rotation [radian].
            frame: Rotations, of which the centres count.
            points: Points besides the nodes, shape (k, 2) [length].
        """
        every, centres = np.concatenate([points, self._box]), np.array([r.start for r in frame])
        reach = np.hypot(*np.abs(every[:, None] - centres).max(axis=0).T).max()
        sections = num_sections(angle, reach, self._resolution)
        return np.arange(1, sections) / sections


def num_sections(angle: float, reach: float, resolution: float) -> int:
    """Number of straight sections of the paths of points that turn (local).

    The sagitta of a chord of angle a is r a^2 / 8.

    Args:
        angle: Angle of the rotation [radian].
        reach: Distance r of the farthest point from its centre [length].
        resolution: Largest distance of a path from its sections [length].
    """
    largest = min(np.sqrt(8.0 * resolution / max(reach, TINY)), LIMITS.section_turn)
    return int(min(max(np.ceil(angle / max(largest, TINY)), 1), LIMITS.max_points))


def _back(frame: Sequence[RigidPath], x: Array, t: float) -> Array:
    """Move positions ``x`` (n, 2) [length] with a frame from the time ``t`` to the start."""
    for rotation in reversed(frame):
        x = rotation.back(x, t)
    return x
