# SPDX-License-Identifier: MIT
"""Calls of contact laws, with checks of users' laws and errors on all ranks.

Every rank evaluates a law at all slave nodes, between collective calls. An error is therefore
stored and a finite placeholder returned; ``raise_stored`` later raises the error on all ranks. Laws
of the package are called without checks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.instant import check_memory
from fenics_mortar.contact.laws import BUILT_IN, Array, Branches, Friction, Law, Nodal, Row
from fenics_mortar.utils.arrays import read_only_view
from fenics_mortar.utils.errors import NotFiniteError, format_point, leave_together

Marks = npt.NDArray[np.bool_]


class LawCalls:
    """Calls of the law of one contact (local).

    Args:
        name: Name of the slave surface, for messages.

    Attributes:
        error: First error since the last ``raise_stored``, or ``None``.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self.error: Exception | None = None

    def branch(self, law: Law, node: Nodal, before: Branches, x: Array) -> Branches:
        """See ``Law.branch``; ``x``: positions of the nodes, (slave nodes, 2), for messages."""
        if type(law) in BUILT_IN:
            return law.branch(node, before)

        def call() -> Branches:
            result = law.branch(_protected(node), read_only_view(before))
            (branch,) = self._numbers(law, "branch", (result,), before.size)
            self._check_finite(law, "branch", (branch,), _all_finite(node), x)
            whole = np.rint(np.nan_to_num(branch))
            if (whole != np.nan_to_num(branch)).any():
                raise ValueError(f"{law!r}: branch returned {branch}; expected integers")
            if isinstance(law, Friction):  # with a limit of nan all nodes would stick
                given = law.limit(_protected(node))
                if not isinstance(given, (tuple, list)) or len(given) not in (3, len(Row._fields)):
                    raise ValueError(
                        f"{law!r}: limit returned {given!r}; expected a Row, or the limit and its "
                        f"derivatives by gap and z_n"
                    )
                limits = self._numbers(law, "limit", given[:1], before.size)
                finite = [np.where(np.isposinf(limit), 0.0, limit) for limit in limits]
                self._check_finite(law, "limit", finite, _all_finite(node), x)
            return whole.astype(np.int64)

        return self._storing_errors(call, before)

    def tangential(self, law: Law, node: Nodal, branch: Branches, used: Marks, x: Array) -> Row:
        """See ``Law.tangential``; ``used``: nodes to which the law applies."""
        if type(law) in BUILT_IN:
            return law.tangential(node, branch)

        def call() -> Row:
            row = law.tangential(_protected(node), read_only_view(branch))
            return self._row(law, "tangential", row, node, used, x)

        none = np.zeros(branch.size)
        return self._storing_errors(call, Row(node.z_tau, none, none, none, none + 1.0))

    def closing_gap(self, law: Law, node: Nodal, used: Marks, x: Array) -> Row:
        """See ``Law.closing_gap``; ``used``: nodes to which the law applies."""

        def call() -> Row:
            row = law.closing_gap(_protected(node))
            return self._row(law, "closing_gap", row, node, used, x)

        none = np.zeros(node.gap.size)
        return self._storing_errors(call, Row(node.gap, none + 1.0, none, none, none))

    def adhesion_at(self, law: Law, node: Nodal, used: Marks, x: Array) -> Row:
        """See ``Law.adhesion_at``; ``used``: nodes to which the law applies."""

        def call() -> Row:
            row = self._row(law, "adhesion", law.adhesion_at(_protected(node)), node, used, x)
            wrong = used & (row.residual < 0.0)
            if wrong.any():
                j = int(np.argmax(wrong))
                raise ValueError(
                    f"{law!r}: adhesion returned {row.residual[j]:g} for a gap of "
                    f"{node.gap[j]:g}; expected zero or a positive stress"
                )
            return row

        none = np.zeros(node.gap.size)
        return self._storing_errors(call, Row(none, none, none, none, none))

    def remember(self, law: Law, node: Nodal, branch: Branches) -> Mapping[str, Array]:
        """See ``Law.remember``."""

        def call() -> Mapping[str, Array]:
            result = law.remember(_protected(node), read_only_view(branch))
            return check_memory(law, "remember", result, branch.size)

        return self._storing_errors(call, node.memory)

    def friction_limit(self, law: Law, pressure: Array, x: Array) -> Array:
        """See ``Law.friction_limit``."""
        if type(law) in BUILT_IN:
            return law.friction_limit(pressure)
        return self._limit(law, lambda: law.friction_limit(read_only_view(pressure)), pressure, x)

    def friction_limit_at(self, law: Law, node: Nodal, x: Array) -> Array:
        """See ``Law.friction_limit_at``."""
        return self._limit(law, lambda: law.friction_limit_at(_protected(node)), node.z_n, x)

    def _limit(self, law: Law, limits: Callable[[], Array], pressure: Array, x: Array) -> Array:
        """Friction limits at given pressures, checked."""

        def call() -> Array:
            (limit,) = self._numbers(law, "friction_limit", (limits(),), pressure.size)
            wrong = (np.isnan(limit) | (limit < 0.0)) & (pressure >= 0.0)
            if wrong.any():
                j = int(np.argmax(wrong))
                raise NotFiniteError(
                    f"{law!r}: friction_limit returned {limit[j]:g} for a pressure of "
                    f"{pressure[j]:g}, at '{self._name}' {format_point(x[j])}; expected zero, a "
                    "positive number or infinity"
                )
            return limit

        return self._storing_errors(call, np.full_like(pressure, np.inf))

    def _row(self, law: Law, what: str, row: Any, node: Nodal, used: Marks, x: Array) -> Row:
        """A row of arrays (slave nodes,), finite at the nodes where it is used."""
        if not isinstance(row, tuple) or len(row) != len(Row._fields):
            raise ValueError(f"{law!r}: {what} returned {row!r}; expected a Row")
        row = Row(*self._numbers(law, what, row, node.gap.size))
        self._check_finite(law, what, row, used & _all_finite(node), x)
        return row

    def _storing_errors(self, call: Callable[[], Any], instead: Any) -> Any:
        """Result of ``call``, or ``instead`` if it raises; the error is stored."""
        try:
            return call()
        except Exception as error:  # any error of a user's law
            self.error = self.error or error
            return instead

    def _numbers(self, law: Law, what: str, results: Iterable[Any], count: int) -> list[Array]:
        """Results as arrays of shape (count,); scalars are broadcast."""
        arrays = [np.asarray(result) for result in results]
        for array in arrays:
            if array.dtype.kind not in "iufb" or array.shape not in ((), (count,)):
                raise ValueError(
                    f"{law!r}: {what} returned an array of shape {array.shape} and type "
                    f"{array.dtype}; expected real numbers of shape ({count},), one per slave node"
                )
        return [np.array(np.broadcast_to(array, count), float) for array in arrays]

    def _check_finite(
        self, law: Law, what: str, results: Iterable[Array], checked: Marks, x: Array
    ) -> None:
        """Raise if a result is not finite at ``checked`` nodes, those with finite arguments."""
        bad = checked & ~np.all([np.isfinite(result) for result in results], axis=0)
        if bad.any():
            raise NotFiniteError(
                f"{law!r}: {what} returned numbers that are not finite at {bad.sum()} nodes of "
                f"'{self._name}', one at {format_point(x[np.argmax(bad)])}"
            )


