# SPDX-License-Identifier: MIT
"""Search for the master facets that each slave facet faces: candidates, segments and partners.

The boxes of the master facets, in the order of the curve, are the leaves of a ``tree``. Candidates
of a slave facet are the boxes that intersect its strip, the quadrilateral x_k -+ radius n_k. The
search costs O(log N + hits) per facet, for any radius and orientation of the interface.

On the candidates ``find_segments`` finds the segments of each slave facet, ``find_points`` the
partners of points that are fixed on it. Of facets at one place the nearest counts, and of portions
of a master those near the nearest one, see ``keep_near_portions``.

A master node lies ahead of or behind the ray of a slave node by the sign of tau . (x_m - x_s). The
sign is evaluated identically for all facets that share the two nodes. No part of a facet is
therefore lost or counted twice, even if nodes coincide. A segment end is a slave node if the ray of
the node hits the master facet, else the partner of a master node. That master node lies strictly
between the two rays, where q changes sign once and has one root (see ``projection``).

Segments of any length are kept, including zero: when a master node passes a slave node, the sliver
contributes nothing to the integrals, but the motion of its ends contributes to the derivative.
Where two bodies end at the same point, two lengths are treated as rounding: facets with negligible
cover have no segments, and a negligible distance between the cover and an end node is closed.

Master facets behind a slave point count only if moving back through them is the shorter way to
separate the bodies, see ``sight``. The test is skipped up to a safe depth of each slave facet.
"""

import numpy as np

from fenics_mortar.kernels import kernel, projection, sight
from fenics_mortar.kernels.blocks import copy_row, copy_rows, grown, sort_rows
from fenics_mortar.kernels.sight import keep_masters, touch_in_a_point
from fenics_mortar.kernels.tree import build_tree, query_tree
from fenics_mortar.utils.arrays import ROUNDING


@kernel
def find_interval(y, N, is_node):
    """Interval of a slave facet that faces a master facet: (whether there is one, xi_a, xi_b).

    ``is_node`` (2,) is filled with whether each end is a slave node.
    """
    size = y.size // 3
    x, n, m = y[:size], y[size : 2 * size], y[2 * size :]
    first_1 = projection.side_of_ray(x[:2], n[:2], m[:2])
    first_2 = projection.side_of_ray(x[:2], n[:2], m[-2:])
    second_1 = projection.side_of_ray(x[-2:], n[-2:], m[:2])
    second_2 = projection.side_of_ray(x[-2:], n[-2:], m[-2:])
    is_node[0], is_node[1] = first_2 <= 0.0, second_1 >= 0.0
    if (not is_node[0] and second_2 >= 0.0) or (not is_node[1] and first_1 <= 0.0):
        return False, 1.0, -1.0
    if (is_node[0] and first_1 <= 0.0) or (is_node[1] and second_2 >= 0.0):
        return False, 1.0, -1.0
    lower = -1.0 if is_node[0] else projection.master_to_slave(y, N.shape[1] - 1, N)
    upper = 1.0 if is_node[1] else projection.master_to_slave(y, 0, N)
    return True, lower, upper


@kernel
def gap_if_facing(y, xi, shapes, min_cosine):
    """Gap at ``xi`` [length]; inf if slave normal and reversed master normal differ too much.

    ``shapes`` = (N, L), overwritten; ``min_cosine``: smallest cosine of the angle between the two
    [1].
    """
    N, L = shapes
    _, alpha = projection.slave_to_master(y, xi, N, L)
    nx, ny = projection.interpolate(y, 1, N, 0)
    ax, ay = projection.interpolate(y, 2, L, 1)
    size = np.sqrt(nx * nx + ny * ny)
    if not -(nx * ay - ny * ax) >= min_cosine * size * np.sqrt(ax * ax + ay * ay):
        return np.inf
    return alpha * size


@kernel
def is_hidden(y, N, xi, depth, behind, facets):
    """Whether a partner at ``depth`` [length] behind the slave surface is rejected, see ``sight``.

    ``behind`` = (safe depths (f,) [length] and bodies (f,) of the slave facets, bodies of the
    master facets, outline, fraction of a facet that is rounding [1]), see ``sight``; ``facets`` =
    (slave facet, master facet).
    """
    _, slave_bodies, master_bodies, outline, rounding = behind
    last = 2 * N.shape[1] - 2
    length = np.sqrt((y[last] - y[0]) ** 2 + (y[last + 1] - y[1]) ** 2)
    bodies = slave_bodies[facets[0]], master_bodies[facets[1]]
    if bodies[0] == bodies[1]:
        return not sight.overlaps_point(y, N, xi, depth, outline, bodies[0], rounding * length)
    return not sight.is_nearer_exit(y, N, xi, depth, outline, bodies, rounding * length)


