# SPDX-License-Identifier: MIT
"""Lagrange shape functions of triangles and quadrilaterals, linear or quadratic.

Reference coordinates of the corners: (0, 0) (1, 0) (0, 1); (-1, -1) (1, -1) (1, 1) (-1, 1).
"""

import numpy as np

from fenics_mortar.kernels import kernel

# Coordinates of the nodes of the reference facets.
TRIANGLE = np.array([[0.0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]])
QUADRILATERAL = np.array(
    [[-1.0, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0], [0, 0]]
)
# Nodes of the linear pieces of each kind of facet.
ONE_TRIANGLE = np.array([[0, 1, 2]])
ONE_QUADRILATERAL = np.array([[0, 1, 2, 3]])
TRIANGLES = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
QUADRILATERALS = np.array([[0, 4, 8, 7], [4, 1, 5, 8], [8, 5, 2, 6], [7, 8, 6, 3]])
# Quadrilaterals: number of the function of each coordinate, of those that are 1 at -1, 1 and 0.
FIRST = (0, 1, 1, 0, 2, 1, 2, 0, 2)
SECOND = (0, 0, 1, 1, 0, 2, 1, 2, 2)


@kernel
def reference_nodes(count):
    """Coordinates of the nodes of a facet with ``count`` nodes, shape (K, 2)."""
    return TRIANGLE[:count] if count % 3 == 0 and count < 9 else QUADRILATERAL[:count]


@kernel
def pieces_of(count):
    """Local nodes of the linear pieces of a facet with ``count`` nodes, shape (1 or 4, 3 or 4)."""
    if count == 3:
        return ONE_TRIANGLE.copy()
    if count == 4:
        return ONE_QUADRILATERAL.copy()
    return TRIANGLES.copy() if count == 6 else QUADRILATERALS.copy()


@kernel
def piece_centres(count):
    """Coordinates of the centres of the pieces of a facet, shape (1 or 4, 2)."""
    pieces, nodes = pieces_of(count), reference_nodes(count)
    centres = np.zeros((pieces.shape[0], 2))
    for p in range(pieces.shape[0]):
        for node in pieces[p]:
            for d in range(2):
                centres[p, d] += nodes[node, d] / pieces.shape[1]
    return centres


@kernel
def tabulate_shapes(a, b, N):
    """Fill ``N`` (3, K) or (6, K): shape functions at (a, b), and their derivatives.

    These are in turn the derivatives by a, b, and, of six rows, by aa, ab, bb.
    """
    if N.shape[1] % 3 == 0 and N.shape[1] < 9:
        _tabulate_triangle(a, b, N)
    else:
        _tabulate_quadrilateral(a, b, N)


@kernel
def _tabulate_triangle(a, b, N):
    """Fill ``N`` for three or six nodes, by the barycentric coordinates."""
    bary, by_a, by_b = (1.0 - a - b, 1.0 * a, 1.0 * b), (-1.0, 1.0, 0.0), (-1.0, 0.0, 1.0)
    linear, seconds = N.shape[1] == 3, N.shape[0] == 6
    for k in range(3):
        slope = 1.0 + 0.0 * a if linear else 4.0 * bary[k] - 1.0
        N[0, k] = bary[k] if linear else bary[k] * (2.0 * bary[k] - 1.0)
        N[1, k], N[2, k] = slope * by_a[k], slope * by_b[k]
        if seconds:
            curvature = 0.0 if linear else 4.0
            N[3, k], N[4, k] = curvature * by_a[k] ** 2, curvature * by_a[k] * by_b[k]
            N[5, k] = curvature * by_b[k] ** 2
    for k in range(3, N.shape[1]):
        i, j = k - 3, (k - 2) % 3
        N[0, k] = 4.0 * bary[i] * bary[j]
        N[1, k] = 4.0 * (by_a[i] * bary[j] + bary[i] * by_a[j])
        N[2, k] = 4.0 * (by_b[i] * bary[j] + bary[i] * by_b[j])
        if seconds:
            N[3, k], N[5, k] = 8.0 * by_a[i] * by_a[j], 8.0 * by_b[i] * by_b[j]
            N[4, k] = 4.0 * (by_a[i] * by_b[j] + by_b[i] * by_a[j])


@kernel
def _along(a, linear):
    """Functions of one coordinate that are 1 at -1, 1 and 0, and both derivatives: 3 by 3."""
    if linear:
        zero = 0.0 * a
        return (
            (0.5 * (1.0 - a), 0.5 * (1.0 + a), zero),
            (zero - 0.5, zero + 0.5, zero),
            (zero, zero, zero),
        )
    one = 1.0 + 0.0 * a
    return (
        (0.5 * a * (a - 1.0), 0.5 * a * (a + 1.0), 1.0 - a * a),
        (a - 0.5, a + 0.5, -2.0 * a),
        (one, one, -2.0 * one),
    )


@kernel
def _tabulate_quadrilateral(a, b, N):
    """Fill ``N`` for four or nine nodes, by products of functions of one coordinate."""
    linear, seconds = N.shape[1] == 4, N.shape[0] == 6
    along_a, along_b = _along(a, linear), _along(b, linear)
    for k in range(N.shape[1]):
        i, j = FIRST[k], SECOND[k]
        N[0, k] = along_a[0][i] * along_b[0][j]
        N[1, k], N[2, k] = along_a[1][i] * along_b[0][j], along_a[0][i] * along_b[1][j]
        if seconds:
            N[3, k], N[4, k] = along_a[2][i] * along_b[0][j], along_a[1][i] * along_b[1][j]
            N[5, k] = along_a[0][i] * along_b[2][j]
