# SPDX-License-Identifier: MIT
"""Points inside cells of other bodies.

Interpolation in a triangulation.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.rows import copy_row
from fenics_mortar.kernels.tree import build_tree, query_tree
from fenics_mortar.utils.rounding import ROUNDING


@kernel
def find_inside(x, cells, labels, outline, points, bodies, inside):
    """Mark the points that lie in a cell of another body than their own.

    Only cells whose nodes have a box that meets that of all points are examined; if all points are
    of one body, only those of other bodies.

    Args:
        x: Positions of all nodes, shape (n, 2) [length].
        cells: Nodes of each cell, shape (cells, k).
        labels: Body of each node, negative for bodies that do not count, shape (n,).
        outline: Nodes of a cell along its outline, numbers from 0 to k - 1, shape (k - inner,).
        points: Shape (p, 2) [length].
        bodies: Body of each point, shape (p,).
        inside: Marks, shape (p,), bool; filled.
    """
    box, one_body = np.empty(4), True
    box[0] = box[1] = np.inf
    box[2] = box[3] = -np.inf
    for p in range(len(points)):
        inside[p] = False
        one_body = one_body and bodies[p] == bodies[0]
        for d in range(2):
            box[d], box[2 + d] = min(box[d], points[p, d]), max(box[2 + d], points[p, d])
    near, count = np.empty(cells.shape, np.int64), 0
    for e in range(cells.shape[0]):
        label = labels[cells[e, 0]]
        if label < 0 or (one_body and label == bodies[0]) or is_away(x, cells[e], box):
            continue
        copy_row(cells[e], near[count])
        count += 1
    if count == 0:
        return
    examined = near[:count]
    boxes = build_tree(x, examined)
    hits = np.empty(boxes.shape[0] // 2, np.int64)
    for p in range(len(points)):
        for d in range(2):
            box[d] = box[2 + d] = points[p, d]
        found = query_tree(boxes, box, None, hits)
        for e in hits[:found]:
            if labels[examined[e, 0]] != bodies[p] and contains(x, examined[e], outline, points[p]):
                inside[p] = True
                break


@kernel
def is_away(x, nodes, box):
    """Whether all ``nodes`` (k,) are on one side of a box (xmin, ymin, xmax, ymax)."""
    for d in range(2):
        below = above = True
        for node in nodes:
            below = below and x[node, d] < box[d]
            above = above and x[node, d] > box[2 + d]
        if below or above:
            return True
    return False


@kernel
def contains(x, nodes, outline, point):
    """Whether a point (2,) lies in the polygon of a cell with ``nodes`` (k,).

    A ray from an interior point crosses the outline an odd number of times.
    """
    odd, last = False, nodes[outline[-1]]
    for k in outline:
        node = nodes[k]
        ay, by = x[last, 1] - point[1], x[node, 1] - point[1]
        if (ay > 0.0) != (by > 0.0):
            ax, bx = x[last, 0] - point[0], x[node, 0] - point[0]
            odd = odd != (ax - (bx - ax) / (by - ay) * ay > 0.0)
        last = node
    return odd


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
