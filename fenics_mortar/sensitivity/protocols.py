# SPDX-License-Identifier: MIT
"""Quantities and controls: what is differentiated, and by what; the quantities of contact.

``Quantity`` and ``Control`` are the protocols, ``PairQuantity`` and ``PairControl`` base classes of
those that act on pairs of surfaces. Quantities of contact are forces, pressures, gaps, friction
work and contact lengths. Their derivatives are taken at fixed sets, at the present state of the
problem, which must be evaluated with ``EXACT``. In space integrals are over areas: units are those
with a thickness. All values are equal on all ranks; all methods but constructors and operators are
collective.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import reduce
from operator import add
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.space_fields import SpaceFields
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.sensitivity.history import (
    BY_PAIR,
    ROWS,
    Before,
    OfPair,
    PairOperator,
    check_exact,
    contact_of,
    from_pairs,
    history_of,
    interface_of,
    values_of,
)
from fenics_mortar.sensitivity.partials import fields
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MortarError, check_direction, check_number, check_vector

if TYPE_CHECKING:
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.problem import ContactProblem
    from fenics_mortar.sensitivity.history import StepMemory
    from fenics_mortar.sensitivity.partials.fields import Changes, Matrix
    from fenics_mortar.sensitivity.partials.history import PairMemory

# Derivatives of a functional with respect to nodal fields by name, see ``partials.fields``, shape
# (slave nodes,) each, or (slave nodes, d) for "z"; fields that are missing have zeros.
ByFields = dict[str, Array]
# Derivatives of the shape of a control, or zero.
Values: TypeAlias = "Array | float"


class Quantity(Protocol):
    """A scalar function J(s_k, s_{k-1}, m) of a state; all methods are collective.

    R_k(s_k, s_{k-1}, m) = 0 are the equations of step k for its state s_k = (u, z, q), rows and
    units as in ``equations.linearized``, and m are the values of a control. All derivatives are
    taken at fixed active sets and branches. ``problem`` is at the end of a step with the state s_k,
    evaluated with ``EXACT``; ``before`` is the state s_{k-1} at its start: a ``State``, or its
    ``StepHistory``.
    """

    @abstractmethod
    def value(self, problem: ContactProblem, before: Before = None) -> float:
        """Value at the present state [unit of the quantity], equal on all ranks."""

    @abstractmethod
    def gradient(self, problem: ContactProblem, before: Before = None) -> LinearVector:
        """dJ/ds_k."""

    def by_before(self, problem: ContactProblem, before: Before) -> LinearVector | None:
        """dJ/ds_{k-1}; ``None``, the default, or a vector without parts if it is zero."""
        return None

    def by_control(self, problem: ContactProblem, control: Any, before: Before = None) -> Values:
        """Explicit derivative dJ/dm at fixed states, of the shape of m [unit of J / unit of m].

        The default is 0.0: the control does not occur.
        """
        return 0.0


class ContactQuantity(Quantity):
    """Base class of the quantities of contact.

    Sums, products with numbers, and powers of quantities are quantities:

    >>> misfit = (TotalForce(0, (0.0, 1.0)) - 12.5) ** 2 + 0.1 * FrictionWork(0)
    """

    def check(self) -> None:
        """Check the arguments, in a call made on all ranks (local).

        Raises:
            ValueError: If an argument has a value that is not allowed.
        """

    def check_dimension(self, dim: int) -> None:
        """Check vectors among the arguments for ``dim`` coordinates, as ``check`` (local).

        Raises:
            ValueError: If one has another number of components.
        """

    def __add__(self, other: ContactQuantity | float) -> ContactQuantity:
        """Sum of quantities, or of a quantity and a number."""
        if isinstance(other, ContactQuantity):
            return Combined([self, other], np.sum, np.ones_like)
        return Combined([self], lambda v: v[0] + other, np.ones_like)

    def __sub__(self, other: ContactQuantity | float) -> ContactQuantity:
        """Difference of quantities, or of a quantity and a number."""
        return self + (-1.0) * other

    def __mul__(self, factor: float) -> ContactQuantity:
        """Product with a number."""
        return Combined([self], lambda v: factor * v[0], lambda v: np.full(1, factor))

    def __pow__(self, power: float) -> ContactQuantity:
        """Power of a quantity."""
        return Combined([self], lambda v: v[0] ** power, lambda v: power * v ** (power - 1))

    __radd__, __rmul__ = __add__, __mul__


class Combined(ContactQuantity):
    """A function of quantities.

    Args:
        parts: The quantities.
        function: Function from their values (n,) to a number.
        derivative: Function from their values to the partial derivatives of ``function``, (n,).
    """

    def __init__(
        self,
        parts: Sequence[Any],
        function: Callable[[Array], Any],
        derivative: Callable[[Array], Array],
    ) -> None:
        self.parts, self._function, self._derivative = list(parts), function, derivative

    def check(self) -> None:
        """Check the arguments, in a call made on all ranks (local)."""
        for part in self.parts:
            part.check()

    def check_dimension(self, dim: int) -> None:
        """Check vectors among the arguments for ``dim`` coordinates, as ``check`` (local)."""
        for part in self.parts:
            part.check_dimension(dim)

    def _values(self, problem: ContactProblem, before: Before) -> Array:
        return np.array([part.value(problem, before) for part in self.parts])

    def _chain(self, each: Sequence[Any], problem: ContactProblem, before: Before) -> Any:
        """Chain rule: sum of derivatives of the quantities times those of the function."""
        factors = map(float, self._derivative(self._values(problem, before)))
        return reduce(add, (part * by for part, by in zip(each, factors, strict=True)))

    def value(self, problem: ContactProblem, before: Before = None) -> float:
        """Value at the present state [unit of the quantity], equal on all ranks."""
        return float(self._function(self._values(problem, before)))

    def gradient(self, problem: ContactProblem, before: Before = None) -> LinearVector:
        """dJ/ds_k."""
        each = [part.gradient(problem, before) for part in self.parts]
        return self._chain(each, problem, before)

    def by_before(self, problem: ContactProblem, before: Before) -> LinearVector | None:
        """dJ/ds_{k-1}; ``None``, the default, or a vector without parts if it is zero."""
        each = [part.by_before(problem, before) or LinearVector() for part in self.parts]
        return self._chain(each, problem, before)

    def by_control(self, problem: ContactProblem, control: Any, before: Before = None) -> Values:
        """Explicit derivative dJ/dm at fixed states, of the shape of m [unit of J / unit of m]."""
        each = [part.by_control(problem, control, before) for part in self.parts]
        return self._chain(each, problem, before)


class PairQuantity(OfPair, ContactQuantity):
    """Base class of the quantities of one pair, functions of its nodal fields.

    Args:
        pair: Number of the pair.
    """

    @abstractmethod
    def _of(self, contact: Any) -> tuple[float, ByFields]:
        """Value, and its derivatives with respect to nodal fields."""

    def value(self, problem: ContactProblem, before: Before = None) -> float:
        """Value at the present state [unit of the quantity], equal on all ranks."""
        return self._of(interface_of(problem.equations, self.pair))[0]

    def gradient(self, problem: ContactProblem, before: Before = None) -> LinearVector:
        """dJ/ds_k."""
        contact = interface_of(problem.equations, self.pair)
        return from_pairs(problem.equations, {self.pair: self._by_state(contact)})

    def _by_state(self, contact: Interface) -> Array:
        """Derivative with respect to the present state, a vector of the pair."""
        if isinstance(contact, Contact):
            check_exact(contact)
        by = self._of(contact)[1]
        return through(by, fields.fields_by_state(contact, by))

    def by_before(self, problem: ContactProblem, before: Before) -> LinearVector | None:
        """dJ/ds_{k-1}; ``None``, the default, or a vector without parts if it is zero."""
        by = self._of(interface_of(problem.equations, self.pair))[1]
        earlier = history_of(problem.equations, before) if {"slip", "rubbing"} & set(by) else None
        if earlier is None or self.pair not in earlier.pairs:
            return None
        gradient = through(by, earlier.pairs[self.pair].fields)
        return from_pairs(problem.equations, {self.pair: gradient})

    def by_control(self, problem: ContactProblem, control: Any, before: Before = None) -> Values:
        """Explicit derivative dJ/dm at fixed states, of the shape of m [unit of J / unit of m].

        For controls that change nodal fields.
        """
        if not hasattr(control, "fields") or self.pair not in control.pairs(problem):
            return 0.0
        changes = control.fields(problem, self.pair, before)
        if not changes:
            return 0.0
        by = self._of(interface_of(problem.equations, self.pair))[1]
        return through(by, changes).reshape(control.get(problem).shape)


def through(by: ByFields, changes: Changes) -> Array:
    """Chain rule: derivative of a functional, (m,), for changes of fields (n, m) (local).

    In the unit of the functional over that of the m values [any].
    """
    (m, *_) = (change.shape[1] for change in changes.values())
    terms = (change.T @ by[name].ravel() for name, change in changes.items() if name in by)
    return sum(terms, np.zeros(m))


class Control(Protocol):
    """Values on which a solution depends.

    A control has the derivative of the residuals of one step, with the rows and units of
    ``equations.linearized``, at fixed displacement, multipliers, active sets, and state before.

    Methods take a ``problem`` at the end of a step, evaluated with ``EXACT``, and the state
    ``before``, at the start of the step, which is needed if slip depends on the control through
    this state: a ``State``, or its ``StepHistory``. Values are replicated arrays of any shape, or
    those of the owned dofs of a function if an attribute ``is_distributed`` is true.

    Other methods are optional: ``pairs`` and ``memory``, as of ``PairControl``, for laws with
    memory, and ``explicit(problem, quantity, before)``, the derivative of a quantity that does not
    know the control, see ``Quantity.by_control``.

    Attributes:
        name: Name for messages.
    """

    name: str

    def get(self, problem: ContactProblem) -> Array:
        """Present values (local), of shape () for a single number [their unit]."""

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Set the ``values``, of the shape of ``get`` [their unit], equal on all ranks (local).

        Raises:
            TypeError: If the control cannot be set.
            ValueError: If a value is not allowed.
        """
        raise TypeError(f"{self.name} cannot be set")

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """Change of the residuals along ``dm``, of the values' shape [their unit] (collective).

        Raises:
            MortarError: On all ranks, if the derivative is not available.
        """

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """Gradient of the scalar product of residuals and ``y`` (collective).

        Equal on all ranks, of the shape of the values [units of the product over theirs].

        Raises:
            MortarError: On all ranks, if the derivative is not available.
        """