def raise_stored(comm: MPI.Comm, contacts: Iterable[Any]) -> None:
    """Raise stored errors of users' laws on all ranks (collective).

    Args:
        comm: Communicator of the contacts.
        contacts: Contacts and ties.

    Raises:
        Exception: See ``errors.leave_together``.
    """
    users = [c for c in contacts if hasattr(c, "law_calls") and type(c.pair.law) not in BUILT_IN]
    if not users:
        return
    errors = [contact.law_calls.error for contact in users]
    for contact in users:
        contact.law_calls.error = None
    law = users[0].pair.law if len(users) == 1 else "a law"
    leave_together(comm, f"{law!r}", next((e for e in errors if e is not None), None))


def _all_finite(node: Nodal) -> Marks:
    """Nodes at which all arguments are finite."""
    arguments = node.gap, node.slip, node.z_n, node.z_tau, node.stiffness, node.c_n
    return np.all([np.isfinite(values) for values in arguments], axis=0)


def _protected(node: Nodal) -> Nodal:
    """Read-only views of ``node``, since a user's law might write into the arrays."""
    arrays = {name: value for name, value in vars(node).items() if isinstance(value, np.ndarray)}
    views: dict[str, Any] = {name: read_only_view(values) for name, values in arrays.items()}
    return replace(node, **views)
