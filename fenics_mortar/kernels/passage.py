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
from fenics_mortar.utils.arrays import ROUNDING

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
def find_events(x0, x1, movers, targets, _):
    """Find intersections of nodes ``movers`` (k, 1) and segments ``targets`` that move to x1.

    Segments that end at the node are left out. Returns rows (mover, segment, time, sign, place), as
    ``space.passage.find_events``: ``sign`` is 1 for entry and -1 for exit, ``place`` the coordinate
    on the segment, 0 to 1.
    """
    boxes = swept_tree(x0, x1, targets)
    hits = np.empty(boxes.shape[0] // 2, np.int64)
    box = np.empty(4)
    rows, count = np.empty((64, 5)), 0
    for k in range(len(movers)):
        p = movers[k, 0]
        swept(x0, x1, p, p, box)
        found = query_tree(boxes, box, None, hits)
        for e in hits[:found]:
            a, b = targets[e]
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
                slope = c1 + 2.0 * c2 * t
                s = ((qx + t * rx) * tx + (qy + t * ry) * ty) / (tx * tx + ty * ty)
                if not (-ROUNDING <= s <= 1.0 + ROUNDING) or slope == 0.0:
                    continue
                rows = grown(rows, count, count + 1)
                rows[count] = float(k), float(e), t, np.sign(slope), s
                count += 1
    return rows[:count].copy()


@kernel
def nearest_segment(x, segments, p, node):
    """Segment nearest to p (2,), without those that end at ``node``.

    Returns (squared distance, segment, coordinate on it); (inf, -1, 0) if there is none.
    """
    best, nearest, place = np.inf, -1, 0.0
    for e in range(segments.shape[0]):
        if segments[e, 0] == node or segments[e, 1] == node:
            continue
        distance, s = nearest_on_piece(p, x[segments[e, 0]], x[segments[e, 1]])
        if distance < best:
            best, nearest, place = distance, e, s
    return best, nearest, place


@kernel
def nearest_to_nodes(x, segments, nodes):
    """Segments nearest to ``nodes`` (k,) that do not end there.

    Returns rows (segment, coordinate on it), -1 for none, (k, 2).
    """
    rows = np.empty((nodes.size, 2))
    for k in range(nodes.size):
        _, e, rows[k, 1] = nearest_segment(x, segments, x[nodes[k]], nodes[k])
        rows[k, 0] = float(e)
    return rows


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
def is_inside(x, segments, p):
    """Whether p (2,) is inside the closed outline of a body, by crossings of a ray along x.

    A segment includes its lower end, not its upper one. Rounding has no effect on points away from
    the outline, also if segments lie on the ray.
    """
    inside = False
    for e in range(segments.shape[0]):
        ax, ay = x[segments[e, 0]]
        bx, by = x[segments[e, 1]]
        if (ay <= p[1]) != (by <= p[1]):
            s = (p[1] - ay) / (by - ay)
            inside = inside != (ax + s * (bx - ax) > p[0])
    return inside


@kernel
def depths_inside(x, segments, points):
    """Depths of ``points`` (k, 2) in a body, and nearest segments: rows (depth, segment), (k, 2).

    Rows of points outside are (0, 0). Depths are distances from the outline, ``segments`` (m, 2).
    """
    rows = np.zeros((points.shape[0], 2))
    for k in range(points.shape[0]):
        if is_inside(x, segments, points[k]):
            square, nearest, _ = nearest_segment(x, segments, points[k], -1)
            rows[k] = np.sqrt(square), float(nearest)
    return rows


@kernel
def lead_round(x, segments, links, lengths, facets, places):
    """Whether paths lead along the surface or round a tip, see ``is_beside``, (k,).

    Args:
        x: Positions of the nodes, shape (n, 2) [length].
        segments: Nodes of the segments, shape (m, 2).
        links: As in ``is_beside``.
        lengths: Lengths of the facets of the segments, shape (m,) [length].
        facets: Segments at entry and exit, shape (k, 2).
        places: Coordinates on them, 0 to 1, shape (k, 2).
    """
    marks = np.empty(len(facets), np.bool_)
    for k in range(len(facets)):
        e, f = facets[k]
        points = (e, f, places[k, 0], places[k, 1])
        marks[k] = is_beside(x, segments, links, points, max(lengths[e], lengths[f]))
    return marks
