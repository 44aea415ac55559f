# SPDX-License-Identifier: MIT
"""Projections and mortar integrals of facets with any number K of nodes; three make them curved.

Same task as ``projection``, ``segment`` and ``basis``, which use what is special to two nodes: here
the facets, the normals and the multipliers are polynomials of degree K - 1.

===========  ====================================================================  ===========
symbol       meaning                                                               shape
===========  ====================================================================  ===========
y            one slave and one master facet: slave nodes, their normals, master    (6 K,)
             nodes, each in order along its curve
xi, eta      coordinate on the slave / master facet, -1 ... 1                      ()
N, L         shape functions of the slave / master facet at xi / eta               (K,)
J            |dx/dxi|, so dgamma = J dxi                                           ()
T            1, t, ..., t^(K - 1) with t = (xi - middle) / half: a basis on the    (K,)
             covered part of the facet, whose ends are at t = -1 and 1
G            moments int t^p dgamma of a segment, p = 0 ... 2 K - 2; the mass      (2 K - 1,)
             matrix of T has the entries G[p + q]
M, g         moments int T_p L_l dgamma, int T_p g dgamma of a segment             (K, K), (K,)
columns      derivatives end up by the positions of the slave nodes of the facet   (8 K - 4,)
             before, the own and the facet after, and of the master nodes
===========  ====================================================================  ===========

On the covered part S of a facet the multiplier functions are Phi = C T. With B the coefficients of
the shape functions, N = B T, and d_j = int_S N_j dgamma, the bases are

    standard   C = B
    dual       C_j = d_j T(xi_j) G^-1, xi_j the coordinate of node j:

d_j times the polynomial that gives, integrated with any other one, its value at node j. So the
dual functions are biorthogonal to N on S, whatever S and J; their sum is one. All integrals are
those of the segments, in D as in M, so that the forces of both sides balance to the last digit.

A node without multiplier hands its function to its neighbours on the facet: C is then multiplied
by a matrix H of weights whose columns sum to one. Dual functions are shared in proportion to d_j,
so that a neighbour whose d_j vanishes gets nothing and may be left out without a jump. If only the
ends of a facet carry, they have the linear functions, (1 -+ xi) / 2: those are N_j + N_m / 2 with
the standard basis, and Phi_j + Phi_m / 2 with the dual one where J is even and the cover full.

T moves with nothing: ``middle`` and ``half`` are numbers, since C T does not depend on them. But J
varies along a curved facet, so that C depends on all segments of the facet: M on segment i has
derivatives by the nodes of each segment k, hence pairs (i, k).
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.basis import BY_COVER, BY_STANDARD, DUAL


@kernel
def tabulate_shapes(xi, N):
    """Fill the shape functions N[0], their first and second derivatives N[1], N[2] at ``xi``."""
    if N.shape[1] == 2:
        N[0, 0], N[0, 1] = 0.5 * (1.0 - xi), 0.5 * (1.0 + xi)
        N[1, 0], N[1, 1] = -0.5, 0.5
        N[2, 0], N[2, 1] = 0.0, 0.0
    else:
        N[0, 0], N[0, 1], N[0, 2] = 0.5 * xi * (xi - 1.0), 1.0 - xi * xi, 0.5 * xi * (xi + 1.0)
        N[1, 0], N[1, 1], N[1, 2] = xi - 0.5, -2.0 * xi, xi + 0.5
        N[2, 0], N[2, 1], N[2, 2] = 1.0, -2.0, 1.0


@kernel
def combine(y, part, N, order):
    """Nodes (part 0), normals (1) or master nodes (2) in ``y`` combined by ``N[order]``: (x, y)."""
    start = 2 * part * N.shape[1]
    vx, vy = 0.0 * y[0], 0.0 * y[0]
    for i in range(N.shape[1]):
        vx += N[order, i] * y[start + 2 * i]
        vy += N[order, i] * y[start + 2 * i + 1]
    return vx, vy


# Projections


@kernel
def side_of_normal(y, k, xi, N):
    """Q = tau . (x_m - x) of master node ``k`` and the slave point ``xi``, and dq/dxi."""
    tabulate_shapes(xi, N)
    x, y_ = combine(y, 0, N, 0)
    tx, ty = combine(y, 0, N, 1)
    nx, ny = combine(y, 1, N, 0)
    bx, by = combine(y, 1, N, 1)
    at = y.size - 2 * N.shape[1] + 2 * k
    rx, ry = y[at] - x, y[at + 1] - y_
    return nx * ry - ny * rx, bx * ry - by * rx - nx * ty + ny * tx


@kernel
def master_to_slave(y, k, N):
    """``xi`` of the partner of master node ``k`` on the slave facet.

    Newton from the root of the chord of q, kept between ends of different sign, which the caller
    has tested. The last step is taken in the numbers of ``y`` and may leave [-1, 1] by rounding.
    """
    low, high = -1.0, 1.0
    first = side_of_normal(y, k, low + 0.0 * y[0], N)[0].real
    last = side_of_normal(y, k, high + 0.0 * y[0], N)[0].real
    xi = (first + last) / (first - last) if first * last < 0.0 else 0.0
    for _ in range(60):
        q, slope = side_of_normal(y, k, xi + 0.0 * y[0], N)
        if q.real * first > 0.0:
            low = xi
        else:
            high = xi
        new = xi - q.real / slope.real
        if not low <= new <= high:
            new = 0.5 * (low + high)
        change = abs(new - xi)
        xi = new
        if change < 1e-13:
            break
    q, slope = side_of_normal(y, k, xi + 0.0 * y[0], N)
    return xi - q / slope


@kernel
def master_to_slave_derivative(y, k, xi, N, dxi_dy):
    """Fill ``dxi_dy`` (6 K,) for the partner ``xi`` of master node ``k``: dq = 0 along it."""
    _, slope = side_of_normal(y, k, xi, N)
    count = N.shape[1]
    at = 4 * count + 2 * k
    x, y_ = combine(y, 0, N, 0)
    nx, ny = combine(y, 1, N, 0)
    rx, ry = y[at] - x, y[at + 1] - y_
    s = -1.0 / slope
    dxi_dy[:] = 0.0
    for i in range(count):
        own, normal = 2 * i, 2 * (count + i)
        dxi_dy[own], dxi_dy[own + 1] = s * N[0, i] * ny, -s * N[0, i] * nx
        dxi_dy[normal], dxi_dy[normal + 1] = s * N[0, i] * ry, -s * N[0, i] * rx
    dxi_dy[at], dxi_dy[at + 1] = -s * ny, s * nx


@kernel
def slave_to_master(y, xi, N):
    """``eta`` and ``alpha`` of the partner x + alpha n of the slave point ``xi``.

    tau . (m(eta) - x) is a quadratic whose root of smaller size is the one in [-1, 1], if there is
    only one there; the formula is that without cancellation.
    """
    count = N.shape[1]
    tabulate_shapes(xi, N)
    x, y_ = combine(y, 0, N, 0)
    nx, ny = combine(y, 1, N, 0)
    first, last = 4 * count, 6 * count - 2
    cx, cy = 0.5 * (y[first] + y[last]), 0.5 * (y[first + 1] + y[last + 1])
    ax, ay = 0.5 * (y[last] - y[first]), 0.5 * (y[last + 1] - y[first + 1])
    A, B = 0.0 * cx, nx * ay - ny * ax
    if count == 3:
        mx, my = y[first + 2], y[first + 3]
        A = nx * (cy - my) - ny * (cx - mx)
        cx, cy = mx, my
    C = nx * (cy - y_) - ny * (cx - x)
    root = np.sqrt(B * B - 4.0 * A * C)
    eta = -2.0 * C / (B + (root if B.real >= 0.0 else -root))
    tabulate_shapes(eta, N)
    mx, my = combine(y, 2, N, 0)
    return eta, (nx * (mx - x) + ny * (my - y_)) / (nx * nx + ny * ny)


@kernel
def segment_ends(y, lower_is_fixed, upper_is_fixed, N, ends, dends_dy):
    """Fill those ends (2,) of a segment that move, and the derivative (2, 6 K) of both.

    The master facet runs against the slave facet: the lower end is fixed (at the first slave node)
    or the partner of the last master node, the upper end at the last one or that of the first.
    """
    dends_dy[:] = 0.0
    last = N.shape[1] - 1
    if not lower_is_fixed:
        ends[0] = master_to_slave(y, last, N)
        master_to_slave_derivative(y, last, ends[0], N, dends_dy[0])
    if not upper_is_fixed:
        ends[1] = master_to_slave(y, 0, N)
        master_to_slave_derivative(y, 0, ends[1], N, dends_dy[1])


# Moments of a segment


@kernel
def point_derivatives(y, eta, alpha, N, L, deta, dgap):
    """Fill d eta and d g by ``y`` (6 K,) at fixed xi; return (g, d eta/d xi, d g/d xi).

    As in ``segment``, with a = dm/deta; ``N`` and ``L`` are those at xi and eta.
    """
    count = N.shape[1]
    nx, ny = combine(y, 1, N, 0)
    bx, by = combine(y, 1, N, 1)
    tx, ty = combine(y, 0, N, 1)
    ax, ay = combine(y, 2, L, 1)
    size = np.sqrt(nx * nx + ny * ny)
    along = nx * ay - ny * ax
    px, py = ny / along, -nx / along
    qx, qy = ay * size / along, -ax * size / along
    for i in range(count):
        for d in range(2):
            p, q, unit = (px, qx, nx / size) if d == 0 else (py, qy, ny / size)
            own, normal, master = 2 * i + d, 2 * (count + i) + d, 2 * (2 * count + i) + d
            deta[own], dgap[own] = -N[0, i] * p, -N[0, i] * q
            deta[normal], dgap[normal] = -alpha * N[0, i] * p, alpha * N[0, i] * (unit - q)
            deta[master], dgap[master] = L[0, i] * p, L[0, i] * q
    sx, sy = tx + alpha * bx, ty + alpha * by
    gap_xi = alpha * (nx * bx + ny * by) / size - (qx * sx + qy * sy)
    return alpha * size, -(px * sx + py * sy), gap_xi


@kernel
def integrate_segment(y, ends, dends, place, rule, work, moments, derivatives):
    """Fill the moments (G, M, g) of a segment and their derivatives (..., 6 K) by ``y``.

    ``place`` = (middle, half) of T; ``work`` = (N (3, K), L (3, K), deta (6 K,), dgap (6 K,)).
    """
    points, weights = rule
    middle, half = place
    N, L, deta, dgap = work
    G, M, g = moments
    dG, dM, dg = derivatives
    count = N.shape[1]
    c, h = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0])
    for array in (G, g):
        array[:] = 0.0
    M[:] = 0.0
    for array in (dG, dg):
        array[:] = 0.0
    dM[:] = 0.0
    for i in range(points.size):
        s, w = points[i], weights[i]
        xi = c + h * s
        eta, alpha = slave_to_master(y, xi, N)
        tabulate_shapes(xi, N)
        tabulate_shapes(eta, L)
        gap, eta_xi, gap_xi = point_derivatives(y, eta, alpha, N, L, deta, dgap)
        tx, ty = combine(y, 0, N, 1)
        kx, ky = combine(y, 0, N, 2)
        J = np.sqrt(tx * tx + ty * ty)
        J_xi = (tx * kx + ty * ky) / J
        t, W = (xi - middle) / half, w * J * h
        T = 1.0 + 0.0 * t
        for p in range(2 * count - 1):
            G[p] += W * T
            if p < count:
                g[p] += W * T * gap
                for l in range(count):
                    M[p, l] += W * T * L[0, l]
            T = T * t
        for k in range(6 * count):
            dh = 0.5 * (dends[1, k] - dends[0, k])
            dxi = 0.5 * (dends[0, k] + dends[1, k]) + s * dh
            dW = w * (J * dh + J_xi * dxi * h)
            if k < 2 * count:
                dW += w * h * N[1, k // 2] * (tx if k % 2 == 0 else ty) / J
            dT_dt, T = 0.0 * t, 1.0 + 0.0 * t
            change, dgap_k, dt = deta[k] + eta_xi * dxi, dgap[k] + gap_xi * dxi, dxi / half
            for p in range(2 * count - 1):
                dWT = dW * T + W * dT_dt * dt
                dG[p, k] += dWT
                if p < count:
                    dg[p, k] += dWT * gap + W * T * dgap_k
                    for l in range(count):
                        dM[p, l, k] += dWT * L[0, l] + W * T * L[1, l] * change
                dT_dt = dT_dt * t + T
                T = T * t


@kernel
def chain_normals(row, dn_dx, nodes, out):
    """Turn a derivative by ``y`` (6 K,) into one by nodal positions (8 K - 4,)."""
    count = nodes.size
    out[:] = 0.0
    for i in range(count):
        for d in range(2):
            out[2 * (count - 1 + i) + d] += row[2 * i + d]
            out[2 * (3 * count - 2 + i) + d] = row[2 * (2 * count + i) + d]
        nx, ny = row[2 * (count + i)], row[2 * (count + i) + 1]
        for k in range(dn_dx.shape[2]):
            out[2 * i + k] += nx * dn_dx[nodes[i], 0, k] + ny * dn_dx[nodes[i], 1, k]


@kernel
def gather(x, n, m, slave, master, y):
    """Gather ``y`` (6 K,) of one slave facet and one master facet (K node numbers each)."""
    count = slave.size
    for i in range(count):
        for d in range(2):
            y[2 * i + d] = x[slave[i], d]
            y[2 * (count + i) + d] = n[slave[i], d]
            y[2 * (2 * count + i) + d] = m[master[i], d]


# Multiplier functions


@kernel
def shape_coefficients(place, B):
    """Fill ``B`` (K, K): N = B T, by Taylor's formula at the middle."""
    middle, half = place
    N = np.empty((3, B.shape[0]))
    tabulate_shapes(middle, N)
    scale = 1.0
    for p in range(B.shape[0]):
        for j in range(B.shape[0]):
            B[j, p] = N[p, j] * scale
        scale *= half / (p + 1.0)


