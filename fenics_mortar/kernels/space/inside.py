# SPDX-License-Identifier: MIT
"""Points inside closed surfaces of triangles, and partners behind both bodies in space.

``depths_inside`` gives the depths of points in bodies by winding numbers and distances from the
surface, ``find_piercings`` the edges of surfaces that pierce triangles. ``is_hidden``,
``is_nearer_elsewhere`` and ``tabulate_lengths`` limit the search behind a slave point, as
``kernels.sight`` in the plane.

``outline`` = (positions of nodes (b, 3) [length], triangles counter-clockwise seen from outside
(m, 3), their bodies (m,), tree of their boxes, space for hits), see ``tree``.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import dot, grown
from fenics_mortar.kernels.sight import covers_point, first_exit
from fenics_mortar.kernels.space.normals import set_across
from fenics_mortar.kernels.space.triangles import nearest_triangle
from fenics_mortar.kernels.tree import query_tree
from fenics_mortar.utils.arrays import ROUNDING

# Direction of the rays, which no edge of a mesh has, over its length [1].
RAY = np.array([0.3711, 0.5423, 0.7537])
# Place of a node on a line, in coordinates across the line [length^2]: its products with those of
# other nodes are no underflow.
BESIDE = (1e-200, 1e-220)


@kernel
def set_ray(boxes, origin, direction, along, box):
    """Fill ``box`` (6,) and ranges ``along`` (2, 5), whose directions are set, around a ray."""
    margin = 0.0
    for d in range(3):
        margin = max(margin, ROUNDING * (boxes[1, 3 + d] - boxes[1, d]))
    for d in range(3):
        box[d] = boxes[1, d] if direction[d] < 0.0 else origin[d] - margin
        box[3 + d] = boxes[1, 3 + d] if direction[d] > 0.0 else origin[d] + margin
    for r in range(2):
        place = 0.0
        for d in range(3):
            place += along[r, d] * origin[d]
        along[r, 3], along[r, 4] = place - margin, place + margin


@kernel
def crossing_of(x, nodes, origin, direction, along, at):
    """Sign with which a line crosses a triangle, 1 exit, -1 entry, 0 none; ``at[0]``: its place.

    ``along`` (2, 3 or more): directions across, see ``set_across``. Both triangles at an edge see
    the edge from its first node to its last one, and so on the same side of the line; a node on
    the line is beside it, alike in all its triangles: a closed surface is left as often as it is
    entered. The place is the product with the direction.
    """
    inside = outside = True
    height = area = 0.0
    for k in range(3):
        i, j = nodes[(k + 1) % 3], nodes[(k + 2) % 3]
        low, high = min(i, j), max(i, j)
        u_low = v_low = u_high = v_high = place = 0.0
        for d in range(3):
            of_low, of_high = x[low, d] - origin[d], x[high, d] - origin[d]
            u_low, v_low = u_low + along[0, d] * of_low, v_low + along[1, d] * of_low
            u_high, v_high = u_high + along[0, d] * of_high, v_high + along[1, d] * of_high
            place += direction[d] * (x[nodes[k], d] - origin[d])
        if u_low == 0.0 and v_low == 0.0:
            u_low, v_low = BESIDE
        if u_high == 0.0 and v_high == 0.0:
            u_high, v_high = BESIDE
        side = u_low * v_high - v_low * u_high
        is_left = (side > 0.0) == (i < j)
        inside, outside = inside and is_left, outside and not is_left
        part = side if i < j else -side
        area, height = area + part, height + part * place
    at[0] = 0.0
    if not (inside or outside) or area == 0.0:
        return 0.0
    at[0] = height / area
    return 1.0 if inside else -1.0


@kernel
def winding_number(x, triangles, boxes, hits, p):
    """Number of times that closed triangles (m, 3) with a tree of ``boxes`` contain p (3,).

    It is the sum of the signs of the triangles that a ray leaves or enters through. The ray has a
    direction that is not parallel to anything in a mesh.
    """
    for d in range(3):
        if not (boxes[1, d] <= p[d] <= boxes[1, 3 + d]):
            return 0
    box, along, at = np.empty(6), np.empty((2, 5)), np.empty(1)
    set_across(RAY, along)
    set_ray(boxes, p, RAY, along, box)
    total = 0
    for f in hits[: query_tree(boxes, box, along, hits)]:
        sign = crossing_of(x, triangles[f], p, RAY, along, at)
        if at[0] > 0.0:
            total += int(sign)
    return total


@kernel
def depths_inside(x, triangles, boxes, points, size):
    """Depths of ``points`` (k, 3) in a body, zero outside, and the nearest triangles, -1 outside.

    Args:
        x: Positions of the nodes, shape (n, 3) [length].
        triangles: Closed surface of the body, shape (m, 3).
        boxes: ``build_tree(x, triangles)``.
        points: The points [length].
        size: Length of a facet [length].
    """
    depths, nearest = np.zeros(len(points)), np.full(len(points), -1)
    hits = np.empty(boxes.shape[0] // 2, np.int64)
    for k in range(len(points)):
        if winding_number(x, triangles, boxes, hits, points[k]) > 0:
            found = nearest_triangle(x, triangles, boxes, hits, points[k], size)
            depths[k], nearest[k] = found
    return depths, nearest


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
    box, none, along, at = np.empty(6), np.empty((0, 5)), np.empty((2, 5)), np.empty(1)
    hits = np.empty(boxes.shape[0] // 2, np.int64)
    for e in range(len(edges)):
        p, q = x[edges[e, 0]], x[edges[e, 1]]
        way = q - p
        square = dot(way, way)
        set_across(way, along)
        for d in range(3):
            box[d], box[3 + d] = min(p[d], q[d]), max(p[d], q[d])
        for f in hits[: query_tree(boxes, box, none, hits)]:
            i, j, k = triangles[f]
            if edges[e, 0] in (i, j, k) or edges[e, 1] in (i, j, k):
                continue
            sign = crossing_of(x, triangles[f], p, way, along, at)
            if sign != 0.0 and 0.0 < at[0] < square:
                rows = grown(rows, count, count + 1)
                rows[count] = float(e), float(f), at[0] / square, sign
                count += 1
    return rows[:count].copy()


# Distance of a partner from another part of the slave, over that along a facet's normal [1], below
# which it belongs to that part. Along curved slaves the two differ by less than this.
MUCH_NEARER = 0.5


@kernel
def crossings(origin, direction, outline, own, min_distance):
    """As ``kernels.sight.crossings``."""
    x, triangles, body, boxes, hits = outline
    box, along, at = np.empty(6), np.empty((2, 5)), np.empty(1)
    set_across(direction, along)
    set_ray(boxes, origin, direction, along, box)
    found, count = np.empty((32, 2)), 0
    for f in hits[: query_tree(boxes, box, along, hits)]:
        if body[f] != own:
            continue
        sign = crossing_of(x, triangles[f], origin, direction, along, at)
        if sign != 0.0 and at[0] > min_distance:
            found = grown(found, count, count + 1)
            found[count, 0], found[count, 1] = at[0], sign
            count += 1
    return found[:count].T


@kernel
def bulge(x, nodes):
    """Distance of a facet (K,) from the triangles between its nodes, or more [length]."""
    count = nodes.size
    sides, largest = (3 if count % 3 == 0 and count < 9 else 4), 0.0
    for k in range(count):
        square = 0.0
        for d in range(3):
            if count == 4:
                off = 0.25 * (x[nodes[0], d] - x[nodes[1], d] + x[nodes[2], d] - x[nodes[3], d])
            elif k < sides:
                off = 0.0
            else:
                i, j = (k, k + 1) if k < 2 * sides else (0, 2)
                off = x[nodes[k], d] - 0.5 * (x[nodes[i % sides], d] + x[nodes[j % sides], d])
            square += off * off
        largest = max(largest, square)
    return np.sqrt(largest)


@kernel
def is_hidden(start, normal, depth, behind, facets, sizes):
    """Whether a partner at ``depth`` [length] behind the slave surface is rejected.

    Args:
        start: Point of the slave surface, shape (3,) [length].
        normal: Unit vector along which the partner was found, outward, shape (3,).
        depth: Distance of the partner behind the slave surface [length].
        behind: Safe depths (f,) [length] and bodies (f,) of the slave facets, bodies of the master
            facets, outline.
        facets: Number of the slave facet in ``behind``, and the master facet.
        sizes: Distances from the slave and from the master facet below which a crossing of a line
            belongs to them [length].
    """
    _, slave_bodies, master_bodies, outline = behind
    own, other = slave_bodies[facets[0]], master_bodies[facets[1]]
    if own == other:
        return not covers_point(crossings(start, -normal, outline, own, sizes[0]), depth + sizes[1])
    length = length_inside(start, -normal, outline, own, sizes[0])
    if depth < 0.5 * length:
        return False
    length += length_inside(start - depth * normal, normal, outline, other, sizes[1])
    return not depth < (0.5 - ROUNDING) * length


@kernel
def length_inside(origin, direction, outline, own, size):
    """Length of a line within body ``own`` from a point of a facet on, inf if it does not leave it.

    Crossings within ``size`` [length] belong to the facet, unless the line leaves the body there,
    as beside an edge, and not beyond.
    """
    length = first_exit(crossings(origin, direction, outline, own, size))
    if length == np.inf and first_exit(crossings(origin, direction, outline, own, 0.0)) < np.inf:
        return size
    return length


@kernel
def is_nearer_elsewhere(start, normal, depth, slave):
    """Whether a partner at ``depth`` [length] is much nearer to another part of the slave surface.

    It is then that part through which the bodies overlap: where the top of a wide block overlaps,
    its sides see partners through the block.

    Args:
        start: Point of the slave surface, shape (3,) [length].
        normal: Unit vector along which the partner was found, outward, shape (3,).
        depth: Distance of the partner behind the slave surface [length].
        slave: Nodes (n, 3) [length], triangles (t, 3) of the slave, tree of these, space for hits;
            without triangles if it is in contact with itself.
    """
    x, triangles, boxes, hits = slave
    if triangles.size == 0:
        return False
    near = MUCH_NEARER * depth
    return nearest_triangle(x, triangles, boxes, hits, start - depth * normal, near)[0] < near


@kernel
def tabulate_lengths(x, n, facets, bodies, outline, min_fraction, lengths):
    """As ``kernels.sight.tabulate_lengths``, behind the means of the facets' nodes."""
    start, back = np.empty(3), np.empty(3)
    for f in range(facets.shape[0]):
        start[:], back[:] = 0.0, 0.0
        for node in facets[f]:
            start += x[node] / facets.shape[1]
            back -= n[node]
        back /= np.sqrt(back[0] ** 2 + back[1] ** 2 + back[2] ** 2)
        edge = x[facets[f, 1]] - x[facets[f, 0]]
        shortest = min_fraction * np.sqrt(edge[0] ** 2 + edge[1] ** 2 + edge[2] ** 2)
        lengths[f] = first_exit(crossings(start, back, outline, bodies[f], shortest))
