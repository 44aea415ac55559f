# SPDX-License-Identifier: MIT
"""Two half planes under the pressure of Hertz: displacement and stress everywhere in closed form.

With z = x + i y, y <= 0 in the lower body, Kolosov's potentials of a half plane under a normal
pressure p0 sqrt(1 - (x/a)^2) are

    phi' = i p0 / (2 a) (z - sqrt(z^2 - a^2)),    psi' = -z phi'',

sigma_x + sigma_y = 4 Re phi', sigma_y - sigma_x + 2 i tau = 2 (conj(z) - z) phi'', and
2 mu (u + i v) = kappa phi - z conj(phi') - conj(psi), kappa = 3 - 4 nu. The upper body, of the same
material, is the mirror image. The theory is linear: its error is of order a / R.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import ufl


@dataclass(frozen=True)
class HalfPlanes:
    """The exact solution.

    Attributes:
        a: Half-width of the contact [length].
        R: Radius of the parabola x^2 / 2 R between the bodies at rest [length].
        E: Young's modulus [stress].
        nu: Poisson's ratio.
    """

    a: float = 0.5
    R: float = 0.5e4
    E: float = 1.0
    nu: float = 0.3

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

    def displacement(self, x: np.ndarray) -> np.ndarray:
        """Displacement at ``x``, shape (2, ...), of the body on whose side of y = 0 they are."""
        side, z, root = self._place(x)
        factor = 0.5j * self.peak / self.a
        derivative = factor * (z - root)
        phi = 0.5 * factor * (z**2 - z * root + self.a**2 * np.log((z + root) / self.a))
        psi = phi - z * derivative
        kappa = 3 - 4 * self.nu
        w = (kappa * phi - z * derivative.conj() - psi.conj()) / (2 * self.mu)
        return np.stack([w.real, side * w.imag])

    def stress(self, x: np.ndarray) -> np.ndarray:
        """Stress at ``x``, shape (2, ...), as a tensor of shape (2, 2, ...)."""
        side, z, root = self._place(x)
        factor = 0.5j * self.peak / self.a
        mean = 2 * (factor * (z - root)).real
        half = (z.conj() - z) * factor * (1 - z / root)
        shear = side * half.imag
        return np.array([[mean - half.real, shear], [shear, mean + half.real]])

    def ufl_stress(self, x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """The same as a UFL tensor, away from y = 0 (McEwen's form)."""
        a, depth = self.a, abs(x[1])
        A = a**2 - x[0] ** 2 + depth**2
        S = ufl.sqrt(A**2 + 4 * x[0] ** 2 * depth**2)
        m, n = ufl.sqrt((S + A) / 2), ufl.sign(x[0]) * ufl.sqrt((S - A) / 2)
        q = (depth**2 + n**2) / (m**2 + n**2)
        xx, yy = -m * (1 + q) + 2 * depth, -m * (1 - q)
        shear = -ufl.sign(x[1]) * n * (m**2 - depth**2) / (m**2 + n**2)
        return self.peak / a * ufl.as_tensor([[xx, shear], [shear, yy]])

    def _place(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sign of the body, z in the lower half plane, and sqrt(z^2 - a^2), like z far away.

        The root is continuous below the real axis, not on it.
        """
        z = x[0] - 1j * np.maximum(np.abs(x[1]), 1e-30)
        root = -1j * np.sqrt(self.a - z) * np.sqrt(self.a + z)
        return np.where(x[1] > 0.0, -1.0, 1.0), z, root
