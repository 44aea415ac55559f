# SPDX-License-Identifier: MIT
"""Derivatives of the integrals in space equal complex steps of their values, for all facets."""

import numpy as np
import pytest
from derivatives import complex_step
from surfaces_in_space import (
    KINDS,
    find,
    grid,
    integrate,
    linearize,
    places_of,
    reversed_facets,
    rotation,
    rule_of,
)

from fenics_mortar.kernels.space.clipping import clip, clipping_work
from fenics_mortar.kernels.space.linearize import linearize_facets
from fenics_mortar.kernels.space.normals import flatten, set_plane

NAMES = ("weight", "gap", "X", "Y", "vector")


def patch(kind, rng, warp, size=1.0):
    """One facet of each kind as a patch that is not flat, seen from above; its nodes."""
    cells = 1
    flat, facets = grid(kind, cells)
    facet = facets[0]
    points = flat[facet] + 0.08 * rng.uniform(-1, 1, (len(facet), 2))
    heights = warp * rng.uniform(-1, 1, len(facet))
    return size * np.column_stack([points - 0.5, heights])


def scene(kind, master_kind, seed, warp=0.06):
    """A slave facet and two master facets above it, which overlap it in part, in any direction."""
    rng = np.random.default_rng(seed)
    Q = rotation(rng)
    x, masters, m = patch(kind, rng, warp), [], []
    for _ in range(2):
        y = patch(master_kind, rng, warp, rng.uniform(0.5, 1.6))
        turn, shift = rng.uniform(0, 2 * np.pi), rng.uniform(-0.6, 0.6, 2)
        c, s = np.cos(turn), np.sin(turn)
        y = y @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + [*shift, 0.2]
        m.append(y)
        masters.append(reversed_facets(np.arange(len(y))[None])[0] + len(y) * len(masters))
    n = np.tile([0.0, 0, 1], (len(x), 1)) + 0.3 * rng.uniform(-1, 1, x.shape)
    geometry = x @ Q.T, n @ Q.T, np.concatenate(m) @ Q.T
    return geometry, np.arange(len(x))[None], np.array(masters), np.array([0, 2])


def random_coefficients(rng, facets, K, masters, components=(3, 3)):
    """Coefficients with this many components of multipliers, and of the fields q, v and y."""
    of_force, of_vector = components
    shapes = (K, K), (K,), (K, of_force), (K, of_force), (K, of_vector), (K, of_vector)
    of_facets = (rng.uniform(-1, 1, (facets, *shape)) for shape in shapes)
    return *of_facets, rng.uniform(-1, 1, (masters, of_vector))


def combined(values, coefficients, masters, places, most):
    """The integrals that ``linearize_facets`` differentiates, of one facet."""
    De, Me, G, B = (values[0][0], values[1][0], values[2][0], values[3])
    A, gamma, s, c, q, v = (a[0] for a in coefficients[:6])
    Y, By = np.zeros((most, c.shape[1]), De.dtype), np.zeros(v.shape, De.dtype)
    for pair in range(len(masters)):
        np.add.at(Y, places[pair], -B[pair].T @ c)
        By += B[pair] @ coefficients[6][masters[pair]]
    return {
        "weight": De,
        "gap": De * gamma + A @ (G - Me @ gamma),
        "X": (De[:, None] * s - Me @ c).ravel(),
        "Y": Y.ravel(),
        "vector": De[:, None] * q + A @ (Me @ v - By),
    }


def steps(geometry, slave, masters, offsets, coefficients, rule=None):
    """Complex steps of all results in the columns of ``linearize_facets``."""
    _, places, most = linearize(geometry, slave, masters, offsets, coefficients, rule)
    x, n, m = geometry

    def evaluate(x, n, moved):
        kind = np.result_type(x, n, moved)
        moved_geometry = x.astype(kind), n.astype(kind), moved.astype(kind)
        found = integrate(moved_geometry, slave, masters, offsets, rule)
        results = combined(found, coefficients, masters, places, most)
        return np.concatenate([results[name].ravel() for name in NAMES])

    by_x = complex_step(lambda y: evaluate(y, n, m), x)[:, slave[0]]
    by_n = complex_step(lambda y: evaluate(x, y, m), n)[:, slave[0]]
    by_m = complex_step(lambda y: evaluate(x, n, y), m)
    merged = np.zeros((len(by_x), most, 3))
    for pair, nodes in enumerate(masters):
        merged[:, places[pair]] = by_m[:, nodes]
    rows = len(by_x)
    by_all = np.concatenate([by_x.reshape(rows, -1), merged.reshape(rows, -1)], axis=1)
    K, shapes, at = slave.shape[1], {}, 0
    a, b = (coefficients[i].shape[2] for i in (3, 5))
    for name, size in zip(NAMES, (K, K, a * K, a * most, b * K)):
        block = by_all[at : at + size]
        if name == "gap":
            block = np.concatenate([block, by_n.reshape(rows, -1)[at : at + size]], axis=1)
        else:
            assert np.abs(by_n[at : at + size]).max() == 0.0
        shapes[name], at = block, at + size
    return shapes


