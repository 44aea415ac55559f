# SPDX-License-Identifier: MIT
"""The contact problem that a user sets up: UFL residual, Dirichlet conditions, contact pairs."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx import fem

from fenics_mortar.bulk.checks import check_cells, check_slave_nodes, check_space
from fenics_mortar.bulk.mesh_overlap import check_mesh_overlap
from fenics_mortar.bulk.residual import Bulk, prescribed_dofs
from fenics_mortar.contact.binding import bind
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.pair import ContactPair
from fenics_mortar.contact.tied import Tie
from fenics_mortar.contact.tied_pair import TiedPair
from fenics_mortar.contact.view import PairView
from fenics_mortar.equations.arguments import check_arguments, check_options
from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.equations.inputs import Inputs, check_roles
from fenics_mortar.equations.linearized import LinearizedEquations, LinearVector
from fenics_mortar.equations.solver import Solver
from fenics_mortar.equations.state import State
from fenics_mortar.equations.undo import undone_if_interrupted
from fenics_mortar.interface.mortar import LINEARIZATIONS
from fenics_mortar.la import options as solvers
from fenics_mortar.la.choice import Algorithm, system_of
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.newton.loop import NewtonOptions, NewtonReport
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils import compat
from fenics_mortar.utils.arguments import check_kind
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import check_same_words, together
from fenics_mortar.verify.certificate import Certificate
from fenics_mortar.verify.estimate import ErrorEstimate, Estimator
from fenics_mortar.verify.matrices import OperatorMatrices
from fenics_mortar.verify.tangent import TangentCheck, check_tangent


class ContactProblem:
    """Quasi-static equilibrium of bodies in contact.

    Args:
        residual: UFL form of f_int - f_ext, linear in a test function of the space of ``u``. Give
            its measures a ``quadrature_degree``.
        u: Displacement, alone or with other unknowns (as a pressure) in a mixed function; its
            present value is the start of the next solve.
        pairs: Contact and tied pairs.
        bcs: Dirichlet conditions, of dolfinx or from ``dirichlet``; values may change.
        petsc_options_prefix: Prefix of the options of the linear solver.
        petsc_options: Options of the linear solver, beside those of ``solver``.
        algorithm: "condensed" (the paper's Alg. 2, dual multipliers only) or "saddle" (Alg. 1);
            condensed by default where D can be inverted node by node.
        solver: "direct" (MUMPS), "iterative" (GMRES with multigrid, see ``multigrid``) or "auto".
            That iterates from 100,000 unknowns on (``system.MANY``), where no options of PETSc are
            given and the bulk is not linear, and directly solves all else: mixed functions, small
            problems. If an iterative solution fails the direct solver takes over, and the report
            says so.
            Measured, CPU time of a Newton iteration, direct over iterative (``bench_newton.py``,
            two blocks): 1.0 with 10,000 unknowns, 1.5 with 41,000, 1.9 with 161,000. Below
            100,000 the gain is not worth answers that are right to 1e-8 instead of rounding.
        linearization: "full", "no_normals", "no_segments" or "frozen" (fixed point).
        newton: When to stop.
        jacobian: UFL form of the bulk tangent; the derivative of ``residual`` by default.
        displacement: Number of the displacement's sub-space, if ``u`` is a mixed function.
        linear_bulk: Whether the tangent of the bulk is constant, so that it can be factored once;
            see ``reduced``. By default this is seen from ``residual``, and done once it pays; with
            solver "iterative" only if asked for.
        adequacy: What asks after each solve whether the model was rich enough, an
            ``AdequacyCheck``; its answer is ``report.adequacy``. It may also begin each solve on a
            cheaper model, and go on only if that was not enough.

    Attributes:
        equations: All equations and their state, for research: bodies, contacts with surfaces and
            operators, driven obstacles, the linear system.

    Raises:
        MortarError: On all ranks, if mesh, surfaces or PETSc do not fit.
        ValueError: If an option is not one of those named.

    Note:
        All methods are collective.
    """

    def __init__(
        self,
        residual: Any,
        u: Any,
        pairs: Sequence[ContactPair | TiedPair],
        *,
        bcs: Sequence[Any] = (),
        petsc_options_prefix: str,
        petsc_options: dict[str, Any] | None = None,
        algorithm: Algorithm | None = None,
        solver: solvers.Solver = "auto",
        linearization: str = "full",
        newton: NewtonOptions | None = None,
        jacobian: Any | None = None,
        displacement: int = 0,
        linear_bulk: bool | None = None,
        adequacy: Any | None = None,
    ) -> None:
        check_kind("u", u, fem.Function, "a function of dolfinx")
        comm = u.function_space.mesh.comm
        options = {
            "petsc_options_prefix": petsc_options_prefix, "petsc_options": petsc_options,
            "algorithm": algorithm, "solver": solver, "linearization": linearization,
            "newton": newton, "displacement": displacement, "linear_bulk": linear_bulk,
        }  # fmt: skip
        with together(comm, "ContactProblem"):
            check_arguments(residual, u, pairs, bcs, jacobian)
            check_options(**options, adequacy=adequacy)
            options["residual"] = f"a form with the signature {residual.signature()[:8]}"
        options |= {f"pair {number}": vars(pair) for number, pair in enumerate(pairs)}
        check_same_words(comm, "ContactProblem", {"pairs": len(pairs), "bcs": len(bcs), **options})
        compat.free_petsc_garbage_of_earlier(comm)
        space = DisplacementSpace(u.function_space, displacement)
        check_space(space.V, pairs)
        if solver == "iterative" and space.is_mixed:
            raise ValueError("solver='iterative': mixed functions need solver='direct'")
        self._given = {
            "residual": residual, "u": u, "bcs": bcs, "petsc_options_prefix": petsc_options_prefix,
            "petsc_options": petsc_options, "algorithm": algorithm, "solver": solver,
            "linearization": linearization, "newton": newton, "jacobian": jacobian,
            "displacement": displacement, "linear_bulk": linear_bulk,
        }  # fmt: skip
        contacts = bind(pairs, space, prescribed_dofs(space, u, bcs))  # may move nodes
        bulk = Bulk(residual, u, list(bcs), jacobian, space)
        compat.keep_communicators(bulk.comm, bulk.r, bulk.K)
        check_slave_nodes(contacts)
        check_roles(contacts)
        check_cells(bulk)
        check_mesh_overlap(space.V, contacts)
        bulk.check_input()
        self.equations = ContactEquations(
            bulk, contacts, LINEARIZATIONS[linearization], newton or NewtonOptions()
        )
        self._show_outlines()
        if solver == "iterative" and linear_bulk is None:
            linear_bulk = False  # who iterates may lack the memory for factors
        self._solver = Solver(
            self.equations,
            system_of(
                bulk, contacts, petsc_options_prefix, petsc_options, algorithm, solver, linear_bulk
            ),
            linear_bulk=linear_bulk,
            prefix=petsc_options_prefix,
        )
        self._estimator: Estimator | None = None
        self._inputs = Inputs(bulk, contacts, self.obstacles)
        self._adequacy = adequacy
        if adequacy is not None:
            adequacy.prepare(self)

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of the mesh."""
        return self.equations.comm

    @property
    def contacts(self) -> tuple[PairView, ...]:
        """What was found on each pair, in the order of ``pairs``."""
        return tuple(PairView(contact) for contact in self.equations.contacts)

    @property
    def obstacles(self) -> list[Obstacle]:
        """The rigid obstacles of the pairs, each once."""
        return self.equations.motions.obstacles

    @property
    def newton(self) -> NewtonOptions:
        """When to stop; may be set."""
        return self.equations.newton

    @newton.setter
    def newton(self, options: NewtonOptions) -> None:
        self.equations.newton = options

    def _show_outlines(self) -> None:
        """Show each contact the bodies that it may look through, tied ones as one."""
        contacts, outline = self.equations.contacts, self.equations.crossings.outline
        labels = self.equations.bulk.space.spread(self.equations.floating.labels)
        bodies = outline.gather(labels)[:, 0].astype(np.int64)
        outline = replace(outline, bodies=bodies)
        ties = [contact for contact in contacts if isinstance(contact, Tie)]
        for contact in [*ties, *(c for c in contacts if isinstance(c, Contact))]:
            outline = contact.see(outline)

    def _renew_if_interrupted(self) -> None:
        """Make anew what an interruption may have left half made (collective)."""
        if self.comm.allreduce(self.equations.interrupted, MPI.LOR):
            self._solver.renew()
            self._estimator = None
            self.equations.interrupted = False

    # Solving

    def solve(self, *, accept_violations: bool = False) -> NewtonReport:
        """Solve for the present loads and prescribed values; move ``u`` and the multipliers.

        Args:
            accept_violations: Whether a state that violates its certificate is returned like any
                other, for who looks at ``report.certificate`` himself. It is asked for with the
                solve, not among the options of Newton's method, which knows no contact.

        Returns:
            The record of the Newton iterations.

        Raises:
            NotConvergedError: On all ranks; holds the record. So it is if Newton's method does not
                converge, and if it converges to a state that violates its certificate. ``u`` and
                the multipliers are left at the last iterate, or at that state, to be looked at,
                and slip goes on to count from the last state that was accepted; to solve again,
                reset ``u`` and mend what was wrong, or ``restore`` a copy made by ``state``.
            MortarError: On all ranks, if displacement, loads or prescribed values are not finite,
                if what is set on all ranks is not the same on all, or if the mesh was moved after
                set-up.
            BaseException: What came from elsewhere, as a KeyboardInterrupt or the error of a law of
                the user. Displacement and multipliers are as before the call then.
        """
        self._renew_if_interrupted()
        self.equations.bulk.check_input()
        remarks = self._inputs.check(self.newton, accept_violations)
        with undone_if_interrupted(self.equations, self._adequacy):
            report = None if self._adequacy is None else self._adequacy.solve_cheaper()
            if report is None:
                report = self._solver.solve(remarks, accept_violations=accept_violations)
            if self._adequacy is not None:
                report.adequacy = self._adequacy.assess(self)
        return report

    def accept(self) -> None:
        """Count slip and ways of nodes from the last evaluated state (collective)."""
        self._solver.accept()

    def state(self) -> State:
        """The present state, as a value: displacement, interfaces, places of obstacles (local)."""
        return self.equations.state()

    def restore(self, state: State) -> None:
        """Go back to a state of this problem, exactly (collective).

        Raises:
            MortarError: On all ranks, if it is none, or one of another problem.
        """
        self.equations.restore(state)

    def forces(self) -> tuple[Array, Array, Array]:
        """Residual of the bulk, contact forces and those on obstacles (collective).

        At the present state, operators evaluated anew. The first two are parts of this rank, shape
        (owned dofs,) [stress length]; their sums at prescribed dofs are the reactions of the
        supports. The third, shape (obstacles, 3), is the force and moment that hold the obstacles.
        """
        self.equations.evaluate_operators()
        return self.equations.forces()

    # Other models

    def variant(self, *, residual: Any | None = None, **pair_options: Any) -> ContactProblem:
        """The same problem by another model, with the same ``u``, conditions and obstacles.

        The two share the displacement: take a state of the one over by ``adopt``.

        Args:
            residual: UFL form in the place of this problem's.
            pair_options: Attributes of contact pairs instead, as ``sliding="finite"``, or functions
                of the present ones.
        """
        pairs = [
            p.with_options(**pair_options) if isinstance(p, ContactPair) else copy(p)
            for p in (contact.pair for contact in self.equations.contacts)
        ]
        given = {**self._given, "pairs": pairs}
        if residual is not None:
            given.update(residual=residual, jacobian=None)
        u = self.equations.bulk.u.x.array
        kept = u.copy()
        try:
            u[:] = 0.0
            return ContactProblem(**given)
        finally:
            u[:] = kept

    def adopt(self, other: ContactProblem) -> None:
        """Go to the present state of a variant."""
        pairs = zip(self.equations.contacts, other.equations.contacts, strict=True)
        for contact, theirs in pairs:
            if isinstance(contact, Contact) and isinstance(theirs, Contact):
                contact.adopt(theirs)
        self.restore(other.state())

    # What was found

    @property
    def adequacy(self) -> Any:
        """The ``AdequacyCheck`` that asks after each solve, or ``None``."""
        return self._adequacy

    def certificate(self) -> Certificate:
        """Measure balance, signs, penetration and crossings of the last evaluated state."""
        return self._solver.certificate()

    def estimate(self) -> ErrorEstimate:
        """Estimate the error of the present state by cells; see ``estimate``.

        Raises:
            MortarError: On all ranks, if the residual has integrals that cannot be read.
        """
        self._renew_if_interrupted()
        if self._estimator is None:
            self._estimator = Estimator(self.equations.bulk)
        self.equations.evaluate_operators()
        self.equations.bulk.free_garbage()
        return self._estimator.evaluate(self.equations.contacts)

    # For research

    @property
    def matrices(self) -> OperatorMatrices:
        """D, M, gap, normals and their derivatives as PETSc objects, at the present state."""
        self.equations.evaluate_operators()
        return OperatorMatrices(self.equations.bulk, self.equations.contacts)

    @property
    def tangent(self) -> PETSc.Mat:
        """Matrix of the linear system at the present state."""
        self._renew_if_interrupted()
        equations = self.equations
        equations.bulk.free_garbage()
        equations.evaluate_operators()
        equations.bulk.assemble_tangent()
        equations.bulk.assemble_residual()
        equations.system.assemble()
        return equations.system.matrix

    def linear_solve(self, rhs: LinearVector, *, transpose: bool = False) -> LinearVector:
        """Solve with the tangent of all equations at the present state, or with its transpose.

        For sensitivities: unknowns, rows and units are those of ``equations.linearized``. Active
        sets, branches of the laws and multipliers are those of the present state; nothing of it
        changes. A direct solver is exact but for rounding; an iterative one leaves the part
        ``ksp_rtol`` of the right-hand side (1e-8 by default).

        Args:
            rhs: The right-hand side.
            transpose: Whether to solve with the transpose, as for an adjoint.

        Returns:
            The solution, with all parts.

        Raises:
            ValueError: On all ranks, if ``rhs`` has another shape or is not finite.
            MortarError: On all ranks, if the tangent is singular, as where contact leaves a body
                free, or if z or q are not alike on all ranks.
        """
        self._renew_if_interrupted()
        with undone_if_interrupted(self.equations, self._adequacy):
            e = self.equations
            e.evaluate_operators()
            e.bulk.free_garbage()
            linearized = LinearizedEquations(e.bulk, e.contacts, e.motions, e.system)
            return linearized.solve(rhs, transpose=transpose)

    def check_tangent(self, **options: Any) -> TangentCheck:
        """Taylor slopes of all derivatives at the present state; see ``tangent.check_tangent``."""
        self._renew_if_interrupted()
        with undone_if_interrupted(self.equations, self._adequacy):
            return check_tangent(self.equations, **options)
