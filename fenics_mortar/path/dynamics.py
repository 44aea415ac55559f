# SPDX-License-Identifier: MIT
"""Motion of bodies with mass: time steps with contact.

All schemes are the generalized-alpha method with contact at the end of the step. With
"generalized_alpha" all nodes have mass: an impact stops the mass of the nodes in contact within one
step, so that pressures oscillate, and energy increases with the trapezoidal rule (rho_inf = 1).
With "massless" slave nodes have no mass, see ``bulk.inertia``: pressures are continuous in time,
impacts are resolved by waves in the bodies, and errors of the energy are of second order. With
"conserving" these errors, of contact and of nonlinear stresses, are corrected, too, and those of
the angular momentum; see ``corrections`` and ``path.report``. Measurements are in
``demos/studies/dynamics``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dolfinx import fem

from fenics_mortar.bulk.inertia import Inertia, Velocity
from fenics_mortar.contact.contact import start_clock
from fenics_mortar.contact.tied import Tie
from fenics_mortar.equations.general import State, restored_if_interrupted
from fenics_mortar.newton.loop import NewtonReport
from fenics_mortar.path.corrections import Corrections
from fenics_mortar.path.report import DynamicsReport, Energies, Forces, Work, forces_of, work_of
from fenics_mortar.path.stepping import SteppingOptions
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
from fenics_mortar.utils.arrays import TINY, Array, Flags
from fenics_mortar.utils.errors import (
    MortarError,
    check_kind,
    check_number,
    check_same_texts,
    together,
)


class Dynamics:
    """Motion of the bodies of a contact problem; all methods are collective.

    The problem becomes that of the end of a time step: residual, multipliers, results and
    checkpoints (``save_state``, ``state``) include inertia. Bodies need no supports, since inertia
    balances their loads. If the problem was solved before, the motion starts at rest from its
    solution.

    Args:
        problem: The problem, with the residual f_int - f_ext of statics.
        density: Mass per area of the mesh [stress time^2 / length^2], a number or a UFL expression;
            times a thickness or 2 pi R if the residual contains them. Steps raise an error if its
            constants or functions have changed since.
        scheme: "conserving" (slave nodes without mass, no gain of energy in impacts, momentum and
            angular momentum exact), "massless" (without these corrections of the velocity) or
            "generalized_alpha" (all nodes have mass). Bodies with history: one of the last two.
        rho_inf: Spectral radius at infinite frequency, from 0 (most dissipation) to 1 (none) [1].
            Default: 0.8 for "generalized_alpha", else 1.
        velocity: The ``Velocity`` in the residual, for damping.
        energy: UFL form of the strain energy, such as ``psi * dx``, for the report.

    Attributes:
        problem: The problem.
        scheme: The time scheme.
        rho_inf: Its spectral radius at infinite frequency [1].
        velocity: Velocity, a function of the space of ``u`` [length / time]; set it before the
            first step.

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
        self._largest_speed = 0.0
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
            The record of the Newton iterations.

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
            return self._advance(dt, forces_of(self.problem))[0]

    def _advance(self, dt: float, forces: Forces) -> tuple[NewtonReport, Forces, Work]:
        """Advance by one step; see ``step``.

        Args:
            dt: The step [time].
            forces: Forces at its start.

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
        return Motion(self, self._advance, options, tolerance).run(stop, set_loads, on_step)

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
        inertia, rates, earlier = self._inertia, self._inertia.rates, rates_of(before)
        speeds = [inertia.product(v, v) for v in (rates.velocity, earlier.velocity)]
        self._largest_speed = max(self._largest_speed, float(np.sqrt(max(*speeds, 0.0))))
        change = rates.acceleration - earlier.acceleration
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
