# SPDX-License-Identifier: MIT
"""Active sets and residuals of the iterations of a solve; remedies for cycles and loose bodies.

Bodies and driven obstacles that do not come to rest get anchored springs, see ``proximal``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.law import STICK, Branches
from fenics_mortar.contact.pair import Discretization
from fenics_mortar.contact.tied import Tie
from fenics_mortar.equations.arguments import EQUATIONS
from fenics_mortar.equations.residual import Residual
from fenics_mortar.newton.loop import UNSETTLED, decreased
from fenics_mortar.rigid.driven import DrivenMotions
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.rigid.proximal import RIGID, Remaining
from fenics_mortar.utils.arrays import Array, Flags

# Active set and branches of each pair in one iteration.
SetsOfPairs = list[tuple[Flags, Branches]]


class SetRecord:
    """Sets of all pairs and residuals since a solve began (local).

    Args:
        contacts: The pairs.

    Attributes:
        residuals: Norm of all residuals for each evaluation [stress length].
        num_changed: Number of nodes that changed in the last evaluation.
        has_merged: Whether ``merge`` was called.
        opens_and_closes: Whether nodes opened and closed in the last cycle, and none changed
            between sticking and sliding.
    """

    def __init__(self, contacts: Sequence[Contact | Tie]) -> None:
        self._contacts = contacts
        self.begin()

    def begin(self) -> None:
        """Discard the data of the last solve."""
        self.residuals: list[float] = []
        self._sets: list[SetsOfPairs] = []
        self.num_changed = self._calls = 0
        self.has_merged = self.opens_and_closes = False

    def record(self, residual: float, changed: int) -> None:
        """Add the present sets; ``changed``: number of nodes that changed."""
        self.residuals.append(residual)
        self._sets.append([(c.active, c.branch) for c in self._contacts])
        self.num_changed = changed

    @property
    def recent(self) -> list[SetsOfPairs]:
        """Sets of the last ``EQUATIONS.recent_sets`` iterations."""
        return self._sets[-EQUATIONS.recent_sets :]

    @property
    def is_unsettled(self) -> bool:
        """Whether sets change although the residual does not decrease, see ``decreased``."""
        residuals = self.residuals
        if not self.num_changed or len(residuals) < 2 or self._calls == EQUATIONS.max_calls:
            return False
        return not decreased(residuals[-1], residuals[-2])

    def count_call(self) -> None:
        """Count a linearized contact problem."""
        self._calls += 1

    def merge(self, period: int) -> str:
        """Leave a cycle of the active set or of branches; return a remark.

        All nodes that were active in the cycle are set active for one iteration. c_n is at most its
        default in this and later solves: a large c_n opens nodes for small gaps left by a step.
        Nodes that changed branch in the cycle stick for one iteration.
        """
        wavering, opening, c_n = 0, 0, Discretization.c_n
        for i, contact in enumerate(self._contacts):
            recent = [sets[i] for sets in self._sets[-period:]]
            active, branches = (np.array(sets) for sets in zip(*recent, strict=True))
            merged = active.any(axis=0) & contact.covered
            wavers = merged & (branches != branches[-1]).any(axis=0)
            contact.change(
                active=merged,
                c_n=min(contact.c_n, c_n),
                branch=np.where(wavers, STICK, contact.branch),
            )
            wavering += int(wavers.sum())
            opening += int((active != active[-1]).any(axis=0).sum())
        self.has_merged, self.opens_and_closes = True, opening > 0 and not wavering
        stuck = f"; {wavering} nodes between sticking and sliding stick in it" * bool(wavering)
        return (
            f"the active set does not converge (last {period} iterations); all nodes active in "
            f"them remain active for one iteration, and c_n is limited to {c_n:g}{stuck}"
        )


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
        self._floating.springs = self._obstacles.springs = None

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
