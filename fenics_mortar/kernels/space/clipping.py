# SPDX-License-Identifier: MIT
"""Common part of the flat images of two pieces, as a convex polygon with labelled vertices.

The image of the master piece is clipped by the edges of the slave piece (Sutherland & Hodgman). The
sides are decided once, with real numbers; a vertex is then known by its label alone:

1. a node, of the slave or of the master: V = X;
2. an intersection of the edges (a, b) and (p, q): V = a + s (b - a) = p + r (q - p), with
   ds = [(1 - r) dp + r dq - (1 - s) da - s db] x (q - p) / ((b - a) x (q - p)).

A node within rounding of an edge is on both sides of it, so that edges that coincide do not
intersect. The first vertex, from which the polygon is divided into cells, is known by its place,
which the shapes of both facets determine, or, of parallelograms with one centre, the first edge of
the slave.
Labels of vertices are four numbers of nodes, (node, -1, -1, -1) or (a, b, p, q); two more are the
ends of the edge that follows the vertex. A row of a polygon (v, 8) is the place, the label and
these ends.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import add_row, copy_row, copy_rows, cross2

# Distance from an edge, over the length of the edge [1], within which a node is on it. Rounding of
# 1e-16 decides where edges at this distance intersect, by 1e-7 of their length: errors of M of 1e-6
# that depend on the place of vertices then keep to 1e-13. Facets on both sides of a slave's edge
# follow that of the master instead, so that all areas are covered once.
ON_EDGE = 1e-9
# Distance of two vertices, over the length of the first slave edge [1], below which they are one.
SAME_VERTEX = 1e-10
# Area of a polygon over that of the slave piece [1], below which it is left out.
NEGLIGIBLE_AREA = 1e-12
# The polygon begins at its farthest vertex in the direction of the third moments of the nodes of
# both facets, each turned and scaled by these complex factors [1]: where edges or nodes of both
# sides coincide, rounding decides on the labels of vertices, but not on the place of the first one,
# and so not on the cells of the quadrature. The moments do not depend on the numbers of the nodes.
# They vanish for parallelograms, where the error of the rule comes from normals alone: there the
# way between the centres decides, and if these coincide, too, the first edge of the slave. No two
# vertices of regular meshes are equally far in any of these directions.
BY_SLAVE, BY_MASTER = (-0.9659, 0.2588), (-0.6578, -0.2394)
BY_WAY, BY_EDGE = (1.1719e-4, 0.3137e-4), (1.3137e-9, -0.1719e-9)
# Vertices of two clipped quadrilaterals, and those that rounding may add.
MAX_VERTICES = 12


@kernel
def clipping_work(most):
    """Two polygons of at most ``most`` vertices, and the sides of the vertices of the first."""
    return np.empty((most, 8)), np.empty((most, 8)), np.empty(most)


@kernel
def signed_area(V, count):
    """Area of a polygon (v, 2 or more) of ``count`` vertices, positive if counter-clockwise."""
    area = 0.0 * V[0, 0]
    for i in range(1, count - 1):
        area += 0.5 * cross2(
            V[i, 0] - V[0, 0], V[i, 1] - V[0, 1], V[i + 1, 0] - V[0, 0], V[i + 1, 1] - V[0, 1]
        )
    return area


@kernel
def start_polygon(images, corners, polygon):
    """Fill a polygon with the image of the master piece, whose ``corners`` are clockwise."""
    count = corners.size
    for i in range(count):
        node, following = corners[count - 1 - i], corners[(2 * count - 2 - i) % count]
        polygon[i, 0], polygon[i, 1] = images[node, 0].real, images[node, 1].real
        polygon[i, 2:] = -1.0
        polygon[i, 2], polygon[i, 6], polygon[i, 7] = node, node, following
    return count


@kernel
def set_label(label, p, q, a, b):
    """Label the vertex of the edges (p, q) and (a, b): a node if they share one."""
    label[:4] = -1.0
    if p == b or q == a:
        label[0] = a if q == a else b
    else:
        label[0], label[1], label[2], label[3] = a, b, p, q


@kernel
def cut(images, a, b, count, work):
    """Cut off the part of the polygon beyond the slave edge (a, b); return the vertices left."""
    polygon, new, side = work
    ax, ay = images[a, 0].real, images[a, 1].real
    ex, ey = images[b, 0].real - ax, images[b, 1].real - ay
    eps, kept = ON_EDGE * (ex * ex + ey * ey), 0
    for i in range(count):
        side[i] = cross2(polygon[i, 0] - ax, polygon[i, 1] - ay, ex, ey)
    for i in range(count):
        j = (i + 1) % count
        outside, leaves = side[i] > eps, side[j] > eps
        if not outside:
            copy_row(polygon[i], new[kept])
            kept += 1
        if outside == leaves:
            continue
        if side[j if outside else i] < -eps:
            t = side[i] / (side[i] - side[j])
            copy_row(polygon[i], new[kept])
            for d in range(2):
                new[kept, d] += t * (polygon[j, d] - polygon[i, d])
            set_label(new[kept, 2:], polygon[i, 6], polygon[i, 7], a, b)
            kept += 1
        if leaves:
            new[kept - 1, 6], new[kept - 1, 7] = a, b
    copy_rows(new, kept, polygon, 0)
    return kept


@kernel
def merge(polygon, count, distance):
    """Merge successive vertices within a ``distance``, into a node if one is; count the result."""
    kept = 0
    for i in range(count):
        to = kept - 1 if kept > 0 else 0
        near = kept > 0 and is_near(polygon[to], polygon[i], distance)
        if not near or polygon[to, 3] >= 0.0:
            copy_row(polygon[i], polygon[to if near else kept])
        kept += 0 if near else 1
    if kept > 1 and is_near(polygon[kept - 1], polygon[0], distance):
        kept -= 1
        if polygon[0, 3] >= 0.0:
            copy_row(polygon[kept], polygon[0])
    return kept


@kernel
def is_near(one, other, distance):
    """Whether two points of the plane are within a ``distance``."""
    x, y = one[0] - other[0], one[1] - other[1]
    return x * x + y * y < distance * distance


@kernel
def add_cube(factor, x, y, along):
    """Add |r|^2 r of r = (x, y), turned and scaled by a complex ``factor``, to ``along`` (2,)."""
    square = x * x + y * y
    along[0] += square * (factor[0] * x - factor[1] * y)
    along[1] += square * (factor[0] * y + factor[1] * x)


@kernel
def add_third_moments(factor, images, start, stop, along):
    """Add the cubes of the places of nodes about their mean; return the mean."""
    cx = cy = 0.0
    for k in range(start, stop):
        cx += images[k, 0].real / (stop - start)
        cy += images[k, 1].real / (stop - start)
    for k in range(start, stop):
        add_cube(factor, images[k, 0].real - cx, images[k, 1].real - cy, along)
    return cx, cy


@kernel
def begin_by_shape(images, own, count, work):
    """Begin the polygon at a vertex that the shapes of both facets determine, see ``BY_SLAVE``.

    ``own``: number of nodes of the slave facet, the first ones of ``images``.
    """
    polygon, new, reach = work
    first, along = 0, np.zeros(2)
    ax, ay = add_third_moments(BY_SLAVE, images, 0, own, along)
    bx, by = add_third_moments(BY_MASTER, images, own, images.shape[0], along)
    add_cube(BY_WAY, bx - ax, by - ay, along)
    x, y = images[1, 0].real - images[0, 0].real, images[1, 1].real - images[0, 1].real
    add_cube(BY_EDGE, x, y, along)
    for i in range(count):
        reach[i] = along[0] * polygon[i, 0] + along[1] * polygon[i, 1]
        if reach[i] > reach[first]:
            first = i
    for i in range(count):
        copy_row(polygon[(first + i) % count], new[i])
    copy_rows(new, count, polygon, 0)


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
    polygon = work[0]
    count = start_polygon(images, master, polygon)
    if not signed_area(polygon, count) > 0.0:
        return 0
    for i in range(slave.size):
        count = cut(images, slave[i], slave[(i + 1) % slave.size], count, work)
        if count < 3:
            return 0
    x = images[slave[1], 0].real - images[slave[0], 0].real
    y = images[slave[1], 1].real - images[slave[0], 1].real
    count = merge(polygon, count, SAME_VERTEX * np.sqrt(x * x + y * y))
    return count if count > 2 and signed_area(polygon, count) > NEGLIGIBLE_AREA * area.real else 0


@kernel
def label_of(vertex):
    """Label (a, b, p, q) of a row of a polygon."""
    return int(vertex[2]), int(vertex[3]), int(vertex[4]), int(vertex[5])


@kernel
def place_vertices(images, polygon, count, V, shares):
    """Fill ``V`` (v, 2) by the labels; ``shares`` (v, 2) with s and r of intersections."""
    for i in range(count):
        a, b, p, q = label_of(polygon[i])
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
def chain_vertices(images, polygon, count, shares, by_V, by_image):
    """Chain rule: add derivatives by images, (K + K', 2, r), given those by vertices, (v, 2, r).

    Both are derivatives of r numbers, by the vertices and by the images of the nodes.
    """
    rows = by_V.shape[2]
    for i in range(count):
        a, b, p, q = label_of(polygon[i])
        if b < 0:
            for d in range(2):
                add_row(1.0, by_V[i, d], by_image[a, d])
            continue
        ux, uy = images[b, 0] - images[a, 0], images[b, 1] - images[a, 1]
        wx, wy = images[q, 0] - images[p, 0], images[q, 1] - images[p, 1]
        det, s, r = cross2(ux, uy, wx, wy), shares[i, 0], shares[i, 1]
        across = wy / det, -wx / det
        for k in range(rows):
            along = by_V[i, 0, k] * ux + by_V[i, 1, k] * uy
            for d in range(2):
                other = along * across[d]
                own = by_V[i, d, k] - other
                by_image[a, d, k] += (1.0 - s) * own
                by_image[b, d, k] += s * own
                by_image[p, d, k] += (1.0 - r) * other
                by_image[q, d, k] += r * other
