# SPDX-License-Identifier: MIT
"""Which slave facet meets which master facet: a tree of boxes, exact sign tests, intervals.

The boxes of the master facets, taken in the order of the curve, are the leaves of a complete
binary tree in heap layout (children of node i: 2i and 2i + 1, root 1). A slave facet asks for the
boxes that its strip meets: the quadrilateral x_k -+ radius n_k. So the search costs
O(log N + hits) per facet, whatever the radius and the direction of the interface.

Whether a master node lies ahead of the ray of a slave node is one expression,
tau . (x_m - x_s), evaluated the same way for all facets that share the two nodes: neighbours
never disagree about it, so no part of a facet is lost or counted twice, also where nodes meet
exactly. A segment end is a slave node if its ray hits the master facet, else the partner of a
master node, which then lies strictly between the two rays: q changes its sign once and the
quadratic of ``projection`` has just one root there.

Slivers stay, down to length zero: where a master node is about to pass a slave node, their value
is nothing, but the motion of their ends is part of the derivative. Only a facet that is covered
by next to nothing in all is left out, and one of which next to nothing is missing at an end counts
as covered up to its node: both are rounding where two bodies end at one place.

For points that are fixed on the slave facets, a ray asks the same question of the two ends of each
master facet. One upon a master node, within rounding, has a partner by rule, so that aligned meshes
do not leave it to chance.

A slave facet at a corner may face two parts of a master, one far behind the other. Weighted
together their gaps mean nothing: positive functions hold a node open that touches the nearer part,
and functions that are negative somewhere, as the dual ones, make an overlap of such gaps, and press
from a distance. So a part that is farther than the nearest one by half a facet does not count.

Of the facets behind a slave point only those count that are the nearer way out, see ``sight``. To
a depth that is safe for each slave facet this is not asked.
"""

import numpy as np

from fenics_mortar.kernels import curved, kernel, sight
from fenics_mortar.kernels.projection import master_to_slave, side_of_ray, slave_to_master
from fenics_mortar.kernels.tree import build_tree, query_tree

# A part of a slave facet: what is farther away than this cannot be in contact, as the certificate
# sees it.
APART = 0.5


@kernel
def control_points(values, facets):
    """Nodal ``values`` (n, 2) with those of inner nodes replaced: their hull holds the facets.

    The control points of a quadratic curve in Bezier's form; nodes of straight facets are theirs.
    """
    controls = values.copy()
    if facets.shape[1] == 3:
        for f in range(facets.shape[0]):
            a, c, b = facets[f]
            for d in range(2):
                controls[c, d] = 2.0 * values[c, d] - 0.5 * (values[a, d] + values[b, d])
    return controls