def memory_by(problem: ContactProblem, step: StepMemory, control: Any) -> PairOperator:
    """Derivative of the memory of a step with respect to a control at fixed states (collective).

    Raises:
        MortarError: If a law has memory, and the control has no derivative of it.
    """
    pairs = getattr(control, "pairs", None)
    if pairs is None and step.pairs:
        raise MortarError(
            f"{control.name}: no derivative through the memory of the law of pair "
            f"{min(step.pairs)}; expected a law without memory, or another control"
        )
    found = {
        i: control.memory(problem, i, step.pairs[i], step.before)
        for i in (pairs(problem) if pairs else ())
        if i in step.pairs
    }
    return PairOperator(problem.equations, found, values_of(control.get(problem).shape), BY_PAIR)


class PairControl(OfPair, Control):
    """Control of m numbers that acts on the rows of pairs, by nodal fields unless overridden.

    Args:
        pair: Number of the pair.
    """

    def pairs(self, problem: ContactProblem) -> list[int]:
        """Numbers of the pairs whose rows or memory depend on it at fixed states (local)."""
        return [self.pair]

    def fields(self, problem: ContactProblem, i: int, before: Before = None) -> Changes:
        """Derivatives of the nodal fields of pair ``i``, one of ``pairs`` (collective).

        By their names, shape (slave nodes, m) each [units of the field over those of the values];
        empty if they do not depend on the control. ``before``: see ``Control``.
        """
        return {}

    def rows(self, problem: ContactProblem, i: int, before: Before = None) -> Matrix:
        """Derivative of the rows of pair ``i``, one of ``pairs`` (collective).

        Shape (d slave nodes, m) [stress length over the units of the values].

        Raises:
            ValueError: On all ranks, if the pair is tied, or its law cannot be differentiated.
            MortarError: On all ranks, if the derivative is not available.
        """
        contact = contact_of(problem.equations, i)
        check_exact(contact)
        if contact.fluxes:
            raise MortarError(
                f"{self.name}: fluxes across {contact.pair!r} have no derivative by this control; "
                "those by constants and functions of the residual, parameters of laws, obstacles' "
                "motions and ConductanceScale are available"
            )
        return fields.through_fields(
            fields.rows_by_fields(contact), self.fields(problem, i, before)
        )

    def memory(
        self, problem: ContactProblem, i: int, memory: PairMemory, before: Before = None
    ) -> Matrix:
        """Derivative of the memory of the law of pair ``i``, one of ``pairs`` (collective).

        Args:
            problem: See ``Control``.
            i: Number of the pair.
            memory: Derivatives of this memory.
            before: See ``Control``.

        Returns:
            Shape (slave nodes * names of the memory, m) [units of the memory over those of the
            values].
        """
        return fields.through_fields(memory.by_fields, self.fields(problem, i, before))

    def residuals(self, problem: ContactProblem, before: Before = None) -> PairOperator:
        """Derivative of the residuals of ``problem``, of any shape [any] (collective).

        ``before``: see ``Control``.
        """
        matrices = {i: self.rows(problem, i, before) for i in self.pairs(problem)}
        return PairOperator(problem.equations, matrices, values_of(self.get(problem).shape), ROWS)

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """Change of the residuals along ``dm``, of the values' shape [their unit] (collective)."""
        return self.residuals(problem, before) @ np.asarray(dm, float)

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """Gradient of the scalar product of residuals and ``y`` [its units] (collective)."""
        return self.residuals(problem, before).T @ y


