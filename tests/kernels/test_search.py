# SPDX-License-Identifier: MIT
"""Search: no segment lost or counted twice, far walls rejected, large curves fast enough."""

import numpy as np
import pytest
from curves import LIMITS, Curves, wavy

from fenics_mortar.interface.integrals import nothing_behind
from fenics_mortar.kernels import search
from fenics_mortar.utils.arrays import ROUNDING


def all_to_all(pair):
    """Segments from every pair of facets, for comparison with the tree."""
    n, _ = pair.normals(pair.x)
    found, everything = np.empty((1000, 7)), np.arange(len(pair.master))
    rest = 10.0, LIMITS, found, (*nothing_behind(1), ROUNDING), 0, None
    counts = [
        search.facet_segments((pair.x, n, pair.m), nodes, pair.master, everything, *rest)
        for nodes in pair.slave
    ]
    return np.array(counts)


@pytest.mark.parametrize("seed", range(5))
def test_tree_agrees_with_brute_force(seed):
    pair = Curves(*wavy(seed, slaves=40, masters=57))
    assert (np.diff(pair.offsets) == all_to_all(pair)).all()


@pytest.mark.parametrize("seed", range(5))
def test_segments_of_a_covered_facet_fill_it(seed):
    pair = Curves(*wavy(seed, slaves=23, masters=31))
    for e in range(len(pair.slave)):
        ends = pair.ends[pair.offsets[e] : pair.offsets[e + 1]]
        assert ends[0, 0] == -1.0 and ends[-1, 1] == 1.0
        assert np.abs(ends[1:, 0] - ends[:-1, 1]).max(initial=0.0) < 1e-14


@pytest.mark.parametrize("shift", [0.0, 1e-16, -1e-16, 1e-13, 1e-9])
def test_coinciding_nodes_are_covered_once(shift):
    x = np.stack([np.linspace(0, 1, 11), np.zeros(11)], axis=1)
    pair = Curves(x, np.stack([np.linspace(1, 0, 11) + shift, np.full(11, -0.1)], axis=1))
    cover = np.bincount(
        np.repeat(np.arange(10), np.diff(pair.offsets)), pair.ends[:, 1] - pair.ends[:, 0]
    )
    assert np.abs(cover - 2.0).max() < 1e-7 * (shift > 1e-10) + 1e-12


def test_wall_that_faces_the_other_way_is_no_partner():
    x = np.array([[0.0, 0], [1, 0]])
    facing, away = np.array([[1.2, -0.1], [-0.2, -0.1]]), np.array([[-0.2, -0.05], [1.2, -0.05]])
    assert len(Curves(x, facing).masters) == 1
    assert len(Curves(x, away).masters) == 0


def test_nearest_of_two_walls_is_taken():
    x = np.array([[0.0, 0], [1, 0]])
    walls = np.array(
        [[1.2, -0.9], [-0.2, -0.9], [-9.0, -0.5], [9.0, -0.5], [1.2, 0.1], [-0.2, 0.1]]
    )
    pair = Curves(x, walls)
    assert pair.masters.tolist() == [4]


def test_oblique_facets_are_refused():
    x = np.array([[0.0, 0], [1, 0]])
    steep = np.array([[0.55, 5.0], [0.45, -5.0]])
    assert len(Curves(x, steep).masters) == 0


def test_found_segments_do_not_depend_on_size():
    x, m = wavy(1)
    pair = Curves(x, m)
    for scale in (1e-6, 1e6):
        other = Curves(x * scale, m * scale, radius=10.0 * scale)
        assert np.array_equal(other.masters, pair.masters)
        assert np.abs(other.ends - pair.ends).max() < 1e-12


def test_control_points_of_a_quadratic_facet_are_where_its_end_tangents_meet():
    """A parabola over a chord, and a straight facet, whose control points are the nodes."""
    x = np.array([(1.0, 2.0), (2.0, 2.5), (3.0, 2.0), (4.0, 2.0)])
    found = search.control_points(x, np.array([[0, 1, 2]]))
    assert np.allclose(found, [(1.0, 2.0), (2.0, 3.0), (3.0, 2.0), (4.0, 2.0)], atol=1e-15)
    assert np.array_equal(search.control_points(x, np.array([[2, 3]])), x)


@pytest.mark.parametrize("left, right", [(1e-12, 1.2), (-0.2, 1.0 - 1e-12)])
def test_almost_covered_end_counts_as_covered(left, right):
    pair = Curves(np.array([[0.0, 0], [1, 0]]), np.array([[right, -0.1], [left, -0.1]]))
    assert pair.ends.tolist() == [[-1.0, 1.0]] and not np.any(pair.partial)


@pytest.mark.parametrize("unit", [1e3, 1e-3])
def test_search_is_independent_of_the_unit_of_length(unit):
    x, m = wavy(2, slaves=40, masters=57)
    one, other = Curves(x, m), Curves(unit * x, unit * m, radius=10.0 * unit)
    assert np.array_equal(one.masters, other.masters)
    assert np.abs(one.ends - other.ends).max() < 1e-9


def test_segments_of_partly_covered_facets_are_coupled():
    # covered by two segments; without any; partly covered; partly covered up to fixed points
    offsets = np.array([0, 2, 2, 4, 6])
    ends = np.array([[-1, 0], [0, 1], [-1, 0], [0, 0.5], [-1, 0], [0, 0.5]])
    fixed = np.array([[1, 0], [0, 1], [1, 0], [0, 0], [1, 1], [1, 1]], bool)
    owner, partial, pair_offsets, pairs = search.couple_segments(offsets, ends, fixed, False)
    assert owner.tolist() == [0, 0, 2, 2, 3, 3]
    assert partial.tolist() == [False, False, True, False]
    assert pair_offsets.tolist() == [0, 2, 2, 6, 8]
    expected = [[0, 0], [1, 1], [2, 2], [2, 3], [3, 2], [3, 3], [4, 4], [5, 5]]
    assert pairs.tolist() == expected
    # functions that move in any case, as on curved facets
    _, partial, pair_offsets, pairs = search.couple_segments(offsets, ends, fixed, True)
    assert partial.all() and pair_offsets.tolist() == [0, 4, 4, 8, 12]
    assert pairs[-4:].tolist() == [[4, 4], [4, 5], [5, 4], [5, 5]]
