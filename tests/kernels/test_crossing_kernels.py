# SPDX-License-Identifier: MIT
"""Crossing outlines and paths through them: compared with all pairs, fine steps, and by hand."""

from fractions import Fraction

import numpy as np
import pytest

from fenics_mortar.kernels import crossing, passage


def outline(*loops):
    """Nodes, segments, after and before of closed loops of points, counter-clockwise."""
    x, segments, after, before, bodies, first = [], [], [], [], [], 0
    for body, loop in enumerate(loops):
        own = first + np.arange(len(loop))
        x.append(np.asarray(loop, float))
        segments.append(np.stack([own, np.roll(own, -1)], axis=1))
        after.append(np.roll(own, -1))
        before.append(np.roll(own, 1))
        bodies.append(np.full(len(loop), body))
        first += len(loop)
    return [np.concatenate(part) for part in (x, segments, after, before, bodies)]


def rectangle(x, y, width, height, size):
    """Points along a rectangle with its lower left corner at x, y, about ``size`` apart."""
    corners = np.array([(x, y), (x + width, y), (x + width, y + height), (x, y + height)])
    sides = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0)):
        count = max(round(np.hypot(*(b - a)) / size), 1)
        sides.append(a + np.arange(count)[:, None] / count * (b - a))
    return np.concatenate(sides)


def circle(x, y, radius, count, phase=0.0):
    angle = phase + 2.0 * np.pi * np.arange(count) / count
    return np.array([x, y]) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def crossings(*loops, allowed=0.0):
    x, segments, after, before, bodies = outline(*loops)
    lengths = np.hypot(*(x[segments[:, 1]] - x[segments[:, 0]]).T)
    allowed = np.full(len(x), allowed)
    return crossing.find_crossings(x, segments, after, before, lengths, bodies, allowed)


def events_of_others(x0, x1, segments, bodies):
    """Intersections of nodes with segments of other bodies; ``bodies`` of nodes and segments."""
    found = []
    for body in np.unique(bodies):
        at, nodes = np.flatnonzero(bodies == body), np.flatnonzero(bodies != body)
        rows = passage.find_events(x0, x1, nodes[:, None], segments[at], x0)
        rows[:, 0], rows[:, 1] = nodes[rows[:, 0].astype(int)], at[rows[:, 1].astype(int)]
        found.append(rows)
    return np.concatenate(found)


def exactly_cross(a, b, c, d):
    """Whether two segments cross at inner points, in exact fractions."""

    def side(p, q, r):
        (px, py), (qx, qy), (rx, ry) = ([Fraction(float(v)) for v in node] for node in (p, q, r))
        return (qx - px) * (ry - py) - (qy - py) * (rx - px)

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0


@pytest.mark.parametrize("seed", range(8))
def test_tree_finds_the_crossings_that_all_pairs_have(seed):
    random = np.random.default_rng(seed)
    loops = [
        circle(*random.uniform(0.0, 2.0, 2), 1.0, 17 + 5 * k)
        + random.normal(0.0, 0.05, (17 + 5 * k, 2))
        for k in range(3)
    ]
    x, segments, *_ = outline(*loops)
    expected = {
        (i, j)
        for i in range(len(segments))
        for j in range(i + 1, len(segments))
        if not set(segments[i]) & set(segments[j])
        and exactly_cross(*x[segments[i]], *x[segments[j]])
    }
    found = crossings(*loops)
    assert {(int(i), int(j)) for i, j in found[:, :2]} == expected
    for i, j, _, _, *P in found:
        for segment in (segments[int(i)], segments[int(j)]):
            a, b = x[segment]
            assert np.hypot(*(P - a)) + np.hypot(*(P - b)) == pytest.approx(np.hypot(*(b - a)))


@pytest.mark.parametrize("seed", range(8))
def test_events_agree_with_fine_steps(seed):
    """Signs of areas at 20,001 times, for every node and segment of another body."""
    random = np.random.default_rng(seed)
    start = [circle(0.0, 0.0, 1.0, 9), circle(1.5, 0.3, 1.0, 7)]
    end = [
        loop + random.normal(0.0, 0.4, 2) + random.normal(0.0, 0.1, loop.shape) for loop in start
    ]
    x0, segments, _, _, bodies = outline(*start)
    x1 = outline(*end)[0]
    found = events_of_others(x0, x1, segments, bodies)
    t = np.linspace(0.0, 1.0, 20001)[:, None]
    expected = []
    for p in range(len(x0)):
        for e, (a, b) in enumerate(segments):
            if bodies[p] == bodies[e]:
                continue
            A, B, P = (x0[k] + t * (x1[k] - x0[k]) for k in (a, b, p))
            E, Q = B - A, P - A
            area = E[:, 0] * Q[:, 1] - E[:, 1] * Q[:, 0]
            place = (E * Q).sum(axis=1) / (E * E).sum(axis=1)
            for k in np.flatnonzero(area[1:] * area[:-1] < 0.0):
                if 0.0 < place[k] < 1.0:
                    expected.append((p, e, t[k, 0], np.sign(area[k + 1])))
    assert len(found) == len(expected) > 0
    key = np.lexsort((found[:, 2], found[:, 1], found[:, 0]))
    assert np.allclose(found[key, :4], sorted(expected), atol=1e-4)


def test_depth_of_overlapping_blocks_is_exact():
    below = rectangle(-2.0, -1.0, 4.0, 1.0, 0.25)
    for deep in (0.001, 0.1, 0.26, 0.7):
        found = crossings(below, rectangle(-0.53, -deep, 1.0, 1.0, 0.2))
        assert len(found) == 2
        assert np.allclose(found[:, 3], deep) and np.allclose(found[:, 2], deep / 0.25)


