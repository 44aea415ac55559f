# SPDX-License-Identifier: MIT
"""Recorded paths, objectives as functions of the values in their steps, and kinks.

``RecordedPath`` has the accepted states of a path, with the loads and data of the solves.
``evaluate`` gives an objective with the values of the quantities, and ``find_kinks`` the distances
of the states from the next change of active sets and branches.

An objective of a path is a function of the values of quantities in its steps. It takes the values,
shape (steps, quantities), and returns the objective and its derivatives with respect to the values,
of the same shape. It is local and must return equal numbers on all ranks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from fenics_mortar.bulk.checks import refuse_history
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.law import GRAZE, KINK, Friction
from fenics_mortar.equations.general import Snapshot, State, restored_if_interrupted
from fenics_mortar.interface.mortar import EXACT
from fenics_mortar.problem import ContactProblem
from fenics_mortar.rigid.spread import refuse_remote
from fenics_mortar.utils import compat, errors
from fenics_mortar.utils.arrays import LAST_DIGITS, Array, Flags

if TYPE_CHECKING:
    from fenics_mortar.sensitivity.protocols import Quantity

# Residual of a solution over that of Newton's tolerance [1]: the reference force of an iteration
# may have been larger than that of the state.
SOLVED_FACTOR = 1e3


@dataclass(frozen=True)
class RecordedStep:
    """An accepted state with its data (local).

    Attributes:
        state: The state.
        data: Values of the constants and functions of residual, conditions and laws except the
            displacement, of any shape [their units].
        laws: Attributes of the laws and conductances of the contacts.
        shapes: Parameters of the shape of each obstacle by name [their units].
        loads: Forces and moments that drive the obstacles, shape (m,) each, nan where prescribed
            [stress length, stress length^2].
    """

    state: State
    data: tuple[Array, ...]
    laws: tuple[dict[str, Any], ...]
    shapes: tuple[dict[str, Array], ...]
    loads: tuple[Array, ...]


def _settings(problem: ContactProblem) -> list[Any]:
    """Laws and conductances of the contacts (local)."""
    pairs = [contact.pair for contact in problem.equations.floating.contacts]
    return [setting for pair in pairs for setting in (pair.law, *pair.fluxes)]


class RecordedPath:
    """Accepted states of a problem, in the order of their load steps; all methods are collective.

    Slip is counted from the state before. A path with friction must therefore be recorded without
    gaps, with one call of ``record`` after each solve::

        path = fm.sensitivity.RecordedPath(problem)  # at the initial state of the path
        fm.follow_path(problem, set_loads, options, on_step=path.record)
        mu = fm.sensitivity.LawParameter(0, "mu")
        gradient = fm.gradient(fm.sensitivity.TotalForce(0, (1.0, 0.0)), [E, mu], path)

    The initial state is fixed: it has no derivatives. Each record contains the displacement, the
    interface states and the values of all constants and functions of the residual.

    Args:
        problem: The problem, at the start of the path.
        also: Constants and functions that change between steps and on which only the objective
            depends.

    Attributes:
        problem: The problem.
        start: State at the start, ``None`` for the path of a single state.
        steps: The records.

    Raises:
        ValueError: If ``problem`` is of another type.
        MortarError: If the problem has inertia or history functions.
    """

    def __init__(self, problem: ContactProblem, *, also: Sequence[Any] = ()) -> None:
        errors.check_kind("problem", problem, ContactProblem, "a ContactProblem")
        if problem.equations.bulk.inertia is not None:
            raise errors.MortarError("dynamics have no derivatives: expected a static problem")
        if any(getattr(s, "heating", None) == "friction" for s in _settings(problem)):
            raise errors.MortarError(
                "heating='friction' has no derivatives: expected heating=None or a function of "
                "pressure and position"
            )
        motions = problem.equations.motions
        refuse_remote([*motions.remote, *motions.spread], "gradients are not implemented")
        refuse_history(problem.equations.bulk, "the gradient of a path")
        self.problem, bulk = problem, problem.equations.bulk
        values = [value for setting in _settings(problem) for value in vars(setting).values()]
        of_laws = [value for value in values if isinstance(value, (fem.Constant, fem.Function))]
        data = dict.fromkeys([*bulk.data, *of_laws, *also])
        self._data = [d.value if isinstance(d, fem.Constant) else d.x.array for d in data]
        self._data += map(compat.condition_numbers, bulk.bcs)
        self.start: State | None = problem.state()
        self.steps: list[RecordedStep] = []

    def record(self, *arguments: Any) -> None:
        """Add the present state.

        Args:
            arguments: Ignored; ``follow_path`` may therefore call this method as its ``on_step``.

        Raises:
            MortarError: On all ranks, if the present state is not a solution for the present values
                of loads, material and laws.
        """
        check_solved(self.problem)
        self.steps.append(self.present())

    def present(self) -> RecordedStep:
        """Record of the present state."""
        laws = tuple(
            {k: v.copy() if isinstance(v, np.ndarray) else v for k, v in vars(setting).items()}
            for setting in _settings(self.problem)
        )
        shapes = tuple(obstacle.shape() for obstacle in self.problem.obstacles)
        loads = tuple(obstacle.load.copy() for obstacle in self.problem.obstacles)
        return RecordedStep(
            self.problem.state(), tuple(map(np.array, self._data)), laws, shapes, loads
        )

    def before(self, number: int) -> State | None:
        """State before the step ``number``."""
        return self.steps[number - 1].state if number else self.start

    def go_to(self, number: int) -> None:
        """Restore the state and the values of step ``number``, and evaluate the operators."""
        self._put_values(self.steps[number])
        self.problem.restore(self.steps[number].state)

    def _put_values(self, step: RecordedStep) -> None:
        for array, numbers in zip(self._data, step.data, strict=True):
            array[...] = numbers
        for setting, values in zip(_settings(self.problem), step.laws, strict=True):
            vars(setting).update(values)
        for contact in self.problem.equations.floating.contacts:
            contact.adopt_law()
        obstacles = zip(self.problem.obstacles, step.loads, step.shapes, strict=True)
        for obstacle, load, shape in obstacles:
            if not np.array_equal(obstacle.load, load, equal_nan=True):
                obstacle.load = load
            for name, now in obstacle.shape().items():
                if not np.array_equal(now, shape[name]):
                    obstacle.set_shape(name, shape[name])

    @contextmanager
    def visited(self) -> Iterator[None]:
        """Context of visits to steps, with exact derivatives; changes are reverted at the end."""
        equations = self.problem.equations
        present, before = self.present(), Snapshot(equations)
        residual, linearization = equations.bulk.r.array_r.copy(), equations.linearization
        equations.linearization, renew = EXACT, True
        try:
            yield
            renew = False
        except errors.MortarError as error:
            renew = isinstance(error, errors.RaisedElsewhereError)
            raise
        except BaseException as error:
            errors.raise_cause(error)
        finally:
            equations.linearization = linearization
            self._put_values(present)
            before.revert(renew=renew)
            equations.bulk.r.array[:] = residual


def check_solved(problem: ContactProblem) -> None:
    """Reject a state that is not a solution; one evaluation of the residual (collective).

    Derivatives are those of a solution. At a state for other loads, materials or laws than the
    present ones they would be wrong without any indication; such a state is not recorded.

    Raises:
        MortarError: On all ranks, if the last solve failed, or if displacement, loads, prescribed
            values, material or law were changed after it.
    """
    e = problem.equations
    if not e.last_converged:
        raise errors.MortarError(
            "the present state is not the result of a solve: record a state after solve()"
        )
    with restored_if_interrupted(e):
        e.evaluate_operators()
        e.bulk.assemble_residual()
        if e.floating.bodies:
            e.floating.add_spring_forces()
        e.residual.begin()
        residual = e.residual.measure()
    tolerance = e.newton.residual_tolerance
    allowed = SOLVED_FACTOR * max(tolerance * e.residual.force, e.residual.attainable)
    if not residual <= allowed:
        raise errors.MortarError(
            f"the present state is not a solution: residual {residual:.1e}, allowed {allowed:.1e}. "
            "Displacement, loads, prescribed values, material or law were changed after solve(): "
            "record before changing them, or solve again"
        )


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
    path: RecordedPath, quantities: Sequence[Quantity], over_steps: OverSteps,
    *, everywhere: bool = False,
) -> tuple[float, Array, Array]:  # fmt: skip
    """Objective, values of the quantities and their weights, (steps, quantities) (collective).

    Units are those of the quantities; weights have that of the objective over theirs [1 for sums].

    Args:
        path: The path.
        quantities: The quantities.
        over_steps: The objective as a function of their values.
        everywhere: Whether to evaluate all steps if the objective depends on the last one alone;
            values of the others are nan otherwise.

    Raises:
        ValueError: If the function returns other shapes, or numbers that are not finite.
        MortarError: On all ranks, if it depends on a value that is nan.
    """
    problem, shape = path.problem, (len(path.steps), len(quantities))
    first = shape[0] - 1 if over_steps is last and not everywhere else 0
    values = np.full(shape, np.nan)
    for number in range(first, shape[0]):
        path.go_to(number)
        before = path.before(number)
        values[number] = [quantity.value(problem, before) for quantity in quantities]
    with errors.together(problem.equations.comm, "over_steps"):
        value, weights = _called(over_steps, values)
        if np.ndim(value) or weights.shape != shape:
            raise ValueError(
                f"over_steps returned a value of shape {np.shape(value)} and derivatives of shape "
                f"{weights.shape}: expected a number and the shape {shape}"
            )
        unknown = np.argwhere(np.isnan(values) & (weights != 0.0)).tolist()
        if unknown:
            step, number = unknown[0]
            raise errors.MortarError(
                f"quantity {number} has no value in step {step}, as where none of the slave nodes "
                "of MeanGap faces the master within the search radius"
            )
        if not (np.isfinite(value) and np.isfinite(weights).all()):
            raise ValueError("over_steps returned numbers that are not finite")
    return float(value), values, weights


def _called(over_steps: Any, values: Array) -> tuple[Any, Array]:
    """Objective and its derivatives with respect to the values, from a user's function (local).

    Raises:
        ValueError: If it is not such a function.
    """
    expected = "expected a function of the values that returns a number and an array"
    if not callable(over_steps):
        raise ValueError(f"over_steps={over_steps!r}: {expected}")
    found = over_steps(values)
    if not isinstance(found, tuple) or len(found) != 2:
        raise ValueError(f"over_steps returned {found!r}: {expected}")
    return found[0], np.asarray(found[1], float)


Change = Literal["opens", "closes", "slides", "sticks", "cover"]


@dataclass(frozen=True)
class Kink:
    """The node of a pair and step closest to a change of a set; local.

    The converged state is differentiable where no set changes. At a kink, the derivatives are those
    of the sets of the state: an element of Clarke's generalized derivative. The distances from a
    kink are

    ================  ==========================================================
    node              distance [1]
    ================  ==========================================================
    active            (z_n + a) / largest pressure of the pair
    open              mean gap / nodal length
    sticking          (b - abs(z_tau)) / b, friction limit b
    sliding           slip / nodal length
    ================  ==========================================================

    and zero where the cover of a node is at the limit for a multiplier. A node is undecided if its
    distance is at most ``contact.law.KINK``. Distances of sticking and sliding nodes are known for
    laws with a friction limit that is reached in sliding (``Friction``).

    Attributes:
        distance: Distance from the change [1].
        step: Number of the step.
        pair: Number of the pair.
        node: Number of the slave node along the surface.
        X: Reference position of the node, shape (d,) [length].
        change: The change.
    """

    distance: float
    step: int
    pair: int
    node: int
    X: tuple[float, ...]
    change: Change

    @property
    def is_undecided(self) -> bool:
        """Whether the node is on the kink."""
        return self.distance <= KINK

    def __str__(self) -> str:
        """Node, change and distance as text."""
        return (
            f"step {self.step}, pair {self.pair}: node {self.node} at "
            f"{errors.format_point(self.X)} {self.change} at a distance of {self.distance:.1e}"
        )


def find_kinks(problem: ContactProblem, step: int) -> list[Kink]:
    """Undecided nodes of the present state, and the nearest other one of each pair (local).

    Args:
        problem: The problem, evaluated.
        step: Number of the step.
    """
    found: list[Kink] = []
    for pair, contact in enumerate(problem.equations.contacts):
        if not isinstance(contact, Contact):
            continue
        kinks = [
            Kink(float(distance[j]), step, pair, int(j), tuple(contact.slave.X[j].tolist()), change)
            for change, distance in _distances(contact).items()
            for j in np.flatnonzero(distance <= max(KINK, distance.min(initial=np.inf)))
            if np.isfinite(distance[j])
        ]
        undecided = [kink for kink in kinks if kink.is_undecided]
        found += undecided or sorted(kinks, key=attrgetter("distance"))[:1]
    return found


def _distances(contact: Contact) -> dict[Change, Array]:
    """Distances of all nodes from each change, inf where it is not possible, (slave nodes,)."""
    now, law = contact.now, contact.pair.law
    active, covered = contact.active, now.covered
    rounding = LAST_DIGITS * contact.stiffness  # as in the active-set test
    pressure = np.where(np.abs(now.tension) <= rounding, 0.0, np.abs(now.tension))
    largest = float(pressure.max(initial=0.0)) or 1.0
    grazes = active & law.grazes & (np.abs(contact.branch) == GRAZE)
    pressure = np.where(grazes, np.abs(now.z_tau), pressure)
    undecided = np.zeros(active.size, bool)
    undecided[contact.undecided] = True
    found: dict[Change, tuple[Flags, Array]] = {
        "opens": (active, pressure / largest),
        "closes": (covered & ~active, np.abs(now.mean_gap) / now.nodal_lengths),
        "cover": (undecided, np.zeros(active.size)),
    }
    if isinstance(law, Friction):
        limit = np.asarray(now.friction_limit(now.z_n))
        limited = active & (limit > 0.0) & np.isfinite(limit)
        shear = np.abs(now.z_tau) / np.where(limited, limit, 1.0)
        found["slides"] = limited & (now.sticking | grazes), np.abs(1.0 - shear)
        found["sticks"] = limited & now.sliding, np.abs(now.slip) / now.nodal_lengths
    return {change: np.where(*where, np.inf) for change, where in found.items()}
