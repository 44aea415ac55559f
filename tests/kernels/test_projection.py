# SPDX-License-Identifier: MIT
"""Projections along the slave normals: exact cases, inverse to each other, derivatives."""

import closed_form
import numpy as np
import pytest
from derivatives import complex_step

from fenics_mortar.kernels import projection
from fenics_mortar.kernels.projection import move_end, segment_ends

N, L = np.empty((2, 3, 2))


def master_to_slave(y, k):
    return projection.master_to_slave(y, k, N)


def slave_to_master(y, xi):
    return projection.slave_to_master(y, xi, N, L)


def facets(seed, parallel_normals=False):
    """Local coordinates of a slave facet on top and a master facet below, normals varying."""
    rng = np.random.default_rng(seed)
    x = np.array([[0.0, 0.0], [1.0, 0.0]]) + rng.uniform(-0.1, 0.1, (2, 2))
    n = np.array([[0.0, -1.0], [0.0, -1.0]]) + (not parallel_normals) * rng.uniform(
        -0.2, 0.2, (2, 2)
    )
    n /= np.linalg.norm(n, axis=1)[:, None]
    m = np.array([[0.8, -0.1], [0.3, -0.1]]) + rng.uniform(-0.1, 0.1, (2, 2))
    return np.concatenate([x.ravel(), n.ravel(), m.ravel()])


def test_projection_between_parallel_facets_agrees_with_hand_calculation():
    # slave from 0 to 4 at height 1 looking down, master from 3 to 1 at height 0
    y = np.array([0.0, 1, 4, 1, 0, -1, 0, -1, 3, 0, 1, 0])
    assert master_to_slave(y, 0) == pytest.approx(1 / 2, abs=1e-15)
    assert master_to_slave(y, 1) == pytest.approx(-1 / 2, abs=1e-15)
    eta, alpha = slave_to_master(y, 0.25)  # at x = 5/2: a quarter of the way from 3 to 1
    assert (eta, alpha) == pytest.approx((-1 / 2, 1.0), abs=1e-15)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("k", [0, 1])
def test_projections_are_inverse_to_each_other(seed, k):
    y = facets(seed)
    xi = master_to_slave(y, k)
    eta, _ = slave_to_master(y, xi)
    assert eta == pytest.approx(-1.0 if k == 0 else 1.0, abs=1e-13)


def test_nearly_parallel_normals_keep_all_digits():
    y = facets(0, parallel_normals=True)
    exact = master_to_slave(y, 0)
    y[4] += 1e-13
    assert master_to_slave(y, 0) == pytest.approx(exact, abs=1e-12)


def test_normal_parallel_to_the_master_facet_gives_no_finite_partner():
    y = np.array([0.0, 0, 1, 0, 0, -1, 0, -1, 0.5, -1, 0.5, -2])
    with np.errstate(all="ignore"):
        eta, _ = slave_to_master(y, 0.3)
    assert not np.isfinite(eta)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("k", [0, 1])
def test_derivative_of_the_partner_equals_the_complex_step(seed, k):
    y, derivative = facets(seed), np.empty(12)
    assert move_end(y, k, master_to_slave(y, k), N, derivative) == pytest.approx(
        closed_form.master_to_slave(y, k), abs=1e-15
    )
    exact = complex_step(lambda moved: np.array(closed_form.master_to_slave(moved, k)), y)
    assert np.abs(derivative - exact).max() < 1e-13 * np.abs(exact).max()


@pytest.mark.parametrize("lower, upper", [(a, b) for a in (True, False) for b in (True, False)])
def test_segment_ends_are_fixed_or_partners(lower, upper):
    y = facets(3)
    ends, derivative = np.array([-1.0, 1.0]), np.empty((2, 12))
    found = np.array([-1.0 if lower else master_to_slave(y, 1)] * 2)
    found[1] = 1.0 if upper else master_to_slave(y, 0)
    segment_ends(y, np.array([lower, upper]), found, N, ends, derivative)
    assert ends == pytest.approx(found, abs=1e-15)
    assert derivative[0].any() != lower and derivative[1].any() != upper
