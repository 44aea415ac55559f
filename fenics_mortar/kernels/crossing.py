# SPDX-License-Identifier: MIT
"""Outlines that cross in a state: crossings of their segments, and depths of overlap.

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

Where two segments cross, at P, each outline enters the other body. Both outlines are traced inwards
from P. The depth of a node of one trace is its distance from the other one, as long as the node is
on the inner side: a lens between faceted curves is shallow, a tip through a plate is deep.

``find_crossings`` returns the crossings with these depths. ``interpolate``, for ``bulk.cells``,
evaluates nodal values between the nodes of triangles.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import copy_row, cross2, grown
from fenics_mortar.kernels.tree import build_tree, query_tree
from fenics_mortar.utils.arrays import ROUNDING, SAME_PLACE, SMALL_ANGLE


@kernel
def side(a, b, p):
    """Twice the area of the triangle of points a, b, p (2,): positive if p is left of a b."""
    return cross2(b[0] - a[0], b[1] - a[1], p[0] - a[0], p[1] - a[1])


@kernel
def distance_of(a, b):
    """Distance of two points (2,)."""
    return np.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2)


@kernel
def share_node(e, f):
    """Whether two segments, pairs of nodes (2,), share a node."""
    return e[0] == f[0] or e[0] == f[1] or e[1] == f[0] or e[1] == f[1]


@kernel
def cross_properly(x, e, f):
    """Whether two segments, pairs of nodes (2,), cross inside both and are not collinear.

    ``x`` (n, 2): positions of the nodes.
    """
    a, b, c, d = x[e[0]], x[e[1]], x[f[0]], x[f[1]]
    of_c, of_d = side(a, b, c), side(a, b, d)
    if not of_c * of_d < 0.0:
        return False
    of_a, of_b = side(c, d, a), side(c, d, b)
    if not of_a * of_b < 0.0:
        return False
    one, two = distance_of(a, b), distance_of(c, d)
    rounding = ROUNDING * max(one, two)
    return max(abs(of_c), abs(of_d)) > rounding * one and max(abs(of_a), abs(of_b)) > rounding * two


@kernel
def crossing_point(x, e, f):
    """Crossing point of two segments, shape (2,)."""
    a, b, c, d = x[e[0]], x[e[1]], x[f[0]], x[f[1]]
    to_a, to_b = side(c, d, a), side(c, d, b)
    return a + to_a / (to_a - to_b) * (b - a)


@kernel
def is_at_end(x, e, P, rounding):
    """Whether P (2,) is an end of segment e (2,) up to ``rounding`` [length]."""
    return min(distance_of(x[e[0]], P), distance_of(x[e[1]], P)) <= rounding


@kernel
def nearest_on_piece(p, a, b):
    """Squared distance of p (2,) from the line a (2,) to b (2,), and nearest coordinate, 0 to 1."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    px, py = p[0] - a[0], p[1] - a[1]
    s = min(max((px * dx + py * dy) / square, 0.0), 1.0) if square > 0.0 else 0.0
    px, py = px - s * dx, py - s * dy
    return px * px + py * py, s


# Cosine of the turn at the tip of a crack [1]: 170 degrees. Notches of rough faces are wider.
FOLDED = -0.985


@kernel
def begin_trace(x, segments, trace, used, e, forward, P):
    """Start a trace at P (2,) with the rest of segment e; fill trace[:2] and used[0].

    ``trace`` (k + 1, 2): positions of its nodes; ``used`` (k,): segments of its edges. ``forward``:
    whether the trace follows the direction of the segments.
    """
    copy_row(P, trace[0])
    copy_row(x[segments[e, 1 if forward else 0]], trace[1])
    used[0] = e


@kernel
def extend_trace(x, segments, links, trace, used, count, forward, i):
    """Whether a trace has an edge i, which is appended if ``count`` == i.

    Edge i, from ``trace[i]`` to ``trace[i + 1]``, is on segment ``used[i]``. A trace ends at the
    end of a curve or at its own start. ``links`` = (after (m,), before (m,)).
    """
    if i < count:
        return True
    if i == used.size:
        return False
    e = links[0][used[i - 1]] if forward else links[1][used[i - 1]]
    if e < 0 or e == used[0]:
        return False
    copy_row(x[segments[e, 1 if forward else 0]], trace[i + 1])
    used[i] = e
    return True


