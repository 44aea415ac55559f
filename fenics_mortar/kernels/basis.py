# SPDX-License-Identifier: MIT
"""Multiplier basis of a slave facet, and the mortar integrals made from segment moments.

The covered part S of a facet is the union of its segments, and an integral over it is the sum over
their points. With |S| = int_S dxi, mean xm = int_S xi / |S| and variance v = int_S (xi - xm)^2 /
|S|, every basis used here reads

    Phi_1 = a - F (xi - xm),    Phi_2 = 1 - Phi_1,

=================  ====================  ====================  =======================
basis              a                     F                     w = F v
=================  ====================  ====================  =======================
dual               (1 - xm) / 2          (1 - xm^2) / (2 v)    (1 - xm^2) / 2
standard           (1 - xm) / 2          1 / 2                 v / 2
only node 1 left   1                     0                     0
only node 2 left   0                     0                     0
=================  ====================  ====================  =======================

The dual row is the closed form of A = D_e M_e^-1 for any number of covered pieces: biorthogonal on
the covered part, hence "consistent" (Cichosz & Bischoff 2011; Popp, Seitz, Gee & Wall 2013). On a
fully covered facet xm = 0, v = 1/3: Phi = (1 -+ 3 xi) / 2. The last two rows hand the weight of a
node that carries no multiplier (its displacement is prescribed) to its neighbour.

The points of a segment have, in its own coordinate s, a mean e and a variance q, its ``spread``: 0
and 1/3 for a Gauss rule, so that the sums are the integrals. On points that are fixed on the facet
the same formulas make the bases of that discrete measure; v must then not vanish for the dual one.
With points at the two nodes, xm = 0 and v = 1: there both bases are one, and D is diagonal.

The gap of node 1 is weighted by a function of the same integral,

    Psi_1 = a_1 (1 + (p_1 - xm) (xi - xm) / v),    a_1 = (1 - xm) / 2,

which takes a linear gap at the place p_1; that of node 2 likewise with a_2 = (1 + xm) / 2. At the
node itself, p = -1 or 1, it is the dual function. On a partly covered facet the dual function of a
node beyond the edge so continues the gap from the cover to the node, where there is no master:
p = the end of the cover next to the node asks for it where the master ends. Or the gap is weighted
by N_j (Petrov-Galerkin; Popp, Seitz, Gee & Wall 2013), which is nowhere negative.

With m = J |S|, N1 = (1 - xm)/2, N2 = (1 + xm)/2 the slave-side matrix is exact:

    D_11 = m (a N1 + w/2), D_12 = m (a N2 - w/2), D_21 = m ((1-a) N1 - w/2), D_22 = ...

Derivatives by the positions of a segment's nodes have 12 columns (see ``segment``). Those of M on
segment i also depend on the ends of the facet's other segments, through xm and F, unless the
facet is fully covered: hence pairs (i, k) of segments.
"""

import numpy as np

from fenics_mortar.kernels import kernel

DUAL, STANDARD = 0, 1
# What weighs the gap: the basis itself, Psi with p at the ends of the cover, N.
BY_BASIS, BY_COVER, BY_STANDARD = 0, 1, 2
BOTH, ONLY_FIRST, ONLY_SECOND = 0, 1, 2


@kernel
def cover_of(ends, spread):
    """|S|, mean and variance of the union of disjoint segments: ``ends`` (n, 2), ``spread`` (n, 2).

    Centres are taken from the first one, so that a single tiny interval keeps all digits.
    """
    size, mean = 0.0, 0.0
    first = 0.5 * (ends[0, 0] + ends[0, 1])
    for i in range(ends.shape[0]):
        c, h = 0.5 * (ends[i, 0] + ends[i, 1]), 0.5 * (ends[i, 1] - ends[i, 0])
        size += 2.0 * h
        mean += 2.0 * h * (c - first + h * spread[i, 0])
    mean = first + mean / size
    variance = 0.0
    for i in range(ends.shape[0]):
        c, h = 0.5 * (ends[i, 0] + ends[i, 1]), 0.5 * (ends[i, 1] - ends[i, 0])
        variance += 2.0 * h * ((c - mean + h * spread[i, 0]) ** 2 + h * h * spread[i, 1])
    return size, mean, variance / size


