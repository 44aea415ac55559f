# SPDX-License-Identifier: MIT
"""Nodal normals in space: exact on spheres, free of the numbering, derivatives by complex step."""

import numpy as np
import pytest
from derivatives import complex_step
from surfaces_in_space import KINDS, cube_sphere, grid, move_corners, normals

from fenics_mortar.kernels.projection import OPPOSITE, OWN, UNIT

WEIGHTINGS = [OPPOSITE, UNIT, OWN]


def wavy(kind, seed=0, cells=2):
    rng = np.random.default_rng(seed)
    flat, facets = grid(kind, cells)
    flat = move_corners(flat, facets, rng.uniform(-0.1, 0.1, flat.shape))
    return np.column_stack([flat, 0.1 * rng.uniform(-1, 1, len(flat))]), facets


@pytest.mark.parametrize("split", [False, True])
@pytest.mark.parametrize("grading", [0.0, 1.0])
def test_opposite_weighting_is_exact_on_a_sphere(split, grading):
    x, facets = cube_sphere(6, split, grading)
    assert np.abs(normals(x, facets)[0] - x).max() < 1e-14
    assert np.abs(normals(x, facets, UNIT)[0] - x).max() > 1e-3


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_normals_of_a_plane_are_its_normal(kind, weighting):
    x, facets = wavy(kind)
    x[:, 2] = 0.3 * x[:, 0] - 0.2 * x[:, 1]
    exact = np.array([-0.3, 0.2, 1.0]) / np.sqrt(1.13)
    assert np.abs(normals(x, facets, weighting)[0] - exact).max() < 1e-15


@pytest.mark.parametrize("kind", [6, 9])
@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_normals_of_curved_facets_are_those_of_a_paraboloid(kind, weighting):
    # a mesh of parallelograms interpolates it exactly
    flat, facets = grid(kind, 3)
    a, b = (flat @ np.array([[1.0, 0.2], [-0.3, 0.8]])).T
    x = np.stack([a, b, a * a - 0.5 * a * b + b], axis=1)
    exact = np.stack([0.5 * b - 2 * a, 0.5 * a - 1, np.ones(len(a))], axis=1)
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    assert np.abs(normals(x, facets, weighting)[0] - exact).max() < 1e-14


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_normals_do_not_depend_on_the_first_corner_of_the_facets(kind, weighting):
    x, facets = wavy(kind)
    sides = 3 if kind in (3, 6) else 4
    turned = facets.copy()
    for start in range(0, 2 * sides if kind > 4 else sides, sides):
        turned[:, start : start + sides] = np.roll(facets[:, start : start + sides], 1, axis=1)
    difference = normals(x, turned, weighting)[0] - normals(x, facets, weighting)[0]
    # the centre of quad9 has one facet, whose weight cancels
    assert np.abs(difference).max() < 1e-14


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("weighting", WEIGHTINGS)
@pytest.mark.parametrize("on_symmetry_plane", [False, True])
def test_derivatives_of_normals_equal_the_complex_step(kind, weighting, on_symmetry_plane):
    x, facets = wavy(kind, cells=2)
    projectors = None
    if on_symmetry_plane:
        projectors = np.tile(np.diag([0.0, 1.0, 1.0]), (len(x), 1, 1))
    _, dn, ring = normals(x, facets, weighting, projectors)
    exact = complex_step(lambda moved: normals(moved, facets, weighting, projectors)[0], x)
    found = np.zeros_like(exact)
    for j in range(len(x)):
        for i, node in enumerate(ring[j]):
            if node >= 0:
                found[j, :, node] = dn[j, :, 3 * i : 3 * i + 3]
            else:
                assert not dn[j, :, 3 * i : 3 * i + 3].any()
    assert np.abs(found - exact).max() < 1e-13 * np.abs(exact).max()


def test_ring_has_only_neighbours_along_edges():
    _, facets = wavy(4, cells=4)
    _, _, ring = normals(*wavy(4, cells=4))
    assert ring.shape[1] == 5 and (np.sort(ring[12]) == [7, 11, 12, 13, 17]).all()
    assert facets.max() == 24