@kernel
def invert(A, inverse):
    """Fill the inverse of a small symmetric positive matrix, by Gauss and Jordan."""
    size = A.shape[0]
    work = A.copy()
    inverse[:] = 0.0
    for i in range(size):
        inverse[i, i] = 1.0
    for i in range(size):
        pivot = work[i, i]
        for c in range(size):
            work[i, c] /= pivot
            inverse[i, c] /= pivot
        for r in range(size):
            if r != i:
                factor = work[r, i]
                for c in range(size):
                    work[r, c] -= factor * work[i, c]
                    inverse[r, c] -= factor * inverse[i, c]


@kernel
def multipliers(basis, G, place, weights, B, C, D, d, H, VG, inverse):
    """Fill B, C, D (K, K), d (K,), and what the derivative of C needs: H, V G^-1 and G^-1 (K, K).

    ``weights`` is H as long as nothing is shared; V has the rows T(xi_j).
    """
    count = C.shape[0]
    mass, own, V = np.empty_like(C), np.empty_like(C), np.ones((count, count))
    shape_coefficients(place, B)
    for j in range(count):
        d[j] = 0.0
        t = (2.0 * j / (count - 1.0) - 1.0 - place[0]) / place[1]
        for p in range(count):
            d[j] += B[j, p] * G[p]
            V[j, p] = t**p
            for q in range(count):
                mass[p, q] = G[p + q]
    H[:] = weights
    if basis == DUAL:
        invert(mass, inverse)
        product(V, inverse, VG)
        share(weights, d, H)
    for j in range(count):
        for p in range(count):
            own[j, p] = d[j] * VG[j, p] if basis == DUAL else B[j, p] + 0.0 * d[j]
            D[p, j] = H[p, j] * d[j]
    product(H, own, C)
    if basis != DUAL:
        product(mass, B.T, own)
        product(C, own, D)


