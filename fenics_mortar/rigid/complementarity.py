# SPDX-License-Identifier: MIT
"""Linear problems with inequalities of contact: friction, limit analysis, moves without overlap.

``solve_friction`` solves linearized contact with Coulomb friction as a complementarity problem,
``follow_loads`` does so along a load path. ``unresisted_motion`` decides by limit analysis whether
contact can support rigid bodies, ``closest_move`` finds a move of these without overlaps.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.linalg import LinAlgError
from scipy.linalg.blas import dger
from scipy.sparse import coo_array, csr_array, hstack

from fenics_mortar.contact.rows import adhesion_at_gap, strength
from fenics_mortar.obstacles.rigid_motion import RIGID
from fenics_mortar.utils.arrays import MAX_STEPS, SOLVED, SUM_ROUNDING, nonnegative_least_squares

if TYPE_CHECKING:
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.contact.fields import ContactFields
    from fenics_mortar.utils.arrays import Array, Flags, Indices


# Numbers of directions of slip in space, tried in turn [1]: with 32 the limit loads of inner and
# outer polygon differ by 0.5 %, as the error of the discretization.
DIRECTIONS = (8, 16, 32)

# Resistance of rigid motions over that of all loads [1], by which bodies stay that nothing pushes.
LAZY = 1e-3


class FrictionProblem(NamedTuple):
    """Gaps and slips of n nodes as linear functions of scaled multipliers; all in units of length.

    Gaps and slips y = (g_n, u) of the nodes are linear in the multipliers z = (z_n, z_tau),
    y = q + V z. With the shear split into nonnegative parts, z_tau = b+ - b-, and s = |u|:

        z_n >= 0,   g_n >= 0,                            z_n g_n = 0
        b+ >= 0,    s - u >= 0,                          b+ (s - u) = 0
        b- >= 0,    s + u >= 0,                          b- (s + u) = 0
        s >= 0,     mu z_n - b+ - b- >= 0,               s (mu z_n - b+ - b-) = 0

    (Stewart & Trinkle 1996).

    Attributes:
        V: Compliance, shape (2 n, 2 n), normal rows and columns first [1].
        q: Gaps and slips without multipliers, shape (2 n,) [length].
        slope: Coefficient of friction mu, shape (n,) [1].
    """

    V: Array
    q: Array
    slope: Array


class Sets(NamedTuple):
    """A solution for n nodes, arrays of shape (n,).

    Attributes:
        active: Whether a node is in contact.
        branch: 0 for stick, +1 or -1 for slip.
        z_n: Scaled normal multiplier [length].
        z_tau: Scaled tangential multiplier [length].
    """

    active: Flags
    branch: Indices
    z_n: Array
    z_tau: Array


def solve_friction(problem: FrictionProblem) -> Sets | None:
    """Solve the linearized problem; ``None`` if Lemke's method finds no solution (local).

    The matrix of the complementarity problem is copositive if the compliance is positive definite;
    Lemke's method (Cottle, Pang & Stone 1992, ch. 4.4) then terminates with a solution for any mu.
    The method follows the piecewise linear path of solutions of a problem relaxed by a scalar
    z_0 > 0. Unlike an active-set iteration that updates all nodes at once, it cannot cycle.
    """
    M, q = as_complementarity(problem)
    basic = lemke(M, q)
    return None if basic is None else sets_of(problem, M, q, basic)


def as_complementarity(problem: FrictionProblem) -> tuple[Array, Array]:
    """M (n, n) and q (n,) of (z_n, b+, b-, s) [unit of rows]; the last three with friction."""
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
    return M, np.concatenate([problem.q[:n], -u, u, np.zeros(m)])


def sets_of(problem: FrictionProblem, M: Array, q: Array, basic: Flags) -> Sets | None:
    """Sets and multipliers for ``M`` (n, n) and ``q`` (n,); ``None`` if not unique (local)."""
    n = problem.slope.size
    rough = np.flatnonzero(problem.slope > 0.0)
    m = rough.size
    try:
        z = np.where(basic, np.linalg.solve(np.where(basic, -M, np.eye(len(M))), q), 0.0)
    except LinAlgError:
        return None
    branch, z_tau = np.ones(n, np.int64), np.zeros(n)  # nodes without friction slide
    plus, minus, slides = basic[n:].reshape(3, m)
    branch[rough] = np.where(slides & (plus != minus), np.where(plus, 1, -1), 0)
    z_tau[rough] = z[n : n + m] - z[n + m : n + 2 * m]
    return Sets(basic[:n], branch, z[:n], z_tau)


def lemke(M: Array, q: Array) -> Flags | None:
    """Basic z_i of a solution of w = q + M z >= 0, z >= 0, w . z = 0 by Lemke's method (local).

    Args:
        M: Shape (n, n).
        q: Shape (n,).

    Returns:
        Shape (n,), bool; ``None`` if the path ends in a ray or after ``MAX_STEPS`` pivots per
        variable.
    """
    if not (q < 0.0).any():
        return np.zeros(q.size, bool)
    # Covering vector in general position, so that ties in the ratio test do not occur.
    relaxed = 1.0 + np.random.default_rng(0).uniform(0.0, 1.0, q.size)
    q = q / np.abs(q).max()  # the parameter has the unit one
    end = _follow(M, q + relaxed, q, np.zeros(q.size, bool), may_return=True)
    return None if isinstance(end, TurningPoint) else end


def exchange(table: Array, row: int, column: int) -> Array:
    """Exchange a basic and a nonbasic variable; return the changed ``table``, (m, n) [any unit]."""
    pivot = table[row, column]
    line, rest = table[row] / -pivot, table[:, column].copy()
    line[column] = 1.0 / pivot
    rest[row] = 0.0
    table[:, column] = 0.0
    table = dger(1.0, rest, line, a=table, overwrite_a=1)
    table[row] = line
    return table


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

    With friction the linearized problem may have several solutions. This one is at the end of the
    path of solutions from the last accepted state, s = 0, to the present loads, s = 1:

        w = (1 - s) q_0 + s q + M z >= 0,    z >= 0,    w . z = 0,

    with q_0 such that the accepted multipliers solve the problem at s = 0. The path is piecewise
    linear, and is followed by pivoting (Cottle, Pang & Stone 1992, ch. 4.5). Lemke's method is the
    same path from q_0 = q + |q| d > 0 with z = 0, a covering vector d, and z_0 = (1 - s) |q|, on
    which s may also decrease.

    Where s would have to decrease, the path has a turning point: there is no solution nearby for
    larger loads, and the solution at s = 1 is reached by a jump. The start of a step is a corner of
    the path, because all slips are zero: a node at its friction limit may stick or continue to
    slide, and all gaps and pressures of two surfaces that just touch are zero. The directions of
    the path follow from a complementarity problem of the rates. If it has no solution, there is no
    equilibrium next to the accepted state (Klarbring 1990).

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
    unit = change or 1.0  # the parameter has the unit one
    end = _follow(M, (w - M @ z + shift) / unit, (q + shift) / unit, basic)
    if isinstance(end, TurningPoint):
        nodes = np.append(np.arange(n), np.tile(np.flatnonzero(problem.slope > 0.0), 3))
        return end._replace(node=int(nodes[end.node]) if end.node >= 0 else -1)
    return sets_of(problem, M, q, end) or TurningPoint(1.0, -1)


def _unknowns(problem: FrictionProblem, start: Sets, gap: Array) -> tuple[Array, Array]:
    """The vectors z and w at the accepted state, (unknowns,) each."""
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


def _follow(
    M: Array, q_0: Array, q: Array, basic: Flags, *, may_return: bool = False
) -> Flags | TurningPoint:
    """Basic z at s = 1, from those at s = 0, or the turning point where s would decrease (local).

    The ``node`` of the turning point is the number of an unknown in z. If s ``may_return``, as in
    Lemke's method, the path is followed to its end, and its turning point is that of a ray.
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
    at, column, before = -1, n, n
    for _ in range(MAX_STEPS * n):
        falls = table[:, column]
        now, grows = (table[at, -1], falls[at]) if at >= 0 else (0.0, 1.0)
        if may_return and now >= 1.0 - SUM_ROUNDING:  # either of the pair: the larger pivot
            rows[at] = columns[max((column, before), key=lambda k: abs(table[at, k]))]
            return np.isin(z, rows)
        rounding = SUM_ROUNDING * np.abs(falls).max()
        falling = np.flatnonzero(falls < -rounding)
        falling = falling[falling != at]
        # without another variable that falls s would grow without end: not by rounding
        advances = grows > (rounding if may_return or not falling.size else 0.0)
        if not advances and not (may_return and falling.size):
            return TurningPoint(float(now), int(columns[column]) % n)
        ways = np.maximum(table[falling, -1], 0.0) / -falls[falling]
        if advances and now + grows * ways.min(initial=np.inf) >= 1.0:
            if at >= 0:
                rows[at] = columns[column]
            return np.isin(z, rows)
        row, before = int(falling[np.argmin(ways)]), column
        table = exchange(table, row, column)
        left, rows[row], columns[column] = rows[row], columns[column], rows[row]
        at = int(np.flatnonzero(rows == s)[0])
        column = int(np.flatnonzero(columns == (left + n) % s)[0])
    return TurningPoint(float(now), -1)


