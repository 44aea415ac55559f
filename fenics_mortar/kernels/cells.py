# SPDX-License-Identifier: MIT
"""Jacobian determinants of cells, of the plane or in space, at nodes or at quadrature points."""

from fenics_mortar.kernels import kernel


@kernel
def tabulate_volumes(x, cells, gradients, volumes):
    """Fill ``volumes`` (cells, p) with the determinant of dx/dX at p points of each cell.

    At a corner of a straight cell of the plane this is twice the area of the triangle of its two
    edges there.

    Args:
        x: Positions of all nodes, shape (n, dim) [length].
        cells: Nodes of each cell, shape (cells, k).
        gradients: Gradients in the reference cell: [a, b] is that of shape function b at point a,
            shape (p, k, dim) [1].
        volumes: Determinants, shape (cells, p) [length^dim]; filled.
    """
    for e in range(cells.shape[0]):
        for a in range(gradients.shape[0]):
            volumes[e, a] = _volume(x, cells, gradients, e, a)


@kernel
def keep_volume(before, after, cells, gradients, undeformed, fraction, examined):
    """Whether every cell keeps a fraction of its area or volume at p of its points in a motion.

    Args:
        before: Positions of all nodes, shape (n, dim) [length].
        after: Positions after the motion, shape (n, dim) [length].
        cells: Nodes of each cell, shape (cells, k).
        gradients: See ``tabulate_volumes``, shape (p, k, dim) [1].
        undeformed: Determinants in the reference state, nan where they are not examined, (cells, p)
            [length^dim].
        fraction: Smallest determinant after over that before, which counts as zero if negative [1].
        examined: Ratio of present to undeformed determinant below which a point is not examined
            [1].
    """
    for e in range(cells.shape[0]):
        for a in range(gradients.shape[0]):
            ratio = _volume(before, cells, gradients, e, a) / undeformed[e, a]
            if ratio < examined:
                continue
            allowed = fraction * (0.0 if ratio < 0.0 else ratio)
            if _volume(after, cells, gradients, e, a) / undeformed[e, a] < allowed:
                return False
    return True


@kernel
def _volume(x, cells, gradients, e, a):
    """Determinant of dx/dX of cell ``e`` at its point ``a``; see ``tabulate_volumes``."""
    if x.shape[1] == 2:
        return _area(x, cells, gradients, e, a)
    x0, y0, z0 = x[cells[e, 0], 0], x[cells[e, 0], 1], x[cells[e, 0], 2]
    xs = xt = xr = ys = yt = yr = zs = zt = zr = 0.0
    for b in range(1, cells.shape[1]):
        node = cells[e, b]
        dx, dy, dz = x[node, 0] - x0, x[node, 1] - y0, x[node, 2] - z0
        s, t, r = gradients[a, b, 0], gradients[a, b, 1], gradients[a, b, 2]
        xs, xt, xr = xs + s * dx, xt + t * dx, xr + r * dx
        ys, yt, yr = ys + s * dy, yt + t * dy, yr + r * dy
        zs, zt, zr = zs + s * dz, zt + t * dz, zr + r * dz
    return xs * (yt * zr - yr * zt) + xt * (yr * zs - ys * zr) + xr * (ys * zt - yt * zs)


@kernel
def _area(x, cells, gradients, e, a):
    """As ``_volume``, in the plane."""
    x0, y0 = x[cells[e, 0], 0], x[cells[e, 0], 1]
    xs = xt = ys = yt = 0.0
    for b in range(1, cells.shape[1]):
        dx, dy = x[cells[e, b], 0] - x0, x[cells[e, b], 1] - y0
        s, t = gradients[a, b, 0], gradients[a, b, 1]
        xs, xt = xs + s * dx, xt + t * dx
        ys, yt = ys + s * dy, yt + t * dy
    return xs * yt - xt * ys
