# SPDX-License-Identifier: MIT
"""A tree of boxes over facets: which of them may meet a box, or a strip along a direction.

The boxes of the facets, in the order given, are the leaves of a complete binary tree in heap layout
(children of node i: 2i and 2i + 1, root 1), so that a query costs O(log N + hits) where neighbours
in the order are neighbours in space.

A query is a box (xmin, ymin, xmax, ymax), and of a strip also where it is ``along`` a direction:
(tx, ty, low, high) are the places whose product with (tx, ty) is between low and high. ``hits``
has room for all leaves.
"""

import numpy as np

from fenics_mortar.kernels import kernel


@kernel
def build_tree(x, facets):
    """Boxes (2P, 4) = (xmin, ymin, xmax, ymax) over ``facets`` (m, K) of control points ``x``."""
    leaves = 1
    while leaves < facets.shape[0]:
        leaves *= 2
    boxes = np.empty((2 * leaves, 4))
    boxes[:, :2] = np.inf
    boxes[:, 2:] = -np.inf
    for f in range(facets.shape[0]):
        for node in facets[f]:
            for d in range(2):
                boxes[leaves + f, d] = min(boxes[leaves + f, d], x[node, d])
                boxes[leaves + f, 2 + d] = max(boxes[leaves + f, 2 + d], x[node, d])
    for i in range(leaves - 1, 0, -1):
        for d in range(2):
            boxes[i, d] = min(boxes[2 * i, d], boxes[2 * i + 1, d])
            boxes[i, 2 + d] = max(boxes[2 * i, 2 + d], boxes[2 * i + 1, 2 + d])
    return boxes


@kernel
def misses(one, other):
    """Whether two boxes are apart, or hold nan."""
    x = one[0] <= other[2] and one[2] >= other[0]
    return not (x and one[1] <= other[3] and one[3] >= other[1])


@kernel
def misses_along(box, along):
    """Whether ``box`` and a strip are apart along the direction of the strip."""
    tx, ty, low, high = along
    middle = 0.5 * ((box[0] + box[2]) * tx + (box[1] + box[3]) * ty)
    half = 0.5 * ((box[2] - box[0]) * abs(tx) + (box[3] - box[1]) * abs(ty))
    return middle - half > high or middle + half < low


@kernel
def query_tree(boxes, box, along, stack, hits):
    """Fill ``hits`` with the facets whose boxes meet a query; return their number."""
    leaves = boxes.shape[0] // 2
    count, top = 0, 1
    stack[0] = 1
    while top > 0:
        top -= 1
        i = stack[top]
        if misses(boxes[i], box):
            continue
        if along is not None:
            if misses_along(boxes[i], along):
                continue
        if i >= leaves:
            hits[count] = i - leaves
            count += 1
        else:
            stack[top], stack[top + 1] = 2 * i, 2 * i + 1
            top += 2
    return count
