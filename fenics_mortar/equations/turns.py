# SPDX-License-Identifier: MIT
"""Bodies whose prescribed values turn, and slip of nodes that come into contact while bodies turn.

``turn`` moves whole bodies with their prescribed nodes before a solve. ``lead_by_motions`` and
``follow_solution`` count slip from where motions carry nodes: those that are prescribed before a
solve, those of the solution after it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from fenics_mortar.contact.arcs import Carried, carried_by, moved_by
from fenics_mortar.contact.slip import lead, lead_by_solution
from fenics_mortar.interface.integrals import evaluate_normals
from fenics_mortar.newton.loop import NewtonReport, then_solve
from fenics_mortar.obstacles.rigid_motion import TURNS
from fenics_mortar.rigid.body_motions import by_body
from fenics_mortar.utils.arrays import Array, at_rows, norms
from fenics_mortar.utils.errors import NotConvergedError
from fenics_mortar.utils.ranks import agreed, from_all_ranks
from fenics_mortar.verify.node_paths import STRETCHED, RigidPath, path_of

if TYPE_CHECKING:
    from fenics_mortar.bulk.bodies import FloatingBody
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.equations.general import ContactEquations


# Rotation of prescribed nodes [radian], 6 degrees, below which bodies do not follow them: Newton's
# method needs few iterations then.
TURNED = 0.1

# Difference of motions over their size [1] up to which a body rides on another one.
FOLLOWS = 1e-3


def turns_of_prescribed(e: ContactEquations) -> dict[int, RigidPath]:
    """Rigid motions of prescribed nodes to their values, of the bodies that turn (collective)."""
    bulk, dofs = e.bulk, e.bulk.space.owned_dofs
    values = bulk.values_as_prescribed()
    led = np.flatnonzero(bulk.prescribed[dofs].all(axis=1))
    x, change = bulk.positions()[led], (values - bulk.values)[dofs[led]]
    bodies, x0, x1 = from_all_ranks(e.comm, (e.floating.labels[led], x, x + change))
    found = {}
    for body in np.unique(bodies).tolist():
        motion = path_of(x0[bodies == body], x1[bodies == body], STRETCHED)
        if abs(motion.angle) > TURNED:
            found[body] = motion
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
    factors = agreed(e.comm, np.linalg.lstsq(A, -b, rcond=FOLLOWS)[0])
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
    pairs = [
        contact
        for contact in e.floating.contacts
        if contact.pair.sliding != "small"
        and (contact.pair.law.has_friction or contact.pair.law.needs_nodal_state)
    ]
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


def follow_solution(
    e: ContactEquations, report: NewtonReport, solve: Callable[[], NewtonReport]
) -> NewtonReport:
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
        change = agreed(e.comm, max(lead_by_solution(pair, *given) for pair in pairs))
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
        raise NotConvergedError(report.reason, report)
    return report
