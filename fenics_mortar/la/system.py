# SPDX-License-Identifier: MIT
"""The linear system of one Newton iteration: saddle point (Alg. 1) or condensed (Alg. 2).

Unknown are the increment dd and the *new* multiplier z (Foltyn & Vlach 2016, eq. 12), so the
right-hand side holds r = f_int - f_ext without the contact force:

    (K + K_c) dd + B^T z = -r         B^T z: +D^T z on slave, -M^T z on master rows
          C dd + A_z z   = rhs        rows of the contact law, see ``interface.Rows``

with K_c = d(B^T z^k)/dd. The multipliers are scaled to forces, z_j = k_j zeta_j / D_jj: this keeps
the system well conditioned where a node is only partly covered (nodal scaling, Popp, Seitz, Gee &
Wall 2013) and does not change the iterates.

Condensed: with a diagonal D the slave rows of a multiplier that acts give z_j = -Z_j (r + K~ dd)_j,
Z_j = P_j / D_jj, where P_j leaves out prescribed components (eq. 14). Put in, the system is

    (Q K~ + C) dd = -Q r + rhs,       Q = 1 - B^T Z - A_z Z,

whose slave rows then hold the contact law. Only rows of contact nodes differ from those of K~: with
its slave rows K_S and Q = 1 + R,

    Q K~ + C = K~ + R K_S + C,

and all of it is added to K in place, as work for these rows only. Either matrix keeps room for what
contact can reach by sliding over a few facets, see ``reach``: until it goes further, neither the
pattern nor the symbolic factorization is made anew.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from typing import Any, Literal

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.rows import Rows
from fenics_mortar.interface.mortar import Block
from fenics_mortar.la.multigrid import OPTIONS, TouchingBodies
from fenics_mortar.la.reach import Reach, zeros
from fenics_mortar.la.sparse import BlockMatrix, SomeRows, add_blocks
from fenics_mortar.utils import compat, errors
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MortarError, raise_together

Algorithm = Literal["condensed", "saddle"]
Solver = Literal["auto", "direct", "iterative"]
# The order of elimination is kept while values change: MUMPS then needs more room than it foresees.
DIRECT = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_14": 50,
}
ITERATIVE = {
    "ksp_type": "gmres",
    "ksp_pc_side": "right",
    "ksp_gmres_restart": 100,
    "ksp_rtol": 1e-8,
    "ksp_max_it": 300,
    "pc_type": "python",
    **OPTIONS,
}
# From so many unknowns on "auto" iterates; see ``ContactProblem``.
MANY = 100_000
# A direct solver that leaves more than this part of the right-hand side has met a singular matrix.
LINEAR_TOLERANCE = 1e-5
# Options that begin so are those of another solver, see ``reduced``.
COMPLIANCE = "compliance_"
# PETSc's reasons for the end of a linear solve by number, and those of which a factorization has
# met a pivot of zero or nan.
REASONS = {
    number: name
    for name, number in vars(PETSc.KSP.ConvergedReason).items()
    if name.isupper() and isinstance(number, int)
}
NO_FACTORS = (-9, -11)
# One that leaves more than this is refined.
REFINED = 1e-14
# Prefixes and names of options that are in PETSc's database for a moment.
_added: set[tuple[str, str]] = set()


@contextmanager
def options_added(
    prefix: str, options: dict[str, Any], used: set[str] | None = None
) -> Iterator[None]:
    """Have options in PETSc's database, but for those that the user has there already.

    Args:
        prefix: Prefix of the options.
        options: Values by name.
        used: Where to add the names that PETSc has asked for meanwhile.
    """
    database = PETSc.Options(prefix)
    ours = {k: v for k, v in options.items() if not database.hasName(k)}
    try:
        for name, value in ours.items():
            _added.add((prefix, name))
            database.setValue(name, value)
        yield
    finally:
        if used is not None:
            names = {*options, *database.getAll()} - used
            used |= {name for name in names if compat.option_is_used(prefix + name)}
        for name in ours:
            database.delValue(name)
            _added.discard((prefix, name))


def drop_added_options() -> None:
    """Take out of PETSc's database what an interruption has left of ``options_added`` (local)."""
    for prefix, name in list(_added):
        PETSc.Options(prefix).delValue(name)
    _added.clear()


