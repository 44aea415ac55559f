# SPDX-License-Identifier: MIT
"""Admissible masters: behind a slave point, and on a surface in contact with itself.

**Partners behind a slave point** count if moving the master back is the shorter way to separate the
bodies, see ``is_nearer_exit``; on one body, if their part covers the point, see ``overlaps_point``.

A line from a slave point x along -n, with the coordinate r >= 0, crosses the outline of a body at
exits and entries. The level at r is the number of exits less that of entries beyond r. It is the
number of times that the body covers the point: one inside, more where the body overlaps itself.

A master facet that faces the slave at a depth d > 0 lies behind the slave surface. The bodies can
be separated along the line in two ways: the master moves back by d, or it moves on by t_s + t_m - d
and leaves on the other side of the slave. Here t_s is the length of the slave's body from x on, and
t_m that of the master's body from the partner back. The first way is the shorter one if

    d < (t_s + t_m) / 2.

Bodies that do not overlap have d >= t_s + t_m, so such a partner is always rejected. Both lengths
are needed: with t_s alone, a thin slave would miss a thick master once the overlap exceeds its own
thickness; with t_m alone, or the smaller of both, a thick slave would miss a thin master.

**On a surface in contact with itself** only some facets are masters of a slave facet, see
``is_master``; ``keep_masters`` drops segments on the others. The order of the facets is that of
``interface.self_contact``.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import copy_row, grown
from fenics_mortar.kernels.projection import interpolate, tabulate_shapes
from fenics_mortar.utils.arrays import HALF_FACET

# Distance behind a contact, over the length of a facet [1], above which a surface does not belong
# to the contact: overlaps of Newton iterates are smaller.
BEHIND = 2.0
# Gap over the length of a facet [1] up to which a portion of the master may be in contact in the
# next iterations.
ALMOST_CLOSED = 0.1


@kernel
def crossings(origin, direction, outline, own, min_distance):
    """Crossings of a line and the outline of body ``own``, shape (2, c).

    Row 0 contains distances above ``min_distance`` [length], row 1 the signs: 1 exit, -1 entry.
    ``outline`` = (positions of nodes (b, 2), segments (p, 2) with the body on their left, their
    bodies (p,)).
    """
    x, branches, body = outline
    ux, uy = direction[0], direction[1]
    found, count = np.empty((32, 2)), 0
    for i in range(branches.shape[0]):
        if body[i] != own:
            continue
        a, b = branches[i, 0], branches[i, 1]
        ax, ay = x[a, 0] - origin[0], x[a, 1] - origin[1]
        bx, by = x[b, 0] - origin[0], x[b, 1] - origin[1]
        side_a, side_b = ux * ay - uy * ax, ux * by - uy * bx
        if (side_a > 0.0) == (side_b > 0.0):
            continue
        fraction = side_a / (side_a - side_b)
        r = ux * (ax + fraction * (bx - ax)) + uy * (ay + fraction * (by - ay))
        if r > min_distance:
            found = grown(found, count, count + 1)
            found[count, 0], found[count, 1] = r, 1.0 if side_b > side_a else -1.0
            count += 1
    return found[:count].T


@kernel
def first_exit(found):
    """Distance at which a line leaves a body wholly, inf if it does not; crossings ``found``."""
    nearest = np.inf
    for i in range(found.shape[1]):
        if found[1, i] < 0.0 or found[0, i] >= nearest:
            continue
        level = 0.0
        for k in range(found.shape[1]):
            if found[0, k] > found[0, i]:
                level += found[1, k]
        if level <= 0.0:
            nearest = found[0, i]
    return nearest


@kernel
def covers_point(found, last):
    """Whether a partner at the distance ``last`` [length] is on a part that covers the point.

    ``found``: all crossings of the line with the body of both.
    """
    covers, exits = 0.0, 0
    for i in range(found.shape[1]):
        covers += found[1, i]
        if found[1, i] > 0.0 and found[0, i] <= last:
            exits += 1
    return exits < covers


@kernel
def length_inside(origin, direction, outline, own, min_distance):
    """Distance from ``origin`` (2,) along the unit vector ``direction`` (2,) to the body's end.

    Crossings nearer than ``min_distance`` [length] are ignored: they belong to the facet on which
    the line begins. If the line does not leave the body, the distance is inf.
    """
    return first_exit(crossings(origin, direction, outline, own, min_distance))


@kernel
def ray_behind(y, N, xi):
    """Point ``xi`` of a slave facet, and the direction opposite to its normal, (2,) each."""
    tabulate_shapes(xi, N)
    start, back = np.empty(2), np.empty(2)
    start[0], start[1] = interpolate(y, 0, N, 0)
    nx, ny = interpolate(y, 1, N, 0)
    size = np.sqrt(nx * nx + ny * ny)
    back[0], back[1] = -nx / size, -ny / size
    return start, back


@kernel
def is_nearer_exit(y, N, xi, depth, outline, bodies, min_distance):
    """Whether moving the master back by ``depth`` [length] is the shorter way out at ``xi``.

    ``y`` as in ``projection``; ``bodies`` = (slave's, master's); others as in ``length_inside``.
    """
    start, back = ray_behind(y, N, xi)
    own = length_inside(start, back, outline, bodies[0], min_distance)
    if depth < 0.5 * own:
        return True
    other = length_inside(start + depth * back, -back, outline, bodies[1], min_distance)
    return depth < 0.5 * (own + other) - min_distance


@kernel
def height(x):
    """Height of a facet with nodes ``x`` (2 K,) over its chord [length]."""
    if x.size < 6:
        return 0.0
    dx, dy = x[2] - 0.5 * (x[0] + x[4]), x[3] - 0.5 * (x[1] + x[5])
    return np.sqrt(dx * dx + dy * dy)


@kernel
def overlaps_point(y, N, xi, depth, outline, body, min_distance):
    """Whether the partner at ``depth`` [length] behind point ``xi`` is on a part that covers it.

    If both surfaces are on one body, as on a wound strip, parts of it lie on each other. Where they
    overlap, as in iterates, the line passes from one into the next, and t_s and t_m include several
    parts: the back of a winding would count as a partner. In this case exits are counted instead.
    Of the k parts that cover the point x, one contains it as a boundary point, the others overlap
    it. A partner is on one of the others if it is among the first k - 1 exits, since overlaps are
    shallower than the parts are thick.

    ``y`` as in ``projection``; both are of ``body``; others as in ``length_inside``. Outlines
    consist of straight segments, which differ from curved facets by less than their heights.
    """
    start, back = ray_behind(y, N, xi)
    third = y.size // 3
    first = max(min_distance, height(y[:third]))
    last = depth + max(min_distance, height(y[2 * third :]))
    return covers_point(crossings(start, back, outline, body, first), last)


@kernel
def tabulate_lengths(x, n, facets, bodies, outline, min_fraction, lengths):
    """Evaluate the lengths of bodies behind the middles of facets, along the reversed normals.

    Args:
        x: Positions of the nodes, shape (n, 2) [length].
        n: Their normals, shape (n, 2).
        facets: Nodes of the facets, shape (f, K).
        bodies: Bodies of the facets, shape (f,).
        outline: As in ``crossings``.
        min_fraction: Shortest length that counts, over the length of the facet [1].
        lengths: Shape (f,) [length]; filled.
    """
    N = np.empty((3, facets.shape[1]))
    tabulate_shapes(0.0, N)
    start, back = np.empty(2), np.empty(2)
    for f in range(facets.shape[0]):
        start[:], back[:] = 0.0, 0.0
        for k in range(facets.shape[1]):
            start += N[0, k] * x[facets[f, k]]
            back -= N[0, k] * n[facets[f, k]]
        back /= np.sqrt(back[0] ** 2 + back[1] ** 2)
        edge = x[facets[f, -1]] - x[facets[f, 0]]
        shortest = min_fraction * np.sqrt(edge[0] ** 2 + edge[1] ** 2)
        lengths[f] = length_inside(start, back, outline, bodies[f], shortest)


@kernel
def reach_behind(gap, length):
    """Depth behind the nearest portion of a master up to which others count [length].

    ``HALF_FACET`` times the ``length`` of the slave facet, or ``BEHIND`` if the nearest portion has
    a ``gap`` between ``-HALF_FACET`` and ``ALMOST_CLOSED`` lengths.
    """
    in_contact = -HALF_FACET * length <= gap <= ALMOST_CLOSED * length
    return length * (BEHIND if in_contact else HALF_FACET)


# Distance of two facets along the boundary, over their mean length [1], up to which they are
# neighbours: the next facet and the one after it. The mesh cannot resolve a fold between them.
NEAR = 1.5


@kernel
def touch_in_a_point(ends, one, other):
    """Whether facets end at the same junction of cracks without being faces of one crack.

    ``ends`` as in ``is_master``.
    """
    for i in range(2):
        for k in range(2):
            same = ends[one, i, 0] >= 0 and ends[one, i, 0] == ends[other, k, 0]
            if same and ends[one, i, 1] != ends[other, k, 1]:
                return True
    return False


@kernel
def is_master(keys, arcs, ends, slave, other):
    """Whether facet ``other`` is a master of facet ``slave``.

    Args:
        keys: Position of each facet in the order of slaves before masters, and number of its curve,
            shape (f, 2).
        arcs: Start and end of each facet along its curve, undeformed, and length of the curve if it
            is closed, else inf, shape (f, 3) [length].
        ends: Of both ends of each facet the junction of cracks there, -1 for none, and the crack
            that leaves it, shape (f, 2, 2).
        slave: Number of one facet.
        other: Number of the other one.
    """
    if keys[slave, 0] >= keys[other, 0] or touch_in_a_point(ends, slave, other):
        return False
    if keys[slave, 1] != keys[other, 1]:
        return True
    period = arcs[slave, 2]
    forward, backward = arcs[other, 0] - arcs[slave, 1], arcs[slave, 0] - arcs[other, 1]
    forward += period if forward < 0.0 else 0.0
    backward += period if backward < 0.0 else 0.0
    lengths = arcs[slave, 1] - arcs[slave, 0] + arcs[other, 1] - arcs[other, 0]
    return min(forward, backward) > NEAR * 0.5 * lengths


@kernel
def keep_masters(found, count, roles, number):
    """Drop segments on facets that are not masters of a slave facet; return the number kept.

    Args:
        found: Rows as in ``search.keep_nearest``, of which the first ``count`` are used.
        count: Number of rows.
        roles: (numbers of the slave facets (s,), ``keys``, ``arcs``, ``ends`` as in ``is_master``).
        number: The slave facet's index among these numbers.
    """
    numbers, keys, arcs, ends = roles
    kept = 0
    for i in range(count):
        if is_master(keys, arcs, ends, numbers[number], int(found[i, 3])):
            copy_row(found[i], found[kept])
            kept += 1
    return kept


@kernel
def tabulate_masters(keys, arcs, ends, slaves, masters):
    """Fill ``masters`` (s, f), bool, with ``is_master`` of the facets ``slaves`` (s,)."""
    for i in range(slaves.size):
        for other in range(keys.shape[0]):
            masters[i, other] = is_master(keys, arcs, ends, slaves[i], other)
