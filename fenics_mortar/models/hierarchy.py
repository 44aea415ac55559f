# SPDX-License-Identifier: MIT
"""Model hierarchy: solves start with the cheapest variant of a problem.

Cheaper models are the bulk linearized at rest with small sliding, and either assumption alone. The
error of a model is estimated by a Newton step of the problem itself. If the model is insufficient,
the cost of this step is not lost: the next model starts from the result, and insufficient models
are not tried again. A step with the residual of the linear bulk yields the error of that assumption
alone; if it is too large, the intermediate models are skipped.

A state whose deviations from the assumptions hardly exceed those of a checked state is not checked
again: errors grow at most with the square of the deviations.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.operator_evaluation import place_of
from fenics_mortar.equations.state import State
from fenics_mortar.models.model_error import (
    ENERGY,
    QUANTITIES,
    Errors,
    SolutionQuantities,
    correct,
    differences,
    largest_slip,
    largest_strain,
    relative,
    sliding_little,
)
from fenics_mortar.models.options import MODELS
from fenics_mortar.models.variant import adopt
from fenics_mortar.newton.report import NewtonReport
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import suppressed_failures
from fenics_mortar.utils.ranks import agreed


@dataclass(frozen=True)
class Model:
    """A variant of a problem.

    Attributes:
        problem: The variant.
        is_linear: Whether it assumes linear strain.
        is_small: Whether it assumes small sliding.
    """

    problem: ContactProblem
    is_linear: bool
    is_small: bool

    @property
    def name(self) -> str:
        """Its assumptions, as text."""
        linear, small = "linear strain" * self.is_linear, "small sliding" * self.is_small
        return " and ".join(filter(None, (linear, small)))


@dataclass(frozen=True)
class UsedModel:
    """The model whose solution is used, its estimated errors, and their origin."""

    model: Model
    errors: Errors
    remark: str


class ModelHierarchy:
    """Solution of a problem by the cheapest sufficient model.

    Args:
        problem: The problem.
        tolerance: Allowed relative error of the quantity.
        quantity: One of ``QUANTITIES``.
        discretisation: Relative error of the mesh, which is allowed as well; for energy norms it is
            estimated if ``None``.

    Attributes:
        used: The model of the last solve; ``None`` for the problem's own model.
    """

    def __init__(
        self,
        problem: ContactProblem,
        tolerance: float,
        quantity: str,
        discretisation: float | None,
    ) -> None:
        self._problem, self._tolerance, self._quantity = problem, tolerance, quantity
        self._discretisation = discretisation
        self._models = cheaper_models(problem)
        self._made: list[Model] = []
        self._level, self._skips_rest = -1, False
        self._model: Model | None
        self._checked: tuple[Array, Errors]
        self._next_model()
        self._mesh_error_at, self._mesh_error, self._has_estimated = 0.0, 0.0, False
        self.used: UsedModel | None = None

    @property
    def mesh_error(self) -> float | None:
        """Relative error of the mesh, if known."""
        return self._discretisation or self._mesh_error or None

    def solve(self) -> NewtonReport | None:
        """Solve (collective).

        Returns:
            The report. ``None`` if only the problem's own model is left; the state of the problem
            is then the initial guess for it.
        """
        problem, start = self._problem, self._problem.state()
        self.used, self._has_estimated = None, False
        while self._model is not None:
            adopt(self._model.problem, problem)
            with suppressed_failures():
                report = self._model.problem.solve()
                solved = self._model.problem.state()
                start, self.used = self._judge(self._model, start)
                if self.used is not None:
                    problem.restore(solved.with_settings_of(start))
                    return report
            problem.restore(start)
            self._next_model()
        return None

    def saved_data(self) -> dict[str, Array]:
        """Arrays of numbers for a file, nan for missing values; units as stated (local).

        ``hierarchy``, shape (5,): insufficient models (inf: all), whether intermediate models are
        skipped, whether the last solve used a cheaper model, model error at which the error of
        the mesh was estimated [1], error of the mesh [1]. ``hierarchy_checked``, shape (n,):
        deviations, then errors, of the last checked state [1]. ``hierarchy_places``, shape
        (contacts, 3): place of the obstacle in frozen operators of each contact of the present
        model [length, length, radian].
        """
        before, errors = self._checked
        checked = np.concatenate([before, [errors.get(name, np.nan) for name in QUANTITIES]])
        places = np.full((len(self._problem.equations.contacts), 3), np.nan)
        contacts = [] if self._model is None else list(self._model.problem.equations.contacts)
        for i, contact in enumerate(contacts):
            if isinstance(contact, Contact):
                places[i] = place_of(contact.state.reference)
        left = self._level if self._model is not None else np.inf
        flags = [left, self._skips_rest, self.used is not None]
        numbers = np.array([*flags, self._mesh_error_at, self._mesh_error], float)
        return {"hierarchy": numbers, "hierarchy_checked": checked, "hierarchy_places": places}

    def restore_data(self, data: Mapping[str, Array]) -> None:
        """Restore ``data``, see ``saved_data`` for shapes, at the same state (collective).

        Slip is counted from the partners in the operators of the model used.
        """
        numbers = map(float, data["hierarchy"])
        level, skips_rest, on_model, self._mesh_error_at, self._mesh_error = numbers
        if np.isinf(level):
            self._model, self._models = None, iter(())
        while self._model is not None and self._level < level:
            self._next_model()
        self._skips_rest = bool(skips_rest)
        if self._model is None:
            return
        before, errors = np.split(data["hierarchy_checked"], [-len(QUANTITIES)])
        if np.isfinite(before).any():
            self._checked = before, dict(zip(QUANTITIES, errors.tolist(), strict=True))
        model = self._model.problem
        for contact, mine, reference in zip(
            model.equations.contacts,
            self._problem.equations.contacts,
            data["hierarchy_places"],
            strict=True,
        ):
            if isinstance(contact, Contact):
                contact.restore_reference(reference, mine.multiplier_nodes)
        if on_model:
            adopt(model, self._problem)
            model.accept()
            here = self._problem.state()
            self._problem.restore(model.state().with_settings_of(here))

    def _next_model(self) -> None:
        self._level += 1
        if self._level == len(self._made):
            self._made += [model for model in (next(self._models, None),) if model is not None]
        nothing = self._skips_rest or self._level >= len(self._made)
        self._model = None if nothing else self._made[self._level]
        self._checked = np.full(1, np.nan), {}

    def _judge(self, model: Model, start: State) -> tuple[State, UsedModel | None]:
        """State to continue from, and the model if it suffices (collective)."""
        problem, (before, errors), now = self._problem, self._checked, deviations(model)
        if (now <= MODELS.recheck * before).all():
            growth = max(1.0, float((now / np.where(before > 0.0, before, 1.0)).max()))
            if self._is_allowed(growth**2 * errors[self._quantity]):
                grown = {name: growth * error for name, error in errors.items()}
                return start, UsedModel(model, grown, "sufficient; estimated in an earlier step")
        errors = correct(model.problem, problem)
        self._checked, corrected = (now, errors), problem.state()
        if errors[ENERGY] < MODELS.max_error:
            start = corrected.counting_slip_from(start)
        if self._is_enough(errors):
            return start, UsedModel(model, errors, "sufficient")
        if model.is_linear and model.is_small and np.isfinite(errors[ENERGY]):
            alone = error_of_linear_bulk(model.problem, problem)
            problem.restore(corrected)
            if not self._is_enough(alone):
                self._skips_rest = True
        return start, None

    def _is_enough(self, errors: Errors) -> bool:
        """Whether the error of a model is within the tolerance or the mesh error (collective).

        The error of the mesh is estimated at the corrected state, which must be the present state
        of the problem: the residual at the model's solution contains the error of the model. It is
        estimated again if it is decisive or the error of the model has doubled, once per solve.
        """
        error, known = errors[self._quantity], self._discretisation is not None
        checked = min(MODELS.recheck * self._mesh_error_at, self._mesh_error)
        decides = checked < error < MODELS.max_error
        if decides and error > self._tolerance and self._quantity == ENERGY and not known:
            with suppressed_failures():
                if not self._has_estimated:
                    self._mesh_error_at, self._mesh_error = error, self._problem.estimate().relative
            self._has_estimated = True
        return self._is_allowed(error)

    def _is_allowed(self, error: float) -> bool:
        return error <= max(self._tolerance, self.mesh_error or 0.0)


def cheaper_models(problem: ContactProblem) -> Iterator[Model]:
    """Cheaper variants of a problem, the cheapest first (collective)."""
    linear: dict[str, Any] = {}
    if not problem.equations.bulk.is_linear:
        bulk = problem.equations.bulk
        linear["residual"] = linearized_residual(bulk.residual, bulk.u)
    contacts = [contact for contact in problem.equations.contacts if isinstance(contact, Contact)]
    if len(sliding_little(problem)) < len(contacts):
        yield Model(problem.variant(**linear, sliding="small"), bool(linear), True)
    if linear:
        yield Model(problem.variant(**linear), True, False)


def linearized_residual(residual: Any, u: Any) -> Any:
    """Linearize a residual's form about u = 0 (local)."""
    zero = fem.Function(u.function_space)
    at_rest = ufl.replace(residual, {u: zero})
    return at_rest + ufl.derivative(at_rest, zero, u)


def deviations(model: Model) -> Array:
    """Deviations of a solved model from its assumptions, shape (n,) [1] (collective)."""
    found: list[float] = []
    if model.is_linear:
        rotation, strain = largest_strain(model.problem)
        found += [strain, relative(rotation**2, strain)]
    if model.is_small:
        found += np.max([largest_slip(c) for c in sliding_little(model.problem)], axis=0).tolist()
    return agreed(model.problem.equations.comm, np.array(found))


def error_of_linear_bulk(other: ContactProblem, problem: ContactProblem) -> Errors:
    """Relative errors of the linear bulk of a variant alone, at a corrected state (collective).

    They follow from a step with its residual; the result is the new state of the problem.

    Args:
        other: The variant.
        problem: The problem at the corrected state.
    """
    here = SolutionQuantities.of(problem)
    other.equations.bulk.assemble_residual()
    problem.equations.bulk.r.array[:] = other.equations.bulk.r.array_r
    problem.equations.advance()
    return differences(other, SolutionQuantities.of(problem), here)
