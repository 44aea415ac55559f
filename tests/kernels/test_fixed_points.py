# SPDX-License-Identifier: MIT
"""Points fixed on the slave facets: the nodes, or those of a Gauss rule per facet."""

from itertools import product

import numpy as np
import pytest
from closed_form import BOTH, ONLY_SECOND
from curves import CurvedCurves, Curves, wavy, wavy_curved
from test_mortar_kernels import COVERS, curves

from fenics_mortar.kernels import projection
from fenics_mortar.kernels.facets import DUAL, STANDARD

RULES = [("elements", 2), ("elements", 5), ("nodes", None)]


def options(integration, points, kind=DUAL):
    """Options of the curves; with points at the nodes all bases are equal."""
    if integration == "nodes":
        return {"integration": "nodes", "basis": STANDARD}
    return {"integration": integration, "points": points, "basis": kind}


def make(cover, degree, **more):
    """Curves of straight or of curved facets."""
    if degree == 1:
        pair = curves(cover, **more)
    else:
        start, stop = COVERS[cover]
        nodes = wavy_curved(1, slaves=4, masters=6, start=start, stop=stop)
        pair = CurvedCurves(*nodes, **more)
    assert len(pair.masters)
    return pair


# cover, degree, integration, points; two of five points lie on the island, no node in the parts
CASES = [
    *((cover, 1, *rule) for cover, rule in product(["full", "one end", "both ends"], RULES)),
    ("island", 1, "elements", 9),
    ("two pieces", 1, "elements", 5),
    *((cover, 2, "elements", count) for cover, count in product(["full", "one end"], [3, 6])),
    ("both ends", 2, "elements", 7),
    ("one end", 2, "nodes", None),
    ("both ends", 2, "nodes", None),
]


def flat(places, height):
    return np.stack([np.asarray(places, float), np.full(len(places), float(height))], axis=1)


def by_sums(pair):
    """D, M and g of each facet from its points, with the basis from the mass matrix on them."""
    s, size = pair.segments, pair.slave.shape[1]
    n, _ = pair.normals(pair.x)
    y, (N, N_m) = np.empty(6 * size), np.empty((2, 3, size))
    D, M = np.zeros((len(pair.slave), size, size)), np.zeros((len(s.master), size, size))
    g = np.zeros((len(pair.slave), size))
    for e in range(len(pair.slave)):
        points = []
        for i in range(s.offsets[e], s.offsets[e + 1]):
            c, h = s.ends[i].mean(), np.diff(s.ends[i])[0] / 2
            for p in range(*s.spans[i]):
                projection.gather(pair.x, n, pair.m, s.slave[i], s.master[i], y)
                eta, alpha = projection.slave_to_master(y, c + h * s.points[p], N, N_m)
                assert abs(eta) < 1 + 1e-12
                J = np.hypot(*projection.interpolate(y, 0, N, 1))
                gap = alpha * np.hypot(*projection.interpolate(y, 1, N, 0))
                points.append((i, s.weights[p] * h * J, N[0].copy(), N_m[0].copy(), gap))
        if not points:
            continue
        mass = sum(w * np.outer(N_p, N_p) for _, w, N_p, _, _ in points)
        d = sum(w * N_p for _, w, N_p, _, _ in points)
        # where points are nodes the mass matrix is diagonal, singular beyond the cover
        A = np.eye(size) if pair.integration == "nodes" else np.diag(d) @ np.linalg.inv(mass)
        D[e] = A @ mass
        for i, w, N_p, L, gap in points:
            M[i] += w * np.outer(A @ N_p, L)
            g[e] += w * gap * (A @ N_p)
    return {"D": D, "M": M, "g": g}


@pytest.mark.parametrize("cover, degree, integration, points", CASES)
def test_basis_is_biorthogonal_on_the_quadrature_points(cover, degree, integration, points):
    pair = make(cover, degree, **options(integration, points))
    values, exact = pair.evaluate(pair.positions), by_sums(pair)
    for name, array in exact.items():
        # the inverse of a mass matrix of few close points is less accurate
        assert np.abs(values[name] - array).max() < 1e-12, name
    off_diagonal = values["D"][:, ~np.eye(degree + 1, dtype=bool)]
    # for three nodes this is rounding, which a problem removes
    assert np.abs(off_diagonal).max() <= (1e-16 if degree == 2 else 0.0)


@pytest.mark.parametrize("cover, degree, integration, points", CASES)
@pytest.mark.parametrize("kind", [DUAL, STANDARD])
def test_rows_of_D_and_M_sum_to_the_same(cover, degree, integration, points, kind):
    pair = make(cover, degree, **options(integration, points, kind))
    values = pair.evaluate(pair.positions)
    of_M = np.zeros(values["g"].shape)
    owner = np.repeat(np.arange(len(pair.slave)), np.diff(pair.offsets))
    np.add.at(of_M, owner, values["M"].sum(axis=2))
    assert np.abs(values["D"].sum(axis=2) - of_M).max() < 1e-15


@pytest.mark.parametrize("cover, degree, integration, points", CASES)
@pytest.mark.parametrize("kind", [DUAL, STANDARD])
@pytest.mark.parametrize("left", [BOTH, ONLY_SECOND])
def test_all_derivatives_equal_the_complex_step(cover, degree, integration, points, kind, left):
    pair = make(cover, degree, **options(integration, points, kind))
    if degree == 1:
        pair.left[:] = left
    elif left != BOTH:
        pair.weights[:, :, 0] = np.eye(3)[1]
    found, exact = pair.assemble(pair.evaluate(pair.positions)), pair.exact_derivatives()
    if degree == 1 and kind == DUAL and left == BOTH:
        exact["D"][:, [0, 1], [1, 0]] = 0.0  # by construction
    for name, array in exact.items():
        error = np.abs(found[name] - array).max()
        assert error < 1e-12 * np.abs(array).max(), name