@kernel
def query_strip(boxes, controls, nodes, radius, stack, hits):
    """The master facets whose boxes meet the strip of one slave facet, see ``tree``.

    ``controls`` = control points of the slave's positions and normals.
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
    strip[:2] -= 1e-9 * length
    strip[2:] += 1e-9 * length
    along = tx, ty, low - 1e-9 * length * length, high + 1e-9 * length * length
    return hits[: query_tree(boxes, strip, along, stack, hits)]


@kernel
def partner_of_master(y, last, N):
    """``xi`` of the partner of the first or the last master node."""
    if N.shape[1] == 2:
        return master_to_slave(y, int(last))
    return curved.master_to_slave(y, 2 * int(last), N)


@kernel
def find_interval(y, N, is_node):
    """Whether a slave facet meets a master facet, and on which (xi_a, xi_b); fills ``is_node``."""
    size = y.size // 3
    x, n, m = y[:size], y[size : 2 * size], y[2 * size :]
    first_1 = side_of_ray(x[:2], n[:2], m[:2])
    first_2 = side_of_ray(x[:2], n[:2], m[-2:])
    second_1 = side_of_ray(x[-2:], n[-2:], m[:2])
    second_2 = side_of_ray(x[-2:], n[-2:], m[-2:])
    is_node[0], is_node[1] = first_2 <= 0.0, second_1 >= 0.0
    if (not is_node[0] and second_2 >= 0.0) or (not is_node[1] and first_1 <= 0.0):
        return False, 1.0, -1.0
    if (is_node[0] and first_1 <= 0.0) or (is_node[1] and second_2 >= 0.0):
        return False, 1.0, -1.0
    lower = -1.0 if is_node[0] else partner_of_master(y, True, N)
    upper = 1.0 if is_node[1] else partner_of_master(y, False, N)
    return True, lower, upper


@kernel
def gap_if_facing(y, N, xi, least_cosine):
    """Gap at ``xi``, or inf where the normals of slave and master are not opposed enough."""
    curved.tabulate_shapes(xi, N)
    nx, ny = curved.combine(y, 1, N, 0)
    if N.shape[1] == 2:
        eta, alpha = slave_to_master(y, xi)
    else:
        eta, alpha = curved.slave_to_master(y, xi, N)
    curved.tabulate_shapes(eta, N)
    ax, ay = curved.combine(y, 2, N, 1)
    size = np.sqrt(nx * nx + ny * ny)
    if not -(nx * ay - ny * ax) >= least_cosine * size * np.sqrt(ax * ax + ay * ay):
        return np.inf
    return alpha * size


@kernel
def is_hidden(y, N, xi, depth, view, facets):
    """Whether a facing partner at ``depth`` behind the slave surface is not the nearer way out.

    ``view`` = (safe depths and bodies of the slave facets, bodies of the master facets, outline,
    part of a facet that is rounding), see ``sight``; ``facets`` = (slave facet, master facet).
    """
    _, slave_bodies, master_bodies, outline, least = view
    last = 2 * N.shape[1] - 2
    length = np.sqrt((y[last] - y[0]) ** 2 + (y[last + 1] - y[1]) ** 2)
    bodies = slave_bodies[facets[0]], master_bodies[facets[1]]
    return not sight.is_way_out(y, N, xi, depth, outline, bodies, least * length)


@kernel
def sort_rows(rows, count, column):
    """Sort the first ``count`` rows (a few) by one column; equal ones keep their order."""
    for i in range(1, count):
        for j in range(i, 0, -1):
            if rows[j, column] >= rows[j - 1, column]:
                break
            for c in range(rows.shape[1]):
                rows[j, c], rows[j - 1, c] = rows[j - 1, c], rows[j, c]


@kernel
def keep_nearest(found, count, tolerance):
    """Of segments that lie over one another keep the nearest, and sort what stays by place.

    Rows of ``found``: (distance, xi_a, xi_b, master facet, lower is node, upper is node); the first
    ``count`` are looked at. Returns how many stay.
    """
    sort_rows(found, count, 0)
    kept = 0
    for i in range(count):
        free = True
        for j in range(kept):
            overlap = min(found[i, 2], found[j, 2]) - max(found[i, 1], found[j, 1])
            free = free and overlap <= tolerance
        if free:
            found[kept] = found[i]
            kept += 1
    sort_rows(found, kept, 1)
    return kept


@kernel
def keep_near_parts(found, count, master_facets, apart):
    """Drop parts that are farther than the nearest one by more than ``apart``.

    Rows of ``found`` as ``keep_nearest`` leaves them; those of master facets that share a node are
    of one part. Returns how many stay.
    """
    nearest = np.inf
    for i in range(count):
        nearest = min(nearest, found[i, 0])
    kept, start = 0, 0
    while start < count:
        stop, distance = start + 1, found[start, 0]
        while stop < count and is_next(master_facets, found[stop - 1, 3], found[stop, 3]):
            distance = min(distance, found[stop, 0])
            stop += 1
        if distance <= nearest + apart:
            for i in range(start, stop):
                found[kept] = found[i]
                kept += 1
        start = stop
    return kept


@kernel
def is_next(master_facets, one, other):
    """Whether the master facet ``other`` goes before ``one``, so comes next along the slave."""
    return master_facets[int(one), 0] == master_facets[int(other), -1]


@kernel
def facet_segments(
    geometry, slave, master_facets, hits, radius, limits, found, view=None, number=0
):
    """Fill ``found`` (see ``keep_nearest``) for one slave facet; return the number of rows.

    ``view`` as in ``is_hidden``, in which the facet has this ``number``; without it all is seen.
    """
    x, n, m = geometry
    least_cosine, least_cover = limits
    y, N = np.empty(6 * slave.size), np.empty((3, slave.size))
    is_node = np.empty(2, np.bool_)
    safe = np.inf
    if view is not None:
        safe = view[0][number]
    count = 0
    for hit in range(hits.size):
        curved.gather(x, n, m, slave, master_facets[hits[hit]], y)
        meets, lower, upper = find_interval(y, N, is_node)
        if not meets:
            continue
        middle = 0.5 * (lower + upper)
        gap = gap_if_facing(y, N, middle, least_cosine)
        if not abs(gap) <= radius or gap == np.inf:
            continue
        if view is not None:
            if -gap > safe and is_hidden(y, N, middle, -gap, view, (number, hits[hit])):
                continue
        found[count, 0], found[count, 1], found[count, 2] = abs(gap), lower, upper
        found[count, 3] = hits[hit]
        found[count, 4], found[count, 5] = is_node[0], is_node[1]
        count += 1
    kept = keep_nearest(found, count, least_cover)
    edge = x[slave[-1]] - x[slave[0]]
    apart = APART * np.sqrt(edge[0] * edge[0] + edge[1] * edge[1])
    kept = keep_near_parts(found, kept, master_facets, apart)
    if kept == 0:
        return 0
    if found[0, 1] < -1.0 + least_cover:
        found[0, 1], found[0, 4] = -1.0, 1.0
    if found[kept - 1, 2] > 1.0 - least_cover:
        found[kept - 1, 2], found[kept - 1, 5] = 1.0, 1.0
    cover = 0.0
    for i in range(kept):
        cover += found[i, 2] - found[i, 1]
    return kept if cover > least_cover else 0


@kernel
def curve_starts(facets, num_nodes):
    """Whether no facet ends at a node, (num_nodes,)."""
    starts = np.ones(num_nodes, np.bool_)
    for f in range(facets.shape[0]):
        starts[facets[f, -1]] = False
    return starts


@kernel
def ray_hits(y, N, is_start, tolerance):
    """Whether the ray of the slave point with shapes ``N`` goes through a master facet.

    One upon a master node, within ``tolerance`` [length], goes through the facet that ends there,
    at the start of a curve through the one that begins.
    """
    at = 4 * N.shape[1]
    x, n = np.empty(2), np.empty(2)
    x[0], x[1] = curved.combine(y, 0, N, 0)
    n[0], n[1] = curved.combine(y, 1, N, 0)
    first, last = side_of_ray(x, n, y[at : at + 2]), side_of_ray(x, n, y[-2:])
    return last <= tolerance and first > (-tolerance if is_start else tolerance)


@kernel
def point_partners(
    geometry, e, slave, master_facets, starts, hits, points, radius, view, limits, partners
):
    """Fill ``partners`` (p,): the nearest master facet of each point, -1 for none; how many have.

    At equal distance it is the facet of the lower number.
    """
    x, n, m = geometry
    least_cosine, tie = limits
    y, N = np.empty(6 * slave.size), np.empty((3, slave.size))
    edge = x[slave[-1]] - x[slave[0]]
    tolerance = tie * np.sqrt(edge[0] * edge[0] + edge[1] * edge[1])
    partners[:], safe = -1, view[0][e]
    distances = np.full(points.size, np.inf)
    for hit in hits:
        curved.gather(x, n, m, slave, master_facets[hit], y)
        for p in range(points.size):
            curved.tabulate_shapes(points[p], N)
            if not ray_hits(y, N, starts[master_facets[hit, 0]], tolerance):
                continue
            gap = gap_if_facing(y, N, points[p], least_cosine)
            distance = abs(gap)
            nearer = distance < distances[p] or (distance == distances[p] and hit < partners[p])
            if not (nearer and distance <= radius):
                continue
            if -gap > safe and is_hidden(y, N, points[p], -gap, view, (e, hit)):
                continue
            partners[p], distances[p] = hit, distance
    return (partners >= 0).sum()


@kernel
def find_points(geometry, slave_facets, master_facets, radius, view, limits, points, least_points):
    """Find the partners of the same ``points`` (p,), in order, on each of ``slave_facets`` (f, K).

    As ``find_segments``; here ``limits`` = (least cosine, part of a slave facet within which a ray
    goes through a master node). Returns offsets (f + 1,), master facets (n,) and points (n, 2),
    first and one after the last, of the runs of points with the same partner; no run for facets of
    which fewer than ``least_points`` points have one.
    """
    x, n, m = geometry
    boxes = build_tree(control_points(m, master_facets), master_facets)
    controls = control_points(x, slave_facets), control_points(n, slave_facets)
    starts = curve_starts(master_facets, m.shape[0])
    stack, hits = np.empty(128, np.int64), np.empty(boxes.shape[0] // 2, np.int64)
    partners = np.empty(points.size, np.int64)
    offsets = np.zeros(slave_facets.shape[0] + 1, np.int64)
    rows = np.empty((points.size * slave_facets.shape[0], 3), np.int64)
    for e in range(slave_facets.shape[0]):
        nodes = slave_facets[e]
        near = query_strip(boxes, controls, nodes, radius, stack, hits)
        paired = point_partners(
            geometry, e, nodes, master_facets, starts, near, points, radius, view, limits, partners
        )
        end = offsets[e]
        for p in range(points.size):
            if paired < least_points or partners[p] < 0:
                continue
            if p == 0 or partners[p] != partners[p - 1]:
                rows[end, 0], rows[end, 1] = partners[p], p
                end += 1
            rows[end - 1, 2] = p + 1
        offsets[e + 1] = end
    rows = rows[: offsets[-1]]
    return offsets, rows[:, 0].copy(), rows[:, 1:].copy()


@kernel
def find_segments(geometry, slave_facets, master_facets, radius, view, limits):
    """Find the segments of ``slave_facets`` (f, K).

    ``geometry`` = (slave positions, slave normals, master positions), ``view`` as in ``is_hidden``;
    ``limits`` = (least cosine between slave normal and reversed master normal, least length in xi).
    Returns offsets (f + 1,), master facet (n,), end_is_node (n, 2), ends (n, 2).
    """
    x, n, m = geometry
    boxes = build_tree(control_points(m, master_facets), master_facets)
    controls = control_points(x, slave_facets), control_points(n, slave_facets)
    stack, hits = np.empty(128, np.int64), np.empty(boxes.shape[0] // 2, np.int64)
    found = np.empty((64, 6))
    offsets = np.zeros(slave_facets.shape[0] + 1, np.int64)
    rows = np.empty((4 * slave_facets.shape[0] + 64, 6))
    for e in range(slave_facets.shape[0]):
        nodes = slave_facets[e]
        near = query_strip(boxes, controls, nodes, radius, stack, hits)
        if near.size > found.shape[0]:
            found = np.empty((2 * near.size, 6))
        kept = facet_segments(geometry, nodes, master_facets, near, radius, limits, found, view, e)
        start = offsets[e]
        if start + kept > rows.shape[0]:
            longer = np.empty((2 * (start + kept), 6))
            longer[:start] = rows[:start]
            rows = longer
        rows[start : start + kept] = found[:kept]
        offsets[e + 1] = start + kept
    rows = rows[: offsets[-1]]
    end_is_node = rows[:, 4:6] != 0.0
    return offsets, rows[:, 3].astype(np.int64), end_is_node, rows[:, 1:3].copy()
