# SPDX-License-Identifier: MIT
"""Nodal positions of the mesh as a control: shape derivatives.

Nodal values are constant while the nodes move. Residual and UFL objectives are differentiated by
UFL's coordinate derivative. Contact depends only on the positions x = X + u, at the end of the step
and in the state from which slip is counted.
"""

from __future__ import annotations

from itertools import chain
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

import ufl
from dolfinx import mesh as dmesh
from ufl.corealg.traversal import unique_pre_traversal

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.forms import DerivativeByField
from fenics_mortar.sensitivity.history import Before, history_of
from fenics_mortar.sensitivity.pair_operators import UNKNOWNS, PairOperator, check_exact
from fenics_mortar.sensitivity.partials.fields import by_positions, check_positions
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError


class NodalPositions:
    """Positions X of the nodes; all methods are collective.

    Values are those of a displacement of the mesh at the owned dofs of ``u``, [length]. Prescribed
    values, loads, offsets, thickness and the choices at set-up do not move with the mesh. The
    displacement must be of degree 1, without further unknowns, on straight cells.
    """

    name, is_distributed = "nodal positions", True

    def __init__(self) -> None:
        self._forms: WeakKeyDictionary[Bulk, _Derivatives] = WeakKeyDictionary()

    def get(self, problem: ContactProblem) -> Array:
        """Positions in ``problem``, shape (owned dofs,) [length]; see ``Control``."""
        space = problem.equations.bulk.space
        return space.positions()[: space.num_owned].copy()

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Raise an error: ``values``, shape (owned dofs,) [length], cannot be set in ``problem``.

        Raises:
            MortarError: Always.
        """
        raise MortarError("nodes of a problem cannot be moved: set up a new one on the moved mesh")

    def _of(self, problem: ContactProblem) -> _Derivatives:
        bulk = problem.equations.bulk
        if bulk not in self._forms:
            self._forms[bulk] = _Derivatives(bulk)
        return self._forms[bulk]

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """Change of the residuals along ``dm``, shape (owned dofs,) [length]; see ``Control``.

        ``problem`` and the state ``before`` are those of a step.
        """
        bodies = LinearVector(u=self._of(problem).residual.along(dm))
        return ContactPositions(problem, before).jvp(dm) + _free(problem.equations, bodies)

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """Gradient of the product of residuals and ``y``, shape (owned dofs,) [product / length].

        See ``Control``; ``problem`` and the state ``before`` are those of a step.
        """
        total, free = ContactPositions(problem, before).vjp(y), _free(problem.equations, y)
        return total if y.u is None else total + self._of(problem).residual.transposed(free.u)

    def explicit(self, problem: ContactProblem, quantity: Any, before: Before = None) -> Array:
        """Derivative of a quantity at fixed displacements, shape (owned dofs,) [quantity / length].

        ``problem`` and the state ``before`` are those of a step.
        """
        form = getattr(quantity, "form", None)
        if form is not None:
            return self._of(problem).of_form(form)
        earlier = quantity.by_before(problem, before) or LinearVector()
        total = (quantity.gradient(problem, before) + earlier).u
        return np.zeros(problem.equations.bulk.num_owned) if total is None else total


class _Derivatives:
    """Derivatives, with respect to positions, of the bodies' residual and of forms of rank 0.

    Args:
        bulk: The bodies.

    Attributes:
        residual: Derivative of the residual.

    Raises:
        MortarError: On all ranks, if the nodes of displacement and mesh differ.
    """

    def __init__(self, bulk: Bulk) -> None:
        space, mesh = bulk.space, bulk.V.mesh
        nodes = compat.dofmap(space.V).shape[1], compat.geometry_dofmap(mesh).shape[1]
        if space.is_mixed or nodes != 2 * (compat.num_corners(mesh),):
            raise MortarError(
                "nodal positions as control need displacements of degree 1 on straight cells"
            )
        self._V = space.V
        self.residual = self._by_positions(bulk.residual, space.V)
        self._forms: dict[ufl.Form, DerivativeByField] = {}

    def _by_positions(self, form: ufl.Form, space: Any = None) -> DerivativeByField:
        return DerivativeByField(form, _positions_in(form, self._V.mesh), self._V, space)

    def of_form(self, form: ufl.Form) -> Array:
        """Gradient of the value of a form, (owned dofs,) [its unit / length]."""
        if form not in self._forms:
            self._forms[form] = self._by_positions(form)
        return self._forms[form].transposed()


class ContactPositions:
    """Derivative of the residuals with respect to the positions of the nodes, contacts only.

    Positions are values at the dofs of the displacement. See ``partials.fields``.

    Args:
        problem: The problem, at the end of a step, evaluated with ``EXACT``; collective.
        before: State at the start of the step, with friction.

    Raises:
        MortarError: On all ranks, if contact depends on the undeformed mesh in other ways.
    """

    def __init__(self, problem: ContactProblem, before: Before = None) -> None:
        e = self._equations = problem.equations
        self._history = history_of(problem, before)
        for contact in e.contacts:
            check_positions(contact)
            check_exact(contact)
        matrices = {i: by_positions(contact) for i, contact in enumerate(e.contacts)}
        self._residuals = PairOperator(e, matrices, UNKNOWNS, UNKNOWNS)

    def jvp(self, dx: Array) -> LinearVector:
        """Change of the residuals with the positions, (owned dofs,) [length] (collective)."""
        positions = LinearVector(u=dx)
        change = _free(self._equations, self._residuals @ positions)
        return change if self._history is None else change + self._history.residuals @ positions

    def vjp(self, y: LinearVector) -> Array:
        """Gradient, by positions, of residuals times ``y``, (owned dofs,) (collective).

        In the unit of the product over [length].
        """
        gradient = self._residuals.T @ _free(self._equations, y)
        if self._history is not None:
            gradient = gradient + self._history.residuals.T @ y
        return np.asarray(gradient.u)


def _free(e: ContactEquations, x: LinearVector) -> LinearVector:
    """Zeros at prescribed dofs and motions: their rows contain no forces (local)."""
    prescribed = e.bulk.prescribed[: e.bulk.num_owned]
    u = None if x.u is None else np.where(prescribed, 0.0, x.u)
    return LinearVector(u, x.z, None if x.q is None else np.where(e.motions.driven, x.q, 0.0))


def _positions_in(form: ufl.Form, mesh: dmesh.Mesh) -> ufl.SpatialCoordinate:
    """Coordinates that occur in a form, or new ones (local).

    UFL finds them by a hash that depends on the coordinate element; FFCx 0.5 changes this element.
    """
    parts = (unique_pre_traversal(integral.integrand()) for integral in form.integrals())
    found = (p for p in chain.from_iterable(parts) if isinstance(p, ufl.SpatialCoordinate))
    return next(found, ufl.SpatialCoordinate(mesh))
