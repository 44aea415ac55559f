# SPDX-License-Identifier: MIT
"""Paths of nodes through outlines and hulls in a step, and points inside outlines.

``find_events`` returns the times at which nodes, on straight lines, enter or leave bodies,
``find_events_in_space`` those at which nodes meet triangles, and edges edges; see ``crossing`` for
symbols.
``lead_round`` tells the paths that slide along a surface or round a tip from those through a body.
In one state, ``nearest_to_nodes`` gives the segments nearest to nodes, ``depths_inside`` the depths
of points in bodies.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import cross2, det, dot, grown
from fenics_mortar.kernels.crossing import nearest_on_piece
from fenics_mortar.kernels.tree import query_tree, swept, swept_tree
from fenics_mortar.utils.arrays import MAX_STEPS, ROUNDING

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

    With nodes on straight lines, a point p is on the line of a segment a b at the roots of

        c(t) = (b - a) x (p - a) = c0 + c1 t + c2 t^2,

    and on the segment if its coordinate s is in [0, 1] up to rounding, so that neighbouring
    segments leave no hole. The body is on the side c > 0: p enters the body where c increases, and
    leaves it where c decreases.

    Segments that end at the node are left out. Returns rows (mover, segment, time, sign, place), as
    ``find_events_in_space``: ``sign`` is 1 for entry and -1 for exit, ``place`` the coordinate
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


@kernel
def value(c, t):
    """Value at t of the polynomial with coefficients (4,), of t^0 first."""
    return c[0] + t * (c[1] + t * (c[2] + t * c[3]))


@kernel
def slope(c, t):
    """Derivative at t of the polynomial with coefficients (4,)."""
    return c[1] + t * (2.0 * c[2] + 3.0 * t * c[3])


@kernel
def bracketed_root(c, low, high):
    """Root between ``low`` and ``high``, at which the values have opposite signs, by bisection."""
    rises = value(c, low) < 0.0
    for _ in range(MAX_STEPS):
        middle = 0.5 * (low + high)
        if (value(c, middle) < 0.0) == rises:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel
def roots_of_cubic(c, knots, roots):
    """Fill ``roots`` (4,) with the simple roots of c (4,) in [0, 1]; return their number.

    ``knots`` (4,) is work space.
    """
    count, knots[0] = 1, 0.0
    if (min(c[0], value(c, 1.0)) > 0.0 or max(c[0], value(c, 1.0)) < 0.0) and (
        abs(c[1]) + abs(c[2]) + abs(c[3]) < abs(c[0])
    ):
        return 0
    square = c[2] * c[2] - 3.0 * c[1] * c[3]
    if square >= 0.0:
        q = -(c[2] + (1.0 if c[2] >= 0.0 else -1.0) * np.sqrt(square))
        first = q / (3.0 * c[3]) if c[3] != 0.0 else -1.0
        second = c[1] / q if q != 0.0 else -1.0
        for t in (min(first, second), max(first, second)):
            if 0.0 < t < 1.0:
                knots[count] = t
                count += 1
    knots[count] = 1.0
    found = 0
    for i in range(count):
        low, high = value(c, knots[i]), value(c, knots[i + 1])
        if low == 0.0 and i == 0:
            roots[found] = 0.0
            found += 1
        if low * high < 0.0:
            roots[found] = bracketed_root(c, knots[i], knots[i + 1])
            found += 1
        if high == 0.0 and i == count - 1 and found < 4:
            roots[found] = 1.0
            found += 1
    return found


@kernel
def set_cubic(e, g, f, h, q, r, c):
    """Fill c (4,): coefficients of det(e + t g, f + t h, q + t r)."""
    c[0] = det(e, f, q)
    c[1] = det(g, f, q) + det(e, h, q) + det(e, f, r)
    c[2] = det(g, h, q) + det(g, f, r) + det(e, h, r)
    c[3] = det(g, h, r)


@kernel
def place_on_axes(e, f, q):
    """Coefficients (s, t) of s e + t f, the point nearest to q (3,); nan for parallel vectors."""
    ee, ef, ff, eq, fq = dot(e, e), dot(e, f), dot(f, f), dot(e, q), dot(f, q)
    size = ee * ff - ef * ef
    if not size > ROUNDING * ROUNDING * ee * ff:
        return np.nan, np.nan
    return (ff * eq - ef * fq) / size, (ee * fq - ef * eq) / size


@kernel
def find_events_in_space(x0, x1, movers, targets, normals):
    """Find where nodes meet moving triangles, or edges other edges.

    Targets with a node of the mover do not count.

    Args:
        x0: Positions of the nodes at the start, shape (n, 3) [length].
        x1: Positions at the end.
        movers: Nodes, shape (k, 1), or edges, shape (k, 2).
        targets: Triangles, shape (m, 3), or for edges other edges, shape (m, 2).
        normals: Outward normals of the other edges, shape (m, 3); not used for triangles.

    Returns:
        Rows (mover, target, time, sign, place), shape (r, 5): ``sign`` is 1 if the mover goes below
        the triangle, or against the normal of the other edge, else -1; ``place`` is the coordinate
        on the edge, 0 to 1.
    """
    boxes, of_edges = swept_tree(x0, x1, targets), targets.shape[1] == 2
    hits, none = np.empty(boxes.shape[0] // 2, np.int64), np.empty((0, 5))
    box, c, knots, roots = np.empty(6), np.empty(4), np.empty(4), np.empty(4)
    rows, count = np.empty((64, 5)), 0
    for k in range(len(movers)):
        a, b = movers[k, 0], movers[k, -1]
        swept(x0, x1, a, b, box)
        for f in hits[: query_tree(boxes, box, none, hits)]:
            i, j, last = targets[f, 0], targets[f, 1], targets[f, -1]
            if a in (i, j, last) or b in (i, j, last):
                continue
            first, last = (b, a) if of_edges else (i, last)
            e, h, q = x0[j] - x0[i], x0[last] - x0[first], x0[a] - x0[i]
            de, dh = x1[j] - x1[i] - e, x1[last] - x1[first] - h
            dq = x1[a] - x1[i] - q
            set_cubic(e, de, h, dh, q, dq, c)
            for t in roots[: roots_of_cubic(c, knots, roots)]:
                s, u = place_on_axes(e + t * de, h + t * dh, q + t * dq)
                largest = max(s, u) if of_edges else s + u
                if not (min(s, u) >= -ROUNDING and largest <= 1.0 + ROUNDING):
                    continue
                moves = dot(dq - s * de - u * dh, normals[f]) if of_edges else slope(c, t)
                if moves == 0.0:
                    continue
                rows = grown(rows, count, count + 1)
                rows[count] = float(k), float(f), t, -np.sign(moves), u
                count += 1
    return rows[:count].copy()
