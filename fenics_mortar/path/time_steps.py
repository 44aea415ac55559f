# SPDX-License-Identifier: MIT
"""Time steps: the scheme, and sequences in which failed steps are cut and sizes follow the error.

**Generalized-alpha method with all forces at the end of the step (Chung & Hulbert 1993).** In the
form of Arnold & Bruels (2007), w is the acceleration that balances all forces at the same time,

    M w_(n+1) + f_int(u_(n+1)) - f_ext + B^T z_(n+1) = 0,

and a an average of it,

    (1 - am) a_(n+1) + am a_n = (1 - af) w_(n+1) + af w_n.

With Newmark's formulas for u and v from a, this is the generalized-alpha method whose internal,
external and contact forces are (1 - af) f_(n+1) + af f_n. Multipliers are those of the end of the
step, in balance with gaps, loads and prescribed values of the same time.

Checks of the arguments of ``Dynamics`` and of the velocity that users set.

Accelerations at the start of a motion, also of rigid boundaries that forces drive.

With V_m the motions of a boundary's nodes k, and the angular velocity w of these,

    u''_k = sum_m a_m V_m,k - w^2 (x_k - x_P),    V_m . (M u'' + f) = push_m,

where free nodes follow from M u'' + f = 0: a solve with M for each driven motion. The forces of
sections act on both faces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import ufl
from ufl.algorithms.analysis import extract_arguments, extract_coefficients, extract_constants
from ufl.domain import extract_domains

from fenics_mortar.bulk.checks import check_domain, check_subdomains
from fenics_mortar.bulk.inertia import Inertia, Origin, Rates, Velocity
from fenics_mortar.equations.general import Snapshot, State, raise_cause
from fenics_mortar.newton.loop import NewtonReport
from fenics_mortar.path.report import DynamicsReport, Forces, Progress, TimeStep, Work, forces_of
from fenics_mortar.path.stepping import PrescribedTurns, StepLengths, SteppingOptions
from fenics_mortar.utils.arrays import EPSILON, ROUNDING, TINY, Array, Flags
from fenics_mortar.utils.errors import (
    MortarError,
    NotConvergedError,
    call_together,
    check_choice,
    check_kind,
    check_number,
    check_same,
    check_same_texts,
    together,
)
from fenics_mortar.utils.ranks import sum_over_ranks

if TYPE_CHECKING:
    from fenics_mortar.problem import ContactProblem


class Line(NamedTuple):
    """A quantity that is linear in the displacement at the end of a step, factor (u - origin)."""

    factor: float
    origin: Array

    def __call__(self, u: Array) -> Array:
        """Its value at the displacement ``u``."""
        return self.factor * (u - self.origin)

    def as_line(self, other: Line, dofs: Flags, u: Array) -> Line:
        """This line with the values of another line at dofs of known displacement.

        Args:
            other: The other line.
            dofs: Marks of these dofs, shape (dofs,), bool.
            u: Displacement at the end of the step at these dofs, shape (dofs,) [length].
        """
        origin = u - other(u) / self.factor
        return Line(self.factor, np.where(dofs, origin, self.origin))


@dataclass(frozen=True)
class GeneralizedAlpha:
    """The method for a spectral radius rho at infinite frequency, between 0 and 1.

    rho = 1 is the trapezoidal rule, which conserves the energy of linear bodies; with rho = 0
    unresolved frequencies are damped within one step.
    """

    rho: float

    @property
    def inertia_shift(self) -> float:
        """Weight am of the old inertia [1]."""
        return (2.0 * self.rho - 1.0) / (self.rho + 1.0)

    @property
    def force_shift(self) -> float:
        """Weight af of the old forces [1]."""
        return self.rho / (self.rho + 1.0)

    @property
    def gamma(self) -> float:
        """Newmark's gamma for second order [1]."""
        return 0.5 + self.force_shift - self.inertia_shift

    @property
    def beta(self) -> float:
        """Newmark's beta for the largest dissipation of high frequencies [1]."""
        return 0.25 * (0.5 + self.gamma) ** 2

    def lines(
        self, u: Array, rates: Rates, dt: float, prescribed: Flags, end: Array
    ) -> tuple[Line, Line, Line]:
        """Velocity, acceleration and its average at the end of the step.

        Rates of ``prescribed`` motions follow from these motions alone, by the method for rho = 0,
        which is of second order as well. With rho = 1 they would alternate permanently after a jump
        of the velocity or for inconsistent initial rates; with rho = 0 such errors vanish in three
        steps. If prescribed motions accelerate, energies balance up to terms of second order. The
        scheme "generalized_alpha" marks none in steps of given size: other codes have the rates of
        the method itself.

        Args:
            u: Displacement at the start of the step, shape (dofs,) [length].
            rates: Rates at the start of the step.
            dt: The step [time].
            prescribed: Marks of such dofs, shape (dofs,), bool.
            end: Displacement of these dofs at the end of the step [length].
        """
        damped = GeneralizedAlpha(0.0)
        of_all, of_prescribed = (
            [line(u, rates, dt) for line in (s.velocity, s.acceleration, s.average)]
            for s in (self, damped)
        )
        velocity, acceleration, average = (
            line.as_line(other, prescribed, end)
            for line, other in zip(of_all, of_prescribed, strict=True)
        )
        return velocity, acceleration, average

    def average(self, u: Array, rates: Rates, dt: float) -> Line:
        """A at the end of the step [length / time^2].

        Args:
            u: Displacement at the start of the step, shape (owned dofs,) [length].
            rates: Rates at the start of the step.
            dt: The step [time].
        """
        start = u + dt * rates.velocity + dt**2 * (0.5 - self.beta) * rates.average
        return Line(1.0 / (self.beta * dt**2), start)

    def velocity(self, u: Array, rates: Rates, dt: float) -> Line:
        """V at the end of the step [length / time]; arguments: see ``average``."""
        a = self.average(u, rates, dt)
        factor = self.gamma * dt * a.factor
        rest = rates.velocity + (1.0 - self.gamma) * dt * rates.average
        return Line(factor, a.origin - rest / factor)

    def acceleration(self, u: Array, rates: Rates, dt: float) -> Line:
        """W at the end of the step [length / time^2]; arguments: see ``average``."""
        am, af, a = self.inertia_shift, self.force_shift, self.average(u, rates, dt)
        factor = (1.0 - am) / (1.0 - af) * a.factor
        rest = (am * rates.average - af * rates.acceleration) / (1.0 - af)
        return Line(factor, a.origin - rest / factor)


