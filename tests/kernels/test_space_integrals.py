# SPDX-License-Identifier: MIT
"""Integrals over pairs of facets in space: patches of all kinds, invariance, covers, folds."""

import numpy as np
import pytest
from surfaces_in_space import (
    KINDS,
    find,
    grid,
    integrate,
    linearize,
    move_corners,
    normals,
    renumbered,
    reversed_facets,
    rotation,
)

from fenics_mortar.kernels.space.integrals import listed_points
from fenics_mortar.kernels.space.shapes import triangle_rule

GAP = 0.03


def flat_pair(kind, master_kind, jiggle=0.06, cells=(3, 4), seed=0, grow=1.1, shift=-0.05):
    """Slave and master meshes on planes with a gap, in any direction; the rotation."""
    rng = np.random.default_rng(seed)
    (a, slave), (b, master) = grid(kind, cells[0]), grid(master_kind, cells[1])
    a = move_corners(a, slave, jiggle * rng.uniform(-1, 1, a.shape))
    b = move_corners(grow * b + shift, master, jiggle * rng.uniform(-1, 1, b.shape))
    if grow > 1.0:  # the master is larger
        b = 1.1 * (b - 0.5) + 0.5
    Q = rotation(rng)
    x = np.column_stack([a, np.zeros(len(a))]) @ Q.T
    m = np.column_stack([b, np.full(len(b), GAP)]) @ Q.T
    return (x, np.tile(Q[:, 2], (len(x), 1)), m), slave, reversed_facets(master), Q


def defects(geometry, slave, master, Q, rule=None):
    """Largest errors of balance, of tangential linear fields and of the gap; values, pairs."""
    x, _, m = geometry
    offsets, found = find(x, slave, m, master)
    values = integrate(geometry, slave, master[found], offsets, rule)
    De, Me, G, B = values[:4]
    sums, field = np.zeros_like(De), np.zeros((*De.shape, 3))
    for e in range(len(slave)):
        for pair in range(offsets[e], offsets[e + 1]):
            sums[e] += B[pair].sum(axis=1)
            field[e] += B[pair] @ m[master[found[pair]]]
    tangential = (Me @ x[slave] - field) @ Q[:, :2]
    errors = np.abs(sums - De).max(), np.abs(tangential).max(), np.abs(G - GAP * De).max()
    return errors, values, (offsets, found)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("master_kind", KINDS)
def test_patch_of_any_two_kinds_of_facets_passes(kind, master_kind):
    for seed in range(3):
        pair = flat_pair(kind, master_kind, seed=seed)
        errors, values, _ = defects(*pair)
        assert max(errors) < 1e-15
        assert values[4].all() and not values[5].any()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("master_kind", KINDS)
def test_listed_points_have_the_integrals_of_both_sides(kind, master_kind):
    """Areas by the weights of each reference facet, and the products of shape functions."""
    (x, n, m), slave, master, _ = flat_pair(kind, master_kind)
    offsets, found = find(x, slave, m, master)
    on_master, rule = master[found], triangle_rule(7)
    De, _, _, B = integrate((x, n, m), slave, on_master, offsets, rule)[:4]
    pair, (weights, N, L) = listed_points((x, m), slave, on_master, offsets, rule)
    facet = np.repeat(np.arange(len(slave)), np.diff(offsets))[pair]
    sides = zip(weights.T, (N, L), (x[slave][facet], m[on_master][pair]))
    for w, shapes, nodes in sides:
        a, b = (np.einsum("tk,tkc->tc", shapes[:, d], nodes) for d in (1, 2))
        area = w * np.linalg.norm(np.cross(a, b), axis=1)
        sums, products = np.zeros_like(De), np.zeros_like(B)
        np.add.at(sums, facet, area[:, None] * N[:, 0])
        np.add.at(products, pair, area[:, None, None] * N[:, 0, :, None] * L[:, 0, None])
        assert np.abs(sums - De).max() < 1e-14 and np.abs(products - B).max() < 1e-14


