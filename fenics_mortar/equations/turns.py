# SPDX-License-Identifier: MIT
"""Bodies that prescribed values move, and slip of nodes that come into contact while bodies turn.

``turn`` moves whole bodies with their prescribed nodes before a solve, ``push_aside`` the bodies
that these or obstacles push and contact alone supports. ``lead_by_motions`` and
``follow_solution`` count slip from where motions carry nodes: those that are prescribed before a
solve, those of the solution after it. ``loads_of_step`` evaluates loads at times within a step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from fenics_mortar.contact.arcs import MAX_ROTATION, Carried, carried_by, moved_by
from fenics_mortar.contact.rows import strength
from fenics_mortar.contact.slip import lead, lead_by_solution
from fenics_mortar.interface.integrals import evaluate_normals
from fenics_mortar.newton.loop import NewtonReport, Solve, then_solve
from fenics_mortar.obstacles.rigid_motion import RIGID, STRETCHED, TURNS, RigidPath, path_of
from fenics_mortar.rigid.body_motions import BoundBody, by_body, closing, slipping
from fenics_mortar.rigid.complementarity import Touching, motion_past
from fenics_mortar.rigid.floating import ROUGH
from fenics_mortar.utils import errors, ranks
from fenics_mortar.utils.arrays import Array, at_rows, norms

if TYPE_CHECKING:
    from fenics_mortar.bulk.bodies import FloatingBody
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.equations.general import ContactEquations
    from fenics_mortar.verify.node_paths import Turns


# Rotation of prescribed nodes [radian], 6 degrees, below which bodies do not follow them: Newton's
# method needs few iterations then.
TURNED = 0.1

# Difference of motions over their size [1] up to which a body rides on another one, or moves as its
# prescribed nodes do.
FOLLOWS = 1e-3

# Overlap of a node over its length [1] above which bodies that others push are moved before a
# solve: Newton's method needs few iterations below.
PUSHED = 0.1


def turns_of_prescribed(e: ContactEquations) -> dict[int, RigidPath]:
    """Rigid motions of prescribed nodes to their values, of the bodies that turn (collective)."""
    moved = motions_of_prescribed(e)
    return {body: motion for body, (motion, _) in moved.items() if abs(motion.angle) > TURNED}


def motions_of_prescribed(e: ContactEquations) -> dict[int, tuple[RigidPath, bool]]:
    """Rigid motions of prescribed nodes to their values, and whether these move as one, by body.

    Collective.
    """
    bulk, dofs = e.bulk, e.bulk.space.owned_dofs
    values = bulk.values_as_prescribed()
    led = np.flatnonzero(bulk.prescribed[dofs].all(axis=1))
    x, change = bulk.positions()[led], (values - bulk.values)[dofs[led]]
    bodies, x0, x1 = ranks.from_all_ranks(e.comm, (e.floating.labels[led], x, x + change))
    found = {}
    for body in np.unique(bodies).tolist():
        start, end = x0[bodies == body], x1[bodies == body]
        motion = path_of(start, end, STRETCHED)
        off, way = (float(np.abs(end - x).max()) for x in (motion.carry(start, 1.0), start))
        found[body] = motion, off <= FOLLOWS * way
    return found


def with_followers(e: ContactEquations, motions: dict[int, RigidPath]) -> dict[int, RigidPath]:
    """Rigid motions, and those of bodies that contact carries along if these turn (collective).

    Without slip at nodes that touch at the accepted state, as far as possible, weighted by the size
    of their forces. A body that moves there like one that is led takes its motion; centres of
    others, such as rollers, move on straight lines.

    Args:
        e: The equations at the start of the step; rigid boundaries driven by forces are moved.
        motions: Rigid motions of prescribed nodes, see ``turns_of_prescribed``.
    """
    bodies, contacts = e.floating.bodies, e.floating.contacts
    rubs = any(contact.pair.law.has_friction for contact in contacts)
    led = e.crossings.led.carried_from_here() if bodies and rubs else None
    if led is None or not (led.turn.any() or _moves(contacts, led)):
        return motions
    rates, given = zip(*(_at_contact(e, contact, led) for contact in contacts), strict=True)
    A, b = np.concatenate(rates, axis=1).T, np.concatenate(given)
    told = np.isfinite(b)  # not where the prescribed nodes of a body do not move as one
    A, b = A[told], b[told]
    factors = ranks.agreed(e.comm, np.linalg.lstsq(A, -b, rcond=FOLLOWS)[0])
    found = dict(motions)
    for body, own in zip(bodies, by_body(bodies, factors), strict=True):
        motion = _as_followed(e, body, own @ body.motions, led)
        if motion is not None:
            found[body.label] = motion
            body.move_loads(own)
    return found


def _moves(contacts: list[Contact], led: Carried) -> bool:
    """Whether pivots of led bodies or obstacles move (local)."""
    obstacles = [(c.obstacle.place, c.partners.place) for c in contacts if c.obstacle is not None]
    return any((end != start).any() for end, start in [(led.end, led.start), *obstacles])


def _at_contact(e: ContactEquations, contact: Contact, led: Carried) -> tuple[Array, Array]:
    """Motions of nodes that touch past what they face, times roots of their forces (collective).

    Returns:
        Those by the motions of floating bodies, (motions, rows), and by led ones, (rows,).
    """
    partners, bodies = contact.partners, e.floating.bodies
    at = np.flatnonzero(partners.pressure > 0.0)
    size = np.sqrt(partners.pressure * contact.slave.nodal_areas)[at][:, None]
    normals = evaluate_normals(contact.slave, partners.x, "opposite")[0][at]
    sides = (contact.slave, partners.x), (contact.master, partners.m)
    past = []
    for side, x in sides:
        nodes, parts = e.crossings.outline.indices_of(side.nodes), e.floating.parts_of(side)
        moved = [at_rows(led, nodes)._replace(x=x).velocity()[None]]
        moved += [body.displacement(x, parts) for body in bodies]
        past.append(np.concatenate(moved))
    facing = partners.M[at]
    rows = np.array([slave[at] - facing @ other for slave, other in zip(*past, strict=True)])
    if contact.obstacle is not None:
        foot = carried_by(contact.obstacle, partners.place, partners.feet)
        rows[0] -= foot._replace(x=partners.x).velocity()[at]
    if not contact.pair.law.has_friction:
        rows = (rows * normals).sum(axis=2, keepdims=True)
    rows = (size * rows).reshape(len(rows), -1)
    return rows[1:], rows[0]


def _as_followed(
    e: ContactEquations, body: FloatingBody, rates: Array, led: Carried
) -> RigidPath | None:
    """Rigid motion of a floating body by its rates; ``None`` if it does not turn (local)."""
    dim = len(body.centre)
    shift, turn = np.split(rates[: dim + len(TURNS[dim])], [dim])
    turn = turn / body.size
    if not TURNED < np.linalg.norm(turn) < np.pi:
        return None
    start = e.crossings.accepted.x[e.crossings.led.bodies == body.label].mean(axis=0)
    here = led._replace(x=np.broadcast_to(start, led.x.shape))
    own = shift + moved_by(turn, (start - body.centre)[None])[0]
    apart = norms(here.velocity() - own) + body.size * norms(led.turn - turn)
    nearest = int(apart.argmin())
    if apart[nearest] <= FOLLOWS * body.size * float(np.linalg.norm(turn)):
        return RigidPath(led.start[nearest], led.end[nearest], turn)
    return RigidPath(start, start + own, turn)


def turn(e: ContactEquations, motions: dict[int, RigidPath], *, followed: bool) -> None:
    """Move bodies along with their prescribed nodes (collective).

    Newton's method starts from the last state, where only prescribed nodes are elsewhere. If these
    turn by more than some degrees, as the hub of an arm, the cells beside them are distorted so
    much that the iteration may fail. A body that follows rigidly has the stresses and the contact
    pressures that it had before, turned. Multipliers of slave nodes turn with their bodies; slip is
    counted from the accepted state.

    Args:
        e: The equations at the start of the motions; displacements and multipliers are changed.
        motions: Rigid motions by body.
        followed: Whether bodies are among them that contact alone supports. Without, multipliers
            vanish where contact has moved on: where gaps exceed what the pressure compresses.
    """
    bulk, dofs, x = e.bulk, e.bulk.space.dofs, e.bulk.positions()
    values = bulk.values_as_prescribed()
    for body, motion in motions.items():
        mine = e.floating.labels == body
        at, moved = dofs[mine], motion.carry(x[mine], 1.0) - x[mine]
        bulk.values[at] = np.where(bulk.prescribed[at], values[at], bulk.values[at] + moved)
    for contact in e.contacts:
        z, bodies = contact.z.copy(), e.floating.labels_of(contact.slave)
        for body, motion in motions.items():
            z[bodies == body] = motion.turned(z[bodies == body], 1.0)
        contact.change(z=z)
    if followed:
        return
    weights = [contact.c_n for contact in e.contacts]
    for contact in e.contacts:
        contact.change(c_n=1.0)
    e.evaluate_contacts(start=True)  # after an error the state is restored, with its weights
    for contact, c_n in zip(e.contacts, weights, strict=True):
        contact.change(c_n=c_n)


def push_aside(e: ContactEquations, idle: set[int]) -> bool:
    """Move bodies that contact alone supports out of the way of led bodies and obstacles.

    Led bodies are moved to their values. Newton's method would begin with bodies that stick, and
    lift or turn those that others push, by many iterations or to another equilibrium. Slip is
    counted from the accepted state. Only in the plane: in space the polygon of friction leaves the
    direction of slip open, and two frictionless pushes took more iterations. Collective.

    Args:
        e: The equations at the start of a solve; displacements are changed.
        idle: Labels of the bodies that are set aside, which do not take part.

    Returns:
        Whether bodies were moved: not where they hardly overlap, or cannot get out of the way.
    """
    bodies = [body for body in e.floating.bodies if body.label not in idle]
    pairs = e.floating.contacts if e.bulk.space.dim == 2 else []
    if not (bodies and pairs) or e.newton.tentative:
        return False
    if turns_of_prescribed(e) or any(map(_turns, pairs)):  # see ``with_followers``
        return False
    start, least = e.state(), PUSHED
    bulk, _, _ = e.residual.forces()
    loads = np.concatenate([body.resultant(bulk - e.motions.pushed_nodes()) for body in bodies])
    try:
        moved = motions_of_prescribed(e).items()
        turn(e, {body: motion for body, (motion, as_one) in moved if as_one}, followed=True)
        for _ in range(RIGID.max_moves):
            e.evaluate_operators()
            nodes = [_ahead(e, c, bodies, idle) for c in pairs]
            touching, gaps, sizes, slips = zip(*nodes, strict=True)
            gap, size, slip = map(np.concatenate, (gaps, sizes, slips))
            if not (gap < -least * size).any():
                if least < PUSHED:
                    return True
                break
            least = RIGID.overlap
            at = Touching.joined(touching), gap + 0.5 * least * size, slip
            motion = ranks.agreed(e.comm, motion_past(loads, *at))
            if motion is None:
                break
            moves = list(zip(bodies, by_body(bodies, motion), strict=True))
            longest = max(np.abs(own).max() / body.size for body, own in moves)
            for body, own in moves:
                body.move(min(1.0, RIGID.largest_move / longest) * own)
    except errors.NotFiniteError:  # on all ranks: where users' functions are not defined
        pass
    e.restore(start)
    return False


def _turns(contact: Contact) -> bool:
    """Whether the obstacle of a contact, if any, turns in the plane in this step (local)."""
    if contact.obstacle is None:
        return False
    return bool(contact.obstacle.place[2] != contact.partners.place[2])


def _ahead(
    e: ContactEquations, contact: Contact, bodies: Sequence[BoundBody], idle: set[int]
) -> tuple[Touching, Array, Array, Array]:
    """Covered nodes of a contact that bodies move, gaps, lengths, slips, (n,) each [length]."""
    rates = closing(contact, *bodies).T
    on = contact.now.covered & contact.multiplier_nodes & rates.any(axis=1)
    for body in e.floating.bodies:
        if body.label in idle:
            on &= ~body.at(contact)
    pressure = np.maximum(contact.pressure, 0.0)
    slope, shear = strength(contact.now, float(pressure.max(initial=0.0)))
    limit = contact.operators.weight * (np.minimum(slope, ROUGH) * pressure + shear)
    slips, none = np.moveaxis(slipping(contact, *bodies), 0, -1)[on], np.zeros(int(on.sum()))
    touching = Touching(-rates[on], slips, none, limit[on], none)
    return touching, contact.now.closing_gap[on], contact.slave.nodal_lengths[on], contact.slip[on]


# Change of slip by the motions of a solution, over the way of bodies that turn [1], above which it
# is solved for again, and how often at most: after one it is below a tenth of that, as a rule.
LED_CHANGE, LED_SOLVES = 2e-4, 4
# The same after the last of these [1], above which the step fails: slip is to be right to 1 %.
LED_WRONG = 0.01


def _led(e: ContactEquations, *, solved: bool) -> tuple[list[Contact], Carried | None]:
    """Pairs that depend on slip and whose bodies may turn; motions that carry their nodes.

    Args:
        e: The equations.
        solved: Whether motions are those of all bodies in a solution; else prescribed ones.
    """
    pairs = [contact for contact in e.floating.contacts if contact.depends_on_slip]
    return pairs, e.crossings.led.carried(e.crossings.accepted, solved=solved) if pairs else None


def lead_by_motions(e: ContactEquations, *, solved: bool) -> None:
    """Count slip of nodes without force from where motions carry them (collective).

    Args:
        e: The equations.
        solved: Whether motions are those of all bodies in a solution; else prescribed ones.
    """
    pairs, carried = _led(e, solved=solved)
    if carried is not None:
        for pair in pairs:
            lead(pair, pair.partners, e.crossings.outline, carried)


def follow_solution(e: ContactEquations, report: NewtonReport, solve: Solve) -> NewtonReport:
    """Solve again, with slip of nodes without force from where their bodies have turned to.

    Collective. Motions are those of the solution, fixed within a solve, for bodies that nothing
    prescribes, such as rollers. Slip by their first-order changes is right anyway: one or two more
    solves are enough, as a rule.

    Args:
        e: The equations at the solution.
        report: Record of the solve that led to it.
        solve: Function that solves from there.

    Raises:
        NotConvergedError: On all ranks, if slip still changes after the last of these solves.
    """
    change = 0.0
    for number in range(LED_SOLVES + 1):
        pairs, carried = _led(e, solved=True)
        if carried is None:
            return report
        kept = [pair.partners for pair in pairs]
        given = e.crossings.outline, carried, e.crossings.led.bodies
        change = ranks.agreed(e.comm, max(lead_by_solution(pair, *given) for pair in pairs))
        if change <= LED_CHANGE or number == LED_SOLVES:
            for pair, partners in zip(pairs, kept, strict=True):
                pair.change(partners=partners)
            break
        report = then_solve(report, solve)
    if change > LED_WRONG:
        report.converged = False
        report.reason = (
            f"slip of bodies that turn still changes by {change:.2g} of their way after "
            f"{LED_SOLVES} more solves from their motions; take smaller steps"
        )
        raise errors.NotConvergedError(report.reason, report)
    return report


# Times within a step, over its length [1]. They are not evenly spaced, so that at a constant rate
# no number of full turns in the step is a number of full turns between all of them.
WITHIN = (0.11, 0.36, 0.68)


@contextmanager
def loads_of_step(
    e: ContactEquations, set_loads: Callable[[float], None], start: float, stop: float
) -> Iterator[None]:
    """Context of a step with the loads of its end; refuses steps in which bodies turn far.

    The ends of a step determine the rotation of a body up to full turns: a shaft turned by 300
    degrees looks like one turned back by 60. Where loads are a function of the time, it is
    evaluated at times within the step as well. The rotations of prescribed boundaries between
    these, each of less than half a turn, are added up. The sizes of rotations are added, so that a
    turn to and fro is found as well.

    Collective.

    Args:
        e: The equations.
        set_loads: Function that sets loads and prescribed values for a time, on all ranks.
        start: Time of the present state [time].
        stop: Time at the end of the step [time].

    Raises:
        NotConvergedError: On all ranks, if one side of a pair turns by more than ``MAX_ROTATION``
            relative to the other one; obstacles turn by known angles.
        Exception: Any error of the function, also at times within the step.
    """
    led = e.crossings.led

    def moved(time: float) -> Array:
        set_loads(time)
        return led.prescribed_positions()

    if led.may_turn:
        times = [*(start + fraction * (stop - start) for fraction in WITHIN), stop]
        turns = [led.turns(*ends) for ends in pairwise([led.positions(), *map(moved, times)])]
        for sides in sorted(led.sides):
            _refuse_turns(e, sides, turns)
    else:
        set_loads(stop)
    led.examined = True
    try:
        yield
    finally:
        led.examined = False


def _refuse_turns(e: ContactEquations, sides: tuple[int, int], turns: list[Turns]) -> None:
    """Raise an error if one of two bodies turns too far relative to the other one."""
    led = e.crossings.led
    relative = np.array([np.linalg.norm(led.relative(sides, turn)) for turn in turns])
    total = float(np.abs(np.arctan2(np.sin(relative), np.cos(relative))).sum())
    if total <= MAX_ROTATION:
        return

    def turned(side: int) -> float:
        return sum(float(np.linalg.norm(turn[side])) for turn in turns if side in turn)

    turning = e.floating.name_of(max(sides, key=turned))
    reason = (
        f"{turning} turns by at least {np.degrees(total):.0f} degrees in the step; the ends tell "
        "the direction of slip and the bodies passed up to "
        f"{np.degrees(MAX_ROTATION):.0f} degrees only: take smaller steps"
    )
    raise errors.NotConvergedError(reason, NewtonReport(reason=reason))
