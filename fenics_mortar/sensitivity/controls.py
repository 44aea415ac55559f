# SPDX-License-Identifier: MIT
"""Controls of contact: parameters of laws, offsets, obstacles, nodal positions.

A control computes the derivative of the residuals of one step, with the rows and units of
``equations.linearized``, at fixed displacement, multipliers, active sets, and state before.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.equations.state import State
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.history import StepHistory, has_history
from fenics_mortar.sensitivity.pair_vectors import (
    OfPair,
    check_exact,
    contact_of,
    from_rows,
    rows_at,
    zero_vector,
)
from fenics_mortar.sensitivity.partials.gap import offset_by_rows, rows_by_offset
from fenics_mortar.sensitivity.partials.law import parameter, parameter_by_rows, rows_by_parameter
from fenics_mortar.sensitivity.partials.shape import rows_by_shape, shape_by_rows
from fenics_mortar.utils.arguments import check_choice, check_kind, check_lengths
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError

# The state at the start of the step, or its ``StepHistory``, to avoid a second evaluation.
Before = State | StepHistory | None


class Control(Protocol):
    """Values on which a solution depends.

    Methods take a ``problem`` at the end of a step, evaluated with ``EXACT``, and the state
    ``before``, at the start of the step, which is needed if slip depends on the control through
    this state: a ``State``, or its ``StepHistory``. Values are replicated arrays of any shape, or
    those of the owned dofs of a function if an attribute ``is_distributed`` is true.

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


class LawParameter(OfPair, Control):
    """A parameter of the law of a pair, see ``Law.parameters``; the constructor is local.

    The values of a parameter that varies in space, see ``Law.fields``, are those at the slave nodes
    at the last solve; ``set`` replaces a function by such values.

    Args:
        pair: Number of the pair.
        name: Name of the parameter, such as "mu".
    """

    def __init__(self, pair: int, name: str) -> None:
        super().__init__(pair)
        self.parameter = name
        self.name = f"{name} of pair {pair}"

    def get(self, problem: ContactProblem) -> Array:
        """See ``Control``."""
        return parameter(contact_of(problem.equations, self.pair), self.parameter)

    def set(self, problem: ContactProblem, values: Array) -> None:
        """See ``Control``."""
        law = contact_of(problem.equations, self.pair).pair.law
        check_choice(f"parameter of {law!r}", self.parameter, law.parameters)
        new = np.array(values, float)
        setattr(law, self.parameter, new if new.ndim else new.item())
        law.check()

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """See ``Control``; ``before`` is not used."""
        contact = contact_of(problem.equations, self.pair)
        rows = rows_by_parameter(contact, self.parameter, np.asarray(dm, float))
        return from_rows(problem.equations, {self.pair: rows})

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """See ``Control``; ``before`` is not used."""
        contact = contact_of(problem.equations, self.pair)
        return parameter_by_rows(contact, self.parameter, rows_at(y, self.pair, contact))


class Offset(OfPair, Control):
    """The nodal offsets of a pair, see ``PairView.offset``; the constructor is local.

    Args:
        pair: Number of the pair.
    """

    def __init__(self, pair: int) -> None:
        super().__init__(pair)
        self.name = f"offset of pair {pair}"

    def get(self, problem: ContactProblem) -> Array:
        """See ``Control``: shape (slave nodes,) [length]."""
        return contact_of(problem.equations, self.pair).offset.copy()

    def set(self, problem: ContactProblem, values: Array) -> None:
        """See ``Control``."""
        contact = contact_of(problem.equations, self.pair)
        contact.change(offset=check_lengths("offset", values, contact.slave.num_nodes))

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """See ``Control``; ``before`` is not used."""
        contact = contact_of(problem.equations, self.pair)
        check_exact(contact)
        return from_rows(problem.equations, {self.pair: rows_by_offset(contact, np.asarray(dm))})

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """See ``Control``; ``before`` is not used."""
        contact = contact_of(problem.equations, self.pair)
        check_exact(contact)
        return offset_by_rows(contact, rows_at(y, self.pair, contact))


class Interference(OfPair, Control):
    """Mean offset of a pair; a change shifts the offsets of all nodes equally.

    The constructor is local.

    Args:
        pair: Number of the pair.
    """

    def __init__(self, pair: int) -> None:
        super().__init__(pair)
        self.name = f"interference of pair {pair}"
        self._offset = Offset(pair)

    def get(self, problem: ContactProblem) -> Array:
        """See ``Control``: shape () [length]."""
        return np.asarray(self._offset.get(problem).mean())

    def set(self, problem: ContactProblem, values: Array) -> None:
        """See ``Control``; without effect beyond the other surface."""
        shift = np.asarray(values, float).item() - self.get(problem)
        self._offset.set(problem, self._offset.get(problem) + shift)

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """See ``Control``; ``before`` is not used."""
        everywhere = np.full(len(self._offset.get(problem)), np.asarray(dm, float).item())
        return self._offset.jvp(problem, everywhere)

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """See ``Control``; ``before`` is not used."""
        return np.asarray(self._offset.vjp(problem, y).sum())


