# SPDX-License-Identifier: MIT
"""Common parts of two facets: exact areas, all numbers of vertices, slivers and parallel edges."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from surfaces_in_space import integrate, linearize, rotation

from fenics_mortar.kernels.space.clipping import clip, clipping_work, place_vertices, signed_area

SHIFTS = [0.0, 1e-16, -1e-16, 1e-13, -1e-13, 1e-12, -3e-12, 1e-11, 1e-9, -1e-9, 1e-6]
SQUARE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def clipped(slave, master):
    """Vertices and area of the common part of two convex polygons, counter-clockwise both."""
    images, work = np.concatenate([slave, master[::-1]]), clipping_work(12)
    rows = np.arange(len(images))
    area = signed_area(slave, len(slave))
    count = clip(images, rows[: len(slave)], rows[len(slave) :], area, work)
    V, shares = np.empty((12, 2)), np.empty((12, 2))
    place_vertices(images, work[0], count, V, shares)
    assert np.abs(V[:count] - work[0][:count, :2]).max(initial=0.0) < 1e-13
    return V[:count], signed_area(V, count)


def common_hull(one, other):
    """The same, as the convex hull of all crossings of edges and of the corners inside."""
    points = []
    for p, q in ((one, other), (other, one)):
        edges = np.roll(q, -1, axis=0) - q
        inside = [np.cross(edges, corner - q).min() > 0 for corner in p]
        points += list(p[inside])
    for a, b in zip(one, np.roll(one, -1, axis=0)):
        for c, d in zip(other, np.roll(other, -1, axis=0)):
            s, r = np.linalg.solve(np.stack([b - a, c - d], axis=1), c - a)
            if 0 < s < 1 and 0 < r < 1:
                points.append(a + s * (b - a))
    if len(points) < 3:
        return 0, 0.0
    hull = ConvexHull(np.array(points))
    return len(hull.vertices), hull.volume


def polygon(rng, sides):
    angles = 2 * np.pi * (np.arange(sides) + 0.6 * rng.uniform(0, 1, sides)) / sides
    radius = rng.uniform(0.4, 1.2) * rng.uniform(0.9, 1.1, sides)
    return radius[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def regular(rng, sides, turn):
    angles = 2 * np.pi * np.arange(sides) / sides + turn
    corners = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return corners + 0.05 * rng.uniform(-1, 1, corners.shape)


@pytest.mark.parametrize("sides", [3, 4])
@pytest.mark.parametrize("others", [3, 4])
def test_common_parts_equal_the_hulls_of_crossings_and_corners(sides, others):
    rng, counts = np.random.default_rng(0), set()
    for i in range(300):
        slave, master = polygon(rng, sides), polygon(rng, others) + rng.uniform(-0.5, 0.5, 2)
        if i % 3 == 0:  # stars
            slave, master = regular(rng, sides, 0.0), regular(rng, others, np.pi / others)
        vertices, area = clipped(slave, master)
        count, exact = common_hull(slave, master)
        assert len(vertices) == count and abs(area - exact) < 1e-14
        counts.add(count)
    assert counts - {0} >= set(range(3, sides + others + 1))


def test_master_that_does_not_face_the_slave_has_no_part():
    assert len(clipped(SQUARE, SQUARE)[0]) == 4
    assert len(clipped(SQUARE, SQUARE[::-1])[0]) == 0


@pytest.mark.parametrize("shift", SHIFTS)
def test_facets_that_only_touch_have_no_part(shift):
    _, area = clipped(SQUARE, SQUARE + np.array([1.0 + shift, 0.0]))
    assert area <= max(-shift, 0.0) + 1e-12
    assert len(clipped(SQUARE, SQUARE + np.array([1.0, 1.0 + shift]))[0]) == 0


@pytest.mark.parametrize("angle", [0.0, 1e-15, 1e-13, 1e-12, 1e-9, 1e-6])
@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize("factor", [1.0, 0.5, 2.0])
def test_integrals_and_derivatives_of_parallel_edges_are_finite_and_continuous(
    angle, shift, factor
):
    # the lower edges coincide but for the shift and the angle; the rest overlaps in part
    Q = rotation(np.random.default_rng(1))
    x = np.column_stack([SQUARE, np.zeros(4)])
    c, s = np.cos(angle), np.sin(angle)
    y = factor * SQUARE @ np.array([[c, s], [-s, c]]) + [0.25, shift]
    m = np.column_stack([y, np.full(4, 0.1)])
    geometry = x @ Q.T, np.tile(Q[:, 2], (4, 1)), m @ Q.T
    slave, masters = np.arange(4)[None], np.array([[0, 3, 2, 1]])
    A, nodal = np.eye(4)[None], np.ones((1, 4, 3))
    coefficients = A, np.zeros((1, 4)), nodal, nodal, nodal, nodal
    values = integrate(geometry, slave, masters, np.array([0, 1]))
    exact = min(0.75, factor) * min(1.0, factor)
    assert abs(values[0].sum() - exact) < 3e-12 + 3 * (abs(shift) + angle)
    assert np.abs(values[3].sum(axis=2) - values[0]).max() < 1e-15
    out, _, _ = linearize(geometry, slave, masters, np.array([0, 1]), coefficients)
    for found in out:
        assert np.isfinite(found).all() and np.abs(found).max() < 10.0
    # where the upper edge of the slave limits the part, the lower one of the master does, or not
    by_master = (out[0].sum(axis=1)[0, 12:].reshape(4, 3) @ Q).sum(axis=0)
    left_edge = min(1.0, factor) if factor > 0.75 else 0.0
    assert abs(by_master[0] + left_edge) < 1e-3 and abs(by_master[2]) < 1e-13