class LinearSystem(ABC):
    """What both forms share: numbering of multipliers, prescribed values, the linear solver.

    Attributes:
        places: Global number of the multiplier of each slave node, per contact: in the order of
            their owners, so that a rank owns a contiguous range.
        num_multipliers: Multipliers this rank owns.
        forcing: Part of the right-hand side that the next solve may leave if it is iterative.
        may_factor: Whether the direct solver takes over for good if an iterative one fails.
        remark: That it has done so, or that PETSc does not know an option, in words; else "".
        given: Names of the options of PETSc that the user gave, without the prefix.
        matrix: The matrix last assembled.
    """

    has_multipliers: bool  # whether the matrix has rows of theirs

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Interface], prefix: str, options: dict[str, Any]
    ) -> None:
        self.bulk, self.contacts, self.comm = bulk, contacts, bulk.comm
        owners = np.concatenate([np.empty(0, np.int64), *(c.slave.owners for c in contacts)])
        place = np.empty(owners.size, np.int64)
        place[np.argsort(owners, kind="stable")] = np.arange(owners.size)
        ends = np.cumsum([contact.slave.num_nodes for contact in contacts])
        self.places: list[Indices] = np.split(place, ends)[:-1]
        self.num_multipliers = int((owners == self.comm.rank).sum())
        self._first_multiplier = int((owners < self.comm.rank).sum())
        self._prefix = prefix
        self.given: set[str] = set()
        self._used: set[str] = set()
        self._create_solver({**DIRECT, **options})
        self.forcing, self.may_factor, self.remark = 0.0, False, ""
        self._first = True
        self._reaches: list[Reach] = []
        self._pattern = 0
        self.matrix: PETSc.Mat
        self._rhs: PETSc.Vec

    @abstractmethod
    def assemble(self) -> None:
        """Build ``matrix`` and the right-hand side from the present state (collective)."""

    @abstractmethod
    def solve(self) -> tuple[PETSc.Vec, list[Array]]:
        """Solve; return dd and the new multipliers of every contact (collective)."""

    @abstractmethod
    def respond(self, laws: Sequence[Array]) -> tuple[PETSc.Vec, list[Array]]:
        """Solve for a change of the contact laws' right-hand sides alone (collective).

        Args:
            laws: Of each contact, shape (slave nodes, 2) [stress length].

        Returns:
            Changes of the displacement and of the multipliers.
        """

    def _create_solver(self, options: dict[str, Any]) -> None:
        self._options = options
        self.ksp = PETSc.KSP().create(self.comm)
        self.ksp.setOptionsPrefix(self._prefix)
        error = None
        try:
            with options_added(self._prefix, self._options, self._used):
                self.ksp.setFromOptions()
        except PETSc.Error as of_petsc:
            what = str(of_petsc).splitlines()[-1].removeprefix(f"[{PETSc.COMM_WORLD.rank}] ")
            error = MortarError(f"PETSc refuses an option '{self._prefix}...': {what}")
        raise_together(self.comm, error)
        self._multigrid: TouchingBodies | None = None
        if self.ksp.getPC().getType() == "python":
            rows = 2 * self.num_multipliers if self.has_multipliers else None
            self._multigrid = TouchingBodies(self.bulk, self.contacts, self._prefix, rows)
            self.ksp.getPC().setPythonContext(self._multigrid)
        self._finest, *_ = self.ksp.getTolerances()

    def _reset(self) -> None:
        """Forget what was made for matrices so far."""
        self.ksp.reset()

    def _forget_pattern(self) -> None:
        """Let no factors of another pattern be kept: PETSc does not see it; multigrid does."""
        if self._multigrid is None:
            self._reset()

    def _update_pattern(self) -> bool:
        """Whether contact goes beyond its reaches; make them anew then (collective)."""
        now = [(c.operators, c.carries, c.faced()) for c in self.contacts]
        acts = [c.acts | c.z.any(axis=1) for c in self.contacts]
        holds = self._pattern == self.bulk.num_patterns and all(
            reach.holds(*state, acting)
            for reach, state, acting in zip(self._reaches, now, acts, strict=True)
        )
        if self.comm.allreduce(holds, MPI.LAND):
            return False
        self._reaches = [Reach(*state) for state in now]
        self._pattern = self.bulk.num_patterns
        return True

    def local(self, contact: Interface, place: Indices) -> Indices:
        """Local positions of the multipliers owned here."""
        return place[contact.slave.owned] - self._first_multiplier

    def numbered(self) -> Iterator[tuple[Interface, Indices]]:
        """Contacts with the numbers of their multipliers."""
        return zip(self.contacts, self.places, strict=True)

    def force_derivative(self) -> Iterable[Block]:
        """Blocks of K_c = d(B^T z)/dd at fixed z."""
        for contact in self.contacts:
            if not contact.operators.linearization.frozen:
                yield from contact.operators.force_derivative(contact.z)

    def scale(self, contact: Interface) -> Array:
        """z_j / zeta_j, shape (slave nodes,) [stress / length]."""
        diagonal = np.where(contact.acts, contact.operators.diagonal, contact.nodal_lengths)
        return contact.stiffness / diagonal

    def force_blocks(self) -> Iterable[Block]:
        """Blocks of B^T for zeta; columns are numbers of multipliers."""
        for contact, place in self.numbered():
            scale = self.scale(contact)
            for rows, columns, values in contact.force_blocks():
                j = columns // 2
                yield Block(rows, 2 * place[j] + columns % 2, values * scale[j][:, None, :])

    def law_blocks(self, laws: Sequence[Rows]) -> Iterable[Block]:
        """Blocks of C, by the rows of each contact; rows are numbers of multipliers."""
        for place, law in zip(self.places, laws, strict=True):
            for block in law.blocks:
                rows = 2 * place[block.rows // 2] + block.rows % 2
                yield Block(rows, block.columns, block.values)

    def multiplier_blocks(self, laws: Sequence[Rows]) -> Iterable[Block]:
        """Blocks of A_z for zeta, of the multipliers owned here."""
        for (contact, place), law in zip(self.numbered(), laws, strict=True):
            mine = contact.slave.owned
            dofs = 2 * place[mine][:, None] + np.arange(2)
            yield Block(dofs, dofs, law.A_z[mine] * self.scale(contact)[mine, None, None])

    @property
    def _largest_stiffness(self) -> float:
        return max((float(c.stiffness.max()) for c in self.contacts), default=1.0)

    def _hold(self, matrix: PETSc.Mat, rhs: PETSc.Vec, first_row: int) -> None:
        """Replace the rows of prescribed dofs by k (dd) = k (prescribed - present)."""
        held, distance = self.bulk.held, self.bulk.distance_to_prescribed()
        scale = self._largest_stiffness
        matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        matrix.zeroRows((held + first_row).astype(PETSc.IntType), diag=scale)
        rhs.array[held] = scale * distance

    def _solve_linear(self, matrix: PETSc.Mat, rhs: PETSc.Vec) -> PETSc.Vec:
        """Solve and check the answer: a singular matrix must not pass in silence.

        A direct solution that leaves more than rounding is refined once: pivots of a saddle point
        are chosen for sparsity, too, and cost digits.
        """
        self.ksp.setTolerances(rtol=max(self.forcing, self._finest))
        self.forcing = 0.0
        solution, failure = self._attempt(matrix, rhs)
        if failure:  # an order that was right for other values may not be
            self._reset()
            solution, failure = self._attempt(matrix, rhs)
        if not failure:
            return solution
        self._reset()  # MUMPS does not factor again after it has failed
        if not self.may_factor:
            raise MortarError(f"the linear system was not solved{failure}")
        self.may_factor = False
        self.remark = (
            f"the iterative solver failed{failure}; from now on the linear systems are solved "
            "directly"
        )
        self.ksp.destroy()
        self._create_solver(DIRECT)
        return self._solve_linear(matrix, rhs)

    def _attempt(self, matrix: PETSc.Mat, rhs: PETSc.Vec) -> tuple[PETSc.Vec, str]:
        """A solution and, to end a sentence with, why it is none; "" if it is one."""
        solution = rhs.duplicate()
        self.ksp.setOperators(matrix)
        try:
            self._run(rhs, solution)
        except MortarError as error:
            return solution, f": {error}"
        defect = rhs.duplicate()
        relative = _defect(matrix, rhs, solution, defect)
        if self.ksp.getType() == "preonly" and REFINED < relative <= LINEAR_TOLERANCE:
            correction = rhs.duplicate()
            self.ksp.solve(defect, correction)
            solution.axpy(1.0, correction)
            correction.destroy()
            relative = _defect(matrix, rhs, solution, defect)
        defect.destroy()
        reason = self.ksp.getConvergedReason()
        if reason >= 0 and relative <= LINEAR_TOLERANCE:
            return solution, ""
        return solution, (
            f", {self._describe(reason)}, remaining part of the right-hand side {relative:.1e} "
            f"(allowed {LINEAR_TOLERANCE:g})"
        )

    def _describe(self, reason: int) -> str:
        """What PETSc's reason for an end says of a solution that is none, in words."""
        named = f"PETSc's reason {reason} ({REASONS.get(reason, 'unknown')})"
        if self.ksp.getType() == "preonly" or reason in NO_FACTORS:
            return f"it may be singular: {named}"
        if reason >= 0:
            return (
                f"the iterative solver stopped too early: {named}, a smaller tolerance is right, "
                f"as '{self._prefix}ksp_rtol'"
            )
        return f"the iterative solver did not converge: {named}"

    def tell_unused(self) -> str:
        """Options of the user that PETSc did not ask for in a solve, in words, each once."""
        database = PETSc.Options(self._prefix).getAll() if self._prefix else {}
        given = {name for name in database if not name.startswith(COMPLIANCE)}
        given |= self.given
        used = set().union(*self.comm.allgather(self._used))
        unused = sorted(given - used)
        self.given, self._used = set(), used | given
        if not unused:
            return ""
        names = ", ".join(f"'{self._prefix}{name}'" for name in unused)
        return f"PETSc did not ask for the option {names}: misspelt, or of another solver"

    def _run(self, rhs: PETSc.Vec, solution: PETSc.Vec) -> None:
        """Let PETSc solve; an error of its on any rank is raised on all as a ``MortarError``."""
        error, copy = None, rhs.copy()  # which an error leaves locked
        try:
            with options_added(self._prefix, self._options, self._used if self._first else None):
                self.ksp.solve(copy, solution)
            copy.destroy()
        except MortarError as ours:
            error = ours
        except PETSc.Error as of_petsc:
            what = str(of_petsc).splitlines()[-1]
            error = MortarError(f"PETSc's error {of_petsc.ierr}, {what}")
        raise_together(self.comm, error)
        if self._first:
            self._first = False
            self.remark = "; ".join(filter(None, (self.remark, self.tell_unused())))


def _defect(matrix: PETSc.Mat, rhs: PETSc.Vec, solution: PETSc.Vec, defect: PETSc.Vec) -> float:
    """Set ``defect`` to what is left of the right-hand side; return its part of the whole."""
    matrix.mult(solution, defect)
    defect.aypx(-1.0, rhs)
    return float(defect.norm() / max(rhs.norm(), np.finfo(float).tiny))


class CondensedSystem(LinearSystem):
    """Displacements only (the paper's Alg. 2); needs dual multipliers.

    Assembling adds to the bulk's ``K``, which has to be assembled anew before the next time.
    """

    has_multipliers = False

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Interface], prefix: str, options: dict[str, Any]
    ) -> None:
        super().__init__(bulk, contacts, prefix, options)
        obstacle = obstacle_to_condensation(contacts)
        if obstacle:
            raise ValueError(f"algorithm='condensed': {obstacle}; use algorithm='saddle'")
        size, mine = bulk.num_owned, 2 * self.num_multipliers
        touched = [side.dofs.ravel() for c in contacts for side in (c.slave, c.master)]
        self._rows = SomeRows(np.concatenate([np.empty(0, np.int64), *touched]), bulk.first, size)
        self._R = BlockMatrix(self.comm, self._rows.local.size, mine)
        self._slave_K: Any = None
        dofs = np.empty((self.num_multipliers, 2), np.int64)
        for contact, place in self.numbered():
            dofs[self.local(contact, place)] = contact.slave.dofs[contact.slave.owned]
        self._slave_rows = PETSc.IS().createGeneral(dofs.ravel().astype(PETSc.IntType), self.comm)
        self._rhs = compat.create_vector(bulk.space.whole).duplicate()

    def assemble(self) -> None:
        """Add K_c + R K_S + C to K, and build -(1 + R) r + rhs."""
        laws = [contact.rows() for contact in self.contacts]
        if self._update_pattern():
            self._make_room(laws)
        K = self.bulk.take_tangent()
        add_blocks(K, self.force_derivative())
        R = self._R.assemble(self._rows.renumbered(self._R_blocks(laws)))
        self._slave_K = K.createSubMatrix(self._slave_rows, None, self._slave_K)
        product = R.matMult(self._slave_K)
        self._rows.add(product, K)
        product.destroy()
        add_blocks(K, self._C_blocks(laws))
        self.matrix = K
        self._assemble_rhs(laws, R)
        self._hold(self.matrix, self._rhs, self.bulk.first)

    def _make_room(self, laws: Sequence[Rows]) -> None:
        """Put zeros into K wherever contact may add within its reach."""
        different = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
        rows, size = self._rows, self.bulk.num_owned
        of_slave = rows.number(self._slave_rows.indices).astype(PETSc.IntType)
        small = BlockMatrix(self.comm, rows.local.size, size).assemble(
            rows.renumbered(reach.derivative_pattern() for reach in self._reaches)
        )
        slave_K = self.bulk.K.createSubMatrix(self._slave_rows)
        of_small = small.createSubMatrix(PETSc.IS().createGeneral(of_slave, self.comm))
        slave_K.axpy(1.0, of_small, different)
        R = self._R.assemble(rows.renumbered(chain(self._R_blocks(laws), self._R_room())))
        product = R.matMult(slave_K)
        small.axpy(1.0, product, different)
        room = rows.room(small, size)
        self.bulk.grow_tangent(room)
        for matrix in (small, slave_K, of_small, product, room, self._slave_K):
            if matrix is not None:
                matrix.destroy()
        self._slave_K = None
        self._forget_pattern()

    def _C_blocks(self, laws: Sequence[Rows]) -> Iterable[Block]:
        """C in the rows of the slave's displacement."""
        for contact, law in zip(self.contacts, laws, strict=True):
            for block in law.blocks:
                rows = contact.slave.dofs.ravel()[block.rows]
                yield Block(rows, block.columns, block.values)

    def _R_blocks(self, laws: Sequence[Rows]) -> Iterable[Block]:
        """R = -B^T Z - A_z Z; columns are numbers of multipliers."""
        for (contact, place), law in zip(self.numbered(), laws, strict=True):
            Z = self._inverse(contact)
            for block in contact.force_blocks():
                j, component = block.columns // 2, block.columns % 2
                values = -block.values * Z[j, component][:, None, :]
                yield Block(block.rows, 2 * place[j] + component, values)
            mine = contact.slave.owned[contact.acts[contact.slave.owned]]
            values = -law.A_z[mine] * Z[mine][:, None, :]
            yield Block(contact.slave.dofs[mine], _components(place[mine, None]), values)

    def _R_room(self) -> Iterable[Block]:
        """Zeros for the reach of R."""
        for place, reach in zip(self.places, self._reaches, strict=True):
            rows, multipliers = reach.force_pattern(~reach.idle)
            columns = _components(place[multipliers, None])
            yield Block(rows, columns, np.zeros((len(rows), 2, 2)))

    def _inverse(self, contact: Interface) -> Array:
        """Diagonal of Z_j, zero where none acts, shape (slave nodes, 2) [1 / length]."""
        diagonal = np.where(contact.acts, contact.operators.diagonal, np.inf)
        return contact.free / diagonal[:, None]

    def _assemble_rhs(self, laws: Sequence[Rows], R: PETSc.Mat) -> None:
        slave_r = R.createVecRight()
        for contact, place in self.numbered():
            values = self.bulk.r.array_r[contact.slave.local_dofs]
            slave_r.array.reshape(-1, 2)[self.local(contact, place)] = values
        gathered = R.createVecLeft()
        R.mult(slave_r, gathered)
        self._rhs.array[:] = -self.bulk.r.array_r[: self.bulk.num_owned]
        self._rhs.array[self._rows.local] -= gathered.array_r
        slave_r.destroy()
        gathered.destroy()
        for contact, law in zip(self.contacts, laws, strict=True):
            contact.slave.scatter_add(law.rhs, self._rhs.array)

    def solve(self) -> tuple[PETSc.Vec, list[Array]]:
        """Solve for dd, then recover z_j = -Z_j (r + K~ dd)_j."""
        return self._recover(self._rhs, self.bulk.r.array_r[: self.bulk.num_owned])

    def respond(self, laws: Sequence[Array]) -> tuple[PETSc.Vec, list[Array]]:
        """The same without forces and prescribed values."""
        rhs = self._rhs.duplicate()
        for contact, law in zip(self.contacts, laws, strict=True):
            contact.slave.scatter_add(law, rhs.array)
        rhs.array[self.bulk.held] = 0.0
        return self._recover(rhs, np.zeros(self.bulk.num_owned))

    def _recover(self, rhs: PETSc.Vec, r: Array) -> tuple[PETSc.Vec, list[Array]]:
        """Solve for dd; return it and the multipliers."""
        dd = self._solve_linear(self.matrix, rhs)
        force = self._slave_K.createVecLeft()
        self._slave_K.mult(dd, force)
        total = r.copy()
        for contact, place in self.numbered():
            change = force.array_r.reshape(-1, 2)[self.local(contact, place)]
            dofs = contact.slave.local_dofs
            total[dofs] = r[dofs] + change  # a node may be a slave of several pairs
        force.destroy()
        return dd, [-self._inverse(c) * c.slave.gather(total) for c in self.contacts]


