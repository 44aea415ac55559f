# SPDX-License-Identifier: MIT
"""The tangent of bodies that remain in contact, in components along nodal axes: R^T L A T R.

T and L differ from the identity only at contact surfaces: L A T is A plus a small matrix of the
dofs near them. R turns the two components of each node, in the rows and columns of A.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from fenics_mortar.bulk.node_blocks import CSR, from_local_csr, local_csr
from fenics_mortar.kernels.node_blocks import count_blocks, turn_to_axes
from fenics_mortar.la.sparse import SomeRows, without_zeros
from fenics_mortar.utils.arrays import Array, Indices

# Parts of a matrix: starts, columns, dofs and values, see ``kernels.node_blocks``.
Parts = tuple[tuple[npt.NDArray, npt.NDArray, npt.NDArray, Array], ...]


class TouchingTangent:
    """R^T L A T R; all methods are collective."""

    def __init__(self) -> None:
        self._of_own, self._of_others = Memory(), Memory()

    def assemble(
        self, A: PETSc.Mat, near: SomeRows, motion: PETSc.Mat, equations: PETSc.Mat, tangents: Array
    ) -> PETSc.Mat:
        """The matrix, with entries in the memory of the last one, which must not be used any more.

        Args:
            A: Tangent of the displacements, with two dofs per node [stress].
            near: The dofs near contact: all entries of A in rows or columns of T - 1 and L - 1 lie
                in their rows and columns.
            motion: T - 1 of these dofs [1].
            equations: L^T - 1 of these dofs [1].
            tangents: First axis of each owned node, shape (nodes, 2) [1].
        """
        change, num_nodes = _change_by_contact(A, near, motion, equations), len(tangents)
        parts, numbers = _numbered_parts(A, change)
        axes = np.concatenate([tangents, _values_at(A, tangents, numbers[num_nodes:])])
        block_starts = np.empty((2, num_nodes + 1), PETSc.IntType)
        most = count_blocks(parts, len(numbers), block_starts)
        of_own, of_others = (
            memory.rows(2 * num_nodes, 4 * num_blocks)
            for memory, num_blocks in zip(
                (self._of_own, self._of_others), block_starts[:, -1], strict=True
            )
        )
        turn_to_axes(parts, numbers, axes, block_starts, most, of_own, of_others)
        B = from_local_csr(A.comm.tompi4py(), of_own, of_others)
        B.setBlockSize(2)
        return B


def touching_in_space(
    A: PETSc.Mat, near: SomeRows, motion: PETSc.Mat, equations: PETSc.Mat, R: PETSc.Mat
) -> PETSc.Mat:
    """R^T L A T R with three dofs per node (collective); see ``TouchingTangent.assemble``.

    Args:
        A: See there, as the next three.
        near: The dofs near contact.
        motion: T - 1.
        equations: L^T - 1.
        R: Nodal axes [1].
    """
    B = without_zeros(A)
    csr, size = _change_by_contact(B, near, motion, equations), A.getLocalSize()[0]
    change = PETSc.Mat().createAIJ(((size, None), (size, None)), csr=csr, comm=A.comm)
    B.axpy(1.0, change, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    turned = B.ptap(R)
    for matrix in (change, B):
        matrix.destroy()
    turned.setBlockSize(3)
    return turned


class Memory:
    """Memory for the rows of a sparse matrix, used for one matrix after the other.

    New memory is slow: the system clears it page by page, in twice the time of the computation.
    """

    def __init__(self) -> None:
        self._columns, self._values = np.empty(0, PETSc.IntType), np.empty(0)

    def rows(self, num_rows: int, num_entries: int) -> CSR:
        """Starts, columns and values of rows, not initialized (local)."""
        if num_entries > self._columns.size:
            size = num_entries + num_entries // 8  # contact grows
            self._columns, self._values = np.empty(size, PETSc.IntType), np.empty(size)
        starts = np.empty(num_rows + 1, PETSc.IntType)
        return starts, self._columns[:num_entries], self._values[:num_entries]


def _numbered_parts(A: PETSc.Mat, change: CSR) -> tuple[Parts, npt.NDArray]:
    """A and its change as parts, see ``kernels.node_blocks``, and global numbers of the nodes."""
    first, num_owned = A.getOwnershipRange()[0], A.getLocalSize()[0]
    own, *others = local_csr(A)
    remote = [(part, np.asarray(part.numbers)) for part in others]
    found = np.unique(np.concatenate([change[1], *(numbers for _, numbers in remote)]) // 2)
    of_others = found[(2 * found < first) | (2 * found >= first + num_owned)]

    def local(dofs: npt.NDArray) -> npt.NDArray:
        """Local numbers of global dofs, those of other ranks last."""
        is_owned = (dofs >= first) & (dofs < first + num_owned)
        last = num_owned + 2 * np.searchsorted(of_others, dofs // 2) + dofs % 2
        return np.where(is_owned, dofs - first, last).astype(PETSc.IntType)

    starts, columns, values = change
    everything = np.arange(max(num_owned, columns.size), dtype=PETSc.IntType)
    parts = [
        (own.starts, own.columns, everything[:num_owned], own.values()),
        (starts, everything[: columns.size], local(columns), values),
    ]
    parts += [(p.starts, p.columns, local(numbers), p.values()) for p, numbers in remote]
    if not remote:  # so that the kernel is compiled for one number of parts
        parts.append((np.zeros_like(starts), everything[:0], everything[:0], values[:0]))
    numbers = np.append((first + everything[:num_owned:2]) // 2, of_others)
    return tuple(parts), numbers.astype(PETSc.IntType)


def _change_by_contact(
    A: PETSc.Mat, near: SomeRows, motion: PETSc.Mat, equations: PETSc.Mat
) -> CSR:
    """L A T - A, with entries near contact only."""
    dofs = PETSc.IS().createGeneral(near.owned.astype(PETSc.IntType), A.comm)
    K = A.createSubMatrix(dofs, dofs)
    change = K.matMult(motion)
    K.axpy(1.0, change, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    gathered = equations.transposeMatMult(K)
    change.axpy(1.0, gathered, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    starts, columns, values = change.getValuesCSR()
    for matrix in (K, gathered, change):
        matrix.destroy()
    return (
        near.starts(starts, A.getLocalSize()[0]),
        near.rows[columns].astype(PETSc.IntType),
        values,
    )


def _values_at(A: PETSc.Mat, values: Array, nodes: Indices) -> Array:
    """Values (m, 2) at any ``nodes`` (m,), from those at the owned ones, (n, 2)."""
    owned = A.createVecRight()
    owned.array[:] = values.ravel()
    dofs = 2 * nodes[:, None] + np.arange(2, dtype=PETSc.IntType)
    numbers = PETSc.IS().createGeneral(dofs.ravel(), comm=PETSc.COMM_SELF)
    found = PETSc.Vec().createSeq(dofs.size, comm=PETSc.COMM_SELF)
    PETSc.Scatter().create(owned, numbers, found, None).scatter(owned, found)
    return found.array_r.reshape(-1, 2)
