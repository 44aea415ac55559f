# SPDX-License-Identifier: MIT
"""Integrals over the common parts of slave facets and their master facets: De, Me, B and G.

``tabulate_points`` evaluates the quadrature points of the common part of two pieces, on both
facets. ``integrate_facets`` sums over the points of all pairs; ``tabulate_pairs`` lists them.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import copy_row, cross2, grown
from fenics_mortar.kernels.space import clipping
from fenics_mortar.kernels.space.normals import find_point, flatten, is_folded, jacobian, set_plane
from fenics_mortar.kernels.space.shapes import piece_centres, pieces_of
from fenics_mortar.utils.arrays import SAME_PLACE


@kernel
def points_work(x, counts, rule):
    """Arrays for the points of two pieces of facets with ``counts`` = (K, K') nodes.

    ``x`` has the kind of the numbers. Returns ``facets`` = (rows of images of the pieces, and their
    centres in reference coordinates, of the slave and of the master facet), ``plane`` = (frame,
    images, heights), ``polygon`` = (work of ``clip``, V, shares, a cell and a point) and ``table``
    = (W (p,), N (p, 3, K), N^m (p, 3, K')).
    """
    own, others = counts
    kind, most = x.dtype, (clipping.MAX_VERTICES - 2) * rule[1].size
    facets = (
        pieces_of(own), piece_centres(own), pieces_of(others) + own, piece_centres(others)
    )  # fmt: skip
    plane = np.empty((4, 3), kind), np.empty((own + others, 2), kind), np.empty(own + others, kind)
    polygon = (
        clipping.clipping_work(clipping.MAX_VERTICES), np.empty((clipping.MAX_VERTICES, 2), kind),
        np.empty((clipping.MAX_VERTICES, 2), kind), np.empty((4, 2), kind),
    )  # fmt: skip
    table = np.empty(most, kind), np.empty((most, 3, own), kind), np.empty((most, 3, others), kind)
    return facets, plane, polygon, table


@kernel
def tabulate_points(images, facets, pieces, area, rule, polygon, table):
    """Fill ``table`` with the points of the common part of two pieces, and ``polygon``.

    The polygon is divided into a fan of triangles from its first vertex, the cells; on curved
    facets, where the rule is not exact, the place of this vertex changes digits of the integrals. A
    point of a cell is V = sum_i lambda_i V_i with the weight W = w A, where lambda and w are those
    of the rule and A is the area of the cell in the plane, a measure that all integrals share.

    Args:
        images: Flat images of the nodes, shape (K + K', 2).
        facets: See ``points_work``.
        pieces: Numbers of the slave and of the master piece.
        area: Area of the slave piece.
        rule: (barycentric coordinates (p, 3), weights (p,)).
        polygon: See ``points_work``; filled.
        table: (W (p,), N (p, 3, K), N^m (p, 3, K')); filled.

    Returns:
        Number of points, number of vertices, and whether no facet is folded at a point.
    """
    (bary, weights), (W, N, L), (work, V, shares, corners) = rule, table, polygon
    (a, b), (c, d) = facets[1][pieces[0]], facets[3][pieces[1]]
    own, point, q, regular = N.shape[2], corners[3], 0, True
    count = clipping.clip(images, facets[0][pieces[0]], facets[2][pieces[1]], area, work)
    clipping.begin_by_shape(images, own, count, work)
    clipping.place_vertices(images, work[0], count, V, shares)
    for cell in range(count - 2):
        for k in range(2):
            corners[0, k], corners[1, k], corners[2, k] = V[0, k], V[cell + 1, k], V[cell + 2, k]
        area_of_cell = clipping.signed_area(corners, 3)
        for g in range(weights.size):
            for k in range(2):
                point[k] = bary[g, 0] * corners[0, k] + bary[g, 1] * corners[1, k]
                point[k] += bary[g, 2] * corners[2, k]
            det = find_point(images, 0, point, a, b, N[q])
            det_master = find_point(images, own, point, c, d, L[q])
            regular = regular and det.real > 0.0 and det_master.real < 0.0
            W[q] = weights[g] * area_of_cell
            q += 1
    return q, count, regular


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
def lift(x, nodes, N, point):
    """Fill ``point`` (3,) with the place on a facet at which shape functions are ``N`` (3, K)."""
    for d in range(3):
        point[d] = 0.0
        for k in range(nodes.size):
            point[d] += N[0, k] * x[nodes[k], d]


@kernel
def add_point(W, N, L, g, De, Me, G, B):
    """Add the contributions of a point to the integrals of one facet and of one pair."""
    for k in range(De.size):
        weighted = W * N[0, k]
        De[k] += weighted
        G[k] += weighted * g
        for q in range(De.size):
            Me[k, q] += weighted * N[0, q]
        for l in range(B.shape[1]):
            B[k, l] += weighted * L[0, l]


@kernel
def integrate_facets(geometry, slave, masters, offsets, rule, values, deepest=None):
    """Integrate over slave facets and their pairs, or find the smallest gap of each pair.

    Args:
        geometry: (x (n, 3), n (n, 3), m (k, 3)): slave positions, normals, master positions.
        slave: Nodes of the slave facets, shape (s, K).
        masters: Nodes of the master facet of each pair, shape (p, K').
        offsets: Pairs of facet e are offsets[e]:offsets[e + 1], shape (s + 1,).
        rule: (barycentric coordinates (q, 3), weights (q,)), see ``shapes``.
        values: (De (s, K), Me (s, K, K), G (s, K), B (p, K, K'), complete (s,), folded (s,));
            filled. De, Me and B are [length^2], G [length^3]. ``complete``: whether the whole facet
            has partners, within ``SAME_PLACE``, bool; ``folded``: whether the facet is
            folded over its plane at a corner of a piece, or it or a master at a point, bool: the
            other values of the facet are meaningless then.
        deepest: Instead of De, Me, G and B the smallest gaps at the points, inf without a common
            part, shape (p,), and their places on the slave, shape (p, 3) [length]; filled.
    """
    x, _, m = geometry
    De, Me, G, B, complete, folded = values
    for array in (De, G):
        array[:] = 0.0
    Me[:], B[:] = 0.0, 0.0
    if deepest is not None:
        deepest[0][:] = np.inf
    own = slave.shape[1]
    facets, plane, polygon, table = points_work(x, (own, masters.shape[1]), rule)
    (frame, images, heights), (W, N, L) = plane, table
    gap = np.empty((3, 3), x.dtype)
    for e in range(slave.shape[0]):
        cover, whole, folded[e] = 0.0, 0.0, False
        for piece in range(facets[0].shape[0]):
            corners = facets[0][piece]
            area = set_plane(x, slave[e], corners, frame)
            flatten(x, slave[e], frame, 0, images, heights)
            whole += area.real
            folded[e] = folded[e] or is_folded(images, corners, N[0])
            for i in range(offsets[e], offsets[e + 1]):
                flatten(m, masters[i], frame, own, images, heights)
                for other in range(facets[2].shape[0]):
                    points, count, regular = tabulate_points(
                        images, facets, (piece, other), area, rule, polygon, table
                    )
                    folded[e] = folded[e] or not regular
                    if points > 0:
                        cover += clipping.signed_area(polygon[1], count).real
                    for q in range(points):
                        g, _ = gap_at(geometry, slave[e], masters[i], N[q], L[q], gap)
                        if deepest is None:
                            add_point(W[q], N[q], L[q], g, De[e], Me[e], G[e], B[i])
                        elif g < deepest[0][i]:
                            deepest[0][i] = g
                            lift(x, slave[e], N[q], deepest[1][i])
        complete[e] = abs(cover - whole) <= SAME_PLACE * whole


@kernel
def tabulate_pairs(geometry, slave, masters, offsets, rule):
    """Tabulate the points of a rule in the cells of each pair.

    Args:
        geometry: (x (n, 3), m (k, 3)): slave and master positions.
        slave: See ``integrate_facets``.
        masters: See ``integrate_facets``.
        offsets: See ``integrate_facets``.
        rule: See ``integrate_facets``.

    Returns:
        A row per point of all pairs in order, shape (t, 3 + 3 K + 3 K'): pair, weights on the
        reference facets of slave and master, which are areas in the plane over the determinants of
        the flat images, N (3, K) and N^m (3, K').
    """
    x, m = geometry
    own, others = slave.shape[1], masters.shape[1]
    facets, plane, polygon, table = points_work(x, (own, others), rule)
    (frame, images, heights), (W, N, L) = plane, table
    rows, used = np.empty((64, 3 + 3 * own + 3 * others)), 0
    for e in range(slave.shape[0]):
        for i in range(offsets[e], offsets[e + 1]):
            for piece in range(facets[0].shape[0]):
                area = set_plane(x, slave[e], facets[0][piece], frame)
                flatten(x, slave[e], frame, 0, images, heights)
                flatten(m, masters[i], frame, own, images, heights)
                for other in range(facets[2].shape[0]):
                    points, _, _ = tabulate_points(
                        images, facets, (piece, other), area, rule, polygon, table
                    )
                    rows = grown(rows, used, used + points)
                    for q in range(points):
                        row = rows[used]
                        row[0] = i
                        xa, ya, xb, yb = jacobian(images, 0, N[q])
                        row[1] = W[q] / abs(cross2(xa, ya, xb, yb))
                        xa, ya, xb, yb = jacobian(images, own, L[q])
                        row[2] = W[q] / abs(cross2(xa, ya, xb, yb))
                        for k in range(3):
                            copy_row(N[q, k], row[3 + own * k :])
                            copy_row(L[q, k], row[3 + 3 * own + others * k :])
                        used += 1
    return rows[:used]


def listed_points(geometry, slave, masters, offsets, rule):
    """The points of ``tabulate_pairs`` in order, of t points in all.

    Returns:
        Their pairs (t,), weights on both reference facets (t, 2), N (t, 3, K), N^m (t, 3, K').
    """
    rows, own = tabulate_pairs(geometry, slave, masters, offsets, rule), 3 * slave.shape[1]
    N = rows[:, 3 : 3 + own].reshape(len(rows), 3, slave.shape[1])
    L = rows[:, 3 + own :].reshape(len(rows), 3, masters.shape[1])
    return rows[:, 0].astype(np.int64), (rows[:, 1:3], N, L)
