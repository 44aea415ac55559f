# SPDX-License-Identifier: MIT
"""Forces, matrices, derivatives and the error estimate of a problem at its present state."""

from __future__ import annotations

from typing import Any

from petsc4py import PETSc

import numpy.typing as npt

from fenics_mortar.bulk.checks import refuse_history, refuse_inertia
from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.equations.linearized import LinearizedEquations, LinearVector
from fenics_mortar.equations.reaction import Reaction, named_boundary, reaction_of
from fenics_mortar.equations.solver import Solver
from fenics_mortar.equations.undo import restored_if_interrupted
from fenics_mortar.mesh.data import MeshData, Names
from fenics_mortar.rigid.remote import refuse_remote
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.ranks import on_any_rank
from fenics_mortar.verify.estimate import ErrorEstimate, Estimator
from fenics_mortar.verify.matrices import OperatorMatrices
from fenics_mortar.verify.tangent import TangentCheck, check_tangent


def linearized(e: ContactEquations) -> LinearizedEquations:
    """Solves with the tangent at the last evaluated state, or with its transpose."""
    return LinearizedEquations(e.bulk, e.contacts, e.motions, e.system, e.reduced_tangent())


class PresentState:
    """Evaluates the equations of a problem at its present state; all methods are collective.

    Operators are evaluated first, since users may have set the displacement.

    Args:
        equations: The equations of the problem.
        solver: Its solver, created again after an interruption.
    """

    def __init__(self, equations: ContactEquations, solver: Solver) -> None:
        self._equations, self._solver = equations, solver
        self._estimator: Estimator | None = None

    def renew_if_interrupted(self) -> None:
        """Create the solver and the estimator again after an interruption."""
        if on_any_rank(self._equations.comm, self._equations.interrupted):
            self._solver.renew()
            self._estimator = None
            self._equations.interrupted = False

    def forces(self) -> tuple[Array, Array, Array]:
        """See ``ContactProblem.forces``."""
        self._equations.evaluate_operators()
        bulk, contact, on_obstacles = self._equations.residual.forces()
        return bulk, contact, on_obstacles * self._equations.motions.scales[: len(on_obstacles)]

    def reaction(
        self, names: Names, about: npt.ArrayLike | None, given: MeshData | None
    ) -> Reaction:
        """See ``ContactProblem.reaction``."""
        e = self._equations
        meshes = [c.pair.data for c in e.contacts] if given is None else [given]
        data, point = named_boundary(e.bulk, meshes, names, about)
        bulk, contact, _ = self.forces()
        return reaction_of(e.bulk, bulk + contact, data, names, point)

    def estimate(self) -> ErrorEstimate:
        """See ``ContactProblem.estimate``."""
        e = self._equations
        refuse_inertia(e.bulk, "estimate()")
        refuse_remote(e.bulk.spread, "the error estimate is not implemented")
        refuse_history(e.bulk, "estimate()")
        self.renew_if_interrupted()
        self._estimator = self._estimator or Estimator(e.bulk)
        e.evaluate_operators()
        e.bulk.free_garbage()
        return self._estimator.evaluate(e.contacts)

    def matrices(self) -> OperatorMatrices:
        """See ``ContactProblem.matrices``."""
        self._equations.evaluate_operators()
        return OperatorMatrices(self._equations.bulk, self._equations.contacts)

    def tangent(self) -> PETSc.Mat:
        """See ``ContactProblem.tangent``."""
        self.renew_if_interrupted()
        e = self._equations
        e.bulk.free_garbage()
        e.evaluate_operators()
        e.bulk.assemble_tangent()
        e.bulk.assemble_residual()
        e.system.assemble()
        return e.system.matrix

    def linear_solve(self, rhs: LinearVector, *, transpose: bool) -> LinearVector:
        """See ``ContactProblem.linear_solve``."""
        self.renew_if_interrupted()
        e = self._equations
        with restored_if_interrupted(e):
            e.evaluate_operators()
            e.bulk.free_garbage()
            return linearized(e).solve(rhs, transpose=transpose)

    def check_tangent(self, **options: Any) -> TangentCheck:
        """See ``ContactProblem.check_tangent``."""
        self.renew_if_interrupted()
        with restored_if_interrupted(self._equations):
            return check_tangent(self._equations, **options)
