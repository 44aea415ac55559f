# SPDX-License-Identifier: MIT
"""Quadrature points of the common part of two pieces, on both facets.

The polygon is divided into a fan of triangles from its first vertex, the cells. A point of a cell
is V = sum_i lambda_i V_i with the weight W = w A, where lambda and w are those of the rule and A is
the area of the cell in the plane, a measure that all integrals share.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.space.clipping import (
    MAX_VERTICES,
    clip,
    clipping_work,
    place_vertices,
    signed_area,
)
from fenics_mortar.kernels.space.normals import find_point
from fenics_mortar.kernels.space.shapes import piece_centres, pieces_of


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
