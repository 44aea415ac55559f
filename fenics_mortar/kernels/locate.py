# SPDX-License-Identifier: MIT
"""Location of points in a triangulation, by walking through it."""

from fenics_mortar.kernels import kernel
from fenics_mortar.utils.rounding import ROUNDING


@kernel
def _double_area(a, b, c):
    """Twice the area of a triangle with these corners, negative if they run clockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@kernel
def locate(points, seeds, x, triangles, neighbours, found, weights):
    """Find the triangle of each point and the barycentric coordinates there.

    A walk begins at a given triangle and crosses a side that the point is beyond: in turn the
    first, second or third of such sides, since walks that always prefer the same one may have
    cycles (Devillers, Pion and Teillaud 2002). A walk that leaves the triangulation ends; if its
    outline is not convex, the point may nevertheless be inside. Double areas below ``ROUNDING``
    times the square of the longest side are rounding.

    Args:
        points: Shape (n, 2) [length].
        seeds: First triangle of each walk, shape (n,).
        x: Positions of the nodes, shape (nodes, 2) [length].
        triangles: Nodes of each, shape (t, 3).
        neighbours: Triangle opposite to each node, -1 at the boundary, shape (t, 3).
        found: Number of the triangle, -1 if the walk ended outside, shape (n,); filled.
        weights: Barycentric coordinates of the point, shape (n, 3) [1]; filled.
    """
    for p in range(len(points)):
        found[p], here = -1, seeds[p]
        for step in range(len(triangles)):
            nodes = triangles[here]
            whole = _double_area(x[nodes[0]], x[nodes[1]], x[nodes[2]])
            sign, size = 1.0 if whole >= 0.0 else -1.0, 0.0
            for k in range(3):
                a, b = x[nodes[(k + 1) % 3]], x[nodes[(k + 2) % 3]]
                weights[p, k] = sign * _double_area(points[p], a, b)
                size = max(size, (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2)
            across = -1
            for turn in range(3):
                k = (step + turn) % 3
                if across < 0 and weights[p, k] < -ROUNDING * size:
                    across = k
            if across < 0:
                if sign * whole > ROUNDING * size:  # otherwise a sliver at the boundary
                    found[p] = here
                    weights[p] /= sign * whole
                break
            here = neighbours[here, across]
            if here < 0:
                break
