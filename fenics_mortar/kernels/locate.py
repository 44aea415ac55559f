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
def double_area(x, y, a, b):
    """Twice the area of the triangle of a point (x, y) and the points ``a``, ``b`` (2,).

    Negative if they run clockwise.
    """
    return (a[0] - x) * (b[1] - y) - (a[1] - y) * (b[0] - x)


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
    hits = np.empty(boxes.shape[0] // 2, np.int64)
    box = np.empty(4)
    rounding = ROUNDING * max(boxes[1, 2] - boxes[1, 0], boxes[1, 3] - boxes[1, 1])
    for p in range(len(points)):
        x0, y0 = points[p, 0], points[p, 1]
        result[p, 0] = result[p, 1] = np.nan
        box[0], box[1], box[2], box[3] = x0 - rounding, y0 - rounding, x0 + rounding, y0 + rounding
        for h in range(query_tree(boxes, box, None, hits)):
            i, j, k = triangles[hits[h], 0], triangles[hits[h], 1], triangles[hits[h], 2]
            whole = double_area(x[i, 0], x[i, 1], x[j], x[k])
            if whole == 0.0:
                continue
            at_i = double_area(x0, y0, x[j], x[k]) / whole
            at_j = double_area(x0, y0, x[k], x[i]) / whole
            at_k = double_area(x0, y0, x[i], x[j]) / whole
            if min(at_i, at_j, at_k) >= -ROUNDING:
                for c in range(2):
                    of_both = at_i * values[i, c] + at_j * values[j, c]
                    result[p, c] = of_both + at_k * values[k, c]
                break
