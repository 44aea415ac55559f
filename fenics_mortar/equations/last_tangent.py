# SPDX-License-Identifier: MIT
"""Newton iterations with the tangent of the iteration before.

Near the solution the tangent hardly changes. Let R_k be the residual at x_k, and T the tangent at
x_(k-1), the last one that was assembled. With d = x_k - x_(k-1), T d = -R_(k-1) and unchanged sets,

    R_k ~ (1/2) R''(d, d).

A further step s with the same tangent, T s = -R_k, leads to

    R_(k+1) ~ R''(d, s),    |R_(k+1)| ~ 2 |R_k| |s| / |d|.

If this is negligible beside the tolerance, a new tangent would not improve the result: assembly and
factorization are saved, often in the last iteration of a load step. The estimate only selects the
iteration: convergence is tested with the residual as in any other. In sliding and pressed blocks,
linear and quadratic, the residual was 0.1 to 4 times the estimate.

The step solves for increments of displacements and multipliers; the rows of multipliers have the
weights with which T was assembled.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.equations.increment import NO_MOTION, Increment
from fenics_mortar.equations.residual import Residual
from fenics_mortar.equations.set_record import SetRecord
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.newton.loop import forcing
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.ranks import on_all_ranks
from fenics_mortar.utils.rounding import TINY

# Estimated residual after a step with the last tangent, over the tolerance [1], up to which it is
# taken: as for linear solves, the rest does not show in the result.
NEGLIGIBLE = 0.01


class LastTangent:
    """The tangent of the last iteration, which may serve one more.

    Args:
        bulk: The bodies.
        residual: Residual of the last evaluated state.
        record: Sets and residuals of the iterations so far.
    """

    def __init__(self, bulk: Bulk, residual: Residual, record: SetRecord) -> None:
        self._bulk, self._residual, self._record = bulk, residual, record
        self.drop()

    def drop(self) -> None:
        """Exclude the present tangent from further iterations (local)."""
        self._matrix_state = -1  # as PETSc counts the changes of a matrix

    def keep(self, system: LinearSystem, increment: Increment) -> None:
        """Allow one further iteration with the tangent of a full step (collective).

        Args:
            system: The linear system.
            increment: Its solution, not yet applied.
        """
        changes = [z - c.z for c, z in zip(system.contacts, increment.z, strict=True)]
        self._matrix_state = system.matrix.stateGet()
        self._sizes = self._sizes_of(increment.u, changes)

    def step(self, system: LinearSystem, goal: float) -> Increment | None:
        """Solve with the last tangent if the iteration is expected to end there (collective).

        Args:
            system: The linear system.
            goal: Residual at which the iteration ends [stress length].

        Returns:
            The solution; ``None`` if a new tangent is needed.
        """
        residuals = self._record.residuals
        if self._matrix_state < 0 or self._record.num_changed or len(residuals) < 2:
            return None
        before, last = residuals[-2:]
        kept, allowed = self._matrix_state, NEGLIGIBLE * goal
        self.drop()
        # before the solve, by residuals: increments rarely decrease faster
        if not 2.0 * last * last <= allowed * before:
            return None
        if not on_all_ranks(system.comm, system.matrix.stateGet() == kept):
            return None
        step, changes = self._solve(system, goal)
        sizes = zip(self._sizes_of(step, changes), self._sizes, strict=True)
        ratios = [new / max(old, TINY) for new, old in sizes]
        if not 2.0 * last * max(ratios) <= allowed:
            return None
        system.num_kept += 1
        z = [c.z + change for c, change in zip(system.contacts, changes, strict=True)]
        return Increment(step, z, NO_MOTION, "")

    def _solve(self, system: LinearSystem, goal: float) -> tuple[Array, list[Array]]:
        """Increments of displacement and multipliers, with the present residuals (collective)."""
        system.solver.forcing = forcing(self._record.residuals, goal)
        f = -self._residual.total
        f[self._bulk.prescribed_dofs] = self._residual.distance
        rows = [
            -contact.rows.weighted(frame)
            for contact, frame in zip(system.contacts, system.frames, strict=True)
        ]
        return system.split(system.solve(system.join(f, rows)))

    def _sizes_of(self, step: Array, changes: Sequence[Array]) -> tuple[float, float]:
        """Largest increments of displacement [length] and multipliers [stress] (collective)."""
        of_z = max((float(np.abs(change).max(initial=0.0)) for change in changes), default=0.0)
        return self._bulk.largest(step), of_z
