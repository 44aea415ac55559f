# SPDX-License-Identifier: MIT
"""Which slave facet meets which master facet: a tree of boxes, and the facets that it finds.

The boxes of the master facets, in the order of the curve, are the leaves of a ``tree``. The
candidates of a slave facet are the boxes that its strip meets, the quadrilateral x_k -+ radius n_k.
So the search costs O(log N + hits) per facet, whatever the radius and the direction of the
interface.

Segments and partners among the master facets that are found: see ``pairing``.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.pairing import curve_starts, facet_segments, point_partners
from fenics_mortar.kernels.tree import build_tree, query_tree


@kernel
def control_points(values, facets):
    """Nodal ``values`` (n, 2) with those of inner nodes replaced: their hull holds the facets.

    The control points of a quadratic curve in Bezier's form; nodes of straight facets are theirs.
    """
    controls = values.copy()
    if facets.shape[1] == 3:
        for f in range(facets.shape[0]):
            a, c, b = facets[f]
            for d in range(2):
                controls[c, d] = 2.0 * values[c, d] - 0.5 * (values[a, d] + values[b, d])
    return controls


@kernel
def query_strip(boxes, controls, nodes, radius, stack, hits):
    """The master facets whose boxes meet the strip of one slave facet, see ``tree``.

    ``controls`` = control points of the slave's positions and normals.
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
    strip[:2] -= 1e-9 * length
    strip[2:] += 1e-9 * length
    along = tx, ty, low - 1e-9 * length * length, high + 1e-9 * length * length
    return hits[: query_tree(boxes, strip, along, stack, hits)]


@kernel
def find_points(geometry, slave_facets, master_facets, radius, view, limits, points, min_points):
    """Find the partners of the same ``points`` (p,), in order, on each of ``slave_facets`` (f, K).

    As ``find_segments``; here ``limits`` = (smallest cosine, fraction of a slave facet within which
    a ray goes through a master node). Returns offsets (f + 1,), master facets (n,) and points
    (n, 2), first and one after the last, of the runs of points with the same partner; no run for
    facets on which fewer than ``min_points`` points have one.
    """
    x, n, m = geometry
    boxes = build_tree(control_points(m, master_facets), master_facets)
    controls = control_points(x, slave_facets), control_points(n, slave_facets)
    starts = curve_starts(master_facets, m.shape[0])
    stack, hits = np.empty(128, np.int64), np.empty(boxes.shape[0] // 2, np.int64)
    partners = np.empty(points.size, np.int64)
    offsets = np.zeros(slave_facets.shape[0] + 1, np.int64)
    rows = np.empty((points.size * slave_facets.shape[0], 3), np.int64)
    for e in range(slave_facets.shape[0]):
        nodes = slave_facets[e]
        near = query_strip(boxes, controls, nodes, radius, stack, hits)
        paired = point_partners(
            geometry, e, nodes, master_facets, starts, near, points, radius, view, limits, partners
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
def find_segments(geometry, slave_facets, master_facets, radius, view, limits):
    """Find the segments of ``slave_facets`` (f, K).

    ``geometry`` = (slave positions, slave normals, master positions), ``view`` as in ``is_hidden``;
    ``limits`` = (least cosine between slave normal and reversed master normal, least length in xi).
    Returns offsets (f + 1,), master facet (n,), end_is_node (n, 2), ends (n, 2).
    """
    x, n, m = geometry
    boxes = build_tree(control_points(m, master_facets), master_facets)
    controls = control_points(x, slave_facets), control_points(n, slave_facets)
    stack, hits = np.empty(128, np.int64), np.empty(boxes.shape[0] // 2, np.int64)
    found = np.empty((64, 6))
    offsets = np.zeros(slave_facets.shape[0] + 1, np.int64)
    rows = np.empty((4 * slave_facets.shape[0] + 64, 6))
    for e in range(slave_facets.shape[0]):
        nodes = slave_facets[e]
        near = query_strip(boxes, controls, nodes, radius, stack, hits)
        if near.size > found.shape[0]:
            found = np.empty((2 * near.size, 6))
        kept = facet_segments(geometry, nodes, master_facets, near, radius, limits, found, view, e)
        start = offsets[e]
        if start + kept > rows.shape[0]:
            longer = np.empty((2 * (start + kept), 6))
            longer[:start] = rows[:start]
            rows = longer
        rows[start : start + kept] = found[:kept]
        offsets[e + 1] = start + kept
    rows = rows[: offsets[-1]]
    end_is_node = rows[:, 4:6] != 0.0
    return offsets, rows[:, 3].astype(np.int64), end_is_node, rows[:, 1:3].copy()


@kernel
def find_segments_within(
    geometry, slave_facets, master_facets, radius, bodies, outline, least, limits
):
    """As ``find_segments``, with the ``view`` (*bodies, outline, least).

    To be called from Python: numba finds out the types of tuples of more than four arrays anew in
    each call, which takes 0.2 ms.
    """
    safe, slave_bodies, master_bodies = bodies
    view = (safe, slave_bodies, master_bodies, outline, least)
    return find_segments(geometry, slave_facets, master_facets, radius, view, limits)
