# SPDX-License-Identifier: MIT
"""Passages of what turns: obstacles and bodies that turn far in one step."""

from __future__ import annotations

import numpy as np
import pytest
from crossing_scenes import DX, move_body, problem_of, turned
from refusal import refused
from scenes import internal, neo_hookean, read, rectangles, rotation

import ufl
from dolfinx import fem

import fenics_mortar as fm
import fenics_mortar.verify.passages as module_of_passages
from fenics_mortar.verify.overlap import depths_in_body
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block

AROUND = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)


def paddle():
    corners = [(0.0, -0.05), (1.0, -0.05), (1.0, 0.05), (0.0, 0.05)]
    return fm.Polygon(corners, 0.02, pivot=(0.0, 0.0), name="paddle")


def leaf():
    points = np.stack([0.5 + 0.5 * np.cos(AROUND), 0.05 * np.sin(AROUND)], axis=1)
    return fm.Spline(points, closed=True, pivot=(0.0, 0.0), name="paddle")


def pin():
    """Narrower than half a facet."""
    corners = [(0.73, -0.03), (0.79, -0.03), (0.79, 0.03), (0.73, 0.03)]
    return fm.Polygon(corners, 0.005, pivot=(0.0, 0.0), name="paddle")


def distance_of_leaf(x):
    return leaf().local(x)


def block_past(obstacle, box, sides, size=0.1, fixed="top"):
    data = read(rectangles, size=size, block=box)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    pair = fm.ContactPair(data, [f"block/{side}" for side in sides], obstacle)
    return problem_of(data, [pair], [fm.dirichlet(V, data, f"block/{fixed}", (0.0, 0.0))], u)


def passages(problem):
    return problem.solve(accept_violations=True).certificate.passages


ALL_SIDES = ("left", "right", "top", "bottom")
SCENES = {
    "paddle": (paddle, (-0.1, 0.6, 0.2, 0.2), ("left", "right"), 0.1),
    "thick block": (paddle, (-0.1, 0.7, 0.2, 0.5), ALL_SIDES, 0.1),
    "top": (leaf, (-0.1, 0.6, 0.2, 0.2), ("top",), 0.1),
    "thin block": (paddle, (-0.004, 0.5, 0.008, 0.3), ("left", "right"), 0.1),
    "pin": (pin, (-0.02, 0.4, 0.04, 0.7), ("left",), 0.2),
    "function": (
        lambda: fm.SignedDistance(distance_of_leaf, pivot=(0.0, 0.0), name="paddle"),
        (-0.1, 0.6, 0.2, 0.2),
        ("left", "right"),
        0.1,
    ),
}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize(
    ("degrees", "touches"),
    [
        (150, True),
        (60, False),
        (200, True),
        (-150, False),
        (-250, False),
        (-300, True),
        (400, True),
    ],
)
def test_obstacle_that_turns_is_followed_by_its_angle(scene, degrees, touches):
    """The block is at 90 degrees; the angle is larger than a turn, or of the other sense."""
    obstacle, box, sides, size = SCENES[scene]
    turning = obstacle()
    problem = block_past(turning, box, sides, size, "bottom" if scene == "top" else "top")
    turning.move(angle=np.radians(degrees))
    found = passages(problem)
    assert bool(found) == touches
    assert all("'paddle'" in message for message in found)


@pytest.mark.parametrize("degrees", [120, 150, 180, 360, 500, -250])
def test_obstacle_that_turns_below_a_block_does_not_touch_it(degrees):
    turning = paddle()
    problem = block_past(turning, (-0.1, 1.1, 0.2, 0.2), ALL_SIDES)
    turning.move(angle=np.radians(degrees))
    assert passages(problem) == []


@pytest.mark.parametrize(("degrees", "touches"), [(150, True), (-150, False)])
def test_obstacle_turns_about_its_moving_pivot(degrees, touches):
    turning = paddle()
    problem = block_past(turning, (-0.1, 1.6, 0.2, 0.2), ALL_SIDES)
    turning.move(y=1.0, angle=np.radians(degrees))
    assert bool(passages(problem)) == touches


WHEELS = {
    "circle": lambda: fm.Circle((0.0, 0.5), 0.5, name="wheel"),
    "spline": lambda: fm.Spline(
        0.5 * np.stack([np.cos(AROUND), 1.0 + np.sin(AROUND)], axis=1), closed=True, name="wheel"
    ),
}


