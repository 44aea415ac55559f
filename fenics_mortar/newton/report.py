# SPDX-License-Identifier: MIT
"""The report of a solve: one row for each Newton iteration, notes, and the outcome."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from fenics_mortar.utils.errors import NotConvergedError
from fenics_mortar.utils.files import Markdown, markdown_table

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
class NewtonReport(Markdown):
    """Record of one solve, complete on success and on failure; prints as a short Markdown table.

    All methods are local.

    Attributes:
        iterations: One row per iteration; row 0 is the state before the first linear system.
        notes: Messages on all deviations from full Newton steps.
        certificate: Measured defects of a converged state, a ``Certificate``.
        model_check: Estimated errors of the model's assumptions, an ``ModelReport``, if requested.
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
        """Linear systems solved."""
        return max(len(self.iterations) - 1, 0)

    @property
    def residuals(self) -> list[float]:
        """Residuals of all rows [force]."""
        return [iteration.residual for iteration in self.iterations]

    def followed_by(self, other: NewtonReport) -> NewtonReport:
        """Record of this solve and the next one, ``other``, with the outcome of the latter."""
        return replace(
            other,
            iterations=self.iterations + other.iterations[1:],
            notes=merge_repeated([*self.notes, *other.notes]),
        )

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
            total = f"{sum(self.total_seconds().values()):.3f}"
            rows.append(("sum", *blank, total, *sums))
        lines = [markdown_table(list(columns), rows)]
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


def then_solve(report: NewtonReport, solve: Callable[[], NewtonReport]) -> NewtonReport:
    """The record followed by that of another solve; its error has the joint record, too."""
    try:
        return report.followed_by(solve())
    except NotConvergedError as error:
        raise NotConvergedError(str(error), report.followed_by(error.report)) from None
