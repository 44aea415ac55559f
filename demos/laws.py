# SPDX-License-Identifier: MIT
"""Contact laws with memory, rate or a layer, written as user code.

Copy the laws that you need; ``demos/guide/laws.md`` explains the parts of a law. Derivatives are
computed by complex step (``row_of``), so that a law is a single formula.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import fenics_mortar as fm
from fenics_mortar.contact.laws import Friction, Nodal, Row, magnitude, row_of
from fenics_mortar.contact.nodal import Array, Branches


class Worn(fm.Coulomb):
    """Archard's wear with Coulomb's friction: the depth h grows by h' = wear z_n |u'|.

    Args:
        mu: Coefficient of friction [1].
        wear: Wear coefficient over hardness [1 / stress].
    """

    memory = ("depth",)

    def __init__(self, mu: float, wear: float) -> None:
        super().__init__(mu)
        self.wear = wear

    def depth(self, node: Nodal) -> Any:
        """Depth at the end of the step, with the pressure at this time [length]."""
        pressure = np.where(np.real(node.z_n) > 0.0, node.z_n, 0.0)
        return node.memory["depth"] + self.wear * pressure * magnitude(node.slip)

    def closing_gap(self, node: Nodal) -> Row:
        """Gap to the worn surface."""
        return row_of(lambda at: at.gap + self.depth(at), node)

    def remember(self, node: Nodal, branch: Branches) -> Mapping[str, Array]:
        """The depth."""
        return {"depth": self.depth(node)}


class NormalCompliance(fm.Coulomb):
    """A soft layer with the pressure k (-g)^m of its overlap -g, and Coulomb's friction.

    Args:
        k: Stiffness [stress / length^m].
        m: Exponent, at least 1.
        mu: Coefficient of friction [1].
    """

    def __init__(self, k: float, m: float, mu: float = 0.0) -> None:
        super().__init__(mu)
        self.k, self.m = k, m

    def closing_gap(self, node: Nodal) -> Row:
        """Excess of the pressure over that of the overlap, as a length; z_n = 0 at open nodes."""

        def gap(at: Nodal) -> Any:
            overlap = np.where(np.real(at.gap) < 0.0, -at.gap, 0.0)
            opening = np.where(np.real(at.gap) < 0.0, 0.0, at.gap)
            return opening + (at.z_n - self.k * overlap**self.m) / at.stiffness

        return row_of(gap, node)


class Cohesive(fm.Frictionless):
    """Cohesive zone with linear softening; it unloads to the origin, and damage is irreversible.

    After unloading from a small opening the line to the origin is steep, and Newton's method may
    alternate between both lines: take steps with larger openings.

    Args:
        strength: Largest adhesion [stress].
        reach: Gap at which the adhesion vanishes [length]; the energy is strength * reach / 2.
    """

    memory = ("opening",)  # largest gap so far

    def __init__(self, strength: float, reach: float) -> None:
        self.strength, self.reach = strength, reach

    def adhesion_at(self, node: Nodal) -> Row:
        """On the softening line, or below it on the line to the origin."""
        largest = node.memory["opening"]
        left = self.strength * np.maximum(1.0 - largest / self.reach, 0.0)
        secant = left / np.where(largest > 0.0, largest, 1.0)

        def pull(at: Nodal) -> Any:
            softening = self.strength * (1.0 - at.gap / self.reach)
            softening = np.where(np.real(at.gap) < self.reach, softening, 0.0)
            return np.where(np.real(at.gap) >= largest, softening, secant * at.gap)

        return row_of(pull, node)

    def remember(self, node: Nodal, branch: Branches) -> Mapping[str, Array]:
        """The largest gap; values below a billionth of the reach are rounding and ignored."""
        gap = np.where(node.gap > 1e-9 * self.reach, node.gap, 0.0)
        return {"opening": np.maximum(node.memory["opening"], gap)}


class MixedCohesive(fm.Law):
    """Cohesive zone in which opening and slip damage the same bond; without friction.

    The traction is k(m) (gap, slip), with the secant stiffness of a bilinear law at the largest
    jump m = max |(gap, slip)| so far: k up to strength / k, then softening to zero at ``reach``.
    The energy of a bond broken in any mode is strength * reach / 2.

    Args:
        stiffness: Stiffness k of the undamaged bond [stress / length].
        strength: Largest traction [stress].
        reach: Jump at which the traction vanishes, above strength / stiffness [length].
    """

    memory = ("jump", "slid")  # largest jump, at least strength / stiffness; slip so far
    bridges_gap = True

    def __init__(self, stiffness: float, strength: float, reach: float) -> None:
        self.stiffness, self.strength, self.reach = stiffness, strength, reach

    def jump(self, node: Nodal) -> tuple[Any, Any, Any]:
        """Opening, slip and the largest jump [length]."""
        gap = np.where(np.real(node.gap) > 0.0, node.gap, 0.0)
        slid, before = node.memory["slid"] + node.slip, node.memory["jump"]
        square = gap**2 + slid**2
        grows = np.real(square) > np.real(before) ** 2
        return gap, slid, np.where(grows, np.sqrt(np.where(grows, square, 1.0)), before)

    def secant(self, largest: Any) -> Any:
        """Stiffness at the largest jump [stress / length]."""
        start = self.strength / self.stiffness
        left = np.where(np.real(largest) < self.reach, self.reach - largest, 0.0)
        return self.strength * left / ((self.reach - start) * largest)

    def initial(self, X: Array) -> Mapping[str, Array]:
        """The jump at which damage begins, and no slip."""
        start = self.strength / self.stiffness
        return {"jump": np.full(len(X), start), "slid": np.zeros(len(X))}

    def adhesion_at(self, node: Nodal) -> Row:
        """The normal traction."""

        def pull(at: Nodal) -> Any:
            gap, _, largest = self.jump(at)
            return self.secant(largest) * gap

        return row_of(pull, node)

    def shear(self, node: Nodal) -> Any:
        """The tangential traction [stress]."""
        _, slid, largest = self.jump(node)
        return self.secant(largest) * slid

    def branch(self, node: Nodal, before: Branches) -> Branches:
        """There is one branch."""
        return np.ones_like(before)

    def tangential(self, node: Nodal, branch: Branches) -> Row:
        """The shear, also of open nodes, minus that of the bond."""
        return row_of(lambda at: at.z_tau - self.shear(at), node)

    def friction_limit_at(self, node: Nodal) -> Array:
        """The shear of the bond."""
        return np.abs(self.shear(node))

    def remember(self, node: Nodal, branch: Branches) -> Mapping[str, Array]:
        """The largest jump, and the slip so far."""
        _, slid, largest = self.jump(node)
        return {"jump": largest, "slid": slid}


class Stribeck(Friction):
    """Stick, and slip with a coefficient that decreases with the rate v = |u| / step.

    mu(v) = kinetic + (static - kinetic) exp(-v / rate) + viscous v

    Args:
        static, kinetic: Coefficients of friction at rest and at large rates [1].
        rate: Rate at which the difference has decreased to 1 / e [length / time].
        viscous: Increase of the coefficient with the rate [time / length].
    """

    needs_time = True

    def __init__(self, static: float, kinetic: float, rate: float, viscous: float = 0.0) -> None:
        super().__init__(c_t=0.1)
        self.static, self.kinetic, self.rate, self.viscous = static, kinetic, rate, viscous

    def coefficient(self, rate: Any) -> Any:
        """Coefficient of friction at a rate >= 0 [1]."""
        fall = (self.static - self.kinetic) * np.exp(-rate / self.rate)
        return self.kinetic + fall + self.viscous * rate

    def limit(self, node: Nodal) -> Row:
        """The coefficient times the pressure of the active-set test."""

        def limit(at: Nodal) -> Any:
            trial = at.z_n - at.c_n * at.gap
            pressure = np.where(np.real(trial) > 0.0, trial, 0.0)
            return self.coefficient(magnitude(at.slip) / at.step) * pressure

        return row_of(limit, node)


class RateAndState(fm.Law):
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
    """

    memory, needs_time = ("theta",), True

    def __init__(
        self, mu: float, a: float, b: float, L: float, v_0: float, theta: float | None = None
    ) -> None:
        self.mu, self.a, self.b, self.L, self.v_0 = mu, a, b, L, v_0
        self.start = L / v_0 if theta is None else theta

    def initial(self, X: Array) -> Mapping[str, Array]:
        """The same state everywhere."""
        return {"theta": np.full(len(X), self.start)}

    def theta(self, node: Nodal) -> Any:
        """State at the end of the step [time]."""
        x = magnitude(node.slip) / self.L
        nonzero = np.where(x == 0.0, 1.0, x)
        aged = np.where(x == 0.0, 1.0, -np.expm1(-x) / nonzero)
        return node.memory["theta"] * np.exp(-x) + node.step * aged

    def friction(self, node: Nodal, slip: Any) -> Any:
        """Shear at a slip in the present state [stress]."""
        return self.a * node.z_n * np.arcsinh(slip / self.unit(node))

    def unit(self, node: Nodal) -> Any:
        """Slip at which the shear is 0.88 a z_n [length]."""
        power = (self.mu + self.b * np.log(self.v_0 * self.theta(node) / self.L)) / self.a
        return 2.0 * self.v_0 * node.step * np.exp(-power)

    def branch(self, node: Nodal, before: Branches) -> Branches:
        """Creep (0), or sliding along the shear (+-1), without pressure (1)."""
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
        """The friction at the present rate, at least that at ``v_0``."""
        slip = np.maximum(np.abs(node.slip), self.v_0 * node.step)
        return np.maximum(self.friction(node, slip), 0.0)

    def remember(self, node: Nodal, branch: Branches) -> Mapping[str, Array]:
        """The state."""
        return {"theta": self.theta(node)}
