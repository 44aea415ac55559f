# SPDX-License-Identifier: MIT
"""Remedies of Newton's method if active sets do not converge or bodies do not come to rest.

Anchored springs on floating bodies and driven obstacles; see ``proximal``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from fenics_mortar.equations.residual import Residual
from fenics_mortar.equations.set_record import SetRecord
from fenics_mortar.newton.loop import UNSETTLED
from fenics_mortar.rigid.driven import DrivenMotions
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.rigid.proximal import Remaining
from fenics_mortar.utils.arrays import Array


class Remedies:
    """Remedies in a solve that does not converge; all methods are collective.

    Args:
        floating: The floating bodies.
        residual: Residual of the last evaluated state.
        set_record: Sets and residuals of the solve.
        adopt_linearized_sets: Function that adopts the sets of the linearized contact problem, also
            beyond a turning point of the load path if its argument is true; returns whether they
            were found.
    """

    def __init__(
        self,
        floating: FloatingBodies,
        residual: Residual,
        set_record: SetRecord,
        adopt_linearized_sets: Callable[[bool], bool],
    ) -> None:
        self._floating, self._residual, self._set_record = floating, residual, set_record
        self._adopt_linearized_sets = adopt_linearized_sets

    def replace_unsettled_sets(self) -> None:
        """Adopt the sets of the linearized problem if those of floating bodies cycle."""
        if not self._floating.anchored and self._set_record.is_unsettled:
            self._adopt_linearized_sets(False)

    def drifts(self) -> str:
        """Describe bodies that are moved by small residual forces only; "" if there are none.

        Contact forces act along averaged normals of facets. Their error drives smooth bodies
        without friction, which may have no equilibrium nearby.
        """
        if (
            self._floating.anchored
            or self._set_record.residuals[-1] > RIGID.slight * self._residual.force
        ):
            return ""
        names = self._floating.names(self._floating.loose() or self._floating.bodies)
        return f"the remaining force is slight and moves {names}" if names else ""

    def merge_sets(self, period: int) -> str:
        """Leave a cycle of sets by merging them; see ``SetRecord.merge``.

        If sets change without a period, or again in a cycle, the sets of the linearized problem are
        adopted. An example are thin plates that bend by more than their gap if a node opens. Beyond
        a turning point of the load path these sets are adopted only if nodes just open and close:
        the bodies snap through. If nodes change between sticking and sliding, the state after a
        snap-through is not determined. If bodies float, ``replace_unsettled_sets`` has adopted
        these sets before.
        """
        set_record = self._set_record
        again, message = set_record.has_merged, set_record.merge(period)
        if (again or period == UNSETTLED) and not self._floating.bodies:
            taken = self._adopt_linearized_sets(set_record.opens_and_closes)
            message += "; that of the linearized problem is used" * taken
        return message


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
