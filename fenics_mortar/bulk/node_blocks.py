# SPDX-License-Identifier: MIT
"""A matrix stored in rows and also in blocks of the two dofs of a node, on one rank.

PETSc assembles and factors blocks in about half of the time needed with rows; all other operations
use rows. Values are copied by their positions, which are found once for each pattern; a copy takes
a hundredth of the time of an assembly.
"""

from __future__ import annotations

import ctypes

from petsc4py import PETSc

import numpy as np

from fenics_mortar.kernels import node_blocks
from fenics_mortar.utils.arrays import Array

_petsc = ctypes.CDLL(PETSc.__file__)
# Functions by type of the matrix to get and restore its values, which petsc4py does not have.
_VALUES = {
    kind: (getattr(_petsc, f"Mat{name}GetArray"), getattr(_petsc, f"Mat{name}RestoreArray"))
    for kind, name in (("seqaij", "SeqAIJ"), ("seqbaij", "SeqBAIJ"))
}
for _functions in _VALUES.values():
    for _function in _functions:
        _function.argtypes = [ctypes.c_void_p, ctypes.c_void_p]


class NodeBlocks:
    """The same matrix in blocks and in rows; all methods are local, for one rank.

    Args:
        blocks: The matrix in blocks of two rows and columns.
        rows: The matrix in rows, of which some entries may be outside of all blocks.

    Attributes:
        blocks: The matrix in blocks.
    """

    def __init__(self, blocks: PETSc.Mat, rows: PETSc.Mat) -> None:
        self.blocks, self._rows, self._num_used = blocks, rows, _num_used(rows)
        starts, columns = rows.getRowIJ()
        self._indices = np.empty(columns.size, np.int64)
        block_starts, block_columns = blocks.getRowIJ(compressed=True)
        node_blocks.find_indices(starts, columns, block_starts, block_columns, self._indices)
        self._of_blocks = ctypes.c_double * (4 * block_columns.size)
        self._of_rows = ctypes.c_double * columns.size
        self._copied = -1  # state of the rows, as PETSc counts it

    def fit(self, rows: PETSc.Mat) -> bool:
        """Whether ``rows`` is the matrix in rows, with an unchanged number of entries."""
        return bool(rows == self._rows and _num_used(rows) == self._num_used)

    def copy_to_rows(self, rows: PETSc.Mat) -> bool:
        """Copy the values from the blocks to ``rows``, with zeros outside of all blocks.

        Returns:
            Whether ``rows`` fit, see ``fit``; nothing is copied otherwise.
        """
        if not self.fit(rows):
            return False
        values = _values(self.blocks, self._of_blocks), _values(self._rows, self._of_rows)
        node_blocks.copy_to_rows(values[0], self._indices, values[1])
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
            values = _values(self.blocks, self._of_blocks), _values(self._rows, self._of_rows)
            node_blocks.copy_to_blocks(values[1], self._indices, values[0])
            self.blocks.stateIncrease()
            self._copied = self._rows.stateGet()
        return True


def _values(matrix: PETSc.Mat, kind: type[ctypes.Array[ctypes.c_double]]) -> Array:
    """Values of a matrix in PETSc's memory, as an array of the type ``kind``, shape (entries,).

    Valid only until the next operation: PETSc may move them even if the pattern is unchanged.
    """
    get, restore = _VALUES[matrix.getType()]
    address = ctypes.c_void_p()
    get(matrix.handle, ctypes.byref(address))
    values = np.ctypeslib.as_array(kind.from_address(address.value or 0))
    restore(matrix.handle, ctypes.byref(address))
    return values


def come_in_pairs(rows: PETSc.Mat) -> bool:
    """Whether the rows of a matrix on one rank alternate between the two dofs of each node."""
    return bool(rows.getType() == "seqaij" and rows.getBlockSize() == 2)


def in_blocks(rows: PETSc.Mat) -> NodeBlocks:
    """A matrix with such rows, copied into blocks that contain all its entries."""
    starts, _ = rows.getRowIJ()
    pairs = np.diff(starts).reshape(-1, 2)
    counts = np.minimum(pairs.sum(axis=1), len(pairs))  # at most; PETSc drops the rest
    blocks = PETSc.Mat().createBAIJ(
        rows.getSize(), 2, nnz=counts.astype(PETSc.IntType), comm=rows.comm
    )
    rows.convert(PETSc.Mat.Type.BAIJ, blocks)
    return NodeBlocks(blocks, rows)


def _num_used(rows: PETSc.Mat) -> float:
    """Number of entries of a matrix (local)."""
    return float(rows.getInfo()["nz_used"])
