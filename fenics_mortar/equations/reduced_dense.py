# SPDX-License-Identifier: MIT
"""The dense system of a linear bulk: displacements of contact dofs and multipliers.

    u + A (K_c u + B^T z) = d,        C u + A_z z = h,

with the compliance A and the displacement d without contact forces; see ``reduced``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from scipy.sparse import coo_array, csr_array

from fenics_mortar.la.solver import LINEAR_TOLERANCE
from fenics_mortar.utils.arrays import Array, Indices


class ContactMatrices(NamedTuple):
    """Matrices on the contact dofs and n multipliers.

    Attributes:
        K_c: Derivative of forces with respect to displacements at fixed multipliers, (size, size).
        B_T: Derivative of forces with respect to multipliers, (size, n).
        C: Derivative of the multipliers' rows with respect to displacements, (n, size).
        A_z: Derivative of the multipliers' rows with respect to multipliers, (n, n); a block per
            node.
    """

    K_c: coo_array
    B_T: coo_array
    C: coo_array
    A_z: coo_array

    @property
    def transposed(self) -> Self:
        """The matrices of the transposed equations."""
        return type(self)(self.K_c.T, self.C.T, self.B_T.T, self.A_z.T)


def solve_dense(
    A: Array, matrices: ContactMatrices, some: Indices, d: Array, rhs: Array, weight: Array
) -> tuple[Array, Array, Array] | None:
    """Solve the dense system for some multipliers, the others being zero (local).

    Args:
        A: Compliance, symmetric, (size, size) [1 / stress].
        matrices: The matrices.
        some: Numbers of the multipliers, ascending.
        d: Displacements without contact forces, (size,) [length].
        rhs: Right-hand side h, (n,).
        weight: Factors of the rows of multipliers, (n,), for the norm of the error.

    Returns:
        Displacements and contact forces, (size,) each, multipliers, (n,); ``None`` if the system is
        singular.
    """
    K_c, B_T, C, A_z = matrices
    coupled = B_T.row[np.isin(B_T.col, some)]
    t = np.unique(np.concatenate([K_c.row, K_c.col, coupled, C.col[np.isin(C.row, some)]]))
    K_t, B_t, A_t = _part(K_c, t, t), _part(B_T, t, some), A[t]
    matrix = np.empty((t.size + some.size, t.size + some.size))
    upper, lower = np.split(matrix, [t.size])
    upper[:, : t.size] = (K_t.T @ A_t[:, t]).T  # A is symmetric
    upper[:, t.size :] = (B_t.T @ A_t[:, t]).T
    upper[np.diag_indices(t.size)] += 1.0
    lower[:, : t.size] = _part(C, some, t).toarray()
    lower[:, t.size :] = _part(A_z, some, some).toarray()
    lower *= weight[some, None]
    right = np.concatenate([d[t], weight[some] * rhs[some]])
    try:
        x = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return None
    defect = np.linalg.norm(matrix @ x - right)
    if not defect <= LINEAR_TOLERANCE * np.linalg.norm(right):
        return None
    z, force = np.zeros(rhs.size), np.zeros(d.size)
    z[some] = x[t.size :]
    force[t] = K_t @ x[: t.size] + B_t @ z[some]
    return d - force[t] @ A_t, force, z


def solve_alone(A_z: coo_array, alone: Sequence[Indices], rhs: Array) -> Array:
    """Solve the blocks of nodes with uncoupled multipliers, (n,); zero elsewhere (local).

    Args:
        A_z: See ``ContactMatrices``.
        alone: Numbers of the components of these multipliers, (nodes, c) for each pair.
        rhs: Right-hand side, (n,).

    Raises:
        LinAlgError: If a block is singular.
    """
    z = np.zeros(rhs.size)
    for z_dofs in alone:
        node, component = np.full((2, rhs.size), -1)
        node[z_dofs], component[z_dofs] = np.indices(z_dofs.shape)
        here = node[A_z.row] >= 0
        i, j, blocks = A_z.row[here], A_z.col[here], np.zeros((*z_dofs.shape, z_dofs.shape[1]))
        np.add.at(blocks, (node[i], component[i], component[j]), A_z.data[here])
        z[z_dofs] = np.linalg.solve(blocks, rhs[z_dofs][:, :, None])[..., 0]
    return z


def _part(matrix: coo_array, rows: Indices, columns: Indices) -> csr_array:
    """Submatrix of ascending rows and columns (local)."""
    i, j = np.full(matrix.shape[0], -1), np.full(matrix.shape[1], -1)
    i[rows], j[columns] = np.arange(rows.size), np.arange(columns.size)
    row, column = i[matrix.row], j[matrix.col]
    inside = (row >= 0) & (column >= 0)
    entries = matrix.data[inside], (row[inside], column[inside])
    return csr_array(entries, shape=(rows.size, columns.size))