def obstacle_to_condensation(contacts: Sequence[Interface]) -> str | None:
    """Why D cannot be inverted node by node, or ``None`` if it can."""
    for contact in contacts:
        names = f"the pair '{contact.slave.name}' - '{contact.master.name}'"
        if contact.pair.basis not in ("dual", "vertices") and contact.pair.integration != "nodes":
            return f"{names} has basis '{contact.pair.basis}', so D is not diagonal"
        if contact.oblique.any():
            where = errors.place(contact.slave.X[contact.oblique][0])
            return (
                f"a slave node of {names} at {where} is held in one component oblique to its normal"
            )
        for other in contacts:
            if np.intersect1d(contact.multiplier_nodes, other.master.nodes).size:
                return f"slave nodes of {names} are master nodes of '{other.master.name}'"
            both = np.intersect1d(contact.multiplier_nodes, other.multiplier_nodes)
            if both.size and other is not contact:
                return f"slave nodes of {names} are slaves of '{other.master.name}', too"
            if np.intersect1d(contact.multiplier_nodes, other.idle_nodes).size:
                return f"slave nodes of {names} are nodes of '{other.slave.name}' as well"
    return None


def _components(nodes: Indices) -> Indices:
    """Numbers 2 k + component of the numbers ``nodes`` (..., k): shape (..., 2 k)."""
    numbers = 2 * nodes[..., None] + np.arange(2)
    return numbers.reshape(*nodes.shape[:-1], 2 * nodes.shape[-1])


