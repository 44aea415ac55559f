# SPDX-License-Identifier: MIT
"""The proximal point method for bodies and obstacles that roll or slide, with anchored springs.

If contact hardly resists a rigid motion, for instance of a polygon that rolls from facet to facet,
a Newton step along it is far too long. Anchored springs limit the step: a solve with springs
converges, the springs are anchored at the new positions, and so on until the bodies come to rest
(proximal point method, Rockafellar 1976). With conservative forces each solve decreases the
potential, and the method converges to a minimum. The last solve is without springs.

Contact forces on facets are not exactly conservative, since they act along averaged normals. The
error may drive a rolling disk, which then has no equilibrium nearby. In this case weak springs
remain, and the report states their force. Springs may not remain on a body whose nodes with
friction all slide, since they would stop a steady slide.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np

from fenics_mortar.newton.loop import Equations, NewtonOptions, solve
from fenics_mortar.newton.report import NewtonReport, then_solve
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.utils.errors import NotConvergedError
from fenics_mortar.utils.rounding import SOLVED


class Remaining(NamedTuple):
    """Forces of anchored springs.

    Attributes:
        fraction: Largest force of springs over the contact force on a body or obstacle [1].
        sliding: Largest such force on bodies whose nodes with friction all slide [1].
        message: A sentence with the names of all these bodies and obstacles.
    """

    fraction: float
    sliding: float
    message: str


class AnchoredSprings(Protocol):
    """Springs on floating bodies and driven obstacles; all methods are collective."""

    def anchor(self, elongation: float) -> None:
        """Anchor floating bodies and driven obstacles at their present positions.

        The forces that drive a body now, or a small fraction of all forces on it, would elongate
        its springs by ``elongation`` shortest facets.
        """

    def remove_springs(self) -> None:
        """Remove the springs."""

    def max_motion(self) -> float:
        """Largest rigid motion since ``anchor`` [shortest facets]."""

    def remaining(self) -> Remaining:
        """Forces of springs relative to contact forces."""


class WithSprings(Equations, Protocol):
    """Equations with anchored springs on bodies and obstacles; all methods are collective."""

    @property
    def springs(self) -> AnchoredSprings:
        """The springs."""

    def state(self) -> Any:
        """The present state, as a value."""

    def restore(self, state: Any) -> None:
        """Restore a state."""


def solve_with_springs(
    equations: WithSprings, options: NewtonOptions, failed: NotConvergedError
) -> NewtonReport:
    """Solve with springs, and finally without springs or with weak ones (collective).

    Args:
        equations: The equations, at the initial state.
        options: Options of the last solve.
        failed: Error of the solve without springs.

    Returns:
        The record of all iterations, including those of ``failed``.

    Raises:
        NotConvergedError: On all ranks, if the bodies do not come to rest.
    """
    begin = equations.state()
    report = _move_on_springs(equations, options, failed, failed.report)
    arrived, carried = equations.state(), equations.springs.remaining().fraction
    try:
        return _solve_without(equations, options, report)
    except NotConvergedError as error:
        report = error.report
    if carried > RIGID.negligible:
        equations.restore(arrived if carried < np.inf else begin)
        try:
            report = _move_on_springs(equations, options, failed, report, balanced=True)
            arrived = equations.state()
            return _solve_without(equations, options, report)
        except NotConvergedError as error:
            report = error.report
    equations.restore(arrived)
    again = NotConvergedError(failed.report.reason, report)
    return solve_with_weak_springs(equations, options, again, repeats=RIGID.repeats)


def solve_with_weak_springs(
    equations: WithSprings,
    options: NewtonOptions,
    failed: NotConvergedError,
    *,
    repeats: int = 1,
    max_fraction: float = RIGID.negligible,
) -> NewtonReport:
    """Solve with weak springs that remain (collective).

    Args:
        equations: The equations, near a state that is unbalanced by small forces only.
        options: Options of the solves.
        failed: Error of the solve without springs.
        repeats: Number of solves, each with springs anchored at the result of the last one.
        max_fraction: Largest force of springs over the contact force on a body [1];
            ``RIGID.slight`` on bodies whose nodes with friction all slide.

    Returns:
        The record of all iterations, including those of ``failed``.

    Raises:
        NotConvergedError: On all ranks, if a solve fails or the force of springs is larger.
    """
    report, shorter = failed.report, RIGID.recovery ** (3 * np.arange(RIGID.max_failures))
    for _ in range(repeats):
        for aim in (RIGID.elongation / shorter).tolist():
            report, reason = _try_anchored(equations, options, report, aim, touched=True)
            if not reason:
                break
        else:
            raise NotConvergedError(f"{failed}; {reason}", report) from failed
    carried = equations.springs.remaining()
    if carried.fraction > max_fraction or carried.sliding > RIGID.slight:
        raise NotConvergedError(f"{failed}; {carried.message}", report) from failed
    report.notes.append(carried.message)
    return report


def _solve_without(
    equations: WithSprings, options: NewtonOptions, report: NewtonReport
) -> NewtonReport:
    """Solve without springs; the record begins with ``report``."""
    equations.springs.remove_springs()
    return then_solve(report, partial(solve, equations, options))


def _move_on_springs(
    equations: WithSprings,
    options: NewtonOptions,
    failed: NotConvergedError,
    report: NewtonReport,
    *,
    balanced: bool = False,
) -> NewtonReport:
    """Solve with springs until their elongation vanishes, at most ``RIGID.max_solves`` times.

    If ``balanced``, also until their force does, with ever weaker springs. A round body on one node
    hardly moves against the first ones, although they carry its moment, and has to roll until the
    next node supports it, too. Solves after which no contact force acts on a body have failed then:
    Newton's method has jumped.
    """
    # the last solve, without springs, uses the user's tolerance
    rough = replace(options, residual_tolerance=max(SOLVED, options.residual_tolerance))
    aim, failures = RIGID.elongation, 0
    for _ in range(RIGID.max_solves):
        report, reason = _try_anchored(equations, rough, report, aim, touched=balanced)
        if reason:
            aim, failures = aim / RIGID.recovery**3, failures + 1
            if failures == RIGID.max_failures:
                raise NotConvergedError(failed.report.reason, report)
            continue
        rests = equations.springs.max_motion() < RIGID.overlap * aim / RIGID.elongation
        carried = equations.springs.remaining().fraction
        if rests and not (balanced and carried > RIGID.negligible):
            break
        aim, failures = RIGID.recovery * aim, 0
        aim = aim if rests else min(aim, RIGID.elongation)
    return report


def _try_anchored(
    equations: WithSprings,
    options: NewtonOptions,
    report: NewtonReport,
    aim: float,
    *,
    touched: bool,
) -> tuple[NewtonReport, str]:
    """One solve with springs; a failure restores the state.

    Args:
        equations: The equations.
        options: Options of the solve.
        report: Record of the iterations before.
        aim: Elongation of the springs [shortest facets].
        touched: Whether contact forces act on all bodies; if not after the solve, it has failed.

    Returns:
        The record of all iterations, and the reason of a failure, "" without one.
    """
    start = equations.state()
    equations.springs.anchor(aim)
    try:
        report = then_solve(report, partial(solve, equations, options))
        carried = equations.springs.remaining()
        if not touched or carried.fraction < np.inf:
            return report, ""
        reason = carried.message
    except NotConvergedError as error:
        report, reason = error.report, str(error) or "not converged"
    equations.restore(start)
    return report, reason
