# SPDX-License-Identifier: MIT
"""Remedies of Newton's method if active sets do not converge or bodies do not come to rest."""

from __future__ import annotations

from collections.abc import Callable

from fenics_mortar.equations.residual import Residual
from fenics_mortar.equations.set_record import SetRecord
from fenics_mortar.newton.loop import UNSETTLED
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.rigid.options import RIGID


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