class TotalForce(PairQuantity):
    """Component of the contact force on the slave body [stress length].

    Args:
        pair: Number of the pair, a contact or a tie.
        direction: Vector by which the force is multiplied, shape (d,) [1].
    """

    def __init__(self, pair: int, direction: npt.ArrayLike) -> None:
        super().__init__(pair)
        self.direction = direction

    def check_dimension(self, dim: int) -> None:
        """Check vectors among the arguments for ``dim`` coordinates, as ``check`` (local)."""
        check_vector("direction", self.direction, dim)

    def _of(self, contact: Interface) -> tuple[float, ByFields]:
        weight, direction = contact.operators.weight, np.asarray(self.direction, float)
        by = {"weight": -contact.z @ direction, "z": -weight[:, None] * direction}
        return float(contact.total_force @ direction), by


class Moment(PairQuantity):
    """Moment of the contact forces on the slave body, counter-clockwise [stress length^2].

    Args:
        pair: Number of the pair, a contact or a tie.
        about: Fixed point, shape (d,) [length]; the origin by default.
        axis: In space the direction of the axis through this point, of any length, shape (3,).
    """

    def __init__(
        self, pair: int, about: npt.ArrayLike | None = None, axis: npt.ArrayLike | None = None
    ) -> None:
        super().__init__(pair)
        self.about, self.axis = about, axis

    def check_dimension(self, dim: int) -> None:
        """Check vectors among the arguments for ``dim`` coordinates, as ``check`` (local)."""
        self._line(dim)

    def _line(self, dim: int) -> tuple[Array, Array | None]:
        """The point (d,) [length], and the unit vector along the axis in space (local).

        Raises:
            ValueError: If one of them is not given as needed.
        """
        about = np.zeros(dim) if self.about is None else check_vector("about", self.about, dim)
        if (self.axis is None) == (dim == 3):
            expected = "the direction of an axis in space" if dim == 3 else "None in the plane"
            raise ValueError(f"axis={self.axis!r}: expected {expected}")
        return about, None if self.axis is None else check_direction("axis", self.axis)

    def _of(self, contact: Interface) -> tuple[float, ByFields]:
        """Value, and its derivatives with respect to nodal fields.

        No control changes the moment at a fixed state.
        """
        return fields.moment(contact, *self._line(contact.slave.dim)), {}

    def _by_state(self, contact: Interface) -> Array:
        return fields.moment_gradient(contact, *self._line(contact.slave.dim))


