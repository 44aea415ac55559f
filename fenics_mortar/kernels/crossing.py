# SPDX-License-Identifier: MIT
"""Crossing boundaries: segments in a state, and paths of nodes through segments in a step.

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

**State.** Where two segments cross, at P, each outline enters the other body. Both are followed
inwards from P. The depth of a node on one is its distance from the other, as long as it is on the
inner side: a lens between faceted curves is shallow, a tip through a plate is deep.

**Step.** With nodes on straight lines, a point p is on the line of a segment a b at the roots of

    c(t) = (b - a) x (p - a) = c0 + c1 t + c2 t^2,

and on the segment if its coordinate s is in [0, 1]. The body is on the side c > 0: p enters where c
increases, and leaves where it decreases.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.tree import build_tree, query_tree

# Tolerance of s in [0, 1] for rounding: no hole between neighbouring segments.
BEYOND = 1e-12
# Distance [facets] up to which two outlines meet, or segments are collinear: rounding.
MET = 1e-9
# Largest number of segments followed from a crossing; a lens has far fewer.
MAX_SEGMENTS = 512
# Cosine between outward normals at entry and exit [1] below which a path passes through a body: 100
# degrees, so that a path round the corner of a block does not.
OPPOSITE = -0.17
# Segments to check for a node: of other bodies, of its own, of all
OTHERS, OWN, ALL = 0, 1, 2


@kernel
def cross(ax, ay, bx, by):
    """The z component of the product of two plane vectors."""
    return ax * by - ay * bx


@kernel
def side(a, b, p):
    """Twice the area of the triangle a, b, p: positive if p is on the left of a b."""
    return cross(b[0] - a[0], b[1] - a[1], p[0] - a[0], p[1] - a[1])


@kernel
def distance_of(a, b):
    """Distance of two points."""
    return np.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2)


@kernel
def share_node(e, f):
    """Whether two segments share a node."""
    return e[0] == f[0] or e[0] == f[1] or e[1] == f[0] or e[1] == f[1]


@kernel
def cross_properly(x, e, f):
    """Whether two segments cross at inner points of both and are not collinear."""
    a, b, c, d = x[e[0]], x[e[1]], x[f[0]], x[f[1]]
    of_c, of_d = side(a, b, c), side(a, b, d)
    if not of_c * of_d < 0.0:
        return False
    of_a, of_b = side(c, d, a), side(c, d, b)
    if not of_a * of_b < 0.0:
        return False
    one, two = distance_of(a, b), distance_of(c, d)
    rounding = MET * max(one, two)
    return max(abs(of_c), abs(of_d)) > rounding * one and max(abs(of_a), abs(of_b)) > rounding * two


@kernel
def crossing_point(x, e, f):
    """Crossing point of two segments, shape (2,)."""
    a, b, c, d = x[e[0]], x[e[1]], x[f[0]], x[f[1]]
    to_a, to_b = side(c, d, a), side(c, d, b)
    return a + to_a / (to_a - to_b) * (b - a)


@kernel
def is_at_end(x, e, P, rounding):
    """Whether P is an end of a segment up to the length ``rounding``."""
    return min(distance_of(x[e[0]], P), distance_of(x[e[1]], P)) <= rounding


@kernel
def begin_way(x, segments, way, used, e, forward, P):
    """Start a path at P with the rest of segment e."""
    way[0], way[1], used[0] = P, x[segments[e, 1 if forward else 0]], e


@kernel
def has_piece(x, segments, links, way, used, count, forward, i):
    """Whether a path along an outline has piece i; appended if ``count`` == i.

    Piece i from ``way[i]`` to ``way[i + 1]`` is on segment ``used[i]``. A path ends if its arrays
    are full, at the end of a curve, or at its start.
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
def nearest_on_piece(p, a, b):
    """Squared distance of p from the segment from a to b, and the nearest coordinate, 0 to 1."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    px, py = p[0] - a[0], p[1] - a[1]
    s = min(max((px * dx + py * dy) / square, 0.0), 1.0) if square > 0.0 else 0.0
    px, py = px - s * dx, py - s * dy
    return px * px + py * py, s


@kernel
def is_left(p, way, count, branch, at, forward):
    """Whether p is inside the outline at its nearest point; ``forward``: direction of the path.

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
    """Nearest piece of a path to p, from piece ``begin`` over the arc length ``ahead``.

    ``counts[k]``: number of its pieces. Returns squared distance, piece and coordinate on it.
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
    """Whether the path from P to p leaves the other body within a facet of P along its outline.

    The outline of the other body is followed outwards from P, against ``forward``. Example: the
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
        if distance <= MET * length:
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
def grown(rows, count):
    """``rows`` with room for row ``count``."""
    if count < rows.shape[0]:
        return rows
    longer = np.empty((2 * count, rows.shape[1]))
    longer[:count] = rows
    return longer


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
    size = min(segments.shape[0], MAX_SEGMENTS)
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
            rounding = MET * max(lengths[e], lengths[f])
            if is_at_end(x, segments[e], P, rounding) and is_at_end(x, segments[f], P, rounding):
                continue  # coinciding corners
            facets, depth = crossing_depth(
                (x, segments, lengths, bodies), (after, before), allowed, (e, f), P, work, walked
            )
            rows = grown(rows, count)
            rows[count] = float(e), float(f), facets, depth, P[0], P[1]
            count += 1
    return rows[:count].copy()


