# SPDX-License-Identifier: MIT
"""Time and memory of a contact law at the start of a step, replaced at its end.

Parameters of a law that vary in space are evaluated at the slave nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from types import MappingProxyType
from typing import Any

import numpy as np

from dolfinx import fem

from fenics_mortar.contact.law import Law
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import call_together, check_same, format_point


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
