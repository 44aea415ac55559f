# SPDX-License-Identifier: MIT
"""Small matrices of some rows, added to a large one: what is added, and what it costs."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from scenes import pressed_blocks

from fenics_mortar.mortar import Block
from fenics_mortar.sparse import BlockMatrix, SomeRows

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
    """A block of one entry, of which each rank adds a part."""
    return Block(np.array([[row]]), np.array([[column]]), np.full((1, 1, 1), value / comm.size))


def test_rows_are_added_where_they_belong():
    """To entries that are there, to more than one row, and on each rank to rows of others."""
    large = tridiagonal()
    last = large.getSize()[0] - 1
    before, entries = dense(large), large.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"]
    blocks = [everywhere(last, last - 1, 3.0), everywhere(2, 2, 5.0), everywhere(-1, 2, 7.0)]
    some, small = with_rows(large, [last, 2, last], blocks)
    assert small.getSize() == (2, last + 1)
    some.add(small, large, False)
    before[last, last - 1] += 3.0
    before[2, 2] += 5.0
    assert np.abs(dense(large) - before).max() < 1e-14
    assert large.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"] == entries


def test_pattern_grows_only_if_asked_to():
    large = tridiagonal()
    last = large.getSize()[0] - 1
    before, entries = dense(large), large.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"]
    some, small = with_rows(large, [0], [everywhere(0, last, 4.0)])
    some.add(small, large, True)
    before[0, last] = 4.0
    assert np.abs(dense(large) - before).max() < 1e-14
    assert large.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"] == entries + 1


@pytest.mark.serial
def test_entry_outside_of_the_pattern_is_not_lost_in_silence():
    large = tridiagonal()
    some, small = with_rows(large, [0], [everywhere(0, OWNED - 1, 4.0)])
    with pytest.raises(PETSc.Error):
        some.add(small, large, False)


def test_contact_has_rows_of_its_own_only():
    """Its matrices do not grow with the bodies, nor are those with a kept pattern made anew."""
    sizes = []
    for layers in (2, 6):
        scene = pressed_blocks(n_upper=6, n_lower=9, layers_upper=layers, layers_lower=layers)
        scene.loads["push"].value[1] = -0.02
        scene.problem.solve()
        system, contact = scene.problem.system, scene.contact
        kept = system._slave_K
        scene.loads["push"].value[1] = -0.021
        scene.problem.solve()
        assert system._slave_K is kept
        sizes.append([m.mat.getSize()[0] for m in (system._K_c, system._C, system._R)])
        assert set(sizes[-1]) == {2 * (contact.slave.num_nodes + contact.master.num_nodes)}
    assert sizes[0] == sizes[1]
