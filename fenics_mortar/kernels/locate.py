# SPDX-License-Identifier: MIT
"""Interpolation in a triangulation."""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.tree import build_tree, query_tree
from fenics_mortar.utils.rounding import ROUNDING


@kernel
def box_triangles(x, triangles):
    """Tree of boxes over ``triangles`` (t, 3) with nodes at ``x`` (n, 2), see ``tree``."""
    return build_tree(x, triangles)


@kernel
def double_area(a, b, c):
    """Twice the area of a triangle with these corners, negative if they run clockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@kernel
def interpolate(points, boxes, x, triangles, values, result):
    """Interpolate nodal values linearly; nan at points outside of all triangles.

    Coordinates below zero by rounding count as zero, so that neighbouring triangles leave no hole.

    Args:
        points: Shape (n, 2) [length].
        boxes: Result of ``box_triangles``, shape (2 P, 4) [length].
        x: Positions of the nodes, shape (nodes, 2) [length].
        triangles: Nodes of each, shape (t, 3).
        values: Values at the nodes, shape (nodes, 2) [unit].
        result: Values at the points, shape (n, 2) [unit]; filled.
    """
    stack, hits = np.empty(128, np.int64), np.empty(boxes.shape[0] // 2, np.int64)
    box, weights = np.empty(4), np.empty(3)
    rounding = ROUNDING * max(boxes[1, 2] - boxes[1, 0], boxes[1, 3] - boxes[1, 1])
    for p in range(len(points)):
        result[p] = np.nan
        box[:2], box[2:] = points[p] - rounding, points[p] + rounding
        found = query_tree(boxes, box, None, stack, hits)
        for e in hits[:found]:
            nodes = triangles[e]
            whole = double_area(x[nodes[0]], x[nodes[1]], x[nodes[2]])
            inside = whole != 0.0
            for k in range(3):
                a, b = x[nodes[(k + 1) % 3]], x[nodes[(k + 2) % 3]]
                weights[k] = double_area(points[p], a, b) / whole if inside else 0.0
                inside = inside and weights[k] >= -ROUNDING
            if inside:
                for c in range(2):
                    result[p, c] = 0.0
                    for k in range(3):
                        result[p, c] += weights[k] * values[nodes[k], c]
                break
