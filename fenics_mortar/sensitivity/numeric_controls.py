# SPDX-License-Identifier: MIT
"""Numerical choices as controls: weights of the rows and of the active-set test, residual.

An exact solution does not depend on them. Derivatives with respect to weights are zero except for
the elastic stick of redundant nodes. The derivative with respect to the residual is the error due
to the end of Newton's method.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.problem import ContactProblem
from fenics_mortar.sensitivity.controls import Before, Control
from fenics_mortar.sensitivity.pair_vectors import contact_of, from_rows, rows_at
from fenics_mortar.sensitivity.partials.law import rows_by_weight
from fenics_mortar.utils.arrays import Array


class NumericWeight(Control):
    """Factor of a weight of a pair, at present 1: c_n, or the stiffness k of the rows.

    Args:
        pair: Number of the pair, a contact.
        weight: "c_n" or "stiffness".
    """

    def __init__(self, pair: int, weight: Literal["c_n", "stiffness"]) -> None:
        self.pair, self.weight, self.name = pair, weight, f"{weight} of pair {pair}"

    def get(self, problem: ContactProblem) -> Array:
        """See ``Control``."""
        return np.array(1.0)

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Multiply the present weight."""
        contact, factor = contact_of(problem.equations, self.pair), float(values)
        if self.weight == "c_n":
            contact.change(c_n=contact.c_n * factor)
        else:
            contact.set_stiffness(contact.stiffness * factor)

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """See ``Control``; ``before`` is not used."""
        rows = float(dm) * self._rows(problem)
        return from_rows(problem.equations, {self.pair: rows})

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """See ``Control``; ``before`` is not used."""
        contact = contact_of(problem.equations, self.pair)
        return np.array((rows_at(y, self.pair, contact) * self._rows(problem)).sum())

    def _rows(self, problem: ContactProblem) -> Array:
        return rows_by_weight(contact_of(problem.equations, self.pair), self.weight)


class RemainingResidual(Control):
    """Factor of the remaining residual of Newton's method: 1; with 0 equilibrium is exact."""

    name = "residual left"

    def get(self, problem: ContactProblem) -> Array:
        """See ``Control``."""
        return np.array(1.0)

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Raise an error: the residual follows from the tolerance of Newton's method."""
        raise ValueError(
            "the remaining residual follows from NewtonOptions: expected another control"
        )

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """See ``Control``; ``before`` is not used."""
        factor, whole = -float(dm), self._residual(problem)
        assert whole.u is not None and whole.z is not None and whole.q is not None
        return LinearVector(factor * whole.u, [factor * z for z in whole.z], factor * whole.q)

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """See ``Control``; ``before`` is not used."""
        return np.array(-self._residual(problem).dot(y, problem.equations.comm))

    def _residual(self, problem: ContactProblem) -> LinearVector:
        """Residuals of all equations at the present state (collective)."""
        e = problem.equations
        bulk, contact, _ = e.residual.forces()
        u = bulk + contact
        u[e.bulk.prescribed_dofs] = -e.bulk.distance_to_prescribed()
        z = [c.rows.weighted(c.rows.frame()) for c in e.contacts]
        return LinearVector(u, z, e.motions.residual() * e.motions.scales)
