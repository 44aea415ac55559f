# SPDX-License-Identifier: MIT
"""Integrals over the common parts of slave facets and their master facets: De, Me, B and G."""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.space.clipping import MAX_VERTICES, signed_area
from fenics_mortar.kernels.space.normals import cross2, flatten, is_folded, jacobian, set_plane
from fenics_mortar.kernels.space.points import common_part, gap_at, points_work, tabulate_points
from fenics_mortar.kernels.space.shapes import pieces_of
from fenics_mortar.utils.rounding import SAME_PLACE


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
def integrate_facets(geometry, slave, masters, offsets, rule, values):
    """Integrate over slave facets and their pairs.

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
    """
    x, _, m = geometry
    De, Me, G, B, complete, folded = values
    for array in (De, G):
        array[:] = 0.0
    Me[:], B[:] = 0.0, 0.0
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
                        add_point(W[q], N[q], L[q], g, De[e], Me[e], G[e], B[i])
        complete[e] = abs(cover - whole) <= SAME_PLACE * whole


@kernel
def sample_gaps(geometry, slave, masters, offsets, rule, smallest, where):
    """Find the smallest gap of each pair at the points of a rule in its cells.

    Args:
        geometry: See ``integrate_facets``.
        slave: See ``integrate_facets``.
        masters: See ``integrate_facets``.
        offsets: See ``integrate_facets``.
        rule: See ``integrate_facets``; that of the corners has the points (1, 0, 0) and so on.
        smallest: Gaps, inf without a common part, shape (p,) [length]; filled.
        where: Their places on the slave, shape (p, 3) [length]; filled.
    """
    x, _, m = geometry
    own = slave.shape[1]
    facets, plane, polygon, table = points_work(x, (own, masters.shape[1]), rule)
    (frame, images, heights), (_, N, L) = plane, table
    gap, master_pieces = np.empty((3, 3), x.dtype), facets[2]
    smallest[:] = np.inf
    for e in range(slave.shape[0]):
        for piece in range(facets[0].shape[0]):
            corners = facets[0][piece]
            area = set_plane(x, slave[e], corners, frame)
            flatten(x, slave[e], frame, 0, images, heights)
            for i in range(offsets[e], offsets[e + 1]):
                flatten(m, masters[i], frame, own, images, heights)
                for other in range(master_pieces.shape[0]):
                    count = common_part(images, corners, master_pieces[other], area, polygon)
                    if count == 0:
                        continue
                    points, _ = tabulate_points(
                        images, count, facets, (piece, other), rule, polygon, table
                    )
                    for q in range(points):
                        g, _ = gap_at(geometry, slave[e], masters[i], N[q], L[q], gap)
                        if g < smallest[i]:
                            smallest[i] = g
                            for d in range(3):
                                where[i, d] = 0.0
                                for k in range(own):
                                    where[i, d] += N[q, 0, k] * x[slave[e, k], d]


@kernel
def tabulate_corners(geometry, slave, masters, offsets, counts, shares):
    """Tabulate the slave's shape functions at the corners of the cells of each pair.

    Args:
        geometry: See ``integrate_facets``.
        slave: See ``integrate_facets``.
        masters: See ``integrate_facets``.
        offsets: See ``integrate_facets``.
        counts: Numbers of corners, those of neighbouring cells counted twice, (p,); filled.
        shares: Shape functions there, shape (p, most, K), see ``most_corners``; filled up to
            ``counts``.
    """
    x, _, m = geometry
    own, rule = slave.shape[1], (np.eye(3), np.ones(3))
    facets, plane, polygon, table = points_work(x, (own, masters.shape[1]), rule)
    frame, images, heights = plane
    counts[:] = 0
    for e in range(slave.shape[0]):
        for piece in range(facets[0].shape[0]):
            corners = facets[0][piece]
            area = set_plane(x, slave[e], corners, frame)
            flatten(x, slave[e], frame, 0, images, heights)
            for i in range(offsets[e], offsets[e + 1]):
                flatten(m, masters[i], frame, own, images, heights)
                for other in range(facets[2].shape[0]):
                    count = common_part(images, corners, facets[2][other], area, polygon)
                    if count == 0:
                        continue
                    points, _ = tabulate_points(
                        images, count, facets, (piece, other), rule, polygon, table
                    )
                    for q in range(points):
                        shares[i, counts[i]] = table[1][q, 0]
                        counts[i] += 1


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


def most_corners(own, others):
    """Largest number of corners of the cells of facets with ``own`` and ``others`` nodes."""
    return 3 * (MAX_VERTICES - 2) * len(pieces_of(own)) * len(pieces_of(others))
