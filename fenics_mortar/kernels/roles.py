# SPDX-License-Identifier: MIT
"""Masters of each facet on a surface in contact with itself."""

from fenics_mortar.kernels import kernel
from fenics_mortar.kernels.blocks import copy_row

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
        found: Rows as in ``pairing.keep_nearest``, of which the first ``count`` are used.
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
