# SPDX-License-Identifier: MIT
"""Adaptive load steps: failed steps are reverted and reduced, steps with few iterations grow.

Rotations of bodies within a step, from prescribed values at times between its ends.

The ends of a step tell the rotation of a body up to full turns: a shaft turned by 300 degrees looks
like one turned back by 60. Where loads are a function of the time, it is evaluated at times within
the step as well. The rotations of prescribed boundaries between these, each of less than half a
turn, are added up. The sizes of rotations are added, so that a turn to and fro is found as well.

Reasons for the end or a turning point of a path of equilibria, from its last state.

Two reasons for an end are certain. First, surfaces that slip off each other's edges lose their last
common length while a force still acts on it. Second, with large friction the equations of a small
step may have no solution (Klarbring 1990): near a state in which some nodes slide and no other node
is about to change, each of these nodes can only stick or continue to slide, so that the number of
possible linear problems is finite. If the solution of each violates its assumption, no nearby state
satisfies the law. In both cases a body would accelerate, and the next state of rest depends on
inertia.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_mortar.bulk.residual import MIN_FRACTION
from fenics_mortar.contact.arcs import MAX_ROTATION
from fenics_mortar.contact.contact import Contact, start_clock
from fenics_mortar.contact.law import STICK
from fenics_mortar.equations.arguments import EQUATIONS
from fenics_mortar.equations.general import Snapshot, State, as_interruption
from fenics_mortar.equations.linearized_contact import LinearizedContact
from fenics_mortar.equations.predictor import Predictor
from fenics_mortar.interface.mortar import LINEARIZATIONS
from fenics_mortar.newton.loop import NewtonReport
from fenics_mortar.path.report import IdleLoads, PathReport, PathStep, Progress, forces_of, work_of
from fenics_mortar.problem import ContactProblem
from fenics_mortar.rigid.proximal import RIGID
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import HALF_FACET, ROUNDING, Array, Indices, norms
from fenics_mortar.utils.errors import (
    MortarError,
    NotConvergedError,
    RaisedElsewhereError,
    call_together,
    check_flag,
    check_kind,
    check_number,
    check_same_texts,
    format_point,
    together,
)
from fenics_mortar.utils.ranks import agreed

if TYPE_CHECKING:
    from fenics_mortar.verify.node_paths import Turns

# Largest number n of sliding nodes for which all 2^n combinations of stick and slip are tried.
MAX_SLIDING = 8

# A pair and a slave node of it.
Place = tuple[Contact, int]


def reason_for_end(problem: ContactProblem) -> str:
    """Reason why there is no equilibrium next to a state; "" if uncertain (collective).

    Args:
        problem: At the last equilibrium, with slightly advanced loads; its state is restored.
    """
    return _reason(
        problem,
        lambda start: (
            agreed(problem.equations.comm, "; ".join(_slipping_off(problem)))
            or _deadlock(problem, start)
        ),
    )


def describe_turning_point(problem: ContactProblem) -> str:
    """Describe the turning point in a failed step; "" if there is none (collective).

    The equations are linearized at the last equilibrium. The result is "" if bodies float, since
    these are moved rigidly before a solve.

    Args:
        problem: At the last equilibrium, with the loads of the step; its state is restored.
    """
    if problem.equations.floating.bodies:
        return ""
    return _reason(problem, lambda _: _turning_point(problem))


def _reason(problem: ContactProblem, find: Callable[[State], str]) -> str:
    """Result of ``find`` for the present state, which is restored; "" if ``find`` fails."""
    start = problem.state()
    try:
        return find(start)
    except RaisedElsewhereError:
        raise
    except MortarError:
        return ""
    finally:
        problem.restore(start)


def _turning_point(problem: ContactProblem) -> str:
    """Turning point of the equations linearized at the start of the step (collective)."""
    equations = problem.equations
    equations.start_step()
    equations.evaluate(start=False)
    linearized = LinearizedContact(
        equations.bulk, equations.floating, equations.system, equations.motions
    )
    if not linearized.applies:
        return ""
    equations.bulk.assemble_tangent()
    return linearized.describe_turning_point()


def _slipping_off(problem: ContactProblem) -> Iterator[str]:
    """Describe pairs whose overlap vanishes under a force (local)."""
    for contact in problem.equations.contacts:
        if not (isinstance(contact, Contact) and contact.active.any() and not contact.obstacle):
            continue
        o = contact.operators
        overlap = float((o.cover / contact.slave.mean_thickness).sum())
        shortest = min(_shortest(o.slave.facets, o.x), _shortest(o.master.facets, o.m))
        if overlap < RIGID.sliver * shortest:
            j = int(np.argmax(np.where(contact.active, o.cover, -1.0)))
            force = float(norms(contact.total_force[None])[0])
            yield (
                f"'{contact.slave.name}' and '{contact.master.name}' slip off each other at "
                f"{format_point(o.x[j])}: their common length has decreased to {overlap:.1e} and "
                f"still transfers a force of {force:.3g}; there is no equilibrium beyond"
            )


def describe_jump(problem: ContactProblem, before: State) -> str:
    """Describe a jump since a state that no path of equilibria follows; "" if none (collective).

    Args:
        problem: The problem at the new state.
        before: The state at the start of the step.
    """
    comm = problem.equations.comm
    return agreed(comm, _past_each_other(problem, before)) or agreed(
        comm, _slid_away(problem, before)
    )


def _past_each_other(problem: ContactProblem, before: State) -> str:
    """Describe a jump of two bodies past each other since a state; "" if none (local).

    Points that were in contact at the start of the step are behind each other, and no contact
    remains.
    """
    for contact, then in zip(problem.equations.contacts, before.interfaces, strict=True):
        active = then.active
        if not (isinstance(contact, Contact) and active.any()) or contact.active.any():
            continue
        o = contact.operators
        behind = (
            np.einsum("ja,ja->j", o.n, contact.partners.gap_vectors(o))
            / contact.slave.nodal_lengths
        )
        j = int(np.argmax(np.where(active, behind, -np.inf)))
        if behind[j] > HALF_FACET:
            return (
                f"'{contact.slave.name}' and '{contact.master.name}' jumped past each other at "
                f"{format_point(o.x[j])}, by {behind[j]:.1f} facets in one step"
            )
    return ""


def _slid_away(problem: ContactProblem, before: State) -> str:
    """Describe a body that slid out of an equilibrium since a state; "" if none (collective).

    Friction supported the body at that state. Now no contact forces balance its loads, and it was
    moved rigidly. If another pair stops it, such as a wall, the new position is a state of rest. If
    only other nodes of the same pairs support it, its new position depends on the mesh.
    """
    equations = problem.equations
    states = dict(zip(map(id, equations.contacts), before.interfaces, strict=True))
    for body in equations.floating.settling.moved:
        pairs = equations.floating.contacts_of(body)
        loaded = [c for c in pairs if c.pair.law.has_friction and states[id(c)].z.any()]
        if not loaded or any(c.active.any() and not states[id(c)].z.any() for c in pairs):
            continue
        slips = [
            np.abs(np.where(states[id(c)].active, c.slip, 0.0)) / c.slave.nodal_lengths
            for c in loaded
        ]
        farthest = max(float(slip.max()) for slip in slips)
        if farthest > RIGID.overlap:
            return (
                "no contact forces at the nodes balance the loads on "
                f"{equations.floating.name_of(body.label)}, which friction supported before: it "
                f"slid by {farthest:.2f} facets in one step, and its rest depends on inertia; "
                f"finer facets may support more"
            )
    return ""


def _shortest(facets: Indices, x: Array) -> float:
    """Length of the shortest facet [length]."""
    return float(np.linalg.norm(x[facets[:, -1]] - x[facets[:, 0]], axis=1).min())


def _deadlock(problem: ContactProblem, start: State) -> str:
    """Describe the case in which all combinations of stick and slip violate the friction law."""
    if problem.equations.linearization != LINEARIZATIONS["full"]:
        return ""
    sliding = [
        (contact, j)
        for contact in problem.equations.contacts
        if isinstance(contact, Contact)
        for j in np.flatnonzero(contact.sliding).tolist()
    ]
    if not 0 < len(sliding) <= MAX_SLIDING:
        return ""
    fewest = sliding
    for choice in product((False, True), repeat=len(sliding)):
        violated = _violated_by(problem, start, [s for s, sticks in zip(sliding, choice) if sticks])
        if not violated or not set(violated) <= set(sliding):
            return ""
        fewest = min(fewest, violated, key=len)
    where = ", ".join(f"{format_point(contact.operators.x[j])}" for contact, j in fewest)
    return (
        f"{len(sliding)} nodes slide, and each of the {2 ** len(sliding)} combinations of stick "
        f"and slip violates the law of friction, at best only at {where}: no nearby state is in "
        f"equilibrium, and bodies would accelerate; friction is too large for a static solution"
    )


def _violated_by(problem: ContactProblem, start: State, sticking: list[Place]) -> list[Place]:
    """Nodes that violate the law after a step with fixed branches, nodes in ``sticking`` stick."""
    problem.restore(start)
    problem.equations.start_step()
    problem.equations.evaluate(start=False)
    contacts = [contact for contact in problem.equations.contacts if isinstance(contact, Contact)]
    for contact, before in zip(problem.equations.contacts, start.interfaces, strict=True):
        branch = before.branch.copy()
        branch[[j for other, j in sticking if other is contact]] = STICK
        contact.change(z=before.z, active=before.active, branch=branch, heading=None)
    assumed = [(contact.active, contact.branch) for contact in contacts]
    problem.equations.advance()
    violated = []
    for contact, (active, branch) in zip(contacts, assumed, strict=True):
        contact.evaluate(problem.equations.bulk.u.x.array, problem.equations.linearization)
        contact.update_active()
        changed = (contact.active != active) | (active & (contact.branch != branch))
        violated += [(contact, j) for j in np.flatnonzero(changed).tolist()]
    return violated


# Times within a step, over its length [1]. They are not evenly spaced, so that at a constant rate
# no number of full turns in the step is a number of full turns between all of them.
WITHIN = (0.11, 0.36, 0.68)


class PrescribedTurns:
    """Rotations that loads prescribe within a step; all methods are collective.

    Args:
        problem: The problem.
        set_loads: Function that sets loads and prescribed values for a time, on all ranks.
    """

    def __init__(self, problem: ContactProblem, set_loads: Callable[[float], None]) -> None:
        equations = problem.equations
        self._bulk, self._floating, self._set_loads = equations.bulk, equations.floating, set_loads
        self._outline, self._led = equations.crossings.outline, equations.crossings.led

    @contextmanager
    def of_step(self, start: float, stop: float) -> Iterator[None]:
        """Context of a step, in which the turns of prescribed values are known; see ``set_loads``.

        Args:
            start: Time of the present state [time].
            stop: Time at the end of the step [time].
        """
        self.set_loads(start, stop)
        self._led.examined = True
        try:
            yield
        finally:
            self._led.examined = False

    def set_loads(self, start: float, stop: float) -> None:
        """Set the loads of the end of a step; refuse steps in which bodies turn far.

        Args:
            start: Time of the present state [time].
            stop: Time at the end of the step [time].

        Raises:
            NotConvergedError: On all ranks, if one side of a pair turns by more than
                ``MAX_ROTATION`` relative to the other one; obstacles turn by known angles.
            Exception: Any error of the function, also at times within the step.
        """
        if not self._led.may_turn:
            return self._set_loads(stop)
        times = [start + fraction * (stop - start) for fraction in WITHIN]
        knots = [self._outline.positions(self._bulk.u.x.array), *map(self._moved, [*times, stop])]
        turns = [self._led.turns(*ends) for ends in pairwise(knots)]
        for sides in sorted(self._led.sides):
            self._refuse(sides, turns)
        return None

    def _moved(self, time: float) -> Array:
        """Set the loads; positions with the prescribed values, shape (n, d) [length]."""
        self._set_loads(time)
        values = self._bulk.u.x.array.copy()
        compat.set_prescribed(values, self._bulk.bcs)
        return self._outline.positions(values)

    def _refuse(self, sides: tuple[int, int], turns: list[Turns]) -> None:
        """Raise an error if one of two bodies turns too far relative to the other one."""
        relative = np.array([np.linalg.norm(self._led.relative(sides, turn)) for turn in turns])
        nearest = np.abs(np.arctan2(np.sin(relative), np.cos(relative)))
        total = float(nearest.sum())
        if total > MAX_ROTATION:

            def turned(side: int) -> float:
                return sum(float(np.linalg.norm(turn[side])) for turn in turns if side in turn)

            turning = self._floating.name_of(max(sides, key=turned))
            reason = (
                f"{turning} turns by at least {np.degrees(total):.0f} degrees in the step; the "
                "ends tell the direction of slip and the bodies passed up to "
                f"{np.degrees(MAX_ROTATION):.0f} degrees only: take smaller steps"
            )
            raise NotConvergedError(reason, NewtonReport(reason=reason))


@dataclass(frozen=True)
class SteppingOptions:
    """Options of adaptive load steps; times are in units of the path parameter.

    Attributes:
        step: Size of the first step [time]; ``largest`` if this is smaller.
        smallest: Smallest step size [time]: failure of such a step ends the path.
        largest: Largest step size [time]; ``step`` if ``None``.
        easy: Number of Newton iterations up to which the next step grows.
        growth: Factor by which the next step grows [1]; to a length that failed after 1, 2, 4, ...
            more steps if it fails again.
        cut: Factor by which a failed step is reduced [1].
        predict: Whether initial guesses are extrapolated, see ``predictor``.

    Raises:
        ValueError: If a value is not allowed.
    """

    step: float
    smallest: float = 1e-6
    largest: float | None = None
    easy: int = 6
    growth: float = EQUATIONS.longest
    cut: float = 0.5
    predict: bool = True

    def __post_init__(self) -> None:
        """Reject values that are not allowed (local)."""
        expected = "0 < smallest <= step and largest, growth at least 1, cut between 0 and 1"
        largest = self.step if self.largest is None else self.largest
        for name, value, allows in (
            ("step", self.step, lambda step: 0.0 < step < np.inf),
            ("smallest", self.smallest, lambda smallest: 0.0 < smallest <= self.step),
            ("largest", largest, lambda largest: largest >= self.smallest),
            ("growth", self.growth, lambda growth: growth >= 1.0),
            ("cut", self.cut, lambda cut: 0.0 < cut < 1.0),
        ):
            check_number(name, value, expected, allows)
        check_number("easy", self.easy, "a number of iterations", lambda easy: easy >= 0)
        check_flag("predict", self.predict)
        object.__setattr__(self, "step", min(self.step, largest))


# Steps nearly as long as one that failed, over its length, which fail for the same reason [1].
SAME_LENGTH = 0.9
# Accepted steps after which a length that failed is tried again: a path that could take longer
# steps has at most so many short ones. One attempt in seventeen is little beside its steps.
LONGEST_PAUSE = 16


class StepLengths:
    """Growth of steps: a length that failed is tried again after 0, 1, 2, 4, ... accepted steps.

    Where all steps of some length fail, as those in which a body turns too far, few are tried. A
    failure of a shorter step has another reason: it begins anew. All methods are local.
    """

    def __init__(self) -> None:
        self._failed, self._wait, self._left, self._cut = np.inf, 0, 0, False

    def cut(self, step: float) -> None:
        """Note that a step of this length [time] failed; of several in turn the last one counts."""
        if step <= SAME_LENGTH * self._failed:
            self._wait = 0
        elif not self._cut:
            self._wait = min(max(2 * self._wait, 1), LONGEST_PAUSE)
        self._failed, self._left, self._cut = step, self._wait, True

    def following(self, step: float, longest: float) -> float:
        """Length [time] of the step after an accepted one, which may grow to ``longest``."""
        self._cut = False
        if step >= self._failed:
            self._failed, self._wait, self._left = np.inf, 0, 0
        if longest < self._failed or not self._left:
            return longest
        self._left -= 1
        return step


# Hint used if the reason for the end of a path is not certain.
HINT = (
    "If smaller steps do not help, the path may have a turning point or a jump here, as where an "
    "arch snaps through or a tip slips off an edge: prescribe another displacement, or start the "
    "path beyond this point"
)
# Further one if cells invert. Before they do, stresses of St. Venant-Kirchhoff fall.
SOFT = (
    ". A material whose stress stays finite in cells that are compressed to nothing, as "
    "St. Venant-Kirchhoff's, gives way before they invert: take fm.energies.neo_hookean"
)


def follow_path(
    problem: ContactProblem,
    set_loads: Callable[[float], None],
    options: SteppingOptions,
    *,
    start: float = 0.0,
    stop: float = 1.0,
    on_step: Callable[[float, NewtonReport], None] | None = None,
) -> PathReport:
    """Solve from ``start`` to ``stop`` in adaptive steps (collective).

    Args:
        problem: The problem, solved or unloaded at ``start``.
        set_loads: Function that sets loads and prescribed values for a time [time]; called again
            for an earlier time after a failure, and for times within each step if prescribed values
            may turn a body. It is called on all ranks and must set equal
            values on all of them.
        options: Options of the steps.
        start: Time of the present state, in units of the path parameter [time].
        stop: Final time [time].
        on_step: Function called with time and report after each accepted step, for example to write
            results.

    Returns:
        The record of the path.

    Raises:
        NotConvergedError: If a step of the smallest size fails, or ends in a state that violates
            its certificate. Displacement and multipliers are those of the last accepted step;
            ``report`` is the ``PathReport``.
        Exception: Any error of ``set_loads`` or ``on_step``; a ``MortarError`` on ranks where they
            did not raise.
        BaseException: An interruption, e.g. a KeyboardInterrupt. The state is that of the last
            accepted step; a note of the error has its time.
        ValueError: If an argument is of another type, or ``start`` is beyond ``stop``. If both are
            equal, for example if a finished path is resumed, no step is taken.
        MortarError: On all ranks, if options differ between ranks.

    Note:
        Rank 0 logs each step and each cut, see ``report``::

            logging.basicConfig()
            logging.getLogger("fenics_mortar").setLevel(logging.INFO)
    """
    check_kind("problem", problem, ContactProblem, "a ContactProblem")
    with together(problem.equations.comm, "follow_path"):
        _check_path(set_loads, options, start, stop, on_step)
    given = {"options": options, "start": start, "stop": stop, "on_step": on_step is not None}
    check_same_texts(problem.equations.comm, "follow_path", given)
    path, time, step = PathReport(), start, options.step
    start_clock(problem.equations.contacts, start)
    largest, lengths = options.largest or options.step, StepLengths()
    predictor = Predictor(problem.equations, start)
    forces, last = forces_of(problem), [(start, Snapshot(problem.equations))]
    idle = IdleLoads(problem)

    def load(time: float) -> None:
        problem.time = time
        call_together(problem.equations.comm, "set_loads", partial(set_loads, time))

    turns, shown = PrescribedTurns(problem, load), Progress(problem.equations.comm)
    with _kept(last):
        while time < stop:
            step = min(step, stop - time)
            if stop - time - step < ROUNDING * step:
                step = stop - time
            accepted = predictor.last
            try:
                may_cut = step > options.smallest
                solve = partial(_solve_soundly, problem, accepted, may_cut)
                attempt = predictor.attempt(time + step, solve, guesses=options.predict)
                with turns.of_step(time, time + step), attempt as finish:
                    report = finish()
            except NotConvergedError as failure:
                path.failures.append(failure.report)
                problem.restore(accepted)
                shown.cut(time + step, str(failure), failure.report)
                if step <= options.smallest:
                    turning_point = describe_turning_point(problem)
                    load(min(time + MIN_FRACTION * options.step, stop))
                    path.dead_end = reason_for_end(problem) or turning_point
                    load(time)
                    message = _end_of_path(time, step, path.dead_end, failure)
                    raise NotConvergedError(message, path) from failure
                lengths.cut(step)
                step = max(options.cut * step, options.smallest)
                continue
            before_forces, forces = forces, forces_of(problem)
            work = work_of(problem, accepted, predictor.last, before_forces, forces)
            time = stop if step == stop - time else time + step
            last[0] = time, Snapshot(problem.equations)
            path.steps.append(PathStep(time, step, report, path.failures, work))
            path.failures = []
            idle.look()
            shown.accept(time, report)
            if on_step is not None:
                call_together(problem.equations.comm, "on_step", partial(on_step, time, report))
            growth = options.growth if report.num_iterations <= options.easy else 1.0
            step = lengths.following(step, min(growth * step, largest))
    path.finished, path.notes = True, idle.remarks(len(path.steps))
    return path


def _check_path(set_loads: Any, options: Any, start: Any, stop: Any, on_step: Any) -> None:
    """Reject arguments of ``follow_path`` (local)."""
    if not callable(set_loads):
        raise ValueError(f"set_loads={set_loads!r}: expected a function of the time")
    expected = "an instance of SteppingOptions, such as SteppingOptions(step=0.1)"
    check_kind("options", options, SteppingOptions, expected)
    for name, value in (("start", start), ("stop", stop)):
        check_number(name, value, "a finite number", np.isfinite)
    if start > stop:
        raise ValueError(
            f"start={start!r} is beyond stop={stop!r}: times increase; to unload, reduce the "
            f"loads with time in set_loads"
        )
    if on_step is not None and not callable(on_step):
        raise ValueError(f"on_step={on_step!r}: expected a function of time and report, or None")


@contextmanager
def _kept(last: list[tuple[float, Snapshot]]) -> Iterator[None]:
    """Context of a path: any error but a failed solve restores the last accepted step.

    ``last``: its time, and the problem at this time; both are replaced by one assignment.
    """
    try:
        yield
    except NotConvergedError:
        raise
    except BaseException as error:
        ours = isinstance(error, MortarError) and not isinstance(error, RaisedElsewhereError)
        time, before = last[0]
        before.revert(renew=not ours)
        interruption = as_interruption(error)
        interruption.add_note(
            f"the problem is at time {time:.6g} of the path, its last accepted step"
        )
        if interruption is error:
            raise
        raise interruption from error


def _end_of_path(time: float, step: float, why: str, failure: NotConvergedError) -> str:
    """Message at the end of a path: time, step and reason."""
    if why:
        return f"the path ends at {time:.6g}: {why}. A step of {step:.1e} fails; {failure}"
    hint = HINT + SOFT * ("are inverted, one" in str(failure))
    return f"the path ends at {time:.6g}: a step of {step:.1e} fails; {failure}. {hint}"


def _solve_soundly(problem: ContactProblem, before: State, may_cut: bool) -> NewtonReport:
    """Solve; refuse states that violate their certificate or lie beyond a jump (collective).

    While the step may be cut, states that bodies may have reached by a passage are refused as well:
    in smaller steps bodies turn less, and their motion is known.
    """
    report = problem.solve(accept_violations=True, predict=False, may_cut=may_cut)
    doubts = report.certificate.possible_passages if may_cut else []
    wrong = "; ".join([*report.certificate.violations(), *doubts])
    wrong = wrong or describe_jump(problem, before)
    if wrong:
        report.converged, report.reason = False, f"converged to a wrong state: {wrong}"
        raise NotConvergedError(report.reason, report)
    return report
