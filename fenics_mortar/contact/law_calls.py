# SPDX-License-Identifier: MIT
"""What the contact laws of users answer: checked, and raised on all ranks or on none.

Every rank asks a law for all slave nodes, in the middle of collective work. So an answer that is no
answer is noted, and something harmless used in its place, until ``raise_noted`` raises on all
ranks. The package's own laws are asked directly: it costs nothing then.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.laws import BUILT_IN, Array, Branches, Law, Nodal, Row
from fenics_mortar.utils.errors import NotFiniteError, leave_together, place

Marks = npt.NDArray[np.bool_]


class Asker:
    """Asks the law of one contact (local).

    Args:
        name: Of the slave surface, for messages.

    Attributes:
        error: What went wrong first since ``raise_noted``; ``None`` if nothing did.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self.error: Exception | None = None

    def branch(self, law: Law, node: Nodal, before: Branches, x: Array) -> Branches:
        """See ``Law.branch``; ``x``: places of the nodes, (slave nodes, 2), for messages."""
        if type(law) in BUILT_IN:
            return law.branch(node, before)

        def ask() -> Branches:
            answer = law.branch(_protected(node), _read_only(before))
            (branch,) = self._numbers(law, "branch", (answer,), before.size)
            self._check_finite(law, "branch", (branch,), _all_finite(node), x)
            whole = np.rint(np.nan_to_num(branch))
            if (whole != np.nan_to_num(branch)).any():
                raise ValueError(f"{law!r}: branch returned {branch}; right are whole numbers")
            return whole.astype(np.int64)

        return self._noting(ask, before)

    def tangential(self, law: Law, node: Nodal, branch: Branches, used: Marks, x: Array) -> Row:
        """See ``Law.tangential``; ``used``: the nodes that follow the law."""
        if type(law) in BUILT_IN:
            return law.tangential(node, branch)

        def ask() -> Row:
            row = law.tangential(_protected(node), _read_only(branch))
            if not isinstance(row, tuple) or len(row) != len(Row._fields):
                raise ValueError(f"{law!r}: tangential returned {row!r}; expected a Row")
            row = Row(*self._numbers(law, "tangential", row, branch.size))
            self._check_finite(law, "tangential", row, used & _all_finite(node), x)
            return row

        none = np.zeros(branch.size)
        return self._noting(ask, Row(node.z_tau, none, none, none, none + 1.0))

    def friction_limit(self, law: Law, pressure: Array, x: Array) -> Array:
        """See ``Law.friction_limit``."""
        if type(law) in BUILT_IN:
            return law.friction_limit(pressure)

        def ask() -> Array:
            (bound,) = self._numbers(
                law, "friction_limit", (law.friction_limit(_read_only(pressure)),), pressure.size
            )
            wrong = (np.isnan(bound) | (bound < 0.0)) & (pressure >= 0.0)
            if wrong.any():
                j = int(np.argmax(wrong))
                raise NotFiniteError(
                    f"{law!r}: friction_limit returned {bound[j]:g} for a pressure of "
                    f"{pressure[j]:g}, at '{self._name}' {place(x[j])}; expected zero, a "
                    "positive number or infinity"
                )
            return bound

        return self._noting(ask, np.full_like(pressure, np.inf))

    def adhesion(self, law: Law, gap: Array, x: Array) -> tuple[Array, Array]:
        """See ``Law.adhesion``."""
        if type(law) in BUILT_IN:
            return law.adhesion(gap)

        def ask() -> tuple[Array, Array]:
            answer = law.adhesion(_read_only(gap))
            if not isinstance(answer, tuple) or len(answer) != 2:
                raise ValueError(
                    f"{law!r}: adhesion returned {answer!r}; right are two arrays, the pull and "
                    "its derivative"
                )
            pull, by_gap = self._numbers(law, "adhesion", answer, gap.size)
            self._check_finite(law, "adhesion", (pull, by_gap), np.isfinite(gap), x)
            if (pull < 0.0).any():
                j = int(np.argmin(pull))
                raise ValueError(
                    f"{law!r}: adhesion returned {pull[j]:g} for a gap of {gap[j]:g}; expected a "
                    "pull, zero or positive"
                )
            return pull, by_gap

        return self._noting(ask, (np.zeros_like(gap), np.zeros_like(gap)))

    def _noting(self, ask: Callable[[], Any], instead: Any) -> Any:
        """What ``ask`` returns; if it raises, note that and return something ``instead``."""
        try:
            return ask()
        except Exception as error:  # of a user's law: any
            self.error = self.error or error
            return instead

    def _numbers(self, law: Law, what: str, answers: Iterable[Any], count: int) -> list[Array]:
        """Answers as arrays of shape (count,); a number stands for all nodes."""
        arrays = [np.asarray(answer) for answer in answers]
        for array in arrays:
            if array.dtype.kind not in "iufb" or array.shape not in ((), (count,)):
                raise ValueError(
                    f"{law!r}: {what} returned an array of shape {array.shape} and type "
                    f"{array.dtype}; right are real numbers of shape ({count},), one a slave node"
                )
        return [np.array(np.broadcast_to(array, count), float) for array in arrays]

    def _check_finite(
        self, law: Law, what: str, answers: Iterable[Array], asked: Marks, x: Array
    ) -> None:
        """Refuse nan and infinity where the arguments were finite."""
        bad = asked & ~np.all([np.isfinite(answer) for answer in answers], axis=0)
        if bad.any():
            raise NotFiniteError(
                f"{law!r}: {what} returned numbers that are not finite at {bad.sum()} nodes of "
                f"'{self._name}', one at {place(x[np.argmax(bad)])}"
            )


def raise_noted(comm: MPI.Comm, contacts: Iterable[Any]) -> None:
    """Raise on all ranks what a law of a user did wrong on any (collective).

    Args:
        comm: Communicator of the contacts.
        contacts: Contacts and ties.

    Raises:
        Exception: See ``errors.leave_together``.
    """
    asked = [c for c in contacts if hasattr(c, "asker") and type(c.pair.law) not in BUILT_IN]
    if not asked:
        return
    errors = [contact.asker.error for contact in asked]
    for contact in asked:
        contact.asker.error = None
    law = asked[0].pair.law if len(asked) == 1 else "a law"
    leave_together(comm, f"{law!r}", next((e for e in errors if e is not None), None))


def _all_finite(node: Nodal) -> Marks:
    """Where all that a law is told is finite."""
    return np.all([np.isfinite(values) for values in vars(node).values()], axis=0)


def _protected(node: Nodal) -> Nodal:
    """Read-only views of ``node``, for a law that might write into it."""
    return Nodal(**{name: _read_only(values) for name, values in vars(node).items()})


def _read_only(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """A view that cannot be written into: what is in there is the state."""
    view = array.view()
    view.flags.writeable = False
    return view
