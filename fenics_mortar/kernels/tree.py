# SPDX-License-Identifier: MIT
"""A tree of boxes over facets, to find those that may intersect a box, a strip or a prism.

The boxes of the facets, in the given order, are the leaves of a complete binary tree in heap layout
(children of node i: 2i and 2i + 1, root 1). A query costs O(log N + hits) if neighbours in the
order are neighbours in space.

A box has 2 d numbers, (xmin, ymin, xmax, ymax) in the plane, in space those of x, y and z. A query
consists of a box and, for a strip or a prism, of ranges ``along`` its directions: each row
(t, low, high), with d + 2 numbers, contains the points x with low <= x . t <= high.
"""

import numpy as np

from fenics_mortar.kernels import kernel

# Bits of each coordinate in the order of points: 1000 places along the longest side.
BITS = 10


@kernel
def build_tree(x, facets):
    """Boxes (2 P, 2 d) over ``facets`` (m, K) with control points ``x`` (n, d); P >= m leaves.

    Row 0 is unused, leaf f is row P + f.
    """
    leaves, dim = 1, x.shape[1]
    while leaves < facets.shape[0]:
        leaves *= 2
    boxes = np.empty((2 * leaves, 2 * dim))
    for i in range(2 * leaves):
        for d in range(dim):
            boxes[i, d], boxes[i, dim + d] = np.inf, -np.inf
    for f in range(facets.shape[0]):
        for node in facets[f]:
            for d in range(dim):
                boxes[leaves + f, d] = min(boxes[leaves + f, d], x[node, d])
                boxes[leaves + f, dim + d] = max(boxes[leaves + f, dim + d], x[node, d])
    for i in range(leaves - 1, 0, -1):
        for d in range(dim):
            boxes[i, d] = min(boxes[2 * i, d], boxes[2 * i + 1, d])
            boxes[i, dim + d] = max(boxes[2 * i, dim + d], boxes[2 * i + 1, dim + d])
    return boxes


@kernel
def swept_tree(x0, x1, facets):
    """Tree of boxes around ``facets`` (m, K) whose nodes move from ``x0`` to ``x1`` (n, d)."""
    n, size = x0.shape[0], facets.shape[1]
    both, ends = np.empty((2 * n, x0.shape[1])), np.empty((facets.shape[0], 2 * size), np.int64)
    both[:n], both[n:] = x0, x1
    ends[:, :size], ends[:, size:] = facets, facets + n
    return build_tree(both, ends)


@kernel
def swept(x0, x1, i, j, box):
    """Fill the box (2 d,) around the nodes i and j that move from ``x0`` to ``x1`` (n, d)."""
    dim = x0.shape[1]
    for d in range(dim):
        box[d] = min(min(x0[i, d], x1[i, d]), min(x0[j, d], x1[j, d]))
        box[dim + d] = max(max(x0[i, d], x1[i, d]), max(x0[j, d], x1[j, d]))


@kernel
def are_disjoint(one, other):
    """Whether two boxes (2 d,) are disjoint, or contain nan."""
    dim = one.size // 2
    x = one[0] <= other[dim] and one[dim] >= other[0]
    y = one[1] <= other[dim + 1] and one[dim + 1] >= other[1]
    if dim == 3 and not (one[2] <= other[5] and one[5] >= other[2]):
        return True
    return not (x and y)


@kernel
def is_outside_ranges(box, along):
    """Whether ``box`` (2 d,) lies outside of one of the ranges ``along`` (r, d + 2)."""
    dim = box.size // 2
    for r in range(along.shape[0]):
        tx, ty = along[r, 0], along[r, 1]
        middle = (box[0] + box[dim]) * tx + (box[1] + box[dim + 1]) * ty
        half = (box[dim] - box[0]) * abs(tx) + (box[dim + 1] - box[1]) * abs(ty)
        if dim == 3:
            middle += (box[2] + box[5]) * along[r, 2]
            half += (box[5] - box[2]) * abs(along[r, 2])
        middle, half = 0.5 * middle, 0.5 * half
        if middle - half > along[r, dim + 1] or middle + half < along[r, dim]:
            return True
    return False


@kernel
def query_tree(boxes, box, along, hits):
    """Fill ``hits`` with the facets whose boxes intersect a query; return their number.

    The right child of a node is visited before the left one, then the left sibling of the nearest
    ancestor that is a right child.

    Args:
        boxes: The tree, shape (2 P, 2 d).
        box: Box of the query, shape (2 d,).
        along: Ranges of a strip or prism, shape (r, d + 2), or None.
        hits: Facets, shape (P,); filled.
    """
    leaves = boxes.shape[0] // 2
    count, i = 0, 1
    while True:
        meets = not are_disjoint(boxes[i], box)
        if along is not None:
            meets = meets and not is_outside_ranges(boxes[i], along)
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


def spatial_order(points):
    """Order of points (n, d) along a Morton curve, where neighbours are neighbours in space."""
    if not len(points):
        return np.empty(0, np.int64)
    low, extent = points.min(axis=0), np.ptp(points, axis=0).max()
    grid = ((points - low) * ((1 << BITS) - 1) / (extent or 1.0)).astype(np.int64)
    codes, dim = np.zeros(len(points), np.int64), points.shape[1]
    for bit in range(BITS):
        for d in range(dim):
            codes |= ((grid[:, d] >> bit) & 1) << (dim * bit + d)
    return np.argsort(codes, kind="stable")
