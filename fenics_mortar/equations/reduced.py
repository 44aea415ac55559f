# SPDX-License-Identifier: MIT
"""Linear bulk, factored once: Newton's method on the contact dofs alone.

With a constant symmetric K a solution without contact force changes by the forces q that contact
puts on the dofs S of its surfaces, and by the prescribed values of the dofs H, in proportion. After
a step that was taken whole the residual vanishes but for these, r_S = -q, and the next step is

    dd_S = d_S - A (K_c dd + B^T z)_S,        C dd + A_z z = rhs,

where d_S is the step without contact force and A = (K^-1)_SS the compliance. This is a small system
with the solutions of the large one; A is dense, and on rank 0. What a step without contact force
does is known too:

    d_S = -A r_S - W^T (prescribed - present)_H - (K^-1 r_I)_S,      W = K_HF (K^-1)_FS,

F being the dofs that are not held, I those of F not in S. Only new loads need the last term. A is
the inverse of a Schur complement, K with all but S eliminated. Of W there are products with the
changes of prescribed values so far, few of which are independent along a path. Inside the bodies
the displacement is found where Newton has ended.

Where all pairs slide little and without friction, D, M and n stay too: contact pushes along
B_n = B^T n, one column per slave node, and the gap is linear. With the displacement without contact
force, of gap g_0, what is left is a linear complementarity problem of the pressures,

    g = g_0 + S p >= 0,    p >= 0,    p . g = 0,    S = B_n^T K^-1 B_n,

and columns of S are solved for as nodes become active.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from scipy.linalg import LinAlgError, inv, solve
from scipy.sparse import coo_array, csr_array

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.pair import ContactPair
from fenics_mortar.contact.rows import Rows
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.mortar import Block
from fenics_mortar.la.sparse import SomeRows, flatten, is_symmetric, leave, schur_complement
from fenics_mortar.la.system import COMPLIANCE, DIRECT, LINEAR_TOLERANCE, options_added
from fenics_mortar.newton.loop import Status, Step
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.errors import MortarError, raise_together

# How K is factored, and by which part [%] of room more than foreseen; the next if that fails: on
# several ranks MUMPS may need far more.
FACTORS = (("cholesky", 50), ("cholesky", 300), ("lu", 300))
# How MUMPS orders what is eliminated: by approximate minimum fill. Its own choice takes longer than
# the factors, which are made once.
ORDERING = 0
# Columns of answers solved for at a time.
COLUMNS = 32
# An iteration of the general path costs as much as a compliance of about so many dofs.
DOFS_PER_ITERATION = 1000
# More contact dofs are reduced to on demand only: their compliance is a dense matrix.
MOST_DOFS = 8000


class ContactDofs(SomeRows):
    """The dofs of all contact surfaces, numbered through; equal on all ranks.

    Attributes:
        size: Their number.
        free: Whether they are not prescribed, shape (size,), bool.
        free_globals: Their global numbers, -1 for prescribed ones, shape (size,).
    """

    def __init__(self, contacts: Sequence[Contact], bulk: Bulk) -> None:
        self._surfaces = [side for contact in contacts for side in (contact.slave, contact.master)]
        dofs = np.concatenate([surface.dofs for surface in self._surfaces])
        super().__init__(dofs, bulk.first, bulk.num_owned)
        self.size = self._rows.size
        self.free = self.gather(bulk.prescribed.astype(float)) == 0.0
        self.free_globals: Indices = np.where(self.free, self._rows, -1)

    def gather(self, values: Array) -> Array:
        """Values at these dofs of a local array of all dofs, shape (size,) (collective)."""
        result = np.zeros(self.size)
        for surface in self._surfaces:
            result[self.number(surface.dofs)] = surface.gather(values)
        return result

    def put(self, values: Array, target: Array) -> None:
        """Write ``values`` (size,) into a local array of all dofs (local)."""
        for surface in self._surfaces:
            target[surface.local_dofs] = values[self.number(surface.dofs[surface.owned])]


def factored(K: PETSc.Mat, prefix: str, rest: Indices | None = None) -> PETSc.PC:
    """A symmetric matrix, factored by MUMPS, all of it or all but a ``rest`` (collective).

    Args:
        K: The matrix.
        prefix: Prefix of PETSc's options.
        rest: Rows and columns to leave, equal on all ranks: see ``sparse.schur_complement``.

    Raises:
        MortarError: On all ranks, if it cannot be.
    """
    for kind, room in FACTORS:
        pc = PETSc.PC().create(K.comm)
        pc.setOptionsPrefix(prefix)
        pc.setFromOptions()
        pc.setType(kind)  # whatever solves the whole system: many right-hand sides need factors
        pc.setFactorSolverType(DIRECT["pc_factor_mat_solver_type"])
        pc.setOperators(K)
        with options_added(prefix, {"mat_mumps_icntl_7": ORDERING, "mat_mumps_icntl_14": room}):
            if rest is not None:
                pc.setFactorSetUpSolverType()
                leave(pc.getFactorMatrix(), rest)
            pc.setUp()
        outcome = pc.getFactorMatrix().getMumpsInfog(1)
        if outcome >= 0:
            return pc
        pc.destroy()
    raise MortarError(f"the stiffness of the bodies was not factored: MUMPS says {outcome}")


def factored_by_cholmod(K: PETSc.Mat, prefix: str) -> PETSc.PC | None:
    """The same on one rank by CHOLMOD, ``None`` if it is not positive definite.

    A single load takes CHOLMOD a third of the time that it takes MUMPS, which is faster by far for
    many at once: 0.04 and 0.12 s, and 0.01 s for each of 32, at 169,000 unknowns.
    """
    pc = PETSc.PC().create(K.comm)
    pc.setOptionsPrefix(f"{prefix}single_")
    pc.setType("cholesky")
    pc.setFactorSolverType("cholmod")
    pc.setOperators(K)
    try:
        pc.setUp()
    except PETSc.Error:
        pc.destroy()
        return None
    return pc


def factored_bulk(
    bulk: Bulk, prefix: str, rest: Indices | None = None, *, single: bool = False
) -> PETSc.PC:
    """The tangent of bodies, factored with the prescribed dofs held (collective).

    Args:
        bulk: The bodies; their tangent is assembled.
        prefix: Prefix of PETSc's options.
        rest: See ``factored``.
        single: Whether loads come one by one.
    """
    held = PETSc.IS().createGeneral((bulk.held + bulk.first).astype(PETSc.IntType), bulk.comm)
    K = bulk.K.copy()
    K.zeroRowsColumns(held, diag=float(np.abs(K.getDiagonal().array_r).max(initial=1.0)))
    K.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    pc = factored_by_cholmod(K, prefix) if single and K.comm.size == 1 else None
    return pc or factored(K, prefix, rest)


class FactoredBulk:
    """K, factored with the prescribed dofs held (collective).

    Args:
        bulk: The bodies; their tangent is constant, and assembled.
        dofs: The contact dofs.
        prefix: Prefix of PETSc's options.
        single: Whether loads come one by one, to ``solve`` alone.
    """

    def __init__(self, bulk: Bulk, dofs: ContactDofs, prefix: str, *, single: bool = False) -> None:
        self._bulk, self._dofs = bulk, dofs
        self._pc = factored_bulk(bulk, prefix, single=single)
        free = ~bulk.prescribed[dofs.local]
        self._numbers, self._local = dofs.numbers[free], dofs.local[free]

    def answers(self, loads: PETSc.Mat) -> PETSc.Mat:
        """Displacements (dofs, k) by forces on free dofs, the rows of ``loads`` (k, dofs).

        The rows are all on rank 0, as MUMPS wants them.
        """
        count = loads.getSize()[0]
        answers = PETSc.Mat().createDense(
            ((self._bulk.num_owned, None), (None, count)), comm=self._bulk.comm
        )
        answers.setUp()
        answers.assemble()
        self._pc.getFactorMatrix().matSolve(PETSc.Mat().createTranspose(loads), answers)
        return answers

    def loads(self, forces: csr_array) -> PETSc.Mat:
        """Forces on the contact dofs, one load a row, (k, size), as rows for ``answers``.

        Those of rank 0 count. Held dofs take none.
        """
        here = self._bulk.comm.rank == 0
        forces = forces[: forces.shape[0] if here else 0].tocoo()
        columns = self._dofs.free_globals[forces.col]
        kept = columns >= 0
        size = forces.shape[0], self._bulk.r.getSize() if here else 0
        rows = csr_array((forces.data[kept], (forces.row[kept], columns[kept])), shape=size)
        csr = rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.data
        sizes = (size[0], None), (size[1], None)
        return PETSc.Mat().createAIJ(sizes, csr=csr, comm=self._bulk.comm)

    def at_contact(self, answers: PETSc.Mat) -> Array:
        """Owned part of ``answers`` at the contact dofs, shape (size, k); the rest is zero."""
        values = np.zeros((self._dofs.size, answers.getSize()[1]))
        values[self._numbers] = answers.getDenseArray()[self._local]
        return values

    def solve(self, force: PETSc.Vec) -> PETSc.Vec:
        """The displacement by forces on the free dofs; prescribed ones stay."""
        force.array[self._bulk.held] = 0.0
        answer = force.duplicate()
        self._pc.apply(force, answer)
        return answer


class Compliance(FactoredBulk):
    """The answers of the contact dofs to forces on them, and to prescribed values (collective).

    Args:
        bulk: The bodies; their tangent is constant, and assembled.
        dofs: The contact dofs.
        prefix: Prefix of PETSc's options.

    Attributes:
        A: Displacement of the contact dofs by unit forces on them, zero for prescribed ones, shape
            (size, size) on rank 0, (0, 0) on the others [1 / stress].
    """

    def __init__(self, bulk: Bulk, dofs: ContactDofs, prefix: str) -> None:
        self.A = _compliance(bulk, dofs, prefix)
        super().__init__(bulk, dofs, prefix, single=True)  # the other factors are gone
        self._changes = np.empty((0, bulk.held.size))
        self._answers = np.empty((0, dofs.size))

    def by_forces(self, forces: Array) -> Array:
        """Displacement of the contact dofs, zero on other ranks than 0 (local)."""
        return self.A @ forces if self._bulk.comm.rank == 0 else np.zeros_like(forces)

    def by_prescribed(self, change: Array, rounding: float) -> Array:
        """Change of the contact dofs that are free, by that of the held ones (local part).

        The changes so far have an orthonormal basis; only what is new in this one is solved for.

        Args:
            change: That of the held dofs.
            rounding: Size of a change that is rounding [length].
        """
        parts = np.zeros(len(self._changes))
        for _ in range(2):  # once leaves what rounding takes from the basis
            more = self._bulk.comm.allreduce(self._changes @ change)
            parts, change = parts + more, change - more @ self._changes
        new = np.sqrt(self._bulk.comm.allreduce(float(change @ change)))
        if new > rounding:
            self._learn(change / new)
            parts = np.append(parts, new)
        return parts @ self._answers

    def _learn(self, change: Array) -> None:
        """Add a change to the basis, and the answer to it."""
        self._bulk.assemble_tangent()  # which a step on all dofs may have added to
        moved, force = self._bulk.K.createVecs()
        moved.array[self._bulk.held] = -change
        self._bulk.K.mult(moved, force)
        answer = self._dofs.gather(self.solve(force).array_r)
        self._changes = np.vstack([self._changes, change])
        self._answers = np.vstack([self._answers, np.where(self._dofs.free, answer, 0.0)])


def _compliance(bulk: Bulk, dofs: ContactDofs, prefix: str) -> Array:
    """See ``Compliance``: the inverse of K with all but the free contact dofs eliminated.

    Raises:
        MortarError: On all ranks, if K is singular.
    """
    rest = dofs.free_globals[dofs.free]
    pc = factored_bulk(bulk, prefix, rest)
    A, error = schur_complement(pc.getFactorMatrix(), rest.size), None
    pc.destroy()
    try:
        A = inv(A, overwrite_a=True) if A.size else A
    except LinAlgError:
        error = MortarError("the stiffness of the bodies is singular")
    raise_together(bulk.comm, error)
    if bulk.comm.rank == 0 and rest.size < dofs.size:
        A, free = np.zeros((dofs.size, dofs.size)), A
        A[np.ix_(dofs.free, dofs.free)] = free
    return A


def portions(count: int) -> list[Indices]:
    """The numbers below ``count``, in parts that are solved for at a time."""
    return [np.arange(i, min(i + COLUMNS, count)) for i in range(0, count, COLUMNS)]


class ReducedEquations:
    """The equations of a problem for ``newton.solve``, on the contact dofs.

    Args:
        problem: A ``ContactProblem`` with linear bulk; none of its bodies floats.
        prefix: Prefix of PETSc's options.
    """

    _compliance: Compliance

    def __init__(self, problem: Any, prefix: str) -> None:
        self._problem, self._bulk, self._system = problem, problem.bulk, problem.system
        self._comm: MPI.Comm = self._bulk.comm
        self._dofs = ContactDofs(problem.contacts, self._bulk)
        self._compliance = self._factor(prefix)
        self._inside: npt.NDArray[np.bool_] = ~self._bulk.prescribed[: self._bulk.num_owned]
        self._inside[self._dofs.local] = False
        self._force: Array | None = None

    def _factor(self, prefix: str) -> Any:
        return Compliance(self._bulk, self._dofs, prefix)

    def evaluate(self, *, start: bool) -> Status:
        """As the problem's; after a step the residual is that of contact alone."""
        if start:
            self._force = None
            self._bulk.assemble_residual()
        return self._problem.look(start=start)

    def advance(self) -> Step:
        """Solve the small system; move the surfaces and the prescribed dofs."""
        u, held = self._bulk.u.x.array, self._bulk.held
        change = self._bulk.distance_to_prescribed()
        with clock("solve"):
            without_contact = self._step_without_contact(change)
        with clock("assembly"):
            laws = [contact.rows() for contact in self._problem.contacts]
            parts = self._assemble(laws)
        with clock("solve"):
            step, zeta, self._force = self._solve(without_contact, laws, *parts)
        moved = np.zeros_like(u)
        self._dofs.put(step, moved)
        moved[held] = change
        u += moved
        self._balance(self._force)
        for contact, place in self._system.numbered():
            z = zeta[place] * self._system.scale(contact)[:, None]
            contact.move(z, 1.0, moved[: self._bulk.num_owned])
        return self._problem.step(self._bulk.largest(moved))

    def _balance(self, force: Array) -> None:
        """Make the residual that of contact forces alone, as it is after a whole step."""
        r, held = self._bulk.r.array, self._bulk.held
        r[self._inside] = 0.0
        kept = r[held]
        self._dofs.put(-force, r)
        r[held] = kept

    def _step_without_contact(self, change: Array) -> Array:
        """d_S, for a ``change`` of the prescribed values; complete on rank 0."""
        r = self._bulk.r.array_r[: self._bulk.num_owned]
        step = self._compliance.by_forces(-self._dofs.gather(r))
        rounding = self._problem.noise() / self._problem.stiffest
        step += self._compliance.by_prescribed(change, rounding)
        rest = self._bulk.r.duplicate()
        rest.array[:] = np.where(self._inside, -r, 0.0)
        forces = self._bulk.to_force * rest.array_r
        if np.sqrt(self._comm.allreduce(float(forces @ forces))) > self._problem.noise():
            step += self._dofs.gather(self._compliance.solve(rest).array_r)
        moved = np.zeros(self._bulk.num_owned)
        moved[self._bulk.held] = change
        return np.where(self._dofs.free, step, 0.0) + self._dofs.gather(moved)

    def _assemble(self, laws: Sequence[Rows]) -> list[coo_array]:
        """K_c, B^T, C and A_z on the contact dofs, complete on rank 0."""
        system, size = self._system, self._dofs.size
        count = 2 * sum(place.size for place in system.places)
        return [
            self._collect(system.force_derivative(), (size, size), (True, True)),
            self._collect(system.force_blocks(), (size, count), (True, False)),
            self._collect(system.law_blocks(laws), (count, size), (False, True)),
            self._collect(system.multiplier_blocks(laws), (count, count), (False, False)),
        ]

    def _collect(
        self, blocks: Iterable[Block], shape: tuple[int, int], are_dofs: tuple[bool, bool]
    ) -> coo_array:
        """The blocks of all ranks, on rank 0; whether rows and columns are global dofs."""
        *places, v = flatten(blocks)
        i, j = (self._dofs.number(p) if are else p for p, are in zip(places, are_dofs, strict=True))
        parts = self._comm.gather((i, j, v)) or [(i, j, v)]
        i, j, v = (np.concatenate(part) for part in zip(*parts, strict=True))
        inside = (i >= 0) & (j >= 0)
        return coo_array((v[inside], (i[inside], j[inside])), shape=shape)

    def _solve(
        self,
        d: Array,
        laws: Sequence[Rows],
        K_c: coo_array,
        B_T: coo_array,
        C: coo_array,
        A_z: coo_array,
    ) -> tuple[Array, Array, Array]:
        """Step of the contact dofs, multipliers zeta (n, 2) and contact force of the solution."""
        rhs, weight = np.zeros((A_z.shape[0] // 2, 2)), np.ones((A_z.shape[0] // 2, 1))
        for (contact, place), law in zip(self._system.numbered(), laws, strict=True):
            rhs[place], weight[place, 0] = law.rhs, 1.0 / contact.stiffness
        answer = None
        if self._comm.rank == 0:
            answer = self._solve_dense(d, K_c, B_T, C, A_z, rhs.ravel(), np.repeat(weight, 2))
        answer = self._comm.bcast(answer)
        if answer is None:
            raise MortarError("the linear system was not solved, it may be singular")
        step, zeta, force = answer
        return step, zeta.reshape(-1, 2), force

    def _solve_dense(
        self,
        d: Array,
        K_c: coo_array,
        B_T: coo_array,
        C: coo_array,
        A_z: coo_array,
        rhs: Array,
        weight: Array,
    ) -> tuple[Array, Array, Array] | None:
        """The same on one rank; ``None`` if the system is singular.

        Unknown are the dofs that contact touches and the multipliers that act.
        """
        t = np.unique(np.concatenate([K_c.row, K_c.col, B_T.row, C.col]))
        a = np.unique(B_T.col)
        K_t, B_t = _dense(K_c, t, t), _dense(B_T, t, a)
        A_t = self._compliance.A[t]
        scale = weight[a, None]
        matrix = np.block(
            [
                [np.eye(t.size) + A_t[:, t] @ K_t, A_t[:, t] @ B_t],
                [scale * _dense(C, a, t), scale * _dense(A_z, a, a)],
            ]
        )
        right = np.concatenate([d[t], weight[a] * rhs[a]])
        try:
            x = np.linalg.solve(matrix, right)
        except np.linalg.LinAlgError:
            return None
        defect = np.linalg.norm(matrix @ x - right)
        if not defect <= LINEAR_TOLERANCE * np.linalg.norm(right):
            return None
        zeta, force = np.zeros(rhs.size), np.zeros(d.size)
        zeta[a] = x[t.size :]
        force[t] = K_t @ x[: t.size] + B_t @ zeta[a]
        return d - force[t] @ A_t, zeta, force

    def finish(self) -> None:
        """Find the displacement inside the bodies."""
        if self._force is None:
            return
        self._bulk.u.x.scatter_forward()
        self._bulk.assemble_residual()
        with clock("solve"):
            rest = self._bulk.r.duplicate()
            force = np.zeros(self._bulk.num_owned)
            self._dofs.put(self._force, force)
            rest.array[:] = -(self._bulk.r.array_r[: self._bulk.num_owned] + force)
            self._bulk.u.x.array[: self._bulk.num_owned] += self._compliance.solve(rest).array_r
        self._bulk.u.x.scatter_forward()

    def merge_sets(self, period: int) -> str:
        """As the problem's."""
        return self._problem.merge_sets(period)

    def seconds(self) -> dict[str, float]:
        """As the problem's."""
        return self._problem.seconds()

    def drifts(self) -> str:
        """See ``Equations``."""
        return self._problem.drifts()

    def diagnose(self) -> str:
        """As the problem's, of the whole bodies."""
        self.finish()
        return self._problem.diagnose()


def _dense(matrix: coo_array, rows: Indices, columns: Indices) -> Array:
    """Some rows and columns of a matrix, ascending; what is in others is left out."""
    inside = np.isin(matrix.row, rows) & np.isin(matrix.col, columns)
    i, j = (
        np.searchsorted(some, place[inside])
        for some, place in ((rows, matrix.row), (columns, matrix.col))
    )
    shape = rows.size, columns.size
    entries = np.bincount(i * shape[1] + j, matrix.data[inside], shape[0] * shape[1])
    return entries.reshape(shape).astype(np.float64)


class SmallSlidingEquations(ReducedEquations):
    """The same where all pairs slide little: pressures of active nodes alone are unknown.

    Args:
        problem: A ``ContactProblem`` with linear bulk; none of its bodies floats.
        prefix: Prefix of PETSc's options.
    """

    def __init__(self, problem: Any, prefix: str) -> None:
        super().__init__(problem, prefix)
        self._count = sum(place.size for place in self._system.places)
        self._carries = np.empty(0, bool)
        self._open: list[Array] = []

    def _factor(self, prefix: str) -> Any:
        return FactoredBulk(self._bulk, self._dofs, prefix)

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
            self._know_answers(pushes)
            zeta, step, self._force = self._solve_pressures(pushes)
        moved = np.zeros_like(u)
        self._dofs.put(step, moved)
        u += moved
        self._balance(self._force)
        for contact, place in self._system.numbered():
            scale = zeta[place] * self._system.scale(contact)
            contact.change(z=scale[:, None] * contact.operators.n)
        return self._problem.step(self._bulk.largest(u - before))

    @clock("solve")
    def _move_without_contact(self) -> None:
        """Move all dofs to where they were without contact."""
        u, held = self._bulk.u, self._bulk.held
        u.x.array[held] += self._bulk.distance_to_prescribed()
        u.x.scatter_forward()
        self._bulk.assemble_residual()
        rest = self._bulk.r.duplicate()
        rest.array[:] = -self._bulk.r.array_r
        u.x.array[: self._bulk.num_owned] += self._compliance.solve(rest).array_r
        u.x.scatter_forward()
        self._start = self._dofs.gather(u.x.array)

    def _find_gaps(self) -> None:
        """Gaps k_j g_j / D_jj without contact, and a clean slate if other nodes carry now."""
        carries = np.concatenate([contact.carries for contact in self._problem.contacts])
        if not np.array_equal(carries, self._carries):
            self._carries = carries
            self._answers = np.zeros((self._dofs.size, self._count))
            self._known = np.zeros(self._count, bool)
            self._open = []
        if self._force is None or not self._open:
            for contact in self._problem.contacts:
                contact.evaluate(self._bulk.u.x.array, self._problem.linearization)
            self._open = [contact.operators.gap for contact in self._problem.contacts]
        self._gaps, self._active = np.zeros(self._count), np.zeros(self._count, bool)
        for (contact, place), gap in zip(self._system.numbered(), self._open, strict=True):
            self._gaps[place] = self._system.scale(contact) * gap
            self._active[place] = contact.active

    def _pushes(self) -> csr_array:
        """B_n of the active nodes, (size, slave nodes), complete on rank 0."""
        normals = np.zeros((self._count, 2))
        for contact, place in self._system.numbered():
            normals[place] = contact.operators.n
        columns = np.repeat(np.arange(self._count), 2)
        entries = normals.ravel(), (np.arange(columns.size), columns)
        shape = self._dofs.size, columns.size
        B_T = self._collect(self._system.force_blocks(), shape, (True, False))
        return B_T.tocsr() @ csr_array(entries, shape=(columns.size, self._count))

    def _know_answers(self, pushes: csr_array) -> None:
        """Solve for the displacements by the pressures of nodes that had none so far."""
        new = np.flatnonzero(self._active & ~self._known)
        for part in portions(new.size):
            loads = self._compliance.loads(pushes[:, new[part]].T.tocsr())
            answers = self._compliance.answers(loads)
            columns = self._compliance.at_contact(answers)
            self._problem.comm.Allreduce(MPI.IN_PLACE, columns)
            self._answers[:, new[part]] = columns
            loads.destroy()
            answers.destroy()
        self._known[new] = True

    def _solve_pressures(self, pushes: csr_array) -> tuple[Array, Array, Array]:
        """Pressures zeta (slave nodes,), and what they move and push, both (size,)."""
        zeta, a, pressures = np.zeros(self._count), np.flatnonzero(self._active), None
        if not a.size:
            pressures = np.empty(0)
        elif self._comm.rank == 0:
            S = pushes[:, a].T @ self._answers[:, a]
            with suppress(LinAlgError):
                pressures = solve(S, -self._gaps[a], assume_a="pos")
        pressures = self._comm.bcast(pressures)
        if pressures is None:
            raise MortarError("the linear system was not solved, it may be singular")
        zeta[a] = pressures
        force = self._comm.bcast(pushes @ zeta if self._comm.rank == 0 else None)
        return zeta, -self._answers @ zeta, force


class LinearBulk:
    """Chooses how a problem is solved, again before each solve.

    Obstacles that forces drive take the general path, and tied bodies, whose K may be singular.

    Args:
        problem: A ``ContactProblem``.
        wanted: Whether to reduce; ``None`` does so where the residual is linear, once the general
            path has taken about as long as the compliance will; with small sliding at once.
        prefix: Prefix of PETSc's options.
    """

    def __init__(self, problem: Any, wanted: bool | None, prefix: str) -> None:
        self._problem, self._wanted, self._prefix = problem, wanted, f"{prefix}{COMPLIANCE}"
        if wanted and problem.newton.damped:
            raise ValueError(
                "linear_bulk=True takes whole steps: leave out line_search and most_motion, or "
                "give linear_bulk=False"
            )
        linear = problem.bulk.is_linear if wanted is None else wanted
        self._possible = linear and bool(problem.contacts)
        self._data: list[Array] = []
        self._equations: ReducedEquations | None = None
        self._num_iterations = 0

    def choose(self) -> tuple[ReducedEquations | None, list[str]]:
        """The reduced equations, or ``None`` for the general path; a remark (collective)."""
        if not self._possible or self._problem.newton.damped or self._problem.tools.driven.any():
            return None, []
        if self._data_changed():
            self._equations, self._num_iterations = None, 0
        if self._equations is None and self._pays():
            obstacle = self._obstacle()
            if obstacle:
                self._possible = False
                return None, [f"linear bulk, but {obstacle}: K is factored in every iteration"]
            equations = SmallSlidingEquations if self._slides_little else ReducedEquations
            self._equations = equations(self._problem, self._prefix)
        return self._equations, []

    def count(self, num_iterations: int) -> None:
        """Take note of iterations of the general path."""
        self._num_iterations += num_iterations

    def forget(self) -> None:
        """Factor the bulk anew before it is used again."""
        self._equations, self._data, self._num_iterations = None, [], 0

    @property
    def _slides_little(self) -> bool:
        return all(
            isinstance(pair, ContactPair)
            and pair.sliding == "small"
            and not (pair.law.rubs or pair.law.attracts)
            for pair in (contact.pair for contact in self._problem.contacts)
        )

    def _pays(self) -> bool:
        if self._slides_little:
            return True
        dofs = 2 * sum(c.slave.num_nodes + c.master.num_nodes for c in self._problem.contacts)
        paid = self._num_iterations > dofs / DOFS_PER_ITERATION
        return bool(self._wanted) or (paid and dofs <= MOST_DOFS)

    def _obstacle(self) -> str:
        if any(isinstance(contact, Tie) for contact in self._problem.contacts):
            return "bodies are tied"
        floating = self._problem.floating
        if floating.bodies:
            names = " and ".join(sorted(floating.name_of(body.label) for body in floating.bodies))
            return f"Dirichlet conditions do not hold {names}"
        self._problem.bulk.assemble_tangent()
        return "" if is_symmetric(self._problem.bulk.K) else "its tangent is not symmetric"

    def _data_changed(self) -> bool:
        """Whether constants or functions of the tangent are no longer what they were."""
        before, self._data = self._data, self._problem.bulk.tangent_data()
        same = len(before) == len(self._data) and all(map(np.array_equal, before, self._data))
        return self._problem.comm.allreduce(not same, MPI.LOR)
