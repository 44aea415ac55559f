# SPDX-License-Identifier: MIT
"""GMRES with the factors of an earlier matrix as preconditioner.

Within a load step the matrices of Newton's method differ by a few contact rows and by small changes
of the stiffness: mostly GMRES then takes three to nine steps to the relative residual that Newton's
method needs. From one load step to the next it takes 20.
"""

from __future__ import annotations

from petsc4py import PETSc

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
