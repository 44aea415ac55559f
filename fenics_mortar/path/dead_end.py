# SPDX-License-Identifier: MIT
"""Why a path of equilibria ends: what can be told from its last state.

Two ends are sure. Surfaces that slip off each other's edges lose the last of their overlap while a
force still passes through it. And with much friction the equations of a small step may have no
solution (Klarbring 1990): near a state in which some nodes slide and no other is about to change,
each of these can only stick or slide on, so that there are finitely many linear problems to solve.
If the solution of each breaks the law that it assumes, no state near by obeys it. In both cases a
body would set off, and only inertia says where it comes to rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.laws import STICK
from fenics_mortar.equations.state import State
from fenics_mortar.interface.mortar import LINEARIZATIONS
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MortarError, RaisedElsewhereError, place

# Overlap of surfaces that slip off each other, over the shortest facet of both.
SLIVER = 1e-3
# Points that pressed on each other have passed if they are so far behind each other [facets].
PASSED = 0.5
# Sliding nodes whose ways on are all tried, 2^n of them.
MOST_SLIDING = 8

# A pair and a slave node of it.
Place = tuple[Contact, int]


def why_path_ends(problem: ContactProblem) -> str:
    """Say why there is no equilibrium next to a state; "" if that is not sure (collective).

    Args:
        problem: At the last equilibrium, with loads that are a little further; it stays there.
    """
    start = problem.state()
    try:
        return "; ".join(_slipping_off(problem)) or _deadlock(problem, start)
    except RaisedElsewhereError:
        raise
    except MortarError:
        return ""
    finally:
        problem.restore(start)


def _slipping_off(problem: ContactProblem) -> Iterator[str]:
    """Pairs whose last overlap vanishes while it bears a force."""
    for contact in problem.equations.contacts:
        if not (isinstance(contact, Contact) and contact.active.any() and not contact.obstacle):
            continue
        o = contact.operators
        overlap = float(o.cover.sum())
        shortest = min(_shortest(o.slave.facets, o.x), _shortest(o.master.facets, o.m))
        if overlap < SLIVER * shortest:
            j = int(np.argmax(np.where(contact.active, o.cover, -1.0)))
            force = float(np.hypot(*contact.total_force))
            yield (
                f"'{contact.slave.name}' and '{contact.master.name}' slip off each other at "
                f"{place(o.x[j])}: their overlap vanishes, it is {overlap:.1e}, with a force of "
                f"{force:.3g} in it that nothing bears beyond"
            )


def why_it_is_a_jump(problem: ContactProblem, before: State) -> str:
    """Say which bodies jumped past each other since a state that they pressed in; "" if none.

    Points that pressed on each other at the start of a step are behind each other, and nothing of
    that contact is left: no way leads there on which each state is in equilibrium.
    """
    for contact, then in zip(problem.equations.contacts, before.interfaces, strict=True):
        active = then.active
        if not (isinstance(contact, Contact) and active.any()) or contact.active.any():
            continue
        o = contact.operators
        behind = np.einsum("ja,ja->j", o.n, contact.partners.apart(o)) / contact.nodal_lengths
        j = int(np.argmax(np.where(active, behind, -np.inf)))
        if behind[j] > PASSED:
            return (
                f"'{contact.slave.name}' and '{contact.master.name}' jumped past each other at "
                f"{place(o.x[j])}, by {behind[j]:.1f} facets in one step"
            )
    return ""


def _shortest(facets: Indices, x: Array) -> float:
    """Length of the shortest facet."""
    return float(np.linalg.norm(x[facets[:, -1]] - x[facets[:, 0]], axis=1).min())


def _deadlock(problem: ContactProblem, start: State) -> str:
    """Whether all ways in which the sliding nodes may go on break the law of friction."""
    if problem.equations.linearization != LINEARIZATIONS["full"]:
        return ""
    sliding = [
        (contact, j)
        for contact in problem.equations.contacts
        if isinstance(contact, Contact)
        for j in np.flatnonzero(contact.sliding).tolist()
    ]
    if not 0 < len(sliding) <= MOST_SLIDING:
        return ""
    fewest = sliding
    for way in product((False, True), repeat=len(sliding)):
        broken = _broken_by(problem, start, [s for s, sticks in zip(sliding, way) if sticks])
        if not broken or not set(broken) <= set(sliding):
            return ""
        fewest = min(fewest, broken, key=len)
    where = ", ".join(f"{place(contact.operators.x[j])}" for contact, j in fewest)
    return (
        f"{len(sliding)} nodes slide, and each of the {2 ** len(sliding)} ways in which they may "
        f"stick or slide on breaks the law of friction, at the least at {where}: no state near by "
        "is in equilibrium, so much friction lets bodies set off"
    )


def _broken_by(problem: ContactProblem, start: State, sticking: list[Place]) -> list[Place]:
    """Nodes that break the law after a small step in which all but some sliding ones stay."""
    problem.restore(start)
    for contact in problem.equations.contacts:
        contact.start_step()
    problem.equations.evaluate(start=False)
    contacts = [contact for contact in problem.equations.contacts if isinstance(contact, Contact)]
    for contact, before in zip(problem.equations.contacts, start.interfaces, strict=True):
        piece = before.piece.copy()
        piece[[j for other, j in sticking if other is contact]] = STICK
        contact.change(z=before.z, active=before.active, piece=piece)
    assumed = [(contact.active, contact.piece) for contact in contacts]
    problem.equations.advance()
    broken = []
    for contact, (active, piece) in zip(contacts, assumed, strict=True):
        contact.evaluate(problem.equations.bulk.u.x.array, problem.equations.linearization)
        contact.update_active()
        changed = (contact.active != active) | (active & (contact.piece != piece))
        broken += [(contact, j) for j in np.flatnonzero(changed).tolist()]
    return broken