@kernel
def coefficients(basis, left, mean, variance):
    """The table above and its derivatives: (a, da/dxm, F, dF/dxm, dF/dv, w, dw/dxm, dw/dv)."""
    o = 0.0 * mean
    if left == ONLY_FIRST:
        return o + 1.0, o, o, o, o, o, o, o
    if left == ONLY_SECOND:
        return o, o, o, o, o, o, o, o
    a = 0.5 * (1.0 - mean)
    if basis == STANDARD:
        return a, o - 0.5, o + 0.5, o, o, 0.5 * variance, o, o + 0.5
    w = 0.5 * (1.0 - mean * mean)
    F = w / variance
    return a, o - 0.5, F, -mean / variance, -F / variance, w, -mean, o


@kernel
def outermost(ends):
    """The segments with the lower and the upper end of the cover: segments may have no length."""
    first, last = 0, 0
    for i in range(1, ends.shape[0]):
        first = i if ends[i, 0].real < ends[first, 0].real else first
        last = i if ends[i, 1].real > ends[last, 1].real else last
    return first, last


@kernel
def gap_weight(basis, weights, alone, sign, end, mean, variance):
    """Psi of one node as a + S (xi - xm): (a, da/dxm, S, dS/dxm, dS/dv, dS/dp).

    ``sign`` is -1 for node 1 and 1 for node 2, ``end`` the end of the cover next to it, ``alone``:
    1 if the node has the whole weight of the facet, -1 if it has none, else 0.
    """
    o = 0.0 * mean
    if alone != 0:
        return (o + 1.0 if alone > 0 else o), o, o, o, o, o
    a, da = 0.5 * (1.0 + sign * mean), o + 0.5 * sign
    if basis == STANDARD or weights == BY_STANDARD:
        return a, da, o + 0.5 * sign, o, o, o
    p, dS_dp = (end, a / variance) if weights == BY_COVER else (o + sign, o)
    S = a * (p - mean) / variance
    return a, da, S, (da * (p - mean) - a) / variance, -S / variance, dS_dp


@kernel
def cover_derivative(ends, dends, spread, size, mean, variance, dsize, dmean, dvariance):
    """Fill the share of one segment, ``ends`` (2,), in d|S|, dxm, dv, each of shape (12,)."""
    h = 0.5 * (ends[1] - ends[0])
    away = 0.5 * (ends[0] + ends[1]) + h * spread[0] - mean
    for k in range(dsize.size):
        dh = 0.5 * (dends[1, k] - dends[0, k])
        moved = 0.5 * (dends[0, k] + dends[1, k]) + spread[0] * dh
        dsize[k] = 2.0 * dh
        dmean[k] = 2.0 * (h * moved + away * dh) / size
        change = (away**2 + 3.0 * h * h * spread[1] - variance) * dh
        dvariance[k] = 2.0 * (2.0 * h * away * moved + change) / size


@kernel
def slave_matrix(table, size, mean, J, D):
    """Fill ``D`` (2, 2) of one facet."""
    a, w, m = table[0], table[5], J * size
    N1, N2 = 0.5 * (1.0 - mean), 0.5 * (1.0 + mean)
    D[0, 0] = m * (a * N1 + 0.5 * w)
    D[0, 1] = m * (a * N2 - 0.5 * w)
    D[1, 0] = m * ((1.0 - a) * N1 - 0.5 * w)
    D[1, 1] = m * ((1.0 - a) * N2 + 0.5 * w)


@kernel
def slave_matrix_derivative(table, size, mean, J, dJ, dsize, dmean, dvariance, dD):
    """Fill the share of one segment in ``dD`` (2, 2, 12); ``dJ`` (12,) comes weighted by it."""
    a, da, w, dw_dmean, dw_dv = table[0], table[1], table[5], table[6], table[7]
    m, N1, N2 = J * size, 0.5 * (1.0 - mean), 0.5 * (1.0 + mean)
    for k in range(dsize.size):
        dm = dJ[k] + J * dsize[k]
        dA = m * da * dmean[k]
        half_dw = 0.5 * m * (dw_dmean * dmean[k] + dw_dv * dvariance[k])
        half_dN = 0.5 * m * dmean[k]
        dD[0, 0, k] = dm * (a * N1 + 0.5 * w) + dA * N1 - a * half_dN + half_dw
        dD[0, 1, k] = dm * (a * N2 - 0.5 * w) + dA * N2 + a * half_dN - half_dw
        dD[1, 0, k] = dm * ((1.0 - a) * N1 - 0.5 * w) - dA * N1 - (1.0 - a) * half_dN - half_dw
        dD[1, 1, k] = dm * ((1.0 - a) * N2 + 0.5 * w) - dA * N2 + (1.0 - a) * half_dN + half_dw


