# SPDX-License-Identifier: MIT
"""Objectives of a path as functions of the values of quantities in its steps.

Such a function takes the values, shape (steps, quantities), and returns the objective and its
derivatives with respect to the values, of the same shape. It is local and must return equal numbers
on all ranks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.sensitivity.path_record import RecordedPath
from fenics_mortar.sensitivity.protocols import Quantity
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import together

OverSteps = Callable[[Array], tuple[float, Array]]


def last(values: Array) -> tuple[float, Array]:
    """Sum of the quantities in the last step, and its derivatives by all values (local).

    Args:
        values: Values of the quantities, shape (steps, quantities) [their units].

    Returns:
        The sum [unit of the quantities] and its derivatives [1], of the shape of ``values``.
    """
    weights = np.zeros_like(values)
    weights[-1] = 1.0
    return float(values[-1].sum()), weights


def total(values: Array) -> tuple[float, Array]:
    """Sum of the quantities over all steps, and its derivatives by all values (local).

    Args:
        values: Values of the quantities, shape (steps, quantities) [their units].

    Returns:
        The sum [unit of the quantities] and its derivatives [1], of the shape of ``values``.
    """
    return float(values.sum()), np.ones_like(values)


def least_squares(measured: npt.ArrayLike, scale: npt.ArrayLike = 1.0) -> OverSteps:
    """Half the sum of the squares of (value - measured) / scale (local).

    Args:
        measured: Measured values, shape (steps,) or (steps, quantities) [units of the quantities].
        scale: Unit of the differences, a number or an array that broadcasts to shape (steps,
            quantities) [units of the quantities].

    Returns:
        The function of the values: the sum [1], and its derivatives, shape (steps, quantities).

    Raises:
        ValueError: When it is evaluated, if ``measured`` has another number of steps or quantities.
    """

    def misfit(values: Array) -> tuple[float, Array]:
        data = np.asarray(measured, float)
        data = data[:, None] if data.ndim == 1 else data
        if data.shape != values.shape:
            raise ValueError(
                f"measured has shape {np.shape(measured)}: expected a value for each of the "
                f"{len(values)} steps and {values.shape[1]} quantities"
            )
        difference = (values - data) / scale
        return 0.5 * float((difference**2).sum()), difference / scale

    return misfit


def evaluate(
    path: RecordedPath,
    quantities: Sequence[Quantity],
    over_steps: OverSteps,
    *,
    everywhere: bool = False,
) -> tuple[float, Array, Array]:
    """Objective, values of the quantities and their weights, (steps, quantities) (collective).

    Units are those of the quantities; weights have that of the objective over theirs [1 for sums].

    Args:
        path: The path.
        quantities: The quantities.
        over_steps: The objective as a function of their values.
        everywhere: Whether to evaluate all steps if the objective depends on the last one alone;
            values of the others are nan otherwise.

    Raises:
        ValueError: If the function returns other shapes.
    """
    problem, shape = path.problem, (len(path.steps), len(quantities))
    first = shape[0] - 1 if over_steps is last and not everywhere else 0
    values = np.full(shape, np.nan)
    for number in range(first, shape[0]):
        path.go_to(number)
        before = path.before(number)
        values[number] = [quantity.value(problem, before) for quantity in quantities]
    with together(problem.equations.comm, "over_steps"):
        value, weights = _called(over_steps, values)
        if np.ndim(value) or weights.shape != shape:
            raise ValueError(
                f"over_steps returned a value of shape {np.shape(value)} and derivatives of shape "
                f"{weights.shape}: expected a number and the shape {shape}"
            )
    return float(value), values, weights


def _called(over_steps: Any, values: Array) -> tuple[Any, Array]:
    """Objective and its derivatives with respect to the values, from a user's function (local).

    Raises:
        ValueError: If it is not such a function, or its numbers are not finite.
    """
    expected = "expected a function of the values that returns a number and an array"
    if not callable(over_steps):
        raise ValueError(f"over_steps={over_steps!r}: {expected}")
    found = over_steps(values)
    if not isinstance(found, tuple) or len(found) != 2:
        raise ValueError(f"over_steps returned {found!r}: {expected}")
    value, weights = found[0], np.asarray(found[1], float)
    if not (np.isfinite(value).all() and np.isfinite(weights).all()):
        raise ValueError("over_steps returned numbers that are not finite")
    return value, weights