@kernel
def share(weights, d, H):
    """Fill the columns of ``H`` whose node hands to several others, in proportion to their d."""
    count = d.size
    for j in range(count):
        total = taken(weights, d, j)
        if total.real > 0.0:
            for i in range(count):
                H[i, j] = d[i] / total if takes(weights, d, i, j) else 0.0 * d[i]


@kernel
def takes(weights, d, i, j):
    """Whether node i takes a part of the function of node j, which others take, too."""
    return 0.0 < weights[i, j] < 1.0 and d[i].real > 0.0


@kernel
def taken(weights, d, j):
    """Sum of d of the nodes that share the function of node j."""
    total = 0.0 * d[0]
    for i in range(d.size):
        if takes(weights, d, i, j):
            total += d[i]
    return total


@kernel
def product(A, B, out):
    """Fill ``out`` = A B."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = 0.0
            for k in range(A.shape[1]):
                out[i, j] += A[i, k] * B[k, j]


@kernel
def accumulate(factor, row, out):
    """Add ``factor`` times ``row`` to ``out``; all derivatives by the columns are built of this."""
    for q in range(row.size):
        out[q] += factor * row[q]


@kernel
def dual_derivative(dG, weights, H, B, d, VG, inverse, work, dC, dD):
    """Fill dC and dD (K, K, columns) of the dual basis from dG (2 K - 1, columns)."""
    count = B.shape[0]
    dd, change = work
    dd[:] = 0.0
    dC[:] = 0.0
    dD[:] = 0.0
    for j in range(count):
        change[:] = 0.0
        for p in range(count):
            accumulate(B[j, p], dG[p], dd[j])
            for r in range(count):
                accumulate(VG[j, r], dG[p + r], change[p])
        for i in range(count):
            if H[i, j] != 0.0:
                accumulate(H[i, j], dd[j], dD[i, j])
                for p in range(count):
                    accumulate(H[i, j] * VG[j, p], dd[j], dC[i, p])
                    for r in range(count):
                        accumulate(-H[i, j] * d[j] * inverse[r, p], change[r], dC[i, p])
    for j in range(count):
        total = taken(weights, d, j)
        if total.real > 0.0:
            for i in range(count):
                for k in range(count):
                    if takes(weights, d, i, j) and takes(weights, d, k, j):
                        slope = d[j] * ((1.0 if i == k else 0.0) - H[i, j]) / total
                        accumulate(slope, dd[k], dD[i, j])
                        for p in range(count):
                            accumulate(slope * VG[j, p], dd[k], dC[i, p])


@kernel
def standard_derivative(dG, B, C, dC, dD):
    """Fill dC = 0 and dD (K, K, columns) of the standard basis: D = C G B^T."""
    count = B.shape[0]
    dC[:] = 0.0
    dD[:] = 0.0
    for j in range(count):
        for k in range(count):
            for p in range(count):
                for r in range(count):
                    accumulate(C[j, p] * B[k, r], dG[p + r], dD[j, k])


@kernel
def weigh_gap(gap_weights, place, weights, B, C, by_N, C_g):
    """Fill ``C_g`` (K, K), as C for the functions that weigh the gap, and whether they are N.

    By the cover it is N for nodes beyond it; see ``basis`` for what two-node facets do there.
    """
    count = B.shape[0]
    product(weights, B, C_g)
    for j in range(count):
        t = (2.0 * j / (count - 1.0) - 1.0 - place[0]) / place[1]
        beyond = gap_weights == BY_COVER and abs(t) > 1.0 + 1e-12
        by_N[j] = beyond or gap_weights == BY_STANDARD
        if not by_N[j]:
            C_g[j] = C[j]


# Facets


@kernel
def place_of(ends):
    """Middle and half length of the covered part, from its segments' ends (n, 2), as numbers."""
    low, high = 1.0, -1.0
    for i in range(ends.shape[0]):
        low, high = min(low, ends[i, 0].real), max(high, ends[i, 1].real)
    return 0.5 * (low + high), 0.5 * (high - low)