def largest_error(geometry, slave, masters, offsets, seed=0, components=(3, 3)):
    """Largest relative difference of all results and the complex step of the integrals."""
    rng, counts = np.random.default_rng(seed), (slave.shape[1], len(geometry[2]))
    coefficients = random_coefficients(rng, 1, *counts, components)
    out, _, _ = linearize(geometry, slave, masters, offsets, coefficients)
    exact, errors = steps(geometry, slave, masters, offsets, coefficients), []
    for name, found in zip(NAMES, out):
        found = found[0].reshape(exact[name].shape)
        errors.append(np.abs(found - exact[name]).max() / np.abs(exact[name]).max())
    return max(errors)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("master_kind", KINDS)
def test_derivatives_equal_the_complex_step(kind, master_kind):
    for seed in range(4):
        scene_of_seed = scene(kind, master_kind, seed)
        values = integrate(*scene_of_seed)
        assert values[3].any(axis=(1, 2)).any() and not values[5].any()
        assert largest_error(*scene_of_seed, seed) < 1e-12
        assert largest_error(*scene_of_seed, seed, (1, 2)) < 1e-12


def stars(sides, others, rng):
    """Two facets with corners on a circle, which turn and move against each other."""
    x, y = (
        np.stack([np.cos(angles), np.sin(angles), 0.05 * rng.uniform(-1, 1, n)], axis=1)
        for n in (sides, others)
        for angles in [2 * np.pi * (np.arange(n) + 0.3 * rng.uniform(0, 1, n)) / n]
    )
    turn, shift = rng.uniform(0, 2 * np.pi), rng.uniform(0, 1) ** 2 * rng.uniform(-1, 1, 2)
    c, s = np.cos(turn), np.sin(turn)
    m = y @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [*shift, 0.1]
    n = np.tile([0.0, 0, 1], (sides, 1)) + 0.3 * rng.uniform(-1, 1, x.shape)
    masters = reversed_facets(np.arange(others)[None])
    return (x, n, m), np.arange(sides)[None], masters, np.array([0, 1])


def vertices(x, m, slave, master):
    """Number of vertices of the common part of two linear facets."""
    frame, images = np.empty((4, 3)), np.empty((len(slave) + len(master), 2))
    rows, heights = np.arange(len(images)), np.empty(len(images))
    area = set_plane(x, slave, rows[: len(slave)], frame)
    flatten(x, slave, frame, 0, images, heights)
    flatten(m, master, frame, len(slave), images, heights)
    return clip(images, rows[: len(slave)], rows[len(slave) :], area, clipping_work(12))


@pytest.mark.parametrize("kind", [3, 4])
@pytest.mark.parametrize("master_kind", [3, 4])
def test_derivatives_are_exact_for_any_number_of_vertices(kind, master_kind):
    rng, counts = np.random.default_rng(0), {}
    for _ in range(200):
        geometry, slave, masters, offsets = stars(kind, master_kind, rng)
        count = vertices(geometry[0], geometry[2], slave[0], masters[0])
        if counts.get(count, 0) < 3 and count:
            counts[count] = counts.get(count, 0) + 1
            assert largest_error(geometry, slave, masters, offsets) < 1e-12
    assert set(counts) == set(range(3, kind + master_kind + 1))


@pytest.mark.parametrize("kind", [4, 6])
def test_masters_with_common_nodes_share_columns(kind):
    rng = np.random.default_rng(2)
    x = patch(kind, rng, 0.05)
    flat, master = grid(4, 2)
    m = np.column_stack([1.2 * (flat - 0.48), 0.1 + 0.05 * rng.uniform(-1, 1, len(flat))])
    slave, n = np.arange(kind)[None], np.tile([0.1, -0.2, 1], (kind, 1))
    master = reversed_facets(master)
    offsets, found = find(x, slave, m, master)
    masters = master[found]
    assert (len(masters), places_of(masters, offsets)[1]) == ((4, 9) if kind == 4 else (3, 8))
    assert largest_error((x, n, m), slave, masters, offsets) < 1e-12


@pytest.mark.parametrize("left_out", range(5))
def test_results_that_are_not_wanted_are_left_out(left_out):
    geometry, slave, masters, offsets = scene(9, 6, 0)
    coefficients = random_coefficients(np.random.default_rng(0), 1, 9, len(geometry[2]))
    everything, places, _ = linearize(geometry, slave, masters, offsets, coefficients)
    rule = rule_of(9)
    some = [
        None if i == left_out else np.full_like(out, np.nan) for i, out in enumerate(everything)
    ]
    one = [np.full_like(out, np.nan) if i == left_out else None for i, out in enumerate(everything)]
    for out in (some, one):
        needed = (*coefficients[:6], coefficients[6][masters])
        needed = needed if out is some or left_out else (None,) * 7
        linearize_facets(geometry, slave, masters, offsets, places, rule, needed, tuple(out))
        for found, exact in zip(out, everything):
            assert found is None or (found == exact).all()


def test_facets_without_pairs_have_no_derivatives():
    geometry, slave, masters, _ = scene(4, 4, 0)
    both = np.concatenate([slave, slave])
    coefficients = random_coefficients(np.random.default_rng(0), 2, 4, len(geometry[2]))
    out, _, _ = linearize(geometry, both, masters, np.array([0, 0, 2]), coefficients)
    assert all(not found[0].any() and found[1].any() for found in out)
