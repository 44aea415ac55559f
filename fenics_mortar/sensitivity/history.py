# SPDX-License-Identifier: MIT
"""Derivatives with respect to the state and the memory of laws at the start of a step.

With the memory h_k of the laws at the end of step k, the equations are
R_k(s_k, s_{k-1}, h_{k-1}, m) = 0 and h_k = H_k(s_k, s_{k-1}, h_{k-1}, m). Changes of the memory are
propagated forwards, gradients with respect to the memory backwards. Both are dictionaries of
replicated arrays by the number of the pair, with the names of the memory of each slave node;
without laws with memory they are empty.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.equations.state import State
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.pair_operators import (
    BY_PAIR,
    ROWS,
    UNKNOWNS,
    PairOperator,
    Vectors,
    check_exact,
    values_of,
)
from fenics_mortar.sensitivity.partials.fields import fields_by_state
from fenics_mortar.sensitivity.partials.history import Earlier, PairHistory, history_of_pair
from fenics_mortar.sensitivity.partials.law import memory_of_pair
from fenics_mortar.sensitivity.partials.maps import Matrix, through_fields
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError
from fenics_mortar.utils.ranks import agreed
from fenics_mortar.utils.rounding import ROUNDING

Memories = dict[int, Array]


class StepHistory:
    """Derivative of the present residuals with respect to the state before; collective methods.

    Rows and units are those of ``equations.linearized``. Only rows of multipliers of pairs with
    friction depend on the state before: through their partners, and through the shear of redundant
    sticks. Active sets are fixed, and so is the memory of laws, see ``StepMemory``.

    Args:
        problem: The problem, at the end of a step, with operators of the linearization ``EXACT``.
        before: Accepted state at the start of the step.

    Attributes:
        pairs: Derivatives of the pairs that depend on the state before, by their numbers.
        residuals: Derivative of the residuals.

    Raises:
        MortarError: On all ranks, if slip is not counted from that state, for example after a rigid
            move of a body or of an obstacle before the solve; or if operators lack derivatives.
    """

    def __init__(self, problem: ContactProblem, before: State) -> None:
        e = problem.equations
        self.pairs: dict[int, PairHistory] = {}
        for i, contact in enumerate(e.contacts):
            if isinstance(contact, Contact) and has_history(contact):
                check_exact(contact)
                earlier = earlier_state_of(e, i, contact, before)
                self.pairs[i] = history_of_pair(contact, earlier)
        rows = {i: pair.rows for i, pair in self.pairs.items()}
        self.residuals = PairOperator(e, rows, UNKNOWNS, ROWS)


# The state at the start of the step, or its ``StepHistory``, to avoid a second evaluation.
Before = State | StepHistory | None


def history_of(problem: ContactProblem, before: Before) -> StepHistory | None:
    """The ``StepHistory`` of a state before (collective).

    Raises:
        MortarError: If there is friction and no state is given.
    """
    if isinstance(before, State):
        return StepHistory(problem, before)
    if before is None:
        for contact in problem.equations.contacts:
            if has_history(contact):
                raise MortarError(
                    f"the slip of {contact.pair!r} depends on the control through the state before:"
                    " expected before=..."
                )
    return before


class StepMemory:
    """Derivatives of the memory of all pairs in a step; constructor and methods are collective.

    Args:
        problem: The problem, at the end of a step, evaluated with ``EXACT``.
        before: ``StepHistory`` of the step; any other value if the state before is fixed.
    """

    def __init__(self, problem: ContactProblem, before: Before) -> None:
        self._problem, self._equations, self._before = problem, problem.equations, before
        self._history = before.pairs if isinstance(before, StepHistory) else {}
        self._pairs = {
            i: memory_of_pair(contact)
            for i, contact in enumerate(self._equations.contacts)
            if isinstance(contact, Contact) and contact.pair.law.memory
        }

    @cached_property
    def residuals(self) -> PairOperator:
        """Derivative of the residuals with respect to the memory before."""
        return self._operator({i: pair.rows for i, pair in self._pairs.items()}, BY_PAIR, ROWS)

    @cached_property
    def by_before(self) -> PairOperator:
        """Derivative of the memory with respect to the memory before."""
        matrices = {i: pair.by_before for i, pair in self._pairs.items()}
        return self._operator(matrices, BY_PAIR, BY_PAIR)

    @cached_property
    def by_state(self) -> PairOperator:
        """Derivative of the memory with respect to the state at the end of the step."""
        matrices = {}
        for i, pair in self._pairs.items():
            changes = fields_by_state(self._equations.contacts[i], pair.by_fields)
            matrices[i] = through_fields(pair.by_fields, changes)
        return self._operator(matrices, UNKNOWNS, BY_PAIR)

    @cached_property
    def by_earlier(self) -> PairOperator:
        """Derivative of the memory with respect to the state before."""
        matrices = {
            i: through_fields(pair.by_fields, self._history[i].fields)
            for i, pair in self._pairs.items()
            if i in self._history
        }
        return self._operator(matrices, UNKNOWNS, BY_PAIR)

    def _operator(
        self, matrices: dict[int, Matrix], source: Vectors, target: Vectors
    ) -> PairOperator:
        return PairOperator(self._equations, matrices, source, target)

    def by_control(self, control: Any) -> PairOperator:
        """Derivative of the memory with respect to a control at fixed states.

        Raises:
            MortarError: If a law has memory, and the control has no derivative of it.
        """
        pairs = getattr(control, "pairs", None)
        if pairs is None and self._pairs:
            raise MortarError(
                f"{control.name}: no derivative through the memory of the law of pair "
                f"{min(self._pairs)}; expected a law without memory, or another control"
            )
        numbers = [i for i in pairs(self._problem) if i in self._pairs] if pairs else []
        given = self._before
        found = {i: control.memory(self._problem, i, self._pairs[i], given) for i in numbers}
        return self._operator(found, values_of(control.get(self._problem).shape), BY_PAIR)


def added(memories: Iterable[Memories]) -> Memories:
    """Sum of changes of memories, or of gradients; pairs that are missing have zeros (local)."""
    total: Memories = {}
    for memory in memories:
        for i, values in memory.items():
            total[i] = total[i] + values if i in total else values
    return total


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
    with earlier.at_earlier_position():
        found = contact.partners_at(earlier.fields)
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
