# SPDX-License-Identifier: MIT
"""Factors of the derivatives of W, xi and eta of a point in those of its contributions W F.

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
