# SPDX-License-Identifier: MIT
"""Which slave facet meets which master facet: a tree of boxes, and the facets that it finds.

The boxes of the master facets, taken in the order of the curve, are the leaves of a complete
binary tree in heap layout (children of node i: 2i and 2i + 1, root 1). The candidates of a slave
facet are the boxes that its strip meets, the quadrilateral x_k -+ radius n_k. So the search costs
O(log N + hits) per facet, whatever the radius and the direction of the interface.

Segments and partners among the master facets that are found: see ``pairing``.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.pairing import curve_starts, facet_segments, point_partners


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
def build_tree(x, facets):
    """Boxes (2P, 4) = (xmin, ymin, xmax, ymax) over ``facets`` (m, K) of control points ``x``."""
    leaves = 1
    while leaves < facets.shape[0]:
        leaves *= 2
    boxes = np.empty((2 * leaves, 4))
    boxes[:, :2] = np.inf
    boxes[:, 2:] = -np.inf
    for f in range(facets.shape[0]):
        for node in facets[f]:
            for d in range(2):
                boxes[leaves + f, d] = min(boxes[leaves + f, d], x[node, d])
                boxes[leaves + f, 2 + d] = max(boxes[leaves + f, 2 + d], x[node, d])
    for i in range(leaves - 1, 0, -1):
        for d in range(2):
            boxes[i, d] = min(boxes[2 * i, d], boxes[2 * i + 1, d])
            boxes[i, 2 + d] = max(boxes[2 * i, 2 + d], boxes[2 * i + 1, 2 + d])
    return boxes


@kernel
def misses(box, strip):
    """Whether ``box`` and the strip (6,) = (its box, range along the facet) are apart."""
    return box[0] > strip[2] or box[2] < strip[0] or box[1] > strip[3] or box[3] < strip[1]


@kernel
def misses_along(box, tx, ty, low, high):
    """Whether ``box`` and the strip are apart along the facet, where the strip is thin."""
    middle = 0.5 * ((box[0] + box[2]) * tx + (box[1] + box[3]) * ty)
    half = 0.5 * ((box[2] - box[0]) * abs(tx) + (box[3] - box[1]) * abs(ty))
    return middle - half > high or middle + half < low


@kernel
def query_tree(boxes, x, n, nodes, radius, stack, hits):
    """Fill ``hits`` with the facets whose boxes meet the strip of one slave facet; their number.

    ``x`` and ``n`` are control points. The number may exceed the size of ``hits``: then call again
    with a larger one.
    """
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
    low, high = low - 1e-9 * length * length, high + 1e-9 * length * length
    leaves = boxes.shape[0] // 2
    count, top = 0, 1
    stack[0] = 1
    while top > 0:
        top -= 1
        i = stack[top]
        if misses(boxes[i], strip) or misses_along(boxes[i], tx, ty, low, high):
            continue
        if i >= leaves:
            if count < hits.size:
                hits[count] = i - leaves
            count += 1
        else:
            stack[top], stack[top + 1] = 2 * i, 2 * i + 1
            top += 2
    return count


@kernel
def candidates(boxes, controls, nodes, radius, stack, hits):
    """The facets that ``query_tree`` finds; in ``hits`` if it is long enough."""
    count = query_tree(boxes, *controls, nodes, radius, stack, hits)
    if count > hits.size:
        hits = np.empty(2 * count, np.int64)
        query_tree(boxes, *controls, nodes, radius, stack, hits)
    return hits[:count]


@kernel
def find_points(geometry, slave_facets, master_facets, radius, view, limits, points, least_points):
    """Find the partners of the same ``points`` (p,), in order, on each of ``slave_facets`` (f, K).

    As ``find_segments``; here ``limits`` = (least cosine, part of a slave facet within which a ray
    goes through a master node). Returns offsets (f + 1,), master facets (n,) and points (n, 2),
    first and one after the last, of the runs of points with the same partner; no run for facets of
    which fewer than ``least_points`` points have one.
    """
    x, n, m = geometry
    boxes = build_tree(control_points(m, master_facets), master_facets)
    controls = control_points(x, slave_facets), control_points(n, slave_facets)
    starts = curve_starts(master_facets, m.shape[0])
    stack, hits = np.empty(128, np.int64), np.empty(64, np.int64)
    partners = np.empty(points.size, np.int64)
    offsets = np.zeros(slave_facets.shape[0] + 1, np.int64)
    rows = np.empty((points.size * slave_facets.shape[0], 3), np.int64)
    for e in range(slave_facets.shape[0]):
        nodes = slave_facets[e]
        near = candidates(boxes, controls, nodes, radius, stack, hits)
        paired = point_partners(
            geometry, e, nodes, master_facets, starts, near, points, radius, view, limits, partners
        )
        end = offsets[e]
        for p in range(points.size):
            if paired < least_points or partners[p] < 0:
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
    stack = np.empty(128, np.int64)
    hits = np.empty(64, np.int64)
    found = np.empty((64, 6))
    offsets = np.zeros(slave_facets.shape[0] + 1, np.int64)
    rows = np.empty((4 * slave_facets.shape[0] + 64, 6))
    for e in range(slave_facets.shape[0]):
        nodes = slave_facets[e]
        near = candidates(boxes, controls, nodes, radius, stack, hits)
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
