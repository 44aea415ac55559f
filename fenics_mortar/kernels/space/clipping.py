# SPDX-License-Identifier: MIT
"""Common part of the flat images of two pieces, as a convex polygon with labelled vertices.

The image of the master piece is clipped by the edges of the slave piece (Sutherland & Hodgman). The
sides are decided once, with real numbers; a vertex is then known by its label alone:

1. a node, of the slave or of the master: V = X;
2. an intersection of the edges (a, b) and (p, q): V = a + s (b - a) = p + r (q - p), with
   ds = [(1 - r) dp + r dq - (1 - s) da - s db] x (q - p) / ((b - a) x (q - p)).

A node within rounding of an edge is on both sides of it, so that edges that coincide do not
intersect. The first vertex, from which the polygon is divided into cells, is known by its place.
Labels of vertices are four numbers of nodes, (node, -1, -1, -1) or (a, b, p, q); two more are the
ends of the edge that follows the vertex.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import copy_row, cross2

# Distance from an edge, over the length of the edge [1], within which a node is on it. Rounding of
# 1e-16 decides where edges at this distance intersect, by 1e-7 of their length: errors of M of 1e-6
# that depend on the place of vertices then keep to 1e-13. Facets on both sides of a slave's edge
# follow that of the master instead, so that all areas are covered once.
ON_EDGE = 1e-9
# Distance of two vertices, over the length of the first slave edge [1], below which they are one.
SAME_VERTEX = 1e-10
# Area of a polygon over that of the slave piece [1], below which it is left out.
NEGLIGIBLE_AREA = 1e-12
# The polygon begins at the vertex nearest to a point beside the second corner of the slave piece,
# at these fractions of its first edge behind the first corner and across [1]: where edges or nodes
# of both sides coincide, rounding decides on the labels of vertices, but not on the place of the
# first one, and so not on the cells of the quadrature. No two vertices of regular meshes are
# equally near.
FIRST = (-1.3137, 0.1719)
# Vertices of two clipped quadrilaterals, and those that rounding may add.
MAX_VERTICES = 12


@kernel
def clipping_work(most):
    """Polygon, (vertices (v, 2), labels (v, 6)), and a second one with the sides of the first.

    ``most`` vertices are possible in both.
    """
    return (
        np.empty((most, 2)), np.empty((most, 6), np.int64), np.empty((most, 2)),
        np.empty((most, 6), np.int64), np.empty(most),
    )  # fmt: skip


@kernel
def signed_area(V, count):
    """Area of a polygon (v, 2) with so many vertices, positive if they are counter-clockwise."""
    area = 0.0 * V[0, 0]
    for i in range(1, count - 1):
        area += 0.5 * cross2(
            V[i, 0] - V[0, 0], V[i, 1] - V[0, 1], V[i + 1, 0] - V[0, 0], V[i + 1, 1] - V[0, 1]
        )
    return area


@kernel
def start_polygon(images, corners, V, labels):
    """Fill a polygon with the image of the master piece, whose ``corners`` are clockwise."""
    count = corners.size
    for i in range(count):
        node, following = corners[count - 1 - i], corners[(2 * count - 2 - i) % count]
        V[i, 0], V[i, 1] = images[node, 0].real, images[node, 1].real
        labels[i, :] = -1
        labels[i, 0], labels[i, 4], labels[i, 5] = node, node, following
    return count


@kernel
def set_label(label, p, q, a, b):
    """Label the vertex of the edges (p, q) and (a, b): a node if they share one."""
    label[:4] = -1
    if p == b or q == a:
        label[0] = a if q == a else b
    else:
        label[0], label[1], label[2], label[3] = a, b, p, q


@kernel
def cut(images, a, b, count, work):
    """Cut off the part of the polygon beyond the slave edge (a, b); return the vertices left."""
    V, labels, V_new, labels_new, side = work
    ax, ay = images[a, 0].real, images[a, 1].real
    ex, ey = images[b, 0].real - ax, images[b, 1].real - ay
    eps, kept = ON_EDGE * (ex * ex + ey * ey), 0
    for i in range(count):
        side[i] = cross2(V[i, 0] - ax, V[i, 1] - ay, ex, ey)
    for i in range(count):
        j = (i + 1) % count
        outside, leaves = side[i] > eps, side[j] > eps
        if not outside:
            copy_row(V[i], V_new[kept])
            copy_row(labels[i], labels_new[kept])
            kept += 1
        if outside == leaves:
            continue
        if side[j if outside else i] < -eps:
            t = side[i] / (side[i] - side[j])
            for d in range(2):
                V_new[kept, d] = V[i, d] + t * (V[j, d] - V[i, d])
            set_label(labels_new[kept], labels[i, 4], labels[i, 5], a, b)
            labels_new[kept, 4], labels_new[kept, 5] = labels[i, 4], labels[i, 5]
            kept += 1
        if leaves:
            labels_new[kept - 1, 4], labels_new[kept - 1, 5] = a, b
    for i in range(kept):
        copy_row(V_new[i], V[i])
        copy_row(labels_new[i], labels[i])
    return kept


@kernel
def merge(V, labels, count, distance):
    """Make one vertex of successive ones within a ``distance``, a node if one is; count them."""
    kept = 0
    for i in range(count):
        to = kept - 1 if kept > 0 else 0
        if kept > 0 and is_near(V[to], V[i], distance):
            if labels[to, 1] >= 0:
                copy_row(labels[i], labels[to])
                copy_row(V[i], V[to])
            continue
        copy_row(V[i], V[kept])
        copy_row(labels[i], labels[kept])
        kept += 1
    if kept > 1 and is_near(V[kept - 1], V[0], distance):
        if labels[0, 1] >= 0:
            copy_row(labels[kept - 1], labels[0])
            copy_row(V[kept - 1], V[0])
        kept -= 1
    return kept


@kernel
def is_near(one, other, distance):
    """Whether two points of the plane are within a ``distance``."""
    x, y = one[0] - other[0], one[1] - other[1]
    return x * x + y * y < distance * distance


@kernel
def begin_near(x, y, count, work):
    """Begin the polygon at its vertex nearest to (x, y)."""
    V, labels, V_new, labels_new, square = work
    first = 0
    for i in range(count):
        square[i] = (V[i, 0] - x) ** 2 + (V[i, 1] - y) ** 2
        if square[i] < square[first]:
            first = i
    if first == 0:
        return
    for i in range(count):
        copy_row(V[(first + i) % count], V_new[i])
        copy_row(labels[(first + i) % count], labels_new[i])
    for i in range(count):
        copy_row(V_new[i], V[i])
        copy_row(labels_new[i], labels[i])


@kernel
def clip(images, slave, master, area, work):
    """Fill the polygon in ``work`` with the common part of two pieces; return its vertices.

    Args:
        images: Flat images of all nodes, shape (K + K', 2).
        slave: Rows of ``images`` of the corners of the slave piece, shape (3 or 4,).
        master: Those of the master piece, which are clockwise if it faces the slave, (3 or 4,).
        area: Area of the slave piece.
        work: See ``clipping_work``.

    Returns:
        Number of vertices; 0 without common part, or if the master does not face the slave.
    """
    V, labels = work[0], work[1]
    count = start_polygon(images, master, V, labels)
    if not signed_area(V, count) > 0.0:
        return 0
    for i in range(slave.size):
        count = cut(images, slave[i], slave[(i + 1) % slave.size], count, work)
        if count < 3:
            return 0
    x = images[slave[1], 0].real - images[slave[0], 0].real
    y = images[slave[1], 1].real - images[slave[0], 1].real
    count = merge(V, labels, count, SAME_VERTEX * np.sqrt(x * x + y * y))
    begin_near(
        images[slave[0], 0].real - FIRST[0] * x + FIRST[1] * y,
        images[slave[0], 1].real - FIRST[0] * y - FIRST[1] * x,
        count, work,
    )  # fmt: skip
    return count if count > 2 and signed_area(V, count) > NEGLIGIBLE_AREA * area.real else 0


@kernel
def place_vertices(images, labels, count, V, shares):
    """Fill ``V`` (v, 2) by the ``labels``; ``shares`` (v, 2) with s and r of intersections."""
    for i in range(count):
        a, b, p, q = labels[i, 0], labels[i, 1], labels[i, 2], labels[i, 3]
        if b < 0:
            copy_row(images[a], V[i])
            continue
        ux, uy = images[b, 0] - images[a, 0], images[b, 1] - images[a, 1]
        wx, wy = images[q, 0] - images[p, 0], images[q, 1] - images[p, 1]
        dx, dy = images[p, 0] - images[a, 0], images[p, 1] - images[a, 1]
        s = cross2(dx, dy, wx, wy) / cross2(ux, uy, wx, wy)
        V[i, 0], V[i, 1] = images[a, 0] + s * ux, images[a, 1] + s * uy
        r = (V[i, 0] - images[p, 0]) * wx + (V[i, 1] - images[p, 1]) * wy
        shares[i, 0], shares[i, 1] = s, r / (wx * wx + wy * wy)


@kernel
def chain_vertices(images, labels, count, shares, by_V, by_image):
    """Add to ``by_image`` (K + K', 2, r) what the rows ``by_V`` (v, 2, r) are with respect to it.

    Both are derivatives of r numbers, by the vertices and by the images of the nodes.
    """
    rows = by_V.shape[2]
    for i in range(count):
        a, b, p, q = labels[i, 0], labels[i, 1], labels[i, 2], labels[i, 3]
        if b < 0:
            for k in range(rows):
                by_image[a, 0, k] += by_V[i, 0, k]
                by_image[a, 1, k] += by_V[i, 1, k]
            continue
        ux, uy = images[b, 0] - images[a, 0], images[b, 1] - images[a, 1]
        wx, wy = images[q, 0] - images[p, 0], images[q, 1] - images[p, 1]
        det, s, r = cross2(ux, uy, wx, wy), shares[i, 0], shares[i, 1]
        wx, wy = wx / det, wy / det
        for k in range(rows):
            along = by_V[i, 0, k] * ux + by_V[i, 1, k] * uy
            x, y = along * wy, -along * wx
            own_x, own_y = by_V[i, 0, k] - x, by_V[i, 1, k] - y
            by_image[a, 0, k] += (1.0 - s) * own_x
            by_image[a, 1, k] += (1.0 - s) * own_y
            by_image[b, 0, k] += s * own_x
            by_image[b, 1, k] += s * own_y
            by_image[p, 0, k] += (1.0 - r) * x
            by_image[p, 1, k] += (1.0 - r) * y
            by_image[q, 0, k] += r * x
            by_image[q, 1, k] += r * y
