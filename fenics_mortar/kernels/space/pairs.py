# SPDX-License-Identifier: MIT
"""Search for the master facets that share an area with each slave facet.

The boxes of the master facets, in an order in which neighbours are near each other (Morton 1966),
are the leaves of a ``tree``. Candidates of a linear piece of a slave facet are the boxes that
intersect its prism, which reaches a radius to both sides. A piece of a master facet is kept if it
faces the slave piece, if their flat images have a common part, if it is within the radius there,
and if it is not behind both bodies, see ``inside``.

As in the plane, see ``kernels.search``, the nearest of pieces at the same place counts, and of
portions of the master, each connected by common nodes, those far behind the nearest one are left
out. Facets with a common node are never at the same place: on a curved master they overlap slightly
as seen from a plane.

On a surface in contact with itself only some facets are masters of a slave facet; the others hide
what is behind them all the same.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import copy_row, copy_rows, grown, sort_rows
from fenics_mortar.kernels.sight import reach_behind
from fenics_mortar.kernels.space.clipping import clip, clipping_work, signed_area
from fenics_mortar.kernels.space.inside import bulge, is_hidden, is_nearer_elsewhere
from fenics_mortar.kernels.space.integrals import lift
from fenics_mortar.kernels.space.normals import find_point, flatten, piece_edges, set_plane
from fenics_mortar.kernels.space.shapes import piece_centres, pieces_of, triangles_of
from fenics_mortar.kernels.space.triangles import NO_ROLES, is_master
from fenics_mortar.kernels.tree import build_tree, query_tree, spatial_order
from fenics_mortar.utils.arrays import ROUNDING, SAME_PLACE

# Vertices of the common part of two octagons, and those that rounding may add.
MAX_COMMON = 20


@kernel
def query_prism(boxes, x, nodes, corners, radius, frame, hits):
    """Master facets whose boxes intersect the prism of one slave piece, shape (h,).

    ``corners`` are the local numbers of the corners of the piece.
    """
    box, along = np.empty(6), np.empty((3, 5))
    box[:3], box[3:] = np.inf, -np.inf
    along[:, 3], along[:, 4] = np.inf, -np.inf
    for k in corners:
        for d in range(3):
            position, reach = x[nodes[k], d], radius * abs(frame[2, d])
            box[d], box[3 + d] = min(box[d], position - reach), max(box[3 + d], position + reach)
            place = 0.0
            for c in range(3):
                along[d, c] = frame[d, c]
                place += frame[d, c] * x[nodes[k], c]
            reach = radius if d == 2 else 0.0
            along[d, 3], along[d, 4] = (
                min(along[d, 3], place - reach),
                max(along[d, 4], place + reach),
            )
    margin = ROUNDING * (along[0, 4] - along[0, 3] + along[1, 4] - along[1, 3])
    for d in range(3):
        box[d], box[3 + d] = box[d] - margin, box[3 + d] + margin
        along[d, 3], along[d, 4] = along[d, 3] - margin, along[d, 4] + margin
    return hits[: query_tree(boxes, box, along, hits)]


@kernel
def cosine(images, heights, corners):
    """Cosine of the normal of a piece and that of the plane; ``corners`` are rows of images."""
    last = corners.size - 1
    ex, ey, fx, fy = piece_edges(images, corners)
    ez = heights[corners[last - 1]] - heights[corners[0]]
    fz = heights[corners[last]] - heights[corners[0] if last == 2 else corners[1]]
    x, y, z = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
    return z / np.sqrt(x * x + y * y + z * z)


@kernel
def distance_at(images, heights, V, count, centres, N, L):
    """Height of the master above the slave at the middle of a polygon [length].

    ``centres`` are those of the two pieces in reference coordinates. The height is zero where a
    facet is folded, which the integration reports.
    """
    point = np.zeros(2)
    for i in range(count):
        for d in range(2):
            point[d] += V[i, d] / count
    det = find_point(images, 0, point, centres[0][0], centres[0][1], N)
    det_master = find_point(images, N.shape[1], point, centres[1][0], centres[1][1], L)
    if not (det > 0.0 and det_master < 0.0):
        return 0.0
    distance = 0.0
    for k in range(N.shape[1]):
        distance -= N[0, k] * heights[k]
    for l in range(L.shape[1]):
        distance += L[0, l] * heights[N.shape[1] + l]
    return distance


@kernel
def share_node(one, other):
    """Whether two facets (K,) have a common node."""
    for node in one:
        for candidate in other:
            if node == candidate:
                return True
    return False


@kernel
def overlap(one, count, other, others, area, work):
    """Whether two polygons (v, 8) share more than rounding of an ``area``."""
    both, rows = np.empty((count + others, 8)), np.arange(count + others)
    copy_rows(one, count, both, 0)
    copy_rows(other, others, both, count)
    for i in range(others):  # clockwise
        rows[count + i] = count + others - 1 - i
    common = clip(both, rows[:count], rows[count:], area, work)
    return common > 0 and signed_area(work[0], common) > SAME_PLACE * area


@kernel
def next_nearest(found, count):
    """First row with the smallest distance among those that are not decided yet."""
    nearest = -1
    for i in range(count):
        if found[i, 4] < 0.0 and (nearest < 0 or found[i, 0] < found[nearest, 0]):
            nearest = i
    return nearest


@kernel
def keep_nearest(found, polygons, count, master_facets, area, work):
    """Fill the last column of ``found`` with whether a piece is the nearest at its place.

    Rows of ``found`` (c, 5): (distance, height [length], master facet, vertices of its polygon,
    kept), the first ``count`` of which are used; ``polygons`` (c, v, 8); ``area``: of the slave
    piece.
    """
    for i in range(count):
        found[i, 4] = -1.0
    for _ in range(count):
        i = next_nearest(found, count)
        one, near = master_facets[int(found[i, 2])], True
        for j in range(count):
            other = master_facets[int(found[j, 2])]
            if not near or found[j, 4] <= 0.0 or share_node(one, other):
                continue
            size, sizes = int(found[i, 3]), int(found[j, 3])
            near = not overlap(polygons[i], size, polygons[j], sizes, area, work)
        found[i, 4] = 1.0 if near else 0.0


@kernel
def keep_near_portions(found, count, master_facets, length):
    """Drop portions of the master too far behind the nearest one; return the number of rows kept.

    Limit: ``sight.reach_behind``. Rows of ``found`` (c, 4): (distance, height
    [length], master facet, portion); ``length``: longest edge of the slave facet.
    """
    nearest, gap, farthest = np.inf, np.inf, 0.0
    for i in range(count):
        farthest = max(farthest, found[i, 0])
        if found[i, 0] < nearest:
            nearest, gap = found[i, 0], found[i, 1]
    limit = nearest + reach_behind(gap, length)
    if count == 0 or farthest <= limit:
        return count
    find_portions(found, count, master_facets)
    kept = 0
    for i in range(count):
        distance = np.inf
        for j in range(count):
            if found[j, 3] == found[i, 3]:
                distance = min(distance, found[j, 0])
        if distance <= limit:
            copy_row(found[i], found[kept])
            kept += 1
    return kept


@kernel
def find_portions(found, count, master_facets):
    """Number the portions of the master in the last column of ``found``, see the module."""
    for i in range(count):
        found[i, 3] = i
    changed = True
    while changed:
        changed = False
        for i in range(count):
            for j in range(i):
                if found[i, 3] == found[j, 3]:
                    continue
                one, other = master_facets[int(found[i, 2])], master_facets[int(found[j, 2])]
                if share_node(one, other):
                    found[i, 3] = found[j, 3] = min(found[i, 3], found[j, 3])
                    changed = True


@kernel
def add_masters(pieces, number, found, count, roles, slave):
    """Add the masters of kept ``pieces`` (c, 5) to the rows ``found`` (c, 4); count the rows."""
    for i in range(number):
        if pieces[i, 4] == 0.0 or not is_master(roles, slave, int(pieces[i, 2])):
            continue
        j = 0
        while j < count and found[j, 2] != pieces[i, 2]:
            j += 1
        if j == count:
            count += 1
        elif found[j, 0] <= pieces[i, 0]:
            continue
        copy_row(pieces[i, :3], found[j])
    return count


@kernel
def longest_edge(x, nodes):
    """Length of the longest edge between corners of a facet with ``nodes`` (K,)."""
    sides = 3 if nodes.size % 3 == 0 and nodes.size < 9 else 4
    longest = 0.0
    for k in range(sides):
        square = 0.0
        for d in range(3):
            square += (x[nodes[(k + 1) % sides], d] - x[nodes[k], d]) ** 2
        longest = max(longest, square)
    return np.sqrt(longest)


@kernel
def search_pairs(
    x, m, slave_facets, master_facets, order, numbers, limits, behind, triangles, roles
):
    """As ``find_pairs``, with the ``order`` (g,) in which the master facets are in the tree.

    ``triangles`` (t, 3) are those of the slave, none if it is in contact with itself.
    """
    radius, min_cosine = limits
    own, others = slave_facets.shape[1], master_facets.shape[1]
    pieces, centres = pieces_of(own), piece_centres(own)
    master_pieces, master_centres = pieces_of(others) + own, piece_centres(others)
    frame, images, heights = np.empty((4, 3)), np.empty((own + others, 2)), np.empty(own + others)
    N, L, work = np.empty((3, own)), np.empty((3, others)), clipping_work(MAX_COMMON)
    start, own_boxes, own_hits = np.empty(3), np.empty((0, 6)), np.empty(0, np.int64)
    boxes = build_tree(m, master_facets[order])
    hits = np.empty(boxes.shape[0] // 2, np.int64)
    of_piece, polygons, found = np.empty((32, 5)), np.empty((32, MAX_COMMON, 8)), np.empty((32, 4))
    offsets, rows = np.zeros(numbers.size + 1, np.int64), np.empty((8 * numbers.size + 32, 1))
    for i in range(numbers.size):
        nodes, count = slave_facets[numbers[i]], 0
        for piece in range(pieces.shape[0]):
            area = set_plane(x, nodes, pieces[piece], frame)
            flatten(x, nodes, frame, 0, images, heights)
            near = query_prism(boxes, x, nodes, pieces[piece], radius, frame, hits)
            most, number = near.size * master_pieces.shape[0], 0
            if most > of_piece.shape[0]:
                of_piece, polygons = np.empty((most, 5)), np.empty((most, MAX_COMMON, 8))
            found = grown(found, count, count + near.size)
            for leaf in near:
                hit = order[leaf]
                flatten(m, master_facets[hit], frame, own, images, heights)
                for other in range(master_pieces.shape[0]):
                    if not cosine(images, heights, master_pieces[other]) < -min_cosine:
                        continue
                    size = clip(images, pieces[piece], master_pieces[other], area, work)
                    if size == 0:
                        continue
                    both = centres[piece], master_centres[other]
                    height = distance_at(images, heights, work[0], size, both, N, L)
                    if abs(height) > radius:
                        continue
                    if -height > behind[0][i]:
                        lift(x, nodes, N, start)
                        least = ROUNDING * np.sqrt(area)
                        sizes = least + bulge(x, nodes), least + bulge(m, master_facets[hit])
                        if is_hidden(start, frame[2], -height, behind, (i, hit), sizes):
                            continue
                        if own_boxes.size == 0 and triangles.size:
                            own_boxes = build_tree(x, triangles)
                            own_hits = np.empty(own_boxes.shape[0] // 2, np.int64)
                        all_own = x, triangles, own_boxes, own_hits
                        if is_nearer_elsewhere(start, frame[2], -height, all_own):
                            continue
                    of_piece[number, 0], of_piece[number, 1] = abs(height), height
                    of_piece[number, 2], of_piece[number, 3] = hit, size
                    copy_rows(work[0], size, polygons[number], 0)
                    number += 1
            keep_nearest(of_piece, polygons, number, master_facets, area, work)
            count = add_masters(of_piece, number, found, count, roles, numbers[i])
        count = keep_near_portions(found, count, master_facets, longest_edge(x, nodes))
        rows = grown(rows, offsets[i], offsets[i] + count)
        sort_rows(found, count, 2)
        copy_rows(found[:, 2:3], count, rows, offsets[i])
        offsets[i + 1] = offsets[i] + count
    masters = np.empty(offsets[-1], np.int64)
    for p in range(masters.size):
        masters[p] = int(rows[p, 0])
    return offsets, masters


def nothing_behind(count):
    """Argument ``behind`` of ``find_pairs`` that does not limit the search for ``count`` facets."""
    none = np.empty(0, np.int64)
    outline = np.empty((0, 3)), np.empty((0, 3), np.int64), none, np.empty((2, 6)), none
    return np.full(count, np.inf), none, none, outline


def find_pairs(
    x, m, slave_facets, master_facets, numbers, radius, min_cosine, behind=None, roles=None
):
    """Find the master facets that share an area with slave facets along their normals n_0.

    Args:
        x: Positions of the slave nodes, shape (n, 3) [length].
        m: Positions of the master nodes, shape (k, 3) [length].
        slave_facets: Nodes of the slave facets, shape (f, K).
        master_facets: Nodes of the master facets, shape (g, K').
        numbers: Slave facets for which masters are searched, shape (s,).
        radius: Largest distance along the normal [length].
        min_cosine: Smallest cosine of slave normal and reversed master normal [1].
        behind: As in ``inside.is_hidden``, for the slave facets ``numbers``; no limits by default.
        roles: Of a surface in contact with itself the position of each facet in the order of slaves
            before masters, (f,), and the facets near each one that are no masters of it, -1 for
            none, (f, c); by default all facets are masters.

    Returns:
        Offsets (s + 1,): pairs of the i-th of the ``numbers`` are offsets[i]:offsets[i + 1]; master
        facets of the pairs, increasing for each slave facet, (p,).
    """
    order = spatial_order(m[master_facets[:, 0]])
    behind = nothing_behind(numbers.size) if behind is None else behind
    triangles = triangles_of(slave_facets if roles is None else slave_facets[:0])[0]
    roles = NO_ROLES if roles is None else roles
    limits = radius, min_cosine
    return search_pairs(
        x, m, slave_facets, master_facets, order, numbers, limits, behind, triangles, roles
    )
