# SPDX-License-Identifier: MIT
"""Derivatives of integrals over slave facets, by the positions of their nodes and of their masters.

The derivative of int W F(xi, eta, g) with a function F whose coefficients are constant is the sum
over the points of these factors times the derivatives of W, xi, eta and g (Popp, Gitterle, Gee &
Wall 2010):

    d(W F) = F dW + W (dF/dxi_a dxi_a + dF/deta_a deta_a + dF/dg dg)

They are the rows of ``by`` (5, r): F and W times the derivatives of F by xi_1, xi_2, eta_1 and
eta_2. Those of the weight and of X, see ``linearize_facets``, have no part in eta: they come first.
All but Y have the form F_kb = N_k p_kb + Phi_k f_b, with constants p and a field f.

In the auxiliary plane, with J the derivatives of the image of a facet,

    dxi = J^-1 (dV - N dX),    deta = (J^m)^-1 (dV - N^m dY),    W = w A(V)

so a point gives each row two numbers for its cell's vertices and for each node, instead of one for
every position. They are chained once for a polygon to the images, see ``clipping``, and from these
to the positions: dX = t_d . dx - h t_d . dn_0. Only the gap depends on more than the images:

    dg = [dn/dxi_a . t - n^ . (dN/dxi_a x)] dxi_a + n^ . (dN^m/deta_a y) deta_a
         + n^ . (N^m dy - N dx) + t . (N dn),    t = (N^m y - N x - g n^) / |N n|

==========  ======================================================================  ============
symbol      meaning                                                                 shape
==========  ======================================================================  ============
by          factors of a point                                                      (5, r)
Phi         functions A N at a point, with derivatives                              (3, K)
field       f at a point, with derivatives by xi and eta                            (5, b)
by_point    derivatives of r rows by V through xi, and through eta                  (4, r)
by_V        derivatives by the vertices                                             (v, 2, r)
by_A        derivative by the area of a cell                                        (r,)
by_image    derivatives by the images of slave and master nodes                     (K + K', 2, r)
direct      derivatives of the gap through x, y and n alone: c = 3 (2 K + K')       (K, c)
==========  ======================================================================  ============
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import add_row, cross2, dot
from fenics_mortar.kernels.space.clipping import chain_vertices
from fenics_mortar.kernels.space.integrals import gap_at, points_work, tabulate_points
from fenics_mortar.kernels.space.normals import flatten, jacobian, piece_edges, set_plane


@kernel
def differentiate_gap(geometry, slave, master, N, L, gap, field):
    """Fill ``field`` (5, 1) with g and its derivatives; ``gap`` (4, 3): t in the last row."""
    x, n, m = geometry
    g, size = gap_at(geometry, slave, master, N, L, gap)
    for c in range(3):
        gap[3, c] = (gap[2, c] - g * gap[1, c]) / size
    field[:] = 0.0
    field[0, 0] = g
    for a in range(1, 3):
        for k in range(slave.size):
            turn, along = dot(gap[3], n[slave[k]]), dot(gap[1], x[slave[k]])
            field[a, 0] += N[a, k] * (turn - along)
        for l in range(master.size):
            field[2 + a, 0] += L[a, l] * dot(gap[1], m[master[l]])


@kernel
def add_field(sign, values, N, field, first):
    """Add ``sign`` times sum_k N[., k] ``values`` (K, b): derivatives to rows ``first``, ..."""
    for a in range(3):
        for k in range(values.shape[0]):
            add_row(sign * N[a, k], values[k], field[first + a - 1 if a > 0 else 0])


@kernel
def weigh_slave(W, N, Phi, constants, field, first, by):
    """F_kb = N_k p_kb + Phi_k f_b, with the ``constants`` p (K, b) and the ``field`` f (5, b)."""
    count = field.shape[1]
    for k in range(N.shape[1]):
        for b in range(count):
            r, p, f = first + count * k + b, constants[k, b], field[0, b]
            by[0, r] = N[0, k] * p + Phi[0, k] * f
            for a in range(1, 3):
                by[a, r] = W * (N[a, k] * p + Phi[a, k] * f + Phi[0, k] * field[a, b])
                by[2 + a, r] = W * Phi[0, k] * field[2 + a, b]


@kernel
def weigh_master(W, L, field, first, by):
    """F_lb = N^m_l f_b, with the ``field`` f (5, b), which does not depend on eta."""
    count = field.shape[1]
    for l in range(L.shape[1]):
        for b in range(count):
            r = first + count * l + b
            by[0, r] = L[0, l] * field[0, b]
            for a in range(1, 3):
                by[a, r], by[2 + a, r] = W * L[0, l] * field[a, b], W * L[a, l] * field[0, b]


@kernel
def add_direct(W, N, L, Phi, gap, direct):
    """Add the derivatives of a point's gap through x, y and n, times W Phi, to ``direct``."""
    own, others = N.shape[1], L.shape[1]
    for j in range(own):
        factor, row = W * Phi[0, j], direct[j]
        for c in range(3):
            along, turn = factor * gap[1, c], factor * gap[3, c]
            for k in range(own):
                row[3 * k + c] -= along * N[0, k]
                row[3 * (own + others + k) + c] += turn * N[0, k]
            for l in range(others):
                row[3 * (own + l) + c] += along * L[0, l]


