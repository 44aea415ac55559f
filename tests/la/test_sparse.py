# SPDX-License-Identifier: MIT
"""Blocks, products and small matrices of some rows, added to a large matrix: result and cost."""

from types import SimpleNamespace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from scenes import pressed_blocks

from fenics_mortar.interface.mortar import Block
from fenics_mortar.la import sparse
from fenics_mortar.la.condensed import ContactColumns
from fenics_mortar.la.sparse import BlockMatrix, Product, SomeRows, add_blocks, packed, summed_rows

comm = MPI.COMM_WORLD
OWNED = 5  # rows of each rank


def tridiagonal():
    """2 on the diagonal, -1 beside it."""
    matrix = PETSc.Mat().createAIJ(((OWNED, None), (OWNED, None)), nnz=3, comm=comm)
    first, last = matrix.getOwnershipRange()
    for row in range(first, last):
        columns = [c for c in (row - 1, row, row + 1) if 0 <= c < matrix.getSize()[1]]
        matrix.setValues([row], columns, [2.0 if c == row else -1.0 for c in columns])
    matrix.assemble()
    return matrix


def dense(matrix):
    first, last = matrix.getOwnershipRange()
    mine = matrix.getValues(range(first, last), range(matrix.getSize()[1]))
    return np.concatenate(comm.allgather(mine))


def with_rows(large, rows, blocks):
    """The rows, and the blocks in a matrix of these alone."""
    some = SomeRows(np.array(rows), large.getOwnershipRange()[0], OWNED)
    small = BlockMatrix(comm, some.local.size, OWNED)
    return some, small.assemble(some.renumbered(blocks))


def everywhere(row, column, value):
    """A block of one entry, to which each rank contributes."""
    return Block(np.array([[row]]), np.array([[column]]), np.full((1, 1, 1), value / comm.size))


def test_products_are_added_where_they_belong():
    """Each rank multiplies rows of its own; the sums are added to rows of any rank."""
    large = tridiagonal()
    before, last = dense(large), large.getSize()[0] - 1
    entries = np.array([1, 0, 1, 1]), np.array([0, 1, 1, 1]), np.array([2.0, 3.0, 5.0, 7.0])
    csr = np.array([0, 2, 4]), np.array([last - 1, last, last, 0]), np.array([1.0, 4.0, 6.0, 0.0])
    with_zero_row = np.array([last, last - 1, 0])
    add_blocks(large, [everywhere(2, 2, 5.0)], Product(entries, csr, with_zero_row))
    before[2, 2] += 5.0
    before[last, last] += comm.size * 3.0 * 6.0
    before[last - 1, [last - 1, last]] += comm.size * np.array([2.0, 2.0 * 4.0 + 12.0 * 6.0])
    assert np.abs(dense(large) - before).max() < 1e-13


@pytest.mark.parametrize("seed", range(3))
def test_elimination_multiplies_as_the_matrix_of_its_entries(seed):
    """Entries for columns of all ranks are given on any rank; duplicates are summed."""
    generator, columns = np.random.default_rng(seed), 3
    large = tridiagonal()
    some = SomeRows(np.arange(0, large.getSize()[0], 2), large.getOwnershipRange()[0], OWNED)
    shape = some.rows.size, columns * comm.size
    i, j = (generator.integers(size, size=(comm.size, 40)) for size in shape)
    v, x = generator.normal(size=(comm.size, 40)), generator.normal(size=shape[1])
    w, R = generator.normal(size=shape[0]), np.zeros(shape)
    np.add.at(R, (i, j), v)
    mine = slice(columns * comm.rank, columns * (comm.rank + 1))
    system = SimpleNamespace(comm=comm, first_z_dof=mine.start, num_z_dofs=columns)
    elimination = ContactColumns(system, some, (i[comm.rank], j[comm.rank], v[comm.rank]))
    assert np.abs(elimination.times(x[mine]) - (R @ x)[some.numbers]).max() < 1e-13
    transposed = elimination.transposed_times(w[some.numbers])
    assert np.abs(transposed - (R.T @ w)[mine]).max() < 1e-13


def test_blocks_are_added_where_they_belong():
    """Duplicates are summed, negative numbers and blocks of zeros left out; any rank, any row."""
    large = tridiagonal()
    last = large.getSize()[0] - 1
    before = dense(large)
    square = Block(np.array([[0, -1, 1]]), np.array([[1, 0]]), np.arange(6.0).reshape(1, 3, 2))
    left_out = everywhere(last, -1, 7.0), everywhere(0, last, 0.0)
    add_blocks(large, [everywhere(last, last - 1, 3.0), *[square] * 2, *left_out])
    before[last, last - 1] += 3.0
    before[:2, [1, 0]] += 2.0 * comm.size * np.array([[0.0, 1.0], [4.0, 5.0]])
    assert np.abs(dense(large) - before).max() < 1e-13


def test_zeros_are_at_the_entries_of_the_small_matrix():
    large = tridiagonal()
    last = large.getSize()[0] - 1
    some, small = with_rows(large, [0], [everywhere(0, last, 4.0)])
    room = some.zeros(small, OWNED)
    assert np.abs(dense(room)).max() == 0.0 and room.getSize() == large.getSize()
    before, entries = dense(large), large.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"]
    large.axpy(1.0, room, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    assert large.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"] == entries + 1
    add_blocks(large, [everywhere(0, last, 4.0)])
    before[0, last] = 4.0
    assert np.abs(dense(large) - before).max() < 1e-14


@pytest.mark.serial
def test_entry_outside_of_the_pattern_raises():
    large = tridiagonal()
    with pytest.raises(PETSc.Error):
        add_blocks(large, [everywhere(0, OWNED - 1, 4.0)])


@pytest.mark.parametrize("empty", [False, True])
def test_rows_of_any_rank_are_summed_beside_the_matrix(empty):
    """Each rank has rows for all; with ``empty`` rank 0 alone, so that others have none to send."""
    large = tridiagonal()
    before, size = dense(large), large.getSize()[0]
    generator, count = np.random.default_rng(3), 0 if empty and comm.rank else 6
    rows, columns = generator.integers(-1, size, (2, comm.size, 6, 3))
    values = np.where(generator.random((comm.size, 6, 3, 3)) < 0.3, 0.0, 1.0 + comm.rank)
    mine = Block(rows[comm.rank, :count], columns[comm.rank, :count], values[comm.rank, :count])
    csr = summed_rows(comm, large.getOwnershipRanges(), [packed([mine], None, size)] * 2)
    total = sparse.with_rows(large, csr)
    expected = before.copy()
    for i, j, v in comm.allgather(mine):
        for block in zip(i, j, v, strict=True):
            used = [k >= 0 for k in block[:2]]
            np.add.at(
                expected,
                np.ix_(*(k[u] for k, u in zip(block[:2], used, strict=True))),
                2.0 * block[2][np.ix_(*used)],
            )
    assert np.abs(dense(total) - expected).max() < 1e-13
    assert np.abs(dense(large) - before).max() == 0.0
    entries = total.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"]
    assert entries == ((expected != 0.0) | (before != 0.0)).sum()


def test_tangent_of_slave_nodes_is_taken_from_K_in_place_while_the_pattern_stays():
    scene = pressed_blocks(n_upper=6, n_lower=9, layers_upper=3, layers_lower=3)
    kept = []
    for depth in (0.02, 0.021):
        scene.loads["push"].value[1] = -depth
        scene.problem.solve()
        kept.append(scene.problem.equations.system._slave_K)
    assert kept[0] is kept[1]
