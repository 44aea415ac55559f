# SPDX-License-Identifier: MIT
"""Quantities and controls: what is differentiated, and by what; base classes of those of pairs.

**The protocol of controls, and the base class of those that act on pairs of surfaces.** A control
has the derivative of the residuals of one step, with the rows and units of
``equations.linearized``, at fixed displacement, multipliers, active sets, and state before.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.history import Before, history_of
from fenics_mortar.sensitivity.pair_operators import (
    ROWS,
    OfPair,
    PairOperator,
    check_exact,
    contact_of,
    from_pairs,
    interface_of,
    refuse_fluxes,
    values_of,
)
from fenics_mortar.sensitivity.partials.fields import fields_by_state, rows_by_fields
from fenics_mortar.sensitivity.partials.law import PairMemory
from fenics_mortar.sensitivity.partials.maps import Changes, Matrix, through_fields
from fenics_mortar.utils.arrays import Array

# Derivatives of a functional with respect to nodal fields by name, see ``partials.fields``, shape
# (slave nodes,) each, or (slave nodes, d) for "z"; fields that are missing have zeros.
ByFields = dict[str, Array]


class Quantity(Protocol):
    """A scalar function J(s_k, s_{k-1}, m) of a state; all methods are collective.

    R_k(s_k, s_{k-1}, m) = 0 are the equations of step k for its state s_k = (u, z, q), rows and
    units as in ``equations.linearized``, and m are the values of a control. All derivatives are
    taken at fixed active sets and branches. ``problem`` is at the end of a step with the state s_k,
    evaluated with ``EXACT``; ``before`` is the state s_{k-1} at its start: a ``State``, or its
    ``StepHistory``.
    """

    @abstractmethod
    def value(self, problem: ContactProblem, before: Before = None) -> float:
        """Value at the present state [unit of the quantity], equal on all ranks."""

    @abstractmethod
    def gradient(self, problem: ContactProblem, before: Before = None) -> LinearVector:
        """dJ/ds_k."""

    def by_before(self, problem: ContactProblem, before: Before) -> LinearVector | None:
        """dJ/ds_{k-1}; ``None``, the default, or a vector without parts if it is zero."""
        return None

    def by_control(
        self, problem: ContactProblem, control: Any, before: Before = None
    ) -> Array | float:
        """Explicit derivative dJ/dm at fixed states, of the shape of m [unit of J / unit of m].

        The default is 0.0: the control does not occur.
        """
        return 0.0


class ContactQuantity(Quantity):
    """Base class of the quantities of contact."""

    def check(self) -> None:
        """Check the arguments, in a call made on all ranks (local).

        Raises:
            ValueError: If an argument has a value that is not allowed.
        """

    def check_dimension(self, dim: int) -> None:
        """Check vectors among the arguments for ``dim`` coordinates, as ``check`` (local).

        Raises:
            ValueError: If one has another number of components.
        """

    def __add__(self, other: ContactQuantity | float) -> ContactQuantity:
        """Sum of quantities, or of a quantity and a number."""
        if isinstance(other, ContactQuantity):
            return Combined([self, other], np.sum, np.ones_like)
        return Combined([self], lambda v: v[0] + other, np.ones_like)

    def __sub__(self, other: ContactQuantity | float) -> ContactQuantity:
        """Difference of quantities, or of a quantity and a number."""
        return self + (-1.0) * other

    def __mul__(self, factor: float) -> ContactQuantity:
        """Product with a number."""
        return Combined([self], lambda v: factor * v[0], lambda v: np.full(1, factor))

    def __pow__(self, power: float) -> ContactQuantity:
        """Power of a quantity."""
        return Combined([self], lambda v: v[0] ** power, lambda v: power * v ** (power - 1))

    __radd__, __rmul__ = __add__, __mul__


class Combined(ContactQuantity):
    """A function of quantities.

    Args:
        parts: The quantities.
        function: Function from their values (n,) to a number.
        derivative: Function from their values to the partial derivatives of ``function``, (n,).
    """

    def __init__(
        self,
        parts: Sequence[Any],
        function: Callable[[Array], Any],
        derivative: Callable[[Array], Array],
    ) -> None:
        self.parts, self._function, self._derivative = list(parts), function, derivative

    def check(self) -> None:
        """See ``Quantity``."""
        for part in self.parts:
            part.check()

    def check_dimension(self, dim: int) -> None:
        """See ``ContactQuantity``."""
        for part in self.parts:
            part.check_dimension(dim)

    def _values(self, problem: ContactProblem, before: Before) -> Array:
        return np.array([part.value(problem, before) for part in self.parts])

    def _chain(
        self, derivative: Callable[[Any], Any], zero: Any, problem: ContactProblem, before: Before
    ) -> Any:
        """Chain rule: sum of derivatives of the quantities times partial derivatives."""
        factors = map(float, self._derivative(self._values(problem, before)))
        return sum(
            (derivative(part) * f for f, part in zip(factors, self.parts, strict=True)), zero
        )

    def value(self, problem: ContactProblem, before: Before = None) -> float:
        """See ``Quantity``."""
        return float(self._function(self._values(problem, before)))

    def gradient(self, problem: ContactProblem, before: Before = None) -> LinearVector:
        """See ``Quantity``."""
        zero = LinearVector()
        return self._chain(lambda part: part.gradient(problem, before), zero, problem, before)

    def by_before(self, problem: ContactProblem, before: Before) -> LinearVector | None:
        """See ``Quantity``."""
        zero = LinearVector()
        return self._chain(
            lambda part: part.by_before(problem, before) or zero, zero, problem, before
        )

    def by_control(
        self, problem: ContactProblem, control: Any, before: Before = None
    ) -> Array | float:
        """See ``Quantity``."""
        return self._chain(
            lambda part: part.by_control(problem, control, before), 0.0, problem, before
        )

    def depends_on(self, control: Any) -> bool:
        """Whether a control occurs in one of the quantities (local)."""
        depends = (getattr(part, "depends_on", lambda _: False) for part in self.parts)
        return any(depends_on(control) for depends_on in depends)


class PairQuantity(OfPair, ContactQuantity):
    """Base class of the quantities of one pair, functions of its nodal fields.

    Args:
        pair: Number of the pair.
    """

    @abstractmethod
    def _of(self, contact: Any) -> float:
        """Value."""

    @abstractmethod
    def _by_fields(self, contact: Any) -> ByFields:
        """Derivatives with respect to nodal fields."""

    def value(self, problem: ContactProblem, before: Before = None) -> float:
        """See ``Quantity``."""
        return self._of(interface_of(problem.equations, self.pair))

    def gradient(self, problem: ContactProblem, before: Before = None) -> LinearVector:
        """See ``Quantity``."""
        contact = interface_of(problem.equations, self.pair)
        return from_pairs(problem.equations, {self.pair: self._by_state(contact)})

    def _by_state(self, contact: Interface) -> Array:
        """Derivative with respect to the present state, a vector of the pair."""
        if isinstance(contact, Contact):
            check_exact(contact)
        by = self._by_fields(contact)
        return through(by, fields_by_state(contact, by))

    def by_before(self, problem: ContactProblem, before: Before) -> LinearVector | None:
        """See ``Quantity``."""
        by = self._by_fields(interface_of(problem.equations, self.pair))
        history = history_of(problem, before) if "slip" in by else None
        if history is None or self.pair not in history.pairs:
            return None
        gradient = through(by, history.pairs[self.pair].fields)
        return from_pairs(problem.equations, {self.pair: gradient})

    def by_control(
        self, problem: ContactProblem, control: Any, before: Before = None
    ) -> Array | float:
        """See ``Quantity``; for controls that change nodal fields."""
        if not hasattr(control, "fields") or self.pair not in control.pairs(problem):
            return 0.0
        changes = control.fields(problem, self.pair, before)
        if not changes:
            return 0.0
        by = self._by_fields(interface_of(problem.equations, self.pair))
        return through(by, changes).reshape(control.get(problem).shape)


def through(by: ByFields, changes: Changes) -> Array:
    """Chain rule: derivative of a functional, (m,), for changes of fields (n, m) (local).

    In the unit of the functional over that of the m values [any].
    """
    (m, *_) = (change.shape[1] for change in changes.values())
    terms = (change.T @ by[name].ravel() for name, change in changes.items() if name in by)
    return sum(terms, np.zeros(m))


class Control(Protocol):
    """Values on which a solution depends.

    Methods take a ``problem`` at the end of a step, evaluated with ``EXACT``, and the state
    ``before``, at the start of the step, which is needed if slip depends on the control through
    this state: a ``State``, or its ``StepHistory``. Values are replicated arrays of any shape, or
    those of the owned dofs of a function if an attribute ``is_distributed`` is true.

    Other methods are optional: ``pairs`` and ``memory``, as of ``PairControl``, for laws with
    memory, and ``explicit(problem, quantity, before)``, the derivative of a quantity that does not
    know the control, see ``Quantity.by_control``.

    Attributes:
        name: Name for messages.
    """

    name: str

    def get(self, problem: ContactProblem) -> Array:
        """Present values (local), of shape () for a single number [their unit]."""

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Set the ``values``, of the shape of ``get`` [their unit], equal on all ranks (local).

        Raises:
            TypeError: If the control cannot be set.
            ValueError: If a value is not allowed.
        """
        raise TypeError(f"{self.name} cannot be set")

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """Change of the residuals along ``dm``, of the values' shape [their unit] (collective).

        Raises:
            MortarError: On all ranks, if the derivative is not available.
        """

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """Gradient of the scalar product of residuals and ``y`` (collective).

        Equal on all ranks, of the shape of the values [units of the product over theirs].

        Raises:
            MortarError: On all ranks, if the derivative is not available.
        """


