# SPDX-License-Identifier: MIT
"""Saddle-point system (Alg. 1): unknowns [dd, zeta] on each rank, matrix S_r A S_c.

S_c scales multipliers to forces, S_r scales the rows of prescribed dofs; see ``system``. The
transposed system S_c A^T S_r uses the same factors.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from enum import IntEnum
from itertools import chain
from typing import Any

from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.interface import Interface
from fenics_mortar.interface.mortar import Block
from fenics_mortar.la.coupling import zero_block
from fenics_mortar.la.sparse import BlockMatrix, add_blocks
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.clock import clock


class Kind(IntEnum):
    """Kinds of rows and columns: dofs of the bodies, components of multipliers."""

    DOF, MULTIPLIER = range(2)


DOF, MULTIPLIER = Kind
# Kind of rows, kind of columns, and blocks with separate numbers for each kind.
Part = tuple[Kind, Kind, Iterable[Block]]


class SaddleSystem(LinearSystem):
    """System of displacements and multipliers; any basis, also with nodes shared between pairs."""

    has_multipliers = True

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Interface], prefix: str, options: dict[str, Any]
    ) -> None:
        super().__init__(bulk, contacts, prefix, options)
        self._sizes = bulk.num_owned, self.num_z_dofs
        sizes = np.array(self.comm.allgather(self._sizes))
        self._ends = np.cumsum(sizes, axis=0)
        self._shifts = np.stack([(self._ends - sizes)[:, MULTIPLIER], self._ends[:, DOF]], axis=1)
        self._no_K = BlockMatrix(self.comm, *[self._sizes[MULTIPLIER]] * 2).assemble([])
        self._assembled: Any = None

    def _number(self, kind: Kind, numbers: Indices) -> Indices:
        """Numbers of dofs or components of multipliers in the whole matrix; -1 stays -1."""
        rank = np.searchsorted(self._ends[:, kind], numbers, side="right")
        return np.where(numbers >= 0, numbers + self._shifts[rank, kind], -1)

    def _numbered_blocks(self, parts: Iterable[Part]) -> Iterator[Block]:
        """Blocks for the whole matrix."""
        for row_kind, column_kind, blocks in parts:
            for rows, columns, values in blocks:
                yield Block(
                    self._number(row_kind, rows), self._number(column_kind, columns), values
                )

    def _parts(self) -> Iterator[Part]:
        """Blocks of K_c, B^T, C and A_z, the last three for scaled multipliers zeta."""
        pair_rows = [contact.rows.linearized() for contact in self.contacts]
        self._law_rhs = [rows.rhs for rows in pair_rows]
        self.frames = [rows.frame for rows in pair_rows]
        yield DOF, DOF, self.force_derivative()
        yield DOF, MULTIPLIER, self.force_blocks()
        yield MULTIPLIER, DOF, self.law_blocks(pair_rows)
        yield MULTIPLIER, MULTIPLIER, self.multiplier_blocks(pair_rows)

    def _zero_blocks(self) -> Iterator[Part]:
        """Zeros for possible entries of K_c, B^T and C; A_z has a fixed pattern."""
        for (contact, z_dofs), coupling in zip(self.numbered(), self._couplings, strict=True):
            own, dim = contact.slave.owned, contact.slave.dim
            dofs, multipliers = coupling.force_pattern()
            dofs = np.concatenate([dofs, contact.slave.dofs[own]]).reshape(-1, 1)
            numbers = z_dofs[np.append(multipliers, own), :dim].reshape(-1, 1)
            nodes, coupled = coupling.law_pattern()
            yield DOF, DOF, [coupling.derivative_pattern()]
            yield DOF, MULTIPLIER, [zero_block(dofs, numbers)]
            for flux in contact.fluxes:
                yield DOF, DOF, [coupling.flux_pattern(flux)]
                rows, carriers = coupling.flux_force_pattern(flux)
                yield DOF, MULTIPLIER, [zero_block(rows, z_dofs[carriers, :dim])]
            yield MULTIPLIER, DOF, [zero_block(z_dofs[nodes, :dim], coupled)]

    def blocks(self) -> tuple[PETSc.Mat, PETSc.Mat, PETSc.Mat, PETSc.Mat]:
        """K + K_c, B^T, C and A_z, the last three for scaled multipliers zeta (collective)."""
        K_c, B_T, C, A_z = (
            BlockMatrix(self.comm, self._sizes[rows], self._sizes[columns]).assemble(blocks)
            for rows, columns, blocks in self._parts()
        )
        K = self.bulk.K.copy()
        K.axpy(1.0, K_c, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return K, B_T, C, A_z

    @clock("assembly")
    def assemble(self) -> None:
        """Fill the matrix; create it again if contact exceeds its pattern (collective)."""
        nest = PETSc.Mat().createNest([[self.bulk.K, None], [None, self._no_K]], comm=self.comm)
        K = PETSc.Mat()
        nest.convert("aij", out=K)
        nest.destroy()
        if self._update_pattern():
            self._extend_pattern(K)
        self.matrix.zeroEntries()
        K.copy(self.matrix, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        K.destroy()
        add_blocks(self.matrix, self._numbered_blocks(self._parts()))
        self._scales = self.collect(self.scale(c) for c in self.contacts)
        self._prescribe_rows(self.matrix, self.matrix.getOwnershipRange()[0])

    def _extend_pattern(self, K: PETSc.Mat) -> None:
        """Create the matrix with the pattern of K and of possible contact (collective)."""
        if self._assembled is not None:
            self._assembled.destroy()
        parts = chain(self._parts(), self._zero_blocks())
        zero_blocks = BlockMatrix(self.comm, *[sum(self._sizes)] * 2)
        zero_blocks.assemble(self._numbered_blocks(parts))
        self.matrix = self._assembled = zero_blocks.mat
        self.matrix.axpy(1.0, K, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self.solver.reset_pattern()

    def step(self, distance: Array) -> Array:
        """See ``LinearSystem``; solves for the increment of zeta, which vanishes at convergence.

        The tolerance of an iterative solver is therefore relative to the residual.
        """
        size = self.bulk.num_owned
        rhs = self._scale_rows(self.join(self._newton_force(distance), self._law_rhs))
        present, product = self.matrix.createVecs()
        present.array[size:] = self.collect(c.z for c in self.contacts) / self._scales
        self.matrix.mult(present, product)
        x = self.solver.solve(self.matrix, rhs - product.array_r) + present.array_r
        present.destroy()
        product.destroy()
        return self._scale_multipliers(x)

    def solve(self, b: Array, *, transpose: bool = False) -> Array:
        """Solve with the saddle-point system; see ``LinearSystem.solve`` (collective)."""
        if transpose:
            return self._scale_rows(
                self.solver.solve(self.matrix, self._scale_multipliers(b), transpose=True)
            )
        return self._scale_multipliers(self.solver.solve(self.matrix, self._scale_rows(b)))

    def _scale_rows(self, b: Array) -> Array:
        """S_r b."""
        scaled = b.copy()
        scaled[self.bulk.prescribed_dofs] *= self._prescribed_scale
        return scaled

    def _scale_multipliers(self, x: Array) -> Array:
        """S_c x."""
        scaled = x.copy()
        scaled[self.bulk.num_owned :] *= self._scales
        return scaled
