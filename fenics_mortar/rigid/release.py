# SPDX-License-Identifier: MIT
"""Bodies and obstacles that roll or slide: springs hold them, and let go little by little.

Where contact hardly resists a motion, as a polygon's that rolls from facet to facet, the joint
Newton step along it is far too long. Here springs tie the bodies to where they are; a solve with
them converges, then they are tied to where it ended, and so on until the bodies stay: the proximal
point method (Rockafellar 1976). For forces with a potential each solve lowers it, so it ends in a
well and on no ridge. The last solve is without springs.

Contact forces on facets have no exact potential, though: they act along averaged normals. A disk
that may roll and slide is driven by what these err, and may have no equilibrium near by. Then the
springs stay, if they are weak, and the record tells how weak. On a body that slides on all of its
nodes with friction they may not stay: there they would end a steady slide.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, Protocol

from fenics_mortar.newton.loop import Equations, solve
from fenics_mortar.newton.options import NewtonOptions
from fenics_mortar.newton.report import NewtonReport, after
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.utils.errors import NotConvergedError

# Travel in one solve that springs aim at, and that which ends them, in shortest facets.
TRAVEL, ARRIVED = 0.25, 0.01
# The part of it that is tried after a failure, and how it grows again.
LESS, MORE = 0.125, 2.0
# After so many failures in a row springs are as stiff as the bodies, and then: the part of their
# travel after a failure, and how it grows. A solve that takes more iterations has too weak ones.
STIFF_AFTER, STIFF_LESS, STIFF_MORE, STIFF_ITERATIONS = 2, 0.1, 3.0, 20
MOST_SOLVES, MOST_FAILURES = 24, 5
# Springs that stay are tied anew so often: what contact can carry it does then.
REPEATS = 3
# Accuracy of the solves with springs: the last one has that of the user.
ROUGH = 1e-6


class Remaining(NamedTuple):
    """Forces that springs carry.

    Attributes:
        fraction: Largest force of springs over the contact force on a body or obstacle [1].
        sliding: The largest on those that slide on all of their nodes with friction [1].
        words: A sentence on each.
    """

    fraction: float
    sliding: float
    words: str


class AnchoredSprings(Protocol):
    """Springs that can hold bodies and obstacles; all collective."""

    def hold(self, travel: float) -> None:
        """Tie floating bodies and driven obstacles to where they are.

        The forces that drive a body now, or a small fraction of all forces on it, would strain its
        springs by ``travel`` shortest facets.
        """

    def let_go(self) -> None:
        """Remove the springs."""

    def stiff_travel(self) -> float:
        """The travel at which springs are as stiff as the bodies, in shortest facets."""

    def travel(self) -> float:
        """Largest rigid motion since ``hold``, in shortest facets."""

    def remaining(self) -> Remaining:
        """Forces that springs carry over contact forces."""


class Held(Equations, Protocol):
    """Equations with bodies or obstacles that springs can hold; all collective."""

    @property
    def springs(self) -> AnchoredSprings:
        """The springs."""

    def state(self) -> Any:
        """Copy the present state."""

    def restore(self, state: Any) -> None:
        """Go back to a state."""


def release_slowly(
    equations: Held, options: NewtonOptions, failed: NotConvergedError
) -> NewtonReport:
    """Solve with springs, and at last without or with weak ones (collective).

    Args:
        equations: What to solve, at the state to start from.
        options: Of the last solve.
        failed: What a solve without springs ended with.

    Returns:
        The record of all iterations, those of ``failed`` included.

    Raises:
        NotConvergedError: On all ranks.
    """
    report = _move_on_springs(equations, options, failed)
    arrived = equations.state()
    equations.springs.let_go()
    try:
        return after(report, partial(solve, equations, options))
    except NotConvergedError as error:
        equations.restore(arrived)
        again = NotConvergedError(failed.report.reason, error.report)
        return hold_here(equations, options, again, repeats=REPEATS)


def hold_here(
    equations: Held,
    options: NewtonOptions,
    failed: NotConvergedError,
    *,
    repeats: int = 1,
    most: float = RIGID.negligible,
) -> NewtonReport:
    """Solve with weak springs that stay (collective).

    Args:
        equations: What to solve, near a state that nothing but slight forces moves on.
        options: Of the solves.
        failed: What a solve without springs ended with.
        repeats: How often springs are tied anew.
        most: Largest force of springs over the contact force on a body [1]; on bodies that slide on
            all of their nodes with friction ``RIGID.slight``.

    Returns:
        The record of all iterations, those of ``failed`` included.

    Raises:
        NotConvergedError: On all ranks, if a solve fails or springs hold more.
    """
    report = failed.report
    for _ in range(repeats):
        equations.springs.hold(TRAVEL)
        report = after(report, partial(solve, equations, options))
    held = equations.springs.remaining()
    if held.fraction > most:
        raise NotConvergedError(f"{failed}; {held.words}", report) from failed
    if held.sliding > RIGID.slight:
        words = f"{held.words}; all of its nodes slide at their friction limit"
        raise NotConvergedError(f"{failed}; {words}", report) from failed
    report.notes.append(held.words)
    return report


def _move_on_springs(
    equations: Held, options: NewtonOptions, failed: NotConvergedError
) -> NewtonReport:
    """Solve with springs until they are hardly strained any more, or long enough."""
    rough = replace(options, residual_tolerance=max(ROUGH, options.residual_tolerance))
    report, aim, failures, less, more = failed.report, TRAVEL, 0, LESS, MORE
    for _ in range(MOST_SOLVES):
        start = equations.state()
        equations.springs.hold(aim)
        try:
            report = after(report, partial(solve, equations, rough))
        except NotConvergedError as error:
            report, aim, failures = error.report, less * aim, failures + 1
            equations.restore(start)
            if failures == MOST_FAILURES:
                raise NotConvergedError(failed.report.reason, report) from error
            if failures == STIFF_AFTER and less == LESS:
                aim, less, more = equations.springs.stiff_travel(), STIFF_LESS, STIFF_MORE
                few = min(STIFF_ITERATIONS, options.max_iterations)
                rough = replace(rough, max_iterations=few)
            continue
        if equations.springs.travel() < ARRIVED * aim / TRAVEL:
            break
        aim, failures = min(more * aim, TRAVEL), 0
    return report
