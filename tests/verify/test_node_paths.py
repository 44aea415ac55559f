# SPDX-License-Identifier: MIT
"""Random paths of bodies in a step: sliding is not reported, passages are."""

import numpy as np
import pytest
from scenes import rotation
from test_crossing_kernels import circle, outline, rectangle

import fenics_mortar as fm
from fenics_mortar.kernels import passage
from fenics_mortar.verify.finding import LIMITS
from fenics_mortar.verify.node_paths import Motions, Paths, StepEnds
from fenics_mortar.verify.obstacle_passages import events_on, own_frame, passed_through


def node_paths(motions):
    """Positions at start, intermediate times and end, shape (m + 1, n, 2)."""
    sections = max(int(np.ceil(np.abs(motions.angles).max() / LIMITS.section_turn)), 1)
    return np.array([motions.at(t) for t in np.arange(sections + 1) / sections])


def count_passages(x0, x1, segments, after, before, bodies):
    """Number of paths through bodies, searched as in ``Passages``."""
    of_segments, count = bodies[segments[:, 0]], 0
    paths = Paths(StepEnds(x0, x1, np.zeros(len(x0), bool)), bodies, [], 1e-3)
    none = np.full(len(x1), -1)
    lengths = np.hypot(*(x1[segments[:, 1]] - x1[segments[:, 0]]).T)
    for i, body in enumerate(paths.motions.labels):
        along, at = paths.seen_from(paths.frame_of(i)), np.flatnonzero(of_segments == body)
        every = events_on(along, passage.find_events, np.arange(len(x0)), segments[at])
        every[:, 1] = at[every[:, 1].astype(int)]
        rows = passage.find_passages(
            along, segments, after, before, none, lengths, of_segments, every
        )
        count += int((rows[:, 2] >= 0).sum())
    return count


@pytest.mark.serial
@pytest.mark.parametrize("seed", range(100))
def test_sliding_block_on_a_rotating_body_is_no_passage(seed):
    """Gaps of 1e-12 to 0.15 facets, slides of up to more than its width, rotations to 180 deg."""
    random = np.random.default_rng(seed)
    sizes, width = random.uniform(0.05, 0.3, 2), random.uniform(0.3, 1.5)
    plate = rectangle(-3.0, -1.0, 6.0, 1.0, sizes[0])
    block = rectangle(-width / 2, 0.0, width, random.uniform(0.2, 1.0), sizes[1])
    rough = 10 ** random.uniform(-12.0, -0.8) * sizes.min() * random.normal(size=(2, *block.shape))
    turn = rotation(random.uniform(-np.pi, np.pi) * (seed % 2)).T
    x0, *topology = outline(plate, block + rough[0])
    x1, *_ = outline(plate @ turn, (block + rough[1] + [random.uniform(-2.0, 2.0), 0.0]) @ turn)
    assert count_passages(x0, x1, *topology) == 0


@pytest.mark.serial
@pytest.mark.parametrize("seed", range(100))
def test_passage_is_detected_for_rotating_bodies(seed):
    random = np.random.default_rng(seed)
    sizes, thickness = random.uniform(0.05, 0.3, 2), 10 ** random.uniform(-2.0, 0.0)
    width, height = random.uniform(0.3, 1.5), random.uniform(0.2, 1.0)
    plate = rectangle(-3.0, -thickness, 6.0, thickness, sizes[0])
    block = rectangle(-width / 2, random.choice([0.0, 1e-9, 0.1, 0.5]), width, height, sizes[1])
    down = [random.uniform(-0.5, 0.5), thickness + height + random.uniform(1.0, 3.0)]
    turn = rotation(random.uniform(-0.8, 0.8) * np.pi * (seed % 2)).T
    x0, *topology = outline(plate, block)
    x1, *_ = outline(plate @ turn, (block - down) @ turn)
    assert count_passages(x0, x1, *topology) > 0


@pytest.mark.serial
@pytest.mark.parametrize("seed", range(60))
def test_rotating_ring_and_shaft_are_no_passage(seed):
    """Equal radii with nonmatching facets, each rotated by a different angle."""
    random = np.random.default_rng(seed)
    counts, angles = random.integers(12, 80, 2), random.uniform(-3.1, 3.1, 2)
    loops = [circle(0.0, 0.0, 1.0, counts[0], random.uniform(0.0, 6.0))]
    hole, rim = circle(0.0, 0.0, 1.0, counts[1])[::-1], circle(0.0, 0.0, 1.5, counts[1])
    x0, segments, after, before, bodies = outline(*loops, hole, rim)
    bodies = np.minimum(bodies, 1)
    turns = [rotation(angle).T for angle in angles]
    x1 = np.concatenate([x0[bodies == body] @ turns[body] for body in (0, 1)])
    assert count_passages(x0, x1, segments, after, before, bodies) == 0


@pytest.mark.serial
@pytest.mark.parametrize("seed", range(30))
def test_nodes_on_a_rotating_obstacle_are_no_passage(seed):
    random = np.random.default_rng(seed)
    sheet = fm.Polygon([(-3, -0.1), (3, -0.1), (3, 0.0), (-3, 0.0)], 0.02, pivot=(5.0, 2.0))
    angle, shift = random.uniform(-3.0, 3.0), random.uniform(-1.0, 1.0, 2)
    block = rectangle(-0.5, 1e-3 * random.normal(), 1.0, 0.5, 0.1)
    for down, through in ((0.0, False), (1.0, True), (-1.0, False)):
        moved = block - [random.uniform(-1.5, 1.5), down]
        end = (moved - sheet.pivot) @ rotation(angle).T + sheet.pivot + shift
        x0, x1 = (
            own_frame(sheet, x, np.array(place))
            for x, place in ((block, (0.0, 0.0, 0.0)), (end, (*shift, angle)))
        )
        knots = node_paths(Motions(StepEnds(x0, x1), (np.arange(1), np.zeros(len(x0), np.int64))))
        depth = passed_through(sheet, knots, np.zeros(len(x0)), np.full(len(x0), 0.1))
        assert (depth > 0.0).any() == through


@pytest.mark.parametrize("middle", [0.0, 0.03, 0.05, -0.02])
@pytest.mark.parametrize("depth", [0.4, 3.0])
def test_passage_of_a_small_obstacle_between_nodes_is_detected(middle, depth):
    """Its radius is 1.1 facets; passages of nodes beside its middle were not detected before."""
    ball = fm.Circle((middle, 0.11), 0.11)
    x0 = np.stack([np.linspace(-0.5, 0.5, 11), np.zeros(11)], axis=1)
    moved = own_frame(ball, x0, np.array((0.0, -depth, 0.0)))
    knots = node_paths(Motions(StepEnds(x0, moved), (np.arange(1), np.zeros(11, np.int64))))
    assert (passed_through(ball, knots, np.zeros(11), np.full(11, 0.1)) > 0.0).any()
