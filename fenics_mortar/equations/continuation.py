# SPDX-License-Identifier: MIT
"""Successive solves as a load path: if loads continue, the last two states are extrapolated.

A user's loop that changes loads and solves is a load path without time. The length of the next step
follows from the loads: each prescribed value, constant and function of the forms, obstacle and
offset has to change along its last change, all by the same ratio. The guess is the last state if

- nothing changed, or loads change direction, reverse, start or stop;
- a step is more than twice as long as the last one;
- a law was changed;
- the present state is not the result of the last solve;
- the bodies have inertia.

Otherwise the guess is that of ``predictor``, which compares its residual with that of the last
state.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.pair import Pretension
from fenics_mortar.contact.tied import Tie
from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.equations.options import EQUATIONS
from fenics_mortar.equations.predictor import Predictor
from fenics_mortar.newton.report import NewtonReport
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import as_text
from fenics_mortar.utils.ranks import on_all_ranks, sum_over_ranks
from fenics_mortar.utils.rounding import ROUNDING

# Attributes of an interface's state that a user may have changed since the last solve.
COMPARED = (
    "z", "active", "branch", "multiplier_nodes", "partners", "accepted_partners",
    "accepted_instant",
)  # fmt: skip


class _Loads(NamedTuple):
    """Values of all loads, distributed ones on this rank; laws as text."""

    values: list[Array]
    laws: list[str]


class Continuation:
    """The last two accepted states of a problem and their loads.

    Args:
        equations: The equations of the problem.
    """

    def __init__(self, equations: ContactEquations) -> None:
        self._equations = equations
        self._predictor: Predictor | None = None
        self._past: list[_Loads] = []
        self._step = 1.0

    def solve(self, solve: Callable[[], NewtonReport], *, guess: bool) -> NewtonReport:
        """Solve from a guess if loads continue, else from the present state (collective).

        Args:
            solve: Function that solves from the present state.
            guess: Whether to guess; never for bodies in motion, which have forces beyond the forms.

        Raises:
            NotConvergedError: On all ranks, if the solve fails; after a guess, if the solve from
                the present state fails as well.
        """
        if not guess or self._equations.bulk.inertia is not None:
            self._past = []
            return solve()
        if self._past and not self._is_last_state():
            self._past = []
        loads = self._loads()
        ratio = self._ratio(loads) if len(self._past) == 2 else 0.0
        step = self._step * ratio if ratio else 1.0
        if self._predictor is None or not self._past:
            report = solve()
            self._predictor = self._predictor or Predictor(self._equations, 0.0)
            self._predictor.begin(0.0)
        else:
            time = self._predictor.time + step
            report = self._predictor.solve(time, solve, guesses=ratio > 0.0)
        self._past, self._step = [*self._past[-1:], loads], step
        return report

    def _is_last_state(self) -> bool:
        """Whether the present state is the result of the last solve (collective)."""
        assert self._predictor is not None
        equations, last = self._equations, self._predictor.last
        history = equations.bulk.history.values
        same = np.array_equal(equations.bulk.u.x.array, last.u) and all(
            getattr(contact.state, name) is getattr(interface, name)
            for contact, interface in zip(equations.contacts, last.interfaces, strict=True)
            for name in COMPARED
        )
        found = equations.motions.found
        same &= np.array_equal(history.accepted, last.history.accepted)
        same &= np.array_equal(equations.motions.places[found], last.places[found])
        return on_all_ranks(equations.comm, same)

    def _loads(self) -> _Loads:
        """The present loads (local)."""
        motions, contacts = self._equations.motions, self._equations.contacts
        values = [*self._equations.bulk.input_data.loads(), *motions.loads]
        values += [load.motion.load.copy() for load in motions.spread]
        values += [np.array(contact.offset, float).ravel() for contact in contacts]
        ties = [contact.pair for contact in contacts if isinstance(contact, Tie)]
        values += [pair.present_jump() for pair in ties if not isinstance(pair, Pretension)]
        laws = [as_text(c.pair.law) for c in contacts if isinstance(c, Contact)]
        return _Loads(values, laws)

    def _ratio(self, loads: _Loads) -> float:
        """Length of the next load step over that of the last [1]; 0.0 if loads do not continue.

        Collective.
        """
        before, last = self._past
        parts = []
        for a, b, c in zip(before.values, last.values, loads.values, strict=True):
            done, next_ = b - a, c - b
            parts.append((done @ done, done @ next_, next_ @ next_, a @ a + b @ b + c @ c))
        sums = sum_over_ranks(self._equations.comm, np.reshape(parts, (-1, 4)))
        sums[:, :3] *= sums[:, :3].max(axis=1, keepdims=True) > ROUNDING**2 * sums[:, 3:]
        done2, product, next2, _ = sums.T
        if before.laws != loads.laws or last.laws != loads.laws or not done2.any():
            return 0.0
        first = np.flatnonzero(done2)[0]
        ratio = float(product[first] / done2[first])
        aside2 = next2 - 2.0 * ratio * product + ratio**2 * done2
        continues = 0.0 < ratio <= EQUATIONS.longest * (1.0 + ROUNDING)
        return ratio if continues and (aside2 <= EQUATIONS.same_direction**2 * next2).all() else 0.0
