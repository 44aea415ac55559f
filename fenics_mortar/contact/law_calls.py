# SPDX-License-Identifier: MIT
"""Laws as a contact uses them: checked calls, memory and fields of contact laws.

``LawCalls`` calls the law of a contact, ``Instant`` has its time and memory at the start of a step,
and ``Parameters`` evaluates parameters that vary in space.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

from mpi4py import MPI

import numpy as np

from dolfinx import fem

from fenics_mortar.contact.law import BUILT_IN, Branches, Friction, Law, Nodal, Row, mapped
from fenics_mortar.utils import errors
from fenics_mortar.utils.arrays import Array, Flags, Indices, protected, read_only_view


@dataclass(frozen=True, eq=False)
class Instant:
    """Time and memory of a contact law at an accepted state, a value.

    A step starts from it, and replaces it at its end.

    Attributes:
        time: Its time.
        step: Length of the step that ended there; 1 before the first one [time].
        memory: The law's numbers by name, shape (slave nodes,) each; read-only.
    """

    time: float
    step: float
    memory: Mapping[str, Array]

    @classmethod
    def of(cls, time: float, step: float, memory: Mapping[str, Array]) -> Instant:
        """An instant with read-only arrays of shape (slave nodes,) for ``memory`` (local)."""
        kept = {name: protected(np.asarray(values, float)) for name, values in memory.items()}
        return cls(time, step, MappingProxyType(kept))

    def __reduce__(self) -> tuple[Any, ...]:
        """How a pickle or a deep copy makes it again: a mapping proxy has no pickle (local)."""
        return Instant.of, (self.time, self.step, dict(self.memory))


def first_instant(law: Law, X: Array, time: float, comm: MPI.Comm) -> Instant:
    """Time and initial memory of a law at slave nodes, undeformed (n, dim) [length] (collective).

    Raises:
        Exception: Any error of ``law.initial``, on all ranks.
        ValueError: If it returns other names, shapes or values.
    """

    def initial() -> Mapping[str, Array]:
        return check_memory(law, "initial", law.initial(X.copy()), len(X))

    memory = errors.call_together(comm, f"{law!r}", initial) if law.memory else {}
    if law.summed_slip and X.shape[1] == 3:
        memory = in_components(law, memory, np.zeros_like(X))
    errors.check_same(comm, [(f"{name} of {law!r}", values) for name, values in memory.items()])
    return Instant.of(time, 1.0, memory)


def names_of_memory(law: Law, dim: int) -> tuple[str, ...]:
    """Names of the numbers that a law stores at each node, in space of components (local)."""
    names = list(law.memory)
    if law.summed_slip and dim == 3:
        at = names.index(law.summed_slip)
        names[at : at + 1] = [f"{law.summed_slip}_{axis}" for axis in "xyz"]
    return tuple(names)


def in_components(law: Law, memory: Mapping[str, Array], slip: Array) -> dict[str, Array]:
    """Memory of a law in space, [its units], its summed slip a vector ``slip`` (nodes, 3)."""
    names, values = names_of_memory(law, 3), dict(memory)
    del values[str(law.summed_slip)]
    axes = (name for name in names if name not in values)
    values |= dict(zip(axes, slip.T, strict=True))
    return {name: values[name] for name in names}


def summed_slip_of(law: Law, memory: Mapping[str, Array]) -> Array:
    """The vector of the summed slip in the memory of a law in space, (slave nodes, 3) [length]."""
    return np.column_stack([memory[f"{law.summed_slip}_{axis}"] for axis in "xyz"])


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


class Parameters:
    """Evaluation, at the slave nodes, of the parameters in ``Law.fields`` that are not numbers.

    Args:
        mesh: The mesh.
        name: Name of the slave surface.
        X: Undeformed positions of its nodes, shape (slave nodes, dim) [length].
        at_nodes: Returns the values of a function of dolfinx there, (slave nodes,) (collective).
    """

    def __init__(
        self, mesh: Any, name: str, X: Array, at_nodes: Callable[[fem.Function], Array]
    ) -> None:
        self._mesh, self._name, self._X, self._at_nodes = mesh, name, X, at_nodes

    def sample(self, law: Law) -> dict[str, Array]:
        """Values at the slave nodes by name, shape (slave nodes,) each [its unit] (collective).

        Raises:
            Exception: Any error of a user's function, on all ranks.
            ValueError: If values are not finite, not one per slave node, or not allowed; or if a
                function of dolfinx is not scalar and continuous, on the mesh of the problem.
            MortarError: If values differ between ranks.
        """
        comm, sampled = self._mesh.comm, {}
        for name, value in law.varying.items():
            if isinstance(value, fem.Function):
                errors.call_together(
                    comm, f"{law!r}", partial(self._check_function, law, name, value)
                )
                value = self._at_nodes(value)
            values = errors.call_together(comm, f"{law!r}", partial(self._values, law, name, value))
            errors.check_same(comm, [(f"{name} of {law!r}", values)])
            sampled[name] = values
        return sampled

    def _values(self, law: Law, name: str, value: Any) -> Array:
        """One parameter at the slave nodes, checked (local)."""
        found = value(self._X.copy()) if callable(value) else value
        numbers = check_numbers(law, name, found, len(self._X))
        try:
            law.check_field(name, numbers)
        except ValueError as error:
            low, high = (
                f"{numbers[j]:g} at {errors.format_point(self._X[j])}"
                for j in (numbers.argmin(), numbers.argmax())
            )
            on = f"on '{self._name}' it is {low} and {high}"
            raise ValueError(f"{law!r}: {error} ({on})") from error
        return numbers

    def _check_function(self, law: Law, name: str, function: fem.Function) -> None:
        """Raise for functions on another mesh, vectors and discontinuous functions (local)."""
        V, mesh = function.function_space, self._mesh
        per_cell = V.dofmap.dof_layout.num_dofs
        cells = mesh.topology.index_map(mesh.topology.dim).size_global
        whole = V.dofmap.index_map.size_global
        if V.mesh is not mesh or function.ufl_shape != () or (whole == cells * per_cell > 1):
            raise ValueError(
                f"{law!r}: {name} is {function}; expected a scalar and continuous function on the "
                "mesh of the problem"
            )


class LawCalls:
    """Calls of the law of one contact, with checks of users' laws and errors on all ranks (local).

    Every rank evaluates a law at all slave nodes, between collective calls. An error is therefore
    stored and a finite placeholder returned; ``raise_stored`` later raises the error on all ranks.
    Laws of the package are called without checks.

    Args:
        pair: The pair; its present law is called, and its slave's name stands in messages.

    Attributes:
        error: First error since the last ``raise_stored``, or ``None``.
    """

    def __init__(self, pair: Any) -> None:
        self._pair = pair
        self.error: Exception | None = None

    def branch(self, node: Nodal, before: Branches) -> Branches:
        """Branch of rho at each node, 0 for stick; ``before`` after an error."""
        law = self._pair.law
        if type(law) in BUILT_IN:
            return law.branch(node, before)
        with self._storing_errors():
            (branch,) = self._numbers("branch", [law.branch(*_protected(node, before))], node)
            whole = np.rint(np.nan_to_num(branch))
            if (whole != np.nan_to_num(branch)).any():
                raise ValueError(f"{law!r}: branch returned {branch}; expected integers")
            if isinstance(law, Friction):  # with a limit of nan all nodes would stick
                given = law.limit(*_protected(node))
                if not isinstance(given, (tuple, list)) or len(given) not in (3, len(Row._fields)):
                    raise ValueError(
                        f"{law!r}: limit returned {given!r}; expected a Row, or the limit and its "
                        f"derivatives by gap and z_n"
                    )
                (limit,) = self._arrays("limit", given[:1], before.size)
                self._numbers("limit", [np.where(np.isposinf(limit), 0.0, limit)], node)
            return whole.astype(np.int64)
        return before

    def row(self, method: str, node: Nodal, used: Flags, *branch: Branches) -> Row:
        """A row of the law; zero after an error.

        Args:
            method: ``tangential``, ``closing_gap`` or ``adhesion_at``, see ``Law``.
            node: State of the slave nodes.
            used: Nodes to which the law applies, shape (slave nodes,), bool.
            branch: Branches of the tangential row, shape (slave nodes,), int.
        """
        law, what = self._pair.law, method.removesuffix("_at")
        if type(law) in BUILT_IN:
            return getattr(law, method)(node, *branch)
        with self._storing_errors():
            given = getattr(law, method)(*_protected(node, *branch))
            if not isinstance(given, tuple) or len(given) != len(Row._fields):
                raise ValueError(f"{law!r}: {what} returned {given!r}; expected a Row")
            row = Row(*self._numbers(what, given, node, used))
            negative = used & (row.residual < 0.0)
            if what == "adhesion" and negative.any():
                j = int(np.argmax(negative))
                raise ValueError(
                    f"{law!r}: adhesion returned {row.residual[j]:g} for a gap of "
                    f"{node.gap[j]:g}; expected zero or a positive stress"
                )
            return row
        return Row(*np.zeros((len(Row._fields), node.gap.size)))

    def remember(self, node: Nodal, branch: Branches) -> Mapping[str, Array]:
        """Memory at the end of a converged step [its units]; that before after an error."""
        law = self._pair.law
        with self._storing_errors():
            memory = law.remember(*_protected(node, branch))
            return check_memory(law, "remember", memory, branch.size)
        return node.memory

    def friction_limit(self, node: Nodal) -> Array:
        """Largest |z_tau| at the pressures ``node.z_n`` [stress]; infinite after an error."""
        law, pressure = self._pair.law, node.z_n
        if type(law) in BUILT_IN:
            return law.friction_limit_at(node)
        with self._storing_errors():
            found = law.friction_limit_at(*_protected(node))
            (limit,) = self._arrays("friction_limit", [found], pressure.size)
            wrong = (np.isnan(limit) | (limit < 0.0)) & (pressure >= 0.0)
            if wrong.any():
                j = int(np.argmax(wrong))
                raise errors.NotFiniteError(
                    f"{law!r}: friction_limit returned {limit[j]:g} for a pressure of "
                    f"{pressure[j]:g}, at '{self._pair.slave_name}' "
                    f"{errors.format_point(node.x[j])}; expected zero, a positive number or "
                    "infinity"
                )
            return limit
        return np.full_like(pressure, np.inf)

    @contextmanager
    def _storing_errors(self) -> Iterator[None]:
        """Context that stores the first error of a user's law, and goes on after it."""
        try:
            yield
        except Exception as error:  # any error of a user's law
            self.error = self.error or error

    def _arrays(self, what: str, results: Iterable[Any], count: int) -> list[Array]:
        """Results as arrays of shape (count,); scalars are broadcast."""
        arrays = [np.asarray(result) for result in results]
        for array in arrays:
            if array.dtype.kind not in "iufb" or array.shape not in ((), (count,)):
                raise ValueError(
                    f"{self._pair.law!r}: {what} returned an array of shape {array.shape} and type "
                    f"{array.dtype}; expected real numbers of shape ({count},), one per slave node"
                )
        return [np.array(np.broadcast_to(array, count), float) for array in arrays]

    def _numbers(self, what: str, results: Any, node: Nodal, used: Any = True) -> list[Array]:
        """``_arrays``, finite at ``used`` nodes whose arguments are finite."""
        arrays = self._arrays(what, results, node.gap.size)
        arguments = node.gap, node.slip, node.z_n, node.z_tau, node.stiffness, node.c_n
        bad = used & np.isfinite(arguments).all(axis=0) & ~np.isfinite(arrays).all(axis=0)
        if bad.any():
            raise errors.NotFiniteError(
                f"{self._pair.law!r}: {what} returned numbers that are not finite at {bad.sum()} "
                f"nodes of '{self._pair.slave_name}', one at "
                f"{errors.format_point(node.x[np.argmax(bad)])}"
            )
        return arrays


def _protected(node: Nodal, *arrays: Indices) -> tuple[Any, ...]:
    """Read-only views of arguments, since a user's law might write into the arrays."""
    return mapped(node, read_only_view), *map(read_only_view, arrays)


def raise_stored(comm: MPI.Comm, contacts: Iterable[Any]) -> None:
    """Raise stored errors of users' laws on all ranks (collective).

    Args:
        comm: Communicator of the contacts.
        contacts: Contacts and ties.

    Raises:
        Exception: See ``errors.leave_together``.
    """
    users = list[Any]()
    for contact in contacts:  # a loop: this is called several times in each iteration
        if hasattr(contact, "law_calls") and type(contact.pair.law) not in BUILT_IN:
            users.append(contact)
    if not users:
        return
    raised = [contact.law_calls.error for contact in users]
    for contact in users:
        contact.law_calls.error = None
    law = users[0].pair.law if len(users) == 1 else "a law"
    errors.leave_together(comm, f"{law!r}", next((e for e in raised if e is not None), None))
