# SPDX-License-Identifier: MIT
"""Bodies without sufficient Dirichlet conditions, supported by contact alone.

Before a solve, bodies that contact cannot support are moved until contact stops them.
In Newton's method, tangent springs regularize loose motions, which active
contact does not resist, see ``proximal``. If Newton's method fails, springs anchor the bodies, see
``proximal``.

Rigid moves of floating bodies before a solve, and a check after it; all collective.

A body that is driven by its loads and not supported by active contact is moved rigidly until
contact stops it. Each move is the closest one to the direction of the resultant for which no node
overlaps by more than ``RIGID.overlap``: a quadratic program in the few rigid motions. Bodies that
contact may support are determined by limit analysis, see ``body_motions``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk.bodies import FloatingBody
from fenics_mortar.contact.law import STICK, Friction
from fenics_mortar.newton.loop import NewtonReport
from fenics_mortar.rigid.body_motions import (
    BodyMotions,
    HeldBodies,
    Touching,
    closing,
    is_ahead,
    loose_bodies,
    nearly_touching,
    opening,
    slipping,
    unresisted_motion,
)
from fenics_mortar.rigid.complementarity import closest_move, nearest_below
from fenics_mortar.rigid.proximal import (
    RIGID,
    Carried,
    Springs,
    anchored_stiffness,
    over_contact,
    slides,
    tangent_stiffness,
)
from fenics_mortar.utils.arrays import SOLVED, Array, Flags
from fenics_mortar.utils.errors import MortarError, NotConvergedError

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.contact.tied import Tie

# Coefficient of friction that holds every body that does not tip over or fall [1].
ROUGH = 100.0
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
        begins = dict[int, list[Callable[[], str]]]()
        for number in range(RIGID.max_moves):
            forces = evaluate()
            if number == 0:
                self.touched = [contact.active.copy() for contact in bodies.contacts]
            moves = self._next_moves(*forces, min_drive, begun=number > 0)
            touching = [body.label for body, _ in moves if self._touches_others(body)]
            limits = self._limit_analysis(forces[0]) if touching else ()
            for label in touching:
                found = self._beginning(label, *limits, may_tip=number == 0)
                begins.setdefault(label, []).append(found)
            creeping = creeping + 1 if self._creeps(moves) else 0
            if not moves or creeping > RIGID.max_creeping:
                self._start = bodies.bulk.u.x.array.copy()
                self.moved = [body for body in bodies.bodies if body.label in moved]
                names = sorted(bodies.name_of(label) for label in sorted(moved))
                return [f"{name} was moved rigidly until contact stopped it" for name in names]
            for body, move in moves:
                bodies.move(body, move)
                moved[body.label] = moved.get(body.label, 0.0) + _length(body, move)
            if all(moved[body.label] > extent for body, _ in moves) and self._part(moves):
                break
        body, move = moves[0]
        name, how = bodies.name_of(body.label), body.describe(move, directed=True)
        told = (begun() for begun in begins.get(body.label, []))
        first = next((text for text in told if text), "")
        message = (
            f"{first}{name} can {how} freely: it is driven by loads, and "
            f"neither Dirichlet conditions nor contact stop it"
        )
        raise NotConvergedError(message, NewtonReport(reason=message))

    def _touches_others(self, body: FloatingBody) -> bool:
        """Whether a body touches anything at present (local)."""
        bodies = self._bodies
        return any((bodies.at_body(c, body) & _touches(c)).any() for c in bodies.contacts)

    def _beginning(
        self, label: int, loads: Array, touching: Touching, *, may_tip: bool
    ) -> Callable[[], str]:
        """Function that tells how a body that touches others begins to tip over or to slide.

        Without friction loads accelerate bodies in the nearest direction to the loads that no
        contact stops. A body that leaves all nodes by it is pulled off. Others tip over if limit
        analysis of the present state moves them at a coefficient of friction ``ROUGH``, or slide in
        that direction.

        Args:
            label: Of the body.
            loads: Resultants on all bodies, see ``_limit_analysis``.
            touching: Touching nodes.
            may_tip: Whether to tell of tipping. A body that falls rolls until it lies on a side.

        Returns:
            Function without arguments; "" if the body does not move, or leaves all that it touches.
        """
        bodies, name = self._bodies, self._bodies.name_of(label)
        (body,) = (each for each in bodies.bodies if each.label == label)
        closes = np.hstack(
            [
                closing(bodies, c, body)[:, bodies.at_body(c, body) & _touches(c)]
                for c in bodies.contacts
            ]
        )

        def begins() -> str:
            found, _ = nearest_below(loads, -touching.opening, np.zeros(len(touching.opening)))
            free = loads if found is None else found
            least, slide = RIGID.resisted * np.abs(free).max(), self._of_bodies(free)[label]
            if (slide @ closes).max() < -least:
                return ""  # pulled off
            rough = touching._replace(slope=np.maximum(touching.slope, ROUGH))
            motion = self._of_bodies(unresisted_motion(loads, rough))[label]
            what = "tips over, which no friction can prevent"
            if np.abs(motion).max() <= RIGID.resisted:
                motion = slide
                if found is None or np.abs(motion).max() <= least:
                    return ""  # carried along by others
                rubs = touching.slope.any() or touching.shear.any()
                what = "friction is too small to hold it" if rubs else "no friction holds it"
                what = f"slides, and {what}"
            elif not may_tip:
                return ""
            how = body.describe(motion, directed=True, poles=True)
            return f"{name} {what}: it begins to {how}. At last "

        return begins

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
        motions = self._of_bodies(unresisted_motion(*self._limit_analysis(bulk)))
        return {label for label, move in motions.items() if np.abs(move).max() > RIGID.resisted}

    def _limit_analysis(self, bulk: Array) -> tuple[Array, Touching]:
        """Resultants of the loads on the bodies, (motions of all,) [force], and touching nodes."""
        bodies = self._bodies
        forces = bulk + self._pull_of_open_nodes(bulk.size)
        loads = np.concatenate([bodies.resultant(body, forces) for body in bodies.bodies])
        size = float(np.abs(loads).sum())
        weight = sum(float(c.operators.weight[c.active].sum()) for c in bodies.contacts)
        pressure = size / weight if weight > 0.0 else 0.0
        pairs = [self._touching(contact, pressure) for contact in bodies.contacts]
        return loads, Touching(*map(np.concatenate, zip(*pairs, strict=True)))

    def _of_bodies(self, motion: Array) -> dict[int, Array]:
        """Coefficients of the motions of each body, by label, of those of all bodies (local)."""
        bodies = self._bodies.bodies
        ends = np.cumsum([len(body.motions) for body in bodies])[:-1]
        return {body.label: part for body, part in zip(bodies, np.split(motion, ends), strict=True)}

    def _pull_of_open_nodes(self, size: int) -> Array:
        """Forces of open nodes, (size,) [stress length]: adhesion across a gap is a load."""
        force = np.zeros(size)
        for contact in self._bodies.contacts:
            if contact.pair.law.has_adhesion:
                pull = np.where(contact.active[:, None], 0.0, contact.z)
                contact.scatter_add(contact.operators.force(pull), force)
        return force

    def _touching(self, contact: Contact, pressure: float) -> Touching:
        """Touching nodes for limit analysis, with friction at a typical pressure."""
        on, weight, bodies = _touches(contact), contact.operators.weight, self._bodies
        rates = [
            np.concatenate([rate(bodies, contact, body) for body in bodies.bodies])
            for rate in (opening, slipping)
        ]
        opens, slips = (np.moveaxis(rate, 0, -1)[on] for rate in rates)
        (slope, shear), adhesion = contact.now.strength(pressure), contact.now.largest_adhesion()
        return Touching(opens, slips, slope[on], (weight * shear)[on], (weight * adhesion)[on])

    def _part(self, moves: Moves) -> bool:
        """Whether bodies that move together approach no surface, nor one another (collective)."""
        bodies, longest = self._bodies, max(_length(body, move) for body, move in moves)
        for c in bodies.contacts:
            rates = np.sum([move @ closing(bodies, c, body) for body, move in moves], axis=0)
            if (rates[~c.set_aside] > RIGID.resisted * longest).any():
                return False
        return True

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


class FloatingBodies(BodyMotions):
    """Floating bodies of a problem and their springs; all methods are collective.

    Args:
        bulk: The bodies.
        contacts: The contacts and ties, bound to the same space.
        held: Their rigid boundaries.

    Attributes:
        springs: Anchored springs at the owned dofs, or ``None``.
        settling: Rigid moves before a solve.
    """

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Contact | Tie], held: HeldBodies | None = None
    ) -> None:
        super().__init__(bulk, contacts, held)
        self.springs: Springs | None = None
        self.settling = BodySettling(self)

    @property
    def supported_by_contact(self) -> bool:
        """Whether active contact loads and supports all floating bodies."""
        return all(map(self.is_loaded, self.bodies)) and not self.loose()

    def loose(self) -> list[FloatingBody]:
        """Bodies with the rigid motions that neither active nor sticking nodes resist."""
        return loose_bodies(self)

    # Before and after a solve

    def settle(
        self, evaluate: Callable[[], tuple[Array, Array]], give_way: Callable[[Moves], Moves] = list
    ) -> list[str]:
        """Move the bodies that contact cannot support until it can."""
        self.settling.begin()
        if not self.bodies:
            return []
        min_drive = RIGID.negligible if self.anchored else SOLVED
        return self.settling.settle(evaluate, give_way, min_drive)

    def start_with_stick(self) -> None:
        """Let nodes stick at the start of a solve that touch without multipliers (local).

        By their law they slide, as their friction limit is zero before pressures are known. Bodies
        that friction supports would be loose in the first iteration, and their slip would be large.
        In the plane the sets of the linearized problem follow; in space there are none.
        """
        for contact in self.contacts:
            sticks = contact.active & ~contact.z.any(axis=1) & contact.follows_law
            if isinstance(contact.pair.law, Friction) and sticks.any():
                contact.change(branch=np.where(sticks, STICK, contact.branch))

    # Springs in the tangent

    def add_springs(self, loose: Sequence[FloatingBody], total: Array, force: float) -> None:
        """Add springs to the diagonal of ``K`` that limit a step to elastic strains.

        Bodies that are not loose have weak springs: nodes may resist each motion but not all
        motions together, for example if polygons turn inside one another.

        Args:
            loose: The result of ``loose``.
            total: Sum of all forces, shape (owned dofs,) [stress length].
            force: Size of all forces [stress length].
        """
        if not self.bodies:
            return
        stiffness = {body.label: RIGID.weakest_spring * body.stiffest for body in self.bodies}
        for body in loose:
            drive = self.resultant(body, total)
            if np.linalg.norm(drive) > self.rounding(body, force):
                stiffness[body.label] = tangent_stiffness(drive, force) * body.stiffest
        springs = self._spread(stiffness) if self.springs is None else self.springs.stiffness
        self.bulk.add_to_diagonal(springs)

    def drop_undriven(
        self, loose: Sequence[FloatingBody], step: Array, motion: Array, total: Array, force: float
    ) -> None:
        """Remove from a step the loose motions of idle bodies, and those driven by roundoff only.

        Args:
            loose: The result of ``loose``.
            step: Increment of the displacement, shape (owned dofs,) [length]; changed.
            motion: Increments of motions of obstacles and remote loads, (m, 3) [length]; changed.
            total: Sum of all forces, shape (owned dofs,) [stress length].
            force: Size of all forces [stress length].
        """
        for body in loose:
            idle = body.label in self.aside
            if self.anchored and not idle:
                continue
            drive = float(np.linalg.norm(self.resultant(body, total)))
            if idle or drive <= self.rounding(body, force):
                dofs, motions = self.motions(body)
                excess = self.rigid_fraction(body, step)
                step[dofs] -= (excess @ motions).reshape(dofs.shape)
                self.held.subtract(body, excess, motion)

    def remark(self, loose: Sequence[FloatingBody]) -> str:
        """Sentence on the tangent springs of loose bodies; "" if there are none."""
        apart = self.aside | {body.label for body in self.without_pair()}
        names = self.names([body for body in loose if body.label not in apart])
        return (
            f"a spring in the tangent regularizes {names}, which contact supports only in part"
            if names
            else ""
        )

    # Anchored springs, see ``proximal``

    def anchor(self, total: Array, elongation: float, share: float) -> None:
        """Anchor the bodies at their present positions by springs.

        Args:
            total: Sum of all forces, shape (owned dofs,) [stress length].
            elongation: Elongation of the springs under the resultant on the body, or under the
                ``share`` of the error of its contact forces if larger [shortest facets].
            share: See ``elongation`` [1].
        """
        bodies, length = self.bodies, elongation * self.shortest_facet()
        stiffness = anchored_stiffness(
            np.array([np.linalg.norm(self.resultant(body, total)) for body in bodies]),
            np.array([share * RIGID.normals_err * self.contact_force(body) for body in bodies]),
            length,
            np.array([body.stiffest for body in bodies]),
        )
        springs = {body.label: float(k) for body, k in zip(bodies, stiffness, strict=True)}
        self.springs = Springs(self._spread(springs), self._place())

    @property
    def anchored(self) -> bool:
        """Whether there are anchored springs."""
        return self.springs is not None

    @property
    def acting_springs(self) -> Springs | None:
        """The anchored springs without those of idle bodies, which only regularize the tangent."""
        springs = self.springs
        for body in self.bodies:
            if springs is not None and body.label in self.aside:
                springs = springs.without(self.dofs_of(body))
        return springs

    def add_spring_forces(self) -> None:
        """Add the forces of anchored springs to the residual."""
        springs = self.acting_springs
        if springs is not None:
            self.bulk.r.array[: self.bulk.num_owned] += springs.forces(self._place())

    def carried_by_springs(self) -> list[Carried]:
        """Forces of the springs on each anchored body."""
        springs = self.acting_springs
        if springs is None:
            return []
        forces = springs.forces(self._place())
        contact = [self.contact_force(body) for body in self.bodies]
        found = []
        for body, on_body in zip(self.bodies, contact, strict=True):
            by_springs = -self.resultant(body, forces)  # along the motion
            size = float(np.linalg.norm(by_springs))
            acts = size > self.rounding(body, sum(contact))
            found.append(
                Carried(
                    self.name_of(body.label),
                    over_contact(size if acts else 0.0, on_body),
                    slides([(c, self.at_body(c, body)) for c in self.contacts]),
                    body.describe(by_springs, directed=True) if acts else "",
                )
            )
        return found

    def pressed_on_springs(self) -> set[int]:
        """Labels of bodies that contact presses against their anchored springs, and nothing else.

        Bodies between two others carry much larger contact forces than their springs do.
        """
        if not self.anchored:
            return set()
        return {
            body.label
            for body, carried in zip(self.bodies, self.carried_by_springs(), strict=True)
            if RIGID.one_sided < carried.fraction < np.inf
        }

    def spring_energy(self) -> float:
        """Energy of the anchored springs [stress length^2]."""
        springs = self.acting_springs
        mine = 0.0 if springs is None else springs.energy(self._place())
        return self.bulk.comm.allreduce(mine)

    def max_motion(self) -> float:
        """Largest rigid motion of a body since ``anchor`` [shortest facets]."""
        if self.springs is None:
            return 0.0
        change = self._place() - self.springs.anchor
        bodies = [body for body in self.bodies if body.label not in self.aside]
        moves = [np.linalg.norm(self.rigid_fraction(body, change)) for body in bodies]
        return float(max(moves, default=0.0)) / self.shortest_facet()

    def _place(self) -> Array:
        """Displacement of the owned dofs [length]."""
        return self.bulk.u.x.array[: self.bulk.num_owned]

    def _spread(self, stiffness: dict[int, float]) -> Array:
        """Stiffness of springs at the owned dofs (owned dofs,) [stress] from that of each body."""
        springs = np.zeros(self.bulk.num_owned)
        for body in self.bodies:
            springs[self.dofs_of(body)] = stiffness[body.label] / body.num_nodes
        return springs