@kernel
def keep_nearest(found, count, tolerance):
    """Keep the nearest of overlapping segments, sorted along the facet; return their number.

    Rows of ``found``: (distance [length], xi_a, xi_b, master facet, whether the lower and whether
    the upper end is a slave node, gap [length]), of which the first ``count`` are used.
    ``tolerance``: overlap in xi that is rounding [1].
    """
    sort_rows(found, count, 0)
    kept = 0
    for i in range(count):
        free = True
        for j in range(kept):
            overlap = min(found[i, 2], found[j, 2]) - max(found[i, 1], found[j, 1])
            free = free and overlap <= tolerance
        if free:
            copy_row(found[i], found[kept])
            kept += 1
    sort_rows(found, kept, 1)
    return kept


@kernel
def keep_near_portions(found, count, master_facets, length):
    """Drop portions of the master too far behind the nearest one; return the number of rows kept.

    A slave facet at a corner may face two portions of a master, one far behind the other. A
    weighted average of both gaps is meaningless: with positive functions, a node that touches the
    nearer portion stays open; dual functions, which are partly negative, produce an overlap and
    pressure at a distance. A portion is therefore ignored if it is farther away than the nearest
    one by half a facet, or by two facets if the nearest one is in contact or a tenth of a facet
    from it: beside a corner of the master both portions belong to the contact zone, and a portion
    that appears and disappears there costs iterations.

    Limit: ``sight.reach_behind``, with the ``length`` of the slave facet. Rows of ``found`` are
    those of ``keep_nearest``; consecutive master facets that share a node form one portion.
    """
    nearest, gap = np.inf, np.inf
    for i in range(count):
        if found[i, 0] < nearest:
            nearest, gap = found[i, 0], found[i, 6]
    limit = nearest + sight.reach_behind(gap, length)
    kept, start = 0, 0
    while start < count:
        stop, distance = start + 1, found[start, 0]
        while stop < count and is_next(master_facets, found[stop - 1, 3], found[stop, 3]):
            distance = min(distance, found[stop, 0])
            stop += 1
        if distance <= limit:
            for i in range(start, stop):
                copy_row(found[i], found[kept])
                kept += 1
        start = stop
    return kept


@kernel
def is_next(master_facets, one, other):
    """Whether master facet ``other`` ends where ``one`` begins; they are numbers of rows (f, K)."""
    return master_facets[int(one), 0] == master_facets[int(other), -1]


@kernel
def facet_segments(
    geometry, slave, master_facets, hits, radius, limits, found, behind, number, roles
):
    """Fill ``found`` with the segments of one slave facet; return their number.

    Args:
        geometry: (x (n, 2), n (n, 2), m (k, 2)): slave positions and normals, master positions.
        slave: Nodes of the slave facet, shape (K,).
        master_facets: Nodes of all master facets, shape (f, K).
        hits: Candidate master facets, shape (h,).
        radius: Largest distance along the normal [length].
        limits: (smallest cosine [1], length in xi that is rounding [1]).
        found: Rows as in ``keep_nearest``, shape (h, 7) or longer; filled.
        behind: As in ``is_hidden``.
        number: Number of the slave facet in ``behind`` and ``roles``.
        roles: As in ``sight.keep_masters``, if slave and master are one surface, else None.
    """
    x, n, m = geometry
    min_cosine, min_cover = limits
    y, N, L = np.empty(6 * slave.size), np.empty((3, slave.size)), np.empty((3, slave.size))
    is_node = np.empty(2, np.bool_)
    count, safe = 0, behind[0][number]
    for hit in range(hits.size):
        if roles is not None and touch_in_a_point(roles[3], roles[0][number], hits[hit]):
            continue
        projection.gather(x, n, m, slave, master_facets[hits[hit]], y)
        meets, lower, upper = find_interval(y, N, is_node)
        if not meets:
            continue
        middle = 0.5 * (lower + upper)
        gap = gap_if_facing(y, middle, (N, L), min_cosine)
        if not abs(gap) <= radius or gap == np.inf:
            continue
        if -gap > safe and is_hidden(y, N, middle, -gap, behind, (number, hits[hit])):
            continue
        found[count, 0], found[count, 1], found[count, 2] = abs(gap), lower, upper
        found[count, 3] = hits[hit]
        found[count, 4], found[count, 5], found[count, 6] = is_node[0], is_node[1], gap
        count += 1
    kept = keep_nearest(found, count, min_cover)
    if roles is not None:
        kept = keep_masters(found, kept, roles, number)
    edge = x[slave[-1]] - x[slave[0]]
    length = np.sqrt(edge[0] * edge[0] + edge[1] * edge[1])
    kept = keep_near_portions(found, kept, master_facets, length)
    if kept == 0:
        return 0
    if found[0, 1] < -1.0 + min_cover:
        found[0, 1], found[0, 4] = -1.0, 1.0
    if found[kept - 1, 2] > 1.0 - min_cover:
        found[kept - 1, 2], found[kept - 1, 5] = 1.0, 1.0
    cover = 0.0
    for i in range(kept):
        cover += found[i, 2] - found[i, 1]
    return kept if cover > min_cover else 0


