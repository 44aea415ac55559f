# SPDX-License-Identifier: MIT
"""Calls of contact laws, with checks of users' laws and errors on all ranks.

Every rank evaluates a law at all slave nodes, between collective calls. An error is therefore
stored and a finite placeholder returned; ``raise_stored`` later raises the error on all ranks. Laws
of the package are called without checks.

Time and memory of a contact law at the start of a step, replaced at its end.

Parameters of a law that vary in space are evaluated at the slave nodes.

Conductance of an interface for a scalar field: temperature, potential, concentration, pressure.

The flux from slave to master is q = h (T_slave - T_master), with h a function of contact pressure
and gap. Frictional power may be a source on both sides. See ``fluxes`` for the weak form.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from mpi4py import MPI

import numpy as np

from dolfinx import fem

from fenics_mortar.contact.law import BUILT_IN, Branches, Friction, Law, Nodal, Row, mapped
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Flags, Indices, protected, read_only_view
from fenics_mortar.utils.errors import (
    MortarError,
    NotFiniteError,
    call_together,
    check_number,
    check_same,
    format_point,
    leave_together,
)

if TYPE_CHECKING:
    from fenics_mortar.interface.surfaces import Surface
    from fenics_mortar.mesh.space import DisplacementSpace


@dataclass(frozen=True, eq=False)
class Instant:
    """Time and memory at an accepted state, a value.

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


def first_instant(law: Law, slave: Surface, time: float) -> Instant:
    """Time and initial memory of a law at the slave nodes (collective).

    Raises:
        Exception: Any error of ``law.initial``, on all ranks.
        ValueError: If it returns other names, shapes or values.
    """

    def initial() -> Mapping[str, Array]:
        return check_memory(law, "initial", law.initial(slave.X.copy()), slave.num_nodes)

    memory = call_together(slave.comm, f"{law!r}", initial) if law.memory else {}
    if law.summed_slip and slave.dim == 3:
        memory = in_components(law, memory, np.zeros_like(slave.X))
    check_same(slave.comm, [(f"{name} of {law!r}", values) for name, values in memory.items()])
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
        V, dofs = compat.collapsed(self._space.V.sub(0))
        return fem.Function(V), dofs // self._space.dim

    def _at_nodes(self, function: fem.Function) -> Array:
        """Values of a function at the slave nodes (collective)."""
        scalar, nodes = self._scalar
        scalar.interpolate(function)
        scalar.x.scatter_forward()
        values = np.zeros(len(self._space.dofs))
        values[nodes] = scalar.x.array
        return self._slave.gather(self._space.spread(values))[:, 0]


