# SPDX-License-Identifier: MIT
"""Residual of all equations: forces of bodies, contacts and driven motions, and their norm.

Forces of the bulk and of contact balance at free dofs. Rows of multipliers, driven motions and
prescribed dofs are converted to forces, so that one norm measures all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.law_calls import raise_stored
from fenics_mortar.contact.tied import Tie
from fenics_mortar.equations.roundoff import check_equal_on_ranks, roundoff_of
from fenics_mortar.kernels.forces import add_forces
from fenics_mortar.rigid.driven import DrivenMotions
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.ranks import sum_over_ranks


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
        """Contributions of shear to contact and obstacle forces; see ``forces`` for shapes."""
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
