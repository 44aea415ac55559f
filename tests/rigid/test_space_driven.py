# SPDX-License-Identifier: MIT
"""Obstacles in space driven by forces and moments, whose places are unknowns of the solve."""

import numpy as np
import pytest
from refusal import refused
from space_scenes import held, of, solid
from test_space_contact import KINDS, TIGHT, block_under, law_of

import fenics_mortar as fm
from fenics_mortar.obstacles.rigid_motion import (
    motion_between,
    place_after,
    places_towards,
    rotation_by,
    vector_beside,
)
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, block

FORCES = ("x", "y", "z")
# Pushes of each obstacle; the others of its motions are prescribed.
SCENES = {
    "plane": (0.0, "z", "axle"),
    "sphere": (0.0, "xyz", ""),
    "cone": (0.2, "z", "moments"),
    "punch": (0.2, "z", "moments"),
}


def pushes(reaction, forces, turns):
    """The loads that balance a reaction, as arguments of ``push``."""
    load = dict(zip(FORCES, -reaction[:3], strict=True))
    moments = {"axle": (-reaction[3], None, None), "moments": -reaction[3:]}
    given = {name: load[name] for name in forces}
    return given | ({"moment": moments[turns]} if turns else {})


def is_quadratic(residuals, rounding=1e-14):
    """Whether the last step left only rounding, or a thousandth of the residual."""
    return residuals[-1] < 1e-3 * residuals[-2] + rounding


@pytest.mark.once
@pytest.mark.parametrize(
    "kind, algorithm", [*((kind, "condensed") for kind in SCENES), ("cone", "saddle")]
)
def test_prescribed_force_agrees_with_prescribed_displacement(kind, algorithm):
    """The reaction to a prescribed motion is fed back as a load to an obstacle further away."""
    mu, forces, turns = SCENES[kind]
    moved, driven = KINDS[kind](), KINDS[kind]()
    given, found = (block_under(o, mu=mu, algorithm=algorithm).problem for o in (moved, driven))
    motion = {"x": 0.01, "y": -0.01, "angle": (0.01, 0.02, 0.015)}
    moved.move(**motion, z=-0.05)
    given.solve()
    driven.move(**motion, z=-0.03)
    driven.push(**pushes(moved.reaction, forces, turns))
    report = found.solve()
    assert report.certificate.violations() == []
    assert any("contact force" in note for note in report.notes)
    size = np.abs(moved.reaction).max()
    assert np.abs(driven.reaction - moved.reaction).max() < 1e-11 * size
    assert np.abs(driven.place - moved.place).max() < 1e-11
    assert is_quadratic(report.residuals)
    z, exact = (problem.equations.contacts[0].z for problem in (found, given))
    assert np.abs(z - exact).max() < 1e-9 * np.abs(exact).max()


def joint(mu=0.3):
    """A ball whose centre moves along z only, free to turn, on a block; pressed."""
    ball = fm.Sphere((0.4, 1.1, 2.9), 1.42)
    problem = block_under(ball, mu=mu).problem
    ball.push(z=-0.3, moment=(0.0, 0.0, 0.0))
    problem.solve()
    return ball, problem


def test_ball_driven_by_a_moment_balances_it_by_friction():
    """Forces and moments of push, obstacle and supports; the derivatives with all motions."""
    ball, problem = joint()
    for step in (1, 2, 3):
        load = 1e-3 * step * np.array((5.0, 2.0, 1.0))
        ball.push(moment=load)
        report = problem.solve()
        assert report.certificate.violations() == []
        assert np.abs(ball.reaction[3:] + load).max() < 1e-10 * np.abs(ball.reaction).max()
        assert ball.reaction[2] == pytest.approx(0.3, rel=1e-10)
    assert ball.place[5] > 0.005  # it has turned
    data = problem.equations.contacts[0].pair.data
    below = problem.reaction("block/bottom", ball.pivot + ball.place[:3], data=data)
    loads = np.array([*below.force, *below.moment])
    assert np.abs(ball.reaction - loads).max() < 1e-10 * np.abs(loads).max()
    slopes = problem.check_tangent(print_table=False).slopes
    assert all(slope > 1.9 for slope in slopes.values()), slopes


