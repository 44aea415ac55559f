# SPDX-License-Identifier: MIT
"""Entries of a sparse matrix in rows, and of one in blocks of the dofs of a node."""

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
def turn_blocks(starts, columns, blocks, of_rows, of_columns):
    """Replace blocks B by R_i^T B R_j, with the axes R of their nodes i and j in columns.

    Args:
        starts: Blocks of node i are starts[i]:starts[i + 1], shape (n + 1,).
        columns: Their nodes j, shape (blocks,).
        blocks: Shape (blocks, dim, dim); changed.
        of_rows: R of the nodes i, shape (n, dim, dim) [1].
        of_columns: R of the nodes j, shape (m, dim, dim) [1].
    """
    dim = blocks.shape[1]
    turned = np.empty((dim, dim))
    for i in range(len(starts) - 1):
        for b in range(starts[i], starts[i + 1]):
            for k in range(dim):
                for l in range(dim):
                    turned[k, l] = 0.0
                    for a in range(dim):
                        turned[k, l] += blocks[b, k, a] * of_columns[columns[b], a, l]
            for k in range(dim):
                for l in range(dim):
                    blocks[b, k, l] = 0.0
                    for a in range(dim):
                        blocks[b, k, l] += of_rows[i, a, k] * turned[a, l]
