# SPDX-License-Identifier: MIT
"""Entries of a sparse matrix in rows, and of one in blocks of the two dofs of a node."""

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