@pytest.mark.parametrize("turn", [2.0, 3.0, 4.0, -2.5, 6.5])
@pytest.mark.parametrize(
    ("kind", "driven"), [("circle", False), ("spline", False), ("circle", True)]
)
def test_wheel_that_spins_in_place_does_not_go_through_the_block(kind, driven, turn):
    wheel = WHEELS[kind]()
    data = read(rectangles, size=0.15, block=(-1.0, -1.0, 2.0, 1.0))
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    pair = fm.ContactPair(data, "block/top", wheel, law=fm.Coulomb(0.3))
    problem = problem_of(data, [pair], [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))], u)
    for depth in (0.03, 0.06):
        if driven:
            wheel.push(y=-50.0 * depth)
        else:
            wheel.move(y=-depth)
        problem.solve()
    wheel.move(angle=turn)
    report = problem.solve(accept_violations=True)
    assert report.certificate.passages == [] and report.certificate.possible_passages == []


def test_path_of_a_paddle_ends_in_contact_with_the_block():
    """A turn by 400 degrees is cut until the paddle touches the block at 84 degrees."""
    turning = paddle()
    problem = block_past(turning, (-0.1, 0.6, 0.2, 0.2), ("left", "right"))

    def load(time):
        turning.move(angle=np.radians(400.0 * time))

    options = fm.SteppingOptions(step=1.0, smallest=0.1)
    with pytest.raises(fm.NotConvergedError, match="went through obstacle 'paddle'") as error:
        fm.follow_path(problem, load, options)
    assert 400.0 * error.value.report.steps[-1].time < 84.0


def test_motion_in_time_is_cut_at_a_passage():
    turning = paddle()
    problem = block_past(turning, (-0.1, 0.6, 0.2, 0.2), ("left", "right"))
    motion = fm.Dynamics(problem, 1.0)

    def load(time):
        turning.move(angle=np.radians(400.0 * time))

    options = fm.SteppingOptions(step=0.4, smallest=0.05)
    with pytest.raises(fm.NotConvergedError, match="went through obstacle 'paddle'"):
        motion.run(1.0, options, load)
    assert 0.0 < 400.0 * motion.time < 84.0


# Bodies

ARM = (-0.05, -0.05, 1.05, 0.1)


def in_arm(x):
    return (x[0] > -0.06) & (x[0] < 1.01) & (np.abs(x[1]) < 0.06)


def arm_past(post, degrees, is_hub=in_arm):
    """An arm whose nodes ``is_hub`` are turned about the origin, and a fixed post."""
    data = read(rectangles, size=0.1, arm=ARM, post=post)
    V = fm.vector_space(data.mesh, 1)
    u, turning = fem.Function(V), fem.Function(V)
    bcs = [fem.dirichletbc(turning, fem.locate_dofs_geometrical(V, is_hub))]
    bcs += [fm.dirichlet(V, data, f"post/{side}", (0.0, 0.0)) for side in ("bottom", "top")]
    pair = fm.ContactPair(data, "post/left", "arm/top", search_radius=0.05)
    problem = problem_of(data, [pair], bcs, u)
    move = rotation(np.radians(degrees)) - np.eye(2)
    turning.interpolate(lambda x: move @ x[:2])
    return problem, turning


ABOVE, BELOW, BEYOND = (-0.1, 0.6, 0.2, 0.2), (-0.1, -0.8, 0.2, 0.2), (-0.1, 1.1, 0.2, 0.2)


@pytest.mark.parametrize(
    ("post", "degrees", "touches"),
    [
        (ABOVE, 150, True),
        (ABOVE, 170, True),
        (BELOW, 150, False),
        (BELOW, -150, True),
        (BEYOND, 150, False),
        (BEYOND, -170, False),
    ],
)
@pytest.mark.parametrize("hub", ["arm", "end"])
def test_body_whose_prescribed_nodes_turn_is_followed_about_their_centre(
    post, degrees, touches, hub
):
    problem, _ = arm_past(
        post, degrees, in_arm if hub == "arm" else lambda x: in_arm(x) & (x[0] < 0.06)
    )
    move_body(problem, lambda x: in_arm(x.T), turned(np.zeros(2), degrees))
    crossings, places = problem.equations.crossings, problem.equations.motions.places
    found, possible = crossings.passages(places)
    assert bool(found) == touches
    # the ends of the step do not exclude the other sense
    assert all("unless a body turned the other way round" in message for message in found)
    assert bool(possible) == (not touches and post != BEYOND)


