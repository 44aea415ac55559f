# SPDX-License-Identifier: MIT
"""D, M, the weighted gap and their derivatives on slave facets; Jacobian determinants of cells.

Each point has its weight W, gap g and coordinates xi on the slave and eta on the master facet, in a
surface of any dimension, and the derivatives of these s numbers. They come from the facets of two
surfaces, see ``points``, or from a signed distance, see ``interface.on_obstacle``.

There are two passes over the points of a facet. The first one computes the moments of the covered
part, which determine the multiplier functions; the second one the derivatives of all integrals:

    dG_pq = sum [ dW T_p T_q + W (T_p,a T_q + T_p T_q,a) dxi_a ]
    dM_jl = sum [ dW Phi_j L_l + W Phi_j,a L_l dxi_a + W Phi_j L_l,a deta_a ] + dC_jp int T_p L_l
    dg_j  = sum [ dW Psi_j g + W Psi_j,a g dxi_a + W Psi_j dg ] + dC_g,jp int T_p g

=========  =========================================================================  ===========
symbol     meaning                                                                    shape
=========  =========================================================================  ===========
T, L       functions on the slave facet, and shape functions of the                   (1 + a, K),
           master facet, with their derivatives by xi_a and eta_a                     (1 + a, K')
rows       derivatives of xi_a, W, eta_a and g of a point, in this order              (s, C)
T_M, T_g   moments int T_p L_l dgamma, int T_p g dgamma                               (K, K'), (K,)
Phi, Psi   multiplier functions C T, functions C_g T that weight the gap              (K,)
=========  =========================================================================  ===========

If the multiplier functions of a facet vary with its segments, M on segment i has derivatives with
respect to the nodes of each segment k: hence the pairs (i, k). They vary on curved facets, as J
does, and where the facet is partly covered and an end of the cover moves. Otherwise the sum of
these terms over the segments is zero, and they are left out.

**Multiplier functions.** Those of a partly covered facet, and the functions that weight its gap,
follow from the moments of the first pass:

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

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import add_row, copy_row, copy_rows

DUAL, STANDARD = range(2)
# Functions that weight the gap, see the module
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


@kernel
def add_moments(q, values, T, L, index, G, T_M, i, T_g):
    """Add the contributions of point q to the moments ``G`` (m,), ``T_M[i]`` and ``T_g``."""
    for p in range(T_g.size):
        weighted = values[q, 0] * T[q, 0, p]
        T_g[p] += weighted * values[q, 1]
        for r in range(p, T_g.size):
            G[index[p, r]] += weighted * T[q, 0, r]
        for l in range(L.shape[2]):
            T_M[i, p, l] += weighted * L[q, 0, l]


@kernel
def evaluate(C, T, q, values):
    """Fill ``values`` (1 + a, K) of the functions C T at point q, and their derivatives."""
    for order in range(T.shape[1]):
        for j in range(C.shape[0]):
            total = 0.0 * C[j, 0]
            for p in range(C.shape[1]):
                total += C[j, p] * T[q, order, p]
            values[order, j] = total


@kernel
def weigh_rows(q, values, T, L, Phi, Psi, by):
    """Fill the factors ``by`` (r, s) of the rows of point q in the derivatives of G, M and g.

    ``Phi`` and ``Psi`` are values and derivatives at the point, (1 + a, K) each.
    """
    count, axes, r = T.shape[2], T.shape[1] - 1, 0
    W, gap = values[q, 0], values[q, 1]
    for p in range(count):
        for o in range(p, count):
            by[r, axes] = T[q, 0, p] * T[q, 0, o]
            for a in range(axes):
                by[r, a] = W * (T[q, 1 + a, p] * T[q, 0, o] + T[q, 0, p] * T[q, 1 + a, o])
            r += 1
    for j in range(count):
        for l in range(L.shape[2]):
            by[r, axes] = Phi[0, j] * L[q, 0, l]
            for a in range(axes):
                by[r, a] = W * Phi[1 + a, j] * L[q, 0, l]
                by[r, axes + 1 + a] = W * Phi[0, j] * L[q, 1 + a, l]
            r += 1
    for j in range(count):
        by[r, axes], by[r, 2 * axes + 1] = Psi[0, j] * gap, W * Psi[0, j]
        for a in range(axes):
            by[r, a] = W * Psi[1 + a, j] * gap
        r += 1


@kernel
def add_weighted(by, rows, q, out):
    """Add ``by`` (r, s) times ``rows[q]`` (s, C) to ``out`` (r, C).

    Loops over four scalars, as in the plane, or over two at a time are the fastest.
    """
    for r in range(out.shape[0]):
        total = out[r]
        if rows.shape[1] == 4:
            a, b, c, d = by[r, 0], by[r, 1], by[r, 2], by[r, 3]
            by_xi, by_W, by_eta, by_g = rows[q, 0], rows[q, 1], rows[q, 2], rows[q, 3]
            for k in range(total.size):
                total[k] += a * by_xi[k] + b * by_W[k] + c * by_eta[k] + d * by_g[k]
        else:
            for s in range(0, rows.shape[1], 2):
                a, b, one, other = by[r, s], by[r, s + 1], rows[q, s], rows[q, s + 1]
                for k in range(total.size):
                    total[k] += a * one[k] + b * other[k]


@kernel
def add_product(A, B, out):
    """Add the matrix product A (r, c) B (c, k) to ``out`` (r, k)."""
    for r in range(A.shape[0]):
        for c in range(A.shape[1]):
            add_row(A[r, c], B[c], out[r])


@kernel
def apply_functions(C, C_dG, T_M, M, M_dG):
    """Fill M (K, K') = C T_M and its derivative with respect to G, (K K', m)."""
    others = M.shape[1]
    M_dG[:] = 0.0
    for j in range(M.shape[0]):
        for l in range(others):
            M[j, l] = 0.0
            for p in range(C.shape[0]):
                M[j, l] += C[j, p] * T_M[p, l]
                add_row(T_M[p, l], C_dG[j, p], M_dG[others * j + l])


@kernel
def apply_to_gap(C_g, C_g_dG, C_g_dp, T_g, g, g_dG, g_dp):
    """Fill g (K,) = C_g T_g and its derivatives by G, (K, m), and by the edges, (K,)."""
    g_dG[:] = 0.0
    for j in range(g.size):
        g[j], g_dp[j] = 0.0, 0.0
        for p in range(g.size):
            g[j] += C_g[j, p] * T_g[p]
            g_dp[j] += C_g_dp[j, p] * T_g[p]
            add_row(T_g[p], C_g_dG[j, p], g_dG[j])


@kernel
def facet_work(most, count, others, example):
    """Arrays that ``integrate_facet`` overwrites, for at most ``most`` segments of a facet.

    ``example`` (p, s, C): rows of points, which have the kind and the number of columns.
    """
    kind, scalars, columns = example.dtype, example.shape[1], example.shape[2]
    size = count * (count + 1) // 2
    index = np.empty((count, count), np.int64)
    packed_index(index)
    total = size + count * others + count
    of_functions = (
        np.empty((count, count), kind), np.empty((count, count), kind),
        np.empty((count, count), kind), np.empty((count, count), kind),
        np.empty((count, count), kind), np.empty((count, count, size), kind),
        np.empty((count, count, size), kind), np.empty((count**2, size), kind),
        np.empty((count, size), kind),
    )  # fmt: skip
    of_moments = (
        np.empty(size, kind), np.empty(count, kind), np.empty((count, size)),
        np.empty((most, count, others), kind), np.empty(count, kind),
        np.empty((most, count * others, size), kind), np.empty((most, size, columns), kind),
        np.empty(count, kind),
    )  # fmt: skip
    of_points = (
        np.empty((scalars // 2, count), kind), np.empty((scalars // 2, count), kind),
        np.zeros((total, scalars), kind), np.empty((total, columns), kind),
    )  # fmt: skip
    return index, of_functions, of_moments, of_points


@kernel
def integrate_facet(points, functions, edges, H, partial, kinds, work, values, derivatives):
    """D, M, the weighted gap and their derivatives on one facet with n > 0 segments.

    Args:
        points: (W and g (p, 2); rows (p, s, C); T (p, 1 + a, K); L (p, 1 + a, K'); points of
            segment i are those from the i-th to the next of (n + 1,)).
        functions: (B (K, K), T at the nodes (K, K)).
        edges: (edge of S beyond which each node lies (K,), -1 for none; segments at both edges
            (2,); T at the edges (2, 2, K); rows of xi of the edges (2, C)).
        H: Hand-over, shape (K, K).
        partial: Whether the multiplier functions vary with the segments.
        kinds: (basis, weights of the gap).
        work: See ``facet_work``.
        values: (D (K, K), M (n, K, K'), g (K,), cover (K,)) [length], g [length^2]; filled.
        derivatives: (dD (n, K K, C) [1], dM (pairs, K K', C) [1], dg (n, K, C) [length]); filled.
            The pairs (i, k) of segments are all with k running fastest if the facet is partial,
            else only i = k.
    """
    point_values, rows, T, L, starts = points
    (B, at_nodes), (beyond, at_edge, T_edges, edge_rows) = functions, edges
    index, of_functions, of_moments, (Phi, Psi, by, out) = work
    C, C_g, C_g_dp, inverse, scratch, C_dG, C_g_dG, D_dG, g_dG = of_functions
    G, d, d_dG, T_M, T_g, M_dG, dG, g_dp = of_moments
    D, M, g, cover = values
    dD, dM, dg = derivatives
    number, count, size = M.shape[0], g.size, G.size
    G[:] = 0.0
    T_g[:] = 0.0
    for i in range(number):
        T_M[i] = 0.0
        for q in range(starts[i], starts[i + 1]):
            add_moments(q, point_values, T, L, index, G, T_M, i, T_g)
    integrate_shapes(B, index, G, d, d_dG)
    if kinds[0] == DUAL:
        invert_mass(index, G, scratch, inverse)
        C[:] = 0.0
        C_dG[:] = 0.0
        for j in range(count):
            dual_function(at_nodes[j], index, d[j], d_dG[j], inverse, g_dp, g_dG)
            hand_over(j, H, d, d_dG, g_dp, g_dG, C, C_dG, D, D_dG)
    else:
        standard_multipliers(H, index, G, B, C, C_dG, D, D_dG)
    weigh_gap(
        kinds, beyond, T_edges, index, H, B, d, d_dG, inverse, C, C_dG, C_g, C_g_dG, C_g_dp
    )  # fmt: skip
    copy_row(d, cover)
    apply_to_gap(C_g, C_g_dG, C_g_dp, T_g, g, g_dG, g_dp)
    step, of_g = number + 1 if partial else 1, out.shape[0] - count
    for i in range(number):
        apply_functions(C, C_dG, T_M[i], M[i], M_dG[i])
        out[:] = 0.0
        for q in range(starts[i], starts[i + 1]):
            evaluate(C, T, q, Phi)
            evaluate(C_g, T, q, Psi)
            weigh_rows(q, point_values, T, L, Phi, Psi, by)
            add_weighted(by, rows, q, out)
        copy_rows(out[:size], size, dG[i], 0)
        copy_rows(out[size:of_g], of_g - size, dM[i * step], 0)
        copy_rows(out[of_g:], count, dg[i], 0)
        dD[i] = 0.0
        add_product(D_dG, dG[i], dD[i])
    if not partial:
        return
    for k in range(number):
        add_product(g_dG, dG[k], dg[k])
        for i in range(number):
            if i != k:
                dM[i * number + k] = 0.0
            add_product(M_dG[i], dG[k], dM[i * number + k])
    for j in range(count):
        if g_dp[j] != 0.0:
            add_row(g_dp[j], edge_rows[beyond[j]], dg[at_edge[beyond[j]], j])


@kernel
def integrate_whole_facets(points, H, kinds, values, derivatives):
    """As ``integrate_facet``, for f fully covered facets of one segment each, with T = N.

    Args:
        points: (W and g (f, p, 2); rows (f, p, s, C); T (p, 1 + a, K)).
        H: Hand-over, shape (f, K, K).
        kinds: (basis, weights of the gap).
        values: (D (f, K, K), g (f, K), cover (f, K)); filled.
        derivatives: (dD (f, K K, C), dg (f, K, C)); filled.
    """
    point_values, rows, T = points
    D, g, cover = values
    dD, dg = derivatives
    kind, count, columns = rows.dtype, H.shape[1], rows.shape[3]
    none, starts, one = np.empty((1, count, 0), kind), np.array([0, T.shape[0]]), np.eye(count)
    L, no_derivatives = np.empty((T.shape[0], T.shape[1], 0), kind), np.empty((1, 0, columns), kind)
    edges = (
        np.full(count, -1), np.zeros(2, np.int64), np.empty((2, 2, count), kind),
        np.empty((2, columns), kind),
    )  # fmt: skip
    for e in range(H.shape[0]):
        if e == 0:
            work = facet_work(1, count, 0, rows[0])
        integrate_facet(
            (point_values[e], rows[e], T, L, starts), (one, one), edges, H[e], True, kinds, work,
            (D[e], none, g[e], cover[e]), (dD[e : e + 1], no_derivatives, dg[e : e + 1]),
        )  # fmt: skip


@kernel
def tabulate_volumes(x, cells, gradients, volumes):
    """Fill ``volumes`` (cells, p) with the determinant of dx/dX at p points of each cell.

    The points are nodes or quadrature points of cells of the plane or of space. At a corner of a
    straight cell of the plane this is twice the area of the triangle of its two edges there.

    Args:
        x: Positions of all nodes, shape (n, dim) [length].
        cells: Nodes of each cell, shape (cells, k).
        gradients: Gradients in the reference cell: [a, b] is that of shape function b at point a,
            shape (p, k, dim) [1].
        volumes: Determinants, shape (cells, p) [length^dim]; filled.
    """
    for e in range(cells.shape[0]):
        for a in range(gradients.shape[0]):
            volumes[e, a] = _volume(x, cells, gradients, e, a)


@kernel
def keep_volume(before, after, cells, gradients, undeformed, fraction, examined):
    """Whether every cell keeps a fraction of its area or volume at p of its points in a motion.

    Args:
        before: Positions of all nodes, shape (n, dim) [length].
        after: Positions after the motion, shape (n, dim) [length].
        cells: Nodes of each cell, shape (cells, k).
        gradients: See ``tabulate_volumes``, shape (p, k, dim) [1].
        undeformed: Determinants in the reference state, nan where they are not examined, (cells, p)
            [length^dim].
        fraction: Smallest determinant after over that before, which counts as zero if negative [1].
        examined: Ratio of present to undeformed determinant below which a point is not examined
            [1].
    """
    for e in range(cells.shape[0]):
        for a in range(gradients.shape[0]):
            ratio = _volume(before, cells, gradients, e, a) / undeformed[e, a]
            if ratio < examined:
                continue
            allowed = fraction * (0.0 if ratio < 0.0 else ratio)
            if _volume(after, cells, gradients, e, a) / undeformed[e, a] < allowed:
                return False
    return True


@kernel
def _volume(x, cells, gradients, e, a):
    """Determinant of dx/dX of cell ``e`` at its point ``a``; see ``tabulate_volumes``."""
    if x.shape[1] == 2:
        return _area(x, cells, gradients, e, a)
    x0, y0, z0 = x[cells[e, 0], 0], x[cells[e, 0], 1], x[cells[e, 0], 2]
    xs = xt = xr = ys = yt = yr = zs = zt = zr = 0.0
    for b in range(1, cells.shape[1]):
        node = cells[e, b]
        dx, dy, dz = x[node, 0] - x0, x[node, 1] - y0, x[node, 2] - z0
        s, t, r = gradients[a, b, 0], gradients[a, b, 1], gradients[a, b, 2]
        xs, xt, xr = xs + s * dx, xt + t * dx, xr + r * dx
        ys, yt, yr = ys + s * dy, yt + t * dy, yr + r * dy
        zs, zt, zr = zs + s * dz, zt + t * dz, zr + r * dz
    return xs * (yt * zr - yr * zt) + xt * (yr * zs - ys * zr) + xr * (ys * zt - yt * zs)


@kernel
def _area(x, cells, gradients, e, a):
    """As ``_volume``, in the plane."""
    x0, y0 = x[cells[e, 0], 0], x[cells[e, 0], 1]
    xs = xt = ys = yt = 0.0
    for b in range(1, cells.shape[1]):
        dx, dy = x[cells[e, b], 0] - x0, x[cells[e, b], 1] - y0
        s, t = gradients[a, b, 0], gradients[a, b, 1]
        xs, xt = xs + s * dx, xt + t * dx
        ys, yt = ys + s * dy, yt + t * dy
    return xs * yt - xt * ys
