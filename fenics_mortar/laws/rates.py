# SPDX-License-Identifier: MIT
"""Friction that depends on the rate of sliding, and on a state that evolves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_mortar.contact.law import Friction, Law, check_positive, magnitude, row_of

if TYPE_CHECKING:
    from fenics_mortar.contact.law import Array, Branches, Nodal, Row


class Stribeck(Friction):
    """Stick, and slip with a coefficient that decreases with the rate v = |u| / step.

    mu(v) = kinetic + (static - kinetic) exp(-v / rate) + viscous v

    Args:
        static, kinetic: Coefficients of friction at rest and at large rates [1].
        rate: Rate at which the difference has decreased to 1 / e [length / time].
        viscous: Increase of the coefficient with the rate [time / length].

    Raises:
        ValueError: If a number is not allowed.

    Source: B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, Automatica 30 (1994) 1083-1138.
    """

    needs_time = True
    parameters = ("static", "kinetic", "rate", "viscous")

    def __init__(self, static: float, kinetic: float, rate: float, viscous: float = 0.0) -> None:
        super().__init__(c_t=0.1)
        self.static, self.kinetic, self.rate, self.viscous = static, kinetic, rate, viscous
        Stribeck.check(self)

    def check(self) -> None:
        """Check the coefficients and the rate."""
        super().check()
        check_positive(self, "static", "kinetic", "viscous", zero=True)
        check_positive(self, "rate")

    def coefficient(self, rate: Any) -> Any:
        """Coefficient of friction at a rate >= 0 [1]."""
        fall = (self.static - self.kinetic) * np.exp(-rate / self.rate)
        return self.kinetic + fall + self.viscous * rate

    def limit(self, node: Nodal) -> Row:
        """The coefficient times the pressure of the active-set test; see ``Friction.limit``."""

        def limit(at: Nodal) -> Any:
            trial = at.z_n - at.c_n * at.gap
            pressure = np.where(np.real(trial) > 0.0, trial, 0.0)
            return self.coefficient(magnitude(at.slip) / at.step) * pressure

        return row_of(limit, node)


class RateAndState(Law):
    """Rate-and-state friction with the aging law, regularised at rest; it always creeps.

    z_tau = a z_n arsinh(v / (2 v_0) exp((mu + b ln(v_0 theta / L)) / a)),
    theta' = 1 - |v| theta / L,

    with the rate v = u / step, constant in a step, and theta at its end (Dieterich 1979; Ruina
    1983; arsinh: Rice & Ben-Zion 1996). Steady: |z_tau| = (mu + (a - b) ln(|v| / v_0)) z_n.

    The equation is solved for the shear if the node slides, and for the slip if it creeps below the
    friction at v_0: Newton's method would not converge between the two flat ends of arsinh.

    Args:
        mu: Steady coefficient of friction at ``v_0`` [1].
        a, b: Direct and evolution effect [1].
        L: Slip in which the state evolves [length].
        v_0: Reference rate [length / time].
        theta: State at the start [time]; default: steady at ``v_0``.

    Raises:
        ValueError: If a number is not allowed.
    """

    memory, needs_time = ("theta",), True
    parameters = ("mu", "a", "b", "L", "v_0")

    def __init__(
        self, mu: float, a: float, b: float, L: float, v_0: float, theta: float | None = None
    ) -> None:
        self.mu, self.a, self.b, self.L, self.v_0 = mu, a, b, L, v_0
        RateAndState.check(self)
        self.theta_0 = L / v_0 if theta is None else theta
        check_positive(self, "theta_0")

    def check(self) -> None:
        """Check the coefficients, the length and the rate."""
        check_positive(self, "mu", "b", zero=True)
        check_positive(self, "a", "L", "v_0")

    def initial(self, X: Array) -> Mapping[str, Array]:
        """The same state everywhere [time]."""
        return {"theta": np.full(len(X), self.theta_0)}

    def theta(self, node: Nodal) -> Any:
        """State at the end of the step [time]."""
        x = magnitude(node.slip) / self.L
        return node.memory["theta"] * np.exp(-x) + node.step * mean_decay(x)

    def friction(self, node: Nodal, slip: Any) -> Any:
        """Shear at a slip in the present state [stress]."""
        return self.a * node.z_n * np.arcsinh(slip / self.unit(node))

    def unit(self, node: Nodal) -> Any:
        """Slip at which the shear is 0.88 a z_n [length]."""
        power = (self.mu + self.b * np.log(self.v_0 * self.theta(node) / self.L)) / self.a
        return 2.0 * self.v_0 * node.step * np.exp(-power)

    def branch(self, node: Nodal, before: Branches) -> Branches:
        """Creep (0), or sliding along the shear (+-1), without pressure (1); see ``Law.branch``."""
        largest = self.friction(node, self.v_0 * node.step)
        w = node.z_tau + 0.1 * node.stiffness * node.slip
        creeps = (np.abs(w) <= largest) & (np.abs(node.z_tau) <= largest)
        slides = np.where(w < 0.0, -1, 1)
        return np.where(node.z_n > 0.0, np.where(creeps, 0, slides), 1).astype(np.int64)

    def tangential(self, node: Nodal, branch: Branches) -> Row:
        """Shear minus friction; for creep the slip minus that of the shear."""
        largest = self.friction(node, self.v_0 * node.step)
        creeps = (branch == 0) & (np.abs(node.z_tau) <= 2.0 * largest) & (node.z_n > 0.0)

        def residual(at: Nodal) -> Any:
            power = np.where(creeps, at.z_tau, 0.0) / np.where(creeps, self.a * at.z_n, 1.0)
            slip = self.unit(at) * np.sinh(power)
            return np.where(
                creeps, at.stiffness * (slip - at.slip), at.z_tau - self.friction(at, at.slip)
            )

        return row_of(residual, node)

    def friction_limit_at(self, node: Nodal) -> Array:
        """The friction at the present rate, at least that at ``v_0`` [stress]."""
        slip = np.maximum(np.abs(node.slip), self.v_0 * node.step)
        return np.maximum(self.friction(node, slip), 0.0)

    def remember(self, node: Nodal, branch: Branches) -> Mapping[str, Array]:
        """The state; see ``Law.remember``."""
        return {"theta": self.theta(node)}


# Below this argument, (1 - exp(-x)) / x is summed as a series of nine terms, whose error is 3e-16:
# its slope by complex step would lose all digits of the quotient, down to none at zero [1].
SMALL = 0.1


def mean_decay(x: Any) -> Any:
    """Mean (1 - exp(-x)) / x of exp(-t) over 0 < t < x, analytic for x >= 0, 1 at zero (local)."""
    small = np.real(x) < SMALL
    series = np.polynomial.polynomial.polyval(
        np.where(small, -x, 0.0), [1.0 / math.factorial(k + 1) for k in range(9)]
    )
    large = np.where(small, 1.0, x)
    return np.where(small, series, -np.expm1(-large) / large)
