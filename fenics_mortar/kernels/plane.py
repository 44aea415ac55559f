# SPDX-License-Identifier: MIT
"""Points and segments of the plane: products, sides, crossings."""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.utils.rounding import ROUNDING


@kernel
def cross(ax, ay, bx, by):
    """Component z of the cross product of the vectors (ax, ay) and (bx, by)."""
    return ax * by - ay * bx


@kernel
def side(a, b, p):
    """Twice the area of the triangle of points a, b, p (2,): positive if p is left of a b."""
    return cross(b[0] - a[0], b[1] - a[1], p[0] - a[0], p[1] - a[1])


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
