# SPDX-License-Identifier: MIT
"""Base class of the quantities of one pair: chain rules from nodal fields to state and controls."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.combined import ContactQuantity
from fenics_mortar.sensitivity.controls import (
    Before,
    Interference,
    ObstacleShape,
    Offset,
    history_of,
)
from fenics_mortar.sensitivity.pair_vectors import (
    OfPair,
    add_pair,
    check_exact,
    contact_of,
    interface_of,
    zero_vector,
)
from fenics_mortar.sensitivity.partials.fields import ByFields
from fenics_mortar.sensitivity.partials.gap import gap_back
from fenics_mortar.sensitivity.partials.maps import PairVector
from fenics_mortar.sensitivity.partials.shape import change_by_shape, units_of
from fenics_mortar.utils.arrays import Array


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
        """Derivative with respect to nodal fields."""

    def value(self, problem: ContactProblem, before: Before = None) -> float:
        """See ``ContactQuantity``."""
        return self._of(interface_of(problem.equations, self.pair))

    def gradient(self, problem: ContactProblem, before: Before = None) -> LinearVector:
        """See ``ContactQuantity``."""
        contact = interface_of(problem.equations, self.pair)
        return self._vector(problem, self._by_state(contact))

    def _by_state(self, contact: Interface) -> PairVector:
        """Derivative with respect to the present state at the pair."""
        if isinstance(contact, Contact):
            check_exact(contact)
        return self._by_fields(contact).gradient(contact)

    def _vector(self, problem: ContactProblem, values: PairVector) -> LinearVector:
        total = zero_vector(problem.equations)
        add_pair(problem.equations, self.pair, total, values)
        return total

    def by_before(self, problem: ContactProblem, before: Before) -> LinearVector | None:
        """See ``ContactQuantity``."""
        contact = interface_of(problem.equations, self.pair)
        by_slip = self._by_fields(contact).slip
        if by_slip is None:
            return None
        history = history_of(problem, before)
        if history is None or self.pair not in history.pairs:
            return None
        return self._vector(problem, history.pairs[self.pair].slip.back(by_slip))

    def by_control(
        self, problem: ContactProblem, control: Any, before: Before = None
    ) -> Array | float:
        """See ``ContactQuantity``; for offsets and shapes of obstacles."""
        contact = interface_of(problem.equations, self.pair)
        by = self._by_fields(contact)
        if isinstance(control, (Offset, Interference)) and control.pair == self.pair:
            if by.gap is None:
                return 0.0
            gradient = gap_back(contact.operators, by.gap)
            return gradient if isinstance(control, Offset) else np.asarray(gradient.sum())
        if isinstance(control, ObstacleShape) and contact.obstacle is control.obstacle:
            return self._by_shape(problem, control, by)
        return 0.0

    def _by_shape(self, problem: ContactProblem, control: ObstacleShape, by: ByFields) -> Array:
        contact, value = contact_of(problem.equations, self.pair), control.get(problem)
        gradient = np.zeros(value.size)
        change = change_by_shape(contact, control.parameter, units_of(value))
        for name, of_field in change._asdict().items():
            weights = getattr(by, name)
            if weights is not None:
                gradient += of_field @ weights
        return gradient.reshape(value.shape)
