# SPDX-License-Identifier: MIT
"""Multiplier functions of a partly covered facet, and the functions that weight its gap.

===========  ====================================================================  ===========
symbol       meaning                                                               shape
===========  ====================================================================  ===========
T            1, t, ..., t^(K - 1) with t = (xi - middle) / half: a basis on the    (K,)
             covered part S of the facet, which is -1 <= t <= 1
G            moments int t^p dgamma over S, p = 0 ... 2 K - 2; the mass matrix     (2 K - 1,)
             of T has the entries G[p + q]
B            coefficients of the shape functions, N = B T; zero from column K on    (K, 2 K - 1)
d            int N_j dgamma over S, d = B G                                        (K,)
H            hand-over: H[i, j] is the fraction of function j added to that of i   (K, K)
C            coefficients of the multiplier functions, Phi = C T                   (K, K)
C_g          coefficients of the functions that weight the gap                     (K, K)
..._dG       derivatives with respect to G                                         (..., 2 K - 1)
===========  ====================================================================  ===========

The bases are

    standard   C = H B
    dual       C = H E,  E_j = d_j T(xi_j) G^-1:

the integral of E_j times a polynomial of degree K - 1 is d_j times the polynomial at node j. The
dual functions are therefore biorthogonal to N on S for any S and J, and sum to one ("consistent"
dual basis: Cichosz & Bischoff 2011; Popp, Seitz, Gee & Wall 2013). D and M are sums over the same
quadrature points, those of the segments: contact forces of both sides balance to rounding. If these
points are the two nodes of a facet, both bases coincide and D is diagonal.

The function of a node without multiplier is handed over to other nodes of the facet: each column of
H sums to one. Dual functions are shared in proportion to d_j: a neighbour with d_j = 0 receives no
share, and its facet can be dropped without a jump. If only the ends of a quadratic facet carry
multipliers, with the inner node m, the functions are the linear ones, (1 -+ xi) / 2: N_j + N_m / 2
in the standard basis, and Phi_j + Phi_m / 2 in the dual one for full cover and even J.

The gap at node j is weighted by Phi_j ("by basis"), by N_j ("by standard": Petrov-Galerkin, Popp,
Seitz, Gee & Wall 2013), or "by cover": by Phi_j if the node is covered. The dual function of a node
beyond the edge of S extrapolates the gap from S to the node, where there is no master. On two-node
facets with multipliers at both nodes, the gap is evaluated at the edge p of S instead, by

    Psi_j = d_j T(p) G^-1 T,

and on other facets it is weighted by N_j. The integral of each of these functions is d_j.

T is fixed: ``middle`` and ``half`` have no derivatives, since Phi does not depend on them. All
derivatives follow from those of G, with coefficients computed once per facet, and from that of p.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.rows import copy_row, copy_rows
from fenics_mortar.kernels.shapes import tabulate_shapes

DUAL, STANDARD = range(2)
# Functions that weight the gap, see above
BY_BASIS, BY_COVER, BY_STANDARD = range(3)


@kernel
def outermost(ends):
    """Indices of the segments at the lower and the upper end of the cover.

    ``ends`` (s, 2), s > 0. These need not be the first and the last segment, as segments can have
    zero length.
    """
    first, last = 0, 0
    for i in range(1, ends.shape[0]):
        first = i if ends[i, 0].real < ends[first, 0].real else first
        last = i if ends[i, 1].real > ends[last, 1].real else last
    return first, last


@kernel
def shape_coefficients(bounds, G, B, d):
    """Fill ``d`` = B G and the first K columns of ``B``: Taylor coefficients at the middle of S.

    ``bounds`` = (lower end, upper end) of S in xi.
    """
    low, high = bounds
    count = d.size
    N = np.empty((3, count))
    tabulate_shapes(0.5 * (low + high), N)
    for j in range(count):
        scale, d[j] = 1.0, 0.0
        for p in range(count):
            B[j, p] = N[p, j] * scale
            d[j] += B[j, p] * G[p]
            scale *= 0.5 * (high - low) / (p + 1.0)


@kernel
def invert_mass(G, work, inverse):
    """Fill ``inverse`` (K, K) of the mass matrix G[p + q] by Gauss-Jordan elimination.

    No pivoting: the matrix is positive definite. ``work`` (K, K) is overwritten.
    """
    size = inverse.shape[0]
    for i in range(size):
        for k in range(size):
            work[i, k] = G[i + k]
            inverse[i, k] = 1.0 if i == k else 0.0
    for i in range(size):
        pivot = work[i, i]
        for c in range(size):
            work[i, c] /= pivot
            inverse[i, c] /= pivot
        for r in range(size):
            if r != i:
                factor = work[r, i]
                for c in range(size):
                    work[r, c] -= factor * work[i, c]
                    inverse[r, c] -= factor * inverse[i, c]


@kernel
def dual_function(t, d, shape, inverse, E, E_dG):
    """Fill ``E`` (K,) = d T(t) G^-1 and ``E_dG`` (K, 2 K - 1); ``shape`` (2 K - 1,) is dd/dG."""
    count = E.size
    for p in range(count):
        value, T = 0.0 * d, 1.0 + 0.0 * t
        for q in range(count):
            value += T * inverse[q, p]
            T *= t
        E[p] = d * value
        for q in range(shape.size):
            E_dG[p, q] = value * shape[q]
    for a in range(count):
        for b in range(count):
            for p in range(count):
                E_dG[p, a + b] -= E[a] * inverse[b, p]


@kernel
def receives_share(weights, d, i, j):
    """Whether node i receives a share below one of the function of node j.

    ``weights`` = H (K, K); ``d`` (K,).
    """
    return 0.0 < weights[i, j] < 1.0 and d[i].real > 0.0


@kernel
def hand_over(j, weights, B, d, E, E_dG, C, C_dG, D, D_dG):
    """Add the shares of node ``j``'s function ``E`` (K,) to C; fill column j of D.

    ``D_dG`` has the shape (K K, 2 K - 1).
    """
    count = d.size
    total = 0.0 * d[0]
    for i in range(count):
        if receives_share(weights, d, i, j):
            total += d[i]
    shared = total.real > 0.0
    for i in range(count):
        h = weights[i, j] + 0.0 * total
        if shared:
            h = d[i] / total if receives_share(weights, d, i, j) else 0.0 * total
        D[i, j] = h * d[j]
        for p in range(count):
            C[i, p] += h * E[p]
        for q in range(B.shape[1]):
            h_dG = 0.0 * total
            if shared and receives_share(weights, d, i, j):
                for k in range(count):
                    if receives_share(weights, d, k, j):
                        h_dG += ((1.0 if i == k else 0.0) - h) * B[k, q] / total
            D_dG[count * i + j, q] = h * B[j, q] + h_dG * d[j]
            for p in range(count):
                C_dG[i, p, q] += h * E_dG[p, q] + h_dG * E[p]


@kernel
def dual_multipliers(bounds, weights, B, d, inverse, work, C, C_dG, D, D_dG):
    """Fill C (K, K), D (K, K) and their derivatives with respect to G for the dual basis.

    ``bounds`` = (lower end, upper end) of S; ``weights`` = H (K, K); ``inverse`` (K, K) that of the
    mass matrix; ``work`` = (E (K,), E_dG (K, 2 K - 1)), overwritten.
    """
    E, E_dG = work
    count = d.size
    low, high = bounds
    C[:] = 0.0
    C_dG[:] = 0.0
    for j in range(count):
        xi = 2.0 * j / (count - 1.0) - 1.0
        t = (2.0 * xi - low - high) / (high - low)
        dual_function(t, d[j], B[j], inverse, E, E_dG)
        hand_over(j, weights, B, d, E, E_dG, C, C_dG, D, D_dG)


@kernel
def standard_multipliers(weights, G, B, C, C_dG, D, D_dG):
    """Fill C (K, K), D (K, K) and their derivatives with respect to G for the standard basis.

    ``weights`` = H (K, K); shapes of derivatives: C_dG (K, K, 2 K - 1), D_dG (K K, 2 K - 1).
    """
    count = C.shape[0]
    C_dG[:] = 0.0
    D_dG[:] = 0.0
    for i in range(count):
        for p in range(count):
            C[i, p] = 0.0
            for j in range(count):
                C[i, p] += weights[i, j] * B[j, p]
        for k in range(count):
            D[i, k] = 0.0
            for p in range(count):
                for r in range(count):
                    D_dG[count * i + k, p + r] += C[i, p] * B[k, r]
                    D[i, k] += C[i, p] * B[k, r] * G[p + r]


@kernel
def edge_beyond(j, count, bounds):
    """Edge of S beyond which node ``j`` of ``count`` lies: -1 lower, 1 upper, 0 none.

    ``bounds`` = (lower end, upper end) of S in xi.
    """
    xi = 2.0 * j / (count - 1.0) - 1.0
    if xi < bounds[0]:
        return -1
    return 1 if xi > bounds[1] else 0


@kernel
def weigh_gap(kinds, bounds, edges, weights, B, d, inverse, C, C_dG, C_g, C_g_dG, C_g_dp):
    """Fill ``C_g``, its derivatives ``C_g_dG``, and ``C_g_dp`` by the edge next to each node.

    ``kinds`` = (basis, weights of the gap); ``edges`` are the ends of S, complex in a complex step;
    ``bounds`` are their real parts; ``C_g_dp`` has the shape (K, K).
    """
    basis, by = kinds
    count = d.size
    whole = True
    for j in range(count):
        whole = whole and weights[j, j] == 1.0
    C_g_dp[:] = 0.0
    for j in range(count):
        copy_row(C[j], C_g[j])
        copy_rows(C_dG[j], count, C_g_dG[j], 0)
        edge = edge_beyond(j, count, bounds)
        if basis == STANDARD or by == BY_BASIS or (by == BY_COVER and edge == 0):
            continue
        if by == BY_COVER and count == 2 and whole:
            p = edges[0] if edge < 0 else edges[1]
            t = (2.0 * p - bounds[0] - bounds[1]) / (bounds[1] - bounds[0])
            dual_function(t, d[j], B[j], inverse, C_g[j], C_g_dG[j])
            for q in range(count):
                C_g_dp[j, q] = d[j] * inverse[1, q] * 2.0 / (bounds[1] - bounds[0])
            continue
        C_g_dG[j] = 0.0
        for q in range(count):
            C_g[j, q] = 0.0
            for r in range(count):
                C_g[j, q] += weights[j, r] * B[r, q]
