# SPDX-License-Identifier: MIT
"""Constants and functions of UFL in the residual and in Dirichlet conditions, as controls.

The rows of free dofs change with the form r, those of prescribed dofs are u - g with the
prescribed values g. A control m may occur in both:

    (dR/dm) dm = dr/dm dm  at free dofs,    -dg/dm dm  at prescribed dofs.

g contains copies of entries of m. They are identified by numbering the entries of m: later
conditions on a dof then overwrite earlier ones as in a solve.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

from petsc4py import PETSc

import numpy as np

from dolfinx import fem

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.forms import derivative_by, num_owned, put_owned
from fenics_mortar.sensitivity.history import Before
from fenics_mortar.sensitivity.partials.maps import Matrix
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array


class FormControl:
    """A ``fem.Constant`` or ``fem.Function`` of a problem; all methods are collective.

    Values have the shape of the constant and are replicated, or that of the owned dofs of the
    function. See ``Control`` for the methods.

    Args:
        bulk: The bodies.
        data: The constant or function.
    """

    def __init__(self, bulk: Bulk, data: Any) -> None:
        self._comm, self._space, self._bcs = bulk.comm, bulk.space.whole, bulk.bcs
        self._is_prescribed = bulk.prescribed[: bulk.num_owned]
        self.data = data
        self.is_distributed = isinstance(data, fem.Function)
        self.name = str(data.name) if self.is_distributed else "a constant"
        self.is_in_residual = any(data is value for value in bulk.data)
        if self.is_in_residual:
            self._derivative = derivative_by(bulk.V.mesh, bulk.residual, data, self._space)

    @property
    def _numbers(self) -> Array:
        """All numbers, ghosts included, as a flat view."""
        values = self.data.x.array if self.is_distributed else self.data.value
        return values.reshape(-1)

    @cached_property
    def _copied(self) -> Matrix:
        """Ones at copies of numbers in prescribed values, shape (owned dofs, local numbers)."""
        before, found = self._numbers.copy(), []
        for numbers in (np.arange(1.0, before.size + 1.0), np.zeros(before.size)):
            self._numbers[:] = numbers
            values = np.zeros(self._is_prescribed.size + self._num_ghosts)
            compat.set_prescribed(values, self._bcs)
            found.append(values[: self._is_prescribed.size])
        self._numbers[:] = before
        copies = np.rint(found[0] - found[1]).astype(np.int64)
        dofs = np.flatnonzero(copies)
        shape = copies.size, before.size
        return Matrix(dofs, copies[dofs] - 1, np.ones(dofs.size), shape)

    @property
    def _num_ghosts(self) -> int:
        layout = self._space.dofmap
        return int(layout.index_map.num_ghosts * layout.index_map_bs)

    @cached_property
    def occurs(self) -> bool:
        """Whether residual or prescribed values depend on the control."""
        return self._comm.allreduce(self.is_in_residual or self._copied.values.size > 0)

    def get(self, problem: ContactProblem) -> Array:
        """Present values, (owned dofs,) of a function, or the shape of a constant [their unit]."""
        if self.is_distributed:
            return self.data.x.array[: num_owned(self.data.function_space)].copy()
        return np.array(self.data.value)

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Set the values, of the shape of ``get``."""
        if self.is_distributed:
            put_owned(self.data, np.asarray(values))
        else:
            self.data.value[...] = values

    def jvp(self, problem: ContactProblem, direction: Array, before: Before = None) -> LinearVector:
        """(dR/dm) dm; see ``Control``."""
        rows = np.zeros(self._is_prescribed.size)
        if self.is_in_residual:
            rows = np.where(self._is_prescribed, 0.0, self._derivative.along(direction))
        return LinearVector(u=rows - self._copied @ self._with_ghosts(direction))

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """(dR/dm)^T y; see ``Control``."""
        u = np.zeros(self._is_prescribed.size) if y.u is None else y.u
        result = np.zeros_like(self.get(problem))
        if self.is_in_residual:
            result = self._derivative.transposed(np.where(self._is_prescribed, 0.0, u))
        return result - self._sum_ghosts(self._copied.T @ u).reshape(result.shape)

    def pairs(self, problem: ContactProblem) -> list[int]:
        """See ``PairControl``: none, pairs depend on the control through the state only."""
        return []

    def _with_ghosts(self, values: Array) -> Array:
        """Values of a direction with ghosts, flat."""
        if not self.is_distributed:
            return np.ravel(values)
        direction = fem.Function(self.data.function_space)
        put_owned(direction, values)
        return direction.x.array

    def _sum_ghosts(self, values: Array) -> Array:
        """Sum of the values (local numbers,) of all ranks, at owned dofs or replicated."""
        if not self.is_distributed:
            return self._comm.allreduce(values)
        vector = compat.create_vector(self.data.function_space)
        with vector.localForm() as local:
            local.array[:] = values
        vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        owned = vector.array_r.copy()
        vector.destroy()
        return owned