@pytest.mark.once
def test_dragged_lid_turns_on_its_sticking_nodes():
    """All six motions are driven, with friction; Newton's method is quadratic."""
    lid = fm.Plane((0.5, 1.0, 1.55), (0.0, 0.0, -1.0))
    problem = block_under(lid, mu=0.3).problem
    loads = np.array([(0.0, 0.0, -0.5, 0.05, 0.03, 0.0), (0.08, -0.04, -0.5, 0.05, 0.03, 0.02)])
    for load in loads:
        lid.push(**dict(zip(FORCES, load[:3], strict=True)), moment=load[3:])
        report = problem.solve()
        assert report.certificate.violations() == []
        assert np.abs(lid.reaction + load).max() < 1e-10
        assert is_quadratic(report.residuals)
    assert lid.place[0] > 0.03 and lid.place[1] < -0.01 and lid.place[5] > 0.01
    slopes = problem.check_tangent(print_table=False).slopes
    assert all(slope > 1.9 for slope in slopes.values()), slopes


@pytest.mark.once
def test_lid_is_driven_with_small_sliding():
    """As by a prescribed motion; operators are frozen, turns of the lid are not."""
    found = []
    for given in (None, "push"):
        lid = fm.Plane((0.5, 1.0, 1.5), (0.0, 0.0, -1.0))
        scene = solid(counts=(3, 4, 2))
        held(scene)
        pair = fm.ContactPair(scene.data, "block/top", lid, law=law_of(0.3), sliding="small")
        problem = scene.set_up([pair], newton=TIGHT).problem
        lid.move(z=-0.05, angle=(0.01, 0.02, 0.015))
        if given:
            lid.move(z=-0.03)
            lid.push(**pushes(found[0][1], "z", "moments"))
        assert is_quadratic(problem.solve().residuals)
        found.append((lid.place, lid.reaction))
    slopes = problem.check_tangent(print_table=False).slopes
    assert all(slope > 1.9 for slope in slopes.values()), slopes
    (place, reaction), (same, loaded) = found
    assert np.abs(same - place).max() < 1e-11
    assert np.abs(loaded - reaction).max() < 1e-11 * np.abs(reaction).max()


def columns(obstacle, mu, **places):
    """Blocks of a base of 0.6 x 0.6 at (x, y), of any height, with their tops at one obstacle."""
    boxes = [
        Box(name, block((2, 2, 2), size=(0.6, 0.6, height), corner=(x, y, 0.0)))
        for name, (x, y, height) in places.items()
    ]
    scene = of(mapped_boxes.mesh(boxes))
    for name in places:
        held(scene, side=f"{name}/bottom")
    pairs = [fm.ContactPair(scene.data, f"{name}/top", obstacle, law=law_of(mu)) for name in places]
    return scene.set_up(pairs, newton=TIGHT)


@pytest.mark.once
def test_lid_on_three_columns_finds_its_tilt():
    """The lid touches the highest column first, turns, and then rests on all three.

    It tilts as the plane through the tops, but for their compression by up to 0.05 over two
    lengths.
    """
    lid = fm.Plane((1.3, 1.3, 1.3), (0.0, 0.0, -1.0))
    scene = columns(lid, 0.3, near=(0, 0, 1.0), right=(2, 0, 0.9), far=(1, 2, 0.95))
    lid.push(z=-0.3, moment=(0.0, 0.0, 0.0))
    report = scene.problem.solve()
    assert report.certificate.violations() == []
    assert any("moved until contact stopped it" in note for note in report.notes)
    assert np.abs(lid.reaction[2:] - (0.3, 0.0, 0.0, 0.0)).max() < 1e-10
    forces = [contact.total_force for contact in scene.problem.equations.contacts]
    assert np.abs(sum(forces) + lid.reaction[:3]).max() < 1e-10
    assert max(force[2] for force in forces) < -0.05
    # height 1 - 0.05 x of the tops, equal in the middle between two of them and at the third
    assert np.abs(lid.place[3:5] - (0.0, 0.05)).max() < 0.025
    about, names = lid.pivot + lid.place[:3], ("near", "right", "far")
    below = [scene.problem.reaction(f"{name}/bottom", about, data=scene.data) for name in names]
    assert np.abs(sum(each.moment for each in below)).max() < 1e-10


@pytest.mark.once
@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_block_between_a_floor_and_a_driven_lid(mu):
    """The block has no supports: it is carried by two planes, one of them driven and free to turn.

    Limit analysis counts a driven obstacle among what supports bodies. Without friction the
    pressure is uniform.
    """
    scene = solid(counts=(2, 2, 2), jiggle=0.0)
    floor, lid = fm.Plane((0, 0, 0), (0, 0, 1.0)), fm.Plane((0.5, 1.0, 1.6), (0, 0, -1.0))
    pairs = [
        fm.ContactPair(scene.data, f"block/{side}", plane, law=law_of(mu))
        for side, plane in (("bottom", floor), ("top", lid))
    ]
    problem = scene.set_up(pairs, newton=TIGHT).problem
    lid.push(z=-1.0, moment=(0.0, 0.0, 0.0))
    report = problem.solve()
    assert report.certificate.violations() == []
    assert np.abs(floor.reaction[:3] - (0.0, 0.0, -1.0)).max() < 1e-9
    assert np.abs(lid.reaction[2:] - (1.0, 0.0, 0.0, 0.0)).max() < 1e-9
    about = np.cross(lid.pivot + lid.place[:3] - floor.pivot, (0.0, 0.0, 1.0))
    assert np.abs(floor.reaction[3:] + about).max() < 1e-9
    if not mu:
        pressure = problem.equations.contacts[1].pressure
        assert np.ptp(pressure) < 1e-8 * pressure.mean()


