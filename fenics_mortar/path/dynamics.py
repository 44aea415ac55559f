# SPDX-License-Identifier: MIT
"""Motion of bodies with mass: time steps with contact.

All schemes are the generalized-alpha method with contact at the end of the step. With
"generalized_alpha" all nodes have mass: an impact stops the mass of the nodes in contact within one
step, so that pressures oscillate, and energy increases with the trapezoidal rule (rho_inf = 1).
Intact bonds, as of ``laws.MixedCohesive``, pull these nodes back to the next impact: energy grows
8 to 600 times in an example, and smaller steps do not help. The force of the bond has no part in
it: with a spring in place of the impact the error is of second order in the step, 8e-4.
With "massless" slave nodes have no mass, see ``bulk.inertia``: pressures are continuous in time,
impacts are resolved by waves in the bodies, and errors of the energy are of second order. With
"conserving" these errors, of contact and of nonlinear stresses, are corrected, as are those of
the angular momentum; see ``path.time_steps``. Measurements are in ``demos/studies/dynamics``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_arguments, extract_coefficients, extract_constants
from ufl.domain import extract_domains

from fenics_mortar.bulk.checks import check_domain, check_subdomains
from fenics_mortar.bulk.inertia import Inertia, Origin, Velocity
from fenics_mortar.contact.contact import start_clock
from fenics_mortar.contact.tied import Tie
from fenics_mortar.equations.general import State, restored_if_interrupted
from fenics_mortar.path import report
from fenics_mortar.path.stepping import SteppingOptions, Steps, check_steps
from fenics_mortar.path.time_steps import Corrections, GeneralizedAlpha, first_acceleration
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils import compat, errors
from fenics_mortar.utils.arrays import ROUNDING, TINY, Array, Flags

if TYPE_CHECKING:
    from fenics_mortar.newton.loop import NewtonReport


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
        errors.check_kind("problem", problem, ContactProblem, "a ContactProblem")
        check_dynamics(problem, density, scheme, rho_inf, velocity, energy)
        self.problem, equations = problem, problem.equations
        self._scheme = GeneralizedAlpha(SCHEMES[scheme] if rho_inf is None else float(rho_inf))
        slaves = [c.slave.nodes for c in equations.contacts if not isinstance(c, Tie)]
        massless = [] if scheme == "generalized_alpha" else slaves
        nodes = np.unique(np.concatenate([np.empty(0, np.int64), *massless]))
        self._density, self._masses_of = density, _density_values(density)
        self._inertia = Inertia(equations.bulk.space, density, nodes)
        self._inertia.rate = velocity
        self._inertia.scheme = f"scheme='{scheme}', rho_inf={self._scheme.rho:g}"
        self._energy = None if energy is None else compat.form(energy)
        equations.add_inertia(self._inertia)
        self.velocity = self._inertia.velocity
        self._errors = report.EnergyErrors()
        self.scheme, self.rho_inf, conserves = scheme, self._scheme.rho, self._scheme.rho == 1.0
        self._corrections: Corrections | None = None
        if scheme == "conserving":
            self._corrections = Corrections(problem, self._inertia, conserves=conserves)

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
        with errors.together(self.problem.equations.comm, "step"):
            check_step(dt, self.time)
        with restored_if_interrupted(self.problem.equations):
            self._begin()
            before = self._errors
            if before.time != self.time:  # after other steps, whose errors it does not add
                before = report.EnergyErrors(*self._energy_totals())
            newton, _, work = self._advance(dt, report.forces_of(self.problem))
        self._errors = before.after(work, *self._energy_totals(), size=dt, time=self.time)
        if self._errors.worst(self.scheme) > before.worst(self.scheme):
            newton.notes[:0] = filter(None, [self._errors.remark(self.scheme, self.rho_inf)])
        return newton

    def _energy_totals(self) -> tuple[float, float]:
        """Largest kinetic energy, and energy lost so far and not returned [stress length^2]."""
        return self._inertia.rates.largest_kinetic, self.energy_deficit

    def _advance(
        self, dt: float, forces: report.Forces, *, adapts: bool = False
    ) -> tuple[NewtonReport, report.Forces, report.Work]:
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
        self._check_density()
        check_step(dt, inertia.rates.time)
        start_clock(problem.equations.contacts, inertia.rates.time)
        before, rates = problem.state(), inertia.rates
        if self._corrections is not None:
            self._corrections.begin()
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
            newton = problem.solve(predict=False)
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
        after = report.forces_of(problem)
        work = report.work_of(problem, before, problem.state(), forces, after, in_time=True)
        if self._corrections is not None:
            self._corrections.correct(work, dt, before.u, (forces, after))
        kinetic = [0.5 * inertia.product(v, v) for v in (rates.velocity, inertia.rates.velocity)]
        largest = float(max(rates.largest_kinetic, *kinetic))
        inertia.set_rates(replace(inertia.rates, largest_kinetic=largest), u)
        return newton, after, work

    def _begin(self) -> None:
        """Set the inertia forces of the present state; at the start compute the accelerations."""
        inertia, bulk = self._inertia, self.problem.equations.bulk
        self.velocity.x.scatter_forward()
        bad = int(np.count_nonzero(~np.isfinite(self.velocity.x.array)))
        if bulk.comm.allreduce(bad):
            raise errors.MortarError("the velocity of Dynamics is not finite")
        inertia.set_rates(inertia.rates, bulk.u.x.array)  # at the start without acceleration
        if inertia.rates.begun:
            return
        w = first_acceleration(self.problem, inertia)
        begun = replace(inertia.rates, acceleration=w, average=w, begun=True)
        inertia.set_rates(begun, bulk.u.x.array)

    def _refuse_driven_motions(self) -> None:
        motions = self.problem.equations.motions
        names = [mover.motion.name for mover in motions.movers if mover.driven.any()]
        if motions.driven_obstacles.any():
            raise errors.MortarError(
                f"obstacle '{names[0]}' is driven by forces, but has no mass: prescribe its motion "
                "by move, or mesh it"
            )
        if names and self._corrections is not None:
            raise errors.MortarError(
                f"remote load '{names[0]}' is driven by forces, but scheme='conserving' corrects "
                "velocities node by node: expected scheme='massless' or 'generalized_alpha', "
                "prescribe the motion by move, or use a SpreadLoad"
            )

    def _check_density(self) -> None:
        """Reject a density that has changed since masses were assembled."""
        pairs = zip(self._masses_of, _density_values(self._density), strict=True)
        changed = not all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)
        if self.problem.equations.comm.allreduce(int(changed)):
            raise errors.MortarError(
                "the density has changed since Dynamics(...), whose masses are constant: set up a "
                "new problem, and give its Dynamics the velocity"
            )

    def _driven_dofs(self) -> Flags:
        """Marks of dofs at rigid boundaries that forces drive, shape (local dofs,), bool."""
        marks = np.zeros(self.problem.equations.bulk.u.x.array.size, bool)
        for load in self.problem.equations.motions.boundaries:
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
    ) -> report.DynamicsReport:
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
        with errors.together(self.problem.equations.comm, "run"):
            check_run(stop, options, set_loads, tolerance, on_step, self.time)
        given = {"stop": stop, "options": options, "tolerance": tolerance}
        errors.check_same_texts(self.problem.equations.comm, "run", given)
        self._begin()
        advance = partial(self._advance, adapts=tolerance is not None)
        steps = TimeSteps(self, advance, tolerance, stop, options, set_loads)
        ended: report.DynamicsReport = steps.run(on_step)
        return ended

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
        errors.check_kind("before", before, State, "a state of the problem")
        if before.rates is None:
            raise ValueError("before has no velocity: expected a state of the motion")
        change = inertia.rates.acceleration - before.rates.acceleration
        size = float(np.sqrt(max(inertia.product(change, change), 0.0)))
        return dt * size / 12.0 / max(float(np.sqrt(2.0 * inertia.rates.largest_kinetic)), TINY)

    def energies(self) -> report.Energies:
        """Kinetic and strain energy and momentum at the present state."""
        inertia, v = self._inertia, self.velocity.x.array
        kinetic = 0.5 * inertia.product(v, v)
        strain = float("nan")
        if self._energy is not None:
            strain = self.problem.equations.comm.allreduce(float(fem.assemble_scalar(self._energy)))
        return report.Energies(kinetic, strain, inertia.momentum(self._positions(), v))

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
        errors.check_number("dt", dt, "a finite number", np.isfinite)
        rates, half = self._inertia.rates, 0.5 * dt
        v = rates.velocity
        return self._inertia.momentum(self._positions() + half * v, v + half * rates.acceleration)

    def _positions(self) -> Array:
        """Present positions of the nodes, an array of all local dofs."""
        bulk = self.problem.equations.bulk
        x = bulk.u.x.array.copy()
        x[bulk.space.dofs] = bulk.positions()
        return x


class TimeSteps(Steps):
    """Time steps of ``Dynamics.run``.

    Args:
        bodies: The ``Dynamics``.
        advance: Function that takes a step from the forces at its start.
        tolerance: Allowed error of a step, or ``None``.
        stop: Time of the last state [time].
        given: Sizes of the steps and function of the loads, see ``Steps``.
    """

    def __init__(
        self, bodies: Any, advance: Any, tolerance: float | None, stop: float, *given: Any
    ) -> None:
        reached = stop - bodies.time <= ROUNDING * given[0].smallest  # the time is a sum of steps
        super().__init__(bodies.problem, (stop if reached else bodies.time, stop), *given)
        self._bodies, self._advance, self._tolerance = bodies, advance, tolerance
        self.report = report.DynamicsReport(
            bodies.energies(), scheme=bodies.scheme, rho_inf=bodies.rho_inf
        )
        options = self.options
        self._largest = options.step if tolerance is None else options.largest or options.step

    def attempt(self, time: float, step: float) -> NewtonReport:
        """Solve for the end of a step that starts at a time; its record."""
        before, tolerance = self.problem.state(), self._tolerance
        newton, forces, self._work = self._advance(step, self.forces)
        self._error = error = self._bodies.error(before, step)
        if tolerance is not None and error > tolerance and step > self.options.smallest:
            raise errors.NotConvergedError(f"error of the step {error:.1e}", newton)
        self.forces = forces
        return newton

    def accept(self, time: float, step: float, newton: NewtonReport) -> float:
        """See ``Steps``; the error grows with the square of the size.

        The next step has nine tenths of the size at which the error would be the tolerance, or
        less.
        """
        bodies, options, growth = self._bodies, self.options, self.options.growth
        measured = self._error, self._work, bodies.energies(), step, bodies.energy_deficit
        self.report.steps.append(report.TimeStep(time, newton, self.report.failures, *measured))
        if self._tolerance is not None:
            growth = min(growth, 0.9 * float(np.sqrt(self._tolerance / max(self._error, TINY))))
        return min(max(growth * step, options.smallest), self._largest)

    def explain(self, time: float, step: float, failure: errors.NotConvergedError) -> str:
        """Why the motion ends at a time, and why larger steps failed, if that differs."""
        failures = self.report.failures
        first, last = failures[0].reason, failures[-1].reason
        count = sum(failure.reason == first for failure in failures)
        times = f" ({count} times)" if count > 1 else ""
        others = "" if first == last else f"; larger steps failed since{times}: {first}"
        return f"the motion ends at time {time:.6g}: a step of {step:.1e} fails; {failure}{others}"


def check_run(
    stop: Any, options: Any, set_loads: Any, tolerance: Any, on_step: Any, time: float
) -> None:
    """Reject arguments of ``Dynamics.run`` (local)."""
    expected = f"a time from the present one, {time:.6g}, on"
    errors.check_number("stop", stop, expected, lambda stop: time <= stop < np.inf)
    check_steps(options, on_step)
    if set_loads is not None and not callable(set_loads):
        raise ValueError(f"set_loads={set_loads!r}: expected a function of the time, or None")
    if tolerance is not None:
        errors.check_number("tolerance", tolerance, "a positive number", lambda t: 0.0 < t < np.inf)


# Default spectral radius at infinite frequency by scheme [1]: no dissipation, or dissipation of the
# frequencies excited by impacts and not resolved by the time step.
SCHEMES = {"conserving": 1.0, "massless": 1.0, "generalized_alpha": 0.8}


def check_dynamics(
    problem: ContactProblem, density: Any, scheme: Any, rho_inf: Any, velocity: Any, energy: Any
) -> None:
    """Reject arguments of ``Dynamics``, also those that differ between ranks (collective).

    Raises:
        ValueError: On all ranks, if an argument is not allowed.
        MortarError: On all ranks, if arguments differ, or a tag is unknown.
    """
    comm, bulk = problem.equations.comm, problem.equations.bulk
    with errors.together(comm, "Dynamics"):
        errors.check_choice("scheme", scheme, SCHEMES)
        if scheme == "conserving" and bulk.history.functions:
            raise ValueError(
                "scheme='conserving' returns lost energy, and does not support bodies with "
                "history, which dissipate: expected scheme='massless' or 'generalized_alpha'"
            )
        if rho_inf is not None:
            errors.check_number(
                "rho_inf", rho_inf, "a number from 0 to 1", lambda rho: 0.0 <= rho <= 1.0
            )
        mesh = bulk.V.ufl_domain()
        _check_density(density, mesh)
        _check_energy(energy, mesh)
        _check_velocity(velocity, problem)
        if problem.equations.model_check is not None:
            raise ValueError("problem has a ModelCheck, whose models have no inertia")
        if bulk.inertia is not None:
            raise ValueError(
                "problem has inertia already, from another Dynamics: set up a new problem"
            )
    is_number = not isinstance(density, ufl.core.expr.Expr)
    given = {
        "scheme": scheme, "rho_inf": rho_inf, "velocity": velocity is not None,
        "energy": energy is not None, "density": density if is_number else "a UFL expression",
    }  # fmt: skip
    errors.check_same_texts(comm, "Dynamics", given)
    constants = [] if is_number else extract_constants(density)
    errors.check_same(comm, [("a constant of density", c.value) for c in constants])
    if energy is not None:
        named = [contact.pair.data for contact in problem.equations.contacts]
        check_subdomains("energy", energy, bulk.V.mesh, named)


def _check_density(density: Any, mesh: Any) -> None:
    if not isinstance(density, ufl.core.expr.Expr):
        errors.check_number("density", density, "a positive number", lambda rho: 0.0 < rho < np.inf)
        return
    if density.ufl_shape:
        raise ValueError(f"density has the shape {density.ufl_shape}: expected a scalar")
    if extract_arguments(density):
        raise ValueError("density has a test function: expected a number or a function")
    if any(domain != mesh for domain in extract_domains(density)):
        raise ValueError("density belongs to another mesh than the problem")


def _check_velocity(velocity: Any, problem: ContactProblem) -> None:
    """Reject a velocity that the residual does not contain, and a missing one."""
    bulk = problem.equations.bulk
    if velocity is not None:
        errors.check_kind("velocity", velocity, Velocity, "a Velocity(u)")
        if velocity.u is not bulk.u:
            raise ValueError("velocity is that of another function: expected Velocity(u)")
    given = None if velocity is None else velocity.origin
    used = [data for data in bulk.data if isinstance(data, Origin)]
    if given is not None and not any(origin is given for origin in used):
        raise ValueError("velocity has no effect: the residual does not contain its expression")
    if any(origin is not given for origin in used):
        raise ValueError(
            "the residual contains a Velocity that would remain zero: expected velocity=..., the "
            "same object"
        )


def _check_energy(energy: Any, mesh: Any) -> None:
    if energy is None:
        return
    errors.check_kind("energy", energy, ufl.Form, "a UFL form, such as psi * dx")
    if energy.arguments():
        raise ValueError("energy has a test function: expected a scalar form, such as psi * dx")
    check_domain("energy", energy, mesh)


def _density_values(density: Any) -> list[Array]:
    """Copies of the values of constants and functions of a density (local)."""
    if not isinstance(density, ufl.core.expr.Expr):
        return []
    values = [np.array(constant.value) for constant in extract_constants(density)]
    return values + [function.x.array.copy() for function in extract_coefficients(density)]


def check_step(dt: Any, time: float) -> None:
    """Reject a step that is not positive, or lost in the rounding of ``time`` (local).

    Raises:
        ValueError: If the step is not allowed.
    """
    errors.check_number("dt", dt, "a positive number", lambda dt: 0.0 < dt < np.inf)
    expected = f"a step that the time {time:g} can resolve"
    errors.check_number("dt", dt, expected, lambda dt: time + dt > time and 0.0 < dt * dt < np.inf)
