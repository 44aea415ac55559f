# SPDX-License-Identifier: MIT
"""Triangles in space: distances of points from them, nearest ones, normals of those that face them.

On a surface in contact with itself only some facets are masters of a slave facet, see
``is_master``; ``facing_normals`` counts triangles on these alone.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import cross, dot
from fenics_mortar.kernels.tree import query_tree

# Order and near facets, see ``is_master``, of a surface that is not in contact with itself.
NO_ROLES = np.empty(0, np.int64), np.empty((0, 0), np.int64)


@kernel
def square_on_edge(p, a, b):
    """Squared distance of p (3,) from the segment a b."""
    length = along = square = 0.0
    for d in range(3):
        length += (b[d] - a[d]) ** 2
        along += (p[d] - a[d]) * (b[d] - a[d])
    t = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    for d in range(3):
        square += (p[d] - a[d] - t * (b[d] - a[d])) ** 2
    return square


@kernel
def square_on_triangle(p, a, b, c):
    """Squared distance of p (3,) from a triangle."""
    u, v, q = b - a, c - a, p - a
    uu, uv, vv, uq, vq = dot(u, u), dot(u, v), dot(v, v), dot(u, q), dot(v, q)
    det = uu * vv - uv * uv
    s, t = vv * uq - uv * vq, uu * vq - uv * uq
    if det > 0.0 and s >= 0.0 and t >= 0.0 and s + t <= det:
        square = 0.0
        for d in range(3):
            square += (q[d] - (s * u[d] + t * v[d]) / det) ** 2
        return square
    ab, bc, ca = square_on_edge(p, a, b), square_on_edge(p, b, c), square_on_edge(p, c, a)
    return min(ab, min(bc, ca))


@kernel
def corners_of(x, triangle):
    """Positions of the three nodes of a triangle (3,)."""
    return x[triangle[0]], x[triangle[1]], x[triangle[2]]


@kernel
def nearest_triangle(x, triangles, boxes, hits, p, radius):
    """Distance of p (3,) from triangles (m, 3) with a tree of ``boxes``, and the nearest one.

    ``radius``: first guess of the distance [length], positive.
    """
    box, none = np.empty(6), np.empty((0, 5))
    while True:
        for d in range(3):
            box[d], box[3 + d] = p[d] - radius, p[d] + radius
        best, nearest = np.inf, -1
        for f in hits[: query_tree(boxes, box, none, hits)]:
            square = square_on_triangle(p, *corners_of(x, triangles[f]))
            if square < best:
                best, nearest = square, f
        if best <= radius * radius or not radius < np.inf:
            return np.sqrt(best), nearest
        radius *= 2.0


@kernel
def is_master(roles, slave, other):
    """Whether facet ``other`` is a master of facet ``slave``; with ``NO_ROLES`` any is.

    ``roles``: as in ``pairs.find_pairs``, or ``NO_ROLES``.
    """
    order, near = roles
    if order.size == 0:
        return True
    if order[slave] >= order[other]:
        return False
    for facet in near[slave]:
        if facet == other:
            return False
    return True


@kernel
def is_master_of_any(roles, slaves, other):
    """``is_master`` of at least one of the facets ``slaves`` (s,)."""
    for slave in slaves:
        if is_master(roles, slave, other):
            return True
    return False


@kernel
def facing_normals(x, triangles, boxes, points, n, equal, first, largest, masters):
    """Reversed mean normals of the nearest triangles that face directions ``n``, (k, 3).

    Args:
        x: Positions of the nodes, shape (m, 3) [length].
        triangles: Their triangles, shape (t, 3).
        boxes: ``build_tree(x, triangles)``.
        points: The points, shape (k, 3) [length].
        n: Unit vectors, shape (k, 3); returned where no triangle faces them.
        equal: Differences of distances that count as none, shape (k,) [length].
        first: First guesses of the distances, shape (k,) [length], positive.
        largest: Largest distance [length].
        masters: (roles, see ``is_master``; facet of each triangle (t,); where the slave facets at
            each point start (k + 1,), and these (e,)): only triangles on masters of these count.
    """
    roles, facets, starts, slaves = masters
    found, box, none = n.copy(), np.empty(6), np.empty((0, 5))
    hits = np.empty(boxes.shape[0] // 2, np.int64)
    normal, distances = np.empty(3), np.empty(hits.size)
    for k in range(len(points)):
        radius, nearest, own = min(first[k], largest), np.inf, slaves[starts[k] : starts[k + 1]]
        while True:
            for d in range(3):
                box[d] = points[k, d] - radius - equal[k]
                box[3 + d] = points[k, d] + radius + equal[k]
            count = query_tree(boxes, box, none, hits)
            for i in range(count):
                a, b, c = corners_of(x, triangles[hits[i]])
                distances[i] = np.inf
                if volume(a, b, c, a + n[k]) < 0.0 and is_master_of_any(
                    roles, own, facets[hits[i]]
                ):
                    distances[i] = np.sqrt(square_on_triangle(points[k], a, b, c))
                nearest = min(nearest, distances[i])
            if nearest <= radius or radius >= largest:
                break
            radius, nearest = min(2.0 * radius, largest), np.inf
        if not nearest <= largest:
            continue
        found[k] = 0.0
        for i in range(count):
            if distances[i] <= nearest + equal[k]:
                a, b, c = corners_of(x, triangles[hits[i]])
                cross(c - a, b - a, normal)
                found[k] += normal / np.sqrt(dot(normal, normal))
        found[k] /= np.sqrt(dot(found[k], found[k]))
    return found


@kernel
def volume(a, b, c, d):
    """Six times the volume of a tetrahedron, positive if d is on the side of (b - a) x (c - a)."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    return wx * (uy * vz - uz * vy) + wy * (uz * vx - ux * vz) + wz * (ux * vy - uy * vx)
