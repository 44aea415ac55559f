# SPDX-License-Identifier: MIT
"""Derivatives in one direction of the controls, propagated forwards through the steps of a path.

The derivatives s'_k of the states and f' of the objective along dm are, see ``gradient``,

    A_k s'_k = -(dR_k/dm) dm - (dR_k/ds_{k-1}) s'_{k-1},
    f' = sum_k w_k [dJ_k/ds_k . s'_k + dJ_k/ds_{k-1} . s'_{k-1} + dJ_k/dm . dm].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dolfinx import fem

from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.gradient import Step, recorded
from fenics_mortar.sensitivity.history import Memories, StepHistory, added
from fenics_mortar.sensitivity.kinks import Kink
from fenics_mortar.sensitivity.objective import (
    Control,
    OverSteps,
    Quantity,
    as_list,
    dot,
    evaluate,
    explicit,
    last,
    read,
)
from fenics_mortar.sensitivity.path_record import RecordedPath
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import together


@dataclass(frozen=True)
class TangentLinear:
    """Derivatives of an objective and of the states in one direction of the controls (local).

    Attributes:
        value: The objective [its unit].
        derivative: Derivative of the objective [its unit].
        values: Values of the quantities, shape (steps, quantities) [their units].
        derivatives: Derivatives of the values, shape (steps, quantities) [their units].
        states: Derivatives of the states of all steps, units as in ``equations.linearized`` over
            that of the direction's factor.
        kinks: Undecided nodes and the nodes closest to a change of set; see ``kinks``.
    """

    value: float
    derivative: float
    values: Array
    derivatives: Array
    states: tuple[LinearVector, ...]
    kinks: tuple[Kink, ...]


def tangent_linear(
    objective: Any,
    controls: Any,
    directions: Any,
    path: RecordedPath | ContactProblem,
    *,
    over_steps: OverSteps = last,
) -> TangentLinear:
    """Derivative of an objective in one direction of the controls (collective).

    Args:
        objective: See ``gradient``.
        controls: See ``gradient``.
        directions: Direction of the control, or for a list of controls a list of directions:
            numbers in the shape of its derivative, a function of the space of a function; or a
            function of the number of the step that returns one of these.
        path: See ``gradient``.
        over_steps: See ``gradient``.

    Returns:
        Derivatives of the objective, the quantities and the states. The state of the problem is
        restored.

    Raises:
        ValueError: If an argument is of another type or shape, or nothing depends on a control.
        MortarError: See ``gradient``.

    Example:
        Change of the shear force if mu grows by 0.01, on a path as in ``RecordedPath``::

            mu = fm.sensitivity.LawParameter(0, "mu")
            shear = fm.sensitivity.TotalForce(0, (1.0, 0.0))
            change = fm.sensitivity.tangent_linear(shear, mu, 0.01, path).derivative
    """
    path = recorded(path)
    problem = path.problem
    quantities, made = read(problem, objective, controls)
    with together(problem.equations.comm, "tangent_linear"):
        given = as_list(directions) if isinstance(controls, Sequence) else [directions]
        if len(given) != len(made):
            raise ValueError(f"{len(given)} directions: expected {len(made)}, one per control")
        along = [
            [_direction_of(problem, *pair, number) for pair in zip(made, given, strict=True)]
            for number in range(len(path.steps))
        ]
    with path.visited():
        value, values, weights = evaluate(path, quantities, over_steps, everywhere=True)
        derivatives, states, kinks = _forwards(path, quantities, made, along)
    derivative = float((weights * derivatives).sum())
    return TangentLinear(value, derivative, values, derivatives, tuple(states), tuple(kinks))


def _direction_of(problem: ContactProblem, control: Control, given: Any, number: int) -> Array:
    """Numbers of a direction in a step (local).

    Raises:
        ValueError: If their shape is not that of the control's derivative.
    """
    if callable(given) and not isinstance(given, fem.Function):
        given = given(number)
    size = control.get(problem).shape
    if isinstance(given, fem.Function):
        given = given.x.array[: int(np.prod(size))]
    direction = np.asarray(given, float)
    if direction.shape != size:
        raise ValueError(
            f"the direction of {control.name} has the shape {direction.shape}: expected {size}"
        )
    return direction


def _forwards(
    path: RecordedPath,
    quantities: Sequence[Quantity],
    controls: Sequence[Control],
    along: Sequence[Sequence[Array]],
) -> tuple[Array, list[LinearVector], list[Kink]]:
    """Derivatives of the quantities' values and of the states, and kinks (collective)."""
    problem = path.problem
    derivatives = np.zeros((len(path.steps), len(quantities)))
    states: list[LinearVector] = []
    kinks: list[Kink] = []
    dh: Memories = {}
    for number, directions in enumerate(along):
        step = Step(path, number)
        before, memory = step.before, step.memory
        earlier = states[-1] if states else LinearVector()
        kinks += step.kinks
        pairs = list(zip(controls, directions, strict=True))
        forces = sum((c.jvp(problem, dm, before) for c, dm in pairs), memory.residuals @ dh)
        if states and isinstance(before, StepHistory):
            forces = forces + before.residuals @ earlier
        states.append(step.solve(forces * -1.0))
        if number < len(path.steps) - 1:
            by_states = [memory.by_state @ states[-1], memory.by_earlier @ earlier]
            by_controls = [memory.by_control(control) @ dm for control, dm in pairs]
            dh = added([*by_states, memory.by_before @ dh, *by_controls])
        for i, quantity in enumerate(quantities):
            change = quantity.gradient(problem, before).dot(states[-1], problem.equations.comm)
            by_before = quantity.by_before(problem, before) if states[:-1] else None
            if by_before is not None:
                change += by_before.dot(earlier, problem.equations.comm)
            for control, dm in pairs:
                by_control = np.zeros_like(dm) + explicit(problem, quantity, control, before)
                change += dot(problem, control, by_control, dm)
            derivatives[number, i] = change
    return derivatives, states, kinks
