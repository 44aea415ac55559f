# SPDX-License-Identifier: MIT
"""The protocol of controls, and the base class of those that act on pairs of surfaces.

A control has the derivative of the residuals of one step, with the rows and units of
``equations.linearized``, at fixed displacement, multipliers, active sets, and state before.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Protocol

import numpy as np

from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.history import Before
from fenics_mortar.sensitivity.pair_operators import (
    ROWS,
    OfPair,
    PairOperator,
    check_exact,
    contact_of,
    refuse_fluxes,
    values_of,
)
from fenics_mortar.sensitivity.partials.fields import rows_by_fields
from fenics_mortar.sensitivity.partials.law import PairMemory
from fenics_mortar.sensitivity.partials.maps import Changes, Matrix, through_fields
from fenics_mortar.utils.arrays import Array


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

    def fields(self, problem: ContactProblem, i: int) -> Changes:
        """Derivatives of the nodal fields of pair ``i``, one of ``pairs`` (collective).

        By their names, shape (slave nodes, m) each [units of the field over those of the values];
        empty if they do not depend on the control.
        """
        return {}

    def rows(self, problem: ContactProblem, i: int) -> Matrix:
        """Derivative of the rows of pair ``i``, one of ``pairs`` (collective).

        Shape (2 slave nodes, m) [stress length over the units of the values].

        Raises:
            ValueError: On all ranks, if the pair is tied, or its law cannot be differentiated.
            MortarError: On all ranks, if the derivative is not available.
        """
        contact = contact_of(problem.equations, i)
        check_exact(contact)
        refuse_fluxes(contact, self.name)
        return through_fields(rows_by_fields(contact), self.fields(problem, i))

    def memory(self, problem: ContactProblem, i: int, memory: PairMemory) -> Matrix:
        """Derivative of the memory of the law of pair ``i``, one of ``pairs`` (collective).

        Args:
            problem: See ``Control``.
            i: Number of the pair.
            memory: Derivatives of this memory.

        Returns:
            Shape (slave nodes * names of the memory, m) [units of the memory over those of the
            values].
        """
        return through_fields(memory.by_fields, self.fields(problem, i))

    def residuals(self, problem: ContactProblem) -> PairOperator:
        """Derivative of the residuals of ``problem``, of any shape [any] (collective)."""
        matrices = {i: self.rows(problem, i) for i in self.pairs(problem)}
        return PairOperator(problem.equations, matrices, values_of(self.get(problem).shape), ROWS)

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """See ``Control``; ``before`` is not used."""
        return self.residuals(problem) @ np.asarray(dm, float)

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """See ``Control``; ``before`` is not used."""
        return self.residuals(problem).T @ y


class OnePairControl(OfPair, PairControl):
    """Control that acts on one pair.

    Args:
        pair: Number of the pair.
    """

    def pairs(self, problem: ContactProblem) -> list[int]:
        """See ``PairControl``."""
        return [self.pair]
