# SPDX-License-Identifier: MIT
"""Jacobian determinants of cells at their nodes or at quadrature points."""

from fenics_mortar.kernels import kernel


@kernel
def tabulate_areas(x, cells, gradients, areas):
    """Fill ``areas`` (cells, p) with the determinant of dx/dX at p points of each cell.

    At a corner of a straight cell this is twice the area of the triangle of its two edges.

    Args:
        x: Positions of all nodes, shape (n, 2) [length].
        cells: Nodes of each cell, shape (cells, k).
        gradients: Gradients in the reference cell: [a, b] is that of shape function b at point a,
            shape (p, k, 2) [1].
        areas: Determinants, shape (cells, p) [length^2]; filled.
    """
    for e in range(cells.shape[0]):
        for a in range(gradients.shape[0]):
            areas[e, a] = _area(x, cells, gradients, e, a)


@kernel
def keep_area(before, after, cells, gradients, undeformed, fraction, examined):
    """Whether every cell keeps a fraction of its area at p of its points in a motion.

    Args:
        before: Positions of all nodes, shape (n, 2) [length].
        after: Positions after the motion, shape (n, 2) [length].
        cells: Nodes of each cell, shape (cells, k).
        gradients: See ``tabulate_areas``, shape (p, k, 2) [1].
        undeformed: Areas in the reference state, nan where they are not examined, (cells, p)
            [length^2].
        fraction: Smallest area after over that before, which counts as zero if negative [1].
        examined: Ratio of present to undeformed area below which a point is not examined [1].
    """
    for e in range(cells.shape[0]):
        for a in range(gradients.shape[0]):
            ratio = _area(before, cells, gradients, e, a) / undeformed[e, a]
            if ratio < examined:
                continue
            allowed = fraction * (0.0 if ratio < 0.0 else ratio)
            if _area(after, cells, gradients, e, a) / undeformed[e, a] < allowed:
                return False
    return True


@kernel
def _area(x, cells, gradients, e, a):
    """Determinant of dx/dX of cell ``e`` at its point ``a``; see ``tabulate_areas``."""
    x0, y0 = x[cells[e, 0], 0], x[cells[e, 0], 1]
    xs = xt = ys = yt = 0.0
    for b in range(1, cells.shape[1]):
        dx, dy = x[cells[e, b], 0] - x0, x[cells[e, b], 1] - y0
        s, t = gradients[a, b, 0], gradients[a, b, 1]
        xs, xt = xs + s * dx, xt + t * dx
        ys, yt = ys + s * dy, yt + t * dy
    return xs * yt - xt * ys
