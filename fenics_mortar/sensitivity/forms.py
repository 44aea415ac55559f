# SPDX-License-Identifier: MIT
"""Derivatives of UFL forms with respect to the constants and functions in them, assembled.

The derivative with respect to a constant c in the direction d is the integral of d(integrand)/dc .
d, by a function that of UFL's Gateaux derivative. The transposed derivative with respect to a
function f is the linear form of test functions of the space of f.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import ufl
from dolfinx import fem
from ufl.algorithms import expand_derivatives
from ufl.algorithms.map_integrands import map_integrands

from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array


class AssembledForm:
    """A form of rank 0 or 1, compiled when first assembled; all methods are collective.

    Args:
        form: The form.
        comm: Communicator of the mesh.
        space: Space of the test function, ``None`` for rank 0.
    """

    def __init__(self, form: ufl.Form, comm: MPI.Comm, space: Any = None) -> None:
        self._form, self._comm, self._space = form, comm, space

    @cached_property
    def _compiled(self) -> Any:
        """The compiled form, ``None`` if it is zero."""
        expanded = expand_derivatives(self._form)
        return compat.form(expanded) if expanded.integrals() else None

    @cached_property
    def _vector(self) -> PETSc.Vec:
        return compat.create_vector(self._space)

    def scalar(self) -> float:
        """Value of a form of rank 0 [its unit], equal on all ranks."""
        if self._compiled is None:
            return 0.0
        return self._comm.allreduce(float(fem.assemble_scalar(self._compiled)))

    def vector(self) -> Array:
        """Vector of a form of rank 1, shape (owned dofs,) [its unit]."""
        if self._compiled is None:
            return np.zeros(num_owned(self._space))
        compat.assemble_vector(self._vector, self._compiled)
        return self._vector.array_r.copy()


class FormDerivative(ABC):
    """Derivative of a form with respect to a constant or a function; all methods are collective.

    Args:
        mesh: The mesh.
        form: The form.
        control: The constant or function.
        space: Space of the form's test function, ``None`` for rank 0.
    """

    def __init__(self, mesh: Any, form: ufl.Form, control: Any, space: Any = None) -> None:
        self._mesh, self._comm = mesh, mesh.comm
        self._form, self._control, self._space = expand_derivatives(form), control, space

    @abstractmethod
    def along(self, direction: Array) -> Any:
        """Derivative in a direction.

        Args:
            direction: Numbers in the shape of the constant, or of the owned dofs of the function.

        Returns:
            A number, or the vector of a form of rank 1, shape (owned dofs,).
        """

    @abstractmethod
    def transposed(self, weights: Array | None = None) -> Array:
        """Derivatives with respect to all numbers of the control.

        Args:
            weights: Weights of the values of the test function, shape (owned dofs,), of a form of
                rank 1.

        Returns:
            Derivatives in the shape of the constant, replicated, or of the owned dofs of the
            function [unit of the sum over that of the control].
        """


class DerivativeByConstant(FormDerivative):
    """Derivative with respect to a ``fem.Constant``; see ``FormDerivative``."""

    @cached_property
    def _direction(self) -> fem.Constant:
        return fem.Constant(self._mesh, 0.0 * self._control.value)

    @cached_property
    def _assembled(self) -> AssembledForm:
        variable = ufl.variable(self._control)
        form = ufl.replace(self._form, {self._control: variable})

        def along(integrand: Any) -> Any:
            return ufl.inner(ufl.diff(integrand, variable), self._direction)

        return AssembledForm(map_integrands(along, form), self._comm, self._space)

    def along(self, direction: Array) -> Any:
        """See ``FormDerivative``."""
        self._direction.value[...] = direction
        return self._assembled.scalar() if self._space is None else self._assembled.vector()

    def transposed(self, weights: Array | None = None) -> Array:
        """See ``FormDerivative``."""
        result = np.zeros_like(self._control.value)
        for entry in np.ndindex(result.shape):
            unit = np.zeros_like(result)
            unit[entry] = 1.0
            result[entry] = self.along(unit) if weights is None else weights @ self.along(unit)
        return result if weights is None else self._comm.allreduce(result)


class DerivativeByFunction(FormDerivative):
    """Derivative with respect to a ``fem.Function``; see ``FormDerivative``."""

    @cached_property
    def _direction(self) -> fem.Function:
        return fem.Function(self._control.function_space)

    @cached_property
    def _weights(self) -> fem.Function:
        return fem.Function(self._space)

    @cached_property
    def _forwards(self) -> AssembledForm:
        form = ufl.derivative(self._form, self._control, self._direction)
        return AssembledForm(form, self._comm, self._space)

    @cached_property
    def _backwards(self) -> AssembledForm:
        form, space = self._form, self._control.function_space
        if self._space is not None:
            (test,) = form.arguments()
            form = ufl.replace(form, {test: self._weights})
        derivative = ufl.derivative(form, self._control, ufl.TestFunction(space))
        return AssembledForm(derivative, self._comm, space)

    def along(self, direction: Array) -> Any:
        """See ``FormDerivative``."""
        put_owned(self._direction, direction)
        return self._forwards.scalar() if self._space is None else self._forwards.vector()

    def transposed(self, weights: Array | None = None) -> Array:
        """See ``FormDerivative``."""
        if weights is not None:
            put_owned(self._weights, weights)
        return self._backwards.vector()


def derivative_by(mesh: Any, form: ufl.Form, control: Any, space: Any = None) -> FormDerivative:
    """Derivative of a form with respect to a constant or function; see ``FormDerivative``."""
    kind = DerivativeByConstant if isinstance(control, fem.Constant) else DerivativeByFunction
    return kind(mesh, form, control, space)


def num_owned(space: Any) -> int:
    """Number of dofs of a space owned by this rank (local)."""
    return int(space.dofmap.index_map.size_local * space.dofmap.index_map_bs)


def put_owned(function: fem.Function, values: Array) -> None:
    """Set the owned values of a function, shape (owned dofs,), and its ghosts (collective)."""
    function.x.array[: values.size] = values
    function.x.scatter_forward()
