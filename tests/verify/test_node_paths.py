# SPDX-License-Identifier: MIT
"""Random paths of bodies in a step: sliding is not reported, passages are."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import rotation
from test_crossing_kernels import circle, outline, rectangle

import fenics_mortar as fm
from fenics_mortar.interface.outline import Outline
from fenics_mortar.obstacles.rigid_motion import RigidPath, at_place, rotation_by
from fenics_mortar.verify.finding import LIMITS
from fenics_mortar.verify.node_paths import Motions, Paths, StepEnds
from fenics_mortar.verify.obstacle_passages import passed_through
from fenics_mortar.verify.overlap import depths_in_body
from fenics_mortar.verify.passages import Passages


def node_paths(motions):
    """Positions at start, intermediate times and end, shape (m + 1, n, 2)."""
    sections = max(int(np.ceil(motions.angles.max() / LIMITS.section_turn)), 1)
    return np.array([motions.at(t) for t in np.arange(sections + 1) / sections])


def in_frame_at(place, obstacle, x):
    """Points in the frame of an obstacle at a place."""
    with at_place(obstacle, np.array(place)):
        return obstacle.to_own_frame(x)


def passages_of(x, segments, bodies):
    """Detection of passages of nodes at ``x`` without pairs."""
    every = np.arange(len(x))
    none = np.zeros(len(x), int)
    o = Outline(
        X=x, nodes=every, bodies=bodies, segments=segments, ends=segments, owners=none, owned=every,
        dofs=none[:, None], local_dofs=none[:, None], comm=MPI.COMM_SELF,
    )  # fmt: skip
    return Passages(o, [], [], None, {})


def count_passages(x0, x1, segments, after, before, bodies):
    """Number of paths through bodies, those of all nodes as in a problem."""
    paths = Paths(StepEnds(x0, x1, np.zeros(len(x0), bool)), bodies, {}, 1e-3)
    found, every = passages_of(x0, segments, bodies), np.ones(len(x0), bool)
    through = (found.nodes_through(paths.seen_from(i), i, every) for i in np.unique(bodies))
    return sum(len(passed.ends) for passed, _ in through)


def passages(start, end):
    """Nodes through loops that move from ``start`` to ``end`` straight; depths of others inside."""
    x0, segments, _, _, bodies = outline(*start)
    x1 = outline(*end)[0]
    found, through, depths = passages_of(x0, segments, bodies), [], []
    for body in np.unique(bodies):
        passed, inside = found.nodes_through(np.array([x0, x1]), body, bodies != body)
        through += passed.ends[:, 0].tolist()
        depths += depths_in_body(found.outline, x1, body, x1[inside])[0].tolist()
    return set(through), np.array(depths)


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
            in_frame_at(place, sheet, x)
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
    moved = in_frame_at((0.0, -depth, 0.0), ball, x0)
    knots = node_paths(Motions(StepEnds(x0, moved), (np.arange(1), np.zeros(11, np.int64))))
    assert (passed_through(ball, knots, np.zeros(11), np.full(11, 0.1)) > 0.0).any()


@pytest.mark.parametrize("thickness", [0.01, 0.3, 1.0])
def test_only_paths_through_a_plate_are_passages(thickness):
    plate = rectangle(-2.0, -thickness, 4.0, thickness, 0.25)
    block = rectangle(-0.4, 0.1, 0.8, 0.5, 0.2)
    through, inside = passages([plate, block], [plate, block - [0.3, 3.0]])
    assert through >= set(range(len(plate), len(plate) + len(block)))
    assert not inside.any()
    for move in ([3.0, 0.0], [0.3, -0.099], [-4.0, 0.0]):
        through, inside = passages([plate, block], [plate, block + move])
        assert not through and not inside.any()
    resting = block - [0.0, 0.1 + 1e-9]
    assert passages([plate, resting], [plate, resting - [0.0, 3.0]])[0]
    for move in ([0.5, 0.0], [-1.0, 1e-9], [1.1, 0.0], [0.3, 2.0]):
        assert not passages([plate, resting], [plate, resting + move])[0]


def test_path_across_a_corner_is_no_passage():
    """A node slides off the end of a plate, and round the corner of a block."""
    plate = rectangle(-2.0, -0.1, 4.0, 0.1, 0.25)
    tip = np.array([(1.9, 0.0), (2.6, 0.3), (2.5, 0.5)])
    assert not passages([plate, tip], [plate, tip - [0.0, 0.25]])[0]
    block = rectangle(-2.0, -4.0, 4.0, 4.0, 0.25)
    tip = np.array([(1.0, 0.01), (1.5, 0.3), (1.2, 0.5)])
    assert not passages([block, tip], [block, np.add(tip, [1.1, -1.5])])[0]


@pytest.mark.parametrize("deep", [0.05, 0.3])
def test_path_that_ends_inside_has_its_depth(deep):
    plate = rectangle(-2.0, -1.0, 4.0, 1.0, 0.25)
    block = rectangle(-0.4, 0.1, 0.8, 0.5, 0.2)
    through, inside = passages([plate, block], [plate, block - [0.0, 0.1 + deep]])
    assert not through
    assert inside.max() == pytest.approx(deep)


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.0])
@pytest.mark.parametrize("seed", range(20))
def test_path_out_along_an_edge_does_not_end_inside(seed, turn):
    """Bodies fitted with interference, whose ends are on one line up to rounding."""
    rng = np.random.default_rng(seed)
    outer, inner = rectangle(0.0, 0.0, 1.0, 0.1, 0.005), rectangle(-0.5, 0.0, 0.55, 0.1, 0.005)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    start = [x + rng.uniform(-1e-17, 1e-17, x.shape) for x in (outer, inner)]
    end = [outer + np.array([0.01, 0.0]), inner - np.array([0.04, 0.0])]
    through, inside = passages([x @ R.T for x in start], [x @ R.T for x in end])
    assert not through
    assert inside.max(initial=0.0) < 1e-12  # nodes that end on the edge up to rounding
    moved = np.array([0.2, 0.03]) + inner
    _, inside = passages([x @ R.T for x in start], [outer @ R.T, moved @ R.T])
    assert inside.max() == pytest.approx(0.03)


@pytest.mark.parametrize("turn", [0.0, 0.4, 2.5])
def test_paths_through_a_body_with_a_closed_crack_are_passages(turn):
    """Both faces of the crack are met at the same time: entries and exits come in any order."""
    tips = [np.array([(0.03 + c, 0.1), (0.45 + c, 0.4), (c - 0.37, 0.5)]) for c in (-0.9, 0.0, 0.8)]
    halves = [rectangle(-2.0, y, 4.0, 0.5, 0.25) for y in (-1.0, -0.5)]
    x0, segments, _, _, loops = outline(*[x @ rotation(turn).T for x in (*halves, *tips)])
    bodies = np.where(loops < 2, 0, loops)
    x1 = x0 + (bodies > 0)[:, None] * (rotation(turn) @ [0.1, -3.0])
    passed, _ = passages_of(x0, segments, bodies).nodes_through(np.array([x0, x1]), 0, bodies > 0)
    assert set(passed.ends[:, 0]) == set(np.flatnonzero(bodies > 0))


@pytest.mark.parametrize("bend", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("thickness", [0.05, 0.005])
def test_paths_through_a_plate_that_bends_meanwhile_are_passages(bend, thickness):
    """Three bodies pass at different times of the step; the plate moves by many thicknesses."""
    plate = rectangle(-2.0, -thickness, 4.0, thickness, 0.1)
    places = ((-1.5, 0.2), (0.0, 1.5), (1.5, 2.5))
    tips = [np.array([(0.0, 0.0), (0.05, 0.1), (-0.05, 0.1)]) + place for place in places]
    x0, segments, _, _, bodies = outline(plate, *tips)
    x1 = x0 - (bodies > 0)[:, None] * [0.0, 3.0]
    x1[bodies == 0, 1] += 0.5 * bend * (x0[bodies == 0, 0] ** 2 - 4.0 / 3.0)
    passed, _ = passages_of(x0, segments, bodies).nodes_through(np.array([x0, x1]), 0, bodies > 0)
    assert set(passed.ends[:, 0]) == set(np.flatnonzero(bodies > 0))


@pytest.mark.parametrize("dim", [2, 3])
def test_a_body_turns_about_its_hub_or_with_an_obstacle(dim):
    """In the plane and in space: by 150 degrees, and riding on a table by more than half a turn."""
    axis = np.array({2: [1.0], 3: [0.0, 0.6, 0.8]}[dim])
    x0 = np.random.default_rng(0).uniform(-0.3, 1.0, (30, dim))
    bodies, hub = np.zeros(30, int), x0[:, 0] < 0.0
    turn = np.radians(150.0) * axis
    paths = Paths(StepEnds(x0, x0 @ rotation_by(turn).T, hub), bodies, {}, 0.01)
    assert np.allclose(paths.at(0.5), x0 @ rotation_by(0.5 * turn).T)
    table = RigidPath(np.zeros(dim), np.zeros(dim), np.radians(-200.0) * axis)
    riding = Paths(StepEnds(x0, table.carry(x0, 1.0)), bodies, {-1: table}, 0.01)
    assert np.allclose(riding.seen_from(-1), x0)
    assert np.allclose(riding.at(0.5), table.carry(x0, 0.5))


@pytest.mark.parametrize("strain", [0.0, 1e-3, -1e-3])
@pytest.mark.parametrize("pin", [0, 10, 20])
def test_a_bar_turns_about_its_pin(pin, strain):
    """One prescribed node tells no rotation; the pin may be anywhere, and is shifted besides."""
    x = np.linspace(0.0, 2.0, 21)
    x0 = np.concatenate([np.c_[x, 0.0 * x], np.c_[x, 0.0 * x + 0.1]])
    led = np.arange(len(x0)) == pin
    shift = np.array([3.0, -1.0])
    stretched = (x0 - x0[pin]) * [1.0 + strain, 1.0]
    x1 = x0[pin] + shift + stretched @ rotation(np.radians(50.0)).T
    middle = Paths(StepEnds(x0, x1, led), np.zeros(len(x0), int), {}, 0.01).at(0.5)
    assert middle[pin] == pytest.approx(x0[pin] + 0.5 * shift, abs=1e-12)


@pytest.mark.parametrize("degrees", [20.0, 50.0, 400.0])
def test_the_held_rim_of_a_ring_tied_to_a_turning_hub_stays(degrees):
    """Its inner nodes follow the rigid boundary of the hub, and its rim does not."""
    angles = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    unit = np.c_[np.cos(angles), np.sin(angles)]
    x0, bodies = np.concatenate([0.3 * unit, 0.5 * unit, unit]), np.repeat([0, 1, 1], 40)
    hub = RigidPath(np.zeros(2), np.zeros(2), np.radians([degrees]))
    x1 = np.concatenate([hub.carry(x0[:80], 1.0), x0[80:]])
    ends = StepEnds(x0, x1, bodies == 0, known={0: hub, 1: hub})
    middle = Paths(ends, bodies, {}, 0.01).at(0.5)
    assert middle[80:] == pytest.approx(x0[80:], abs=0.01)
