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
from dolfinx import fem
from dolfinx import mesh as dmesh
from ufl.corealg.traversal import unique_pre_traversal

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.controls import Before
from fenics_mortar.sensitivity.forms import AssembledForm, put_owned
from fenics_mortar.sensitivity.positions import ContactPositions
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
        change, prescribed = ContactPositions(problem, before).jvp(dm), _prescribed(problem)
        of_bodies = np.where(prescribed, 0.0, self._of(problem).along(dm))
        return LinearVector(
            of_bodies if change.u is None else change.u + of_bodies, change.z, change.q
        )

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """Gradient of the product of residuals and ``y``, shape (owned dofs,) [product / length].

        See ``Control``; ``problem`` and the state ``before`` are those of a step.
        """
        total = ContactPositions(problem, before).vjp(y)
        if y.u is None:
            return total
        return total + self._of(problem).transposed(np.where(_prescribed(problem), 0.0, y.u))

    def explicit(self, problem: ContactProblem, quantity: Any, before: Before = None) -> Array:
        """Derivative of a quantity at fixed displacements, shape (owned dofs,) [quantity / length].

        ``problem`` and the state ``before`` are those of a step.
        """
        form = getattr(quantity, "form", None)
        if form is not None:
            return self._of(problem).of_form(form)
        total = np.zeros(problem.equations.bulk.num_owned)
        for vector in (quantity.gradient(problem, before), quantity.by_before(problem, before)):
            total = total if vector is None or vector.u is None else total + vector.u
        return total


class _Derivatives:
    """Derivatives, with respect to positions, of the bodies' residual and of forms of rank 0.

    Args:
        bulk: The bodies.

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
        self._V, self._mesh = space.V, mesh
        self._direction, self._weights = fem.Function(space.V), fem.Function(space.V)
        (test,) = bulk.residual.arguments()
        action = ufl.replace(bulk.residual, {test: self._weights})
        x = _positions_in(bulk.residual, mesh)
        forwards = ufl.derivative(bulk.residual, x, self._direction)
        self._forwards = AssembledForm(forwards, mesh.comm, space.V)
        self._backwards = self._by_positions(action)
        self._forms: dict[ufl.Form, AssembledForm] = {}

    def _by_positions(self, form: ufl.Form) -> AssembledForm:
        x = _positions_in(form, self._mesh)
        derivative = ufl.derivative(form, x, ufl.TestFunction(self._V))
        return AssembledForm(derivative, self._mesh.comm, self._V)

    def along(self, direction: Array) -> Array:
        """Change of the residual along a direction of positions, (owned dofs,) [stress length]."""
        put_owned(self._direction, direction)
        return self._forwards.vector()

    def transposed(self, weights: Array) -> Array:
        """Gradient of the residual times ``weights``, (owned dofs,) [unit of the sum / length]."""
        put_owned(self._weights, weights)
        return self._backwards.vector()

    def of_form(self, form: ufl.Form) -> Array:
        """Gradient of the value of a form, (owned dofs,) [its unit / length]."""
        if form not in self._forms:
            self._forms[form] = self._by_positions(form)
        return self._forms[form].vector()


def _prescribed(problem: ContactProblem) -> Any:
    """Marks of the owned prescribed dofs (local)."""
    bulk = problem.equations.bulk
    return bulk.prescribed[: bulk.num_owned]


def _positions_in(form: ufl.Form, mesh: dmesh.Mesh) -> ufl.SpatialCoordinate:
    """Coordinates that occur in a form, or new ones (local).

    UFL finds them by a hash that depends on the coordinate element; FFCx 0.5 changes this element.
    """
    parts = (unique_pre_traversal(integral.integrand()) for integral in form.integrals())
    found = (p for p in chain.from_iterable(parts) if isinstance(p, ufl.SpatialCoordinate))
    return next(found, ufl.SpatialCoordinate(mesh))
