# SPDX-License-Identifier: MIT
"""Lagrange shape functions of facets with two or three equidistant nodes on [-1, 1]."""

import numpy as np

from fenics_mortar.kernels import kernel


@kernel
def tabulate_shapes(xi, N):
    """Fill ``N`` (3, K): shape functions at ``xi``, then their first and second derivatives."""
    if N.shape[1] == 2:
        N[0, 0], N[0, 1] = 0.5 * (1.0 - xi), 0.5 * (1.0 + xi)
        N[1, 0], N[1, 1] = -0.5, 0.5
        N[2, 0], N[2, 1] = 0.0, 0.0
    else:
        N[0, 0], N[0, 1], N[0, 2] = 0.5 * xi * (xi - 1.0), 1.0 - xi * xi, 0.5 * xi * (xi + 1.0)
        N[1, 0], N[1, 1], N[1, 2] = xi - 0.5, -2.0 * xi, xi + 0.5
        N[2, 0], N[2, 1], N[2, 2] = 1.0, -2.0, 1.0


@kernel
def tabulate_points(points, table):
    """Fill ``table`` (p, 3, K) with shape functions and derivatives at ``points`` (p,)."""
    for p in range(points.size):
        tabulate_shapes(points[p], table[p])


def lagrange(s, degree):
    """Shape functions at coordinates ``s`` (...) and first derivatives, both (..., degree + 1)."""
    table = np.empty((s.size, 3, degree + 1))
    tabulate_points(np.ravel(s), table)
    shapes = table.reshape(*s.shape, 3, degree + 1)
    return shapes[..., 0, :], shapes[..., 1, :]
