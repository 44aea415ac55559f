# SPDX-License-Identifier: MIT
"""Springs that hold floating bodies and driven obstacles where Newton fails; see ``release``."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fenics_mortar.rigid.driven import DrivenObstacles
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.rigid.release import Remaining
from fenics_mortar.utils.arrays import Array


class HoldingSprings:
    """Anchored springs of a problem; all methods are collective.

    Args:
        floating: The floating bodies.
        obstacles: The obstacles.
        stiffness: Of the bulk [stress].
        forces: Returns forces of the bulk and of contact at the present state (owned parts).
    """

    def __init__(
        self,
        floating: FloatingBodies,
        obstacles: DrivenObstacles,
        stiffness: float,
        forces: Callable[[], tuple[Array, Array, Array]],
    ) -> None:
        self._floating, self._obstacles = floating, obstacles
        self._stiffness, self._forces = stiffness, forces

    def hold(self, travel: float) -> None:
        """Tie floating bodies and driven obstacles to where they are; see ``AnchoredSprings``."""
        self._floating.hold(self._total(), travel)
        self._obstacles.hold(travel, self._stiffness)

    def let_go(self) -> None:
        """Remove the springs."""
        self._floating.let_go()
        self._obstacles.let_go()

    def stiff_travel(self) -> float:
        """The ``travel`` of ``hold`` at which springs are as stiff as the bodies [facets]."""
        return self._floating.stiff_travel(self._total())

    def travel(self) -> float:
        """Largest rigid motion since ``hold``, in shortest facets."""
        return max(self._floating.travel(), self._obstacles.travel())

    def fractions(self) -> list[tuple[str, float, bool]]:
        """Name, force of springs over contact force, whether it slides, of all that they hold."""
        return self._floating.held_fractions() + self._obstacles.held_fractions()

    def largest(self) -> float:
        """Largest force of springs over contact force [1]; zero without springs."""
        return max((fraction for _, fraction, _ in self.fractions()), default=0.0)

    def remaining(self) -> Remaining:
        """Forces that springs carry over contact forces."""
        held = self.fractions()
        energy = self._floating.spring_energy() + self._obstacles.spring_energy()
        each = [f"{name} with {fraction:.1e} of its contact force" for name, fraction, _ in held]
        return Remaining(
            self.largest(),
            max((fraction for _, fraction, slides in held if slides), default=0.0),
            f"springs hold {', '.join(each)}, with an energy of {energy:.3e}: contact does not "
            "resist its motion more than the facets' corners drive it; prescribe it, or refine",
        )

    def _total(self) -> Array:
        bulk, contact, _ = self._forces()
        return np.asarray(bulk + contact)
