# SPDX-License-Identifier: MIT
"""Entries of matrices in PETSc's own memory, on any number of ranks."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest

from fenics_mortar.bulk.node_blocks import from_local_csr, local_csr

comm = MPI.COMM_WORLD


def chain(block_size, kind):
    """A matrix of a chain of nodes, four on each rank, and the owned rows of its entries."""
    size, total = 4 * block_size, 4 * block_size * comm.size
    first = size * comm.rank
    dense = np.zeros((total, total))
    for i in range(total):
        for j in range(total):
            if abs(i // block_size - j // block_size) <= 1:
                dense[i, j] = 1.0 + i + 0.01 * j
    matrix = PETSc.Mat().create(comm)
    matrix.setSizes(((size, None), (size, None)), block_size)
    matrix.setType(kind)
    matrix.setUp()
    for i in range(first, first + size):
        columns = np.flatnonzero(dense[i]).astype(PETSc.IntType)
        matrix.setValues([i], columns, dense[i, columns])
    matrix.assemble()
    return matrix, dense[first : first + size], first


def of_rows(matrix, width, first):
    """The owned rows of a matrix in dense form, from its parts."""
    dense = np.zeros((matrix.getLocalSize()[0], width))
    for part in local_csr(matrix):
        shift = first if part.numbers is None else 0
        rows = np.repeat(np.arange(len(dense)), np.diff(part.starts))
        dense[rows, part.numbered() + shift] = part.values()
    return dense


def test_parts_of_rows_contain_all_entries():
    matrix, expected, first = chain(2, "aij")
    assert np.array_equal(of_rows(matrix, expected.shape[1], first), expected)


@pytest.mark.serial
def test_blocks_contain_all_entries():
    matrix, expected, first = chain(2, "baij")
    dense = np.zeros_like(expected)
    for part in local_csr(matrix):
        shift = first if part.numbers is None else 0
        blocks = part.values().reshape(-1, 2, 2).transpose(0, 2, 1)
        for i, (start, end) in enumerate(zip(part.starts[:-1], part.starts[1:], strict=True)):
            for e in range(start, end):
                column = 2 * part.numbered()[e] + shift
                dense[2 * i : 2 * i + 2, column : column + 2] = blocks[e]
    assert np.array_equal(dense, expected)


def test_only_changes_count_as_changes():
    matrix, expected, _ = chain(2, "aij")
    state = matrix.stateGet()
    for part in local_csr(matrix):
        part.values()
    assert matrix.stateGet() == state
    for part in local_csr(matrix):
        part.values(change=True)[:] = 3.0
    x, y = matrix.createVecs()
    x.set(1.0)
    matrix.mult(x, y)
    assert np.array_equal(y.array_r, 3.0 * (expected != 0.0).sum(axis=1))


def test_matrix_uses_the_given_arrays():
    matrix, expected, first = chain(2, "aij")
    parts = local_csr(matrix)
    own = [(p.starts.copy(), p.numbered().copy(), 2.0 * p.values()) for p in parts]
    none = np.zeros_like(own[0][0]), own[0][1][:0].copy(), np.empty(0)
    same = from_local_csr(comm, own[0], own[1] if comm.size > 1 else none)
    difference = same.copy()
    difference.axpy(-2.0, matrix)
    assert difference.norm() == 0.0 < same.norm()
    own[0][2][:] = 0.0
    x, y = same.createVecs()
    x.set(1.0)
    same.mult(x, y)
    of_others = expected.copy()
    of_others[:, first : first + len(expected)] = 0.0
    assert np.allclose(y.array_r, 2.0 * of_others.sum(axis=1), rtol=1e-14)
