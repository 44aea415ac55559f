# SPDX-License-Identifier: MIT
"""Derivatives with respect to the state and the memory of laws at the start of a step.

With the memory h_k of the laws at the end of step k, the equations are
R_k(s_k, s_{k-1}, h_{k-1}, m) = 0 and h_k = H_k(s_k, s_{k-1}, h_{k-1}, m). Changes of the memory are
propagated forwards, gradients with respect to the memory backwards. Both are dictionaries of
replicated arrays by the number of the pair, with the names of the memory of each slave node;
without laws with memory they are empty.

``StepHistory`` has the derivatives with respect to the state before, ``StepMemory`` those of the
memory, both by a ``PairOperator`` with a small matrix for each pair.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from fenics_mortar.contact.arcs import LEADS
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.slip import find_partners
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.interface.mortar import EXACT
from fenics_mortar.obstacles.rigid_motion import at_place
from fenics_mortar.sensitivity.partials.fields import Layout, fields_by_state, through_fields
from fenics_mortar.sensitivity.partials.history import PairHistory, history_of_pair, memory_of_pair
from fenics_mortar.utils import errors, ranks
from fenics_mortar.utils.arrays import ROUNDING, Array

if TYPE_CHECKING:
    from fenics_mortar.contact.fields import ContactFields
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.equations.general import ContactEquations, State
    from fenics_mortar.sensitivity.partials.fields import Matrix


@dataclass(frozen=True)
class Vectors:
    """A kind of vectors of a problem.

    Attributes:
        at: Part of a vector at a pair with a number, flat; ``None`` if it is zero.
        collect: Vector from its parts by the numbers of the pairs.
    """

    at: Callable[[ContactEquations, int, Any], Array | None]
    collect: Callable[[ContactEquations, dict[int, Array]], Any]


@dataclass(frozen=True)
class PairOperator:
    """Operator with one matrix for each pair, and its transpose.

    Vectors of a problem are restricted to its pairs, multiplied by the matrices of the pairs, and
    the products are collected to a vector of the problem. Collecting is the transpose of
    restricting; therefore the transposed operator has the transposed matrices and the two kinds of
    vectors swapped.

    Attributes:
        equations: The equations.
        matrices: Matrices by the numbers of their pairs.
        source: Kind of the vectors that it is applied to.
        target: Kind of the results.
    """

    equations: ContactEquations
    matrices: dict[int, Matrix]
    source: Vectors
    target: Vectors

    def __matmul__(self, x: Any) -> Any:
        """Product with a vector (collective)."""
        e, matrices = self.equations, self.matrices
        parts = {i: self.source.at(e, i, x) for i in matrices}
        products = {i: matrices[i] @ part for i, part in parts.items() if part is not None}
        return self.target.collect(e, products)

    @property
    def T(self) -> PairOperator:
        """The transpose (local)."""
        matrices = {i: matrix.T for i, matrix in self.matrices.items()}
        return PairOperator(self.equations, matrices, self.target, self.source)


def at_pair(equations: ContactEquations, i: int, x: LinearVector) -> Array:
    """Values of a vector at pair ``i``, see ``partials.fields`` (collective)."""
    contact, motions = equations.contacts[i], equations.motions
    layout = Layout(contact)
    values = np.zeros(layout.size)
    if x.u is not None:
        values[layout.on_slave] = contact.slave.gather(x.u).ravel()
        values[layout.on_master] = contact.master.gather(x.u).ravel()
    if x.z is not None:
        values[layout.z] = x.z[i].ravel()
    if x.q is not None:
        values[layout.motion] = motions.of_obstacle(contact, x.q * motions.scales)
    return values


def from_pairs(equations: ContactEquations, parts: dict[int, Array]) -> LinearVector:
    """Sum of values at pairs: transpose of ``at_pair``; without parts if there are none (local)."""
    if not parts:
        return LinearVector()
    motions = equations.motions
    u, q = np.zeros(equations.bulk.num_owned), np.zeros(motions.scales.shape)
    z = [np.zeros_like(contact.z) for contact in equations.contacts]
    for i, values in parts.items():
        contact = equations.contacts[i]
        layout = Layout(contact)
        contact.slave.scatter_add(values[layout.on_slave].reshape(-1, layout.dim), u)
        contact.master.scatter_add(values[layout.on_master].reshape(-1, layout.dim), u)
        z[i] = values[layout.z].reshape(contact.z.shape)
        motions.of_obstacle(contact, q)[...] += values[layout.motion]
    return LinearVector(u, z, q * motions.scales)


def _rows_at(_: ContactEquations, i: int, x: LinearVector) -> Array | None:
    return None if x.z is None else x.z[i].ravel()


def _from_rows(equations: ContactEquations, parts: dict[int, Array]) -> LinearVector:
    none = [np.zeros(contact.z.size) for contact in equations.contacts]
    shapes = [contact.z.shape for contact in equations.contacts]
    return LinearVector(z=[parts.get(i, none[i]).reshape(shape) for i, shape in enumerate(shapes)])


# Vectors of unknowns or of all residuals; residuals of the rows of the multipliers alone; values by
# pair, as of the memory of laws.
UNKNOWNS = Vectors(at_pair, from_pairs)
ROWS = Vectors(_rows_at, _from_rows)
BY_PAIR = Vectors(lambda _, i, x: x.get(i), lambda _, parts: parts)


def values_of(shape: tuple[int, ...]) -> Vectors:
    """Vectors of replicated values of a control of a shape (local)."""

    def collect(_: ContactEquations, parts: dict[int, Array]) -> Array:
        return sum(parts.values(), np.zeros(int(np.prod(shape)))).reshape(shape)

    return Vectors(lambda _, i, x: np.ravel(x), collect)


class OfPair:
    """Part of controls and quantities of one pair.

    Args:
        pair: Number of the pair.
    """

    def __init__(self, pair: int) -> None:
        self.pair = pair

    def check(self) -> None:
        """Check the number of the pair, in a call made on all ranks (local).

        Raises:
            ValueError: If it is not a number of a pair.
        """
        expected = "the number of a pair, from 0 on"
        errors.check_number("pair", self.pair, expected, lambda i: i >= 0, whole=True)


def interface_of(equations: ContactEquations, i: int) -> Interface:
    """Contact or tie of the pair with number ``i`` (local).

    Raises:
        ValueError: If there is no such pair.
        MortarError: If it ties fields.
    """
    count = len(equations.contacts)
    if not isinstance(i, (int, np.integer)) or not 0 <= i < count:
        raise ValueError(f"pair {i!r}: expected a number from 0 to {count - 1}, in order of pairs")
    contact = equations.contacts[i]
    if contact.z.shape[1] > contact.slave.dim:
        raise errors.MortarError(
            f"pair {i} ties fields: quantities of it have no derivatives; expected a UFL form"
        )
    return contact


def contact_of(equations: ContactEquations, i: int) -> Contact:
    """Contact of the pair with number ``i`` (local).

    Raises:
        ValueError: If there is no such pair, or it is a tie.
    """
    contact = interface_of(equations, i)
    if not isinstance(contact, Contact):
        raise ValueError(f"pair {i} is tied: expected a contact")
    return contact


def check_exact(contact: Any) -> None:
    """Raise an error if the operators of a contact lack derivatives (local, equal on all ranks).

    Raises:
        MortarError: If terms of the linearization are left out.
    """
    terms = contact.operators.linearization
    if isinstance(contact, Contact) and contact.pair.sliding == "small":
        if (contact.now.decreases_fast & contact.attracted).any():
            raise errors.MortarError(
                "adhesion that decreases fast with the gap has no derivative with "
                "sliding='small': expected sliding='finite'"
            )
    elif terms != EXACT:
        raise errors.MortarError(f"operators with {terms}: derivatives of a solution need {EXACT}")


Memories = dict[int, Array]


class StepHistory:
    """Derivative of the present residuals with respect to the state before; collective methods.

    Rows and units are those of ``equations.linearized``. Only rows of multipliers of pairs with
    friction depend on the state before: through their partners, and through the shear of redundant
    sticks. Active sets are fixed, and so is the memory of laws, see ``StepMemory``.

    Args:
        e: The equations, at the end of a step, with operators of the linearization ``EXACT``.
        before: Accepted state at the start of the step.

    Attributes:
        pairs: Derivatives of the pairs that depend on the state before, by their numbers.
        residuals: Derivative of the residuals.

    Raises:
        MortarError: On all ranks, if slip is not counted from that state, for example after a rigid
            move of a body or of an obstacle before the solve; or if operators lack derivatives.
    """

    def __init__(self, e: ContactEquations, before: State) -> None:
        self.pairs: dict[int, PairHistory] = {}
        for i, contact in enumerate(e.contacts):
            if isinstance(contact, Contact) and has_history(contact):
                check_exact(contact)
                self.pairs[i] = history_of_pair(contact, fields_before(e, i, contact, before))
        rows = {i: pair.rows for i, pair in self.pairs.items()}
        self.residuals = PairOperator(e, rows, UNKNOWNS, ROWS)


# The state at the start of the step, or its ``StepHistory``, to avoid a second evaluation.
Before: TypeAlias = "State | StepHistory | None"


def history_of(e: ContactEquations, before: Before) -> StepHistory | None:
    """The ``StepHistory`` of a state before (collective).

    Raises:
        MortarError: If there is friction and no state is given.
    """
    if before is None:
        for contact in e.contacts:
            if has_history(contact):
                raise errors.MortarError(
                    f"the slip of {contact.pair!r} depends on the control through the state before:"
                    " expected before=..."
                )
        return None
    return before if isinstance(before, StepHistory) else StepHistory(e, before)


class StepMemory:
    """Derivatives of the memory of all pairs in a step; constructor and methods are collective.

    Args:
        e: The equations, at the end of a step, evaluated with ``EXACT``.
        before: ``StepHistory`` of the step; any other value if the state before is fixed.

    Attributes:
        pairs: Derivatives of the pairs whose laws have memory, by their numbers.
        before: As given.
        residuals: Derivative of the residuals with respect to the memory before.
        by_before: Derivative of the memory with respect to the memory before.
        by_state: Derivative of the memory with respect to the state at the end of the step.
        by_earlier: Derivative of the memory with respect to the state before.
    """

    def __init__(self, e: ContactEquations, before: Before) -> None:
        history = before.pairs if isinstance(before, StepHistory) else {}
        self.before = before
        self.pairs = {
            i: memory_of_pair(contact)
            for i, contact in enumerate(e.contacts)
            if isinstance(contact, Contact) and contact.pair.law.memory
        }
        rows = {i: pair.rows for i, pair in self.pairs.items()}
        own = {i: pair.by_before for i, pair in self.pairs.items()}
        by = {i: pair.by_fields for i, pair in self.pairs.items()}
        by_state = {i: through_fields(by[i], fields_by_state(e.contacts[i], by[i])) for i in by}
        by_earlier = {i: through_fields(by[i], history[i].fields) for i in by if i in history}
        self.residuals = PairOperator(e, rows, BY_PAIR, ROWS)
        self.by_before = PairOperator(e, own, BY_PAIR, BY_PAIR)
        self.by_state = PairOperator(e, by_state, UNKNOWNS, BY_PAIR)
        self.by_earlier = PairOperator(e, by_earlier, UNKNOWNS, BY_PAIR)


def added(*memories: Memories) -> Memories:
    """Sum of changes of memories, or of gradients; pairs that are missing have zeros (local)."""
    numbers = dict.fromkeys(chain(*memories))
    return {i: np.sum([each[i] for each in memories if i in each], axis=0) for i in numbers}


def has_history(contact: Any) -> bool:
    """Whether the rows of a pair depend on the state before (local)."""
    return isinstance(contact, Contact) and contact.pair.law.needs_slip


def fields_before(e: ContactEquations, i: int, contact: Contact, before: State) -> ContactFields:
    """Nodal fields of pair ``i`` in the state before, with all derivatives (collective).

    The contact and its obstacle are not changed.

    Raises:
        MortarError: On all ranks, if slip is counted from another state.
    """
    state = before.interfaces[i]
    with at_place(contact.obstacle, e.motions.of_obstacle(contact, before.places)):
        operators, _ = copy(contact.evaluation).evaluate(before.u, state, EXACT)
        then: ContactFields = type(contact.now)(contact, state, operators)
        found = find_partners(then)
    o, given = contact.operators, contact.partners
    counts = contact.active | contact.pair.law.bridges_gap  # slip of others is of no effect
    difference = np.abs(found.gap_vectors(o) - given.gap_vectors(o))[counts].max(initial=0.0)
    difference = max(difference, np.abs(found.slip(o) - given.slip(o))[counts].max(initial=0.0))
    difference = ranks.agreed(e.comm, float(difference))
    if difference <= ROUNDING * contact.slave.extent:
        return then
    if given.led is not None:
        raise errors.MortarError(
            f"the bodies of {contact.pair!r} turned and carried nodes into contact: slip is "
            "counted from there, and its derivative by the state before is not available; take "
            f"steps in which bodies turn by less than {np.degrees(LEADS):.2f} degrees"
        )
    raise errors.MortarError(
        f"the slip of {contact.pair!r} is not counted from the state before, but from one "
        f"that differs by {difference:.3g}: bodies or obstacles were moved before the solve, "
        "or the shape of an obstacle was changed; call accept() at the start of the path, so "
        "that slip is counted from there"
    )