# Paths


@kernel
def roots_in_step(c0, c1, c2):
    """Roots of c0 + c1 t + c2 t^2 in [0, 1], nan for none: (t, t)."""
    square = c1 * c1 - 4.0 * c2 * c0
    if not square >= 0.0:
        return np.nan, np.nan
    q = -0.5 * (c1 + (np.sqrt(square) if c1 >= 0.0 else -np.sqrt(square)))
    first = q / c2 if c2 != 0.0 else np.nan
    second = c0 / q if q != 0.0 else np.nan
    first = first if 0.0 <= first <= 1.0 else np.nan
    second = second if 0.0 <= second <= 1.0 else np.nan
    return first, second


@kernel
def find_events(x0, x1, segments, bodies, node_bodies, which):
    """Find intersections of nodes and segments that move from x0 to x1.

    ``which``: segments of OTHERS, of the node's OWN body, or ALL, without those that end at it.
    Returns rows (node, segment, t, 1 for entry or -1 for exit, outward normal, coordinate).
    """
    size = x0.shape[0]
    both = np.concatenate((x0, x1))
    boxes = build_tree(both, np.concatenate((segments, segments + size), axis=1))
    stack, hits = np.empty(128, np.int64), np.empty(boxes.shape[0] // 2, np.int64)
    box = np.empty(4)
    rows, count = np.empty((64, 7)), 0
    for p in range(size):
        for d in range(2):
            box[d], box[2 + d] = min(x0[p, d], x1[p, d]), max(x0[p, d], x1[p, d])
        found = query_tree(boxes, box, None, stack, hits)
        for e in hits[:found]:
            a, b = segments[e]
            if which != ALL and (bodies[e] == node_bodies[p]) != (which == OWN):
                continue
            if p == a or p == b:
                continue
            ex, ey = x0[b, 0] - x0[a, 0], x0[b, 1] - x0[a, 1]
            gx, gy = x1[b, 0] - x1[a, 0] - ex, x1[b, 1] - x1[a, 1] - ey
            qx, qy = x0[p, 0] - x0[a, 0], x0[p, 1] - x0[a, 1]
            rx, ry = x1[p, 0] - x1[a, 0] - qx, x1[p, 1] - x1[a, 1] - qy
            c0, c2 = cross(ex, ey, qx, qy), cross(gx, gy, rx, ry)
            c1 = cross(ex, ey, rx, ry) + cross(gx, gy, qx, qy)
            for t in roots_in_step(c0, c1, c2):
                tx, ty = ex + t * gx, ey + t * gy
                square, slope = tx * tx + ty * ty, c1 + 2.0 * c2 * t
                s = ((qx + t * rx) * tx + (qy + t * ry) * ty) / square
                if not (-BEYOND <= s <= 1.0 + BEYOND) or slope == 0.0:
                    continue
                rows = grown(rows, count)
                length = np.sqrt(square)
                rows[count] = float(p), float(e), t, np.sign(slope), ty / length, -tx / length, s
                count += 1
    return rows[:count].copy()


@kernel
def nearest_segment(x, segments, bodies, body, p, node):
    """Squared distance and nearest segment of a body to p, without those at ``node``."""
    best, nearest = np.inf, -1
    for e in range(segments.shape[0]):
        if bodies[e] != body or segments[e, 0] == node or segments[e, 1] == node:
            continue
        distance, _ = nearest_on_piece(p, x[segments[e, 0]], x[segments[e, 1]])
        if distance < best:
            best, nearest = distance, e
    return best, nearest


@kernel
def normal_of(x, segment):
    """Outward unit normal of a segment: (nx, ny)."""
    tx, ty = x[segment[1], 0] - x[segment[0], 0], x[segment[1], 1] - x[segment[0], 1]
    length = np.sqrt(tx * tx + ty * ty)
    return ty / length, -tx / length


@kernel
def is_beside(x, segments, links, places, max_distance):
    """Whether the outline between two points, in either direction, is close to their chord.

    ``places``: two segments and coordinates on them, 0 to 1. All nodes in between must be within
    ``max_distance`` of the chord: a path along it slid along the surface, or round a tip.
    """
    e, f, s_e, s_f = places
    if e == f:
        return True
    chord = np.empty((2, 2))
    for d in range(2):
        chord[0, d] = x[segments[e, 0], d] + s_e * (x[segments[e, 1], d] - x[segments[e, 0], d])
        chord[1, d] = x[segments[f, 0], d] + s_f * (x[segments[f, 1], d] - x[segments[f, 0], d])
    for next_, end in ((links[0], 1), (links[1], 0)):
        g = e
        while True:
            square, _ = nearest_on_piece(x[segments[g, end]], chord[0], chord[1])
            g = next_[g]
            if not square <= max_distance * max_distance or g < 0 or g == e:
                break
            if g == f:
                return True
    return False


@kernel
def place_on(x, segment, p):
    """Coordinate of the projection of p on a segment, 0 to 1."""
    ax, ay = x[segment[0]]
    dx, dy = x[segment[1], 0] - ax, x[segment[1], 1] - ay
    s = ((p[0] - ax) * dx + (p[1] - ay) * dy) / (dx * dx + dy * dy)
    return min(max(s, 0.0), 1.0)


@kernel
def find_passages(x0, x1, segments, after, before, lengths, bodies, events):
    """Find paths that pass through a body or end inside one.

    ``events``: rows of ``find_events``, sorted by node, body of the segment and time; x0, x1:
    positions at start and end. Returns rows (node, segment of entry, segment of exit, distance of
    the node from the first). For a path that ends inside, the exit is -1 and the first segment is
    the nearest one.
    """
    rows, count = np.empty((16, 4)), 0
    i = 0
    while i < events.shape[0]:
        p, body = int(events[i, 0]), bodies[int(events[i, 1])]
        entry, nx, ny, s, fresh = -1, 0.0, 0.0, 0.0, True
        while i < events.shape[0] and events[i, 0] == p and bodies[int(events[i, 1])] == body:
            e = int(events[i, 1])
            if events[i, 3] > 0.0:
                if entry < 0:
                    entry, nx, ny, s = e, events[i, 4], events[i, 5], events[i, 6]
            else:
                if entry < 0 and fresh:  # starts inside: in contact, or overlapping
                    _, entry = nearest_segment(x0, segments, bodies, body, x0[p], p)
                    if entry >= 0:
                        nx, ny = normal_of(x0, segments[entry])
                        s = place_on(x0, segments[entry], x0[p])
                if entry >= 0:
                    mx, my = normal_of(x1, segments[entry])
                    kx, ky = normal_of(x1, segments[e])
                    opposed = nx * events[i, 4] + ny * events[i, 5] < OPPOSITE
                    opposed = opposed and mx * kx + my * ky < OPPOSITE
                    facet = max(lengths[entry], lengths[e])
                    places = (entry, e, s, events[i, 6])
                    if opposed and not is_beside(x1, segments, (after, before), places, facet):
                        a, b = x1[segments[entry, 0]], x1[segments[entry, 1]]
                        square, _ = nearest_on_piece(x1[p], a, b)
                        rows = grown(rows, count)
                        rows[count] = float(p), float(entry), float(e), np.sqrt(square)
                        count += 1
                entry = -1
            fresh = False
            i += 1
        if entry >= 0:
            square, nearest = nearest_segment(x1, segments, bodies, body, x1[p], p)
            rows = grown(rows, count)
            rows[count] = float(p), float(nearest), -1.0, np.sqrt(square)
            count += 1
    return rows[:count].copy()
