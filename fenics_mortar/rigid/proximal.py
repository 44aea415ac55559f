# SPDX-License-Identifier: MIT
"""Bodies and obstacles that roll or slide: the proximal point method with springs.

Where contact hardly resists a motion, as a polygon's that rolls from facet to facet, the joint
Newton step along it is far too long. Here springs anchor the bodies; a solve with
them converges, then they are anchored where it ended, and so on until the bodies stay: the proximal
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

# Elongation of springs in one solve that is aimed at, and that which ends them [shortest facets].
ELONGATION, ARRIVED = 0.25, 0.01
# The part of it that is tried after a failure, and how it grows again.
LESS, MORE = 0.125, 2.0
# After so many failures in a row springs are as stiff as the bodies, and then: the part of their
# elongation after a failure, and how it grows. A solve of more iterations has too weak springs.
STIFF_AFTER, STIFF_LESS, STIFF_MORE, STIFF_ITERATIONS = 2, 0.1, 3.0, 20
MOST_SOLVES, MOST_FAILURES = 24, 5
# Springs that stay are anchored anew so often: what contact can carry it does then.
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
    """Springs that can anchor bodies and obstacles; all collective."""

    def anchor(self, elongation: float) -> None:
        """Anchor floating bodies and driven obstacles at their present positions.

        The forces that drive a body now, or a small fraction of all forces on it, would elongate
        its springs by ``elongation`` shortest facets.
        """

    def remove_springs(self) -> None:
        """Remove the springs."""

    def stiff_elongation(self) -> float:
        """The elongation at which springs are as stiff as the bodies, in shortest facets."""

    def max_motion(self) -> float:
        """Largest rigid motion since ``anchor``, in shortest facets."""

    def remaining(self) -> Remaining:
        """Forces that springs carry over contact forces."""


class WithSprings(Equations, Protocol):
    """Equations with bodies or obstacles that springs can anchor; all collective."""

    @property
    def springs(self) -> AnchoredSprings:
        """The springs."""

    def state(self) -> Any:
        """Copy the present state."""

    def restore(self, state: Any) -> None:
        """Go back to a state."""


def solve_with_springs(
    equations: WithSprings, options: NewtonOptions, failed: NotConvergedError
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
    equations.springs.remove_springs()
    try:
        return after(report, partial(solve, equations, options))
    except NotConvergedError as error:
        equations.restore(arrived)
        again = NotConvergedError(failed.report.reason, error.report)
        return solve_with_weak_springs(equations, options, again, repeats=REPEATS)


def solve_with_weak_springs(
    equations: WithSprings,
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
        repeats: How often springs are anchored anew.
        most: Largest force of springs over the contact force on a body [1]; on bodies that slide on
            all of their nodes with friction ``RIGID.slight``.

    Returns:
        The record of all iterations, those of ``failed`` included.

    Raises:
        NotConvergedError: On all ranks, if a solve fails or springs carry more.
    """
    report = failed.report
    for _ in range(repeats):
        equations.springs.anchor(ELONGATION)
        report = after(report, partial(solve, equations, options))
    carried = equations.springs.remaining()
    if carried.fraction > most:
        raise NotConvergedError(f"{failed}; {carried.words}", report) from failed
    if carried.sliding > RIGID.slight:
        words = f"{carried.words}; all of its nodes slide at their friction limit"
        raise NotConvergedError(f"{failed}; {words}", report) from failed
    report.notes.append(carried.words)
    return report


def _move_on_springs(
    equations: WithSprings, options: NewtonOptions, failed: NotConvergedError
) -> NewtonReport:
    """Solve with springs until they are hardly strained any more, or long enough."""
    rough = replace(options, residual_tolerance=max(ROUGH, options.residual_tolerance))
    report, aim, failures, less, more = failed.report, ELONGATION, 0, LESS, MORE
    for _ in range(MOST_SOLVES):
        start = equations.state()
        equations.springs.anchor(aim)
        try:
            report = after(report, partial(solve, equations, rough))
        except NotConvergedError as error:
            report, aim, failures = error.report, less * aim, failures + 1
            equations.restore(start)
            if failures == MOST_FAILURES:
                raise NotConvergedError(failed.report.reason, report) from error
            if failures == STIFF_AFTER and less == LESS:
                aim, less, more = equations.springs.stiff_elongation(), STIFF_LESS, STIFF_MORE
                few = min(STIFF_ITERATIONS, options.max_iterations)
                rough = replace(rough, max_iterations=few)
            continue
        if equations.springs.max_motion() < ARRIVED * aim / ELONGATION:
            break
        aim, failures = min(more * aim, ELONGATION), 0
    return report
