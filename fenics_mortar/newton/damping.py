# SPDX-License-Identifier: MIT
"""Damped Newton steps: line search on the residual, or a limit of the surface motion.

Both are off by default, see ``NewtonOptions``. A full step often raises the residual for one
iteration, when nodes come into contact, and the next iterate is the solution; with a line search
the active set would change one node at a time. A limit of the motion splits prescribed
displacements of many facets into as many iterations. By default steps are limited only where cells
would invert.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol

from fenics_mortar.newton.loop import Equations, Status, Step
from fenics_mortar.newton.options import NewtonOptions

# Smallest fraction of a step [1] at which the line search halves the step again.
MIN_HALVED = 0.1


class Stateful(Equations, Protocol):
    """Equations whose state can be stored and restored; all methods are collective."""

    def state(self) -> Any:
        """The present state, an object with a method ``towards``."""

    def restore(self, state: Any) -> None:
        """Restore a state."""

    def interface_motion(self, before: Any) -> float:
        """Largest motion of a surface since a state, in facets [1]."""


class Damped:
    """Equations with damped steps; all methods are collective.

    Args:
        equations: The equations to solve.
        options: With ``line_search`` and ``max_motion``.
    """

    def __init__(self, equations: Stateful, options: NewtonOptions) -> None:
        self._equations, self._options = equations, options
        self.remedies = equations.remedies
        self.seconds, self.diagnose = equations.seconds, equations.diagnose
        self._residual = 0.0

    def advance(self) -> Step:
        """Solve one linear system; limit the motion of surfaces to ``max_motion`` facets."""
        self._before = self._equations.state()
        step = self._equations.advance()
        self._after = self._equations.state()
        motion = self._equations.interface_motion(self._before)
        if motion <= self._options.max_motion:
            return step
        fraction = self._options.max_motion / motion
        self._after = self._before.towards(self._after, fraction)
        self._equations.restore(self._after)
        return step._replace(fraction=fraction * step.fraction)

    def evaluate(self, *, start: bool) -> Status:
        """Evaluate the state; halve the last step while it raises the residual."""
        status, fraction = self._equations.evaluate(start=start), 1.0
        if self._options.line_search and not start:
            while not status.residual <= self._residual and fraction > MIN_HALVED:
                fraction *= 0.5
                self._equations.restore(self._before.towards(self._after, fraction))
                status = self._equations.evaluate(start=False)
        self._residual = status.residual
        return replace(status, fraction=fraction)
