# SPDX-License-Identifier: MIT
"""Quadrature points of the common part of two pieces, on both facets.

The polygon is divided into a fan of triangles from its first vertex, the cells. A point of a cell
is V = sum_i lambda_i V_i with the weight W = w A, where lambda and w are those of the rule and A is
the area of the cell in the plane, a measure that all integrals share.

The derivatives of W, xi and eta of a point have these factors in those of its contributions W F:

    d(W F) = F dW + W (dF/dxi_a dxi_a + dF/deta_a deta_a + dF/dg dg)

The functions F are those of ``linearize``, with constant coefficients. Their factors are the rows
of ``by`` (5, r): F and W times the derivatives of F by xi_1, xi_2, eta_1 and eta_2. Those of X and
of the weight have no part in eta: they come first.

==========  ======================================================================  ============
symbol      meaning                                                                 shape
==========  ======================================================================  ============
fields      c, v and y at a point, with derivatives by xi, by eta for y             (3, b) each
Phi         functions A N at a point, with derivatives                              (3, K)
gamma       gamma at a point, with derivatives                                      (3,)
==========  ======================================================================  ============
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.space.clipping import (
    MAX_VERTICES,
    clip,
    clipping_work,
    place_vertices,
    signed_area,
)
from fenics_mortar.kernels.space.normals import find_point
from fenics_mortar.kernels.space.shapes import piece_centres, pieces_of


@kernel
def points_work(x, counts, rule):
    """Arrays for the points of two pieces of facets with ``counts`` = (K, K') nodes.

    ``x`` has the kind of the numbers. Returns ``facets`` = (rows of images of the pieces, and their
    centres in reference coordinates, of the slave and of the master facet), ``plane`` = (frame,
    images, heights), ``polygon`` = (work of ``clip``, V, shares, a cell and a point) and ``table``
    = (W (p,), N (p, 3, K), N^m (p, 3, K')).
    """
    own, others = counts
    kind, most = x.dtype, (MAX_VERTICES - 2) * rule[1].size
    facets = (
        pieces_of(own), piece_centres(own), pieces_of(others) + own, piece_centres(others)
    )  # fmt: skip
    plane = np.empty((4, 3), kind), np.empty((own + others, 2), kind), np.empty(own + others, kind)
    polygon = (
        clipping_work(MAX_VERTICES), np.empty((MAX_VERTICES, 2), kind),
        np.empty((MAX_VERTICES, 2), kind), np.empty((4, 2), kind),
    )  # fmt: skip
    table = np.empty(most, kind), np.empty((most, 3, own), kind), np.empty((most, 3, others), kind)
    return facets, plane, polygon, table


@kernel
def common_part(images, slave, master, area, polygon):
    """Number of vertices of the common part of two pieces, see ``clip``; ``polygon`` is filled."""
    work, V, shares, _ = polygon
    count = clip(images, slave, master, area, work)
    place_vertices(images, work[1], count, V, shares)
    return count


@kernel
def tabulate_points(images, count, facets, pieces, rule, polygon, table):
    """Fill ``table`` with the points of a polygon: (number of points, whether no facet is folded).

    Args:
        images: Flat images of the nodes, shape (K + K', 2).
        count: Number of vertices of the polygon.
        facets: See ``points_work``.
        pieces: Numbers of the slave and of the master piece.
        rule: (barycentric coordinates (p, 3), weights (p,)).
        polygon: See ``points_work`` and ``common_part``.
        table: (W (p,), N (p, 3, K), N^m (p, 3, K')); filled.
    """
    (bary, weights), (W, N, L), (_, V, _, corners) = rule, table, polygon
    (a, b), (c, d) = facets[1][pieces[0]], facets[3][pieces[1]]
    own, point, q, regular = N.shape[2], corners[3], 0, True
    for cell in range(count - 2):
        for k in range(2):
            corners[0, k], corners[1, k], corners[2, k] = V[0, k], V[cell + 1, k], V[cell + 2, k]
        area = signed_area(corners, 3)
        for g in range(weights.size):
            for k in range(2):
                point[k] = bary[g, 0] * corners[0, k] + bary[g, 1] * corners[1, k]
                point[k] += bary[g, 2] * corners[2, k]
            det = find_point(images, 0, point, a, b, N[q])
            det_master = find_point(images, own, point, c, d, L[q])
            regular = regular and det.real > 0.0 and det_master.real < 0.0
            W[q] = weights[g] * area
            q += 1
    return q, regular


@kernel
def gap_at(geometry, slave, master, N, L, gap):
    """Fill ``gap`` (3, 3) with n, n^ and N^m y - N x at a point; return (g, |n|).

    ``slave`` (K,) and ``master`` (K',) are the nodes of the facets.
    """
    x, n, m = geometry
    g = square = 0.0 * x[0, 0]
    for c in range(3):
        gap[0, c] = gap[2, c] = 0.0 * x[0, 0]
        for k in range(slave.size):
            gap[0, c] += N[0, k] * n[slave[k], c]
            gap[2, c] -= N[0, k] * x[slave[k], c]
        for l in range(master.size):
            gap[2, c] += L[0, l] * m[master[l], c]
        square += gap[0, c] * gap[0, c]
    size = np.sqrt(square)
    for c in range(3):
        gap[1, c] = gap[0, c] / size
        g += gap[1, c] * gap[2, c]
    return g, size


@kernel
def row_starts(own, others, wanted, of_force, of_vector):
    """First rows of weight, X, gap, Y and vector, and the number of rows, shape (6,).

    ``wanted`` (5,): whether each of them is, in this order. ``of_force`` and ``of_vector`` are the
    numbers of components of X and Y, and of vector.
    """
    starts = np.zeros(6, np.int64)
    sizes = (own, of_force * own, own, of_force * others, of_vector * own)
    for i in range(5):
        starts[i + 1] = starts[i] + (sizes[i] if wanted[i] else 0)
    return starts


@kernel
def combine(values, N, out):
    """Fill ``out`` (3, c) with sum_k N[., k] ``values`` (K, c)."""
    for a in range(3):
        for c in range(values.shape[1]):
            total = 0.0 * N[0, 0]
            for k in range(values.shape[0]):
                total += N[a, k] * values[k, c]
            out[a, c] = total


@kernel
def combine_scalar(values, N, out):
    """Fill ``out`` (3,) with sum_k N[., k] ``values`` (K,)."""
    for a in range(3):
        total = 0.0 * N[0, 0]
        for k in range(values.size):
            total += N[a, k] * values[k]
        out[a] = total


@kernel
def weigh_weight(W, N, first, by):
    """F_j = N_j."""
    for j in range(N.shape[1]):
        by[0, first + j] = N[0, j]
        by[1, first + j], by[2, first + j] = W * N[1, j], W * N[2, j]


@kernel
def weigh_slave_force(W, N, s, c, first, by):
    """F_kc = N_k (s_kc - c_c), with ``s`` (K, b) and the field ``c`` (3, b)."""
    count = c.shape[1]
    for k in range(N.shape[1]):
        for d in range(count):
            r, difference = first + count * k + d, s[k, d] - c[0, d]
            by[0, r] = N[0, k] * difference
            for a in range(1, 3):
                by[a, r] = W * (N[a, k] * difference - N[0, k] * c[a, d])


@kernel
def weigh_master_force(W, L, c, first, by):
    """F_lc = -N^m_l c_c, with the field ``c`` (3, b)."""
    count = c.shape[1]
    for l in range(L.shape[1]):
        for d in range(count):
            r = first + count * l + d
            by[0, r] = -L[0, l] * c[0, d]
            for a in range(1, 3):
                by[a, r], by[2 + a, r] = -W * L[0, l] * c[a, d], -W * L[a, l] * c[0, d]


@kernel
def weigh_gap(W, N, Phi, g, slopes, of_nodes, gamma, first, by):
    """F_j = N_j gamma_j + Phi_j (g - gamma), with ``of_nodes`` gamma_j (K,) and ``gamma`` (3,).

    ``slopes`` (4,) are the derivatives of g by xi and eta.
    """
    difference = g - gamma[0]
    for j in range(N.shape[1]):
        r = first + j
        by[0, r] = N[0, j] * of_nodes[j] + Phi[0, j] * difference
        for a in range(1, 3):
            slope = slopes[a - 1] - gamma[a]
            by[a, r] = W * (N[a, j] * of_nodes[j] + Phi[a, j] * difference + Phi[0, j] * slope)
            by[2 + a, r] = W * Phi[0, j] * slopes[1 + a]


@kernel
def weigh_vector(W, N, Phi, q, v, y, first, by):
    """F_jb = N_j q_jb + Phi_j (v_b - y_b), with ``q`` (K, b) and the fields ``v``, ``y`` (3, b)."""
    count = v.shape[1]
    for j in range(N.shape[1]):
        for d in range(count):
            r, difference = first + count * j + d, v[0, d] - y[0, d]
            by[0, r] = N[0, j] * q[j, d] + Phi[0, j] * difference
            for a in range(1, 3):
                by[a, r] = W * (N[a, j] * q[j, d] + Phi[a, j] * difference + Phi[0, j] * v[a, d])
                by[2 + a, r] = -W * Phi[0, j] * y[a, d]