@pytest.mark.parametrize("thickness", [0.01, 0.1, 0.5])
@pytest.mark.parametrize("shift", [0.0, 0.07, 0.113])
def test_depth_of_crossing_strips_is_independent_of_their_thickness(thickness, shift):
    """Facets of 0.2: nodes of one need not lie in the other."""
    level = rectangle(-2.0, shift, 4.0, thickness, 0.2)
    upright = rectangle(shift, -2.0, thickness, 4.0, 0.2)
    assert crossings(level, upright)[:, 2].max() > 0.5


@pytest.mark.parametrize("counts", [(40, 57), (64, 64), (30, 200), (200, 30)])
@pytest.mark.parametrize("phase", [0.0, 0.01, 0.5])
def test_faceted_curves_in_contact_overlap_by_their_sagitta(counts, phase):
    """A disk in a ring of its own radius."""
    inner = circle(0.0, 0.0, 1.0, counts[0], phase * np.pi / counts[0])
    outer = circle(0.0, 0.0, 1.0, counts[1])[::-1]
    found = crossings(inner, outer, circle(0.0, 0.0, 2.0, 50))
    assert found[:, 2].max(initial=0.0) < 0.1


@pytest.mark.parametrize("seed", range(40))
def test_depth_of_rough_faces_is_their_roughness(seed):
    """Blocks with any facets, also graded ones, whose faces overlap by a fraction of a facet."""
    random = np.random.default_rng(seed)
    faces = []
    for count in random.integers(4, 60, 2):
        face = np.sort(random.uniform(-1.0, 1.0, count - 1)) if seed % 2 else []
        face = np.concatenate([[-1.0], face, [1.0]]) if seed % 2 else np.linspace(-1, 1, count + 1)
        faces.append(np.stack([face * random.uniform(0.8, 1.2), 0.0 * face], axis=1))
    size = 10 ** random.uniform(-6.0, -1.5) * 2.0
    for face in faces:
        face[:, 1] += size * random.uniform(-0.5, 0.5, len(face))
    low = np.concatenate([faces[0][::-1], [(-1.3, -1.0), (1.3, -1.0)]])
    high = np.concatenate([faces[1], [(1.3, 1.0), (-1.3, 1.0)]])
    found = crossings(low, high)
    assert len(found) and found[:, 3].max() < 1.01 * size


def test_blocks_of_one_mesh_size_that_touch_do_not_cross_by_rounding():
    """Nodes on nodes, corners on corners, moved by rounding: no depth at all."""
    random = np.random.default_rng(0)
    low, high = rectangle(0.0, 0.0, 1.0, 1.0, 0.1), rectangle(0.0, 1.0, 1.0, 1.0, 0.1)
    for size in (1e-16, 1e-12, 1e-6):
        for _ in range(20):
            perturbation = size * random.normal(size=(2, *low.shape))
            found = crossings(low + perturbation[0], high + perturbation[1])
            assert found[:, 2].max(initial=0.0) < 1e3 * size


def test_allowed_overlap_is_subtracted():
    pair = rectangle(-2.0, -1.0, 4.0, 1.0, 0.25), rectangle(-0.53, -0.1, 1.0, 1.0, 0.2)
    assert crossings(*pair, allowed=0.1)[:, 2].max() < 1e-12
    assert np.allclose(crossings(*pair, allowed=0.05)[:, 2].max(), 0.2)


def test_self_crossing_outline_is_detected():
    """A C whose ends have passed each other."""
    angle = np.linspace(0.05, 2.0 * np.pi + 0.4, 80)
    arc = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    loop = np.concatenate([1.2 * arc, 0.9 * arc[::-1]])
    assert crossings(loop)[:, 2].max() > 1.0
    angle = np.linspace(0.05, 2.0 * np.pi - 0.05, 80)
    arc = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert not len(crossings(np.concatenate([1.2 * arc, 0.9 * arc[::-1]])))


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.0])
@pytest.mark.parametrize("seed", range(20))
def test_aligned_blocks_overlap_by_rounding_only(seed, turn):
    """Top corners of sticking blocks are equally high: the tops cross in the joint."""
    rng = np.random.default_rng(seed)
    size = 1e-6
    left, right = rectangle(-1.0, 0.0, 1.0, 1.0, 0.5), rectangle(0.0, 0.0, 1.0, 1.0, 0.25)
    left += [size, 0.0]
    for block in (left, right):
        free = (block[:, 1] > 0.99) & (np.abs(block[:, 0]) > 0.1)
        block[free, 1] += size * rng.uniform(-1.0, 1.0, free.sum())
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    rows = crossings(left @ R.T, right @ R.T)
    assert rows[:, 2].max(initial=0.0) < 10.0 * size / 0.25


def test_collinear_segments_do_not_cross():
    """Tops of two blocks that stick to each other: the segments meet at the common corner."""
    x = np.array([(4e-17, 0.0), (-1 / 3, -1.1e-16), (0.25, -2.2e-16), (4e-19, 0.0)])
    one, other = np.array([0, 1]), np.array([2, 3])
    assert not crossing.cross_properly(x, one, other)
    x[2:] += [(0.0, 0.1), (-0.3, -0.1)]
    assert crossing.cross_properly(x, one, other)


def test_coordinate_on_a_segment_is_that_of_the_projection():
    along, across = np.array([0.8, 0.6]), np.array([-0.6, 0.8])
    x = np.array([3.0, -2.0]) + np.outer([0.0, 1.0], along)
    for place, expected in ((-0.5, 0.0), (0.25, 0.25), (0.9, 0.9), (1.5, 1.0)):
        for side in (-2.0, 0.3):
            p = x[0] + place * along + side * across
            assert crossing.nearest_on_piece(p, *x)[1] == pytest.approx(expected, abs=1e-14)
