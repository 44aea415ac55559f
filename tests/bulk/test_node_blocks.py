# SPDX-License-Identifier: MIT
"""Matrices in rows, copied to blocks of the two dofs of a node."""

from petsc4py import PETSc

import numpy as np
import pytest

from fenics_mortar.bulk.node_blocks import NodeBlocks, come_in_pairs

pytestmark = pytest.mark.serial


def matrix_in_pairs(values):
    """The matrix of a whole number of nodes, without its zeros."""
    rows, columns = np.nonzero(values)
    starts = np.searchsorted(rows, np.arange(len(values) + 1)).astype(PETSc.IntType)
    csr = starts, columns.astype(PETSc.IntType), values[rows, columns]
    return PETSc.Mat().createAIJ(values.shape, bsize=2, csr=csr, comm=PETSc.COMM_SELF)


def test_blocks_follow_changes_of_the_rows_and_otherwise_keep_factors():
    values = np.kron([[2.0, 1.0], [0.0, 2.0]], [[1.0, 0.0], [3.0, 4.0]])  # blocks with gaps
    rows = matrix_in_pairs(values)
    both = NodeBlocks(rows)
    rows.scale(3.0)
    both.copy_to_blocks(rows)
    assert np.array_equal(both.blocks.copy().convert("dense").getDenseArray(), 3.0 * values)
    state = both.blocks.stateGet()
    both.copy_to_blocks(rows)
    assert both.blocks.stateGet() == state


@pytest.mark.parametrize("kind, bsize, expected", [
    ("seqaij", 2, True), ("seqaij", 1, False), ("seqbaij", 2, False), ("mpiaij", 2, True),
])  # fmt: skip
def test_rows_with_two_dofs_per_node_come_in_pairs(kind, bsize, expected):
    rows = PETSc.Mat().create(PETSc.COMM_SELF)
    rows.setType(kind)
    rows.setSizes(4, bsize=bsize)
    rows.setUp()
    assert come_in_pairs(rows) == expected


def test_blocks_do_not_fit_other_rows():
    one, other = (matrix_in_pairs(np.eye(4) + number) for number in (1.0, 2.0))
    both = NodeBlocks(one)
    assert both.fit(one)
    assert not both.fit(other)
    grown = matrix_in_pairs(np.eye(4))
    both = NodeBlocks(grown)
    grown.axpy(1.0, one, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    assert not both.fit(grown)


def test_values_moved_by_petsc_are_found():
    values = np.kron(np.eye(3), [[1.0, 2.0], [3.0, 4.0]])
    rows = matrix_in_pairs(values)
    both = NodeBlocks(rows)
    rows.axpy(1.0, matrix_in_pairs(values), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    assert both.fit(rows)  # the same entries in a new place
    both.copy_to_blocks(rows)
    assert np.array_equal(both.blocks.copy().convert("dense").getDenseArray(), 2.0 * values)
