# SPDX-License-Identifier: MIT
"""Whether a partner behind a slave point is the nearer way out, or is seen through the bodies.

A line through a slave point x against its normal n, r counted from x along -n, crosses the outline
of a body at places that are exits or entries. The level, exits less entries beyond r, tells how
many times the body covers the place r: it is one inside, more where the body overlaps itself.

A master facet that faces the slave at the depth d > 0 lies behind the slave surface. Two ways
separate the bodies along the line: this facet goes back by d, or the slave's other side leaves the
master's other side, by t_s + t_m - d. Here t_s is the length of the slave's body from x on, and t_m
that of the master's body from the partner back. The nearer way is the first one where

    d < (t_s + t_m) / 2.

Bodies that do not overlap have d >= t_s + t_m, so that such a partner is never taken. Seen through
one part of a body that has both surfaces on it, as through a strip that is wound up, t_s = t_m = d
but for rounding: that partner is the back of the strip, and no way out either. Both lengths
count: with t_s alone a thin slave would lose a thick master that it enters by more than its own
thickness, and with t_m alone, or the lesser of both, a thin master would be lost in a thick slave.
"""

import numpy as np

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.projection import combine
from fenics_mortar.kernels.shapes import tabulate_shapes


@kernel
def find_crossings(origin, direction, outline, own, least, found):
    """Fill ``found`` (2, c) with places beyond ``least`` and signs (exit 1, entry -1); how many.

    ``outline`` = (nodes (b, 2), pieces (p, 2) with the body on their left, bodies of these (p,));
    pieces of the body ``own`` count. The number may exceed the size of ``found``.
    """
    x, branches, body = outline
    ux, uy = direction[0], direction[1]
    count = 0
    for i in range(branches.shape[0]):
        if body[i] != own:
            continue
        a, b = branches[i, 0], branches[i, 1]
        ax, ay = x[a, 0] - origin[0], x[a, 1] - origin[1]
        bx, by = x[b, 0] - origin[0], x[b, 1] - origin[1]
        side_a, side_b = ux * ay - uy * ax, ux * by - uy * bx
        if (side_a > 0.0) == (side_b > 0.0):
            continue
        part = side_a / (side_a - side_b)
        r = ux * (ax + part * (bx - ax)) + uy * (ay + part * (by - ay))
        if r > least:
            if count < found.shape[1]:
                found[0, count] = r
                found[1, count] = 1.0 if side_b > side_a else -1.0
            count += 1
    return count


@kernel
def length_inside(origin, direction, outline, own, least):
    """Distance from ``origin`` along ``direction`` to where the body ``own`` ends; inf if nowhere.

    Ends nearer than ``least`` [length] do not count: those of the facet that the line begins on.
    """
    found = np.empty((2, 32))
    count = find_crossings(origin, direction, outline, own, least, found)
    if count > found.shape[1]:
        found = np.empty((2, count))
        find_crossings(origin, direction, outline, own, least, found)
    nearest = np.inf
    for i in range(count):
        if found[1, i] < 0.0 or found[0, i] >= nearest:
            continue
        level = 0.0
        for k in range(count):
            if found[0, k] > found[0, i]:
                level += found[1, k]
        if level <= 0.0:
            nearest = found[0, i]
    return nearest


@kernel
def is_way_out(y, N, xi, depth, outline, bodies, least):
    """Whether a partner at ``depth`` behind the slave point ``xi`` is the nearer way out.

    ``y`` as in ``projection``; ``bodies`` = (slave's, master's), ``least`` as above.
    """
    tabulate_shapes(xi, N)
    start, back, partner = np.empty(2), np.empty(2), np.empty(2)
    start[0], start[1] = combine(y, 0, N, 0)
    nx, ny = combine(y, 1, N, 0)
    size = np.sqrt(nx * nx + ny * ny)
    back[0], back[1] = -nx / size, -ny / size
    own = length_inside(start, back, outline, bodies[0], least)
    if depth < 0.5 * own:
        return True
    partner[:] = start + depth * back
    other = length_inside(partner, -back, outline, bodies[1], least)
    return depth < 0.5 * (own + other) - least


@kernel
def tabulate_lengths(x, n, facets, bodies, outline, least, lengths):
    """Fill the ``lengths`` (f,) of the bodies (f,) behind the middles of ``facets`` (f, K).

    ``x`` and ``n`` are positions and normals of the nodes; ``least`` is a part of each facet.
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
        shortest = least * np.sqrt(edge[0] ** 2 + edge[1] ** 2)
        lengths[f] = length_inside(start, back, outline, bodies[f], shortest)
