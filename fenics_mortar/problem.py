# SPDX-License-Identifier: MIT
"""The contact problem that a user sets up: UFL residual, Dirichlet conditions, contact pairs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from typing import Any, get_args

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import ufl
from dolfinx import fem

from fenics_mortar.bulk.checks import (
    check_cells,
    check_jacobian,
    check_residual,
    check_slave_nodes,
    check_space,
)
from fenics_mortar.bulk.mesh_overlap import check_mesh_overlap
from fenics_mortar.bulk.residual import Bulk, prescribed_dofs
from fenics_mortar.contact.binding import bind
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.pair import ContactPair
from fenics_mortar.contact.tied import Tie
from fenics_mortar.contact.tied_pair import TiedPair
from fenics_mortar.contact.words import describe_start
from fenics_mortar.equations.general import SLIGHT, ContactEquations
from fenics_mortar.equations.inputs import Inputs, check_roles
from fenics_mortar.equations.reduced import LinearBulk
from fenics_mortar.equations.undo import undone_if_interrupted
from fenics_mortar.interface.mortar import LINEARIZATIONS
from fenics_mortar.interface.sight import extract_outline
from fenics_mortar.la.system import (
    DIRECT,
    ITERATIVE,
    MANY,
    SYSTEMS,
    Algorithm,
    LinearSystem,
    Solver,
    obstacle_to_condensation,
)
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.newton.damping import Damped
from fenics_mortar.newton.loop import NewtonOptions, NewtonReport, once, solve
from fenics_mortar.rigid.release import hold_here, release_slowly
from fenics_mortar.utils import compat
from fenics_mortar.utils.arguments import check_choice, check_kind, check_number
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.errors import NotConvergedError, check_same_words, together
from fenics_mortar.verify.certificate import Certificate, certify
from fenics_mortar.verify.estimate import ErrorEstimate, Estimator
from fenics_mortar.verify.matrices import OperatorMatrices
from fenics_mortar.verify.tangent import TangentCheck, check_tangent


class ContactProblem(ContactEquations):
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
        contacts: The pairs bound to the mesh: multipliers, active sets, operators.
        tools: Their obstacles.
        bulk: Bulk residual and tangent.
        floating: Bodies that Dirichlet conditions do not hold.
        stiffest: Largest diagonal entry of the bulk tangent at the start [stress].

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
        solver: Solver = "auto",
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
            _check_arguments(residual, u, pairs, bcs, jacobian)
            _check_options(**options, adequacy=adequacy)
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
        super().__init__(bulk, contacts, LINEARIZATIONS[linearization], newton or NewtonOptions())
        self._show_outlines()
        if algorithm is None:
            algorithm = "saddle" if obstacle_to_condensation(contacts) else "condensed"
        automatic = solver == "auto"
        if automatic and not self._is_for_multigrid(linear_bulk, petsc_options):
            solver = "direct"
        defaults: dict[str, Any] = DIRECT if solver == "direct" else ITERATIVE
        solving = defaults | (petsc_options or {})
        system: Callable[..., LinearSystem] = SYSTEMS[algorithm]
        self._create_system = partial(system, bulk, contacts, petsc_options_prefix, solving)
        self._may_factor = automatic and solver == "auto"
        self._renew_system()
        self.interrupted = False
        if solver == "iterative" and linear_bulk is None:
            linear_bulk = False  # who iterates may lack the memory for factors
        self._linear_bulk = LinearBulk(self, linear_bulk, petsc_options_prefix)
        self._estimator: Estimator | None = None
        self._begin_where_meshed()
        self._inputs, self._remarks = Inputs(bulk, contacts, self.tools.obstacles), list[str]()
        self._adequacy = adequacy
        if adequacy is not None:
            adequacy.prepare(self)

    def _show_outlines(self) -> None:
        """Show each contact the bodies that it may look through, tied ones as one."""
        outline = extract_outline(self.bulk.space, self.floating.labels)
        ties = [contact for contact in self.contacts if isinstance(contact, Tie)]
        for contact in [*ties, *(c for c in self.contacts if isinstance(c, Contact))]:
            outline = contact.see(outline)

    def _begin_where_meshed(self) -> None:
        """Evaluate the contacts at the start, and take its gaps for what the pairs say."""
        self._evaluate_operators()
        for contact in self.contacts:
            contact.set_initial_gap()
        self._evaluate_operators()
        self.accept()
        self._starts = [describe_start(contact) for contact in self.contacts]

    def _renew_system(self) -> None:
        """Make the linear system and its solver, as they were at the start."""
        self.system = self._create_system()
        self.system.given = set(self._given["petsc_options"] or {})
        self.system.may_factor = self._may_factor

    def _renew_if_interrupted(self) -> None:
        """Make anew what an interruption may have left half made (collective)."""
        if self.comm.allreduce(self.interrupted, MPI.LOR):
            self.bulk.renew_tangent()
            self.bulk.assemble_tangent()
            self._renew_system()
            self._linear_bulk.forget()
            self._estimator = None
            self.interrupted = False

    def _is_for_multigrid(
        self, linear_bulk: bool | None, petsc_options: dict[str, Any] | None
    ) -> bool:
        """Whether solver "auto" iterates; see there."""
        given = PETSc.Options(self._given["petsc_options_prefix"]).getAll() or petsc_options
        factored_once = self.bulk.is_linear and linear_bulk is not False
        simple = not (self.bulk.space.is_mixed or given or factored_once)
        return simple and self.bulk.r.getSize() >= MANY

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
        self.bulk.check_input()
        self._remarks = self._inputs.check(self.newton, accept_violations)
        with undone_if_interrupted(self):
            report = None if self._adequacy is None else self._adequacy.solve_cheaper()
            report = report or self._solve_by_this_model(accept_violations)
            if self._adequacy is not None:
                report.adequacy = self._adequacy.assess(self)
        return report

    def _solve_by_this_model(self, accept_violations: bool) -> NewtonReport:
        """Solve, whatever the model's adequacy."""
        clock.read()
        self.crossings.begin(self.tools.places)
        for contact in self.contacts:
            contact.start_step()
        try:
            self.tools.follow(self._evaluate_operators)
            moved = self.tools.settle(partial(self._evaluate_contacts, start=True))
            moved += self.floating.settle(self._evaluate_forces)
            self.hold(None)
            if moved:
                self._accept_moved()
            report = self._solve()
            moved += self.floating.check()
        except Exception:  # of whatever kind, for all ranks alike
            self._last_converged = False
            self.crossings.leave()
            self.hold(None)
            raise
        self._last_converged = True
        accepted = [contact.accepted for contact in self.contacts]
        for contact in self.contacts:
            contact.accept()
        self.bulk.free_garbage()
        passages = self.crossings.passages(self.tools.places)
        report.certificate = replace(
            self.certificate(), drift=self.tools.strayed(), passages=passages
        )
        violations = report.certificate.violations()
        told = [f"VIOLATED: {violation}" for violation in violations]
        remarks = told or report.certificate.remarks()
        reactions = self.tools.record()
        begun = [*self._remarks, *filter(None, self._starts)]
        report.notes[:] = once([*begun, *moved, *remarks, *reactions, *report.notes])
        self._starts, self._remarks = [], []
        if violations and not accept_violations:
            self._last_converged = False
            for contact, before in zip(self.contacts, accepted, strict=True):
                contact.change(accepted=before)
            self.crossings.leave()
            raise _wrong_state(report, violations)
        self.crossings.accept(self.tools.places)
        return report

    def _solve(self) -> NewtonReport:
        """Solve on the contact dofs where the bulk is linear, else on all."""
        reduced, remarks = self._linear_bulk.choose()
        if reduced is not None:
            start = self.state()
            try:
                report = solve(reduced, self.newton)
                reduced.finish()
                if self._is_sound(report):
                    return report
            except NotConvergedError:
                if self.newton.tentative:
                    raise
            self.restore(start)
            remarks = ["the contact dofs alone led astray: this step was solved on all dofs"]
        report = self._solve_on_all_dofs()
        self._linear_bulk.count(report.num_iterations)
        report.notes[:0] = remarks
        return report

    def _is_sound(self, report: NewtonReport) -> bool:
        """Whether the present state solves all equations and inverts no cell (collective)."""
        status = self.evaluate(start=False)
        allowed = self.newton.residual_tolerance * max(report.force, status.force) + status.noise
        return status.residual <= allowed and not self.bulk.inverted_cells()[0]

    def _solve_on_all_dofs(self) -> NewtonReport:
        """One Newton loop; where that fails and bodies float, several with springs that let go."""
        start = self.state()
        try:
            return solve(Damped(self, self.newton) if self.newton.damped else self, self.newton)
        except NotConvergedError as error:
            loose = bool(self.floating.bodies) or self.tools.driven.any()
            if self.newton.tentative or not loose:
                raise
            failed = error
            if self.drifts():
                try:
                    return hold_here(self, self.newton, error, most=SLIGHT)
                except NotConvergedError as held:
                    failed = NotConvergedError(error.report.reason, held.report)
            self.restore(start)
            return release_slowly(self, self.newton, failed)

    def accept(self) -> None:
        """Count slip and ways of nodes from the last evaluated state (collective)."""
        for contact in self.contacts:
            contact.accept()
            contact.start_step()
        self.crossings.accept(self.tools.places)

    def _accept_moved(self) -> None:
        """Count slip from where bodies were moved to, but for nodes that slid there (collective).

        Motion towards another body is no slip; motion along one, from touch to touch, is.
        """
        touched = iter(self.floating.touched)
        for contact in self.contacts:
            if isinstance(contact, Contact):
                before = next(touched, np.zeros_like(contact.active))
                contact.accept(slid=before & contact.active)
            else:
                contact.accept()
            contact.start_step()

    # Other models

    def variant(self, *, residual: Any | None = None, **pair_options: Any) -> ContactProblem:
        """The same problem by another model, with the same ``u``, conditions and obstacles.

        The two share the displacement: take a state of the one over by ``adopt``.

        Args:
            residual: UFL form in the place of this problem's.
            pair_options: Attributes of contact pairs instead, as ``sliding="finite"``, or functions
                of the present ones.
        """
        pairs = [copy(contact.pair) for contact in self.contacts]
        for pair in pairs:
            if isinstance(pair, ContactPair):
                for name, new in pair_options.items():
                    if name not in vars(pair):
                        raise ValueError(f"{name}={new!r}: a pair has {', '.join(vars(pair))}")
                    setattr(pair, name, new(getattr(pair, name)) if callable(new) else new)
        given = {**self._given, "pairs": pairs}
        if residual is not None:
            given.update(residual=residual, jacobian=None)
        u = self.bulk.u.x.array
        kept = u.copy()
        try:
            u[:] = 0.0
            return ContactProblem(**given)
        finally:
            u[:] = kept

    def adopt(self, other: ContactProblem) -> None:
        """Go to the present state of a variant."""
        for contact, theirs in zip(self.contacts, other.contacts, strict=True):
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
        certificate = certify(self.bulk, self.contacts, self.floating.labels, self.tools.residual())
        springs = max((p for _, p in self._parts_held()), default=0.0)
        return replace(certificate, springs=springs, crossings=self.crossings.find())

    def estimate(self) -> ErrorEstimate:
        """Estimate the error of the present state by cells; see ``estimate``.

        Raises:
            MortarError: On all ranks, if the residual has integrals that cannot be read.
        """
        self._renew_if_interrupted()
        if self._estimator is None:
            self._estimator = Estimator(self.bulk)
        self._evaluate_operators()
        self.bulk.free_garbage()
        return self._estimator.evaluate(self.contacts)

    # For research

    @property
    def matrices(self) -> OperatorMatrices:
        """D, M, gap, normals and their derivatives as PETSc objects, at the present state."""
        return OperatorMatrices(self.bulk, self.contacts)

    @property
    def D(self) -> PETSc.Mat:
        """Slave mortar matrix of the first pair; see ``matrices``."""
        return self.matrices.D(0)

    @property
    def M(self) -> PETSc.Mat:
        """Master mortar matrix of the first pair; see ``matrices``."""
        return self.matrices.M(0)

    @property
    def tangent(self) -> PETSc.Mat:
        """Matrix of the linear system at the present state."""
        self._renew_if_interrupted()
        self.bulk.free_garbage()
        self.bulk.assemble_tangent()
        self.bulk.assemble_residual()
        self.system.assemble()
        return self.system.matrix

    def check_tangent(self, **options: Any) -> TangentCheck:
        """Taylor slopes of all derivatives at the present state; see ``tangent.check_tangent``."""
        self._renew_if_interrupted()
        with undone_if_interrupted(self):
            return check_tangent(self, **options)


