# SPDX-License-Identifier: MIT
"""Times in a step at which nodes meet triangles, and edges meet edges, in space.

All nodes move along straight lines at constant speed. Four points are in one plane where a cubic
polynomial of time vanishes; its roots are bracketed between the roots of its derivative.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import det, dot, grown
from fenics_mortar.kernels.tree import query_tree, swept, swept_tree
from fenics_mortar.utils.arrays import MAX_STEPS, ROUNDING


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
def find_events(x0, x1, movers, targets, normals):
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
