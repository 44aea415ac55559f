# SPDX-License-Identifier: MIT
"""The tangent of bodies that remain in contact, in components along nodal axes: R^T L A T R.

T and L differ from the identity only at contact surfaces: L A T is A plus a small matrix of the
dofs near them. R turns the two components of each node, in the rows and columns of A.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from fenics_mortar.kernels.node_axes import count_blocks, turn_to_axes
from fenics_mortar.utils.arrays import Array, Indices


def touching_tangent(
    A: PETSc.Mat, near: Indices, motion: PETSc.Mat, equations: PETSc.Mat, tangents: Array
) -> PETSc.Mat:
    """R^T L A T R, a new matrix (collective).

    Args:
        A: Tangent of the displacements, with two dofs per node [stress].
        near: Local numbers of the owned dofs near contact, shape (n,): all entries of A in rows or
            columns of T - 1 and L - 1 lie in their rows and columns.
        motion: T - 1 [1].
        equations: L^T - 1 [1].
        tangents: First axis of each owned node, shape (nodes, 2) [1].
    """
    change = _change_by_contact(A, near, motion, equations)
    change.axpy(1.0, A, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    B = _along_axes(change, tangents)
    change.destroy()
    return B


def _change_by_contact(
    A: PETSc.Mat, near: Indices, motion: PETSc.Mat, equations: PETSc.Mat
) -> PETSc.Mat:
    """L A T - A, of the size of A, with entries near contact only."""
    first, _ = A.getOwnershipRange()
    rows = PETSc.IS().createGeneral((near + first).astype(PETSc.IntType), A.comm)
    K, T, L = (matrix.createSubMatrix(rows, rows) for matrix in (A, motion, equations))
    change = K.matMult(T)
    K.axpy(1.0, change, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    gathered = L.transposeMatMult(K)
    change.axpy(1.0, gathered, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    whole = _enlarged(change, near, A)
    for matrix in (K, T, L, gathered, change):
        matrix.destroy()
    return whole


def _enlarged(small: PETSc.Mat, rows: Indices, A: PETSc.Mat) -> PETSc.Mat:
    """Matrix of the size of ``A`` with the entries of one of its rows and columns ``rows``."""
    first, _ = A.getOwnershipRange()
    num_owned, _ = A.getLocalSize()
    starts, columns, values = small.getValuesCSR()
    numbers = np.concatenate(A.comm.tompi4py().allgather(rows + first)).astype(PETSc.IntType)
    sizes = np.zeros(num_owned + 1, PETSc.IntType)
    sizes[rows + 1] = np.diff(starts)
    csr = np.cumsum(sizes, dtype=PETSc.IntType), numbers[columns], values
    return PETSc.Mat().createAIJ(A.getSizes(), csr=csr, comm=A.comm)


def _along_axes(A: PETSc.Mat, tangents: Array) -> PETSc.Mat:
    """R^T A R."""
    starts, columns, values = A.getValuesCSR()
    first, num_nodes = A.getOwnershipRange()[0] // 2, len(tangents)
    nodes = columns // 2
    others = np.unique(nodes[(nodes < first) | (nodes >= first + num_nodes)])
    block_starts = np.empty(num_nodes + 1, PETSc.IntType)
    count_blocks(starts, columns, block_starts)
    turned = (
        np.empty(2 * num_nodes + 1, PETSc.IntType),
        np.empty(4 * block_starts[-1], PETSc.IntType),
        np.empty(4 * block_starts[-1]),
    )
    theirs = _values_at(A, tangents, others)
    turn_to_axes(starts, columns, values, first, tangents, others, theirs, block_starts, turned)
    B = PETSc.Mat().createAIJ(A.getSizes(), csr=turned, comm=A.comm)
    B.setBlockSize(2)
    return B


def _values_at(A: PETSc.Mat, values: Array, nodes: Indices) -> Array:
    """Values (m, 2) at any ``nodes`` (m,), from those at the owned ones, (n, 2)."""
    owned = A.createVecRight()
    owned.array[:] = values.ravel()
    dofs = 2 * nodes[:, None] + np.arange(2, dtype=PETSc.IntType)
    numbers = PETSc.IS().createGeneral(dofs.ravel(), comm=PETSc.COMM_SELF)
    found = PETSc.Vec().createSeq(dofs.size, comm=PETSc.COMM_SELF)
    PETSc.Scatter().create(owned, numbers, found, None).scatter(owned, found)
    return found.array_r.reshape(-1, 2)
