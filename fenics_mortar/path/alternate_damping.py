# SPDX-License-Identifier: MIT
"""Solves with full or damped Newton steps alternately, for contact laws of users."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

from fenics_mortar.contact.contact import Contact
from fenics_mortar.newton.options import NewtonOptions
from fenics_mortar.newton.report import NewtonReport, then_solve
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.errors import NotConvergedError


class AlternateDamping:
    """Newton's method with full or damped steps; the variant that converged last is tried first.

    Users' contact laws may be steep or not monotonic, and full steps may oscillate about a kink. In
    this case a line search converges, where full steps would need shorter load steps. It does not
    save iterations for the laws of this package, whose branches are known.

    Args:
        problem: The problem.
    """

    def __init__(self, problem: ContactProblem) -> None:
        self._problem, self._damps_first = problem, False
        self._has_choice = any(map(_has_own_law, problem.equations.contacts))

    def solve(self) -> NewtonReport:
        """Solve; on failure, solve again by the other variant (collective).

        Raises:
            NotConvergedError: On all ranks, if both fail.
        """
        problem, options = self._problem, self._problem.equations.newton
        if not self._has_choice or options.damped or options.tentative:
            return problem.solve(accept_violations=True, predict=False)
        start = problem.state()
        try:
            return self._solve(options)
        except NotConvergedError as failure:
            problem.restore(start)
            self._damps_first = not self._damps_first
            lost, how = failure.report, "damped" if self._damps_first else "full"
            lost.notes.append(f"restarted with {how} steps: {failure}")
        return then_solve(lost, partial(self._solve, options))

    def _solve(self, options: NewtonOptions) -> NewtonReport:
        try:
            self._problem.equations.newton = replace(options, line_search=self._damps_first)
            return self._problem.solve(accept_violations=True, predict=False)
        finally:
            self._problem.equations.newton = options


def _has_own_law(contact: Any) -> bool:
    """Whether ``contact`` is a contact with a user's law."""
    return isinstance(contact, Contact) and not contact.pair.law.is_of_package