class PressureFunctional(PairQuantity):
    """Integral of a function of the pressure over the slave, sum_j w_j f(p_j).

    Nodal quadrature with the weights w_j, the integrals of the multiplier functions over the
    current surface and the thickness, gives int f(p) = sum_j w_j f(p_j); it is exact for f = p.

    Args:
        pair: Number of the pair.
        function: Function from the pressures of all slave nodes, (slave nodes,) [stress], to values
            (slave nodes,) [unit of f].
        derivative: Function from the pressures to the derivatives, (slave nodes,) [unit of f over
            stress].
    """

    def __init__(
        self, pair: int, function: Callable[[Array], Array], derivative: Callable[[Array], Array]
    ) -> None:
        super().__init__(pair)
        self._function, self._derivative = function, derivative

    def _of(self, contact: Contact) -> tuple[float, ByFields]:
        p, weight = contact.now.z_n, contact.operators.weight
        f = self._function(p)
        return float(weight @ f), {"weight": f, "z_n": weight * self._derivative(p)}


class PressureIntegral(PressureFunctional):
    """Integral of a power of the pressure over the slave [stress^power length].

    Args:
        pair: Number of the pair.
        power: Power, a whole number, at least 1.
    """

    def __init__(self, pair: int, power: int = 1) -> None:
        self.power = power
        super().__init__(pair, lambda p: p**power, lambda p: power * p ** (power - 1))

    def check(self) -> None:
        """Check the arguments, in a call made on all ranks (local)."""
        super().check()
        check_number("power", self.power, "at least 1", lambda n: n >= 1, whole=True)