class _OfObstacle(Control):
    """Values of an obstacle in the rows of its motions.

    Args:
        obstacle: The obstacle.
    """

    quantity: str

    def __init__(self, obstacle: Obstacle) -> None:
        self.obstacle = obstacle
        self.name = f"{self.quantity} of '{getattr(obstacle, 'name', obstacle)}'"

    def check(self) -> None:
        """Reject a value that is not an obstacle (local).

        Raises:
            ValueError: If it is not.
        """
        check_kind("obstacle", self.obstacle, Obstacle, "an obstacle of the problem")

    def _number(self, problem: ContactProblem) -> int:
        if not any(obstacle is self.obstacle for obstacle in problem.obstacles):
            raise ValueError(f"{self.name}: the problem has no such obstacle")
        return problem.obstacles.index(self.obstacle)

    @abstractmethod
    def _mine(self, problem: ContactProblem) -> npt.NDArray[np.bool_]:
        """Motions whose rows depend on the values, shape (3,), bool."""

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """See ``Control``; ``before`` is not used."""
        change = zero_vector(problem.equations)
        assert change.q is not None
        change.q[self._number(problem)] = np.where(self._mine(problem), -np.asarray(dm), 0.0)
        return change

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """See ``Control``; ``before`` is not used."""
        if y.q is None:
            return np.zeros(3)
        return np.where(self._mine(problem), -y.q[self._number(problem)], 0.0)


class ObstaclePlace(_OfObstacle):
    """Prescribed place (x, y, angle) of an obstacle in this step [length, length, radian].

    Values of driven motions have no effect.

    Attributes:
        quantity: Name of the values.
    """

    quantity = "place"

    def get(self, problem: ContactProblem) -> Array:
        """See ``Control``: shape (3,)."""
        return self.obstacle.place.copy()

    def set(self, problem: ContactProblem, values: Array) -> None:
        """See ``Control``; driven motions are unchanged."""
        self.obstacle.place = np.where(self._mine(problem), values, self.obstacle.place)

    def _mine(self, problem: ContactProblem) -> npt.NDArray[np.bool_]:
        return ~np.isfinite(self.obstacle.load)


class ObstacleLoad(_OfObstacle):
    """Forces and moment that drive an obstacle [stress length, stress length, stress length^2].

    Values of prescribed motions have no effect.

    Attributes:
        quantity: Name of the values.
    """

    quantity = "load"

    def get(self, problem: ContactProblem) -> Array:
        """See ``Control``: shape (3,), 0 for prescribed motions."""
        return np.nan_to_num(self.obstacle.load)

    def set(self, problem: ContactProblem, values: Array) -> None:
        """See ``Control``; prescribed motions remain prescribed."""
        self.obstacle.load = np.where(self._mine(problem), values, np.nan)

    def _mine(self, problem: ContactProblem) -> npt.NDArray[np.bool_]:
        return np.isfinite(self.obstacle.load)


class ObstacleShape(Control):
    """A parameter of the shape of an obstacle, see ``Obstacle.shape``; the constructor is local.

    Args:
        obstacle: The obstacle.
        name: Name of the parameter: "radius" of a circle, "points" of a spline.
    """

    def __init__(self, obstacle: Obstacle, name: str) -> None:
        self.obstacle, self.parameter = obstacle, name
        self.name = f"{name} of '{getattr(obstacle, 'name', obstacle)}'"

    def check(self) -> None:
        """Reject a value that is not an obstacle with this parameter (local).

        Raises:
            ValueError: If it is not.
        """
        check_kind("obstacle", self.obstacle, Obstacle, "an obstacle of the problem")
        check_choice("shape parameter", self.parameter, self.obstacle.shape())

    def get(self, problem: ContactProblem) -> Array:
        """See ``Control``."""
        return np.array(self.obstacle.shape()[self.parameter])

    def set(self, problem: ContactProblem, values: Array) -> None:
        """See ``Control``."""
        self.obstacle.set_shape(self.parameter, np.asarray(values, float))

    def _pairs(self, problem: ContactProblem) -> list[tuple[int, Any]]:
        """Numbers and contacts of the obstacle (local)."""
        every = enumerate(problem.equations.contacts)
        found = [(i, contact) for i, contact in every if contact.obstacle is self.obstacle]
        for _, contact in found:
            check_exact(contact)
        return found

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """See ``Control``; ``before`` is not used."""
        rows = {
            i: rows_by_shape(contact, self.parameter, np.asarray(dm, float)[None])[0]
            for i, contact in self._pairs(problem)
        }
        return from_rows(problem.equations, rows)

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """See ``Control``; ``before`` is not used."""
        gradient = np.zeros_like(self.get(problem))
        for i, contact in self._pairs(problem):
            rows = rows_at(y, i, contact)
            gradient = gradient + shape_by_rows(contact, self.parameter, rows)
        return gradient


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
