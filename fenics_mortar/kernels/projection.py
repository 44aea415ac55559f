# SPDX-License-Identifier: MIT
"""Projections along the continuous field of slave normals, with their derivatives.

===========  ====================================================================  =========
symbol       meaning                                                               shape
===========  ====================================================================  =========
y            local coordinates of one slave and one master facet:                  (12,)
             x1, x2 (slave nodes), n1, n2 (their normals), m1, m2 (master nodes)
xi, eta      coordinate on the slave / master facet, -1 ... 1                      ()
x(xi)        N1 x1 + N2 x2;  N1 = (1 - xi) / 2, N2 = (1 + xi) / 2                  (2,)
n(xi)        N1 n1 + N2 n2, not normalised; tau(xi) = (-n_y, n_x)                  (2,)
dxi_dy       derivative of a segment end by ``y``                                  (12,)
===========  ====================================================================  =========

Both directions use the slave's normals, so they are inverse to each other: a master point x_m and
a slave point x(xi) are partners where q(xi) = tau(xi) . (x_m - x(xi)) = 0 (Popp, Gee & Wall 2009,
section 4). For two-node facets q is quadratic and no iteration is needed.
"""

import numpy as np

from fenics_mortar.kernels import kernel


@kernel
def side_of_ray(x, n, point):
    """Tau . (point - x): positive where ``point`` lies ahead of the ray from ``x`` along ``n``."""
    return n[0] * (point[1] - x[1]) - n[1] * (point[0] - x[0])


@kernel
def master_to_slave(y, k):
    """``xi`` of the partner of master node ``k`` (0 or 1) on the slave facet.

    The root of smaller size, in the form without cancellation. It is the one in [-1, 1] whenever q
    changes its sign there, which the caller has tested.
    """
    cx = 0.5 * (y[0] + y[2])
    cy = 0.5 * (y[1] + y[3])
    ax = 0.5 * (y[2] - y[0])
    ay = 0.5 * (y[3] - y[1])
    nx = 0.5 * (y[4] + y[6])
    ny = 0.5 * (y[5] + y[7])
    bx = 0.5 * (y[6] - y[4])
    by = 0.5 * (y[7] - y[5])
    rx = y[8 + 2 * k] - cx
    ry = y[9 + 2 * k] - cy
    A = by * ax - bx * ay
    B = bx * ry - by * rx + ny * ax - nx * ay
    C = nx * ry - ny * rx
    root = np.sqrt(B * B - 4.0 * A * C)
    return -2.0 * C / (B + (root if B.real >= 0.0 else -root))


@kernel
def master_to_slave_derivative(y, k, xi, dxi_dy):
    """Fill ``dxi_dy`` for the partner ``xi`` of master node ``k``: dq = 0 along the root."""
    N1, N2 = 0.5 * (1.0 - xi), 0.5 * (1.0 + xi)
    nx, ny = N1 * y[4] + N2 * y[6], N1 * y[5] + N2 * y[7]
    rx = y[8 + 2 * k] - N1 * y[0] - N2 * y[2]
    ry = y[9 + 2 * k] - N1 * y[1] - N2 * y[3]
    ax, ay = 0.5 * (y[2] - y[0]), 0.5 * (y[3] - y[1])
    bx, by = 0.5 * (y[6] - y[4]), 0.5 * (y[7] - y[5])
    dq_dxi = bx * ry - by * rx + ny * ax - nx * ay
    s = -1.0 / dq_dxi
    dxi_dy[:] = 0.0
    dxi_dy[0], dxi_dy[1] = s * N1 * ny, -s * N1 * nx
    dxi_dy[2], dxi_dy[3] = s * N2 * ny, -s * N2 * nx
    dxi_dy[4], dxi_dy[5] = s * N1 * ry, -s * N1 * rx
    dxi_dy[6], dxi_dy[7] = s * N2 * ry, -s * N2 * rx
    dxi_dy[8 + 2 * k], dxi_dy[9 + 2 * k] = -s * ny, s * nx


@kernel
def slave_to_master(y, xi):
    """``eta`` and ``alpha`` of the partner x + alpha n of the slave point ``xi``."""
    N1, N2 = 0.5 * (1.0 - xi), 0.5 * (1.0 + xi)
    nx, ny = N1 * y[4] + N2 * y[6], N1 * y[5] + N2 * y[7]
    x0, x1 = N1 * y[0] + N2 * y[2], N1 * y[1] + N2 * y[3]
    ax, ay = 0.5 * (y[10] - y[8]), 0.5 * (y[11] - y[9])
    rx, ry = 0.5 * (y[8] + y[10]) - x0, 0.5 * (y[9] + y[11]) - x1
    across = nx * ay - ny * ax
    eta = -(nx * ry - ny * rx) / across
    alpha = (ay * rx - ax * ry) / (ay * nx - ax * ny)
    return eta, alpha


@kernel
def segment_ends(y, lower_is_fixed, upper_is_fixed, ends, dends_dy):
    """Fill those ends (2,) of a segment that move, and the derivative (2, 12) of both.

    The master facet runs against the slave facet: the lower end is fixed (at slave node 1) or the
    partner of master node 2, the upper end is fixed (at slave node 2) or that of master node 1.
    """
    dends_dy[:] = 0.0
    if not lower_is_fixed:
        ends[0] = master_to_slave(y, 1)
        master_to_slave_derivative(y, 1, ends[0], dends_dy[0])
    if not upper_is_fixed:
        ends[1] = master_to_slave(y, 0)
        master_to_slave_derivative(y, 0, ends[1], dends_dy[1])
