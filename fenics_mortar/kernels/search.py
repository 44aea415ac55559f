# SPDX-License-Identifier: MIT
"""Search for the master facets that each slave facet faces, by a tree of boxes.

The boxes of the master facets, in the order of the curve, are the leaves of a ``tree``. Candidates
of a slave facet are the boxes that intersect its strip, the quadrilateral x_k -+ radius n_k. The
search costs O(log N + hits) per facet, for any radius and orientation of the interface.

For segments and partners on the candidates see ``pairing``.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.pairing import curve_starts, facet_segments, point_partners
from fenics_mortar.kernels.rows import copy_rows, grown
from fenics_mortar.kernels.tree import build_tree, query_tree
from fenics_mortar.utils.rounding import ROUNDING


@kernel
def control_points(values, facets):
    """Bezier control points of facets (f, K) with nodal ``values`` (n, 2), shape (n, 2).

    Their convex hull contains the facet. Those of straight facets are the nodes.
    """
    controls = values.copy()
    if facets.shape[1] == 3:
        for f in range(facets.shape[0]):
            a, c, b = facets[f]
            for d in range(2):
                controls[c, d] = 2.0 * values[c, d] - 0.5 * (values[a, d] + values[b, d])
    return controls


@kernel
def query_strip(boxes, controls, nodes, radius, hits):
    """Master facets whose boxes intersect the strip of one slave facet, shape (h,).

    ``boxes`` and ``hits`` as in ``tree``; ``controls`` = control points of the slave's positions
    and normals, each (n, 2); ``nodes`` (K,) are those of the facet.
    """
    x, n = controls
    a, b = x[nodes[0]], x[nodes[-1]]
    tx, ty = b[0] - a[0], b[1] - a[1]
    strip = np.array([np.inf, np.inf, -np.inf, -np.inf])
    low, high = np.inf, -np.inf
    for k in range(2 * nodes.size):
        base, normal = x[nodes[k // 2]], n[nodes[k // 2]]
        r = radius if k % 2 == 0 else -radius
        px, py = base[0] + r * normal[0], base[1] + r * normal[1]
        strip[0], strip[1] = min(strip[0], px), min(strip[1], py)
        strip[2], strip[3] = max(strip[2], px), max(strip[3], py)
        low, high = min(low, px * tx + py * ty), max(high, px * tx + py * ty)
    length = abs(tx) + abs(ty)
    strip[:2] -= ROUNDING * length
    strip[2:] += ROUNDING * length
    margin = ROUNDING * length * length
    along = np.array([[tx, ty, low - margin, high + margin]])
    return hits[: query_tree(boxes, strip, along, hits)]


@kernel
def find_points(geometry, slave_facets, master_facets, radius, behind, limits, points, min_points):
    """Find partners of points on slave facets, as runs of points with the same master facet.

    Args:
        geometry: As in ``find_segments``.
        slave_facets: Nodes of the slave facets, shape (f, K).
        master_facets: Nodes of the master facets, shape (g, K).
        radius: Largest distance along the normal [length].
        behind: As in ``pairing.is_hidden``.
        limits: (smallest cosine [1], fraction of a slave facet within which a ray hits a master
            node [1]).
        points: Coordinates on each facet, -1 ... 1, increasing, shape (p,).
        min_points: Facets on which fewer points have a partner have no runs.

    Returns:
        Offsets (f + 1,): runs of facet e are offsets[e]:offsets[e + 1]; master facets (n,); points
        of each run, first and one after the last, (n, 2).
    """
    x, n, m = geometry
    boxes = build_tree(control_points(m, master_facets), master_facets)
    controls = control_points(x, slave_facets), control_points(n, slave_facets)
    starts = curve_starts(master_facets, m.shape[0])
    hits = np.empty(boxes.shape[0] // 2, np.int64)
    partners = np.empty(points.size, np.int64)
    offsets = np.zeros(slave_facets.shape[0] + 1, np.int64)
    rows = np.empty((points.size * slave_facets.shape[0], 3), np.int64)
    for e in range(slave_facets.shape[0]):
        nodes = slave_facets[e]
        near = query_strip(boxes, controls, nodes, radius, hits)
        paired = point_partners(
            geometry,
            e,
            nodes,
            master_facets,
            starts,
            near,
            points,
            radius,
            behind,
            limits,
            partners,
        )
        end = offsets[e]
        for p in range(points.size):
            if paired < min_points or partners[p] < 0:
                continue
            if p == 0 or partners[p] != partners[p - 1]:
                rows[end, 0], rows[end, 1] = partners[p], p
                end += 1
            rows[end - 1, 2] = p + 1
        offsets[e + 1] = end
    rows = rows[: offsets[-1]]
    return offsets, rows[:, 0].copy(), rows[:, 1:].copy()


@kernel
def find_segments(geometry, slave_facets, master_facets, radius, behind, limits, roles=None):
    """Find the segments of slave facets.

    Args:
        geometry: (x (n, 2), n (n, 2), m (k, 2)): slave positions, slave normals, master positions.
        slave_facets: Nodes of the slave facets, shape (f, K).
        master_facets: Nodes of the master facets, shape (g, K).
        radius: Largest distance along the normal [length].
        behind: As in ``pairing.is_hidden``.
        limits: (smallest cosine of slave normal and reversed master normal [1], length in xi that
            is rounding [1]).
        roles: As in ``pairing.facet_segments``.

    Returns:
        Offsets (f + 1,): segments of facet e are offsets[e]:offsets[e + 1]; master facets (s,);
        whether each end is a slave node (s, 2); ends in xi (s, 2).
    """
    x, n, m = geometry
    boxes = build_tree(control_points(m, master_facets), master_facets)
    controls = control_points(x, slave_facets), control_points(n, slave_facets)
    hits = np.empty(boxes.shape[0] // 2, np.int64)
    found = np.empty((64, 7))
    offsets = np.zeros(slave_facets.shape[0] + 1, np.int64)
    rows = np.empty((4 * slave_facets.shape[0] + 64, 7))
    for e in range(slave_facets.shape[0]):
        nodes = slave_facets[e]
        near = query_strip(boxes, controls, nodes, radius, hits)
        if near.size > found.shape[0]:
            found = np.empty((2 * near.size, 7))
        kept = facet_segments(
            geometry, nodes, master_facets, near, radius, limits, found, behind, e, roles
        )
        start = offsets[e]
        rows = grown(rows, start, start + kept)
        copy_rows(found, kept, rows, start)
        offsets[e + 1] = start + kept
    count = offsets[-1]
    masters, end_is_node = np.empty(count, np.int64), np.empty((count, 2), np.bool_)
    ends = np.empty((count, 2))
    for i in range(count):
        masters[i] = int(rows[i, 3])
        for k in range(2):
            ends[i, k], end_is_node[i, k] = rows[i, 1 + k], rows[i, 4 + k] != 0.0
    return offsets, masters, end_is_node, ends


@kernel
def couple_segments(offsets, ends, end_is_fixed, functions_move):
    """Pairs of segments coupled by the multiplier functions of their facet.

    The functions of a facet vary with all its segments if the facet is partly covered by segments
    with moving ends, or if they vary anyway; else each segment is coupled to itself alone.

    Args:
        offsets: Segments of facet e are offsets[e]:offsets[e + 1], shape (f + 1,).
        ends: Ends of the segments in xi, shape (s, 2).
        end_is_fixed: Whether an end is a fixed point of the facet, shape (s, 2), bool.
        functions_move: Whether the functions vary with the segments on every facet.

    Returns:
        Facet of each segment (s,); whether the functions of a facet vary, (f,), bool; pairs of
        facet e are those from the e-th offset to the next, (f + 1,); segments of each pair, the
        second one running fastest, (p, 2).
    """
    count = offsets.size - 1
    owner, partial = np.empty(offsets[count], np.int64), np.empty(count, np.bool_)
    pair_offsets = np.zeros(count + 1, np.int64)
    for e in range(count):
        covered, moves, size = 0.0, False, offsets[e + 1] - offsets[e]
        for i in range(offsets[e], offsets[e + 1]):
            owner[i] = e
            covered += ends[i, 1] - ends[i, 0]
            moves = moves or not (end_is_fixed[i, 0] and end_is_fixed[i, 1])
        partial[e] = functions_move or (moves and covered < 2.0 - ROUNDING)
        pair_offsets[e + 1] = pair_offsets[e] + (size * size if partial[e] else size)
    pairs = np.empty((pair_offsets[count], 2), np.int64)
    for e in range(count):
        p = pair_offsets[e]
        for i in range(offsets[e], offsets[e + 1]):
            first, last = (offsets[e], offsets[e + 1]) if partial[e] else (i, i + 1)
            for k in range(first, last):
                pairs[p, 0], pairs[p, 1] = i, k
                p += 1
    return owner, partial, pair_offsets, pairs


@kernel
def find_segments_within(
    geometry,
    slave_facets,
    master_facets,
    radius,
    bodies,
    outline,
    rounding,
    limits,
    roles,
    functions_move,
):
    """Results of ``find_segments``, and of ``couple_segments`` for them.

    The ``behind`` is made of ``bodies``, ``outline`` and ``rounding``.

    Entry point from Python: in each call numba determines the types of tuples of more than four
    arrays again, which takes 0.2 ms.
    """
    safe, slave_bodies, master_bodies = bodies
    behind = (safe, slave_bodies, master_bodies, outline, rounding)
    found = find_segments(geometry, slave_facets, master_facets, radius, behind, limits, roles)
    return found, couple_segments(found[0], found[3], found[2], functions_move)
