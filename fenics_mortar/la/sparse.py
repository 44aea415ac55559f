# SPDX-License-Identifier: MIT
"""Sparse matrices of PETSc: sums of blocks and rows, Schur complements, bordered systems.

Blocks and rows may be given on any rank for any row. ``BlockMatrix`` makes a matrix from blocks,
``add_blocks`` adds them to an existing pattern, as in the plane, and ``with_rows`` adds summed rows
as a new matrix, as in space. ``leave`` and ``schur_complement`` factor a part of a matrix by MUMPS;
``solve_bordered`` solves a factored system with a few more unknowns.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, Self

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from fenics_mortar.bulk.node_blocks import CSR, from_local_csr, local_csr
from fenics_mortar.interface.mortar import Block, entries_of
from fenics_mortar.kernels.blocks import add_rows, pack_product, pack_rows, sum_rows
from fenics_mortar.utils.arrays import SUM_ROUNDING, Array, Flags, Indices
from fenics_mortar.utils.compat import POINTER, petsc_function
from fenics_mortar.utils.errors import MortarError, raise_together

_set_pattern = petsc_function("MatSetPreallocationCOO", POINTER, ctypes.c_ssize_t, POINTER, POINTER)
_set_values = petsc_function("MatSetValuesCOO", POINTER, POINTER, ctypes.c_int)
_set_schur_rows = petsc_function("MatFactorSetSchurIS", POINTER, POINTER)
_create_schur = petsc_function("MatFactorCreateSchurComplement", *3 * [POINTER])
_get_array = petsc_function("MatDenseGetArrayRead", POINTER, POINTER)
_restore_array = petsc_function("MatDenseRestoreArrayRead", POINTER, POINTER)
_destroy = petsc_function("MatDestroy", POINTER)

# Rows, columns and values of entries, shape (n,) each.
Entries = tuple[npt.NDArray, npt.NDArray, npt.NDArray]


class BlockMatrix:
    """A matrix that is made from blocks, each time anew.

    Any rank may add to any row; duplicates are summed and negative indices are dropped. PETSc
    preallocates in coordinate form; without preallocation PETSc 3.18 takes minutes instead of
    milliseconds.

    Args:
        comm: Communicator (all methods are collective).
        rows: Number of rows owned by this rank.
        columns: Number of columns owned by this rank.
        block_size: Block size of PETSc's matrix.

    Attributes:
        mat: The matrix, after ``assemble``.
    """

    def __init__(self, comm: MPI.Comm, rows: int, columns: int, block_size: int = 1) -> None:
        self._comm = comm
        self._sizes = ((rows, None), (columns, None))
        self._block_size = block_size
        self.mat: Any = None

    def assemble(self, blocks: Iterable[Block]) -> PETSc.Mat:
        """Sum the blocks into the matrix and return it."""
        return self.assemble_entries(*flatten(blocks))

    def assemble_entries(self, i: npt.NDArray, j: npt.NDArray, v: npt.NDArray) -> PETSc.Mat:
        """Sum entries into the matrix and return it.

        Args:
            i: Rows, shape (entries,), of PETSc's type of integers; overwritten by PETSc.
            j: Columns, of that shape and type; overwritten.
            v: Values, shape (entries,).
        """
        if self.mat is not None:
            self.mat.destroy()
        self.mat = PETSc.Mat().create(self._comm)
        self.mat.setSizes(self._sizes)
        self.mat.setType(PETSc.Mat.Type.AIJ)
        self.mat.setBlockSize(self._block_size)
        _set_pattern(self.mat.handle, i.size, i.ctypes.data, j.ctypes.data)
        _set_values(self.mat.handle, v.ctypes.data, 1)
        return self.mat


class Product(NamedTuple):
    """Product of two sparse matrices, in some rows of a large one.

    Attributes:
        entries: Entries of the first matrix in the columns that correspond to rows of the second
            one on this rank; columns are local numbers.
        csr: Starts, columns and values of the rows of the second matrix on this rank.
        numbers: Number in the large matrix of each row of the product.
    """

    entries: Entries
    csr: tuple[npt.NDArray, npt.NDArray, npt.NDArray]
    numbers: Indices


class SomeRows:
    """A subset of the rows of a large matrix as the rows of a small one; methods are local.

    Args:
        rows: Numbers of the rows, replicated; duplicates are allowed.
        first: First row of the large matrix owned by this rank.
        num_owned: Number of rows of the large matrix owned by this rank.

    Attributes:
        rows: Numbers of the rows without duplicates, replicated, ascending.
        numbers: Numbers in the small matrix of the rows owned by this rank.
        owned: Numbers of these rows in the large matrix, ascending.
        local: ``owned`` as local numbers.
    """

    def __init__(self, rows: Indices, first: int, num_owned: int) -> None:
        self.rows = np.unique(rows)
        start, end = np.searchsorted(self.rows, (first, first + num_owned))
        self.numbers: Indices = np.arange(start, end)
        self.owned: Indices = self.rows[start:end]
        self.local: Indices = self.owned - first

    def number(self, rows: Indices) -> Indices:
        """Numbers of ``rows`` (n,) in the small matrix, shape (n,); -1 stays -1 (local)."""
        return np.where(rows >= 0, np.searchsorted(self.rows, rows), -1)

    def renumbered(self, blocks: Iterable[Block]) -> list[Block]:
        """Blocks of the large matrix with the row numbers of the small one."""
        return [Block(self.number(rows), columns, values) for rows, columns, values in blocks]

    def in_submatrix(self, blocks: Iterable[Block]) -> list[Block]:
        """Blocks in the principal submatrix of these rows, which include all of the blocks."""
        return [Block(self.number(i), self.number(j), values) for i, j, values in blocks]

    def starts(self, starts: npt.NDArray, num_owned: int) -> npt.NDArray:
        """Starts of the rows of a large matrix whose entries are those of the small one (local)."""
        sizes = np.zeros(num_owned + 1, PETSc.IntType)
        sizes[self.local + 1] = np.diff(starts)
        return np.cumsum(sizes, dtype=PETSc.IntType)

    def zeros(self, small: PETSc.Mat, num_owned: int) -> PETSc.Mat:
        """Large matrix of ``num_owned`` rows with zeros at the entries of the small one."""
        starts, columns, values = small.getValuesCSR()
        csr = self.starts(starts, num_owned), columns, np.zeros_like(values)
        return PETSc.Mat().createAIJ(((num_owned, None),) * 2, csr=csr, comm=small.comm)


# Numbers of rows in any order, starts (rows + 1,), columns and values (entries,) of their entries.
Packed = tuple[npt.NDArray, npt.NDArray, npt.NDArray, npt.NDArray]


def packed(blocks: Iterable[Block], product: Product | None, num_columns: int) -> Packed:
    """Rows of blocks and of a product of sparse matrices (local).

    Negative indices and zeros of blocks are dropped.

    Args:
        blocks: The blocks.
        product: The product.
        num_columns: Number of columns of the product.
    """
    given, num_rows, num_entries = list(blocks), 0, 0
    for block in given:
        num_rows, num_entries = num_rows + block.rows.size, num_entries + block.values.size
    if product is not None:
        num_rows += product.numbers.size
        num_entries += int(np.diff(product.csr[0])[product.entries[1]].sum())
    rows, starts = np.empty(num_rows, PETSc.IntType), np.empty(num_rows + 1, PETSc.IntType)
    columns, values = np.empty(num_entries, PETSc.IntType), np.empty(num_entries)
    counts = np.zeros(2, np.int64)
    starts[0] = 0
    found = counts, rows, starts, columns, values
    for block in given:
        pack_rows(*map(np.ascontiguousarray, block), *found)
    if product is not None:
        pack_product(*product.entries, *product.csr, product.numbers, num_columns, *found)
    row, entry = counts
    return rows[:row], starts[: row + 1], columns[:entry], values[:entry]


def add_blocks(matrix: PETSc.Mat, blocks: Iterable[Block], product: Product | None = None) -> None:
    """Add blocks and a product of sparse matrices to existing entries of a matrix (collective).

    Any rank may add to any row; negative indices and zeros of blocks are dropped. The cost does
    not depend on the number of entries of the matrix.

    Args:
        matrix: The matrix, changed in place.
        blocks: The blocks.
        product: The product.
    """
    rows, starts, columns, values = packed(blocks, product, matrix.getSize()[1])
    matrix.setValuesIJV(starts, columns, values, PETSc.InsertMode.ADD_VALUES, rows)
    matrix.assemble()


def summed_rows(comm: MPI.Comm, bounds: npt.NDArray, parts: Sequence[Packed]) -> CSR:
    """Sum rows that any rank may have for any rank (collective).

    Args:
        comm: Communicator.
        bounds: First row of each rank, and the number of rows and columns, shape (ranks + 1,).
        parts: The rows.

    Returns:
        The rows of this rank, all with a diagonal entry that have entries; columns ascend.
    """
    mine = [part for some in parts for part in _sent_to_owners(comm, bounds, some)]
    rows, columns, values = (np.concatenate([part[k] for part in mine]) for k in (0, 2, 3))
    sizes = np.concatenate([np.diff(part[1]) for part in mine])
    starts = np.zeros(rows.size + 1, np.int64)
    np.cumsum(sizes, out=starts[1:])
    first, end = bounds[comm.rank : comm.rank + 2].tolist()
    sum_starts = np.empty(end - first + 1, PETSc.IntType)
    most = values.size + rows.size
    sum_columns, sum_values = np.empty(most, PETSc.IntType), np.empty(most)
    sum_rows(
        rows, starts, columns, values, first, int(bounds[-1]), sum_starts, sum_columns, sum_values
    )
    count = sum_starts[-1]
    return sum_starts, sum_columns[:count].copy(), sum_values[:count].copy()


def _sent_to_owners(comm: MPI.Comm, bounds: npt.NDArray, rows: Packed) -> list[Packed]:
    """Rows of this rank, from all ranks in their order (collective)."""
    if comm.size == 1:
        return [rows]
    numbers, starts, columns, values = rows
    owners, sizes = np.searchsorted(bounds, numbers, side="right") - 1, np.diff(starts)
    of_entries, sent = np.repeat(owners, sizes), list[Packed | None]()
    for rank in range(comm.size):
        here, its = owners == rank, of_entries == rank
        begins = np.append(0, np.cumsum(sizes[here]))
        sent.append((numbers[here], begins, columns[its], values[its]))
    mine, sent[comm.rank] = sent[comm.rank], None  # by far the most, is not sent
    received = comm.alltoall(sent)
    received[comm.rank] = mine
    return received


def packed_rows(csr: CSR, first: int) -> Packed:
    """Rows with entries, of those from number ``first`` on (local)."""
    starts, columns, values = csr
    some = np.flatnonzero(np.diff(starts))
    return some + first, np.append(starts[some], starts[-1]), columns, values


def with_rows(matrix: PETSc.Mat, csr: CSR) -> PETSc.Mat:
    """The sum of a matrix and of rows of this rank, as a new matrix (collective).

    Its pattern has no more than the entries of both, so that nothing need be known beforehand of
    what may come into contact.

    In the plane the pattern of a system has zeros for all that may come into contact in a load
    step, so that an elimination order serves many matrices. In space these were most of the
    entries, 3 of 3.5 million of 11,000 unknowns; on two ranks, making the pattern took half of a
    solve with 53,000 unknowns, and a third of the memory. There the rows of contact of the present
    state are summed and added to those of the bodies, as a new matrix.

    Args:
        matrix: A square matrix of type AIJ.
        csr: Starts, columns and values of all owned rows, see ``summed_rows``.
    """
    bounds = np.array(matrix.getOwnershipRange())
    sums = []
    for part in local_csr(matrix):
        size = part.columns.size + csr[1].size
        found = np.empty_like(csr[0]), np.empty(size, PETSc.IntType), np.empty(size)
        outside = part.numbers is not None
        columns = part.numbered().astype(PETSc.IntType, copy=False)
        add_rows((part.starts, columns, part.values()), csr, bounds, outside, found)
        sums.append((found[0], found[1][: found[0][-1]], found[2][: found[0][-1]]))
    total = from_local_csr(matrix.comm.tompi4py(), sums[0], sums[-1])
    total.setBlockSize(matrix.getBlockSize())
    return total


def flatten(blocks: Iterable[Block]) -> Entries:
    """Row, column and value of every entry of the blocks, (entries,) each."""
    parts = [entries_of(block) for block in blocks]
    if not parts:
        return np.empty(0, PETSc.IntType), np.empty(0, PETSc.IntType), np.empty(0)
    i, j, v = map(np.concatenate, zip(*parts, strict=True))
    return i.astype(PETSc.IntType), j.astype(PETSc.IntType), v.astype(np.float64)


def leave(factor: PETSc.Mat, rows: Indices) -> None:
    """Exclude rows and columns from a factorization by MUMPS before it is computed (collective).

    The ``rows``, shape (n,), are replicated; PETSc returns their Schur complement on rank 0 only.
    """
    mine = rows if factor.comm.rank == 0 else rows[:0]
    numbers = PETSc.IS().createGeneral(mine.astype(PETSc.IntType), factor.comm)
    _set_schur_rows(factor.handle, numbers.handle)


def schur_complement(factor: PETSc.Mat, num_left: int) -> Array:
    """Schur complement of a symmetric matrix on the excluded rows, in their order (collective).

    Args:
        factor: The factored matrix.
        num_left: Number of excluded rows.

    Returns:
        Shape (num_left, num_left) on rank 0, (0, 0) on other ranks [unit of the matrix].
    """
    handle, status = ctypes.c_void_p(), ctypes.c_int()
    entries = ctypes.POINTER(ctypes.c_double)()
    _create_schur(factor.handle, ctypes.byref(handle), ctypes.byref(status))
    _get_array(handle, ctypes.byref(entries))
    here = num_left > 0 and factor.comm.rank == 0
    shape = (num_left, num_left)
    values = np.ctypeslib.as_array(entries, shape).copy() if here else np.empty((0, 0))
    _restore_array(handle, ctypes.byref(entries))
    _destroy(ctypes.byref(handle))
    return values


def is_indefinite(factor: PETSc.Mat) -> bool:
    """Whether a symmetric matrix factored by MUMPS has negative pivots (collective)."""
    return bool(factor.getMumpsInfog(12))


def is_symmetric(K: PETSc.Mat) -> bool:
    """Whether x . K y = y . K x for two irregular vectors (collective)."""
    x, y = K.createVecs()
    Kx, Ky = x.duplicate(), x.duplicate()
    start = K.getOwnershipRange()[0]
    numbers = np.arange(start, start + x.getLocalSize(), dtype=float)
    x.array[:], y.array[:] = np.sin(numbers**2), np.cos(1.0 + numbers**2)
    K.mult(x, Kx)
    K.mult(y, Ky)
    return bool(abs(x.dot(Ky) - y.dot(Kx)) <= SUM_ROUNDING * x.norm() * Ky.norm())


class Border(NamedTuple):
    """C, G and E for m additional unknowns and n owned unknowns of A.

    Attributes:
        columns: C transposed, shape (m, n).
        rows: G, shape (m, n).
        corner: E, shape (m, m), equal on all ranks.
    """

    columns: Array
    rows: Array
    corner: Array

    @classmethod
    def empty(cls, system: Any, count: int) -> Self:
        """A border of zeros for ``count`` unknowns of a ``LinearSystem`` (local)."""
        columns, rows = np.zeros((2, count, system.bulk.num_owned + system.num_z_dofs))
        return cls(columns, rows, np.zeros((count, count)))

    @property
    def transposed(self) -> Self:
        """The border of the transposed system."""
        return type(self)(self.rows, self.columns, self.corner.T)

    def scaled(self, units: Array) -> Self:
        """The border for unknowns q / ``units`` and equations times ``units`` (m,)."""
        each = units[:, None]
        return type(self)(each * self.columns, each * self.rows, each * self.corner * units)

    @classmethod
    def joined(cls, parts: Sequence[Border]) -> Self:
        """The border of the unknowns of all parts."""
        columns, rows, corners = zip(*parts, strict=True)
        return cls(np.vstack(columns), np.vstack(rows), block_diag(*corners))

    def restricted_to(self, some: Flags) -> Self:
        """The border of a subset of the unknowns and their equations; ``some``: (m,), bool."""
        return type(self)(self.columns[some], self.rows[some], self.corner[np.ix_(some, some)])


def solve_bordered(
    solve: Callable[[Array], Array], border: Border, x: Array, c: Array, comm: MPI.Comm
) -> tuple[Array, Array]:
    """Solve a bordered system (collective).

    There are a few unknowns q in addition to those of a large, factored system A:

        A x + C q = b
        G x + E q = c

    Block elimination needs a solve with A for each column of C, and a small dense system for q. The
    transposed system has the same form, with the rows of G as columns.

    Args:
        solve: Solves A x = b; takes and returns owned values, shape (n,) (collective).
        border: C, G and E.
        x: Solution of A x = b without the border, owned values, shape (n,).
        c: Right-hand side of the m additional equations, shape (m,), replicated.
        comm: Communicator.

    Returns:
        x, shape (n,), and q, shape (m,), equal on all ranks [units of the system].

    Raises:
        MortarError: On all ranks, if A or the small dense system is singular.
    """
    if not c.size:
        return x, np.zeros(0)
    solutions = np.array([solve(column) for column in border.columns])
    products = comm.allreduce(border.rows @ np.vstack([x, solutions]).T)
    q, error = np.empty_like(c), None
    try:
        q = np.linalg.solve(border.corner - products[:, 1:], c - products[:, 0])
    except np.linalg.LinAlgError as singular:
        error = MortarError(f"the balance of the driven motions is singular: {singular}")
    raise_together(comm, error)
    comm.Bcast(q)
    return x - q @ solutions, q
