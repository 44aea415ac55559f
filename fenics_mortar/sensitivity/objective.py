# SPDX-License-Identifier: MIT
"""Objectives from arguments of users: quantities, controls, functions of the values in all steps.

**Objectives of a path as functions of the values of quantities in its steps.** Such a function
takes the values, shape (steps, quantities), and returns the objective and its derivatives with
respect to the values, of the same shape. It is local and must return equal numbers on all ranks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem

from fenics_mortar.bulk.checks import check_domain
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.forms import FormControl, FormQuantity
from fenics_mortar.sensitivity.history import Before
from fenics_mortar.sensitivity.path_record import RecordedPath
from fenics_mortar.sensitivity.protocols import Combined, ContactQuantity, Control, Quantity
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import check_same_texts, together

# Cache of controls and quantities with compiled forms, by bulk and UFL object.
_kept: WeakKeyDictionary[Any, dict[Any, Any]] = WeakKeyDictionary()


def controls_of(problem: ContactProblem, given: Any) -> list[Control]:
    """Controls; constants and functions are converted (local).

    Raises:
        ValueError: If an object is not a control.
    """
    return [_control_of(problem, control) for control in as_list(given)]


def quantities_of(problem: ContactProblem, given: Any) -> list[Quantity]:
    """Quantities; UFL forms are converted (local).

    Raises:
        ValueError: If an object is neither a quantity nor a form of rank 0.
    """
    return [_quantity_of(problem, quantity) for quantity in as_list(given)]


def as_list(given: Any) -> list[Any]:
    """A list of at least one object from one object or several (local).

    Raises:
        ValueError: If the list is empty.
    """
    found = list(given) if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    if not found:
        raise ValueError("an empty list: expected at least one control and one quantity")
    return found


def read(
    problem: ContactProblem, objective: Any, controls: Any
) -> tuple[list[Quantity], list[Control]]:
    """Quantities and controls of a gradient; see ``gradient`` for the arguments (collective).

    Raises:
        ValueError: On all ranks, if an argument is of another type, or nothing depends on a
            control.
        MortarError: On all ranks, if number, kind or arguments of quantities or controls differ.
    """
    comm = problem.equations.comm
    with together(comm, "gradient"):
        quantities, made = quantities_of(problem, objective), controls_of(problem, controls)
    given = {
        "quantities": [_described(quantity) for quantity in quantities],
        "controls": [f"{type(control).__name__} {control.name}" for control in made],
    }
    check_same_texts(comm, "gradient", given)
    for control in made:
        occurs = getattr(control, "occurs", True)
        tests = (getattr(quantity, "depends_on", lambda _: False) for quantity in quantities)
        if not occurs and not any(depends_on(control) for depends_on in tests):
            raise ValueError(
                f"{control.name}: neither residual nor Dirichlet conditions nor objective depend "
                "on this control"
            )
    return quantities, made


def explicit(
    problem: ContactProblem, quantity: Quantity, control: Control, before: Before
) -> Array | float:
    """dJ/dm at fixed states, of the shape of the control's values (collective).

    In the unit of J over that of m [any].
    """
    of_control = getattr(control, "explicit", None)
    if of_control is not None:
        return of_control(problem, quantity, before)
    return quantity.by_control(problem, control, before)


def dot(problem: ContactProblem, control: Control, one: Array, other: Array) -> float:
    """Scalar product of two arrays of a control's shape [product of units] (collective).

    Values of controls with a true ``is_distributed`` are those of the owned dofs, others are
    replicated.
    """
    mine, is_distributed = float(np.vdot(one, other)), getattr(control, "is_distributed", False)
    return problem.equations.comm.allreduce(mine) if is_distributed else mine


def _control_of(problem: ContactProblem, control: Any) -> Control:
    bulk = problem.equations.bulk
    if control is bulk.u:
        raise ValueError("the displacement is an unknown: expected a control on which it depends")
    if isinstance(control, (fem.Constant, fem.Function)):
        return _keep(bulk, control, lambda: FormControl(bulk, control))
    if not hasattr(control, "jvp") or not hasattr(control, "vjp"):
        raise ValueError(
            f"control {control!r}: expected a fem.Constant, a fem.Function or a control of the "
            f"package, e.g. LawParameter(0, 'mu')"
        )
    _check(control)
    return control


def _quantity_of(problem: ContactProblem, quantity: Any) -> Quantity:
    bulk = problem.equations.bulk
    if isinstance(quantity, ufl.Form):
        if quantity.arguments():
            raise ValueError(
                f"the objective is a form with {len(quantity.arguments())} arguments: expected a "
                "form without test functions"
            )
        check_domain("objective", quantity, bulk.V.ufl_domain())
        return _keep(bulk, quantity, lambda: FormQuantity(bulk, quantity))
    if not hasattr(quantity, "value") or not hasattr(quantity, "gradient"):
        raise ValueError(
            f"objective {quantity!r}: expected a scalar UFL form or a quantity of the package, "
            f"e.g. TotalForce(0, (0.0, 1.0))"
        )
    _check(quantity)
    if isinstance(quantity, ContactQuantity):
        quantity.check_dimension(bulk.space.dim)
    return quantity


def _check(given: Any) -> None:
    """Check the arguments of a control or quantity, if it has a method for this (local)."""
    check = getattr(given, "check", None)
    if check is not None:
        check()


def _described(quantity: Any) -> list[Any]:
    """Type and public arguments of a quantity, or of its parts, for a comparison (local)."""
    if isinstance(quantity, Combined):
        return [type(quantity).__name__, *map(_described, quantity.parts)]
    public = {name: v for name, v in vars(quantity).items() if not name.startswith("_")}
    return [type(quantity).__name__, public]


def _keep(bulk: Any, key: Any, make: Any) -> Any:
    """The object made earlier for a UFL object, or a new one (local)."""
    kept = _kept.setdefault(bulk, {})
    if key not in kept:
        kept[key] = make()
    return kept[key]


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