class Touching(NamedTuple):
    """n touching nodes of rigid bodies with m motions.

    Attributes:
        opening: Opening rate of each motion, shape (n, m) [1].
        slip: Slip rate of each motion, shape (n, m), in space along two tangents (n, 2, m) [1].
        slope: Coefficient of friction mu_j, inf for nodes that cannot slip, shape (n,) [1].
        shear: Friction s_j0 without pressure, shape (n,) [force].
        adhesion: Largest tensile force a_j, shape (n,) [force].
    """

    opening: Array
    slip: Array
    slope: Array
    shear: Array
    adhesion: Array

    @classmethod
    def of(
        cls, contact: Contact, on: Flags, opening: Array, slip: Array, pressure: float
    ) -> Touching:
        """Some nodes of a contact, with friction at a typical pressure (local).

        Args:
            contact: The contact.
            on: The nodes, shape (slave nodes,).
            opening: See ``Touching``.
            slip: Likewise.
            pressure: The pressure [stress].
        """
        slope, shear = strength(contact.now, pressure)
        forces = contact.operators.weight * [shear, largest_adhesion(contact.now)]
        return cls(opening, slip, slope[on], *forces[:, on])

    @classmethod
    def joined(cls, parts: Sequence[Touching]) -> Touching:
        """The nodes of all parts (local)."""
        return cls(*map(np.concatenate, zip(*parts, strict=True)))


