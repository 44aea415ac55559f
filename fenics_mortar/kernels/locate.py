# SPDX-License-Identifier: MIT
"""Location of points in a triangulation, by walking through it."""

from fenics_mortar.kernels import kernel
from fenics_mortar.utils.rounding import ROUNDING


@kernel
def _double_area(a, b, c):
    """Twice the area of a triangle with these corners, negative if they run clockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@kernel
def locate(points, x, triangles, neighbours, found, weights):
    """Find the triangle of each point and the barycentric coordinates there.

    A walk begins where the previous one ended, and crosses the side that the point is farthest
    beyond: in a Delaunay triangulation it has no cycles (Devillers, Pion and Teillaud 2002).
    Consecutive points should be near each other. Double areas below ``ROUNDING`` times the square
    of the longest side are rounding.

    Args:
        points: Shape (n, 2) [length].
        x: Positions of the nodes, shape (nodes, 2) [length].
        triangles: Nodes of each, shape (t, 3).
        neighbours: Triangle opposite to each node, -1 at the boundary, shape (t, 3).
        found: Number of the triangle, -1 outside, shape (n,); filled.
        weights: Barycentric coordinates of the point, shape (n, 3) [1]; filled.
    """
    begin = 0
    for p in range(len(points)):
        found[p], here = -1, begin
        for _ in range(len(triangles)):
            begin, nodes = here, triangles[here]
            whole = _double_area(x[nodes[0]], x[nodes[1]], x[nodes[2]])
            sign = 1.0 if whole >= 0.0 else -1.0
            size, lowest, across = 0.0, 0.0, 0
            for k in range(3):
                a, b = x[nodes[(k + 1) % 3]], x[nodes[(k + 2) % 3]]
                weights[p, k] = sign * _double_area(points[p], a, b)
                size = max(size, (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2)
                if weights[p, k] < lowest:
                    lowest, across = weights[p, k], k
            if lowest >= -ROUNDING * size:
                if sign * whole > ROUNDING * size:  # otherwise a sliver at the boundary
                    found[p] = here
                    weights[p] /= sign * whole
                break
            here = neighbours[here, across]
            if here < 0:
                break
