# SPDX-License-Identifier: MIT
"""A tree of boxes over facets: which of them may meet a box, or a strip along a direction.

The boxes of the facets, in the order given, are the leaves of a complete binary tree in heap layout
(children of node i: 2i and 2i + 1, root 1), so that a query costs O(log N + hits) where neighbours
in the order are neighbours in space.

A strip is (xmin, ymin, xmax, ymax, tx, ty, low, high), shape (8,): the places of a box whose
product with (tx, ty) is between low and high. With zeros in the last four it is all of the box.
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
def misses(box, strip):
    """Whether ``box`` and the box of a strip are apart."""
    return box[0] > strip[2] or box[2] < strip[0] or box[1] > strip[3] or box[3] < strip[1]


@kernel
def misses_along(box, strip):
    """Whether ``box`` and a strip are apart along its direction."""
    tx, ty = strip[4], strip[5]
    middle = 0.5 * ((box[0] + box[2]) * tx + (box[1] + box[3]) * ty)
    half = 0.5 * ((box[2] - box[0]) * abs(tx) + (box[3] - box[1]) * abs(ty))
    return middle - half > strip[7] or middle + half < strip[6]


@kernel
def fill_hits(boxes, strip, stack, hits):
    """Fill ``hits`` with the leaves that meet a strip; their number may exceed its size."""
    leaves = boxes.shape[0] // 2
    count, top = 0, 1
    stack[0] = 1
    while top > 0:
        top -= 1
        i = stack[top]
        if misses(boxes[i], strip) or misses_along(boxes[i], strip):
            continue
        if i >= leaves:
            if count < hits.size:
                hits[count] = i - leaves
            count += 1
        else:
            stack[top], stack[top + 1] = 2 * i, 2 * i + 1
            top += 2
    return count


@kernel
def query_tree(boxes, strip, stack, hits):
    """The facets whose boxes meet a strip, shape (k,); in ``hits`` if it is long enough."""
    count = fill_hits(boxes, strip, stack, hits)
    if count > hits.size:
        hits = np.empty(count, np.int64)
        fill_hits(boxes, strip, stack, hits)
    return hits[:count]