def unresisted_motion(loads: Array, touching: Touching) -> Array:
    """Rigid motion with the largest work of the loads that no contact force can resist (local).

    Limit analysis by linear programming. Loads with resultants w on the rigid motions v of all
    bodies are in equilibrium with contact forces that the law admits if and only if they do no work
    on any motion that these forces cannot resist (kinematic theorem, Charnes, Lemke & Zienkiewicz
    1959). With the opening rate g_j and the slip rate u_j of each touching node, and admissible
    forces p_j >= -a_j, |s_j| <= s_j0 + mu_j (p_j + a_j),

        maximize  (w - sum_j a_j g_j) . v - sum_j s_j0 |u_j|,    g_j >= mu_j |u_j|,    |v| <= 1.

    If the maximum is positive, the bodies move. If it is zero, contact may support them; the
    condition is necessary but not sufficient, since Coulomb's law is not associated: gaps do not
    open by as much as g_j >= mu_j |u_j| requires. The solution of the contact problem then decides.

    In space u_j is a vector. With k directions e_i around the normal, the largest e_i . u_j is at
    most |u_j|, and at least cos(pi / k) |u_j|: shears in the polygon with the corners e_i are
    admissible, and all admissible ones are in the polygon around the circle, larger by
    1 / cos(pi / k). Bodies that shears in the inner polygons can support are supported, those that
    shears in the outer ones cannot support move. If neither is the case, k is doubled; at last,
    with loads within 0.5 % of the limit load, contact may support them.

    Args:
        loads: Resultants of the loads along the motions, shape (m,) [force].
        touching: The touching nodes.

    Returns:
        Coefficients of the motions, shape (m,), of absolute value at most one [length]; zero if
        contact may support the bodies.

    Raises:
        ArithmeticError: If the linear program fails.
    """
    size = float(np.abs(loads).sum())
    if size == 0.0:
        return np.zeros(loads.size)
    if touching.slip.ndim == 2:
        return _largest_work(loads, touching, _slips_along(touching))
    friction = touching.slope.any() or touching.shear.any()
    motion = np.zeros(loads.size)
    for count in DIRECTIONS if friction else (1,):
        slips = _slips_along(touching, count)
        of_inner = _largest_work(loads, touching, slips)
        if not (friction and of_inner.any()):
            return of_inner
        motion = _largest_work(loads, touching, slips / np.cos(np.pi / count))
        if motion.any():
            break
    return motion


