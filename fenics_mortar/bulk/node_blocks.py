# SPDX-License-Identifier: MIT
"""A matrix stored in rows and also in blocks of the two dofs of a node.

PETSc assembles and factors blocks in about half of the time needed with rows; all other operations
use rows. Values are copied by their positions, which are found once for each pattern; a copy takes
a hundredth of the time of an assembly. ``NodeBlocks`` has both forms on one rank.

Insertion into a matrix of one rank takes two thirds of that into a distributed one. Each rank
therefore assembles its cells in blocks of all its local nodes, in the order of their global
numbers: the rows of ghosts are stored one after another for each owner. They are sent to the
owners, which add them. See ``CellBlocks``.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from fenics_mortar.kernels import blocks as kernels
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.compat import COMM, INT, POINTER, petsc_function

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

    They are entries of a PETSc matrix in compressed rows, in PETSc's own memory. On several ranks
    PETSc stores the owned rows as two matrices: columns of this rank, and columns of other ranks.
    petsc4py gives access to copies only.

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
            kernel: One of ``kernels.blocks``.
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


class NodeBlocks:
    """The same matrix in blocks and in rows, on one rank.

    Args:
        rows: The matrix in rows.

    Attributes:
        blocks: The matrix in blocks that contain all entries; zero before the first copy.
    """

    def __init__(self, rows: PETSc.Mat) -> None:
        self.blocks, self._rows, self._pattern = _in_blocks(rows), rows, _pattern_of(rows)
        (self._in_blocks,), (self._in_rows,) = local_csr(self.blocks), local_csr(rows)
        of_blocks = self._in_blocks
        self._indices = _find_in_blocks(self._in_rows, of_blocks.starts, of_blocks.columns)
        self._copied = -1  # state of the rows, as PETSc counts it

    def fit(self, rows: PETSc.Mat) -> bool:
        """Whether ``rows`` is the matrix in rows, with an unchanged number of entries."""
        return bool(rows == self._rows and _pattern_of(rows) == self._pattern)

    def copy_to_blocks(self, rows: PETSc.Mat) -> bool:
        """Copy the values from ``rows`` to the blocks.

        Without effect if the rows have not changed since the last copy, so that factors of the
        blocks remain valid.

        Returns:
            Whether ``rows`` fit, see ``fit``; nothing is copied otherwise.
        """
        if not self.fit(rows):
            return False
        if self._rows.stateGet() != self._copied:
            self._in_rows.copy_to(self._in_blocks, self._indices, kernels.copy_to_blocks)
            self.blocks.stateIncrease()
            self._copied = self._rows.stateGet()
        return True


class CellBlocks:
    """Blocks of the local nodes, and their positions in the rows of the tangent.

    The constructor is collective.

    Args:
        rows: An assembled matrix with two rows per node and the layout of a dolfinx space, whose
            pattern contains all couplings of nodes.

    Attributes:
        blocks: A matrix on this rank only, to be assembled with the dofs of the space.
    """

    def __init__(self, rows: PETSc.Mat) -> None:
        self._comm: MPI.Comm = rows.comm.tompi4py()
        local = rows.getLGMap()[0].getBlockIndices()  # global numbers of the local nodes
        order = np.argsort(local)
        self._nodes = local[order]
        self.blocks = _matrix_of(self._nodes, order, rows)
        (self._stored,) = local_csr(self.blocks)
        rank, bounds = self._comm.rank, rows.getOwnershipRanges() // 2
        of_ranks = np.searchsorted(self._nodes, bounds)  # first local node of each rank
        own = slice(of_ranks[rank], of_ranks[rank + 1])
        self._first = bounds[rank]
        starts = self._stored.starts
        self._own = replace(
            self._stored, starts=starts[own.start : own.stop + 1], numbers=self._nodes
        )
        self._own_blocks = slice(starts[own.start], starts[own.stop])
        self._sent = np.diff(starts[of_ranks].astype(np.int64))  # blocks, to each rank
        self._sent[rank] = 0
        self._received = np.empty_like(self._sent)
        self._comm.Alltoall(self._sent, self._received)
        self._received_rows = self._exchange(np.repeat(self._nodes, np.diff(starts)), 1)
        self._received_columns = self._exchange(self._nodes[self._stored.columns], 1)
        self._match(rows)

    def _exchange(self, values: npt.NDArray, k: int) -> npt.NDArray:
        """Send the values of blocks in rows of ghosts to the owners (collective).

        Args:
            values: Of all blocks, shape (k blocks,).
            k: Number of values of a block.

        Returns:
            Values from all ranks, shape (k blocks,).
        """
        own = self._own_blocks
        values = np.concatenate([values[: k * own.start], values[k * own.stop :]])
        received = np.empty(k * self._received.sum(), values.dtype)
        self._comm.Alltoallv([values, k * self._sent], [received, k * self._received])
        return received

    def _match(self, rows: PETSc.Mat) -> None:
        """Find the entries of the rows among the own blocks, and the received blocks among them."""
        self._rows, self._pattern = rows, _pattern_of(rows)
        self._parts = []
        for part in local_csr(rows):
            first = self._first if part.numbers is None else 0
            positions = _find_in_blocks(part, self._own.starts, self._own.numbered() - first)
            entries = np.empty(4 * self._received_rows.size, np.int64)
            blocks = self._received_rows - self._first, self._received_columns - first
            if entries.size:
                kernels.find_entries(part.starts, part.numbered(), *blocks, entries)
            self._parts.append((part, positions, entries))

    def copy_to(self, rows: PETSc.Mat) -> None:
        """Fill ``rows`` with sums over ranks, with zeros outside of all blocks (collective).

        Args:
            rows: The matrix of the constructor, or one with the same layout and another pattern.
        """
        if rows != self._rows or _pattern_of(rows) != self._pattern:
            self._match(rows)
        for part, positions, _ in self._parts:
            self._own.copy_to(part, positions, kernels.copy_to_rows)
        if self._comm.size > 1:
            received = self._exchange(self._stored.values(), 4)
            for part, _, entries in self._parts:
                kernels.add_values(received, entries, part.values(change=True))
        rows.stateIncrease()


def _matrix_of(nodes: npt.NDArray, order: Indices, rows: PETSc.Mat) -> PETSc.Mat:
    """Blocks of the couplings of local nodes, assembled with their local numbers (collective).

    Args:
        nodes: Global numbers of the local nodes, ascending.
        order: Their local numbers.
        rows: Matrix that contains the couplings.
    """
    chosen = PETSc.IS().createBlock(2, nodes, comm=PETSc.COMM_SELF)
    (couplings,) = rows.createSubMatrices(chosen, chosen)
    blocks = _in_blocks(couplings)
    couplings.destroy()
    places = np.empty_like(nodes)
    places[order] = np.arange(len(order))
    numbers = PETSc.LGMap().create(places, bsize=2, comm=PETSc.COMM_SELF)
    blocks.setLGMap(numbers, numbers)
    return blocks


def _find_in_blocks(rows: LocalRows, starts: npt.NDArray, columns: npt.NDArray) -> Indices:
    """Positions of the entries (entries,) among the values of blocks, -1 outside of all (local).

    Args:
        rows: Rows of a matrix, in pairs.
        starts: Blocks of rows 2 i and 2 i + 1 are starts[i]:starts[i + 1].
        columns: Columns of the blocks over two, ascending in each row.
    """
    indices = np.empty(rows.columns.size, np.int64)
    kernels.find_indices(rows.starts, rows.numbered(), starts, columns, indices)
    return indices


def come_in_pairs(rows: PETSc.Mat) -> bool:
    """Whether the rows of a matrix of type AIJ alternate between the two dofs of each node."""
    return rows.getType() in ("seqaij", "mpiaij") and rows.getBlockSize() == 2


def _in_blocks(rows: PETSc.Mat) -> PETSc.Mat:
    """Blocks of zeros that contain all entries of a matrix on one rank, with rows in pairs."""
    starts, columns = rows.getRowIJ()
    block_columns = np.empty_like(columns)
    block_starts = np.empty(len(starts) // 2 + 1, starts.dtype)
    kernels.find_blocks(starts, columns, block_starts, block_columns)
    csr = block_starts, block_columns[: block_starts[-1]]
    return PETSc.Mat().createBAIJ(rows.getSize(), 2, csr=csr, comm=rows.comm)


def _pattern_of(rows: PETSc.Mat) -> tuple[float, list[int]]:
    """Number of entries of a matrix on this rank; on several ranks, handles of its parts (local).

    An extension of the pattern replaces the parts even if it adds nothing.
    """
    handles = stored_parts(rows)[0] if rows.comm.size > 1 else []
    return float(rows.getInfo(PETSc.Mat.InfoType.LOCAL)["nz_used"]), handles
