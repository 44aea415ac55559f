# SPDX-License-Identifier: MIT
"""Normals of facets in space: averaged at the nodes, and those of the auxiliary planes of pieces.

**Averaged nodal normals** of a surface of facets, flat or curved, with their derivatives, by
``tabulate_normals``:

=========  ==========================================================================  ============
symbol     meaning                                                                     shape
=========  ==========================================================================  ============
p, q       edges of a facet that leave a node, counter-clockwise: P x and Q x          (3,)
s          weighted sum of p x q over the facets at a node                             (3,)
n          unit normal s / |s|, or Q s / |Q s| with a projector                        (3,)
ring       nodes on which n depends                                                    (S,)
dn         derivative of n by the positions of the ring                                (3, 3 S)
=========  ==========================================================================  ============

At the node on an edge p is along the edge and q points to the opposite corner or edge; edges of
curved facets are tangents at the node. With the weight ``OPPOSITE``, 1 / (|p|^2 |q|^2), normals are
exact on a sphere for any mesh (Max 1999); ``UNIT`` is 1 / |p x q| (Popp, Gitterle, Gee & Wall
2010), ``OWN`` is 1.

**Auxiliary plane** of a linear piece of a slave facet, by ``set_plane``. ``flatten`` projects nodes
onto it along its normal, ``find_point`` a point of it back to a facet:

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
from fenics_mortar.kernels.blocks import cross, cross2, dot
from fenics_mortar.kernels.projection import OPPOSITE, UNIT
from fenics_mortar.kernels.space import shapes
from fenics_mortar.utils.arrays import MAX_STEPS


def _edge_directions(nodes, corners):
    """Directions of the edges p and q at the ``nodes`` (K, 2) of a reference facet, (K, 2, 2)."""
    edges = []
    for j in range(corners):
        edges.append((nodes[(j + 1) % corners] - nodes[j], nodes[(j - 1) % corners] - nodes[j]))
    for j in range(corners):
        opposite = nodes[(j + 2) % 3] if corners == 3 else nodes[4 + (j + 2) % 4]
        edges.append((nodes[(j + 1) % corners] - nodes[j], opposite - nodes[corners + j]))
    if corners == 4:
        edges.append((nodes[1] - nodes[0], nodes[3] - nodes[0]))
    return np.array(edges)


EDGES_OF_TRIANGLE = _edge_directions(shapes.TRIANGLE, 3)
EDGES_OF_QUADRILATERAL = _edge_directions(shapes.QUADRILATERAL, 4)


@kernel
def edge_coefficients(count):
    """P and Q (K, K): edges at node j of a facet are sum_k P[j, k] x_k and sum_k Q[j, k] x_k."""
    P, Q, N = np.empty((count, count)), np.empty((count, count)), np.empty((3, count))
    nodes = shapes.reference_nodes(count)
    edges = EDGES_OF_TRIANGLE if count % 3 == 0 and count < 9 else EDGES_OF_QUADRILATERAL
    for j in range(count):
        shapes.tabulate_shapes(nodes[j, 0], nodes[j, 1], N)
        for k in range(count):
            P[j, k] = N[1, k] * edges[j, 0, 0] + N[2, k] * edges[j, 0, 1]
            Q[j, k] = N[1, k] * edges[j, 1, 0] + N[2, k] * edges[j, 1, 1]
    return P, Q


def facets_around(facets, num_nodes):
    """Facets (f, K) at each node: starts (n + 1,), facets (e,), local numbers of the node (e,)."""
    order = np.argsort(facets, axis=None, kind="stable")
    counts = np.bincount(facets.ravel(), minlength=num_nodes)
    starts = np.concatenate([[0], np.cumsum(counts)])
    return starts, order // facets.shape[1], order % facets.shape[1]


def padded(rows, values, count):
    """Values by rows, in order, -1 for none, shape (count, largest number of values).

    ``rows`` (k,) ascend; ``values`` has the same shape.
    """
    starts = np.searchsorted(rows, np.arange(count + 1))
    table = np.full((count, max(1, int(np.diff(starts).max(initial=0)))), -1)
    table[rows, np.arange(rows.size) - starts[rows]] = values
    return table


def find_rings(facets, num_nodes):
    """Nodes on which the normal of each node depends, increasing, shape (n, S); -1 for none."""
    P, Q = edge_coefficients(facets.shape[1])
    of_node, used = np.nonzero((P != 0.0) | (Q != 0.0))
    pairs = np.unique(np.ravel(facets[:, of_node] * num_nodes + facets[:, used]))
    return padded(pairs // num_nodes, pairs % num_nodes, num_nodes)


@kernel
def place_in(ring, node):
    """Place of a node in its ``ring`` (S,); -1 if it is not in it."""
    for i in range(ring.size):
        if ring[i] == node:
            return i
    return -1


@kernel
def add_facet(x, nodes, P, Q, weighting, ring, s, ds, work):
    """Add the contribution of one facet to ``s`` (3,) and ``ds`` (3, 3 S).

    ``nodes`` (K,) are those of the facet, ``P`` and ``Q`` (K,) the coefficients of its edges at the
    node, ``work`` has the shape (5, 3).
    """
    p, q, area, arm, turned = work[0], work[1], work[2], work[3], work[4]
    for d in range(3):
        p[d] = q[d] = 0.0 * x[0, 0]
        for k in range(nodes.size):
            p[d] += P[k] * x[nodes[k], d]
            q[d] += Q[k] * x[nodes[k], d]
    cross(p, q, area)
    A, B, weight = dot(p, p), dot(q, q), 1.0 + 0.0 * p[0]
    if weighting == OPPOSITE:
        weight = 1.0 / (A * B)
    elif weighting == UNIT:
        weight = 1.0 / np.sqrt(dot(area, area))
    for d in range(3):
        s[d] += weight * area[d]
    for k in range(nodes.size):
        if P[k] == 0.0 and Q[k] == 0.0:
            continue
        at = 3 * place_in(ring, nodes[k])
        for d in range(3):
            arm[d] = P[k] * q[d] - Q[k] * p[d]
        cross(arm, area, turned)
        for d in range(3):
            # d(p x q) = e_d x arm
            one, other = (d + 1) % 3, (d + 2) % 3
            ds[one, at + d] -= weight * arm[other]
            ds[other, at + d] += weight * arm[one]
            slope = 0.0 * weight
            if weighting == OPPOSITE:
                slope = -2.0 * weight * (p[d] * P[k] / A + q[d] * Q[k] / B)
            elif weighting == UNIT:
                slope = -(weight**3) * turned[d]
            for c in range(3):
                ds[c, at + d] += slope * area[c]


@kernel
def tabulate_normals(x, facets, around, ring, weighting, projectors, n, dn):
    """Fill ``n`` and ``dn``, see the module.

    Args:
        x: Positions of the nodes, shape (n, 3) [length].
        facets: Nodes of the facets, shape (f, K).
        around: (starts (n + 1,), facets (e,), local numbers (e,)), see ``facets_around``.
        ring: Nodes on which each normal depends, shape (n, S), -1 for none: at least those of
            ``find_rings``.
        weighting: ``OPPOSITE``, ``UNIT`` or ``OWN``, see ``kernels.projection``.
        projectors: Matrices that are applied to s, for symmetry planes, shape (n, 3, 3); or None.
        n: Unit normals, shape (n, 3); filled. They are nan at nodes without facets.
        dn: Derivatives, shape (n, 3, 3 S) [1 / length]; filled.
    """
    starts, facet, local = around
    P, Q = edge_coefficients(facets.shape[1])
    s, ds = np.empty(3, x.dtype), np.empty((3, dn.shape[2]), x.dtype)
    work, column = np.empty((5, 3), x.dtype), np.empty(3, x.dtype)
    for j in range(x.shape[0]):
        s[:] = 0.0
        ds[:] = 0.0
        for i in range(starts[j], starts[j + 1]):
            k = local[i]
            add_facet(x, facets[facet[i]], P[k], Q[k], weighting, ring[j], s, ds, work)
        if projectors is not None:
            project(projectors[j], s, column)
        size = np.sqrt(dot(s, s))
        for c in range(3):
            n[j, c] = s[c] / size
        for k in range(dn.shape[2]):
            if projectors is not None:
                project(projectors[j], ds[:, k], column)
            along = n[j, 0] * ds[0, k] + n[j, 1] * ds[1, k] + n[j, 2] * ds[2, k]
            for c in range(3):
                dn[j, c, k] = (ds[c, k] - n[j, c] * along) / size


@kernel
def project(projector, vector, work):
    """Replace ``vector`` (3,) by its product with ``projector`` (3, 3)."""
    for c in range(3):
        work[c] = projector[c, 0] * vector[0] + projector[c, 1] * vector[1]
        work[c] += projector[c, 2] * vector[2]
    for c in range(3):
        vector[c] = work[c]


# Last Newton step [1] in reference coordinates: the next one would be its square.
LAST_STEP = 1e-13


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
def set_across(n, along):
    """Fill ``along[:2, :3]`` with two unit vectors across a unit vector ``n`` (3,), orthogonal."""
    least = 0
    for d in range(1, 3):
        if abs(n[d]) < abs(n[least]):
            least = d
    axis = np.zeros(3)
    axis[least] = 1.0
    cross(n, axis, along[0])
    size = np.sqrt(dot(along[0, :3], along[0, :3]))
    for d in range(3):
        along[0, d] /= size
    cross(n, along[0], along[1])


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
def piece_edges(images, corners):
    """Edges e and f of a piece in the plane; ``corners`` are rows of ``images``."""
    last = corners.size - 1
    start = corners[0] if last == 2 else corners[1]
    return (
        images[corners[last - 1], 0] - images[corners[0], 0],
        images[corners[last - 1], 1] - images[corners[0], 1],
        images[corners[last], 0] - images[start, 0],
        images[corners[last], 1] - images[start, 1],
    )


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
    reference = shapes.reference_nodes(N.shape[1])
    for k in corners:
        shapes.tabulate_shapes(reference[k, 0], reference[k, 1], N)
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
        shapes.tabulate_shapes(a, b, N)
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
