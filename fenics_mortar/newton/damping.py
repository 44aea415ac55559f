# SPDX-License-Identifier: MIT
"""Newton steps that go less far: while the residual grows, or where the surfaces would move far.

Both are off unless ``NewtonOptions`` ask for them. A whole step often raises the residual for one
iteration, as nodes enter the contact, and the next one is the solution: a search along the line
stops on the way and lets the sets change a node at a time. And the displacement that is prescribed
moves the surfaces by as many facets as the load step asks for, which a limit of the motion turns
into as many iterations. The atlas of methods has a column for each beside the default, which only
keeps cells from inverting.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol

from fenics_mortar.newton.loop import Equations, NewtonOptions, Status, Step

# The search along the line ends here: a sixteenth of a step may raise the residual.
SHORTEST = 0.1


class Stateful(Equations, Protocol):
    """Equations whose state can be kept and taken up again; all collective."""

    def state(self) -> Any:
        """Copy the present state; it has ``towards``."""

    def restore(self, state: Any) -> None:
        """Go back to a state."""

    def interface_motion(self, before: Any) -> float:
        """How far surfaces have moved since a state, in facets."""


class Damped:
    """Equations of which a step goes only so far (collective).

    Args:
        equations: The equations that are solved.
        options: Their ``line_search`` and ``max_motion``.
    """

    def __init__(self, equations: Stateful, options: NewtonOptions) -> None:
        self._equations, self._options = equations, options
        self.merge_sets, self.seconds = equations.merge_sets, equations.seconds
        self.diagnose, self.drifts = equations.diagnose, equations.drifts
        self._residual = 0.0

    def advance(self) -> Step:
        """Solve one linear system and move, the surfaces no farther than ``max_motion`` facets."""
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
        """Evaluate; halve the last step while the residual is larger than before it."""
        status, fraction = self._equations.evaluate(start=start), 1.0
        if self._options.line_search and not start:
            while not status.residual <= self._residual and fraction > SHORTEST:
                fraction *= 0.5
                self._equations.restore(self._before.towards(self._after, fraction))
                status = self._equations.evaluate(start=False)
        self._residual = status.residual
        return replace(status, fraction=fraction)
