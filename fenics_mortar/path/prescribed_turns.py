# SPDX-License-Identifier: MIT
"""Rotations of bodies within a step, from prescribed values at times between its ends.

The ends of a step tell the rotation of a body up to full turns: a shaft turned by 300 degrees looks
like one turned back by 60. Where loads are a function of the time, it is evaluated at times within
the step as well. The rotations of prescribed boundaries between these, each of less than half a
turn, are added up. The sizes of rotations are added, so that a turn to and fro is found as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise

import numpy as np

from fenics_mortar.contact.arcs import MAX_ROTATION
from fenics_mortar.newton.report import NewtonReport
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import NotConvergedError
from fenics_mortar.verify.led_bodies import Turns

# Times within a step, over its length [1]. They are not evenly spaced, so that at a constant rate
# no number of full turns in the step is a number of full turns between all of them.
WITHIN = (0.11, 0.36, 0.68)


class PrescribedTurns:
    """Rotations that loads prescribe within a step; all methods are collective.

    Args:
        problem: The problem.
        set_loads: Function that sets loads and prescribed values for a time, on all ranks.
    """

    def __init__(self, problem: ContactProblem, set_loads: Callable[[float], None]) -> None:
        equations = problem.equations
        self._bulk, self._floating, self._set_loads = equations.bulk, equations.floating, set_loads
        self._outline, self._led = equations.crossings.outline, equations.crossings.led

    @contextmanager
    def of_step(self, start: float, stop: float) -> Iterator[None]:
        """Context of a step, in which the turns of prescribed values are known; see ``set_loads``.

        Args:
            start: Time of the present state [time].
            stop: Time at the end of the step [time].
        """
        self.set_loads(start, stop)
        self._led.examined = True
        try:
            yield
        finally:
            self._led.examined = False

    def set_loads(self, start: float, stop: float) -> None:
        """Set the loads of the end of a step; refuse steps in which bodies turn far.

        Args:
            start: Time of the present state [time].
            stop: Time at the end of the step [time].

        Raises:
            NotConvergedError: On all ranks, if one side of a pair turns by more than
                ``MAX_ROTATION`` relative to the other one; obstacles turn by known angles.
            Exception: Any error of the function, also at times within the step.
        """
        if not self._led.may_turn:
            return self._set_loads(stop)
        times = [start + fraction * (stop - start) for fraction in WITHIN]
        knots = [self._outline.positions(self._bulk.u.x.array), *map(self._moved, [*times, stop])]
        turns = [self._led.turns(*ends) for ends in pairwise(knots)]
        for sides in sorted(self._led.sides):
            self._refuse(sides, turns)
        return None

    def _moved(self, time: float) -> Array:
        """Set the loads; positions with the prescribed values, shape (n, d) [length]."""
        self._set_loads(time)
        values = self._bulk.u.x.array.copy()
        compat.set_prescribed(values, self._bulk.bcs)
        return self._outline.positions(values)

    def _refuse(self, sides: tuple[int, int], turns: list[Turns]) -> None:
        """Raise an error if one of two bodies turns too far relative to the other one."""
        relative = np.array([np.linalg.norm(self._led.relative(sides, turn)) for turn in turns])
        nearest = np.abs(np.arctan2(np.sin(relative), np.cos(relative)))
        total = float(nearest.sum())
        if total > MAX_ROTATION:

            def turned(side: int) -> float:
                return sum(float(np.linalg.norm(turn[side])) for turn in turns if side in turn)

            turning = self._floating.name_of(max(sides, key=turned))
            reason = (
                f"{turning} turns by at least {np.degrees(total):.0f} degrees in the step; the "
                "ends tell the direction of slip and the bodies passed up to "
                f"{np.degrees(MAX_ROTATION):.0f} degrees only: take smaller steps"
            )
            raise NotConvergedError(reason, NewtonReport(reason=reason))
