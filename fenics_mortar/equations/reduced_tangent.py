# SPDX-License-Identifier: MIT
"""Solves with the tangent of a linear bulk that is factored once, or with its transpose.

With the stiffness K of the bodies, factored with the supports H prescribed, the equations of
``linearized`` on the free dofs are

    K u + K_c u + B^T z = f - K_H u_H,        C u + A_z z = h.

On the contact dofs they are the dense system of ``reduced_dense``. One solve with K and the forces
of its solution yields u. The transposed equations have the same form: K_c^T replaces K_c, C^T
replaces B^T, B replaces C, and A_z^T replaces A_z. The values at prescribed dofs are computed last.

The dense system contains the multipliers with displacements in their rows, C. Multipliers of other
nodes, most of them open, are computed separately: for A x = b before it, since they exert forces,
and for A^T y = b after it, since they depend on the displacements.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.rows import Rows
from fenics_mortar.equations.reduced_dense import ContactMatrices, solve_alone, solve_dense
from fenics_mortar.la.compliance import Compliance
from fenics_mortar.la.contact_dofs import ContactDofs
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.errors import MortarError


class ReducedTangent:
    """The tangent of displacement and multipliers by factors of the bulk; methods are collective.

    Args:
        bulk: The bodies; their tangent is constant.
        system: System of displacements and multipliers, for numbers and scales.
        dofs: The contact dofs.
        compliance: Factors of the bulk.
        collect: Function that assembles ``ContactMatrices``, with scaled multipliers, from the rows
            of all contacts.
    """

    def __init__(
        self,
        bulk: Bulk,
        system: LinearSystem,
        dofs: ContactDofs,
        compliance: Compliance,
        collect: Callable[[Sequence[Rows]], ContactMatrices],
    ) -> None:
        self._bulk, self._system, self._dofs = bulk, system, dofs
        self._compliance, self._collect = compliance, collect
        self._away = ~bulk.prescribed[: bulk.num_owned]
        self._away[dofs.local] = False
        bulk.assemble_tangent()  # a step on all dofs may have added contact terms
        rows = (bulk.prescribed_dofs + bulk.first).astype(PETSc.IntType)
        self._K_H = bulk.K.createSubMatrix(PETSc.IS().createGeneral(rows, bulk.comm))

    @clock("assembly")
    def assemble(self) -> None:
        """See ``LinearSystem``."""
        self._parts = self._collect([c.rows.linearized() for c in self._system.contacts])
        self._coupled = self._system.with_others(self._parts.C.row)

    @clock("solve")
    def solve(self, b: Array, *, transpose: bool = False) -> Array:
        """See ``LinearSystem``."""
        prescribed = self._bulk.prescribed_dofs
        f, h = self._system.split(b)
        given, f[prescribed] = f[prescribed], 0.0
        if transpose:
            u, forces, z = self._solve(f, self._scaled(h), self._parts.transposed)
            u[prescribed] = given - self._support_forces(u) - forces[prescribed]
            return self._system.join(u, z)
        known = np.zeros_like(f)
        known[prescribed] = given
        u, _, z = self._solve(f - self._forces_by(given), h, self._parts, known)
        return self._system.join(u, self._scaled(z))

    def _solve(
        self, f: Array, h: Sequence[Array], matrices: ContactMatrices, known: Array | None = None
    ) -> tuple[Array, Array, list[Array]]:
        """Displacements and contact forces of the owned dofs, multipliers of the contacts.

        Args:
            f: Forces, owned dofs [stress length]; those on prescribed dofs are not used.
            h: Right-hand sides of the multipliers' rows, (slave nodes, 2) each.
            matrices: Matrices, complete on rank 0.
            known: Prescribed values, zero at free dofs, owned dofs [length]; zero by default.
        """
        d = self._without_contact(f)
        if known is not None:
            d = d + self._dofs.gather(known)
        solution = None
        if self._bulk.comm.rank == 0:
            solution = self._on_contact(d, h, matrices)
        solution = self._bulk.comm.bcast(solution)
        if solution is None:
            raise MortarError("the reduced linear system is singular")
        force, zeta = solution
        forces = np.zeros_like(f)
        self._dofs.put(force, forces)
        u = self._of_bulk(f - forces)
        if known is not None:
            u += known
        return u, forces, [zeta[z_dofs] for z_dofs in self._system.z_dofs]

    def _without_contact(self, f: Array) -> Array:
        """Displacements of the contact dofs under forces, (size,) [length]; complete on rank 0."""
        if self._bulk.comm.allreduce(bool(f[self._away].any())):
            return self._dofs.gather(self._of_bulk(f))
        return self._compliance.by_forces(self._dofs.gather(f))

    def _on_contact(
        self, d: Array, h: Sequence[Array], matrices: ContactMatrices
    ) -> tuple[Array, Array] | None:
        """Contact forces (size,) and multipliers (n,); ``None`` if singular (local)."""
        A, (rhs, weight) = self._compliance.A, np.empty((2, self._system.all_z_dofs))
        for (contact, z_dofs), values in zip(self._system.numbered(), h, strict=True):
            rhs[z_dofs], weight[z_dofs] = values, 1.0 / contact.stiffness[:, None]
        coupled = [z_dofs.ravel() for z_dofs in self._coupled]
        some = np.sort(np.concatenate([np.empty(0, np.int64), *coupled]))
        others = self._system.with_others(np.setdiff1d(np.arange(rhs.size), some))
        try:
            alone = solve_alone(matrices.A_z, others, rhs)
            pushed = matrices.B_T @ alone
            found = solve_dense(A, matrices, some, d - A @ pushed, rhs, weight)
            if found is None:
                return None
            u, force, z = found
            alone = solve_alone(matrices.A_z, others, rhs - matrices.C @ u)
        except np.linalg.LinAlgError:
            return None
        return force + pushed, z + alone

    def _of_bulk(self, f: Array) -> Array:
        """Displacements of the owned dofs under forces on the free ones, (owned dofs,) [length]."""
        force = self._bulk.r.duplicate()
        force.array[:] = f
        return np.array(self._compliance.solve(force).array_r)

    def _forces_by(self, given: Array) -> Array:
        """Forces K_H^T u_H of prescribed values, (owned dofs,) [stress length]."""
        forces, values = self._K_H.createVecs()
        values.array[:] = given
        self._K_H.multTranspose(values, forces)
        return np.array(forces.array_r)

    def _support_forces(self, u: Array) -> Array:
        """Forces K_H u at the prescribed dofs, (prescribed dofs,) [stress length]."""
        displacement, forces = self._K_H.createVecs()
        displacement.array[:] = u
        self._K_H.mult(displacement, forces)
        return np.array(forces.array_r)

    def _scaled(self, z: Sequence[Array]) -> list[Array]:
        """Values of each contact times the scale of its multipliers (local)."""
        scales = map(self._system.scale, self._system.contacts)
        return [values * scale for values, scale in zip(z, scales, strict=True)]
