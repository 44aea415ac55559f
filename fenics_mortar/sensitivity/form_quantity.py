# SPDX-License-Identifier: MIT
"""A scalar UFL form of displacement, constants and functions as an objective."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import ufl

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.bulk.subdomains import check_subdomains
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.controls import Before
from fenics_mortar.sensitivity.form_controls import FormControl
from fenics_mortar.sensitivity.forms import AssembledForm, FormDerivative, derivative_by
from fenics_mortar.utils.arrays import Array


class FormQuantity:
    """Value and derivatives of a UFL form of rank 0; all methods are collective.

    See ``quantities`` for the methods.

    Args:
        bulk: The bodies.
        form: The form.

    Attributes:
        form: The form.
    """

    def __init__(self, bulk: Bulk, form: ufl.Form) -> None:
        self.form, self._u, self._mesh = form, bulk.u, bulk.V.mesh
        self._data = [*form.constants(), *form.coefficients()]
        self._by_controls: dict[Any, FormDerivative] = {}

    @cached_property
    def _checked(self) -> ufl.Form:
        """The form, whose tags belong to the mesh."""
        check_subdomains("objective", self.form, self._mesh, ())
        return self.form

    @cached_property
    def _value(self) -> AssembledForm:
        return AssembledForm(self._checked, self._mesh.comm)

    @cached_property
    def _by_u(self) -> FormDerivative:
        return derivative_by(self._mesh, self._checked, self._u)

    def value(self, problem: ContactProblem, before: Before = None) -> float:
        """Value at the present state [its unit]."""
        return self._value.scalar()

    def gradient(self, problem: ContactProblem, before: Before = None) -> LinearVector:
        """Derivative with respect to the state."""
        return LinearVector(u=self._by_u.transposed())

    def by_before(self, problem: ContactProblem, before: Before) -> LinearVector | None:
        """Derivative with respect to the state before, which is zero: ``None``."""
        return None

    def depends_on(self, control: Any) -> bool:
        """Whether a control occurs in the form (local)."""
        data = control.data if isinstance(control, FormControl) else None
        return any(data is value for value in self._data)

    def by_control(
        self, problem: ContactProblem, control: Any, before: Before = None
    ) -> Array | float:
        """See ``Quantity.by_control``."""
        if not self.depends_on(control):
            return 0.0
        if control.data not in self._by_controls:
            self._by_controls[control.data] = derivative_by(self._mesh, self._checked, control.data)
        return self._by_controls[control.data].transposed()
