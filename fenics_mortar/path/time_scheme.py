# SPDX-License-Identifier: MIT
"""Generalized-alpha method with all forces at the end of the step (Chung & Hulbert 1993).

In the form of Arnold & Bruels (2007), w is the acceleration that balances all forces at the same
time,

    M w_(n+1) + f_int(u_(n+1)) - f_ext + B^T z_(n+1) = 0,

and a an average of it,

    (1 - am) a_(n+1) + am a_n = (1 - af) w_(n+1) + af w_n.

With Newmark's formulas for u and v from a, this is the generalized-alpha method whose internal,
external and contact forces are (1 - af) f_(n+1) + af f_n. Multipliers are those of the end of the
step, in balance with gaps, loads and prescribed values of the same time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fenics_mortar.bulk.inertia import Rates
from fenics_mortar.utils.arrays import Array, Flags


class Line(NamedTuple):
    """A quantity that is linear in the displacement at the end of a step, factor (u - origin)."""

    factor: float
    origin: Array

    def __call__(self, u: Array) -> Array:
        """Its value at the displacement ``u``."""
        return self.factor * (u - self.origin)

    def as_line(self, other: Line, dofs: Flags, u: Array) -> Line:
        """This line with the values of another line at dofs of known displacement.

        Args:
            other: The other line.
            dofs: Marks of these dofs, shape (dofs,), bool.
            u: Displacement at the end of the step at these dofs, shape (dofs,) [length].
        """
        origin = u - other(u) / self.factor
        return Line(self.factor, np.where(dofs, origin, self.origin))


@dataclass(frozen=True)
class GeneralizedAlpha:
    """The method for a spectral radius rho at infinite frequency, between 0 and 1.

    rho = 1 is the trapezoidal rule, which conserves the energy of linear bodies; with rho = 0
    unresolved frequencies are damped within one step.
    """

    rho: float

    @property
    def inertia_shift(self) -> float:
        """Weight am of the old inertia [1]."""
        return (2.0 * self.rho - 1.0) / (self.rho + 1.0)

    @property
    def force_shift(self) -> float:
        """Weight af of the old forces [1]."""
        return self.rho / (self.rho + 1.0)

    @property
    def gamma(self) -> float:
        """Newmark's gamma for second order [1]."""
        return 0.5 + self.force_shift - self.inertia_shift

    @property
    def beta(self) -> float:
        """Newmark's beta for the largest dissipation of high frequencies [1]."""
        return 0.25 * (0.5 + self.gamma) ** 2

    def lines(
        self, u: Array, rates: Rates, dt: float, prescribed: Flags, end: Array
    ) -> tuple[Line, Line, Line]:
        """Velocity, acceleration and its average at the end of the step.

        Rates of prescribed motions follow from these motions alone, by the method for rho = 0,
        which is of second order as well. With rho = 1 they would alternate permanently after a jump
        of the velocity or for inconsistent initial rates; with rho = 0 such errors vanish in three
        steps. If prescribed motions accelerate, energies balance up to terms of second order.

        Args:
            u: Displacement at the start of the step, shape (dofs,) [length].
            rates: Rates at the start of the step.
            dt: The step [time].
            prescribed: Marks of the prescribed dofs, shape (dofs,), bool.
            end: Displacement of the prescribed dofs at the end of the step [length].
        """
        damped = GeneralizedAlpha(0.0)
        of_all, of_prescribed = (
            [line(u, rates, dt) for line in (s.velocity, s.acceleration, s.average)]
            for s in (self, damped)
        )
        velocity, acceleration, average = (
            line.as_line(other, prescribed, end)
            for line, other in zip(of_all, of_prescribed, strict=True)
        )
        return velocity, acceleration, average

    def average(self, u: Array, rates: Rates, dt: float) -> Line:
        """A at the end of the step [length / time^2].

        Args:
            u: Displacement at the start of the step, shape (owned dofs,) [length].
            rates: Rates at the start of the step.
            dt: The step [time].
        """
        start = u + dt * rates.velocity + dt**2 * (0.5 - self.beta) * rates.average
        return Line(1.0 / (self.beta * dt**2), start)

    def velocity(self, u: Array, rates: Rates, dt: float) -> Line:
        """V at the end of the step [length / time]; arguments: see ``average``."""
        a = self.average(u, rates, dt)
        factor = self.gamma * dt * a.factor
        rest = rates.velocity + (1.0 - self.gamma) * dt * rates.average
        return Line(factor, a.origin - rest / factor)

    def acceleration(self, u: Array, rates: Rates, dt: float) -> Line:
        """W at the end of the step [length / time^2]; arguments: see ``average``."""
        am, af, a = self.inertia_shift, self.force_shift, self.average(u, rates, dt)
        factor = (1.0 - am) / (1.0 - af) * a.factor
        rest = (am * rates.average - af * rates.acceleration) / (1.0 - af)
        return Line(factor, a.origin - rest / factor)
