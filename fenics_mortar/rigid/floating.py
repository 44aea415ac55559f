# SPDX-License-Identifier: MIT
"""Bodies without sufficient Dirichlet conditions, supported by contact alone.

Before a solve, ``settle`` moves bodies that contact cannot support until contact stops them, and
after it ``check_settled`` checks them. In Newton's method, tangent springs of ``FloatingBodies``
regularize loose motions, which active contact does not resist. If Newton's method fails, springs
anchor the bodies. See ``proximal`` for both kinds of springs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.law import STICK, Friction
from fenics_mortar.newton.loop import NewtonReport
from fenics_mortar.obstacles.rigid_motion import RIGID
from fenics_mortar.rigid.body_motions import (
    BodyMotions,
    BoundBody,
    by_body,
    closing,
    names_of,
    opening,
    slipping,
)
from fenics_mortar.rigid.complementarity import (
    Touching,
    closest_move,
    nearest_below,
    touches,
    unresisted_motion,
)
from fenics_mortar.rigid.proximal import AnchoredSprings, tangent_stiffness
from fenics_mortar.utils.arrays import SOLVED, Array, Flags
from fenics_mortar.utils.errors import MortarError, NotConvergedError

if TYPE_CHECKING:
    from fenics_mortar.contact.contact import Contact

# Coefficient of friction that holds every body that does not tip over or fall [1].
ROUGH = 100.0
TIPS = "tips over, which no friction can prevent"
# Bodies to be moved, with the coefficients of their motions, (motions,) each [length].
Moves = list[tuple[BoundBody, Array]]


@dataclass
class Settling:
    """What moved in ``settle``, and from where.

    Attributes:
        unloaded: Labels of bodies without contact force before.
        start: Displacement after the moves, shape (local dofs,) [length].
        touched: Active sets of the contacts before.
        moved: Bodies that were moved.
    """

    unloaded: set[int]
    start: Array
    touched: list[Flags] = field(default_factory=list)
    moved: list[BoundBody] = field(default_factory=list)


def settle(
    bodies: FloatingBodies,
    evaluate: Callable[[], tuple[Array, Array]],
    give_way: Callable[[Moves], Moves],
) -> list[str]:
    """Move the bodies that contact cannot support rigidly until it can (collective).

    A body that is driven by its loads and not supported by active contact is moved rigidly until
    contact stops it. Each move is the closest one to the direction of the resultant for which no
    node overlaps by more than ``RIGID.overlap``: a quadratic program in the few rigid motions.
    Bodies that contact may support are determined by limit analysis, see ``complementarity``.

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
    unloaded = {body.label for body in bodies.bodies if not body.is_loaded()}
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
        for label, begin in _beginnings(bodies, untold, forces[0], may_tip=number == 0).items():
            met = f", after it was moved by about {moved.get(label, 0.0):.2g}"
            begins[label] = f"{begin}{met * (label in moved)}. At last "
        longest = max((float(np.linalg.norm(move)) for _, move in moves), default=0.0)
        creeping = creeping + 1 if RIGID.overlap * longest <= shortest else 0
        if not moves or creeping > RIGID.max_creeping:
            bodies.settling.start = bodies.bulk.values.copy()
            bodies.settling.moved = [body for body in bodies.bodies if body.label in moved]
            ways = sorted((bodies.name_of(label), moved[label]) for label in sorted(moved))
            stopped = "was moved rigidly until contact stopped it"
            return [f"{name} {stopped}, by about {way:.2g}" for name, way in ways]
        for body, move in moves:
            body.move(move)
            moved[body.label] = moved.get(body.label, 0.0) + float(np.linalg.norm(move))
        if all(moved[body.label] > extent for body, _ in moves) and _part(bodies, moves):
            break
    body, move = moves[0]
    name, how = body.name, body.describe(move, directed=True)
    message = (
        f"{begins.get(body.label, '')}{name} can {how} freely: it is driven by loads, and "
        "neither Dirichlet conditions nor contact stop it: support it, prescribe its motion, or "
        "compute the motion with Dynamics"
    )
    raise NotConvergedError(message, NewtonReport(reason=message))


