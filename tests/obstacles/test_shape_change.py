# SPDX-License-Identifier: MIT
"""Derivatives of distances by the points of a spline, against difference quotients."""

import numpy as np
import pytest

import fenics_mortar as fm
from fenics_mortar.obstacles.obstacle import differentiate_shape


@pytest.mark.parametrize("closed", [False, True], ids=["open", "closed"])
def test_points_of_a_spline(closed):
    """Points on both sides, and beyond the ends of an open curve, where it is straight."""
    rng = np.random.default_rng(0)
    if closed:
        turn = np.linspace(0.0, 2.0 * np.pi, 8)[:-1]
        points = np.stack([1.2 * np.cos(turn), np.sin(turn)], 1) * (1.0 + 0.1 * rng.random((7, 1)))
        x = 1.1 * points + 0.05 * rng.uniform(-1.0, 1.0, points.shape)
    else:
        at = np.linspace(-1.0, 1.0, 9) + 0.05 * rng.random(9)
        points = np.stack([at, 0.3 * at**2 + 0.02 * rng.random(9)], 1)
        along = np.linspace(-1.3, 1.3, 17)
        x = np.stack([along, 0.3 * along**2 + 0.1 * np.sin(9.0 * along)], 1)
    spline, directions = fm.Spline(points, closed=closed), rng.normal(size=(3, *points.shape))
    found = spline.local_by_shapes(x, "points", directions)
    quotients = [differentiate_shape(spline, x, "points", direction) for direction in directions]
    for exact, each in zip(found, zip(*quotients, strict=True), strict=True):
        assert np.allclose(exact, np.array(each), rtol=1e-8, atol=1e-9)
    assert np.ptp(found[0]) > 0.1 and np.ptp(found[1]) > 0.1
