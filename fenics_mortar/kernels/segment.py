# SPDX-License-Identifier: MIT
"""Moments of one contact segment and their derivatives by the nodal positions.

A segment is the part [xi_a, xi_b] of a slave facet that meets one master facet, and a list of
points xi = c + h s, -1 <= s <= 1, with weights whose sum is 2: a Gauss rule, if its ends are where
the facets meet. Or its ends are fixed places on the slave facet, and its points are those of a rule
for the whole facet that lie between them: then nothing moves but the partners of the points. What
is summed up here are the moments

    M[p, l] = int s^p N_l(eta) dgamma,    g[p] = int s^p g dgamma,    p = 0, 1,

over the *current* slave surface. Any linear multiplier basis (dual, standard, modified at a
Dirichlet end) is a combination of 1 and s, so these moments serve all of them; see ``basis``.

=========  =========================================================================  ===========
symbol     meaning                                                                    shape
=========  =========================================================================  ===========
y          x1, x2, n1, n2, m1, m2 (see ``projection``)                                (12,)
c, h       centre and half length of the segment, c = (xi_a + xi_b)/2                 ()
s, w       places and weights of the points of a segment                              (p,)
J          |x2 - x1| / 2, so dgamma = J h ds                                          ()
g          gap n^ . (x^ - x) = alpha |n|, n^ = n / |n|                                ()
columns    derivatives end up by the positions of the slave nodes before, 1, 2,       (12,)
           after and of the master nodes 1, 2: the normals are chained through
=========  =========================================================================  ===========

With r = x^ - x = alpha n, tau = (-n_y, n_x), a = (m2 - m1)/2 and its perpendicular b:

    d eta   = p . (N^m dm - dx - alpha dn),   p = -tau / (tau . a)
    d alpha = q . (N^m dm - dx - alpha dn),   q = b / (b . n)
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.projection import segment_ends, slave_to_master


@kernel
def point_derivatives(y, xi, eta, alpha, deta, dgap):
    """Fill d eta and d g by ``y`` (12,) at fixed ``xi``; return (g, d eta/d xi, d g/d xi)."""
    nx = 0.5 * (y[4] + y[6]) + 0.5 * xi * (y[6] - y[4])
    ny = 0.5 * (y[5] + y[7]) + 0.5 * xi * (y[7] - y[5])
    size = np.sqrt(nx * nx + ny * ny)
    ax, ay = 0.5 * (y[10] - y[8]), 0.5 * (y[11] - y[9])
    along = nx * ay - ny * ax
    px, py = ny / along, -nx / along
    qx, qy = ay * size / (ay * nx - ax * ny), -ax * size / (ay * nx - ax * ny)
    for k in range(2):
        N = 0.5 * (1.0 - xi) if k == 0 else 0.5 * (1.0 + xi)
        L = 0.5 * (1.0 - eta) if k == 0 else 0.5 * (1.0 + eta)
        deta[2 * k], deta[2 * k + 1] = -N * px, -N * py
        dgap[2 * k], dgap[2 * k + 1] = -N * qx, -N * qy
        deta[4 + 2 * k], deta[5 + 2 * k] = -alpha * N * px, -alpha * N * py
        dgap[4 + 2 * k] = alpha * N * (nx / size - qx)
        dgap[5 + 2 * k] = alpha * N * (ny / size - qy)
        deta[8 + 2 * k], deta[9 + 2 * k] = L * px, L * py
        dgap[8 + 2 * k], dgap[9 + 2 * k] = L * qx, L * qy
    bx, by = 0.5 * (y[6] - y[4]), 0.5 * (y[7] - y[5])
    tx, ty = 0.5 * (y[2] - y[0]) + alpha * bx, 0.5 * (y[3] - y[1]) + alpha * by
    dg_dxi = -(qx * tx + qy * ty) + alpha * (nx * bx + ny * by) / size
    return alpha * size, -(px * tx + py * ty), dg_dxi


@kernel
def integrate_segment(y, ends, dends, rule, span, M, dM, g, dg, deta, dgap):
    """Fill the moments ``M`` (2, 2), ``g`` (2,) and their derivatives by ``y`` (..., 12)."""
    points, weights = rule
    c, h = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0])
    ex, ey = 0.5 * (y[2] - y[0]), 0.5 * (y[3] - y[1])
    J = np.sqrt(ex * ex + ey * ey)
    M[:] = 0.0
    dM[:] = 0.0
    g[:] = 0.0
    dg[:] = 0.0
    for i in range(span[0], span[1]):
        s, w = points[i], weights[i]
        xi = c + h * s
        eta, alpha = slave_to_master(y, xi)
        gap, eta_xi, gap_xi = point_derivatives(y, xi, eta, alpha, deta, dgap)
        L1, L2, W = 0.5 * (1.0 - eta), 0.5 * (1.0 + eta), w * J * h
        M[0, 0] += W * L1
        M[0, 1] += W * L2
        M[1, 0] += W * s * L1
        M[1, 1] += W * s * L2
        g[0] += W * gap
        g[1] += W * s * gap
        for k in range(12):
            dh = 0.5 * (dends[1, k] - dends[0, k])
            dxi = 0.5 * (dends[0, k] + dends[1, k]) + s * dh
            dW = w * J * dh
            if k < 4:
                edge = ex if k % 2 == 0 else ey
                dW += w * h * (edge if k >= 2 else -edge) * 0.5 / J
            half = 0.5 * W * (deta[k] + eta_xi * dxi)
            d1 = L1 * dW - half
            d2 = L2 * dW + half
            d3 = gap * dW + W * (dgap[k] + gap_xi * dxi)
            dM[0, 0, k] += d1
            dM[0, 1, k] += d2
            dM[1, 0, k] += s * d1
            dM[1, 1, k] += s * d2
            dg[0, k] += d3
            dg[1, k] += s * d3


@kernel
def chain_normals(row, dn1, dn2, out):
    """Turn a derivative by ``y`` into one by nodal positions, with dn1, dn2 (2, 6)."""
    for d in range(2):
        out[d] = row[4] * dn1[0, d] + row[5] * dn1[1, d]
        out[2 + d] = (
            row[d]
            + row[4] * dn1[0, 2 + d]
            + row[5] * dn1[1, 2 + d]
            + row[6] * dn2[0, d]
            + row[7] * dn2[1, d]
        )
        out[4 + d] = (
            row[2 + d]
            + row[4] * dn1[0, 4 + d]
            + row[5] * dn1[1, 4 + d]
            + row[6] * dn2[0, 2 + d]
            + row[7] * dn2[1, 2 + d]
        )
        out[6 + d] = row[6] * dn2[0, 4 + d] + row[7] * dn2[1, 4 + d]
        out[8 + d] = row[8 + d]
        out[10 + d] = row[10 + d]


@kernel
def local_coordinates(x, n, m, slave, master, y):
    """Gather ``y`` (12,) of one slave facet and one master facet (two node numbers each)."""
    for k in range(2):
        for d in range(2):
            y[2 * k + d] = x[slave[k], d]
            y[4 + 2 * k + d] = n[slave[k], d]
            y[8 + 2 * k + d] = m[master[k], d]


@kernel
def tabulate_segments(
    geometry, connectivity, end_is_fixed, rule, linearize_ends, ends, dends, M, dM, g, dg
):
    """Fill ends (n, 2), moments M (n, 2, 2), g (n, 2) and derivatives (..., 12) of n segments.

    ``geometry`` = (x, n, dn_dx, m): slave positions, normals and their derivative, master
    positions; ``connectivity`` = (slave nodes (n, 2), master nodes (n, 2)); ``rule`` = (s, w, spans
    (n, 2)): segment i has the points spans[i, 0]:spans[i, 1]. Ends that are fixed must come filled.
    Without ``linearize_ends`` all count as fixed in the derivatives.
    """
    x, n, dn_dx, m = geometry
    slave, master = connectivity
    s, w, spans = rule
    kind = x.dtype
    y, deta, dgap = np.empty(12, kind), np.empty(12, kind), np.empty(12, kind)
    dM_dy, dg_dy = np.empty((2, 2, 12), kind), np.empty((2, 12), kind)
    dends_dy = np.empty((2, 12), kind)
    for i in range(slave.shape[0]):
        local_coordinates(x, n, m, slave[i], master[i], y)
        segment_ends(y, end_is_fixed[i, 0], end_is_fixed[i, 1], ends[i], dends_dy)
        if not linearize_ends:
            dends_dy[:] = 0.0
        integrate_segment(
            y, ends[i], dends_dy, (s, w), spans[i], M[i], dM_dy, g[i], dg_dy, deta, dgap
        )
        dn1, dn2 = dn_dx[slave[i, 0]], dn_dx[slave[i, 1]]
        for p in range(2):
            chain_normals(dends_dy[p], dn1, dn2, dends[i, p])
            chain_normals(dg_dy[p], dn1, dn2, dg[i, p])
            for k in range(2):
                chain_normals(dM_dy[p, k], dn1, dn2, dM[i, p, k])