def _wrong_state(report: NewtonReport, violations: Sequence[str]) -> NotConvergedError:
    """The error that says that a state violates its certificate, and what helps."""
    report.reason = f"converged to a wrong state: {'; '.join(violations)}"
    report.converged = False
    smaller = any("smaller steps" in words or "inverted" in words for words in violations)
    advice = "follow_path takes such a step back and cuts it; " * smaller
    words = f"{report.reason}; {advice}solve(accept_violations=True) returns it"
    return NotConvergedError(words, report)


def _check_arguments(residual: Any, u: Any, pairs: Any, bcs: Any, jacobian: Any) -> None:
    """Refuse forms, pairs or conditions of a wrong kind (local)."""
    check_kind("residual", residual, ufl.Form, "a UFL form")
    if not isinstance(pairs, Sequence) or not all(
        isinstance(p, (ContactPair, TiedPair)) for p in pairs
    ):
        raise ValueError(f"pairs={pairs!r}: right is a list of ContactPair and TiedPair")
    if not isinstance(bcs, Sequence):
        raise ValueError(f"bcs is a {type(bcs).__name__}: right is a list of Dirichlet conditions")
    if not all(hasattr(bc, "function_space") for bc in bcs):
        raise ValueError(f"bcs={bcs!r}: right is a list of Dirichlet conditions")
    for pair in pairs:
        pair.check()
    check_residual("residual", residual, u)
    if jacobian is not None:
        check_kind("jacobian", jacobian, ufl.Form, "a UFL form, or None")
        check_jacobian(jacobian, u)


