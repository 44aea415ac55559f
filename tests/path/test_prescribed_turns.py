# SPDX-License-Identifier: MIT
"""Steps in which prescribed values turn a body so far that their ends do not tell the direction."""

import numpy as np
import pytest
from friction_scenes import block_on
from scenes import internal, neo_hookean, read, rotation
from turning_scenes import shaft_in_ring

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.equations.turns import loads_of_step
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block, sector

STEP = fm.SteppingOptions(1.0, smallest=1.0 / 64)


def wheel_on_plane(*, law=None, remote=False):
    """An elastic tyre about a rigid hub, pressed by 0.02 onto a fixed plane below."""
    angles = (-np.pi / 2, 1.5 * np.pi)
    grid = Grid("tyre", sector(36, 2, radii=(0.35, 0.5), angles=angles), closed=True)
    data = read(mapped_grids.build, grids=[grid])
    V = fm.vector_space(data.mesh, 1)
    u, hub = fem.Function(V), fem.Function(V)
    axle = fm.RigidBoundary(data, "tyre/top", pivot=(0.0, 0.0))
    given = {"remote": [axle]} if remote else {"bcs": [fm.dirichlet(V, data, "tyre/top", hub)]}
    plane = fm.Plane((0.0, -0.5), (0.0, 1.0))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 1.0, 0.3)),
        u,
        [fm.ContactPair(data, "tyre/bottom", plane, law=law or fm.Coulomb(0.2))],
        petsc_options_prefix="tyre_",
        **given,
    )

    def set_angle(angle):
        axle.move(y=-0.02, angle=angle)
        hub.interpolate(lambda x: (rotation(angle) - np.eye(2)) @ x[:2] - [[0.0], [0.02]])

    set_angle(0.0)
    problem.solve()
    return problem, set_angle


@pytest.mark.once
@pytest.mark.parametrize("degrees", [150.0, 250.0, -330.0, 360.0, 700.0, 1080.0])
def test_shaft_turns_in_steps_of_known_direction(degrees):
    """In one step of the path, cut until each part is below 135 degrees; friction opposes all."""
    shaft, angle = shaft_in_ring(fm.Coulomb(0.3)), np.radians(degrees)
    path = fm.follow_path(shaft.problem, lambda t: shaft.set_angle(t * angle), STEP)
    assert all(step.step * abs(degrees) < 135.1 for step in path.steps)
    assert 0 < path.num_cuts < max(5, len(path.steps))  # a length that fails is seldom tried again
    assert sum(step.work.friction for step in path.steps) > 0.0
    assert shaft.moment * degrees > 0.0  # that of the reaction to friction


@pytest.mark.parametrize("remote", [False, True])
def test_wheel_that_turns_on_a_plane_drags_it_the_right_way(remote):
    """By 300 degrees: its lowest point moves to the right, friction acts to the left."""
    problem, set_angle = wheel_on_plane(remote=remote)
    fm.follow_path(problem, lambda t: set_angle(t * np.radians(300.0)), STEP)
    contact = problem.equations.contacts[0]
    normal = float(contact.operators.weight @ contact.now.z_n)
    assert contact.total_force[0] == pytest.approx(-0.2 * normal, rel=1e-3)


@pytest.mark.parametrize("degrees", [120.0, 300.0, 620.0])
def test_tyre_on_a_rigid_hub_is_known_to_turn(degrees):
    """By any angle, if the nodes in contact at its end were not in contact at its start."""
    problem, set_angle = wheel_on_plane(remote=True)
    set_angle(np.radians(20.0))
    problem.solve()
    set_angle(np.radians(20.0 + degrees))
    assert not any("rotation" in text for text in problem.solve().certificate.remarks())
    contact = problem.equations.contacts[0]
    assert contact.total_force[0] < 0.0
    slip = contact.slip[contact.active]
    assert np.allclose(slip, 0.5 * np.radians(degrees), rtol=0.05), slip


@pytest.mark.serial
def test_arm_does_not_pass_through_a_block_by_a_turn():
    """By 340 degrees, which look like 20 the other way round; the block is above the hub."""
    grids = [
        Grid("arm", block(12, 2, width=1.2, height=0.1, corner=(0.0, -0.05))),
        Grid("block", block(3, 3, width=0.3, height=0.3, corner=(-0.15, 0.6))),
    ]
    data = mapped_grids.mesh(grids, cell="quadrilateral")
    V = fm.vector_space(data.mesh, 1)
    u, hub = fem.Function(V), fem.Function(V)
    sides = [f"block/{side}" for side in ("bottom", "right", "top", "left")]
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 10.0, 0.3)),
        u,
        [fm.ContactPair(data, sides, ["arm/top", "arm/right"])],
        bcs=[
            fm.dirichlet(V, data, "block/bottom", (0.0, 0.0)),
            fm.dirichlet(V, data, ["arm/left", "arm/bottom"], hub),
        ],
        petsc_options_prefix="arm_",
    )

    def turn(time):
        R = rotation(time * np.radians(340.0))
        hub.interpolate(lambda x: (R - np.eye(2)) @ x[:2])

    with pytest.raises(fm.NotConvergedError, match="the path ends at 0.2"):
        fm.follow_path(problem, turn, STEP)


def test_step_that_cannot_be_cut_is_refused():
    shaft = shaft_in_ring(fm.Coulomb(0.3))
    fixed = fm.SteppingOptions(1.0, smallest=1.0)
    with pytest.raises(fm.NotConvergedError, match="body 'shaft' turns by at least 300 degrees"):
        fm.follow_path(shaft.problem, lambda t: shaft.set_angle(t * np.radians(300.0)), fixed)
    assert not shaft.bore.x.array.any()  # the loads are those of the start


@pytest.mark.parametrize("scheme", ["conserving", "generalized_alpha"])
def test_time_steps_are_cut_too(scheme):
    problem, set_angle = wheel_on_plane()
    motion = fm.Dynamics(problem, 1e-3, scheme=scheme)
    record = motion.run(1.0, STEP, lambda t: set_angle(t * np.radians(310.0)))
    assert len(record.steps) > 2
    assert problem.equations.contacts[0].total_force[0] < 0.0


def test_bodies_that_turn_together_do_not_turn_relative_to_each_other():
    """Nothing is refused, though both turn by more than half a turn; nor is there any slip."""
    shaft = shaft_in_ring(fm.Coulomb(0.3))
    with loads_of_step(shaft.problem.equations, shaft.set_both, 0.0, 4.0):
        pass
    one = loads_of_step(shaft.problem.equations, shaft.set_angle, 0.0, 4.0)
    with pytest.raises(fm.NotConvergedError), one:
        pass


def test_constants_alone_turn_nothing():
    """The function of the loads is then called for the ends of the steps only."""
    wheel, times = fm.Circle((0.5, -0.5), 0.5, name="wheel"), []
    problem, _ = block_on(wheel)

    def set_loads(time):
        times.append(time)
        wheel.move(y=0.02 * time, angle=5.0 * time)

    fm.follow_path(problem, set_loads, fm.SteppingOptions(0.5))
    assert times == [0.5, 1.0]
