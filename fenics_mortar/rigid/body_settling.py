# SPDX-License-Identifier: MIT
"""Rigid moves of floating bodies before a solve, and a check after it; all collective.

A body that is driven by its loads and not supported by active contact is moved rigidly until
contact stops it. Each move is the closest one to the direction of the resultant for which no node
overlaps by more than ``RIGID.overlap``: a quadratic program in the few rigid motions. Bodies that
contact may support are determined by limit analysis, see ``body_motions``.
"""

from __future__ import annotations

from collections.abc import Callable

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk.bodies import FloatingBody
from fenics_mortar.contact.contact import Contact
from fenics_mortar.newton.loop import NewtonReport
from fenics_mortar.rigid.body_motions import (
    BodyMotions,
    Touching,
    closing,
    is_ahead,
    loose_bodies,
    nearly_touching,
    opening,
    slipping,
    unresisted_motion,
)
from fenics_mortar.rigid.complementarity import closest_move
from fenics_mortar.rigid.proximal import RIGID
from fenics_mortar.utils.arrays import SOLVED, Array, Flags
from fenics_mortar.utils.errors import MortarError, NotConvergedError

# Bodies to be moved, with the coefficients of their motions, (motions,) each [length].
Moves = list[tuple[FloatingBody, Array]]


class BodySettling:
    """Moves of floating bodies before a solve, and check of the state after it.

    Args:
        bodies: The floating bodies.

    Attributes:
        touched: Active sets of the contacts at the start of ``settle``.
        moved: Bodies that the last ``settle`` moved.
    """

    def __init__(self, bodies: BodyMotions) -> None:
        self._bodies = bodies
        self._unloaded: list[FloatingBody] = []
        self._start: Array = bodies.bulk.u.x.array
        self._give_way: Callable[[Moves], Moves] = list
        self.touched: list[Flags] = []
        self.moved: list[FloatingBody] = []

    def begin(self) -> None:
        """Forget what the last solve moved: motions may be prescribed since (local)."""
        self.moved, self._unloaded = [], []

    def settle(
        self,
        evaluate: Callable[[], tuple[Array, Array]],
        give_way: Callable[[Moves], Moves],
        min_drive: float,
    ) -> list[str]:
        """Move the bodies that contact cannot support rigidly until it can.

        Args:
            evaluate: Function that evaluates the contacts at the present state and returns the
                forces of the bulk and of contact, shape (owned dofs,) each [stress length].
            give_way: Function that shortens moves until idle bodies can give way, and adds their
                moves.
            min_drive: Smallest resultant that moves a body, over the forces on it [1].

        Returns:
            A sentence for each body that was moved.

        Raises:
            NotConvergedError: On all ranks, if no contact stops a body.
        """
        bodies, self._give_way = self._bodies, give_way
        self._unloaded = [body for body in bodies.bodies if not bodies.is_loaded(body)]
        moved, creeping, extent = dict[int, float](), 0, bodies.extent()
        for number in range(RIGID.max_moves):
            forces = evaluate()
            if number == 0:
                self.touched = [contact.active.copy() for contact in bodies.contacts]
            moves = self._next_moves(*forces, min_drive, begun=number > 0)
            creeping = creeping + 1 if self._creeps(moves) else 0
            if not moves or creeping > RIGID.max_creeping:
                self._start = bodies.bulk.u.x.array.copy()
                self.moved = [body for body in bodies.bodies if body.label in moved]
                names = sorted(bodies.name_of(label) for label in sorted(moved))
                return [f"{name} was moved rigidly until contact stopped it" for name in names]
            for body, move in moves:
                bodies.move(body, move)
                moved[body.label] = moved.get(body.label, 0.0) + _length(body, move)
            if all(
                moved[body.label] > extent and self._has_left(body, move) for body, move in moves
            ):
                break
        body, move = moves[0]
        message = (
            f"{bodies.name_of(body.label)} can {body.describe(move, directed=True)} freely: it is "
            f"driven by loads, and neither Dirichlet conditions nor contact stop it"
        )
        raise NotConvergedError(message, NewtonReport(reason=message))

    def check(self, reach: float) -> list[str]:
        """Check bodies without contact force before and after the solve.

        Args:
            reach: Largest motion of a body set aside that gives way to deformation [length].

        Returns:
            A sentence for each body that was pushed towards a surface that may stop it.

        Raises:
            MortarError: On all ranks, if a body was pushed and no surface is ahead of it.
        """
        bodies, notes = self._bodies, []
        for body in self._unloaded:
            change = (bodies.bulk.u.x.array - self._start)[: bodies.bulk.num_owned]
            motion = bodies.rigid_fraction(body, change)
            distance, idle = float(np.linalg.norm(motion)), body.label in bodies.aside
            is_at_rest = distance <= SOLVED * body.size or (idle and distance <= reach)
            if is_at_rest or bodies.is_loaded(body):
                continue
            name = bodies.name_of(body.label)
            if not any(is_ahead(bodies, contact, body, motion) for contact in bodies.contacts):
                raise MortarError(
                    f"{name} can {body.describe(motion, directed=True)} freely: contact pushed it "
                    f"away, and its Dirichlet conditions do not fix it"
                )
            notes.append(f"{name} was pushed along by contact without a force")
        return notes + self._released()

    def _released(self) -> list[str]:
        """A sentence for each body that has lost all contact in the solve (collective)."""
        bodies, before = self._bodies, {body.label for body in self._unloaded}
        change, notes = (bodies.bulk.u.x.array - self._start)[: bodies.bulk.num_owned], []
        for body in bodies.bodies:
            if body.label in before or bodies.is_loaded(body):
                continue
            moved = np.linalg.norm(change[bodies.motions(body)[0]], axis=1).max(initial=0.0)
            largest = bodies.bulk.comm.allreduce(float(moved), MPI.MAX)
            notes.append(
                f"{bodies.name_of(body.label)} has lost all contact, and no force holds it: "
                f"it moved by up to {largest:.3g} in this solve"
            )
        return notes

    def _next_moves(self, bulk: Array, contact: Array, min_drive: float, *, begun: bool) -> Moves:
        """The next move of each driven, unsupported body; none of negligible length."""
        driven = self._driven(bulk, contact, min_drive, begun=begun)
        if not driven:
            return []
        bodies = self._bodies
        desired = np.concatenate([RIGID.largest_move * body.size * drive for body, drive in driven])
        rates = [
            np.where(
                c.set_aside[:, None],
                0.0,
                np.vstack([closing(bodies, c, body) for body, _ in driven]).T,
            )
            for c in bodies.contacts
        ]
        move = closest_move(desired, rates, bodies.contacts)
        ends = np.cumsum([len(body.motions) for body, _ in driven])[:-1]
        moves = [(body, m) for (body, _), m in zip(driven, np.split(move, ends), strict=True)]
        shortest = RIGID.overlap**2 * bodies.shortest_facet()
        return [(body, m) for body, m in self._give_way(moves) if np.linalg.norm(m) > shortest]

    def _driven(self, bulk: Array, contact: Array, min_drive: float, *, begun: bool) -> Moves:
        """Bodies driven by loads and not supported by contact, with unit directions.

        A body with contact force moves only along directions that active contact admits. Without
        friction and adhesion, a round body may rest on its facets although the smooth body would
        roll on. Limit analysis is therefore used in this case only for bodies that touch before
        they have moved or carried any force.
        """
        bodies = self._bodies
        total, sizes = bulk + contact, np.abs(bulk) + np.abs(contact)
        unloaded = [body for body in bodies.bodies if not bodies.is_loaded(body)]
        labels = {body.label for body in unloaded}
        reached = self._reached_by_loads(bulk, float(sizes.sum()))
        loose = [
            body for body in loose_bodies(bodies, sticking=False) if body.label in reached - labels
        ]
        driven = [
            (body, self._drive(body, total, sizes, min_drive)) for body in (*unloaded, *loose)
        ]
        driven = [(body, drive) for body, drive in driven if drive.any()]
        laws = [contact.pair.law for contact in bodies.contacts]
        if any(law.has_friction or law.has_adhesion for law in laws):
            judged = {body.label for body, _ in driven}
        else:
            judged = set() if begun else labels
        if driven and judged:
            unsupported = self.unsupported(bulk) | {body.label for body in bodies.bodies} - judged
            driven = [(body, drive) for body, drive in driven if body.label in unsupported]
        return driven

    def _reached_by_loads(self, bulk: Array, size: float) -> set[int]:
        """Labels of the bodies with loads, and of those that contact may pass loads on to.

        The contact forces of the accepted state drive no other body: its loads have been removed.

        Args:
            bulk: Forces of the bulk, the negative loads, shape (owned dofs,) [stress length].
            size: Sum of the sizes of all forces on this rank [stress length].
        """
        bodies = self._bodies
        force = bodies.bulk.comm.allreduce(size)
        reached = {
            body.label
            for body in bodies.bodies
            if np.linalg.norm(bodies.resultant(body, bulk)) > bodies.rounding(body, force)
        }
        groups = []
        for contact in bodies.contacts:
            at = {body.label for body in bodies.bodies if bodies.at_body(contact, body).any()}
            obstacle = contact.obstacle
            driven = obstacle is not None and bool(np.isfinite(obstacle.load).any())
            reached |= at if driven or contact.pair.law.has_adhesion else set()
            groups.append(at)
        while more := {label for at in groups if at & reached for label in at} - reached:
            reached |= more
        return reached

    def _drive(self, body: FloatingBody, total: Array, sizes: Array, min_drive: float) -> Array:
        """Unit direction of the resultant on a body; zero if the resultant is negligible."""
        bodies = self._bodies
        drive = bodies.resultant(body, total)
        mine = float(sizes[bodies.dofs_of(body)].sum())
        size, force = bodies.bulk.comm.allreduce(np.array([mine, sizes.sum()]))
        least = max(min_drive * size, bodies.rounding(body, float(force)))
        norm = float(np.linalg.norm(drive))
        return drive / norm if norm > least else np.zeros(len(drive))

    def unsupported(self, bulk: Array) -> set[int]:
        """Labels of the bodies that no admissible contact forces can support.

        Args:
            bulk: Forces of the bulk, the negative loads, shape (owned dofs,) [stress length].
        """
        bodies = self._bodies
        if not bodies.contacts:
            return {body.label for body in bodies.bodies}
        forces = bulk + self._pull_of_open_nodes(bulk.size)
        loads = np.concatenate([bodies.resultant(body, forces) for body in bodies.bodies])
        size = float(np.abs(loads).sum())
        weight = sum(float(c.operators.weight[c.active].sum()) for c in bodies.contacts)
        pressure = size / weight if weight > 0.0 else 0.0
        pairs = [self._touching(contact, pressure) for contact in bodies.contacts]
        motion = unresisted_motion(loads, Touching(*map(np.concatenate, zip(*pairs, strict=True))))
        ends = np.cumsum([len(body.motions) for body in bodies.bodies])[:-1]
        moves = zip(bodies.bodies, np.split(motion, ends), strict=True)
        return {body.label for body, move in moves if np.abs(move).max() > RIGID.resisted}

    def _pull_of_open_nodes(self, size: int) -> Array:
        """Forces of open nodes, (size,) [stress length]: adhesion across a gap is a load."""
        force = np.zeros(size)
        for contact in self._bodies.contacts:
            if contact.pair.law.has_adhesion:
                pull = np.where(contact.active[:, None], 0.0, contact.z)
                on_slave, on_master = contact.operators.force(pull)
                contact.slave.scatter_add(on_slave, force)
                contact.master.scatter_add(on_master, force)
        return force

    def _touching(self, contact: Contact, pressure: float) -> Touching:
        """Touching nodes for limit analysis, with friction at a typical pressure."""
        on, weight, bodies = _touches(contact), contact.operators.weight, self._bodies
        rates = [
            np.concatenate([rate(bodies, contact, body) for body in bodies.bodies])
            for rate in (opening, slipping)
        ]
        opens, slips = (np.moveaxis(rate, 0, -1)[on] for rate in rates)
        slope, shear, adhesion = contact.now.strength(pressure)
        return Touching(opens, slips, slope[on], (weight * shear)[on], (weight * adhesion)[on])

    def _has_left(self, body: FloatingBody, move: Array) -> bool:
        """Whether no surface of another body is ahead of a moving body (collective)."""
        bodies = self._bodies
        return not any(
            is_ahead(bodies, c, body, move, idle=False) for c in bodies.contacts_of(body)
        )

    def _creeps(self, moves: Moves) -> bool:
        """Whether all moves are shorter than the admitted overlap."""
        longest = max((_length(body, move) for body, move in moves), default=0.0)
        return longest <= RIGID.overlap * self._bodies.shortest_facet()


def _touches(contact: Contact) -> Flags:
    """Active nodes and, if there are any, open ones that nearly touch, (slave nodes,) (local).

    Open nodes with adhesion do not: their forces are loads.
    """
    on = contact.active & ~contact.set_aside
    near = nearly_touching(contact) & ~contact.z.any(axis=1) & ~contact.set_aside
    return on | near if on.any() else on


def _length(body: FloatingBody, move: Array) -> float:
    return float(np.linalg.norm(move @ body.motions))