def _slips_along(touching: Touching, count: int = DIRECTIONS[0]) -> Array:
    """Slips along both senses, in space along ``count`` directions, (n, k, m) [1] (local)."""
    if touching.slip.ndim == 2:
        return np.stack([touching.slip, -touching.slip], axis=1)
    angles = 2.0 * np.pi / count * np.arange(count)
    return np.einsum("ck,jcm->jkm", [np.cos(angles), np.sin(angles)], touching.slip)


def motion_past(loads: Array, touching: Touching, gaps: Array, slips: Array) -> Array | None:
    """Rigid motion without overlaps against which loads and friction do the least work (local).

    The forces at nodes are those of an equilibrium, and friction there has the limits of these:

        minimize  -w . v + sum_j s_j0 |u_j0 + u_j|,    g_j0 + g_j >= 0,

    to which resistance of motions themselves is added, so that bodies stay that nothing pushes. It
    is not negative without gaps. Bodies slide, tip over, and carry others along as they would. Only
    in the plane.

    Args:
        loads: Resultants w of the loads in equilibrium with the contact forces, shape (m,) [force].
        touching: The nodes with ``shear`` as the limit of friction, and ``slope`` zero.
        gaps: Gaps g_j0 of the nodes, negative where they overlap, shape (n,) [length].
        slips: Slips u_j0 of the nodes so far, shape (n,) [length].

    Returns:
        Coefficients of the motions, shape (m,) [length]; ``None`` if overlaps are inevitable.
    """
    count = loads.size
    size = float(np.abs(loads).sum()) or 1.0
    none, resists = np.zeros(count), np.full(count, LAZY * size)
    lazy = Touching(np.zeros((count, count)), np.eye(count), none, resists, none)
    every = Touching.joined([touching, lazy])
    given = np.append(gaps, none), np.append(slips, none)
    found = _most_work(loads, every, _slips_along(every), *given, None)
    return found.x[:count] if found.success else None


def _largest_work(loads: Array, touching: Touching, slips: Array) -> Array:
    """``unresisted_motion`` with the largest of the ``slips`` (n, k, m) [1] for |u_j|."""
    none = np.zeros(len(slips))
    found = _most_work(loads, touching, slips, none, none, 1.0)
    if not found.success:
        raise ArithmeticError(f"linear program of rigid bodies: {found.message}")
    # SOLVED is above the feasibility tolerance of the linear program, 1e-7
    return found.x[: loads.size] if -found.fun > SOLVED else np.zeros(loads.size)


def _most_work(
    loads: Array, touching: Touching, slips: Array, gaps: Array, slipped: Array,
    largest: float | None,
) -> Any:  # fmt: skip
    """Motion with the most work of loads and least of friction, as scipy's ``linprog`` returns it.

    Args:
        loads: See ``unresisted_motion``, as ``touching``.
        touching: The nodes.
        slips: Rates whose largest at a node is |u_j|, shape (n, k, m) [1].
        gaps: Gaps that may close, negative if they have to open, shape (n,) [length].
        slipped: Slips so far, to which rates are added, in the plane only, shape (n,) [length].
        largest: Bound of all coefficients [length]; ``None`` for none.
    """
    size = float(np.abs(loads).sum()) or 1.0
    work = (loads - touching.adhesion @ touching.opening) / size
    sticks, bounded = np.isinf(touching.slope), touching.shear > 0.0
    slope, count = np.where(sticks, 0.0, touching.slope)[:, None], int(bounded.sum())
    along = np.moveaxis(slips, 1, 0)
    resisted = [slope * along - touching.opening, along[:, sticks], along[:, bounded]]
    rates = csr_array(np.concatenate([each.reshape(-1, loads.size) for each in resisted]))
    rubbing = np.arange(len(along) * count)  # the last rows: slips are at most the |u_j|
    at = rates.shape[0] - rubbing.size + rubbing, rubbing % count
    rows = hstack([rates, coo_array((-np.ones(rubbing.size), at), (rates.shape[0], count))])
    from scipy.optimize import linprog  # imported on first use: the import is slow

    least = np.zeros(rows.shape[0])
    least[: len(along) * gaps.size] = np.tile(gaps, len(along))
    if slipped.any():
        least[rates.shape[0] - rubbing.size :] = np.outer([-1.0, 1.0], slipped[bounded]).ravel()
    bounds = [(-largest if largest else None, largest)] * loads.size
    return linprog(
        np.concatenate([-work, touching.shear[bounded] / size]),
        A_ub=rows,
        b_ub=least,
        bounds=[*bounds, *[(0.0, None)] * count],
        method="highs",
        options={"presolve": False},  # in scipy 1.10 it reports feasible programs as infeasible
    )


