# SPDX-License-Identifier: MIT
"""Pairs of near points by bins equal those by comparison of all points."""

import numpy as np
import pytest

from fenics_mortar.utils.arrays import near


@pytest.mark.parametrize("seed", range(20))
def test_all_near_pairs_are_found(seed):
    rng = np.random.default_rng(seed)
    a, b = (10.0 ** rng.uniform(-3, 3) * rng.normal(size=(n, 2)) for n in rng.integers(0, 40, 2))
    radius = 10.0 ** rng.uniform(-2, 2)
    i, j = near(a, b, radius)
    expected = np.nonzero(((a[:, None] - b) ** 2).sum(axis=2) <= radius**2)
    assert sorted(zip(i, j)) == sorted(zip(*expected))


def test_points_on_edges_of_bins_count():
    x = np.stack(np.meshgrid(np.arange(3.0), np.arange(3.0)), axis=-1).reshape(-1, 2)
    i, j = near(x, x, 1.0)
    assert len(i) == 9 + 2 * 12 and (np.hypot(*(x[i] - x[j]).T) <= 1.0).all()