@kernel
def curve_starts(facets, num_nodes):
    """Whether a node is not the last one of any facet, shape (num_nodes,)."""
    starts = np.ones(num_nodes, np.bool_)
    for f in range(facets.shape[0]):
        starts[facets[f, -1]] = False
    return starts


@kernel
def ray_hits(y, N, is_start, tolerance):
    """Whether the ray of the slave point with shape functions ``N`` hits a master facet.

    A ray within ``tolerance`` [length] of a master node hits the facet that ends at the node; at
    the start of a curve, where ``is_start``, it hits the facet that begins there.
    """
    at = 4 * N.shape[1]
    x, n = np.empty(2), np.empty(2)
    x[0], x[1] = projection.interpolate(y, 0, N, 0)
    n[0], n[1] = projection.interpolate(y, 1, N, 0)
    first, last = projection.side_of_ray(x, n, y[at : at + 2]), projection.side_of_ray(x, n, y[-2:])
    return last <= tolerance and first > (-tolerance if is_start else tolerance)


@kernel
def point_partners(
    geometry, e, slave, master_facets, starts, hits, points, radius, behind, limits, partners
):
    """Fill ``partners`` (p,) with the nearest master facet of each point, -1 for none; count them.

    Ties go to the facet with the lower number. ``points`` (p,) are coordinates on the slave facet
    ``e`` with the nodes ``slave`` (K,), ``starts`` is that of ``curve_starts``, ``limits`` =
    (smallest cosine [1], fraction of the slave facet within which a ray hits a master node [1]);
    others as in ``facet_segments``.
    """
    x, n, m = geometry
    min_cosine, tie = limits
    y, N, L = np.empty(6 * slave.size), np.empty((3, slave.size)), np.empty((3, slave.size))
    edge = x[slave[-1]] - x[slave[0]]
    tolerance = tie * np.sqrt(edge[0] * edge[0] + edge[1] * edge[1])
    partners[:], safe = -1, behind[0][e]
    distances = np.full(points.size, np.inf)
    for hit in hits:
        projection.gather(x, n, m, slave, master_facets[hit], y)
        for p in range(points.size):
            projection.tabulate_shapes(points[p], N)
            if not ray_hits(y, N, starts[master_facets[hit, 0]], tolerance):
                continue
            gap = gap_if_facing(y, points[p], (N, L), min_cosine)
            distance = abs(gap)
            nearer = distance < distances[p] or (distance == distances[p] and hit < partners[p])
            if not (nearer and distance <= radius):
                continue
            if -gap > safe and is_hidden(y, N, points[p], -gap, behind, (e, hit)):
                continue
            partners[p], distances[p] = hit, distance
    return (partners >= 0).sum()


@kernel
def control_points(values, facets):
    """Bezier control points of facets (f, K) with nodal ``values`` (n, 2), shape (n, 2).

    Their convex hull contains the facet. Those of straight facets are the nodes.
    """
    controls = values.copy()
    if facets.shape[1] == 3:
        for f in range(facets.shape[0]):
            a, c, b = facets[f]
            for d in range(2):
                controls[c, d] = 2.0 * values[c, d] - 0.5 * (values[a, d] + values[b, d])
    return controls


