# SPDX-License-Identifier: MIT
"""The entries of a PETSc matrix on this rank in compressed rows, in PETSc's own memory.

On several ranks PETSc stores the owned rows as two matrices: columns of this rank, and columns of
other ranks. petsc4py gives access to copies only.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.petsc import COMM, INT, POINTER, petsc_function

_row_ij = petsc_function("MatGetRowIJ", POINTER, INT, ctypes.c_int, ctypes.c_int, *4 * [POINTER])
_from_arrays = petsc_function("MatCreateMPIAIJWithSplitArrays", COMM, *4 * [INT], *7 * [POINTER])
_replace = petsc_function("MatHeaderReplace", POINTER, POINTER)
_parts = petsc_function("MatMPIAIJGetSeqAIJ", *4 * [POINTER])
# By type of the matrix: functions to get and restore its values, to read or to change them.
_READ, _CHANGE = (
    {
        kind: [
            petsc_function(f"MatSeq{kind}{verb}Array{access}", POINTER, POINTER, checked=False)
            for verb in ("Get", "Restore")
        ]
        for kind, access in accesses
    }
    for accesses in ((("AIJ", "Read"), ("BAIJ", "")), (("AIJ", ""), ("BAIJ", "")))
)

# Starts (rows + 1,), columns (entries,) and values (entries,) of rows.
CSR = tuple[npt.NDArray, npt.NDArray, Array]


@dataclass
class LocalRows:
    """Some columns of the owned rows; all methods are local.

    Attributes:
        starts: Entries, or blocks, of row i are starts[i]:starts[i + 1], shape (rows + 1,).
        columns: Their columns, or columns of blocks, in ascending order, shape (entries,): local
            numbers for columns of this rank.
        numbers: Global numbers of the columns of other ranks, ascending; ``None`` for columns of
            this rank.
    """

    starts: npt.NDArray
    columns: npt.NDArray
    numbers: npt.NDArray | None
    _handle: int
    _kind: str
    _values: Any  # type of the array of values

    def values(self, *, change: bool = False) -> Array:
        """Values in PETSc's memory [unit of the matrix]; of blocks of two by columns.

        Valid only until the next operation: PETSc may move them even if the pattern is unchanged.

        Args:
            change: Whether they will be changed.

        Returns:
            Shape (entries,), or (4 blocks,).
        """
        get, restore = (_CHANGE if change else _READ)[self._kind]
        address = POINTER()
        get(self._handle, ctypes.byref(address))
        values: Array = np.ctypeslib.as_array(self._values.from_address(address.value or 0))
        restore(self._handle, ctypes.byref(address))
        return values

    def copy_to(self, target: LocalRows, indices: Indices, kernel: Callable[..., None]) -> None:
        """Change the values of ``target`` by a kernel of these values, ``indices`` and its values.

        Args:
            target: Rows of another matrix.
            indices: Positions of entries among those of the other matrix, shape (entries,).
            kernel: One of ``kernels.node_blocks``.
        """
        kernel(self.values(), indices, target.values(change=True))

    def numbered(self) -> npt.NDArray:
        """Columns, or columns of blocks, shape (entries,): global numbers for other ranks'."""
        return self.columns if self.numbers is None else self.numbers[self.columns]


def local_csr(matrix: PETSc.Mat) -> list[LocalRows]:
    """The owned rows of a matrix of type AIJ: columns of this rank, of other ranks (local).

    Patterns are valid until the pattern of the matrix changes. On one rank there is one part, and
    the type may be BAIJ.
    """
    handles, numbers = stored_parts(matrix)
    own, *others = (_local_rows(handle, matrix.getType()[3:].upper()) for handle in handles)
    for part in others:
        part.numbers = _array(numbers, int(part.columns.max(initial=-1)) + 1, INT)
    return [own, *others]


def stored_parts(matrix: PETSc.Mat) -> tuple[list[int], Any]:
    """Handles of the parts of a matrix, and address of the others' column numbers (local)."""
    if matrix.getType().startswith("seq"):
        return [matrix.handle], None
    own, others, numbers = POINTER(), POINTER(), POINTER()
    _parts(matrix.handle, *map(ctypes.byref, (own, others, numbers)))
    return [own.value or 0, others.value or 0], numbers


def _local_rows(handle: int, kind: str) -> LocalRows:
    """The rows of a matrix on one rank, in blocks of two if its type is BAIJ."""
    blocks, size, done = int(kind == "BAIJ"), INT(), ctypes.c_int()
    starts, columns = POINTER(), POINTER()
    _row_ij(handle, 0, 0, blocks, *map(ctypes.byref, (size, starts, columns, done)))
    first = _array(starts, size.value + 1, INT)
    last = int(first[-1])
    values = ctypes.c_double * (last * (4 if blocks else 1))
    return LocalRows(first, _array(columns, last, INT), None, handle, kind, values)


def _array(address: Any, size: int, kind: Any) -> npt.NDArray:
    """Array (size,) in PETSc's memory."""
    return np.ctypeslib.as_array((kind * size).from_address(address.value or 0))


def from_local_csr(comm: MPI.Comm, own: CSR, others: CSR) -> PETSc.Mat:
    """Square matrix of type AIJ that keeps its entries in the given arrays (collective).

    Args:
        comm: Communicator.
        own: Starts (rows + 1,), columns (entries,) and values (entries,) of the owned rows in
            columns of this rank, by local numbers in ascending order.
        others: Those in columns of other ranks, by global numbers in ascending order; changed.
    """
    size = len(own[0]) - 1
    matrix = PETSc.Mat()
    if comm.size == 1:
        return matrix.createAIJWithArrays((size, size), own, comm=comm)
    new = POINTER()
    arrays = [array.ctypes.data for array in (*own, *others)]
    sizes = 2 * [size] + 2 * [comm.allreduce(size)]
    _from_arrays(MPI._handleof(comm), *sizes, *arrays, ctypes.byref(new))
    matrix.create(comm)
    _replace(matrix.handle, ctypes.byref(new))
    matrix.setAttr("arrays", (own, others))
    return matrix
