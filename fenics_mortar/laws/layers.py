# SPDX-License-Identifier: MIT
"""Laws of layers between the surfaces: wear, soft layers, cohesive zones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fenics_mortar.contact.law import (
    Array,
    Branches,
    Coulomb,
    Frictionless,
    Law,
    Nodal,
    Row,
    check_entries,
    check_positive,
    magnitude,
    row_of,
)
from fenics_mortar.utils.errors import check_number


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
