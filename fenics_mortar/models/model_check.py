# SPDX-License-Identifier: MIT
"""Model check: estimated errors of the assumptions of a problem's model.

The estimates of ``model_error`` use one Newton step of a richer model at the solution of the
present one.

Indicators are the deviations from the assumptions. The body that an obstacle represents may be
meshed alone, see ``model_error``: the displacement of its surface under the tractions widens the
gaps in the richer model. The error of the facets of that mesh, compared with the curve, is reported
separately; if it is larger, refine that mesh first. Without a mesh only a rule is available: a body
of modulus E' = E / (1 - nu^2) against another one of its shape has the compliance
1/E' + 1/E'_other, so neglecting the other compliance is an error of E' / E'_other (of forces and
pressures under prescribed displacements; half of it, of pressures, under prescribed forces). Shape
and supports may change this estimate by a factor of three.

A plane or axisymmetric problem is lifted to one in space, see ``in_space``.

If surfaces may have friction, all nodes in contact stick in the richer model. The required friction
is the shear over the pressure; where it exceeds the available friction, nodes slide in the
following steps. Slip is counted from first contact, over all solves of the check: the slip of the
last step alone would cause only a fraction of the shear.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

import ufl

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.law import Coulomb, Law, Stick
from fenics_mortar.models import model_error
from fenics_mortar.models.in_space import InSpace
from fenics_mortar.utils.errors import check_choice, check_kind, check_number, check_same_texts

if TYPE_CHECKING:
    from fenics_mortar.problem import ContactProblem
    from fenics_mortar.utils.arrays import Array


class ModelCheck:
    """Check of the assumptions of a problem's model after each solve; the constructor is local.

    Args:
        tolerance: Allowed relative error of the quantity [1].
        quantity: "energy norm", "total force" or "peak pressure".
        finite_strain: UFL form of the residual at finite strain, in the same ``u``, if the
            residual of the problem is linear.
        stiffness_ratio: E / (1 - nu^2) of the bodies over that of the bodies that obstacles
            represent [1].
        elastic_obstacles: Elastic bodies that obstacles represent; they replace the ratio.
        discretisation: Relative error of the mesh [1], if known.
        friction: Largest possible coefficient of friction of surfaces modelled as frictionless [1].
        in_space: The bodies in space of which a plane or axisymmetric problem is a section.

    Raises:
        ValueError: If an argument is of another type or not allowed.

    Example:
        ``ContactProblem(..., model_check=fm.ModelCheck(0.02, finite_strain=residual))``; then
        ``print(problem.solve().model_check)``.
    """

    def __init__(
        self,
        tolerance: float = 0.01,
        *,
        quantity: str = model_error.ENERGY,
        finite_strain: Any | None = None,
        stiffness_ratio: float | None = None,
        elastic_obstacles: Sequence[model_error.ElasticObstacle] = (),
        discretisation: float | None = None,
        friction: float | None = None,
        in_space: InSpace | None = None,
    ) -> None:
        check_choice("quantity", quantity, model_error.QUANTITIES)
        numbers = {"tolerance": tolerance, "stiffness_ratio": stiffness_ratio, "friction": friction}
        for name, value in numbers.items():
            if value is not None or name == "tolerance":
                check_number(name, value, "a positive number", lambda number: 0.0 < number < np.inf)
        if discretisation is not None:
            expected = "zero or a positive number"
            check_number("discretisation", discretisation, expected, lambda e: 0.0 <= e < np.inf)
        expected = "a list of ElasticObstacle"
        check_kind("elastic_obstacles", elastic_obstacles, Sequence, expected)
        for elastic in elastic_obstacles:
            check_kind("elastic_obstacles", elastic, model_error.ElasticObstacle, expected)
        if finite_strain is not None:
            check_kind("finite_strain", finite_strain, ufl.Form, "a UFL form of the residual")
        if in_space is not None:
            check_kind("in_space", in_space, InSpace, "an InSpace of a problem in space, or None")
        self._tolerance, self._quantity, self._in_space = tolerance, quantity, in_space
        self._finite_strain, self._stiffness_ratio = finite_strain, stiffness_ratio
        self._discretisation, self._friction = discretisation, friction
        self._elastic = {elastic.obstacle: elastic for elastic in elastic_obstacles}
        self._richer: dict[str, ContactProblem] = {}
        self._slips: dict[Contact, Array] = {}

    def prepare(self, problem: ContactProblem) -> None:
        """Compare the options on all ranks (collective).

        Raises:
            MortarError: On all ranks, if options differ between them.
        """
        given = {
            "tolerance": self._tolerance, "quantity": self._quantity,
            "stiffness_ratio": self._stiffness_ratio,
            "friction": self._friction, "discretisation": self._discretisation,
            "elastic_obstacles": len(self._elastic),
            "finite_strain": self._finite_strain is not None,
            "in_space": self._in_space is not None,
        }  # fmt: skip
        check_same_texts(problem.equations.comm, "ModelCheck", given)
        if self._in_space is not None:
            self._in_space.prepare(problem)

    def snapshot(self) -> Callable[[], None]:
        """Return a function that restores the present data of the check (local)."""
        slips, section = self._slips.copy(), self._in_space
        start = None if section is None else section.start

        def restore() -> None:
            self._slips = slips
            if section is not None and start is not None:
                section.start = start

        return restore

    def saved_data(self, problem: ContactProblem) -> dict[str, Array]:
        """Accumulated slip of each pair of ``problem`` for a checkpoint (local).

        Shape (slave nodes,), in space (slave nodes, 3), each [length].
        """
        contacts = problem.equations.floating.contacts
        return {f"slips{i}": self._slips.get(c, np.empty(0)) for i, c in enumerate(contacts)}

    def restore_data(self, problem: ContactProblem, data: Mapping[str, Array]) -> None:
        """Restore ``data`` as far as present (collective); see ``saved_data`` for shapes."""
        for i, contact in enumerate(problem.equations.floating.contacts):
            if data.get(f"slips{i}", np.empty(0)).shape == contact.accepted_partners.counted.shape:
                self._slips[contact] = data[f"slips{i}"]
        if self._in_space is not None:
            self._in_space.follow(problem)

    def assess(self, problem: ContactProblem) -> model_error.ModelReport:
        """Estimate the errors of the present solution; its state is restored (collective)."""
        found = list(self._assumptions(problem))
        return model_error.ModelReport(found, self._tolerance, self._quantity, self._discretisation)

    def _assumptions(self, problem: ContactProblem) -> Iterator[model_error.Assumption]:
        richer: dict[str, dict[str, Any]] = {}
        if self._finite_strain is not None:
            richer[model_error.LINEAR] = {"residual": self._finite_strain}
        if model_error.sliding_little(problem):
            richer[model_error.SMALL] = {"sliding": "finite"}
        for name, model in richer.items():
            errors = model_error.estimate(problem, self._variant(problem, name, model))
            yield model_error.Assumption(name, model_error.describe(problem, name), errors)
        yield from self._rigid(problem)
        yield from self._without_friction(problem)
        if self._in_space is not None:
            yield self._in_space.estimate(problem)
        if len(richer) > 1:
            everything = {key: value for model in richer.values() for key, value in model.items()}
            name = " and ".join(richer)
            errors = model_error.estimate(problem, self._variant(problem, name, everything))
            yield model_error.Assumption(name, "", errors)

    def _variant(self, problem: ContactProblem, name: str, model: dict[str, Any]) -> ContactProblem:
        if name not in self._richer:
            self._richer[name] = problem.variant(**model)
        return self._richer[name]

    def _rigid(self, problem: ContactProblem) -> Iterator[model_error.Assumption]:
        """Errors of rigid obstacles, from their elastic bodies or the ratio of stiffness."""
        ratio = self._stiffness_ratio
        for obstacle in problem.equations.motions.obstacles:
            if obstacle in self._elastic:
                yield model_error.rigid_obstacle(problem, self._elastic[obstacle])
            else:
                known = "no stiffness_ratio" if ratio is None else f"stiffness ratio {ratio:.2g}"
                error = np.nan if ratio is None else ratio
                yield model_error.Assumption(
                    f"rigid {obstacle}", known, dict.fromkeys(model_error.QUANTITIES, error)
                )

    def _without_friction(self, problem: ContactProblem) -> Iterator[model_error.Assumption]:
        """Error of neglecting friction: all nodes stick; nodes with too large a shear slide."""
        number = self._friction
        if number is not None and any(map(_is_frictionless, problem.equations.contacts)):
            stick = self._variant(problem, "stick", {"law": partial(_instead, Stick())})
            rough = self._variant(problem, "friction", {"law": partial(_instead, Coulomb(number))})
            kept = problem.state()
            self._count_all_slip(problem)
            errors = model_error.estimate(problem, stick, rough)
            problem.restore(kept)
            demand = model_error.shear_demand(stick)
            known = f"stick requires mu = {demand:.2g}; friction up to {number:.2g} is possible"
            yield model_error.Assumption("frictionless", known, errors)

    def _count_all_slip(self, problem: ContactProblem) -> None:
        """Accumulate the slip of each node since first contact, over all checked steps."""
        for contact in filter(_is_frictionless, problem.equations.floating.contacts):
            slip = contact.now.counted_slip
            before = self._slips.get(contact, np.zeros_like(slip))
            on = contact.active.reshape(-1, *[1] * (slip.ndim - 1))
            self._slips[contact] = np.where(on, before + slip, 0.0)
            partners = contact.partners
            contact.change(partners=replace(partners, counted=partners.counted + before))


def _is_frictionless(contact: Any) -> bool:
    """Whether ``contact`` is a contact without friction (local)."""
    return isinstance(contact, Contact) and not contact.pair.law.has_friction


def _instead(rough: Law, law: Law) -> Law:
    """``rough`` in place of a law without friction, else the law (local)."""
    return law if law.has_friction else rough