@kernel
def line(table, mean, c, h):
    """Phi_1 on the piece c - h ... c + h as b0 + b1 s, s = -1 ... 1."""
    return table[0] - table[2] * (c - mean), -table[2] * h


@kernel
def line_derivative(table, mean, c, h, dmean, dvariance):
    """Derivatives of ``line`` by mean and variance of the cover."""
    dF = table[3] * dmean + table[4] * dvariance
    return (table[1] + table[2]) * dmean - (c - mean) * dF, -h * dF


@kernel
def facet_values(table, gap_weights, segments, size, mean, J, D, M, g):
    """Fill D (2, 2), M (n, 2, 2) and g (2,) of one facet from the moments of its segments."""
    ends, _, Mp, _, gp, _ = segments
    slave_matrix(table, size, mean, J, D)
    g[:] = 0.0
    for i in range(ends.shape[0]):
        c, h = 0.5 * (ends[i, 0] + ends[i, 1]), 0.5 * (ends[i, 1] - ends[i, 0])
        b0, b1 = line(table, mean, c, h)
        for l in range(2):
            M[i, 0, l] = b0 * Mp[i, 0, l] + b1 * Mp[i, 1, l]
            M[i, 1, l] = Mp[i, 0, l] - M[i, 0, l]
        for j in range(2):
            a, S = gap_weights[j][0], gap_weights[j][2]
            g[j] += (a + S * (c - mean)) * gp[i, 0] + S * h * gp[i, 1]


@kernel
def own_derivative(table, gap_weights, segments, i, mean, dM, dg):
    """Fill dM (2, 2, 12) and dg (2, 12) of segment ``i`` by its own nodes, xm and F fixed."""
    ends, dends, Mp, dMp, gp, dgp = segments
    c, h = 0.5 * (ends[i, 0] + ends[i, 1]), 0.5 * (ends[i, 1] - ends[i, 0])
    b0, b1 = line(table, mean, c, h)
    for q in range(12):
        dc, dh = 0.5 * (dends[i, 0, q] + dends[i, 1, q]), 0.5 * (dends[i, 1, q] - dends[i, 0, q])
        for l in range(2):
            change = -table[2] * (dc * Mp[i, 0, l] + dh * Mp[i, 1, l])
            change += b0 * dMp[i, 0, l, q] + b1 * dMp[i, 1, l, q]
            dM[0, l, q] = change
            dM[1, l, q] = dMp[i, 0, l, q] - change
        moved = dc * gp[i, 0] + dh * gp[i, 1]
        for j in range(2):
            a, S = gap_weights[j][0], gap_weights[j][2]
            dg[j, q] = (a + S * (c - mean)) * dgp[i, 0, q] + S * (h * dgp[i, 1, q] + moved)


@kernel
def add_cover_derivative(table, gap_weights, segments, i, mean, dmean, dvariance, dp, dM, dg):
    """Add what segment ``i`` changes by dxm, dv (12,) and the ends dp (2, 12).

    To dM (2, 2, 12) and dg (2, 12).
    """
    ends, _, Mp, _, gp, _ = segments
    c, h = 0.5 * (ends[i, 0] + ends[i, 1]), 0.5 * (ends[i, 1] - ends[i, 0])
    for q in range(12):
        db0, db1 = line_derivative(table, mean, c, h, dmean[q], dvariance[q])
        for l in range(2):
            change = db0 * Mp[i, 0, l] + db1 * Mp[i, 1, l]
            dM[0, l, q] += change
            dM[1, l, q] -= change
        for j in range(2):
            _, da, S, dS_dmean, dS_dv, dS_dp = gap_weights[j]
            dS = dS_dmean * dmean[q] + dS_dv * dvariance[q] + dS_dp * dp[j, q]
            dg[j, q] += ((da - S) * dmean[q] + (c - mean) * dS) * gp[i, 0] + h * dS * gp[i, 1]


