# SPDX-License-Identifier: MIT
"""Search for pairs of facets in space: as by brute force; distance, facing, sheets behind."""

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from surfaces_in_space import KINDS, find, grid, integrate, move_corners, reversed_facets, rotation

from fenics_mortar.kernels.space.pairs import find_pairs


def sheet(kind, cells, seed, height, size=1.0):
    """A curved surface seen from above."""
    rng = np.random.default_rng(seed)
    flat, facets = grid(kind, cells)
    flat = move_corners(flat, facets, 0.2 / cells * rng.uniform(-1, 1, flat.shape))
    flat = size * (flat - 0.5)
    bump = height + 0.2 * np.sin(3 * flat[:, 0]) * np.cos(2 * flat[:, 1])
    return np.column_stack([flat, bump]), facets


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("master_kind", KINDS)
def test_pairs_are_those_of_brute_force(kind, master_kind):
    Q = rotation(np.random.default_rng(5))
    (x, slave), (m, master) = sheet(kind, 4, 0, 0.0), sheet(master_kind, 5, 1, 0.02, 1.1)
    x, m, master = x @ Q.T, m @ Q.T, reversed_facets(master)
    offsets, found = find(x, slave, m, master, radius=0.5)
    n = np.tile(Q[:, 2], (len(x), 1))
    for e in range(len(slave)):
        everything = np.tile(slave[e], (len(master), 1))
        pairs = np.arange(len(master) + 1)
        values = integrate((x, n, m), everything, master, pairs)
        area = values[0].sum(axis=1)
        assert (found[offsets[e] : offsets[e + 1]] == np.flatnonzero(area > 0)).all()
    assert offsets[-1] > 2 * len(slave)


def test_some_facets_are_searched_in_the_given_order():
    (x, slave), (m, master) = sheet(4, 4, 0, 0.0), sheet(4, 5, 1, 0.02, 1.1)
    master = reversed_facets(master)
    offsets, found = find(x, slave, m, master)
    few, of_few = find(x, slave, m, master, numbers=np.array([7, 2]))
    for i, e in enumerate((7, 2)):
        own = of_few[few[i] : few[i + 1]]
        assert (own == found[offsets[e] : offsets[e + 1]]).all() and len(own)
    none, of_none = find(x, slave, m, master, numbers=np.array([], np.int64))
    assert len(none) == 1 and len(of_none) == 0
    offsets, found = find_pairs(x, m, slave, master[:0], np.arange(3), 1.0, 0.1)
    assert not offsets.any() and not len(found)


def test_numbers_of_the_master_facets_do_not_matter():
    (x, slave), (m, master) = sheet(4, 12, 0, 0.0), sheet(3, 15, 1, 0.02, 1.1)
    master = reversed_facets(master)
    offsets, found = find(x, slave, m, master)
    order = np.random.default_rng(0).permutation(len(master))
    others, shuffled = find(x, slave, m, master[order])
    assert (others == offsets).all()
    for start, stop in pairwise(offsets):
        assert (np.sort(order[shuffled[start:stop]]) == found[start:stop]).all()


def test_only_masters_within_the_radius_that_face_the_slave_count():
    (x, slave), (m, master) = sheet(4, 3, 0, 0.0), sheet(4, 3, 0, 0.3)
    facing = reversed_facets(master)
    assert len(find(x, slave, m, facing, radius=0.31)[1]) >= len(slave)
    assert not len(find(x, slave, m, facing, radius=0.2)[1])
    assert not len(find(x, slave, m, master)[1])
    # inclined by 60 degrees: the cosine is a half
    flat, facets = grid(4, 1)
    x = np.column_stack([flat, np.zeros(4)])
    m = np.column_stack([flat[:, 0], flat[:, 1], np.sqrt(3.0) * flat[:, 0]])
    one = reversed_facets(facets)
    assert len(find(x, facets, m, one, 5.0, 0.49)[1]) and not len(
        find(x, facets, m, one, 5.0, 0.51)[1]
    )


