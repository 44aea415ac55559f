# SPDX-License-Identifier: MIT
"""Kernels of curved facets: by hand, invariants, derivatives."""

from itertools import product

import numpy as np
import pytest
from curves import CurvedCurves, wavy_curved, with_inner_nodes

from fenics_mortar.kernels.facets import BY_BASIS, BY_COVER, BY_STANDARD, DUAL, STANDARD

BASES = [DUAL, STANDARD]
OPTIONS = [
    (DUAL, None, BY_BASIS),
    (DUAL, None, BY_COVER),
    (DUAL, 0, BY_COVER),
    (DUAL, None, BY_STANDARD),
    (STANDARD, None, BY_BASIS),
    (STANDARD, 0, BY_BASIS),
]
SHARED = [
    {"share": True, "basis": kind, "gap_weights": weights}
    for kind, weights in product(BASES, (BY_BASIS, BY_COVER))
]
COVERS = {
    "full": (-0.05, 1.05),
    "one end": (0.13, 1.05),
    "both ends": (0.13, 0.97),
    "island": (0.55, 0.62),
}


def curves(cover, seed=0, **options):
    start, stop = COVERS[cover]
    return CurvedCurves(*wavy_curved(seed, start=start, stop=stop), **options)


def test_dual_functions_of_a_straight_facet_by_hand():
    # slave [0, 4], master [1, 3] as one straight facet each: eta = (2 - x), J = 2
    x = np.array([[0.0, 1], [2, 1], [4, 1]])
    m = np.array([[5.0, 0], [2, 0], [-1, 0]])
    pair = CurvedCurves(x, m)
    values = pair.evaluate(pair.positions)
    assert np.allclose(values["D"][0], 2 * np.diag([1, 4, 1]) / 3, atol=1e-15)
    # Phi = (5 xi^2 - 2 xi - 1)/4, (3 - 5 xi^2)/2, ...; L at eta = -2 xi / 3
    moments = {0: 2.0, 2: 2 / 3, 4: 2 / 5}

    def integral(a, b):
        polynomial = np.polynomial.polynomial.polymul(a, b)
        return 2 * sum(c * moments.get(i, 0.0) for i, c in enumerate(polynomial))

    phi = [[-1 / 4, -1 / 2, 5 / 4], [3 / 2, 0, -5 / 2], [-1 / 4, 1 / 2, 5 / 4]]
    shapes = [[0, 1 / 3, 2 / 9], [1, 0, -4 / 9], [0, -1 / 3, 2 / 9]]
    exact = [[integral(p, s) for s in shapes] for p in phi]
    assert np.allclose(values["M"][0], exact, atol=1e-14)
    assert np.allclose(values["g"][0], np.array([2, 8, 2]) / 3, atol=1e-14)


@pytest.mark.parametrize("cover", COVERS)
def test_dual_basis_is_biorthogonal_on_the_covered_part(cover):
    dual, standard = curves(cover), curves(cover, basis=STANDARD)
    one, other = dual.evaluate(dual.positions), standard.evaluate(standard.positions)
    off_diagonal = one["D"][:, ~np.eye(3, dtype=bool)]
    assert np.abs(off_diagonal).max() == 0.0
    assert np.abs(one["cover"] - np.einsum("ejj->ej", one["D"])).max() < 1e-15
    assert np.abs(one["cover"] - other["D"].sum(axis=2)).max() < 1e-15


