# SPDX-License-Identifier: MIT
"""Rotations of bodies within a step, from prescribed values at times between its ends.

The ends of a step tell the rotation of a body up to full turns: a shaft turned by 300 degrees looks
like one turned back by 60. Where loads are a function of the time, it is evaluated at times within
the step as well. The rotations of prescribed boundaries between these, each of less than half a
turn, are added up. The sizes of rotations are added, so that a turn to and fro is found as well.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise, product

import numpy as np

from fenics_mortar.contact.arcs import MAX_ROTATION
from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.newton.report import NewtonReport
from fenics_mortar.obstacles.rotations import TURNS
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import NotConvergedError
from fenics_mortar.verify.node_paths import Motions
from fenics_mortar.verify.space_passages import motion_between

# Times within a step, over its length [1]. They are not evenly spaced, so that at a constant rate
# no number of full turns in the step is a number of full turns between all of them.
WITHIN = (0.11, 0.36, 0.68)

# Rotations by the number of the body: an angle, shape (1,), in space a vector (3,) [radian].
Turns = dict[int, Array]


class PrescribedTurns:
    """Rotations that loads prescribe within a step; all methods are collective.

    Args:
        problem: The problem.
        set_loads: Function that sets loads and prescribed values for a time, on all ranks.
    """

    def __init__(self, problem: ContactProblem, set_loads: Callable[[float], None]) -> None:
        equations = problem.equations
        self._bulk, self._floating, self._set_loads = equations.bulk, equations.floating, set_loads
        self._outline = equations.crossings.outline
        labels = self._outline.gather(self._bulk.space.spread(self._floating.labels))
        self._bodies = labels[:, 0].astype(np.int64)
        free = self._outline.gather(1.0 - self._bulk.prescribed)
        self._prescribed = (free == 0.0).all(axis=1)
        led = set(self._bodies[self._prescribed].tolist())
        self._sides = {
            sides
            for contact in equations.contacts
            if isinstance(contact, Contact)
            for sides in product(self._of(contact.slave), self._of(contact.master) or [-1])
            if sides[0] != sides[1] and not led.isdisjoint(sides)
        }
        self._may_turn = bool(self._sides) and self._vary(len(led))

    def _of(self, surface: Surface) -> list[int]:
        """Numbers of the bodies of a surface, none for an obstacle, which becomes -1."""
        return sorted(set(self._floating.labels_of(surface).astype(np.int64).tolist()))

    def _vary(self, num_led: int) -> bool:
        """Whether values may be those of a rotation, not one constant for each body (local)."""
        sizes = [compat.prescribed_value(bc).size for bc in self._bulk.bcs]
        return 0 in sizes or len(sizes) > num_led

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
        if not self._may_turn:
            return self._set_loads(stop)
        times = [start + fraction * (stop - start) for fraction in WITHIN]
        knots = [self._outline.positions(self._bulk.u.x.array), *map(self._moved, [*times, stop])]
        turns = [self._turns(*ends) for ends in pairwise(knots)]
        for sides in sorted(self._sides):
            self._refuse(sides, turns)
        return None

    def _moved(self, time: float) -> Array:
        """Set the loads; positions with the prescribed values, shape (n, d) [length]."""
        self._set_loads(time)
        values = self._bulk.u.x.array.copy()
        compat.set_prescribed(values, self._bulk.bcs)
        return self._outline.positions(values)

    def _turns(self, x0: Array, x1: Array) -> Turns:
        """Rotations of the bodies with prescribed nodes between two positions (local)."""
        led = self._prescribed
        if x0.shape[1] == 3:
            bodies = np.unique(self._bodies[led]).tolist()
            marks = [led & (self._bodies == body) for body in bodies]
            turns = [motion_between(x0[at], x1[at]).vector for at in marks]
            return dict(zip(bodies, turns, strict=True))
        found = Motions(x0, x1, self._bodies, led)
        angles = np.where(found.are_led, found.angles, 0.0)
        return dict(zip(found.labels.tolist(), angles[:, None], strict=True))

    def _refuse(self, sides: tuple[int, int], turns: list[Turns]) -> None:
        """Raise an error if one of two bodies turns too far relative to the other one."""
        still = np.zeros(len(TURNS[self._bulk.space.dim]))
        slave, master = (
            np.array([turn.get(side, still) for turn in turns]).reshape(-1, still.size)
            for side in sides
        )
        relative = np.linalg.norm(slave - master, axis=1)
        nearest = np.abs(np.arctan2(np.sin(relative), np.cos(relative)))
        total = float(nearest.sum())
        if total > MAX_ROTATION:
            sizes = np.linalg.norm([slave, master], axis=2).sum(axis=1)
            turning = self._floating.name_of(sides[int(sizes.argmax())])
            reason = (
                f"{turning} turns by at least {np.degrees(total):.0f} degrees in the step; the "
                "ends tell the direction of slip and the bodies passed up to "
                f"{np.degrees(MAX_ROTATION):.0f} degrees only: take smaller steps"
            )
            raise NotConvergedError(reason, NewtonReport(reason=reason))
