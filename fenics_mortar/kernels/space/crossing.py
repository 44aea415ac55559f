# SPDX-License-Identifier: MIT
"""Edges of surfaces that pierce triangles."""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.rows import grown
from fenics_mortar.kernels.tree import query_tree


@kernel
def volume(a, b, c, d):
    """Six times the volume of a tetrahedron, positive if d is on the side of (b - a) x (c - a)."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    return wx * (uy * vz - uz * vy) + wy * (uz * vx - ux * vz) + wz * (ux * vy - uy * vx)


@kernel
def find_piercings(x, edges, triangles, boxes):
    """Find the triangles that edges pierce: rows (edge, triangle, place, sign), (r, 4).

    ``place`` is the coordinate on the edge, 0 to 1; ``sign`` is 1 if the edge leaves the body there
    and -1 if it enters. Triangles with a node of the edge do not count.

    Args:
        x: Positions of the nodes, shape (n, 3) [length].
        edges: Nodes of the edges, shape (k, 2).
        triangles: Nodes of the triangles, counter-clockwise seen from outside, shape (m, 3).
        boxes: ``build_tree(x, triangles)``.
    """
    rows, count = np.empty((64, 4)), 0
    box, none = np.empty(6), np.empty((0, 5))
    hits = np.empty(boxes.shape[0] // 2, np.int64)
    for e in range(len(edges)):
        p, q = x[edges[e, 0]], x[edges[e, 1]]
        for d in range(3):
            box[d], box[3 + d] = min(p[d], q[d]), max(p[d], q[d])
        for f in hits[: query_tree(boxes, box, none, hits)]:
            i, j, k = triangles[f]
            if edges[e, 0] in (i, j, k) or edges[e, 1] in (i, j, k):
                continue
            a, b, c = x[i], x[j], x[k]
            begin, end = volume(a, b, c, p), volume(a, b, c, q)
            if not begin * end < 0.0:
                continue
            one, two, three = volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)
            if min(one, min(two, three)) < 0.0 < max(one, max(two, three)):
                continue
            rows = grown(rows, count, count + 1)
            rows[count, 0], rows[count, 1] = float(e), float(f)
            rows[count, 2], rows[count, 3] = begin / (begin - end), np.sign(end - begin)
            count += 1
    return rows[:count].copy()
