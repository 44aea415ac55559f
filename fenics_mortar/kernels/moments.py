# SPDX-License-Identifier: MIT
"""Integrals over one segment, and their derivatives.

A segment is a part of a slave facet with partners on one master facet, and a list of points
xi = c + h s, -1 <= s <= 1, with weights whose sum is 2. Either its ends are those of the
intersection of the two facets, and the points are a Gauss rule; or its ends are fixed on the slave
facet, and the points are those of a rule for the whole facet that lie between them. In the latter
case only the partners of the points move.

=========  =========================================================================  ===========
symbol     meaning                                                                    shape
=========  =========================================================================  ===========
c, h       centre and half length of the segment                                      ()
J          |dx/dxi|, dgamma = J h ds; W = w J h is the weight of a point              ()
theta      out-of-plane thickness at the nodes of the facet; with it dgamma is an     (K,)
           area, dgamma = (N theta) J h ds, and W = w J h (N theta)
g          gap n^ . (x^ - x) = alpha |n|, n^ = n / |n|                                ()
T          powers of t on the covered part of the facet, see ``basis``                (K,)
G          moments int t^p dgamma, p = 0 ... 2 K - 2                                  (2 K - 1,)
T_M, T_g   moments int T_p L_l dgamma, int T_p g dgamma                               (K, K), (K,)
Phi, Psi   multiplier functions C T, functions C_g T that weight the gap              (K,)
rows       derivatives of xi, W, eta and g of a point by y                            (4, 6 K)
columns    positions that final derivatives refer to: slave nodes of the facet        (8 K - 4,)
           before, of this one and of the one after, then master nodes
=========  =========================================================================  ===========

With the partner x^ = x + alpha n, tau = (-n_y, n_x), a = dm/deta and b = (a_y, -a_x):

    d eta   = p . (L dm - N dx - alpha N dn),   p = -tau / (tau . a)
    d alpha = q . (L dm - N dx - alpha N dn),   q = b / (b . n)
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.projection import interpolate, slave_to_master


@kernel
def thickness_at(theta, N, derivative):
    """Thickness at a point with the shape functions ``N`` (3, K), or its derivative by xi."""
    value = 0.0 * theta[0]
    for i in range(theta.size):
        value += N[derivative, i] * theta[i]
    return value


@kernel
def integrate_moments(y, ends, bounds, rule, shapes, G, T_M, T_g, theta=None):
    """Fill the moments ``T_M`` of a segment; add its contribution to ``G`` and ``T_g``.

    ``ends`` (2,); ``bounds`` = (lower end, upper end) of the covered part, without derivatives;
    ``rule`` = (points, weights); ``shapes`` = (N, L), overwritten; the thickness is one without
    ``theta``.
    """
    points, weights = rule
    N, L = shapes
    count = N.shape[1]
    c, h = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0])
    middle, half = 0.5 * (bounds[0] + bounds[1]), 0.5 * (bounds[1] - bounds[0])
    T_M[:] = 0.0
    for i in range(points.size):
        xi = c + h * points[i]
        _, alpha = slave_to_master(y, xi, N, L)
        nx, ny = interpolate(y, 1, N, 0)
        tx, ty = interpolate(y, 0, N, 1)
        gap = alpha * np.sqrt(nx * nx + ny * ny)
        t, T = (xi - middle) / half, weights[i] * h * np.sqrt(tx * tx + ty * ty)
        if theta is not None:
            T = T * thickness_at(theta, N, 0)
        for p in range(2 * count - 1):
            G[p] += T
            if p < count:
                T_g[p] += T * gap
                for l in range(count):
                    T_M[p, l] += T * L[0, l]
            T = T * t


@kernel
def differentiate_point(y, s, w, ends, dends, shapes, rows):
    """Fill ``rows`` (4, 6 K), the derivatives of xi, W, eta and g of a point; return (xi, W, g).

    ``s`` and ``w`` are its coordinate and weight, ``dends`` (2, 6 K) the derivatives of the
    ``ends``; the ``shapes`` (N, L) are filled, too.
    """
    N, L = shapes
    count = N.shape[1]
    c, h = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0])
    xi = c + h * s
    _, alpha = slave_to_master(y, xi, N, L)
    nx, ny = interpolate(y, 1, N, 0)
    bx, by = interpolate(y, 1, N, 1)
    tx, ty = interpolate(y, 0, N, 1)
    kx, ky = interpolate(y, 0, N, 2)
    ax, ay = interpolate(y, 2, L, 1)
    size, J = np.sqrt(nx * nx + ny * ny), np.sqrt(tx * tx + ty * ty)
    along = nx * ay - ny * ax
    px, py = ny / along, -nx / along
    qx, qy = ay * size / along, -ax * size / along
    sx, sy = tx + alpha * bx, ty + alpha * by
    eta_xi = -(px * sx + py * sy)
    gap_xi = alpha * (nx * bx + ny * by) / size - (qx * sx + qy * sy)
    J_xi = (tx * kx + ty * ky) / J
    lower, upper = 0.5 * (1.0 - s), 0.5 * (1.0 + s)
    for k in range(6 * count):
        dxi = lower * dends[0, k] + upper * dends[1, k]
        rows[0, k] = dxi
        rows[1, k] = w * (0.5 * J * (dends[1, k] - dends[0, k]) + h * J_xi * dxi)
        rows[2, k] = eta_xi * dxi
        rows[3, k] = gap_xi * dxi
    for i in range(count):
        own, normal, master, f = 2 * i, 2 * (count + i), 2 * (2 * count + i), N[0, i]
        stretch = w * h * N[1, i] / J
        rows[1, own] += stretch * tx
        rows[1, own + 1] += stretch * ty
        rows[2, own] -= f * px
        rows[2, own + 1] -= f * py
        rows[3, own] -= f * qx
        rows[3, own + 1] -= f * qy
        rows[2, normal] -= alpha * f * px
        rows[2, normal + 1] -= alpha * f * py
        rows[3, normal] += alpha * f * (nx / size - qx)
        rows[3, normal + 1] += alpha * f * (ny / size - qy)
        rows[2, master] += L[0, i] * px
        rows[2, master + 1] += L[0, i] * py
        rows[3, master] += L[0, i] * qx
        rows[3, master + 1] += L[0, i] * qy
    return xi, w * J * h, alpha * size


@kernel
def differentiate_thickness(theta, by_x, W, N, rows):
    """Multiply W and its derivative, in ``rows``, by the thickness of a point; return W.

    ``by_x``: derivative of ``theta`` with respect to the first coordinate of its node.
    """
    value, slope = thickness_at(theta, N, 0), thickness_at(theta, N, 1)
    for k in range(rows.shape[1]):
        rows[1, k] = rows[1, k] * value + W * slope * rows[0, k]
    for i in range(theta.size):
        rows[1, 2 * i] += W * by_x * N[0, i]
    return W * value


@kernel
def add_product(A, B, out):
    """Add the matrix product A (r, c) B (c, k) to ``out`` (r, k)."""
    for r in range(A.shape[0]):
        for c in range(A.shape[1]):
            factor = A[r, c]
            for k in range(B.shape[1]):
                out[r, k] += factor * B[c, k]


@kernel
def integrate_derivatives(y, ends, dends, bounds, rule, functions, work, out, theta=None, by_x=0.0):
    """Fill ``out`` with derivatives by ``y`` of G, M and g; the ``functions`` (C, C_g) are fixed.

    ``out`` (r, 6 K) has 2 K - 1 rows for G, K K for M and K for g. ``work`` = (shapes, rows,
    weights (r, 4) of these rows) is overwritten. ``theta``, ``by_x``: see
    ``differentiate_thickness``.
    """
    points, point_weights = rule
    C, C_g = functions
    shapes, rows, weights = work
    L, count = shapes[1], C.shape[0]
    middle, half = 0.5 * (bounds[0] + bounds[1]), 0.5 * (bounds[1] - bounds[0])
    out[:] = 0.0
    weights[:] = 0.0
    for i in range(points.size):
        xi, W, gap = differentiate_point(y, points[i], point_weights[i], ends, dends, shapes, rows)
        if theta is not None:
            W = differentiate_thickness(theta, by_x, W, shapes[0], rows)
        t = (xi - middle) / half
        T, T_xi = 1.0 + 0.0 * t, 0.0 * t
        for p in range(2 * count - 1):
            weights[p, 0], weights[p, 1] = W * T_xi, T
            T_xi = T_xi * t + T / half
            T = T * t
        row = 2 * count - 1
        for j in range(count):
            phi, phi_xi = value_and_slope(C, j, t, half)
            for l in range(count):
                weights[row, 0], weights[row, 1] = W * phi_xi * L[0, l], phi * L[0, l]
                weights[row, 2] = W * phi * L[1, l]
                row += 1
        for j in range(count):
            psi, psi_xi = value_and_slope(C_g, j, t, half)
            weights[row, 0], weights[row, 1] = W * psi_xi * gap, psi * gap
            weights[row, 3] = W * psi
            row += 1
        for r in range(out.shape[0]):
            a, b, c, d = weights[r, 0], weights[r, 1], weights[r, 2], weights[r, 3]
            for k in range(out.shape[1]):
                out[r, k] += a * rows[0, k] + b * rows[1, k] + c * rows[2, k] + d * rows[3, k]


@kernel
def value_and_slope(C, j, t, half):
    """Value at t of function ``j`` with coefficients ``C``, and its derivative by xi (Horner)."""
    count = C.shape[1]
    value, slope = C[j, count - 1], 0.0 * C[j, 0]
    for p in range(count - 2, -1, -1):
        slope = slope * t + value
        value = value * t + C[j, p]
    return value, slope / half


@kernel
def chain_normals(row, dn_dx, nodes, out):
    """Fill ``out`` (8 K - 4,) with derivatives by nodal positions, given those by ``y`` (6 K,).

    ``dn_dx`` are the derivatives of the normals in ``y`` with respect to the positions; ``nodes``
    (K,) are those of the slave facet.
    """
    count = nodes.size
    out[:] = 0.0
    for i in range(count):
        for d in range(2):
            out[2 * (count - 1 + i) + d] += row[2 * i + d]
            out[2 * (3 * count - 2 + i) + d] = row[2 * (2 * count + i) + d]
        nx, ny = row[2 * (count + i)], row[2 * (count + i) + 1]
        for k in range(dn_dx.shape[2]):
            out[2 * i + k] += nx * dn_dx[nodes[i], 0, k] + ny * dn_dx[nodes[i], 1, k]
