# SPDX-License-Identifier: MIT
"""Was the model rich enough? An estimate of its error, from one step of the next richer one.

The estimates are those of ``model_error``: a Newton step of the richer model at the solution of the
cheap one says what that leaves out.

The indicators are what the cheap model leaves out: for linear kinematics the rotation, whose
spurious strain is angle^2 / 2, and the strain; for small sliding the slip over a facet's length and
the turn of the normals. What an obstacle stands for may be meshed alone, see ``elastic_tool``: it
gives way to the tractions, and the gaps wider by that are the richer model. Beside it stands what
the facets of that mesh get wrong, in place of the curve: where that is more, refine it before you
model it. Without a mesh there is but a rule: a body of modulus E' = E / (1 - nu^2) against another
one of its shape has the compliance 1/E' + 1/E'_other, so leaving out the other is an error of
E' / E'_other (of forces and pressures under prescribed displacements; half of it, of pressures,
under prescribed forces). Shape and supports may make that three times as much or as little.

Where surfaces might have friction, the richer model lets all stick that touches. What it asks for
is the demand, its shear over its pressure; where that is more than there is, nodes slide in the
steps that follow. Slip counts from where nodes came to touch, over all solves that the check sees:
that of the last step alone would be a part of the shear.

A check that climbs begins each solve on a cheaper model, see ``climb``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

import ufl

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.laws import Coulomb, Law, Stick
from fenics_mortar.models.climb import Climb
from fenics_mortar.models.elastic_tool import ElasticTool
from fenics_mortar.models.model_error import (
    ENERGY,
    QUANTITIES,
    Errors,
    estimate,
    estimate_wider,
    largest_slip,
    largest_strain,
    shear_demand,
    sliding_little,
)
from fenics_mortar.newton.loop import NewtonReport
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arguments import check_choice, check_flag, check_kind, check_number
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import check_same_words


@dataclass(frozen=True)
class Assumption:
    """What a model leaves out, and what that is worth.

    Attributes:
        name: The assumption.
        indicator: How far the state is from it, in words.
        errors: Estimated relative error by quantity; nan if nothing is known.
        mesh: What the mesh of the richer model would get wrong, if that is known.
    """

    name: str
    indicator: str
    errors: Errors
    mesh: Assumption | None = None


@dataclass(frozen=True)
class Adequacy:
    """The assumptions behind a solution; prints as a Markdown table.

    Attributes:
        assumptions: One by one, and where they are several, all together as the last.
        tolerance: Error that is allowed.
        quantity: Of what.
        discretisation: Relative error that the mesh leaves, if it is known.
    """

    assumptions: list[Assumption]
    tolerance: float
    quantity: str
    discretisation: float | None = None

    @property
    def error(self) -> float:
        """Estimated relative error of the quantity by all assumptions."""
        return max((a.errors[self.quantity] for a in self.assumptions), default=0.0)

    @property
    def suffices(self) -> bool:
        """Whether the model is seen to be rich enough."""
        return bool(self.error <= self.tolerance)

    def verdict(self, assumption: Assumption) -> str:
        """Judgement on one assumption, in words."""
        error = assumption.errors[self.quantity]
        if np.isnan(error):
            return "unknown"
        if error <= self.tolerance:
            return "enough"
        of_meshes = [self.discretisation or 0.0]
        of_meshes += [assumption.mesh.errors[self.quantity]] if assumption.mesh else []
        return "refine before you model more" if error <= max(of_meshes) else "not enough"

    def __str__(self) -> str:
        """One row per assumption, and the error of the mesh."""
        lines = ["| assumption | indicator | " + " | ".join(QUANTITIES) + " | verdict |"]
        lines.append("|---|---|" + "---:|" * len(QUANTITIES) + "---|")
        for a in self.assumptions:
            lines.append(_row(a, self.verdict(a)))
            lines += [_row(a.mesh, "")] if a.mesh else []
        if self.discretisation is not None:
            empty = " | " * (len(QUANTITIES) - 1)
            lines.append(f"| mesh | | {100 * self.discretisation:.2g} % {empty} | |")
        lines.append(
            f"\nestimated errors; allowed are {100 * self.tolerance:g} % in {self.quantity}"
        )
        return "\n".join(lines)


def _row(assumption: Assumption, verdict: str) -> str:
    """A line of the table."""
    cells = [f"{100 * assumption.errors[name]:.2g} %" for name in QUANTITIES]
    return f"| {' | '.join([assumption.name, assumption.indicator, *cells, verdict])} |"


class AdequacyCheck:
    """Asks of a solved problem whether its model was rich enough.

    Args:
        tolerance: Relative error that is allowed.
        quantity: Of what: "energy norm", "total force" or "peak pressure".
        finite_strain: UFL form of the residual at finite strain, in the same ``u``, if the
            problem's is linear.
        stiffness_ratio: E / (1 - nu^2) of the bodies over that of what obstacles stand for.
        tools: What obstacles stand for, where there is a mesh of it, in the place of the ratio.
        discretisation: Relative error that the mesh leaves, if it is known.
        friction: Largest coefficient of friction that surfaces may have where the problem has none.
        climb: Whether solves begin on a cheaper model, and go on to the problem's own only if the
            estimated error of the quantity is above both the tolerance and the error of the mesh:
            ``discretisation``, or of energy norms what the problem's ``estimate()`` says.

    Raises:
        ValueError: If a number is not positive or the quantity is another one.

    Example:
        ``ContactProblem(..., adequacy=fm.AdequacyCheck(0.02, finite_strain=residual))``; then
        ``print(problem.solve().adequacy)``.
    """

    def __init__(
        self,
        tolerance: float = 0.01,
        *,
        quantity: str = ENERGY,
        finite_strain: Any | None = None,
        stiffness_ratio: float | None = None,
        tools: Sequence[ElasticTool] = (),
        discretisation: float | None = None,
        friction: float | None = None,
        climb: bool = False,
    ) -> None:
        check_choice("quantity", quantity, QUANTITIES)
        numbers = {"tolerance": tolerance, "stiffness_ratio": stiffness_ratio, "friction": friction}
        for name, value in numbers.items():
            if value is not None or name == "tolerance":
                check_number(name, value, "a positive number", lambda number: 0.0 < number < np.inf)
        if discretisation is not None:
            right = "zero or a positive number"
            check_number("discretisation", discretisation, right, lambda e: 0.0 <= e < np.inf)
        right = "a list of ElasticTool"
        check_kind("tools", tools, Sequence, right)
        for tool in tools:
            check_kind("tools", tool, ElasticTool, right)
        if finite_strain is not None:
            check_kind("finite_strain", finite_strain, ufl.Form, "a UFL form of the residual")
        check_flag("climb", climb)
        self._tolerance, self._quantity = tolerance, quantity
        self._finite_strain, self._stiffness_ratio = finite_strain, stiffness_ratio
        self._discretisation, self._friction, self._climbs = discretisation, friction, climb
        self._tools = {tool.obstacle: tool for tool in tools}
        self._richer: dict[str, ContactProblem] = {}
        self._climb: Climb | None = None
        self._slips: dict[Contact, Array] = {}

    def prepare(self, problem: ContactProblem) -> None:
        """Set up the models below a problem, if it is to climb (collective)."""
        given = {
            "tolerance": self._tolerance, "quantity": self._quantity, "climb": self._climbs,
            "stiffness_ratio": self._stiffness_ratio, "friction": self._friction,
            "discretisation": self._discretisation, "tools": len(self._tools),
            "finite_strain": self._finite_strain is not None,
        }  # fmt: skip
        check_same_words(problem.comm, "AdequacyCheck", given)
        if self._climbs:
            self._climb = Climb(problem, self._tolerance, self._quantity, self._discretisation)

    def climb(self) -> NewtonReport | None:
        """Solve by the cheapest model that is enough, see ``climb``, if asked to (collective).

        Returns:
            Its record; ``None`` if the problem's own model is to be solved.
        """
        return self._climb.solve() if self._climb else None

    def remember(self) -> Callable[[], None]:
        """Return a function that makes all forgotten that is learned from now on (local)."""
        slips, climbed = self._slips.copy(), vars(self._climb).copy() if self._climb else {}

        def forget() -> None:
            self._slips = slips
            if self._climb:
                vars(self._climb).update(climbed)

        return forget

    def kept(self, problem: ContactProblem) -> dict[str, Array]:
        """What later solves depend on, as arrays for a file: the climb, and all slip so far."""
        none = np.empty(0)
        slips = [
            self._slips.get(c, none) for c in problem.equations.contacts if isinstance(c, Contact)
        ]
        return {f"slips{i}": slip for i, slip in enumerate(slips)} | (
            self._climb.kept() if self._climb else {}
        )

    def take(self, problem: ContactProblem, data: Mapping[str, Array]) -> None:
        """Go on from what ``kept`` gave, if it is in a file (collective)."""
        contacts = [c for c in problem.equations.contacts if isinstance(c, Contact)]
        for i, contact in enumerate(contacts):
            if data.get(f"slips{i}", np.empty(0)).shape == (contact.slave.num_nodes,):
                self._slips[contact] = data[f"slips{i}"]
        if self._climb and "climb" in data:
            self._climb.take(data)

    def assess(self, problem: ContactProblem) -> Adequacy:
        """Estimate the errors of the present solution; it stays as it is (collective)."""
        summit = self._climb.summit if self._climb else None
        climbed = [Assumption(summit.model.name, summit.remark, summit.errors)] if summit else []
        found = [*climbed, *self._assumptions(problem)]
        if summit is not None:  # forces and gaps are those of its operators
            for contact, theirs in zip(
                problem.equations.contacts, summit.model.problem.equations.contacts, strict=True
            ):
                contact.show(theirs.operators)
        mesh_error = self._climb.mesh_error if self._climb else self._discretisation
        return Adequacy(found, self._tolerance, self._quantity, mesh_error)

    def _assumptions(self, problem: ContactProblem) -> Iterator[Assumption]:
        richer: dict[str, dict[str, Any]] = {}
        indicators: dict[str, Callable[[ContactProblem], str]] = {}
        if self._finite_strain is not None:
            richer["linear strain"] = {"residual": self._finite_strain}
            indicators["linear strain"] = describe_strain
        if sliding_little(problem):
            richer["small sliding"] = {"sliding": "finite"}
            indicators["small sliding"] = describe_sliding
        for name, model in richer.items():
            errors = estimate(problem, self._variant(problem, name, model))
            yield Assumption(name, indicators[name](problem), errors)
        yield from self._rigid(problem)
        yield from self._without_friction(problem)
        if len(richer) > 1:
            everything = {key: value for model in richer.values() for key, value in model.items()}
            name = " and ".join(richer)
            yield Assumption(name, "", estimate(problem, self._variant(problem, name, everything)))

    def _variant(self, problem: ContactProblem, name: str, model: dict[str, Any]) -> ContactProblem:
        if name not in self._richer:
            self._richer[name] = problem.variant(**model)
        return self._richer[name]

    def _rigid(self, problem: ContactProblem) -> Iterator[Assumption]:
        """What obstacles stand for gives way as its mesh says, or by the rule of stiffness."""
        ratio = self._stiffness_ratio
        for obstacle in problem.equations.tools.obstacles:
            if obstacle in self._tools:
                yield from_tool(problem, self._tools[obstacle])
            else:
                known = (
                    f"stiffness ratio {ratio:.2g}" if ratio is not None else "no stiffness_ratio"
                )
                error = np.nan if ratio is None else ratio
                yield Assumption(f"rigid {obstacle}", known, dict.fromkeys(QUANTITIES, error))

    def _without_friction(self, problem: ContactProblem) -> Iterator[Assumption]:
        """What friction could do: all sticks first, and slides where that asks for too much."""
        number = self._friction
        if number is not None and any(map(_is_frictionless, problem.equations.contacts)):
            stick = self._variant(problem, "stick", {"law": partial(_instead, Stick())})
            rough = self._variant(problem, "friction", {"law": partial(_instead, Coulomb(number))})
            kept = problem.state()
            self._count_all_slip(problem)
            errors = estimate(problem, stick, rough)
            problem.restore(kept)
            demand = shear_demand(stick)
            known = f"stick asks for a friction of {demand:.2g}, there may be {number:.2g}"
            yield Assumption("frictionless", known, errors)

    def _count_all_slip(self, problem: ContactProblem) -> None:
        """Let slip count from where nodes came to touch, of all steps that the check has seen."""
        for contact in problem.equations.contacts:
            if not isinstance(contact, Contact) or not _is_frictionless(contact):
                continue
            before = self._slips.get(contact, np.zeros(contact.slave.num_nodes))
            self._slips[contact] = np.where(contact.active, before + contact.slip, 0.0)
            partners = contact.partners
            contact.change(partners=replace(partners, start=partners.start - before))


def from_tool(problem: ContactProblem, tool: ElasticTool) -> Assumption:
    """What it is worth that an obstacle does not give way, and has no facets (collective)."""
    touching = touching_tool(problem, tool)
    give, flatness = tool.give(touching), tool.flatness(touching)
    by_mesh = Assumption(
        f"mesh of {tool.obstacle}",
        f"its facets are off by {largest(flatness):.2g}",
        estimate_wider(problem, touching, flatness),
    )
    return Assumption(
        f"rigid {tool.obstacle}",
        f"it would give way by {largest(give):.2g}",
        estimate_wider(problem, touching, give),
        by_mesh,
    )


def touching_tool(problem: ContactProblem, tool: ElasticTool) -> list[Contact]:
    """The contacts with the obstacle that a mesh is there of."""
    contacts = [contact for contact in problem.equations.contacts if isinstance(contact, Contact)]
    return [contact for contact in contacts if contact.obstacle is tool.obstacle]


def largest(lengths: Sequence[Array]) -> float:
    """The largest of all."""
    return max((float(np.abs(length).max(initial=0.0)) for length in lengths), default=0.0)


def describe_strain(problem: ContactProblem) -> str:
    """Largest rotation and strain of all cells, in words (collective)."""
    rotation, strain = largest_strain(problem)
    return f"rotation {np.degrees(rotation):.2g}°, strain {100 * strain:.2g} %"


def describe_sliding(problem: ContactProblem) -> str:
    """Largest slip and turn of the normals of all pairs that slide little, in words."""
    slip, turn = np.max([largest_slip(contact) for contact in sliding_little(problem)], axis=0)
    return f"slip {slip:.2g} facets, normals turn by {np.degrees(turn):.2g}°"


def _is_frictionless(contact: Any) -> bool:
    """Whether it is a contact without friction."""
    return isinstance(contact, Contact) and not contact.pair.law.rubs


def _instead(rough: Law, law: Law) -> Law:
    """A law in the place of no friction."""
    return law if law.rubs else rough