class PeakPressure(PairQuantity):
    """Smooth maximum of the pressure, the norm (sum_j w_j p_j^P / sum_j w_j)^(1/P) [stress].

    Tensile pressures, as under adhesion, are replaced by zero.

    Args:
        pair: Number of the pair.
        power: Exponent P [1]; the norm is below the maximum and tends to it as P increases.
    """

    def __init__(self, pair: int, power: float = 8.0) -> None:
        super().__init__(pair)
        self.power = power

    def check(self) -> None:
        """Check the arguments, in a call made on all ranks (local)."""
        super().check()
        check_number("power", self.power, "more than 1", lambda P: 1.0 < P < np.inf)

    def _of(self, contact: Contact) -> tuple[float, ByFields]:
        """Value, and its derivatives with respect to nodal fields.

        Derivatives are zero without pressure.
        """
        weight, p = contact.operators.weight, np.maximum(contact.now.z_n, 0.0)
        largest, total = float(p.max()) or 1.0, float(weight.sum())
        p = p / largest
        mean = float(weight @ p**self.power) / total
        value = float(largest * mean ** (1.0 / self.power))
        if mean == 0.0:
            return value, {"weight": p}
        by_mean = mean ** (1.0 / self.power - 1.0) / total
        by_weight = largest / self.power * by_mean * (p**self.power - mean)
        return value, {"weight": by_weight, "z_n": by_mean * weight * p ** (self.power - 1.0)}


