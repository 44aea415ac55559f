# SPDX-License-Identifier: MIT
"""The linear system of one Newton iteration: saddle point (Alg. 1) or condensed (Alg. 2).

Unknown are the increment dd and the *new* multiplier z (Foltyn & Vlach 2016, eq. 12), so the
right-hand side holds r = f_int - f_ext without the contact force:

    (K + K_c) dd + B^T z = -r         B^T z: +D^T z on slave, -M^T z on master rows
          C dd + A_z z   = rhs        rows of the contact law, see ``contact.Rows``

with K_c = d(B^T z^k)/dd. The multipliers are scaled to forces, z_j = k_j zeta_j / D_jj: this keeps
the system well conditioned where a node is only partly covered (nodal scaling, Popp, Seitz, Gee &
Wall 2013) and does not change the iterates.

Condensed: with a diagonal D the slave rows of an active node give z_j = -Z_j (r + K~ dd)_j,
Z_j = P_j / D_jj, where P_j leaves out prescribed components (eq. 14). Put in, the system is

    (Q K~ + C) dd = -Q r + rhs,       Q = 1 - B^T Z - A_z Z,

whose slave rows then hold the contact law.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np

from mpi4py import MPI
from petsc4py import PETSc

from fenics_mortar.bulk import Bulk
from fenics_mortar.contact import Contact
from fenics_mortar.errors import MortarError
from fenics_mortar.mortar import Block, dofs_of
from fenics_mortar.sparse import BlockMatrix
from fenics_mortar.surfaces import Array, Indices

Algorithm = Literal["condensed", "saddle"]
DIRECT = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
# A direct solver that leaves more than this part of the right-hand side has met a singular matrix.
LINEAR_TOLERANCE = 1e-5


class LinearSystem:
    """What both forms share: bulk and contact matrices, and the linear solver."""

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Contact], prefix: str, options: dict[str, Any]
    ) -> None:
        self.bulk, self.contacts, self.comm = bulk, contacts, bulk.comm
        self._K_c = BlockMatrix(self.comm, bulk.num_owned, bulk.num_owned, 2)
        self._C = BlockMatrix(self.comm, bulk.num_owned, bulk.num_owned, 2)
        self.ksp = PETSc.KSP().create(self.comm)
        self.ksp.setOptionsPrefix(prefix)
        database = PETSc.Options(prefix)
        for name, value in {**DIRECT, **options}.items():
            if not database.hasName(name):
                database.setValue(name, value)
        self.ksp.setFromOptions()
        self.matrix: PETSc.Mat | None = None

    def assemble(self) -> None:
        """Build ``matrix`` and the right-hand side from the present state (collective)."""
        raise NotImplementedError

    def solve(self) -> tuple[PETSc.Vec, list[Array]]:
        """Solve; return dd and the new multipliers of every contact (collective)."""
        raise NotImplementedError

    def _contact_tangent(self) -> PETSc.Mat:
        """K_c = d(B^T z)/dd at fixed z."""
        blocks: list[Block] = []
        for contact in self.contacts:
            if not contact.operators.linearization.frozen:
                blocks += contact.operators.force_derivative(contact.z)
        return self._K_c.assemble(blocks)

    def _hold(self, matrix: PETSc.Mat, rhs: PETSc.Vec, first_row: int) -> None:
        """Replace the rows of prescribed dofs by k (dd) = k (prescribed - present)."""
        held, distance = self.bulk.held, self.bulk.distance_to_prescribed()
        scale = max((float(c.stiffness.max()) for c in self.contacts), default=1.0)
        matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        matrix.zeroRows((held + first_row).astype(PETSc.IntType), diag=scale)
        rhs.array[held] = scale * distance

    def _solve_linear(self, matrix: PETSc.Mat, rhs: PETSc.Vec) -> PETSc.Vec:
        """Solve and check the answer: a singular matrix must not pass in silence."""
        solution = rhs.duplicate()
        self.ksp.setOperators(matrix)
        self.ksp.solve(rhs, solution)
        defect = rhs.duplicate()
        matrix.mult(solution, defect)
        defect.aypx(-1.0, rhs)
        relative = defect.norm() / max(rhs.norm(), np.finfo(float).tiny)
        reason = self.ksp.getConvergedReason()
        if reason < 0 or not relative <= LINEAR_TOLERANCE:
            raise MortarError(
                f"the linear system was not solved: PETSc's reason {reason}, remaining part of the "
                f"right-hand side {relative:.1e}"
            )
        return solution


class CondensedSystem(LinearSystem):
    """Displacements only (the paper's Alg. 2); needs dual multipliers."""

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Contact], prefix: str, options: dict[str, Any]
    ) -> None:
        super().__init__(bulk, contacts, prefix, options)
        for contact in contacts:
            if contact.pair.basis != "dual":
                raise ValueError(
                    f"algorithm='condensed' needs basis='dual', the pair '{contact.slave.name}' - "
                    f"'{contact.master.name}' has '{contact.pair.basis}': use algorithm='saddle'"
                )
        self._Q = BlockMatrix(self.comm, bulk.num_owned, bulk.num_owned, 2)
        self._rhs: PETSc.Vec

    def assemble(self) -> None:
        """Build Q K~ + C and -Q r + rhs."""
        K, K_c = self.bulk.K, self._contact_tangent()
        Q = self._Q.assemble(self._elimination())
        C = self._C.assemble(self._law_blocks())
        if self.matrix is not None:
            self.matrix.destroy()
        self.matrix = Q.matMult(K)
        contact_part = Q.matMult(K_c)
        contact_part.axpy(1.0, C, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self.matrix.axpy(1.0, contact_part, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        contact_part.destroy()
        self._rhs = self.matrix.createVecLeft()
        Q.mult(self.bulk.r, self._rhs)
        self._rhs.scale(-1.0)
        for contact in self.contacts:
            contact.slave.scatter_add(
                np.where(contact.active[:, None], contact.rows().rhs, 0.0), self._rhs.array
            )
        self._hold(self.matrix, self._rhs, self.bulk.first)

    def _elimination(self) -> Iterable[Block]:
        """Blocks of Q."""
        own = np.arange(self.bulk.first, self.bulk.first + self.bulk.num_owned)[:, None]
        yield Block(own, own, np.ones((own.size, 1, 1)))
        for contact in self.contacts:
            Z, nodes = self._inverse(contact), contact.slave.nodes
            for block in contact.force_blocks():
                j, component = block.columns // 2, block.columns % 2
                values = -block.values * Z[j, component][:, None, :]
                yield Block(block.rows, 2 * nodes[j] + component, values)
            mine = contact.slave.owned[contact.active[contact.slave.owned]]
            dofs = dofs_of(nodes, mine[:, None])
            yield Block(dofs, dofs, -contact.rows().A_z[mine] * Z[mine][:, None, :])

    def _inverse(self, contact: Contact) -> Array:
        """Diagonal of Z_j, zero for inactive nodes, shape (slave nodes, 2) [1 / length]."""
        diagonal = np.where(contact.active, contact.operators.diagonal, np.inf)
        return contact.free / diagonal[:, None]

    def _law_blocks(self) -> Iterable[Block]:
        """Blocks of C in the rows of the slave's displacement dofs."""
        for contact in self.contacts:
            for block in contact.rows().blocks:
                rows = 2 * contact.slave.nodes[block.rows // 2] + block.rows % 2
                yield Block(rows, block.columns, block.values)

    def solve(self) -> tuple[PETSc.Vec, list[Array]]:
        """Solve for dd, then recover z_j = -Z_j (r + K~ dd)_j."""
        dd = self._solve_linear(self.matrix, self._rhs)
        force = dd.duplicate()
        self.bulk.K.mult(dd, force)
        self._K_c.mat.multAdd(dd, force, force)
        total = force.array_r + self.bulk.r.array_r[: self.bulk.num_owned]
        return dd, [-self._inverse(c) * c.slave.gather(total) for c in self.contacts]


class SaddleSystem(LinearSystem):
    """Displacements and multipliers (the paper's Alg. 1)."""

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Contact], prefix: str, options: dict[str, Any]
    ) -> None:
        super().__init__(bulk, contacts, prefix, options)
        owners = np.concatenate([contact.slave.owners for contact in contacts])
        place = np.empty(owners.size, np.int64)
        place[np.argsort(owners, kind="stable")] = np.arange(owners.size)
        splits = np.cumsum([contact.slave.num_nodes for contact in contacts])[:-1]
        self.places: list[Indices] = np.split(place, splits)
        size, mine = bulk.num_owned, 2 * int((owners == self.comm.rank).sum())
        self._C = BlockMatrix(self.comm, mine, size)
        self._B_T = BlockMatrix(self.comm, size, mine)
        self._A_z = BlockMatrix(self.comm, mine, mine)
        self._rhs: PETSc.Vec

    def blocks(self) -> tuple[PETSc.Mat, PETSc.Mat, PETSc.Mat, PETSc.Mat]:
        """K + K_c, B^T, C and A_z, the last three for scaled multipliers zeta."""
        K = self.bulk.K.copy()
        K.axpy(1.0, self._contact_tangent(), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        B_T = self._B_T.assemble(self._force_blocks())
        C, A_z = self._C.assemble(self._law_blocks()), self._A_z.assemble(self._multiplier_blocks())
        return K, B_T, C, A_z

    def assemble(self) -> None:
        """Build the block matrix, as one sparse matrix with rows [dd, zeta] on each rank."""
        K, B_T, C, A_z = self.blocks()
        nest = PETSc.Mat().createNest([[K, B_T], [C, A_z]], comm=self.comm)
        if self.matrix is not None:
            self.matrix.destroy()
        self.matrix = PETSc.Mat()
        nest.convert("aij", out=self.matrix)
        nest.destroy()
        K.destroy()
        self._rhs = self.matrix.createVecLeft()
        size = self.bulk.num_owned
        self._rhs.array[:size] = -self.bulk.r.array_r[:size]
        for contact, place in zip(self.contacts, self.places, strict=True):
            self._rhs.array[size:].reshape(-1, 2)[self.local(contact, place)] = (
                contact.rows().rhs[contact.slave.owned]
            )
        self._hold(self.matrix, self._rhs, self.matrix.getOwnershipRange()[0])

    def local(self, contact: Contact, place: Indices) -> Indices:
        """Local positions of the multipliers owned here."""
        return place[contact.slave.owned] - self._A_z.mat.getOwnershipRange()[0] // 2

    def scale(self, contact: Contact) -> Array:
        """z_j / zeta_j, shape (slave nodes,) [stress / length]."""
        diagonal = np.where(contact.active, contact.operators.diagonal, contact.nodal_lengths)
        return contact.stiffness / diagonal

    def _force_blocks(self) -> Iterable[Block]:
        for contact, place in zip(self.contacts, self.places, strict=True):
            scale = self.scale(contact)
            for rows, columns, values in contact.force_blocks():
                j = columns // 2
                yield Block(rows, 2 * place[j] + columns % 2, values * scale[j][:, None, :])

    def _law_blocks(self) -> Iterable[Block]:
        for contact, place in zip(self.contacts, self.places, strict=True):
            for block in contact.rows().blocks:
                rows = 2 * place[block.rows // 2] + block.rows % 2
                yield Block(rows, block.columns, block.values)

    def _multiplier_blocks(self) -> Iterable[Block]:
        for contact, place in zip(self.contacts, self.places, strict=True):
            mine = contact.slave.owned
            dofs = 2 * place[mine][:, None] + np.arange(2)
            yield Block(dofs, dofs, contact.rows().A_z[mine] * self.scale(contact)[mine, None, None])

    def solve(self) -> tuple[PETSc.Vec, list[Array]]:
        """Solve for dd and zeta; z is handed to all ranks."""
        solution = self._solve_linear(self.matrix, self._rhs)
        size = self.bulk.num_owned
        dd = PETSc.Vec().createMPI((size, None), comm=self.comm)
        dd.array[:] = solution.array_r[:size]
        multipliers = []
        for contact, place in zip(self.contacts, self.places, strict=True):
            zeta = np.zeros((contact.slave.num_nodes, 2))
            mine = contact.slave.owned
            zeta[mine] = solution.array_r[size:].reshape(-1, 2)[self.local(contact, place)]
            self.comm.Allreduce(MPI.IN_PLACE, zeta)
            multipliers.append(zeta * self.scale(contact)[:, None])
        return dd, multipliers


SYSTEMS = {"condensed": CondensedSystem, "saddle": SaddleSystem}
