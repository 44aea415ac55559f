# SPDX-License-Identifier: MIT
"""Paths of contact as functions for frameworks of automatic differentiation.

Such a framework needs a function and the product of a vector with its Jacobian (pullback): the
methods of ``Simulation``. ``to_autograd`` defines the function for autograd
(https://github.com/HIPS/autograd).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.gradient import gradient, recorded
from fenics_mortar.sensitivity.over_steps import evaluate, total
from fenics_mortar.sensitivity.path_record import RecordedPath
from fenics_mortar.sensitivity.protocols import as_list, controls_of, quantities_of
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import together


class Simulation:
    """Values of quantities in the steps of a path, as a function of the values of controls.

    All methods are collective; values of functions are those of the owned dofs.

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
    """Convert a simulation to a function of autograd, which must be installed (local)."""
    from autograd.extend import defvjp, primitive

    def rule(i: int) -> Callable[..., Any]:
        return lambda _, *at: lambda weights: simulation.pullback(weights, *at)[i]

    function = primitive(simulation.__call__)
    defvjp(function, *map(rule, range(len(simulation.controls))))
    return function
