# SPDX-License-Identifier: MIT
"""Segments of two surfaces in the plane: quadrature points with all derivatives, and integrals.

A segment is a part of a slave facet with partners on one master facet, and a list of points
xi = c + h s, -1 <= s <= 1, with weights whose sum is 2. Either its ends are those of the
intersection of the two facets, and the points are a Gauss rule; or its ends are fixed on the slave
facet, and the points are those of a rule for the whole facet that lie between them. In the latter
case only the partners of the points move.

=========  =========================================================================  ===========
symbol     meaning                                                                    shape
=========  =========================================================================  ===========
c, h       centre and half length of the segment                                      ()
J          |dx/dxi|, dgamma = J h ds; W = w J h is the weight of a point              ()
theta      out-of-plane thickness at the nodes of the facet; with it dgamma is an     (K,)
           area, dgamma = (N theta) J h ds, and W = w J h (N theta)
g          gap n^ . (x^ - x) = alpha |n|, n^ = n / |n|                                ()
S          covered part of a facet, from the lowest to the highest end                ()
T          1, t, ..., t^(K - 1) with t = (xi - middle) / half, which is -1 to 1 on    (K,)
           S: middle and half are constants, although S moves
B          coefficients of the shape functions, N = B T                               (K, K)
rows       derivatives of xi, W, eta and g of a point by y, see ``projection``        (4, 6 K)
columns    positions that final derivatives refer to: slave nodes of the facet        (8 K - 4,)
           before, of this one and of the one after, then master nodes
=========  =========================================================================  ===========

``tabulate_points`` evaluates the points of a facet, each by ``differentiate_point``, and their
derivatives are chained to nodal positions. What follows from the points, D, M and the weighted gap,
is the same in any dimension, see ``facets``; ``integrate_segments`` does all of it for the facets
of a surface. The derivatives are those of Popp, Gee & Wall (2009).
"""

import numpy as np

from fenics_mortar.kernels import kernel, projection
from fenics_mortar.kernels.blocks import dot2
from fenics_mortar.kernels.facets import facet_work, integrate_facet


@kernel
def thickness_at(theta, N, derivative):
    """Thickness at a point with the shape functions ``N`` (3, K), or its derivative by xi."""
    value = 0.0 * theta[0]
    for i in range(theta.size):
        value += N[derivative, i] * theta[i]
    return value


@kernel
def gather_thickness(x, nodes, thickness, theta):
    """Fill ``theta`` (K,), the ``thickness`` at ``nodes`` (K,), [length]."""
    constant, by_x = thickness
    for i in range(nodes.size):
        theta[i] = constant[nodes[i]] + by_x * x[nodes[i], 0]


