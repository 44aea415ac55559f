# SPDX-License-Identifier: MIT
"""Load stepping that adapts: a failed step is taken back and cut, easy ones grow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fenics_mortar.dead_end import why_it_is_a_jump, why_path_ends
from fenics_mortar.equations import State
from fenics_mortar.errors import MortarError, NotConvergedError, call_together
from fenics_mortar.files import make_folder, try_together, without_suffix
from fenics_mortar.newton import NewtonReport
from fenics_mortar.options import check_flag, check_number
from fenics_mortar.predictor import Predictor
from fenics_mortar.problem import ContactProblem
from fenics_mortar.surfaces import Array

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
# What of a contact is written to a file.
KEPT = ("z", "active", "carries", "piece")


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
    """

    bulk: float
    supports: float
    contact: float
    friction: float = 0.0

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
        """Work of the pressures over the largest of all."""
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
        """Markdown table, one row per accepted step, and why attempts failed."""
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
    """
    path, time, step = PathReport(), start, options.step
    largest = options.largest or options.step
    predictor = Predictor(problem, start, guesses=options.predict)
    forces = _forces(problem)

    def load(time: float) -> None:
        call_together(problem.comm, "set_loads", partial(set_loads, time))

    while time < stop:
        step = min(step, stop - time)
        if stop - time - step < REMAINDER * step:
            step = stop - time
        load(time + step)
        accepted = predictor.last
        try:
            report = predictor.solve(time + step, partial(_solve_soundly, problem, accepted))
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
        time = stop if step == stop - time else time + step
        path.steps.append(PathStep(time, step, report, path.failures, work))
        path.failures = []
        _say(problem, print_steps, f"time {time:.6g}: {report.reason}")
        if on_step is not None:
            call_together(problem.comm, "on_step", partial(on_step, time, report))
        if report.num_iterations <= options.easy:
            step = min(options.growth * step, largest)
    path.finished = True
    return path


def _last_words(time: float, step: float, why: str, failure: NotConvergedError) -> str:
    """Where a path ends and why."""
    if why:
        return f"the path ends at {time:.6g}: {why}. A step of {step:.1e} fails; {failure}"
    return f"the path ends at {time:.6g}: a step of {step:.1e} fails; {failure}. {HINT}"


def _solve_soundly(problem: ContactProblem, before: State) -> NewtonReport:
    """Solve; neither a state that violates its certificate is accepted, nor a jump to it."""
    report = problem.solve()
    wrong = "; ".join(report.certificate.violations()) or why_it_is_a_jump(problem, before)
    if wrong:
        report.converged, report.reason = False, f"converged to a wrong state: {wrong}"
        raise NotConvergedError(report.reason, report)
    return report


def _forces(problem: ContactProblem) -> Forces:
    """Of bulk and contact, on obstacles, and what of the last two is shear (collective)."""
    return *problem.forces(), *problem.shear_forces()


def _work(problem: ContactProblem, start: State, end: State, before: Forces, after: Forces) -> Work:
    """Work of the mean forces in a step (collective). What holds obstacles counts as a support."""
    means = (0.5 * (a + b) for a, b in zip(before, after, strict=True))
    r, contact, on_tools, shear, shear_on_tools = means
    du, held = (end.u - start.u)[: r.size], problem.bulk.held
    supports = (r + contact)[held] @ du[held]
    work = problem.comm.allreduce(np.array([r @ du, supports, contact @ du, shear @ du]))
    moved = problem.tools.motions_of(end.places - start.places)
    work[1:3] += (on_tools * moved).sum()
    work[3] += (shear_on_tools * moved).sum()
    return Work(*map(float, work))


def _say(problem: ContactProblem, wanted: bool, line: str) -> None:
    """Print a line on rank 0."""
    if wanted and problem.comm.rank == 0:
        print(line, flush=True)


def save_state(problem: ContactProblem, path: str | Path) -> None:
    """Write displacement, multipliers, active sets and obstacles' places as .npz (collective).

    It can be read on any number of ranks: nodes are known by their number in the mesh's input.

    Raises:
        MortarError: On all ranks, if the file cannot be written.
    """
    file = _state_file(problem, path)
    make_folder(problem.comm, file.parent)
    nodes, values = problem.bulk.by_input_node()
    data = {"nodes": nodes, "u": values, "places": problem.tools.places}
    for i, contact in enumerate(problem.contacts):
        data |= {f"{name}{i}": getattr(contact, name) for name in KEPT}
    write, first = partial(np.savez, file, **data), problem.comm.rank == 0
    try_together(problem.comm, first, write, f"cannot write '{file}'")


def load_state(problem: ContactProblem, path: str | Path) -> None:
    """Read what ``save_state`` wrote into a problem on the same mesh (collective).

    Raises:
        MortarError: On all ranks, if there is no such file, or it is that of another problem.
    """
    file = _state_file(problem, path)
    first, message = problem.comm.rank == 0, f"cannot read '{file}'"
    data = try_together(problem.comm, first, partial(_read_arrays, file), message)
    data = problem.comm.bcast(data)
    expected = {f"{k}{i}": getattr(c, k) for i, c in enumerate(problem.contacts) for k in KEPT}
    expected["places"] = problem.tools.places
    for name, mine in expected.items():
        if name not in data or data[name].shape != mine.shape:
            raise MortarError(
                f"'{file}' is the state of a problem with other pairs, or on another mesh or "
                f"degree: see '{name}'"
            )
    problem.bulk.set_by_input_node(data["nodes"], data["u"])
    kept: dict[str, Any] = {
        name: [data[f"{name}{i}"] for i in range(len(problem.contacts))] for name in KEPT
    }
    problem.restore(replace(problem.state(), **kept, places=data["places"], converged=True))
    problem.accept()


def _state_file(problem: ContactProblem, path: str | Path) -> Path:
    """Numpy writes to names that end in .npz only (collective)."""
    stem = without_suffix(problem.comm, path, ".npz")
    return stem.with_name(f"{stem.name}.npz")


def _read_arrays(file: Path) -> dict[str, Array]:
    """All arrays of an .npz file, without pickled objects."""
    with np.load(file) as arrays:
        return dict(arrays)
