# SPDX-License-Identifier: MIT
"""Limit analysis by linear programming: whether contact can support rigid bodies.

Loads with resultants w on the rigid motions v of all bodies are in equilibrium with contact forces
that the law admits if and only if they do no work on any motion that these forces cannot resist
(kinematic theorem, Charnes, Lemke & Zienkiewicz 1959). With the opening rate g_j and the slip rate
u_j of each touching node, and admissible forces p_j >= -a_j, |s_j| <= s_j0 + mu_j (p_j + a_j),

    maximize  (w - sum_j a_j g_j) . v - sum_j s_j0 |u_j|,    g_j >= mu_j |u_j|,    |v| <= 1.

If the maximum is positive, the bodies move. If it is zero, contact may support them; the condition
is necessary but not sufficient, since Coulomb's law is not associated: gaps do not open by as much
as g_j >= mu_j |u_j| requires. The solution of the contact problem then decides.

In space u_j is a vector. With k directions e_i around the normal, the largest e_i . u_j is at most
|u_j|, and at least cos(pi / k) |u_j|: shears in the polygon with the corners e_i are admissible,
and all admissible ones are in the polygon around the circle, larger by 1 / cos(pi / k). Bodies that
shears in the inner polygons can support are supported, those that shears in the outer ones cannot
support move. If neither is the case, k is doubled; at last, with loads within 0.5 % of the limit
load, contact may support them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array, hstack, vstack

from fenics_mortar.utils.rounding import SOLVED

Array = npt.NDArray[np.float64]
# Numbers of directions of slip in space, tried in turn [1]: with 32 the limit loads of inner and
# outer polygon differ by 0.5 %, as the error of the discretization.
DIRECTIONS = (8, 16, 32)


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


def unresisted_motion(loads: Array, touching: Touching) -> Array:
    """Rigid motion with the largest work of the loads that no contact force can resist (local).

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
        return _largest_work(loads, touching, np.stack([touching.slip, -touching.slip], axis=1))
    friction = touching.slope.any() or touching.shear.any()
    motion = np.zeros(loads.size)
    for count in DIRECTIONS if friction else (1,):
        slips = _along_directions(touching.slip, count)
        of_inner = _largest_work(loads, touching, slips)
        if not (friction and of_inner.any()):
            return of_inner
        motion = _largest_work(loads, touching, slips / np.cos(np.pi / count))
        if motion.any():
            break
    return motion


def _along_directions(slip: Array, count: int) -> Array:
    """Slips (n, 2, m) along ``count`` directions around the normal, shape (n, count, m) [1]."""
    angles = 2.0 * np.pi / count * np.arange(count)
    return np.einsum("ck,jcm->jkm", np.stack([np.cos(angles), np.sin(angles)]), slip)


def _largest_work(loads: Array, touching: Touching, slips: Array) -> Array:
    """See ``unresisted_motion``, with the largest of the ``slips`` (n, k, m) [1] for |u_j|."""
    size = float(np.abs(loads).sum())
    work = (loads - touching.adhesion @ touching.opening) / size
    sticks, bounded = np.isinf(touching.slope), touching.shear > 0.0
    slope, count = np.where(sticks, 0.0, touching.slope)[:, None], int(bounded.sum())
    along = np.moveaxis(slips, 1, 0)
    resisted = [
        *((slope * slip - touching.opening, 0.0) for slip in along),
        *((slip[sticks], 0.0) for slip in along),
        *((slip[bounded], 1.0) for slip in along),
    ]
    rows = vstack(
        [hstack([csr_array(row), -by_rate * _unit(len(row), count)]) for row, by_rate in resisted]
    )
    from scipy.optimize import linprog  # imported on first use: the import is slow

    costs = np.concatenate([-work, touching.shear[bounded] / size])
    bounds = [(-1.0, 1.0)] * loads.size + [(0.0, None)] * count
    found = linprog(
        costs,
        A_ub=rows,
        b_ub=np.zeros(rows.shape[0]),
        bounds=bounds,
        method="highs",
        options={"presolve": False},  # in scipy 1.10 it reports feasible programs as infeasible
    )
    if not found.success:
        raise ArithmeticError(f"linear program of rigid bodies: {found.message}")
    # SOLVED is above the feasibility tolerance of the linear program, 1e-7
    return found.x[: loads.size] if -found.fun > SOLVED else np.zeros(loads.size)


def _unit(rows: int, columns: int) -> csr_array:
    """Unit matrix if ``rows == columns``, else zeros, (rows, columns)."""
    shape = (rows, columns)
    return csr_array(np.eye(*shape)) if rows == columns else csr_array(shape)
