# SPDX-License-Identifier: MIT
"""Averaged nodal normals of a chain of straight facets, with their derivatives.

=========  ==========================================================  ===============
symbol     meaning                                                     shape
=========  ==========================================================  ===============
x          current positions of the nodes                              (n, 2)
t, l, nu   unit tangent, length and normal of one facet                (2,), (), (2,)
m          weighted sum of the normals of the facets at a node         (2,)
n          unit normal m / |m|; tau = (-n_y, n_x)                      (n, 2)
dn_dx      derivative by the positions of previous, own and next node  (n, 2, 6)
=========  ==========================================================  ===============

A facet runs from a to b with the body on its left: nu = (t_y, -t_x). With l dnu = -t (nu . de)
and dl = t . de for e = b - a, and dn = tau (tau . dm) / |m|.

The weight of a facet's normal is the length of the *other* facet (``OPPOSITE``: the normal is then
that of the circle through the three nodes, exact on any mesh of a circle; Yang, Laursen & Meng
2005), one (``UNIT``: Popp, Gee & Wall 2009 as implemented by most codes) or its own length.
"""

import numpy as np

from fenics_mortar.kernels import kernel

OPPOSITE, UNIT, OWN = 0, 1, 2


@kernel
def facet_frame(a, b):
    """Length, tangent and outward normal of the facet from ``a`` to ``b``: (l, tx, ty, nx, ny)."""
    ex, ey = b[0] - a[0], b[1] - a[1]
    length = np.sqrt(ex * ex + ey * ey)
    return length, ex / length, ey / length, ey / length, -ex / length


@kernel
def add_facet(own, other, weighting, m, dm_own, dm_other):
    """Add one facet to ``m``; its derivative by its own and the other facet's edge vector."""
    length, tx, ty, nx, ny = own
    weight = 1.0 + 0.0 * length
    if weighting == OPPOSITE:
        weight = other[0]
        dm_other[0, 0] += nx * other[1]
        dm_other[0, 1] += nx * other[2]
        dm_other[1, 0] += ny * other[1]
        dm_other[1, 1] += ny * other[2]
    elif weighting == OWN:
        weight = length
        dm_own[0, 0] += nx * tx
        dm_own[0, 1] += nx * ty
        dm_own[1, 0] += ny * tx
        dm_own[1, 1] += ny * ty
    m[0] += weight * nx
    m[1] += weight * ny
    weight = weight / length
    dm_own[0, 0] -= weight * tx * nx
    dm_own[0, 1] -= weight * tx * ny
    dm_own[1, 0] -= weight * ty * nx
    dm_own[1, 1] -= weight * ty * ny


@kernel
def tabulate_normals(x, previous, following, weighting, n, dn_dx):
    """Fill ``n`` and ``dn_dx``; ``previous`` and ``following`` hold -1 at the end of a chain."""
    m = np.zeros(2, x.dtype)
    dm_before = np.zeros((2, 2), x.dtype)
    dm_after = np.zeros((2, 2), x.dtype)
    for j in range(x.shape[0]):
        m[:] = 0.0
        dm_before[:] = 0.0
        dm_after[:] = 0.0
        i, k = previous[j], following[j]
        if i >= 0 and k >= 0:
            before = facet_frame(x[i], x[j])
            after = facet_frame(x[j], x[k])
            add_facet(before, after, weighting, m, dm_before, dm_after)
            add_facet(after, before, weighting, m, dm_after, dm_before)
        elif k >= 0:
            after = facet_frame(x[j], x[k])
            add_facet(after, after, UNIT, m, dm_after, dm_before)
        else:
            before = facet_frame(x[i], x[j])
            add_facet(before, before, UNIT, m, dm_before, dm_after)
        size = np.sqrt(m[0] * m[0] + m[1] * m[1])
        nx, ny = m[0] / size, m[1] / size
        n[j, 0], n[j, 1] = nx, ny
        for d in range(2):
            db = (-ny * dm_before[0, d] + nx * dm_before[1, d]) / size
            da = (-ny * dm_after[0, d] + nx * dm_after[1, d]) / size
            for c in range(2):
                tau = -ny if c == 0 else nx
                dn_dx[j, c, d] = -tau * db
                dn_dx[j, c, 2 + d] = tau * (db - da)
                dn_dx[j, c, 4 + d] = tau * da
