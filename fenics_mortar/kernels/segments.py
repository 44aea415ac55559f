# SPDX-License-Identifier: MIT
"""Integrals over the segments of two surfaces in the plane: points, then D, M and the gap."""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.facets import facet_work, integrate_facet
from fenics_mortar.kernels.points import (
    chain_normals,
    gather_thickness,
    points_work,
    tabulate_points,
    thickness_at,
)
from fenics_mortar.kernels.projection import gather, interpolate, tabulate_shapes


@kernel
def tabulate_covers(x, facets, ends, offsets, rule, cover, thickness=None):
    """Fill ``cover`` (f, K) with the integrals of N over the covered parts [length].

    ``x`` (n, 2), ``facets`` (f, K), ``ends`` (s, 2); others as in ``integrate_segments``.
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
def most_of(starts):
    """Largest difference of successive ``starts`` (n + 1,)."""
    most = 0
    for i in range(starts.size - 1):
        most = max(most, starts[i + 1] - starts[i])
    return most


@kernel
def integrate_segments(
    geometry, facets, segments, offsets, pair_offsets, rule, options, values, derivatives, thickness
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
        values: (D (f, K, K), M (n, K, K), g (f, K), cover (f, K)); filled. Rows of facets without
            segments are unchanged.
        derivatives: (dD (n, K K, C), dM (pairs, K K, C), dg (n, K, C)) with C = 8 K - 4 columns;
            filled. D, M, cover and dg are [length], g is [length^2], dD and dM are [1].
        thickness: (constant part at the slave nodes (n,) [length], derivative with respect to their
            first current coordinate [1]), linear between nodes, a factor of all integrals; or
            ``None`` for 1.
    """
    x, n, dn_dx, m = geometry
    nodes, weights, partial = facets
    masters, end_is_fixed, found = segments
    s, w, spans = rule
    basis, gap_weights, move_ends = options
    D, M, g, cover = values
    dD, dM, dg = derivatives
    kind, count, columns = x.dtype, nodes.shape[1], 6 * nodes.shape[1]
    most, lengths = most_of(offsets), spans[:, 1] - spans[:, 0]
    longest = most * (np.max(lengths) if lengths.size else 0)
    points = (
        np.empty((longest, 2), kind), np.empty((longest, 4, columns), kind),
        np.empty((longest, 2, count), kind), np.empty((longest, 2, count), kind),
        np.empty(most + 1, np.int64),
    )  # fmt: skip
    functions = np.empty((count, count)), np.empty((count, count))
    edges = (
        np.empty(count, np.int64), np.empty(2, np.int64), np.empty((2, 2, count), kind),
        np.empty((2, columns), kind),
    )  # fmt: skip
    by_y = (
        np.empty((most, count**2, columns), kind), np.empty((most**2, count**2, columns), kind),
        np.empty((most, count, columns), kind),
    )  # fmt: skip
    of_points, of_facet = points_work(most, count, x), facet_work(most, count, count, points[1])
    for e in range(nodes.shape[0]):
        own = slice(offsets[e], offsets[e + 1])
        number, first_pair = offsets[e + 1] - offsets[e], pair_offsets[e]
        if number == 0:
            continue
        tabulate_points(
            (x, n, m), nodes[e], (masters[own], end_is_fixed[own], found[own]), (s, w, spans[own]),
            move_ends, thickness, of_points, points, functions, edges,
        )  # fmt: skip
        integrate_facet(
            points, functions, edges, weights[e], partial[e], (basis, gap_weights), of_facet,
            (D[e], M[own], g[e], cover[e]), by_y,
        )  # fmt: skip
        for i in range(number):
            chain_normals(by_y[0][i], dn_dx, nodes[e], dD[offsets[e] + i])
            chain_normals(by_y[2][i], dn_dx, nodes[e], dg[offsets[e] + i])
        for i in range(pair_offsets[e + 1] - first_pair):
            chain_normals(by_y[1][i], dn_dx, nodes[e], dM[first_pair + i])
