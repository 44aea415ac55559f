# SPDX-License-Identifier: MIT
"""Derivative of a step's residuals with respect to the state at the start of the step."""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.partners import find_partners
from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.equations.state import State
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.pair_vectors import (
    add_pair,
    at_pair,
    check_exact,
    from_rows,
    rows_at,
    zero_vector,
)
from fenics_mortar.sensitivity.partials.history import Earlier, PairHistory
from fenics_mortar.utils.errors import MortarError
from fenics_mortar.utils.ranks import agreed
from fenics_mortar.utils.rounding import ROUNDING


class StepHistory:
    """Derivative of the present residuals with respect to the state before; collective methods.

    Rows and units are those of ``equations.linearized``. Only rows of multipliers of pairs with
    friction depend on the state before: through their partners, and through the shear of redundant
    sticks. Active sets are fixed, and so is the memory of laws, see ``memory``.

    Args:
        problem: The problem, at the end of a step, with operators of the linearization ``EXACT``.
        before: Accepted state at the start of the step.

    Attributes:
        any: Whether any row depends on the state before.
        pairs: Derivatives of the pairs, with respect to their numbers.
        earlier: States before of the pairs, by their numbers.

    Raises:
        MortarError: On all ranks, if slip is not counted from that state, for example after a rigid
            move of a body or of an obstacle before the solve; or if operators lack derivatives.
    """

    def __init__(self, problem: ContactProblem, before: State) -> None:
        e = self._equations = problem.equations
        self.earlier: dict[int, Earlier] = {}
        self.pairs: dict[int, PairHistory] = {}
        for i, contact in enumerate(e.contacts):
            if not isinstance(contact, Contact) or not has_history(contact):
                continue
            check_exact(contact)
            self.earlier[i] = earlier_state_of(e, i, contact, before)
            self.pairs[i] = PairHistory(contact, self.earlier[i])
        self.any = bool(self.pairs)

    def jvp(self, ds: LinearVector) -> LinearVector:
        """Change of the residuals along a change ``ds`` of the state before."""
        e = self._equations
        return from_rows(e, {i: pair.along(at_pair(e, i, ds)) for i, pair in self.pairs.items()})

    def vjp(self, y: LinearVector) -> LinearVector:
        """Gradient of the scalar product of the residuals and ``y`` by the state before."""
        gradient = zero_vector(self._equations)
        for i, pair in self.pairs.items():
            rows = rows_at(y, i, self._equations.contacts[i])
            add_pair(self._equations, i, gradient, pair.back(rows))
        return gradient


def has_history(contact: Any) -> bool:
    """Whether the rows of a pair depend on the state before (local)."""
    if not isinstance(contact, Contact):
        return False
    law = contact.pair.law
    return bool(law.has_friction or law.memory or law.needs_nodal_state)


def earlier_state_of(e: ContactEquations, i: int, contact: Contact, before: State) -> Earlier:
    """State before of pair ``i``; its partners have to be those of the step (collective).

    Raises:
        MortarError: On all ranks, if slip is counted from another state.
    """
    place = None
    if contact.obstacle is not None:
        place = before.places[e.motions.obstacles.index(contact.obstacle)]
    earlier = Earlier(contact, before.u, before.interfaces[i], place)
    measure = contact.slip_measure
    with earlier.at_earlier_position():
        found = find_partners(
            earlier.operators, earlier.fields.covered, measure,
            least=contact.least_coverage, master_planes=contact.rotating_planes,
        )  # fmt: skip
    o, given = contact.operators, contact.partners
    difference = np.abs(found.gap_vectors(o) - given.gap_vectors(o)).max()
    difference = max(difference, np.abs(found.slip(o) - given.slip(o)).max())
    difference = agreed(e.comm, float(difference))
    if not difference <= ROUNDING * contact.slave.extent:
        raise MortarError(
            f"the slip of {contact.pair!r} is not counted from the state before, but from one "
            f"that differs by {difference:.3g}: bodies or obstacles were moved before the solve, "
            "or the shape of an obstacle was changed; call accept() at the start of the path, so "
            "that slip is counted from there"
        )
    return earlier
