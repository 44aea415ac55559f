# SPDX-License-Identifier: MIT
"""Choices of the numerics as controls: weights of the rows and of the active-set test, residual.

A solution depends on none of them: derivatives by weights are zero but for the elastic stick of
redundant nodes, and that by the residual is the error of stopping Newton's method.
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
    """Part of the residual that Newton's method left, at present 1; at 0 equilibrium is exact."""

    name = "residual left"

    def get(self, problem: ContactProblem) -> Array:
        """See ``Control``."""
        return np.array(1.0)

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """See ``Control``; ``before`` is not used."""
        factor, whole = -float(dm), self._residual(problem)
        assert whole.u is not None and whole.z is not None and whole.q is not None
        return LinearVector(factor * whole.u, [factor * z for z in whole.z], factor * whole.q)

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """See ``Control``; ``before`` is not used."""
        return np.array(-self._residual(problem).dot(y, problem.comm))

    def _residual(self, problem: ContactProblem) -> LinearVector:
        """Residuals of all equations at the present state (collective)."""
        e = problem.equations
        bulk, contact, _ = e.residual.forces()
        u = bulk + contact
        u[e.bulk.prescribed_dofs] = -e.bulk.distance_to_prescribed()
        z = [c.rows.weighted(c.rows.frame()) for c in e.contacts]
        return LinearVector(u, z, e.motions.residual() * e.motions.scales)
