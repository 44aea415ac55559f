# SPDX-License-Identifier: MIT
"""Compliance of the contact dofs: displacements due to contact forces and prescribed values.

``ContactDofs`` numbers the dofs of all contact surfaces one after the other; ``Compliance`` has
their responses.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np
from scipy.linalg import LinAlgError, inv, lapack
from scipy.sparse import csr_array

from fenics_mortar.la.solver import column_groups, factored_bulk, factored_by_cholmod, supported
from fenics_mortar.la.sparse import SomeRows, is_indefinite, schur_complement
from fenics_mortar.utils import errors, ranks
from fenics_mortar.utils.arrays import SOLVED, Array, Indices

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.interface import Interface


class ContactDofs(SomeRows):
    """Dofs of all contact surfaces with consecutive numbers, replicated.

    Attributes:
        size: Number of contact dofs.
        free: Whether a dof is not prescribed, shape (size,), bool.
        free_globals: Global numbers of the dofs, -1 for prescribed ones, shape (size,).
    """

    def __init__(self, contacts: Sequence[Interface], bulk: Bulk) -> None:
        self._surfaces = [side for contact in contacts for side in (contact.slave, contact.master)]
        dofs = np.concatenate([surface.dofs for surface in self._surfaces])
        super().__init__(dofs, bulk.first, bulk.num_owned)
        self.size = self.rows.size
        self.free = self.gather(bulk.prescribed.astype(float)) == 0.0
        self.free_globals: Indices = np.where(self.free, self.rows, -1)

    def gather(self, values: Array) -> Array:
        """``values`` (local dofs,) [any unit] at the contact dofs, shape (size,) (collective)."""
        result = np.zeros(self.size)
        for surface in self._surfaces:
            result[self.number(surface.dofs)] = surface.gather(values)
        return result

    def put(self, values: Array, target: Array) -> None:
        """Write ``values`` (size,) into ``target`` (local dofs,) (local)."""
        for surface in self._surfaces:
            target[surface.local_dofs] = values[self.number(surface.dofs[surface.owned])]


# Number of single solves after which factors by CHOLMOD pay: they take about 40 times as long as a
# solve by them saves (0.3 s and 8 ms at 41,000 unknowns, 1.5 s and 33 ms at 152,000).
MANY_SOLVES = 40


class Compliance:
    """Response of the contact dofs to forces on them and to prescribed values (collective).

    Args:
        bulk: The bodies; their tangent is constant and assembled.
        dofs: The contact dofs.
        prefix: Prefix of PETSc's options.

    Attributes:
        A: Displacements of the contact dofs due to unit forces on them, zero for prescribed dofs,
            shape (size, size) on rank 0, (0, 0) on other ranks [1 / stress].
    """

    def __init__(self, bulk: Bulk, dofs: ContactDofs, prefix: str) -> None:
        self._bulk, self._dofs = bulk, dofs
        free = ~bulk.prescribed[dofs.local]
        self._numbers, self._local = dofs.numbers[free], dofs.local[free]
        self.A, self._factors = _compliance(bulk, dofs, prefix)
        if not self._is_accurate():
            self._factors.destroy()
            self._factors = factored_bulk(bulk, prefix)
            self.A = self._by_columns()
        self._prefix, self._num_solves = prefix, 0
        self._changes = np.empty((0, bulk.prescribed_dofs.size))
        self._responses_to_changes = np.empty((0, dofs.size))

    def responses(self, forces: csr_array) -> Array:
        """Displacements of the contact dofs due to forces on them (collective).

        Args:
            forces: One load a row, shape (k, size) [stress length], used on rank 0 only; k up to
                ``solver.COLUMNS``. Forces on prescribed dofs are dropped.

        Returns:
            Displacements, zero at prescribed dofs, shape (size, k) [length].
        """
        count, loads = forces.shape[0], self._loads(forces)
        sizes = (self._bulk.num_owned, None), (None, count)
        moved = PETSc.Mat().createDense(sizes, comm=self._bulk.comm)
        moved.setUp()
        moved.assemble()
        self._factors.getFactorMatrix().matSolve(PETSc.Mat().createTranspose(loads), moved)
        values = np.zeros((self._dofs.size, count))
        values[self._numbers] = moved.getDenseArray()[self._local]
        loads.destroy()
        moved.destroy()
        return ranks.sum_over_ranks(self._bulk.comm, values)

    def _loads(self, forces: csr_array) -> PETSc.Mat:
        """Forces (k, size) as rows (k, dofs), all on rank 0, as MUMPS requires (collective)."""
        here = self._bulk.comm.rank == 0
        forces = forces[: forces.shape[0] if here else 0].tocoo()
        columns = self._dofs.free_globals[forces.col]
        kept = columns >= 0
        size = forces.shape[0], self._bulk.r.getSize() if here else 0
        rows = csr_array((forces.data[kept], (forces.row[kept], columns[kept])), shape=size)
        csr = rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.data
        sizes = (size[0], None), (size[1], None)
        return PETSc.Mat().createAIJ(sizes, csr=csr, comm=self._bulk.comm)

    def solve(self, force: PETSc.Vec) -> PETSc.Vec:
        """Displacement due to forces on the free dofs; changes ``force`` (collective).

        On one rank, after many solves, by new factors of CHOLMOD.
        """
        self._num_solves += 1
        if self._num_solves == MANY_SOLVES and self._bulk.comm.size == 1:
            self._bulk.assemble_tangent()  # a step on all dofs may have added terms to it
            faster = factored_by_cholmod(supported(self._bulk), self._prefix)
            if faster is not None:
                self._factors.destroy()
                self._factors = faster
        return self._solve(force)

    def _solve(self, force: PETSc.Vec) -> PETSc.Vec:
        """Solve by the present factors."""
        force.array[self._bulk.prescribed_dofs] = 0.0
        response = force.duplicate()
        self._factors.apply(force, response)
        return response

    def _is_accurate(self) -> bool:
        """Whether A and the factors are accurate (collective).

        With fixed contact dofs K may be singular though K itself is not, if it is indefinite: an
        incompressible body inside a rigid boundary. K and A are then compared for one load.
        """
        bulk, dofs = self._bulk, self._dofs
        if not is_indefinite(self._factors.getFactorMatrix()):
            return True
        force, rest = bulk.K.createVecs()
        given = np.where(dofs.free, np.cos(np.arange(dofs.size)), 0.0)
        dofs.put(given, force.array)
        response = self._solve(force)
        bulk.K.mult(response, rest)
        rest.axpy(-1.0, force)
        rest.array[bulk.prescribed_dofs] = 0.0
        balances = rest.norm() <= SOLVED * force.norm()
        moved, by_A = dofs.gather(response.array_r), self.by_forces(given)
        agrees = np.linalg.norm(by_A - moved) <= SOLVED * np.linalg.norm(moved)
        return bool(balances and bulk.comm.bcast(bool(agrees)))

    def _by_columns(self) -> Array:
        """A column by column, by complete factors (collective)."""
        size, here = self._dofs.size, self._bulk.comm.rank == 0
        A = np.zeros((size, size) if here else (0, 0))
        for group in column_groups(size):
            entries = np.ones(group.size), (np.arange(group.size), group)
            columns = self.responses(csr_array(entries, shape=(group.size, size)))
            if here:
                A[:, group] = columns
        return A

    def by_forces(self, forces: Array) -> Array:
        """Displacements (size,) [length] due to ``forces`` (size,); 0 on ranks > 0 (local)."""
        return self.A @ forces if self._bulk.comm.rank == 0 else np.zeros_like(forces)

    def by_prescribed(self, change: Array, rounding: float) -> Array:
        """Change of the free contact dofs due to a change of prescribed values (collective).

        Responses to an orthonormal basis of all earlier changes are stored; only the component
        orthogonal to the basis needs a solve.

        Args:
            change: Change of the owned prescribed dofs, shape (prescribed dofs,) [length].
            rounding: Norm of a change below which it is roundoff [length].

        Returns:
            Contribution of this rank, shape (size,) [length].
        """
        parts = np.zeros(len(self._changes))
        for _ in range(2):  # a second pass removes the rounding of the first
            more = self._bulk.comm.allreduce(self._changes @ change)
            parts, change = parts + more, change - more @ self._changes
        new = np.sqrt(self._bulk.comm.allreduce(float(change @ change)))
        if new > rounding:
            self._add_response(change / new)
            parts = np.append(parts, new)
        return parts @ self._responses_to_changes

    def _add_response(self, change: Array) -> None:
        """Add a unit change to the basis, with its response (collective)."""
        self._bulk.assemble_tangent()  # a step on all dofs may have added terms to it
        moved, force = self._bulk.K.createVecs()
        moved.array[self._bulk.prescribed_dofs] = -change
        self._bulk.K.mult(moved, force)
        response = np.where(self._dofs.free, self._dofs.gather(self.solve(force).array_r), 0.0)
        self._changes = np.vstack([self._changes, change])
        self._responses_to_changes = np.vstack([self._responses_to_changes, response])


def _compliance(bulk: Bulk, dofs: ContactDofs, prefix: str) -> tuple[Array, PETSc.PC]:
    """See ``Compliance.A``, inverse of the Schur complement of K on the free contact dofs; factors.

    On one rank the same factors also serve ``solve``; on several ranks PETSc does not solve with
    factors up to a Schur complement.

    Raises:
        MortarError: On all ranks, if K is singular.
    """
    rest = dofs.free_globals[dofs.free]
    factors = factored_bulk(bulk, prefix, rest)
    A, error = schur_complement(factors.getFactorMatrix(), rest.size), None
    try:
        A = _inverse(A) if A.size else A
    except LinAlgError:
        error = errors.MortarError("the stiffness of the bodies is singular")
    errors.raise_together(bulk.comm, error)
    if bulk.comm.rank == 0 and rest.size < dofs.size:
        A, free = np.zeros((dofs.size, dofs.size)), A
        A[np.ix_(dofs.free, dofs.free)] = free
    if bulk.comm.size > 1:
        factors.destroy()
        factors = factored_bulk(bulk, prefix)
    return A, factors


def _inverse(S: Array) -> Array:
    """Inverse of a symmetric matrix (n, n), faster if it is positive definite (local).

    Raises:
        LinAlgError: If it is singular.
    """
    L, fails = lapack.dpotrf(S, lower=1)  # zero above the diagonal
    if not fails:
        lower, fails = lapack.dpotri(L, lower=1, overwrite_c=1)
    return inv(S, overwrite_a=True) if fails else (lower + np.tril(lower, -1).T).T