def matrices(x, slave, m, master, points):
    """D, M and the integrals of the gap by the numbers of the nodes."""
    offsets, found = find(x, slave, m, master)
    pairs, rule = master[found], triangle_rule(points)
    _, Me, G, B = integrate((x, normals(x, slave)[0], m), slave, pairs, offsets, rule)[:4]
    owner = np.repeat(np.arange(len(slave)), np.diff(offsets))
    D, M, gap = np.zeros((len(x), len(x))), np.zeros((len(x), len(m))), np.zeros(len(x))
    np.add.at(D, (slave[:, :, None], slave[:, None]), Me)
    np.add.at(M, (slave[owner][:, :, None], pairs[:, None]), B)
    np.add.at(gap, slave, G)
    return D, M, gap


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("master_kind", KINDS)
@pytest.mark.parametrize("jiggle", [0.0, 0.06])
def test_integrals_do_not_depend_on_the_numbers_of_nodes(kind, master_kind, jiggle):
    """On curved surfaces, and on facets that are no parallelograms, the rule has an error."""
    (x, _, m), slave, master, Q = flat_pair(kind, master_kind, jiggle)
    rng = np.random.default_rng(5)
    for nodes in (x, m):
        nodes -= 0.3 * np.outer(((nodes @ Q - 0.5)[:, :2] ** 2).sum(axis=1), Q[:, 2])
    expected = matrices(x, slave, m, master, 7)
    others = matrices(x, renumbered(slave, rng), m, renumbered(master, rng), 7)
    exact = matrices(x, slave, m, master, 64)
    for one, other, limit in zip(expected, others, exact):
        assert np.abs(one - other).max() < 1e-14 * np.abs(limit).max()
        assert np.abs(one - limit).max() < 2e-3 * np.abs(limit).max()


@pytest.mark.parametrize("points", [3, 6, 12])
def test_patch_passes_with_any_rule(points):
    errors, _, _ = defects(*flat_pair(4, 9), triangle_rule(points))
    assert max(errors) < 1e-15


@pytest.mark.parametrize("kind", [6, 9])
@pytest.mark.parametrize("master_kind", KINDS)
def test_balance_and_linear_fields_of_facets_with_curved_edges_in_the_plane(kind, master_kind):
    (x, n, m), slave, master, Q = flat_pair(kind, master_kind)
    x = x + 0.02 * np.random.default_rng(3).uniform(-1, 1, (len(x), 2)) @ Q[:, :2].T
    errors, values, _ = defects((x, n, m), slave, master, Q)
    assert max(errors) < 1e-15 and not values[5].any()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("shift", [0.0, 1e-16, -1e-16, 1e-13, 1e-9])
@pytest.mark.parametrize("cells", [(4, 4), (4, 8), (8, 4)])
def test_coincident_and_hanging_meshes_are_covered_once(kind, shift, cells):
    for seed in range(3):
        pair = flat_pair(kind, kind, 0.0, cells, seed, grow=1.0, shift=shift)
        errors, values, _ = defects(*pair)
        assert max(errors) < 1e-15
        # slivers as wide as the shift, along at most 16 lines, may be left out
        assert abs(values[0].sum() - 1.0) < 1e-13 + 20 * abs(shift)
        assert values[4].all()


@pytest.mark.parametrize("kind", [3, 4])
def test_coincident_facets_have_one_pair_each(kind):
    (x, _, m), slave, master, _ = flat_pair(kind, kind, 0.0, (4, 4), grow=1.0, shift=0.0)
    offsets, found = find(x, slave, m, master)
    assert (found == np.arange(len(slave))).all() and (np.diff(offsets) == 1).all()


@pytest.mark.parametrize("kind", KINDS)
def test_facets_without_partner_on_a_part_are_not_complete(kind):
    (x, n, m), slave, master, Q = flat_pair(kind, 4, 0.0, (4, 4), grow=1.0, shift=0.0)
    m = m + 0.1 * Q[:, 0]
    _, values, _ = defects((x, n, m), slave, master, Q)
    assert abs(values[0].sum() - 0.9) < 1e-13
    first = (x[slave] @ Q[:, 0]).min(axis=1) < 0.1
    assert (values[4] == ~first).all()
    # without any pair
    none = integrate((x, n, m), slave, master[:0], np.zeros(len(slave) + 1, np.int64))
    assert not none[0].any() and not none[4].any()