def _beginnings(
    bodies: FloatingBodies, labels: set[int], bulk: Array, *, may_tip: bool
) -> dict[int, str]:
    """How bodies that touch others begin to tip over or to slide, in words, by their labels.

    Without friction, loads accelerate bodies in the direction nearest to the loads that no contact
    stops. A body that leaves all nodes by it is pulled off. Others tip over if limit analysis of
    the present state moves them at a coefficient of friction ``ROUGH``, or slide in that direction,
    unless others carry them along.

    Args:
        bodies: The floating bodies.
        labels: Labels of the bodies to describe.
        bulk: Forces of the bulk, the negative loads, shape (owned dofs,) [stress length].
        may_tip: Whether tipping is described. A body that falls rolls until it lies on a side.
    """
    if not labels:
        return {}
    touching, closes = [(c, touches(c)) for c in bodies.contacts], dict[int, Array]()
    for body in (body for body in bodies.bodies if body.label in labels):
        at_body = [closing(c, body)[:, body.at(c) & on] for c, on in touching]
        if any(rates.size for rates in at_body):
            closes[body.label] = np.hstack(at_body)
    if not closes:
        return {}
    loads, nodes = _limit_analysis(bodies, bulk)
    found, _ = nearest_below(loads, -nodes.opening, np.zeros(len(nodes.opening)))
    free = loads if found is None else found
    tips = _tips(loads, nodes)
    of_bodies = bodies.bodies, by_body(bodies.bodies, tips), by_body(bodies.bodies, free)
    least, begins = RIGID.resisted * np.abs(free).max(), dict[int, str]()
    friction = "too little friction" if nodes.slope.any() or nodes.shear.any() else "no friction"
    for body, tip, slide in zip(*of_bodies, strict=True):
        if body.label not in closes or (slide @ closes[body.label]).max() < -least:
            continue  # pulled off
        motion, what = slide, f"slides, with {friction} to hold it"
        is_told = found is not None and np.abs(slide).max() > least  # not carried along by others
        if _moves(tip):
            motion, what, is_told = tip, TIPS, may_tip
        if is_told:
            begins[body.label] = f"{body.name} {what}: {_begins(body, motion)}"
    return begins


def _tips(loads: Array, nodes: Touching) -> Array:
    """``unresisted_motion`` at a coefficient of friction ``ROUGH``, (motions,) (local)."""
    return unresisted_motion(loads, nodes._replace(slope=np.maximum(nodes.slope, ROUGH)))


def _moves(motion: Array) -> bool:
    """Whether a body moves, by the motion (m,) of limit analysis (local)."""
    return bool(np.abs(motion).max() > RIGID.resisted)


def _begins(body: BoundBody, motion: Array) -> str:
    """How a body begins to move along ``motion`` (m,), in words (collective)."""
    return f"it begins to {body.describe(motion, directed=True, poles=True)}"


def check_settled(bodies: FloatingBodies, reach: float) -> list[str]:
    """Check bodies without contact force before and after the solve (collective).

    Args:
        bodies: The floating bodies.
        reach: Largest motion of a body set aside that gives way to deformation [length].

    Returns:
        A sentence for each body that was pushed towards a surface that may stop it.

    Raises:
        MortarError: On all ranks, if a body was pushed and no surface is ahead of it.
    """
    settling, bulk = bodies.settling, bodies.bulk
    change = (bulk.values - settling.start)[: bulk.num_owned]
    notes = [
        _pushed(body, change, reach) if body.label in settling.unloaded else _released(body, change)
        for body in bodies.bodies
        if not body.is_loaded()
    ]
    return [note for note in notes if note]


def _pushed(body: BoundBody, change: Array, reach: float) -> str:
    """A sentence on a body that had no force and was pushed; "" if it is at rest (collective)."""
    motion = body.rigid_fraction(change)
    distance, idle = float(np.linalg.norm(motion)), body.label in body.among.aside
    if distance <= max(SOLVED * body.size, reach * idle):
        return ""
    rates = [motion @ closing(contact, body) for contact in body.among.contacts]
    if not any((rate > RIGID.resisted * distance).any() for rate in rates):
        raise MortarError(
            f"{body.name} can {body.describe(motion, directed=True)} freely: contact pushed it "
            "away, and its Dirichlet conditions do not fix it; take smaller steps if a surface "
            "ahead stops it, else give it a support, or a load that contact can bear"
        )
    return f"{body.name} was pushed along by contact without a force"


