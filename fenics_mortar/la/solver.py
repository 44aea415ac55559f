# SPDX-License-Identifier: MIT
"""Factorizations and solves by PETSc; a check of the residual detects singular matrices.

``factored_bulk`` factors the bulk tangent with prescribed dofs fixed, for many right-hand sides.
``LinearSolver`` solves the systems of Newton's method, directly or iteratively, also by GMRES with
the factors of an earlier matrix as preconditioner.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.node_blocks import NodeBlocks, come_in_pairs
from fenics_mortar.la.options import (
    COMPLIANCE,
    COSTS,
    DIRECT,
    MORE_MEMORY,
    ORDERED,
    SMALL,
    WITHOUT_PIVOTING,
    options_added,
    with_defaults,
)
from fenics_mortar.la.sparse import leave
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import LAST_DIGITS, SUM_ROUNDING, TINY, Array, Indices
from fenics_mortar.utils.errors import MortarError, raise_together

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk

# Factorizations in the order of trial, and memory in excess of the estimate of MUMPS [%], which may
# be far too low on several ranks.
FACTORS = (("cholesky", 50), ("cholesky", 300), ("lu", 300))
# Elimination order of MUMPS (ICNTL 7): approximate minimum degree. The choice of MUMPS takes longer
# than the factorization, which is done once.
ORDERING = {"mat_mumps_icntl_7": 0}
# Right-hand sides per solve: more need more memory and gain little.
COLUMNS = 32


def factored(K: PETSc.Mat, prefix: str, rest: Indices | None = None) -> PETSc.PC:
    """Factorize a symmetric matrix by MUMPS, completely or up to a Schur complement (collective).

    Args:
        K: The matrix.
        prefix: Prefix of PETSc's options.
        rest: Rows and columns of the Schur complement, shape (n,), equal on all ranks; see
            ``sparse.schur_complement``.

    Raises:
        MortarError: On all ranks, if MUMPS fails.
    """
    for kind, workspace in FACTORS:
        pc = PETSc.PC().create(K.comm)
        pc.setOptionsPrefix(prefix)
        pc.setFromOptions()
        pc.setType(kind)  # whatever the options of the system: many right-hand sides need factors
        pc.setFactorSolverType(DIRECT["pc_factor_mat_solver_type"])
        pc.setOperators(K)
        with options_added(prefix, {**ORDERING, "mat_mumps_icntl_14": workspace}):
            if rest is not None:
                pc.setFactorSetUpSolverType()
                pc.getFactorMatrix().setOptionsPrefix(prefix)
                leave(pc.getFactorMatrix(), rest)
            pc.setUp()
        outcome = pc.getFactorMatrix().getMumpsInfog(1)
        if outcome >= 0:
            return pc
        pc.destroy()
    raise MortarError(f"factorization of the stiffness of the bodies failed: MUMPS error {outcome}")


def factored_by_cholmod(K: PETSc.Mat, prefix: str) -> PETSc.PC | None:
    """Factor by CHOLMOD on one rank (local).

    ``None`` if K is not positive definite, or if PETSc has no SuiteSparse.

    For a single right-hand side CHOLMOD takes half of the time of MUMPS; MUMPS is faster for many
    at once (0.04 and 0.01 s for each of 32 at 169,000 unknowns), and in factorizing.
    """
    if not compat.petsc_has("suitesparse", "cholmod"):
        return None
    pc = PETSc.PC().create(K.comm)
    pc.setOptionsPrefix(f"{prefix}single_")
    pc.setType("cholesky")
    pc.setFactorSolverType("cholmod")
    pc.setOperators(K)
    options, quiet = PETSc.Options(), f"{prefix}single_mat_cholmod_print"
    options.setValue(quiet, 0)  # no warning on the terminal: MUMPS is used instead
    try:
        pc.setUp()
    except PETSc.Error:
        pc.destroy()
        return None
    finally:
        options.delValue(quiet)
    return pc


def factored_bulk(bulk: Bulk, prefix: str, rest: Indices | None = None) -> PETSc.PC:
    """Factor the bulk tangent with the prescribed dofs fixed (collective).

    Args:
        bulk: The bodies; their tangent is assembled and not changed.
        prefix: Prefix of PETSc's options.
        rest: See ``factored``.
    """
    return factored(supported(bulk), prefix, rest)


def supported(bulk: Bulk) -> PETSc.Mat:
    """The bulk tangent with the prescribed dofs fixed (collective)."""
    rows = (bulk.prescribed_dofs + bulk.first).astype(PETSc.IntType)
    prescribed = PETSc.IS().createGeneral(rows, bulk.comm)
    K = bulk.K.copy()
    K.zeroRowsColumns(prescribed, diag=float(np.abs(K.getDiagonal().array_r).max(initial=1.0)))
    K.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return K


def column_groups(count: int) -> list[Indices]:
    """The numbers below ``count`` in groups of shape (n,), n up to ``COLUMNS`` (local)."""
    return [np.arange(i, min(i + COLUMNS, count)) for i in range(0, count, COLUMNS)]


# Largest number of steps [1]. With factors of PETSc in blocks, 4,700 and 18,000 unknowns, a step
# takes a twelfth to a fifteenth of the time of a factorization; 8, 12 and 16 steps save less.
STEPS = 10
REASON = PETSc.KSP.ConvergedReason


def _gmres_with(pc: PETSc.PC) -> PETSc.KSP:
    """GMRES preconditioned by the factors of an earlier matrix (collective)."""
    ksp = PETSc.KSP().create(pc.comm)
    ksp.setType(PETSc.KSP.Type.GMRES)
    ksp.setPCSide(PETSc.PC.Side.RIGHT)
    ksp.setGMRESRestart(STEPS)
    ksp.setPC(pc)
    return ksp


def _judge(
    _: PETSc.KSP, step: int, residual: float, tolerance: float, residuals: list[float]
) -> int:
    """Reason for the end of GMRES: tolerance, number of steps, or slow convergence."""
    residuals.append(residual)
    allowed = tolerance * residuals[0]
    if residual <= allowed:
        return int(REASON.CONVERGED_RTOL)
    is_slow = step == STEPS // 2 and residual**2 > allowed * residuals[0]
    return int(REASON.DIVERGED_MAX_IT if is_slow or step == STEPS else REASON.ITERATING)


# Largest relative residual of an accepted solution [1]: above it the matrix of a direct solver is
# singular, unless the residual is rounding of the solution.
LINEAR_TOLERANCE = 1e-5
# Largest relative residual that may be rounding of the solution [1]: 1e-3 in bending of a strip
# 500 times as long as thick; and largest change of the solution by a refinement. Of a singular
# matrix both are about 1, the change also where the residual is small.
REGULAR = 0.01
# Number of unknowns from which factors serve further iterations [1]: below it a factorization takes
# as long as some steps of GMRES.
MIN_LAGGED = 500
# PETSc's reasons for the end of a linear solve by number, and those of a zero or nan pivot.
REASONS = {
    number: name
    for name, number in vars(REASON).items()
    if name.isupper() and isinstance(number, int)
}
NO_FACTORS = (REASON.DIVERGED_NANORINF, REASON.DIVERGED_PCSETUP_FAILED)


class LinearSolver:
    """Solver for A x = b and A^T x = b; all methods are collective.

    Within a load step the matrices of Newton's method differ by a few contact rows and by small
    changes of the stiffness: with the factors of an earlier one, GMRES mostly takes three to nine
    steps to the relative residual that Newton's method needs. From one load step to the next it
    takes 20.

    Args:
        comm: Communicator.
        prefix: Prefix of PETSc's options.
        options: Options by name, without the prefix; those of the database take precedence.
            Defaults are those of MUMPS, see ``options.with_defaults``.
        preconditioner: Function that creates the preconditioner of ``pc_type python``.

    Attributes:
        ksp: PETSc's solver.
        forcing: Allowed relative residual of the next solve if it is iterative, or by GMRES with
            the factors of an earlier iteration [1].
        same_step: Whether the next matrix belongs to a further iteration of the same load step.
        may_factor: Whether MUMPS is used permanently after a failure of an iterative solver, or of
            one without pivoting.
        long_factors: Whether a factorization takes ten to a hundred times as long as a solution,
            as in space: factors by MUMPS, too, serve further iterations of a load step.
        remark: Message on such a change of the solver or on unused options; else "".
        reason: Why this solver was chosen, as text; "" if unknown.
        given: Names of PETSc options given by the user, without the prefix.

    Raises:
        MortarError: On all ranks, if PETSc rejects an option.
    """

    def __init__(
        self, comm: MPI.Comm, prefix: str, options: dict[str, Any],
        preconditioner: Callable[[], Any],
    ) -> None:  # fmt: skip
        self._comm, self._prefix, self._make_preconditioner = comm, prefix, preconditioner
        self.forcing, self.may_factor, self.remark, self.reason = 0.0, False, "", ""
        self.same_step = self.long_factors = False
        self.count_anew()
        self.given: set[str] = set()
        self._used: set[str] = set()
        self._first = True
        self._create(with_defaults(prefix, options))

    def _create(self, options: dict[str, Any]) -> None:
        self._options = options
        factors = "pc_factor_mat_solver_type"
        self._pivots = options.get(factors) != SMALL[factors]
        self._allowed = LINEAR_TOLERANCE if self._pivots else WITHOUT_PIVOTING
        self._begin_anew()
        self.ksp = PETSc.KSP().create(self._comm)
        self.ksp.setOptionsPrefix(self._prefix)
        error = None
        try:
            with options_added(self._prefix, self._options, self._used):
                self.ksp.setFromOptions()
        except PETSc.Error as of_petsc:
            what = str(of_petsc).splitlines()[-1].removeprefix(f"[{PETSc.COMM_WORLD.rank}] ")
            error = MortarError(f"PETSc rejected an option '{self._prefix}...': {what}")
        raise_together(self._comm, error)
        self.multigrid: Any = None
        if self.ksp.getPC().getType() == "python":
            self.multigrid = self._make_preconditioner()
            self.ksp.getPC().setPythonContext(self.multigrid)
        self._finest, *_ = self.ksp.getTolerances()
        self._is_direct = self.ksp.getType() == "preonly"
        names = [*options, *PETSc.Options(self._prefix).getAll()]
        self._is_shown = any(name.startswith("ksp_view") for name in names)

    def _begin_anew(self) -> None:
        """Read PETSc's options and make vectors at the next solve (local)."""
        self._reads_options = True
        self._vectors: list[PETSc.Vec] = []
        self._in_blocks: NodeBlocks | None = None
        self._gmres: PETSc.KSP | None = None

    def _reset(self) -> None:
        self.ksp.reset()
        if self._is_shown:  # the reset removes PETSc's viewers
            with options_added(self._prefix, self._options, self._used):
                self.ksp.setFromOptions()
        self._begin_anew()

    def count_anew(self) -> None:
        """Set the numbers of solutions with earlier factors and of others to zero (local)."""
        self._num_lagged = self._num_others = 0

    def describe(self) -> str:
        """Description of the solver, the reason for it, and use of earlier factors (local)."""
        kind, pc = self.ksp.getType(), self.ksp.getPC()
        name = f"{kind} with {pc.getType()}"
        if self.multigrid is not None:
            name = f"{kind} with multigrid{self.multigrid.by}"
        elif kind == "preonly":
            name = f"factors by {pc.getFactorSolverType()}{'' if self._pivots else ORDERED}"
        text = f"{name} ({self.reason})" if self.reason else name
        if self._num_lagged:
            solutions = self._num_lagged + self._num_others
            text += f"; {self._num_lagged} of {solutions} solutions by gmres with earlier factors"
            text += " (small changes within a load step)"
        return text

    def reset_pattern(self) -> None:
        """Drop factors, or those of multigrid's strip, after a change of the sparsity pattern."""
        if self.multigrid is None:
            self._reset()
        else:
            self.multigrid.forget_pattern()

    def solve(self, matrix: PETSc.Mat, rhs: Array, *, transpose: bool = False) -> Array:
        """Solve and check the solution.

        A direct solution whose residual is above rounding is refined once: MUMPS also chooses the
        pivots of a saddle point for sparsity, at the cost of some digits. Factors are reused while
        the matrix is unchanged.

        Args:
            matrix: A.
            rhs: Right-hand side, shape (owned rows,) in either case [unit of the system].
            transpose: Whether to solve with A^T.

        Returns:
            The solution, shape (owned rows,) [unit of the system].

        Raises:
            MortarError: On all ranks, if no solution was found.
        """
        if not self._is_direct:
            self.ksp.setTolerances(rtol=max(self.forcing, self._finest))
            self._allowed = max(LINEAR_TOLERANCE, 2.0 * self.forcing)
            if self.multigrid is not None:
                self.multigrid.begin_solve(self.ksp.getTolerances()[0], same_step=self.same_step)
        elif self._may_lag(matrix) and not transpose:
            found = self._solve_with_last_factors(matrix, rhs)
            if found is not None:
                return found
        self.forcing = 0.0
        is_new = self._reads_options
        solution, failure = self._attempt(matrix, rhs, transpose)
        if failure and self._pivots:  # order or memory may be unsuitable for new values
            if self._is_direct:
                self._options = self._options | MORE_MEMORY
            self._reset()
            solution, failure = self._attempt(matrix, rhs, transpose)
        if not failure:
            found = np.array(solution.array_r)
            self._num_others += 1
            if is_new and self.may_factor and not self._pivots and self._has_long_rows():
                self._switch_to_mumps(f"rows of factors longer than {COSTS.long_rows}")
            return found
        self._reset()  # MUMPS does not factorize again after a failure
        if not self.may_factor:
            raise MortarError(f"the linear system was not solved{failure}")
        failed, then = "elimination without pivoting", "by MUMPS"
        if self._pivots:
            failed, then = "the iterative solver", "directly"
        self.remark = f"{failed} failed{failure}; all further linear systems are solved {then}"
        self._switch_to_mumps(f"{failed} failed")
        return self.solve(matrix, rhs, transpose=transpose)

    def _may_lag(self, matrix: PETSc.Mat) -> bool:
        """Whether to try the factors of an earlier matrix (local)."""
        kept = self.same_step and not self._reads_options
        kept = kept and (self.long_factors or not self._pivots)
        return kept and self.forcing > 0.0 and matrix.getSize()[0] >= MIN_LAGGED

    def _solve_with_last_factors(self, matrix: PETSc.Mat, values: Array) -> Array | None:
        """Solution by GMRES with the last factors, ``None`` if it takes too many steps."""
        pc, (rhs, solution, *_) = self.ksp.getPC(), self._vectors
        _, factored_matrix = pc.getOperators()
        if self._gmres is None:
            self._gmres = _gmres_with(pc)
        rhs.array[:] = values
        self._gmres.setConvergenceTest(_judge, (self.forcing, []))
        pc.setReusePreconditioner(True)
        try:
            self._gmres.setOperators(matrix, factored_matrix)
            self._gmres.solve(rhs, solution)
        finally:
            pc.setReusePreconditioner(False)
        if self._gmres.getConvergedReason() <= 0:
            return None
        self.forcing = 0.0
        self._num_lagged += 1
        return np.array(solution.array_r)

    def _switch_to_mumps(self, reason: str) -> None:
        """Use MUMPS for all further solves."""
        self.may_factor, self.reason = False, reason
        self.ksp.destroy()
        self._create(DIRECT)

    def _has_long_rows(self) -> bool:
        """Whether the rows of the factors are long enough for MUMPS to be faster."""
        factors = self.ksp.getPC().getFactorMatrix()
        return bool(factors.getInfo()["nz_used"] > COSTS.long_rows * factors.getSize()[0])

    def _attempt(self, matrix: PETSc.Mat, values: Array, transpose: bool) -> tuple[PETSc.Vec, str]:
        """A solution, and the failure as the end of a sentence; "" if the solution is accepted."""
        if not self._vectors:
            self._vectors = [matrix.createVecLeft() for _ in range(4)]
        rhs, solution, defect, correction = self._vectors
        rhs.array[:] = values
        solution.set(0.0)
        self.ksp.setOperators(matrix, matrix if self._pivots else self._blocks_of(matrix))
        try:
            self._run(rhs, solution, transpose)
        except MortarError as error:
            self._vectors = []  # after an error the right-hand side is locked
            return solution, f": {error}"
        multiply = matrix.multTranspose if transpose else matrix.mult
        size = max(rhs.norm(), TINY)
        relative = _defect(multiply, rhs, solution, defect) / size
        if self._is_direct and LAST_DIGITS < relative <= REGULAR:
            self._call(defect, correction, transpose)
            solution.axpy(1.0, correction)
            relative = _defect(multiply, rhs, solution, defect) / size
        reason = self.ksp.getConvergedReason()
        if reason >= 0 and relative <= self._allowed:
            return solution, ""
        # a refinement of a singular matrix adds as much again
        refined = correction.norm() <= REGULAR * solution.norm()
        if self._is_direct and reason >= 0 and relative <= REGULAR and refined:
            largest = PETSc.NormType.INFINITY
            rounding = SUM_ROUNDING * matrix.norm(largest) * solution.norm(largest)
            if defect.norm(largest) <= rounding:
                return solution, ""
        size_of_rest = f"relative residual {relative:.1e} (allowed {self._allowed:g})"
        return solution, f", {self._describe(reason)}, {size_of_rest}"

    def _blocks_of(self, matrix: PETSc.Mat) -> PETSc.Mat:
        """The matrix stored in blocks of the two dofs of a node, if its rows come in such pairs.

        Factorization in blocks takes two thirds of the time in PETSc, its analysis half.
        """
        if self._in_blocks is not None:
            if self._in_blocks.copy_to_blocks(matrix):
                return self._in_blocks.blocks
            self._reset()
        if self._comm.size > 1 or not come_in_pairs(matrix):
            return matrix
        self._in_blocks = NodeBlocks(matrix)
        self._in_blocks.copy_to_blocks(matrix)
        return self._in_blocks.blocks

    def _call(self, rhs: PETSc.Vec, solution: PETSc.Vec, transpose: bool) -> None:
        """Call PETSc's solver."""
        (self.ksp.solveTranspose if transpose else self.ksp.solve)(rhs, solution)

    def _run(self, rhs: PETSc.Vec, solution: PETSc.Vec, transpose: bool) -> None:
        """Call PETSc's solver; an error on any rank is raised on all as a ``MortarError``.

        Direct solvers read options when factors of a new pattern are made.
        """
        error = None
        used = self._used if self._first else None
        reads = self._reads_options or not self._is_direct
        context = options_added(self._prefix, self._options, used) if reads else nullcontext()
        try:
            with context:
                self._call(rhs, solution, transpose)
        except MortarError as ours:
            error = ours
        except PETSc.Error as of_petsc:
            what = str(of_petsc).splitlines()[-1]
            error = MortarError(f"PETSc's error {of_petsc.ierr}, {what}")
        raise_together(self._comm, error)
        self._reads_options = False
        if self._first:
            self._first = False
            self.remark = "; ".join(filter(None, (self.remark, self.describe_unused())))

    def _describe(self, reason: int) -> str:
        """PETSc's reason for a failed solve, as text."""
        named = f"PETSc's reason {reason} ({REASONS.get(reason, 'unknown')})"
        if self.ksp.getType() == "preonly" or reason in NO_FACTORS:
            return f"it may be singular: {named}"
        if reason >= 0:
            return (
                f"the iterative solver stopped too early: {named}, reduce the tolerance "
                f"'{self._prefix}ksp_rtol'"
            )
        return f"the iterative solver did not converge: {named}"

    def describe_unused(self, *, reduced: bool = False) -> str:
        """Message on options of the user that PETSc did not read in a solve, each option once.

        Args:
            reduced: Whether the bulk was factorized instead of the whole system.
        """
        database = PETSc.Options(self._prefix).getAll() if self._prefix else {}
        given = {name for name in database if reduced or not name.startswith(COMPLIANCE)}
        given |= self.given
        self._used |= {name for name in database if compat.option_is_used(self._prefix + name)}
        used = set().union(*self._comm.allgather(self._used))
        unused = sorted(given - used)
        self.given, self._used = set(), used | given
        if not unused:
            return ""
        names = ", ".join(f"'{self._prefix}{name}'" for name in unused)
        message = f"PETSc did not use the option {names}: misspelt, or for another solver"
        if reduced:
            begin = f"'{self._prefix}{COMPLIANCE}'"
            message += f"; options of the linear bulk's factors begin with {begin}"
        return message


def _defect(
    multiply: Callable[[PETSc.Vec, PETSc.Vec], None], rhs: PETSc.Vec, solution: PETSc.Vec,
    defect: PETSc.Vec,
) -> float:  # fmt: skip
    """Set ``defect`` to the residual; return its norm."""
    multiply(solution, defect)
    defect.aypx(-1.0, rhs)
    return float(defect.norm())
