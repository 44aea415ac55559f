# SPDX-License-Identifier: MIT
"""Interpolation in a triangulation, against scipy's search."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from fenics_mortar.kernels.crossing import interpolate
from fenics_mortar.kernels.tree import build_tree


def nodes(kind):
    """Random points, or a grid, which has four nodes on a circle and many on its sides."""
    if kind == "random":
        return np.random.default_rng(0).random((60, 2))
    return np.stack(np.meshgrid(np.linspace(0, 3, 13), np.linspace(0, 1, 6)), -1).reshape(-1, 2)


@pytest.mark.parametrize("kind", ["random", "grid"])
def test_linear_functions_are_exact_inside_and_nothing_is_found_outside(kind):
    mesh = Delaunay(nodes(kind))
    x, triangles = mesh.points, mesh.simplices.astype(np.int64)
    low, high = x.min(axis=0) - 0.1, x.max(axis=0) + 0.1
    points = np.vstack([low + (high - low) * np.random.default_rng(1).random((400, 2)), x])
    result = np.empty_like(points)
    interpolate(points, build_tree(x, triangles), x, triangles, 2.0 * x - 1.0, result)
    inside = mesh.find_simplex(points) >= 0
    assert 0 < inside.sum() < len(points)
    assert np.array_equal(np.isfinite(result).all(axis=1), inside)
    assert np.abs(result - (2.0 * points - 1.0))[inside].max() < 1e-13


def test_a_notch_is_outside():
    """If the triangles of a notch are removed, no value is found there."""
    mesh = Delaunay(nodes("grid"))
    middles = mesh.points[mesh.simplices].mean(axis=1)
    notched = (middles[:, 0] < 1.0) | (middles[:, 0] > 2.0) | (middles[:, 1] < 0.4)
    triangles = mesh.simplices[notched].astype(np.int64)
    result = np.empty((2, 2))
    points, x = np.array([[1.5, 0.9], [1.5, 0.3]]), mesh.points
    interpolate(points, build_tree(x, triangles), x, triangles, x, result)
    assert np.isnan(result[0]).all() and np.abs(result[1] - points[1]).max() < 1e-14
