# SPDX-License-Identifier: MIT
"""D, M, the weighted gap and all derivatives of slave facets with K = 2 or 3 nodes.

There are two passes over the segments of a facet. The first one computes the moments of the covered
part, which determine the multiplier functions; the second one the integrals and their derivatives.
For the symbols see ``basis`` and ``moments``.

If the multiplier functions of a facet vary with its segments, M on segment i has derivatives with
respect to the nodes of each segment k: hence the pairs (i, k). They vary on curved facets, as J
does, and where the facet is partly covered and an end of the cover moves. Otherwise the sum of
these terms over the segments is zero, and they are left out.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.basis import (
    DUAL,
    dual_multipliers,
    invert_mass,
    outermost,
    shape_coefficients,
    standard_multipliers,
    weigh_gap,
)
from fenics_mortar.kernels.moments import (
    add_product,
    chain_normals,
    integrate_derivatives,
    integrate_moments,
    thickness_at,
)
from fenics_mortar.kernels.projection import gather, interpolate, segment_ends
from fenics_mortar.kernels.rows import copy_row
from fenics_mortar.kernels.shapes import tabulate_shapes


@kernel
def gather_thickness(x, nodes, thickness, theta):
    """Fill ``theta`` (K,), the ``thickness`` at ``nodes`` (K,), [length]."""
    constant, by_x = thickness
    for i in range(nodes.size):
        theta[i] = constant[nodes[i]] + by_x * x[nodes[i], 0]


@kernel
def tabulate_covers(x, facets, ends, offsets, rule, cover, thickness=None):
    """Fill ``cover`` (f, K) with the integrals of N over the covered parts [length].

    ``x`` (n, 2), ``facets`` (f, K), ``ends`` (s, 2); others as in ``tabulate_facets``.
    """
    points, weights, spans = rule
    theta = np.empty(facets.shape[1])
    y, N = np.empty(6 * facets.shape[1]), np.empty((3, facets.shape[1]))
    cover[:] = 0.0
    for e in range(facets.shape[0]):
        gather(x, x, x, facets[e], facets[e], y)
        if thickness is not None:
            gather_thickness(x, facets[e], thickness, theta)
        for i in range(offsets[e], offsets[e + 1]):
            c, h = 0.5 * (ends[i, 0] + ends[i, 1]), 0.5 * (ends[i, 1] - ends[i, 0])
            for p in range(spans[i, 0], spans[i, 1]):
                tabulate_shapes(c + h * points[p], N)
                tx, ty = interpolate(y, 0, N, 1)
                J = np.sqrt(tx * tx + ty * ty)
                if thickness is not None:
                    J = J * thickness_at(theta, N, 0)
                for j in range(facets.shape[1]):
                    cover[e, j] += weights[p] * J * h * N[0, j]


@kernel
def apply_functions(C, C_dG, T_M, M, M_dG):
    """Fill M (K, K) = C T_M and its derivative with respect to G, (K K, 2 K - 1)."""
    count = C.shape[0]
    M_dG[:] = 0.0
    for j in range(count):
        for l in range(count):
            M[j, l] = 0.0
            for p in range(count):
                M[j, l] += C[j, p] * T_M[p, l]
                for q in range(M_dG.shape[1]):
                    M_dG[count * j + l, q] += C_dG[j, p, q] * T_M[p, l]


@kernel
def apply_to_gap(C_g, C_g_dG, C_g_dp, T_g, g, g_dG, g_dp):
    """Fill g (K,) = C_g T_g and its derivatives by G, (K, 2 K - 1), and by the edges, (K,)."""
    g_dG[:] = 0.0
    for j in range(g.size):
        g[j], g_dp[j] = 0.0, 0.0
        for p in range(g.size):
            g[j] += C_g[j, p] * T_g[p]
            g_dp[j] += C_g_dp[j, p] * T_g[p]
            for q in range(g_dG.shape[1]):
                g_dG[j, q] += C_g_dG[j, p, q] * T_g[p]


@kernel
def square(count, kind):
    """Uninitialized array (count, count)."""
    return np.empty((count, count), kind)


@kernel
def add_edge(g_dp, dend, dn_dx, nodes, row, dg):
    """Add the change of g by the motion ``dend`` (6 K,) of an edge to ``dg`` (8 K - 4,)."""
    chain_normals(dend, dn_dx, nodes, row)
    for q in range(row.size):
        dg[q] += g_dp * row[q]


@kernel
def tabulate_facets(
    geometry, facets, segments, offsets, pair_offsets, rule, options, values, thickness=None
):
    """Evaluate D, M, the weighted gap and their derivatives on all facets.

    Args:
        geometry: (x, n, dn_dx, m): slave positions, normals and their derivatives, master
            positions [length].
        facets: (slave nodes (f, K), weights H (f, K, K), partial (f,): whether the multiplier
            functions of a facet vary with its segments).
        segments: (master nodes (n, K), end_is_fixed (n, 2), ends (n, 2)).
        offsets: Segments of facet e are offsets[e]:offsets[e + 1], shape (f + 1,).
        pair_offsets: Pairs (i, k) of segments of facet e are pair_offsets[e]:pair_offsets[e + 1],
            shape (f + 1,): all pairs with k running fastest if it is partial, else only i = k.
        rule: (s (p,), w (p,), spans (n, 2)): points of segment i are spans[i, 0]:spans[i, 1].
        options: (basis, weights of the gap, whether the ends of segments have derivatives).
        values: (D (f, K, K), dD (n, K K, C), M (n, K, K), dM (pairs, K K, C), g (f, K), dg
            (n, K, C), cover (f, K)) with C = 8 K - 4 columns; filled. Rows of facets without
            segments are unchanged; dD and dM must be zero on entry. D, M, cover and dg are
            [length], g is [length^2], dD and dM are [1].
        thickness: (constant part at the slave nodes (n,) [length], derivative with respect to their
            first current coordinate [1]), linear between nodes; a factor of all integrals; by
            default 1.
    """
    x, n, dn_dx, m = geometry
    nodes, weights, partial = facets
    masters, end_is_fixed, found = segments
    points, point_weights, spans = rule
    basis, gap_weights, move_ends = options
    D, dD, M, dM, g, dg, cover = values
    kind, count, columns = x.dtype, nodes.shape[1], dD.shape[2]
    size, max_segments = 2 * count - 1, np.max(offsets[1:] - offsets[:-1]) if nodes.shape[0] else 0
    of_M, of_g, rows = size, size + count * count, size + count * count + count
    shapes = np.empty((3, count), kind), np.empty((3, count), kind)
    work = shapes, np.empty((4, 6 * count), kind), np.empty((rows, 4), kind)
    y, ends = np.empty((max_segments, 6 * count), kind), np.empty((max_segments, 2), kind)
    dends, by_y = np.empty((max_segments, 2, 6 * count), kind), np.empty((rows, 6 * count), kind)
    T_M = np.empty((max_segments, count, count), kind)
    G, T_g = np.empty(size, kind), np.empty(count, kind)
    C, C_g, C_g_dp = square(count, kind), square(count, kind), square(count, kind)
    inverse, scratch = square(count, kind), square(count, kind)
    C_dG, C_g_dG = np.empty((count, count, size), kind), np.empty((count, count, size), kind)
    M_dG, D_dG = np.empty((max_segments, count**2, size), kind), np.empty((count**2, size), kind)
    g_dG = np.empty((count, size), kind)
    B, d, g_dp = np.zeros((count, size)), np.empty(count, kind), np.empty(count, kind)
    dG, row = np.empty((max_segments, size, columns), kind), np.empty(columns, kind)
    if thickness is None:
        theta, by_x = None, 0.0
    else:
        theta, by_x = np.empty(count, kind), thickness[1]
    for e in range(nodes.shape[0]):
        start, number = offsets[e], offsets[e + 1] - offsets[e]
        if number == 0:
            continue
        for i in range(number):
            gather(x, n, m, nodes[e], masters[start + i], y[i])
            segment_ends(
                y[i], end_is_fixed[start + i], found[start + i], shapes[0], ends[i], dends[i]
            )
        if thickness is not None:
            gather_thickness(x, nodes[e], thickness, theta)
        first, last = outermost(ends[:number])
        bounds = ends[first, 0].real, ends[last, 1].real
        G[:] = 0.0
        T_g[:] = 0.0
        for i in range(number):
            span = slice(spans[start + i, 0], spans[start + i, 1])
            own_rule = points[span], point_weights[span]
            integrate_moments(y[i], ends[i], bounds, own_rule, shapes, G, T_M[i], T_g, theta)
        shape_coefficients(bounds, G, B, d)
        if basis == DUAL:
            invert_mass(G, scratch, inverse)
            own = g_dp, g_dG
            dual_multipliers(bounds, weights[e], B, d, inverse, own, C, C_dG, D[e], D_dG)
        else:
            standard_multipliers(weights[e], G, B, C, C_dG, D[e], D_dG)
        weigh_gap(
            (basis, gap_weights), bounds, (ends[first, 0], ends[last, 1]), weights[e], B, d,
            inverse, C, C_dG, C_g, C_g_dG, C_g_dp,
        )  # fmt: skip
        copy_row(d, cover[e])
        apply_to_gap(C_g, C_g_dG, C_g_dp, T_g, g[e], g_dG, g_dp)
        pairs, step = pair_offsets[e], number + 1 if partial[e] else 1
        for i in range(number):
            own = start + i
            apply_functions(C, C_dG, T_M[i], M[own], M_dG[i])
            if not move_ends:
                dends[i] = 0.0
            span = slice(spans[own, 0], spans[own, 1])
            integrate_derivatives(
                y[i], ends[i], dends[i], bounds, (points[span], point_weights[span]), (C, C_g),
                work, by_y, theta, by_x,
            )  # fmt: skip
            for r in range(rows):
                if r < of_M:
                    target = dG[i, r]
                elif r < of_g:
                    target = dM[pairs + i * step, r - of_M]
                else:
                    target = dg[own, r - of_g]
                chain_normals(by_y[r], dn_dx, nodes[e], target)
            add_product(D_dG, dG[i], dD[own])
        if not partial[e]:
            continue
        for k in range(number):
            add_product(g_dG, dG[k], dg[start + k])
            for i in range(number):
                add_product(M_dG[i], dG[k], dM[pairs + i * number + k])
        for j in range(count):
            if g_dp[j] != 0.0:
                edge, end = (first, 0) if j == 0 else (last, 1)
                add_edge(g_dp[j], dends[edge, end], dn_dx, nodes[e], row, dg[start + edge, j])


@kernel
def integrate_facets(
    geometry, facets, segments, offsets, pair_offsets, rule, options, values, derivatives, thickness
):
    """Call ``tabulate_facets`` with ``values`` (D, M, g, cover), ``derivatives`` (dD, dM, dg).

    Entry point from Python: in each call numba determines the types of tuples of more than four
    arrays again, which takes 0.1 ms.
    """
    D, M, g, cover = values
    dD, dM, dg = derivatives
    tabulate_facets(
        geometry, facets, segments, offsets, pair_offsets, rule, options,
        (D, dD, M, dM, g, dg, cover), thickness,
    )  # fmt: skip