class MeanGap(PairQuantity):
    """Mean gap of nodes, the sum of weighted gaps over the sum of weights [length].

    Args:
        pair: Number of the pair.
        nodes: Numbers of slave nodes along the surface, shape (k,); all covered ones by default.
    """

    def __init__(self, pair: int, nodes: Indices | None = None) -> None:
        super().__init__(pair)
        self.nodes = nodes

    def check(self) -> None:
        """Check the arguments, in a call made on all ranks (local)."""
        super().check()
        nodes = np.asarray(0 if self.nodes is None else self.nodes)
        if self.nodes is not None and (
            nodes.dtype.kind not in "iu" or nodes.ndim != 1 or not nodes.size or nodes.min() < 0
        ):
            raise ValueError(f"nodes={self.nodes!r}: expected numbers of slave nodes, from 0 on")

    def _of(self, contact: Contact) -> tuple[float, ByFields]:
        """Value, and its derivatives with respect to nodal fields.

        Nan and zero if none of the nodes is covered; ``evaluate`` refuses steps where it counts.
        """
        o, counts = contact.operators, contact.covered.astype(float)
        if self.nodes is not None:
            if np.max(self.nodes) >= counts.size:
                raise ValueError(
                    f"nodes: pair {self.pair} has the slave nodes 0 to {counts.size - 1}"
                )
            counts *= np.isin(np.arange(counts.size), self.nodes)
        total = float(counts @ o.weight) or 1.0
        mean = float(counts @ o.gap) / total
        by = {"weight": -mean / total * counts, "gap": counts / total}
        return mean if counts.any() else np.nan, by


class FrictionWork(PairQuantity):
    """Work of friction in the step, by the shear at its end [stress length^2].

    The sum of w_j z_tau u_j with the slip u_j; see ``PairView.friction_work``.

    Args:
        pair: Number of the pair.

    Raises:
        ValueError: When it is evaluated, if the pair is tied.
    """

    def _of(self, contact: Any) -> tuple[float, ByFields]:
        if not isinstance(contact, Contact):
            raise ValueError(f"pair {self.pair} is tied: FrictionWork needs a contact")
        w, z_tau, slip, f = contact.operators.weight, contact.z_tau, contact.slip, contact.now
        if isinstance(f, SpaceFields):  # by vectors: the slip of a bond may have another direction
            return f.friction_work, {"weight": z_tau * slip, "rubbing": w}
        gap = z_tau * f.slip_by_gap
        weight = z_tau * slip - gap * f.mean_gap
        by = {"weight": weight, "gap": gap, "z_tau": w * slip, "slip": w * z_tau}
        return f.friction_work, by


class ContactLength(PairQuantity):
    """Length of the surface in contact, the sum of w_j over active nodes [length].

    The length jumps if the active set changes; the derivative at a fixed set is only the stretch of
    the surface at active nodes. ``effective_length`` is smooth.

    Args:
        pair: Number of the pair.
    """

    def _of(self, contact: Contact) -> tuple[float, ByFields]:
        active = contact.active.astype(float)
        return float(contact.operators.weight @ active), {"weight": active}


def effective_length(pair: int) -> ContactQuantity:
    """Length over which the mean pressure acts, (int p)^2 / int p^2 [length] (local).

    This is the length in contact for a uniform pressure, and 3 pi^2 / 32 = 0.925 of it for a
    Hertzian pressure. It changes continuously with the active set.

    Args:
        pair: Number of the pair.
    """
    parts = [PressureIntegral(pair, 1), PressureIntegral(pair, 2)]
    return Combined(
        parts,
        lambda v: v[0] ** 2 / v[1],
        lambda v: np.array([2.0 * v[0] / v[1], -((v[0] / v[1]) ** 2)]),
    )