def strip(start, stop, low, high):
    """A facet over start < x < stop that faces downwards, with these heights at its ends."""
    x = np.array([[start, 0], [start, 1], [stop, 1], [stop, 0]])
    return np.column_stack([x, [low, low, high, high]])


def masters_of_unit_square(*strips):
    """Numbers of the strips that are masters of a facet below them; equal nodes are one."""
    flat, facets = grid(4, 1)
    m, inverse = np.unique(np.concatenate(strips), axis=0, return_inverse=True)
    master = np.reshape(inverse, (-1, 4))
    found = find(np.column_stack([flat, np.zeros(4)]), facets, m, master, 5.0)[1]
    return found.tolist()


@pytest.mark.parametrize("farther", [1e-6, 0.1, 0.9])
def test_nearest_of_two_sheets_at_the_same_place_is_taken(farther):
    near = strip(0, 1, 0.3, 0.3)
    far = near + np.array([0.01, 0.02, farther])
    assert masters_of_unit_square(far, near) == [1] and masters_of_unit_square(near, far) == [0]
    # beside each other both count
    halves = strip(0, 0.5, 0.3, 0.3), strip(0.5, 1, 0.4, 0.4)
    assert masters_of_unit_square(*halves) == [0, 1]


@pytest.mark.parametrize("behind, kept", [(0.45, True), (0.55, False)])
def test_portion_of_the_master_far_behind_the_nearest_is_left_out(behind, kept):
    near, far = strip(0, 0.4, 0.2, 0.2), strip(0.6, 1, 0.2 + behind, 0.2 + behind)
    assert masters_of_unit_square(near, far) == ([0, 1] if kept else [0])
    # connected by a ramp they are one portion
    assert masters_of_unit_square(near, far, strip(0.4, 0.6, 0.2, 0.2 + behind)) == [0, 1, 2]


@pytest.mark.parametrize("gap", [0.05, -0.05])
@pytest.mark.parametrize("behind, kept", [(1.9, True), (2.1, False)])
def test_portions_beside_a_contact_count_up_to_two_facets(gap, behind, kept):
    near, far = strip(0, 0.4, gap, gap), strip(0.6, 1, abs(gap) + behind, abs(gap) + behind)
    assert masters_of_unit_square(near, far) == ([0, 1] if kept else [0])


def test_roles_limit_the_masters_of_a_surface():
    """Sheets above each other as one surface: the upper two, seen from below, face the lowest."""
    x, facets, heights = [], [], (0.0, 0.1, 0.3)
    for number, height in enumerate(heights):
        points, sheet_facets = grid(4, 3)
        sheet_facets = sheet_facets if number == 0 else reversed_facets(sheet_facets)
        facets.append(sheet_facets + number * len(points))
        x.append(np.column_stack([points, np.full(len(points), height)]))
    x, facets = np.concatenate(x), np.concatenate(facets)
    count, everything = len(facets) // 3, np.arange(len(facets))
    near = everything[:, None].copy()
    find_with = partial(find_pairs, x, x, facets, facets, everything, 1.0, 0.1)
    offsets, masters = find_with()
    above = everything[count : 2 * count]
    assert (np.diff(offsets) == 1).all() and (masters[:count] == above).all()
    for first in (0, 1):  # the lowest sheet before the others, or after them
        order = np.where(everything < count, first * len(facets), 0) + everything
        offsets, masters = find_with(roles=(np.argsort(np.argsort(order)), near))
        slaves = np.flatnonzero(np.diff(offsets))
        assert (slaves < count).all() if first == 0 else (slaves >= count).all()
        assert masters.size == (count if first == 0 else 2 * count)
    order = everything[::-1].copy()
    blocked = np.stack([everything, everything % count], axis=1)
    offsets, masters = find_with(roles=(order, blocked))
    assert not masters.size  # those below are too near
