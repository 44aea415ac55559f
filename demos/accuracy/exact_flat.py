# SPDX-License-Identifier: MIT
"""A smooth manufactured solution with a flat, closed, sliding interface, at finite strain.

Two squares meet on y = 0. The lower one, y <= 0, moves by

    u = A sin(pi x / 2) (1 + y^2),    v = -y (B + C cos(pi x)) + D y^2 sin(pi x)

and the upper one is its mirror image. On y = 0 v and du/dy vanish, so F is diagonal there: there is
no shear, and the pressure is -sigma_yy on both sides. Body forces keep the balance.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

import ufl


@dataclass(frozen=True)
class FlatInterface:
    """The exact solution of the compressible neo-Hookean law, on [0, 1] x [-1, 1]."""

    E: float = 1.0
    nu: float = 0.3
    amplitudes: tuple[float, float, float, float] = (0.1, 0.15, 0.05, 0.05)

    def lower(self, x: Any, y: Any, functions: ModuleType) -> tuple[Any, Any]:
        """Displacement of the lower body; ``functions`` has sin and cos: numpy or ufl."""
        A, B, C, D = self.amplitudes
        sin, cos = functions.sin, functions.cos
        u = A * sin(np.pi / 2 * x) * (1 + y**2)
        return u, -y * (B + C * cos(np.pi * x)) + D * y**2 * sin(np.pi * x)

    def displacement(self, x: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Displacement at ``x``, shape (2, n), of the body that ``upper`` (n,) says."""
        sign = np.where(upper, -1.0, 1.0)
        u, v = self.lower(x[0], sign * x[1], np)
        return np.stack([u, sign * v])

    def gradient(self, x: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Gradient of the displacement, shape (2, 2, n), by complex steps."""
        steps = 1e-30j * np.eye(2)[:, :, None]
        return np.stack([self.displacement(x + h, upper).imag / 1e-30 for h in steps], axis=1)

    def ufl_displacement(self, x: Any) -> Any:
        """The same as a UFL vector, away from y = 0."""
        sign = -ufl.sign(x[1])
        u, v = self.lower(x[0], sign * x[1], ufl)
        return ufl.as_vector([u, sign * v])

    def pressure(self, x: np.ndarray) -> np.ndarray:
        """Contact pressure, force over deformed length, at the reference place x [stress]."""
        mu = self.E / (2 * (1 + self.nu))
        lmbda = 2 * mu * self.nu / (1 - 2 * self.nu)
        place = np.stack([x, np.zeros_like(x)])
        F = np.eye(2)[:, :, None] + self.gradient(place, np.zeros(x.shape, bool))
        J = F[0, 0] * F[1, 1]
        return -(mu * (F[1, 1] ** 2 - 1) + lmbda * np.log(J)) / J
