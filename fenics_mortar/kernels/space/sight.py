# SPDX-License-Identifier: MIT
"""Partners behind a slave point in space, as ``kernels.sight`` in the plane.

``outline`` = (positions of nodes (b, 3) [length], triangles counter-clockwise seen from outside
(m, 3), their bodies (m,), tree of their boxes, space for hits), see ``tree``.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.sight import covers_point, first_exit
from fenics_mortar.kernels.space.inside import nearest_triangle
from fenics_mortar.kernels.space.normals import set_across
from fenics_mortar.kernels.tree import query_tree
from fenics_mortar.utils.rounding import ROUNDING

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
def find_ray_crossings(origin, direction, outline, own, min_distance, found):
    """As ``kernels.sight.find_ray_crossings``."""
    x, triangles, body, boxes, hits = outline
    box, along, at = np.empty(6), np.empty((2, 5)), np.empty(1)
    set_across(direction, along)
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
    count = 0
    for f in hits[: query_tree(boxes, box, along, hits)]:
        if body[f] != own:
            continue
        sign = crossing_of(x, triangles[f], origin, direction, at)
        if sign != 0.0 and at[0] > min_distance:
            if count < found.shape[1]:
                found[0, count], found[1, count] = at[0], sign
            count += 1
    return count


@kernel
def crossings(origin, direction, outline, own, min_distance):
    """All crossings as rows of ``find_ray_crossings``, shape (2, c)."""
    found = np.empty((2, 32))
    count = find_ray_crossings(origin, direction, outline, own, min_distance, found)
    if count > found.shape[1]:
        found = np.empty((2, count))
        find_ray_crossings(origin, direction, outline, own, min_distance, found)
    return found[:, :count]


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
    length = first_exit(crossings(start, -normal, outline, own, sizes[0]))
    if depth < 0.5 * length:
        return False
    partner = start - depth * normal
    length += first_exit(crossings(partner, normal, outline, other, sizes[1]))
    return not depth < (0.5 - ROUNDING) * length


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
