# SPDX-License-Identifier: MIT
"""A smooth manufactured solution across a curved interface that sticks, at finite strain.

Two quarter rings meet on a circle. Both move by one smooth deformation, so that nothing slips or
opens; body forces keep the balance. The traction at the interface is a pressure everywhere, and a
shear below a large friction limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class CurvedInterface:
    """The exact solution of the compressible neo-Hookean law.

    Attributes:
        radii: Inner radius, that of the interface, outer radius [length].
        E: Young's modulus [stress].
        nu: Poisson's ratio.
        squeeze: Uniform compression.
        wave: Amplitude of the nonuniform part [length].
    """

    radii: tuple[float, float, float] = (1.0, 2.0, 3.0)
    E: float = 1.0
    nu: float = 0.3
    squeeze: float = 0.1
    wave: float = 0.05

    def displacement(self, x: np.ndarray) -> np.ndarray:
        """Displacement at ``x``, shape (2, n)."""
        u = -self.squeeze * x[0] + self.wave * np.sin(x[0] + 0.5 * x[1])
        v = -self.squeeze * x[1] + self.wave * np.cos(x[1] - 0.5 * x[0])
        return np.stack([u, v])

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """Gradient of the displacement, shape (2, 2, n), by complex steps."""
        steps = 1e-30j * np.eye(2)[:, :, None]
        return np.stack([self.displacement(x + h).imag / 1e-30 for h in steps], axis=1)

    def pressure(self, x: np.ndarray, *, tied: bool = False) -> np.ndarray:
        """Contact pressure at reference positions x (2, n), force over deformed length.

        For ``tied`` surfaces over undeformed length, like their multipliers.
        """
        mu = self.E / (2 * (1 + self.nu))
        lmbda = 2 * mu * self.nu / (1 - 2 * self.nu)
        F = np.moveaxis(np.eye(2)[:, :, None] + self.gradient(x), -1, 0)
        inverse, J = np.linalg.inv(F).swapaxes(1, 2), np.linalg.det(F)[:, None, None]
        P = mu * (F - inverse) + lmbda * np.log(J) * inverse
        N = (x / np.hypot(*x)).T[:, :, None]
        area = J * (inverse @ N)
        length = np.linalg.norm(area, axis=(1, 2))
        return -((P @ N) * area).sum(axis=(1, 2)) / length ** (1 if tied else 2)
