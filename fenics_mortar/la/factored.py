# SPDX-License-Identifier: MIT
"""Factorization of the bulk tangent with prescribed dofs fixed, for many right-hand sides.

GMRES with the factors of an earlier matrix as preconditioner.

Within a load step the matrices of Newton's method differ by a few contact rows and by small changes
of the stiffness: mostly GMRES then takes three to nine steps to the relative residual that Newton's
method needs. From one load step to the next it takes 20.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.la.options import DIRECT, options_added
from fenics_mortar.la.sparse import leave
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Indices
from fenics_mortar.utils.errors import MortarError

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
        pc.setType(
            kind
        )  # independent of the options of the whole system: many right-hand sides need factors
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
    return factored(_supported(bulk), prefix, rest)


def factored_bulk_by_cholmod(bulk: Bulk, prefix: str) -> PETSc.PC | None:
    """As ``factored_bulk``, see ``factored_by_cholmod`` (local)."""
    return factored_by_cholmod(_supported(bulk), prefix)


def _supported(bulk: Bulk) -> PETSc.Mat:
    """The bulk tangent with the prescribed dofs fixed (collective)."""
    prescribed = PETSc.IS().createGeneral(
        (bulk.prescribed_dofs + bulk.first).astype(PETSc.IntType), bulk.comm
    )
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


class LaggedFactors:
    """GMRES preconditioned by factors of an earlier matrix.

    Args:
        pc: The factors, which remain unchanged.
    """

    def __init__(self, pc: PETSc.PC) -> None:
        self._pc = pc
        self._ksp = PETSc.KSP().create(pc.comm)
        self._ksp.setType(PETSc.KSP.Type.GMRES)
        self._ksp.setPCSide(PETSc.PC.Side.RIGHT)
        self._ksp.setGMRESRestart(STEPS)
        self._ksp.setPC(pc)

    def solve(
        self, matrix: PETSc.Mat, rhs: PETSc.Vec, solution: PETSc.Vec, tolerance: float
    ) -> bool:
        """Solve with ``matrix`` in at most ``STEPS`` steps.

        Args:
            matrix: A, of the size of the factored matrix.
            rhs: Right-hand side [unit of the system].
            solution: The solution; filled.
            tolerance: Largest relative residual [1].

        Returns:
            Whether the tolerance was reached.
        """
        _, factored = self._pc.getOperators()
        self._ksp.setConvergenceTest(_judge, (tolerance, []))
        self._pc.setReusePreconditioner(True)
        try:
            self._ksp.setOperators(matrix, factored)
            self._ksp.solve(rhs, solution)
        finally:
            self._pc.setReusePreconditioner(False)
        return bool(self._ksp.getConvergedReason() > 0)


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