@kernel
def differentiate_point(y, s, w, ends, dends, N, L, table, at):
    """Fill ``table[at]`` (4, 6 K), derivatives of xi, W, eta and g of a point; return (xi, W, g).

    ``s`` and ``w`` are its coordinate and weight, ``dends`` (2, 6 K) the derivatives of the
    ``ends``; ``N`` and ``L`` (3, K) are filled, too.

    With the partner x^ = x + alpha n, tau = (-n_y, n_x), a = dm/deta and b = (a_y, -a_x):

        d eta   = p . (L dm - N dx - alpha N dn),   p = -tau / (tau . a)
        d alpha = q . (L dm - N dx - alpha N dn),   q = b / (b . n)
    """
    count, rows = N.shape[1], table[at]
    c, h = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0])
    xi = c + h * s
    _, alpha = projection.slave_to_master(y, xi, N, L)
    n, b = projection.interpolate(y, 1, N, 0), projection.interpolate(y, 1, N, 1)
    t, k = projection.interpolate(y, 0, N, 1), projection.interpolate(y, 0, N, 2)
    a = projection.interpolate(y, 2, L, 1)
    size, J = np.sqrt(dot2(n, n)), np.sqrt(dot2(t, t))
    along = n[0] * a[1] - n[1] * a[0]
    p = n[1] / along, -n[0] / along
    q = a[1] * size / along, -a[0] * size / along
    slope = t[0] + alpha * b[0], t[1] + alpha * b[1]
    eta_xi = -dot2(p, slope)
    gap_xi = alpha * dot2(n, b) / size - dot2(q, slope)
    J_xi = dot2(t, k) / J
    lower, upper = 0.5 * (1.0 - s), 0.5 * (1.0 + s)
    for c in range(6 * count):
        dxi = lower * dends[0, c] + upper * dends[1, c]
        rows[0, c] = dxi
        rows[1, c] = w * (0.5 * J * (dends[1, c] - dends[0, c]) + h * J_xi * dxi)
        rows[2, c] = eta_xi * dxi
        rows[3, c] = gap_xi * dxi
    for i in range(count):
        own, normal, master, f = 2 * i, 2 * (count + i), 2 * (2 * count + i), N[0, i]
        stretch = w * h * N[1, i] / J
        for d in range(2):
            rows[1, own + d] += stretch * t[d]
            rows[2, own + d] -= f * p[d]
            rows[3, own + d] -= f * q[d]
            rows[2, normal + d] -= alpha * f * p[d]
            rows[3, normal + d] += alpha * f * (n[d] / size - q[d])
            rows[2, master + d] += L[0, i] * p[d]
            rows[3, master + d] += L[0, i] * q[d]
    return xi, w * J * h, alpha * size


@kernel
def differentiate_thickness(theta, by_x, W, N, table, at):
    """Multiply W and its derivative, in ``table[at]``, by the thickness of a point; return W.

    ``by_x``: derivative of ``theta`` with respect to the first coordinate of its node.
    """
    rows = table[at]
    value, slope = thickness_at(theta, N, 0), thickness_at(theta, N, 1)
    for k in range(rows.shape[1]):
        rows[1, k] = rows[1, k] * value + W * slope * rows[0, k]
    for i in range(theta.size):
        rows[1, 2 * i] += W * by_x * N[0, i]
    return W * value


@kernel
def chain_normals(by_y, dn_dx, nodes, out):
    """Fill ``out`` (r, 8 K - 4), derivatives by nodal positions, given those by y, (r, 6 K).

    ``dn_dx`` are the derivatives of the normals in y with respect to the positions; ``nodes`` (K,)
    are those of the slave facet.
    """
    count = nodes.size
    for r in range(out.shape[0]):
        for k in range(out.shape[1]):
            out[r, k] = 0.0
        for i in range(count):
            for d in range(2):
                out[r, 2 * (count - 1 + i) + d] += by_y[r, 2 * i + d]
                out[r, 2 * (3 * count - 2 + i) + d] = by_y[r, 2 * (2 * count + i) + d]
            nx, ny = by_y[r, 2 * (count + i)], by_y[r, 2 * (count + i) + 1]
            for k in range(dn_dx.shape[2]):
                out[r, 2 * i + k] += nx * dn_dx[nodes[i], 0, k] + ny * dn_dx[nodes[i], 1, k]


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
def tabulate_powers(xi, bounds, T, at):
    """Fill ``T[at]`` (2, K), the powers of t at ``xi`` and their derivatives by xi.

    ``bounds`` = (lower end, upper end) of S in xi.
    """
    half = 0.5 * (bounds[1] - bounds[0])
    t = (xi - 0.5 * (bounds[0] + bounds[1])) / half
    T[at, 0, 0], T[at, 1, 0] = 1.0, 0.0
    for p in range(1, T.shape[2]):
        T[at, 0, p] = T[at, 0, p - 1] * t
        T[at, 1, p] = T[at, 1, p - 1] * t + T[at, 0, p - 1] / half


