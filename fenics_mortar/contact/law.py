# SPDX-License-Identifier: MIT
"""Contact laws: the tangential row of active slave nodes, and the adhesion of open ones.

``Law`` is the base class, with an explanation of how to write one. ``Frictionless`` and ``Stick``
have no parameters; ``Friction`` is the base class of laws with a friction limit, as ``Coulomb`` and
``Tresca``. All laws act on all slave nodes at once: their argument is a ``Nodal``, and a result is
a ``Row``, whose derivatives are given or computed by complex step, see ``row_of``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from fenics_mortar.utils.errors import as_text, check_choice, check_number, is_function

Array = npt.NDArray[np.float64]
Branches = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Nodal:
    """State of the slave nodes; each array has the shape (slave nodes,) unless stated (local).

    Attributes:
        gap: Mean gap g, zero where there is no partner [length]. In ``Law.closing_gap`` this is the
            geometric gap, in all other methods the closing gap.
        slip: Slip u since the last accepted step, positive along tau [length].
        z_n, z_tau: Multiplier [stress].
        stiffness: Stiffness k_j / l_j of the bulk [stress / length].
        c_n: Weight of the gap in the active-set test, c k_j / l_j [stress / length].
        X, x: Positions in the undeformed mesh and at present, shape (slave nodes, dim) [length].
        time: Time at the end of the step [time].
        step: Length of the step [time].
        memory: Numbers stored by the law at the start of the step, by the names in ``Law.memory``
            [units of the law].
        fields: Values of the law's parameters that vary in space, by the names in ``Law.fields``
            [units of the law].
    """

    gap: Array
    slip: Array
    z_n: Array
    z_tau: Array
    stiffness: Array
    c_n: Array
    X: Any = None
    x: Any = None
    time: float = 0.0
    step: float = 1.0
    memory: Mapping[str, Array] = field(default_factory=dict)
    fields: Mapping[str, Any] = field(default_factory=dict)


class Row(NamedTuple):
    """Value of a law and its derivatives, each of shape (slave nodes,) or a scalar (local).

    Attributes:
        residual: Residual rho [stress], gap [length] or adhesion [stress].
        by_gap: Its derivative with respect to the gap [unit / length].
        by_slip: Its derivative with respect to the slip [unit / length].
        by_z_n: Its derivative with respect to the pressure [unit / stress].
        by_z_tau: Its derivative with respect to the shear [unit / stress].
    """

    residual: Any
    by_gap: Any = 0.0
    by_slip: Any = 0.0
    by_z_n: Any = 0.0
    by_z_tau: Any = 0.0


class VectorRow(NamedTuple):
    """A row of a law at the slave nodes, and its derivatives by vectors (local).

    Attributes:
        residual: Shape (slave nodes,).
        by_z: Derivative by the multiplier, shape (slave nodes, dim).
        by_slip: By the slip, shape (slave nodes,) in the plane; by its vector s^, shape (slave
            nodes, 3), in space.
        by_gap: By the mean gap, shape (slave nodes,).
        by_normal: By the normal, shape (slave nodes, dim).
    """

    residual: Array
    by_z: Array
    by_slip: Array
    by_gap: Array
    by_normal: Array


# Arguments with respect to which a row has derivatives, in the order of ``Row``.
ARGUMENTS = ("gap", "slip", "z_n", "z_tau")
# Imaginary increment: its square underflows, so that derivatives are exact to rounding [1].
COMPLEX_STEP = 1e-200


def row_of(function: Callable[[Nodal], Any], node: Nodal) -> Row:
    """Row of a function, with derivatives by complex step, exact to rounding (local).

    The function has to be analytic at the nodes: numpy's arithmetic, ``exp``, ``tanh``, ``where``
    and so on. Use ``magnitude`` for the absolute value, ``np.where`` for maxima.

    Args:
        function: Value at a ``Nodal`` with complex ``gap``, ``slip``, ``z_n`` or ``z_tau``.
        node: State of the slave nodes.
    """
    changes = []
    for name in ARGUMENTS:
        moved = replace(node, **{name: getattr(node, name) + 1j * COMPLEX_STEP})
        changes.append(np.imag(function(moved)) / COMPLEX_STEP)
    value = function(node)  # complex if a parameter is, see ``sensitivity.partials.history``
    return Row(value if np.imag(value).any() else np.real(value), *changes)


def magnitude(values: Any) -> Any:
    """Absolute value of ``values``, analytic in complex arguments; slope +1 at zero (local)."""
    return np.where(np.real(values) < 0.0, -values, values)


def chain_rule(row: Row, gap: Row) -> Row:
    """Row of a law in terms of a gap that is itself a row: the chain rule."""
    first, *others = row[1:]
    chained = [a + first * b for a, b in zip(others, gap[2:], strict=True)]
    return Row(row.residual, first * gap.by_gap, *chained)


def mapped(node: Nodal, of: Callable[[Any], Any]) -> Nodal:
    """All arrays of a node replaced by functions of them, as their values at points (local).

    Args:
        node: State of the slave nodes.
        of: Function of an array, shape (slave nodes, ...); its results have any shape.
    """

    def changed(value: Any) -> Any:
        if isinstance(value, Mapping):
            return MappingProxyType({name: of(numbers) for name, numbers in value.items()})
        return of(value) if isinstance(value, np.ndarray) else value

    return Nodal(**{name: changed(value) for name, value in vars(node).items()})


# Distance from a kink of the complementarity functions [1] within which a node counts as on the
# kink: distance of the shear over the friction limit, or of the gap over the nodal length. It is
# larger than the errors after convergence of Newton's method.
KINK = 1e-8
# Branches of friction: stick, and times the direction sliding, also without pressure.
STICK, SLIDE, GRAZE = range(3)


def check_names(law: Law) -> None:
    """Raise for invalid names of memory, fields and parameters (local).

    Raises:
        ValueError: If names are not a tuple or list of distinct strings, or a field or parameter is
            not an attribute of the law.
    """
    for what in ("memory", "fields", "parameters"):
        given = getattr(law, what)
        several = isinstance(given, (tuple, list))
        if not several or not all(isinstance(name, str) and name.isidentifier() for name in given):
            expected = "expected a tuple of names, e.g. ('depth',)"
            raise ValueError(f"{what} of {type(law).__name__} is {given!r}: {expected}")
        if len(set(given)) < len(given):
            raise ValueError(f"{what} of {type(law).__name__} has a name twice: {given!r}")
        missing = [name for name in given if what != "memory" and not hasattr(law, name)]
        if missing:
            raise ValueError(f"{type(law).__name__} has no attribute {missing[0]!r} of its {what}")
    if law.summed_slip not in (None, *law.memory):
        raise ValueError(
            f"summed_slip of {type(law).__name__} is {law.summed_slip!r}: expected a name in its "
            f"memory, {law.memory!r}, or None"
        )


def varies(value: Any) -> bool:
    """Whether a parameter of a law is an array or a function of the position, not a number."""
    return isinstance(value, (np.ndarray, fem.Function)) or is_function(value)


def check_positive(law: Law, *names: str, zero: bool = False) -> None:
    """Reject parameters that are not finite and positive (local).

    Args:
        law: The law.
        names: Names of its attributes; ``fields`` that vary in space are not checked.
        zero: Whether zero is allowed.

    Raises:
        ValueError: If a number is not allowed.
    """
    expected = "zero or a positive number" if zero else "a positive number"
    for name in names:
        value = getattr(law, name)
        if not (name in law.fields and varies(value)):
            check_entries(name, value, expected, lambda x: 0.0 < x < np.inf or (zero and x == 0.0))


def check_entries(name: str, value: Any, expected: str, allows: Callable[[Any], bool]) -> None:
    """``check_number`` of a number or of each entry of an array (local)."""
    for entry in value.ravel().tolist() if isinstance(value, np.ndarray) else [value]:
        check_number(name, entry, expected, allows)


class Law(ABC):
    """Base class of all laws; all methods act on all slave nodes at once and are local.

    The gap of an active node is closed under every law. A law adds one equation per node, rho(g, u,
    z_n, z_tau) = 0, with the mean gap g, the slip u since the last accepted step, and the
    multiplier z = z_n n + z_tau tau, minus the traction on the slave. It returns rho and its four
    derivatives; the derivatives of g, u, n and tau with respect to the displacement are computed by
    ``Contact``.

    The multiplier of an open node is zero unless the law has an adhesion a(g), see
    ``Law.adhesion``. Then g and z_n + a are complementary:

        g >= 0,    z_n + a(g) >= 0,    (z_n + a(g)) g = 0,

    so that a closed node opens if its tension exceeds a(0), and z_n = -a(g) at an open node.

    rho may consist of smooth branches. ``Law.branch`` returns the branch of each node as an
    integer; Newton's method uses it to detect changes and cycles.

    Example: a regularized Coulomb law with a single branch,

    >>> class Creeping(Law):
    ...     def __init__(self, mu: float, length: float) -> None:
    ...         self.mu, self.length = mu, length
    ...
    ...     def branch(self, node: Nodal, before: Branches) -> Branches:
    ...         return np.ones_like(before)
    ...
    ...     def tangential(self, node: Nodal, branch: Branches) -> Row:
    ...         fraction = np.tanh(node.slip / self.length)
    ...         return Row(
    ...             node.z_tau - self.mu * node.z_n * fraction,
    ...             by_slip=-self.mu * node.z_n * (1.0 - fraction**2) / self.length,
    ...             by_z_n=-self.mu * fraction,
    ...             by_z_tau=1.0,
    ...         )
    ...
    ...     def friction_limit(self, pressure: Array) -> Array:
    ...         return self.mu * pressure
    >>> Creeping(0.3, 0.01).friction_limit(np.array([0.0, 2.0]))
    array([0. , 0.6])

    and Coulomb friction with an adhesion that decays with the gap:

    >>> class Sticky(Coulomb):
    ...     def adhesion(self, gap: Array) -> tuple[Array, Array]:
    ...         pull = 2.0 * np.exp(-gap / 0.01)
    ...         return pull, -pull / 0.01
    >>> Sticky(0.3).has_adhesion
    True

    Besides the tangential row and an adhesion, a law may have

    - ``closing_gap``: a length g_c(g, u, z_n, z_tau) that replaces the gap g in

        g_c >= 0,    z_n + a >= 0,    (z_n + a) g_c = 0.

      Wear h is g_c = g + h; a soft layer of compliance 1 / k is g_c = g + z_n / k; a layer with
      the pressure p(overlap) is g_c = (z_n - p(-g)) / k with any stiffness k.
    - ``memory``: numbers stored at each node, which ``remember`` replaces at the end of a step.
      They are part of the state of the interface: they are restored if a step fails, and saved in
      checkpoints.
    - ``fields``: parameters that vary in space.

    The argument ``Nodal`` of each method contains positions, time, step and memory. Derivatives are
    returned by the law, or computed by ``row_of``. Archard's wear with Coulomb's friction,
    h' = wear z_n |u'|:

    >>> class Worn(Coulomb):
    ...     memory = ("depth",)
    ...
    ...     def __init__(self, mu: float, wear: float) -> None:
    ...         super().__init__(mu)
    ...         self.wear = wear
    ...
    ...     def depth(self, node: Nodal) -> Any:
    ...         return node.memory["depth"] + self.wear * node.z_n * magnitude(node.slip)
    ...
    ...     def closing_gap(self, node: Nodal) -> Row:
    ...         return row_of(lambda at: at.gap + self.depth(at), node)
    ...
    ...     def remember(self, node: Nodal, branch: Branches) -> Mapping[str, Array]:
    ...         return {"depth": self.depth(node)}
    >>> Worn(0.3, wear=1e-4).memory
    ('depth',)

    ``ContactProblem.check_tangent`` verifies the derivatives. Results must be finite, equal on all
    ranks, and one number per node. Otherwise, or if the law raises an error, the solve raises an
    error on all ranks, see ``law_calls``. ``Law.check`` may reject parameters before each solve.

    Attributes:
        parameters: Names of attributes, real numbers or arrays of these, with respect to which
            results may be differentiated: ``tangential`` and ``adhesion`` have to be analytic in
            them.
        memory: Names of the numbers that the law stores at each node.
        fields: Names of parameters that may vary in space: attributes that are a number, an array
            (slave nodes,), a function of undeformed positions (n, 2), or a scalar function of
            dolfinx. Those that are not numbers are evaluated before each solve and given in
            ``Nodal.fields``.
        needs_time: Whether the law needs the length of the step, so that ``ContactProblem.time``
            has to increase from solve to solve.
        bridges_gap: Whether the tangential row also holds at open nodes with adhesion.
        summed_slip: Name in ``memory`` of the slip summed over the steps, for elastic bonds, or
            ``None``: the law depends on its sum with ``slip``, and remembers this. In space it is a
            vector, zero at the start, which turns with the slave; shear and slip are then those
            along the total slip, and memory and results have its components, as "slid_x".
        grazes: Whether the friction limit is positive without pressure, see ``Friction``: of laws
            derived from it that have its ``branch`` and ``tangential``, without adhesion.
    """

    parameters: tuple[str, ...] = ()
    memory: tuple[str, ...] = ()
    fields: tuple[str, ...] = ()
    needs_time: bool = False
    bridges_gap: bool = False
    summed_slip: str | None = None
    grazes: bool = False

    def __repr__(self) -> str:
        """Name and public numbers, equal on all ranks."""
        return as_text(self)

    @abstractmethod
    def branch(self, node: Nodal, before: Branches) -> Branches:
        """Branch of rho at each node, 0 for stick, shape (slave nodes,), int.

        Args:
            node: State of the slave nodes.
            before: Previous branches, shape (slave nodes,), int.
        """

    @abstractmethod
    def tangential(self, node: Nodal, branch: Branches) -> Row:
        """Residual rho and its derivatives on given branches.

        Args:
            node: State of the slave nodes.
            branch: Branches, shape (slave nodes,), int.

        Returns:
            Arrays (slave nodes,) or scalars.
        """

    def friction_limit(self, pressure: Array) -> Array:
        """Largest admissible |z_tau| at given pressures, for laws that are equal at all nodes.

        Args:
            pressure: Shape (n,) [stress].

        Returns:
            Friction limits, shape (n,) [stress]; inf where there is none.

        Raises:
            NotImplementedError: If the limit depends on more than the pressure.
        """
        raise NotImplementedError(f"{self!r} has no friction_limit of the pressure alone")

    def friction_limit_at(self, node: Nodal) -> Array:
        """Largest admissible |z_tau| at each node at the pressure ``node.z_n``.

        Override this method instead of ``friction_limit`` if the limit depends on more than the
        pressure.

        Returns:
            Friction limits of the shape of ``node.z_n`` [stress]; inf where there is none.
        """
        return self.friction_limit(node.z_n)

    def adhesion(self, gap: Array) -> tuple[Array, Array]:
        """Adhesion of closed and open gaps, and its derivative; zero by default.

        Args:
            gap: Gaps g >= 0 of any shape [length].

        Returns:
            a(g) >= 0 [stress] and a'(g) [stress / length], each of the shape of ``gap``.
        """
        return np.zeros_like(gap), np.zeros_like(gap)

    def adhesion_at(self, node: Nodal) -> Row:
        """Adhesion at the gaps ``node.gap`` >= 0, and its derivatives [stress].

        Override this method instead of ``adhesion`` if the adhesion depends on more than the gap.

        Raises:
            ValueError: If ``adhesion`` returns something else than two arrays.
        """
        result = self.adhesion(node.gap)
        if not isinstance(result, tuple) or len(result) != 2:
            raise ValueError(
                f"{self!r}: adhesion returned {result!r}; expected two arrays, the adhesion and "
                "its derivative"
            )
        return Row(*result)

    def closing_gap(self, node: Nodal) -> Row:
        """The gap that contact closes, and its derivatives [length]; the gap by default."""
        return Row(node.gap, by_gap=1.0)

    def initial(self, X: Array) -> Mapping[str, Array]:
        """Memory before the first step; zero by default.

        Args:
            X: Undeformed positions, shape (slave nodes, 2) [length].

        Returns:
            An array of shape (slave nodes,) for each name in ``memory``.
        """
        return {name: np.zeros(len(X)) for name in self.memory}

    def remember(self, node: Nodal, branch: Branches) -> Mapping[str, Array]:
        """Memory at the end of a converged step; unchanged by default.

        Args:
            node: State of the slave nodes at the end of the step, memory at its start.
            branch: Branches, shape (slave nodes,), int.

        Returns:
            An array of shape (slave nodes,) for each name in ``memory`` [units of the law].
        """
        return node.memory

    def check_field(self, name: str, values: Array) -> None:  # noqa: B027
        """Check the values of a parameter in ``fields`` at the slave nodes (local).

        Args:
            name: Its name.
            values: Finite numbers, shape (slave nodes,) [unit of the parameter].

        Raises:
            ValueError: If a value is not allowed.
        """

    def check(self) -> None:  # noqa: B027
        """Check the parameters; called before each solve (local).

        Override it in laws with parameters.

        Raises:
            ValueError: If a parameter has a value that is not allowed.
        """

    @property
    def has_friction(self) -> bool:
        """Whether the law has friction."""
        return type(self).tangential is not Frictionless.tangential

    @property
    def has_adhesion(self) -> bool:
        """Whether the law has adhesion."""
        return type(self).adhesion is not Law.adhesion or self.has_nodal_adhesion

    @property
    def has_closing_gap(self) -> bool:
        """Whether the law defines a closing gap."""
        return type(self).closing_gap is not Law.closing_gap

    @property
    def has_nodal_adhesion(self) -> bool:
        """Whether the adhesion depends on more than the gap."""
        return type(self).adhesion_at is not Law.adhesion_at

    @property
    def varying(self) -> dict[str, Any]:
        """Parameters in ``fields`` that are not numbers, by name."""
        given = {name: getattr(self, name) for name in self.fields}
        return {name: value for name, value in given.items() if varies(value)}

    @property
    def needs_nodal_state(self) -> bool:
        """Whether the law has more than a tangential row and an adhesion a(g)."""
        of_data = bool(self.memory) or self.bridges_gap or bool(self.varying)
        return of_data or self.has_closing_gap or self.has_nodal_adhesion

    @property
    def needs_slip(self) -> bool:
        """Whether the rows may depend on the slip."""
        return self.has_friction or self.needs_nodal_state


class Frictionless(Law):
    """No friction: z_tau = 0."""

    def branch(self, node: Nodal, before: Branches) -> Branches:
        """All nodes slide; see ``Law.branch``."""
        return np.ones_like(before)

    def tangential(self, node: Nodal, branch: Branches) -> Row:
        """The residual is the shear; see ``Law.tangential``."""
        return Row(node.z_tau, by_z_tau=1.0)

    def friction_limit(self, pressure: Array) -> Array:
        """Zero; see ``Law.friction_limit``."""
        return np.zeros_like(pressure)


class Stick(Law):
    """All active nodes stick, without a limit of the shear: (k / l) u = 0."""

    def branch(self, node: Nodal, before: Branches) -> Branches:
        """All nodes stick; see ``Law.branch``."""
        return np.full_like(before, STICK)

    def tangential(self, node: Nodal, branch: Branches) -> Row:
        """The residual is the slip times the stiffness; see ``Law.tangential``."""
        return Row(node.stiffness * node.slip, by_slip=node.stiffness)

    def friction_limit(self, pressure: Array) -> Array:
        """Infinity; see ``Law.friction_limit``."""
        return np.full_like(pressure, np.inf)


__all__ = [
    "Coulomb", "Friction", "Frictionless", "Law", "Nodal", "Row", "Tresca", "magnitude", "row_of",
]  # fmt: skip

# Friction limit over the pressure [1] below which the distance from a kink is relative to the
# pressure: errors of the shear after convergence are fractions of the whole traction.
SMALL_LIMIT = 1e-2


class Friction(Law):
    """Base class of laws with a friction limit b: a node sticks while |z_tau| < b, else it slides.

    The complementarity function is z_tau - clip(w, -b, b), w = z_tau + c_t (k / l) u, with the
    branches

        stick (0):     |w| <= b        (k / l) u = 0
        slide (+-1):   +-w > b         z_tau -+ b = 0

    A limit b > 0 without pressure jumps where a node opens: an edge node that its own shear opens
    closes again without it. Under a law that ``grazes`` the limit at no pressure is therefore any
    value from 0 to b. On the third branch a node slides in a direction, closed without pressure:

        graze (+-2):   0 < +-z_tau < b    z_n = 0

    Args:
        c_t: Weight of the slip in w [1]. The result does not depend on it. With large weights nodes
            reverse their direction of sliding within one iteration and may alternate; with small
            ones they stick first, which delays the sliding of a body.

    Raises:
        ValueError: If a number is not allowed.
    """

    c_t = 0.1  # default for laws that do not call ``__init__`` of this class

    def __init_subclass__(cls, **options: Any) -> None:
        """A class with branches or rows of its own grazes only if it says so."""
        super().__init_subclass__(**options)
        if {"branch", "tangential"} & vars(cls).keys() and "grazes" not in vars(cls):
            cls.grazes = False

    def __init__(self, c_t: float = c_t) -> None:
        self.c_t = c_t

    def check(self) -> None:
        """Check the weight of the slip."""
        check_number("c_t", self.c_t, "a positive number", lambda c: 0.0 < c < np.inf)

    @abstractmethod
    def limit(self, node: Nodal) -> Row | tuple[Any, Any, Any]:
        """Friction limit b at ``node`` with its derivatives, (slave nodes,).

        A ``Row``, or b and its derivatives with respect to gap and z_n [stress].
        """

    def friction_limit(self, pressure: Array) -> Array:
        """The limit b at closed gaps without slip; see ``Law.friction_limit``."""
        none = np.zeros_like(pressure)
        return np.asarray(self.limit(Nodal(none, none, pressure, none, none, none))[0])

    def friction_limit_at(self, node: Nodal) -> Array:
        """The limit b; see ``Law.friction_limit_at``.

        Of ``limit`` and ``friction_limit``, that of the most derived class applies: a law derived
        from ``Coulomb`` with another ``limit`` also has another ``friction_limit``.
        """
        kinds = (kind for kind in type(self).__mro__ if {"limit", "friction_limit"} & {*vars(kind)})
        if self.needs_nodal_state or "friction_limit" not in vars(next(kinds)):
            return np.asarray(self.limit(node)[0])
        return self.friction_limit(node.z_n)

    def branch(self, node: Nodal, before: Branches) -> Branches:
        """Stick (0), direction of sliding (+-1) or of grazing (+-2); see ``Law.branch``.

        Nodes stick or slide if the limit is 0, as before.
        """
        w, limit = node.z_tau + self.c_t * node.stiffness * node.slip, self.limit(node)[0]
        now = np.where(np.abs(w) > limit, np.sign(w), STICK).astype(np.int64)
        kink = np.abs(np.abs(w) - limit) <= KINK * np.maximum(limit, SMALL_LIMIT * np.abs(node.z_n))
        free = np.where(before == STICK, 1, before)
        found = np.where(limit == 0.0, free, np.where(kink, before, now))
        if not self.grazes:
            return found
        way, none = np.sign(before), (node.z_n == 0.0) & (node.z_tau == 0.0)  # just closed
        back = way * self.c_t * node.stiffness * node.slip < -KINK * limit
        left = np.where(way * node.z_tau + node.z_n < limit, before, way)
        left = np.where(back & ~none, STICK, left)
        return np.where(np.abs(before) == GRAZE, left, found)

    def tangential(self, node: Nodal, branch: Branches) -> Row:
        """Slip of sticking nodes, shear minus limit of sliding ones; see ``Law.tangential``."""
        given, sticks = self.limit(node), branch == STICK
        b = given if isinstance(given, Row) else Row(*given[:2], by_z_n=given[2])
        row = Row(
            np.where(sticks, -node.stiffness * node.slip, node.z_tau - branch * b.residual),
            by_gap=-branch * b.by_gap,
            by_slip=np.where(sticks, -node.stiffness, -branch * b.by_slip),
            by_z_n=-branch * b.by_z_n,
            by_z_tau=np.where(sticks, 0.0, 1.0 - branch * b.by_z_tau),
        )
        if not self.grazes:
            return row
        pairs = zip(Row(node.z_n, by_z_n=1.0), row, strict=True)
        return Row(*(np.where(np.abs(branch) == GRAZE, a, b) for a, b in pairs))


class Coulomb(Friction):
    """Coulomb's law, |z_tau| <= mu z_n, with an optional upper limit of the shear.

    Args:
        mu: Coefficient of friction [1]: a number, an array with one number per slave node, a
            function of undeformed positions (n, 2), or a scalar function of dolfinx on the mesh of
            the problem. Fields are evaluated at the slave nodes before each solve.
        max_shear: Upper limit of the shear, independent of the pressure [stress].
        c_t: Weight of the slip in the complementarity function [1], see ``Friction``.
        limit_by: Pressure in the friction limit of a Newton iterate: "trial", the positive part of
            z_n - c_n g as in the active-set test, or "pressure", the positive part of z_n. The
            solution is the same.

    Raises:
        ValueError: If an argument has a value that is not allowed.
    """

    fields = ("mu",)
    parameters: tuple[str, ...] = ("mu", "max_shear")

    def __init__(
        self,
        mu: Any,
        *,
        max_shear: float = np.inf,
        c_t: float = Friction.c_t,
        limit_by: Literal["trial", "pressure"] = "trial",
    ) -> None:
        super().__init__(c_t)
        self.mu, self.max_shear, self.limit_by = mu, max_shear, limit_by
        Coulomb.check(self)

    def check(self) -> None:
        """Check coefficient, upper limit and options."""
        super().check()
        check_positive(self, "mu", zero=True)
        expected = "a positive stress, or infinity"
        check_number("max_shear", self.max_shear, expected, lambda max_shear: max_shear > 0.0)
        check_choice("limit_by", self.limit_by, ("trial", "pressure"))

    def check_field(self, name: str, values: Array) -> None:
        """Raise an error for negative coefficients in ``values`` (slave nodes,) [1]."""
        if name == "mu" and values.min() < 0.0:
            raise ValueError(
                f"mu={values.min():g} at a slave node: expected zero or a positive number"
            )

    def __repr__(self) -> str:
        """The coefficient; all numbers of a derived law."""
        if type(self) is not Coulomb:
            return as_text(self)
        mu = type(self.mu).__name__ if varies(self.mu) else f"{self.mu:g}"
        return f"Coulomb({mu})"

    def limit(self, node: Nodal) -> tuple[Any, Any, Any]:
        """Mu times the positive part of the pressure, at most ``max_shear``; see ``Friction``."""
        mu = node.fields.get("mu", self.mu)
        c_n = node.c_n if self.limit_by == "trial" else np.zeros_like(node.c_n)
        trial = node.z_n - c_n * node.gap
        factor = np.where((trial > 0.0) & (mu * trial < self.max_shear), mu, 0.0)
        return np.clip(mu * trial, 0.0, self.max_shear), -factor * c_n, factor


class Tresca(Friction):
    """Tresca's law, |z_tau| <= stress at all closed nodes.

    Where the shear of an edge node would open it, it is as large as leaves the node closed without
    pressure, see ``Friction``.

    Args:
        stress: Friction limit [stress].
        c_t: Weight of the slip in the complementarity function [1], see ``Friction``.

    Raises:
        ValueError: If an argument has a value that is not allowed.
    """

    parameters = ("stress",)
    grazes = True

    def __init__(self, stress: float, *, c_t: float = Friction.c_t) -> None:
        super().__init__(c_t)
        self.stress = stress
        Tresca.check(self)

    def check(self) -> None:
        """Check the friction limit."""
        super().check()
        expected = "zero or a positive number"
        check_number("stress", self.stress, expected, lambda stress: 0.0 <= stress < np.inf)

    def __repr__(self) -> str:
        """The friction limit; all numbers of a derived law."""
        return f"Tresca({self.stress:g})" if type(self) is Tresca else as_text(self)

    def limit(self, node: Nodal) -> tuple[Any, Any, Any]:
        """Constant; see ``Friction.limit``."""
        return np.full_like(node.z_n, self.stress), 0.0, 0.0


# Laws whose results are not checked.
BUILT_IN = (Frictionless, Stick, Coulomb, Tresca)