@kernel
def is_left(p, trace, count, edge, at, forward):
    """Whether p (2,) is on the inner side of a trace at its nearest point.

    The nearest point is at the coordinate ``at``, 0 to 1, of edge ``edge`` of ``count`` edges. At
    a node the sum of both unit normals is used.
    """
    nx, ny, bx, by = 0.0, 0.0, 0.0, 0.0
    first = edge - 1 if at <= 0.0 else edge
    last = edge + 1 if at >= 1.0 else edge
    for j in range(max(first, 0), min(last, count - 1) + 1):
        dx, dy = trace[j + 1, 0] - trace[j, 0], trace[j + 1, 1] - trace[j, 1]
        size = np.sqrt(dx * dx + dy * dy)
        if size > 0.0:
            nx, ny = nx - dy / size, ny + dx / size
    bx = trace[edge, 0] + at * (trace[edge + 1, 0] - trace[edge, 0])
    by = trace[edge, 1] + at * (trace[edge + 1, 1] - trace[edge, 1])
    left = (p[0] - bx) * nx + (p[1] - by) * ny
    return left > 0.0 if forward else left < 0.0


@kernel
def folds_back(trace, j, forward):
    """Whether a trace folds back where edge j begins, round the tip of a crack.

    Beyond it is the other face, often at the same place, with the body on its other side. The faces
    of a closed crack may overlap by rounding or between nodes; no body ends at so small an angle.
    """
    ax, ay = trace[j, 0] - trace[j - 1, 0], trace[j, 1] - trace[j - 1, 1]
    bx, by = trace[j + 1, 0] - trace[j, 0], trace[j + 1, 1] - trace[j, 1]
    turn = ax * by - ay * bx if forward else ay * bx - ax * by
    aa, bb = ax * ax + ay * ay, bx * bx + by * by
    if min(aa, bb) < SAME_PLACE**2 * max(aa, bb):  # an edge from a crossing at a node: rounding
        return False
    size = np.sqrt(aa * bb)
    return turn <= SMALL_ANGLE * size and ax * bx + ay * by < FOLDED * size


@kernel
def nearest_on_trace(x, segments, links, trace, used, counts, k, forward, p, begin, ahead):
    """Edge of trace ``k`` nearest to p (2,), from edge ``begin`` over the length ``ahead``.

    Edges beyond a tip of a crack are left out.

    ``counts`` (2,): numbers of edges of both traces, updated. Returns (squared distance, edge,
    coordinate on the edge, 0 to 1).
    """
    best, edge, at, j = np.inf, begin, 0.0, begin
    while ahead >= 0.0 and extend_trace(x, segments, links, trace, used, counts[k], forward, j):
        counts[k] = max(counts[k], j + 1)
        if j > begin and folds_back(trace, j, forward):
            break
        a, b = trace[j], trace[j + 1]
        square, s = nearest_on_piece(p, a, b)
        if square < best:
            best, edge, at = square, j, s
        ahead -= distance_of(a, b)
        j += 1
    return best, edge, at