def _check_options(
    petsc_options_prefix: Any,
    petsc_options: Any,
    algorithm: Any,
    solver: Any,
    linearization: Any,
    newton: Any,
    displacement: Any,
    linear_bulk: Any,
    adequacy: Any,
) -> None:
    """Refuse options of a wrong kind (local)."""
    check_kind("petsc_options_prefix", petsc_options_prefix, str, "a text, as 'blocks_'")
    for name, value, kind, right in (
        ("petsc_options", petsc_options, dict, "a dictionary, or None"),
        ("newton", newton, NewtonOptions, "an instance of NewtonOptions, or None"),
        ("linear_bulk", linear_bulk, bool, "True, False or None"),
    ):
        if value is not None:
            check_kind(name, value, kind, right)
    for name in petsc_options or {}:
        if not isinstance(name, str) or name.startswith("-"):
            raise ValueError(f"petsc_options with {name!r}: right is e.g. 'ksp_rtol'")
    check_choice("linearization", linearization, LINEARIZATIONS)
    check_choice("solver", solver, get_args(Solver))
    if algorithm is not None:
        check_choice("algorithm", algorithm, get_args(Algorithm))
    right = "the number of a sub-space"
    check_number("displacement", displacement, right, lambda part: part >= 0, whole=True)
    if adequacy is not None and (isinstance(adequacy, type) or not hasattr(adequacy, "prepare")):
        raise ValueError(f"adequacy={adequacy!r}: expected an instance of AdequacyCheck, or None")
