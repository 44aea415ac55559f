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

from collections.abc import Mapping
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.operator_evaluation import place_of
from fenics_mortar.equations.state import State
from fenics_mortar.models.deviations import (
    LINEAR,
    SMALL,
    all_contacts,
    deviations,
    sliding_little,
)
from fenics_mortar.models.model_error import (
    ENERGY,
    QUANTITIES,
    Errors,
    SolutionQuantities,
    adopt,
    correct,
    differences,
)
from fenics_mortar.models.report import Assumption
from fenics_mortar.newton.report import NewtonReport
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import suppressed_failures

# Relative error [1] above which the result of a model is not used as initial guess.
MAX_ERROR = 0.5
# Growth of a model's deviations or errors since the last check above which they are checked again
# [1].
RECHECK = 2.0


class ModelHierarchy:
    """Solution of a problem by the cheapest sufficient model.

    Args:
        problem: The problem.
        tolerance: Allowed relative error of the quantity.
        quantity: One of ``QUANTITIES``.
        discretisation: Relative error of the mesh, which is allowed as well; for energy norms it is
            estimated if ``None``.

    Attributes:
        used: The assumptions of the last solve and their errors; ``None`` for the problem's own
            model.
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
        self._cheaper = cheaper_models(problem)
        self._made: dict[int, ContactProblem] = {}
        self._enter(0)
        self._mesh_error_at, self._mesh_error, self._has_estimated = 0.0, 0.0, False
        self.used: Assumption | None = None

    @property
    def model(self) -> ContactProblem | None:
        """The cheapest variant that is not known to be insufficient, if any is left."""
        return self._made.get(self._level)

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
        while (model := self.model) is not None:
            adopt(model, problem)
            with suppressed_failures():
                report, solved = model.solve(), model.state()
                start, self.used = self._judge(model, start)
                if self.used is not None:
                    problem.restore(solved.with_settings_of(start))
                    return report
            problem.restore(start)
            self._enter(self._level + 1)
        return None

    def saved_data(self) -> dict[str, Array]:
        """Arrays of numbers for a file, nan for missing values; units as stated (local).

        ``hierarchy``, shape (4,): insufficient models (inf: all), whether the last solve used a
        cheaper model, model error at which the error of the mesh was estimated [1], error of the
        mesh [1]. ``hierarchy_checked``, shape (n,):
        deviations, then errors, of the last checked state [1]. ``hierarchy_places``, shape
        (contacts, 3): place of the obstacle in frozen operators of each contact of the present
        model [length, length, radian].
        """
        before, errors = self._checked
        checked = np.concatenate([before, [errors.get(name, np.nan) for name in QUANTITIES]])
        places = np.full((len(self._problem.equations.contacts), 3), np.nan)
        for i, contact in enumerate(self.model.equations.contacts if self.model else []):
            if isinstance(contact, Contact):
                places[i] = place_of(contact.state.reference)
        flags = [self._level if self.model else np.inf, self.used is not None]
        numbers = np.array([*flags, self._mesh_error_at, self._mesh_error], float)
        return {"hierarchy": numbers, "hierarchy_checked": checked, "hierarchy_places": places}

    def restore_data(self, data: Mapping[str, Array]) -> None:
        """Restore ``data``, see ``saved_data`` for shapes, at the same state (collective).

        Slip is counted from the partners in the operators of the model used.
        """
        level, on_model, self._mesh_error_at, self._mesh_error = map(float, data["hierarchy"])
        self._enter(int(min(level, len(self._cheaper))))
        model = self.model
        if model is None:
            return
        before, errors = np.split(data["hierarchy_checked"], [-len(QUANTITIES)])
        if np.isfinite(before).any():
            self._checked = before, dict(zip(QUANTITIES, errors.tolist(), strict=True))
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

    def _enter(self, level: int) -> None:
        """Make the model of a level, if there is one, the present one (collective)."""
        self._level = level
        self._checked = np.full(1, np.nan), dict[str, float]()
        if level < len(self._cheaper) and level not in self._made:
            self._made[level] = self._problem.variant(**self._cheaper[level][1])

    def _judge(self, model: ContactProblem, start: State) -> tuple[State, Assumption | None]:
        """State to continue from, and the assumptions if the model suffices (collective)."""
        problem, (before, errors) = self._problem, self._checked
        assumptions, _ = self._cheaper[self._level]
        now, name = deviations(model, assumptions), " and ".join(assumptions)
        if (now <= RECHECK * before).all():
            growth = max(1.0, float((now / np.where(before > 0.0, before, 1.0)).max()))
            if self._is_allowed(growth**2 * errors[self._quantity]):
                grown = {name: growth * error for name, error in errors.items()}
                return start, Assumption(name, "sufficient; estimated in an earlier step", grown)
        errors = correct(model, problem)
        self._checked, corrected = (now, errors), problem.state()
        if errors[ENERGY] < MAX_ERROR:
            start = corrected.counting_slip_from(start)
        if self._is_enough(errors):
            return start, Assumption(name, "sufficient", errors)
        if len(assumptions) > 1 and np.isfinite(errors[ENERGY]):
            alone = error_of_linear_bulk(model, problem)
            problem.restore(corrected)
            if not self._is_enough(alone):
                self._level = len(self._cheaper)  # the other models have a linear bulk, too
        return start, None

    def _is_enough(self, errors: Errors) -> bool:
        """Whether the error of a model is within the tolerance or the mesh error (collective).

        The error of the mesh is estimated at the corrected state, which must be the present state
        of the problem: the residual at the model's solution contains the error of the model. It is
        estimated again if it is decisive or the error of the model has doubled, once per solve.
        """
        error, known = errors[self._quantity], self._discretisation is not None
        checked = min(RECHECK * self._mesh_error_at, self._mesh_error)
        decides = checked < error < MAX_ERROR
        if decides and error > self._tolerance and self._quantity == ENERGY and not known:
            with suppressed_failures():
                if not self._has_estimated:
                    self._mesh_error_at, self._mesh_error = error, self._problem.estimate().relative
            self._has_estimated = True
        return self._is_allowed(error)

    def _is_allowed(self, error: float) -> bool:
        return error <= max(self._tolerance, self.mesh_error or 0.0)


def cheaper_models(problem: ContactProblem) -> list[tuple[tuple[str, ...], dict[str, Any]]]:
    """Assumptions and options of cheaper variants of a problem, the cheapest first (local)."""
    bulk, options = problem.equations.bulk, dict[str, dict[str, Any]]()
    if not bulk.is_linear:
        options[LINEAR] = {"residual": linearized_residual(bulk.residual, bulk.u)}
    if len(sliding_little(problem)) < len(all_contacts(problem)):
        options[SMALL] = {"sliding": "small"}
    choices = dict.fromkeys([tuple(options), tuple(options)[:1]]) if options else {}
    return [(names, {k: v for n in names for k, v in options[n].items()}) for names in choices]


def linearized_residual(residual: Any, u: Any) -> Any:
    """Linearize a residual's form about u = 0 (local)."""
    zero = fem.Function(u.function_space)
    at_rest = ufl.replace(residual, {u: zero})
    return at_rest + ufl.derivative(at_rest, zero, u)


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
