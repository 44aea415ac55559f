# SPDX-License-Identifier: MIT
"""Residual of all equations: forces of bodies, contacts and driven motions, and their norm.

Forces of the bulk and of contact balance at free dofs. Rows of multipliers, driven motions and
prescribed dofs are converted to forces, so that one norm measures all of them.

Roundoff of the residual, and check that contact rows are equal on all ranks.

Solution of the linearized equations.

Newton iterations with the tangent of the iteration before.

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

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.law_calls import raise_stored
from fenics_mortar.contact.tied import Tie
from fenics_mortar.kernels.blocks import add_forces
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.newton.loop import forcing
from fenics_mortar.rigid.driven import DrivenMotions
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.errors import MortarError
from fenics_mortar.utils.ranks import on_all_ranks, sum_over_ranks
from fenics_mortar.utils.rounding import EPSILON, SOLVED, TINY


def roundoff_of(
    bulk: Bulk, contacts: Sequence[Interface], displacement: float, stiffness: float
) -> float:
    """Attainable accuracy of the residual, limited by roundoff [stress length] (collective).

    Args:
        bulk: The bodies.
        contacts: All pairs.
        displacement: Largest displacement of bodies and obstacles [length].
        stiffness: Largest diagonal entry of the bulk tangent [stress].
    """
    roundoff = stiffness * math.sqrt(bulk.num_dofs) * displacement
    for c in contacts:
        steepest = max(stiffness, c.now.steepness)
        largest = float(np.abs(c.slave.X).max())
        loads = sum([flux.rounding() for flux in c.fluxes])
        roundoff += (steepest * largest + loads) * math.sqrt(c.slave.num_nodes)
    return 4.0 * EPSILON * roundoff


def check_equal_on_ranks(total: float, squares: float, force2: float, num_ranks: int) -> None:
    """Check that replicated contact rows are equal on all ranks (local).

    Args:
        total: Sum over the ranks of the squared norm of the rows.
        squares: Sum over the ranks of the squared norm to the power of two.
        force2: Square of the reference force.
        num_ranks: Number of ranks.

    Raises:
        MortarError: On all ranks, if the rows differ.
    """
    mean = total / num_ranks
    spread = math.sqrt(max(squares / num_ranks - mean**2, 0.0))
    if spread > SOLVED * max(mean, force2):  # roundoff of the spread is sqrt(EPSILON) = 1.5e-8
        raise MortarError(
            "the equations of contact differ between ranks: expected the same law, distance and "
            "attributes of contacts and obstacles on all ranks"
        )


class Residual:
    """Residual of the last evaluated state; all methods are collective.

    Args:
        bulk: Bulk residual and tangent.
        contacts: The bound pairs.
        floating: Bodies that Dirichlet conditions leave free to move rigidly.
        motions: The rigid motions.
        stiffest: Largest diagonal entry of the bulk tangent [stress].

    Attributes:
        total: Sum of bulk residual and contact forces, (owned dofs,) [stress length].
        distance: Distance to the prescribed values, (prescribed dofs,) [length].
        force: Reference force: the largest norm of contact forces, reactions and inertia. Fluxes
            of conductances are at most those of the bodies [stress length].
        gap: Largest mean gap of an active node over the node's length [1].
        attainable: ``roundoff`` at that state [stress length].
    """

    total: Array
    distance: Array
    force: float
    gap: float
    attainable: float

    def __init__(
        self,
        bulk: Bulk,
        contacts: Sequence[Contact | Tie],
        floating: FloatingBodies,
        motions: DrivenMotions,
        stiffest: float,
    ) -> None:
        self._bulk, self._contacts = bulk, contacts
        self._floating, self._motions, self._stiffest = floating, motions, stiffest
        self._conducts = np.zeros(bulk.num_owned, bool)
        for flux in (flux for contact in contacts for flux in contact.fluxes):
            self._conducts[flux.conducting_dofs] = True
        self._per_distance = stiffest / bulk.units[bulk.prescribed_dofs]
        self.begin()

    def begin(self) -> None:
        """Read the prescribed values, constant in a solve unless rigid boundaries are driven."""
        self._prescribed = self._bulk.prescribed_values()

    def measure(self) -> float:
        """Norm of all residuals, with the bulk residual already assembled [stress length]."""
        bulk = self._bulk
        prescribed = bulk.prescribed_dofs
        rows, self.gap = 0.0, 0.0
        if self._motions.movers:
            rows += float((self._motions.residual() ** 2).sum())
        for contact in self._contacts:
            squares, gap = contact.rows.measure()
            rows, self.gap = rows + squares, max(gap, self.gap)
        raise_stored(bulk.comm, self._contacts)
        if self._motions.remote:
            self.begin()
        self.distance = self._prescribed - bulk.values[prescribed]
        self.total = np.empty(bulk.num_owned)
        free, contact, reactions = add_forces(
            bulk.r.array_r, self.contact_force(), bulk.to_force, bulk.prescribed, self._conducts,
            self.total,
        )  # fmt: skip
        moves, inertia = self._per_distance * self.distance, 0.0
        if bulk.inertia is not None:
            inertia = (bulk.inertia.forces(bulk.u.x.array) ** 2).sum()
        sums = np.array([free + moves @ moves, contact, reactions, inertia, rows, rows * rows])
        if bulk.comm.size > 1:
            sums = sum_over_ranks(bulk.comm, sums)
            check_equal_on_ranks(
                float(sums[4]), float(sums[5]), float(sums[1:4].max()), bulk.comm.size
            )
        largest = sums[1:4].max()  # nan if one of them is
        self.force, self.attainable = math.sqrt(largest), self.roundoff()
        return math.sqrt(sums[0] + sums[4] / bulk.comm.size)  # equal on all ranks

    def driving(self) -> Array:
        """``total`` less the pushes on rigid boundaries, (owned dofs,) [stress length].

        Its resultants drive floating bodies.
        """
        return self.total - self._motions.pushed_nodes()

    def of_prescribed(self) -> float:
        """Norm of the rows of prescribed dofs, a lower bound of ``measure`` [stress length]."""
        rows = self._per_distance * self._bulk.distance_to_prescribed()
        return float(np.sqrt(self._bulk.comm.allreduce(float(rows @ rows))))

    def roundoff(self) -> float:
        """Attainable accuracy of the residual, limited by roundoff [stress length]."""
        largest, inertia = self._bulk.largest(self._bulk.values), self._bulk.inertia
        if self._motions.movers:
            largest = max(largest, self._motions.largest())
        stiffest = self._stiffest + (0.0 if inertia is None else inertia.stiffness)
        return roundoff_of(self._bulk, self._contacts, largest, stiffest)

    def forces(self) -> tuple[Array, Array, Array]:
        """Bulk residual, contact forces and forces on obstacles at the present state.

        Returns:
            Bulk residual and contact forces, (owned dofs,) each [stress length], whose sum at
            prescribed dofs is the support reaction; forces and moments that keep obstacles in
            place, (obstacles, 3), moments over ``RigidMotions.scales`` [stress length].
        """
        self._bulk.assemble_residual()
        bulk = self._bulk.r.array_r[: self._bulk.num_owned].copy()
        self._floating.add_spring_forces()
        return bulk, self.contact_force(), self._motions.obstacle_forces()

    def shear_forces(self) -> tuple[Array, Array]:
        """Contributions of shear to contact and obstacle forces; see ``kernels.blocks``."""
        return self.contact_force("shear"), self._motions.obstacle_forces("shear")

    @clock("assembly")
    def contact_force(self, multipliers: str = "z") -> Array:
        """B^T z and loads of fluxes, (owned dofs,); ``multipliers="shear"``: of the shear only.

        Units [stress length], those of fluxes [flux length].
        """
        force = np.zeros(self._bulk.num_owned)
        for contact in self._contacts:
            if multipliers == "z":
                contact.add_loads(force)
                continue
            on_slave, on_master = contact.operators.force(getattr(contact, multipliers))
            contact.slave.scatter_add(on_slave, force)
            contact.master.scatter_add(on_master, force)
        return force


# Motions of nothing that moves.
NO_MOTION: Array = np.zeros((0, 3))


class Increment(NamedTuple):
    """Solution of the linearized equations.

    Attributes:
        u: Increment of the displacement and other unknowns of the bulk, owned dofs [length].
        z: The new multipliers of each pair, shape (slave nodes, 2) [stress].
        motion: Increments of the motions of m obstacles and remote loads, shape (m, 3) [length];
            ``NO_MOTION`` if none moves.
        remark: Remarks on the solution; "" if there are none.
    """

    u: Array
    z: list[Array]
    motion: Array
    remark: str


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