def nearly_touching(contact: Contact) -> Flags:
    """Slave nodes whose gap closes in a motion considered as rest, (slave nodes,) (local)."""
    gap = np.nan_to_num(contact.now.closing_gap, nan=np.inf)
    near = gap < RIGID.overlap * contact.slave.nodal_lengths
    return np.asarray(near & contact.multiplier_nodes)


def touches(contact: Contact) -> Flags:
    """Active nodes and, if there are any, open ones that nearly touch, (slave nodes,) (local).

    Open nodes with adhesion do not: their forces are loads.
    """
    on = contact.active & ~contact.set_aside
    near = nearly_touching(contact) & ~contact.z.any(axis=1) & ~contact.set_aside
    return on | near if on.any() else on


def closest_move(
    desired: Array, closing: Sequence[Array], contacts: Sequence[Contact], back: Array | None = None
) -> Array:
    """The move closest to ``desired`` without overlaps above ``RIGID.overlap`` (local).

    Args:
        desired: Coefficients of the motions, shape (n,) [length].
        closing: Closing rates of the gaps of each contact, shape (slave nodes, n) each [1].
        contacts: The contacts, evaluated.
        back: Direction in which the move may have no component, shape (n,); none by default.

    Returns:
        Coefficients of the move, shape (n,) [length].
    """
    slack = [
        np.nan_to_num(c.now.closing_gap) + RIGID.overlap * c.slave.nodal_lengths for c in contacts
    ]
    rows = [np.empty((0, desired.size)), *closing]
    if back is not None:
        slack, rows = [*slack, np.zeros(1)], [*rows, back[None]]
    every = np.concatenate([np.empty(0), *slack])
    found, _ = nearest_below(desired, np.concatenate(rows), np.maximum(every, 0.0))
    assert found is not None  # zero satisfies all inequalities
    return found


def nearest_below(desired: Array, rows: Array, slack: Array) -> tuple[Array | None, Flags]:
    """The vector closest to ``desired`` with ``rows @ vector <= slack`` (local).

    A least-distance problem, solved by nonnegative least squares (Lawson & Hanson 1974, ch. 23).

    Args:
        desired: Shape (n,) [length].
        rows: Shape (m, n) [1].
        slack: Shape (m,) [length].

    Returns:
        The vector, shape (n,) [length], and the rows with a multiplier, shape (m,), bool. ``None``
        if there is none up to rounding, a million times the excess or size of ``desired`` away:
        these rows contradict one another.
    """
    excess = rows @ desired - slack
    if not (excess > 0.0).any():
        return desired, np.zeros(len(rows), bool)
    scale = max(float(excess.max()), float(np.abs(desired).max()))
    system = np.vstack([-rows.T, excess / scale])
    target = np.zeros(desired.size + 1)
    target[-1] = 1.0
    multipliers = nonnegative_least_squares(system, target)
    *change, last = system @ multipliers - target
    pressed = multipliers > 0.0
    return (desired - scale * np.array(change) / last if last < -SUM_ROUNDING else None), pressed


def largest_adhesion(f: ContactFields) -> Array:
    """Largest adhesion at gaps of up to a facet, shape (slave nodes,) [stress].

    Elastic bonds pull as they open. The gap is found to a per cent, if there is one maximum.
    """
    sizes = f.interface.slave.nodal_lengths
    if not f.interface.pair.law.has_adhesion:
        return 0.0 * sizes
    gap, largest = 0.0 * sizes, adhesion_at_gap(f, 0.0 * sizes)
    for ratio in 2.0 ** np.arange(-40.0, 1.0):
        pull = adhesion_at_gap(f, ratio * sizes)
        gap, largest = np.where(pull > largest, ratio * sizes, gap), np.maximum(pull, largest)
    for ratio in 2.0 ** np.outer(0.5 ** np.arange(1.0, 8.0), [1.0, -1.0]).ravel():
        pull = adhesion_at_gap(f, ratio * gap)
        gap, largest = np.where(pull > largest, ratio * gap, gap), np.maximum(pull, largest)
    return largest