@kernel
def tabulate_covers(x, facets, ends, offsets, rule, cover):
    """Fill ``cover`` (f, K): the integrals of N over the covered parts; see below."""
    points, weights, spans = rule
    y, N = np.empty(6 * facets.shape[1]), np.empty((3, facets.shape[1]))
    cover[:] = 0.0
    for e in range(facets.shape[0]):
        gather(x, x, x, facets[e], facets[e], y)
        for i in range(offsets[e], offsets[e + 1]):
            c, h = 0.5 * (ends[i, 0] + ends[i, 1]), 0.5 * (ends[i, 1] - ends[i, 0])
            for p in range(spans[i, 0], spans[i, 1]):
                tabulate_shapes(c + h * points[p], N)
                tx, ty = combine(y, 0, N, 1)
                J = np.sqrt(tx * tx + ty * ty)
                for j in range(facets.shape[1]):
                    cover[e, j] += weights[p] * J * h * N[0, j]


@kernel
def tabulate_facets(geometry, facets, segments, offsets, pair_offsets, rule, options, values):
    """Make D, M and the weighted gap of all facets.

    ``geometry`` = (x, n, dn_dx, m): slave positions, normals and their derivative, master
    positions; ``facets`` = (slave nodes (f, K), weights H (f, K, K)); ``segments`` = (master nodes
    (n, K), end_is_fixed (n, 2), ends (n, 2) of which those that are fixed are used), those of facet
    e being offsets[e]:offsets[e+1], with all pairs (i, k) of them, k running fastest, at
    pair_offsets[e]; ``rule`` = (s, w, spans (n, 2)) as in ``segment``; ``options`` = (basis, what
    weighs the gap, whether the ends of segments have derivatives). Fills ``values`` =
    (D (f, K, K), dD (n, K, K, C), M (n, K, K), dM (pairs, K, K, C), g (f, K), dg (n, K, C), cover
    (f, K)) with C = 8 K - 4 columns; rows of facets without segments are left as they are.
    """
    x, n, dn_dx, m = geometry
    nodes, handed = facets
    masters, end_is_fixed, found = segments
    points, point_weights, spans = rule
    basis, gap_weights, move_ends = options
    D, dD, M, dM, g, dg, cover = values
    kind, count, columns = x.dtype, nodes.shape[1], dD.shape[3]
    size, most = 2 * count - 1, np.max(offsets[1:] - offsets[:-1]) if nodes.shape[0] else 0
    work = (
        np.empty((3, count), kind), np.empty((3, count), kind),
        np.empty(6 * count, kind), np.empty(6 * count, kind),
    )  # fmt: skip
    y = np.empty(6 * count, kind)
    ends, dends = np.empty((most, 2), kind), np.empty((most, 2, 6 * count), kind)
    G, dG = np.empty((most, size), kind), np.empty((most, size, columns), kind)
    T_M, dT_M = np.empty((most, count, count), kind), np.empty((most, count, count, columns), kind)
    T_g, dT_g = np.empty((most, count), kind), np.empty((most, count, columns), kind)
    dG_y, dM_y = np.empty((size, 6 * count), kind), np.empty((count, count, 6 * count), kind)
    dg_y = np.empty((count, 6 * count), kind)
    C, H, VG, inverse = np.empty((4, count, count), kind)
    B, d = np.empty((count, count)), np.empty(count, kind)
    by_N, C_g = np.empty(count, np.bool_), np.empty((count, count), kind)
    small, dC = np.empty((2, count, columns), kind), np.empty((count, count, columns), kind)
    sum_G, sum_g = np.empty(size, kind), np.empty(count, kind)
    for e in range(nodes.shape[0]):
        start, number = offsets[e], offsets[e + 1] - offsets[e]
        if number == 0:
            continue
        for i in range(number):
            own = start + i
            gather(x, n, m, nodes[e], masters[own], y)
            lower, upper = end_is_fixed[own, 0], end_is_fixed[own, 1]
            ends[i, 0], ends[i, 1] = found[own, 0], found[own, 1]
            segment_ends(y, lower, upper, work[0], ends[i], dends[i])
            if not move_ends:
                dends[i] = 0.0
        place = place_of(ends[:number])
        sum_G[:] = 0.0
        sum_g[:] = 0.0
        for i in range(number):
            gather(x, n, m, nodes[e], masters[start + i], y)
            span = slice(spans[start + i, 0], spans[start + i, 1])
            integrate_segment(
                y, ends[i], dends[i], place, (points[span], point_weights[span]), work,
                (G[i], T_M[i], T_g[i]), (dG_y, dM_y, dg_y),
            )  # fmt: skip
            sum_G += G[i]
            sum_g += T_g[i]
            for p in range(size):
                chain_normals(dG_y[p], dn_dx, nodes[e], dG[i, p])
            for p in range(count):
                chain_normals(dg_y[p], dn_dx, nodes[e], dT_g[i, p])
                for l in range(count):
                    chain_normals(dM_y[p, l], dn_dx, nodes[e], dT_M[i, p, l])
        multipliers(basis, sum_G, place, handed[e], B, C, D[e], d, H, VG, inverse)
        cover[e] = d
        weigh_gap(gap_weights, place, handed[e], B, C, by_N, C_g)
        g[e] = 0.0
        for j in range(count):
            for p in range(count):
                g[e, j] += C_g[j, p] * sum_g[p]
        for i in range(number):
            product(C, T_M[i], M[start + i])
        for k in range(number):
            if basis == DUAL:
                dual_derivative(dG[k], handed[e], H, B, d, VG, inverse, small, dC, dD[start + k])
            else:
                standard_derivative(dG[k], B, C, dC, dD[start + k])
            dg[start + k] = 0.0
            for j in range(count):
                for p in range(count):
                    accumulate(C_g[j, p], dT_g[k, p], dg[start + k, j])
                    if not by_N[j]:
                        accumulate(sum_g[p], dC[j, p], dg[start + k, j])
            for i in range(number):
                pair = pair_offsets[e] + i * number + k
                dM[pair] = 0.0
                for j in range(count):
                    for l in range(count):
                        for p in range(count):
                            accumulate(T_M[i, p, l], dC[j, p], dM[pair, j, l])
                            if i == k:
                                accumulate(C[j, p], dT_M[i, p, l], dM[pair, j, l])


@kernel
def sample_gaps(geometry, connectivity, places, points, gaps):
    """Fill ``gaps`` (n, p) at the places s = ``points`` (p,) of n segments.

    ``geometry`` = (x, n, m); ``connectivity`` = (slave nodes (n, K), master nodes (n, K));
    ``places``: their ends (n, 2).
    """
    x, n, m = geometry
    slave, master = connectivity
    count = slave.shape[1]
    y, N = np.empty(6 * count), np.empty((3, count))
    for i in range(slave.shape[0]):
        gather(x, n, m, slave[i], master[i], y)
        for p in range(points.size):
            c, h = 0.5 * (places[i, 0] + places[i, 1]), 0.5 * (places[i, 1] - places[i, 0])
            xi = c + h * points[p]
            tabulate_shapes(xi, N)
            nx, ny = combine(y, 1, N, 0)
            _, alpha = slave_to_master(y, xi, N)
            gaps[i, p] = alpha * np.sqrt(nx * nx + ny * ny)
