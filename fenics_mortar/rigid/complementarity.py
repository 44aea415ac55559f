# SPDX-License-Identifier: MIT
"""Contact with friction at small changes: a linear complementarity problem, by Lemke's method.

With the gaps y = (g_n, u) of the nodes linear in their multipliers z = (z_n, z_tau), y = q + V z,
the shear is the difference of two nonnegative numbers, z_tau = b+ - b-, and s the size of the slip:

    z_n >= 0,   g_n >= 0,                            z_n g_n = 0
    b+ >= 0,    s - u >= 0,                          b+ (s - u) = 0
    b- >= 0,    s + u >= 0,                          b- (s + u) = 0
    s >= 0,     mu z_n - b+ - b- >= 0,               s (mu z_n - b+ - b-) = 0

(Stewart & Trinkle 1996). Its matrix is copositive where the compliance is positive definite, so
that Lemke's method (Cottle, Pang & Stone 1992, ch. 4.4) ends in a solution, whatever mu is. It goes
along the solutions of a problem that a number z_0 > 0 relaxes, from one piece to the next. It
cannot go in circles, as nodes do that take, all at once, what the last state of the others asks of
them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import LinAlgError
from scipy.linalg.blas import dger

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
# Entries of a column below this part of its largest are rounding.
ROUNDING = 1e-11
# What relaxes the rows is gone below this part of where it began.
NOTHING = 1e-14
# Changes of the basis for each variable at the most; five problems looked at took less than one.
MOST_CHANGES = 50


class FrictionProblem(NamedTuple):
    """Gaps as linear functions of the multipliers, of n nodes; lengths throughout.

    Attributes:
        V: Shape (2 n, 2 n), normal rows and columns first.
        q: Shape (2 n,).
        slope: mu, shape (n,).
    """

    V: Array
    q: Array
    slope: Array


class Sets(NamedTuple):
    """A solution, shape (n,) each.

    Attributes:
        active: Whether a node touches.
        branch: Whether it sticks (0) or slides (+-1).
        z_n, z_tau: Multipliers.
    """

    active: npt.NDArray[np.bool_]
    branch: Indices
    z_n: Array
    z_tau: Array


def solve_friction(problem: FrictionProblem) -> Sets | None:
    """A solution of the linearized problem; ``None`` if there is none in sight."""
    n = problem.slope.size
    rough = np.flatnonzero(problem.slope > 0.0)
    m = rough.size
    V_nn, V_nt = problem.V[:n, :n], problem.V[:n, n + rough]
    V_tn, V_tt = problem.V[n + rough, :n], problem.V[np.ix_(n + rough, n + rough)]
    one, none = np.eye(m), np.zeros((m, m))
    cone = np.zeros((m, n))
    cone[np.arange(m), rough] = problem.slope[rough]
    M = np.block(
        [
            [V_nn, V_nt, -V_nt, np.zeros((n, m))],
            [-V_tn, -V_tt, V_tt, one],
            [V_tn, V_tt, -V_tt, one],
            [cone, -one, -one, none],
        ]
    )
    u = problem.q[n + rough]
    q = np.concatenate([problem.q[:n], -u, u, np.zeros(m)])
    basic = lemke(M, q)
    if basic is None:
        return None
    try:
        z = np.where(basic, np.linalg.solve(np.where(basic, -M, np.eye(len(M))), q), 0.0)
    except LinAlgError:
        return None
    branch, z_tau = np.zeros(n, np.int64), np.zeros(n)
    plus, minus, slides = basic[n:].reshape(3, m)
    branch[rough] = np.where(slides & (plus != minus), np.where(plus, 1, -1), 0)
    z_tau[rough] = z[n : n + m] - z[n + m : n + 2 * m]
    return Sets(basic[:n], branch, z[:n], z_tau)


def lemke(M: Array, q: Array) -> npt.NDArray[np.bool_] | None:
    """Which z_i are basic in a solution of w = q + M z >= 0, z >= 0, w . z = 0; ``None`` if none.

    Args:
        M: Shape (n, n).
        q: Shape (n,).
    """
    n = q.size
    if not (q < 0.0).any():
        return np.zeros(n, bool)
    # What relaxes the rows: in general position, so that no two of them become zero at once.
    relaxed = 1.0 + np.random.default_rng(0).uniform(0.0, 1.0, n)
    table = np.asfortranarray(np.column_stack([M, relaxed, q / np.abs(q).max()]))
    # Of the table, basic = table @ (others, 1): w_i is number i, z_i is n + i, z_0 is 2 n.
    rows, columns, z_0 = np.arange(n), np.arange(n, 2 * n + 1), 2 * n
    row, column = int(np.argmin(q / relaxed)), n
    for _ in range(MOST_CHANGES * n):
        table = _exchange(table, row, column)
        left, rows[row], columns[column] = rows[row], columns[column], rows[row]
        if left == z_0:
            return np.isin(np.arange(n, 2 * n), rows)
        column = int(np.flatnonzero(columns == (left + n) % z_0)[0])
        falls = table[:, column]
        falling = np.flatnonzero(falls < -ROUNDING * np.abs(falls).max())
        if not falling.size:
            return None
        ways = np.maximum(table[falling, -1], 0.0) / -falls[falling]
        first = int(np.argmin(ways))
        row, last = int(falling[first]), int(np.flatnonzero(rows == z_0)[0])
        if table[last, -1] + falls[last] * ways[first] <= NOTHING:
            row = last
    return None


def _exchange(table: Array, row: int, column: int) -> Array:
    """Let a basic variable and another one change places, in place; return the table."""
    pivot = table[row, column]
    line, rest = table[row] / -pivot, table[:, column].copy()
    line[column] = 1.0 / pivot
    rest[row] = 0.0
    table[:, column] = 0.0
    table = dger(1.0, rest, line, a=table, overwrite_a=1)
    table[row] = line
    return table
