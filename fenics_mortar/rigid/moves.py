# SPDX-License-Identifier: MIT
"""Rigid moves towards contact: closest to a given move, limited by the gaps of all nodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.utils.arrays import Array, Flags
from fenics_mortar.utils.rounding import MAX_STEPS, SUM_ROUNDING


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


def nonnegative_least_squares(A: Array, b: Array) -> Array:
    """The x >= 0 with the smallest |A x - b| (Lawson & Hanson 1974, ch. 23; local).

    SciPy has the same method, but some releases (1.15) return points that are not stationary if
    columns depend on one another, as those of the nodes of a facet under rigid motions do.

    Args:
        A: Shape (m, n), few rows [1].
        b: Shape (m,) [1].

    Returns:
        x, shape (n,) [1]; the columns with x > 0 are linearly independent.
    """
    x, positive = np.zeros(A.shape[1]), list[int]()
    refused = np.zeros(x.size, bool)  # columns that rounding alone lets enter
    least = SUM_ROUNDING * np.linalg.norm(A, axis=0) * np.linalg.norm(b)
    for _ in range(MAX_STEPS * x.size):
        descent = A.T @ (b - A @ x)
        descent[refused | (x > 0.0) | (descent <= least)] = 0.0
        if not descent.any():
            break
        entering = int(descent.argmax())
        solution = _least_squares(A, b, [*positive, entering])
        refused[entering] = solution[-1] <= 0.0
        if refused[entering]:
            continue
        refused[:] = False
        positive.append(entering)
        while solution.min(initial=1.0) <= 0.0:  # columns leave at the boundary
            now = x[positive]
            reach = np.full(now.size, np.inf)
            down = solution <= 0.0
            reach[down] = now[down] / (now[down] - solution[down])
            moved = now + reach.min() * (solution - now)
            stays = (moved > 0.0) & (reach > reach.min())
            x[positive] = np.where(stays, moved, 0.0)
            positive = [j for j, kept in zip(positive, stays, strict=True) if kept]
            solution = _least_squares(A, b, positive)
        x[positive] = solution
    return x


def _least_squares(A: Array, b: Array, columns: list[int]) -> Array:
    found: Array = np.linalg.lstsq(A[:, columns], b, rcond=None)[0]
    return found