# What a row or column of the saddle point's matrix is.
DOF, MULTIPLIER = 0, 1
# Blocks with such rows and columns, each kind numbered by itself.
Part = tuple[int, int, Iterable[Block]]


class SaddleSystem(LinearSystem):
    """Displacements and multipliers (the paper's Alg. 1), with rows [dd, zeta] on each rank."""

    has_multipliers = True

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Interface], prefix: str, options: dict[str, Any]
    ) -> None:
        super().__init__(bulk, contacts, prefix, options)
        self._sizes = bulk.num_owned, 2 * self.num_multipliers
        sizes = np.array(self.comm.allgather(self._sizes))
        self._ends = np.cumsum(sizes, axis=0)
        self._shifts = np.stack([(self._ends - sizes)[:, MULTIPLIER], self._ends[:, DOF]], axis=1)
        self._no_K = BlockMatrix(self.comm, *[self._sizes[MULTIPLIER]] * 2).assemble([])
        self._assembled: Any = None

    def _number(self, kind: int, numbers: Indices) -> Indices:
        """Numbers in the whole matrix of dofs or of components of multipliers; -1 stays -1."""
        rank = np.searchsorted(self._ends[:, kind], numbers, side="right")
        return np.where(numbers >= 0, numbers + self._shifts[rank, kind], -1)

    def _numbered_blocks(self, parts: Iterable[Part]) -> Iterator[Block]:
        """Blocks for the whole matrix."""
        for row_kind, column_kind, blocks in parts:
            for rows, columns, values in blocks:
                yield Block(
                    self._number(row_kind, rows), self._number(column_kind, columns), values
                )

    def _parts(self) -> Iterator[Part]:
        """Blocks of K_c, B^T, C and A_z, the last three for scaled multipliers zeta."""
        laws = [contact.rows() for contact in self.contacts]
        yield DOF, DOF, self.force_derivative()
        yield DOF, MULTIPLIER, self.force_blocks()
        yield MULTIPLIER, DOF, self.law_blocks(laws)
        yield MULTIPLIER, MULTIPLIER, self.multiplier_blocks(laws)

    def _room(self) -> Iterator[Part]:
        """Zeros for the reach of K_c, B^T and C; those of A_z are always there."""
        for (contact, place), reach in zip(self.numbered(), self._reaches, strict=True):
            own = contact.slave.owned
            dofs, multipliers = reach.force_pattern(reach.carries)
            dofs = np.concatenate([dofs, contact.slave.dofs[own]]).reshape(-1, 1)
            numbers = _components(place[np.append(multipliers, own), None]).reshape(-1, 1)
            nodes, coupled = reach.law_pattern()
            yield DOF, DOF, [reach.derivative_pattern()]
            yield DOF, MULTIPLIER, [zeros(dofs, numbers)]
            yield MULTIPLIER, DOF, [zeros(_components(place[nodes, None]), coupled)]

    def blocks(self) -> tuple[PETSc.Mat, PETSc.Mat, PETSc.Mat, PETSc.Mat]:
        """K + K_c, B^T, C and A_z, the last three for scaled multipliers zeta."""
        K_c, B_T, C, A_z = (
            BlockMatrix(self.comm, self._sizes[rows], self._sizes[columns]).assemble(blocks)
            for rows, columns, blocks in self._parts()
        )
        K = self.bulk.K.copy()
        K.axpy(1.0, K_c, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return K, B_T, C, A_z

    def assemble(self) -> None:
        """Fill the matrix, made anew where contact goes beyond its room, and build -r and rhs."""
        nest = PETSc.Mat().createNest([[self.bulk.K, None], [None, self._no_K]], comm=self.comm)
        K = PETSc.Mat()
        nest.convert("aij", out=K)
        nest.destroy()
        if self._update_pattern():
            self._make_room(K)
        self.matrix.zeroEntries()
        K.copy(self.matrix, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        K.destroy()
        add_blocks(self.matrix, self._numbered_blocks(self._parts()))
        self._assemble_rhs()
        self._hold(self.matrix, self._rhs, self.matrix.getOwnershipRange()[0])

    def _make_room(self, K: PETSc.Mat) -> None:
        """Make the matrix anew, with the entries of K and all that contact may reach."""
        if self._assembled is not None:
            self._assembled.destroy()
        parts = chain(self._parts(), self._room())
        room = BlockMatrix(self.comm, *[sum(self._sizes)] * 2)
        room.assemble(self._numbered_blocks(parts))
        self.matrix = self._assembled = room.mat
        self.matrix.axpy(1.0, K, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self._rhs = self.matrix.createVecLeft()
        self._forget_pattern()

    def _assemble_rhs(self) -> None:
        size = self.bulk.num_owned
        self._rhs.array[:size] = -self.bulk.r.array_r[:size]
        for contact, place in self.numbered():
            self._rhs.array[size:].reshape(-1, 2)[self.local(contact, place)] = contact.rows().rhs[
                contact.slave.owned
            ]

    def solve(self) -> tuple[PETSc.Vec, list[Array]]:
        """Solve for dd and the change of zeta, which vanish as Newton converges."""
        rhs, present = self._rhs.duplicate(), self._rhs.duplicate()
        zeta = present.array[self.bulk.num_owned :].reshape(-1, 2)
        for contact, place in self.numbered():
            scaled = contact.z / self.scale(contact)[:, None]
            zeta[self.local(contact, place)] = scaled[contact.slave.owned]
        self.matrix.mult(present, rhs)
        rhs.aypx(-1.0, self._rhs)
        return self._recover(rhs, present)

    def respond(self, laws: Sequence[Array]) -> tuple[PETSc.Vec, list[Array]]:
        """The same without forces and prescribed values."""
        rhs = self._rhs.duplicate()
        for (contact, place), law in zip(self.numbered(), laws, strict=True):
            mine = rhs.array[self.bulk.num_owned :].reshape(-1, 2)
            mine[self.local(contact, place)] = law[contact.slave.owned]
        return self._recover(rhs, rhs.duplicate())

    def _recover(self, rhs: PETSc.Vec, present: PETSc.Vec) -> tuple[PETSc.Vec, list[Array]]:
        """Solve for a change; return dd and the new multipliers, handed to all ranks."""
        solution = self._solve_linear(self.matrix, rhs)
        solution.axpy(1.0, present)
        size = self.bulk.num_owned
        dd = PETSc.Vec().createMPI((size, None), comm=self.comm)
        dd.array[:] = solution.array_r[:size]
        multipliers = []
        for contact, place in self.numbered():
            zeta = np.zeros((contact.slave.num_nodes, 2))
            mine = contact.slave.owned
            zeta[mine] = solution.array_r[size:].reshape(-1, 2)[self.local(contact, place)]
            self.comm.Allreduce(MPI.IN_PLACE, zeta)
            multipliers.append(zeta * self.scale(contact)[:, None])
        solution.destroy()
        return dd, multipliers


SYSTEMS = {"condensed": CondensedSystem, "saddle": SaddleSystem}
