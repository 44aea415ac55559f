# SPDX-License-Identifier: MIT
"""Paths of nodes through segments in a step; for symbols see ``crossing``.

With nodes on straight lines, a point p is on the line of a segment a b at the roots of

    c(t) = (b - a) x (p - a) = c0 + c1 t + c2 t^2,

and on the segment if its coordinate s is in [0, 1] up to rounding, so that neighbouring segments
leave no hole. The body is on the side c > 0: p enters the body where c increases, and leaves it
where c decreases.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import cross2, grown
from fenics_mortar.kernels.crossing import nearest_on_piece
from fenics_mortar.kernels.tree import query_tree, swept, swept_tree
from fenics_mortar.utils.arrays import ROUNDING, SOLVED

# Cosine of the angle between the outward normals at entry and exit [1] below which a path passes
# through a body: 100 degrees, more than at the right-angled corner of a block.
OPPOSED = -0.17


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
def find_events(x0, x1, nodes, segments):
    """Find intersections of ``nodes`` (k,) and segments that move from x0 to x1.

    Segments that end at the node are left out. Returns rows (node, segment, t, 1 for entry or -1
    for exit, outward normal, coordinate).
    """
    boxes = swept_tree(x0, x1, segments)
    hits = np.empty(boxes.shape[0] // 2, np.int64)
    box = np.empty(4)
    rows, count = np.empty((64, 7)), 0
    for p in nodes:
        swept(x0, x1, p, p, box)
        found = query_tree(boxes, box, None, hits)
        for e in hits[:found]:
            a, b = segments[e]
            if p == a or p == b:
                continue
            ex, ey = x0[b, 0] - x0[a, 0], x0[b, 1] - x0[a, 1]
            gx, gy = x1[b, 0] - x1[a, 0] - ex, x1[b, 1] - x1[a, 1] - ey
            qx, qy = x0[p, 0] - x0[a, 0], x0[p, 1] - x0[a, 1]
            rx, ry = x1[p, 0] - x1[a, 0] - qx, x1[p, 1] - x1[a, 1] - qy
            c0, c2 = cross2(ex, ey, qx, qy), cross2(gx, gy, rx, ry)
            c1 = cross2(ex, ey, rx, ry) + cross2(gx, gy, qx, qy)
            for t in roots_in_step(c0, c1, c2):
                tx, ty = ex + t * gx, ey + t * gy
                square, slope = tx * tx + ty * ty, c1 + 2.0 * c2 * t
                s = ((qx + t * rx) * tx + (qy + t * ry) * ty) / square
                if not (-ROUNDING <= s <= 1.0 + ROUNDING) or slope == 0.0:
                    continue
                rows = grown(rows, count, count + 1)
                length = np.sqrt(square)
                rows[count] = float(p), float(e), t, np.sign(slope), ty / length, -tx / length, s
                count += 1
    return rows[:count].copy()


@kernel
def nearest_segment(x, segments, bodies, body, p, node):
    """Segment of ``body`` nearest to p (2,), without those that end at ``node``.

    Returns (squared distance, segment); (inf, -1) if there is none.
    """
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
def is_beside(x, segments, links, points, max_distance):
    """Whether the outline between two points, in either direction, is close to their chord.

    All nodes in between have to be within ``max_distance`` [length] of the chord: a path along the
    chord then slides along the surface, or round a tip. ``points`` = (segment, segment, coordinate
    on the first, on the second, 0 to 1); ``links`` = (after (m,), before (m,)).
    """
    e, f, s_e, s_f = points
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
def is_inside(x, segments, bodies, body, p):
    """Whether p (2,) is inside the closed outline of ``body``, by crossings of a ray along x.

    A segment includes its lower end, not its upper one. Rounding has no effect on points away from
    the outline, also if segments lie on the ray.
    """
    inside = False
    for e in range(segments.shape[0]):
        ax, ay = x[segments[e, 0]]
        bx, by = x[segments[e, 1]]
        if bodies[e] == body and (ay <= p[1]) != (by <= p[1]):
            s = (p[1] - ay) / (by - ay)
            inside = inside != (ax + s * (bx - ax) > p[0])
    return inside


@kernel
def depths_inside(x, segments, bodies, body, points):
    """Depths of ``points`` (k, 2) in ``body``, and nearest segments: rows (depth, segment), (k, 2).

    Rows of points outside are (0, 0). Depths are distances from the outline.
    """
    rows = np.zeros((points.shape[0], 2))
    for k in range(points.shape[0]):
        if is_inside(x, segments, bodies, body, points[k]):
            square, nearest = nearest_segment(x, segments, bodies, body, points[k], -1)
            rows[k] = np.sqrt(square), float(nearest)
    return rows


@kernel
def depth_below(along, segment, p, time):
    """Depth of node ``p`` below the line of a segment [length] at a time of paths (m + 1, n, 2)."""
    k = min(int(time), along.shape[0] - 2)
    x0, x1, t = along[k], along[k + 1], time - k
    a, b = segment
    ex, ey = x0[b, 0] - x0[a, 0], x0[b, 1] - x0[a, 1]
    qx, qy = x0[p, 0] - x0[a, 0], x0[p, 1] - x0[a, 1]
    ex += t * (x1[b, 0] - x1[a, 0] - ex)
    ey += t * (x1[b, 1] - x1[a, 1] - ey)
    qx += t * (x1[p, 0] - x1[a, 0] - qx)
    qy += t * (x1[p, 1] - x1[a, 1] - qy)
    return cross2(ex, ey, qx, qy) / np.sqrt(ex * ex + ey * ey)


@kernel
def meet_at_junction(segments, junctions, e, f):
    """Whether two segments end at the same junction of cracks, ``junctions`` (n,), -1 for none."""
    for a in segments[e]:
        for b in segments[f]:
            if junctions[a] >= 0 and junctions[a] == junctions[b]:
                return True
    return False


@kernel
def find_passages(along, segments, after, before, junctions, lengths, bodies, events):
    """Find paths that pass through a body or end inside one.

    along: positions at the ends of m sections of the step, shape (m + 1, n, 2); ``events``: rows of
    ``find_events`` of all sections, times 0 to m, sorted by node, body of the segment and time. A
    node in contact that leaves where it is, or lies on several segments as at the junction of
    cracks, passes through nothing: at the exit it is no deeper below the first segment than
    ``SOLVED`` facets. Nor does one that enters a part at a junction and leaves another part there:
    parts that meet overlap by less than a facet. Returns rows (node, segment of entry, segment of
    exit, distance of the node from the first). For a path that ends inside, the exit is
    -1 and the first segment is the nearest one.
    """
    x0, x1 = along[0], along[-1]
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
                if entry < 0 and fresh:  # starts inside: in contact or overlapping
                    _, entry = nearest_segment(x0, segments, bodies, body, x0[p], p)
                    if entry >= 0:
                        nx, ny = normal_of(x0, segments[entry])
                        a, b = x0[segments[entry, 0]], x0[segments[entry, 1]]
                        _, s = nearest_on_piece(x0[p], a, b)
                if entry >= 0:
                    mx, my = normal_of(x1, segments[entry])
                    kx, ky = normal_of(x1, segments[e])
                    opposed = nx * events[i, 4] + ny * events[i, 5] < OPPOSED
                    opposed = opposed and mx * kx + my * ky < OPPOSED
                    facet = max(lengths[entry], lengths[e])
                    below = depth_below(along, segments[entry], p, events[i, 2])
                    opposed = opposed and below > SOLVED * facet
                    points = (entry, e, s, events[i, 6])
                    opposed = opposed and not meet_at_junction(segments, junctions, entry, e)
                    if opposed and not is_beside(x1, segments, (after, before), points, facet):
                        a, b = x1[segments[entry, 0]], x1[segments[entry, 1]]
                        square, _ = nearest_on_piece(x1[p], a, b)
                        rows = grown(rows, count, count + 1)
                        rows[count] = float(p), float(entry), float(e), np.sqrt(square)
                        count += 1
                entry = -1
            fresh = False
            i += 1
        # a path collinear with an edge enters by rounding, possibly without an exit
        if entry >= 0 and is_inside(x1, segments, bodies, body, x1[p]):
            square, nearest = nearest_segment(x1, segments, bodies, body, x1[p], p)
            rows = grown(rows, count, count + 1)
            rows[count] = float(p), float(nearest), -1.0, np.sqrt(square)
            count += 1
    return rows[:count].copy()
