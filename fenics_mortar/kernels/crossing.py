# SPDX-License-Identifier: MIT
"""Crossing boundaries: segments of outlines that cross in a state.

==========  ======================================================================  ==============
symbol      meaning                                                                 shape
==========  ======================================================================  ==============
x           positions of the nodes of all outlines                                  (n, 2)
segments    nodes a, b of each segment, its body on the left                        (m, 2)
after       segment that begins where each one ends, -1 for none                    (m,)
before      segment that ends where each one begins, -1 for none                    (m,)
lengths     length of the facet of each segment                                     (m,)
bodies      body of each segment                                                    (m,)
==========  ======================================================================  ==============

Where two segments cross, at P, each outline enters the other body. Both are followed
inwards from P. The depth of a node on one is its distance from the other, as long as it is on the
inner side: a lens between faceted curves is shallow, a tip through a plate is deep.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.plane import (
    cross_properly,
    crossing_point,
    distance_of,
    grown,
    is_at_end,
    nearest_on_piece,
    share_node,
    side,
)
from fenics_mortar.kernels.tree import build_tree, query_tree
from fenics_mortar.utils.rounding import ROUNDING


@kernel
def begin_way(x, segments, way, used, e, forward, P):
    """Start a path at P (2,) with the rest of segment e; fill way[:2] and used[0].

    ``way`` (k + 1, 2): positions of the nodes of the path; ``used`` (k,): segments of its pieces.
    ``forward``: whether the path follows the direction of the segments.
    """
    way[0], way[1], used[0] = P, x[segments[e, 1 if forward else 0]], e


@kernel
def has_piece(x, segments, links, way, used, count, forward, i):
    """Whether a path along an outline has piece i; it is appended if ``count`` == i.

    Piece i, from ``way[i]`` to ``way[i + 1]``, is on segment ``used[i]``. A path ends at the end of
    a curve or at its own start. ``links`` = (after (m,), before (m,)).
    """
    if i < count:
        return True
    if i == used.size:
        return False
    e = links[0][used[i - 1]] if forward else links[1][used[i - 1]]
    if e < 0 or e == used[0]:
        return False
    way[i + 1], used[i] = x[segments[e, 1 if forward else 0]], e
    return True


@kernel
def is_left(p, way, count, branch, at, forward):
    """Whether p (2,) is on the inner side of a path at its nearest point.

    The nearest point is at the coordinate ``at``, 0 to 1, of piece ``branch`` of ``count`` pieces.
    At a node the sum of both unit normals is used.
    """
    nx, ny, bx, by = 0.0, 0.0, 0.0, 0.0
    first = branch - 1 if at <= 0.0 else branch
    last = branch + 1 if at >= 1.0 else branch
    for j in range(max(first, 0), min(last, count - 1) + 1):
        dx, dy = way[j + 1, 0] - way[j, 0], way[j + 1, 1] - way[j, 1]
        size = np.sqrt(dx * dx + dy * dy)
        if size > 0.0:
            nx, ny = nx - dy / size, ny + dx / size
    bx = way[branch, 0] + at * (way[branch + 1, 0] - way[branch, 0])
    by = way[branch, 1] + at * (way[branch + 1, 1] - way[branch, 1])
    left = (p[0] - bx) * nx + (p[1] - by) * ny
    return left > 0.0 if forward else left < 0.0


@kernel
def nearest_on_way(x, segments, links, way, used, counts, k, forward, p, begin, ahead):
    """Piece of path ``k`` nearest to p (2,), from piece ``begin`` over the length ``ahead``.

    ``counts`` (2,): numbers of pieces of both paths, updated. Returns (squared distance, piece,
    coordinate on the piece, 0 to 1).
    """
    best, branch, at, j = np.inf, begin, 0.0, begin
    while ahead >= 0.0 and has_piece(x, segments, links, way, used, counts[k], forward, j):
        counts[k] = max(counts[k], j + 1)
        a, b = way[j], way[j + 1]
        square, s = nearest_on_piece(p, a, b)
        if square < best:
            best, branch, at = square, j, s
        ahead -= distance_of(a, b)
        j += 1
    return best, branch, at


@kernel
def is_out_at_once(outlines, links, f, forward, P, p):
    """Whether the path from P (2,) to p (2,) leaves the other body within a facet of P.

    The outline of the other body is followed outwards from P on segment ``f``, against ``forward``,
    over the length of one facet. Example: the
    nearly collinear tops of two adjacent blocks that overlap by rounding.
    """
    x, segments, lengths, _ = outlines
    here, arc, e = P, 0.0, f
    while arc <= lengths[f]:
        next_node = x[segments[e, 0 if forward else 1]]
        if e != f and side(P, p, here) * side(P, p, next_node) < 0.0:
            if side(here, next_node, P) * side(here, next_node, p) < 0.0:
                return True
        arc += distance_of(here, next_node)
        here = next_node
        e = links[1][e] if forward else links[0][e]
        if e < 0 or e == f:
            return False
    return False


@kernel
def depth_along(outlines, links, allowed, ways, useds, counts, forwards, order, walked):
    """Largest depth of the nodes of one path below the other: (depth / facet, depth).

    ``outlines`` = (x, segments, lengths, bodies); ``order``: numbers of the two paths; ``allowed``
    overlaps are subtracted. The path is followed until it leaves the body, or its depth decreases
    and is above one facet; the distance is that from pieces of the other path at a similar arc
    length. ``walked`` (m, 2) marks segments by direction with the body they were followed in, so
    that none is followed twice.
    """
    x, segments, lengths, bodies = outlines
    one, two = order
    way, used, other = ways[one], useds[one], ways[two]
    max_facets, depth, distance, near = 0.0, 0.0, 0.0, 0
    body, direction = bodies[useds[two][0]], int(forwards[one])
    for i in range(used.size):
        if not has_piece(x, segments, links, way, used, counts[one], forwards[one], i):
            break
        counts[one] = max(counts[one], i + 1)
        if walked[used[i], direction] == body:
            break
        e, p = used[i], way[i + 1]
        step = distance_of(way[i], p)
        room = 2.0 * (distance + step) + lengths[e]
        begin, back = near, 0.0
        while begin > 0 and back < room:
            begin -= 1
            back += distance_of(other[begin], other[begin + 1])
        ahead = back + distance_of(other[near], other[near + 1]) + room
        square, near, at = nearest_on_way(
            x, segments, links, other, useds[two], counts, two, forwards[two], p, begin, ahead
        )
        f = useds[two][near]
        length, distance = max(lengths[e], lengths[f]), np.sqrt(square)
        if distance <= ROUNDING * length:
            break
        if not is_left(p, other, counts[two], near, at, forwards[two]):
            break
        f = useds[two][0]
        if i == 0 and bodies[f] != bodies[e]:
            if is_out_at_once(outlines, links, f, forwards[two], way[0], p):
                break
        if i > 0:
            walked[e, direction] = body
        slack = max(
            max(allowed[segments[e, 0]], allowed[segments[e, 1]]),
            max(allowed[segments[f, 0]], allowed[segments[f, 1]]),
        )
        if distance - slack > max_facets * length:
            max_facets, depth = (distance - slack) / length, distance
        elif max_facets > 1.0:
            break
    return max_facets, depth


@kernel
def crossing_depth(outlines, links, allowed, pair, P, work, walked):
    """Depth of two outlines in each other from a crossing P: (depth / facet, depth)."""
    x, segments, _, _ = outlines
    first, second, used_1, used_2, counts = work
    e, f = pair
    # The inner end of each segment is the one on the left of the other.
    on_e = side(x[segments[f, 0]], x[segments[f, 1]], x[segments[e, 1]]) > 0.0
    on_f = side(x[segments[e, 0]], x[segments[e, 1]], x[segments[f, 1]]) > 0.0
    begin_way(x, segments, first, used_1, e, on_e, P)
    begin_way(x, segments, second, used_2, f, on_f, P)
    counts[:] = 1
    ways, useds, forwards = (first, second), (used_1, used_2), (on_e, on_f)
    one = depth_along(outlines, links, allowed, ways, useds, counts, forwards, (0, 1), walked)
    two = depth_along(outlines, links, allowed, ways, useds, counts, forwards, (1, 0), walked)
    return one if one[0] >= two[0] else two


@kernel
def find_crossings(x, segments, after, before, lengths, bodies, allowed):
    """Find crossings of segments: rows (e, f, depth over facet, depth, x, y).

    ``allowed`` (n,): admitted overlap of nodes [length].
    """
    boxes = build_tree(x, segments)
    leaves = boxes.shape[0] // 2
    stack, hits = np.empty(128, np.int64), np.empty(boxes.shape[0] // 2, np.int64)
    rows, count = np.empty((64, 6)), 0
    walked = np.full((segments.shape[0], 2), -1)
    size = segments.shape[0]
    work = (
        np.empty((size + 1, 2)),
        np.empty((size + 1, 2)),
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(2, np.int64),
    )
    for e in range(segments.shape[0]):
        found = query_tree(boxes, boxes[leaves + e], None, stack, hits)
        for f in hits[:found]:
            if f <= e or share_node(segments[e], segments[f]):
                continue
            if not cross_properly(x, segments[e], segments[f]):
                continue
            P = crossing_point(x, segments[e], segments[f])
            rounding = ROUNDING * max(lengths[e], lengths[f])
            if is_at_end(x, segments[e], P, rounding) and is_at_end(x, segments[f], P, rounding):
                continue  # coinciding corners
            facets, depth = crossing_depth(
                (x, segments, lengths, bodies), (after, before), allowed, (e, f), P, work, walked
            )
            rows = grown(rows, count)
            rows[count] = float(e), float(f), facets, depth, P[0], P[1]
            count += 1
    return rows[:count].copy()
