# SPDX-License-Identifier: MIT
"""Time schemes of the literature that the package does not contain, for comparison; in serial.

In all of them slave nodes keep their mass. They have contact forces of the end of the
step only. The trapezoidal rule of the package counts them half: their multipliers are twice the
pressures.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import nnls

import fenics_mortar as fm


class ImplicitContact(fm.Dynamics):
    """The trapezoidal rule, but contact forces only of the end of the step (Kane et al. 1999)."""

    def _advance(self, dt: float, forces: Any, **given: Any) -> Any:
        done = super()._advance(dt, forces, **given)
        inertia, bulk = self._inertia, self.problem.equations.bulk
        rates, contact = inertia.rates, self.problem.forces()[1]
        w = rates.acceleration + inertia.acceleration_of(contact, bulk.prescribed)
        inertia.rates = replace(rates, acceleration=w, average=w)
        return done

    def _gaps(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Weighted gaps (n,), their derivatives (n, N), and those over the mass, likewise."""
        matrices, bulk = self.problem.matrices, self.problem.equations.bulk
        derivative = matrices.gap_derivative()
        rows = derivative.getDenseArray() if derivative.type == "seqdense" else _dense(derivative)
        over_mass = [self._inertia.acceleration_of(row, bulk.prescribed) for row in rows]
        return matrices.gap().array.copy(), rows, np.array(over_mass)


def _dense(matrix: Any) -> np.ndarray:
    """A sparse matrix as an array."""
    return np.asarray(matrix.convert("dense").getDenseArray())


class StabilizedNewmark(ImplicitContact):
    """Free motion is projected onto the admissible one first (Deuflhard, Krause & Ertel 2008).

    The projection minimizes the norm of the mass, with gaps linear in the motion of the step.
    """

    def _advance(self, dt: float, forces: Any, **given: Any) -> Any:
        inertia = self._inertia
        rates, (gap, rows, over_mass) = inertia.rates, self._gaps()
        after = gap + dt * rows @ rates.velocity
        change = np.zeros_like(rates.velocity)
        if after.min() < 0.0:  # gaps after + compliance . impulses, both >= 0 and complementary
            factor = np.linalg.cholesky(rows @ over_mass.T)
            impulses = nnls(factor.T, -np.linalg.solve(factor, after))[0]
            change = impulses @ over_mass / dt
        inertia.rates = replace(rates, velocity=rates.velocity + change)
        try:
            done = super()._advance(dt, forces, **given)
        except BaseException:
            inertia.rates = rates
            raise
        inertia.rates = replace(inertia.rates, velocity=inertia.rates.velocity - change)
        return done


class NodalReturn(ImplicitContact):
    """Velocities return to each node the energy that its pressure took (Laursen & Love 2002).

    By an impulse along the derivative of its gap; if no impulse adds the energy, by the one that
    comes nearest, after which the gap has no rate.
    """

    _deficit: np.ndarray | None = None

    def _advance(self, dt: float, forces: Any, **given: Any) -> Any:
        inertia, gap = self._inertia, self._gaps()[0]
        deficit = np.zeros_like(gap) if self._deficit is None else self._deficit
        done = super()._advance(dt, forces, **given)
        contact = self.problem.equations.contacts[0]
        after, rows, over_mass = self._gaps()
        pressure = 0.5 * np.einsum("jc,jc->j", contact.z, contact.operators.n)
        self._deficit = deficit = deficit + pressure * (gap - after)
        velocity = inertia.rates.velocity
        for j in np.flatnonzero((pressure > 0.0) | (np.abs(deficit) > 0.0)):
            power, square = float(rows[j] @ velocity), float(rows[j] @ over_mass[j])
            inside = power**2 + 2.0 * square * deficit[j]
            root = math.sqrt(inside) if inside > 0.0 else 0.0
            t = (math.copysign(root, power) - power) / square
            velocity = velocity + t * over_mass[j]
            deficit[j] -= t * power + 0.5 * t**2 * square
        inertia.rates = replace(inertia.rates, velocity=velocity)
        return done
