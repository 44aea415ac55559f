# SPDX-License-Identifier: MIT
"""Integrals weighted by an out-of-plane thickness: by hand, invariants, derivatives."""

from itertools import product

import numpy as np
import pytest
from curves import CurvedCurves, Curves, wavy, wavy_curved

from fenics_mortar.kernels.facets import BY_BASIS, BY_COVER, BY_STANDARD, DUAL, STANDARD

COVERS = {"full": (-0.05, 1.05), "one end": (0.13, 1.05), "island": (0.55, 0.7)}
OPTIONS = [
    *product([DUAL], [BY_BASIS, BY_COVER, BY_STANDARD]),
    (STANDARD, BY_BASIS),
]
AROUND_AXIS = 2.0 * np.pi


def revolved(curves, start, stop, **options):
    """Curves in the meridian plane; the axis is at the first slave node."""
    build, make = {1: (Curves, wavy), 2: (CurvedCurves, wavy_curved)}[curves]
    x, m = make(1, slaves=4, masters=6, start=start, stop=stop)
    return build(x, m, thickness=(np.zeros(len(x)), AROUND_AXIS), **options)


def test_disk_by_hand():
    # slave from the axis to r = 1 at y = 0, one facet; dual functions for the weight 2 pi r:
    # mass = 2 pi [[1/12, 1/12], [1/12, 1/4]], d = 2 pi (1/6, 1/3)
    pair = Curves(
        np.array([[0.0, 0], [1, 0]]), np.array([[1.5, -0.1], [-0.1, -0.1]]),
        thickness=(np.zeros(2), AROUND_AXIS),
    )  # fmt: skip
    values = pair.evaluate(pair.positions)
    assert np.allclose(values["D"][0], AROUND_AXIS * np.diag([1 / 6, 1 / 3]), atol=1e-15)
    assert np.allclose(values["cover"][0], AROUND_AXIS * np.array([1 / 6, 1 / 3]), atol=1e-15)
    assert np.allclose(values["g"][0], 0.1 * AROUND_AXIS * np.array([1 / 6, 1 / 3]), atol=1e-15)
    # M_jl = int Phi_j L_l 2 pi r with L_1 = (r + 0.1)/1.6 at r = 1.5 and int Phi_j r dA = d_j r_j
    exact = AROUND_AXIS * np.array([[0.1 / 6, 1.5 / 6], [1.1 / 3, 0.5 / 3]]) / 1.6
    assert np.allclose(values["M"][0], exact, atol=1e-14)


@pytest.mark.parametrize("degree, cover", product([1, 2], COVERS))
@pytest.mark.parametrize("kind", [DUAL, STANDARD])
def test_rows_of_D_and_M_sum_to_the_same_area(degree, cover, kind):
    pair = revolved(degree, *COVERS[cover], basis=kind)
    values = pair.evaluate(pair.positions)
    of_D = values["D"].sum(axis=2)
    for e in range(len(pair.slave)):
        of_M = values["M"][pair.offsets[e] : pair.offsets[e + 1]].sum(axis=(0, 2))
        assert np.abs(of_D[e] - of_M).max(initial=0.0) < 1e-14
    assert np.abs(of_D.sum(axis=1) - values["cover"].sum(axis=1)).max() < 1e-14


def test_area_is_that_of_frustums():
    pair = revolved(1, *COVERS["full"])
    x = pair.x
    lengths = np.linalg.norm(np.diff(x, axis=0), axis=1)
    area = np.pi * (x[:-1, 0] + x[1:, 0]) @ lengths
    assert pair.evaluate(pair.positions)["D"].sum() == pytest.approx(area, rel=1e-15)


@pytest.mark.parametrize("degree, cover", product([1, 2], COVERS))
@pytest.mark.parametrize("kind, gap_weights", OPTIONS)
def test_all_derivatives_equal_the_complex_step(degree, cover, kind, gap_weights):
    pair = revolved(degree, *COVERS[cover], basis=kind, gap_weights=gap_weights)
    found, exact = pair.assemble(pair.evaluate(pair.positions)), pair.exact_derivatives()
    if kind == DUAL:  # the off-diagonal is zero by construction
        exact["D"][:, ~np.eye(degree + 1, dtype=bool)] = 0.0
    for name, array in exact.items():
        error = np.abs(found[name] - array).max()
        assert error < 1e-11 * np.abs(array).max(), name


@pytest.mark.parametrize("degree", [1, 2])
def test_material_thickness_is_independent_of_positions(degree):
    build, make = {1: (Curves, wavy), 2: (CurvedCurves, wavy_curved)}[degree]
    x, m = make(1, slaves=4, masters=6, start=0.13, stop=1.05)
    pair = build(x, m, thickness=(1.0 + x[:, 0] ** 2, 0.0))
    found, exact = pair.assemble(pair.evaluate(pair.positions)), pair.exact_derivatives()
    exact["D"][:, ~np.eye(degree + 1, dtype=bool)] = 0.0
    for name, array in exact.items():
        assert np.abs(found[name] - array).max() < 1e-11 * np.abs(array).max(), name


@pytest.mark.parametrize("degree", [1, 2])
def test_unit_thickness_changes_nothing(degree):
    build, make = {1: (Curves, wavy), 2: (CurvedCurves, wavy_curved)}[degree]
    x, m = make(0, start=0.13)
    plain, ones = build(x, m), build(x, m, thickness=(np.ones(len(x)), 0.0))
    one, other = (pair.evaluate(pair.positions) for pair in (plain, ones))
    for name, array in one.items():
        assert np.abs(other[name] - array).max() < 1e-13 * max(np.abs(array).max(), 1.0), name
