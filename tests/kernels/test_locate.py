# SPDX-License-Identifier: MIT
"""Points in a triangulation, against scipy's search."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from fenics_mortar.kernels.locate import locate


def nodes(kind):
    """At random, or on a grid, whose circles hold four nodes and whose sides many."""
    if kind == "random":
        return np.random.default_rng(0).random((60, 2))
    return np.stack(np.meshgrid(np.linspace(0, 3, 13), np.linspace(0, 1, 6)), -1).reshape(-1, 2)


@pytest.mark.parametrize("kind", ["random", "grid"])
def test_linear_functions_are_exact_inside_and_nothing_is_found_outside(kind):
    mesh = Delaunay(nodes(kind))
    x = mesh.points
    low, high = x.min(axis=0) - 0.1, x.max(axis=0) + 0.1
    points = np.vstack([low + (high - low) * np.random.default_rng(1).random((400, 2)), x])
    found, weights = np.empty(len(points), np.int64), np.empty((len(points), 3))
    seeds = np.random.default_rng(2).integers(len(mesh.simplices), size=len(points))
    locate(points, seeds, x, mesh.simplices, mesh.neighbors, found, weights)
    inside = mesh.find_simplex(points) >= 0
    assert 0 < inside.sum() < len(points)
    assert np.array_equal(found >= 0, inside)
    at = np.einsum("nk,nkc->nc", weights, x[mesh.simplices[found]])
    assert np.abs(at - points)[inside].max() < 1e-13
    assert weights[inside].min() > -1e-9
