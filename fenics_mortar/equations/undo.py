# SPDX-License-Identifier: MIT
"""Undo of interrupted or refused solves and set-ups: all is as it was before.

An interruption is a KeyboardInterrupt or any other exception that does not come from the equations,
such as an error of a user's function. It may occur anywhere and on one rank only; therefore a state
is restored without communication. Incomplete matrices, factors and solvers are created again at the
start of the next solve.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

from fenics_mortar.equations.general import ContactEquations
from fenics_mortar.la.options import drop_added_options
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.errors import MortarError, NotConvergedError


@contextmanager
def unchanged_if_refused(u: Any) -> Iterator[None]:
    """Context that restores mesh and displacement if a set-up raises any exception (local).

    Ties move nodes, and cheaper models may displace them.

    Args:
        u: The function of the unknowns.
    """
    positions, values = u.function_space.mesh.geometry.x, u.x.array
    before = positions.copy(), values.copy()
    try:
        yield
    except BaseException:
        positions[:], values[:] = before
        raise


class Snapshot:
    """Snapshot of a problem (local).

    Args:
        equations: The equations of the problem.
    """

    def __init__(self, equations: ContactEquations) -> None:
        self._equations, self._state, self._depth = equations, equations.state(), clock.depth
        self._operators = [contact.operators for contact in equations.contacts]
        self._springs = equations.floating.springs, equations.motions.springs
        model_check = equations.model_check
        self._revert_model_check = None if model_check is None else model_check.snapshot()

    def revert(self, *, renew: bool) -> None:
        """Restore the snapshot; ``renew``: create matrices and solvers again in the next solve."""
        equations = self._equations
        clock.leave(self._depth)
        drop_added_options()
        equations.put(self._state)
        for contact, operators in zip(equations.contacts, self._operators, strict=True):
            contact.set_operators(operators)
        equations.floating.springs, equations.motions.springs = self._springs
        if self._revert_model_check is not None:
            self._revert_model_check()
        equations.interrupted |= renew


@contextmanager
def restored_if_interrupted(equations: ContactEquations) -> Iterator[None]:
    """Context that restores a problem if any exception but ``NotConvergedError`` is raised."""
    before = Snapshot(equations)
    try:
        yield
    except NotConvergedError:
        raise
    except MortarError:
        before.revert(renew=True)
        raise
    except BaseException as error:
        before.revert(renew=True)
        raise_cause(error)


def raise_cause(error: BaseException) -> NoReturn:
    """Raise an error, or the interruption that caused it; see ``as_interruption``."""
    interruption = as_interruption(error)
    if interruption is error:
        raise error
    raise interruption from error


def as_interruption(error: BaseException) -> BaseException:
    """Return a KeyboardInterrupt for an error that one in compiled code caused (local).

    Numba reports an exception that is set during a call as a SystemError. Any other error is
    returned unchanged.
    """
    cause: BaseException | None = error
    while isinstance(cause, SystemError):
        cause = cause.__cause__ or cause.__context__
    if isinstance(error, SystemError) and isinstance(cause, KeyboardInterrupt):
        return KeyboardInterrupt(*cause.args)
    return error
