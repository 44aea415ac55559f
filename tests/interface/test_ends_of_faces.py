# SPDX-License-Identifier: MIT
"""Curves end at tips and junctions of cracks; nodes there belong to two of them."""

import numpy as np
import pytest
from array_meshes import surface_of
from crack_scenes import COMM, branched, slit

from fenics_mortar.interface.curve_surface import ends_of_faces, order_curves, turn_between


def loop(x):
    """Links along a closed curve through points (n, 2), the body on the left."""
    numbers = np.arange(len(x))
    return np.asarray(x, float), np.roll(numbers, 1), np.roll(numbers, -1)


@pytest.mark.parametrize("angle, tips", [(0.0, 1), (20.0, 1), (-20.0, 0), (40.0, 0)])
def test_outline_folds_back_at_a_tip(angle, tips):
    """A notch of this angle [degrees] in a body on its left; a negative one is a sharp body."""
    t = np.radians(angle)
    x, previous, following = loop([(np.cos(t), -np.sin(t)), (0, 0), (1, 0), (1, -9), (-9, 0)])
    assert (ends_of_faces(x, previous, following) == 1).sum() == tips


def test_turn_back_is_to_the_right():
    """A body has no corner without cells: neither rounding nor its sign decide."""
    there = np.array([[1.0, 0.0]] * 4)
    back = np.array([[-1.0, 0.0], [-1.0, -0.0], [-1.0, 1e-16], [-1.0, -1e-16]])
    assert (turn_between(there, back) == -np.pi).all()
    assert turn_between(there[:1], np.array([[-1.0, 1e-3]]))[0] == pytest.approx(np.pi - 1e-3)


def test_faces_of_a_slit_are_two_curves_that_end_at_its_tips():
    side = surface_of_list(slit(4, ratio=1.0), ["upper", "lower"])
    assert side.num_nodes == 2 * 5 and (side.previous < 0).sum() == 2
    nodes, count = np.unique(side.nodes, return_counts=True)
    assert sorted(count) == [1] * 6 + [2] * 2
    for node in nodes[count == 2]:
        end, start = np.sort(np.flatnonzero(side.nodes == node)[[0, 1]])
        ends = {int(side.previous[k] < 0) - int(side.following[k] < 0) for k in (end, start)}
        assert ends == {1, -1}  # one curve begins where the other ends
        assert np.array_equal(*side.dofs[[end, start]])
        assert abs(side.X[end, 0]) == pytest.approx(1.0)


def test_parts_round_a_junction_are_two_curves_each():
    side = surface_of_list(branched(4), ["a1", "a2", "b1", "b2", "c1", "c2"])
    assert (side.previous < 0).sum() == 6
    assert (np.hypot(*side.X.T) < 1e-12).sum() == 6


def test_a_tip_is_added_once():
    """Forces on its two places in the surface act on the same dofs."""
    side = surface_of_list(slit(4), ["upper", "lower"])
    sums = np.zeros(int(side.local_dofs.max(initial=-1)) + 1)
    side.scatter_add(np.ones((side.num_nodes, 2)), sums)
    total = COMM.allreduce(sums.sum())
    assert total == 2 * side.num_nodes


def surface_of_list(mesh, names):
    return surface_of(mesh.data(), names)


def test_order_of_curves_with_tips():
    facets = np.array([[0, 1], [1, 2], [2, 1], [1, 0]])[[0, 3]]
    X = np.array([[0.0, 0.0], [1.0, 0.0]])
    order, facets, previous, following = order_curves(facets, X, "crack")
    assert order.tolist() == [0, 1, 1, 0]  # a crack of one facet: two curves
    assert facets.tolist() == [[0, 1], [2, 3]]
    assert previous.tolist() == [-1, 0, -1, 2] and following.tolist() == [1, -1, 3, -1]
