# SPDX-License-Identifier: MIT
"""Anchored springs on floating bodies and driven obstacles; see ``proximal``."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from fenics_mortar.rigid.driven import DrivenMotions
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.rigid.proximal import Remaining
from fenics_mortar.utils.arrays import Array


def _reason(carried: Iterable[tuple[str, float, bool]]) -> str:
    """Why springs carry forces: names, fractions of the contact force, whether all nodes slide."""
    sliding = [name for name, fraction, slides in carried if slides and fraction > RIGID.slight]
    if sliding:
        return (
            f"all nodes with friction of {', '.join(sliding)} slide at their friction limit, which "
            "the loads exceed; reduce these, or prescribe the motion"
        )
    return (
        "the resistance of contact to the motion is below the force from the corners of the "
        "facets; prescribe the motion, or refine"
    )


class CombinedSprings:
    """Anchored springs of a problem; all methods are collective.

    Args:
        floating: The floating bodies.
        obstacles: The obstacles.
        stiffness: Stiffness of the bulk [stress].
        forces: Function that returns forces of the bulk, of contact and on obstacles at the present
            state, see ``Residual.forces``.
    """

    def __init__(
        self,
        floating: FloatingBodies,
        obstacles: DrivenMotions,
        stiffness: float,
        forces: Callable[[], tuple[Array, Array, Array]],
    ) -> None:
        self._floating, self._obstacles = floating, obstacles
        self._stiffness, self._forces = stiffness, forces

    def anchor(self, elongation: float) -> None:
        """Anchor floating bodies and driven obstacles; see ``AnchoredSprings``."""
        self._floating.anchor(self._total(), elongation)
        self._obstacles.anchor(elongation, self._stiffness)

    def remove_springs(self) -> None:
        """Remove the springs."""
        self._floating.remove_springs()
        self._obstacles.remove_springs()

    def max_motion(self) -> float:
        """Largest rigid motion since ``anchor`` [shortest facets]."""
        return max(self._floating.max_motion(), self._obstacles.max_motion())

    def fractions(self) -> list[tuple[str, float, bool]]:
        """Name, force of springs over contact force, whether it slides, of each body on springs."""
        return self._floating.spring_fractions() + self._obstacles.spring_fractions()

    def largest(self) -> float:
        """Largest force of springs over contact force [1]; zero without springs."""
        return max((fraction for _, fraction, _ in self.fractions()), default=0.0)

    def remaining(self) -> Remaining:
        """Forces of the springs over contact forces."""
        carried = self.fractions()
        energy = self._floating.spring_energy() + self._obstacles.spring_energy()
        each = [
            f"{fraction:.1e} of the contact force on {name}"
            if np.isfinite(fraction)
            else f"all forces on {name}, which no contact force acts on"
            for name, fraction, _ in carried
        ]
        return Remaining(
            self.largest(),
            max((fraction for _, fraction, slides in carried if slides), default=0.0),
            f"springs carry {', '.join(each)}, with an energy of {energy:.3e}: {_reason(carried)}",
        )

    def _total(self) -> Array:
        bulk, contact, _ = self._forces()
        return np.asarray(bulk + contact - self._obstacles.pushed_nodes())