@kernel
def through_image(images, start, N, one, other, out):
    """Fill ``out`` (2, r) with (``one``, ``other``) (r,) times J^-1, see the module."""
    xa, ya, xb, yb = jacobian(images, start, N)
    det = cross2(xa, ya, xb, yb)
    xa, ya, xb, yb = xa / det, ya / det, xb / det, yb / det
    for r in range(one.size):
        out[0, r] = one[r] * yb - other[r] * ya
        out[1, r] = other[r] * xa - one[r] * xb


@kernel
def add_point(images, N, L, weight, bary, cell, first, by, by_point, by_V, by_A, by_image):
    """Add the contributions of a point to the derivatives by images, vertices and area.

    ``weight`` and ``bary`` (3,) are those of the rule, ``cell`` the number of the cell; rows from
    ``first`` on depend on eta.
    """
    own = N.shape[1]
    through_image(images, 0, N, by[1], by[2], by_point[:2])
    through_image(images, own, L, by[3, first:], by[4, first:], by_point[2:, first:])
    add_row(weight, by[0], by_A)
    for d in range(2):
        of_xi, of_eta = by_point[d], by_point[2 + d, first:]
        for k in range(own):
            add_row(-N[0, k], of_xi, by_image[k, d])
        for l in range(L.shape[1]):
            add_row(-L[0, l], of_eta, by_image[own + l, d, first:])
        add_row(1.0, of_eta, of_xi[first:])
        for i in range(3):
            add_row(bary[i], of_xi, by_V[cell + i if i > 0 else 0, d])


@kernel
def add_area(V, cell, by_A, by_V):
    """Add the derivatives by the vertices of a cell through its area; set ``by_A`` to zero."""
    for i in range(3):
        vertex = cell + i if i > 0 else 0
        after, before = cell + (i + 1) % 3, cell + (i + 2) % 3
        after, before = (after if i != 2 else 0), (before if i != 1 else 0)
        add_row(0.5 * (V[after, 1] - V[before, 1]), by_A, by_V[vertex, 0])
        add_row(0.5 * (V[before, 0] - V[after, 0]), by_A, by_V[vertex, 1])
    by_A[:] = 0.0


@kernel
def to_positions(plane, corners, by_image, out):
    """Fill ``out`` (r, 3 (K + K')) with derivatives by positions, given those by the images.

    ``corners`` are those of the slave piece, whose positions turn the plane.
    """
    frame, images, heights = plane
    last = corners.size - 1
    start = corners[0] if last == 2 else corners[1]
    ex, ey, fx, fy = piece_edges(images, corners)
    area = cross2(ex, ey, fx, fy)
    for r in range(out.shape[0]):
        x = y = 0.0 * images[0, 0]
        for k in range(heights.size):
            one, other = by_image[k, 0, r], by_image[k, 1, r]
            x -= heights[k] * one
            y -= heights[k] * other
            for c in range(3):
                out[r, 3 * k + c] = one * frame[0, c] + other * frame[1, c]
        by_e, by_f = cross2(fx, fy, x, y) / area, cross2(x, y, ex, ey) / area
        for c in range(3):
            normal = frame[2, c]
            out[r, 3 * corners[last - 1] + c] += by_e * normal
            out[r, 3 * corners[0] + c] -= by_e * normal
            out[r, 3 * corners[last] + c] += by_f * normal
            out[r, 3 * start + c] -= by_f * normal