@pytest.mark.parametrize("cover", COVERS)
def test_dual_functions_integrate_polynomials_to_their_nodal_values(cover):
    # on a flat pair the master functions are quadratics of the slave's coordinate, therefore
    # sum_l M_jl p(m_l) = int Phi_j p = d_j p(x_j) for p = 1, x, x^2
    start, stop = COVERS[cover]
    x = with_inner_nodes(np.stack([np.linspace(0, 1, 4), np.zeros(4)], axis=1), 0, 0.0)
    m = with_inner_nodes(np.stack([np.linspace(stop, start, 6), np.full(6, -0.1)], axis=1), 0, 0.0)
    pair = CurvedCurves(x, m)
    values = pair.evaluate(pair.positions)
    for power in range(3):
        for e, nodes in enumerate(pair.slave):
            found = np.zeros(3)
            for i in range(pair.offsets[e], pair.offsets[e + 1]):
                found += values["M"][i] @ m[pair.nodes[1][i], 0] ** power
            d = np.einsum("jj->j", values["D"][e])
            # the functions are up to 1e2 on the island
            assert np.abs(found - d * x[nodes, 0] ** power).max() < 1e-14


@pytest.mark.parametrize("cover", COVERS)
@pytest.mark.parametrize("kind", BASES)
@pytest.mark.parametrize("drop", [None, 0, 1, 2])
def test_rows_of_D_and_M_sum_to_the_same(cover, kind, drop):
    pair = curves(cover, basis=kind, drop=drop)
    values = pair.evaluate(pair.positions)
    of_D, of_M = values["D"].sum(axis=2), np.zeros((len(pair.slave), 3))
    for e in range(len(pair.slave)):
        of_M[e] = values["M"][pair.offsets[e] : pair.offsets[e + 1]].sum(axis=(0, 2))
    assert np.abs(of_D - of_M).max() < 1e-15
    assert np.abs(of_D.sum(axis=1) - values["cover"].sum(axis=1)).max() < 1e-15
    if drop is not None:
        assert np.abs(of_D[:, drop]).max() == 0.0


@pytest.mark.parametrize("cover", COVERS)
@pytest.mark.parametrize(
    "options", [*(dict(zip(("basis", "drop", "gap_weights"), o)) for o in OPTIONS), *SHARED]
)
def test_all_derivatives_equal_the_complex_step(cover, options):
    start, stop = COVERS[cover]
    pair = CurvedCurves(*wavy_curved(1, slaves=4, masters=6, start=start, stop=stop), **options)
    found, exact = pair.assemble(pair.evaluate(pair.positions)), pair.exact_derivatives()
    for name, array in exact.items():
        error = np.abs(found[name] - array).max()
        assert error < 1e-11 * np.abs(array).max(), name


def linear_pair(kind, stop, bulge):
    """Two slave facets on [0, 1] covered up to ``stop``, with multipliers at their ends only."""
    x = with_inner_nodes(np.stack([np.linspace(0, 1, 3), np.zeros(3)], axis=1), 0, bulge)
    m = with_inner_nodes(np.stack([np.linspace(stop, -0.1, 5), np.full(5, -0.1)], axis=1), 1, 0.0)
    return CurvedCurves(x, m, basis=kind, share=True)


@pytest.mark.parametrize("kind", BASES)
def test_ends_of_a_straight_covered_facet_have_the_linear_functions(kind):
    values = (pair := linear_pair(kind, 1.1, 0.0)).evaluate(pair.positions)
    # int (1 - xi) / 2 N_k dgamma with J = 1/4; the mean of 1 -+ xi over a facet is 1
    exact = np.array([[1 / 3, 2 / 3, 0], [0, 0, 0], [0, 2 / 3, 1 / 3]]) / 4
    assert np.abs(values["D"] - exact).max() < 1e-16
    assert np.abs(values["g"] - 0.1 * np.array([0.25, 0, 0.25])).max() < 1e-16


@pytest.mark.parametrize("stop", [1.1, 0.93, 0.8])
def test_shared_dual_functions_leave_the_ends_uncoupled(stop):
    values = (pair := linear_pair(DUAL, stop, 0.1)).evaluate(pair.positions)
    D = values["D"]
    assert np.abs(D[:, [0, 2], [2, 0]]).max() == 0.0
    assert np.abs(D[:, [0, 2], [0, 2]] - values["cover"][:, [0, 2]]).max() < 1e-16
    assert np.abs(D.sum(axis=(1, 2)) - values["cover"].sum(axis=1)).max() < 1e-15


