# SPDX-License-Identifier: MIT
"""Rigid moves towards contact: closest to a given move, limited by the gaps of all nodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.utils.arrays import Array, Flags
from fenics_mortar.utils.rounding import SUM_ROUNDING


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
    from scipy.optimize import nnls  # imported on first use: a tenth of the package's import time

    system = np.vstack([-rows.T, excess / scale])
    target = np.zeros(desired.size + 1)
    target[-1] = 1.0
    multipliers, _ = nnls(system, target)
    *change, last = system @ multipliers - target
    pressed = multipliers > 0.0
    return (desired - scale * np.array(change) / last if last < -SUM_ROUNDING else None), pressed
