# SPDX-License-Identifier: MIT
"""Limit analysis of rigid bodies in contact at points: an independent check of friction.

The static theorem: equilibrium is possible if and only if there are contact forces within the law's
bounds that balance the loads, a linear program. A force at a point with the normal n and tangent t
is a sum p (n + mu t) + q (n - mu t) - r n with p, q >= 0 and r between 0 and the adhesion, where p
and q are zero if r > 0: integer variables. The duals of the balance are rigid motions: the
mechanism.

Coulomb's friction is not associated. If the program is infeasible, a body certainly moves. If it is
feasible, bodies that slide already may still move; bodies that have not slid remain at rest.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import linprog

Array = np.ndarray
# Forces below this fraction of the loads are rounding of the linear program [1].
ROUNDING = 1e-7
# Bounds of forces over the loads, and of velocities for which the live loads have unit power.
MOST_FORCE, FASTEST = 1e3, 1e3
GROUND = -1
# Factor of the live loads above which it is considered infinite.
MOST = 1e4


@dataclass(frozen=True)
class Point:
    """A point in which two bodies touch.

    Attributes:
        one, other: Numbers of the bodies, ``GROUND`` for clamped ones.
        x: Position, shape (2,) [length].
        n: Unit normal, along which the pressure acts on ``one``, shape (2,).
        mu: Coefficient of friction; infinite if contact always sticks.
        pull: Largest tension [force].
    """

    one: int
    other: int
    x: Array
    n: Array
    mu: float
    pull: float = 0.0


@dataclass(frozen=True)
class Structure:
    """Rigid bodies and their contact points; wrenches are (x, y, moment about the origin).

    Attributes:
        points: Contact points.
        dead: Constant loads, shape (bodies, 3).
        live: Scaled loads, shape (bodies, 3).
        guided: Which motions of a body are prescribed, shape (bodies, 3).
    """

    points: list[Point]
    dead: Array
    live: Array
    guided: Array = field(default_factory=lambda: np.zeros(0))

    def loaded(self, part: float) -> Structure:
        """The structure with a fraction of the live loads added to the dead ones."""
        return replace(self, dead=self.dead + part * self.live)

    def with_friction(self, factor: float) -> Structure:
        """The structure with all coefficients of friction multiplied by a factor."""
        return replace(self, points=[replace(p, mu=factor * p.mu) for p in self.points])


@dataclass(frozen=True)
class Verdict:
    """Result of limit analysis.

    Attributes:
        feasible: Whether some contact forces balance the dead loads.
        defect: Smallest sum of unbalanced loads, over the sum of the loads.
        factor: Largest multiple of the live loads that can be balanced in addition; infinite if
            unlimited, zero if the dead loads cannot be balanced.
        mechanism: Rates (x, y, angle) of the bodies that move at this factor, or under the dead
            loads alone if these cannot be balanced, shape (bodies, 3).
    """

    feasible: bool
    defect: float
    factor: float
    mechanism: Array


@dataclass(frozen=True)
class Program:
    """Elementary contact forces: their wrenches on the bodies, and their bounds.

    Attributes:
        A: Wrenches on the bodies, one column each.
        lower, upper: Bounds of the forces.
        pulls: Columns of pressure and pull of each point with adhesion: only one of the two acts,
            since friction is proportional to pressure alone.
    """

    A: Array
    lower: Array
    upper: Array
    pulls: list[tuple[list[int], int]]

    def solve(self, cost: Array, extra: Array, bounds: Array, right: Array) -> Any:
        """Minimize over the forces and some extra columns; ``right``: of the balance equations."""
        choices = len(self.pulls)
        forces, others = self.A.shape[1], extra.shape[1]
        whole = np.hstack([self.A, extra, np.zeros((len(right), choices))])
        limits = np.vstack([np.stack([self.lower, self.upper], axis=1), bounds])
        limits = np.vstack([limits, np.tile([0.0, 1.0], (choices, 1))])
        options: dict[str, Any] = {}
        if choices:
            most = MOST * max(float(np.abs(right).sum()), float(self.upper[self._last].max()))
            above = np.zeros((2 * choices, whole.shape[1]))
            for k, (press, pull) in enumerate(self.pulls):
                choice = forces + others + k
                above[2 * k, [pull, choice]] = 1.0, -self.upper[pull]
                above[2 * k + 1, press], above[2 * k + 1, choice] = 1.0, most
            kinds = np.r_[np.zeros(forces + others), np.ones(choices)]
            options = {"A_ub": above, "b_ub": np.tile([0.0, most], choices), "integrality": kinds}
            options["options"] = {"presolve": False}  # that of scipy 1.10 is wrong with integers
        cost = np.r_[np.zeros(forces), cost, np.zeros(choices)]
        return linprog(cost, A_eq=whole, b_eq=right, bounds=limits, method="highs", **options)

    @property
    def _last(self) -> list[int]:
        """Columns of the pulls."""
        return [pull for _, pull in self.pulls]


def judge(structure: Structure) -> Verdict:
    """Solve both programs: balance of the dead loads, and the largest factor of the live ones."""
    units, centre, size, force, push = _without_units(structure)
    program, rows = _program(units), _rows(structure)
    program = replace(program, A=program.A[rows])
    dead, live = units.dead.ravel()[rows], units.live.ravel()[rows]
    defect, motion = _least_defect(program, dead)
    feasible, factor = defect <= ROUNDING, 0.0
    if feasible:
        factor, motion = _largest_factor(program, dead, live)
    rates = np.zeros(structure.dead.size)
    rates[rows] = motion
    rates = rates.reshape(-1, 3) * np.array([1.0, 1.0, 1.0 / size])
    rates[:, :2] += rates[:, 2:] * np.array([centre[1], -centre[0]])
    return Verdict(feasible, defect, factor * force / push, rates)


def _without_units(structure: Structure) -> tuple[Structure, Array, float, float, float]:
    """The structure relative to the middle of its points, in units of its extent and its loads.

    Returns:
        The structure, the middle, the extent, and the sums of the dead and the live loads.
    """
    x = np.array([point.x for point in structure.points]).reshape(-1, 2)
    centre = x.mean(axis=0)
    size = float(np.abs(x - centre).max()) or 1.0
    loads, sums = [], []
    for rows in (structure.dead, structure.live):
        moments = rows[:, 2] - (centre[0] * rows[:, 1] - centre[1] * rows[:, 0])
        rows = np.column_stack([rows[:, :2], moments / size])
        loads.append(rows)
        sums.append(float(np.abs(rows).sum()))
    force, push = sums[0] or sums[1] or 1.0, sums[1] or 1.0
    points = [replace(p, x=(p.x - centre) / size, pull=p.pull / force) for p in structure.points]
    units = replace(structure, points=points, dead=loads[0] / force, live=loads[1] / push)
    return units, centre, size, force, push


def friction_needed(structure: Structure, *, most: float = 64.0, steps: int = 40) -> float:
    """Smallest factor of all coefficients of friction for which the dead loads can be balanced.

    Below one there is a margin; infinite if ``most`` does not suffice.
    """

    def borne(factor: float) -> bool:
        return judge(replace(structure.with_friction(factor), live=0.0 * structure.live)).feasible

    if borne(0.0):
        return 0.0
    low, high = 0.0, 1.0
    while not borne(high):
        low, high = high, 2.0 * high
        if high > most:
            return np.inf
    for _ in range(steps):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if borne(middle) else (middle, high)
        if high - low < 1e-6 * high:
            break
    return high


def least_factor(structure: Structure, *, seconds: float = 20.0) -> float:
    """Smallest multiple of the live loads at which bodies may move, for friction without adhesion.

    Coulomb's friction is not associated: sliding bodies do not separate, and may move below the
    factor of ``judge``, depending on statically indeterminate pressures. Here forces and a
    mechanism are computed together, such that both satisfy the law of friction: a point is open,
    sticks, or slides against its friction (Ferris & Tin-Loi 2001), chosen by integer variables.

    Args:
        structure: The bodies.
        seconds: Time limit.

    Returns:
        The factor, or that of the best mechanism found in time; infinite if there is none.
    """
    units, _, _, force, push = _without_units(structure)
    rows = _rows(structure)
    dead, live = units.dead.ravel()[rows], units.live.ravel()[rows]
    normal, tangent = (
        np.stack([_wrench(p, _along(p, k), len(units.dead)) for p in units.points], axis=1)[rows]
        for k in range(2)
    )
    mu = np.array([p.mu for p in units.points])
    m, n = normal.shape
    one, none = np.eye(n), np.zeros((n, n))
    still, no_factor = np.zeros((n, m)), np.zeros((n, 1))
    # Unknowns: velocities, factor, forces along n + mu t and n - mu t; open, slides on or back.
    balance = np.hstack([
        np.zeros((m, m)), live[:, None], normal + mu * tangent, normal - mu * tangent,
        np.zeros((m, 3 * n)),
    ])  # fmt: skip
    power = np.concatenate([live, np.zeros(5 * n + 1)])
    most, fast = MOST_FORCE * one, FASTEST * one
    modes = [
        [-normal.T, no_factor, none, none, none, none, none],
        [normal.T, no_factor, none, none, -fast, none, none],
        [tangent.T, no_factor, none, none, -fast, -fast, none],
        [-tangent.T, no_factor, none, none, -fast, none, -fast],
        [still, no_factor, one, one, most, none, none],
        [still, no_factor, one, none, none, most, none],
        [still, no_factor, none, one, none, none, most],
        [still, no_factor, none, none, one, one, one],
    ]
    bounds = [(-FASTEST, FASTEST)] * m + [(0.0, MOST)]
    bounds += [(0.0, MOST_FORCE)] * (2 * n) + [(0.0, 1.0)] * (3 * n)
    right = np.repeat([0.0, 0.0, 0.0, 0.0, MOST_FORCE, MOST_FORCE, MOST_FORCE, 1.0], n)
    found = linprog(
        np.eye(m + 1 + 5 * n)[m],
        A_ub=np.vstack([np.hstack(row) for row in modes]),
        b_ub=right,
        A_eq=np.vstack([balance, power]),
        b_eq=np.r_[-dead, 1.0],
        bounds=bounds,
        method="highs",
        integrality=np.r_[np.zeros(m + 1 + 2 * n), np.ones(3 * n)],
        options={"presolve": False, "time_limit": seconds},
    )
    return np.inf if found.x is None else float(found.fun) * force / push


def _along(point: Point, which: int) -> Array:
    """Normal (0) or tangent (1) of a point."""
    return point.n if which == 0 else np.array([-point.n[1], point.n[0]])


def _wrench(point: Point, force: Array, bodies: int) -> Array:
    """Wrenches of a force at a point on all bodies, shape (3 bodies,)."""
    wrench = np.zeros((bodies, 3))
    own = np.array([*force, point.x[0] * force[1] - point.x[1] * force[0]])
    for body, sign in ((point.one, 1.0), (point.other, -1.0)):
        if body != GROUND:
            wrench[body] += sign * own
    return wrench.ravel()


def _least_defect(program: Program, dead: Array) -> tuple[float, Array]:
    """Smallest sum of additional forces that balance the dead loads, and its duals."""
    rows = len(dead)
    extra = np.hstack([np.eye(rows), -np.eye(rows)])
    found = program.solve(np.ones(2 * rows), extra, np.tile([0.0, np.inf], (2 * rows, 1)), -dead)
    if found.status != 0:
        raise RuntimeError(f"linear program of the dead loads: {found.message}")
    return float(found.fun), _rates(program, found, rows)


def _largest_factor(program: Program, dead: Array, live: Array) -> tuple[float, Array]:
    """Largest multiple of the live loads, and the mechanism whose live power is one."""
    if not live.any():
        return np.inf, np.zeros_like(live)
    found = program.solve(np.array([-1.0]), live[:, None], np.array([[0.0, MOST]]), -dead)
    if found.status == 2:  # balanced up to rounding
        return 0.0, np.zeros_like(live)
    if found.status != 0:
        raise RuntimeError(f"linear program of the live loads: {found.message}")
    factor = -float(found.fun)
    return (np.inf if factor >= MOST else factor), _rates(program, found, len(dead))


def _rates(program: Program, found: Any, rows: int) -> Array:
    """Duals of the balance; programs with choices have none."""
    return np.zeros(rows) if program.pulls else -np.asarray(found.eqlin.marginals)


def _program(structure: Structure) -> Program:
    """The elementary contact forces of all points."""
    columns: list[Array] = []
    bounds: list[tuple[float, float]] = []
    pulls: list[tuple[list[int], int]] = []
    for point in structure.points:
        forces = _forces(point)
        first = len(columns)
        for force, low, high in forces:
            column = np.zeros((len(structure.dead), 3))
            wrench = np.array([*force, point.x[0] * force[1] - point.x[1] * force[0]])
            for body, sign in ((point.one, 1.0), (point.other, -1.0)):
                if body != GROUND:
                    column[body] += sign * wrench
            columns.append(column.ravel())
            bounds.append((low, high))
        if point.pull > 0.0:
            pulls.append((list(range(first, len(columns) - 1)), len(columns) - 1))
    A = np.array(columns).reshape(-1, structure.dead.size).T
    lower, upper = np.array(bounds).reshape(-1, 2).T
    return Program(A, lower, upper, pulls)


def _forces(point: Point) -> list[tuple[Array, float, float]]:
    """Elementary forces on the first body of a point, with bounds; the pull comes last."""
    t = np.array([-point.n[1], point.n[0]])
    if np.isinf(point.mu):
        forces = [(point.n, 0.0, np.inf), (t, -np.inf, np.inf)]
    elif point.mu > 0.0:
        forces = [(point.n + s * point.mu * t, 0.0, np.inf) for s in (1.0, -1.0)]
    else:
        forces = [(point.n, 0.0, np.inf)]
    return forces + ([(-point.n, 0.0, point.pull)] if point.pull > 0.0 else [])


def _rows(structure: Structure) -> Array:
    """Marks of the equations of balance: those of motions that are not prescribed."""
    if structure.guided.size == 0:
        return np.ones(structure.dead.size, bool)
    return ~structure.guided.astype(bool).ravel()


# Contact points of bodies