@kernel
def scatter(by_position, places, own, out):
    """Add the derivatives of a row by the nodes of a pair, (3 (K + K'),), to those of its facet."""
    for k in range(3 * own):
        out[k] += by_position[k]
    for l in range(places.size):
        for c in range(3):
            out[3 * (own + places[l]) + c] += by_position[3 * (own + l) + c]


@kernel
def scatter_rows(by_position, direct, places, starts, of_force, own, e, out):
    """Add the derivatives of all rows of a pair to those of the facet ``e``.

    ``of_force``: number of components of X and Y.
    """
    for i in range(5):
        for r in range(starts[i], starts[i + 1]):
            row = r - starts[i]
            if i == 3:
                row = of_force * places[row // of_force] + row % of_force
            sums = out[i][e, row]
            scatter(by_position[r], places, own, sums)
            if i == 2:
                scatter(direct[row], places, own, sums)
                by_normals = direct[row, 3 * (own + places.size) :]
                add_row(1.0, by_normals, sums[sums.size - by_normals.size :])


@kernel
def weigh_point(geometry, nodes, W, N, L, coefficients, e, y, starts, work, direct, by):
    """Fill ``by`` for a point of the facet ``e``; add to ``direct``.

    ``nodes`` = (slave, master) nodes of the pair, ``y`` (K', b) values of the latter; for others
    see ``linearize_wanted``.
    """
    A, gamma, s, c, q, v, _ = coefficients
    wanted, Phi, gap, ones, (no_field, of_force, of_gap, of_vector) = work
    if wanted[2] or wanted[4]:
        Phi[:] = 0.0
        for a in range(3):
            for j in range(Phi.shape[1]):
                for k in range(Phi.shape[1]):
                    Phi[a, j] += A[e, j, k] * N[a, k]
    if wanted[0]:
        weigh_slave(W, N, N, ones, no_field, starts[0], by)
    if wanted[1] or wanted[3]:
        of_force[:] = 0.0
        add_field(-1.0, c[e], N, of_force, 1)
    if wanted[1]:
        weigh_slave(W, N, N, s[e], of_force, starts[1], by)
    if wanted[2]:
        at_nodes = gamma[e].reshape((-1, 1))
        differentiate_gap(geometry, nodes[0], nodes[1], N, L, gap, of_gap)
        add_field(-1.0, at_nodes, N, of_gap, 1)
        weigh_slave(W, N, Phi, at_nodes, of_gap, starts[2], by)
        add_direct(W, N, L, Phi, gap, direct)
    if wanted[3]:
        weigh_master(W, L, of_force, starts[3], by)
    if wanted[4]:
        of_vector[:] = 0.0
        add_field(1.0, v[e], N, of_vector, 1)
        add_field(-1.0, y, L, of_vector, 3)
        weigh_slave(W, N, Phi, q[e], of_vector, starts[4], by)


@kernel
def linearize_wanted(geometry, slave, masters, offsets, places, rule, coefficients, out):
    """As ``linearize_facets``, with arrays of size zero for what is not wanted.

    ``out`` has rows of facets and columns, in the order weight, X, gap, Y, vector.
    """
    x, _, m = geometry
    own, others, values = slave.shape[1], masters.shape[1], coefficients[6]
    counts = coefficients[3].shape[2], coefficients[5].shape[2]
    starts = np.zeros(6, np.int64)  # of weight, X, gap, Y and vector among the rows of a pair
    for i in range(5):
        size = out[i].shape[1]
        starts[i + 1] = starts[i] + (min(size, counts[0] * others) if i == 3 else size)
    rows, first = starts[5], starts[2]
    facets, plane, polygon, table = points_work(x, (own, others), rule)
    (frame, images, heights), (W, N, L), (bary, weights) = plane, table, rule
    by, by_point, by_A = np.zeros((5, rows)), np.empty((4, rows)), np.zeros(rows)
    by_V, by_image = np.empty((polygon[1].shape[0], 2, rows)), np.empty((own + others, 2, rows))
    by_position, direct = (
        np.empty((rows, 3 * (own + others))),
        np.empty((own, 3 * (2 * own + others))),
    )
    fields = (
        np.zeros((5, 1)), np.empty((5, counts[0])), np.empty((5, 1)), np.empty((5, counts[1])),
    )  # fmt: skip
    wanted = starts[1:] > starts[:-1]
    work = wanted, np.empty((3, own)), np.empty((4, 3)), np.ones((own, 1)), fields
    y = np.empty((others, counts[1]))
    for e in range(slave.shape[0]):
        for piece in range(facets[0].shape[0]):
            corners = facets[0][piece]
            area = set_plane(x, slave[e], corners, frame)
            flatten(x, slave[e], frame, 0, images, heights)
            for i in range(offsets[e], offsets[e + 1]):
                flatten(m, masters[i], frame, own, images, heights)
                for l in range(others):
                    for c in range(counts[1]):
                        y[l, c] = values[i, l, c]
                by_image[:] = 0.0
                direct[:] = 0.0
                met = False
                for other in range(facets[2].shape[0]):
                    points, count, _ = tabulate_points(
                        images, facets, (piece, other), area, rule, polygon, table
                    )
                    met = met or points > 0
                    by_V[:count] = 0.0
                    for p in range(points):
                        cell, g = p // weights.size, p % weights.size
                        weigh_point(
                            geometry, (slave[e], masters[i]), W[p], N[p], L[p], coefficients, e, y,
                            starts, work, direct, by,
                        )  # fmt: skip
                        add_point(
                            images, N[p], L[p], weights[g], bary[g], cell, first, by, by_point,
                            by_V, by_A, by_image,
                        )  # fmt: skip
                        if g == weights.size - 1:
                            add_area(polygon[1], cell, by_A, by_V)
                    chain_vertices(images, polygon[0][0], count, polygon[2], by_V, by_image)
                if met:
                    to_positions(plane, corners, by_image, by_position)
                    scatter_rows(by_position, direct, places[i], starts, counts[0], own, e, out)


def linearize_facets(geometry, slave, masters, offsets, places, rule, coefficients, out):
    """Differentiate the integrals of functions F over slave facets and their pairs.

    Columns of a facet: 3 K positions of the slave nodes, then 3 L of the master nodes of all its
    pairs; columns that a facet does not need are zero. Each F is a function of the point with
    constant coefficients: Phi = A N, c = sum_k N_k c_k, likewise gamma and v; y = sum_l N^m_l y_l
    of the master nodes of each pair. No facet may be folded, see ``integrate_facets``.

    ========  ==============================================  ======================
    result    functions                                       shape
    ========  ==============================================  ======================
    weight    F_j = N_j                                       (s, K, C)
    gap       F_j = N_j gamma_j + Phi_j (g - gamma)           (s, K, C + 3 K): then
                                                              by the nodal normals
    X         F_kc = N_k (s_kc - c_c)                         (s, a K, C)
    Y         F_lc = -N^m_l c_c                               (s, a L, C)
    vector    F_jb = N_j q_jb + Phi_j (v_b - y_b)             (s, K, b, C)
    ========  ==============================================  ======================

    Args:
        geometry: (x (n, 3), n (n, 3), m (k, 3)): slave positions, normals, master positions.
        slave: Nodes of the slave facets, shape (s, K).
        masters: Nodes of the master facet of each pair, shape (p, K').
        offsets: Pairs of facet e are offsets[e]:offsets[e + 1], shape (s + 1,).
        places: Number 0 ... L - 1 of each master node among those of the slave facet, (p, K').
        rule: (barycentric coordinates (q, 3), weights (q,)), see ``shapes``.
        coefficients: (A (s, K, K), gamma (s, K), s, c (s, K, a), q, v (s, K, b), y (p, K', b));
            None where no result needs it. The numbers a and b of components are those of the
            values: 3 of multipliers and positions, 1 of a scalar field.
        out: (weight, gap, X, Y, vector); filled, None where a result is not wanted.
    """
    weight, gap, X, Y, vector = out
    if vector is not None:
        vector = vector.reshape(len(slave), slave.shape[1] * vector.shape[2], vector.shape[3])
    results = [_given_or_empty(a, 3) for a in (weight, X, gap, Y, vector)]
    for result in results:
        result[:] = 0.0
    constants = [_given_or_empty(a, d) for a, d in zip(coefficients, (3, 2, 3, 3, 3, 3, 3))]
    linearize_wanted(
        geometry, slave, masters, offsets, places, rule, tuple(constants), tuple(results)
    )


def _given_or_empty(array, dimensions):
    """``array``, or one of size zero for None: numba compiles the kernel for one kind only."""
    return np.empty((0,) * dimensions) if array is None else array
