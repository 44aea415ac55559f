# SPDX-License-Identifier: MIT
"""Rows of tables, copied by loops.

numba compiles an assignment of an array to a part of another one with checks of shapes and overlap:
up to ten times the code, which each process loads.
"""

import numpy as np

from fenics_mortar.kernels import kernel


@kernel
def copy_row(source, target):
    """Copy the values of one row (c,) into another."""
    for k in range(source.size):
        target[k] = source[k]


@kernel
def copy_rows(source, count, target, start):
    """Copy the first ``count`` rows of (r, c) into another table, from row ``start`` on."""
    for i in range(count):
        copy_row(source[i], target[start + i])


@kernel
def grown(rows, used, needed):
    """``rows`` (r, c), or a longer table with the rows ``used`` if ``needed`` are more than r."""
    if needed <= rows.shape[0]:
        return rows
    longer = np.empty((2 * needed, rows.shape[1]))
    copy_rows(rows, used, longer, 0)
    return longer
