# SPDX-License-Identifier: MIT
"""Load steps of a path: adaptive sizes, reasons for the end of the path.

``follow_path`` takes adaptive load steps: failed steps are reverted and reduced, steps with few
iterations grow. ``reason_for_end`` and ``describe_turning_point`` examine the last state of a path.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial, wraps
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_mortar.bulk.residual import MIN_FRACTION
from fenics_mortar.contact.contact import Contact, start_clock
from fenics_mortar.contact.law import STICK
from fenics_mortar.equations.arguments import EQUATIONS
from fenics_mortar.equations.general import Kept, Snapshot, State, restored_if_interrupted
from fenics_mortar.equations.linearized_contact import LinearizedContact
from fenics_mortar.equations.predictor import Predictor
from fenics_mortar.equations.turns import loads_of_step
from fenics_mortar.interface.mortar import LINEARIZATIONS
from fenics_mortar.obstacles.rigid_motion import RIGID
from fenics_mortar.path.report import (
    PathReport,
    PathStep,
    forces_of,
    log_solve,
    remarks_on_idle,
    values_to_set,
    work_of,
)
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils import errors, ranks
from fenics_mortar.utils.arrays import EPSILON, HALF_FACET, ROUNDING, Array, Indices, norms

if TYPE_CHECKING:
    from fenics_mortar.newton.loop import NewtonReport

# Largest number n of sliding nodes for which all 2^n combinations of stick and slip are tried.
MAX_SLIDING = 8

# A pair and a slave node of it.
Place = tuple[Contact, int]


def _restored(find: Callable[[ContactProblem], str]) -> Callable[[ContactProblem], str]:
    """Result of ``find`` for the present state, which is restored; "" if ``find`` fails."""

    @wraps(find)
    def found(problem: ContactProblem) -> str:
        start = problem.state()
        try:
            return find(problem)
        except errors.RaisedElsewhereError:
            raise
        except errors.MortarError:
            return ""
        finally:
            problem.restore(start)

    return found


@_restored
def reason_for_end(problem: ContactProblem) -> str:
    """Reason why there is no equilibrium next to a state; "" if uncertain (collective).

    Two reasons are certain. First, surfaces that slip off each other's edges lose their last common
    length while a force still acts on it. Second, with large friction the equations of a small step
    may have no solution (Klarbring 1990): near a state in which some nodes slide and no other node
    is about to change, each of these nodes can only stick or continue to slide, so that the number
    of possible linear problems is finite. If the solution of each violates its assumption, no
    nearby state satisfies the law. In both cases a body would accelerate, and the next state of
    rest depends on inertia.

    Args:
        problem: At the last equilibrium, with slightly advanced loads; its state is restored.
    """
    slipping = ranks.agreed(problem.equations.comm, "; ".join(_slipping_off(problem)))
    return slipping or _deadlock(problem)


@_restored
def describe_turning_point(problem: ContactProblem) -> str:
    """Describe the turning point in a failed step; "" if there is none (collective).

    The equations are linearized at the last equilibrium. The result is "" if bodies float, since
    these are moved rigidly before a solve.

    Args:
        problem: At the last equilibrium, with the loads of the step; its state is restored.
    """
    e = problem.equations
    if e.floating.bodies:
        return ""
    e.start_step()
    e.evaluate(start=False)
    linearized = LinearizedContact(e)
    if not linearized.applies:
        return ""
    e.bulk.assemble_tangent()
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
                f"{errors.format_point(o.x[j])}: their common length has decreased to "
                f"{overlap:.1e} and still transfers a force of {force:.3g}; there is no "
                "equilibrium beyond"
            )


def describe_jump(problem: ContactProblem, before: State) -> str:
    """Describe a jump since a state that no path of equilibria follows; "" if none (collective).

    Args:
        problem: The problem at the new state.
        before: The state at the start of the step.
    """
    comm = problem.equations.comm
    passed = ranks.agreed(comm, _past_each_other(problem, before))
    return passed or ranks.agreed(comm, _slid_away(problem, before))


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
        vectors, lengths = contact.partners.gap_vectors(o), contact.slave.nodal_lengths
        behind = np.einsum("ja,ja->j", o.n, vectors) / lengths
        j = int(np.argmax(np.where(active, behind, -np.inf)))
        if behind[j] > HALF_FACET:
            return (
                f"'{contact.slave.name}' and '{contact.master.name}' jumped past each other at "
                f"{errors.format_point(o.x[j])}, by {behind[j]:.1f} facets in one step"
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
        pairs = body.contacts
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
                f"{body.name}, which friction supported before: it "
                f"slid by {farthest:.2f} facets in one step, and its rest depends on inertia; "
                f"finer facets may support more"
            )
    return ""


def _shortest(facets: Indices, x: Array) -> float:
    """Length of the shortest facet [length]."""
    return float(np.linalg.norm(x[facets[:, -1]] - x[facets[:, 0]], axis=1).min())


def _deadlock(problem: ContactProblem) -> str:
    """Describe the case in which all combinations of stick and slip violate the friction law."""
    start = problem.state()
    if problem.equations.linearization != LINEARIZATIONS["full"]:
        return ""
    sliding = [
        (contact, j)
        for contact in problem.equations.floating.contacts
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
    where = ", ".join(f"{errors.format_point(contact.operators.x[j])}" for contact, j in fewest)
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
    contacts = problem.equations.floating.contacts
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
            errors.check_number(name, value, expected, allows)
        errors.check_number("easy", self.easy, "a number of iterations", lambda easy: easy >= 0)
        errors.check_flag("predict", self.predict)
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
    errors.check_kind("problem", problem, ContactProblem, "a ContactProblem")
    with errors.together(problem.equations.comm, "follow_path"):
        check_steps(options, on_step)
        if not callable(set_loads):
            raise ValueError(f"set_loads={set_loads!r}: expected a function of the time")
        for name, value in (("start", start), ("stop", stop)):
            errors.check_number(name, value, "a finite number", np.isfinite)
        if start > stop:
            raise ValueError(
                f"start={start!r} is beyond stop={stop!r}: times increase; to unload, reduce the "
                f"loads with time in set_loads"
            )
    given = {"options": options, "start": start, "stop": stop, "on_step": on_step is not None}
    errors.check_same_texts(problem.equations.comm, "follow_path", given)
    start_clock(problem.equations.contacts, start)
    steps = _LoadSteps(problem, (start, stop), options, set_loads)
    path: PathReport = steps.run(on_step)
    path.notes = remarks_on_idle(problem, len(path.steps), changed=steps.changed)
    path.finished = True
    return path


def check_steps(options: Any, on_step: Any) -> None:
    """Reject options of another type, and an ``on_step`` that is no function (local)."""
    expected = "an instance of SteppingOptions, such as SteppingOptions(step=0.1)"
    errors.check_kind("options", options, SteppingOptions, expected)
    if on_step is not None and not callable(on_step):
        raise ValueError(f"on_step={on_step!r}: expected a function of time and report, or None")


class Steps(ABC):
    """Steps to a given time: failed ones are reverted and cut; all methods are collective.

    Args:
        problem: The problem.
        ends: Times of the present state and of the last one [time].
        options: Sizes of the steps.
        set_loads: Function of the user that sets loads for a time [time], or ``None``.

    Attributes:
        report: Record of the steps; to be set by derived classes.
        forces: Forces at the end of the last step, see ``forces_of``.
    """

    report: Any

    def __init__(
        self, problem: ContactProblem, ends: tuple[float, float], options: SteppingOptions,
        set_loads: Any,
    ) -> None:  # fmt: skip
        self.problem, self.options, self.ends, self._set_loads = problem, options, ends, set_loads
        self.forces = forces_of(problem)

    def load(self, time: float) -> None:
        """Set the loads of a time [time]; errors of the user's function are raised on all ranks."""
        self.problem.time = time
        errors.call_together(
            self.problem.equations.comm, "set_loads", partial(self._set_loads, time)
        )

    @abstractmethod
    def attempt(self, time: float, step: float) -> NewtonReport:
        """Solve for the end of a step that starts at a time; its record.

        Raises:
            NotConvergedError: On all ranks, if a smaller step is to be taken.
        """

    @abstractmethod
    def accept(self, time: float, step: float, newton: NewtonReport) -> float:
        """Add a step that ends at a time to the report; the longest next one [time]."""

    @abstractmethod
    def explain(self, time: float, step: float, failure: errors.NotConvergedError) -> str:
        """Message on the end of the steps at a time, after one of the smallest size failed."""

    def run(self, on_step: Callable[[float, NewtonReport], None] | None) -> Any:
        """Take the steps, see ``follow_path``; the report."""
        problem, options, taken = self.problem, self.options, self.report
        (time, stop), step, lengths = self.ends, options.step, StepLengths()
        equations, comm = problem.equations, problem.equations.comm

        def accepted(time: float) -> Kept:
            return Snapshot(equations), f"the problem is at time {time:.6g}, its last accepted step"

        with restored_if_interrupted(equations) as kept:
            while time < stop:
                kept[0] = accepted(time)
                step = min(step, stop - time)
                rounded = len(taken.steps) * EPSILON * abs(stop)  # as the sum of many steps is
                if stop - time - step < max(ROUNDING * step, rounded):
                    step = stop - time
                try:
                    given = equations, self.load, time, time + step
                    with nullcontext() if self._set_loads is None else loads_of_step(*given):
                        newton = self.attempt(time, step)
                except errors.NotConvergedError as failure:
                    problem.restore(kept[0][0].state)
                    taken.failures.append(failure.report)
                    log_solve(comm, f"time {time + step:.6g}: cut, {failure}", failure.report)
                    if step <= options.smallest:
                        message = self.explain(time, step, failure)
                        raise errors.NotConvergedError(message, taken) from failure
                    lengths.cut(step)
                    step = max(options.cut * step, options.smallest)
                    continue
                time = stop if step == stop - time else time + step
                longest = self.accept(time, step, newton)
                taken.failures = []
                kept[0] = accepted(time)
                number = len(taken.steps)
                log_solve(comm, f"step {number}, time {time:.6g}: {newton.reason}", newton)
                if on_step is not None:
                    errors.call_together(comm, "on_step", partial(on_step, time, newton))
                step = lengths.following(step, longest)
        return taken


