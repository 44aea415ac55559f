# SPDX-License-Identifier: MIT
"""Accepted states of a path, with the loads and data of the solves.

Derivatives are those of a solution. At a state for other loads, materials or laws than the present
ones they would be wrong without any indication; such a state is not recorded.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from dolfinx import fem

from fenics_mortar.bulk.checks import refuse_history
from fenics_mortar.contact.contact import Contact
from fenics_mortar.equations.general import State
from fenics_mortar.equations.undo import Snapshot, raise_cause, restored_if_interrupted
from fenics_mortar.interface.mortar import EXACT
from fenics_mortar.problem import ContactProblem
from fenics_mortar.rigid.spread import refuse_remote
from fenics_mortar.utils import compat
from fenics_mortar.utils.arguments import check_kind
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, RaisedElsewhereError

# Residual of a solution over that of Newton's tolerance [1]: the reference force of an iteration
# may have been larger than that of the state.
SOLVED_FACTOR = 1e3


@dataclass(frozen=True)
class RecordedStep:
    """An accepted state with its data (local).

    Attributes:
        state: The state.
        data: Values of the constants and functions of the forms, of any shape [their units], see
            ``Data``.
        laws: Attributes of the laws and conductances of the contacts.
        shapes: Parameters of the shape of each obstacle by name [their units].
        loads: Forces and moments that drive the obstacles, shape (m,) each, nan where prescribed
            [stress length, stress length^2].
    """

    state: State
    data: tuple[Array, ...]
    laws: tuple[dict[str, Any], ...]
    shapes: tuple[dict[str, Array], ...]
    loads: tuple[Array, ...]


class Data:
    """Constants and functions of residual, conditions and laws except the displacement; local.

    Args:
        problem: The problem.
        more: Further constants and functions.
    """

    def __init__(self, problem: ContactProblem, more: Sequence[Any] = ()) -> None:
        settings = map(vars, _settings(problem))
        of_laws = [value for values in settings for value in values.values() if _is_data(value)]
        bulk = problem.equations.bulk
        objects = dict.fromkeys([*bulk.data, *of_laws, *more])
        conditions = [compat.condition_numbers(bc) for bc in bulk.bcs]
        self._arrays = [*map(_array_of, objects), *conditions]

    def values(self) -> tuple[Array, ...]:
        """Copies of the present values, of the shapes and units of the data [any]."""
        return tuple(np.array(numbers) for numbers in self._arrays)

    def put(self, values: Sequence[Array]) -> None:
        """Set all values, of the shapes of the data."""
        for numbers, value in zip(self._arrays, values, strict=True):
            numbers[...] = value


def _is_data(value: Any) -> bool:
    """Whether a value is a constant or function of dolfinx (local)."""
    return isinstance(value, (fem.Constant, fem.Function))


def _with_law(problem: ContactProblem) -> list[Contact]:
    """The contacts of a problem without its ties (local)."""
    return [c for c in problem.equations.contacts if isinstance(c, Contact)]


def _settings(problem: ContactProblem) -> list[Any]:
    """Laws and conductances of the contacts (local)."""
    pairs = [contact.pair for contact in _with_law(problem)]
    return [setting for pair in pairs for setting in (pair.law, *pair.fluxes)]


def _copies(values: dict[str, Any]) -> dict[str, Any]:
    """Attributes with copies of arrays (local)."""
    return {k: v.copy() if isinstance(v, np.ndarray) else v for k, v in values.items()}


def _array_of(data: Any) -> Array:
    """The numbers of a constant or function, not a copy (local)."""
    return data.value if isinstance(data, fem.Constant) else data.x.array


class RecordedPath:
    """Accepted states of a problem, in the order of their load steps; all methods are collective.

    Slip is counted from the state before. A path with friction must therefore be recorded without
    gaps, with one call of ``record`` after each solve::

        path = fm.sensitivity.RecordedPath(problem)  # at the initial state of the path
        fm.follow_path(problem, set_loads, options, on_step=path.record)
        mu = fm.sensitivity.LawParameter(0, "mu")
        gradient = fm.gradient(fm.sensitivity.TotalForce(0, (1.0, 0.0)), [E, mu], path)

    The initial state is fixed: it has no derivatives. Each record contains the displacement, the
    interface states and the values of all constants and functions of the residual.

    Args:
        problem: The problem, at the start of the path.
        also: Constants and functions that change between steps and on which only the objective
            depends.

    Attributes:
        problem: The problem.
        start: State at the start, ``None`` for the path of a single state.
        steps: The records.

    Raises:
        ValueError: If ``problem`` is of another type.
        MortarError: If the problem has inertia or history functions.
    """

    def __init__(self, problem: ContactProblem, *, also: Sequence[Any] = ()) -> None:
        check_kind("problem", problem, ContactProblem, "a ContactProblem")
        if problem.equations.bulk.inertia is not None:
            raise MortarError("dynamics have no derivatives: expected a static problem")
        if any(getattr(s, "heating", None) == "friction" for s in _settings(problem)):
            raise MortarError(
                "heating='friction' has no derivatives: expected heating=None or a function of "
                "pressure and position"
            )
        motions = problem.equations.motions
        refuse_remote([*motions.remote, *motions.spread], "gradients are not implemented")
        refuse_history(problem.equations.bulk, "the gradient of a path")
        self.problem, self._data = problem, Data(problem, also)
        self.start: State | None = problem.state()
        self.steps: list[RecordedStep] = []

    def record(self, *arguments: Any) -> None:
        """Add the present state.

        Args:
            arguments: Ignored; ``follow_path`` may therefore call this method as its ``on_step``.

        Raises:
            MortarError: On all ranks, if the present state is not a solution for the present values
                of loads, material and laws.
        """
        check_solved(self.problem)
        self.steps.append(self.present())

    def present(self) -> RecordedStep:
        """Record of the present state."""
        laws = tuple(_copies(vars(setting)) for setting in _settings(self.problem))
        shapes = tuple(obstacle.shape() for obstacle in self.problem.obstacles)
        loads = tuple(obstacle.load.copy() for obstacle in self.problem.obstacles)
        return RecordedStep(self.problem.state(), self._data.values(), laws, shapes, loads)

    def before(self, number: int) -> State | None:
        """State before the step ``number``."""
        return self.steps[number - 1].state if number else self.start

    def go_to(self, number: int) -> None:
        """Restore the state and the values of step ``number``, and evaluate the operators."""
        self._put_values(self.steps[number])
        self.problem.restore(self.steps[number].state)

    def _put_values(self, step: RecordedStep) -> None:
        self._data.put(step.data)
        for setting, values in zip(_settings(self.problem), step.laws, strict=True):
            vars(setting).update(values)
        for contact in _with_law(self.problem):
            contact.adopt_law()
        for obstacle, load in zip(self.problem.obstacles, step.loads, strict=True):
            if not np.array_equal(obstacle.load, load, equal_nan=True):
                obstacle.load = load
        for obstacle, shape in zip(self.problem.obstacles, step.shapes, strict=True):
            for name, now in obstacle.shape().items():
                if not np.array_equal(now, shape[name]):
                    obstacle.set_shape(name, shape[name])

    @contextmanager
    def visited(self) -> Iterator[None]:
        """Context of visits to steps, with exact derivatives; changes are reverted at the end."""
        equations = self.problem.equations
        present, before = self.present(), Snapshot(equations)
        residual, linearization = equations.bulk.r.array_r.copy(), equations.linearization
        equations.linearization, renew = EXACT, True
        try:
            yield
            renew = False
        except MortarError as error:
            renew = isinstance(error, RaisedElsewhereError)
            raise
        except BaseException as error:
            raise_cause(error)
        finally:
            equations.linearization = linearization
            self._put_values(present)
            before.revert(renew=renew)
            equations.bulk.r.array[:] = residual

    def check(self) -> None:
        """Reject a path without steps (local).

        Raises:
            MortarError: If nothing was recorded.
        """
        if not self.steps:
            raise MortarError("the path has no steps: call record() after each solve")


def path_of_state(problem: ContactProblem) -> RecordedPath:
    """Path of the present state alone; the state at the start of the step is fixed (collective)."""
    path = RecordedPath(problem)
    path.start = None
    path.record()
    return path


def check_solved(problem: ContactProblem) -> None:
    """Reject a state that is not a solution; one evaluation of the residual (collective).

    Raises:
        MortarError: On all ranks, if the last solve failed, or if displacement, loads, prescribed
            values, material or law were changed after it.
    """
    e = problem.equations
    if not e.last_converged:
        raise MortarError(
            "the present state is not the result of a solve: record a state after solve()"
        )
    with restored_if_interrupted(e):
        e.evaluate_operators()
        e.bulk.assemble_residual()
        if e.floating.bodies:
            e.floating.add_spring_forces()
        e.residual.begin()
        residual = e.residual.measure()
    tolerance = e.newton.residual_tolerance
    allowed = SOLVED_FACTOR * max(tolerance * e.residual.force, e.residual.attainable)
    if not residual <= allowed:
        raise MortarError(
            f"the present state is not a solution: residual {residual:.1e}, allowed {allowed:.1e}. "
            "Displacement, loads, prescribed values, material or law were changed after solve(): "
            "record before changing them, or solve again"
        )
