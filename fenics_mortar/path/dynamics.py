# SPDX-License-Identifier: MIT
"""Motion of bodies with mass: time steps with contact.

All schemes are the generalized-alpha method with contact at the end of the step. With
"generalized_alpha" all nodes have mass: an impact stops the mass of the nodes in contact within one
step, so that pressures oscillate, and energy increases with the trapezoidal rule (rho_inf = 1).
With "massless" slave nodes have no mass, see ``bulk.inertia``: pressures are continuous in time,
impacts are resolved by waves in the bodies, and errors of the energy are of second order. With
"conserving" these errors, of contact and of nonlinear stresses, are corrected, too, and those of
the angular momentum; see below and ``path.report``. Measurements are in
``demos/studies/dynamics``.

Corrections of the velocity after a time step, which conserve angular momentum and energy.

**Angular momentum lost by bodies in a time step, and its return by rigid rotations.** Closed mortar
gaps are zero on average, not at each point, and normals of nodes are not those of facets: pressures
of slave and master have a moment of third order in the length of the facets. The trapezoidal rule
conserves the angular momentum in the middle of equal steps, not that of present positions and
velocities. After each step the velocity of a rigid rotation about the centre of mass is added to
each body, so that

    L_(n+1) - L_n = dt / 2 (T_n + T_(n+1))

with the moments T of loads, internal forces and obstacles, without those exerted by other bodies.
Bodies in contact rotate together. Bodies with prescribed dofs are not corrected, since their
supports exert moments. Linear momentum is already balanced, and is not changed by rotations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dolfinx import fem

from fenics_mortar.bulk.bodies import join_bodies, label_bodies
from fenics_mortar.bulk.inertia import Inertia, Velocity
from fenics_mortar.contact.contact import start_clock
from fenics_mortar.contact.tied import Tie
from fenics_mortar.equations.general import State, restored_if_interrupted
from fenics_mortar.obstacles.rigid_motion import moments_of, turned
from fenics_mortar.path.report import (
    MAX_SCALING,
    Energies,
    EnergyErrors,
    Impulse,
    forces_of,
    internal_defect,
    pressure_impulse,
    return_energy,
    work_of,
)
from fenics_mortar.path.time_steps import (
    SCHEMES,
    DensityValues,
    GeneralizedAlpha,
    Motion,
    check_dynamics,
    check_rates,
    check_run,
    check_step,
    first_acceleration,
    rates_of,
)
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import ROUNDING, TINY, Array, Flags, Indices
from fenics_mortar.utils.errors import (
    MortarError,
    check_kind,
    check_number,
    check_same_texts,
    together,
)

if TYPE_CHECKING:
    from fenics_mortar.mesh.space import DisplacementSpace
    from fenics_mortar.newton.loop import NewtonReport
    from fenics_mortar.path.report import DynamicsReport, Forces, Work
    from fenics_mortar.path.stepping import SteppingOptions


class DeformationRate:
    """Velocities without momentum and angular momentum of any body; all methods are collective.

    Args:
        space: The displacement's nodes and dofs.
        inertia: Mass of the bodies.
        prescribed: Marks of the local dofs with prescribed values.
    """

    def __init__(self, space: DisplacementSpace, inertia: Inertia, prescribed: Flags) -> None:
        self._space, self._inertia, self._prescribed = space, inertia, prescribed
        self._label, self._count = label_bodies(space.V)

    def of(self, velocity: Array, x: Array) -> Array:
        """The part of a velocity that is orthogonal, in mass, to rigid motions; 0 if prescribed.

        Args:
            velocity: Array of all local dofs [length / time].
            x: Positions of the local nodes, shape (n, dim) [length].

        Returns:
            An array of all local dofs [length / time].
        """
        space, inertia, size = self._space, self._inertia, self._space.num_owned
        comm, owned = space.V.mesh.comm, space.num_nodes
        centre = comm.allreduce(np.array([*x[:owned].sum(axis=0), owned]))
        r = x - centre[:-1] / centre[-1]
        shifts = np.broadcast_to(np.eye(space.dim)[:, None], (space.dim, *x.shape))
        rigid = shifts[1:] if space.is_axisymmetric else np.concatenate([shifts, turned(r)])
        fields = np.zeros((len(rigid), velocity.size))
        fields[:, space.dofs] = rigid
        momenta = np.array([inertia.times_mass(field) for field in fields])
        rows = [m * v[:size] for m in momenta for v in (*fields, velocity)]
        sums = self._by_body(rows).reshape(len(rigid), len(rigid) + 1, self._count)
        rates = [
            np.linalg.lstsq(body[:, :-1], body[:, -1], rcond=ROUNDING)[0]
            for body in np.moveaxis(sums, 2, 0)
        ]
        weights = np.array(rates).reshape(self._count, len(rigid))[self._label]
        rest = velocity - sum(space.spread(w) * f for w, f in zip(weights.T, fields, strict=True))
        return np.where(self._prescribed, 0.0, rest)

    def _by_body(self, rows: list[Array]) -> Array:
        """Sums of values (owned dofs,) over the nodes of each body, equal on all ranks."""
        label = self._label[: self._space.num_nodes]
        dofs = self._space.owned_dofs
        nodal = [row[dofs].sum(axis=1) for row in rows]
        mine = np.array([np.bincount(label, values, self._count) for values in nodal])
        return np.asarray(self._space.V.mesh.comm.allreduce(mine))


@dataclass(frozen=True, eq=False)
class Balance:
    """Angular momentum of each body and the moments on it, about the origin; equal on all ranks.

    Attributes:
        momentum: Angular momentum, shape (axes, bodies) [stress length^2 time]; one axis in the
            plane, three in space.
        moment: Moment of all forces except those between bodies, likewise [stress length^2].
        touching: Whether a pair exerts forces on a body, shape (pairs, bodies), bool.
        on_obstacle: Whether an obstacle exerts forces on a body, shape (bodies,), bool.
    """

    momentum: Array
    moment: Array
    touching: Flags
    on_obstacle: Flags


@dataclass(frozen=True, eq=False)
class Rotations:
    """Rigid rotations of groups of bodies about their centres of mass.

    Attributes:
        group: Group of each body, shape (bodies,).
        velocity: Velocity at a rotation by one per time about each axis, arrays of all local dofs,
            (axes, local dofs) [length].
        inertia: Tensors of inertia, shape (groups, axes, axes) [stress length^2 time^2].
        free: Whether no dof of a group is prescribed, shape (groups,), bool.
        between_bodies: Whether a group also has no forces from obstacles, (groups,), bool.
    """

    group: Indices
    velocity: Array
    inertia: Array
    free: Flags
    between_bodies: Flags


class SpinReturn:
    """Angular momentum of the bodies and its correction; all methods are collective.

    Args:
        problem: The problem; not axisymmetric.
        inertia: Mass and rates of the bodies.
    """

    def __init__(self, problem: ContactProblem, inertia: Inertia) -> None:
        self._equations, self._inertia = problem.equations, inertia
        self._space = problem.equations.bulk.space
        self._label, self._count = label_bodies(self._space.V)
        marks = problem.equations.bulk.prescribed[self._space.owned_dofs].any(axis=1)
        self._supported = self._sum(marks.astype(float)[None])[0] > 0.0

    def balance(self) -> Balance:
        """Momenta and moments at the last evaluated state."""
        inertia, owned = self._inertia, self._space.owned_dofs
        rates, x = inertia.rates, self._positions()[: len(owned)]
        rows = [
            moments_of(x, inertia.times_mass(values)[owned])
            for values in (rates.velocity, rates.acceleration)
        ]
        contacts, axes = self._equations.contacts, len(rows[0])
        for contact in contacts:
            force = np.zeros(self._space.num_owned)
            contact.scatter_add(contact.now.forces, force)
            f = force[owned]
            rows += [moments_of(x, f), np.abs(f).sum(axis=1)[None]]
        sums = self._sum(np.concatenate(rows))
        meshed = np.array([contact.obstacle is None for contact in contacts], bool)
        momentum, moment, of_pairs = np.split(sums, [axes, 2 * axes])
        of_pairs = of_pairs.reshape(len(contacts), axes + 1, self._count)
        sizes = of_pairs[:, axes] > 0.0
        moment = moment + of_pairs[meshed, :axes].sum(axis=0)
        return Balance(momentum, moment, sizes[meshed], sizes[~meshed].any(axis=0))

    def restore(self, before: Balance, after: Balance, dt: float) -> Rotations:
        """Balance the angular momentum at the end of a step.

        The energy added is subtracted from the energy to be returned, see ``report``.

        Args:
            before: Balance at the start of the step.
            after: Balance at its end.
            dt: The step [time].

        Returns:
            The rotations of bodies that touched in the step.
        """
        inertia, rotations = self._inertia, self._rotations(before, after)
        missing = before.momentum + 0.5 * dt * (before.moment + after.moment) - after.momentum
        change = self._rotate(rotations, missing, rotations.free)
        rates = inertia.rates
        added = inertia.product(change, rates.velocity + 0.5 * change)
        inertia.rates = replace(
            rates, velocity=rates.velocity + change, energy_deficit=rates.energy_deficit - added
        )
        return rotations

    def without_spin(self, rotations: Rotations, change: Array, moved: Flags) -> Array:
        """Subtract the rotation from a change of velocity by internal forces or between bodies.

        Args:
            rotations: See ``restore``.
            change: Array of all local dofs [length / time].
            moved: Groups whose angular momentum stays unchanged, shape (groups,), bool.

        Returns:
            The change without angular momentum, likewise.
        """
        x, owned = self._positions(), self._space.owned_dofs
        of_mass = self._inertia.times_mass(change)[owned]
        momentum = self._sum(moments_of(x[: len(owned)], of_mass))
        return change - self._rotate(rotations, momentum, moved)

    def _rotations(self, before: Balance, after: Balance) -> Rotations:
        links = [np.flatnonzero(b | a) for b, a in zip(before.touching, after.touching)]
        pairs = [np.stack([bodies[:-1], bodies[1:]], axis=1) for bodies in links]
        group, count = join_bodies(np.arange(self._count), self._count, pairs)
        space, x = self._space, self._positions()
        one = space.spread(np.ones(len(x)))
        mass = self._inertia.times_mass(one)[space.owned_dofs]
        own = x[: len(mass)]
        sums = self._sum(np.concatenate([mass[:, :1].T, (mass * own).T]))
        mass_of, *first = (np.bincount(group, row, count) for row in sums)
        r = x - (np.array(first) / mass_of).T[group[self._label]]
        turns = turned(r)
        velocity = np.zeros((len(turns), one.size))
        velocity[:, space.dofs] = turns
        of_mass = [self._inertia.times_mass(field)[space.owned_dofs] for field in velocity]
        second = self._sum(np.concatenate([moments_of(r[: len(mass)], p) for p in of_mass]))
        free, obstacles = (
            np.bincount(group, marks, count) == 0.0
            for marks in (self._supported, before.on_obstacle | after.on_obstacle)
        )
        inertia = np.array([np.bincount(group, row, count) for row in second])
        inertia = inertia.T.reshape(count, len(turns), len(turns)).astype(float)
        return Rotations(group, velocity, inertia, free, free & obstacles)

    def _rotate(self, rotations: Rotations, momentum: Array, moved: Flags) -> Array:
        """Rotations of the groups ``moved`` by angular momenta of the bodies, (local dofs,)."""
        group, inertia = rotations.group, rotations.inertia
        of_groups = np.array([np.bincount(group, row, len(inertia)) for row in momentum])
        rates = np.linalg.solve(inertia, of_groups.T[:, :, None])[:, :, 0]
        rates = np.where(moved[:, None], rates, 0.0)[group[self._label]].T
        parts = zip(rates, rotations.velocity, strict=True)
        return np.asarray(sum(self._space.spread(rate) * field for rate, field in parts))

    def _positions(self) -> Array:
        """Present positions of the local nodes, ghosts included, shape (n, dim) [length]."""
        return self._equations.bulk.positions()

    def _sum(self, rows: Array) -> Array:
        """Sums of values of the owned nodes of all ranks, (k, nodes), by body: (k, bodies)."""
        label = self._label[: self._space.num_nodes]
        mine = np.array([np.bincount(label, row, self._count) for row in rows])
        return np.asarray(self._space.V.mesh.comm.allreduce(mine))


class Corrections:
    """Return of angular momentum and energy, see ``report``; all methods are collective.

    Args:
        problem: The problem.
        inertia: Mass and rates of the bodies.
        conserves: Whether the scheme is the trapezoidal rule. Otherwise it dissipates vibrations,
            and only the energy lost by contact is returned.
    """

    def __init__(self, problem: ContactProblem, inertia: Inertia, *, conserves: bool) -> None:
        self._bulk, self._inertia, self._conserves = problem.equations.bulk, inertia, conserves
        space = self._bulk.space
        self._spin = None if space.is_axisymmetric else SpinReturn(problem, inertia)
        self._deformation = DeformationRate(space, inertia, self._bulk.prescribed)

    def balance(self) -> Balance | None:
        """Angular momentum at the present state; ``None`` with axisymmetry."""
        return None if self._spin is None else self._spin.balance()

    def correct(
        self,
        work: Work,
        dt: float,
        start: Array,
        forces: tuple[Forces, Forces],
        before: Balance | None,
    ) -> None:
        """Return the angular momentum and energy lost in a step.

        Args:
            work: Work done in the step.
            dt: The step [time].
            start: Displacement at its start, shape (local dofs,) [length].
            forces: Forces at its start and end.
            before: Angular momentum at its start.
        """
        bulk, inertia = self._bulk, self._inertia
        energy = work.pressure
        if self._conserves and inertia.rate is None and inertia.rates.time <= dt:
            energy -= work.imbalance  # in the first step; damping is not returned
        internal, pressures = None, pressure_impulse(inertia, bulk, forces, dt)
        if self._conserves and not bulk.is_linear:
            d = internal_defect(bulk, inertia, start, dt)
            moved = (bulk.values - start)[: bulk.num_owned]
            energy += bulk.comm.allreduce(float(d @ moved))
            internal = inertia.acceleration_of(dt * d, bulk.prescribed)
        after = self.balance()
        if self._spin is not None and before is not None and after is not None:
            turns = self._spin.restore(before, after, dt)
            if internal is not None:
                internal = self._spin.without_spin(turns, internal, turns.free)
            if pressures is not None:
                pressures = self._spin.without_spin(turns, pressures, turns.between_bodies)
        rates = inertia.rates
        inertia.rates = replace(rates, energy_deficit=rates.energy_deficit + energy)
        impulses = []
        if internal is not None:
            impulses.append(Impulse(internal, 0.0, 2.0))
        if pressures is not None:
            impulses.append(Impulse(pressures, -1.0, 1.0))
        if self._conserves:
            for found in (None,) if pressures is None else (None, pressures):
                part = self._free_part(rates.velocity, found)
                impulses.append(Impulse(part, -MAX_SCALING, MAX_SCALING))
        return_energy(inertia, impulses, ROUNDING * work.largest)

    def _free_part(self, velocity: Array, pressures: Array | None) -> Array:
        """The part of a velocity that may change in an impact, (local dofs,) [length / time].

        Velocities of deformation, and rigid motions as those caused by the pressures.
        """
        inertia, x = self._inertia, self._bulk.positions()
        part = self._deformation.of(velocity, x)
        if pressures is not None:
            rigid = pressures - self._deformation.of(pressures, x)
            power, square = inertia.product(rigid, velocity), inertia.product(rigid, rigid)
            part += power / square * rigid if square > 0.0 else 0.0
        return part


class Dynamics:
    """Motion of the bodies of a contact problem; all methods are collective.

    The problem becomes that of the end of a time step: residual, multipliers, results and
    checkpoints (``save_state``, ``state``) include inertia. Bodies need no supports, since inertia
    balances their loads. If the problem was solved before, the motion starts at rest from its
    solution.

    Args:
        problem: The problem, with the residual f_int - f_ext of statics.
        density: Mass per volume [stress time^2 / length^2], a number or a UFL expression; in the
            plane per area of the mesh, times a thickness or 2 pi R if the residual contains them.
            Steps raise an error if its constants or functions have changed since.
        scheme: "conserving" (slave nodes without mass, no gain of energy in impacts, momentum and
            angular momentum exact), "massless" (without these corrections of the velocity) or
            "generalized_alpha" (all nodes have mass, and rates of prescribed motions are the
            method's, as in other codes, unless steps are adapted). Bodies with history: one of the
            last two.
        rho_inf: Spectral radius at infinite frequency, from 0 (most dissipation) to 1 (none) [1].
            Default: 0.8 for "generalized_alpha", else 1.
        velocity: The ``Velocity`` in the residual, for damping.
        energy: UFL form of the strain energy, such as ``psi * dx``, for the report.

    Attributes:
        problem: The problem.
        scheme: The time scheme.
        rho_inf: Its spectral radius at infinite frequency [1].
        velocity: Velocity, a function of the space of ``u`` [length / time]; set it before the
            first step, with "generalized_alpha" also that of prescribed motions.

    Raises:
        ValueError: If an argument is not allowed.
        MortarError: On all ranks, if masses are not positive, or slave nodes are massless and a
            body has fewer than two layers of nodes behind them.

    Example:
        The block "upper" hits another one with the velocity 1::

            motion = fm.Dynamics(problem, density=1.0, energy=psi * dx)
            cells = blocks.cell_tags.find(blocks.bodies["upper"])
            motion.velocity.interpolate(lambda x: np.stack([0 * x[0], 0 * x[1] - 1.0]), cells)
            record = motion.run(0.5, fm.SteppingOptions(step=0.01))
            print(record)
    """

    def __init__(
        self,
        problem: ContactProblem,
        density: Any,
        *,
        scheme: str = "conserving",
        rho_inf: float | None = None,
        velocity: Velocity | None = None,
        energy: Any | None = None,
    ) -> None:
        check_kind("problem", problem, ContactProblem, "a ContactProblem")
        check_dynamics(problem, density, scheme, rho_inf, velocity, energy)
        self.problem, equations = problem, problem.equations
        self._scheme = GeneralizedAlpha(SCHEMES[scheme] if rho_inf is None else float(rho_inf))
        slaves = [c.slave.nodes for c in equations.contacts if not isinstance(c, Tie)]
        massless = [] if scheme == "generalized_alpha" else slaves
        nodes = np.unique(np.concatenate([np.empty(0, np.int64), *massless]))
        self._density = DensityValues(density)
        self._inertia = Inertia(equations.bulk.space, density, nodes)
        self._inertia.rate = velocity
        self._inertia.scheme = f"scheme='{scheme}', rho_inf={self._scheme.rho:g}"
        self._energy = None if energy is None else compat.form(energy)
        equations.add_inertia(self._inertia)
        self.velocity = self._inertia.velocity
        self._largest_speed, self._errors = 0.0, EnergyErrors()
        self.scheme, self.rho_inf, conserves = scheme, self._scheme.rho, self._scheme.rho == 1.0
        self._corrections = (
            Corrections(problem, self._inertia, conserves=conserves)
            if scheme == "conserving"
            else None
        )

    @property
    def time(self) -> float:
        """Present time [time]."""
        return self._inertia.rates.time

    # One step

    def step(self, dt: float) -> NewtonReport:
        """Advance by ``dt`` [time], with the loads and prescribed values of the end of the step.

        The accelerations at the start of the first step are those of the loads when it is called,
        which then act suddenly. Loads that grow from zero: ``run``, whose ``set_loads`` follows.

        Returns:
            The record of the Newton iterations. If the step adds to errors of the energy that
            ``DynamicsReport.remark`` would name, since the first of successive calls, its first
            note says so, and names a step that suffices.

        Raises:
            NotConvergedError: On all ranks, as ``ContactProblem.solve``; state, velocity and time
                are then those before the step.
            MortarError: On all ranks, if an obstacle is driven by forces: it has no mass; with
                "conserving", if a rigid boundary or a section is.
            ValueError: If ``dt`` is not positive, or too short for the present time.
        """
        with together(self.problem.equations.comm, "step"):
            check_step(dt, self.time)
        with restored_if_interrupted(self.problem.equations):
            self._begin()
            before = self._errors
            if before.time != self.time:  # after other steps, whose errors it does not add
                kinetic = 0.5 * self._largest_speed**2
                before = EnergyErrors(kinetic=kinetic, deficit=self.energy_deficit)
            report, _, work = self._advance(dt, forces_of(self.problem))
        totals = 0.5 * self._largest_speed**2, self.energy_deficit
        self._errors = before.after(work, *totals, size=dt, time=self.time)
        if self._errors.worst(self.scheme) > before.worst(self.scheme):
            remark = self._errors.remark(self.scheme, self.rho_inf)
            report.notes[:0] = filter(None, [remark])
        return report

    def _advance(
        self, dt: float, forces: Forces, *, adapts: bool = False
    ) -> tuple[NewtonReport, Forces, Work]:
        """Advance by one step; see ``step``.

        Args:
            dt: The step [time].
            forces: Forces at its start.
            adapts: Whether its size follows from the estimated error, which rates that alternate
                would dominate at any size.

        Returns:
            The record of the iterations, forces at the end, and the work done.
        """
        problem, inertia = self.problem, self._inertia
        self._refuse_driven_motions()
        self._density.check(problem)
        check_step(dt, inertia.rates.time)
        start_clock(problem.equations.contacts, inertia.rates.time)
        before, rates = problem.state(), inertia.rates
        corrections = self._corrections
        balance = None if corrections is None else corrections.balance()
        problem.time = rates.time + dt
        bulk, end = problem.equations.bulk, before.u.copy()
        compat.set_prescribed(end, bulk.bcs)
        known = np.zeros_like(bulk.prescribed)
        if self.scheme != "generalized_alpha" or adapts:
            known = bulk.prescribed & ~self._driven_dofs()
        lines = self._scheme.lines(before.u, rates, dt, known, end)
        inertia.factor, inertia.origin = lines[1]
        if inertia.rate is not None:
            inertia.rate.set(*lines[0])
        inertia.moving = True
        try:
            report = problem.solve(predict=False)
        except BaseException:
            inertia.moving = False
            problem.restore(before)
            raise
        inertia.moving = False
        u = problem.equations.bulk.u.x.array
        inertia.rates = replace(
            rates,
            velocity=lines[0](u),
            acceleration=lines[1](u),
            average=lines[2](u),
            time=rates.time + dt,
        )
        after = forces_of(problem)
        work = work_of(problem, before, problem.state(), forces, after)
        if corrections is not None:
            corrections.correct(work, dt, before.u, (forces, after), balance)
        inertia.set_rates(inertia.rates, u)
        speeds = [inertia.product(v, v) for v in (rates.velocity, inertia.rates.velocity)]
        self._largest_speed = max(self._largest_speed, float(np.sqrt(max(*speeds, 0.0))))
        return report, after, work

    def _begin(self) -> None:
        """Set the inertia forces of the present state; at the start compute the accelerations."""
        inertia, bulk = self._inertia, self.problem.equations.bulk
        check_rates(self.problem)
        if inertia.rates.begun:
            inertia.set_rates(inertia.rates, bulk.u.x.array)
            return
        inertia.set_rates(inertia.rates, bulk.u.x.array)  # acceleration not included yet
        w = first_acceleration(self.problem, inertia)
        begun = replace(inertia.rates, acceleration=w, average=w, begun=True)
        inertia.set_rates(begun, bulk.u.x.array)

    def _refuse_driven_motions(self) -> None:
        motions = self.problem.equations.motions
        driven = motions.driven.any(axis=1)
        names = [o.name for o, pushed in zip(motions.movers, driven, strict=True) if pushed]
        if names and driven[: len(motions.obstacles)].any():
            raise MortarError(
                f"obstacle '{names[0]}' is driven by forces, but has no mass: prescribe its motion "
                "by move, or mesh it"
            )
        if names and self._corrections is not None:
            raise MortarError(
                f"remote load '{names[0]}' is driven by forces, but scheme='conserving' corrects "
                "velocities node by node: expected scheme='massless' or 'generalized_alpha', "
                "prescribe the motion by move, or use a SpreadLoad"
            )

    def _driven_dofs(self) -> Flags:
        """Marks of dofs at rigid boundaries that forces drive, shape (local dofs,), bool."""
        bulk = self.problem.equations.bulk
        marks = np.zeros(bulk.u.x.array.size, bool)
        remote: list[Any] = list(self.problem.equations.motions.remote)
        for load in remote:
            if load in bulk.bcs:
                marks |= load.driven_dofs()
        return marks

    # Many steps

    def run(
        self,
        stop: float,
        options: SteppingOptions,
        set_loads: Callable[[float], None] | None = None,
        *,
        tolerance: float | None = None,
        on_step: Callable[[float, NewtonReport], None] | None = None,
    ) -> DynamicsReport:
        """Advance to the time ``stop``.

        A failed step is reverted and cut. Without ``tolerance`` the step size grows back to
        ``options.step``; with it the size follows from the estimated error, up to
        ``options.largest``.

        Args:
            stop: Final time [time].
            options: Sizes of the steps; ``easy`` and ``predict`` have no effect.
            set_loads: Function that sets loads and prescribed values for a time [time], also
                called for times within each step, see ``follow_path``.
            tolerance: Allowed error of a step [1], see ``error``.
            on_step: Function called with time and report after each step.

        Returns:
            The record of the steps, with energies.

        Raises:
            NotConvergedError: If a step of the smallest size fails. State and time are those of the
                last step; ``report`` is the ``DynamicsReport``.
            Exception: Any error of ``set_loads`` or ``on_step``.

        Note:
            Rank 0 logs each step and each cut, see ``report``.
        """
        with together(self.problem.equations.comm, "run"):
            check_run(stop, options, set_loads, tolerance, on_step, self.time)
        given = {"stop": stop, "options": options, "tolerance": tolerance}
        check_same_texts(self.problem.equations.comm, "run", given)
        self._begin()
        advance = partial(self._advance, adapts=tolerance is not None)
        return Motion(self, advance, options, tolerance).run(stop, set_loads, on_step)

    # Measures

    @property
    def energy_deficit(self) -> float:
        """Energy lost by errors of the time steps and not returned yet [stress length^2] (local).

        Zero unless the scheme is "conserving".
        """
        return self._inertia.rates.energy_deficit

    def error(self, before: State, dt: float) -> float:
        """Estimated error of the velocity in the last step over the largest velocity so far [1].

        dt |w_(n+1) - w_n| / 12 in the norm of the mass: the displacement error dt^2 (w_(n+1) -
        w_n) / 12 of the trapezoidal rule (Zienkiewicz & Xie 1991) over dt. For a mode of angular
        frequency omega it is about (omega dt)^2 / 12.

        Args:
            before: State at the start of the step.
            dt: The step [time].
        """
        inertia = self._inertia
        change = inertia.rates.acceleration - rates_of(before).acceleration
        size = float(np.sqrt(max(inertia.product(change, change), 0.0)))
        return dt * size / 12.0 / max(self._largest_speed, TINY)

    def energies(self) -> Energies:
        """Kinetic and strain energy and momentum at the present state."""
        inertia, v = self._inertia, self.velocity.x.array
        kinetic = 0.5 * inertia.product(v, v)
        strain = float("nan")
        if self._energy is not None:
            strain = self.problem.equations.comm.allreduce(float(fem.assemble_scalar(self._energy)))
        return Energies(kinetic, strain, inertia.momentum(self._positions(), v))

    def momentum(self, dt: float = 0.0) -> Array:
        """Linear momentum and angular momentum about the origin, shape (3,), in space (6,).

        Units [stress length time] and [stress length^2 time].

        Args:
            dt: Step [time]: displacement and velocity are extrapolated linearly by dt / 2. With
                "massless", rho_inf = 1 and equal steps dt without external forces the result is the
                momentum in the middle of the next step, which is constant up to rounding and the
                moments of mortar pressures. With "conserving" the momentum at the present time is
                constant.
        """
        check_number("dt", dt, "a finite number", np.isfinite)
        rates, half = self._inertia.rates, 0.5 * dt
        v = rates.velocity
        return self._inertia.momentum(self._positions() + half * v, v + half * rates.acceleration)

    def _positions(self) -> Array:
        """Present positions of the nodes, an array of all local dofs."""
        bulk = self.problem.equations.bulk
        x = bulk.u.x.array.copy()
        x[bulk.space.dofs] = bulk.positions()
        return x
