# SPDX-License-Identifier: MIT
"""Derivatives of an objective along a path: by the adjoint method, and in one direction.

``gradient`` goes backwards through the steps by the adjoint method. With the equations
R_k(s_k, s_{k-1}, m) = 0 of the steps k = 1..N, the quantities J_k and the objective
f(J_1, ..., J_N), w_k = df/dJ_k,

    A_k^T y_k = w_k dJ_k/ds_k + w_{k+1} dJ_{k+1}/ds_k - (dR_{k+1}/ds_k)^T y_{k+1},
    df/dm = sum_k [w_k dJ_k/dm - (dR_k/dm)^T y_k],             A_k = dR_k/ds_k.

Memories of laws are propagated with the states, see ``history``. One solve with the transposed
tangent per step gives the derivatives with respect to all controls. dR_{k+1}/ds_k is the history:
partners, slip and shear of the accepted state; without friction it vanishes, and steps without
weight are left out.

``tangent_linear`` goes forwards. The derivatives s'_k of the states and f' of the objective in one
direction dm of the controls are

    A_k s'_k = -(dR_k/dm) dm - (dR_k/ds_{k-1}) s'_{k-1},
    f' = sum_k w_k [dJ_k/ds_k . s'_k + dJ_k/ds_{k-1} . s'_{k-1} + dJ_k/dm . dm].

``Simulation`` is a path as a function of the controls, for frameworks of automatic differentiation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from fenics_mortar.contact.contact import Contact
from fenics_mortar.equations.linearized import LinearizedEquations, LinearVector
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.controls import LawParameter, dot, explicit
from fenics_mortar.sensitivity.forms import as_list, controls_of, put_owned, quantities_of, read
from fenics_mortar.sensitivity.history import Before, Memories, StepHistory, StepMemory, added
from fenics_mortar.sensitivity.objective import RecordedPath, evaluate, find_kinks, last, total
from fenics_mortar.sensitivity.protocols import Control, Quantity, memory_by
from fenics_mortar.utils.errors import MortarError, together
from fenics_mortar.utils.ranks import agreed

if TYPE_CHECKING:
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.sensitivity.objective import Kink, OverSteps
    from fenics_mortar.utils.arrays import Array


# Whether no node of a pair is in contact, or all that are stick.
Status = Literal["open", "stick", "other"]


@dataclass(frozen=True)
class Gradient:
    """Derivatives of an objective with respect to controls; all methods are local.

    ``gradient[control]`` is the derivative with respect to a control: an array of the shape of a
    constant, the derivatives with respect to all nodal values of a function as a function of its
    space (the dual vector; for the gradient in L2 solve with the mass matrix), and an array for
    controls of contact.

    Attributes:
        value: The objective [its unit].
        values: Values of the quantities, shape (steps, quantities) [their units]; nan in steps that
            the objective does not depend on.
        controls: The controls as given.
        by_step: Contributions of the steps: for each control a list of arrays of the shape of its
            values, the derivatives with respect to the value in this step alone [objective / unit
            of the control]. Their sum is the derivative with respect to a
            value of all steps. Functions: values of the owned dofs.
        kinks: Undecided nodes and the nodes closest to a change of set; see ``objective``.
        remarks: Parameters of laws on which the objective does not depend, as all nodes in contact
            stick, or none is in contact; see ``objective``.
    """

    value: float
    values: Array
    controls: tuple[Any, ...]
    by_step: tuple[list[Array], ...]
    kinks: tuple[Kink, ...]
    remarks: tuple[str, ...]

    def __getitem__(self, control: Any) -> Any:
        """Derivative with respect to a control (collective for functions).

        Raises:
            KeyError: If it is not one of ``controls``.
        """
        for given, parts in zip(self.controls, self.by_step, strict=True):
            if given is control:
                return in_own_space(control, sum(parts[1:], parts[0]))
        raise KeyError(f"{control!r} is not one of the controls of this gradient")

    def __str__(self) -> str:
        """Objective, a line for each control, and remarks (local).

        Fields, and derivatives of more than 8 values, are not printed.
        """
        lines = [f"objective {self.value:.6g}"]
        for number, (control, parts) in enumerate(zip(self.controls, self.by_step, strict=True)):
            derivative = np.asarray(sum(parts[1:], parts[0]))
            is_field = isinstance(control, fem.Function) or derivative.size > 8
            text = f"{derivative.size} values" if is_field else np.array2string(derivative)
            name = getattr(control, "name", type(control).__name__)
            lines.append(f"by control {number}, {name}: {text}")
        return "\n".join([*lines, *self.remarks])

    @property
    def undecided(self) -> tuple[Kink, ...]:
        """Nodes on a kink, where the gradient is not unique."""
        return tuple(kink for kink in self.kinks if kink.is_undecided)

    @property
    def nearest_change(self) -> Kink | None:
        """The node nearest to a change of its set, ``None`` without contact."""
        return min(self.kinks, key=attrgetter("distance"), default=None)


def in_own_space(control: Any, values: Array) -> Any:
    """Values (owned dofs,) of a function as a function, other values unchanged (collective)."""
    if not isinstance(control, fem.Function):
        return values
    function = fem.Function(control.function_space, name=f"derivative by {control.name}")
    put_owned(function, values)
    return function


def gradient(
    objective: Any,
    controls: Any,
    path: RecordedPath | ContactProblem,
    *,
    over_steps: OverSteps = last,
) -> Gradient:
    """Derivatives of an objective with respect to controls (collective).

    Args:
        objective: A scalar UFL form of the displacement and other fields, or a quantity of contact
            such as ``TotalForce``; or a list of them.
        controls: A control or a list of them: constants and functions of the residual and of
            Dirichlet conditions, and parameters of contact such as ``LawParameter``.
        path: A recorded path, or a solved problem. For a problem the objective is that of its
            present state, and the state from which slip is counted is fixed.
        over_steps: The objective as a function of the quantities' values in the steps; the sum of
            the quantities in the last step by default; see ``objective``.

    Returns:
        Objective and derivatives. The state of the problem is restored.

    Raises:
        ValueError: If an argument is of another type, or nothing depends on a control.
        MortarError: On all ranks, if the path has no steps, a tangent is singular, rigid moves
            between steps changed the state from which slip is counted, or bodies have history.
    """
    path = recorded(path)
    quantities, made = read(path.problem, objective, controls)
    with path.visited():
        value, values, weights = evaluate(path, quantities, over_steps)
        by_step, kinks, statuses = _backwards(path, quantities, weights, made)
    equations = path.problem.equations
    remarks = agreed(equations.comm, flat_remarks(equations.contacts, statuses, made, by_step))
    given = tuple(as_list(controls))
    return Gradient(value, values, given, tuple(by_step), tuple(kinks), remarks)


def recorded(path: Any) -> RecordedPath:
    """A recorded path of at least one step.

    Raises:
        ValueError: If the argument is of another type.
        MortarError: If there is no state.
    """
    if isinstance(path, ContactProblem):
        path = RecordedPath(path)
        path.start = None  # slip is counted from a fixed state
        path.record()
    if not isinstance(path, RecordedPath):
        raise ValueError(f"path={path!r}: expected a RecordedPath or a solved ContactProblem")
    if not path.steps:
        raise MortarError("the path has no steps: call record() after each solve")
    return path


def visit(path: RecordedPath, number: int) -> tuple[Before, StepMemory]:
    """Go to a step of a path (collective).

    Returns:
        ``StepHistory`` of the state before, of the first step this state, which is fixed; and the
        derivatives of the memory of laws.
    """
    path.go_to(number)
    state, equations = path.before(number), path.problem.equations
    before = StepHistory(equations, state) if number and state is not None else state
    return before, StepMemory(equations, before)


def _solved(problem: ContactProblem, rhs: LinearVector, *, transpose: bool = False) -> LinearVector:
    """Solve with the tangent A = dR/ds of the present step, or with its transpose (collective)."""
    problem.equations.bulk.free_garbage()
    return LinearizedEquations(problem.equations).solve(rhs, transpose=transpose)


def _backwards(
    path: RecordedPath, quantities: Sequence[Quantity], weights: Array, controls: Sequence[Control]
) -> tuple[list[list[Array]], list[Kink], list[list[Status]]]:
    """Contributions of the steps to the derivatives, for each control, and kinks (collective).

    The last result is the status of all pairs in the steps that the objective depends on.
    """
    problem = path.problem
    by_step: list[list[Array]] = [[] for _ in controls]
    kinks: list[Kink] = []
    statuses: list[list[Status]] = []
    carried = LinearVector()
    by_memory: Memories = {}
    for number in reversed(range(len(path.steps))):
        is_carried = by_memory or any(part is not None for part in vars(carried).values())
        if not is_carried and not weights[number].any():
            for parts, control in zip(by_step, controls, strict=True):
                parts.insert(0, np.zeros_like(control.get(problem)))
            continue
        before, memory = visit(path, number)
        kinks[:0] = find_kinks(problem, number)
        statuses.append([status_of(contact) for contact in problem.equations.contacts])
        weighted = [(w, q) for w, q in zip(weights[number], quantities, strict=True) if w]
        rhs = carried + memory.by_state.T @ by_memory
        for weight, quantity in weighted:
            rhs = rhs + quantity.gradient(problem, before) * weight
        y = _solved(problem, rhs, transpose=True)
        for parts, control in zip(by_step, controls, strict=True):
            change = -control.vjp(problem, y, before)
            if by_memory:
                change = change + memory_by(problem, memory, control).T @ by_memory
            for weight, quantity in weighted:
                change = change + weight * explicit(problem, quantity, control, before)
            parts.insert(0, change)
        carried = LinearVector()
        if isinstance(before, StepHistory):
            for weight, quantity in weighted:
                carried = carried + (quantity.by_before(problem, before) or LinearVector()) * weight
            carried = carried + before.residuals.T @ (y * -1.0) + memory.by_earlier.T @ by_memory
        of_rows = memory.residuals.T @ (y * -1.0)
        by_memory = added(memory.by_before.T @ by_memory, of_rows)
    return by_step, kinks, statuses


def status_of(contact: Interface) -> Status:
    """Whether no node of a pair is in contact, or all that are stick (local)."""
    if not contact.active.any():
        return "open"
    if not isinstance(contact, Contact) or not contact.pair.law.has_friction:
        return "other"
    can_slide = contact.active & contact.follows_law
    return "other" if (can_slide & ~contact.now.sticking).any() else "stick"


def flat_remarks(
    contacts: Sequence[Interface], statuses: Sequence[Sequence[Status]],
    controls: Sequence[Control], by_step: Sequence[Sequence[Array]],
) -> tuple[str, ...]:  # fmt: skip
    """Describe parameters of laws whose derivative is zero in a whole region (local).

    An objective may be flat. If all nodes in contact stick in all steps, a larger friction limit
    changes nothing: the derivative is exactly zero in a whole region, and an optimizer that
    compares gradients with zero stops there. The same holds for all parameters of a pair without
    contact.

    Args:
        contacts: The pairs.
        statuses: ``status_of`` the pairs, in each step that the objective depends on.
        controls: The controls.
        by_step: Contributions of the steps to the derivatives by each control.
    """
    found = []
    for control, parts in zip(controls, by_step, strict=True):
        if not isinstance(control, LawParameter) or any(part.any() for part in parts):
            continue
        seen = {each[control.pair] for each in statuses}
        if seen and "other" not in seen:
            contact = contacts[control.pair]
            found.append(
                f"the derivative by {control.name} is zero: in all {len(statuses)} steps "
                f"{_reason(contact, seen)} (a flat region, which is not a minimum)"
            )
    return tuple(found)


def _reason(contact: Interface, seen: set[Status]) -> str:
    """Why an objective is flat, and what helps (local)."""
    names = f"'{contact.slave.name}' on '{contact.master.name}'"
    if "stick" not in seen:
        return f"no node of {names} is in contact; choose steps or other parameters with contact"
    return (
        f"all nodes of {names} in contact stick, so that the objective does not depend on the "
        "friction limit; start with less friction, bound it to values with slip, or load until "
        "nodes slide"
    )


class Simulation:
    """Values of quantities in the steps of a path, as a function of the values of controls.

    All methods are collective; values of functions are those of the owned dofs.

    Frameworks of automatic differentiation need a function and the product of a vector with its
    Jacobian (pullback): the methods of this class.

    Args:
        problem: The problem.
        run: Function that solves from one and the same state, and returns the recorded path or the
            problem.
        objectives: See ``gradient``.
        controls: See ``gradient``.

    Raises:
        ValueError: On all ranks, if a control is not allowed.

    Example:
        Derivative of a function of the friction work in all steps with respect to mu::

            work, mu = fm.sensitivity.FrictionWork(0), fm.sensitivity.LawParameter(0, "mu")
            works = fm.sensitivity.to_autograd(fm.sensitivity.Simulation(problem, run, work, mu))
            by_mu = autograd.grad(lambda mu: autograd.numpy.sum(works(mu) ** 2))(0.3)
    """

    def __init__(
        self, problem: ContactProblem, run: Callable[[], Any], objectives: Any, controls: Any
    ) -> None:
        self._problem, self._run, self._objectives = problem, run, objectives
        with together(problem.equations.comm, "Simulation"):
            self.controls, self._made = as_list(controls), controls_of(problem, controls)
        self._last: tuple[list[Array], RecordedPath] | None = None

    def __call__(self, *values: npt.ArrayLike) -> Array:
        """Values of the quantities at given values of the controls, shape (steps, quantities).

        Raises:
            ValueError: On all ranks, if number or shapes differ from those of the controls.
        """
        path, quantities = self._path(values), quantities_of(self._problem, self._objectives)
        with path.visited():
            return evaluate(path, quantities, total)[1]

    def pullback(self, weights: npt.ArrayLike, *values: npt.ArrayLike) -> list[Array]:
        """Derivatives of the sum of weights times values of the quantities.

        The path is solved again if the values have changed.

        Args:
            weights: Weights, shape (steps, quantities) [1 / unit of the quantity].
            values: Values of the controls, of their shapes [their units].

        Returns:
            One array per control, of its shape [1 / unit of the control].
        """
        w = np.asarray(weights, float)
        found = gradient(
            self._objectives, self.controls, self._path(values),
            over_steps=lambda at: (float((w * at).sum()), w),
        )  # fmt: skip
        return [np.asarray(np.sum(parts, axis=0)) for parts in found.by_step]

    def _path(self, values: tuple[npt.ArrayLike, ...]) -> RecordedPath:
        """The path for these values, solved again if they have changed (collective)."""
        given, comm = [np.array(value, float) for value in values], self._problem.equations.comm
        with together(comm, "Simulation"):
            shapes = [control.get(self._problem).shape for control in self._made]
            if [value.shape for value in given] != shapes:
                raise ValueError(f"values of shapes {[v.shape for v in given]}: expected {shapes}")
        same = self._last is not None and all(map(np.array_equal, given, self._last[0]))
        if self._last is None or comm.allreduce(not same):
            self._last = None
            for control, value in zip(self._made, given, strict=True):
                control.set(self._problem, value)
            self._last = given, recorded(self._run())
        return self._last[1]


def to_autograd(simulation: Simulation) -> Any:
    """Convert a simulation to a function of autograd, which must be installed (local).

    See https://github.com/HIPS/autograd.
    """
    from autograd.extend import defvjp, primitive

    def rule(i: int) -> Callable[..., Any]:
        return lambda _, *at: lambda weights: simulation.pullback(weights, *at)[i]

    function = primitive(simulation.__call__)
    defvjp(function, *map(rule, range(len(simulation.controls))))
    return function


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
        kinks: Undecided nodes and the nodes closest to a change of set; see ``objective``.
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
    derivative = float((weights * derivatives)[weights != 0.0].sum())
    return TangentLinear(value, derivative, values, derivatives, tuple(states), tuple(kinks))


def _direction_of(problem: ContactProblem, control: Control, given: Any, number: int) -> Array:
    """Values of a direction in a step (local).

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
    path: RecordedPath, quantities: Sequence[Quantity], controls: Sequence[Control],
    along: Sequence[Sequence[Array]],
) -> tuple[Array, list[LinearVector], list[Kink]]:  # fmt: skip
    """Derivatives of the quantities' values and of the states, and kinks (collective)."""
    problem = path.problem
    derivatives = np.zeros((len(path.steps), len(quantities)))
    states: list[LinearVector] = []
    kinks: list[Kink] = []
    dh: Memories = {}
    for number, directions in enumerate(along):
        before, memory = visit(path, number)
        earlier = states[-1] if states else LinearVector()
        kinks += find_kinks(problem, number)
        pairs = list(zip(controls, directions, strict=True))
        forces = sum((c.jvp(problem, dm, before) for c, dm in pairs), memory.residuals @ dh)
        if isinstance(before, StepHistory):
            forces = forces + before.residuals @ earlier
        states.append(_solved(problem, forces * -1.0))
        if number < len(path.steps) - 1:
            by_states = [memory.by_state @ states[-1], memory.by_earlier @ earlier]
            by_controls = [memory_by(problem, memory, control) @ dm for control, dm in pairs]
            dh = added(*by_states, memory.by_before @ dh, *by_controls)
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
