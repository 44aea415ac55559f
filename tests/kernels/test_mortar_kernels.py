# SPDX-License-Identifier: MIT
"""Segment moments, multiplier bases, and the resulting D, M and gap."""

from itertools import product

import numpy as np
import pytest
from closed_form import BOTH, ONLY_FIRST, ONLY_SECOND
from curves import Curves, wavy

from fenics_mortar.kernels import projection
from fenics_mortar.kernels.facets import BY_BASIS, BY_COVER, BY_STANDARD, DUAL, STANDARD

BASES = [DUAL, STANDARD]
GAP_WEIGHTS = [BY_BASIS, BY_COVER, BY_STANDARD]
# cover of the slave by the master: full, an end missing, an island, and two pieces
COVERS = {
    "full": (-0.05, 1.05),
    "one end": (0.13, 1.05),
    "both ends": (0.13, 0.97),
    "island": (0.55, 0.7),
}


def curves(cover, seed=0, **options):
    if cover == "two pieces":
        x, m = wavy(seed, slaves=2, masters=5, start=0.05, stop=0.95)
        m[2] = [0.5, 5.0]  # a spike beyond the angle filter: the middle has no partner
        return Curves(x, m, **options)
    start, stop = COVERS[cover]
    return Curves(*wavy(seed, start=start, stop=stop), **options)


def test_one_segment_by_hand():
    # slave [0, 4], master [1, 3], both flat, distance 1: half of the facet is covered
    pair = Curves(np.array([[0.0, 1], [4, 1]]), np.array([[3.0, 0], [1, 0]]), STANDARD)
    values = pair.evaluate(pair.positions)
    # int_1^3 N_j N_k with N_1 = 1 - x/4, N_2 = x/4
    assert np.allclose(values["D"][0], np.array([[13, 11], [11, 13]]) / 24, atol=1e-15)
    # master functions L_1 = (x - 1)/2, L_2 = (3 - x)/2
    assert np.allclose(values["M"][0], np.array([[5, 7], [7, 5]]) / 12, atol=1e-15)
    assert np.allclose(values["g"][0], [1, 1], atol=1e-15)


def test_dual_basis_by_hand():
    # the same with Phi_1 = 1/2 - 3 s, s in [-1, 1]: F = 3 / (2 h) with h = 1/2
    pair = Curves(np.array([[0.0, 1], [4, 1]]), np.array([[3.0, 0], [1, 0]]))
    values = pair.evaluate(pair.positions)
    assert np.allclose(values["D"][0], np.eye(2), atol=1e-15)
    assert np.allclose(values["M"][0], np.array([[-1, 3], [3, -1]]) / 2, atol=1e-14)
    assert np.allclose(values["g"][0], [1, 1], atol=1e-14)


@pytest.mark.parametrize("cover", [*COVERS, "two pieces"])
@pytest.mark.parametrize("kind", BASES)
def test_rows_of_D_and_M_sum_to_the_same(cover, kind):
    pair = curves(cover, basis=kind)
    values = pair.evaluate(pair.positions)
    of_D, of_M = values["D"].sum(axis=2), np.zeros((len(pair.slave), 2))
    for e in range(len(pair.slave)):
        of_M[e] = values["M"][pair.offsets[e] : pair.offsets[e + 1]].sum(axis=(0, 2))
    assert np.abs(of_D - of_M).max() < 1e-15


@pytest.mark.parametrize("cover", [*COVERS, "two pieces"])
def test_dual_basis_is_biorthogonal_on_the_covered_part(cover):
    dual, standard = curves(cover), curves(cover, basis=STANDARD)
    D = dual.evaluate(dual.positions)["D"]
    mass = standard.evaluate(standard.positions)["D"]
    assert np.abs(D[:, 0, 1]).max() == 0.0 and np.abs(D[:, 1, 0]).max() == 0.0
    assert np.abs(np.einsum("ejj->ej", D) - mass.sum(axis=2)).max() < 1e-15


def test_separate_segments_are_independent():
    pair = curves("two pieces")
    ends = pair.ends[np.argsort(pair.ends[:, 0])]
    gaps = ends[1:, 0] - ends[:-1, 1]
    assert len(pair.slave) == 1 and (gaps > 0.1).sum() == 1


@pytest.mark.parametrize("cover", [*COVERS, "two pieces"])
@pytest.mark.parametrize("kind", BASES)
def test_gap_by_standard_weights_is_that_of_the_standard_basis(cover, kind):
    standard = curves(cover, basis=STANDARD)
    pair = curves(cover, basis=kind, gap_weights=BY_STANDARD)
    g, exact = (p.evaluate(p.positions)["g"] for p in (pair, standard))
    assert np.allclose(g, exact, rtol=0, atol=1e-15)


@pytest.mark.parametrize("cover", [*COVERS, "two pieces"])
def test_gap_by_the_cover_is_that_of_the_basis_at_covered_nodes(cover):
    own, pair = curves(cover), curves(cover, gap_weights=BY_COVER)
    g_own, g = (p.evaluate(p.positions)["g"] for p in (own, pair))
    first, last = own.ends[own.offsets[:-1], 0], own.ends[own.offsets[1:] - 1, 1]
    covered = np.stack([first == -1.0, last == 1.0], axis=1)
    assert np.allclose(g[covered], g_own[covered], rtol=0, atol=1e-15)


