# SPDX-License-Identifier: MIT
"""Arguments and results of contact laws at the slave nodes, and derivatives by complex step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

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
    value = function(node)  # complex if a parameter is, see ``sensitivity.partials.law``
    return Row(value if np.imag(value).any() else np.real(value), *changes)


def magnitude(values: Any) -> Any:
    """Absolute value of ``values``, analytic in complex arguments; slope +1 at zero (local)."""
    return np.where(np.real(values) < 0.0, -values, values)


def chain_rule(row: Row, gap: Row) -> Row:
    """Row of a law in terms of a gap that is itself a row: the chain rule."""
    first, *others = row[1:]
    chained = [a + first * b for a, b in zip(others, gap[2:], strict=True)]
    return Row(row.residual, first * gap.by_gap, *chained)


def with_gap_of_slip(row: Row, by_gap: Array) -> Row:
    """Row of a law whose slip depends on the gap, with the derivative ``by_gap`` of the slip."""
    return row._replace(by_gap=row.by_gap + row.by_slip * by_gap)


def at_points(node: Nodal, of: Callable[[Any], Any]) -> Nodal:
    """Nodal values interpolated to points of the surface; fields of shape (n, q).

    Args:
        node: State of the slave nodes.
        of: Interpolates nodal values, shape (slave nodes, ...), to points, shape (n, q, ...).
    """
    new: dict[str, Any] = {}
    for attribute in fields(node):
        value = getattr(node, attribute.name)
        if isinstance(value, Mapping):
            new[attribute.name] = {name: of(numbers) for name, numbers in value.items()}
        else:
            new[attribute.name] = of(value) if isinstance(value, np.ndarray) else value
    return Nodal(**new)
