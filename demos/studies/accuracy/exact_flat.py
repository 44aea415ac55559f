# SPDX-License-Identifier: MIT
"""A smooth manufactured solution with a flat, closed interface that slides, at finite strain.

One body is deformed by u and v after it was cut along y = 0 and its upper part shifted to the left
by ``slid``. With the stretch F = 1 + B + C sin(pi x) along the cut and 1 / F across it,

    u = B x - C cos(pi x) / pi + y friction (F - 1 / F) + y^2 sin(pi x / 2) / 10,
    v = y (1 / F - 1) + y^2 sin(pi x) / 20.

On y = 0 the volume is kept and v = 0, so that the neo-Hookean law has the pressure mu (1 - 1 / F^2)
there, and the shear is friction times that: the upper part has slid back to its original position
at the limit of Coulomb's law. Body forces keep the balance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class FlatInterface:
    """The exact solution of the compressible neo-Hookean law.

    Attributes:
        E: Young's modulus [stress].
        nu: Poisson's ratio.
        friction: Coulomb's coefficient.
        slid: Distance by which the upper part has slid to the right, undeformed [length].
        stretches: B and C.
    """

    E: float = 1.0
    nu: float = 0.3
    friction: float = 0.0
    slid: float = 0.0
    stretches: tuple[float, float] = (0.15, 0.05)

    def stretch(self, x: np.ndarray) -> np.ndarray:
        """F at position x of the uncut body."""
        B, C = self.stretches
        return 1 + B + C * np.sin(np.pi * x)

    def displacement(self, x: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Displacement at ``x``, shape (2, n), of the part given by ``upper`` (n,)."""
        (B, C), back = self.stretches, self.slid * upper
        x, y = x[0] + back, x[1]
        F = self.stretch(x)
        u = B * x - C * np.cos(np.pi * x) / np.pi + y * self.friction * (F - 1 / F)
        v = y * (1 / F - 1) + y**2 * np.sin(np.pi * x) / 20
        return np.stack([back + u + y**2 * np.sin(np.pi * x / 2) / 10, v])

    def gradient(self, x: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Gradient of the displacement, shape (2, 2, n), by complex steps."""
        steps = 1e-30j * np.eye(2)[:, :, None]
        return np.stack([self.displacement(x + h, upper).imag / 1e-30 for h in steps], axis=1)

    def pressure(self, x: np.ndarray) -> np.ndarray:
        """Contact pressure, force over deformed length, at position x of the lower part."""
        return self.E / (2 * (1 + self.nu)) * (1 - self.stretch(x) ** -2.0)
