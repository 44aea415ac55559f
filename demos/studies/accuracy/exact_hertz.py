# SPDX-License-Identifier: MIT
"""Two half planes under the pressure of Hertz, and the shear of Cattaneo and Mindlin.

With z = x + i y, y <= 0 in the lower body, and

    f_b = i / (2 b) (z - sqrt(z^2 - b^2)),    2 Re f_b = -sqrt(1 - (x/b)^2) on the surface,

Kolosov's potentials of a half plane are, of the pressure p = p0 sqrt(1 - (x/a)^2),

    phi' = p0 f_a,    psi' = -z phi'',

and of the shear q = q0 (sqrt(1 - (x/a)^2) - (c/a) sqrt(1 - (x/c)^2)), q0 = friction p0,

    phi' = i q0 (f_a - (c/a) f_c),    psi' = -2 phi' - z phi''.

sigma_x + sigma_y = 4 Re phi', sigma_y - sigma_x + 2 i tau = 2 (conj(z) phi'' + psi') and 2 mu
(u + i v) = kappa phi - z conj(phi') - conj(psi), kappa = 3 - 4 nu. The upper body, of the same
material, is the mirror image, under shear with the sign of u, sigma_x and sigma_y changed. A rigid
motion is added such that |x| < c sticks. The theory is linear: its error is of order a / R.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

import ufl


class Load(NamedTuple):
    """One part of the traction: phi' = factor f_b, psi' = -z phi'', minus 2 phi' for shear."""

    factor: complex
    b: float
    sheared: bool

    def potential(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Phi and its first two derivatives.

        The root tends to z far away; it is continuous below the real axis, not on it.
        """
        b, factor = self.b, 0.5j * self.factor / self.b
        root = -1j * np.sqrt(b - z) * np.sqrt(b + z)
        phi = 0.5 * factor * (z**2 - z * root + b**2 * np.log((z + root) / b))
        return phi, factor * (z - root), factor * (1 - z / root)


@dataclass(frozen=True)
class HalfPlanes:
    """The exact solution.

    Attributes:
        a: Half-width of the contact [length].
        R: Radius of the parabola x^2 / 2 R between the bodies at rest [length].
        E: Young's modulus [stress].
        nu: Poisson's ratio.
        friction: Coulomb's coefficient; without it there is no shear.
        stuck: Half-width c of the part that sticks [length].
    """

    a: float = 0.5
    R: float = 0.5e4
    E: float = 1.0
    nu: float = 0.3
    friction: float = 0.0
    stuck: float = 0.0

    @property
    def mu(self) -> float:
        """Shear modulus [stress]."""
        return self.E / (2 * (1 + self.nu))

    @property
    def peak(self) -> float:
        """Largest pressure E* a / 2 R, with 1 / E* = 2 (1 - nu^2) / E [stress]."""
        return self.E / (1 - self.nu**2) * self.a / (4 * self.R)

    @property
    def force(self) -> float:
        """Resultant of the pressure per thickness [stress length]."""
        return 0.5 * np.pi * self.a * self.peak

    def pressure(self, x: np.ndarray) -> np.ndarray:
        """Pressure at x [stress]."""
        return self.peak * np.sqrt(np.maximum(1 - (x / self.a) ** 2, 0.0))

    def shear(self, x: np.ndarray) -> np.ndarray:
        """Shear at x, in the direction of x on the lower body [stress]."""
        outer, inner = (np.sqrt(np.maximum(b**2 - x**2, 0.0)) for b in (self.a, self.stuck))
        return self.friction * self.peak / self.a * (outer - inner)

    def displacement(self, x: np.ndarray) -> np.ndarray:
        """Displacement at ``x``, shape (2, ...), of the body on the respective side of y = 0."""
        side, z = self._place(x)
        total = np.zeros(x.shape)
        for load in self._loads:
            along, across = (side, 1.0) if load.sheared else (1.0, side)
            w = self._moved(z, load) - load.sheared * self._moved(np.array(-1e-30j), load)
            total += np.stack([along * w.real, across * w.imag])
        return total

    def _moved(self, z: np.ndarray, load: Load) -> np.ndarray:
        """Displacement u + i v of the lower body."""
        phi, derivative, _ = load.potential(z)
        psi = (1 - 2 * load.sheared) * phi - z * derivative
        kappa = 3 - 4 * self.nu
        return (kappa * phi - z * derivative.conj() - psi.conj()) / (2 * self.mu)

    def stress(self, x: np.ndarray) -> np.ndarray:
        """Stress at ``x``, shape (2, ...), as a tensor of shape (2, 2, ...)."""
        side, z = self._place(x)
        total = np.zeros((2, *x.shape))
        for load in self._loads:
            along, across = (side, 1.0) if load.sheared else (1.0, side)
            _, first, second = load.potential(z)
            mean, half = 2 * first.real, (z.conj() - z) * second - 2 * load.sheared * first
            shear = across * half.imag
            rows = [along * (mean - half.real), shear], [shear, along * (mean + half.real)]
            total += np.array(rows)
        return total

    def ufl_stress(self, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """Stress as a UFL tensor, away from y = 0 (McEwen's form)."""
        a, depth = self.a, abs(x[1])
        A = a**2 - x[0] ** 2 + depth**2
        S = ufl.sqrt(A**2 + 4 * x[0] ** 2 * depth**2)
        m, n = ufl.sqrt((S + A) / 2), ufl.sign(x[0]) * ufl.sqrt((S - A) / 2)
        q = (depth**2 + n**2) / (m**2 + n**2)
        xx, yy = -m * (1 + q) + 2 * depth, -m * (1 - q)
        shear = -ufl.sign(x[1]) * n * (m**2 - depth**2) / (m**2 + n**2)
        return self.peak / a * ufl.as_tensor([[xx, shear], [shear, yy]])

    @property
    def _loads(self) -> list[Load]:
        """Pressure, and the two parts of the shear."""
        q = 1j * self.friction * self.peak / self.a
        loads = [Load(self.peak, self.a, sheared=False)]
        if self.friction:
            loads.append(Load(q * self.a, self.a, sheared=True))
        if self.friction and self.stuck:
            loads.append(Load(-q * self.stuck, self.stuck, sheared=True))
        return loads

    def _place(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sign of the body, and z in the lower half plane."""
        z = x[0] - 1j * np.maximum(np.abs(x[1]), 1e-30)
        return np.where(x[1] > 0.0, -1.0, 1.0), z
