# SPDX-License-Identifier: MIT
"""Newton's method for any equations: options, loop, damped steps, and the report of a solve."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from fenics_mortar.utils import errors, files
from fenics_mortar.utils.arrays import TINY

# Start of a note, and end of a note that represents several.
ITERATION, TIMES = re.compile(r"^iteration \d+: "), re.compile(r" \((\d+) times\)$")


@dataclass(frozen=True)
class Iteration:
    """Measures of one Newton iteration, equal on all ranks.

    Attributes:
        residual: Norm of all equations [force].
        gap: Largest mean gap of an active node over the node's length [1].
        increment: Displacement increment over displacement, largest values [1].
        fraction: Fraction of the increment that was applied [1].
        num_active: Size of the active set.
        num_changed: Nodes that entered or left the active set or changed their branch.
        seconds: Wall time by phase, on the slowest rank [s].
    """

    residual: float
    gap: float
    increment: float
    fraction: float
    num_active: int
    num_changed: int
    seconds: dict[str, float]


@dataclass
class NewtonReport(files.Markdown):
    """Record of one solve, complete on success and on failure; prints as a short Markdown table.

    One row for each Newton iteration, notes, and the outcome. All methods are local.

    Attributes:
        iterations: One row per iteration; row 0 is the state before the first linear system.
        notes: Messages on all deviations from full Newton steps.
        certificate: Measured defects of a converged state, a ``Certificate``.
        model_check: Estimated errors of the model's assumptions, a ``ModelReport``, if requested.
        force: Reference force of the residuals, the largest norm of the nodal forces in the
            iteration; not the contact force, see ``PairView.total_force`` [stress length].
        allowed: Residual at which the last iteration converges [stress length].
        converged: Whether the solve converged.
        reason: Outcome as text.
        solver: Linear solver and the reason for its choice, as text.
    """

    iterations: list[Iteration] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    certificate: Any = None
    model_check: Any = None
    force: float = 0.0
    allowed: float = 0.0
    converged: bool = False
    reason: str = "not started"
    solver: str = ""

    @property
    def num_iterations(self) -> int:
        """Number of linear systems solved."""
        return max(len(self.iterations) - 1, 0)

    @property
    def residuals(self) -> list[float]:
        """Residuals of all rows [force]."""
        return [iteration.residual for iteration in self.iterations]

    def followed_by(self, other: NewtonReport) -> NewtonReport:
        """Record of this solve and the next one, ``other``, with the outcome of the latter."""
        both = replace(
            other,
            iterations=self.iterations + other.iterations[1:],
            notes=merge_repeated([*self.notes, *other.notes]),
        )
        if both.converged:
            both.reason = f"converged in {both.num_iterations} iterations"
        return both

    def total_seconds(self) -> dict[str, float]:
        """Wall time of all iterations, by phase [s]."""
        phases = {name: 0.0 for it in self.iterations for name in it.seconds}
        return {name: sum(it.seconds.get(name, 0.0) for it in self.iterations) for name in phases}

    def table(self, *, phases: bool = False) -> str:
        """Markdown table, one row per iteration, notes, linear solver, and a line with the outcome.

        Residuals are relative to ``force``, the reference of the convergence test.

        Args:
            phases: Whether to show increments and seconds of each phase as well.
        """
        columns = self._columns()
        if phases:
            for name in self.total_seconds():
                seconds = [it.seconds.get(name, 0.0) for it in self.iterations]
                columns[f"{name} [s]"] = [f"{number:.4f}" for number in seconds]
        else:
            hidden = ["increment"]
            hidden += ["step"] if all(it.fraction == 1.0 for it in self.iterations) else []
            columns = {title: cells for title, cells in columns.items() if title not in hidden}
        rows = list(zip(*columns.values(), strict=True))
        if phases:
            sums = [f"{seconds:.4f}" for seconds in self.total_seconds().values()]
            blank = [""] * (len(columns) - len(sums) - 2)
            rows.append(("sum", *blank, f"{sum(self.total_seconds().values()):.3f}", *sums))
        lines = [files.markdown_table(list(columns), rows)]
        lines += ["", *(f"- {note}" for note in self.notes)] if self.notes else []
        if self.solver:
            lines.append(f"\nlinear solver: {self.solver}")
        return "\n".join([*lines, f"\n{self.reason}{self._judged_by()}"])

    def _columns(self) -> dict[str, list[str]]:
        """Cells of the table by title, without phases."""
        its, force = self.iterations, self.force if self.force > 0.0 else 1.0
        return {
            "it": [str(number) for number in range(len(its))],
            "residual / force": [f"{it.residual / force:.1e}" for it in its],
            "gap": [f"{it.gap:.1e}" for it in its],
            "increment": [*["–"][: len(its)], *(f"{it.increment:.1e}" for it in its[1:])],
            "step": [*["–"][: len(its)], *(f"{it.fraction:.2g}" for it in its[1:])],
            "active": [str(it.num_active) for it in its],
            "changed": [str(it.num_changed) for it in its],
            "seconds": [f"{sum(it.seconds.values()):.3f}" for it in its],
        }

    def _judged_by(self) -> str:
        """Reference force and allowed residual, as text."""
        if not self.force > 0.0:
            return ""
        scale = f"reference force {self.force:.3e} (norm of the nodal forces)"
        return f"; {scale}, allowed residual / force {self.allowed / self.force:.1e}"

    def __str__(self) -> str:
        """The table."""
        return self.table()


def merge_repeated(notes: Sequence[str]) -> list[str]:
    """Merge notes that differ only in the iteration; their number is appended."""
    first, counts = dict[str, str](), dict[str, int]()
    for note in notes:
        text, times = ITERATION.sub("", note), 1
        repeated = TIMES.search(text)
        if repeated:
            text, times = text[: repeated.start()], int(repeated[1])
        first.setdefault(text, TIMES.sub("", note))
        counts[text] = counts.get(text, 0) + times
    return [
        note if counts[text] == 1 else f"{note} ({counts[text]} times)"
        for text, note in first.items()
    ]


# A solve, whose record it returns.
Solve = Callable[[], NewtonReport]


def then_solve(report: NewtonReport, solve: Solve) -> NewtonReport:
    """The record followed by that of another solve; an error of the latter has both records."""
    try:
        return report.followed_by(solve())
    except errors.NotConvergedError as error:
        raise errors.NotConvergedError(str(error), report.followed_by(error.report)) from None


@dataclass(frozen=True)
class NewtonOptions:
    """Tolerances and limits of Newton's method, relative and independent of units; local.

    Attributes:
        max_iterations: Largest number of linear systems, of each attempt; twice as many in those
            that follow without success, with friction, adhesion or a user's law.
        residual_tolerance: Residual over the largest force so far [1].
        increment_tolerance: Largest displacement increment over the largest displacement, and that
            of each other field of a mixed function over its largest value [1].
        line_search: Halve steps that raise the residual; see ``Damped``.
        max_motion: Largest motion of a surface in one iteration over its shortest facet [1].
        tentative: Fail at once instead of trying fallbacks; the caller has another initial guess.
        max_remaining: Largest residual after the first iteration over the initial one [1]; the
            solve fails above it.

    Raises:
        ValueError: If an option has a value that is not allowed.
    """

    max_iterations: int = 30
    residual_tolerance: float = 1e-10
    increment_tolerance: float = 1e-6
    line_search: bool = False
    max_motion: float = np.inf
    tentative: bool = False
    max_remaining: float = np.inf

    def __post_init__(self) -> None:
        """Check the numbers."""
        expected = "a whole number, at least 1"
        errors.check_number(
            "max_iterations", self.max_iterations, expected, lambda n: n >= 1, whole=True
        )
        for what in ("residual_tolerance", "increment_tolerance"):
            value = getattr(self, what)
            errors.check_number(
                what, value, "a positive number", lambda number: 0.0 < number < np.inf
            )
        expected = "a positive number"
        errors.check_number(
            "max_remaining", self.max_remaining, expected, lambda number: number > 0.0
        )
        expected = "a positive number of facets"
        errors.check_number("max_motion", self.max_motion, expected, lambda number: number > 0.0)
        for what in ("line_search", "tentative"):
            errors.check_flag(what, getattr(self, what))

    @property
    def damped(self) -> bool:
        """Whether steps are damped by ``line_search`` or ``max_motion``."""
        return self.line_search or bool(np.isfinite(self.max_motion))


# Number of successive iterations with changing sets after which a cycle is assumed, unless the
# residual decreased tenfold: on fine meshes a contact zone shrinks by one node per iteration.
UNSETTLED = 12
# Largest relative residual of a linear solve [1] where a step begins: prescribed motions dominate
# the right-hand side, by some thousand times the contact forces that decide on the active sets.
MAX_FORCING = 5e-6
# Largest residual of a linear solve by multigrid while sets change, relative to the right-hand side
# and to the reference force [1]. Press of a half cylinder, 260,000 unknowns, three steps: 299
# applications with 5e-6, 203 with 1e-2, 26 iterations with both.
LOOSE_FORCING = 1e-2


@dataclass(frozen=True)
class Status:
    """Convergence measures of an iterate, equal on all ranks.

    Attributes:
        residual: Norm of all equations [force].
        force: Reference force of the residual at this state [force].
        gap: Largest mean gap of an active node over the node's length [1].
        num_active: Size of the active set.
        num_changed: Nodes that entered or left the active set or changed their branch.
        roundoff: Rounding of the residual at this state [force].
        sets: Hash of the sets, to detect cycles.
        fraction: Fraction of the last step that was applied [1].
    """

    residual: float
    force: float
    gap: float
    num_active: int
    num_changed: int
    roundoff: float
    sets: bytes = b""
    fraction: float = 1.0


class Step(NamedTuple):
    """One Newton step: increment over displacement [1], applied fraction [1], note."""

    increment: float
    fraction: float
    note: str = ""


class Remedies(Protocol):
    """Remedies for equations whose sets do not converge; all methods are collective."""

    def drifts(self) -> str:
        """Message on bodies that drift along free motions under small forces; "" if none do."""

    def merge_sets(self, period: int) -> str:
        """Break a cycle of the sets for one iteration; return a note."""


class Equations(Protocol):
    """Nonlinear equations with the two operations of an iteration, ``evaluate`` and ``advance``."""

    @property
    def remedies(self) -> Remedies:
        """Remedies if sets do not converge."""

    def evaluate(self, *, start: bool) -> Status:
        """Evaluate residual and sets at the present state (collective)."""

    def advance(self) -> Step:
        """Solve one linear system and update the state (collective)."""

    def seconds(self) -> dict[str, float]:
        """Wall time since the last call, by phase [s]."""

    def diagnose(self) -> str:
        """Message on defects of the state; "" if none are found (collective)."""


def solve(equations: Equations, options: NewtonOptions) -> NewtonReport:
    """Iterate until residual and increment are small and the sets are unchanged (collective).

    Args:
        equations: The equations; their state is updated.
        options: Tolerances and limits.

    Returns:
        The record.

    Raises:
        NotConvergedError: On all ranks, with the record so far.
        MortarError: On all ranks, if input is not finite at the initial state, or a user's function
            raised on one rank.
    """
    report = NewtonReport()
    step, sets, noted = Step(np.inf, 1.0), list[bytes](), set[str]()
    residuals: list[float] = []
    for number in range(options.max_iterations + 1):
        if number:
            try:
                step = equations.advance()
            except errors.RaisedElsewhereError:
                raise
            except errors.MortarError as error:
                raise _failure(equations, report, f"iteration {number}: {error}") from error
            if step.note and step.note not in noted:
                noted.add(step.note)
                report.notes.append(f"iteration {number}: {step.note}")
        try:
            status = equations.evaluate(start=number == 0)
        except errors.NotFiniteError as error:
            if not number:  # the initial state is the user's responsibility
                raise
            raise _failure(equations, report, f"iteration {number}: {error}") from error
        if status.fraction < 1.0:
            step = step._replace(fraction=step.fraction * status.fraction)
        report.force = max(report.force, status.force)
        report.allowed = allowed_residual(status, report.force, options)
        measures = status.residual, status.gap, step.increment, step.fraction
        sizes = status.num_active, status.num_changed
        report.iterations.append(Iteration(*measures, *sizes, equations.seconds()))
        if not math.isfinite(status.residual + status.force):
            raise _failure(equations, report, f"iteration {number}: the residual is not finite")
        if not any(_failed_tests(status, step, report.force, options)):
            report.converged = True
            report.reason = f"converged in {number} iterations"
            return report
        residuals.append(status.residual)
        if number == 1 and status.residual > options.max_remaining * residuals[0]:
            raise _failure(equations, report, "the first iteration hardly reduced the residual")
        if number and not status.num_changed and _stagnates(residuals):
            drifting = equations.remedies.drifts()
            if drifting:
                raise _failure(equations, report, drifting)
        sets = [*sets, status.sets] if status.num_changed else [status.sets]
        period = UNSETTLED if _is_stuck(sets, residuals) else period_of(sets)
        if period:
            note = f"iteration {number}: {equations.remedies.merge_sets(period)}"
            report.notes[:] = merge_repeated([*report.notes, note])
            sets = []
    failed = "; ".join(_failed_tests(status, step, report.force, options))
    reason = f"not converged in {options.max_iterations} iterations: {failed}"
    raise _failure(equations, report, reason)


def _stagnates(residuals: Sequence[float]) -> bool:
    """Whether the last two iterations together did not halve the residual."""
    return len(residuals) > 2 and residuals[-1] > 0.5 * residuals[-3]


def decreased(residual: float, before: float) -> bool:
    """Whether a residual decreased tenfold: sets then settle except for nodes at roundoff."""
    return residual < 0.1 * before


def _is_stuck(sets: list[bytes], residuals: list[float]) -> bool:
    """Whether the sets changed in many iterations and the residual did not decrease."""
    return len(sets) > UNSETTLED and not decreased(residuals[-1], residuals[-1 - UNSETTLED])


def period_of(sets: list[bytes]) -> int:
    """Length of a cycle that occurs twice at the end of ``sets``; 0 if there is none."""
    for period in range(2, len(sets) // 2 + 1):
        if sets[-period:] == sets[-2 * period : -period]:
            return period if len(set(sets[-period:])) > 1 else 0
    return 0


def forcing(
    residuals: Sequence[float], goal: float, force: float = 0.0, *, sets_change: bool = True
) -> float:
    """Relative tolerance of the next linear solve [1] (Eisenstat & Walker 1996).

    The linear residual may be a tenth of the expected nonlinear residual, of second order, or a
    hundredth of the tolerance of the iteration. In the first iteration with other sets the residual
    decreases by much more than in the last one, to which the order refers.

    Args:
        residuals: Residuals of the iterations so far [force].
        goal: Residual at which the iteration ends [force].
        force: Reference force, to allow linear residuals that are small beside it [force].
        sets_change: Whether the last iteration changed active sets or branches.
    """
    last, before = residuals[-1], residuals[-2] if len(residuals) > 1 else 0.0
    loosest = max(LOOSE_FORCING * min(force / max(last, TINY), 1.0), MAX_FORCING)
    expected = 0.1 * (last / before) ** 2 if before > 0.0 else loosest
    if not sets_change:
        expected = min(expected, MAX_FORCING)
    enough = 0.01 * goal / last if last > goal else 0.01
    return min(max(expected, enough), loosest)


def _failure(equations: Equations, report: NewtonReport, reason: str) -> errors.NotConvergedError:
    """Complete the record and return the error to raise (collective)."""
    report.reason = "; ".join(filter(None, (reason, equations.diagnose())))
    return errors.NotConvergedError(report.reason, report)


def allowed_residual(status: Status, force: float, options: NewtonOptions) -> float:
    """Largest residual of a converged state [force]."""
    return options.residual_tolerance * force + status.roundoff


def _failed_tests(
    status: Status, step: Step, force: float, options: NewtonOptions
) -> Iterator[str]:
    """Failed convergence tests, as text."""
    allowed = allowed_residual(status, force, options)
    if status.residual > allowed:
        yield f"residual {status.residual:.2e} (allowed {allowed:.2e})"
    if step.increment > options.increment_tolerance:
        yield f"increment {step.increment:.1e} (allowed {options.increment_tolerance:.1e})"
    if step.fraction < 1.0:
        yield f"last step shortened to the fraction {step.fraction:.1e}"
    if status.num_changed:
        yield f"{status.num_changed} nodes changed their status"


# Smallest fraction of a step [1] at which the line search halves the step again.
MIN_HALVED = 0.1


class Stateful(Equations, Protocol):
    """Equations whose state can be stored and restored; all methods are collective."""

    def state(self) -> Any:
        """The present state, an object with a method ``towards``."""

    def restore(self, state: Any) -> None:
        """Restore a state."""

    def interface_motion(self, before: Any) -> float:
        """Largest motion of a surface since a state, in facets [1]."""


class Damped:
    """Equations with damped steps; all methods are collective.

    Newton steps are damped by a line search on the residual, or by a limit of the surface motion.
    Both are off by default, see ``NewtonOptions``. A full step often raises the residual for one
    iteration, when nodes come into contact, and the next iterate is the solution; with a line
    search the active set would change one node at a time. A limit of the motion splits prescribed
    displacements of many facets into as many iterations. By default steps are limited only where
    cells would invert.

    Args:
        equations: The equations to solve.
        options: With ``line_search`` and ``max_motion``.
    """

    def __init__(self, equations: Stateful, options: NewtonOptions) -> None:
        self._equations, self._options = equations, options
        self.remedies = equations.remedies
        self.seconds, self.diagnose = equations.seconds, equations.diagnose
        self._residual = 0.0

    def advance(self) -> Step:
        """Solve one linear system; limit the motion of surfaces to ``max_motion`` facets."""
        self._before = self._equations.state()
        step = self._equations.advance()
        self._after = self._equations.state()
        motion = self._equations.interface_motion(self._before)
        if motion <= self._options.max_motion:
            return step
        fraction = self._options.max_motion / motion
        self._after = self._before.towards(self._after, fraction)
        self._equations.restore(self._after)
        return step._replace(fraction=fraction * step.fraction)

    def evaluate(self, *, start: bool) -> Status:
        """Evaluate the state; halve the last step while it raises the residual."""
        status, fraction = self._equations.evaluate(start=start), 1.0
        if self._options.line_search and not start:
            while not status.residual <= self._residual and fraction > MIN_HALVED:
                fraction *= 0.5
                self._equations.restore(self._before.towards(self._after, fraction))
                status = self._equations.evaluate(start=False)
        self._residual = status.residual
        return replace(status, fraction=fraction)
