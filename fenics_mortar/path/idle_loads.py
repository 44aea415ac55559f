# SPDX-License-Identifier: MIT
"""Remark on a path whose loads never change, as if ``set_loads`` made a new constant each time."""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.steps import needing_time
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.errors import as_text
from fenics_mortar.utils.ranks import on_any_rank


class IdleLoads:
    """Comparison of the loads of all steps with those before the path.

    Args:
        problem: The problem, before the first step.
    """

    def __init__(self, problem: ContactProblem) -> None:
        self._problem, self._changed = problem, False
        self._first = self._loads()

    def look(self) -> None:
        """Compare the present loads (local)."""
        if not self._changed:
            pairs = zip(self._first, self._loads(), strict=True)
            self._changed = not all(np.array_equal(a, b) for a, b in pairs)

    def remarks(self, num_steps: int) -> list[str]:
        """The remark after several steps without any change; else none (collective).

        Laws that depend on the time may be the reason for such a path.

        Args:
            num_steps: Number of accepted steps.
        """
        contacts, comm = self._problem.equations.contacts, self._problem.equations.comm
        timed = any(isinstance(c, Contact) and needing_time(c) for c in contacts)
        if on_any_rank(comm, self._changed) or timed or num_steps < 2:
            return []
        return [
            "set_loads changed no constant, function, prescribed value, obstacle or law of the "
            "problem in any step: set values in place, e.g. push.value[1] = -0.03 * time"
        ]

    def _loads(self) -> list[Any]:
        """Values that ``set_loads`` may set, in a fixed order (local)."""
        equations, motions = self._problem.equations, self._problem.equations.motions
        found: list[Any] = [
            *equations.bulk.input_data.loads(),
            *np.where(motions.driven, motions.push(), motions.places),
        ]
        found += [value for o in self._problem.obstacles for value in o.shape().values()]
        found += [np.array(contact.offset, float) for contact in equations.contacts]
        found += [as_text(c.pair.law) for c in equations.contacts if isinstance(c, Contact)]
        return found
