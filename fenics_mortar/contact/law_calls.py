# SPDX-License-Identifier: MIT
"""Calls of contact laws, with checks of users' laws and errors on all ranks.

Every rank evaluates a law at all slave nodes, between collective calls. An error is therefore
stored and a finite placeholder returned; ``raise_stored`` later raises the error on all ranks. Laws
of the package are called without checks.

Time and memory of a contact law at the start of a step, replaced at its end.

Parameters of a law that vary in space are evaluated at the slave nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from types import MappingProxyType
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from fenics_mortar.contact.law import BUILT_IN, Branches, Friction, Law, Nodal, Row
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array, Indices, read_only_view
from fenics_mortar.utils.errors import (
    NotFiniteError,
    call_together,
    check_same,
    format_point,
    leave_together,
)


@dataclass(frozen=True, eq=False)
class Instant:
    """Time and memory at an accepted state, a value.

    Attributes:
        time: Its time.
        step: Length of the step that ended there; 1 before the first one [time].
        memory: The law's numbers by name, shape (slave nodes,) each; read-only.
    """

    time: float = 0.0
    step: float = 1.0
    memory: Mapping[str, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, time: float, step: float, memory: Mapping[str, Array]) -> Instant:
        """An instant with copies of the arrays of shape (slave nodes,) in ``memory`` (local)."""
        kept = {name: np.array(values, float) for name, values in memory.items()}
        for values in kept.values():
            values.flags.writeable = False
        return cls(time, step, MappingProxyType(kept))

    def __reduce__(self) -> tuple[Any, ...]:
        """How a pickle or a deep copy makes it again: a mapping proxy has no pickle (local)."""
        return Instant.of, (self.time, self.step, dict(self.memory))

    def begins(self, law: Law) -> bool:
        """Whether the memory has other names than that of ``law``."""
        return tuple(self.memory) != tuple(law.memory)


def first_instant(law: Law, slave: Surface, time: float) -> Instant:
    """Time and initial memory of a law at the slave nodes (collective).

    Raises:
        Exception: Any error of ``law.initial``, on all ranks.
        ValueError: If it returns other names, shapes or values.
    """

    def initial() -> Mapping[str, Array]:
        return check_memory(law, "initial", law.initial(slave.X.copy()), slave.num_nodes)

    memory = call_together(slave.comm, f"{law!r}", initial) if law.memory else {}
    check_same(slave.comm, [(f"{name} of {law!r}", values) for name, values in memory.items()])
    return Instant.of(time, 1.0, memory)


def check_memory(law: Law, what: str, result: Any, count: int) -> dict[str, Array]:
    """Memory returned by a law, in the order of its names, (slave nodes,) each [its units] (local).

    Raises:
        ValueError: If names, shapes or values are not allowed.
    """
    if not isinstance(result, Mapping) or set(result) != set(law.memory):
        raise ValueError(
            f"{law!r}: {what} returned {result!r}; expected arrays named {', '.join(law.memory)}"
        )
    return {name: check_numbers(law, f"{what}: {name}", result[name], count) for name in law.memory}


def check_numbers(law: Law, what: str, values: Any, count: int) -> Array:
    """Check for finite real numbers, one per slave node; return them, (slave nodes,) [any unit]."""
    array = np.asarray(values)
    if array.shape != (count,) or array.dtype.kind not in "iufb":
        raise ValueError(
            f"{law!r}: {what} has shape {array.shape} and type {array.dtype}; expected real "
            f"numbers of shape ({count},), one per slave node"
        )
    if not np.isfinite(array).all():
        raise ValueError(f"{law!r}: {what} is not finite at {(~np.isfinite(array)).sum()} nodes")
    return array.astype(float)


def instant_arrays(contact: Any) -> tuple[list[str], Array, Array]:
    """Names of the memory, time and step (2,), and memory (names, slave nodes), for files (local).

    Units are those of the law [time, its units]. Names and memory of a tie are empty.
    """
    instant, count = contact.state.accepted_instant or Instant(), contact.slave.num_nodes
    values = np.array(list(instant.memory.values()), float).reshape(-1, count)
    return list(instant.memory), np.array([instant.time, instant.step]), values


def restore_instant(contact: Any, clock: Array, values: Array) -> None:
    """Set (time, step) and memory (names, slave nodes) from a file, for the present law (local)."""
    time, step = map(float, clock)
    instant = contact.state.accepted_instant
    if instant is not None:
        memory = dict(zip(instant.memory, values, strict=True))
        contact.change(accepted_instant=Instant.of(time, step, memory))
    contact.change(load_time=time)


class Parameters:
    """Evaluation of the parameters in ``Law.fields`` that are not numbers.

    Args:
        space: Nodes and dofs of the displacement.
        slave: The slave surface.
    """

    def __init__(self, space: DisplacementSpace, slave: Surface) -> None:
        self._space, self._slave = space, slave

    def sample(self, law: Law) -> dict[str, Array]:
        """Values at the slave nodes by name, shape (slave nodes,) each [its unit] (collective).

        Raises:
            Exception: Any error of a user's function, on all ranks.
            ValueError: If values are not finite, not one per slave node, or not allowed; or if a
                function of dolfinx is not scalar and continuous, on the mesh of the problem.
            MortarError: If values differ between ranks.
        """
        comm, sampled = self._slave.comm, {}
        for name, value in law.varying.items():
            if isinstance(value, fem.Function):
                call_together(comm, f"{law!r}", partial(self._check_function, law, name, value))
                value = self._at_nodes(value)
            values = call_together(comm, f"{law!r}", partial(self._values, law, name, value))
            check_same(comm, [(f"{name} of {law!r}", values)])
            sampled[name] = values
        return sampled

    def _values(self, law: Law, name: str, value: Any) -> Array:
        """One parameter at the slave nodes, checked (local)."""
        found = value(self._slave.X.copy()) if callable(value) else value
        numbers = check_numbers(law, name, found, self._slave.num_nodes)
        try:
            law.check_field(name, numbers)
        except ValueError as error:
            low, high = (
                f"{numbers[j]:g} at {format_point(self._slave.X[j])}"
                for j in (numbers.argmin(), numbers.argmax())
            )
            on = f"on '{self._slave.name}' it is {low} and {high}"
            raise ValueError(f"{law!r}: {error} ({on})") from error
        return numbers

    def _check_function(self, law: Law, name: str, function: fem.Function) -> None:
        """Raise for functions on another mesh, vectors and discontinuous functions (local)."""
        V, mesh = function.function_space, self._space.V.mesh
        per_cell = V.dofmap.dof_layout.num_dofs
        cells = mesh.topology.index_map(mesh.topology.dim).size_global
        whole = V.dofmap.index_map.size_global
        if V.mesh is not mesh or function.ufl_shape != () or (whole == cells * per_cell > 1):
            raise ValueError(
                f"{law!r}: {name} is {function}; expected a scalar and continuous function on the "
                "mesh of the problem"
            )

    @cached_property
    def _scalar(self) -> tuple[fem.Function, Indices]:
        """A function of one component of the displacement's space, and local nodes of its dofs."""
        V, dofs = self._space.V.sub(0).collapse()
        return fem.Function(V), np.asarray(dofs, np.int64) // self._space.dim

    def _at_nodes(self, function: fem.Function) -> Array:
        """Values of a function at the slave nodes (collective)."""
        scalar, nodes = self._scalar
        scalar.interpolate(function)
        scalar.x.scatter_forward()
        values = np.zeros(len(self._space.dofs))
        values[nodes] = scalar.x.array
        return self._slave.gather(self._space.spread(values))[:, 0]


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
