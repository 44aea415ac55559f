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
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk.bodies import FloatingBody
from fenics_mortar.contact.law import STICK, Friction
from fenics_mortar.newton.loop import NewtonReport
from fenics_mortar.rigid.body_motions import (
    BodyMotions,
    Touching,
    by_body,
    closing,
    opening,
    slipping,
    touches,
    unresisted_motion,
)
from fenics_mortar.rigid.complementarity import closest_move, nearest_below
from fenics_mortar.rigid.proximal import (
    RIGID,
    Carried,
    Springs,
    anchored_stiffness,
    carried_by,
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


@dataclass
class Settling:
    """What moved in ``settle``, and from where.

    Attributes:
        unloaded: Bodies without contact force before.
        start: Displacement after the moves, shape (local dofs,) [length].
        touched: Active sets of the contacts before.
        moved: Bodies that were moved.
    """

    unloaded: list[FloatingBody]
    start: Array
    touched: list[Flags] = field(default_factory=list)
    moved: list[FloatingBody] = field(default_factory=list)


def settle(
    bodies: FloatingBodies,
    evaluate: Callable[[], tuple[Array, Array]],
    give_way: Callable[[Moves], Moves],
) -> list[str]:
    """Move the bodies that contact cannot support rigidly until it can.

    Args:
        bodies: The floating bodies; their ``settling`` is set.
        evaluate: Function that evaluates the contacts at the present state and returns the
            forces of the bulk and of contact, shape (owned dofs,) each [stress length].
        give_way: Function that shortens moves until idle bodies can give way, and adds their
            moves.

    Returns:
        A sentence for each body that was moved, with its way [length].

    Raises:
        NotConvergedError: On all ranks, if no contact stops a body.
    """
    unloaded = [body for body in bodies.bodies if not bodies.is_loaded(body)]
    bodies.settling = Settling(unloaded, bodies.bulk.values.copy())
    if not bodies.bodies:
        return []
    moved, creeping, extent = dict[int, float](), 0, bodies.extent(bodies.bulk.positions())
    shortest = RIGID.overlap**2 * bodies.shortest_facet()
    begins = dict[int, str]()
    for number in range(RIGID.max_moves):
        forces = evaluate()
        if number == 0:
            bodies.settling.touched = [contact.active.copy() for contact in bodies.contacts]
        moves = give_way(_next_moves(bodies, *forces, begun=number > 0))
        moves = [(body, move) for body, move in moves if np.linalg.norm(move) > shortest]
        untold = {body.label for body, _ in moves} - begins.keys()
        begins |= _beginnings(bodies, untold, forces[0], may_tip=number == 0)
        longest = max((_length(body, move) for body, move in moves), default=0.0)
        creeping = creeping + 1 if RIGID.overlap * longest <= shortest else 0
        if not moves or creeping > RIGID.max_creeping:
            bodies.settling.start = bodies.bulk.values.copy()
            bodies.settling.moved = [body for body in bodies.bodies if body.label in moved]
            ways = sorted((bodies.name_of(label), moved[label]) for label in sorted(moved))
            stopped = "was moved rigidly until contact stopped it"
            return [f"{name} {stopped}, by about {way:.2g}" for name, way in ways]
        for body, move in moves:
            bodies.move(body, move)
            moved[body.label] = moved.get(body.label, 0.0) + _length(body, move)
        if all(moved[body.label] > extent for body, _ in moves) and _part(bodies, moves):
            break
    body, move = moves[0]
    name, how = bodies.name_of(body.label), body.describe(move, directed=True)
    message = (
        f"{begins.get(body.label, '')}{name} can {how} freely: it is driven by loads, and "
        f"neither Dirichlet conditions nor contact stop it"
    )
    raise NotConvergedError(message, NewtonReport(reason=message))


def _beginnings(
    bodies: FloatingBodies, labels: set[int], bulk: Array, *, may_tip: bool
) -> dict[int, str]:
    """How bodies that touch others begin to tip over or to slide, in words, by their labels.

    Without friction loads accelerate bodies in the nearest direction to the loads that no
    contact stops. A body that leaves all nodes by it is pulled off. Others tip over if limit
    analysis of the present state moves them at a coefficient of friction ``ROUGH``, or slide in
    that direction, unless others carry them along.

    Args:
        bodies: The floating bodies.
        labels: Of the bodies to tell of.
        bulk: Forces of the bulk, the negative loads, shape (owned dofs,) [stress length].
        may_tip: Whether to tell of tipping. A body that falls rolls until it lies on a side.
    """
    if not labels:
        return {}
    touching, closes = [(c, touches(c)) for c in bodies.contacts], dict[int, Array]()
    for body in (body for body in bodies.bodies if body.label in labels):
        at_body = [closing(bodies, c, body)[:, bodies.at_body(c, body) & on] for c, on in touching]
        if any(rates.size for rates in at_body):
            closes[body.label] = np.hstack(at_body)
    if not closes:
        return {}
    loads, nodes = _limit_analysis(bodies, bulk)
    found, _ = nearest_below(loads, -nodes.opening, np.zeros(len(nodes.opening)))
    free = loads if found is None else found
    tips = unresisted_motion(loads, nodes._replace(slope=np.maximum(nodes.slope, ROUGH)))
    of_bodies = bodies.bodies, by_body(bodies.bodies, tips), by_body(bodies.bodies, free)
    least, begins = RIGID.resisted * np.abs(free).max(), dict[int, str]()
    friction = "too little friction" if nodes.slope.any() or nodes.shear.any() else "no friction"
    for body, tip, slide in zip(*of_bodies, strict=True):
        if body.label not in closes or (slide @ closes[body.label]).max() < -least:
            continue  # pulled off
        motion, what = slide, f"slides, with {friction} to hold it"
        is_told = found is not None and np.abs(slide).max() > least  # not carried along by others
        if np.abs(tip).max() > RIGID.resisted:
            motion, what, is_told = tip, "tips over, which no friction can prevent", may_tip
        if is_told:
            how = body.describe(motion, directed=True, poles=True)
            name = bodies.name_of(body.label)
            begins[body.label] = f"{name} {what}: it begins to {how}. At last "
    return begins


def check_settled(bodies: FloatingBodies, reach: float) -> list[str]:
    """Check bodies without contact force before and after the solve.

    Args:
        bodies: The floating bodies.
        reach: Largest motion of a body set aside that gives way to deformation [length].

    Returns:
        A sentence for each body that was pushed towards a surface that may stop it.

    Raises:
        MortarError: On all ranks, if a body was pushed and no surface is ahead of it.
    """
    notes = []
    for body in bodies.settling.unloaded:
        change = (bodies.bulk.u.x.array - bodies.settling.start)[: bodies.bulk.num_owned]
        motion = bodies.rigid_fraction(body, change)
        distance, idle = float(np.linalg.norm(motion)), body.label in bodies.aside
        is_at_rest = distance <= SOLVED * body.size or (idle and distance <= reach)
        if is_at_rest or bodies.is_loaded(body):
            continue
        name = bodies.name_of(body.label)
        rates = [motion @ closing(bodies, contact, body) for contact in bodies.contacts]
        if not any((rate > RIGID.resisted * distance).any() for rate in rates):
            raise MortarError(
                f"{name} can {body.describe(motion, directed=True)} freely: contact pushed it "
                f"away, and its Dirichlet conditions do not fix it"
            )
        notes.append(f"{name} was pushed along by contact without a force")
    return notes + _released(bodies)


def _released(bodies: FloatingBodies) -> list[str]:
    """A sentence for each body that has lost all contact in the solve (collective)."""
    before = {body.label for body in bodies.settling.unloaded}
    change, notes = (bodies.bulk.u.x.array - bodies.settling.start)[: bodies.bulk.num_owned], []
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


def _next_moves(bodies: FloatingBodies, bulk: Array, contact: Array, *, begun: bool) -> Moves:
    """The next move of each driven, unsupported body."""
    driven = _driven(bodies, bulk, contact, begun=begun)
    if not driven:
        return []
    desired = np.concatenate([RIGID.largest_move * body.size * drive for body, drive in driven])
    some = [body for body, _ in driven]
    rates = [
        np.where(c.set_aside[:, None], 0.0, closing(bodies, c, *some).T) for c in bodies.contacts
    ]
    move = closest_move(desired, rates, bodies.contacts)
    return list(zip(some, by_body(some, move), strict=True))


def _driven(bodies: FloatingBodies, bulk: Array, contact: Array, *, begun: bool) -> Moves:
    """Bodies driven by loads and not supported by contact, with unit directions.

    A body with contact force moves only along directions that active contact admits. Without
    friction and adhesion, a round body may rest on its facets although the smooth body would
    roll on. Limit analysis is therefore used in this case only for bodies that touch before
    they have moved or carried any force.
    """
    total, sizes = bulk + contact, np.abs(bulk) + np.abs(contact)
    unloaded = [body for body in bodies.bodies if not bodies.is_loaded(body)]
    labels = {body.label for body in unloaded}
    reached = _reached_by_loads(bodies, bulk, float(sizes.sum()))
    loose = [body for body in bodies.loose(sticking=False) if body.label in reached - labels]
    driven = [(body, _drive(bodies, body, total, sizes)) for body in (*unloaded, *loose)]
    driven = [(body, drive) for body, drive in driven if drive.any()]
    laws = [contact.pair.law for contact in bodies.contacts]
    if any(law.has_friction or law.has_adhesion for law in laws):
        judged = {body.label for body, _ in driven}
    else:
        judged = set() if begun else labels
    if driven and judged:
        free = unsupported(bodies, bulk) | {body.label for body in bodies.bodies} - judged
        driven = [(body, drive) for body, drive in driven if body.label in free]
    return driven


def _reached_by_loads(bodies: FloatingBodies, bulk: Array, size: float) -> set[int]:
    """Labels of the bodies with loads, and of those that contact may pass loads on to.

    The contact forces of the accepted state drive no other body: its loads have been removed.

    Args:
        bodies: The floating bodies.
        bulk: Forces of the bulk, the negative loads, shape (owned dofs,) [stress length].
        size: Sum of the sizes of all forces on this rank [stress length].
    """
    groups = []
    reached = bodies.driven_by(bulk, size)
    for contact in bodies.contacts:
        at = {body.label for body in bodies.bodies if bodies.at_body(contact, body).any()}
        obstacle = contact.obstacle
        driven = obstacle is not None and bool(np.isfinite(obstacle.load).any())
        reached |= at if driven or contact.pair.law.has_adhesion else set()
        groups.append(at)
    while more := {label for at in groups if at & reached for label in at} - reached:
        reached |= more
    return reached


def _drive(bodies: FloatingBodies, body: FloatingBody, total: Array, sizes: Array) -> Array:
    """Unit direction of the resultant on a body; zero if the resultant is negligible."""
    min_drive = RIGID.negligible if bodies.anchored else SOLVED
    drive = bodies.resultant(body, total)
    mine = float(sizes[bodies.dofs_of(body)].sum())
    size, force = bodies.bulk.comm.allreduce(np.array([mine, sizes.sum()]))
    least = max(min_drive * size, bodies.rounding(body, float(force)))
    norm = float(np.linalg.norm(drive))
    return drive / norm if norm > least else np.zeros(len(drive))


def unsupported(bodies: FloatingBodies, bulk: Array) -> set[int]:
    """Labels of the bodies that no admissible contact forces can support.

    Args:
        bodies: The floating bodies.
        bulk: Forces of the bulk, the negative loads, shape (owned dofs,) [stress length].
    """
    if not bodies.contacts:
        return {body.label for body in bodies.bodies}
    moves = by_body(bodies.bodies, unresisted_motion(*_limit_analysis(bodies, bulk)))
    moved = zip(bodies.bodies, moves, strict=True)
    return {body.label for body, move in moved if np.abs(move).max() > RIGID.resisted}


def _limit_analysis(bodies: FloatingBodies, bulk: Array) -> tuple[Array, Touching]:
    """Resultants of the loads on the bodies, (motions of all,) [force], and touching nodes."""
    forces = bulk + _pull_of_open_nodes(bodies, bulk.size)
    loads = np.concatenate([bodies.resultant(body, forces) for body in bodies.bodies])
    size = float(np.abs(loads).sum())
    weight = sum(float(c.operators.weight[c.active].sum()) for c in bodies.contacts)
    pressure = size / weight if weight > 0.0 else 0.0
    pairs = [_touching(bodies, contact, pressure) for contact in bodies.contacts]
    return loads, Touching(*map(np.concatenate, zip(*pairs, strict=True)))


def _pull_of_open_nodes(bodies: FloatingBodies, size: int) -> Array:
    """Forces of open nodes, (size,) [stress length]: adhesion across a gap is a load."""
    force = np.zeros(size)
    for contact in bodies.contacts:
        if contact.pair.law.has_adhesion:
            pull = np.where(contact.active[:, None], 0.0, contact.z)
            contact.scatter_add(contact.operators.force(pull), force)
    return force


def _touching(bodies: FloatingBodies, contact: Contact, pressure: float) -> Touching:
    """Touching nodes for limit analysis, with friction at a typical pressure."""
    on, weight = touches(contact), contact.operators.weight
    opens, slips = (
        np.moveaxis(rate(bodies, contact, *bodies.bodies), 0, -1)[on]
        for rate in (opening, slipping)
    )
    (slope, shear), adhesion = contact.now.strength(pressure), contact.now.largest_adhesion()
    return Touching(opens, slips, slope[on], (weight * shear)[on], (weight * adhesion)[on])


def _part(bodies: FloatingBodies, moves: Moves) -> bool:
    """Whether bodies that move together approach no surface, nor one another (collective)."""
    longest = RIGID.resisted * max(_length(body, move) for body, move in moves)
    some, lengths = zip(*moves, strict=True)
    rates = [
        (np.concatenate(lengths) @ closing(bodies, c, *some))[~c.set_aside] for c in bodies.contacts
    ]
    return not any((rate > longest).any() for rate in rates)


def _length(body: FloatingBody, move: Array) -> float:
    return float(np.linalg.norm(move @ body.motions))


class FloatingBodies(BodyMotions):
    """Floating bodies of a problem and their springs; all methods are collective.

    Args:
        bulk: The bodies.
        contacts: The contacts and ties, bound to the same space.
        remote: The remote loads with motions, bound to the mesh.

    Attributes:
        springs: Anchored springs at the owned dofs, or ``None``.
        settling: Rigid moves before a solve.
    """

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Contact | Tie], remote: Sequence[Any]
    ) -> None:
        super().__init__(bulk, contacts, remote)
        self.springs: Springs | None = None
        self.settling = Settling([], bulk.values)

    @property
    def supported_by_contact(self) -> bool:
        """Whether active contact loads and supports all floating bodies."""
        return all(map(self.is_loaded, self.bodies)) and not self.loose()

    # Before and after a solve

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
        sides = [side for c in self.contacts for side in (c.slave, c.master)]
        paired = set[int]().union(*(self.labels_of(side).tolist() for side in sides))
        names = self.names([body for body in loose if body.label in paired - self.aside])
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
        length = elongation * self.shortest_facet()
        stiffness = {
            body.label: anchored_stiffness(
                float(np.linalg.norm(self.resultant(body, total))),
                share * RIGID.normals_err * self.contact_force(body),
                length,
                body.stiffest,
            )
            for body in self.bodies
        }
        self.springs = Springs(self._spread(stiffness), self._place())

    @property
    def anchored(self) -> bool:
        """Whether there are anchored springs."""
        return self.springs is not None

    @property
    def acting_springs(self) -> Springs | None:
        """The anchored springs without those of idle bodies, which only regularize the tangent."""
        if self.springs is None or not self.aside:
            return self.springs
        stiffness = self.springs.stiffness.copy()
        for body in self.bodies:
            if body.label in self.aside:
                stiffness[self.dofs_of(body)] = 0.0
        return self.springs.replaced(stiffness=stiffness)

    def add_spring_forces(self) -> None:
        """Add the forces of anchored springs to the residual."""
        if self.anchored:
            self.bulk.r.array[: self.bulk.num_owned] += self._spring_forces()

    def carried_by_springs(self) -> list[Carried]:
        """Forces of the springs on each anchored body."""
        if not self.anchored:
            return []
        forces, found = self._spring_forces(), []
        contact = [self.contact_force(body) for body in self.bodies]
        for body, on_body in zip(self.bodies, contact, strict=True):
            by_springs = -self.resultant(body, forces)  # along the motion
            size = float(np.linalg.norm(by_springs))
            acts = size > self.rounding(body, sum(contact))
            nodes = [(c, self.at_body(c, body)) for c in self.contacts]
            how = partial(body.describe, by_springs, directed=True)
            name = self.name_of(body.label)
            found.append(carried_by(size if acts else 0.0, on_body, name, nodes, how))
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

    def _spring_forces(self) -> Array:
        """Forces of the acting springs, (owned dofs,) [stress length]."""
        springs = self.acting_springs
        assert springs is not None
        return springs.stiffness * (self._place() - springs.anchor)

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
