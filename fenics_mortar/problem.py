# SPDX-License-Identifier: MIT
"""The contact problem: UFL residual, Dirichlet conditions, contact pairs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from fenics_mortar.bulk import checks
from fenics_mortar.bulk.bodies import check_mesh_overlap
from fenics_mortar.bulk.residual import Bulk, mark_prescribed
from fenics_mortar.bulk.revolution import check_axis, check_radius
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.pair import ContactPair, Pretension, TiedPair
from fenics_mortar.contact.tied import bind
from fenics_mortar.contact.view import PairView
from fenics_mortar.equations import general
from fenics_mortar.equations.arguments import check_arguments, check_in_space, check_options
from fenics_mortar.equations.inputs import Inputs, check_roles
from fenics_mortar.equations.linearized import LinearizedEquations, LinearVector
from fenics_mortar.equations.predictor import Continuation
from fenics_mortar.equations.residual import Reaction, reaction_of
from fenics_mortar.equations.solver import Solver
from fenics_mortar.interface.mortar import LINEARIZATIONS
from fenics_mortar.la.condensed import system_of
from fenics_mortar.mesh.space import DisplacementSpace, Geometry, thickness_of
from fenics_mortar.newton.loop import NewtonOptions, NewtonReport
from fenics_mortar.rigid.spread import BoundaryMotion, BoundSection, check_remote, refuse_remote
from fenics_mortar.utils import compat, errors, ranks
from fenics_mortar.verify.estimate import ErrorEstimate, Estimator
from fenics_mortar.verify.tangent import OperatorMatrices, TangentCheck, check_tangent

if TYPE_CHECKING:
    from fenics_mortar.la import options as solvers
    from fenics_mortar.la.options import Algorithm
    from fenics_mortar.mesh.data import MeshData, Names
    from fenics_mortar.obstacles.obstacle import Obstacle
    from fenics_mortar.utils.arrays import Array
    from fenics_mortar.verify.certificate import Certificate


def check_given(
    given: dict[str, Any], pairs: Sequence[ContactPair | TiedPair], model_check: Any
) -> None:
    """Reject arguments of a wrong type, or that differ between ranks (collective).

    Args:
        given: Arguments of ``ContactProblem`` by name, without pairs and model check.
        pairs: The pairs.
        model_check: Check of the model, or ``None``.

    Raises:
        ValueError: On all ranks, if an argument has a value that is not allowed.
        MortarError: On all ranks, if arguments differ between ranks.
        NotImplementedError: On all ranks, if an argument needs the plane.
    """
    lists = ("bcs", "remote", "history")
    forms = ("residual", "u", "jacobian", "before_assembly", *lists)
    options = {name: value for name, value in given.items() if name not in forms}
    errors.check_kind("u", given["u"], fem.Function, "a function of dolfinx")
    mesh = given["u"].function_space.mesh
    comm = mesh.comm
    if comm.size > 1:
        compat.settle_coordinate_element(mesh)
    with errors.together(comm, "ContactProblem"):
        check_arguments(pairs, given)
        check_remote(given["remote"])
        check_options(given, model_check)
        beyond = [name for name in ("history", "before_assembly") if given[name]]
        if beyond and model_check is not None:
            raise ValueError(f"model_check does not support {beyond[0]}")
        signature = given["residual"].signature()
        options["residual"] = f"a form with the signature {signature[:8]}"
    check_in_space(given, pairs)
    options |= {f"pair {number}": vars(pair) for number, pair in enumerate(pairs)}
    counts = {"pairs": len(pairs), **{name: len(given[name]) for name in lists}}
    errors.check_same_texts(comm, "ContactProblem", {**counts, **options})


def equations_of(
    given: dict[str, Any], pairs: Sequence[ContactPair | TiedPair]
) -> general.ContactEquations:
    """Equations of a problem, for arguments of ``ContactProblem`` by name (collective).

    Gaps of ties are removed from the mesh.

    Raises:
        MortarError: On all ranks, if the mesh or a surface is unsuitable.
        ValueError: On all ranks, if ``u`` is a mixed function and the solver iterative.
    """
    residual, u, jacobian = (given[name] for name in ("residual", "u", "jacobian"))
    compat.free_garbage_of_earlier(u.function_space.mesh.comm)
    weight = thickness_of(given["geometry"], given["thickness"])
    space = DisplacementSpace(u.function_space, given["displacement"], weight)
    checks.check_space(space.V, pairs)
    for name, form in (("residual", residual), ("jacobian", jacobian)):
        if form is not None:
            checks.check_subdomains(name, form, space.V.mesh, [pair.data for pair in pairs])
    if given["solver"] == "iterative" and space.is_mixed:
        raise ValueError("solver='iterative': mixed functions need solver='direct'")
    loads = [load.bind(space) for load in given["remote"]]
    bcs = [*given["bcs"], *(load for load in loads if hasattr(load, "dof_indices"))]
    prescribed = mark_prescribed(space, u, bcs)
    check_axis(space, prescribed)
    check_radius(residual, u, space)
    checks.check_rules(residual, u, space)
    contacts = bind(
        pairs, space, prescribed, chains=given["algorithm"] != "condensed"
    )  # may move nodes
    for load in loads:
        load.update_reference()
    bulk = Bulk(residual, u, bcs, jacobian, space, given["history"], given["before_assembly"])
    bulk.surfaces_slide = any(p.sliding == "finite" for p in pairs if isinstance(p, ContactPair))
    compat.keep_communicators(bulk.comm, bulk.r, bulk.K)
    loads += [BoundSection(c, bulk) for c in contacts if isinstance(c.pair, Pretension)]
    checks.check_slave_nodes(contacts)
    check_roles(contacts)
    checks.check_cells(bulk)
    check_mesh_overlap(space, [side for c in contacts for side in (c.slave, c.master)])
    bulk.input_data.check()
    linearization, newton = LINEARIZATIONS[given["linearization"]], given["newton"]
    newton = newton or NewtonOptions()
    equations = general.ContactEquations(bulk, contacts, linearization, newton, loads)
    outline = equations.crossings.outline
    labels = outline.gather(bulk.space.spread(equations.floating.labels))[:, 0]
    outline = replace(outline, bodies=labels.astype(np.int64))  # tied bodies are one
    for contact in sorted(contacts, key=lambda contact: isinstance(contact, Contact)):  # ties first
        outline = contact.limit_sight(outline)
    return equations


def solver_of(equations: general.ContactEquations, given: dict[str, Any]) -> Solver:
    """Solver of equations, for arguments of ``ContactProblem`` by name (collective)."""
    prefix, solver, linear_bulk = (
        given[name] for name in ("petsc_options_prefix", "solver", "linear_bulk")
    )
    if solver == "iterative" and linear_bulk is None:
        linear_bulk = False  # the factors may exceed the memory
    create_system = system_of(
        equations.bulk, equations.contacts, prefix, given["petsc_options"], given["algorithm"],
        solver, linear_bulk,
    )  # fmt: skip
    return Solver(equations, create_system, linear_bulk=linear_bulk, prefix=prefix)


class ContactProblem:
    """Quasi-static equilibrium of bodies in contact.

    Args:
        residual: UFL form of f_int - f_ext, linear in a test function of the space of ``u``.
            Specify a ``quadrature_degree`` for its measures.
        u: Displacement, or a mixed function with the displacement and further unknowns, such as a
            pressure. Its present value is the initial guess of the next solve.
        pairs: Contact and tied pairs, sections under pretension.
        bcs: Dirichlet conditions, of dolfinx or from ``dirichlet``; their values may change.
        petsc_options_prefix: Prefix of the options of the linear solver.
        petsc_options: Options of the linear solver, in addition to those of ``solver``. With a
            ``pc_type`` other than "lu" and "cholesky" PETSc's own defaults apply (GMRES).
        algorithm: "condensed" (Foltyn & Vlach 2016, Alg. 2; dual multipliers only) or "saddle"
            (Alg. 1). Default: condensed if D can be inverted node by node.
        solver: "direct" (MUMPS), "iterative" (GMRES with multigrid, see ``multigrid``) or "auto".
            "auto" is iterative from 100,000 unknowns (``la.options``) for nonlinear bulk without
            PETSc options. The direct solver is used, with a note, if an iterative solve fails.
        linearization: "full", "no_normals", "no_segments" or "frozen" (fixed point).
        newton: Tolerances and limits of Newton's method.
        jacobian: UFL form of the bulk tangent; the derivative of ``residual`` by default.
        displacement: Index of the displacement's sub-space if ``u`` is a mixed function.
        linear_bulk: Whether the bulk tangent is constant and may be factorized once; see
            ``reduced``. Default: detected, used if it saves time and ``solver`` is not "iterative".
        geometry: "plane", or "axisymmetric": the mesh is the meridian half plane x >= 0 of bodies
            of revolution about x = 0. Interface integrals are then weighted by 2 pi r: pressures
            are stresses, and forces act on the whole bodies; ``residual`` must contain 2 pi X[0] in
            its measures and the hoop strain. Radial components on the axis must be prescribed as 0.
            A ``Circle`` about a point of the axis is a sphere. See ``mesh.space``.
        thickness: Out-of-plane thickness of plane bodies, by which interface integrals are
            weighted, as the measures of ``residual`` must be. A positive length, or a function of
            reference positions (n, 2); ``None`` means one, without a unit.
        remote: Loads or motions given at points: ``RigidBoundary``, ``SpreadLoad``.
        history: Pairs of an ``fm.quadrature_function`` in the forms and a UFL expression of ``u``
            and such functions: its new value, set when a step is accepted; see ``bulk.history``.
        before_assembly: Function without arguments that sets functions of the forms which depend on
            ``u`` by other means than UFL; called before each assembly, needs ``jacobian``.
        model_check: A ``ModelCheck`` that estimates the model error after each solve
            (``report.model_check``).

    Attributes:
        equations: All equations and their state, for research: bodies, contacts with surfaces and
            operators, rigid motions, the linear system, ``newton`` (options, may be set).

    Raises:
        MortarError: On all ranks, if the mesh, a surface or PETSc is unsuitable.
        ValueError: If an argument has a value that is not allowed.

    Note:
        All methods are collective.

    Example:
        Two blocks, pressed together in five steps; the README has the whole script::

            contact = fm.ContactPair(blocks, slave="upper/bottom", master="lower/top")
            problem = fm.ContactProblem(
                residual, u, [contact], bcs=bcs, petsc_options_prefix="blocks_"
            )
            for step in range(1, 6):
                push.value[1] = -0.03 * step
                report = problem.solve()
            print(report, problem.contacts[0].pressure)
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
        solver: solvers.SolverName = "auto",
        linearization: str = "full",
        newton: NewtonOptions | None = None,
        jacobian: Any | None = None,
        displacement: int = 0,
        linear_bulk: bool | None = None,
        geometry: Geometry = "plane",
        thickness: float | Callable[[Array], Any] | None = None,
        remote: Sequence[Any] = (),
        history: Sequence[tuple[Any, Any]] = (),
        before_assembly: Callable[[], Any] | None = None,
        model_check: Any | None = None,
    ) -> None:
        given, apart = locals().copy(), ("self", "pairs", "model_check")
        self._given = {name: value for name, value in given.items() if name not in apart}
        check_given(self._given, pairs, model_check)
        with unchanged_if_refused(u):
            self.equations = equations_of(self._given, pairs)
            self._solver = solver_of(self.equations, self._given)
            self._continuation = Continuation(self.equations)
            self._estimator: Estimator | None = None
            self._inputs = Inputs(self.equations)
            self.equations.model_check = model_check
            if model_check is not None:
                model_check.prepare(self)

    @property
    def contacts(self) -> tuple[PairView, ...]:
        """Results on each pair, in the order of ``pairs``."""
        return tuple(PairView(c, self.equations.bulk.space) for c in self.equations.contacts)

    @property
    def obstacles(self) -> list[Obstacle]:
        """Rigid obstacles of the pairs, without duplicates."""
        return self.equations.motions.obstacles

    @property
    def time(self) -> float:
        """Time of the loads [time], for laws with memory or rates; set it before ``solve``.

        The step of a law is the time since the last accepted state. ``follow_path`` and
        ``Dynamics`` set it.
        """
        return max((c.state.load_time for c in self.equations.contacts), default=0.0)

    @time.setter
    def time(self, time: float) -> None:
        errors.check_number("time", time, "a finite number", np.isfinite)
        for contact in self.equations.contacts:
            contact.change(load_time=float(time))

    def solve(
        self, *, accept_violations: bool = False, predict: bool = True, may_cut: bool = False
    ) -> NewtonReport:
        """Solve for the present loads and prescribed values; update ``u`` and the multipliers.

        Collective.

        Args:
            predict: Whether to extrapolate the initial guess from the last two solves if the loads
                continue in their direction, see ``predictor``; it is the last state otherwise.
            accept_violations: Whether to return a state that violates its certificate instead of
                raising an error; see ``report.certificate``.
            may_cut: Whether you take a smaller step if this one fails: a line search, which follows
                full steps that fail with friction, is then not tried.

        Returns:
            The record of the Newton iterations.

        Raises:
            NotConvergedError: On all ranks, with the record, if Newton's method does not converge
                or converges to a state that violates its certificate. ``u`` and the multipliers
                keep the values of the last iterate; slip is still counted from the last accepted
                state. Before the next solve reset ``u``, or ``restore`` a value of ``state``.
            MortarError: On all ranks, if displacement, loads or prescribed values are not finite,
                if input differs between ranks, if the mesh was moved after set-up, or if bodies
                have inertia: ``Dynamics`` solves for their time steps.
            BaseException: Any other exception, such as KeyboardInterrupt or an error of a user's
                law.

        With any exception but ``NotConvergedError`` the state of the problem is restored.
        """
        self._renew_if_interrupted()
        cure = "set up a new problem, or see variant(); problem.equations.newton may be set"
        with errors.together(self.equations.comm, "ContactProblem"):
            errors.check_no_effect(
                "the problem", self, [*self._given, "pairs", "model_check"], cure
            )
        self.equations.bulk.input_data.check()
        remarks = self._inputs.check(
            self.equations.newton, accept_violations=accept_violations, predict=predict
        )
        self.equations.floating.restrict()
        with general.restored_if_interrupted(self.equations):
            model_check = self.equations.model_check
            given = {"accept_violations": accept_violations, "may_cut": may_cut}
            solve = partial(self._solver.solve, remarks, **given)
            predict &= model_check is None and not self.equations.newton.tentative
            with self._continuation.attempt(solve, guess=predict) as finish:
                report = finish()
            if model_check is not None:
                report.model_check = model_check.assess(self)
            return report

    def accept(self) -> None:
        """Accept the last evaluated state: slip is counted from it (collective)."""
        self._solver.accept()

    def state(self) -> general.State:
        """Present displacement, interface states and places, as a value (local)."""
        return self.equations.state()

    def restore(self, state: general.State) -> None:
        """Restore a state of this problem exactly (collective).

        Raises:
            MortarError: On all ranks, if ``state`` is not a state of this problem.
        """
        self._renew_if_interrupted()
        self.equations.restore(state)
        self.equations.bulk.assemble_residual()
        self.equations.motions.record()

    def forces(self) -> tuple[Array, Array, Array]:
        """Bulk residual, contact forces and forces on obstacles at the present state (collective).

        Returns:
            Bulk residual and contact forces at the dofs of this rank, each of shape (owned dofs,)
            [stress length]; their sum at prescribed dofs is the support reaction, see
            ``equations.residual``. Third, force and moment about the pivot that keep each obstacle
            in place, shape (obstacles, 3) [stress length, moments stress length^2], equal on all
            ranks.
        """
        e = self.equations
        e.evaluate_operators()  # users may have set the displacement
        bulk, contact, on_obstacles = e.residual.forces()
        return bulk, contact, on_obstacles * e.motions.scales[: len(on_obstacles)]

    def reaction(
        self, name: Names, about: npt.ArrayLike | None = None, *, data: MeshData | None = None
    ) -> Reaction:
        """Force and moment that Dirichlet conditions exert on the bodies, by boundary (collective).

        The result is a ``Reaction``, equal on all ranks, which describes what is summed.

        Args:
            name: Name or tag of a boundary of the ``MeshData``, or a list of them.
            about: Point of reference of the moment, (2,), in space (3,) [length]; default: the
                origin.
            data: The ``MeshData`` with this name; default: those of pairs and
                remote loads.

        Raises:
            MeshError: On all ranks, if no boundary has the name, or no dof there is prescribed.
            ValueError: On all ranks, if ``about`` is not a point.

        Example:
            The force on the upper block, of the top and of the contact, after a solve::

                force, moment, _ = problem.reaction("upper/top")
                print(force, problem.contacts[0].total_force)
        """
        e = self.equations
        loads = [load.motion for load in (*e.motions.remote, *e.motions.spread)]
        meshes = [c.pair.data for c in e.contacts]
        meshes += [load.data for load in loads if isinstance(load, BoundaryMotion)]
        meshes = meshes if data is None else [data]
        bulk, contact, _ = self.forces()
        return reaction_of(e.bulk, bulk + contact, meshes, name, about)

    def variant(self, *, residual: Any | None = None, **pair_options: Any) -> ContactProblem:
        """Another model of this problem, with its ``u``, conditions and obstacles (collective).

        The two problems share the displacement.

        Args:
            residual: UFL form that replaces the present one.
            pair_options: New attributes of the contact pairs, such as ``sliding="finite"``, or
                functions of the present ones.

        Raises:
            ValueError: If a contact pair has no such attribute.
            MortarError: If bodies have inertia.
        """
        bulk, pairs = self.equations.bulk, [contact.pair for contact in self.equations.contacts]
        checks.refuse_inertia(bulk, "variant()")
        changed = [
            pair.with_options(**pair_options) if isinstance(pair, ContactPair) else copy(pair)
            for pair in pairs
        ]
        form = {} if residual is None else {"residual": residual, "jacobian": None}
        kept = bulk.values.copy()
        try:
            bulk.values[:] = 0.0  # as a set-up requires
            return ContactProblem(**{**self._given, "pairs": changed, **form})
        finally:
            bulk.values[:] = kept

    def certificate(self) -> Certificate:
        """Measure balance with the present loads, signs, penetration and crossings (collective)."""
        self.forces()  # assembles the residual
        self.equations.residual.measure()
        return self._solver.certificate()

    def estimate(self) -> ErrorEstimate:
        """Estimate the discretization error of the present state, cell by cell (collective).

        Raises:
            MortarError: On all ranks, if the residual has integrals that are not supported, or
                bodies have inertia or history functions.
        """
        bulk = self.equations.bulk
        checks.refuse_inertia(bulk, "estimate()")
        refuse_remote(bulk.spread, "the error estimate is not implemented")
        checks.refuse_history(bulk, "estimate()")
        self._renew_if_interrupted()
        self._estimator = self._estimator or Estimator(bulk)
        self.equations.evaluate_operators()
        bulk.free_garbage()
        return self._estimator.evaluate(self.equations.contacts)

    # For research

    @property
    def matrices(self) -> OperatorMatrices:
        """D, M, gap, normals and derivatives at the present state, as PETSc objects; collective."""
        self.equations.evaluate_operators()
        return OperatorMatrices(self.equations.bulk, self.equations.contacts)

    @property
    def tangent(self) -> PETSc.Mat:
        """Matrix of the linear system at the present state (collective)."""
        self._renew_if_interrupted()
        e = self.equations
        e.bulk.free_garbage()
        e.evaluate_operators()
        e.bulk.assemble_tangent()
        e.bulk.assemble_residual()
        e.system.assemble()
        return e.system.matrix

    def linear_solve(self, rhs: LinearVector, *, transpose: bool = False) -> LinearVector:
        """Solve with the tangent at the present state, or with its transpose (collective).

        For sensitivities. Unknowns, rows and units are those of ``equations.linearized``; active
        sets, branches and multipliers are those of the present state, which is not changed. The
        relative residual is of the order of rounding with a direct solver, and at most ``ksp_rtol``
        (1e-8 by default) with an iterative one.

        Args:
            rhs: Right-hand side.
            transpose: Solve with the transpose, for adjoint sensitivities.

        Returns:
            The solution: increments of displacement, multipliers and obstacle motions.

        Raises:
            ValueError: On all ranks, if ``rhs`` has a wrong shape or is not finite.
            MortarError: On all ranks, if the tangent is singular, for instance because contact
                leaves a body free, or if z or q differ between ranks.
        """
        self._renew_if_interrupted()
        e = self.equations
        with general.restored_if_interrupted(e):
            e.evaluate_operators()
            e.bulk.free_garbage()
            return LinearizedEquations(e).solve(rhs, transpose=transpose)

    def check_tangent(self, **options: Any) -> TangentCheck:
        """Taylor slopes of all derivatives at the present state, 2 if exact (collective).

        Args:
            options: ``print_table=False`` keeps rank 0 from printing the table, ``steps`` are sizes
                over the shortest slave facet, shape (s,) [1], ``seed`` is that of the direction.

        Returns:
            Remainders and slopes of each block: bulk, n, g, D, M and the whole system.
        """
        self._renew_if_interrupted()
        with general.restored_if_interrupted(self.equations):
            return check_tangent(self.equations, **options)

    def _renew_if_interrupted(self) -> None:
        """Create solver and estimator again after an interruption."""
        if ranks.on_any_rank(self.equations.comm, self.equations.interrupted):
            self._solver.renew()
            self._estimator = None
            self.equations.interrupted = False


@contextmanager
def unchanged_if_refused(u: Any) -> Iterator[None]:
    """Context that restores mesh and displacement if a set-up raises any exception (local).

    Ties move nodes, and cheaper models may displace them.

    Args:
        u: The function of the unknowns.
    """
    positions, values = u.function_space.mesh.geometry.x, u.x.array
    before = positions.copy(), values.copy()
    try:
        yield
    except BaseException:
        positions[:], values[:] = before
        raise