def _released(body: BoundBody, change: Array) -> str:
    """A sentence on a body that has lost all contact in the solve (collective)."""
    moved = float(np.linalg.norm(change[body.dofs], axis=1).max(initial=0.0))
    largest = body.among.bulk.comm.allreduce(moved, MPI.MAX)
    return (
        f"{body.name} has lost all contact, and no force holds it: "
        f"it moved by up to {largest:.3g} in this solve"
    )


def _next_moves(bodies: FloatingBodies, bulk: Array, contact: Array, *, begun: bool) -> Moves:
    """The next move of each driven, unsupported body."""
    driven = _driven(bodies, bulk, contact, begun=begun)
    if not driven:
        return []
    desired = np.concatenate([RIGID.largest_move * body.size * drive for body, drive in driven])
    some = [body for body, _ in driven]
    rates = [np.where(c.set_aside[:, None], 0.0, closing(c, *some).T) for c in bodies.contacts]
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
    unloaded = [body for body in bodies.bodies if not body.is_loaded()]
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
        at = {body.label for body in bodies.bodies if body.at(contact).any()}
        obstacle = contact.obstacle
        driven = obstacle is not None and bool(np.isfinite(obstacle.load).any())
        reached |= at if driven or contact.pair.law.has_adhesion else set()
        groups.append(at)
    while more := {label for at in groups if at & reached for label in at} - reached:
        reached |= more
    return reached


def _drive(bodies: FloatingBodies, body: BoundBody, total: Array, sizes: Array) -> Array:
    """Unit direction of the resultant on a body; zero if the resultant is negligible."""
    min_drive = RIGID.negligible if bodies.anchored else SOLVED
    drive = body.resultant(total)
    mine = float(sizes[body.dofs].sum())
    size, force = bodies.bulk.comm.allreduce(np.array([mine, sizes.sum()]))
    least = max(min_drive * size, body.rounding(float(force)))
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
    return {body.label for body, _ in moved_by_loads(bodies, *_limit_analysis(bodies, bulk))}


def moved_by_loads(bodies: BodyMotions, loads: Array, touching: Touching) -> Moves:
    """Bodies that no contact forces at touching nodes support, with motions (local).

    Args:
        bodies: The floating bodies.
        loads: Resultants of the loads along their motions, (motions of all,) [force].
        touching: The nodes.
    """
    moves = by_body(bodies.bodies, unresisted_motion(loads, touching))
    moved = zip(bodies.bodies, moves, strict=True)
    return [(body, move) for body, move in moved if _moves(move)]


def _limit_analysis(bodies: FloatingBodies, bulk: Array) -> tuple[Array, Touching]:
    """Resultants of the loads on the bodies, (motions of all,) [force], and touching nodes."""
    forces = bulk + _pull_of_open_nodes(bodies, bulk.size)
    loads = np.concatenate([body.resultant(forces) for body in bodies.bodies])
    size = float(np.abs(loads).sum())
    weight = sum(float(c.operators.weight[c.active].sum()) for c in bodies.contacts)
    pressure = size / weight if weight > 0.0 else 0.0
    pairs = [_touching(bodies, contact, pressure) for contact in bodies.contacts]
    return loads, Touching.joined(pairs)


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
    on = touches(contact)
    opens, slips = (
        np.moveaxis(rate(contact, *bodies.bodies), 0, -1)[on] for rate in (opening, slipping)
    )
    return Touching.of(contact, on, opens, slips, pressure)


def _part(bodies: FloatingBodies, moves: Moves) -> bool:
    """Whether bodies that move together approach no surface, nor one another (collective)."""
    longest = RIGID.resisted * max(float(np.linalg.norm(move)) for _, move in moves)
    some, lengths = zip(*moves, strict=True)
    rates = [(np.concatenate(lengths) @ closing(c, *some))[~c.set_aside] for c in bodies.contacts]
    return not any((rate > longest).any() for rate in rates)