@pytest.mark.parametrize("start, stop", [(0.2, 0.9), (0.2, 1.0), (0.5, 0.51)])
def test_gap_by_the_cover_is_a_linear_gap_at_its_ends(start, stop):
    """With weights of the basis, the gap at the nodes is the extrapolation of this gap."""
    x, m = (
        np.array([[0.0, 0.0], [1.0, 0.0]]),
        np.array([[stop, -0.3 * stop], [start, -0.3 * start]]),
    )
    for weights, places in ((BY_COVER, [start, stop]), (BY_BASIS, [0.0, 1.0])):
        pair = Curves(x, m, gap_weights=weights)
        values = pair.evaluate(pair.positions)
        mean = values["g"][0] / np.diag(values["D"][0])
        assert np.allclose(mean, 0.3 * np.array(places), rtol=0, atol=1e-12)


@pytest.mark.parametrize("cover", [1.0, 1e-2, 1e-5, 1e-9])
def test_tiny_cover_keeps_the_dual_basis_finite_and_the_sums_exact(cover):
    x = np.array([[0.0, 0], [1, 0], [2, 0]])
    pair = Curves(x, np.array([[1 + cover, -0.1], [-1, -0.1]]))
    values = pair.evaluate(pair.positions)
    D = values["D"][1]
    exact = np.array([cover - cover**2 / 2, cover**2 / 2])
    # the middle of the cover is 1 - cover/2 in xi: 1 - xi^2 keeps 1e-16 / cover
    assert np.abs(np.diag(D) / exact - 1).max() < 4e-16 / cover
    M = values["M"][pair.offsets[1] :].sum(axis=0)
    assert np.abs(M.sum(axis=1) - np.diag(D)).max() < 1e-15 * cover + 1e-17


@pytest.mark.parametrize("left", [ONLY_FIRST, ONLY_SECOND])
def test_neighbour_takes_over_the_weight_of_a_node_without_multiplier(left):
    x, m = wavy(0)
    pair = Curves(x, m, left=np.full(len(x) - 1, left))
    values = pair.evaluate(pair.positions)
    dropped = 1 if left == ONLY_FIRST else 0
    assert np.abs(values["D"][:, dropped]).max() < 1e-17
    assert np.abs(values["D"][:, 1 - dropped] - values["cover"]).max() < 1e-15


@pytest.mark.parametrize("cover", [*COVERS, "two pieces"])
@pytest.mark.parametrize(
    "rule, kind, gap_weights",
    [
        *product(["segments", "elements"], BASES, GAP_WEIGHTS),
        ("nodes", STANDARD, BY_BASIS),
    ],
)
@pytest.mark.parametrize("left", [BOTH, ONLY_FIRST, ONLY_SECOND])
def test_values_and_derivatives_are_those_of_the_closed_form(cover, rule, kind, gap_weights, left):
    points = 9 if rule == "elements" else 5
    more = {"integration": rule, "points": points, "gap_weights": gap_weights}
    pair = curves(cover, basis=kind, **more)
    pair.left[:] = left
    values, exact = pair.evaluate(pair.positions), pair.exact(pair.positions)
    for name in exact:
        size = np.abs(exact[name]).max(initial=0.0)
        assert np.abs(values[name] - exact[name]).max(initial=0.0) <= 1e-13 * size, name
    if gap_weights == BY_BASIS or (cover == "one end" and left == BOTH):
        found, exact = pair.assemble(values), pair.exact_derivatives(pair.exact)
        for name, array in exact.items():
            error = np.abs(found[name] - array).max(initial=0.0)
            assert error <= 1e-12 * np.abs(array).max(initial=0.0), name


@pytest.mark.parametrize("cover", [*COVERS, "two pieces"])
@pytest.mark.parametrize("kind, weighting", product(BASES, [projection.OPPOSITE, projection.UNIT]))
@pytest.mark.parametrize(
    "left, gap_weights",
    [
        *product([BOTH], GAP_WEIGHTS),
        *product([ONLY_FIRST, ONLY_SECOND], [BY_COVER]),
    ],
)
def test_all_derivatives_equal_the_complex_step(cover, kind, weighting, left, gap_weights):
    pair = curves(cover, basis=kind, weighting=weighting, gap_weights=gap_weights)
    pair.left[:] = left
    found, exact = pair.assemble(pair.evaluate(pair.positions)), pair.exact_derivatives()
    if kind == DUAL and left == BOTH:  # the off-diagonal is zero by construction
        exact["D"][:, [0, 1], [1, 0]] = 0.0
    for name, array in exact.items():
        error = np.abs(found[name] - array).max()
        assert error < 1e-12 * np.abs(array).max(), name


@pytest.mark.parametrize("seed", range(3))
def test_rigid_motion_leaves_gap_and_matrices(seed):
    pair = Curves(*wavy(seed, start=0.1))
    turn = np.array([[0.28, -0.96], [0.96, 0.28]])
    before = pair.evaluate(pair.positions)
    after = pair.evaluate(pair.positions @ turn.T + [3.0, -2.0])
    for name in ("D", "M", "g"):
        assert np.abs(after[name] - before[name]).max() < 1e-14


def test_five_points_integrate_the_rational_integrand_to_round_off():
    few, many = (Curves(*wavy(0), points=points) for points in (5, 12))
    few, many = few.evaluate(few.positions), many.evaluate(many.positions)
    assert np.abs(few["M"] - many["M"]).max() < 1e-12
    assert np.abs(few["g"] - many["g"]).max() < 1e-13