@kernel
def tabulate_functions(bounds, work, B, at_nodes):
    """Fill ``B`` (K, K), Taylor coefficients of N at the middle of S, and ``at_nodes`` (K, K).

    The latter is T at the nodes of the facet, a row each. ``work`` = (N (3, K), T (1, 2, K)) is
    overwritten; ``bounds`` as in ``tabulate_powers``.
    """
    (low, high), (N, T) = bounds, work
    count = B.shape[0]
    projection.tabulate_shapes(0.5 * (low + high), N)
    for j in range(count):
        scale = 1.0
        for p in range(count):
            B[j, p] = N[p, j] * scale
            scale *= 0.5 * (high - low) / (p + 1.0)
        xi = 2.0 * j / (count - 1.0) - 1.0
        tabulate_powers(xi, bounds, T, 0)
        for p in range(count):
            at_nodes[j, p] = T[0, 0, p]


@kernel
def edge_beyond(j, count, bounds):
    """Edge of S beyond which node ``j`` of ``count`` lies: 0 lower, 1 upper, -1 none.

    ``bounds`` = (lower end, upper end) of S in xi.
    """
    xi = 2.0 * j / (count - 1.0) - 1.0
    if xi < bounds[0]:
        return 0
    return 1 if xi > bounds[1] else -1


@kernel
def tabulate_points(geometry, nodes, segments, rule, move_ends, thickness, work, points,
                    functions, edges):  # fmt: skip
    """Evaluate the points of the segments of one facet.

    Args:
        geometry: (x, n, m): slave positions, normals, master positions [length].
        nodes: Slave nodes of the facet, shape (K,).
        segments: (master nodes (n, K), end_is_fixed (n, 2), ends (n, 2)) of the facet.
        rule: (s (r,), w (r,), spans (n, 2)): points of segment i are spans[i, 0]:spans[i, 1].
        move_ends: Whether the ends of segments have derivatives.
        thickness: See ``integrate_segments``.
        work: See ``points_work``.
        points: (W and g (p, 2); rows (p, 4, 6 K); T (p, 2, K) and L (p, 2, K), with derivatives by
            xi and eta; first point of each segment (n + 1,)); filled.
        functions: (B (K, K), T at the nodes (K, K)); filled.
        edges: (edge of S beyond which each node lies (K,), -1 for none; segments at both edges
            (2,); T at the edges (2, 2, K); rows of xi of the edges (2, 6 K)); filled.
    """
    x, n, m = geometry
    masters, end_is_fixed, found = segments
    s, w, spans = rule
    y, ends, dends, N, L, constant, theta = work
    values, rows, T, L_points, starts = points
    beyond, at_edge, T_edges, edge_rows = edges
    number = masters.shape[0]
    for i in range(number):
        projection.gather(x, n, m, nodes, masters[i], y[i])
        projection.segment_ends(y[i], end_is_fixed[i], found[i], N, ends[i], dends[i])
        if not move_ends:
            dends[i] = 0.0
    if thickness is not None:
        gather_thickness(x, nodes, thickness, theta)
    first, last = outermost(ends[:number])
    bounds = ends[first, 0].real, ends[last, 1].real
    tabulate_functions(bounds, constant, functions[0], functions[1])
    at_edge[0], at_edge[1] = first, last
    for edge in range(2):
        tabulate_powers(ends[at_edge[edge], edge], bounds, T_edges, edge)
        for k in range(edge_rows.shape[1]):
            edge_rows[edge, k] = dends[at_edge[edge], edge, k]
    for j in range(nodes.size):
        beyond[j] = edge_beyond(j, nodes.size, bounds)
    at = 0
    for i in range(number):
        starts[i], own, both, dboth = at, y[i], ends[i], dends[i]
        for p in range(spans[i, 0], spans[i, 1]):
            xi, W, gap = differentiate_point(own, s[p], w[p], both, dboth, N, L, rows, at)
            if thickness is not None:
                W = differentiate_thickness(theta, thickness[1], W, N, rows, at)
            values[at, 0], values[at, 1] = W, gap
            tabulate_powers(xi, bounds, T, at)
            for order in range(2):
                for l in range(nodes.size):
                    L_points[at, order, l] = L[order, l]
            at += 1
    starts[number] = at