class FloatingBodies(BodyMotions):
    """Floating bodies of a problem and their springs; all methods are collective.

    Attributes:
        springs: Anchored springs, set by these.
    """

    springs: AnchoredSprings

    @cached_property
    def settling(self) -> Settling:
        """Rigid moves before the last solve; set by ``settle``."""
        return Settling(set(), self.bulk.values)

    @property
    def supported_by_contact(self) -> bool:
        """Whether active contact loads and supports all floating bodies."""
        return all(body.is_loaded() for body in self.bodies) and not self.loose()

    # Before and after a solve

    def tipping(self, bulk: Array) -> str:
        """Bodies that tip over at the present state, in words; "" if there are none.

        Args:
            bulk: Forces of the bulk, the negative loads, shape (owned dofs,) [stress length].
        """
        if not (self.bodies and self.contacts):
            return ""
        tips = by_body(self.bodies, _tips(*_limit_analysis(self, bulk)))
        each = zip(self.bodies, tips, strict=True)
        moved = [(body, tip) for body, tip in each if _moves(tip) and body.is_loaded()]
        return "; ".join(f"{body.name} {TIPS}: {_begins(body, move)}" for body, move in moved)

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

    def add_springs(self, loose: Sequence[BoundBody], total: Array, force: float) -> None:
        """Add springs to the diagonal of ``K`` that limit a step to elastic strains.

        Bodies that are not loose have weak springs: nodes may resist each motion but not all
        motions together, for example if polygons turn inside one another.

        Args:
            loose: The result of ``loose``.
            total: Sum of all forces, shape (owned dofs,) [stress length].
            force: Size of all forces [stress length].
        """
        stiffness = np.zeros(self.num_bodies)
        for body in self.bodies:
            stiffness[body.label] = RIGID.weakest_spring * body.stiffest
        for body in loose:
            drive = body.resultant(total)
            if np.linalg.norm(drive) > body.rounding(force):
                stiffness[body.label] = tangent_stiffness(drive, force) * body.stiffest
        anchored = self.springs.present
        self.bulk.add_to_diagonal(self.spread(anchored.of_bodies if anchored else stiffness))

    def drop_undriven(
        self, loose: Sequence[BoundBody], step: Array, motion: Array, total: Array, force: float
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
            drive = float(np.linalg.norm(body.resultant(total)))
            if idle or drive <= body.rounding(force):
                body.subtract(body.rigid_fraction(step), step, motion)

    def remark(self, loose: Sequence[BoundBody]) -> str:
        """Sentence on the tangent springs of loose bodies; "" if there are none."""
        sides = [side for c in self.contacts for side in (c.slave, c.master)]
        paired = set[int]().union(*(self.labels_of(side).tolist() for side in sides))
        names = names_of([body for body in loose if body.label in paired - self.aside])
        return (
            f"a spring in the tangent regularizes {names}, which contact supports only in part"
            if names
            else ""
        )

    @property
    def anchored(self) -> bool:
        """Whether there are anchored springs, see ``proximal``."""
        return self.springs.present is not None

    def add_spring_forces(self) -> None:
        """Add the forces of anchored springs to the residual."""
        self.bulk.r.array[: self.bulk.num_owned] += self.springs.on_bodies()

    def pressed_on_springs(self) -> set[int]:
        """Labels of bodies that contact presses against their anchored springs, and nothing else.

        Bodies between two others carry much larger contact forces than their springs do.
        """
        return {
            body.label
            for body, carried in zip(self.bodies, self.springs.carried(), strict=False)
            if RIGID.one_sided < carried.fraction < np.inf
        }

    def spread(self, stiffness: Array) -> Array:
        """Stiffness of springs at the owned dofs (owned dofs,) [stress] from that of each body.

        Args:
            stiffness: Stiffness on each body, by its label, shape (bodies,) [stress].
        """
        springs = np.zeros(self.bulk.num_owned)
        for body in self.bodies:
            springs[body.dofs] = stiffness[body.label] / body.num_nodes
        return springs
