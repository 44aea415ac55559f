# SPDX-License-Identifier: MIT
"""Segments and partners of one slave facet among the master facets that are near it.

Whether a master node lies ahead of the ray of a slave node is one expression,
tau . (x_m - x_s), evaluated the same way for all facets that share the two nodes: neighbours
never disagree about it, so no part of a facet is lost or counted twice, also where nodes meet
exactly. A segment end is a slave node if its ray hits the master facet, else the partner of a
master node, which then lies strictly between the two rays: q changes its sign once and has just one
root there (see ``projection``).

Slivers stay, down to length zero: where a master node is about to pass a slave node, their value
is nothing, but the motion of their ends is part of the derivative. Only a facet that is covered
by next to nothing in all is left out, and one of which next to nothing is missing at an end counts
as covered up to its node: both are rounding where two bodies end at one place.

Points that are fixed on the slave facets have a ray each, tested against the two ends of each
master facet. A ray through a master node, within rounding, has a partner by rule, so that aligned
meshes do not leave it to chance.

A slave facet at a corner may face two parts of a master, one far behind the other. Weighted
together their gaps mean nothing: positive functions hold a node open that touches the nearer part,
and functions that are negative somewhere, as the dual ones, make an overlap of such gaps, and press
from a distance. So a part that is farther than the nearest one by half a facet does not count,
where the nearest is in contact by two facets: beside a corner of the master both sides belong to
the contact, and a part that comes and goes there costs iterations.

Of the facets behind a slave point only those count that are the nearer way out, see ``sight``. To
a depth that is safe for each slave facet this is not tested.
"""

import numpy as np

from fenics_mortar.kernels import kernel, sight
from fenics_mortar.kernels.projection import (
    combine,
    gather,
    master_to_slave,
    side_of_ray,
    slave_to_master,
)
from fenics_mortar.kernels.shapes import tabulate_shapes

# Fraction of a slave facet: what is farther away than this cannot be in contact, as the certificate
# sees it.
APART = 0.5
# Lengths of a slave facet by which a part lies behind one in contact, and does not belong to it.
BEHIND = 2.0


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
    lower = -1.0 if is_node[0] else master_to_slave(y, N.shape[1] - 1, N)
    upper = 1.0 if is_node[1] else master_to_slave(y, 0, N)
    return True, lower, upper


@kernel
def gap_if_facing(y, xi, shapes, min_cosine):
    """Gap at ``xi``, or inf where the normals of slave and master are not opposed enough."""
    N, L = shapes
    _, alpha = slave_to_master(y, xi, N, L)
    nx, ny = combine(y, 1, N, 0)
    ax, ay = combine(y, 2, L, 1)
    size = np.sqrt(nx * nx + ny * ny)
    if not -(nx * ay - ny * ax) >= min_cosine * size * np.sqrt(ax * ax + ay * ay):
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
def keep_near_parts(found, count, master_facets, length):
    """Drop parts that are farther than the nearest one, see ``APART`` and ``BEHIND``.

    Rows of ``found`` as ``keep_nearest`` leaves them; those of master facets that share a node are
    of one part. Returns how many stay.
    """
    nearest = np.inf
    for i in range(count):
        nearest = min(nearest, found[i, 0])
    apart = length * (APART if nearest > APART * length else BEHIND)
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
    min_cosine, min_cover = limits
    y, N, L = np.empty(6 * slave.size), np.empty((3, slave.size)), np.empty((3, slave.size))
    is_node = np.empty(2, np.bool_)
    safe = np.inf
    if view is not None:
        safe = view[0][number]
    count = 0
    for hit in range(hits.size):
        gather(x, n, m, slave, master_facets[hits[hit]], y)
        meets, lower, upper = find_interval(y, N, is_node)
        if not meets:
            continue
        middle = 0.5 * (lower + upper)
        gap = gap_if_facing(y, middle, (N, L), min_cosine)
        if not abs(gap) <= radius or gap == np.inf:
            continue
        if view is not None:
            if -gap > safe and is_hidden(y, N, middle, -gap, view, (number, hits[hit])):
                continue
        found[count, 0], found[count, 1], found[count, 2] = abs(gap), lower, upper
        found[count, 3] = hits[hit]
        found[count, 4], found[count, 5] = is_node[0], is_node[1]
        count += 1
    kept = keep_nearest(found, count, min_cover)
    edge = x[slave[-1]] - x[slave[0]]
    length = np.sqrt(edge[0] * edge[0] + edge[1] * edge[1])
    kept = keep_near_parts(found, kept, master_facets, length)
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
    x[0], x[1] = combine(y, 0, N, 0)
    n[0], n[1] = combine(y, 1, N, 0)
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
    min_cosine, tie = limits
    y, N, L = np.empty(6 * slave.size), np.empty((3, slave.size)), np.empty((3, slave.size))
    edge = x[slave[-1]] - x[slave[0]]
    tolerance = tie * np.sqrt(edge[0] * edge[0] + edge[1] * edge[1])
    partners[:], safe = -1, view[0][e]
    distances = np.full(points.size, np.inf)
    for hit in hits:
        gather(x, n, m, slave, master_facets[hit], y)
        for p in range(points.size):
            tabulate_shapes(points[p], N)
            if not ray_hits(y, N, starts[master_facets[hit, 0]], tolerance):
                continue
            gap = gap_if_facing(y, points[p], (N, L), min_cosine)
            distance = abs(gap)
            nearer = distance < distances[p] or (distance == distances[p] and hit < partners[p])
            if not (nearer and distance <= radius):
                continue
            if -gap > safe and is_hidden(y, N, points[p], -gap, view, (e, hit)):
                continue
            partners[p], distances[p] = hit, distance
    return (partners >= 0).sum()
