# SPDX-License-Identifier: MIT
"""The record of a load path."""

from __future__ import annotations

from dataclasses import dataclass, field

from fenics_mortar.newton.report import NewtonReport
from fenics_mortar.path.work import Work
from fenics_mortar.utils.files import Markdown


@dataclass(frozen=True)
class PathStep:
    """One accepted step.

    Attributes:
        time: Time at the end of the step [time].
        step: Size of the step [time].
        report: Record of its solve.
        failures: Records of failed attempts at larger steps.
        work: Work done in the step.
    """

    time: float
    step: float
    report: NewtonReport
    failures: list[NewtonReport]
    work: Work


@dataclass
class PathReport(Markdown):
    """Record of a path, complete on success and on failure; prints as a Markdown table.

    All methods are local.

    Attributes:
        steps: The accepted steps: see ``PathStep``.
        failures: Records of failed attempts at the step after the last accepted one.
        finished: Whether the end of the path was reached.
        dead_end: Reason why no equilibrium exists beyond the last step, if this is certain; else
            "".
        notes: Remarks on the whole path.
    """

    steps: list[PathStep] = field(default_factory=list)
    failures: list[NewtonReport] = field(default_factory=list)
    finished: bool = False
    dead_end: str = ""
    notes: list[str] = field(default_factory=list)

    @property
    def num_iterations(self) -> int:
        """Number of linear systems solved, including failed attempts."""
        return sum(r.num_iterations for s in self.steps for r in (s.report, *s.failures)) + sum(
            r.num_iterations for r in self.failures
        )

    @property
    def num_cuts(self) -> int:
        """Number of failed attempts."""
        return sum(len(step.failures) for step in self.steps) + len(self.failures)

    def table(self) -> str:
        """Markdown table, one row per accepted step, reasons of failures, and remarks.

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
        reasons += [f"- {note}" for note in self.notes]
        return "\n".join([*lines, *(["", *reasons] if reasons else [])])

    def __str__(self) -> str:
        """The table."""
        return self.table()