def test_shared_dual_functions_lose_an_end_without_a_jump():
    """The far end's d vanishes at three quarters of a straight facet; x = 0.875 is there."""
    far = []
    for change in (1e-3, 1e-6, 1e-9):
        values = (pair := linear_pair(DUAL, 0.875 + change, 0.0)).evaluate(pair.positions)
        assert values["cover"][1, 2] > 0.0
        M = values["M"][pair.offsets[1] :]
        far.append(max(np.abs(M[:, 2]).max(), np.abs(values["D"][1, 2]).max()))
    assert far[1] == pytest.approx(1e-3 * far[0], rel=0.1)
    assert far[2] == pytest.approx(1e-6 * far[0], rel=0.1)


@pytest.mark.parametrize("seed, kind", product(range(3), BASES))
def test_rigid_motion_leaves_gap_and_matrices(seed, kind):
    pair = CurvedCurves(*wavy_curved(seed, start=0.1), basis=kind)
    turn = np.array([[0.28, -0.96], [0.96, 0.28]])
    before = pair.evaluate(pair.positions)
    after = pair.evaluate(pair.positions @ turn.T + [3.0, -2.0])
    for name in ("D", "M", "g"):
        assert np.abs(after[name] - before[name]).max() < 1e-13


@pytest.mark.parametrize("seed", range(3))
def test_segments_of_a_covered_facet_fill_it(seed):
    pair = CurvedCurves(*wavy_curved(seed, slaves=23, masters=31))
    for e in range(len(pair.slave)):
        ends = pair.ends[pair.offsets[e] : pair.offsets[e + 1]]
        assert ends[0, 0] == -1.0 and ends[-1, 1] == 1.0
        assert np.abs(ends[1:, 0] - ends[:-1, 1]).max(initial=0.0) < 1e-13


@pytest.mark.parametrize("cover", [1.0, 1e-2, 1e-4])
def test_tiny_cover_keeps_the_dual_basis_finite_and_the_sums_exact(cover):
    x = np.stack([np.linspace(0, 2, 5), np.zeros(5)], axis=1)
    m = np.stack([np.linspace(1 + cover, -1, 3), np.full(3, -0.1)], axis=1)
    pair = CurvedCurves(x, m)
    values = pair.evaluate(pair.positions)
    d = np.einsum("jj->j", values["D"][1])
    # int over X in [0, cover] of N(xi), xi + 1 = 2 X
    exact = [cover - 1.5 * cover**2 + 2 / 3 * cover**3, 2 * cover**2 - 4 / 3 * cover**3]
    exact.append(2 / 3 * cover**3 - cover**2 / 2)
    assert np.abs(d / exact - 1).max() < 4e-15 / cover
    # d_j T(xi_j) is of order one, however small d_j is: rounding of the facet's length
    M = values["M"][pair.offsets[1] :].sum(axis=0)
    assert np.abs(M.sum(axis=1) - d).max() < 1e-14


def test_coinciding_nodes_are_integrated_in_any_direction():
    """Rounding leaves slivers of no length, some behind the segment that covers the facet."""
    slave, master = np.arange(9.0), np.arange(10.0, -3.0, -1.0)
    behind = 0
    for angle in np.linspace(0.0, 6.0, 61):
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        x = np.stack([slave, np.zeros(9)], axis=1) @ turn
        m = np.stack([master, np.full(13, -0.1)], axis=1) @ turn
        pair = CurvedCurves(x, m)
        values = pair.evaluate(pair.positions)
        last = pair.ends[pair.offsets[1:] - 1]
        behind += (last[:, 1] == -1.0).sum()
        assert np.allclose(values["g"], 0.1 * np.array([1, 4, 1]) / 3, atol=1e-14)
        for name in ("dD", "dM", "dg"):
            assert np.isfinite(values[name]).all()
    assert behind > 0
