# SPDX-License-Identifier: MIT
"""Multiplier functions of a partly covered facet, and the functions that weight its gap.

===========  ====================================================================  ===========
symbol       meaning                                                               shape
===========  ====================================================================  ===========
T            functions on the covered part S of the facet that span the shape      (K,)
             functions: powers in the plane, which stay independent on a small S
B            coefficients of the shape functions, N = B T                          (K, K)
G            mass matrix int T_p T_q dgamma over S, packed: G[index[p, q]]         (m,)
d            int N_j dgamma over S                                                 (K,)
H            hand-over: H[i, j] is the fraction of function j added to that of i   (K, K)
C            coefficients of the multiplier functions, Phi = C T                   (K, K)
C_g          coefficients of the functions that weight the gap                     (K, K)
..._dG       derivatives with respect to G; m = K (K + 1) / 2                      (..., m)
===========  ====================================================================  ===========

The bases are

    standard   C = H B
    dual       C = H E,  E_j = d_j T(node j) G^-1:

the integral of E_j times a function of the span of T is d_j times its value at node j. The dual
functions are therefore biorthogonal to N on S for any S and J, and sum to one ("consistent" dual
basis: Cichosz & Bischoff 2011; Popp, Seitz, Gee & Wall 2013). D and M are sums over the same
quadrature points, those of the segments: contact forces of both sides balance to rounding. If these
points are the nodes of a facet, both bases coincide and D is diagonal.

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

T is fixed at the positions of an evaluation, since Phi does not depend on its choice. All
derivatives follow from those of G, with coefficients computed once per facet, and from that of p.
"""

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import copy_row, copy_rows

DUAL, STANDARD = range(2)
# Functions that weight the gap, see above
BY_BASIS, BY_COVER, BY_STANDARD = range(3)


@kernel
def packed_index(index):
    """Fill ``index`` (K, K), the places of the entries of a symmetric matrix in a packed one."""
    place = 0
    for p in range(index.shape[0]):
        for q in range(p, index.shape[0]):
            index[p, q] = index[q, p] = place
            place += 1


@kernel
def integrate_shapes(B, index, G, d, d_dG):
    """Fill ``d`` (K,), the integrals of N = B T, and ``d_dG`` (K, m); sum_k N_k is one."""
    count = d.size
    d_dG[:] = 0.0
    for j in range(count):
        d[j] = 0.0
        for q in range(count):
            one = 0.0
            for k in range(count):
                one += B[k, q]
            for p in range(count):
                d_dG[j, index[p, q]] += B[j, p] * one
                d[j] += B[j, p] * one * G[index[p, q]]


@kernel
def invert_mass(index, G, work, inverse):
    """Fill ``inverse`` (K, K) of the mass matrix by Gauss-Jordan elimination.

    No pivoting: the matrix is positive definite. ``work`` (K, K) is overwritten.
    """
    size = inverse.shape[0]
    for i in range(size):
        for k in range(size):
            work[i, k] = G[index[i, k]]
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
def dual_function(at, index, d, d_dG, inverse, E, E_dG):
    """Fill ``E`` (K,) = d T G^-1 with T = ``at`` (K,), and ``E_dG`` (K, m); ``d_dG`` (m,)."""
    count = E.size
    for p in range(count):
        value = 0.0 * d
        for q in range(count):
            value += at[q] * inverse[q, p]
        E[p] = d * value
        for q in range(d_dG.size):
            E_dG[p, q] = value * d_dG[q]
    for a in range(count):
        for b in range(count):
            for p in range(count):
                E_dG[p, index[a, b]] -= E[a] * inverse[b, p]


@kernel
def receives_share(weights, d, i, j):
    """Whether node i receives a share below one of the function of node j.

    ``weights`` = H (K, K); ``d`` (K,).
    """
    return 0.0 < weights[i, j] < 1.0 and d[i].real > 0.0


@kernel
def hand_over(j, weights, d, d_dG, E, E_dG, C, C_dG, D, D_dG):
    """Add the shares of node ``j``'s function ``E`` (K,) to C; fill column j of D.

    ``d_dG`` (K, m), ``D_dG`` (K K, m).
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
        for q in range(d_dG.shape[1]):
            h_dG = 0.0 * total
            if shared and receives_share(weights, d, i, j):
                for k in range(count):
                    if receives_share(weights, d, k, j):
                        h_dG += ((1.0 if i == k else 0.0) - h) * d_dG[k, q] / total
            D_dG[count * i + j, q] = h * d_dG[j, q] + h_dG * d[j]
            for p in range(count):
                C_dG[i, p, q] += h * E_dG[p, q] + h_dG * E[p]


@kernel
def dual_multipliers(at_nodes, index, weights, d, d_dG, inverse, C, C_dG, D, D_dG, E, E_dG):
    """Fill C (K, K), D (K, K) and their derivatives with respect to G for the dual basis.

    ``at_nodes`` (K, K): T at the nodes; ``weights`` = H (K, K); ``inverse`` (K, K) that of the mass
    matrix; ``E`` (K,) and ``E_dG`` (K, m) are overwritten.
    """
    C[:] = 0.0
    C_dG[:] = 0.0
    for j in range(d.size):
        dual_function(at_nodes[j], index, d[j], d_dG[j], inverse, E, E_dG)
        hand_over(j, weights, d, d_dG, E, E_dG, C, C_dG, D, D_dG)


@kernel
def standard_multipliers(weights, index, G, B, C, C_dG, D, D_dG):
    """Fill C (K, K), D (K, K) and their derivatives with respect to G for the standard basis.

    ``weights`` = H (K, K); shapes of derivatives: C_dG (K, K, m), D_dG (K K, m).
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
                    D_dG[count * i + k, index[p, r]] += C[i, p] * B[k, r]
                    D[i, k] += C[i, p] * B[k, r] * G[index[p, r]]


@kernel
def weigh_gap(kinds, beyond, T_edges, index, weights, B, d, d_dG, inverse, C, C_dG, C_g, C_g_dG,
              C_g_dp):  # fmt: skip
    """Fill ``C_g``, its derivatives ``C_g_dG``, and ``C_g_dp`` (K, K) by the edge at each node.

    ``kinds`` = (basis, weights of the gap); ``beyond`` (K,): edge of S beyond which each node lies,
    -1 for none; ``T_edges`` (2, 2, K): T at both edges, and its derivative.
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
        edge = beyond[j]
        if basis == STANDARD or by == BY_BASIS or (by == BY_COVER and edge < 0):
            continue
        if by == BY_COVER and count == 2 and whole:
            dual_function(T_edges[edge, 0], index, d[j], d_dG[j], inverse, C_g[j], C_g_dG[j])
            for q in range(count):
                for p in range(count):
                    C_g_dp[j, q] += d[j] * T_edges[edge, 1, p] * inverse[p, q]
            continue
        C_g_dG[j] = 0.0
        for q in range(count):
            C_g[j, q] = 0.0
            for r in range(count):
                C_g[j, q] += weights[j, r] * B[r, q]
