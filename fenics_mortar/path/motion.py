# SPDX-License-Identifier: MIT
"""Sequences of time steps: failed steps are cut, and step sizes may follow the estimated error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np

from fenics_mortar.equations.state import State
from fenics_mortar.equations.undo import Snapshot, raise_cause
from fenics_mortar.newton.report import NewtonReport
from fenics_mortar.path.dynamics_report import DynamicsReport, Energies, TimeStep
from fenics_mortar.path.options import SteppingOptions
from fenics_mortar.path.progress import Progress
from fenics_mortar.path.work import Forces, Work, forces_of
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arguments import check_kind, check_number
from fenics_mortar.utils.errors import NotConvergedError, call_together
from fenics_mortar.utils.rounding import EPSILON, ROUNDING, TINY

# Function that takes a time step from forces at its start; returns record, forces at the end, work.
Advance = Callable[[float, Forces], tuple[NewtonReport, Forces, Work]]
SetLoads = Callable[[float], None]
OnStep = Callable[[float, NewtonReport], None]


class Moving(Protocol):
    """Bodies in motion; see ``Dynamics``."""

    problem: ContactProblem
    scheme: str
    rho_inf: float

    @property
    def energy_deficit(self) -> float:
        """Energy lost by errors of the time steps and not returned yet [stress length^2]."""

    @property
    def time(self) -> float:
        """Present time [time]."""

    def error(self, before: State, dt: float) -> float:
        """Estimated error of the last step [1]."""

    def energies(self) -> Energies:
        """Energies and momentum at the present state."""


class Motion:
    """Steps of a motion to a given time; all methods are collective.

    Args:
        bodies: The bodies.
        advance: Function that takes a time step.
        options: Sizes of the steps.
        tolerance: Allowed error of a step, or ``None``.
    """

    def __init__(
        self, bodies: Moving, advance: Advance, options: SteppingOptions, tolerance: float | None
    ) -> None:
        self._bodies, self._advance = bodies, advance
        self._options, self._tolerance = options, tolerance
        self._largest = options.step if tolerance is None else (options.largest or options.step)

    def run(
        self, stop: float, set_loads: SetLoads | None, on_step: OnStep | None
    ) -> DynamicsReport:
        """Advance to the time ``stop``; see ``Dynamics.run``."""
        bodies, problem, options = self._bodies, self._bodies.problem, self._options
        report = DynamicsReport(bodies.energies(), scheme=bodies.scheme, rho_inf=bodies.rho_inf)
        size, forces = options.step, forces_of(problem)
        shown = Progress(problem.equations.comm, bodies.time, stop)
        # the sum of many steps is rounded
        while stop - bodies.time > max(
            ROUNDING * options.smallest, len(report.steps) * EPSILON * abs(stop)
        ):
            start = bodies.time
            dt = min(size, stop - start)
            dt = stop - start if stop - start - dt < ROUNDING * dt else dt
            before = Snapshot(problem.equations)
            accepted = problem.state()
            try:
                if set_loads is not None:
                    call_together(
                        problem.equations.comm, "set_loads", partial(set_loads, start + dt)
                    )
                newton, after, work = self._advance(dt, forces)
                error = self._error(accepted, dt, newton)
            except NotConvergedError as failure:
                problem.restore(accepted)
                report.failures.append(failure.report)
                shown.cut(start + dt, str(failure), failure.report)
                if dt <= options.smallest:
                    message = f"the motion ends at time {start:.6g}: a step of {dt:.1e} fails"
                    message = f"{message}; {failure}{_other_reasons(report.failures)}"
                    raise NotConvergedError(message, report) from failure
                size = max(options.cut * dt, options.smallest)
                continue
            except BaseException as interruption:
                before.revert(renew=True)
                raise_cause(interruption)
            forces = after
            measured = error, work, bodies.energies(), dt, bodies.energy_deficit
            done = TimeStep(bodies.time, newton, report.failures, *measured)
            report.steps.append(done)
            shown.accept(bodies.time, newton)
            report.failures = []
            size = self._next_size(size, error)
            if on_step is not None:
                call_together(
                    problem.equations.comm, "on_step", partial(on_step, bodies.time, newton)
                )
        return report

    def _error(self, accepted: State, dt: float, newton: NewtonReport) -> float:
        """Estimated error of the last step; see ``Dynamics.error``.

        Raises:
            NotConvergedError: If it exceeds the tolerance and the step may be cut.
        """
        error, tolerance = self._bodies.error(accepted, dt), self._tolerance
        if tolerance is not None and error > tolerance and dt > self._options.smallest:
            raise NotConvergedError(f"error of the step {error:.1e}", newton)
        return error

    def _next_size(self, size: float, error: float) -> float:
        """Size of the next step; the error grows with its square.

        Nine tenths of the size at which the error would be the tolerance, or less.
        """
        options, growth = self._options, self._options.growth
        if self._tolerance is not None:
            growth = min(growth, 0.9 * float(np.sqrt(self._tolerance / max(error, TINY))))
        return min(max(growth * size, options.smallest), self._largest)


def _other_reasons(failures: Sequence[NewtonReport]) -> str:
    """Clause on the reason for which larger steps failed first, "" if that is the last one."""
    first, last = failures[0].reason, failures[-1].reason
    count = sum(report.reason == first for report in failures)
    times = f" ({count} times)" if count > 1 else ""
    return "" if first == last else f"; larger steps failed since{times}: {first}"


def check_run(
    stop: Any, options: Any, set_loads: Any, tolerance: Any, on_step: Any, time: float
) -> None:
    """Reject arguments of ``Dynamics.run`` (local)."""
    expected = f"a time from the present one, {time:.6g}, on"
    check_number("stop", stop, expected, lambda stop: time <= stop < np.inf)
    expected = "an instance of SteppingOptions, such as SteppingOptions(step=0.1)"
    check_kind("options", options, SteppingOptions, expected)
    if tolerance is not None:
        check_number("tolerance", tolerance, "a positive number", lambda t: 0.0 < t < np.inf)
    for name, function in (("set_loads", set_loads), ("on_step", on_step)):
        if function is not None and not callable(function):
            raise ValueError(f"{name}={function!r}: expected a function, or None")