# Function that takes a time step from forces at its start; returns record, forces at the end, work.
Advance = Callable[[float, Forces], tuple[NewtonReport, Forces, Work]]
SetLoads = Callable[[float], None]
OnStep = Callable[[float, NewtonReport], None]


class Motion:
    """Steps of a motion to a given time; all methods are collective.

    Args:
        bodies: The ``Dynamics``.
        advance: Function that takes a time step.
        options: Sizes of the steps.
        tolerance: Allowed error of a step, or ``None``.
    """

    def __init__(
        self, bodies: Any, advance: Advance, options: SteppingOptions, tolerance: float | None
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
        size, lengths, forces = options.step, StepLengths(), forces_of(problem)
        shown = Progress(problem.equations.comm)
        turns = None if set_loads is None else PrescribedTurns(problem, self._together(set_loads))
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
                with nullcontext() if turns is None else turns.of_step(start, start + dt):
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
                lengths.cut(dt)
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
            size = lengths.following(size, self._next_size(size, error))
            if on_step is not None:
                call_together(
                    problem.equations.comm, "on_step", partial(on_step, bodies.time, newton)
                )
        return report

    def _together(self, set_loads: SetLoads) -> SetLoads:
        """The function of the user, whose errors are raised on all ranks."""
        comm = self._bodies.problem.equations.comm
        return lambda time: call_together(comm, "set_loads", partial(set_loads, time))

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
    with together(comm, "Dynamics"):
        check_choice("scheme", scheme, SCHEMES)
        if scheme == "conserving" and bulk.history.functions:
            raise ValueError(
                "scheme='conserving' returns lost energy, and does not support bodies with "
                "history, which dissipate: expected scheme='massless' or 'generalized_alpha'"
            )
        if rho_inf is not None:
            check_number("rho_inf", rho_inf, "a number from 0 to 1", lambda rho: 0.0 <= rho <= 1.0)
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
    check_same_texts(comm, "Dynamics", given)
    constants = [] if is_number else extract_constants(density)
    check_same(comm, [("a constant of density", c.value) for c in constants])
    if energy is not None:
        named = [contact.pair.data for contact in problem.equations.contacts]
        check_subdomains("energy", energy, bulk.V.mesh, named)


def _check_density(density: Any, mesh: Any) -> None:
    if not isinstance(density, ufl.core.expr.Expr):
        check_number("density", density, "a positive number", lambda rho: 0.0 < rho < np.inf)
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
        check_kind("velocity", velocity, Velocity, "a Velocity(u)")
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
    check_kind("energy", energy, ufl.Form, "a UFL form, such as psi * dx")
    if energy.arguments():
        raise ValueError("energy has a test function: expected a scalar form, such as psi * dx")
    check_domain("energy", energy, mesh)


class DensityValues:
    """Values of a density at the time when masses were assembled (local).

    Args:
        density: Number or UFL expression.
    """

    def __init__(self, density: Any) -> None:
        is_number = not isinstance(density, ufl.core.expr.Expr)
        self._constants = [] if is_number else extract_constants(density)
        self._functions = [] if is_number else extract_coefficients(density)
        self._values = self._present()

    def check(self, problem: ContactProblem) -> None:
        """Reject a density that has changed (collective).

        Raises:
            MortarError: On all ranks.
        """
        pairs = zip(self._values, self._present(), strict=True)
        changed = not all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)
        if problem.equations.comm.allreduce(int(changed)):
            raise MortarError(
                "the density has changed since Dynamics(...), whose masses are constant: set up a "
                "new problem, and give its Dynamics the velocity"
            )

    def _present(self) -> list[Array]:
        values = [np.array(constant.value) for constant in self._constants]
        return values + [function.x.array.copy() for function in self._functions]