@pytest.mark.once
def test_path_rolls_back_and_restarts(shared_path):
    """The state is restored exactly, from memory and from a file; steps extrapolate places."""

    def set_loads(ball):
        return lambda time: ball.push(z=-0.3, moment=1e-3 * time * np.array((8.0, 4.0, 2.0)))

    ball, problem = joint()
    options = fm.SteppingOptions(step=0.25)
    fm.follow_path(problem, set_loads(ball), options, stop=0.5)
    kept, state = ball.place.copy(), problem.state()
    fm.save_state(problem, str(shared_path / "state.npz"))
    fm.follow_path(problem, set_loads(ball), options, start=0.5)
    end = ball.place.copy()
    assert np.abs(end - kept).max() > 1e-3
    problem.restore(state)
    assert (ball.place == kept).all()
    other, again = joint()
    fm.load_state(again, str(shared_path / "state.npz"))
    assert (other.place == kept).all()
    fm.follow_path(again, set_loads(other), options, start=0.5)
    assert np.abs(other.place - end).max() < 1e-11


@pytest.mark.once
def test_contact_adds_no_energy():
    """The work of the push is that on the block, up to the square of the step size."""
    rests = []
    for step in (0.5, 0.25):
        lid = fm.Plane((0.5, 1.0, 1.5), (0.0, 0.0, -1.0))
        problem = block_under(lid).problem
        lid.move(angle=(0.0, 0.0, 0.4))  # the axle is not along the rotation vector
        lid.push(z=-2.0, moment=(0.0, None, None))
        problem.solve()

        def set_loads(time, lid=lid):
            lid.push(z=-2.0 - 2.0 * time, moment=(0.3 * time, None, None))

        path = fm.follow_path(problem, set_loads, fm.SteppingOptions(step=step))
        rests.append(sum(step.work.contact for step in path.steps))
        assert abs(rests[-1]) < 2e-3 * sum(step.work.supports for step in path.steps)
    assert rests[0] / rests[1] == pytest.approx(4.0, rel=0.03)  # 3.93: a term of third order


def test_springs_have_the_derivative_of_their_forces():
    """Of finite motions since their anchor, by central differences."""
    lid = KINDS["plane"]()
    equations = block_under(lid).problem.equations
    motions, springs = equations.motions, equations.springs
    lid.push(x=0.0, y=0.0, z=-0.2, moment=(0.0, 0.0, 0.0))
    springs.anchor(0.25)
    motions.move(np.array([(0.1, -0.2, 0.1, 0.5, 0.3, -0.4)]))
    places, found, h = motions.places, np.empty((6, 6)), 1e-5
    for i, motion in enumerate(np.eye(6)):
        ends = []
        for sign in (1.0, -1.0):
            motions.places = places
            motions.move(sign * h * motion[None])
            ends.append(springs.on_motions()[0])
        found[:, i] = (ends[0] - ends[1]) / (2.0 * h)
    motions.places = places
    exact = motions._stiffness_of_springs(1.0, 1.0)
    assert np.abs(found - exact).max() < 1e-9 * np.abs(exact).max()
    assert np.abs(exact - np.diag(np.diag(exact))).max() > 0.05 * np.abs(exact).max()


@pytest.mark.once
@pytest.mark.parametrize("height", [0.99, 1.0, 1.2])
def test_oblique_push_is_held_by_friction_from_the_start(height):
    """Also of a lid in the air, or that overlaps; pressed on first, it lies nearly the same way."""
    push = {"x": 0.003, "y": -0.006, "z": -0.06, "moment": (1e-3, -1e-3, 5e-4)}
    places = []
    for first in (False, True):
        lid = fm.Plane((0.3, 0.3, height), (0.0, 0.0, -1.0))
        scene = columns(lid, 0.5, only=(0.0, 0.0, 1.0))
        if first:
            lid.move(z=0.99 - height)
            scene.problem.solve()
        lid.push(**push)
        report = scene.problem.solve()
        assert report.certificate.violations() == []
        assert (
            np.abs(lid.reaction + np.array([3e-3, -6e-3, -6e-2, 1e-3, -1e-3, 5e-4])).max() < 1e-10
        )
        places.append(lid.place.copy())
    if height <= 1.0:  # in the air it turns as far as its moment drives it
        assert np.abs(places[0] - places[1]).max() < 1e-2 * np.abs(places[1]).max()


