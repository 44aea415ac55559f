# SPDX-License-Identifier: MIT
"""The accepted states of a path, with the values that its solves were given."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from dolfinx import fem

from fenics_mortar.contact.contact import Contact
from fenics_mortar.equations.general import State
from fenics_mortar.equations.undo import Before, raise_told
from fenics_mortar.interface.mortar import EXACT
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.pair_vectors import check_law
from fenics_mortar.sensitivity.solved import check_solved
from fenics_mortar.utils.arguments import check_kind
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, RaisedElsewhereError


@dataclass(frozen=True)
class Step:
    """An accepted state.

    Attributes:
        state: The state.
        data: Values of the constants and functions of the forms, see ``Data``.
        laws: Attributes of the laws of the contacts.
        shapes: Parameters of the shape of each obstacle.
    """

    state: State
    data: tuple[Array, ...]
    laws: tuple[dict[str, Any], ...]
    shapes: tuple[dict[str, Array], ...]


class Data:
    """Constants and functions that a residual depends on, except the displacement; local.

    Args:
        problem: The problem.
        more: Further constants and functions.
    """

    def __init__(self, problem: ContactProblem, more: Sequence[Any] = ()) -> None:
        laws = [vars(contact.pair.law) for contact in _with_law(problem)]
        of_laws = [value for law in laws for value in law.values() if _is_data(value)]
        self._objects = list(dict.fromkeys([*problem.equations.bulk.data, *of_laws, *more]))

    def values(self) -> tuple[Array, ...]:
        """Copies of the present values."""
        return tuple(np.array(_array_of(data)) for data in self._objects)

    def put(self, values: Sequence[Array]) -> None:
        """Set all values."""
        for data, value in zip(self._objects, values, strict=True):
            _array_of(data)[...] = value


def _is_data(value: Any) -> bool:
    """Whether a value is a constant or function of dolfinx (local)."""
    return isinstance(value, (fem.Constant, fem.Function))


def _with_law(problem: ContactProblem) -> list[Contact]:
    """The contacts of a problem without its ties (local)."""
    return [c for c in problem.equations.contacts if isinstance(c, Contact)]


def _copies(values: dict[str, Any]) -> dict[str, Any]:
    """Attributes with copies of arrays (local)."""
    return {k: v.copy() if isinstance(v, np.ndarray) else v for k, v in values.items()}


def _array_of(data: Any) -> Array:
    """The numbers of a constant or function, not a copy (local)."""
    return data.value if isinstance(data, fem.Constant) else data.x.array


class RecordedPath:
    """Accepted states of a problem, in the order of their load steps; all methods are collective.

    Slip counts from the state before, so that a path with friction has to be recorded without gaps,
    one call of ``record`` after each solve::

        path = fm.RecordedPath(problem)  # at the state that the path begins with
        fm.follow_path(problem, set_loads, options, on_step=path.record)
        mu = fm.sensitivity.LawParameter(0, "mu")
        gradient = fm.gradient(fm.sensitivity.TotalForce(0, (1.0, 0.0)), [E, mu], path)

    The state at the start is given: derivatives do not go beyond it. Each record contains the
    displacement, the interface states and the values of all constants and functions of the
    residual.

    Args:
        problem: The problem, at the start of the path.
        also: Constants and functions that only the objective depends on and that change between
            steps.

    Attributes:
        problem: The problem.
        start: State at the start, ``None`` for the path of a single state.
        steps: The records.

    Raises:
        ValueError: If ``problem`` is of another type.
        MortarError: If the problem has inertia, or a law no sensitivities; see ``check_law``.
    """

    def __init__(self, problem: ContactProblem, *, also: Sequence[Any] = ()) -> None:
        check_kind("problem", problem, ContactProblem, "a ContactProblem")
        if problem.equations.bulk.inertia is not None:
            raise MortarError("dynamics have no derivatives: expected a static problem")
        for contact in problem.equations.contacts:
            check_law(contact)
        self.problem, self._data = problem, Data(problem, also)
        self.start: State | None = problem.state()
        self.steps: list[Step] = []

    def record(self, *arguments: Any) -> None:
        """Add the present state.

        Args:
            arguments: Ignored, so that ``follow_path`` may call this method as its ``on_step``.

        Raises:
            MortarError: On all ranks, if the present state is no solution for the present values of
                loads, material and laws.
        """
        check_solved(self.problem)
        self.steps.append(self.present())

    def present(self) -> Step:
        """Record of the present state."""
        laws = tuple(_copies(vars(contact.pair.law)) for contact in _with_law(self.problem))
        shapes = tuple(obstacle.shape() for obstacle in self.problem.obstacles)
        return Step(self.problem.state(), self._data.values(), laws, shapes)

    def before(self, number: int) -> State | None:
        """State before the step ``number`` (local)."""
        return self.steps[number - 1].state if number else self.start

    def go_to(self, number: int) -> None:
        """Restore the state and the values of step ``number``, and evaluate the operators."""
        step = self.steps[number]
        self._put_values(step)
        self.problem.restore(step.state)

    def _put_values(self, step: Step) -> None:
        self._data.put(step.data)
        for contact, law in zip(_with_law(self.problem), step.laws, strict=True):
            vars(contact.pair.law).update(law)
            contact.take_law()
        for obstacle, shape in zip(self.problem.obstacles, step.shapes, strict=True):
            for name, now in obstacle.shape().items():
                if not np.array_equal(now, shape[name]):
                    obstacle.set_shape(name, shape[name])

    @contextmanager
    def visited(self) -> Iterator[None]:
        """Context of visits to steps, with exact derivatives; it restores all at its end."""
        equations = self.problem.equations
        present, before = self.present(), Before(equations, self.problem.adequacy)
        residual, linearization = equations.bulk.r.array_r.copy(), equations.linearization
        equations.linearization, renew = EXACT, True
        try:
            yield
            renew = False
        except MortarError as error:
            renew = isinstance(error, RaisedElsewhereError)
            raise
        except BaseException as error:
            raise_told(error)
        finally:
            equations.linearization = linearization
            self._put_values(present)
            before.take_back(renew=renew)
            equations.bulk.r.array[:] = residual

    def check(self) -> None:
        """Refuse a path without steps (local).

        Raises:
            MortarError: If nothing was recorded.
        """
        if not self.steps:
            raise MortarError("the path has no steps: call record() after each solve")


def path_of_state(problem: ContactProblem) -> RecordedPath:
    """Path of the present state alone; the state that slip counts from is given (collective)."""
    path = RecordedPath(problem)
    path.start = None
    path.record()
    return path
