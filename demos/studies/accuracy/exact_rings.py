# SPDX-License-Identifier: MIT
"""Press fit of two rings at finite strain: a boundary value problem in one variable.

A ring of inner radius a and outer radius b + interference sits in one of inner radius b and outer
radius c, plane strain, both made of the same material, inside and outside free. With r(R) the
deformed radius and P the first Piola-Kirchhoff stress of the stretches r' and r / R,

    (R P_r)' = P_t,    r and R P_r equal on both sides of the interface.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import newton

Law = Callable[[Any, Any, float, float], tuple[Any, Any]]


def neo_hookean(radial: Any, hoop: Any, mu: float, lmbda: float) -> tuple[Any, Any]:
    """Radial and hoop stress for two stretches."""
    volume = lmbda * np.log(radial * hoop)
    return mu * (radial - 1 / radial) + volume / radial, mu * (hoop - 1 / hoop) + volume / hoop


def linear(radial: Any, hoop: Any, mu: float, lmbda: float) -> tuple[Any, Any]:
    """Radial and hoop stress of linear elasticity for two stretches."""
    volume = lmbda * (radial + hoop - 2)
    return 2 * mu * (radial - 1) + volume, 2 * mu * (hoop - 1) + volume


@dataclass(frozen=True)
class PressFit:
    """The exact solution, to ten digits.

    Attributes:
        law: Stresses by stretches: ``neo_hookean`` or ``linear``.
        radii: a, b and c [length].
        interference: Excess of the inner ring's outer radius over b [length].
        E: Young's modulus [stress].
        nu: Poisson's ratio.
    """

    law: Law = neo_hookean
    radii: tuple[float, float, float] = (1.0, 2.0, 3.0)
    interference: float = 0.2
    E: float = 1.0
    nu: float = 0.3

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's parameters [stress]."""
        mu = self.E / (2 * (1 + self.nu))
        return mu, 2 * mu * self.nu / (1 - 2 * self.nu)

    @property
    def rings(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Inner and outer radius of the inner and of the outer ring [length]."""
        a, b, c = self.radii
        return (a, b + self.interference), (b, c)

    def stretch(self, hoop: np.ndarray, stress: np.ndarray) -> np.ndarray:
        """Radial stretch for a given radial stress."""

        def excess(radial: np.ndarray) -> np.ndarray:
            return self.law(radial, hoop, *self.lame)[0] - stress

        return newton(excess, np.ones_like(hoop), tol=1e-14)

    @cached_property
    def _solution(self) -> Any:
        """Both rings over t from 0 to 1: r and R P_r of the inner, then of the outer one."""

        def radius(t: np.ndarray, ring: tuple[float, float]) -> np.ndarray:
            return ring[0] + (ring[1] - ring[0]) * t

        def slope(t: np.ndarray, y: np.ndarray) -> np.ndarray:
            rows = []
            for (r, force), ring in zip((y[:2], y[2:]), self.rings):
                R = radius(t, ring)
                radial = self.stretch(r / R, force / R)
                hoop_stress = self.law(radial, r / R, *self.lame)[1]
                rows += [(ring[1] - ring[0]) * radial, (ring[1] - ring[0]) * hoop_stress]
            return np.stack(rows)

        def ends(y0: np.ndarray, y1: np.ndarray) -> np.ndarray:
            return np.array([y0[1], y1[3], y1[0] - y0[2], y1[1] - y0[3]])

        t = np.linspace(0, 1, 65)
        start = [np.zeros_like(t)] * 4
        start[0], start[2] = (radius(t, ring) for ring in self.rings)
        found = solve_bvp(slope, ends, t, np.stack(start), tol=1e-11, max_nodes=100_000)
        if not found.success:
            raise RuntimeError(f"the press fit has no solution: {found.message}")
        return found.sol

    @property
    def interface(self) -> float:
        """Deformed radius of the interface [length]."""
        return float(self._solution(1.0)[0])

    @property
    def contact_pressure(self) -> float:
        """Force over deformed length at the interface [stress]."""
        return float(-self._solution(1.0)[1] / self.interface)

    def _radial(self, R: np.ndarray, inner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Deformed radius and radial stretch at reference radii of either ring."""
        both = []
        for k, (start, end) in enumerate(self.rings):
            r, force = self._solution((R - start) / (end - start))[2 * k : 2 * k + 2]
            both.append((r, self.stretch(r / R, force / R)))
        return np.where(inner, both[0][0], both[1][0]), np.where(inner, both[0][1], both[1][1])

    def displacement(self, x: np.ndarray, inner: np.ndarray) -> np.ndarray:
        """Displacement at ``x``, shape (2, n), of the ring given by ``inner`` (n,)."""
        R = np.hypot(*x)
        return (self._radial(R, inner)[0] / R - 1) * x

    def gradient(self, x: np.ndarray, inner: np.ndarray) -> np.ndarray:
        """Gradient of the displacement, shape (2, 2, n)."""
        R = np.hypot(*x)
        r, radial = self._radial(R, inner)
        e = x / R
        identity = np.eye(2)[:, :, None]
        return (r / R - 1) * identity + (radial - r / R) * e[:, None] * e[None, :]
