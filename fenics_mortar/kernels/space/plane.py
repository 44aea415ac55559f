# SPDX-License-Identifier: MIT
"""Auxiliary plane of a linear piece of a slave facet, and projections along its normal.

==========  ======================================================================  ============
symbol      meaning                                                                 shape
==========  ======================================================================  ============
frame       t_1, t_2, n_0 and c: axes, normal and centre of the plane               (4, 3)
e, f        edges at the centre: the plane's normal is e x f / |e x f|              (3,)
images      flat images of the nodes of the slave and then of the master facet      (K + K', 2)
heights     their heights above the plane, h                                        (K + K',)
==========  ======================================================================  ============

For a triangle e = x_1 - x_0, f = x_2 - x_0; for a quadrilateral e = x_2 - x_0, f = x_3 - x_1, its
diagonals. The area of the flat image of both is |e x f| / 2. The derivatives (Puso & Laursen 2004;
Popp, Gitterle, Gee & Wall 2010) are

    dX = t_d . dx - h t_d . dn_0,    t_d . dn_0 = t_d . (de x f + e x df) / |e x f|
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.space.normals import cross, dot
from fenics_mortar.kernels.space.shapes import reference_nodes, tabulate_shapes
from fenics_mortar.utils.rounding import MAX_STEPS

# Last Newton step [1] in reference coordinates: the next one would be its square.
LAST_STEP = 1e-13


@kernel
def cross2(ax, ay, bx, by):
    """Vector product of two vectors in the plane."""
    return ax * by - ay * bx


@kernel
def set_plane(x, nodes, corners, frame):
    """Fill ``frame`` (4, 3) for the piece of a facet with local ``corners``; return its area."""
    e, f, n = frame[0], frame[1], frame[2]
    first = nodes[corners[0]]
    last = nodes[corners[corners.size - 1]]
    for d in range(3):
        start = x[first, d] if corners.size == 3 else x[nodes[corners[1]], d]
        e[d], f[d] = x[nodes[corners[corners.size - 2]], d] - x[first, d], x[last, d] - start
        frame[3, d] = 0.0 * x[0, 0]
        for k in range(corners.size):
            frame[3, d] += x[nodes[corners[k]], d] / corners.size
    cross(e, f, n)
    size, length = np.sqrt(dot(n, n)), np.sqrt(dot(e, e))
    for d in range(3):
        n[d] /= size
        e[d] /= length
    cross(n, e, f)
    return 0.5 * size


@kernel
def flatten(x, nodes, frame, start, images, heights):
    """Fill ``images`` and ``heights`` of ``nodes`` (K,) at positions ``x``, from row ``start``."""
    for k in range(nodes.size):
        vx, vy = x[nodes[k], 0] - frame[3, 0], x[nodes[k], 1] - frame[3, 1]
        vz = x[nodes[k], 2] - frame[3, 2]
        for d in range(2):
            images[start + k, d] = frame[d, 0] * vx + frame[d, 1] * vy + frame[d, 2] * vz
        heights[start + k] = frame[2, 0] * vx + frame[2, 1] * vy + frame[2, 2] * vz


@kernel
def jacobian(images, start, N):
    """Derivatives of the image of a facet with respect to its coordinates: (X_1, Y_1, X_2, Y_2)."""
    xa = ya = xb = yb = 0.0 * images[0, 0]
    for k in range(N.shape[1]):
        xa += N[1, k] * images[start + k, 0]
        ya += N[1, k] * images[start + k, 1]
        xb += N[2, k] * images[start + k, 0]
        yb += N[2, k] * images[start + k, 1]
    return xa, ya, xb, yb


@kernel
def is_folded(images, corners, N):
    """Whether a slave facet is folded over its plane at one of the ``corners`` of a piece.

    ``N`` (3, K) is overwritten. A quadrilateral is folded if it is not convex.
    """
    reference = reference_nodes(N.shape[1])
    for k in corners:
        tabulate_shapes(reference[k, 0], reference[k, 1], N)
        xa, ya, xb, yb = jacobian(images, 0, N)
        if not cross2(xa, ya, xb, yb).real > 0.0:
            return True
    return False


@kernel
def find_point(images, start, point, a, b, N):
    """Fill ``N`` (3, K) at the point of a facet whose flat image is ``point``, by Newton's method.

    ``a``, ``b``: where it starts, in reference coordinates. Returns the determinant of the flat
    image at the point; nan if there is none.
    """
    a, b = a + 0.0 * images[0, 0], b + 0.0 * images[0, 0]
    found = False
    for _ in range(MAX_STEPS):
        tabulate_shapes(a, b, N)
        xa, ya, xb, yb = jacobian(images, start, N)
        det = cross2(xa, ya, xb, yb)
        if found or det.real == 0.0:
            return det
        rx, ry = point[0], point[1]
        for k in range(N.shape[1]):
            rx = rx - N[0, k] * images[start + k, 0]
            ry = ry - N[0, k] * images[start + k, 1]
        da, db = cross2(rx, ry, xb, yb) / det, cross2(xa, ya, rx, ry) / det
        a, b = a + da, b + db
        found = N.shape[1] == 3 or abs(da.real) + abs(db.real) < LAST_STEP
    return np.nan * det