# What is refused


@pytest.mark.each
@pytest.mark.parametrize(
    "loads, message",
    [
        ({"z": 1.0}, r"can move along \(0, 0, 1\) freely"),
        ({"x": 1.0, "y": 1.0}, r"can move along \(0.7071, 0.7071, 0\) freely"),
        ({"moment": (0.0, 0.0, 1.0)}, r"can rotate about the axis \(0, 0, 1\) freely"),
        ({"moment": (None, 2.0, None)}, r"can rotate about the axis \(0, 1, 0\) freely"),
    ],
)
def test_unsupported_obstacle_is_refused(loads, message):
    """A ball turns about its centre in spite of contact; equal errors on all ranks."""
    kinds = {"plane": ((0.5, 1.0, 1.6), (0.0, 0.0, -1.0)), "ball": ((0.5, 1.0, 2.95), 1.42)}
    obstacle = fm.Sphere(*kinds["ball"]) if "moment" in loads else fm.Plane(*kinds["plane"])
    problem = block_under(obstacle).problem
    obstacle.push(**loads)
    with refused(fm.MortarError, message):
        problem.solve()


@pytest.mark.each
@pytest.mark.parametrize(
    "load, message",
    [
        ({"z": np.nan}, "finite"),
        ({"moment": 0.1}, "moments about x, y and z"),
        ({"moment": (0.1, 0.2, None)}, "one of them and None for the others"),
        ({"moment": (0.1, np.inf, 0.2)}, "finite"),
    ],
)
def test_invalid_loads_are_refused(load, message):
    with pytest.raises(ValueError, match=message):
        fm.Sphere((0, 0, 0), 1.0).push(**load)
    with pytest.raises(ValueError, match="in the plane"):
        fm.Circle((0, 0), 1.0).push(z=1.0)


def test_load_that_turns_about_two_axes_is_refused():
    """Set as an attribute, which is checked before a solve only."""
    ball, problem = joint()
    ball.load[3] = np.nan
    with refused(fm.MortarError, "moments about none, one or all of the axes"):
        problem.solve()


# Places


@pytest.mark.serial
def test_axle_turns_any_number_of_times():
    """Also if the obstacle was tilted before: its place and the way between places."""
    for tilt in ((0.0, 0.0, 0.0), (0.3, -0.2, 0.0)):
        place, start = np.array([0.0, 0.0, 0.0, *tilt]), rotation_by(np.array(tilt))
        for step in range(1, 41):
            before = place
            place = place_after(before, np.array([0.0, 0.0, 0.1, 0.0, 0.0, 1.0]), 2.0)
            turned = rotation_by(np.array((0.0, 0.0, 0.5 * step))) @ start
            assert np.allclose(rotation_by(place[3:]), turned, atol=1e-13)
            assert np.allclose(motion_between(before, place, 2.0)[3:], (0, 0, 1.0), atol=1e-12)
        assert place[2] == pytest.approx(4.0)
        if not any(tilt):
            assert np.allclose(place[3:], (0.0, 0.0, 20.0), atol=1e-12)
    near = np.array((0.0, 6.0, 0.1))  # no rotation is also a full turn about any axis
    whole = vector_beside(np.eye(3), near)
    assert np.allclose(whole, 2.0 * np.pi * near / np.linalg.norm(near), atol=1e-12)


@pytest.mark.serial
def test_places_are_interpolated_along_one_screw():
    """Both ends are exact, and parts of the way add up, as for a body that turns."""
    rng = np.random.default_rng(2)
    one, other = rng.normal(size=(2, 3, 6))
    assert np.allclose(places_towards(one, other, 0.0), one, atol=1e-12)
    for place, end in zip(places_towards(one, other, 1.0), other, strict=True):
        assert np.allclose(rotation_by(place[3:]), rotation_by(end[3:]), atol=1e-13)
    half = places_towards(one, other, 0.5)
    again = places_towards(half, places_towards(one, other, 1.0), 0.5)
    for place, end in zip(again, places_towards(one, other, 0.75), strict=True):
        assert np.allclose(rotation_by(place[3:]), rotation_by(end[3:]), atol=1e-13)
    plane = rng.normal(size=(2, 2, 3))
    assert np.allclose(places_towards(*plane, 0.3), 0.7 * plane[0] + 0.3 * plane[1], atol=1e-15)