def test_points_at_the_nodes_are_node_to_segment_contact_by_hand():
    pair = Curves(flat([0, 2, 4], 1), flat([5, 1, -1], 0), **options("nodes", None))
    values = pair.evaluate(pair.positions)
    assert np.allclose(values["D"], [np.eye(2), np.eye(2)], atol=1e-15)
    assert np.allclose(values["g"], np.ones((2, 2)), atol=1e-15)
    # node 0 lies in the middle of the facet from 1 to -1, node 2 at 1/4, node 4 at 3/4 of [1, 5]
    assert np.allclose(values["M"][0], [[1 / 2, 1 / 2], [0, 0]], atol=1e-15)
    assert np.allclose(values["M"][1], [[0, 0], [1 / 4, 3 / 4]], atol=1e-15)
    assert np.allclose(values["M"][2], [[1 / 4, 3 / 4], [3 / 4, 1 / 4]], atol=1e-15)


def test_only_covered_nodes_have_weights():
    pair = Curves(flat([0, 2], 1), flat([5, 1], 0), **options("nodes", None))
    values = pair.evaluate(pair.positions)
    assert np.allclose(values["D"][0], [[0, 0], [0, 1]], atol=1e-15)
    assert np.allclose(values["cover"][0], [0, 1], atol=1e-15)
    assert np.allclose(values["g"][0], [0, 1], atol=1e-15)


@pytest.mark.parametrize("covered, counts", [(1, False), (2, True), (3, True)])
def test_facet_with_fewer_points_than_nodes_counts_as_uncovered(covered, counts):
    xi, w = np.polynomial.legendre.leggauss(3)
    edge = (1.0, *(xi[:0:-1] + xi[1::-1]) / 2, -1.0)[covered]  # master from there to the end
    pair = Curves(flat([-1, 1], 1), flat([2, edge], 0), **options("elements", 3))
    values = pair.evaluate(pair.positions)
    assert len(pair.masters) == counts
    of_points = w[-covered:] @ np.stack([1 - xi[-covered:], 1 + xi[-covered:]], axis=1) / 2
    assert np.allclose(values["cover"][0], of_points if counts else 0.0, atol=1e-15)
    assert np.allclose(values["D"][0], np.diag(values["cover"][0]), atol=1e-15)


@pytest.mark.parametrize("shift", [0.0, 1e-16, -1e-16, 1e-13, -1e-13])
@pytest.mark.parametrize("angle", np.linspace(0.0, 6.0, 13))
def test_partners_of_coinciding_nodes_are_independent_of_rounding(shift, angle):
    """At the ends of the curve, the partner is the master facet that ends there."""
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    x, m = flat(np.arange(6), 0), flat(np.arange(5, -1, -1) + shift, -0.1)
    pair = Curves(x @ turn, m @ turn, **options("nodes", None))
    partners = [pair.masters[i:j].tolist() for i, j in zip(pair.offsets, pair.offsets[1:])]
    # facet k from 5 - k to 4 - k; node 5 starts the curve
    assert partners == [[4, 3], [3, 2], [2, 1], [1, 0], [0]]
    values = pair.evaluate(pair.positions)
    assert np.allclose(values["D"], np.eye(2) / 2, atol=1e-15)
    assert np.allclose(values["g"], 0.05, atol=1e-14)


def test_nearest_of_two_walls_is_taken_point_by_point():
    """A bump in front of a wall: the points on the bump lie between two runs on the wall."""
    x = flat([0, 3], 0)
    m = np.concatenate([flat([4, -1], -0.5), [[-9, -9], [9, -9]], flat([2, 1], -0.2)])
    pair = Curves(x, m, **options("elements", 9))
    assert pair.masters.tolist() == [0, 4, 0]
    xi = np.polynomial.legendre.leggauss(9)[0]
    assert np.diff(pair.segments.spans, axis=1)[1, 0] == (np.abs(xi) < 1 / 3).sum()
    values = pair.evaluate(pair.positions)
    assert np.abs(values["D"][0].sum(axis=1) - values["M"].sum(axis=(0, 2))).max() < 1e-15


def test_of_partners_at_equal_distance_the_first_is_taken():
    wall = flat([4, -1], -0.5)
    pair = Curves(
        flat([0, 3], 0), np.concatenate([wall, [[-9, -9], [9, -9]], wall]), **options("elements", 4)
    )
    assert pair.masters.tolist() == [0]


@pytest.mark.parametrize("integration, points", RULES)
def test_no_partners_beyond_the_radius_or_turned_away(integration, points):
    more = options(integration, points)
    x, facing = flat([0, 1], 0), flat([1.2, -0.2], -0.1)
    assert len(Curves(x, facing, **more).masters) == 1
    assert len(Curves(x, facing, radius=0.09, **more).masters) == 0
    assert len(Curves(x, facing[::-1].copy(), **more).masters) == 0
    steep = np.array([[2.0, 5.0], [-1.0, -40.0]])
    assert len(Curves(x, steep, **more).masters) == 0


@pytest.mark.parametrize("degree", [1, 2])
def test_many_points_converge_to_segments(degree):
    """Points resolve kinks of the master only on average, with at least first order."""
    kind, build = (Curves, wavy) if degree == 1 else (CurvedCurves, wavy_curved)
    exact = kind(*build(2))
    exact = exact.evaluate(exact.positions)["g"]
    errors = []
    for count in (3, 100):
        pair = kind(*build(2), **options("elements", count))
        errors.append(np.abs(pair.evaluate(pair.positions)["g"] - exact).max())
    assert errors[1] < errors[0] / 30 and errors[1] < 1e-3 * np.abs(exact).max()
