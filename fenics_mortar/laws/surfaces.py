# SPDX-License-Identifier: MIT
"""Laws of surfaces that are worn away, or rough and soft: a closing gap and Coulomb's friction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fenics_mortar.contact.law import check_positive, varies
from fenics_mortar.contact.laws import Coulomb
from fenics_mortar.contact.nodal import Array, Branches, Nodal, Row, magnitude, row_of
from fenics_mortar.utils.arguments import check_number


class Worn(Coulomb):
    """Archard's wear with Coulomb's friction: the depth h grows by h' = wear z_n |u'|.

    ``ResultsWriter`` writes the depth h [length] as ``memory_depth``; pair i has it as
    ``problem.equations.contacts[i].accepted_instant.memory["depth"]``.

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
        if not varies(self.m):
            check_number("m", self.m, "an exponent of at least 1", lambda m: 1.0 <= m < np.inf)

    def closing_gap(self, node: Nodal) -> Row:
        """Excess of the pressure over that of the overlap, as a length; z_n = 0 at open nodes."""

        def gap(at: Nodal) -> Any:
            overlaps = np.real(at.gap) < 0.0
            pressure = self.k * np.where(overlaps, -at.gap, 1.0) ** self.m
            opening = np.where(overlaps, 0.0, at.gap)
            return opening + (at.z_n - np.where(overlaps, pressure, 0.0)) / at.stiffness

        return row_of(gap, node)