@pytest.mark.parametrize(
    ("degrees", "touches"),
    [(60, False), (150, True), (-200, False), (250, True), (-300, True), (350, True), (400, True)],
)
@pytest.mark.parametrize("post", [ABOVE, BEYOND])
def test_body_on_a_rigid_boundary_is_followed_by_its_angle(post, degrees, touches):
    """Also by more than half a turn, and by a full one."""
    data = read(rectangles, size=0.1, arm=ARM, post=post)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    bcs = [
        fm.dirichlet(u.function_space, data, f"post/{side}", (0.0, 0.0))
        for side in ("bottom", "top")
    ]
    hub = fm.RigidBoundary(data, ["arm/left", "arm/bottom"], pivot=(0.0, 0.0))
    pair = fm.ContactPair(data, "post/left", "arm/top", search_radius=0.05)
    problem = problem_of(data, [pair], bcs, u, remote=[hub])
    hub.move(angle=np.radians(degrees))
    certificate = problem.solve(accept_violations=True).certificate
    assert bool(certificate.passages) == (touches and post == ABOVE)
    assert certificate.possible_passages == []
    assert not any("unless" in message for message in certificate.passages)


def test_turn_whose_sense_is_unknown_is_a_remark_and_cut_in_a_path():
    """By 200 degrees, which could be -160: only the former passes the post."""
    problem, turning = arm_past(ABOVE, 200.0)
    start = problem.state()
    report = problem.solve()
    assert report.certificate.violations() == []
    (remark,) = report.certificate.remarks()
    assert "do not tell how bodies turned" in remark and "the other way round" in remark
    assert any(remark in note for note in report.notes)
    problem.restore(start)

    def load(time):
        move = rotation(np.radians(-200.0 * time)) - np.eye(2)
        turning.interpolate(lambda x: move @ x[:2])

    path = fm.follow_path(problem, load, fm.SteppingOptions(step=1.0, smallest=1e-2))
    assert path.finished and all(not step.report.certificate.remarks() for step in path.steps)


@pytest.mark.parametrize("pivot", [(0.0, 0.0), (3.0, -2.0)])
@pytest.mark.parametrize("is_free", [False, True])
def test_body_that_turns_with_an_obstacle_is_carried_by_it(pivot, is_free):
    bar = fm.Polygon([(-1, -0.2), (1, -0.2), (1, 0), (-1, 0)], 0.02, pivot=pivot, name="bar")
    data = read(rectangles, size=0.2, block=(-0.3, 0.0, 0.6, 0.3))
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    bcs = [] if is_free else [fm.dirichlet(V, data, "block/top", (0.0, 0.0))]
    load = fem.Constant(data.mesh, -1e-3) * v[1] * DX
    problem = problem_of(data, [fm.ContactPair(data, "block/bottom", bar)], bcs, u, load)
    for degrees in (150.0, -200.0, 300.0):
        bar.move(angle=np.radians(degrees))
        move_body(problem, lambda x: x[:, 1] > -9.0, turned(np.array(pivot), degrees))
        crossings, places = problem.equations.crossings, problem.equations.motions.places
        assert crossings.passages(places) == ([], [])
        move_body(problem, lambda x: x[:, 1] > -9.0, turned(np.array(pivot), -degrees))


def test_paths_deep_inside_a_body_are_judged_by_few_of_their_points(monkeypatch):
    """A block moves through another one, by seven times its width: 56 facets."""
    grids = [
        Grid("wall", block(8, 8, width=1.0, height=1.0)),
        Grid("block", block(8, 8, width=1.0, height=1.0, corner=(-1.5, 0.0))),
    ]
    data = mapped_grids.mesh(grids)
    V = fm.vector_space(data.mesh, 1)
    u, moved = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)), u,
        [fm.ContactPair(data, "block/right", "wall/left")],
        bcs=[
            fm.dirichlet(V, data, "wall/bottom", (0.0, 0.0)),
            fm.dirichlet(V, data, "block/left", moved),
        ],
        petsc_options_prefix="through_",
    )  # fmt: skip
    problem.solve()
    counts = []

    def counted(outline, x, body, points):
        counts.append(len(points))
        return depths_in_body(outline, x, body, points)

    monkeypatch.setattr(module_of_passages, "depths_in_body", counted)
    moved.value[:] = (7.0, 0.01)
    with refused(fm.NotConvergedError, "went through body"):
        problem.solve()
    every = len(problem.equations.crossings.outline.X)
    assert 0 < sum(counts) <= module_of_passages.POINTS_ON_PATH * every
