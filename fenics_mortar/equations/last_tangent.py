# SPDX-License-Identifier: MIT
"""Newton iterations with the tangent of the iteration before.

Near the solution the tangent hardly changes. Let R_k be the residual at x_k, and T the tangent at
x_(k-1), the last one that was assembled. With d = x_k - x_(k-1), T d = -R_(k-1) and unchanged sets,

    R_k ~ (1/2) R''(d, d).

A further step s with the same tangent, T s = -R_k, leads to

    R_(k+1) ~ R''(d, s),    |R_(k+1)| ~ 2 |R_k| |s| / |d|.

If this is negligible beside the rounding of the residual, a new tangent would not improve the
result: assembly and factorization are saved, often in the last iteration of a load step. The
estimate only selects the iteration: convergence is tested with the residual as in any other. In
sliding and pressed blocks, linear and quadratic, with sizes of displacements, the residual was 0.3
to 7 times the estimate.

The step solves for increments of displacements and multipliers; the rows of multipliers have the
weights with which T was assembled.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from fenics_mortar.equations.increment import NO_MOTION, Increment
from fenics_mortar.equations.residual import Residual
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.newton.loop import forcing
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.ranks import on_all_ranks
from fenics_mortar.utils.rounding import TINY

# Estimated residual after a step with the last tangent, over the rounding of the residual [1]. Up
# to this value the step is taken, since the result is that of a new tangent.
MAX_ESTIMATE = 0.01


class LastTangent(NamedTuple):
    """The tangent of the last iteration, which may serve one more.

    Attributes:
        matrix_state: State of the system's matrix when it was assembled, as PETSc counts changes.
        size: Size of the step over that of the displacement [1].
    """

    matrix_state: int
    size: float

    def solve(
        self, system: LinearSystem, residual: Residual, residuals: Sequence[float], goal: float
    ) -> Increment | None:
        """Solve for a further step; ``None`` if a new tangent is better (collective).

        Args:
            system: The linear system.
            residual: Residual of the present state.
            residuals: Residuals of the iterations so far [stress length].
            goal: Residual at which the iteration ends [stress length].
        """
        if len(residuals) < 2 or estimate(residuals) > MAX_ESTIMATE * residual.attainable:
            return None
        if not on_all_ranks(system.comm, system.matrix.stateGet() == self.matrix_state):
            return None
        force = residual.force if system.solver.multigrid is not None else 0.0
        system.solver.forcing = forcing(residuals, goal, force, sets_change=False)
        f = -residual.total
        f[system.bulk.prescribed_dofs] = residual.distance
        rows = [
            -contact.rows.weighted(frame)
            for contact, frame in zip(system.contacts, system.frames, strict=True)
        ]
        with clock("solve"):
            step, changes = system.split(system.solve(system.join(f, rows)))
        z = [contact.z + change for contact, change in zip(system.contacts, changes, strict=True)]
        return Increment(step, z, NO_MOTION, "")

    def suffices(self, residual: Residual, residuals: Sequence[float], size: float) -> bool:
        """Whether the step is negligible beside the last one, by its size [1] (local)."""
        estimated = estimate(residuals, size / max(self.size, TINY))
        return estimated <= MAX_ESTIMATE * residual.attainable


def estimate(residuals: Sequence[float], ratio: float | None = None) -> float:
    """Estimated residual after a step with the last tangent [stress length] (local).

    Args:
        residuals: Residuals of the iterations so far, at least two [stress length].
        ratio: Size of the step over that of the last one [1]. Before it is known, that of the
            residuals, since displacements rarely decrease faster.
    """
    before, last = residuals[-2:]
    return 2.0 * last * (last / max(before, TINY) if ratio is None else ratio)