@kernel
def is_out_at_once(outlines, links, f, forward, P, p):
    """Whether the path from P (2,) to p (2,) leaves the other body within a facet of P.

    The outline of the other body is followed outwards from P on segment ``f``, against ``forward``,
    over the length of one facet. Example: the nearly collinear tops of two adjacent blocks that
    overlap by rounding.
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
def depth_along(outlines, links, allowed, traces, useds, counts, forwards, one, walked):
    """Largest depth of the nodes of one trace below the other: (depth / facet, depth).

    ``outlines`` = (x, segments, lengths, bodies); ``one``: number of the trace, 0 or 1; ``allowed``
    overlaps are subtracted. The trace is followed until it leaves the body, or its depth decreases
    and is above one facet; the distance is that from edges of the other trace at a similar arc
    length. ``walked`` (m, 2) marks segments by direction with the body they were followed in, so
    that no segment is followed twice.
    """
    x, segments, lengths, bodies = outlines
    two = 1 - one
    trace, used, other = traces[one], useds[one], traces[two]
    max_facets, depth, distance, near = 0.0, 0.0, 0.0, 0
    body, direction = bodies[useds[two][0]], int(forwards[one])
    for i in range(used.size):
        if not extend_trace(x, segments, links, trace, used, counts[one], forwards[one], i):
            break
        counts[one] = max(counts[one], i + 1)
        if walked[used[i], direction] == body:
            break
        e, p = used[i], trace[i + 1]
        step = distance_of(trace[i], p)
        margin = 2.0 * (distance + step) + lengths[e]
        begin, back = near, 0.0
        while begin > 0 and back < margin and not folds_back(other, begin, forwards[two]):
            begin -= 1
            back += distance_of(other[begin], other[begin + 1])
        ahead = back + distance_of(other[near], other[near + 1]) + margin
        square, near, at = nearest_on_trace(
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
            if is_out_at_once(outlines, links, f, forwards[two], trace[0], p):
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
    begin_trace(x, segments, first, used_1, e, on_e, P)
    begin_trace(x, segments, second, used_2, f, on_f, P)
    counts[:] = 1
    traces, useds, forwards = (first, second), (used_1, used_2), (on_e, on_f)
    depths = np.empty((2, 2))
    for one in range(2):  # not two calls with constants: numba would compile each on its own
        depths[one] = depth_along(
            outlines, links, allowed, traces, useds, counts, forwards, one, walked
        )
    deeper = depths[0 if depths[0, 0] >= depths[1, 0] else 1]
    return deeper[0], deeper[1]


@kernel
def find_crossings(x, segments, after, before, lengths, bodies, allowed):
    """Find crossings of segments: rows (e, f, depth over facet, depth, x, y).

    ``allowed`` (n,): admitted overlap of nodes [length].
    """
    boxes = build_tree(x, segments)
    leaves = boxes.shape[0] // 2
    hits = np.empty(boxes.shape[0] // 2, np.int64)
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
        found = query_tree(boxes, boxes[leaves + e], None, hits)
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
            rows = grown(rows, count, count + 1)
            rows[count] = float(e), float(f), facets, depth, P[0], P[1]
            count += 1
    return rows[:count].copy()


@kernel
def interpolate(points, boxes, x, triangles, values, result):
    """Interpolate nodal values linearly; nan at points outside of all triangles.

    Coordinates below zero by rounding count as zero, so that neighbouring triangles leave no hole.

    Args:
        points: Shape (n, 2) [length].
        boxes: Tree over the triangles, shape (2 P, 4) [length].
        x: Positions of the nodes, shape (nodes, 2) [length].
        triangles: Nodes of each, shape (t, 3).
        values: Values at the nodes, shape (nodes, 2) [unit].
        result: Values at the points, shape (n, 2) [unit]; filled.
    """
    hits = np.empty(boxes.shape[0] // 2, np.int64)
    box = np.empty(4)
    rounding = ROUNDING * max(boxes[1, 2] - boxes[1, 0], boxes[1, 3] - boxes[1, 1])
    for p in range(len(points)):
        x0, y0 = points[p, 0], points[p, 1]
        result[p, 0] = result[p, 1] = np.nan
        box[0], box[1], box[2], box[3] = x0 - rounding, y0 - rounding, x0 + rounding, y0 + rounding
        for h in range(query_tree(boxes, box, None, hits)):
            i, j, k = triangles[hits[h], 0], triangles[hits[h], 1], triangles[hits[h], 2]
            whole = side(x[j], x[k], x[i])
            if whole == 0.0:
                continue
            at_i, at_j = side(x[j], x[k], points[p]) / whole, side(x[k], x[i], points[p]) / whole
            at_k = side(x[i], x[j], points[p]) / whole
            if min(at_i, at_j, at_k) >= -ROUNDING:
                for c in range(2):
                    of_both = at_i * values[i, c] + at_j * values[j, c]
                    result[p, c] = of_both + at_k * values[k, c]
                break
