# SPDX-License-Identifier: MIT
"""Solves that begin on the cheapest of the models that a problem's own form gives.

These are the bulk linearized at rest with small sliding, and either alone. The error of a model is
estimated from a Newton step of the problem itself, so that what it costs to find a model too poor
is not lost: the next goes on from there, and models that were not enough once are not tried again.
A step back, with the residual of linear bulk, tells what that alone is worth: where it is too much,
the models between are left out.

A state that departs from the assumptions hardly more than one that was checked need not be checked
again: errors grow as the indicators do, at the most with their square.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

from fenics_mortar.contact.contact import Contact
from fenics_mortar.equations.state import State
from fenics_mortar.models.model_error import (
    ENERGY,
    QUANTITIES,
    Errors,
    Snapshot,
    correct,
    differences,
    largest_slip,
    largest_strain,
    part_of,
    sliding_little,
)
from fenics_mortar.newton.loop import NewtonReport
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import going_on

# A model with a larger error than this is no good to go on from.
FAR = 0.5
# A state is checked where an indicator is above so many times that of the last one checked.
NEAR = 2.0
# Indicators of a model that assumes all there is.
MOST_INDICATORS = 4


@dataclass(frozen=True)
class Model:
    """A variant of a problem, and what it assumes; ``is_linear``: strain, ``is_small``: sliding."""

    problem: ContactProblem
    is_linear: bool
    is_small: bool

    @property
    def name(self) -> str:
        """What it assumes."""
        linear, small = "linear strain" * self.is_linear, "small sliding" * self.is_small
        return " and ".join(filter(None, (linear, small)))


@dataclass(frozen=True)
class Summit:
    """The model that a solve ended on, its estimated errors, and how these were found."""

    model: Model
    errors: Errors
    remark: str


class Climb:
    """Solves of a problem by the cheapest model that is enough.

    Args:
        problem: The problem.
        tolerance: Relative error that is allowed.
        quantity: Of what.
        discretisation: Relative error that the mesh leaves, which is allowed, too; of energy norms
            it is estimated otherwise.

    Attributes:
        summit: Where the last solve ended; ``None`` if on the problem's own model.
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
        self._level, self._leaves_out_rest = -1, False
        self._model: Model | None
        self._checked: tuple[Array, Errors]
        self._next_model()
        self._mesh_seen_at, self._mesh_seen, self._has_looked = 0.0, 0.0, False
        self.summit: Summit | None = None

    @property
    def mesh_error(self) -> float | None:
        """Relative error of the mesh, if it is known."""
        return self._discretisation or self._mesh_seen or None

    def solve(self) -> NewtonReport | None:
        """Solve (collective).

        Returns:
            The record; ``None`` if only the problem's own model is left, which then is to start
            from where the problem is.
        """
        problem, start = self._problem, self._problem.state()
        self.summit, self._has_looked = None, False
        while self._model is not None:
            self._model.problem.adopt(problem)
            with going_on():
                report = self._model.problem.solve()
                solved = self._model.problem.state()
                start, self.summit = self._judge(self._model, start)
                if self.summit is not None:
                    problem.restore(solved.with_settings_of(start))
                    return report
            problem.restore(start)
            self._next_model()
        return None

    def kept(self) -> dict[str, Array]:
        """How far it has come, as numbers for a file; nan where there is nothing.

        ``climb``: models left behind (inf: all), whether those in between are left out, whether the
        last solve ended on a cheaper model, where the error of the mesh was looked for and found;
        ``climb_checked``: indicators, then errors, of the state last checked; ``climb_places``: of
        each contact of the present model, see ``Contact.reference_place``.
        """
        before, errors = self._checked
        checked = np.full(MOST_INDICATORS + len(QUANTITIES), np.nan)
        checked[: before.size] = before
        checked[MOST_INDICATORS:] = [errors.get(name, np.nan) for name in QUANTITIES]
        places = np.full((len(self._problem.equations.contacts), 3), np.nan)
        contacts = [] if self._model is None else list(self._model.problem.equations.contacts)
        for i, contact in enumerate(contacts):
            if isinstance(contact, Contact):
                places[i] = contact.reference_place
        left = self._level if self._model is not None else np.inf
        flags = [left, self._leaves_out_rest, self.summit is not None]
        numbers = np.array([*flags, self._mesh_seen_at, self._mesh_seen], float)
        return {"climb": numbers, "climb_checked": checked, "climb_places": places}

    def take(self, data: Mapping[str, Array]) -> None:
        """Go on from what ``kept`` gave, with the problem at the state of then (collective).

        Slip counts from what nodes faced by the operators of the model that the solve ended on.
        """
        numbers = map(float, data["climb"])
        level, leaves_out_rest, on_model, self._mesh_seen_at, self._mesh_seen = numbers
        if np.isinf(level):
            self._model, self._models = None, iter(())
        while self._model is not None and self._level < level:
            self._next_model()
        self._leaves_out_rest = bool(leaves_out_rest)
        if self._model is None:
            return
        before, errors = np.split(data["climb_checked"], [MOST_INDICATORS])
        if np.isfinite(before).any():
            count = 2 * (self._model.is_linear + self._model.is_small)
            self._checked = before[:count], dict(zip(QUANTITIES, errors.tolist(), strict=True))
        model = self._model.problem
        for contact, mine, reference in zip(
            model.equations.contacts,
            self._problem.equations.contacts,
            data["climb_places"],
            strict=True,
        ):
            if isinstance(contact, Contact):
                contact.refer_to(reference, mine.carries)
        if on_model:
            model.adopt(self._problem)
            model.accept()
            here = self._problem.state()
            self._problem.restore(model.state().with_settings_of(here))

    def _next_model(self) -> None:
        self._level += 1
        if self._level == len(self._made):
            self._made += [model for model in (next(self._models, None),) if model is not None]
        nothing = self._leaves_out_rest or self._level >= len(self._made)
        self._model = None if nothing else self._made[self._level]
        self._checked = np.full(1, np.nan), {}

    def _judge(self, model: Model, start: State) -> tuple[State, Summit | None]:
        """Where to go on from, and whether a solved model is enough."""
        problem, (before, errors), now = self._problem, self._checked, departure(model)
        if (now <= NEAR * before).all():
            growth = max(1.0, float((now / np.where(before > 0.0, before, 1.0)).max()))
            if self._is_allowed(growth**2 * errors[self._quantity]):
                grown = {name: growth * error for name, error in errors.items()}
                return start, Summit(model, grown, "the climb ended here; estimated a step before")
        errors = correct(model.problem, problem)
        self._checked, corrected = (now, errors), problem.state()
        if errors[ENERGY] < FAR:
            start = corrected.counting_slip_from(start)
        if self._is_enough(errors):
            return start, Summit(model, errors, "the climb ended here")
        if model.is_linear and model.is_small and np.isfinite(errors[ENERGY]):
            alone = what_bulk_is_worth(model.problem, problem)
            problem.restore(corrected)
            if not self._is_enough(alone):
                self._leaves_out_rest = True
        return start, None

    def _is_enough(self, errors: Errors) -> bool:
        """Whether the error of a model is below the tolerance, or below that of the mesh.

        That of the mesh is seen at the corrected state, at which the problem has to be: what is
        wrong with the model is in the residual of its own state, too. It is looked for anew where
        it decides, or where the error of the model has doubled since; once a solve.
        """
        error, known = errors[self._quantity], self._discretisation is not None
        decides = min(2.0 * self._mesh_seen_at, self._mesh_seen) < error < FAR
        if decides and error > self._tolerance and self._quantity == ENERGY and not known:
            with going_on():
                if not self._has_looked:
                    self._mesh_seen_at, self._mesh_seen = error, self._problem.estimate().relative
            self._has_looked = True
        return self._is_allowed(error)

    def _is_allowed(self, error: float) -> bool:
        return error <= max(self._tolerance, self.mesh_error or 0.0)


