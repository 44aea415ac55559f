# SPDX-License-Identifier: MIT
"""A sparse matrix of nodes with two dofs each, in components along axes that differ by node."""

import numpy as np

from fenics_mortar.kernels import kernel


@kernel
def count_blocks(starts, columns, block_starts):
    """Count the nodes that are coupled to each node.

    Args:
        starts: Entries of row i are starts[i]:starts[i + 1], shape (2 n + 1,).
        columns: Their columns in ascending order, shape (entries,).
        block_starts: Blocks of node i are block_starts[i]:block_starts[i + 1], (n + 1,); filled.
    """
    block_starts[0] = 0
    for i in range(block_starts.shape[0] - 1):
        a, b, count = starts[2 * i], starts[2 * i + 1], 0
        while a < starts[2 * i + 1] or b < starts[2 * i + 2]:
            node = _next_node(columns, a, starts[2 * i + 1], b, starts[2 * i + 2])
            a = _after(columns, a, starts[2 * i + 1], node)
            b = _after(columns, b, starts[2 * i + 2], node)
            count += 1
        block_starts[i + 1] = block_starts[i] + count


@kernel
def turn_to_axes(
    starts, columns, values, first, tangents, others, their_tangents, block_starts, turned
):
    """Entries of R^T A R, with columns (t, n) of R at each node, where n is t turned by 90 degrees.

    Args:
        starts: Entries of row i are starts[i]:starts[i + 1], shape (2 n + 1,).
        columns: Their columns in ascending order, shape (entries,).
        values: Entries of A, shape (entries,).
        first: Number of this rank's first node.
        tangents: t of this rank's nodes, shape (n, 2) [1].
        others: Numbers of nodes of other ranks, ascending, shape (m,).
        their_tangents: t of these nodes, shape (m, 2) [1].
        block_starts: Result of ``count_blocks``, shape (n + 1,).
        turned: Rows, columns and values in blocks of 2 x 2, each as rows of a sparse matrix:
            starts (2 n + 1,), columns (4 blocks,), values (4 blocks,); filled.
    """
    new_starts, new_columns, new_values = turned
    block = np.zeros((2, 2))
    new_starts[0] = 0
    for i in range(tangents.shape[0]):
        c, s = tangents[i]
        width = 2 * (block_starts[i + 1] - block_starts[i])
        upper = 4 * block_starts[i]
        lower = upper + width
        new_starts[2 * i + 1], new_starts[2 * i + 2] = lower, lower + width
        a, b = starts[2 * i], starts[2 * i + 1]
        while upper < new_starts[2 * i + 1]:
            node = _next_node(columns, a, starts[2 * i + 1], b, starts[2 * i + 2])
            after_a = _after(columns, a, starts[2 * i + 1], node)
            after_b = _after(columns, b, starts[2 * i + 2], node)
            block[:] = 0.0
            for e in range(a, after_a):
                block[0, columns[e] % 2] = values[e]
            for e in range(b, after_b):
                block[1, columns[e] % 2] = values[e]
            a, b = after_a, after_b
            if first <= node < first + tangents.shape[0]:
                tx, ty = tangents[node - first]
            else:
                tx, ty = their_tangents[np.searchsorted(others, node)]
            for k in range(2):
                x, y = block[k]
                block[k, 0], block[k, 1] = x * tx + y * ty, y * tx - x * ty
            for k in range(2):
                x, y = block[:, k]
                new_columns[upper + k] = new_columns[lower + k] = 2 * node + k
                new_values[upper + k], new_values[lower + k] = c * x + s * y, c * y - s * x
            upper, lower = upper + 2, lower + 2


@kernel
def _next_node(columns, a, end_a, b, end_b):
    """Smaller node of the columns at ``a`` and ``b``, at least one of which is before its end."""
    if a == end_a:
        return columns[b] // 2
    if b == end_b:
        return columns[a] // 2
    return min(columns[a], columns[b]) // 2


@kernel
def _after(columns, e, end, node):
    """First entry from ``e`` on whose column does not belong to ``node``."""
    while e < end and columns[e] // 2 == node:
        e += 1
    return e