@kernel
def query_strip(boxes, controls, nodes, radius, hits):
    """Master facets whose boxes intersect the strip of one slave facet, shape (h,).

    ``boxes`` and ``hits`` as in ``tree``; ``controls`` = control points of the slave's positions
    and normals, each (n, 2); ``nodes`` (K,) are those of the facet.
    """
    x, n = controls
    a, b = x[nodes[0]], x[nodes[-1]]
    tx, ty = b[0] - a[0], b[1] - a[1]
    strip = np.array([np.inf, np.inf, -np.inf, -np.inf])
    low, high = np.inf, -np.inf
    for k in range(2 * nodes.size):
        base, normal = x[nodes[k // 2]], n[nodes[k // 2]]
        r = radius if k % 2 == 0 else -radius
        px, py = base[0] + r * normal[0], base[1] + r * normal[1]
        strip[0], strip[1] = min(strip[0], px), min(strip[1], py)
        strip[2], strip[3] = max(strip[2], px), max(strip[3], py)
        low, high = min(low, px * tx + py * ty), max(high, px * tx + py * ty)
    length = abs(tx) + abs(ty)
    strip[:2] -= ROUNDING * length
    strip[2:] += ROUNDING * length
    margin = ROUNDING * length * length
    along = np.array([[tx, ty, low - margin, high + margin]])
    return hits[: query_tree(boxes, strip, along, hits)]


@kernel
def find_points(geometry, slave_facets, master_facets, radius, behind, limits, points, min_points):
    """Find partners of points on slave facets, as runs of points with the same master facet.

    Quadrature points that are fixed on the slave facets have one ray each, which is tested against
    both ends of each master facet. A ray that passes through a master node, within rounding, is
    assigned to one of the two facets by a fixed rule, so that results on aligned meshes are
    reproducible.

    Args:
        geometry: As in ``find_segments``.
        slave_facets: Nodes of the slave facets, shape (f, K).
        master_facets: Nodes of the master facets, shape (g, K).
        radius: Largest distance along the normal [length].
        behind: As in ``is_hidden``.
        limits: (smallest cosine [1], fraction of a slave facet within which a ray hits a master
            node [1]).
        points: Coordinates on each facet, -1 ... 1, increasing, shape (p,).
        min_points: Facets on which fewer points have a partner have no runs.

    Returns:
        Offsets (f + 1,): runs of facet e are offsets[e]:offsets[e + 1]; master facets (n,); points
        of each run, first and one after the last, (n, 2).
    """
    x, n, m = geometry
    boxes = build_tree(control_points(m, master_facets), master_facets)
    controls = control_points(x, slave_facets), control_points(n, slave_facets)
    starts = curve_starts(master_facets, m.shape[0])
    hits = np.empty(boxes.shape[0] // 2, np.int64)
    partners = np.empty(points.size, np.int64)
    offsets = np.zeros(slave_facets.shape[0] + 1, np.int64)
    rows = np.empty((points.size * slave_facets.shape[0], 3), np.int64)
    for e in range(slave_facets.shape[0]):
        nodes = slave_facets[e]
        near = query_strip(boxes, controls, nodes, radius, hits)
        paired = point_partners(
            geometry, e, nodes, master_facets, starts, near, points, radius, behind, limits,
            partners,
        )  # fmt: skip
        end = offsets[e]
        for p in range(points.size):
            if paired < min_points or partners[p] < 0:
                continue
            if p == 0 or partners[p] != partners[p - 1]:
                rows[end, 0], rows[end, 1] = partners[p], p
                end += 1
            rows[end - 1, 2] = p + 1
        offsets[e + 1] = end
    rows = rows[: offsets[-1]]
    return offsets, rows[:, 0].copy(), rows[:, 1:].copy()


@kernel
def couple_segments(offsets, ends, end_is_fixed, functions_move):
    """Pairs of segments coupled by the multiplier functions of their facet.

    The functions of a facet vary with all its segments if the facet is partly covered by segments
    with moving ends, or if they vary anyway; else each segment is coupled to itself alone.

    Args:
        offsets: Segments of facet e are offsets[e]:offsets[e + 1], shape (f + 1,).
        ends: Ends of the segments in xi, shape (s, 2).
        end_is_fixed: Whether an end is a fixed point of the facet, shape (s, 2), bool.
        functions_move: Whether the functions vary with the segments on every facet.

    Returns:
        Facet of each segment (s,); whether the functions of a facet vary, (f,), bool; pairs of
        facet e are those from the e-th offset to the next, (f + 1,); segments of each pair, the
        second one running fastest, (p, 2).
    """
    count = offsets.size - 1
    owner, partial = np.empty(offsets[count], np.int64), np.empty(count, np.bool_)
    pair_offsets = np.zeros(count + 1, np.int64)
    for e in range(count):
        covered, moves, size = 0.0, False, offsets[e + 1] - offsets[e]
        for i in range(offsets[e], offsets[e + 1]):
            owner[i] = e
            covered += ends[i, 1] - ends[i, 0]
            moves = moves or not (end_is_fixed[i, 0] and end_is_fixed[i, 1])
        partial[e] = functions_move or (moves and covered < 2.0 - ROUNDING)
        pair_offsets[e + 1] = pair_offsets[e] + (size * size if partial[e] else size)
    pairs = np.empty((pair_offsets[count], 2), np.int64)
    for e in range(count):
        p = pair_offsets[e]
        for i in range(offsets[e], offsets[e + 1]):
            first, last = (offsets[e], offsets[e + 1]) if partial[e] else (i, i + 1)
            for k in range(first, last):
                pairs[p, 0], pairs[p, 1] = i, k
                p += 1
    return owner, partial, pair_offsets, pairs


@kernel
def find_segments(geometry, slave_facets, master_facets, radius, bodies, outline, rounding, limits,
                  roles, functions_move):  # fmt: skip
    """Find the segments of slave facets.

    In each call from Python numba determines the types of tuples of more than four arrays again,
    which takes 0.2 ms: the argument ``behind`` of ``is_hidden`` is composed here.

    Args:
        geometry: (x (n, 2), n (n, 2), m (k, 2)): slave positions, slave normals, master positions.
        slave_facets: Nodes of the slave facets, shape (f, K).
        master_facets: Nodes of the master facets, shape (g, K).
        radius: Largest distance along the normal [length].
        bodies: The first three parts of ``behind``.
        outline: The fourth part.
        rounding: The fifth part.
        limits: (smallest cosine of slave normal and reversed master normal [1], length in xi that
            is rounding [1]).
        roles: As in ``facet_segments``.
        functions_move: See ``couple_segments``.

    Returns:
        Offsets (f + 1,): segments of facet e are offsets[e]:offsets[e + 1]; master facets (s,);
        whether each end is a slave node (s, 2); ends in xi (s, 2); results of ``couple_segments``.
    """
    x, n, m = geometry
    safe, slave_bodies, master_bodies = bodies
    behind = safe, slave_bodies, master_bodies, outline, rounding
    boxes = build_tree(control_points(m, master_facets), master_facets)
    controls = control_points(x, slave_facets), control_points(n, slave_facets)
    hits = np.empty(boxes.shape[0] // 2, np.int64)
    found = np.empty((64, 7))
    offsets = np.zeros(slave_facets.shape[0] + 1, np.int64)
    rows = np.empty((4 * slave_facets.shape[0] + 64, 7))
    for e in range(slave_facets.shape[0]):
        nodes = slave_facets[e]
        near = query_strip(boxes, controls, nodes, radius, hits)
        if near.size > found.shape[0]:
            found = np.empty((2 * near.size, 7))
        kept = facet_segments(
            geometry, nodes, master_facets, near, radius, limits, found, behind, e, roles
        )
        start = offsets[e]
        rows = grown(rows, start, start + kept)
        copy_rows(found, kept, rows, start)
        offsets[e + 1] = start + kept
    count = offsets[-1]
    masters, end_is_node = np.empty(count, np.int64), np.empty((count, 2), np.bool_)
    ends = np.empty((count, 2))
    for i in range(count):
        masters[i] = int(rows[i, 3])
        for k in range(2):
            ends[i, k], end_is_node[i, k] = rows[i, 1 + k], rows[i, 4 + k] != 0.0
    couples = couple_segments(offsets, ends, end_is_node, functions_move)
    return offsets, masters, end_is_node, ends, couples
