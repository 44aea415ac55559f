# SPDX-License-Identifier: MIT
"""Where a load step begins: at the last state, or where the last two lead.

Displacements, multipliers and motions that forces drive are extrapolated along a line, so that most
nodes have entered or left the contact before the first iteration. While a path goes on straight
that saves about one iteration a step, also where contact slides by whole facets. A parabola saves
no more: as nodes pass facets the states have kinks.

It is no good start where the path turns: the residual there is larger than at the last state. Nor
is it where states have little to do with each other, as with much friction, or where steps are of
several facets: the first iteration then leaves most of the residual, or there are many. In that
case the step begins anew at the last state, and the next one, two, four... make no guess.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact import Contact
from fenics_mortar.equations import State
from fenics_mortar.errors import NotConvergedError
from fenics_mortar.newton import NewtonReport, after
from fenics_mortar.problem import ContactProblem

# A guess that has not led to a solution in so many iterations has cost more than any could save.
FEW = 8


class Predictor:
    """Extrapolates the accepted states of a problem.

    Args:
        problem: The problem.
        time: That of its present state.
        guesses: Whether to make guesses at all.

    Attributes:
        last: The last accepted state.
    """

    def __init__(self, problem: ContactProblem, time: float, *, guesses: bool = True) -> None:
        self._problem, self._guesses = problem, guesses
        self._time, self.last = time, problem.state()
        self._before: tuple[float, State] | None = None
        self._pause = self._left = 0

    def solve(self, time: float, solve: Callable[[], NewtonReport]) -> NewtonReport:
        """Solve for a time, from a guess or from the last state, and accept the end (collective).

        Args:
            time: That of the present loads and prescribed values.
            solve: Solves from the present state.

        Returns:
            The record, with the iterations from a guess that came to nothing.

        Raises:
            NotConvergedError: On all ranks, if it fails from the last state, too.
        """
        here = self._problem.state()
        if self._go_to_guess(time, here):
            report = self._solve_from_guess(here, solve)
        else:
            self._left = max(self._left - 1, 0)
            report = solve()
        self._before = self._time, self.last
        self._time, self.last = time, self._problem.state()
        return report

    def _go_to_guess(self, time: float, here: State) -> bool:
        """Go to where the last two states lead if the equations are violated less there.

        Bodies that float must be held by contact, and what presses goes on to do so: a solve moves
        bodies and obstacles rigidly before it begins where they are loose.
        """
        problem = self._problem
        if not self._guesses or self._left or self._before is None:
            return False
        if not problem.floating.held_by_contact:
            return False
        then, before = self._before
        guess = self.last.towards(before, (time - self._time) / (then - self._time))
        places = np.where(problem.tools.driven, guess.places, here.places)
        guess = replace(guess, places=places)
        residual, presses = self._look()
        problem.restore(guess)
        guessed, still_presses = self._look()
        better = guessed < residual and not (presses & ~still_presses).any()
        problem.restore(guess if better else here)
        return better

    def _look(self) -> tuple[float, npt.NDArray[np.bool_]]:
        """Residual of the present state, inf if a cell is inverted; which contacts press."""
        problem = self._problem
        for contact in problem.contacts:
            contact.start_step()
        residual = np.inf if problem.bulk.inverted_cells()[0] else self._residual()
        contacts = [contact for contact in problem.contacts if isinstance(contact, Contact)]
        return residual, np.array([(c.pressure > 0.0).any() for c in contacts], bool)

    def _residual(self) -> float:
        residual = self._problem.evaluate(start=True).residual
        return residual if np.isfinite(residual) else np.inf

    def _solve_from_guess(self, here: State, solve: Callable[[], NewtonReport]) -> NewtonReport:
        """Solve; where that does not go well, once more from ``here``."""
        options = self._problem.newton
        few = min(FEW, options.max_iterations)
        self._problem.newton = replace(options, tentative=True, max_iterations=few)
        try:
            report = solve()
            self._pause = 0
            return report
        except NotConvergedError as error:
            lost = error.report
            lost.notes.append(f"begun where the last two states led, in vain: {error}")
        finally:
            self._problem.newton = options
        self._left = self._pause = max(2 * self._pause, 1)
        self._problem.restore(here)
        return after(lost, solve)
