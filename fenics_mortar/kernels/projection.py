# SPDX-License-Identifier: MIT
"""Averaged slave normals in the plane and projections along them, for facets of K = 2 or 3 nodes.

``tabulate_normals`` averages the normals at the nodes; with the shape functions of
``tabulate_shapes`` they are a continuous field. ``slave_to_master`` and ``master_to_slave`` project
along it from one facet to the other, and ``segment_ends`` differentiates the ends of segments found
by ``search``.

===========  ====================================================================  =========
symbol       meaning                                                               shape
===========  ====================================================================  =========
y            one slave and one master facet: slave nodes, their normals, master    (6 K,)
             nodes, each in order along its curve
xi, eta      coordinate on the slave / master facet, -1 ... 1                      ()
N, L         shape functions of the slave / master facet at xi / eta, with first   (3, K)
             and second derivatives
x(xi)        N x, position on the slave                                            (2,)
n(xi)        N n, not normalized; tau(xi) = (-n_y, n_x)                            (2,)
===========  ====================================================================  =========

Both directions use the normals of the slave, so each is the inverse of the other: a master point
x_m and a slave point x(xi) are partners if q(xi) = tau(xi) . (x_m - x(xi)) = 0 (Popp, Gee & Wall
2009, section 4).
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.utils.arrays import ASSEMBLY_ROUNDING, MAX_STEPS


@kernel
def tabulate_shapes(xi, N):
    """Fill ``N`` (3, K): shape functions at ``xi``, then their first and second derivatives.

    They are the Lagrange functions of two or three equidistant nodes on [-1, 1].
    """
    if N.shape[1] == 2:
        N[0, 0], N[0, 1] = 0.5 * (1.0 - xi), 0.5 * (1.0 + xi)
        N[1, 0], N[1, 1] = -0.5, 0.5
        N[2, 0], N[2, 1] = 0.0, 0.0
    else:
        N[0, 0], N[0, 1], N[0, 2] = 0.5 * xi * (xi - 1.0), 1.0 - xi * xi, 0.5 * xi * (xi + 1.0)
        N[1, 0], N[1, 1], N[1, 2] = xi - 0.5, -2.0 * xi, xi + 0.5
        N[2, 0], N[2, 1], N[2, 2] = 1.0, -2.0, 1.0


@kernel
def tabulate_points(points, table):
    """Fill ``table`` (p, 3, K) with shape functions and derivatives at ``points`` (p,)."""
    for p in range(points.size):
        tabulate_shapes(points[p], table[p])


def lagrange(s, degree):
    """Shape functions at coordinates ``s`` (...) and first derivatives, both (..., degree + 1)."""
    table = np.empty((s.size, 3, degree + 1))
    tabulate_points(np.ravel(s), table)
    shapes = table.reshape(*s.shape, 3, degree + 1)
    return shapes[..., 0, :], shapes[..., 1, :]


@kernel
def gather(x, n, m, slave, master, y):
    """Fill ``y`` (6 K,) for one slave facet and one master facet.

    ``x`` and ``n`` (n, 2) are slave positions and normals, ``m`` (k, 2) master positions; ``slave``
    and ``master`` (K,) are the nodes of the facets.
    """
    count = slave.size
    for i in range(count):
        for d in range(2):
            y[2 * i + d] = x[slave[i], d]
            y[2 * (count + i) + d] = n[slave[i], d]
            y[2 * (2 * count + i) + d] = m[master[i], d]


@kernel
def interpolate(y, which, N, order):
    """Interpolate in ``y`` by ``N[order]``: (x, y) of positions (0), normals (1), master (2)."""
    start = 2 * which * N.shape[1]
    vx, vy = 0.0 * y[0], 0.0 * y[0]
    for i in range(N.shape[1]):
        vx += N[order, i] * y[start + 2 * i]
        vy += N[order, i] * y[start + 2 * i + 1]
    return vx, vy


@kernel
def side_of_ray(x, n, point):
    """Return tau . (point - x) [length]: positive if ``point`` lies ahead of the ray along n."""
    return n[0] * (point[1] - x[1]) - n[1] * (point[0] - x[0])


@kernel
def side_of_normal(y, k, xi, N):
    """Return q = tau . (x_m - x) of master node ``k`` and slave point ``xi``, and dq/dxi."""
    tabulate_shapes(xi, N)
    x, y_ = interpolate(y, 0, N, 0)
    tx, ty = interpolate(y, 0, N, 1)
    nx, ny = interpolate(y, 1, N, 0)
    bx, by = interpolate(y, 1, N, 1)
    at = y.size - 2 * N.shape[1] + 2 * k
    rx, ry = y[at] - x, y[at + 1] - y_
    return nx * ry - ny * rx, bx * ry - by * rx - nx * ty + ny * tx


@kernel
def small_root(A, B, C):
    """Root of A t^2 + B t + C with the smaller modulus, in the form without cancellation."""
    root = np.sqrt(B * B - 4.0 * A * C)
    return -2.0 * C / (B + (root if B.real >= 0.0 else -root))


@kernel
def master_to_slave(y, k, N):
    """Coordinate ``xi`` of the partner of master node ``k`` on the slave facet; real numbers only.

    Newton's method, safeguarded by bisection: q must have different signs at -1 and 1, which is not
    checked here. It starts from the root of the parabola through q at -1, 0 and 1, which is exact
    for two-node facets and has about three digits for others. ``y`` (6 K,); ``N`` (3, K) is
    overwritten.
    """
    low, high = -1.0, 1.0
    first = side_of_normal(y, k, low, N)[0]
    last = side_of_normal(y, k, high, N)[0]
    middle = side_of_normal(y, k, 0.0, N)[0]
    xi = small_root(0.5 * (first + last) - middle, 0.5 * (last - first), middle)
    if not abs(xi) <= 1.0:
        xi = 0.0
    for _ in range(MAX_STEPS):
        q, slope = side_of_normal(y, k, xi, N)
        if q * first > 0.0:
            low = xi
        else:
            high = xi
        new = xi - q / slope
        if not low <= new <= high:
            new = 0.5 * (low + high)
        change = abs(new - xi)
        xi = new
        if change < ASSEMBLY_ROUNDING:
            break
    return xi


@kernel
def move_end(y, k, found, N, dxi_dy):
    """Coordinate ``xi`` of the partner of master node ``k``; fill ``dxi_dy`` (6 K,).

    ``found`` is the root up to rounding. One step of Newton's method from there gives xi its
    derivative where ``y`` is complex; dxi/dy follows from dq = 0.
    """
    q, slope = side_of_normal(y, k, found, N)
    xi = found - q / slope
    _, slope = side_of_normal(y, k, xi, N)
    count = N.shape[1]
    at = 4 * count + 2 * k
    x, y_ = interpolate(y, 0, N, 0)
    nx, ny = interpolate(y, 1, N, 0)
    rx, ry = y[at] - x, y[at + 1] - y_
    s = -1.0 / slope
    dxi_dy[:] = 0.0
    for i in range(count):
        own, normal = 2 * i, 2 * (count + i)
        dxi_dy[own], dxi_dy[own + 1] = s * N[0, i] * ny, -s * N[0, i] * nx
        dxi_dy[normal], dxi_dy[normal + 1] = s * N[0, i] * ry, -s * N[0, i] * rx
    dxi_dy[at], dxi_dy[at + 1] = -s * ny, s * nx
    return xi


@kernel
def slave_to_master(y, xi, N, L):
    """Return (eta, alpha) of the partner x + alpha n of slave point ``xi``; fill N and L (3, K).

    tau . (m(eta) - x) is linear or quadratic in eta. If [-1, 1] contains exactly one root, it is
    the one with the smaller modulus.
    """
    count = N.shape[1]
    tabulate_shapes(xi, N)
    x, y_ = interpolate(y, 0, N, 0)
    nx, ny = interpolate(y, 1, N, 0)
    first, last = 4 * count, 6 * count - 2
    cx, cy = 0.5 * (y[first] + y[last]), 0.5 * (y[first + 1] + y[last + 1])
    ax, ay = 0.5 * (y[last] - y[first]), 0.5 * (y[last + 1] - y[first + 1])
    B = nx * ay - ny * ax
    if count == 2:
        eta = (ny * (cx - x) - nx * (cy - y_)) / B
    else:
        mx, my = y[first + 2], y[first + 3]
        A = nx * (cy - my) - ny * (cx - mx)
        eta = small_root(A, B, nx * (my - y_) - ny * (mx - x))
    tabulate_shapes(eta, L)
    mx, my = interpolate(y, 2, L, 0)
    return eta, (nx * (mx - x) + ny * (my - y_)) / (nx * nx + ny * ny)


@kernel
def segment_ends(y, is_fixed, found, N, ends, dends_dy):
    """Fill the ``ends`` (2,) of a segment and ``dends_dy`` (2, 6 K).

    Each end is fixed on the slave facet, ``is_fixed`` (2,), or the partner of a master node: of the
    last one at the lower end and of the first one at the upper end, as the facets run in opposite
    directions. ``found`` (2,) are the ends up to rounding.
    """
    for end in range(2):
        if is_fixed[end]:
            ends[end] = found[end]
            dends_dy[end] = 0.0
        else:
            ends[end] = move_end(y, (1 - end) * (N.shape[1] - 1), found[end], N, dends_dy[end])


@kernel
def sample_gaps(geometry, connectivity, ends, points, gaps):
    """Evaluate the gap at points of segments.

    Args:
        geometry: (x (k, 2), n (k, 2), m (l, 2)): slave positions and normals, master positions.
        connectivity: (slave nodes (n, K), master nodes (n, K)) of the segments.
        ends: Ends of the segments on the slave facets, shape (n, 2).
        points: Coordinates in the segments, -1 ... 1, shape (p,).
        gaps: Gaps along the unit normal, shape (n, p) [length]; filled.
    """
    x, n, m = geometry
    slave, master = connectivity
    count = slave.shape[1]
    y, N, L = np.empty(6 * count), np.empty((3, count)), np.empty((3, count))
    for i in range(slave.shape[0]):
        gather(x, n, m, slave[i], master[i], y)
        c, h = 0.5 * (ends[i, 0] + ends[i, 1]), 0.5 * (ends[i, 1] - ends[i, 0])
        for p in range(points.size):
            _, alpha = slave_to_master(y, c + h * points[p], N, L)
            nx, ny = interpolate(y, 1, N, 0)
            gaps[i, p] = alpha * np.sqrt(nx * nx + ny * ny)


OPPOSITE, UNIT, OWN = range(3)
# Coefficients of nodal positions in the edges before and after a node; for curved facets those of
# an end node, then those of an inner node, which has one edge, counted twice
STRAIGHT = np.array([[[-1.0, 1, 0], [0, -1, 1]]])
CURVED = np.array([[[1.0, -4, 3, 0, 0], [0, 0, -3, 4, -1]], [[0, -1, 0, 1, 0], [0, -1, 0, 1, 0]]])


@kernel
def edge_frame(ex, ey):
    """Length, unit tangent and outward unit normal of an edge: (l, (tx, ty), (nx, ny))."""
    length = np.sqrt(ex * ex + ey * ey)
    tx, ty = ex / length, ey / length
    return length, (tx, ty), (ty, -tx)


@kernel
def add_facet(own, other, weighting, m, dm_own, dm_other):
    """Add the weighted normal of one facet to ``m``; add its derivatives by both edges.

    ``own`` and ``other`` are frames as ``edge_frame`` returns them; ``dm_own`` and ``dm_other``
    have the shape (2, 2).
    """
    length, t, n = own
    weight = 1.0 + 0.0 * length
    if weighting == OPPOSITE:
        weight = other[0]
    elif weighting == OWN:
        weight = length
    for a in range(2):
        m[a] += weight * n[a]
        for b in range(2):
            dm_own[a, b] -= weight / length * t[a] * n[b]
            if weighting == OPPOSITE:
                dm_other[a, b] += n[a] * other[1][b]
            elif weighting == OWN:
                dm_own[a, b] += n[a] * t[b]


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
    """Fill ``n`` and ``dn_dx``: averaged nodal normals of a chain of facets, straight or curved.

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
    l dnu = -t (nu . de) and dn = tau (tau . dm) / |m|. The edge of a straight facet is the vector
    from the first to the second node. The edge of a curved facet at an end node depends on all
    three nodes, and at the inner node on the two end nodes.

    The normal of a facet is weighted by the length of the *other* edge (``OPPOSITE``: with straight
    facets, n is then the normal of the circle through the three nodes, exact on any mesh of a
    circle; Yang, Laursen & Meng 2005), by one (``UNIT``: Popp, Gee & Wall 2009 as implemented by
    most codes), or by the length of the facet's edge itself (``OWN``).

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
