# SPDX-License-Identifier: MIT
"""Slip of a step with rotations of any size; for the formula see ``contact.arcs``."""

import numpy as np

from fenics_mortar.kernels import kernel

# Angle below which kappa is computed by its series [radian]: errors are then below rounding.
SERIES_BELOW = 0.1
# Coefficients of h, h^3, ... in the series of kappa [1].
SERIES = (1.0 / 6.0, 1.0 / 90.0, 1.0 / 945.0, 1.0 / 9450.0, 1.0 / 93555.0)


@kernel
def kappa_at(h):
    """Kappa [1] and its derivative [1 / radian] at half an angle ``h``."""
    if abs(h) >= SERIES_BELOW:
        return 0.5 * (1.0 / h - 1.0 / np.tan(h)), 0.5 * (1.0 / np.sin(h) ** 2 - 1.0 / h**2)
    value, slope, power = 0.0, 0.0, 1.0
    for i in range(len(SERIES)):
        value += SERIES[i] * power * h
        slope += (2 * i + 1) * SERIES[i] * power
        power *= h * h
    return value, slope


@kernel
def tabulate_arcs(now, start, theta, beta, gap, slip, by_vectors, by_angles):
    """Tabulate the slip and its derivatives.

    Args:
        now: Vectors r and normals n, shape (2, k, 2) [length, 1].
        start: r_0 and n_0, likewise.
        theta: Rotation of the master minus that of the normal, shape (k,) [radian].
        beta: Rotation of the normal in the frame of constant velocity, shape (k,) [radian].
        gap: Gap that is closed by contact, shape (k,) [length].
        slip: Shape (k,) [length]; filled.
        by_vectors: Derivatives by r and r_0, shape (2, k, 2) [1]; filled.
        by_angles: Derivatives by rotations of n and n_0, by theta and by beta, (4, k) [length];
            filled.
    """
    for j in range(theta.size):
        nx, ny = now[1, j, 0], now[1, j, 1]
        mx, my = start[1, j, 0], start[1, j, 1]
        along = nx * now[0, j, 1] - ny * now[0, j, 0]
        along_0 = mx * start[0, j, 1] - my * start[0, j, 0]
        across = nx * now[0, j, 0] + ny * now[0, j, 1]
        across_0 = mx * start[0, j, 0] + my * start[0, j, 1]
        kappa, slope = kappa_at(0.5 * beta[j])
        factor, half = 1.0 + theta[j] * kappa, 0.5 * theta[j]
        moved, mean = along - along_0, 0.5 * (across + gap[j] + across_0)
        slip[j] = factor * moved - theta[j] * mean
        by_vectors[0, j, 0], by_vectors[0, j, 1] = -factor * ny - half * nx, factor * nx - half * ny
        by_vectors[1, j, 0], by_vectors[1, j, 1] = factor * my - half * mx, -factor * mx - half * my
        by_angles[0, j] = -factor * across - half * along
        by_angles[1, j] = factor * across_0 - half * along_0
        by_angles[2, j] = kappa * moved - mean
        by_angles[3, j] = half * slope * moved
