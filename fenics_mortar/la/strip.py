# SPDX-License-Identifier: MIT
"""Factorization of the rows and columns of a matrix in a strip along contact.

A solution in the strip is zero elsewhere, except at prescribed dofs: its product with the matrix
differs from zero only in the rows next to these dofs. The product uses a copy of these entries
instead of the whole matrix.

In the plane the matrix is factored without pivoting, which takes half of the time, until the
residual of a solution shows that pivots are needed, as with rows of multipliers. In space MUMPS
factors it without the zeros of its pattern.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.la.options import STRIP_FACTORS, STRIP_PIVOTS, WITHOUT_PIVOTING, options_added
from fenics_mortar.la.sparse import WithoutZeros
from fenics_mortar.utils.arrays import Indices
from fenics_mortar.utils.ranks import on_all_ranks

# Layers of cells of the strip on either side of contact, in the plane and in space, where the
# factors of a layer have long rows.
LAYERS = {2: 2, 3: 1}


class Strip:
    """Factored rows and columns of the dofs near contact surfaces; methods are collective.

    Args:
        bulk: The bodies; K without contact terms.
        prefix: Prefix of PETSc's options.
        multipliers: Number of rows of multipliers after those of dofs; all are in the strip.

    Attributes:
        dofs: Owned dofs of the strip, shape (n,).
        num_rows: Rows of the strip, summed over all ranks.
    """

    def __init__(self, bulk: Bulk, prefix: str, multipliers: int) -> None:
        self._prefix, self._prescribed, self._comm = prefix, bulk.prescribed_dofs, bulk.comm
        self._bulk, self._multipliers = bulk, multipliers
        self.dofs = np.empty(0, np.int64)
        self._matrix: Any = None
        self._columns: Any = None
        self._factors: Any = None
        self._nonzeros = WithoutZeros() if bulk.space.dim == 3 else None
        self._options = STRIP_FACTORS if self._nonzeros is None else STRIP_PIVOTS
        self._pattern = (0, 0.0)  # handle and number of entries of the matrix

    def move_to(self, dofs: Indices) -> None:
        """Put the strip around owned ``dofs`` (k,)."""
        bulk = self._bulk
        self.dofs = _with_neighbours(bulk, dofs, LAYERS[bulk.space.dim])
        rows = np.arange(bulk.num_owned, bulk.num_owned + self._multipliers)
        self._rows = np.append(self.dofs, rows)
        self.num_rows = bulk.comm.allreduce(self._rows.size)
        self._solved = np.union1d(self._rows, self._prescribed)
        dofs = self._solved[self._solved < bulk.num_owned]
        self._touched = np.append(_with_neighbours(bulk, dofs, 1), rows)
        self.forget_pattern()

    def factor(self, A: PETSc.Mat) -> None:
        """Factor the strip of ``A``, whose pattern may have changed."""
        pattern = A.handle, A.getInfo(PETSc.Mat.InfoType.LOCAL)["nz_used"]
        if not on_all_ranks(self._comm, pattern == self._pattern):
            self.forget_pattern()
            self._pattern = pattern
        whole, solved, touched = (
            self._numbers_in(A, rows) for rows in (self._rows, self._solved, self._touched)
        )
        self._matrix = A.createSubMatrix(whole, whole, self._matrix)
        self._columns = A.createSubMatrix(touched, solved, self._columns)
        self._on_solved, self._on_touched = self._columns.createVecs()
        self._b, self._x = self._matrix.createVecs()
        self._diagonal = A.getDiagonal().array_r[self._prescribed]
        self._compute_factors()
        if self._options is STRIP_FACTORS and not self._is_accurate():
            self._options = STRIP_PIVOTS
            self._compute_factors()

    def forget_pattern(self) -> None:
        """Begin anew for the next matrix, whose pattern differs."""
        for of_pattern in (self._factors, self._matrix, self._columns):
            if of_pattern is not None:
                of_pattern.destroy()
        self._factors = self._matrix = self._columns = None
        if self._nonzeros is not None:
            self._nonzeros.forget()

    def _compute_factors(self) -> None:
        """Factor the matrix, without pivoting in the order of elimination of the last one."""
        if self._factors is None or self._options is STRIP_PIVOTS:
            if self._factors is not None:
                self._factors.destroy()
            self._factors = PETSc.PC().create(self._comm)
            self._factors.setOptionsPrefix(self._prefix)
        with options_added(self._prefix, self._options):
            self._factors.setFromOptions()
            matrix = self._matrix if self._nonzeros is None else self._nonzeros.of(self._matrix)
            self._factors.setOperators(matrix)
            self._factors.setUp()

    def _is_accurate(self) -> bool:
        """Whether the residual of one solution is as small as without growth of the pivots."""
        self._b.set(1.0)
        self._factors.apply(self._b, self._x)
        size = self._b.norm()
        self._matrix.mult(self._x, self._b)
        self._b.shift(-1.0)
        return bool(self._b.norm() <= WITHOUT_PIVOTING * size)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec, *, transpose: bool = False) -> None:
        """Solve for the rows of the strip and for prescribed dofs; other values are zero.

        Args:
            b: Right-hand side of the whole matrix.
            x: The solution; changed.
            transpose: Whether to solve with the transposed factors.
        """
        x.set(0.0)
        x.array[self._prescribed] = b.array_r[self._prescribed] / self._diagonal
        self._b.array[:] = b.array_r[self._rows]
        apply = self._factors.applyTranspose if transpose else self._factors.apply
        apply(self._b, self._x)
        x.array[self._rows] = self._x.array_r

    def subtract_product(self, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Subtract A x from ``b`` for a solution ``x`` of ``solve``.

        Args:
            x: The solution, zero outside of the strip and of prescribed dofs.
            b: Vector of the whole matrix; changed.
        """
        self._on_solved.array[:] = x.array_r[self._solved]
        self._columns.mult(self._on_solved, self._on_touched)
        b.array[self._touched] -= self._on_touched.array_r

    def subtract_transposed(self, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Subtract A^T x from ``b`` in the rows that ``solve`` uses.

        Args:
            x: Any vector.
            b: Vector of the whole matrix; changed.
        """
        self._on_touched.array[:] = x.array_r[self._touched]
        self._columns.multTranspose(self._on_touched, self._on_solved)
        b.array[self._solved] -= self._on_solved.array_r

    def _numbers_in(self, A: PETSc.Mat, rows: Indices) -> PETSc.IS:
        """Global numbers of local rows."""
        first, _ = A.getOwnershipRange()
        return PETSc.IS().createGeneral((rows + first).astype(PETSc.IntType), self._comm)


def dofs_near(bulk: Bulk, surfaces: Sequence[Surface], layers: int) -> Indices:
    """Owned dofs, shape (n,), within ``layers`` of cells of the surfaces (collective)."""
    return _with_neighbours(bulk, dofs_of(surfaces), layers)


def dofs_of(surfaces: Sequence[Surface]) -> Indices:
    """Owned dofs of the nodes of surfaces, shape (n,) (local)."""
    dofs = [np.empty(0, np.int64), *(surface.local_dofs.ravel() for surface in surfaces)]
    return np.unique(np.concatenate(dofs))


def _with_neighbours(bulk: Bulk, dofs: Indices, layers: int) -> Indices:
    """Owned dofs, shape (n,), within ``layers`` of cells of owned ones (collective)."""
    found = PETSc.IS().createGeneral((dofs + bulk.first).astype(PETSc.IntType), PETSc.COMM_SELF)
    bulk.K.increaseOverlap(found, layers)
    everywhere = np.unique(np.concatenate(bulk.comm.allgather(found.indices)))
    mine = (everywhere >= bulk.first) & (everywhere < bulk.first + bulk.num_owned)
    return everywhere[mine].astype(np.int64) - bulk.first
