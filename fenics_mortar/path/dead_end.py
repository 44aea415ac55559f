# SPDX-License-Identifier: MIT
"""Reasons for the end or a turning point of a path of equilibria, from its last state.

Two reasons for an end are certain. First, surfaces that slip off each other's edges lose their last
common length while a force still acts on it. Second, with large friction the equations of a small
step may have no solution (Klarbring 1990): near a state in which some nodes slide and no other node
is about to change, each of these nodes can only stick or continue to slide, so that the number of
possible linear problems is finite. If the solution of each violates its assumption, no nearby state
satisfies the law. In both cases a body would accelerate, and the next state of rest depends on
inertia.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.law import STICK
from fenics_mortar.equations.general import State
from fenics_mortar.equations.linearized_contact import LinearizedContact
from fenics_mortar.interface.mortar import LINEARIZATIONS
from fenics_mortar.problem import ContactProblem
from fenics_mortar.rigid.proximal import RIGID
from fenics_mortar.utils.arrays import HALF_FACET, Array, Indices, norms
from fenics_mortar.utils.errors import MortarError, RaisedElsewhereError, format_point
from fenics_mortar.utils.ranks import agreed

# Largest number n of sliding nodes for which all 2^n combinations of stick and slip are tried.
MAX_SLIDING = 8

# A pair and a slave node of it.
Place = tuple[Contact, int]


def reason_for_end(problem: ContactProblem) -> str:
    """Reason why there is no equilibrium next to a state; "" if uncertain (collective).

    Args:
        problem: At the last equilibrium, with slightly advanced loads; its state is restored.
    """
    return _reason(
        problem,
        lambda start: (
            agreed(problem.equations.comm, "; ".join(_slipping_off(problem)))
            or _deadlock(problem, start)
        ),
    )


def describe_turning_point(problem: ContactProblem) -> str:
    """Describe the turning point in a failed step; "" if there is none (collective).

    The equations are linearized at the last equilibrium. The result is "" if bodies float, since
    these are moved rigidly before a solve.

    Args:
        problem: At the last equilibrium, with the loads of the step; its state is restored.
    """
    if problem.equations.floating.bodies:
        return ""
    return _reason(problem, lambda _: _turning_point(problem))


def _reason(problem: ContactProblem, find: Callable[[State], str]) -> str:
    """Result of ``find`` for the present state, which is restored; "" if ``find`` fails."""
    start = problem.state()
    try:
        return find(start)
    except RaisedElsewhereError:
        raise
    except MortarError:
        return ""
    finally:
        problem.restore(start)


def _turning_point(problem: ContactProblem) -> str:
    """Turning point of the equations linearized at the start of the step (collective)."""
    equations = problem.equations
    equations.start_step()
    equations.evaluate(start=False)
    linearized = LinearizedContact(
        equations.bulk, equations.floating, equations.system, equations.motions
    )
    if not linearized.applies:
        return ""
    equations.bulk.assemble_tangent()
    return linearized.describe_turning_point()


def _slipping_off(problem: ContactProblem) -> Iterator[str]:
    """Describe pairs whose overlap vanishes under a force (local)."""
    for contact in problem.equations.contacts:
        if not (isinstance(contact, Contact) and contact.active.any() and not contact.obstacle):
            continue
        o = contact.operators
        overlap = float((o.cover / contact.slave.mean_thickness).sum())
        shortest = min(_shortest(o.slave.facets, o.x), _shortest(o.master.facets, o.m))
        if overlap < RIGID.sliver * shortest:
            j = int(np.argmax(np.where(contact.active, o.cover, -1.0)))
            force = float(norms(contact.total_force[None])[0])
            yield (
                f"'{contact.slave.name}' and '{contact.master.name}' slip off each other at "
                f"{format_point(o.x[j])}: their common length has decreased to {overlap:.1e} and "
                f"still transfers a force of {force:.3g}; there is no equilibrium beyond"
            )


def describe_jump(problem: ContactProblem, before: State) -> str:
    """Describe a jump since a state that no path of equilibria follows; "" if none (collective).

    Args:
        problem: The problem at the new state.
        before: The state at the start of the step.
    """
    comm = problem.equations.comm
    return agreed(comm, _past_each_other(problem, before)) or agreed(
        comm, _slid_away(problem, before)
    )


def _past_each_other(problem: ContactProblem, before: State) -> str:
    """Describe a jump of two bodies past each other since a state; "" if none (local).

    Points that were in contact at the start of the step are behind each other, and no contact
    remains.
    """
    for contact, then in zip(problem.equations.contacts, before.interfaces, strict=True):
        active = then.active
        if not (isinstance(contact, Contact) and active.any()) or contact.active.any():
            continue
        o = contact.operators
        behind = (
            np.einsum("ja,ja->j", o.n, contact.partners.gap_vectors(o))
            / contact.slave.nodal_lengths
        )
        j = int(np.argmax(np.where(active, behind, -np.inf)))
        if behind[j] > HALF_FACET:
            return (
                f"'{contact.slave.name}' and '{contact.master.name}' jumped past each other at "
                f"{format_point(o.x[j])}, by {behind[j]:.1f} facets in one step"
            )
    return ""


def _slid_away(problem: ContactProblem, before: State) -> str:
    """Describe a body that slid out of an equilibrium since a state; "" if none (collective).

    Friction supported the body at that state. Now no contact forces balance its loads, and it was
    moved rigidly. If another pair stops it, such as a wall, the new position is a state of rest. If
    only other nodes of the same pairs support it, its new position depends on the mesh.
    """
    equations = problem.equations
    states = dict(zip(map(id, equations.contacts), before.interfaces, strict=True))
    for body in equations.floating.settling.moved:
        pairs = equations.floating.contacts_of(body)
        loaded = [c for c in pairs if c.pair.law.has_friction and states[id(c)].z.any()]
        if not loaded or any(c.active.any() and not states[id(c)].z.any() for c in pairs):
            continue
        slips = [
            np.abs(np.where(states[id(c)].active, c.slip, 0.0)) / c.slave.nodal_lengths
            for c in loaded
        ]
        farthest = max(float(slip.max()) for slip in slips)
        if farthest > RIGID.overlap:
            return (
                "no contact forces at the nodes balance the loads on "
                f"{equations.floating.name_of(body.label)}, which friction supported before: it "
                f"slid by {farthest:.2f} facets in one step, and its rest depends on inertia; "
                f"finer facets may support more"
            )
    return ""


def _shortest(facets: Indices, x: Array) -> float:
    """Length of the shortest facet [length]."""
    return float(np.linalg.norm(x[facets[:, -1]] - x[facets[:, 0]], axis=1).min())


def _deadlock(problem: ContactProblem, start: State) -> str:
    """Describe the case in which all combinations of stick and slip violate the friction law."""
    if problem.equations.linearization != LINEARIZATIONS["full"]:
        return ""
    sliding = [
        (contact, j)
        for contact in problem.equations.contacts
        if isinstance(contact, Contact)
        for j in np.flatnonzero(contact.sliding).tolist()
    ]
    if not 0 < len(sliding) <= MAX_SLIDING:
        return ""
    fewest = sliding
    for choice in product((False, True), repeat=len(sliding)):
        violated = _violated_by(problem, start, [s for s, sticks in zip(sliding, choice) if sticks])
        if not violated or not set(violated) <= set(sliding):
            return ""
        fewest = min(fewest, violated, key=len)
    where = ", ".join(f"{format_point(contact.operators.x[j])}" for contact, j in fewest)
    return (
        f"{len(sliding)} nodes slide, and each of the {2 ** len(sliding)} combinations of stick "
        f"and slip violates the law of friction, at best only at {where}: no nearby state is in "
        f"equilibrium, and bodies would accelerate; friction is too large for a static solution"
    )


def _violated_by(problem: ContactProblem, start: State, sticking: list[Place]) -> list[Place]:
    """Nodes that violate the law after a step with fixed branches, nodes in ``sticking`` stick."""
    problem.restore(start)
    problem.equations.start_step()
    problem.equations.evaluate(start=False)
    contacts = [contact for contact in problem.equations.contacts if isinstance(contact, Contact)]
    for contact, before in zip(problem.equations.contacts, start.interfaces, strict=True):
        branch = before.branch.copy()
        branch[[j for other, j in sticking if other is contact]] = STICK
        contact.change(z=before.z, active=before.active, branch=branch, heading=None)
    assumed = [(contact.active, contact.branch) for contact in contacts]
    problem.equations.advance()
    violated = []
    for contact, (active, branch) in zip(contacts, assumed, strict=True):
        contact.evaluate(problem.equations.bulk.u.x.array, problem.equations.linearization)
        contact.update_active()
        changed = (contact.active != active) | (active & (contact.branch != branch))
        violated += [(contact, j) for j in np.flatnonzero(changed).tolist()]
    return violated
