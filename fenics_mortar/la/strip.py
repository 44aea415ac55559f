# SPDX-License-Identifier: MIT
"""Factorization of the rows and columns of a matrix in a strip along the contact surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.interface import Interface
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.utils.arrays import Indices

# Layers of cells of the strip on either side of a contact surface.
LAYERS = 2


class Strip:
    """Factored rows and columns of the dofs near contact surfaces; methods are collective.

    Args:
        bulk: The bodies; K without contact terms.
        contacts: The contacts.
        prefix: Prefix of PETSc's options.
        multipliers: Number of rows of multipliers after those of dofs; all are in the strip.

    Attributes:
        num_rows: Rows of the strip, summed over all ranks.
    """

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Interface], prefix: str, multipliers: int
    ) -> None:
        self._prefix, self._prescribed, self._comm = prefix, bulk.prescribed_dofs, bulk.comm
        rows = np.arange(bulk.num_owned, bulk.num_owned + multipliers)
        surfaces = [surface for c in contacts for surface in (c.slave, c.master)]
        self._rows = np.append(dofs_near(bulk, surfaces, LAYERS), rows)
        self.num_rows = bulk.comm.allreduce(self._rows.size)
        self._matrix: Any = None
        self._factors: Any = None

    def factor(self, A: PETSc.Mat) -> None:
        """Factor the strip of ``A``, whose pattern may have changed."""
        if self._matrix is not None:
            self._factors.destroy()
            self._matrix.destroy()
        rows = (self._rows + A.getOwnershipRange()[0]).astype(PETSc.IntType)
        whole = PETSc.IS().createGeneral(rows, self._comm)
        self._matrix = A.createSubMatrix(whole, whole)
        self._factors = PETSc.PC().create(self._comm)
        self._factors.setOptionsPrefix(self._prefix)
        self._factors.setFromOptions()
        self._factors.setOperators(self._matrix)
        self._factors.setUp()
        self._b, self._x = self._matrix.createVecs()
        self._diagonal = A.getDiagonal().array_r[self._prescribed]

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


def dofs_near(bulk: Bulk, surfaces: Sequence[Surface], layers: int) -> Indices:
    """Owned dofs, shape (n,), within ``layers`` of cells of the surfaces (collective)."""
    dofs = [np.empty(0, np.int64), *(s.local_dofs.ravel() + bulk.first for s in surfaces)]
    found = PETSc.IS().createGeneral(
        np.unique(np.concatenate(dofs)).astype(PETSc.IntType), PETSc.COMM_SELF
    )
    bulk.K.increaseOverlap(found, layers)
    everywhere = np.unique(np.concatenate(bulk.comm.allgather(found.indices)))
    mine = (everywhere >= bulk.first) & (everywhere < bulk.first + bulk.num_owned)
    return everywhere[mine].astype(np.int64) - bulk.first