class LawCalls:
    """Calls of the law of one contact (local).

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
                raise NotFiniteError(
                    f"{law!r}: friction_limit returned {limit[j]:g} for a pressure of "
                    f"{pressure[j]:g}, at '{self._pair.slave_name}' {format_point(node.x[j])}; "
                    "expected zero, a positive number or infinity"
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
            raise NotFiniteError(
                f"{self._pair.law!r}: {what} returned numbers that are not finite at {bad.sum()} "
                f"nodes of '{self._pair.slave_name}', one at {format_point(node.x[np.argmax(bad)])}"
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
    errors = [contact.law_calls.error for contact in users]
    for contact in users:
        contact.law_calls.error = None
    law = users[0].pair.law if len(users) == 1 else "a law"
    leave_together(comm, f"{law!r}", next((e for e in errors if e is not None), None))


# Pressure over the reference pressure [1] below which a power law with an exponent below 1, whose
# slope is infinite at zero, is continued by a parabola with the same value and slope: Newton's
# method needs a finite slope where contact closes. The conductance is then 0.1 % of the reference.
SMALL_PRESSURE = 1e-3


class ConductanceValue(NamedTuple):
    """Conductance and its derivatives, each of shape (slave nodes,) or a scalar.

    Attributes:
        h: Conductance [flux / field].
        by_pressure: Its derivative by the pressure [flux / field / stress].
        by_gap: Its derivative by the gap [flux / field / length].
    """

    h: Any
    by_pressure: Any = 0.0
    by_gap: Any = 0.0


# Function of pressures and gaps, (slave nodes,) each, that returns h, dh/dp and dh/dg.
ConductanceFunction = Callable[[Array, Array], Sequence[Any]]
# Function of pressures (slave nodes,) and undeformed positions (slave nodes, dim) that returns
# power per area and its derivative by pressure.
HeatingFunction = Callable[[Array, Array], Sequence[Any]]


@dataclass(frozen=True)
class ClosedConductance:
    """Constant conductance where contact is closed, zero where it is open.

    Attributes:
        h: The conductance [flux / field].
    """

    h: float

    def __call__(self, pressure: Array, gap: Array) -> ConductanceValue:
        """Conductance at pressures [stress] and gaps [length], (slave nodes,) each (local)."""
        return ConductanceValue(np.where(gap <= 0.0, self.h, 0.0))


class _Smooth:
    """Base of conductances that do not jump where contact closes, of positive numbers."""

    def __post_init__(self) -> None:
        """Check all numbers."""
        for name, value in vars(self).items():
            check_number(name, value, "a positive number", lambda number: number > 0.0)


@dataclass(frozen=True)
class PressureConductance(_Smooth):
    """Conductance of rough surfaces in contact, h (p / p_0)^m; zero where contact is open.

    Below 0.1 % of p_0 a parabola replaces powers m < 1, whose slope is infinite at p = 0.

    Attributes:
        h: Conductance at the reference pressure [flux / field].
        pressure: Reference pressure p_0, such as the hardness [stress].
        exponent: m; 0.95 of plastic contact of asperities (Cooper, Mikic & Yovanovich 1969) [1].

    Raises:
        ValueError: If one of them is not a positive number.
    """

    h: float
    pressure: float
    exponent: float = 0.95

    def __call__(self, pressure: Array, gap: Array) -> ConductanceValue:
        """Conductance at pressures [stress] and gaps [length], (slave nodes,) each (local)."""
        ratio, m = np.maximum(pressure, 0.0) / self.pressure, self.exponent
        start = SMALL_PRESSURE if m < 1.0 else 0.0
        large = np.maximum(ratio, start)
        value, slope = large**m, m * large ** (m - 1.0)
        if start:
            s, small = ratio / start, ratio < start
            value = np.where(small, start**m * s * (2.0 - m + (m - 1.0) * s), value)
            parabola = start ** (m - 1.0) * (2.0 - m + 2.0 * (m - 1.0) * s)
            slope = np.where(small, parabola, slope)
        return ConductanceValue(self.h * value, self.h * slope / self.pressure)


@dataclass(frozen=True)
class GapConductance(_Smooth):
    """Conductance through the medium in a gap, k / (g + g_0), also of closed gaps.

    Attributes:
        conductivity: Conductivity k of the medium [flux length / field].
        distance: Mean distance g_0 of closed rough surfaces, the jump distances of a rarefied gas
            included [length].

    Raises:
        ValueError: If one of them is not a positive number.
    """

    conductivity: float
    distance: float

    def __call__(self, pressure: Array, gap: Array) -> ConductanceValue:
        """Conductance at pressures [stress] and gaps [length], (slave nodes,) each (local)."""
        h = self.conductivity / (gap + self.distance)
        return ConductanceValue(h, 0.0, -h / (gap + self.distance))


class Conductance:
    """Flux of a scalar field across a contact, q = h(p, g) (T_slave - T_master) (local).

    The field is a sub-space of the mixed function of the problem. Its equation in the residual
    must be that of a flux per area that leaves the slave, with positive sign of the capacity: for a
    temperature T with test function w, ``k * inner(grad(T), grad(w)) * dx - heat * w * dx``.

    Args:
        field: Number of the scalar field's sub-space in the mixed function; or the function of a
            field that the user solves for in a problem of its own, by the loads and derivatives
            ``problem.matrices.flux_loads`` and ``flux_derivative``.
        h: Conductance [flux / field]: a number, which holds where contact is closed, inf for
            perfect conduction: a jump of zero there, and the flux is a multiplier;
            ``PressureConductance`` or ``GapConductance``; a function of pressures and gaps, arrays
            of shape (slave nodes,), that returns finite h, dh/dp and dh/dg; or a list of these,
            which are added.
        heating: Source at closed contact [flux]: "friction", shear times slip over the length of
            the step, see ``ContactProblem.time``; a function of pressures (slave nodes,) and
            undeformed positions (slave nodes, dim) that returns power per area and its derivative
            by pressure, for sliding that is not resolved: mu p omega r of a brake disc; or
            ``None``.
        share: Fraction of the source that enters the slave, between 0 and 1, the rest enters the
            master: e_s / (e_s + e_m) with effusivities e = sqrt(k rho c) of two half spaces [1].
        temperature: Value of the field on a rigid obstacle, which is the master [field]: a number
            or a constant, whose value may change between solves.

    Attributes:
        scale: Factor of h [1]; 1 unless a study changes it, see ``sensitivity.ConductanceScale``.

    Raises:
        ValueError: If an argument has a value that is not allowed.

    Example:
        Temperature is the second part of a mixed function (displacement, temperature)::

            heat = fm.Conductance(1, fm.PressureConductance(2e4, pressure=10.0))
            pair = fm.ContactPair(data, "pin/outer", "hub/inner", fluxes=[heat])
    """

    def __init__(
        self,
        field: int | fem.Function,
        h: float | ConductanceFunction | Sequence[float | ConductanceFunction],
        *,
        heating: Literal["friction"] | HeatingFunction | None = None,
        share: float = 0.5,
        temperature: float | fem.Constant | None = None,
    ) -> None:
        self.field, self.h, self.scale = field, h, 1.0
        self.heating, self.share, self.temperature = heating, share, temperature

    def __setattr__(self, name: str, value: Any) -> None:
        """Set a value after a check; all but the field take effect in the next solve (local).

        Raises:
            ValueError: If it is not allowed, or the field is set again.
        """
        if name not in _CHECKS or (name == "field" and "field" in vars(self)):
            raise ValueError(f"{name} of {self!r} cannot be set; set up a new problem")
        _CHECKS[name](value)
        super().__setattr__(name, value)

    def __repr__(self) -> str:
        """Field and conductance."""
        return f"Conductance({self.field!r}, {self.h!r})"

    def evaluate(self, pressure: Array, gap: Array, *, finite: bool = False) -> ConductanceValue:
        """Conductance of the slave nodes and its derivatives (local).

        Args:
            pressure: Contact pressure, zero where open, shape (slave nodes,) [stress].
            gap: Mean gap, zero where closed, shape (slave nodes,) [length].
            finite: Whether conduction may not be perfect.

        Raises:
            MortarError: If a conductance is negative, or not a number, or inf of a function.
        """
        sums = np.zeros((3, pressure.size))
        for term in _terms_of(self.h):
            found = term(pressure, gap)
            if not isinstance(found, Sequence) or len(found) != 3:
                raise MortarError(
                    f"h: {term!r} returned {found!r}; expected h, dh/dp and dh/dg for arrays of "
                    "pressures and gaps"
                )
            for total, value in zip(sums, found, strict=True):
                total += value
        bad = ~np.isfinite(sums).all(axis=0) | (sums[0] < 0.0)
        bad &= np.isfinite(pressure) & np.isfinite(gap)  # else an iterate of Newton's method fails
        if self.is_perfect and not finite:
            bad &= ~((sums[0] == np.inf) & np.isfinite(sums[1:]).all(axis=0))
        if bad.any():
            j = int(bad.argmax())
            raise MortarError(
                f"{self!r} is {sums[0, j]:.3g} with slopes {sums[1, j]:.3g} and {sums[2, j]:.3g} "
                f"at the pressure {pressure[j]:.3g} and the gap {gap[j]:.3g}: expected a finite "
                "conductance that is not negative"
            )
        return ConductanceValue(*(self.scale * sums))

    def power(self, pressure: Array, X: Array) -> tuple[Array, Array]:
        """Power per area of a ``heating`` function and its derivative by pressure (local).

        Args:
            pressure: Contact pressure, zero where open, shape (slave nodes,) [stress].
            X: Undeformed positions, shape (slave nodes, dim) [length].

        Returns:
            Power [flux] and derivative [flux / stress], (slave nodes,) each.

        Raises:
            MortarError: If the function returns anything but finite numbers of these shapes.
        """
        assert callable(self.heating)
        found = self.heating(pressure, X.copy())
        if not isinstance(found, Sequence) or len(found) != 2:
            raise MortarError(f"heating returned {found!r}; expected power and its derivative by p")
        power, slope = (np.zeros(pressure.size) + part for part in found)
        if not np.isfinite([power, slope]).all():
            raise MortarError("heating returned power or derivative that is not finite")
        return power, slope

    @property
    def jumps(self) -> bool:
        """Whether the conductance may jump where contact closes, as a number does (local)."""
        return not all(isinstance(term, _Smooth) for term in _terms_of(self.h))

    @property
    def is_perfect(self) -> bool:
        """Whether conduction is perfect where contact is closed (local)."""
        return any(term == ClosedConductance(np.inf) for term in _terms_of(self.h))

    @property
    def on_obstacle(self) -> float:
        """Present value of the field on an obstacle, zero without one [field] (local)."""
        given: Any = 0.0 if self.temperature is None else self.temperature
        return float(given.value if isinstance(given, fem.Constant) else given)


def _check_field(field: Any) -> None:
    """Reject all but numbers of sub-spaces and functions."""
    if not isinstance(field, fem.Function):
        expected = "the number of a sub-space, or a function"
        check_number("field", field, expected, lambda n: n >= 0, whole=True)


def _check_heating(heating: Any) -> None:
    """Reject all but "friction", functions and ``None``."""
    if not (heating in (None, "friction") or callable(heating)):
        raise ValueError(
            f"heating={heating!r}: expected 'friction', a function of pressures and positions, "
            "or None"
        )


def _check_temperature(temperature: Any) -> None:
    """Reject all but finite numbers, constants and ``None``."""
    if not (temperature is None or isinstance(temperature, fem.Constant)):
        check_number("temperature", temperature, "a number or a constant", np.isfinite)


def _terms_of(h: Any) -> list[ConductanceFunction]:
    """Conductances whose sum is ``h``; numbers are those of closed contact.

    Raises:
        ValueError: If one is no conductance, or negative, or there is none.
    """
    terms = list(h) if isinstance(h, Sequence) and not isinstance(h, str) else [h]
    if not terms:
        raise ValueError("h=[]: expected at least one conductance")
    expected = "a conductance: a number that is at least 0, or a function of pressure and gap"
    for term in terms:
        if not callable(term):
            check_number("h", term, expected, lambda value: value >= 0.0)
    return [term if callable(term) else ClosedConductance(float(term)) for term in terms]


_CHECKS: dict[str, Callable[[Any], object]] = {
    "field": _check_field,
    "h": _terms_of,
    "heating": _check_heating,
    "share": partial(
        check_number, "share", expected="a fraction between 0 and 1", allows=lambda x: 0 <= x <= 1
    ),
    "scale": partial(
        check_number, "scale", expected="a positive number", allows=lambda x: 0 < x < np.inf
    ),
    "temperature": _check_temperature,
}
