# SPDX-License-Identifier: MIT
"""Users' contact laws for the random problems."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import fenics_mortar as fm
from demos.studies.stability.random_bodies import Array
from fenics_mortar.contact.law import Branches, Friction, Nodal, Row


class Creeping(fm.Law):
    """Smooth friction, z_tau = mu z_n tanh(u / length), u: the slip of a step."""

    def __init__(self, mu: float, length: float) -> None:
        self.mu, self.length = mu, length

    def branch(self, node: Nodal, before: Branches) -> Branches:
        """One branch for all nodes."""
        return np.ones_like(before)

    def coefficient(self, slip: Array) -> tuple[Array, Array]:
        """Shear over pressure, and its derivative [1 / length]."""
        part = np.tanh(slip / self.length)
        return self.mu * part, self.mu * (1.0 - part**2) / self.length

    def tangential(self, node: Nodal, branch: Branches) -> Row:
        """Shear minus that of the law."""
        value, change = self.coefficient(node.slip)
        return Row(
            node.z_tau - node.z_n * value,
            by_slip=-node.z_n * change,
            by_z_n=-value,
            by_z_tau=1.0,
        )

    def friction_limit(self, pressure: Array) -> Array:
        """Mu times the pressure."""
        return self.mu * np.maximum(pressure, 0.0)


class Stribeck(Creeping):
    """Smooth friction with a coefficient that decreases from mu to ``kinetic`` with slip."""

    def __init__(self, mu: float, kinetic: float, length: float) -> None:
        super().__init__(mu, length)
        self.kinetic = kinetic

    def coefficient(self, slip: Array) -> tuple[Array, Array]:
        """(kinetic + (mu - kinetic) exp(-(u / 10 length)^2)) tanh(u / length)."""
        far = slip / (10.0 * self.length)
        fall = (self.mu - self.kinetic) * np.exp(-(far**2))
        part = np.tanh(slip / self.length)
        by_slip = -2.0 * far / (10.0 * self.length) * fall * part
        by_slip += (self.kinetic + fall) * (1.0 - part**2) / self.length
        return (self.kinetic + fall) * part, by_slip


class Saturating(Friction):
    """Stick and slip with a limit that saturates, mu p / (1 + p / most)."""

    def __init__(self, mu: float, most: float) -> None:
        super().__init__(0.1)
        self.mu, self.most = mu, most

    def limit(self, node: Nodal) -> tuple[Array, Array, Array]:
        """Limit and its derivatives, a function of the pressure."""
        p = np.maximum(node.z_n, 0.0)
        by_z_n = np.where(node.z_n > 0.0, self.mu / (1.0 + p / self.most) ** 2, 0.0)
        return self.friction_limit(p), np.zeros_like(p), by_z_n

    def friction_limit(self, pressure: Array) -> Array:
        """The limit."""
        p = np.maximum(pressure, 0.0)
        return self.mu * p / (1.0 + p / self.most)


class Sticky(fm.Coulomb):
    """Coulomb's friction, and adhesion that decreases with the gap."""

    def __init__(self, mu: float, pull: float, fade: float) -> None:
        super().__init__(mu)
        self.pull, self.fade = pull, fade

    def adhesion(self, gap: Array) -> tuple[Array, Array]:
        """Pull exp(-g / fade)."""
        pull = self.pull * np.exp(-gap / self.fade)
        return pull, -pull / self.fade


@dataclass(frozen=True)
class Rule:
    """A law as numbers.

    Attributes:
        kind: "Coulomb" (frictionless if mu is zero), "tanh", "Stribeck", "saturating" or "sticky".
        mu: Coefficient of friction.
        kinetic: Coefficient at large slip for "Stribeck".
        length: Reference slip of "tanh" and "Stribeck", reference gap of "sticky" [length].
        stress: Largest shear over mu of "saturating", pull of "sticky" [stress].
    """

    kind: str
    mu: float
    kinetic: float = 0.0
    length: float = 1.0
    stress: float = 1.0

    def scaled(self, length: float, stress: float) -> Rule:
        """The law in other units."""
        return replace(self, length=length * self.length, stress=stress * self.stress)

    def law(self) -> fm.Law:
        """The law."""
        if self.kind == "tanh":
            return Creeping(self.mu, self.length)
        if self.kind == "Stribeck":
            return Stribeck(self.mu, self.kinetic, self.length)
        if self.kind == "saturating":
            return Saturating(self.mu, self.stress)
        if self.kind == "sticky":
            return Sticky(self.mu, self.stress, self.length)
        return fm.Coulomb(self.mu) if self.mu else fm.Frictionless()