class _LoadSteps(Steps):
    """Load steps of ``follow_path``; arguments: see ``Steps``."""

    def __init__(self, problem: ContactProblem, *given: Any) -> None:
        super().__init__(problem, *given)
        self.report, self._first, self.changed = PathReport(), values_to_set(problem), False
        self._predictor = Predictor(problem.equations, self.ends[0])

    def attempt(self, time: float, step: float) -> NewtonReport:
        """Solve for the end of a step that starts at a time; its record."""
        self._accepted = self._predictor.last
        solve = partial(_solve_soundly, self.problem, self._accepted, step > self.options.smallest)
        guesses = self.options.predict
        with self._predictor.attempt(time + step, solve, guesses=guesses) as finish:
            return finish()

    def accept(self, time: float, step: float, newton: NewtonReport) -> float:
        """Add a step that ends at a time to the report; the longest next one [time]."""
        before, self.forces = self.forces, forces_of(self.problem)
        work = work_of(self.problem, self._accepted, self._predictor.last, before, self.forces)
        self.report.steps.append(PathStep(time, step, newton, self.report.failures, work))
        if not self.changed:
            pairs = zip(self._first, values_to_set(self.problem), strict=True)
            self.changed = not all(np.array_equal(a, b) for a, b in pairs)
        options = self.options
        growth = options.growth if newton.num_iterations <= options.easy else 1.0
        return min(growth * step, options.largest or options.step)

    def explain(self, time: float, step: float, failure: errors.NotConvergedError) -> str:
        """Why the path ends at a time; sets ``dead_end`` of the report."""
        turning_point = describe_turning_point(self.problem)
        self.load(min(time + MIN_FRACTION * self.options.step, self.ends[1]))
        why = self.report.dead_end = reason_for_end(self.problem) or turning_point
        self.load(time)
        if why:
            return f"the path ends at {time:.6g}: {why}. A step of {step:.1e} fails; {failure}"
        hint = HINT + SOFT * ("are inverted, one" in str(failure))
        return f"the path ends at {time:.6g}: a step of {step:.1e} fails; {failure}. {hint}"


def _solve_soundly(problem: ContactProblem, before: State, may_cut: bool) -> NewtonReport:
    """Solve; refuse states that violate their certificate or lie beyond a jump (collective).

    While the step may be cut, states that bodies may have reached by a passage are refused as well:
    in smaller steps bodies turn less, and their motion is known.
    """
    newton = problem.solve(accept_violations=True, predict=False, may_cut=may_cut)
    doubts = newton.certificate.possible_passages if may_cut else []
    wrong = "; ".join([*newton.certificate.violations(), *doubts])
    wrong = wrong or describe_jump(problem, before)
    if wrong:
        newton.converged, newton.reason = False, f"converged to a wrong state: {wrong}"
        raise errors.NotConvergedError(newton.reason, newton)
    return newton