def curved_pair(kind, master_kind, seed=0):
    (x, n, m), slave, master, _ = flat_pair(kind, master_kind, seed=seed)
    rng = np.random.default_rng(seed + 10)
    x, m = x + 0.01 * rng.uniform(-1, 1, x.shape), m + 0.01 * rng.uniform(-1, 1, m.shape)
    n = n + 0.1 * rng.uniform(-1, 1, n.shape)
    return (x, n, m), slave, master


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("master_kind", KINDS)
def test_rigid_motions_change_nothing(kind, master_kind):
    (x, n, m), slave, master = curved_pair(kind, master_kind)
    rng = np.random.default_rng(1)
    Q, shift = rotation(rng), rng.uniform(-1, 1, 3)
    offsets, found = find(x, slave, m, master)
    moved = x @ Q.T + shift, n @ Q.T, m @ Q.T + shift
    others = find(moved[0], slave, moved[2], master)
    assert (others[0] == offsets).all() and (others[1] == found).all()
    values = integrate((x, n, m), slave, master[found], offsets)
    turned = integrate(moved, slave, master[found], offsets)
    for one, other in zip(values[:4], turned[:4]):
        assert np.abs(one - other).max() < 1e-13 * np.abs(one).max()
    # balance does not need planes
    De, B = values[0], values[3]
    sums = np.add.reduceat(B.sum(axis=2), offsets[:-1])
    assert np.abs(sums - De).max() < 1e-15


def test_derivatives_turn_with_the_bodies_and_vanish_for_translations():
    (x, n, m), slave, master = curved_pair(4, 9)
    rng = np.random.default_rng(1)
    Q, shift, K = rotation(rng), rng.uniform(-1, 1, 3), 4
    offsets, found = find(x, slave, m, master)
    shapes = (K, K), (K,), (K, 3), (K, 3), (K, 3), (K, 3)
    A, gamma, *vectors = (rng.uniform(-1, 1, (len(slave), *shape)) for shape in shapes)
    masters = master[found]
    given = (A, gamma, *vectors)
    out, _, _ = linearize((x, n, m), slave, masters, offsets, given)
    moved = x @ Q.T + shift, n @ Q.T, m @ Q.T + shift
    turned, _, _ = linearize(moved, slave, masters, offsets, given)
    for one, other, of_normals in zip(out[:2], turned[:2], (0, 4)):
        one, other = (a.reshape(*a.shape[:2], -1, 3) for a in (one, other))
        assert np.abs(one @ Q.T - other).max() < 1e-12 * np.abs(one).max()
        sums = one[:, :, : one.shape[2] - of_normals].sum(axis=2)
        assert np.abs(sums).max() < 1e-13 * np.abs(one).max()


@pytest.mark.parametrize("kind", [6, 9])
def test_curved_slave_facets_that_are_folded_are_named(kind):
    (x, n, m), slave, master, _ = flat_pair(kind, 4, 0.0, (2, 2), grow=1.0, shift=0.0)
    before = defects((x, n, m), slave, master, np.eye(3))[1]
    middle, end = (3, 1) if kind == 6 else (4, 1)
    x[slave[1, middle]] += 0.6 * (x[slave[1, end]] - x[slave[1, middle]])
    offsets, found = find(x, slave, m, master)
    values = integrate((x, n, m), slave, master[found], offsets)
    assert values[5][1] and not values[5].all() and not before[5].any()


@pytest.mark.parametrize("of_slave", [True, False])
def test_quadrilaterals_that_are_not_convex_are_named(of_slave):
    (x, n, m), slave, master, _ = flat_pair(4, 4, 0.0, (1, 1), grow=1.0, shift=0.0)
    positions, facet = (x, slave[0]) if of_slave else (m, master[0])
    positions[facet[2]] += 0.7 * (positions[facet[0]] - positions[facet[2]])
    offsets, found = find(x, slave, m, master)
    # the search leaves them to the integration
    assert len(found) == 1
    assert integrate((x, n, m), slave, master[found], offsets)[5].all()
