# SPDX-License-Identifier: MIT
"""Active sets and residuals of the iterations of a solve, and a remedy for cycles of sets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.discretization import Discretization
from fenics_mortar.contact.laws import STICK, Branches
from fenics_mortar.contact.tied import Tie
from fenics_mortar.equations.options import EQUATIONS
from fenics_mortar.newton.loop import decreased
from fenics_mortar.utils.arrays import Flags

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
