# SPDX-License-Identifier: MIT
"""Base class of the quantities of contact, and functions of quantities."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.controls import Before
from fenics_mortar.sensitivity.pair_vectors import zero_vector
from fenics_mortar.utils.arrays import Array


class ContactQuantity(ABC):
    """Base class of the quantities of contact; all methods are collective.

    Arguments of the methods are a ``problem`` at the end of a step, evaluated with ``EXACT``, and
    the state ``before``, at the start of the step: a ``State``, or its ``StepHistory``.
    """

    def check(self) -> None:  # noqa: B027
        """Check the arguments, in a call made on all ranks (local).

        Raises:
            ValueError: If an argument has a value that is not allowed.
        """

    @abstractmethod
    def value(self, problem: ContactProblem, before: Before = None) -> float:
        """Value at the present state [unit of the quantity]."""

    @abstractmethod
    def gradient(self, problem: ContactProblem, before: Before = None) -> LinearVector:
        """Derivative with respect to the present state."""

    def by_before(self, problem: ContactProblem, before: Before) -> LinearVector | None:
        """Derivative with respect to the state before; ``None`` if it is zero."""
        return None

    def by_control(
        self, problem: ContactProblem, control: Any, before: Before = None
    ) -> Array | float:
        """Derivative with respect to a ``control`` at fixed states; 0.0 if it is not contained.

        Shape of the control's values [unit of the quantity over theirs].
        """
        return 0.0

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
        """See ``ContactQuantity``."""
        for part in self.parts:
            part.check()

    def _values(self, problem: ContactProblem, before: Before) -> Array:
        return np.array([part.value(problem, before) for part in self.parts])

    def _terms(self, problem: ContactProblem, before: Before) -> list[tuple[float, Any]]:
        """Partial derivatives and quantities."""
        factors = self._derivative(self._values(problem, before))
        return [(float(f), part) for f, part in zip(factors, self.parts, strict=True)]

    def value(self, problem: ContactProblem, before: Before = None) -> float:
        """See ``ContactQuantity``."""
        return float(self._function(self._values(problem, before)))

    def gradient(self, problem: ContactProblem, before: Before = None) -> LinearVector:
        """See ``ContactQuantity``."""
        terms = self._terms(problem, before)
        return _sum(problem, [(f, part.gradient(problem, before)) for f, part in terms])

    def by_before(self, problem: ContactProblem, before: Before) -> LinearVector | None:
        """See ``ContactQuantity``."""
        terms = self._terms(problem, before)
        found = [(f, part.by_before(problem, before)) for f, part in terms]
        present = [(f, vector) for f, vector in found if vector is not None]
        return _sum(problem, present) if present else None

    def by_control(
        self, problem: ContactProblem, control: Any, before: Before = None
    ) -> Array | float:
        """See ``ContactQuantity``."""
        terms = self._terms(problem, before)
        return sum((f * part.by_control(problem, control, before) for f, part in terms), 0.0)

    def depends_on(self, control: Any) -> bool:
        """Whether a control occurs in one of the quantities (local)."""
        depends = (getattr(part, "depends_on", lambda _: False) for part in self.parts)
        return any(depends_on(control) for depends_on in depends)


def _sum(problem: ContactProblem, terms: Sequence[tuple[float, LinearVector]]) -> LinearVector:
    """Sum of factor times vector, with zeros in place of ``None`` (local)."""
    total = zero_vector(problem.equations)
    assert total.u is not None and total.z is not None and total.q is not None
    for factor, vector in terms:
        if vector.u is not None:
            total.u[:] += factor * vector.u
        if vector.q is not None:
            total.q[:] += factor * vector.q
        for mine, theirs in zip(total.z, vector.z or (), strict=False):
            mine += factor * theirs
    return total
