# SPDX-License-Identifier: MIT
"""Load stepping that adapts: a failed step is taken back and cut, easy ones grow."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.equations.state import State
from fenics_mortar.equations.undo import Before
from fenics_mortar.newton.loop import NewtonOptions, NewtonReport, after
from fenics_mortar.path.dead_end import why_it_is_a_jump, why_path_ends
from fenics_mortar.path.predictor import Predictor
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arguments import check_flag, check_kind, check_number
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import (
    MortarError,
    NotConvergedError,
    RaisedElsewhereError,
    call_together,
    check_same_words,
    together,
)

# What is left of the path below this part of a step is taken with the step.
REMAINDER = 1e-6
# Part of the first step by which loads go on to ask why a path ends.
ONWARD = 1e-3
# What the end of a path may mean.
HINT = (
    "If smaller steps do not help, the path may turn or jump here, as where an arch snaps through "
    "or a tip slips off an edge: prescribe another displacement, or start beyond"
)
Forces = tuple[Array, Array, Array, Array, Array]


@dataclass(frozen=True)
class SteppingOptions:
    """How the steps adapt; times are in units of the path's parameter.

    Attributes:
        step: First step.
        smallest: A step that fails at this size or below ends the path.
        largest: Largest step; ``step`` if ``None``.
        easy: A step of at most so many Newton iterations lets the next one grow.
        growth: Factor by which it grows.
        cut: Factor by which a failed step is cut.
        predict: Whether a step may begin where the last two states lead, see ``predictor``.
    """

    step: float
    smallest: float = 1e-6
    largest: float | None = None
    easy: int = 6
    growth: float = 2.0
    cut: float = 0.5
    predict: bool = True

    def __post_init__(self) -> None:
        """Refuse what cannot work."""
        right = (
            "0 < smallest <= step <= largest, growth at least 1, cut between 0 and 1 are allowed"
        )
        largest = self.step if self.largest is None else self.largest
        for name, value, allows in (
            ("step", self.step, lambda step: 0.0 < step < np.inf),
            ("smallest", self.smallest, lambda smallest: 0.0 < smallest <= self.step),
            ("largest", largest, lambda largest: largest >= self.step),
            ("growth", self.growth, lambda growth: growth >= 1.0),
            ("cut", self.cut, lambda cut: 0.0 < cut < 1.0),
        ):
            check_number(name, value, right, allows)
        check_number("easy", self.easy, "a number of iterations", lambda easy: easy >= 0)
        check_flag("predict", self.predict)


class Work(NamedTuple):
    """Work done in a step, by the trapezoidal rule over it [stress length^2].

    Attributes:
        bulk: What the bodies store, less the work of applied loads.
        supports: Of the reactions.
        contact: Of the contact forces.
        friction: Of their shears: what friction takes up.
        largest: What contact forces would do if all of them acted along the way that their nodes
            and obstacles go: the sum of the sizes of forces times those of motions.
    """

    bulk: float
    supports: float
    contact: float
    friction: float = 0.0
    largest: float = 0.0

    @property
    def pressure(self) -> float:
        """Of the pressures [stress length^2].

        Closed gaps take up nothing: this is the energy that the discretisation adds. It vanishes
        with the size of facets and steps, slowly where a corner slides, under which the pressure
        has no bound.
        """
        return self.contact - self.friction

    @property
    def defect(self) -> float:
        """Work of the pressures over the largest of all.

        Under dead loads on supports at rest nothing but contact does any work that is seen here:
        what bodies store is what loads do, less that of contact. So it is compared with what its
        forces could do on the way that they go; in sliding that is the friction that facets add.
        """
        return abs(self.pressure) / max(*map(abs, self), 1e-300)


@dataclass(frozen=True)
class PathStep:
    """One accepted step: where it ended, how long it was, its record, and those that failed."""

    time: float
    step: float
    report: NewtonReport
    failures: list[NewtonReport]
    work: Work


@dataclass
class PathReport:
    """What happened along a path: kept on success and on failure.

    Attributes:
        steps: The accepted steps.
        failures: Records of the failed attempts at the step after the last accepted one.
        finished: Whether the end was reached.
        dead_end: Why there is no equilibrium beyond its last step, if that is sure; else "".
    """

    steps: list[PathStep] = field(default_factory=list)
    failures: list[NewtonReport] = field(default_factory=list)
    finished: bool = False
    dead_end: str = ""

    @property
    def num_iterations(self) -> int:
        """Linear systems solved in all, in failed attempts too."""
        return sum(r.num_iterations for s in self.steps for r in (s.report, *s.failures)) + sum(
            r.num_iterations for r in self.failures
        )

    @property
    def num_cuts(self) -> int:
        """Attempts that failed."""
        return sum(len(step.failures) for step in self.steps) + len(self.failures)

    def table(self) -> str:
        """Markdown table, one row per accepted step, and why attempts failed.

        The last column is ``Work.defect``.
        """
        lines = [
            "| step | time | size | iterations | active | cuts | contact work |",
            "|---:|---:|---:|---:|---:|---:|---:|",
        ]
        reasons = []
        for number, step in enumerate(self.steps, start=1):
            active = step.report.iterations[-1].num_active
            cells = [f"{number}", f"{step.time:.6g}", f"{step.step:.3g}"]
            cells += [f"{step.report.num_iterations}", f"{active}", f"{len(step.failures)}"]
            cells += [f"{step.work.defect:.1e}"]
            lines.append(f"| {' | '.join(cells)} |")
            reasons += [f"- step {number}: {failure.reason}" for failure in step.failures]
        reasons += [f"- step {len(self.steps) + 1}: {failure.reason}" for failure in self.failures]
        return "\n".join([*lines, *(["", *reasons] if reasons else [])])

    def __str__(self) -> str:
        """The table."""
        return self.table()


def follow_path(
    problem: ContactProblem,
    set_loads: Callable[[float], None],
    options: SteppingOptions,
    *,
    start: float = 0.0,
    stop: float = 1.0,
    on_step: Callable[[float, NewtonReport], None] | None = None,
    print_steps: bool = False,
) -> PathReport:
    """Solve from ``start`` to ``stop`` in steps that adapt (collective).

    Args:
        problem: The problem, solved at ``start`` (or unloaded there).
        set_loads: Sets loads and prescribed values for a time; may be called again for an earlier
            one after a failure.
        options: How the steps adapt.
        start: Time of the present state.
        stop: Time at which to end.
        on_step: Called after each accepted step, for example to write results.
        print_steps: Whether rank 0 prints a line per step.

    Returns:
        The record of all steps.

    Raises:
        NotConvergedError: If a step of the smallest size fails, or ends in a state that violates
            its certificate. Displacement and multipliers are those of the last accepted step then;
            ``report`` is the ``PathReport``.
        Exception: What ``set_loads`` or ``on_step`` raised; a ``MortarError`` on ranks where they
            did not.
        BaseException: What interrupted it, as a KeyboardInterrupt. The state is that of the last
            accepted step then; a note at the error says at which time that was.
        ValueError: If an argument is of another kind, or ``start`` is beyond ``stop``. Where they
            are equal, as at the end of a path that is taken up again, there is no step to take.
        MortarError: On all ranks, if options differ between them.
    """
    check_kind("problem", problem, ContactProblem, "a ContactProblem")
    with together(problem.comm, "follow_path"):
        _check_path(set_loads, options, start, stop, on_step)
    given = {"options": options, "start": start, "stop": stop, "on_step": on_step is not None}
    check_same_words(problem.comm, "follow_path", given)
    path, time, step = PathReport(), start, options.step
    largest = options.largest or options.step
    predictor = Predictor(problem, start, guesses=options.predict)
    forces, kept = _forces(problem), Before(problem.equations, problem.adequacy)
    ways = _Ways(problem)

    def load(time: float) -> None:
        call_together(problem.comm, "set_loads", partial(set_loads, time))

    while time < stop:
        step = min(step, stop - time)
        if stop - time - step < REMAINDER * step:
            step = stop - time
        accepted = predictor.last
        with _kept(kept, time):
            load(time + step)
            try:
                report = predictor.solve(
                    time + step, partial(_solve_soundly, problem, ways, accepted)
                )
            except NotConvergedError as failure:
                path.failures.append(failure.report)
                problem.restore(accepted)
                _say(problem, print_steps, f"time {time + step:.6g}: cut, {failure}")
                if step <= options.smallest:
                    load(min(time + ONWARD * options.step, stop))
                    path.dead_end = why_path_ends(problem)
                    load(time)
                    words = _last_words(time, step, path.dead_end, failure)
                    raise NotConvergedError(words, path) from failure
                step = max(options.cut * step, options.smallest)
                continue
            before_forces, forces = forces, _forces(problem)
            work = _work(problem, accepted, predictor.last, before_forces, forces)
        time, kept = (
            (stop if step == stop - time else time + step),
            Before(problem.equations, problem.adequacy),
        )
        path.steps.append(PathStep(time, step, report, path.failures, work))
        path.failures = []
        _say(problem, print_steps, f"time {time:.6g}: {report.reason}")
        if on_step is not None:
            call_together(problem.comm, "on_step", partial(on_step, time, report))
        if report.num_iterations <= options.easy:
            step = min(options.growth * step, largest)
    path.finished = True
    return path


def _check_path(set_loads: Any, options: Any, start: Any, stop: Any, on_step: Any) -> None:
    """Refuse arguments of ``follow_path`` (local)."""
    if not callable(set_loads):
        raise ValueError(f"set_loads={set_loads!r}: a function of the time")
    right = "an instance of SteppingOptions, as SteppingOptions(step=0.1)"
    check_kind("options", options, SteppingOptions, right)
    for name, value in (("start", start), ("stop", stop)):
        check_number(name, value, "a finite number", np.isfinite)
    if start > stop:
        raise ValueError(
            f"start={start!r} is beyond stop={stop!r}: times grow; to unload, let set_loads lessen "
            "the loads with time"
        )
    if on_step is not None and not callable(on_step):
        raise ValueError(f"on_step={on_step!r}: a function of the time and the record, or None")


@contextmanager
def _kept(before: Before, time: float) -> Iterator[None]:
    """A step of which nothing is left if anything but a failed solve ends it."""
    try:
        yield
    except NotConvergedError:
        raise
    except BaseException as error:
        ours = isinstance(error, MortarError) and not isinstance(error, RaisedElsewhereError)
        before.take_back(renew=not ours)
        error.add_note(f"the problem is at time {time:.6g} of the path, its last accepted step")
        raise


def _last_words(time: float, step: float, why: str, failure: NotConvergedError) -> str:
    """Where a path ends and why."""
    if why:
        return f"the path ends at {time:.6g}: {why}. A step of {step:.1e} fails; {failure}"
    return f"the path ends at {time:.6g}: a step of {step:.1e} fails; {failure}. {HINT}"


class _Ways:
    """Whole steps and damped ones: the way that led to the end last comes first, then the other.

    Laws of the user's own may be as steep or as little monotonous as they like, and whole steps go
    to and fro about a kink of theirs. A line search finds the way between, where else only short
    load steps would. The laws of this package know their pieces, for them it does not pay.
    """

    def __init__(self, problem: ContactProblem) -> None:
        self._problem, self._damps_first = problem, False
        self._has_choice = any(map(_has_own_law, problem.equations.contacts))

    def solve(self) -> NewtonReport:
        """Solve; if that fails, once more in the other way (collective)."""
        problem, options = self._problem, self._problem.newton
        if not self._has_choice or options.damped or options.tentative:
            return problem.solve(accept_violations=True)
        start = problem.state()
        try:
            return self._solve(options)
        except NotConvergedError as failure:
            problem.restore(start)
            self._damps_first = not self._damps_first
            lost, how = failure.report, "damped" if self._damps_first else "whole"
            lost.notes.append(f"begun anew with {how} steps: {failure}")
        return after(lost, partial(self._solve, options))

    def _solve(self, options: NewtonOptions) -> NewtonReport:
        try:
            self._problem.newton = replace(options, line_search=self._damps_first)
            return self._problem.solve(accept_violations=True)
        finally:
            self._problem.newton = options


def _has_own_law(contact: Any) -> bool:
    """Whether it is a contact whose law is not one of this package."""
    return isinstance(contact, Contact) and not contact.pair.law.is_of_package


def _solve_soundly(problem: ContactProblem, ways: _Ways, before: State) -> NewtonReport:
    """Solve; neither a state that violates its certificate is accepted, nor a jump to it."""
    report = ways.solve()
    wrong = "; ".join(report.certificate.violations()) or why_it_is_a_jump(problem, before)
    if wrong:
        report.converged, report.reason = False, f"converged to a wrong state: {wrong}"
        raise NotConvergedError(report.reason, report)
    return report


def _forces(problem: ContactProblem) -> Forces:
    """Of bulk and contact, on obstacles, and what of the last two is shear (collective)."""
    return *problem.forces(), *problem.equations.shear_forces()


def _work(problem: ContactProblem, start: State, end: State, before: Forces, after: Forces) -> Work:
    """Work of the mean forces in a step (collective). What holds obstacles counts as a support."""
    means = (0.5 * (a + b) for a, b in zip(before, after, strict=True))
    r, contact, on_tools, shear, shear_on_tools = means
    du, prescribed = (end.u - start.u)[: r.size], problem.equations.bulk.held
    supports = (r + contact)[prescribed] @ du[prescribed]
    work = problem.comm.allreduce(np.array([r @ du, supports, contact @ du, shear @ du]))
    moved = problem.equations.tools.motions_of(end.places - start.places)
    work[1:3] += (on_tools * moved).sum()
    work[3] += (shear_on_tools * moved).sum()
    dofs = problem.equations.bulk.space.owned_dofs
    sizes = np.linalg.norm(contact[dofs], axis=1) @ np.linalg.norm(du[dofs], axis=1)
    largest = problem.comm.allreduce(float(sizes)) + np.abs(on_tools * moved).sum()
    of_bulk, of_supports, of_contact, of_friction = map(float, work)
    return Work(of_bulk, of_supports, of_contact, of_friction, float(largest))


def _say(problem: ContactProblem, wanted: bool, line: str) -> None:
    """Print a line on rank 0."""
    if wanted and problem.comm.rank == 0:
        print(line, flush=True)