class PairControl(Control):
    """Control of m numbers that acts on the rows of pairs, by nodal fields unless overridden."""

    @abstractmethod
    def pairs(self, problem: ContactProblem) -> list[int]:
        """Numbers of the pairs whose rows or memory depend on it at fixed states (local)."""

    def fields(self, problem: ContactProblem, i: int, before: Before = None) -> Changes:
        """Derivatives of the nodal fields of pair ``i``, one of ``pairs`` (collective).

        By their names, shape (slave nodes, m) each [units of the field over those of the values];
        empty if they do not depend on the control. ``before``: see ``Control``.
        """
        return {}

    def rows(self, problem: ContactProblem, i: int, before: Before = None) -> Matrix:
        """Derivative of the rows of pair ``i``, one of ``pairs`` (collective).

        Shape (d slave nodes, m) [stress length over the units of the values].

        Raises:
            ValueError: On all ranks, if the pair is tied, or its law cannot be differentiated.
            MortarError: On all ranks, if the derivative is not available.
        """
        contact = contact_of(problem.equations, i)
        check_exact(contact)
        refuse_fluxes(contact, self.name)
        return through_fields(rows_by_fields(contact), self.fields(problem, i, before))

    def memory(
        self, problem: ContactProblem, i: int, memory: PairMemory, before: Before = None
    ) -> Matrix:
        """Derivative of the memory of the law of pair ``i``, one of ``pairs`` (collective).

        Args:
            problem: See ``Control``.
            i: Number of the pair.
            memory: Derivatives of this memory.
            before: See ``Control``.

        Returns:
            Shape (slave nodes * names of the memory, m) [units of the memory over those of the
            values].
        """
        return through_fields(memory.by_fields, self.fields(problem, i, before))

    def residuals(self, problem: ContactProblem, before: Before = None) -> PairOperator:
        """Derivative of the residuals of ``problem``, of any shape [any] (collective).

        ``before``: see ``Control``.
        """
        matrices = {i: self.rows(problem, i, before) for i in self.pairs(problem)}
        return PairOperator(problem.equations, matrices, values_of(self.get(problem).shape), ROWS)

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """See ``Control``."""
        return self.residuals(problem, before) @ np.asarray(dm, float)

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """See ``Control``."""
        return self.residuals(problem, before).T @ y


class OnePairControl(OfPair, PairControl):
    """Control that acts on one pair.

    Args:
        pair: Number of the pair.
    """

    def pairs(self, problem: ContactProblem) -> list[int]:
        """See ``PairControl``."""
        return [self.pair]
