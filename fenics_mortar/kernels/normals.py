# SPDX-License-Identifier: MIT
"""Averaged nodal normals of a chain of facets, straight or curved, with their derivatives.

=========  ==========================================================  ====================
symbol     meaning                                                     shape
=========  ==========================================================  ====================
x          current positions of the nodes                              (n, 2)
e          edge of a facet at a node: twice the tangent dx/dxi there   (2,)
t, l, nu   unit tangent, length of e and normal of one facet           (2,), (), (2,)
m          weighted sum of the normals of the facets at a node         (2,)
n          unit normal m / |m|; tau = (-n_y, n_x)                      (n, 2)
dn_dx      derivative of n by positions of nodes along the curve: p    (n, 2, 2 (2 p + 1))
           nodes before, the node itself, p nodes after; p = degree
=========  ==========================================================  ====================

The body is on the left of a facet: nu = (t_y, -t_x). The derivatives follow from dl = t . de,
l dnu = -t (nu . de) and dn = tau (tau . dm) / |m|. The edge of a straight facet is the vector from
the first to the second node. The edge of a curved facet at an end node depends on all three nodes,
and at the inner node on the two end nodes.

The normal of a facet is weighted by the length of the *other* edge (``OPPOSITE``: with straight
facets, n is then the normal of the circle through the three nodes, exact on any mesh of a circle;
Yang, Laursen & Meng 2005), by one (``UNIT``: Popp, Gee & Wall 2009 as implemented by most codes),
or by the length of the facet's edge itself (``OWN``).
"""

import numpy as np

from fenics_mortar.kernels import kernel

OPPOSITE, UNIT, OWN = range(3)
# Coefficients of nodal positions in the edges before and after a node; for curved facets those of
# an end node, then those of an inner node, which has one edge, counted twice
STRAIGHT = np.array([[[-1.0, 1, 0], [0, -1, 1]]])
CURVED = np.array(
    [
        [[1.0, -4, 3, 0, 0], [0, 0, -3, 4, -1]],
        [[0, -1, 0, 1, 0], [0, -1, 0, 1, 0]],
    ]
)


@kernel
def edge_frame(ex, ey):
    """Length, unit tangent and outward unit normal of an edge: (l, tx, ty, nx, ny)."""
    length = np.sqrt(ex * ex + ey * ey)
    return length, ex / length, ey / length, ey / length, -ex / length


@kernel
def add_facet(own, other, weighting, m, dm_own, dm_other):
    """Add the weighted normal of one facet to ``m``; add its derivatives by both edges.

    ``own`` and ``other`` are frames as ``edge_frame`` returns them; ``dm_own`` and ``dm_other``
    have the shape (2, 2).
    """
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
def edge_at(x, near, coefficients):
    """Frame of the edge sum_k coefficients[k] x[near[k]], see ``edge_frame``.

    ``near`` (2 p + 1,) as in ``walk``; ``coefficients`` (2 p + 1,) are 0 for nodes beyond an end.
    """
    ex, ey = 0.0 * x[0, 0], 0.0 * x[0, 1]
    for k in range(near.size):
        if coefficients[k] != 0.0:
            ex += coefficients[k] * x[near[k], 0]
            ey += coefficients[k] * x[near[k], 1]
    return edge_frame(ex, ey)


@kernel
def walk(j, previous, following, near):
    """Fill ``near`` (2 p + 1,) with the nodes around node ``j`` on the curve; -1 beyond an end."""
    degree = near.size // 2
    near[degree] = j
    for k in range(degree):
        before, after = near[degree - k], near[degree + k]
        near[degree - k - 1] = previous[before] if before >= 0 else -1
        near[degree + k + 1] = following[after] if after >= 0 else -1


@kernel
def tabulate_normals(x, previous, following, inner, weighting, n, dn_dx):
    """Fill ``n`` and ``dn_dx``, see above.

    Args:
        x: Current positions of the nodes, shape (n, 2) [length].
        previous: Node before each node, -1 at an end of a curve, shape (n,).
        following: Node after each node, -1 at an end of a curve, shape (n,).
        inner: Whether a node is inside a curved facet, shape (n,), bool.
        weighting: ``OPPOSITE``, ``UNIT`` or ``OWN``.
        n: Unit normals, shape (n, 2); filled.
        dn_dx: Derivatives, shape (n, 2, 2 (2 p + 1)) [1 / length]; filled.
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
        coefficients = STRAIGHT[0] if degree == 1 else CURVED[int(inner[j])]
        if near[degree - 1] >= 0 and near[degree + 1] >= 0:
            before, after = edge_at(x, near, coefficients[0]), edge_at(x, near, coefficients[1])
            add_facet(before, after, weighting, m, dm_before, dm_after)
            add_facet(after, before, weighting, m, dm_after, dm_before)
        elif near[degree + 1] >= 0:
            after = edge_at(x, near, coefficients[1])
            add_facet(after, after, UNIT, m, dm_after, dm_before)
        else:
            before = edge_at(x, near, coefficients[0])
            add_facet(before, before, UNIT, m, dm_before, dm_after)
        size = np.sqrt(m[0] * m[0] + m[1] * m[1])
        nx, ny = m[0] / size, m[1] / size
        n[j, 0], n[j, 1] = nx, ny
        for d in range(2):
            db = (-ny * dm_before[0, d] + nx * dm_before[1, d]) / size
            da = (-ny * dm_after[0, d] + nx * dm_after[1, d]) / size
            for k in range(near.size):
                along = coefficients[0, k] * db + coefficients[1, k] * da
                dn_dx[j, 0, 2 * k + d] = -ny * along
                dn_dx[j, 1, 2 * k + d] = nx * along