def check_step(dt: Any, time: float) -> None:
    """Reject a step that is not positive, or lost in the rounding of ``time`` (local).

    Raises:
        ValueError: If the step is not allowed.
    """
    check_number("dt", dt, "a positive number", lambda dt: 0.0 < dt < np.inf)
    expected = f"a step that the time {time:g} can resolve"
    check_number("dt", dt, expected, lambda dt: time + dt > time and 0.0 < dt * dt < np.inf)


def check_rates(problem: ContactProblem) -> None:
    """Reject a velocity that is not finite (collective).

    Raises:
        MortarError: On all ranks.
    """
    velocity = problem.equations.bulk.inertia.velocity
    velocity.x.scatter_forward()
    bad = int(np.count_nonzero(~np.isfinite(velocity.x.array)))
    if problem.equations.comm.allreduce(bad):
        raise MortarError("the velocity of Dynamics is not finite")


def rates_of(state: Any) -> Rates:
    """Rates of a state of a motion (local).

    Raises:
        ValueError: If it is not a state of a motion.
    """
    check_kind("before", state, State, "a state of the problem")
    if state.rates is None:
        raise ValueError("before has no velocity: expected a state of the motion")
    rates: Rates = state.rates
    return rates


def first_acceleration(problem: ContactProblem, inertia: Inertia) -> Array:
    """Accelerations that balance the forces, (local dofs,) [length / time^2] (collective).

    Those of nodes with prescribed motions are zero.

    Args:
        problem: The problem, with rates of which the acceleration is zero.
        inertia: Mass and velocity.
    """
    bulk, comm = problem.equations.bulk, problem.equations.comm
    remote: list[Any] = list(problem.equations.motions.remote)
    forces, contact, _ = problem.forces()
    total = forces + contact - sum(load.pushed_nodes() for load in remote if load not in bulk.bcs)
    w = inertia.acceleration_of(-total, bulk.prescribed)
    driven = [
        (load, np.isfinite(load.motion.load))
        for load in remote
        if load in bulk.bcs and np.isfinite(load.motion.load).any()
    ]
    if not driven:
        return w
    turning = [load.centripetal(inertia.velocity.x.array) for load, _ in driven]
    w = w + _followed(inertia, bulk, sum(turning))
    V = np.concatenate([load.nodal_motions()[on] for load, on in driven])
    fields = [_followed(inertia, bulk, motion) for motion in V]
    of_motions = [inertia.times_mass(field) for field in fields]
    at_present = inertia.times_mass(w) + inertia.carried(total)
    products = sum_over_ranks(comm, V @ np.column_stack([*of_motions, at_present]))
    push = np.concatenate([load.push()[on] for load, on in driven])
    a = np.linalg.solve(products[:, :-1], push - products[:, -1])
    return w + np.tensordot(a, np.array(fields), axes=1)


def _followed(inertia: Inertia, bulk: Any, on_boundary: Array) -> Array:
    """Accelerations ``on_boundary`` (owned dofs,), with those of free nodes without other forces.

    An array of all local dofs (collective).
    """
    given = inertia.with_ghosts(on_boundary)
    return given + inertia.acceleration_of(-inertia.times_mass(given), bulk.prescribed)
