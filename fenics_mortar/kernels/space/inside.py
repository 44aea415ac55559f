# SPDX-License-Identifier: MIT
"""Points inside closed surfaces of triangles: winding numbers, and distances from the surface.

The winding number is the sum of the signs of the triangles that a ray leaves or enters through. The
ray has a direction that is not parallel to anything in a mesh. Where it passes a triangle's edge
within rounding the number is that of the solid angles of all triangles (van Oosterom & Strackee
1983).

Also edges of surfaces that pierce triangles.

Partners behind a slave point in space, as ``kernels.sight`` in the plane.

``outline`` = (positions of nodes (b, 3) [length], triangles counter-clockwise seen from outside
(m, 3), their bodies (m,), tree of their boxes, space for hits), see ``tree``.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import det, dot, grown
from fenics_mortar.kernels.sight import covers_point, first_exit
from fenics_mortar.kernels.space.normals import set_across
from fenics_mortar.kernels.space.triangles import nearest_triangle, volume
from fenics_mortar.kernels.tree import query_tree
from fenics_mortar.utils.arrays import ROUNDING

# Direction of the rays, and two directions across, a right-handed orthonormal frame (Rodrigues
# rotation of the axes by an angle [radian] that no mesh has).
_ANGLE, _AXIS = 0.7368062997, np.array([0.3711, 0.5423, 0.7537])
_UNIT = _AXIS / np.linalg.norm(_AXIS)
_CROSS = np.array(
    [[0.0, -_UNIT[2], _UNIT[1]], [_UNIT[2], 0.0, -_UNIT[0]], [-_UNIT[1], _UNIT[0], 0.0]]
)
# The frame: direction of the rays first [1].
FRAME = np.eye(3) + np.sin(_ANGLE) * _CROSS + (1.0 - np.cos(_ANGLE)) * _CROSS @ _CROSS


@kernel
def solid_angle(a, b, c):
    """Solid angle of the triangle of three vectors (3,) from a point, over 4 pi."""
    la, lb, lc = np.sqrt(dot(a, a)), np.sqrt(dot(b, b)), np.sqrt(dot(c, c))
    rest = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
    return np.arctan2(det(a, b, c), rest) / (2.0 * np.pi)


@kernel
def winding_by_angles(x, triangles, p):
    """Number of times that closed triangles (m, 3) contain p (3,), by their solid angles."""
    total = 0.0
    for nodes in triangles:
        total += solid_angle(x[nodes[0]] - p, x[nodes[1]] - p, x[nodes[2]] - p)
    return int(np.rint(total))


@kernel
def meets_ray(x, nodes, p):
    """How the ray from p (3,) meets a triangle: 1 leaving, -1 entering, 0 not, 2 uncertain."""
    u, v, w = np.empty(3), np.empty(3), np.empty(3)
    for k in range(3):
        u[k] = v[k] = w[k] = 0.0
        for d in range(3):
            distance = x[nodes[k], d] - p[d]
            u[k] += FRAME[0, d] * distance
            v[k] += FRAME[1, d] * distance
            w[k] += FRAME[2, d] * distance
    size, height, area = 0.0, 0.0, 0.0
    positive = negative = True
    near = False
    for k in range(3):
        size = max(size, u[k] * u[k] + v[k] * v[k])
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        part = u[i] * v[j] - u[j] * v[i]
        near = near or abs(part) <= ROUNDING * size
        positive, negative = positive and part > 0.0, negative and part < 0.0
        area, height = area + part, height + part * w[k]
    if near:
        return 2
    if not (positive or negative) or not height / area > 0.0:
        return 0
    return 1 if positive else -1


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
def winding_number(x, triangles, boxes, hits, p):
    """Number of times that closed triangles (m, 3) with a tree of ``boxes`` contain p (3,)."""
    for d in range(3):
        if not (boxes[1, d] <= p[d] <= boxes[1, 3 + d]):
            return 0
    box, along = np.empty(6), np.empty((2, 5))
    along[:, :3] = FRAME[:2]
    set_ray(boxes, p, FRAME[2], along, box)
    total = 0
    for f in hits[: query_tree(boxes, box, along, hits)]:
        sign = meets_ray(x, triangles[f], p)
        if sign == 2:
            return winding_by_angles(x, triangles, p)
        total += sign
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


# Distance of a partner from another part of the slave, over that along a facet's normal [1], below
# which it belongs to that part. Along curved slaves the two differ by less than this.
MUCH_NEARER = 0.5


@kernel
def crossing_of(x, nodes, origin, direction, at):
    """Sign with which a line crosses a triangle, 1 exit, -1 entry, 0 none; ``at[0]``: its place.

    Both triangles at an edge see the edge from its first node to its last one, and so on the same
    side of the line: a closed surface is left as often as it is entered.
    """
    inside = outside = True
    height = area = 0.0
    for k in range(3):
        i, j = nodes[(k + 1) % 3], nodes[(k + 2) % 3]
        low, high = min(i, j), max(i, j)
        side = place = 0.0
        for d in range(3):
            e = (d + 1) % 3
            f = (d + 2) % 3
            side += direction[d] * (
                (x[low, e] - origin[e]) * (x[high, f] - origin[f])
                - (x[low, f] - origin[f]) * (x[high, e] - origin[e])
            )
            place += direction[d] * (x[nodes[k], d] - origin[d])
        is_left = (side > 0.0) == (i < j)
        inside, outside = inside and is_left, outside and not is_left
        part = side if i < j else -side
        area, height = area + part, height + part * place
    if not (inside or outside) or area == 0.0:
        return 0.0
    at[0] = height / area
    return 1.0 if inside else -1.0


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
        sign = crossing_of(x, triangles[f], origin, direction, at)
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
