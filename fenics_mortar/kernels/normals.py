# SPDX-License-Identifier: MIT
"""Averaged nodal normals of a chain of facets, straight or curved, with their derivatives.

=========  ==========================================================  ====================
symbol     meaning                                                     shape
=========  ==========================================================  ====================
x          current positions of the nodes                              (n, 2)
e          edge of a facet at a node: twice its tangent dx/dxi there   (2,)
t, l, nu   unit tangent, length of e and normal of one facet           (2,), (), (2,)
m          weighted sum of the normals of the facets at a node         (2,)
n          unit normal m / |m|; tau = (-n_y, n_x)                      (n, 2)
dn_dx      derivative by the positions of the neighbours along the     (n, 2, 2 (2 p + 1))
           curve: p nodes before, own, p nodes after; p = degree
=========  ==========================================================  ====================

A facet has the body on its left: nu = (t_y, -t_x). With l dnu = -t (nu . de) and dl = t . de, and
dn = tau (tau . dm) / |m|. The edge of a straight facet is the vector from its first to its second
node; that of a curved one follows from its three nodes, and at its inner node from the outer two.

The weight of a facet's normal is the length of the *other* edge (``OPPOSITE``: of straight facets
the normal is then that of the circle through the three nodes, exact on any mesh of a circle; Yang,
Laursen & Meng 2005), one (``UNIT``: Popp, Gee & Wall 2009 as implemented by most codes) or its own
length.
"""

import numpy as np

from fenics_mortar.kernels import kernel

OPPOSITE, UNIT, OWN = 0, 1, 2
# Edge before and after a node from the nodes of its neighbourhood; curved facets: of an outer node
# and of an inner one, which has one edge, taken twice
STRAIGHT = np.array([[[-1.0, 1, 0], [0, -1, 1]]])
CURVED = np.array(
    [
        [[1.0, -4, 3, 0, 0], [0, 0, -3, 4, -1]],
        [[0, -1, 0, 1, 0], [0, -1, 0, 1, 0]],
    ]
)


@kernel
def edge_frame(ex, ey):
    """Length, tangent and outward normal of an edge: (l, tx, ty, nx, ny)."""
    length = np.sqrt(ex * ex + ey * ey)
    return length, ex / length, ey / length, ey / length, -ex / length


@kernel
def add_facet(own, other, weighting, m, dm_own, dm_other):
    """Add one facet to ``m``; its derivative by its own and the other facet's edge."""
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
def edge_at(x, near, parts):
    """Frame of the edge made from ``parts`` of the nodes ``near``; those outside have no part."""
    ex, ey = 0.0 * x[0, 0], 0.0 * x[0, 1]
    for k in range(near.size):
        if parts[k] != 0.0:
            ex += parts[k] * x[near[k], 0]
            ey += parts[k] * x[near[k], 1]
    return edge_frame(ex, ey)


@kernel
def walk(j, previous, following, near):
    """Fill ``near`` with the neighbours of node ``j`` along the curve; -1 beyond an end."""
    degree = near.size // 2
    near[degree] = j
    for k in range(degree):
        before, after = near[degree - k], near[degree + k]
        near[degree - k - 1] = previous[before] if before >= 0 else -1
        near[degree + k + 1] = following[after] if after >= 0 else -1


@kernel
def tabulate_normals(x, previous, following, inner, weighting, n, dn_dx):
    """Fill ``n`` and ``dn_dx``; ``previous`` and ``following`` hold -1 at the end of a chain.

    ``inner`` (n,) tells the nodes inside facets; there are some if the facets are curved.
    """
    near = np.empty(dn_dx.shape[2] // 2, np.int64)
    degree = near.size // 2
    m = np.zeros(2, x.dtype)
    dm_before = np.zeros((2, 2), x.dtype)
    dm_after = np.zeros((2, 2), x.dtype)
    for j in range(x.shape[0]):
        m[:] = 0.0
        dm_before[:] = 0.0
        dm_after[:] = 0.0
        walk(j, previous, following, near)
        parts = STRAIGHT[0] if degree == 1 else CURVED[int(inner[j])]
        if near[degree - 1] >= 0 and near[degree + 1] >= 0:
            before, after = edge_at(x, near, parts[0]), edge_at(x, near, parts[1])
            add_facet(before, after, weighting, m, dm_before, dm_after)
            add_facet(after, before, weighting, m, dm_after, dm_before)
        elif near[degree + 1] >= 0:
            after = edge_at(x, near, parts[1])
            add_facet(after, after, UNIT, m, dm_after, dm_before)
        else:
            before = edge_at(x, near, parts[0])
            add_facet(before, before, UNIT, m, dm_before, dm_after)
        size = np.sqrt(m[0] * m[0] + m[1] * m[1])
        nx, ny = m[0] / size, m[1] / size
        n[j, 0], n[j, 1] = nx, ny
        for d in range(2):
            db = (-ny * dm_before[0, d] + nx * dm_before[1, d]) / size
            da = (-ny * dm_after[0, d] + nx * dm_after[1, d]) / size
            for k in range(near.size):
                along = parts[0, k] * db + parts[1, k] * da
                dn_dx[j, 0, 2 * k + d] = -ny * along
                dn_dx[j, 1, 2 * k + d] = nx * along
