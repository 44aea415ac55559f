# SPDX-License-Identifier: MIT
"""Integrals over the common parts of slave facets and their master facets: De, Me, B and G.

Quadrature points of the common part of two pieces, on both facets.

The polygon is divided into a fan of triangles from its first vertex, the cells; on curved facets,
whose integrals the rule has with an error, its place decides on digits. A point of a cell
is V = sum_i lambda_i V_i with the weight W = w A, where lambda and w are those of the rule and A is
the area of the cell in the plane, a measure that all integrals share.

The derivatives of W, xi and eta of a point have these factors in those of its contributions W F:

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
from fenics_mortar.kernels.blocks import cross2
from fenics_mortar.kernels.space.clipping import (
    MAX_VERTICES,
    clip,
    clipping_work,
    place_vertices,
    signed_area,
)
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
    kind, most = x.dtype, (MAX_VERTICES - 2) * rule[1].size
    facets = (
        pieces_of(own), piece_centres(own), pieces_of(others) + own, piece_centres(others)
    )  # fmt: skip
    plane = np.empty((4, 3), kind), np.empty((own + others, 2), kind), np.empty(own + others, kind)
    polygon = (
        clipping_work(MAX_VERTICES), np.empty((MAX_VERTICES, 2), kind),
        np.empty((MAX_VERTICES, 2), kind), np.empty((4, 2), kind),
    )  # fmt: skip
    table = np.empty(most, kind), np.empty((most, 3, own), kind), np.empty((most, 3, others), kind)
    return facets, plane, polygon, table


@kernel
def common_part(images, slave, master, area, polygon):
    """Number of vertices of the common part of two pieces, see ``clip``; ``polygon`` is filled."""
    work, V, shares, _ = polygon
    count = clip(images, slave, master, area, work)
    place_vertices(images, work[1], count, V, shares)
    return count


@kernel
def tabulate_points(images, count, facets, pieces, rule, polygon, table):
    """Fill ``table`` with the points of a polygon: (number of points, whether no facet is folded).

    Args:
        images: Flat images of the nodes, shape (K + K', 2).
        count: Number of vertices of the polygon.
        facets: See ``points_work``.
        pieces: Numbers of the slave and of the master piece.
        rule: (barycentric coordinates (p, 3), weights (p,)).
        polygon: See ``points_work`` and ``common_part``.
        table: (W (p,), N (p, 3, K), N^m (p, 3, K')); filled.
    """
    (bary, weights), (W, N, L), (_, V, _, corners) = rule, table, polygon
    (a, b), (c, d) = facets[1][pieces[0]], facets[3][pieces[1]]
    own, point, q, regular = N.shape[2], corners[3], 0, True
    for cell in range(count - 2):
        for k in range(2):
            corners[0, k], corners[1, k], corners[2, k] = V[0, k], V[cell + 1, k], V[cell + 2, k]
        area = signed_area(corners, 3)
        for g in range(weights.size):
            for k in range(2):
                point[k] = bary[g, 0] * corners[0, k] + bary[g, 1] * corners[1, k]
                point[k] += bary[g, 2] * corners[2, k]
            det = find_point(images, 0, point, a, b, N[q])
            det_master = find_point(images, own, point, c, d, L[q])
            regular = regular and det.real > 0.0 and det_master.real < 0.0
            W[q] = weights[g] * area
            q += 1
    return q, regular


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
    gap, master_pieces = np.empty((3, 3), x.dtype), facets[2]
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
                for other in range(master_pieces.shape[0]):
                    count = common_part(images, corners, master_pieces[other], area, polygon)
                    if count == 0:
                        continue
                    points, regular = tabulate_points(
                        images, count, facets, (piece, other), rule, polygon, table
                    )
                    folded[e] = folded[e] or not regular
                    cover += signed_area(polygon[1], count).real
                    for q in range(points):
                        g, _ = gap_at(geometry, slave[e], masters[i], N[q], L[q], gap)
                        if deepest is None:
                            add_point(W[q], N[q], L[q], g, De[e], Me[e], G[e], B[i])
                        elif g < deepest[0][i]:
                            deepest[0][i] = g
                            lift(x, slave[e], N[q], deepest[1][i])
        complete[e] = abs(cover - whole) <= SAME_PLACE * whole


@kernel
def tabulate_pairs(geometry, slave, masters, offsets, rule, counts, table):
    """Tabulate the points of a rule in the cells of each pair; without a table count them only.

    Args:
        geometry: (x (n, 3), m (k, 3)): slave and master positions.
        slave: See ``integrate_facets``.
        masters: See ``integrate_facets``.
        offsets: See ``integrate_facets``.
        rule: See ``integrate_facets``.
        counts: Number of points of each pair, shape (p,); filled.
        table: (weights (t, 2), N (t, 3, K), N^m (t, 3, K')) of all pairs in order; filled, unless
            they have no rows. The weights are those of the reference facets of slave and master,
            the areas in the plane over the determinants of the flat images.
    """
    x, m = geometry
    weights, of_slave, of_master = table
    own = slave.shape[1]
    facets, plane, polygon, points_table = points_work(x, (own, masters.shape[1]), rule)
    (frame, images, heights), (W, N, L) = plane, points_table
    counts[:] = 0
    start = 0
    for e in range(slave.shape[0]):
        for i in range(offsets[e], offsets[e + 1]):
            for piece in range(facets[0].shape[0]):
                corners = facets[0][piece]
                area = set_plane(x, slave[e], corners, frame)
                flatten(x, slave[e], frame, 0, images, heights)
                flatten(m, masters[i], frame, own, images, heights)
                for other in range(facets[2].shape[0]):
                    count = common_part(images, corners, facets[2][other], area, polygon)
                    if count == 0:
                        continue
                    points = (count - 2) * rule[1].size
                    counts[i] += points
                    if len(weights) == 0:
                        continue
                    tabulate_points(
                        images, count, facets, (piece, other), rule, polygon, points_table
                    )
                    for q in range(points):
                        xa, ya, xb, yb = jacobian(images, 0, N[q])
                        weights[start, 0] = W[q] / abs(cross2(xa, ya, xb, yb))
                        xa, ya, xb, yb = jacobian(images, own, L[q])
                        weights[start, 1] = W[q] / abs(cross2(xa, ya, xb, yb))
                        of_slave[start], of_master[start] = N[q], L[q]
                        start += 1


def listed_points(geometry, slave, masters, offsets, rule):
    """The points of ``tabulate_pairs`` in order: their pairs (t,), and its table."""
    counts, shapes = np.empty(len(masters), np.int64), ((3, slave.shape[1]), (3, masters.shape[1]))
    table = tuple(np.empty((0, *shape)) for shape in ((2,), *shapes))
    tabulate_pairs(geometry, slave, masters, offsets, rule, counts, table)
    if total := counts.sum():  # the number of points is not known before
        table = tuple(np.empty((total, *part.shape[1:])) for part in table)
        tabulate_pairs(geometry, slave, masters, offsets, rule, counts, table)
    return np.repeat(np.arange(counts.size), counts), table
