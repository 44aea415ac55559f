# SPDX-License-Identifier: MIT
"""Shape functions of facets in space, their pieces, and rules of a triangle."""

from math import factorial

import numpy as np
import pytest
from derivatives import complex_step
from surfaces_in_space import KINDS

from fenics_mortar.kernels.space.shapes import (
    ALLOWED,
    COLLAPSED,
    piece_centres,
    pieces_of,
    reference_nodes,
    tabulate_shapes,
    triangle_rule,
)


def shapes(a, b, kind, orders=6):
    N = np.empty((orders, kind), np.result_type(a, b, float))
    tabulate_shapes(a, b, N)
    return N


@pytest.mark.parametrize("kind", KINDS)
def test_functions_are_one_at_their_nodes_and_their_sum_is_one(kind):
    at_nodes = np.array([shapes(a, b, kind, 3)[0] for a, b in reference_nodes(kind)])
    assert np.abs(at_nodes - np.eye(kind)).max() < 1e-15
    assert np.abs(shapes(0.31, 0.17, kind).sum(axis=1) - [1, 0, 0, 0, 0, 0]).max() < 1e-15


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_of_functions_equal_the_complex_step(kind):
    point = np.array([0.31, 0.17])
    by_point = complex_step(lambda p: shapes(p[0], p[1], kind)[:3], point)
    N = shapes(0.31, 0.17, kind)
    exact = np.stack([by_point[0, :, 0], by_point[0, :, 1]])
    assert np.abs(N[1:3] - exact).max() < 1e-15
    seconds = np.stack([by_point[1, :, 0], by_point[1, :, 1], by_point[2, :, 1]])
    assert np.abs(N[3:] - seconds).max() < 1e-15


@pytest.mark.parametrize("kind", KINDS)
def test_pieces_fill_the_reference_facet(kind):
    nodes, areas = reference_nodes(kind), []
    for piece in pieces_of(kind):
        p = nodes[piece]
        areas.append((p[:, 0] * np.roll(p[:, 1], -1) - p[:, 1] * np.roll(p[:, 0], -1)).sum() / 2)
    assert min(areas) > 0 and sum(areas) == (0.5 if kind in (3, 6) else 4.0)
    assert np.allclose(
        piece_centres(kind), [nodes[piece].mean(axis=0) for piece in pieces_of(kind)]
    )


DEGREES = {3: 2, 6: 4, 7: 5, 12: 6, 16: 7, 25: 9, 36: 11, 49: 13, 64: 15}


@pytest.mark.parametrize("points", ALLOWED)
def test_rules_are_exact_up_to_their_degree_and_symmetric(points):
    degree = DEGREES[points]
    bary, weights = triangle_rule(points)
    assert len(weights) == points and bary.min() > 0.0

    def error(i, j):
        exact = 2 * factorial(i) * factorial(j) / factorial(i + j + 2)
        return abs(weights @ (bary[:, 0] ** i * bary[:, 1] ** j) - exact)

    assert max(error(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)) < 1e-14
    assert max(error(i, degree + 1 - i) for i in range(degree + 2)) > 1e-12
    if points in COLLAPSED:
        return
    turned = np.roll(bary, 1, axis=1)
    assert all(np.abs(bary - row).max(axis=1).min() < 1e-15 for row in turned)


def test_rule_that_does_not_exist_is_named():
    with pytest.raises(KeyError, match="5"):
        triangle_rule(5)
