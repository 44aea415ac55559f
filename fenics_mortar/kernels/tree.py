# SPDX-License-Identifier: MIT
"""A tree of boxes over facets, to find those that may intersect a box or a strip.

The boxes of the facets, in the given order, are the leaves of a complete binary tree in heap layout
(children of node i: 2i and 2i + 1, root 1). A query costs O(log N + hits) if neighbours in the
order are neighbours in space.

A query consists of a box (xmin, ymin, xmax, ymax) and, for a strip, of the range ``along`` its
direction: (tx, ty, low, high) contains the points x with low <= x . (tx, ty) <= high.
"""

import numpy as np

from fenics_mortar.kernels import kernel


@kernel
def build_tree(x, facets):
    """Boxes (2 P, 4) over ``facets`` (m, K) with control points ``x`` (n, 2); P >= m leaves.

    Each row is (xmin, ymin, xmax, ymax); row 0 is unused, leaf f is row P + f.
    """
    leaves = 1
    while leaves < facets.shape[0]:
        leaves *= 2
    boxes = np.empty((2 * leaves, 4))
    for i in range(2 * leaves):
        boxes[i, 0] = boxes[i, 1] = np.inf
        boxes[i, 2] = boxes[i, 3] = -np.inf
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
def are_disjoint(one, other):
    """Whether two boxes (4,) are disjoint, or contain nan."""
    x = one[0] <= other[2] and one[2] >= other[0]
    return not (x and one[1] <= other[3] and one[3] >= other[1])


@kernel
def is_outside_strip(box, along):
    """Whether ``box`` (4,) lies outside of the range ``along`` = (tx, ty, low, high)."""
    tx, ty, low, high = along
    middle = 0.5 * ((box[0] + box[2]) * tx + (box[1] + box[3]) * ty)
    half = 0.5 * ((box[2] - box[0]) * abs(tx) + (box[3] - box[1]) * abs(ty))
    return middle - half > high or middle + half < low


@kernel
def query_tree(boxes, box, along, hits):
    """Fill ``hits`` with the facets whose boxes intersect a query; return their number.

    The right child of a node is visited before the left one, then the left sibling of the nearest
    ancestor that is a right child.

    Args:
        boxes: The tree, shape (2 P, 4).
        box: Box of the query, shape (4,).
        along: Range (tx, ty, low, high) of a strip, or None.
        hits: Facets, shape (P,); filled.
    """
    leaves = boxes.shape[0] // 2
    count, i = 0, 1
    while True:
        meets = not are_disjoint(boxes[i], box)
        if along is not None:
            meets = meets and not is_outside_strip(boxes[i], along)
        if meets and i < leaves:
            i = 2 * i + 1
            continue
        if meets:
            hits[count] = i - leaves
            count += 1
        while i & 1 == 0:
            i >>= 1
        if i == 1:
            return count
        i -= 1
