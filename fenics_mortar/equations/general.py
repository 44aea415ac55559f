# SPDX-License-Identifier: MIT
"""All equations of bodies in contact, as Newton's method sees them.

Residual of the bodies, laws of the contacts and balance of driven obstacles are one system, whose
state is the displacement, the multipliers, the active sets and the places of obstacles. Here it is
evaluated, moved by one linear solve, kept and taken up again: what ``newton``, ``damping`` and
``release`` ask of their equations. Who chooses the linear system, the start and the model is
``problem``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.inertia import Inertia
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.law_calls import raise_noted
from fenics_mortar.contact.redundancy import Redundancy
from fenics_mortar.contact.tied import Tie
from fenics_mortar.equations.diagnosis import check_diagonal, diagnose
from fenics_mortar.equations.linearized_contact import LinearizedContact
from fenics_mortar.equations.measures import check_alike, rounding_of
from fenics_mortar.equations.set_history import SetHistory
from fenics_mortar.equations.springs import HoldingSprings
from fenics_mortar.equations.state import State, check_state
from fenics_mortar.interface.mortar import Linearization
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.newton.loop import Status, Step, forcing
from fenics_mortar.newton.options import NewtonOptions
from fenics_mortar.rigid.driven import DrivenObstacles
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.errors import together
from fenics_mortar.verify.crossing import Crossings


class Increment(NamedTuple):
    """Solution of the linearized equations.

    Attributes:
        u: Increment of the displacement and other unknowns of the bulk [length].
        z: The new multipliers of each pair, shape (slave nodes, 2) [stress].
        motion: Increments of the motions of obstacles, shape (obstacles, 3) [length].
        remark: Remarks on the solution, in words.
    """

    u: PETSc.Vec
    z: list[Array]
    motion: Array
    remark: str


class ContactEquations:
    """Bodies, contacts and driven obstacles together; all methods are collective.

    More than 20 methods: the protocols of Newton's method, damping, springs and load paths.

    Args:
        bulk: Bulk residual and tangent.
        contacts: The pairs bound to the mesh.
        linearization: Which derivatives the tangent has.
        newton: When to stop.

    Attributes:
        contacts: The pairs, as they are computed with.
        tools: The obstacles of the contacts.
        floating: Bodies that Dirichlet conditions do not hold.
        springs: Springs that hold bodies and obstacles where Newton fails.
        crossings: What looks for surfaces that crossed.
        interrupted: Whether an interruption may have left matrices half made.
        last_converged: Whether the last solve ended in the present state.
        stiffest: Largest diagonal entry of the bulk tangent at the start [stress].
        system: The linear system; has to be set before the first ``advance``.

    Raises:
        MortarError: On all ranks, if the bulk tangent is not finite, or zero at a node.
    """

    system: LinearSystem

    def __init__(
        self,
        bulk: Bulk,
        contacts: Sequence[Contact | Tie],
        linearization: Linearization,
        newton: NewtonOptions,
    ) -> None:
        self.bulk, self.contacts, self.comm = bulk, contacts, bulk.comm
        self.linearization, self.newton = linearization, newton
        self.motions = DrivenObstacles(contacts)
        self._redundancy = Redundancy(contacts)
        self.bulk.assemble_tangent()
        self.floating = FloatingBodies(bulk, contacts)
        self._set_stiffness()
        self.floating.find()
        self.crossings = Crossings(bulk, contacts, self.floating)
        self.last_converged = self.interrupted = False
        self.springs = HoldingSprings(self.floating, self.motions, self.stiffest, self.forces)
        self._history = SetHistory(contacts)

    def add_inertia(self, inertia: Inertia) -> None:
        """Add mass: inertia holds all bodies, and none floats."""
        self.bulk.inertia = inertia
        self.floating.find()
        self.last_converged, self.interrupted = False, True  # matrices have another pattern

    def _set_stiffness(self) -> None:
        """Give each contact the mean diagonal of K at its slave nodes."""
        diagonal = self.bulk.K.getDiagonal().array_r
        check_diagonal(diagonal, self.bulk, self.floating)
        largest = float(np.abs(diagonal[self.bulk.space.owned_dofs]).max(initial=0.0))
        self.stiffest: float = self.comm.allreduce(largest, MPI.MAX)
        self.bulk.set_units(self.stiffest)
        for contact in self.contacts:
            contact.set_stiffness(np.abs(contact.slave.gather(diagonal)).mean(axis=1))

    # Where they stand

    def evaluate(self, *, start: bool) -> Status:
        """Evaluate residual, operators and active sets at the present state."""
        self.bulk.assemble_residual()
        self.floating.add_spring_forces()
        return self.look(start=start)

    def look(self, *, start: bool) -> Status:
        """Evaluate operators and active sets; the residual of the bulk is there."""
        if start:
            self._history.begin()
            self._redundancy.begin()
            for contact in self.contacts:
                contact.begin()
        changed = self.evaluate_contacts(start=start)
        residual, force = self._residual_and_force()
        self._force = force
        self._history.record(residual, changed)
        gaps = [np.abs(c.gap / c.nodal_lengths)[c.active].max(initial=0.0) for c in self.contacts]
        active = sum(int(c.active.sum()) for c in self.contacts)
        sets = b"".join(
            np.packbits([c.active, c.multiplier_nodes]).tobytes() + (c.active * c.branch).tobytes()
            for c in self.contacts
        )
        gap = float(max(gaps, default=0.0))
        return Status(residual, force, gap, active, changed, self.noise(), sets)

    def evaluate_operators(self) -> None:
        """Evaluate the operators of all contacts."""
        for contact in self.contacts:
            contact.evaluate(self.bulk.u.x.array, self.linearization)

    def evaluate_contacts(self, *, start: bool) -> int:
        """Evaluate operators and active sets; return how many nodes changed."""
        changed = 0
        for contact in self.contacts:
            contact.evaluate(self.bulk.u.x.array, self.linearization)
            handed = contact.update_multiplier_nodes()
            if handed:
                contact.evaluate(self.bulk.u.x.array, self.linearization)
            changed += handed + contact.update_active(start=start and not self.last_converged)
        self._redundancy.mark()
        raise_noted(self.comm, self.contacts)
        return changed

    def evaluate_forces(self) -> tuple[Array, Array]:
        """Evaluate everything; return the forces of the bulk and of contact, owned parts."""
        self.evaluate_contacts(start=True)
        bulk, contact, _ = self.forces()
        return bulk, contact

    def _residual_and_force(self) -> tuple[float, float]:
        """Norm of all equations and of the forces they are made of [stress length].

        Gaps and distances to prescribed values count as forces by the stiffness of the bulk.
        """
        size, held = self.bulk.num_owned, self.bulk.held
        contact_force, rows = self._contact_force(), float((self.motions.residual() ** 2).sum())
        rows += sum(float((contact.residual() ** 2).sum()) for contact in self.contacts)
        raise_noted(self.comm, self.contacts)
        self._total = total = self.bulk.r.array_r[:size] + contact_force
        free = self.bulk.to_force * total
        reactions = free[held]
        free[held] = self.stiffest * self.bulk.distance_to_prescribed() / self.bulk.units[held]
        inertia = self.bulk.inertia_forces()
        mine = [free @ free, contact_force @ contact_force, reactions @ reactions]
        sums = self.comm.allreduce(np.array([*mine, inertia @ inertia, rows, rows**2]))
        free2, force2 = sums[0], sums[1:4].max()
        check_alike(float(sums[4]), float(sums[5]), force2, self.comm.size)
        return float(np.sqrt(free2 + rows)), float(np.sqrt(force2))

    def noise(self) -> float:
        """Residual that rounding leaves, however long one iterates [stress length]."""
        inertia = self.bulk.inertia
        stiffest = self.stiffest + (0.0 if inertia is None else inertia.stiffness)
        return rounding_of(self.bulk, self.contacts, self._largest_displacement(), stiffest)

    def _largest_displacement(self) -> float:
        return max(self.bulk.largest(self.bulk.u.x.array), self.motions.largest())

    def seconds(self) -> dict[str, float]:
        """Seconds since the last call by phase, see ``clock``; of the slowest rank in each."""
        mine = clock.read()
        slowest = np.array(list(mine.values()))
        self.comm.Allreduce(MPI.IN_PLACE, slowest, MPI.MAX)
        return dict(zip(mine, slowest.tolist(), strict=True))

    def diagnose(self) -> str:
        """Name inverted cells, loose bodies, edges that a shear peels off, and deep overlaps."""
        recent = self._history.recent
        return diagnose(self.bulk, self.contacts, self.floating, self.motions, self._force, recent)

    # Where they lead

    def advance(self) -> Step:
        """Solve one linear system and move, less than all the way where that would be too far."""
        self._settle_sets()
        self.linearize()
        increment = self.solve_linear()
        return self.apply(increment)

    def linearize(self) -> None:
        """Assemble the tangent of all equations at the last evaluated state."""
        self.bulk.assemble_tangent()
        self._loose = self.floating.loose()
        self.floating.add_springs(self._loose, self._total, self._force)
        with clock("assembly"):
            self.system.assemble()
        raise_noted(self.comm, self.contacts)

    def solve_linear(self) -> Increment:
        """Solve the linearized equations; no state changes."""
        goal = self.newton.residual_tolerance * self._force
        self.system.solver.forcing = forcing(self._history.residuals, goal)
        with clock("solve"):
            step, z, motion = self.motions.solve(self.system, self.stiffest, self._force)
        self.floating.drop_undriven(self._loose, step, self._total, self._force)
        remarks = [self.system.solver.remark, self.floating.remark(self._loose)]
        self.system.solver.remark = ""
        return Increment(step, z, motion, "; ".join(filter(None, remarks)))

    def apply(self, increment: Increment) -> Step:
        """Move by an increment, less than all the way where that would be too far."""
        step = increment.u
        part = self.bulk.move(step)
        for contact, z in zip(self.contacts, increment.z, strict=True):
            contact.move(z, part, step.array_r)
        self.motions.move(part * increment.motion)
        size = max(self.bulk.largest(step.array_r), np.abs(increment.motion).max(initial=0.0))
        step.destroy()
        self.bulk.free_garbage()
        return self.step(size, part, increment.remark)

    def _settle_sets(self) -> None:
        """Where bodies float and sets do not settle, take those of the linearized problem."""
        if not self.floating.bodies or self.floating.held or not self._history.is_unsettled:
            return
        linearized = LinearizedContact(self.bulk, self.floating, self.system, self.motions)
        if linearized.can_say:
            self._history.count_call()
            self.bulk.assemble_tangent()
            linearized.choose_sets(self._redundancy.mark)

    def step(self, increment: float, part: float = 1.0, note: str = "") -> Step:
        """Record of a step taken, by its largest increment [length]."""
        facet = min((float(c.slave.lengths.min()) for c in self.contacts), default=0.0)
        size = max(self._largest_displacement(), 1e-8 * facet, 1e-300)
        return Step(increment / size, part, note)

    def drifts(self) -> str:
        """Say which bodies only slight forces along free motions move on (collective).

        Contact forces act along averaged normals of facets, so that smooth bodies without friction
        are driven by a small part of them, and may have no equilibrium near by; "" if there are no
        such bodies, or other forces are left as well.
        """
        if self.floating.held or self._history.residuals[-1] > RIGID.slight * self._force:
            return ""
        names = self.floating.names(self.floating.loose() or self.floating.bodies)
        return f"only a slight force is left, which moves {names} on" if names else ""

    def merge_sets(self, period: int) -> str:
        """Leave a cycle of sets; see ``SetHistory.merge``."""
        return self._history.merge(period)

    # Forces

    def forces(self) -> tuple[Array, Array, Array]:
        """Residual of the bulk, contact forces and those on obstacles, (obstacles, 3).

        At the present state, the first two as parts of this rank [stress length]. What these sum to
        at prescribed dofs are the reactions of the supports; the third is what holds the obstacles.
        """
        self.bulk.assemble_residual()
        bulk = self.bulk.r.array_r[: self.bulk.num_owned].copy()
        self.floating.add_spring_forces()
        return bulk, self._contact_force(), self.motions.forces()

    def shear_forces(self) -> tuple[Array, Array]:
        """What of the last two of ``forces`` is shear."""
        return self._contact_force("shear"), self.motions.forces("shear")

    @clock("assembly")
    def _contact_force(self, part: str = "z") -> Array:
        """B^T z on the owned dofs, or that of the contacts' "shear" only."""
        force = np.zeros(self.bulk.num_owned)
        for contact in self.contacts:
            on_slave, on_master = contact.operators.force(getattr(contact, part))
            contact.slave.scatter_add(on_slave, force)
            contact.master.scatter_add(on_master, force)
        return force

    # States

    def state(self) -> State:
        """Copy the present state."""
        return State(
            self.bulk.u.x.array,
            tuple(contact.state for contact in self.contacts),
            self.motions.places,
            self.crossings.accepted,
            self.last_converged,
            None if self.bulk.inertia is None else self.bulk.inertia.rates,
        )

    def restore(self, state: State) -> None:
        """Go back to a state, exactly.

        Raises:
            MortarError: On all ranks, if it is none, or one of another problem.
        """
        with together(self.comm, "restore"):
            check_state(state, self.bulk.u.x.array.shape, [c.z.shape for c in self.contacts])
        self.put(state)
        self.evaluate_operators()

    def put(self, state: State) -> None:
        """Go back to a state, whose operators are not evaluated (local)."""
        self.bulk.u.x.array[:] = state.u
        self.motions.places = state.places
        self.crossings.restore(state.standing, state.u)
        if self.bulk.inertia is not None and state.rates is not None:
            self.bulk.inertia.take(state.rates, state.u)
        for contact, interface in zip(self.contacts, state.interfaces, strict=True):
            contact.put(interface)
        self.last_converged = state.converged

    def interface_motion(self, before: State) -> float:
        """Largest motion of a surface since a state, in its shortest facets (collective)."""
        change = (self.bulk.u.x.array - before.u)[: self.bulk.num_owned]
        sides = [side for c in self.contacts for side in (c.slave, c.master) if side.num_nodes]
        motions = [np.hypot(*side.gather(change).T).max() / side.lengths.min() for side in sides]
        return float(max(motions, default=0.0))
