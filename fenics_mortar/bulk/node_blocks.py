# SPDX-License-Identifier: MIT
"""A matrix stored in rows and also in blocks of the two dofs of a node.

PETSc assembles and factors blocks in about half of the time needed with rows; all other operations
use rows. Values are copied by their positions, which are found once for each pattern; a copy takes
a hundredth of the time of an assembly.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.local_csr import LocalRows, local_csr, stored_parts
from fenics_mortar.kernels import node_blocks
from fenics_mortar.utils.arrays import Indices


class NodeBlocks:
    """The same matrix in blocks and in rows; all methods are local.

    Args:
        blocks: The matrix in blocks of two rows and columns.
        rows: The matrix in rows, of which some entries may be outside of all blocks.

    Attributes:
        blocks: The matrix in blocks.
    """

    def __init__(self, blocks: PETSc.Mat, rows: PETSc.Mat) -> None:
        self.blocks, self._rows, self._pattern = blocks, rows, _pattern(rows)
        self._parts = list(zip(local_csr(blocks), local_csr(rows), strict=True))
        self._indices = [_indices(*parts) for parts in self._parts]
        self._copied = -1  # state of the rows, as PETSc counts it

    def fit(self, rows: PETSc.Mat) -> bool:
        """Whether ``rows`` is the matrix in rows, with an unchanged number of entries."""
        return bool(rows == self._rows and _pattern(rows) == self._pattern)

    def copy_to_rows(self, rows: PETSc.Mat) -> bool:
        """Copy the values from the blocks to ``rows``, with zeros outside of all blocks.

        Returns:
            Whether ``rows`` fit, see ``fit``; nothing is copied otherwise.
        """
        if not self.fit(rows):
            return False
        for (in_blocks, in_rows), indices in zip(self._parts, self._indices, strict=True):
            in_blocks.copy_to(in_rows, indices, node_blocks.copy_to_rows)
        self._rows.stateIncrease()
        return True

    def copy_to_blocks(self, rows: PETSc.Mat) -> bool:
        """Copy the values from ``rows`` to the blocks, which contain all entries.

        Without effect if the rows have not changed since the last copy, so that factors of the
        blocks remain valid.

        Returns:
            Whether ``rows`` fit, see ``fit``; nothing is copied otherwise.
        """
        if not self.fit(rows):
            return False
        if self._rows.stateGet() != self._copied:
            for (in_blocks, in_rows), indices in zip(self._parts, self._indices, strict=True):
                in_rows.copy_to(in_blocks, indices, node_blocks.copy_to_blocks)
            self.blocks.stateIncrease()
            self._copied = self._rows.stateGet()
        return True


def _indices(blocks: LocalRows, rows: LocalRows) -> Indices:
    """Positions of the entries (entries,) among the values of the blocks, -1 outside of all."""
    indices = np.empty(rows.columns.size, np.int64)
    (starts, columns), of_blocks = ((part.starts, part.numbered()) for part in (rows, blocks))
    node_blocks.find_indices(starts, columns, *of_blocks, indices)
    return indices


def come_in_pairs(rows: PETSc.Mat) -> bool:
    """Whether the rows of a matrix of type AIJ alternate between the two dofs of each node."""
    return rows.getType() in ("seqaij", "mpiaij") and rows.getBlockSize() == 2


def in_blocks(rows: PETSc.Mat) -> NodeBlocks:
    """A matrix with such rows on one rank, copied into blocks that contain all its entries."""
    starts, _ = rows.getRowIJ()
    pairs = np.diff(starts).reshape(-1, 2)
    counts = np.minimum(pairs.sum(axis=1), len(pairs))  # at most; PETSc drops the rest
    blocks = PETSc.Mat().createBAIJ(
        rows.getSize(), 2, nnz=counts.astype(PETSc.IntType), comm=rows.comm
    )
    rows.convert(PETSc.Mat.Type.BAIJ, blocks)
    return NodeBlocks(blocks, rows)


def _pattern(rows: PETSc.Mat) -> tuple[float, list[int]]:
    """Number of entries of a matrix on this rank; on several ranks, handles of its parts (local).

    An extension of the pattern replaces the parts even if it adds nothing.
    """
    handles = stored_parts(rows)[0] if rows.comm.size > 1 else []
    return float(rows.getInfo(PETSc.Mat.InfoType.LOCAL)["nz_used"]), handles
