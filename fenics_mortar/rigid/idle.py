# SPDX-License-Identifier: MIT
"""Idle bodies: floating bodies without load that no contact force acts on.

Such a body is in equilibrium wherever it does not overlap other bodies. An active set that closes
its gaps is therefore not unique, and its multipliers are rounding of either sign. An idle body is
instead set aside: its multipliers are zero, and after each Newton step it is moved rigidly to the
nearest place, next to that before the solve, without overlap,

    minimize  |v|^2,    g_j + dg_j . v >= 0    for all of its nodes,

with the motions v of all idle bodies since the start of the solve, a least-distance problem. If it
has no solution nearby, its neighbours squeeze some of these bodies, those with a multiplier in the
certificate of infeasibility. They take part in contact again, until no force acts on them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk.bodies import centre_and_size
from fenics_mortar.contact.rows import strength
from fenics_mortar.obstacles.rigid_motion import RIGID, motion_between, rigid_motions
from fenics_mortar.rigid import body_motions
from fenics_mortar.rigid.complementarity import nearest_below, nearly_touching
from fenics_mortar.rigid.floating import FloatingBodies, Moves, unsupported
from fenics_mortar.utils.arrays import LAST_DIGITS, SOLVED, Array
from fenics_mortar.utils.ranks import largest_over_ranks

if TYPE_CHECKING:
    from fenics_mortar.contact.contact import Contact


class IdleBodies:
    """Idle bodies of a problem; all methods are collective.

    Args:
        bodies: The floating bodies; their ``aside`` is set.

    Attributes:
        were_aside: Whether bodies were set aside since ``reset``.
        first: Labels of the bodies that are set aside at the start of the solve, after ``find``.
    """

    def __init__(self, bodies: FloatingBodies) -> None:
        self._bodies = bodies
        self.were_aside, self._may_be_aside = False, True
        self._unloaded: list[body_motions.BoundBody] = []
        self.first: set[int] = set()
        self._readmissions = Counter[int]()
        self._home: Array = bodies.bulk.values
        self._before: dict[int, float] = {}
        self._driven: set[int] = set()

    # A solve

    def reset(self, *, may_be_aside: bool) -> None:
        """Begin an attempt to solve, in which bodies may be set aside or not."""
        self.end()
        self.were_aside, self._may_be_aside = False, may_be_aside

    def evaluate(self, evaluate: Callable[[], tuple[Array, Array]]) -> tuple[Array, Array]:
        """Evaluate the contacts before a solve; set bodies aside that are free to give way.

        These are idle at present, and may move away from all bodies that they touch.

        Args:
            evaluate: Function that evaluates the contacts at the present state and returns the
                forces of the bulk and of contact, shape (owned dofs,) each [stress length].

        Returns:
            These forces.
        """
        bodies = self._bodies
        self._set_aside(())
        bulk, contact = evaluate()
        size = float(np.abs(bulk).sum() + np.abs(contact).sum())
        self._driven = bodies.driven_by(bulk, size)
        self._unloaded = [
            body
            for body in bodies.bodies
            if self._may_be_aside and body.label not in self._driven and self._may_be_idle(body)
        ]
        self._set_aside(body.label for body in self._unloaded if not body.is_loaded())
        if not bodies.aside:
            return bulk, contact
        self._readmit_enclosed()
        return evaluate()

    def find(self, evaluate: Callable[[], tuple[Array, Array]]) -> None:
        """Find the bodies to be set aside at the start of a solve.

        If these support others, all take part in contact until no force acts on them.

        Args:
            evaluate: As of ``evaluate``.
        """
        bodies = self._bodies
        self._home, self.first = bodies.bulk.values.copy(), set()
        self._before = {
            body.label: body_motions.largest_multiplier(c.z[body.at(c)] for c in bodies.contacts)
            for body in bodies.bodies
        }
        if not bodies.bodies:
            return
        bulk, _ = self.evaluate(evaluate)
        others = {body.label for body in bodies.bodies} - bodies.aside
        if bodies.aside and not (others and unsupported(bodies, bulk) & others):
            self.first = bodies.aside
        self._set_aside(())

    def give_way(self, moves: Moves) -> Moves:
        """Shorten moves of other bodies until idle bodies can give way; add moves of the latter.

        Args:
            moves: Bodies with the coefficients of their motions, (motions,) each [length].
        """
        idle = self._idle
        if not (idle and moves):
            return moves
        some, lengths = zip(*moves, strict=True)
        rates, advance = self._rates(idle), self._rates(some) @ np.concatenate(lengths)
        gaps = self._at_idle(lambda contact: contact.now.closing_gap)
        sizes = self._at_idle(lambda contact: contact.slave.nodal_lengths)
        slack = np.maximum(gaps, 0.0) + RIGID.overlap * sizes

        def response(fraction: float) -> Array | None:
            left = slack - fraction * advance
            found, _ = nearest_below(np.zeros(rates.shape[1]), rates, left)
            near = found is not None and _longest(idle, found) <= self._farthest(-left)
            return found if near else None

        low, high, given = 0.0, 1.0, np.zeros(rates.shape[1])
        fraction = high
        while high - low > RIGID.overlap:
            found = response(fraction)
            if found is None:
                high = fraction
            else:
                low, given = fraction, found
            fraction = 0.5 * (low + high)
        shortened = [(body, low * move) for body, move in moves]
        return [*shortened, *zip(idle, body_motions.by_body(idle, given), strict=True)]

    def begin(self) -> None:
        """Set the bodies aside that are idle at the start of the solve."""
        if self._unloaded:
            self._readmissions.clear()
            self._set_aside(self.first)

    def reach(self) -> float:
        """Largest motion of a body that gives way in this solve [length].

        It may go along with prescribed rigid motions of bodies and obstacles, as on a tray, but by
        no more, as a wedge that is squeezed out. The displacement of loaded floating bodies, and
        that of others without their rigid motion, is not prescribed.
        """
        bodies, largest, led = self._bodies, 0.0, 0.0
        if not bodies.aside:
            return largest
        for c in bodies.contacts:
            if c.obstacle is not None:
                way = motion_between(c.accepted_partners.place, c.obstacle.place, c.arm)
                led = max(led, float(np.linalg.norm(way)))
        bulk = bodies.bulk
        change = bulk.values - self._home
        floating = {body.label for body in bodies.bodies}
        count = bulk.space.num_nodes
        for label in range(bodies.num_bodies):
            mine = bodies.labels[:count] == label
            moved, X = change[bulk.space.owned_dofs[mine]], bulk.cells.X[:count][mine]
            if label not in floating:
                led = max(led, float(np.linalg.norm(moved, axis=1).max(initial=0.0)))
            if label not in floating or label in bodies.aside:
                moved = _deformation(X, moved, bulk.comm)
            largest = max(largest, float(np.abs(moved).max(initial=0.0)))
        largest, led = largest_over_ranks(bulk.comm, [largest, led])
        return (1.0 + SOLVED) * led + self._farthest(np.array([largest]))

    def describe_unsupported(self) -> list[str]:
        """Remarks, before ``end``, on bodies that nothing holds, with their free motions.

        Contact forces do not hold them either: a gap may be closed without any. Adhesion holds
        without a force.
        """
        bodies, found = self._bodies, dict[str, list[body_motions.BoundBody]]()
        idle = [
            body
            for body in bodies.bodies
            if body.label not in self._driven
            and not bodies.repeats(body)
            and not body.is_loaded(self._before.get(body.label, 0.0))
        ]
        for body in body_motions.bonded_motions(idle):
            aside = body.label in bodies.aside
            moved = aside and np.linalg.norm(self._motion(body)) > SOLVED * body.size
            where = "moved out of the way of other bodies" if moved else "left in place"
            found.setdefault(f"{body.describe_all()}: {where}", []).append(body)
        return [
            f"nothing holds {body_motions.names_of(group)}, and no contact force acts there; free "
            f"to {how}; if supports or loads were forgotten, check bcs and the residual"
            for how, group in found.items()
        ]

    def end(self) -> None:
        """End a solve or an attempt."""
        self._bodies.springs.remove_idle()
        self._unloaded, self.first, self._driven = [], set(), set()
        self._set_aside(())

    # An iteration

    def place(self, evaluate: Callable[[], object]) -> None:
        """Move the bodies set aside to the nearest places without overlap.

        Args:
            evaluate: Function that evaluates the operators at the present state.
        """
        creeping = 0
        self._bring_home()
        while idle := self._idle:
            evaluate()
            desired = -np.concatenate([self._motion(body) for body in idle])
            gaps, rates = self._at_idle(lambda contact: contact.now.closing_gap), self._rates(idle)
            move, pressed = nearest_below(desired, rates, gaps)
            farthest = self._farthest(rates @ desired - gaps)
            if creeping == RIGID.max_creeping:
                self._readmit(idle)
            elif move is None or _longest(idle, move - desired) > farthest:
                self._readmit(_moved_by(rates[pressed], idle) or idle)
            elif (np.abs(move) <= self._digits()).all():
                return
            else:
                longest = RIGID.largest_move * min(body.size for body in idle)
                fraction = min(longest / float(np.abs(move).max()), 1.0)
                creeping += fraction == 1.0
                for body, coefficients in zip(idle, body_motions.by_body(idle, move), strict=True):
                    body.move(fraction * coefficients)

    def _bring_home(self) -> None:
        """Put bodies set aside back that are farther away than one move: Newton steps throw them.

        They are not held in the tangent where they were in contact before.
        """
        bodies, bulk = self._bodies, self._bodies.bulk
        for body in self._unloaded:
            motion = self._motion(body)
            is_far = np.linalg.norm(motion) > RIGID.largest_move * body.size
            if body.label in bodies.aside and is_far:
                dofs = bulk.space.dofs[bodies.labels == body.label]
                bulk.u.x.array[dofs] = self._home[dofs]
                body.move_loads(-motion)

    def review(self) -> int:
        """Set bodies aside that no contact force acts on any more; return their number.

        Nor does one act without the springs on a body that contact presses against these alone.
        """
        bodies = self._bodies
        sprung = bodies.pressed_on_springs()
        quiet = {
            body.label
            for body in self._unloaded
            if body.label not in bodies.aside
            and self._readmissions[body.label] < RIGID.max_readmissions
            and (body.label in sprung or not body.is_loaded(self._before.get(body.label, 0.0)))
        }
        if quiet:
            self._set_aside(bodies.aside | quiet)
        return len(quiet)

    def _readmit_enclosed(self) -> None:
        """Readmit the bodies set aside that cannot move away from all bodies that they touch."""
        while idle := self._idle:
            rates = self._rates(idle)[self._at_idle(nearly_touching)]
            move, pressed = nearest_below(
                np.zeros(rates.shape[1]), rates, np.full(len(rates), -1.0)
            )
            farthest = len(idle) * self._farthest(np.ones(1))
            if move is not None and np.abs(move).max() <= farthest:
                return
            self._readmit(_moved_by(rates[pressed], idle) or idle)

    def _may_be_idle(self, body: body_motions.BoundBody) -> bool:
        """Whether a body has contacts, each with one other body, without adhesion or driven force.

        A node that faces several bodies would press on idle ones, too.
        """
        bodies, contacts = self._bodies, body.contacts
        for contact in contacts:
            law, obstacle = contact.pair.law, contact.obstacle
            driven = obstacle is not None and bool(np.isfinite(obstacle.load).any())
            on_slave, on_master = (
                bodies.labels_of(side) == body.label for side in (contact.slave, contact.master)
            )
            alone = not on_master.any() or (on_master.all() and not on_slave.any())
            if law.has_adhesion or law.bridges_gap or driven or not alone:
                return False
        return bool(contacts)

    @property
    def _idle(self) -> list[body_motions.BoundBody]:
        """The bodies that are set aside."""
        return [body for body in self._unloaded if body.label in self._bodies.aside]

    def _at_idle(self, values: Callable[[Contact], Any]) -> Any:
        """Values (slave nodes, ...) of the contacts at the covered nodes set aside, (n, ...)."""
        contacts = self._bodies.contacts
        return np.concatenate([values(c)[c.set_aside & c.now.covered] for c in contacts])

    def _rates(self, some: Sequence[body_motions.BoundBody]) -> Array:
        """Closing rates of the nodes set aside due to motions of bodies, (n, motions) [1]."""
        return np.asarray(self._at_idle(lambda contact: body_motions.closing(contact, *some).T))

    def _farthest(self, overlaps: Array) -> float:
        """Largest motion of bodies that give way, for overlaps (n,) where they were [length]."""
        slope = RIGID.narrowest
        for c in self._bodies.contacts:
            if c.pair.law.has_friction and c.set_aside.any():
                smallest = RIGID.weakest_spring * float(c.modulus.min())
                slopes, _ = strength(c.now, smallest)
                slope = max(slope, float(slopes[c.set_aside].max()))
        largest = float(np.hypot(1.0, 1.0 / slope)) * float(overlaps.max(initial=0.0))
        return (1.0 + SOLVED) * largest + self._digits()

    def _digits(self) -> float:
        """Rounding of gaps [length], as for active sets."""
        return LAST_DIGITS * max(
            float(np.abs(c.operators.x).max(initial=0.0)) for c in self._bodies.contacts
        )

    def _motion(self, body: body_motions.BoundBody) -> Array:
        """Rigid motion of a body since the start of the solve, (motions,) [length]."""
        bulk = self._bodies.bulk
        return body.rigid_fraction((bulk.values - self._home)[: bulk.num_owned])

    def _set_aside(self, labels: Iterable[int]) -> None:
        """Set these bodies aside, and no others."""
        bodies = self._bodies
        bodies.aside = set(labels)
        self.were_aside |= bool(bodies.aside)
        for contact in bodies.contacts:
            aside = np.zeros(contact.slave.num_nodes, bool)
            for body in bodies.bodies:
                if body.label in bodies.aside:
                    aside |= body.at(contact)
            contact.leave_out(aside)

    def _readmit(self, bodies: Iterable[body_motions.BoundBody]) -> None:
        """Let bodies take part in contact again."""
        labels = {body.label for body in bodies}
        self._readmissions.update(labels)
        self._set_aside(self._bodies.aside - labels)


def _deformation(X: Array, u: Array, comm: MPI.Comm) -> Array:
    """``u`` (n, dim) at ``X`` [length] without its rigid motion, of all ranks (collective)."""
    motions = rigid_motions(X, *centre_and_size(X, comm))
    rigid = motions.reshape(len(motions), -1)
    products = comm.allreduce(np.column_stack([rigid @ rigid.T, rigid @ u.ravel()]))
    fit = np.linalg.lstsq(products[:, :-1], products[:, -1], rcond=None)[0]
    return u - (fit @ rigid).reshape(u.shape)


def _moved_by(rates: Array, idle: Sequence[body_motions.BoundBody]) -> list[body_motions.BoundBody]:
    """Idle bodies whose motions change the gaps with these rates, (n, motions of all) [1]."""
    parts = body_motions.by_body(idle, np.abs(rates).max(axis=0))
    return [body for body, part in zip(idle, parts, strict=True) if part.any()]


def _longest(bodies: Sequence[body_motions.BoundBody], moves: Array) -> float:
    """Largest norm of the moves of bodies, (motions of all,) [length]."""
    return max(float(np.linalg.norm(move)) for move in body_motions.by_body(bodies, moves))
