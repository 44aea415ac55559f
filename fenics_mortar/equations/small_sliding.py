# SPDX-License-Identifier: MIT
"""Linear bulk and frictionless small sliding: the unknowns are the pressures of active nodes.

D, M and n are those of the undeformed mesh: contact forces act along B_n = B^T n, one column per
slave node, and the gap is linear. With g_0 the gap without contact forces, the pressures solve the
linear complementarity problem

    g = g_0 + S p >= 0,    p >= 0,    p . g = 0,    S = B_n^T K^-1 B_n,

A column of S is computed when its node becomes active.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, solve
from scipy.sparse import csr_array

from fenics_mortar.contact.interface import Interface
from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.equations.reduced import ReducedEquations
from fenics_mortar.equations.reduced_tangent import ReducedTangent
from fenics_mortar.la.compliance import Compliance, FactoredBulk
from fenics_mortar.la.costs import costs_of
from fenics_mortar.la.factored import column_groups, factored_bulk
from fenics_mortar.newton.loop import Step
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.errors import MortarError


class SmallSlidingEquations(ReducedEquations):
    """Equations for small sliding, reduced to the pressures of active nodes.

    Args:
        general: The general equations, with linear bulk and without floating bodies.
        prefix: Prefix of PETSc's options.
    """

    def __init__(self, general: ContactEquations, prefix: str) -> None:
        super().__init__(general, prefix)
        self._prefix = prefix
        first = [z_dofs[:, 0] for z_dofs in self._system.z_dofs]
        order = np.argsort(np.argsort(np.concatenate([np.empty(0, np.int64), *first])))
        self._count = order.size
        self._numbers = np.split(order, np.cumsum([part.size for part in first])[:-1])
        self._multiplier_nodes = np.empty(0, bool)
        self._open: list[Array] = []

    def _numbered(self) -> Iterator[tuple[Interface, Indices]]:
        """Each contact with the numbers of its nodes' pressures, (slave nodes,)."""
        return zip(self._system.contacts, self._numbers, strict=True)

    def _factor(self, prefix: str) -> Any:
        return FactoredBulk(self._bulk, self._dofs, factored_bulk(self._bulk, prefix))

    def tangent(self) -> ReducedTangent | None:
        """See ``ReducedEquations``; the compliance is computed first if this reduces the cost."""
        unknowns, dofs = self._bulk.r.getSize(), self._dofs.size
        costs = costs_of(self._bulk.space.dim)
        factors = costs.factors(unknowns, costs.expected)
        pays = costs.fits(unknowns, dofs) and costs.compliance(unknowns, dofs) < factors
        if self._tangent is None and pays:
            self._bulk.assemble_tangent()  # a step on all dofs may have added terms to it
            compliance = Compliance(self._bulk, self._dofs, self._prefix)
            self._tangent = self._tangent_by(compliance)
        return self._tangent

    def advance(self) -> Step:
        """Solve for the pressures of the active nodes; move the surfaces."""
        u = self._bulk.u.x.array
        before = u.copy()
        if self._force is None:
            self._move_without_contact()
        else:
            self._dofs.put(self._start, u)
        self._find_gaps()
        with clock("assembly"):
            pushes = self._pushes()
        with clock("solve"):
            self._update_responses(pushes)
            zeta, step, self._force = self._solve_pressures(pushes)
        moved = np.zeros_like(u)
        self._dofs.put(step, moved)
        u += moved
        self._balance(self._force)
        for contact, numbers in self._numbered():
            scale = zeta[numbers] * self._system.scale(contact)[:, 0]
            contact.change(z=scale[:, None] * contact.operators.n)
        return self._general.step(self._bulk.largest(u - before))

    @clock("solve")
    def _move_without_contact(self) -> None:
        """Compute the displacement of all dofs without contact forces."""
        u, prescribed = self._bulk.u, self._bulk.prescribed_dofs
        u.x.array[prescribed] += self._bulk.distance_to_prescribed()
        u.x.scatter_forward()
        self._bulk.assemble_residual()
        rest = self._bulk.r.duplicate()
        rest.array[:] = -self._bulk.r.array_r
        u.x.array[: self._bulk.num_owned] += self._compliance.solve(rest).array_r
        u.x.scatter_forward()
        self._start = self._dofs.gather(u.x.array)

    def _find_gaps(self) -> None:
        """Compute gaps k_j g_j / D_jj without contact; drop columns if multiplier nodes changed."""
        multiplier_nodes = np.concatenate(
            [contact.multiplier_nodes for contact in self._general.contacts]
        )
        if not np.array_equal(multiplier_nodes, self._multiplier_nodes):
            self._multiplier_nodes = multiplier_nodes
            self._responses = np.zeros((self._dofs.size, self._count))
            self._known = np.zeros(self._count, bool)
            self._open = []
        if self._force is None or not self._open:
            self._general.evaluate_operators()
            self._open = [contact.operators.gap for contact in self._general.contacts]
        self._gaps, self._active = np.zeros(self._count), np.zeros(self._count, bool)
        for (contact, numbers), gap in zip(self._numbered(), self._open, strict=True):
            self._gaps[numbers] = self._system.scale(contact)[:, 0] * gap
            self._active[numbers] = contact.active

    def _pushes(self) -> csr_array:
        """B_n of the slave nodes, (size, slave nodes), complete on rank 0."""
        size = self._system.all_z_dofs
        normals, columns = np.empty(size), np.empty(size, np.int64)
        for (contact, z_dofs), numbers in zip(self._system.numbered(), self._numbers, strict=True):
            normals[z_dofs], columns[z_dofs] = contact.operators.n, numbers[:, None]
        entries = normals, (np.arange(size), columns)
        B_T = self._collect(self._system.force_blocks(), (self._dofs.size, size), (True, False))
        return B_T.tocsr() @ csr_array(entries, shape=(size, self._count))

    def _update_responses(self, pushes: csr_array) -> None:
        """Compute the displacements due to pressures of newly active nodes."""
        new = np.flatnonzero(self._active & ~self._known)
        for group in column_groups(new.size):
            forces = pushes[:, new[group]].T.tocsr()
            self._responses[:, new[group]] = self._compliance.responses(forces)
        self._known[new] = True

    def _solve_pressures(self, pushes: csr_array) -> tuple[Array, Array, Array]:
        """Pressures zeta (slave nodes,), resulting displacements and forces, (size,) each."""
        zeta, a, pressures = np.zeros(self._count), np.flatnonzero(self._active), None
        if not a.size:
            pressures = np.empty(0)
        elif self._comm.rank == 0:
            S = pushes[:, a].T @ self._responses[:, a]
            with suppress(LinAlgError):
                pressures = solve(S, -self._gaps[a], assume_a="pos")
        pressures = self._comm.bcast(pressures)
        if pressures is None:
            raise MortarError("the reduced linear system is singular")
        zeta[a] = pressures
        force = self._comm.bcast(pushes @ zeta if self._comm.rank == 0 else None)
        return zeta, -self._responses @ zeta, force
