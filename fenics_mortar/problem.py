# SPDX-License-Identifier: MIT
"""The contact problem that a user sets up: UFL residual, Dirichlet conditions, contact pairs."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, get_args

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from fenics_mortar import compat
from fenics_mortar.bulk import Bulk, prescribed_dofs
from fenics_mortar.certificate import Certificate, certify
from fenics_mortar.checks import check_cells, check_slave_nodes, check_space
from fenics_mortar.clock import clock
from fenics_mortar.contact import Contact, mark_overheld
from fenics_mortar.damping import Damped
from fenics_mortar.driven import DrivenObstacles
from fenics_mortar.errors import MortarError, NotConvergedError
from fenics_mortar.estimate import ErrorEstimate, Estimator
from fenics_mortar.floating import FloatingBodies
from fenics_mortar.laws import STICK, Pieces
from fenics_mortar.mortar import LINEARIZATIONS
from fenics_mortar.newton import NewtonOptions, NewtonReport, Status, Step, forcing, solve
from fenics_mortar.operators import OperatorMatrices
from fenics_mortar.pair import ContactPair
from fenics_mortar.reduced import LinearBulk
from fenics_mortar.release import release_slowly
from fenics_mortar.slip import Partners
from fenics_mortar.space import DisplacementSpace
from fenics_mortar.surfaces import Array
from fenics_mortar.system import (
    DIRECT,
    ITERATIVE,
    MANY,
    SYSTEMS,
    Algorithm,
    Solver,
    obstacle_to_condensation,
)
from fenics_mortar.tangent import TangentCheck, check_tangent
from fenics_mortar.tied import TiedPair, bind

# Largest c_n after a cycle of the active set.
LESS_WEIGHT = 1e-3
EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True)
class State:
    """Displacement, multipliers, active sets and places of obstacles, as copies.

    The displacement is the part of this rank. Of each contact there are the partners that its slip
    counts from, and those at the last accepted state.
    """

    u: Array
    z: list[Array]
    active: list[npt.NDArray[np.bool_]]
    carries: list[npt.NDArray[np.bool_]]
    piece: list[Pieces]
    partners: list[tuple[Partners, Partners]]
    places: Array
    converged: bool

    def towards(self, other: State, part: float) -> State:
        """Part of the way to another state, with the sets of this one."""
        return replace(
            self,
            u=self.u + part * (other.u - self.u),
            z=[mine + part * (z - mine) for mine, z in zip(self.z, other.z, strict=True)],
            places=self.places + part * (other.places - self.places),
        )


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
        solver: "direct" (MUMPS), "iterative": GMRES with multigrid, of the condensed system see
            ``multigrid``, of the saddle point by blocks, whose bodies Dirichlet conditions have to
            hold; or "auto". That iterates from 100,000 unknowns on (``system.MANY``), where no
            options of PETSc are given and the bulk is not linear, and directly solves all else:
            saddle point systems, mixed functions, small problems. If an iterative solution fails
            the direct solver takes over, and the report says so.
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
        if not isinstance(pairs, Sequence) or not all(
            isinstance(p, (ContactPair, TiedPair)) for p in pairs
        ):
            raise ValueError(f"pairs={pairs!r}: right is a list of ContactPair and TiedPair")
        if not isinstance(bcs, Sequence):
            raise ValueError(
                f"bcs is a {type(bcs).__name__}: right is a list of Dirichlet conditions"
            )
        if len(residual.arguments()) != 1:
            raise ValueError(
                "the residual has to hold one test function and no trial function; of an energy, "
                "it is ufl.derivative(energy, u, v)"
            )
        compat.free_petsc_garbage_of_earlier(u.function_space.mesh.comm)
        space = DisplacementSpace(u.function_space, displacement)
        check_space(space.V, pairs)
        if linearization not in LINEARIZATIONS:
            allowed = ", ".join(LINEARIZATIONS)
            raise ValueError(f"linearization={linearization!r}: allowed are {allowed}")
        if algorithm not in (None, *get_args(Algorithm)):
            allowed = ", ".join(get_args(Algorithm))
            raise ValueError(f"algorithm={algorithm!r}: allowed are {allowed}")
        if solver not in get_args(Solver):
            raise ValueError(f"solver={solver!r}: allowed are {', '.join(get_args(Solver))}")
        if solver == "iterative" and space.is_mixed:
            raise ValueError("solver='iterative': mixed functions need solver='direct'")
        self.newton = newton or NewtonOptions()
        self._adequacy = adequacy
        self._given = {
            "residual": residual, "u": u, "bcs": bcs, "petsc_options_prefix": petsc_options_prefix,
            "petsc_options": petsc_options, "algorithm": algorithm, "solver": solver,
            "linearization": linearization, "newton": newton, "jacobian": jacobian,
            "displacement": displacement, "linear_bulk": linear_bulk,
        }  # fmt: skip
        self.linearization = LINEARIZATIONS[linearization]
        self.contacts = bind(pairs, space, prescribed_dofs(space, u, bcs))  # may move nodes
        self.bulk = Bulk(residual, u, list(bcs), jacobian, space)
        self.comm: MPI.Comm = self.bulk.comm
        self.tools = DrivenObstacles(self.contacts)
        check_slave_nodes(self.contacts)
        check_cells(self.bulk)
        self.bulk.check_input()
        self.bulk.assemble_tangent()
        self.floating = FloatingBodies(self.bulk, self.contacts)
        self._set_stiffness()
        self.floating.find()
        if algorithm is None:
            algorithm = "saddle" if obstacle_to_condensation(self.contacts) else "condensed"
        automatic = solver == "auto"
        if automatic and not self._is_for_multigrid(algorithm, linear_bulk, petsc_options):
            solver = "direct"
        self.system = SYSTEMS[algorithm](
            self.bulk,
            self.contacts,
            petsc_options_prefix,
            (DIRECT if solver == "direct" else ITERATIVE[algorithm]) | (petsc_options or {}),
        )
        self.system.may_factor = automatic and solver == "auto"
        if solver == "iterative" and linear_bulk is None:
            linear_bulk = False  # who iterates may lack the memory for factors
        self._linear_bulk = LinearBulk(self, linear_bulk, petsc_options_prefix)
        self._estimator: Estimator | None = None
        self._last_converged = False
        self._residuals: list[float] = []
        self._recent_sets: list[list[tuple[npt.NDArray[np.bool_], Pieces]]] = []
        for contact in self.contacts:
            contact.evaluate(u.x.array, self.linearization)
            contact.set_initial_gap()
            contact.evaluate(u.x.array, self.linearization)
        self.accept()
        self._starts = [c.describe_start() for c in self.contacts]
        if adequacy is not None:
            adequacy.prepare(self)

    def _is_for_multigrid(
        self, algorithm: str, linear_bulk: bool | None, petsc_options: dict[str, Any] | None
    ) -> bool:
        """Whether solver "auto" iterates; see there."""
        given = PETSc.Options(self._given["petsc_options_prefix"]).getAll() or petsc_options
        factored_once = self.bulk.is_linear and linear_bulk is not False
        bodies_only = algorithm == "condensed" and not self.bulk.space.is_mixed
        return bodies_only and not given and not factored_once and self.bulk.r.getSize() >= MANY

    # Solving

    def solve(self) -> NewtonReport:
        """Solve for the present loads and prescribed values; move ``u`` and the multipliers.

        Returns:
            The record of the Newton iterations.

        Raises:
            NotConvergedError: On all ranks; holds the record. ``u`` and the multipliers are left
                at the last iterate; to solve again, reset ``u`` and mend what was wrong.
            MortarError: On all ranks, if displacement, loads or prescribed values are not finite,
                or if the mesh was moved after set-up.
        """
        self.bulk.check_input()
        report = None if self._adequacy is None else self._adequacy.climb()
        report = report or self._solve_by_this_model()
        if self._adequacy is not None:
            report.adequacy = self._adequacy.assess(self)
        return report

    def _solve_by_this_model(self) -> NewtonReport:
        """Solve, whatever the model's adequacy."""
        clock.read()
        for contact in self.contacts:
            contact.start_step()
        try:
            self.tools.follow(self._evaluate_operators)
            moved = self.tools.settle(partial(self._evaluate_contacts, start=True))
            moved += self.floating.settle(self._evaluate_forces)
            self.hold(None)
            if moved:  # bodies that nothing held were moved to each other: that is no slip
                self.accept()
            report = self._solve()
            moved += self.floating.check()
        except MortarError:
            self._last_converged = False
            self.hold(None)
            raise
        self._last_converged = True
        for contact in self.contacts:
            contact.accept()
        compat.free_petsc_garbage(self.comm)
        report.certificate = replace(self.certificate(), strayed=self.tools.strayed())
        violations = [f"VIOLATED: {violation}" for violation in report.certificate.violations()]
        remarks = violations or report.certificate.remarks()
        reactions = self.tools.record()
        report.notes[:0] = [*filter(None, self._starts), *moved, *remarks, *reactions]
        self._starts = []
        return report

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
                    setattr(pair, name, new(getattr(pair, name)) if callable(new) else new)
        given = {**self._given, "pairs": pairs}
        if residual is not None:
            given.update(residual=residual, jacobian=None)
        u = self.bulk.u.x.array
        kept = u.copy()
        u[:] = 0.0
        try:
            return ContactProblem(**given)
        finally:
            u[:] = kept

    def adopt(self, other: ContactProblem) -> None:
        """Go to the present state of a variant."""
        for contact, theirs in zip(self.contacts, other.contacts, strict=True):
            if isinstance(contact, Contact) and isinstance(theirs, Contact):
                contact.adopt(theirs)
        self.restore(other.state())

    def accept(self) -> None:
        """Count slip from the last evaluated state (collective)."""
        for contact in self.contacts:
            contact.accept()
            contact.start_step()

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
            self.restore(start)
            return release_slowly(self, self.newton, error)

    def hold(self, travel: float | None) -> None:
        """Tie floating bodies and driven obstacles by springs, or let them go; see ``release``."""
        if travel is None:
            self.floating.let_go()
            self.tools.let_go()
        else:
            bulk, contact, _ = self.forces()
            self.floating.hold(bulk + contact, travel)
            self.tools.hold(travel, self.stiffest)

    def travel(self) -> float:
        """How far what ``hold`` ties has moved since, in shortest facets."""
        return max(self.floating.travel(), self.tools.travel())

    def remaining(self) -> tuple[float, str]:
        """Part of the forces that springs hold, and that in words."""
        parts = self._parts_held()
        energy = self.floating.spring_energy() + self.tools.spring_energy()
        each = [f"{name} with {part:.1e} of its contact force" for name, part in parts]
        return max(part for _, part in parts), (
            f"springs hold {', '.join(each)}, with an energy of {energy:.3e}: contact does not "
            "resist its motion more than the facets' corners drive it; prescribe it, or refine"
        )

    def _parts_held(self) -> list[tuple[str, float]]:
        """What springs of ``hold`` hold, and which part of the contact force on it."""
        return self.floating.parts_held() + self.tools.parts_held()

    def evaluate(self, *, start: bool) -> Status:
        """Evaluate residual, operators and active sets at the present state."""
        self.bulk.assemble_residual()
        self.floating.add_spring_forces()
        return self.look(start=start)

    def look(self, *, start: bool) -> Status:
        """Evaluate operators and active sets; the residual of the bulk is there."""
        if start:
            self._begin()
        changed = self._evaluate_contacts(start=start)
        residual, force = self._residual_and_force()
        self._force = force
        self._residuals.append(residual)
        gaps = [np.abs(c.gap / c.nodal_lengths)[c.active].max(initial=0.0) for c in self.contacts]
        active = sum(int(c.active.sum()) for c in self.contacts)
        self._recent_sets.append([(c.active.copy(), c.piece.copy()) for c in self.contacts])
        sets = b"".join(
            np.packbits([c.active, c.carries]).tobytes() + (c.active * c.piece).tobytes()
            for c in self.contacts
        )
        gap = float(max(gaps, default=0.0))
        return Status(residual, force, gap, active, changed, self.noise(), sets)

    def _evaluate_operators(self) -> None:
        """Evaluate the operators of all contacts."""
        for contact in self.contacts:
            contact.evaluate(self.bulk.u.x.array, self.linearization)

    def _evaluate_contacts(self, *, start: bool) -> int:
        """Evaluate operators and active sets; return how many nodes changed."""
        changed = 0
        for contact in self.contacts:
            contact.evaluate(self.bulk.u.x.array, self.linearization)
            handed = contact.update_carriers()
            if handed:
                contact.evaluate(self.bulk.u.x.array, self.linearization)
            changed += handed + contact.update_active(start=start and not self._last_converged)
        return changed

    def _evaluate_forces(self) -> tuple[Array, Array]:
        """Evaluate everything; return the sum of all forces and of their sizes, owned parts."""
        self._evaluate_contacts(start=True)
        bulk, contact, _ = self.forces()
        return bulk + contact, np.abs(bulk) + np.abs(contact)

    @clock("assembly")
    def _contact_force(self, part: str = "z") -> Array:
        """B^T z on the owned dofs, or that of the contacts' "shear" only."""
        force = np.zeros(self.bulk.num_owned)
        for contact in self.contacts:
            on_slave, on_master = contact.operators.force(getattr(contact, part))
            contact.slave.scatter_add(on_slave, force)
            contact.master.scatter_add(on_master, force)
        return force

    def advance(self) -> Step:
        """Solve one linear system and move, less than all the way where that would be too far."""
        self.bulk.assemble_tangent()
        loose = self.floating.loose()
        self.floating.add_springs(loose, self._total, self._force)
        mark_overheld(self.contacts)
        with clock("assembly"):
            self.system.assemble()
        goal = self.newton.residual_tolerance * self._force
        self.system.forcing = forcing(self._residuals, goal)
        with clock("solve"):
            step, multipliers, motion = self.tools.solve(self.system, self.stiffest, self._force)
        self.floating.drop_undriven(loose, step, self._total, self._force)
        remarks = [self.system.remark, self.floating.remark(loose)]
        self.system.remark = ""
        part = self.bulk.move(step)
        for contact, z in zip(self.contacts, multipliers, strict=True):
            contact.z = contact.z + part * (z - contact.z) if part < 1.0 else z
        self.tools.move(part * motion)
        increment = max(self.bulk.largest(step.array_r), np.abs(motion).max(initial=0.0))
        step.destroy()
        compat.free_petsc_garbage(self.comm)
        return self.step(increment, part, "; ".join(filter(None, remarks)))

    def step(self, increment: float, part: float = 1.0, note: str = "") -> Step:
        """Record of a step taken, by its largest increment [length]."""
        size = max(self._largest_displacement(), 1e-8 * self._facet_length(), 1e-300)
        return Step(increment / size, part, note)

    def merge_sets(self, period: int) -> str:
        """Leave a cycle of the active set or of sticking and sliding nodes; say how.

        All nodes that were active in it are so for one iteration, and gaps weigh less from then on,
        in later solves too: a large c_n releases nodes for small gaps that a step leaves behind.
        Nodes that did not always slide in one direction stick for that iteration.
        """
        wavering = 0
        for i, contact in enumerate(self.contacts):
            recent = [sets[i] for sets in self._recent_sets[-period:]]
            active, pieces = (np.array(sets) for sets in zip(*recent, strict=True))
            contact.active = active.any(axis=0) & contact.covered
            contact.c_n = min(contact.c_n, LESS_WEIGHT)
            wavers = contact.active & (pieces != pieces[-1]).any(axis=0)
            contact.piece = np.where(wavers, STICK, contact.piece)
            wavering += int(wavers.sum())
        stuck = f"; {wavering} nodes between sticking and sliding stick in it" * bool(wavering)
        return (
            f"the active set does not settle (last {period} iterations); all nodes active in them "
            f"stay so for one iteration, and c_n is at most {LESS_WEIGHT:g} from now on{stuck}"
        )

    def _begin(self) -> None:
        """Forget the cycles of the last solve."""
        self._recent_sets, self._residuals = [], []
        for contact in self.contacts:
            contact.begin()

    def seconds(self) -> dict[str, float]:
        """Seconds since the last call by phase, see ``clock``; of the slowest rank in each."""
        mine = clock.read()
        slowest = np.array(list(mine.values()))
        self.comm.Allreduce(MPI.IN_PLACE, slowest, MPI.MAX)
        return dict(zip(mine, slowest.tolist(), strict=True))

    def diagnose(self) -> str:
        """Name inverted cells and bodies that nothing holds."""
        inverted = self._describe_inverted()
        if inverted:
            return inverted
        free = self.floating.describe(self.floating.loose()), self.tools.describe(self._force)
        return ", ".join(filter(None, free))

    def _describe_inverted(self) -> str:
        count, where = self.bulk.inverted_cells()
        return f"{count} cells are inverted, one at {where}: try smaller load steps" * bool(count)

    def _residual_and_force(self) -> tuple[float, float]:
        """Norm of all equations and of the forces they are made of [stress length].

        Gaps and distances to prescribed values count as forces by the stiffness of the bulk.
        """
        size, held = self.bulk.num_owned, self.bulk.held
        contact_force, rows = self._contact_force(), float((self.tools.residual() ** 2).sum())
        rows += sum(float((contact.residual() ** 2).sum()) for contact in self.contacts)
        self._total = total = self.bulk.r.array_r[:size] + contact_force
        free = self.bulk.to_force * total
        reactions = free[held]
        free[held] = self.stiffest * self.bulk.distance_to_prescribed() / self.bulk.units[held]
        mine = [free @ free, contact_force @ contact_force, reactions @ reactions]
        free2, contact2, reaction2 = self.comm.allreduce(np.array(mine))
        return float(np.sqrt(free2 + rows)), float(np.sqrt(max(contact2, reaction2)))

    def noise(self) -> float:
        """Residual that rounding leaves, however long one iterates [stress length]."""
        num_dofs = self.bulk.r.getSize()
        bulk = np.sqrt(num_dofs) * self._largest_displacement()
        contact = sum(np.sqrt(c.slave.num_nodes) * np.abs(c.slave.X).max() for c in self.contacts)
        return 4.0 * EPSILON * self.stiffest * float(bulk + contact)

    def _largest_displacement(self) -> float:
        return max(self.bulk.largest(self.bulk.u.x.array), self.tools.largest())

    def _facet_length(self) -> float:
        return min((float(c.slave.lengths.min()) for c in self.contacts), default=0.0)

    # Set-up and checks

    def _set_stiffness(self) -> None:
        """Give each contact the mean diagonal of K at its slave nodes."""
        diagonal = self.bulk.K.getDiagonal().array_r
        if self.comm.allreduce(not np.isfinite(diagonal).all(), MPI.LOR):
            reason = self._describe_inverted() or "check the residual form"
            raise MortarError(
                f"the bulk tangent is not finite at the initial displacement: {reason}"
            )
        dofs = self.bulk.space.owned_dofs
        loose = np.zeros(diagonal.size, bool)
        loose[dofs] = (diagonal[dofs] == 0.0) & ~self.bulk.prescribed[dofs]
        count, where = self.bulk.count_nodes(loose)
        if count:
            mine = set(self.floating.labels[: len(dofs)][loose[dofs].any(axis=1)].tolist())
            bodies = sorted(set().union(*self.comm.allgather(mine)))
            names = ", ".join(self.floating.name_of(label) for label in bodies)
            raise MortarError(
                f"the bulk tangent has no stiffness at {count} nodes, one at {where}, of {names}: "
                "the residual form has to hold the stress of every body"
            )
        largest = float(np.abs(diagonal[dofs]).max(initial=0.0))
        self.stiffest: float = self.comm.allreduce(largest, MPI.MAX)
        self.bulk.set_units(self.stiffest)
        for contact in self.contacts:
            contact.stiffness = np.abs(contact.slave.gather(diagonal)).mean(axis=1)

    def state(self) -> State:
        """Copy the present state."""
        return State(
            self.bulk.u.x.array.copy(),
            [contact.z.copy() for contact in self.contacts],
            [contact.active.copy() for contact in self.contacts],
            [contact.carries.copy() for contact in self.contacts],
            [contact.piece.copy() for contact in self.contacts],
            [(contact.partners, contact.accepted) for contact in self.contacts],
            self.tools.places,
            self._last_converged,
        )

    def restore(self, state: State) -> None:
        """Go back to a state, exactly."""
        self.bulk.u.x.array[:] = state.u
        self.tools.places = state.places
        for i, contact in enumerate(self.contacts):
            contact.z, contact.active = state.z[i].copy(), state.active[i].copy()
            contact.carries, contact.piece = state.carries[i].copy(), state.piece[i].copy()
            contact.partners, contact.accepted = state.partners[i]
            contact.evaluate(state.u, self.linearization)
        self._last_converged = state.converged

    def interface_motion(self, before: State) -> float:
        """Largest motion of a surface since a state, in its shortest facets (collective)."""
        change = (self.bulk.u.x.array - before.u)[: self.bulk.num_owned]
        sides = [side for c in self.contacts for side in (c.slave, c.master) if side.num_nodes]
        motions = [np.hypot(*side.gather(change).T).max() / side.lengths.min() for side in sides]
        return float(max(motions, default=0.0))

    def certificate(self) -> Certificate:
        """Measure balance, signs and penetration of the last evaluated state."""
        certificate = certify(self.bulk, self.contacts, self.floating.labels, self.tools.residual())
        return replace(certificate, springs=max((p for _, p in self._parts_held()), default=0.0))

    def estimate(self) -> ErrorEstimate:
        """Estimate the error of the present state by cells; see ``estimate``.

        Raises:
            MortarError: On all ranks, if the residual has integrals that cannot be read.
        """
        if self._estimator is None:
            self._estimator = Estimator(self.bulk)
        self._evaluate_operators()
        return self._estimator.evaluate(self.contacts)

    def forces(self) -> tuple[Array, Array, Array]:
        """Residual of the bulk, contact forces and those on obstacles, (obstacles, 3).

        At the present state, the first two as parts of this rank [stress length]. What these sum to
        at prescribed dofs are the reactions of the supports; the third is what holds the obstacles.
        """
        self.bulk.assemble_residual()
        bulk = self.bulk.r.array_r[: self.bulk.num_owned].copy()
        self.floating.add_spring_forces()
        return bulk, self._contact_force(), self.tools.forces()

    def shear_forces(self) -> tuple[Array, Array]:
        """What of the last two of ``forces`` is shear."""
        return self._contact_force("shear"), self.tools.forces("shear")

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
        self.bulk.assemble_tangent()
        self.bulk.assemble_residual()
        self.system.assemble()
        return self.system.matrix

    def check_tangent(self, **options: Any) -> TangentCheck:
        """Taylor slopes of all derivatives at the present state; see ``tangent.check_tangent``."""
        return check_tangent(self, **options)