@kernel
def points_work(most, count, example):
    """Arrays that ``tabulate_points`` overwrites, for at most ``most`` segments of a facet.

    These are y (n, 6 K), ends (n, 2), their derivatives by y (n, 2, 6 K), shape functions of both
    facets (3, K), real functions (3, K) and (1, 2, K), thickness (K,); of the kind of ``example``.
    """
    kind = example.dtype
    return (
        np.empty((most, 6 * count), kind), np.empty((most, 2), kind),
        np.empty((most, 2, 6 * count), kind), np.empty((3, count), kind),
        np.empty((3, count), kind), (np.empty((3, count)), np.empty((1, 2, count))),
        np.empty(count, kind),
    )  # fmt: skip


@kernel
def tabulate_covers(x, facets, ends, offsets, rule, cover, thickness):
    """Fill ``cover`` (f, K) with the integrals of N over the covered parts [length].

    ``x`` (n, 2), ``facets`` (f, K), ``ends`` (s, 2); others as in ``integrate_segments``.
    """
    points, weights, spans = rule
    theta = np.empty(facets.shape[1])
    y, N = np.empty(6 * facets.shape[1]), np.empty((3, facets.shape[1]))
    cover[:] = 0.0
    for e in range(facets.shape[0]):
        projection.gather(x, x, x, facets[e], facets[e], y)
        if thickness is not None:
            gather_thickness(x, facets[e], thickness, theta)
        for i in range(offsets[e], offsets[e + 1]):
            c, h = 0.5 * (ends[i, 0] + ends[i, 1]), 0.5 * (ends[i, 1] - ends[i, 0])
            for p in range(spans[i, 0], spans[i, 1]):
                projection.tabulate_shapes(c + h * points[p], N)
                t = projection.interpolate(y, 0, N, 1)
                J = np.sqrt(dot2(t, t))
                if thickness is not None:
                    J = J * thickness_at(theta, N, 0)
                for j in range(facets.shape[1]):
                    cover[e, j] += weights[p] * J * h * N[0, j]


@kernel
def integrate_segments(geometry, facets, segments, offsets, pair_offsets, rule, options, thickness):
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
        thickness: (constant part at the slave nodes (n,) [length], derivative with respect to their
            first current coordinate [1]), linear between nodes, a factor of all integrals; or
            ``None`` for 1.

    Returns:
        D (f, K, K), dD (n, K, K, C), M (n, K, K), dM (pairs, K, K, C), g (f, K), dg (n, K, C) and
        cover (f, K), with C = 8 K - 4 columns. D, M, cover and dg are [length], g is [length^2], dD
        and dM are [1]. D, g and cover of facets without segments are zero.
    """
    x, n, dn_dx, m = geometry
    nodes, weights, partial = facets
    masters, end_is_fixed, found = segments
    s, w, spans = rule
    basis, gap_weights, move_ends = options
    kind, count, columns = x.dtype, nodes.shape[1], 6 * nodes.shape[1]
    total, width = masters.shape[0], 8 * count - 4
    D, M = np.zeros((nodes.shape[0], count, count), kind), np.empty((total, count, count), kind)
    g, cover = np.zeros(nodes.shape, kind), np.zeros(nodes.shape, kind)
    dD, dg = np.empty((total, count**2, width), kind), np.empty((total, count, width), kind)
    dM = np.empty((pair_offsets[-1], count**2, width), kind)
    most = longest = 0
    if total > 0:
        most = np.max(offsets[1:] - offsets[:-1])
        longest = most * np.max(spans[:, 1] - spans[:, 0])
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
    dD = dD.reshape((total, count, count, width))
    return D, dD, M, dM.reshape((pair_offsets[-1], count, count, width)), g, dg, cover
