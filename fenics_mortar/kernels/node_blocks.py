# SPDX-License-Identifier: MIT
"""Entries of a sparse matrix in rows, and of one in blocks of the two dofs of a node.

A sparse matrix of nodes with two dofs each, in components along axes that differ by node.

The matrix is the sum of several, its parts. Each part is given by its rows:

    starts: Entries of row i are starts[i]:starts[i + 1], shape (2 n + 1,) for n nodes.
    columns: Their columns, shape (entries,).
    dofs: Dof of each column of the part, shape (columns,). Node i has dofs 2 i and 2 i + 1.
    values: Shape (entries,).
"""

import numpy as np

from fenics_mortar.kernels import kernel


@kernel
def find_indices(starts, columns, block_starts, block_columns, indices):
    """Find the entries of a matrix in rows among those of a matrix in blocks.

    Args:
        starts: Entries of row i are starts[i]:starts[i + 1], shape (2 n + 1,).
        columns: Their columns in ascending order, shape (entries,).
        block_starts: Blocks of rows 2 i and 2 i + 1, shape (n + 1,).
        block_columns: Their columns over two in ascending order, shape (blocks,).
        indices: Positions among the values in blocks of two columns each, -1 for entries outside of
            all blocks, shape (entries,); filled.
    """
    for i in range(starts.shape[0] - 1):
        block, end = block_starts[i // 2], block_starts[i // 2 + 1]
        for e in range(starts[i], starts[i + 1]):
            while block < end and block_columns[block] < columns[e] // 2:
                block += 1
            indices[e] = -1
            if block < end and block_columns[block] == columns[e] // 2:
                indices[e] = 4 * block + 2 * (columns[e] % 2) + i % 2


@kernel
def copy_to_rows(blocks, indices, rows):
    """Fill the values of the rows (entries,) from those of the blocks, with zeros outside."""
    for e in range(indices.shape[0]):
        rows[e] = blocks[indices[e]] if indices[e] >= 0 else 0.0


@kernel
def copy_to_blocks(rows, indices, blocks):
    """Overwrite the values of the blocks by those of the rows (entries,), all within blocks."""
    for e in range(indices.shape[0]):
        blocks[indices[e]] = rows[e]


@kernel
def find_entries(starts, columns, block_rows, block_columns, entries):
    """Find the values of blocks among the entries of a matrix in rows.

    Args:
        starts: Entries of row i are starts[i]:starts[i + 1], shape (2 n + 1,).
        columns: Their columns in ascending order, shape (entries,).
        block_rows: Rows of the blocks over two, shape (blocks,).
        block_columns: Columns of the blocks over two, shape (blocks,).
        entries: Positions of the values, by columns of a block, -1 for those that are no entries,
            shape (4 blocks,); filled.
    """
    for b in range(block_rows.shape[0]):
        for k in range(4):
            row, column = 2 * block_rows[b] + k % 2, 2 * block_columns[b] + k // 2
            start, end = starts[row], starts[row + 1]
            e = start + np.searchsorted(columns[start:end], column)
            entries[4 * b + k] = e if e < end and columns[e] == column else -1


@kernel
def add_values(values, entries, rows):
    """Add values (k,) to those of the rows at ``entries`` (k,), without those at -1."""
    for k in range(entries.shape[0]):
        if entries[k] >= 0:
            rows[entries[k]] += values[k]


@kernel
def find_blocks(starts, columns, block_starts, block_columns):
    """Find the blocks that contain the entries of a matrix in rows.

    Args:
        starts: Entries of row i are starts[i]:starts[i + 1], shape (2 n + 1,).
        columns: Their columns in ascending order, shape (entries,).
        block_starts: Blocks of rows 2 i and 2 i + 1, shape (n + 1,); filled.
        block_columns: Their columns over two in ascending order, shape (entries,); the first
            block_starts[n] are filled.
    """
    count = 0
    block_starts[0] = 0
    for i in range(block_starts.shape[0] - 1):
        e, middle, f, end = starts[2 * i], starts[2 * i + 1], starts[2 * i + 1], starts[2 * i + 2]
        while e < middle or f < end:
            if f == end or (e < middle and columns[e] <= columns[f]):
                column = columns[e] // 2
                e += 1
            else:
                column = columns[f] // 2
                f += 1
            if count == block_starts[i] or block_columns[count - 1] != column:
                block_columns[count] = column
                count += 1
        block_starts[i + 1] = count


@kernel
def count_blocks(parts, num_nodes, block_starts):
    """Count the nodes that are coupled to each node: those with rows, and others.

    Args:
        parts: The parts of the matrix.
        num_nodes: Number of nodes that have columns, those with rows first.
        block_starts: Blocks of node i and either kind are block_starts[kind, i]:block_starts[kind,
            i + 1], shape (2, n + 1); filled.

    Returns:
        Largest number of nodes that are coupled to a node.
    """
    num_rows, most = block_starts.shape[1] - 1, 0
    last = np.full(num_nodes, -1, np.int32)
    block_starts[:, 0] = 0
    for i in range(num_rows):
        own, others = 0, 0
        for starts, columns, dofs, _ in parts:
            for e in range(starts[2 * i], starts[2 * i + 2]):
                node = dofs[columns[e]] >> 1
                if last[node] != i:
                    last[node] = i
                    own += node < num_rows
                    others += node >= num_rows
        block_starts[0, i + 1] = block_starts[0, i] + own
        block_starts[1, i + 1] = block_starts[1, i] + others
        most = max(most, own + others)
    return most


@kernel
def turn_to_axes(parts, numbers, tangents, block_starts, most, own, others):
    """Entries of R^T A R, with columns (t, n) of R at each node, where n is t turned by 90 degrees.

    Args:
        parts: The parts of A.
        numbers: Global number of each node that has columns, shape (m,); those with rows first.
        tangents: t of these nodes, shape (m, 2) [1].
        block_starts: Result of ``count_blocks``, shape (2, n + 1).
        most: Largest number of nodes that are coupled to a node.
        own: The result in columns of nodes with rows, which begin with zero: starts (2 n + 1,),
            columns (4 blocks,) in ascending order, and values (4 blocks,); filled.
        others: The result in other columns, by global numbers; filled.
    """
    num_rows = block_starts.shape[1] - 1
    slots = np.full(numbers.shape[0], -1, np.int32)
    nodes, blocks = np.empty(most, np.int32), np.empty((most, 2, 2))
    own[0][0] = others[0][0] = 0
    for i in range(num_rows):
        count = _gather(parts, i, numbers, slots, nodes, blocks)
        a, b = 4 * block_starts[0, i], 4 * block_starts[1, i]
        width = 2 * (block_starts[0, i + 1] - block_starts[0, i])
        width_of_others = 2 * count - width
        own[0][2 * i + 1], own[0][2 * i + 2] = a + width, a + 2 * width
        others[0][2 * i + 1], others[0][2 * i + 2] = b + width_of_others, b + 2 * width_of_others
        for k in range(count):
            node = nodes[k]
            _turn(blocks, slots[node], tangents, i, node)
            if node < num_rows:
                _insert(blocks, slots[node], 2 * node, a, a + width, own)
                a += 2
            else:
                _insert(blocks, slots[node], 2 * numbers[node], b, b + width_of_others, others)
                b += 2
            slots[node] = -1


@kernel
def _turn(blocks, b, tangents, i, j):
    """Turn block b to components along the axes of node i (rows) and node j (columns)."""
    c, s, tx, ty = tangents[i, 0], tangents[i, 1], tangents[j, 0], tangents[j, 1]
    xx, xy, yx, yy = blocks[b, 0, 0], blocks[b, 0, 1], blocks[b, 1, 0], blocks[b, 1, 1]
    xt, xn, yt, yn = xx * tx + xy * ty, xy * tx - xx * ty, yx * tx + yy * ty, yy * tx - yx * ty
    blocks[b, 0, 0], blocks[b, 0, 1] = c * xt + s * yt, c * xn + s * yn
    blocks[b, 1, 0], blocks[b, 1, 1] = c * yt - s * xt, c * yn - s * xn


@kernel
def _insert(blocks, b, column, upper, lower, rows):
    """Insert block b at its first column: its rows at the entries ``upper`` and ``lower``."""
    _, columns, values = rows
    for k in range(2):
        columns[upper + k] = columns[lower + k] = column + k
        values[upper + k], values[lower + k] = blocks[b, 0, k], blocks[b, 1, k]


@kernel
def _gather(parts, i, numbers, slots, nodes, blocks):
    """Sum the blocks of node i over the parts.

    Args:
        parts: The parts of the matrix.
        i: The node.
        numbers: Global number of each node, shape (m,).
        slots: Position of each node's block, -1 at first, shape (m,); filled at the nodes found.
        nodes: Nodes that are coupled to node i, in the order of their numbers; filled.
        blocks: Their blocks, shape (nodes, 2, 2), by their ``slots``; filled.

    Returns:
        Number of these nodes.
    """
    count = 0
    for starts, columns, dofs, values in parts:
        for k in range(2):
            for e in range(starts[2 * i + k], starts[2 * i + k + 1]):
                dof = dofs[columns[e]]
                node = dof >> 1
                slot = slots[node]
                if slot < 0:
                    slot = slots[node] = count
                    blocks[slot, 0, 0] = blocks[slot, 0, 1] = 0.0
                    blocks[slot, 1, 0] = blocks[slot, 1, 1] = 0.0
                    b = count
                    while b > 0 and numbers[nodes[b - 1]] > numbers[node]:
                        nodes[b] = nodes[b - 1]
                        b -= 1
                    nodes[b] = node
                    count += 1
                blocks[slot, k, dof & 1] += values[e]
    return count
