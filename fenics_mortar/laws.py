# SPDX-License-Identifier: MIT
"""All contact laws of the package, and the names with which users write their own.

Input: parameters. Output: laws, an argument of ``fm.ContactPair``. ``Frictionless``, ``Coulomb``
and ``Tresca`` are laws without memory. The others are written as users write theirs, with the base
classes ``Law`` and ``Friction``, the state ``Nodal`` of the nodes, the result ``Row``, and the
helpers ``row_of`` and ``magnitude``: ``demos/guide/laws.md`` explains how.

>>> SoftLayer(k=50.0, m=2.0, mu=0.3)
SoftLayer(c_t=0.1, mu=0.3, max_shear=inf, limit_by='trial', k=50.0, m=2.0)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from fenics_mortar.contact.law import (
    Array,
    Branches,
    Coulomb,
    Friction,
    Frictionless,
    Law,
    Nodal,
    Row,
    Tresca,
    check_entries,
    check_positive,
    magnitude,
    row_of,
)
from fenics_mortar.utils.errors import check_number

__all__ = [
    "Cohesive", "Coulomb", "Friction", "Frictionless", "Law", "MixedCohesive", "Nodal",
    "RateAndState", "Row", "SoftLayer", "Stribeck", "Tresca", "Worn", "magnitude", "row_of",
]  # fmt: skip


class Worn(Coulomb):
    """Archard's wear with Coulomb's friction: the depth h grows by h' = wear z_n |u'|.

    At nodes without slip, as those that stick, |u'| has a kink: ``check_tangent`` shows slopes
    between 1 and 2 there.

    ``ResultsWriter`` writes the depth h [length] as ``memory_depth``; pair i has it as
    ``problem.contacts[i].memory["depth"]``.

    Args:
        mu: Coefficient of friction [1], a number, or as in ``Coulomb`` one that varies in space.
        wear: Wear coefficient over hardness [1 / stress].

    Raises:
        ValueError: If a number is not allowed.

    Source: J. F. Archard, J. Appl. Phys. 24 (1953) 981-988.
    """

    memory = ("depth",)
    parameters = (*Coulomb.parameters, "wear")

    def __init__(self, mu: float, wear: float) -> None:
        super().__init__(mu)
        self.wear = wear
        Worn.check(self)

    def check(self) -> None:
        """Check the coefficients."""
        super().check()
        check_positive(self, "wear", zero=True)

    def depth(self, node: Nodal) -> Any:
        """Depth at the end of the step, with the pressure at this time [length]."""
        pressure = np.where(np.real(node.z_n) > 0.0, node.z_n, 0.0)
        return node.memory["depth"] + self.wear * pressure * magnitude(node.slip)

    def closing_gap(self, node: Nodal) -> Row:
        """Gap to the worn surface; see ``Law.closing_gap``."""
        return row_of(lambda at: at.gap + self.depth(at), node)

    def remember(self, node: Nodal, branch: Branches) -> Mapping[str, Array]:
        """The depth; see ``Law.remember``."""
        return {"depth": self.depth(node)}


class SoftLayer(Coulomb):
    """A soft layer with the pressure k (-g)^m of its overlap -g, and Coulomb's friction.

    This is the normal compliance of a rough surface.

    Args:
        k: Stiffness [stress / length^m].
        m: Exponent, at least 1 [1].
        mu: Coefficient of friction [1].

    Raises:
        ValueError: If a number is not allowed.

    Source: J. T. Oden, J. A. C. Martins, CMAME 52 (1985) 527-634.
    """

    parameters = (*Coulomb.parameters, "k", "m")

    def __init__(self, k: float, m: float, mu: float = 0.0) -> None:
        super().__init__(mu)
        self.k, self.m = k, m
        SoftLayer.check(self)

    def check(self) -> None:
        """Check stiffness, exponent and coefficient."""
        super().check()
        check_positive(self, "k")
        check_entries("m", self.m, "an exponent of at least 1", lambda m: 1.0 <= m < np.inf)

    def closing_gap(self, node: Nodal) -> Row:
        """Excess of the pressure over that of the overlap, as a length; z_n = 0 at open nodes."""

        def gap(at: Nodal) -> Any:
            overlaps = np.real(at.gap) < 0.0
            pressure = self.k * np.where(overlaps, -at.gap, 1.0) ** self.m
            opening = np.where(overlaps, 0.0, at.gap)
            return opening + (at.z_n - np.where(overlaps, pressure, 0.0)) / at.stiffness

        return row_of(gap, node)


class Cohesive(Frictionless):
    """Cohesive zone with linear softening; it unloads to the origin, and damage is irreversible.

    Args:
        strength: Largest adhesion [stress].
        reach: Gap at which the adhesion vanishes [length]; the energy is strength * reach / 2.

    Raises:
        ValueError: If a number is not allowed.

    Source: A. Hillerborg, M. Modeer, P.-E. Petersson, Cem. Concr. Res. 6 (1976) 773-781.
    """

    memory = ("opening",)  # largest gap so far
    parameters = ("strength", "reach")

    def __init__(self, strength: float, reach: float) -> None:
        self.strength, self.reach = strength, reach
        Cohesive.check(self)

    def check(self) -> None:
        """Check strength and reach."""
        check_positive(self, "strength", "reach")

    def adhesion_at(self, node: Nodal) -> Row:
        """On the softening line, or below it on the line to the origin; see ``Law.adhesion_at``."""
        largest = node.memory["opening"]
        left = self.strength * np.maximum(1.0 - largest / self.reach, 0.0)
        secant = left / np.where(largest > 0.0, largest, 1.0)

        def pull(at: Nodal) -> Any:
            softening = self.strength * (1.0 - at.gap / self.reach)
            softening = np.where(np.real(at.gap) < self.reach, softening, 0.0)
            return np.where(np.real(at.gap) >= largest, softening, secant * at.gap)

        return row_of(pull, node)

    def remember(self, node: Nodal, branch: Branches) -> Mapping[str, Array]:
        """The largest gap [length]; below a billionth of the reach it is rounding, and ignored."""
        gap = np.where(node.gap > 1e-9 * self.reach, node.gap, 0.0)
        return {"opening": np.maximum(node.memory["opening"], gap)}


class MixedCohesive(Law):
    """Cohesive zone in which opening and slip damage the same bond; without friction.

    The traction is k(m) (gap, slip), with the secant stiffness of a bilinear law at the largest
    jump m = max |(gap, slip)| so far: k up to strength / k, then softening to zero at ``reach``.
    The energy of a bond broken in any mode is strength * reach / 2. In space the slip is the vector
    of the slip of all steps, which turns with the slave.

    Args:
        stiffness: Stiffness k of the undamaged bond [stress / length].
        strength: Largest traction [stress].
        reach: Jump at which the traction vanishes, above strength / stiffness [length].

    Raises:
        ValueError: If a number is not allowed.

    Source: V. Tvergaard, Mater. Sci. Eng. A 125 (1990) 203-213: one damage of opening and slip.
    """

    memory = ("jump", "slid")  # largest jump, at least strength / stiffness; slip so far
    summed_slip = "slid"
    parameters = ("stiffness", "strength", "reach")
    bridges_gap = True

    def __init__(self, stiffness: float, strength: float, reach: float) -> None:
        self.stiffness, self.strength, self.reach = stiffness, strength, reach
        MixedCohesive.check(self)

    def check(self) -> None:
        """Check stiffness, strength and reach."""
        check_positive(self, "stiffness", "strength")
        start = self.strength / self.stiffness
        expected = f"a length above strength / stiffness = {start:g}"
        check_number("reach", self.reach, expected, lambda reach: start < reach < np.inf)

    def jump(self, node: Nodal) -> tuple[Any, Any, Any]:
        """Opening, slip and the largest jump [length]."""
        gap = np.where(np.real(node.gap) >= 0.0, node.gap, 0.0)
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
        """The jump at which damage begins, and no slip [length]."""
        start = self.strength / self.stiffness
        return {"jump": np.full(len(X), start), "slid": np.zeros(len(X))}

    def adhesion_at(self, node: Nodal) -> Row:
        """The normal traction; see ``Law.adhesion_at``."""

        def pull(at: Nodal) -> Any:
            gap, _, largest = self.jump(at)
            return self.secant(largest) * gap

        return row_of(pull, node)

    def shear(self, node: Nodal) -> Any:
        """The tangential traction [stress]."""
        _, slid, largest = self.jump(node)
        return self.secant(largest) * slid

    def branch(self, node: Nodal, before: Branches) -> Branches:
        """There is one branch; see ``Law.branch``."""
        return np.ones_like(before)

    def tangential(self, node: Nodal, branch: Branches) -> Row:
        """The shear, also of open nodes, minus that of the bond; see ``Law.tangential``."""
        return row_of(lambda at: at.z_tau - self.shear(at), node)

    def friction_limit_at(self, node: Nodal) -> Array:
        """The shear of the bond; see ``Law.friction_limit_at``."""
        return np.abs(self.shear(node))

    def remember(self, node: Nodal, branch: Branches) -> Mapping[str, Array]:
        """The largest jump, and the slip so far; see ``Law.remember``."""
        _, slid, largest = self.jump(node)
        return {"jump": largest, "slid": slid}


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
