# SPDX-License-Identifier: MIT
"""Linearized contact with friction along a load path: a parametric complementarity problem.

With friction the linearized problem may have several solutions. This module computes the one at the
end of the path of solutions from the last accepted state, s = 0, to the present loads, s = 1:

    w = (1 - s) q_0 + s q + M z >= 0,    z >= 0,    w . z = 0,

with q_0 such that the accepted multipliers solve the problem at s = 0. The path is piecewise
linear, and is followed by pivoting (Cottle, Pang & Stone 1992, ch. 4.5).

Where s would have to decrease, the path has a turning point: there is no solution nearby for larger
loads, and the solution at s = 1 is reached by a jump. The start of a step is a corner of the path,
because all slips are zero: a node at its friction limit may stick or continue to slide, and all
gaps and pressures of two surfaces that just touch are zero. The directions of the path follow from
a complementarity problem of the rates. If it has no solution, there is no equilibrium next to the
accepted state (Klarbring 1990).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fenics_mortar.rigid.complementarity import (
    Array,
    FrictionProblem,
    Sets,
    as_complementarity,
    exchange,
    lemke,
    sets_of,
)
from fenics_mortar.utils.rounding import MAX_STEPS, SOLVED, SUM_ROUNDING

Flags = npt.NDArray[np.bool_]


class TurningPoint(NamedTuple):
    """Turning point of a path.

    Attributes:
        fraction: Load parameter s at the turning point [1].
        node: Number of the node whose gap or slip would have to change its branch; -1 if unknown.
    """

    fraction: float
    node: int


def follow_loads(problem: FrictionProblem, start: Sets, gap: Array) -> Sets | TurningPoint:
    """Solve the linearized problem along the path from the accepted state (local).

    Values at the start up to ``SOLVED`` times the largest change are considered zero and replaced
    by random numbers of that size, so that ties in the ratio test do not occur.

    Args:
        problem: The problem at the present loads.
        start: Sets and multipliers of the accepted state.
        gap: Gaps of the accepted state, zero or positive, shape (n,) [length].

    Returns:
        Sets and multipliers, or the turning point before the present loads; ``start`` if the
        problem has no nodes.
    """
    if not problem.slope.size:
        return start
    M, q = as_complementarity(problem)
    z, w = _unknowns(problem, start, gap)
    change = np.abs(q - (w - M @ z)).max()
    n = problem.slope.size
    forces = np.arange(q.size) < n + 2 * np.count_nonzero(problem.slope > 0.0)
    # Gaps and slips change by ``change``, multipliers at least by this over the compliance.
    lengths, multipliers = SOLVED * change, SOLVED * change / np.abs(problem.V).max()
    z_zero, w_zero = np.where(forces, [[multipliers], [lengths]], [[lengths], [multipliers]])
    z, w = np.where(z > z_zero, z, 0.0), np.where(w > w_zero, w, 0.0)
    basic = _basic_of_rates(M, q - (w - M @ z), z, w)
    if basic is None:
        return TurningPoint(0.0, -1)
    random = np.random.default_rng(0).uniform(1.0, 2.0, q.size)
    shift = np.where(basic, 0.0, random * w_zero) - M @ np.where(basic, random * z_zero, 0.0)
    end = _follow(M, w - M @ z + shift, q + shift, basic)
    if isinstance(end, TurningPoint):
        nodes = np.append(np.arange(n), np.tile(np.flatnonzero(problem.slope > 0.0), 3))
        return end._replace(node=int(nodes[end.node]) if end.node >= 0 else -1)
    return sets_of(problem, M, q, end) or TurningPoint(1.0, -1)


def _unknowns(problem: FrictionProblem, start: Sets, gap: Array) -> tuple[Array, Array]:
    """Z and w at the accepted state, (unknowns,) each."""
    rough = np.flatnonzero(problem.slope > 0.0)
    active, branch, z_n, z_tau = (values[rough] for values in start)
    sticks, none = active & (branch == 0), np.zeros(rough.size)
    below_limit = np.where(sticks, problem.slope[rough] * z_n - np.abs(z_tau), 0.0)
    z = np.concatenate([start.z_n, z_tau, -z_tau, none])
    w = np.concatenate([np.where(start.active, 0.0, gap), none, none, below_limit])
    return np.maximum(z, 0.0), np.maximum(w, 0.0)


def _basic_of_rates(M: Array, rate: Array, z: Array, w: Array) -> Flags | None:
    """Basic z near z, w at s = 0 for a change of q by ``rate``; ``None`` if there is none."""
    a, d = np.flatnonzero(z > 0.0), np.flatnonzero((z == 0.0) & (w == 0.0))
    try:
        known = np.column_stack([M[np.ix_(a, d)], rate[a]])
        rest = M[np.ix_(d, a)] @ np.linalg.solve(M[np.ix_(a, a)], known)
    except np.linalg.LinAlgError:
        return None
    reduced = np.column_stack([M[np.ix_(d, d)], rate[d]]) - rest
    found = lemke(reduced[:, :-1], reduced[:, -1])
    if found is None:
        return None
    basic = z > 0.0
    basic[d] = found
    return basic


def _follow(M: Array, q_0: Array, q: Array, basic: Flags) -> Flags | TurningPoint:
    """Basic z at s = 1, from those at s = 0, or the turning point where s would decrease (local).

    The ``node`` of the turning point is the number of an unknown in z.
    """
    n = q.size
    # Tableau: basic = table @ (nonbasic, 1). Numbers: w_i is i, z_i is n + i, s is 2 n.
    w, z, s = np.arange(n), np.arange(n, 2 * n), 2 * n
    rows, columns = np.where(basic, z, w), np.append(np.where(basic, w, z), s)
    given = np.column_stack([np.where(basic, -np.eye(n), M), q - q_0, q_0])
    try:
        table = np.asfortranarray(np.linalg.solve(np.where(basic, -M, np.eye(n)), given))
    except np.linalg.LinAlgError:
        return TurningPoint(0.0, -1)
    at, column = -1, n
    for _ in range(MAX_STEPS * n):
        falls = table[:, column]
        now, grows = (table[at, -1], falls[at]) if at >= 0 else (0.0, 1.0)
        if not grows > 0.0:
            return TurningPoint(float(now), int(columns[column]) % n)
        falling = np.flatnonzero(falls < -SUM_ROUNDING * np.abs(falls).max())
        ways = np.maximum(table[falling, -1], 0.0) / -falls[falling]
        if now + grows * ways.min(initial=np.inf) >= 1.0:
            if at >= 0:
                rows[at] = columns[column]
            return np.isin(z, rows)
        row = int(falling[np.argmin(ways)])
        table = exchange(table, row, column)
        left, rows[row], columns[column] = rows[row], columns[column], rows[row]
        at = int(np.flatnonzero(rows == s)[0])
        column = int(np.flatnonzero(columns == (left + n) % s)[0])
    return TurningPoint(float(now), -1)
