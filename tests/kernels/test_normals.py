# SPDX-License-Identifier: MIT
"""Averaged normals: exact cases, invariants, derivatives."""

import numpy as np
import pytest
from derivatives import complex_step

from fenics_mortar.kernels.projection import OPPOSITE, OWN, UNIT, tabulate_normals

WEIGHTINGS = [OPPOSITE, UNIT, OWN]


def normals(x, weighting, closed=False, degree=1):
    count = len(x)
    previous, following = np.arange(count) - 1, np.arange(count) + 1
    following[-1] = -1
    if closed:
        previous[0], following[-1] = count - 1, 0
    n, dn = np.empty_like(x), np.zeros((count, 2, 4 * degree + 2), x.dtype)
    inner = np.arange(count) % degree != 0
    tabulate_normals(x, previous, following, inner, weighting, n, dn)
    return n, dn


def wavy_curve(seed, count=7):
    rng = np.random.default_rng(seed)
    x = np.sort(rng.uniform(0, 1, count))
    return np.stack([x, 0.2 * rng.uniform(-1, 1, count)], axis=1)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_normals_of_a_straight_surface_point_away_from_the_body_on_the_left(weighting):
    x = np.array([[0.0, 0.0], [0.3, 0.4], [1.2, 1.6]])
    n, _ = normals(x, weighting)
    assert np.allclose(n, [0.8, -0.6], atol=1e-15)


@pytest.mark.parametrize("closed", [False, True])
def test_opposite_weighting_is_exact_on_a_circle_with_random_facets(closed):
    angles = np.sort(np.random.default_rng(1).uniform(0, 2 * np.pi, 20))
    x = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    n, _ = normals(x, OPPOSITE, closed)
    inner = slice(None) if closed else slice(1, -1)
    assert np.abs(n - x)[inner].max() < 1e-14


def test_unit_weighting_is_the_bisector_of_the_facet_normals():
    x = np.array([[-3.0, 0.0], [0.0, 0.0], [0.0, 0.1]])
    n, _ = normals(x, UNIT)
    assert np.allclose(n[1], np.array([1.0, -1.0]) / np.sqrt(2), atol=1e-15)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_derivative_of_normals_equals_the_complex_step(weighting, closed, seed):
    x = wavy_curve(seed)
    _, dn = normals(x, weighting, closed)
    exact = complex_step(lambda moved: normals(moved, weighting, closed)[0], x)
    count = len(x)
    found = np.zeros_like(exact)
    for j in range(count):
        for place, node in enumerate((j - 1, j, j + 1)):
            if closed or 0 <= node < count:
                found[j, :, node % count] += dn[j, :, 2 * place : 2 * place + 2]
    assert np.abs(found - exact).max() < 1e-13 * np.abs(exact).max()


@pytest.mark.parametrize("weighting", WEIGHTINGS)
@pytest.mark.parametrize("closed", [False, True])
def test_derivative_of_normals_of_curved_facets_equals_the_complex_step(weighting, closed):
    x = wavy_curve(0, 8 if closed else 9)
    count = len(x)
    _, dn = normals(x, weighting, closed, degree=2)
    exact = complex_step(lambda moved: normals(moved, weighting, closed, degree=2)[0], x)
    found = np.zeros_like(exact)
    for j in range(count):
        for place, node in enumerate(range(j - 2, j + 3)):
            if closed or 0 <= node < count:
                found[j, :, node % count] += dn[j, :, 2 * place : 2 * place + 2]
            else:
                assert np.abs(dn[j, :, 2 * place : 2 * place + 2]).max() == 0.0
    assert np.abs(found - exact).max() < 1e-13 * np.abs(exact).max()


def test_normals_of_curved_facets_are_those_of_the_curve():
    # a parabola is its own quadratic interpolation: the normals are exact, whatever the weighting
    s = np.array([-1.0, -0.4, 0.2, 0.5, 0.8])
    x = np.stack([s, s * s], axis=1)
    exact = np.stack([2 * s, -np.ones(5)], axis=1) / np.sqrt(1 + 4 * s * s)[:, None]
    for weighting in WEIGHTINGS:
        n, _ = normals(x, weighting, degree=2)
        assert np.abs(n - exact).max() < 1e-15


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_normals_of_curved_facets_on_a_circle_are_of_third_order(weighting):
    errors = []
    for count in (8, 16):
        angles = np.linspace(0, np.pi, 2 * count + 1)
        angles[::4] -= 0.1 * angles[1]
        angles[1::2] = (angles[:-1:2] + angles[2::2]) / 2
        x = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        n, _ = normals(x, weighting, degree=2)
        errors.append(np.abs(n - x)[2:-2].max())
        assert np.abs(n - x)[1::2].max() < 1e-14
    assert errors[1] < errors[0] / 6


def test_normals_turn_with_the_surface_and_ignore_its_size():
    x = wavy_curve(0)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    n, _ = normals(x, OPPOSITE)
    turned, _ = normals(1e-6 * x @ turn.T + 5.0, OPPOSITE)
    # moving by 5 leaves 1e-6 * x with some 9 digits
    assert np.abs(turned - n @ turn.T).max() < 1e-8
