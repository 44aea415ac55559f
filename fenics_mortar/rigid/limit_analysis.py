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
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array, hstack, vstack

from fenics_mortar.utils.rounding import SOLVED

Array = npt.NDArray[np.float64]


class Touching(NamedTuple):
    """n touching nodes of rigid bodies with m motions.

    Attributes:
        opening: Opening rate of each motion, shape (n, m) [1].
        slip: Slip rate of each motion, shape (n, m) [1].
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
    work = (loads - touching.adhesion @ touching.opening) / size
    sticks = np.isinf(touching.slope)
    cone = np.where(sticks, 0.0, touching.slope)[:, None] * touching.slip
    bounded = touching.shear > 0.0
    slip, count = touching.slip[bounded], int(bounded.sum())
    resisted = [
        (cone - touching.opening, 0.0),
        (-cone - touching.opening, 0.0),
        (touching.slip[sticks], 0.0),
        (-touching.slip[sticks], 0.0),
        (slip, 1.0),
        (-slip, 1.0),
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
