# SPDX-License-Identifier: MIT
"""Multiplier functions of a partly covered facet, and the functions that weigh its gap.

===========  ====================================================================  ===========
symbol       meaning                                                               shape
===========  ====================================================================  ===========
T            1, t, ..., t^(K - 1) with t = (xi - middle) / half: a basis on the    (K,)
             covered part S of the facet, whose ends are at t = -1 and 1
G            moments int t^p dgamma over S, p = 0 ... 2 K - 2; the mass matrix     (2 K - 1,)
             of T has the entries G[p + q]
B            coefficients of the shape functions, N = B T, zero from K on           (K, 2 K - 1)
d            int N_j dgamma over S, B G                                            (K,)
H            weights by which nodes take over functions of others                  (K, K)
C            coefficients of the multiplier functions, Phi = C T                   (K, K)
C_g          those of the functions that weigh the gap                             (K, K)
..._dG       derivatives by G                                                      (..., 2 K - 1)
===========  ====================================================================  ===========

The bases are

    standard   C = H B
    dual       C = H E,  E_j = d_j T(xi_j) G^-1:

E_j is d_j times the polynomial that gives, integrated with any other one, its value at node j. So
the dual functions are biorthogonal to N on S, whatever S and J; their sum is one ("consistent":
Cichosz & Bischoff 2011; Popp, Seitz, Gee & Wall 2013). All integrals are sums over the points of
the segments, in D as in M, so that the forces of both sides balance to the last digit. With points
at the two nodes of a facet both bases are one, and D is diagonal.

A node without multiplier hands its function to its neighbours on the facet: the columns of H sum to
one. Dual functions are shared in proportion to d_j, so that a neighbour whose d_j vanishes gets
nothing and may be left out without a jump. If only the ends of a quadratic facet carry multipliers,
they have the linear functions, (1 -+ xi) / 2: those are N_j + N_m / 2 with the standard basis, and
Phi_j + Phi_m / 2 with the dual one where J is even and the cover full.

The gap of node j is weighted by Phi_j ("by basis"), by N_j ("by standard": Petrov-Galerkin, Popp,
Seitz, Gee & Wall 2013), or "by cover": by Phi_j if the node is covered. The dual function of a node
beyond the edge continues the gap from S to the node, where there is no master. On a facet of two
nodes that both have multipliers the gap is evaluated at the edge p of S instead, by the function

    Psi_j = d_j T(p) G^-1 T,

and on other facets it is weighted by N_j. All of these have the integral d_j.

T is fixed: ``middle`` and ``half`` are numbers, for Phi does not depend on them. All derivatives
follow from those of G, by scalars that are computed once for a facet, and from that of p.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.shapes import tabulate_shapes

DUAL, STANDARD = 0, 1
# What weighs the gap, see above
BY_BASIS, BY_COVER, BY_STANDARD = 0, 1, 2


@kernel
def outermost(ends):
    """The segments with the lower and the upper end of the cover: segments may have no length."""
    first, last = 0, 0
    for i in range(1, ends.shape[0]):
        first = i if ends[i, 0].real < ends[first, 0].real else first
        last = i if ends[i, 1].real > ends[last, 1].real else last
    return first, last


@kernel
def shape_coefficients(place, G, B, d):
    """Fill ``B`` (K, K first columns), by Taylor's formula at the middle, and ``d`` = B G."""
    low, high = place
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
    """Fill ``inverse`` of the mass matrix G[p + q] (K, K), by Gauss and Jordan."""
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
    """Fill ``E`` (K,) = d T(t) G^-1 and its derivative; ``shape`` (2 K - 1,) = dd/dG."""
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
def takes(weights, d, i, j):
    """Whether node i takes a fraction of the function of node j, which others take, too."""
    return 0.0 < weights[i, j] < 1.0 and d[i].real > 0.0


@kernel
def hand_over(j, weights, B, d, E, E_dG, C, C_dG, D, D_dG):
    """Add what nodes take of the function ``E`` (K,) of node ``j``; fill column j of D."""
    count = d.size
    total = 0.0 * d[0]
    for i in range(count):
        if takes(weights, d, i, j):
            total += d[i]
    shared = total.real > 0.0
    for i in range(count):
        h = weights[i, j] + 0.0 * total
        if shared:
            h = d[i] / total if takes(weights, d, i, j) else 0.0 * total
        D[i, j] = h * d[j]
        for p in range(count):
            C[i, p] += h * E[p]
        for q in range(B.shape[1]):
            h_dG = 0.0 * total
            if shared and takes(weights, d, i, j):
                for k in range(count):
                    if takes(weights, d, k, j):
                        h_dG += ((1.0 if i == k else 0.0) - h) * B[k, q] / total
            D_dG[count * i + j, q] = h * B[j, q] + h_dG * d[j]
            for p in range(count):
                C_dG[i, p, q] += h * E_dG[p, q] + h_dG * E[p]


@kernel
def dual_multipliers(place, weights, B, d, inverse, work, C, C_dG, D, D_dG):
    """Fill C, D and their derivatives for the dual basis; ``work`` = (E (K,), E_dG)."""
    E, E_dG = work
    count = d.size
    low, high = place
    C[:] = 0.0
    C_dG[:] = 0.0
    for j in range(count):
        xi = 2.0 * j / (count - 1.0) - 1.0
        t = (2.0 * xi - low - high) / (high - low)
        dual_function(t, d[j], B[j], inverse, E, E_dG)
        hand_over(j, weights, B, d, E, E_dG, C, C_dG, D, D_dG)


@kernel
def standard_multipliers(weights, G, B, C, C_dG, D, D_dG):
    """Fill C, D and their derivatives for the standard basis."""
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
def edge_beyond(j, count, place):
    """The edge next to node ``j`` if it lies beyond: -1 the lower one, 1 the upper one, else 0."""
    xi = 2.0 * j / (count - 1.0) - 1.0
    if xi < place[0]:
        return -1
    return 1 if xi > place[1] else 0


@kernel
def weigh_gap(kinds, place, edges, weights, B, d, inverse, C, C_dG, C_g, C_g_dG, C_g_dp):
    """Fill ``C_g``, its derivatives by G and, ``C_g_dp`` (K, K), by the edge next to each node.

    ``kinds`` = (basis, what weighs the gap); ``edges``: ends of the cover, ``place`` as numbers.
    """
    basis, by = kinds
    count = d.size
    whole = True
    for j in range(count):
        whole = whole and weights[j, j] == 1.0
    C_g_dp[:] = 0.0
    for j in range(count):
        C_g[j] = C[j]
        C_g_dG[j] = C_dG[j]
        edge = edge_beyond(j, count, place)
        if basis == STANDARD or by == BY_BASIS or (by == BY_COVER and edge == 0):
            continue
        if by == BY_COVER and count == 2 and whole:
            p = edges[0] if edge < 0 else edges[1]
            t = (2.0 * p - place[0] - place[1]) / (place[1] - place[0])
            dual_function(t, d[j], B[j], inverse, C_g[j], C_g_dG[j])
            for q in range(count):
                C_g_dp[j, q] = d[j] * inverse[1, q] * 2.0 / (place[1] - place[0])
            continue
        C_g_dG[j] = 0.0
        for q in range(count):
            C_g[j, q] = 0.0
            for r in range(count):
                C_g[j, q] += weights[j, r] * B[r, q]
