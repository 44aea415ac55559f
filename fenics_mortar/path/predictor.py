# SPDX-License-Identifier: MIT
"""Where a load step begins: at the last state, or where the last two lead.

Displacements, multipliers and motions that forces drive are extrapolated: along a line, or, where
contact goes on along a body by half a facet or more in a step, in a frame that travels with it, see
``travel``. A parabola saves no more: as nodes pass facets the states have kinks. So most nodes have
entered or left the contact before the first iteration. While a path goes on straight a line saves
about one iteration a step. It leads nowhere by whole facets with friction; the travelling frame
saves two iterations to seven there.

It is no good start where the path turns: the residual there is larger than at the last state. Nor
is it where states have little to do with each other. The first iteration from a line then leaves
most of the residual, or there are many. In that case the step begins anew at the last state, and
the next one, two, four... make no guess of that kind.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.contact import Contact
from fenics_mortar.equations.state import State
from fenics_mortar.newton.loop import NewtonReport, after
from fenics_mortar.path.travel import Travel
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import NotConvergedError

# A guess that has not led to a solution in so many iterations has cost more than any could save.
FEW = 8
# Part of the residual that the first iteration from a line leaves at the most. Measured on 300
# steps of sliding and rolling: above it such a start costs more than it saves. One that travels
# with the contact is worth going on from: it leaves 0.06 of the force where the last state leaves
# 0.5.
MOST_LEFT = 0.4


class _Point(NamedTuple):
    """An accepted state of the path: its time, and where its contacts are on the bodies."""

    time: float
    state: State
    places: Array


@dataclass
class _Kind:
    """A kind of guess: what its first iteration may leave, for how many steps it is not made."""

    most_left: float
    pause: int = 0
    left: int = 0

    def failed(self) -> None:
        """Pause twice as long as the last time."""
        self.left = self.pause = max(2 * self.pause, 1)


class Predictor:
    """Extrapolates the accepted states of a problem.

    Args:
        problem: The problem.
        time: That of its present state.
        guesses: Whether to make guesses at all.
    """

    def __init__(self, problem: ContactProblem, time: float, *, guesses: bool = True) -> None:
        self._problem, self._guesses = problem, guesses
        self._travel = Travel(problem)
        self._here = self._point(time)
        self._before: _Point | None = None
        self._line, self._travelling = _Kind(MOST_LEFT), _Kind(np.inf)

    @property
    def last(self) -> State:
        """The last accepted state."""
        return self._here.state

    def _point(self, time: float) -> _Point:
        return _Point(time, self._problem.state(), self._travel.places())

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
        kind = self._go_to_guess(time, here)
        for other in (self._line, self._travelling):
            other.left = max(other.left - (other is not kind), 0)
        report = solve() if kind is None else self._solve_from_guess(kind, here, solve)
        self._before, self._here = self._here, self._point(time)
        return report

    def _go_to_guess(self, time: float, here: State) -> _Kind | None:
        """Go to where the last two states lead if the equations are violated less there.

        Bodies that float must be held by contact, and what presses goes on to do so: a solve moves
        bodies and obstacles rigidly before it begins where they are loose.
        """
        problem = self._problem
        if (
            not self._guesses
            or self._before is None
            or not problem.equations.floating.held_by_contact
        ):
            return None
        guesses = self._find_guesses(
            (time - self._here.time) / (self._here.time - self._before.time)
        )
        if not guesses:
            return None
        best, kind = here, None
        residual, presses = self._look()
        for its_kind, guess in guesses:
            places = np.where(problem.equations.tools.driven, guess.places, here.places)
            guess = replace(guess, places=places).with_settings_of(here)
            problem.restore(guess)
            guessed, still_presses = self._look()
            if guessed < residual and not (presses & ~still_presses).any():
                residual, best, kind = guessed, guess, its_kind
        problem.restore(best)
        return kind

    def _find_guesses(self, ratio: float) -> list[tuple[_Kind, State]]:
        """Guesses for a step of ``ratio`` times the length of the last one, but for pauses."""
        assert self._before is not None
        (_, last, places), (_, before, places_before) = self._here, self._before
        guesses = []
        if not self._line.left:
            guesses.append((self._line, last.towards(before, -ratio)))
        if not self._travelling.left:
            guess = self._travel.guess(last, before, places - places_before, ratio)
            guesses += [(self._travelling, guess)] if guess is not None else []
        return guesses

    def _look(self) -> tuple[float, npt.NDArray[np.bool_]]:
        """Residual of the present state, inf if a cell is inverted; which contacts press."""
        problem = self._problem
        for contact in problem.equations.contacts:
            contact.start_step()
        residual = np.inf if problem.equations.bulk.inverted_cells()[0] else self._residual()
        contacts = [
            contact for contact in problem.equations.contacts if isinstance(contact, Contact)
        ]
        return residual, np.array([(c.pressure > 0.0).any() for c in contacts], bool)

    def _residual(self) -> float:
        residual = self._problem.equations.evaluate(start=True).residual
        return residual if np.isfinite(residual) else np.inf

    def _solve_from_guess(
        self, kind: _Kind, here: State, solve: Callable[[], NewtonReport]
    ) -> NewtonReport:
        """Solve; where that does not go well, once more from ``here``."""
        options = self._problem.newton
        few = min(FEW, options.max_iterations)
        cautious = replace(options, tentative=True, most_left=kind.most_left, max_iterations=few)
        try:
            self._problem.newton = cautious
            report = solve()
            kind.pause = 0
            return report
        except NotConvergedError as error:
            lost = error.report
            lost.notes.append(f"begun where the last two states led, in vain: {error}")
        finally:
            self._problem.newton = options
        kind.failed()
        self._problem.restore(here)
        return after(lost, solve)
