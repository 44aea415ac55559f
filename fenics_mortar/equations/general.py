# SPDX-License-Identifier: MIT
"""All equations of bodies in contact: evaluation, linearization, one Newton iteration, states.

Residual of the bodies, contact laws and balance of driven motions form one system,
``ContactEquations``. Its state, a ``State``, consists of displacement, multipliers, active sets and
places. A solve or a set-up that is interrupted or refused is undone: all is as it was before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.law_calls import raise_stored
from fenics_mortar.equations.arguments import EQUATIONS
from fenics_mortar.equations.diagnosis import Remedies, check_diagonal, diagnose
from fenics_mortar.equations.linearized_contact import LinearizedContact, Redundancy
from fenics_mortar.equations.residual import NO_MOTION, Increment, Residual
from fenics_mortar.la.options import drop_added_options
from fenics_mortar.newton.loop import NewtonOptions, Status, Step, forcing
from fenics_mortar.obstacles.rigid_motion import places_towards
from fenics_mortar.rigid.driven import DrivenMotions
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.rigid.idle import IdleBodies
from fenics_mortar.rigid.proximal import AnchoredSprings
from fenics_mortar.utils import errors
from fenics_mortar.utils.arrays import TINY, Array, Value, norms
from fenics_mortar.utils.clock import clock
from fenics_mortar.verify.crossing import Crossings, SpaceCrossings

if TYPE_CHECKING:
    from fenics_mortar.bulk.history import HistoryValues
    from fenics_mortar.bulk.inertia import Inertia, Rates
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.contact.fields import InterfaceState
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.contact.tied import Tie
    from fenics_mortar.interface.mortar import Linearization
    from fenics_mortar.la.system import LinearSystem
    from fenics_mortar.rigid.body_motions import BoundBody
    from fenics_mortar.verify.node_paths import AcceptedPositions


@dataclass(frozen=True)
class State(Value):
    """All quantities from which a solve starts, as an immutable value; all methods are local.

    ``replaced`` and ``dataclasses.replace`` return changed copies.

    Attributes:
        u: Displacement and other unknowns of the bulk, shape (local dofs,) [length].
        interfaces: State of each pair.
        places: Places (x, y, angle) of the m obstacles and remote loads, shape (m, 3) [length,
            length, radian].
        accepted_positions: Positions of outlines and obstacles in the last accepted state.
        converged: Whether the last solve ended in this state.
        history: Values of the history functions of the bodies.
        rates: Velocity and accelerations, ``None`` in statics.
    """

    u: Array
    interfaces: tuple[InterfaceState, ...]
    places: Array
    accepted_positions: AcceptedPositions
    converged: bool
    history: HistoryValues
    rates: Rates | None = None

    def with_settings_of(self, other: State) -> State:
        """This state with the offsets, weights of gaps, time and undeformed operators of ``other``.

        Users set these for a problem, while this state may be an extrapolation of earlier states or
        the state of another model.
        """
        return self._taking(other, "offset", "c_n", "reference", "load_time")

    def counting_slip_from(self, other: State) -> State:
        """This state with the partners, instants, history and accepted positions of ``other``."""
        names = "partners", "accepted_partners", "start_instant", "accepted_instant"
        found = self._taking(other, *names)
        return found.replaced(accepted_positions=other.accepted_positions, history=other.history)

    def _taking(self, other: State, *names: str) -> State:
        """This state with some attributes of the interfaces of ``other``."""
        pairs = zip(self.interfaces, other.interfaces, strict=True)
        taken = (a.replaced(**{name: getattr(b, name) for name in names}) for a, b in pairs)
        return self.replaced(interfaces=tuple(taken))

    def towards(self, other: State, fraction: float) -> State:
        """Interpolate to ``other`` by a ``fraction`` [1], with the active sets of this state."""
        pairs = zip(self.interfaces, other.interfaces, strict=True)
        return self.replaced(
            u=self.u + fraction * (other.u - self.u),
            interfaces=tuple(a.towards(b, fraction) for a, b in pairs),
            places=places_towards(self.places, other.places, fraction),
        )


class ContactEquations:
    """Coupled equations of bodies, contacts and driven motions; all methods are collective.

    The class implements the protocols of ``newton.loop``. Linear system, initial guess and model
    are chosen by ``problem`` and ``solver``.

    Args:
        bulk: Bulk residual and tangent.
        contacts: The pairs bound to the mesh.
        linearization: Derivatives in the tangent.
        newton: Tolerances and limits of Newton's method.
        remote: The remote loads, bound to the mesh.

    Attributes:
        contacts: The bound pairs.
        motions: Rigid motions of the obstacles of the contacts and of remote loads.
        floating: Bodies that Dirichlet conditions leave free to move rigidly.
        idle: Floating bodies on which no force acts.
        residual: Residual of the last evaluated state, and its forces.
        remedies: Remedies if active sets cycle or bodies do not come to rest.
        springs: Anchored springs on bodies and obstacles if Newton's method fails.
        crossings: Detection of crossed surfaces.
        interrupted: Whether matrices may be incomplete after an interruption.
        last_converged: Whether the last solve ended in the present state.
        evaluated: Initial guess and result of ``evaluate(start=True)``, for the next solve only.
        stiffest: Largest diagonal entry of the bulk tangent at the start [stress].
        system: The linear system; has to be set before the first ``advance``.
        model_check: A ``ModelCheck`` that follows each solve, or ``None``.
        reduced_tangent: Returns solves by factors of a linear bulk, or ``None`` (collective).

    Raises:
        MortarError: On all ranks, if the bulk tangent is not finite or zero at a node.
    """

    system: LinearSystem

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Contact | Tie], linearization: Linearization,
        newton: NewtonOptions, remote: Sequence[Any],
    ) -> None:  # fmt: skip
        self.bulk, self.contacts, self.comm = bulk, contacts, bulk.comm
        self.linearization, self.newton = linearization, newton
        self.motions = motions = DrivenMotions(bulk, contacts, remote)
        self._redundancy = Redundancy(contacts)
        self.bulk.assemble_tangent()
        boundaries = [(load, load.local_nodes) for load in motions.boundaries]
        sections = {load.tie: load for load in motions.sections}
        self.floating = FloatingBodies(bulk, contacts, boundaries, sections)
        self.springs = AnchoredSprings(self)
        self.idle = IdleBodies(self.floating)
        self._set_stiffness()
        self.floating.find()
        find_crossed = Crossings if bulk.space.dim == 2 else SpaceCrossings
        self.crossings = find_crossed(bulk, contacts, self.floating)
        self.last_converged = self.interrupted = False
        self.evaluated: tuple[State, Status] | None = None
        self.residual = Residual(self)
        self.remedies = Remedies(self, self._adopt_linearized_sets)
        self._shortest_facet = min(
            (float(c.slave.facet_sizes.min()) for c in contacts), default=0.0
        )
        self._loose: list[BoundBody] = []
        self.model_check: Any = None
        self.reduced_tangent: Callable[[], Any] = lambda: None

    def add_inertia(self, inertia: Inertia) -> None:
        """Add mass; bodies with mass are not floating."""
        self.bulk.inertia = inertia
        self.floating.find()
        self.last_converged, self.interrupted = False, True  # the pattern of the matrices changes

    def _set_stiffness(self) -> None:
        """Set the stiffness of each contact, limited by that of its master."""
        diagonal = self.bulk.K.getDiagonal().array_r
        check_diagonal(diagonal, self.bulk, self.floating)
        largest = float(np.abs(diagonal[self.bulk.space.owned_dofs]).max(initial=0.0))
        self.stiffest: float = self.comm.allreduce(largest, MPI.MAX)
        self.bulk.set_units(self.stiffest)
        for contact in self.contacts:
            contact.set_stiffness(_nodal_stiffness(contact, diagonal))
            contact.components.set_units(self.bulk.units, self.bulk.to_force, diagonal)

    # Evaluation

    def evaluate(self, *, start: bool, by_contact: bool = False) -> Status:
        """Evaluate residual, operators and active sets at the present state.

        Args:
            start: Whether a solve starts here.
            by_contact: Whether the bulk residual follows from the forces of contact and is known.
        """
        guessed, self.evaluated = self.evaluated if start else None, None
        if guessed is not None and not by_contact:
            return guessed[1]
        if guessed is not None:  # evaluated with the bulk
            self.put(guessed[0])
            self.start_step()
        if self.floating.bodies and not start:
            self.idle.place(self._evaluate_flat)
        if not by_contact:
            self.bulk.assemble_residual()
        if self.floating.bodies:
            self.floating.add_spring_forces()
        if start:
            if self.bulk.is_mixed:
                self.bulk.fields.begin()
            self.remedies.begin()
            self._redundancy.begin()
            self.residual.begin()
            for contact in self.contacts:
                contact.begin()
            self.idle.begin()
        changed = self.evaluate_contacts(start=start)
        if not start:
            self._refuse_folds()
        if start and self.floating.bodies and self.bulk.space.dim == 3:
            self.floating.start_with_stick()
            self._redundancy.mark()
        if self.floating.bodies and not start and self.idle.review():
            changed += 1 + self.evaluate_contacts(start=False)
        residual = self.residual.measure()
        self.remedies.record(residual, changed)
        num_active, sets = 0, b""
        for c in self.contacts:
            num_active += int(np.count_nonzero(c.active))
            sets += c.active.tobytes() + c.multiplier_nodes.tobytes()
            sets += (c.active * c.branch).tobytes()
        r = self.residual
        return Status(residual, r.force, r.gap, num_active, changed, r.attainable, sets)

    def _evaluate_flat(self) -> None:
        """As ``evaluate_operators``; refuse folded facets."""
        self.evaluate_operators()
        self._refuse_folds()

    def _refuse_folds(self) -> None:
        """Refuse facets folded over their own plane, as in some iterations; their gap is nan.

        Raises:
            NotFiniteError: On all ranks: open nodes with such a gap are not in the residual.
        """
        for contact in self.floating.contacts if self.bulk.space.dim == 3 else ():
            o = contact.operators
            if np.isnan(o.gap).any():
                where = errors.format_point(o.x[int(np.isnan(o.gap).argmax())])
                names, advice = f"'{contact.slave.name}'", ""
                if contact.obstacle is None:
                    names += f", or of '{contact.master.name}' opposite,"
                    if contact.evaluation.sharp_edges.nodes.size:
                        advice = f": {contact.other_roles}take smaller steps"
                raise errors.NotFiniteError(f"facets of {names} are folded at {where}{advice}")

    def evaluate_operators(self) -> None:
        """Evaluate the operators of all contacts."""
        for contact in self.contacts:
            contact.evaluate(self.bulk.values, self.linearization)

    def evaluate_contacts(self, *, start: bool) -> int:
        """Evaluate operators and active sets; return the number of changed nodes."""
        changed = 0
        for contact in self.contacts:
            contact.evaluate(self.bulk.values, self.linearization)
            handed = contact.update_multiplier_nodes()
            if handed:
                contact.evaluate(self.bulk.values, self.linearization)
            changed += handed + contact.update_active(start=start and not self.last_converged)
        self._redundancy.mark()
        raise_stored(self.comm, self.contacts)
        return changed

    def evaluate_forces(self) -> tuple[Array, Array]:
        """Evaluate; return forces of bulk less pushes, and contact, (owned dofs,) [force] each."""
        self.evaluate_contacts(start=True)
        bulk, contact, _ = self.residual.forces()
        return bulk - self.motions.pushed_nodes(), contact

    def seconds(self) -> dict[str, float]:
        """Seconds since the last call by phase; maximum over ranks."""
        return clock.slowest(self.comm)

    def diagnose(self) -> str:
        """Describe inverted cells, loose bodies, peeling edges and deep overlaps; "" if none."""
        return diagnose(self, self.remedies.recent)

    # Newton iteration

    def advance(self) -> Step:
        """Carry out one Newton iteration: linearize, solve, apply; too long a step is shortened."""
        if self.floating.bodies:
            self.remedies.replace_unsettled_sets()
        self.linearize()
        return self.apply(self.solve_linear())

    def linearize(self) -> None:
        """Assemble the tangent of all equations at the last evaluated state."""
        self.bulk.assemble_tangent()
        if self.floating.bodies:
            self._loose = self.floating.loose()
            self.floating.add_springs(self._loose, self.residual.driving(), self.residual.force)
        for load in self.motions.boundaries:
            load.take_bulk_rows()
        self.system.assemble()
        raise_stored(self.comm, self.contacts)

    @clock("solve")
    def solve_linear(self) -> Increment:
        """Solve the linearized equations; the state is not changed."""
        residual, residuals = self.residual, self.remedies.residuals
        goal = self.newton.residual_tolerance * residual.force
        solver, changes = self.system.solver, self.remedies.num_changed > 0
        force = residual.force if solver.multigrid is not None else 0.0
        solver.forcing = forcing(residuals, goal, force, sets_change=changes)
        for contact in self.contacts:
            for flux in contact.conductances:
                # Loads of its rows exceed the residual by many orders; or flows that exceed forces
                # by many change with the active set, which follows from displacements.
                if flux.exceeds or flux.law.jumps:
                    solver.forcing = 0.0
        is_bordered = self.motions.exist and bool(self.motions.unknowns.any())
        solver.same_step = not (len(residuals) == 1 or is_bordered)
        x, motion = self.system.step(residual.distance), NO_MOTION
        if is_bordered:
            x, motion = self.motions.solve(x, self.system, self.stiffest, residual.force)
        step, z = self.system.split(x)
        remark, solver.remark = solver.remark, ""
        if self._loose:
            drive = residual.driving(), residual.force
            self.floating.drop_undriven(self._loose, step, motion, *drive)
            remark = "; ".join(filter(None, (remark, self.floating.remark(self._loose))))
        return Increment(step, z, motion, remark)

    def apply(self, increment: Increment) -> Step:
        """Apply an increment to the state; a step that is too long is shortened."""
        step = increment.u
        fraction = self.bulk.move(step)
        for contact, z in zip(self.contacts, increment.z, strict=True):
            for flux in contact.conductances:
                flux.move(z, fraction, step, self.motions.of_obstacle(contact, increment.motion))
            contact.move(z, fraction, step)
        size = 0.0
        if increment.motion.size:
            self.motions.move(fraction * increment.motion)
            size = float(np.abs(increment.motion).max())
        return self.step(step, size, fraction, increment.remark)

    def _adopt_linearized_sets(self, snap: bool) -> bool:
        """Adopt the sets of the linearized problem; return whether they were found."""
        linearized = LinearizedContact(self)
        if not linearized.applies:
            return False
        self.remedies.num_linearized += 1
        self.bulk.assemble_tangent()
        return linearized.choose_sets(self._redundancy.mark, snap=snap)

    def step(
        self, change: Array, motion: float = 0.0, fraction: float = 1.0, note: str = ""
    ) -> Step:
        """Record of a step.

        Args:
            change: Change of the unknowns of the bulk, owned ones first, shape (owned dofs,).
            motion: Largest motion of obstacles and remote loads [length].
            fraction: Fraction of the increment that was applied [1].
            note: Remark.
        """
        moved = self.motions.largest() if self.motions.movers else 0.0
        displacement = max(self.bulk.largest(self.bulk.values), moved)
        size = max(displacement, EQUATIONS.at_rest * self._shortest_facet, TINY)
        relative = max(self.bulk.largest(change), motion) / size
        if self.bulk.is_mixed:
            sources = dict[int, float]()
            for flux in (flux for c in self.floating.contacts for flux in c.fluxes):
                sources[flux.law.field] = max(sources.get(flux.law.field, 0.0), flux.rounding)
            relative = max(relative, self.bulk.fields.change(change, sources))
        return Step(relative, fraction, note)

    # States

    def state(self) -> State:
        """The present state, as a value."""
        return State(
            self.bulk.values,
            tuple(contact.state for contact in self.contacts),
            self.motions.places,
            self.crossings.accepted,
            self.last_converged,
            self.bulk.history.values,
            None if self.bulk.inertia is None else self.bulk.inertia.rates,
        )

    def restore(self, state: State) -> None:
        """Restore a state exactly, and evaluate the operators.

        Raises:
            TypeError: On all ranks, if ``state`` is not a state.
            MortarError: On all ranks, if it is one of another problem.
        """
        with errors.together(self.comm, "restore"):
            errors.check_kind("state", state, State, "what state() of the same problem returned")
            same = (
                state.u.shape == self.bulk.values.shape
                and state.history.accepted.shape == (self.bulk.history.size,)
                and [z.shape for z in state.interfaces] == [c.state.shape for c in self.contacts]
                and len(state.places) == len(self.motions.movers)
            )
            if not same:
                raise errors.MortarError(
                    "the state belongs to another problem: expected a result of state() of this one"
                )
            if state.rates is not None and self.bulk.inertia is None:
                raise errors.MortarError(
                    "the state is one of a motion, and this problem is one of statics: set up the "
                    "same Dynamics of it before restore"
                )
            if state.rates is None and self.bulk.inertia is not None:
                raise errors.MortarError(
                    "the state is one at rest, and this problem has a Dynamics: restore it before "
                    "Dynamics(...) of a new problem, which starts at rest from it"
                )
        self.put(state)
        self.residual.begin()
        self.evaluate_operators()

    def put(self, state: State) -> None:
        """Restore a state without evaluating operators (local)."""
        self.bulk.values[:] = state.u
        self.bulk.history.put(state.history)
        self.evaluated = None
        self.motions.places = state.places
        self.crossings.restore(state.accepted_positions, state.u)
        inertia = self.bulk.inertia
        if inertia is not None and state.rates is not None:
            if inertia.moving:
                inertia.rates = state.rates
            else:
                inertia.set_rates(state.rates, state.u)
        for contact, interface in zip(self.contacts, state.interfaces, strict=True):
            contact.put(interface)
        self.last_converged = state.converged

    def start_step(self) -> None:
        """Count slip, memory and history from the accepted state (local)."""
        for contact in self.contacts:
            contact.start_step()
        self.bulk.history.start_step()

    def interface_motion(self, before: State) -> float:
        """Largest motion of a surface since a state, over its shortest facet [1]."""
        change = (self.bulk.values - before.u)[: self.bulk.num_owned]
        sides = [side for c in self.contacts for side in (c.slave, c.master) if side.num_nodes]
        motions = [norms(side.gather(change)).max() / side.facet_sizes.min() for side in sides]
        return float(max(motions, default=0.0))


# Largest stiffness of a slave node over the smallest of the master's nodes [1]. Pressed blocks of a
# ratio of 1e10, quadratic with friction, do not converge with 1e4; those of 1e5 take 11 instead of
# 42 iterations. With ten, multigrid at a ratio of a thousand takes 13 applications instead of 11.
STIFFER_SLAVE = 1e3


def _nodal_stiffness(contact: Interface, diagonal: Array) -> Array:
    """Mean diagonal of K at each slave node, (slave nodes,) [stress] (collective).

    At most ``STIFFER_SLAVE`` times that of the master: pressures and gaps are compared by what a
    gap costs, and the softer side bears it. Times the stiffness of a stiff slave, gaps left by
    linearization would exceed all pressures.
    """
    stiffness = np.abs(contact.slave.gather(diagonal)).mean(axis=1)
    if contact.master is contact.slave or not contact.master.num_nodes:
        return stiffness
    of_master = np.abs(contact.master.gather(diagonal)).mean(axis=1)
    return np.minimum(stiffness, STIFFER_SLAVE * of_master.min())


class Snapshot:
    """State of a problem to which an interrupted solve returns (local).

    Args:
        equations: The equations of the problem.
    """

    def __init__(self, equations: ContactEquations) -> None:
        self._equations, self.state, self._depth = equations, equations.state(), clock.depth
        self._operators = [contact.operators for contact in equations.contacts]
        self._springs = equations.springs.present
        model_check = equations.model_check
        self._revert_model_check = None if model_check is None else model_check.snapshot()

    def revert(self, *, renew: bool) -> None:
        """Restore the snapshot; ``renew``: create matrices and solvers again in the next solve."""
        equations = self._equations
        clock.leave(self._depth)
        drop_added_options()
        equations.put(self.state)
        for contact, operators in zip(equations.contacts, self._operators, strict=True):
            contact.set_operators(operators)
        equations.springs.present = self._springs
        if self._revert_model_check is not None:
            self._revert_model_check()
        equations.interrupted |= renew


# A snapshot, and notes for an error after which it is restored.
Kept = tuple[Snapshot, *tuple[str, ...]]


@contextmanager
def restored_if_interrupted(equations: ContactEquations) -> Iterator[list[Kept]]:
    """Context that restores a problem if any exception but ``NotConvergedError`` is raised.

    An interruption is a KeyboardInterrupt or any other exception that does not come from the
    equations, such as an error of a user's function. It may occur anywhere and on one rank only;
    therefore a state is restored without communication. Incomplete matrices, factors and solvers
    are created again at the start of the next solve.

    Yields:
        One snapshot, that of the start; another one may take its place in the list.
    """
    kept: list[Kept] = [(Snapshot(equations),)]
    try:
        yield kept
    except errors.NotConvergedError:
        raise
    except BaseException as error:
        before, *notes = kept[0]
        before.revert(renew=True)
        errors.raise_cause(error, *notes)
