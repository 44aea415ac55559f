# SPDX-License-Identifier: MIT
"""Solves that are interrupted: the problem is then as it was before.

An interruption is a KeyboardInterrupt, or whatever else comes from elsewhere than the equations, as
from a function of the user. It may come anywhere, and on one rank only: what is undone is undone
without communication. What was half made of matrices, factors and solvers is made anew when the
next solve begins.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.la.options import drop_added_options
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.errors import MortarError, RaisedElsewhereError


class Before:
    """A problem as it is now, to go back to (local).

    Args:
        equations: Its equations.
        adequacy: Its ``AdequacyCheck``, or ``None``.
    """

    def __init__(self, equations: ContactEquations, adequacy: Any) -> None:
        self._equations, self._state, self._depth = equations, equations.state(), clock.depth
        self._operators = [contact.operators for contact in equations.contacts]
        self._springs = equations.floating.springs, equations.motions.springs
        self._take_back_adequacy = adequacy.remember() if adequacy is not None else None

    def take_back(self, *, renew: bool) -> None:
        """Go back; ``renew``: make matrices and solvers anew in the next solve."""
        equations = self._equations
        clock.leave(self._depth)
        drop_added_options()
        equations.put(self._state)
        for contact, operators in zip(equations.contacts, self._operators, strict=True):
            contact.show(operators)
        equations.floating.springs, equations.motions.springs = self._springs
        if self._take_back_adequacy is not None:
            self._take_back_adequacy()
        equations.interrupted |= renew


@contextmanager
def undone_if_interrupted(equations: ContactEquations, adequacy: Any) -> Iterator[None]:
    """A block after which a ``ContactProblem`` is as before if anything but the package raises."""
    before = Before(equations, adequacy)
    try:
        yield
    except MortarError as error:
        if isinstance(error, RaisedElsewhereError):  # on that rank it is another error
            before.take_back(renew=True)
        raise
    except BaseException:
        before.take_back(renew=True)
        raise