@kernel
def facet_derivatives(table, gap_weights, segments, shape, edge, partial, dD, dM, dg):
    """Fill dD (n, 2, 2, 12), dM (pairs, 2, 2, 12) and dg (n, 2, 12) of one facet."""
    ends, dends = segments[0], segments[1]
    spread, size, mean, variance = shape
    count = ends.shape[0]
    kind = ends.dtype
    dJ, dsize = np.zeros(12, kind), np.zeros(12, kind)
    dmean, dvariance, dp = np.zeros(12, kind), np.zeros(12, kind), np.zeros((2, 12), kind)
    ex, ey = 0.5 * edge[0], 0.5 * edge[1]
    J = np.sqrt(ex * ex + ey * ey)
    for k in range(count):
        own = k * count + k if partial else k
        own_derivative(table, gap_weights, segments, k, mean, dM[own], dg[k])
        share = 0.5 * (ends[k, 1] - ends[k, 0]) / J
        dJ[2], dJ[3], dJ[4], dJ[5] = -share * ex, -share * ey, share * ex, share * ey
        if partial:
            piece = ends[k], dends[k], spread[k]
            cover_derivative(*piece, size, mean, variance, dsize, dmean, dvariance)
        slave_matrix_derivative(table, size, mean, J, dJ, dsize, dmean, dvariance, dD[k])
    if not partial:
        return
    first, last = outermost(ends)
    for k in range(count):
        piece = ends[k], dends[k], spread[k]
        cover_derivative(*piece, size, mean, variance, dsize, dmean, dvariance)
        for q in range(12):
            dp[0, q] = dends[k, 0, q] if k == first else 0.0
            dp[1, q] = dends[k, 1, q] if k == last else 0.0
        for i in range(count):
            pair = i * count + k
            add_cover_derivative(
                table, gap_weights, segments, i, mean, dmean, dvariance, dp, dM[pair], dg[k]
            )


@kernel
def tabulate_facets(facets, basis, gap_weights, offsets, pair_offsets, segments, values):
    """Make D, M and the weighted gap of all facets from the moments of their segments.

    ``facets`` = (edges (f, 2): vector from the first to the second node of each facet; left (f,):
    which nodes carry a multiplier; partial (f,): whether the covered part of the facet moves).
    Facet e owns the segments offsets[e]:offsets[e+1] and the pairs pair_offsets[e]:
    pair_offsets[e+1] of them: (i, k), k running fastest, where that moves, else only i = k.
    ``gap_weights`` says what weighs the gap. ``segments`` = (ends, dends, spread (n, 2), M, dM, g,
    dg), all but the third of ``tabulate_segments``. Fills ``values`` = (D (f, 2, 2),
    dD (n, 2, 2, 12), M (n, 2, 2), dM (pairs, 2, 2, 12), g (f, 2), dg (n, 2, 12), cover (f, 2):
    the integrals of N_1 and N_2 over the covered part). dM must come zeroed; rows of facets without
    segments are left as they are.
    """
    edges, left, partial = facets
    ends, dends, spread, Mp, dMp, gp, dgp = segments
    D, dD, M, dM, g, dg, cover = values
    for e in range(edges.shape[0]):
        i, j, p, q = offsets[e], offsets[e + 1], pair_offsets[e], pair_offsets[e + 1]
        if i == j:
            continue
        own = (ends[i:j], dends[i:j], Mp[i:j], dMp[i:j], gp[i:j], dgp[i:j])
        shape = (spread[i:j], *cover_of(own[0], spread[i:j]))
        _, size, mean, variance = shape
        J = 0.5 * np.sqrt(edges[e, 0] * edges[e, 0] + edges[e, 1] * edges[e, 1])
        cover[e, 0] = 0.5 * J * size * (1.0 - mean)
        cover[e, 1] = 0.5 * J * size * (1.0 + mean)
        table = coefficients(basis, left[e], mean, variance)
        first, last = outermost(own[0])
        alone = 0
        if left[e] != BOTH:
            alone = 1 if left[e] == ONLY_FIRST else -1
        weights = (
            gap_weight(basis, gap_weights, alone, -1.0, own[0][first, 0], mean, variance),
            gap_weight(basis, gap_weights, -alone, 1.0, own[0][last, 1], mean, variance),
        )
        facet_values(table, weights, own, size, mean, J, D[e], M[i:j], g[e])
        if basis == DUAL and left[e] == BOTH:
            D[e, 0, 1] = 0.0
            D[e, 1, 0] = 0.0
        facet_derivatives(
            table, weights, own, shape, edges[e], partial[e], dD[i:j], dM[p:q], dg[i:j]
        )