def cheaper_models(problem: ContactProblem) -> Iterator[Model]:
    """Variants of a problem below its own model by what they assume, the cheapest first."""
    linear: dict[str, Any] = {}
    if not problem.equations.bulk.is_linear:
        linear["residual"] = linearized(problem.equations.bulk.residual, problem.equations.bulk.u)
    contacts = [contact for contact in problem.equations.contacts if isinstance(contact, Contact)]
    if len(sliding_little(problem)) < len(contacts):
        yield Model(problem.variant(**linear, sliding="small"), bool(linear), True)
    if linear:
        yield Model(problem.variant(**linear), True, False)


def linearized(residual: Any, u: Any) -> Any:
    """A residual's form to first order in ``u``, about u = 0."""
    zero = fem.Function(u.function_space)
    at_rest = ufl.replace(residual, {u: zero})
    return at_rest + ufl.derivative(at_rest, zero, u)


def departure(model: Model) -> Array:
    """What the errors of a solved model grow with: indicators of all that it assumes, (n,)."""
    found: list[float] = []
    if model.is_linear:
        rotation, strain = largest_strain(model.problem)
        found += [strain, part_of(rotation**2, strain)]
    if model.is_small:
        found += np.max([largest_slip(c) for c in sliding_little(model.problem)], axis=0).tolist()
    return np.array(found)


def what_bulk_is_worth(other: ContactProblem, problem: ContactProblem) -> Errors:
    """Relative errors, at a corrected state, of the bulk of a variant alone (collective).

    By a step with its residual; the problem is left there.
    """
    here = Snapshot.of(problem)
    other.equations.bulk.assemble_residual()
    problem.equations.bulk.r.array[:] = other.equations.bulk.r.array_r
    problem.equations.advance()
    return differences(other, Snapshot.of(problem), here)
