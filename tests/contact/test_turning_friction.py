# SPDX-License-Identifier: MIT
"""Slip of wheels and shafts that turn by any angle in a step, and of whole scenes that turn."""

import re

import numpy as np
import pytest
from friction_scenes import NU, E, block_on
from scenes import TIGHT, internal, neo_hookean, read, rectangles, rotation
from turning_scenes import RADIUS, shaft_in_ring, wheel_under_block

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact import arcs
from fenics_mortar.contact.arcs import rotation_past_obstacle
from fenics_mortar.contact.slip import PlanePartners
from fenics_mortar.laws import Worn
from fenics_mortar.obstacles.rigid_motion import STRETCHED, turn_of
from meshes.mapped_grids import Grid, build, sector

MU, TURN = 0.3, 2.0 * np.pi


def normal_force(contact):
    return float(contact.operators.weight @ contact.now.z_n)


@pytest.mark.parametrize("angle", [2.0, -3.0, 4.0, 5.0, TURN, 3.0 * TURN + 1.0])
def test_turned_wheel_pushes_the_block_along(angle):
    """Below the block, turned clockwise (negative angles) the wheel pushes it to the right.

    The moment does the work of friction to rounding, as slip is that of the nodes.
    """
    problem, wheel = wheel_under_block(fm.Coulomb(MU))
    contact = problem.equations.contacts[0]
    wheel.move(angle=angle)
    problem.solve()
    assert contact.total_force[0] * angle < 0.0
    assert abs(contact.now.shear_force.sum()) == pytest.approx(MU * normal_force(contact))
    wheel.move(angle=2.0 * angle)
    report = problem.solve()
    work = wheel.reaction[2] * angle
    assert contact.now.friction_work == pytest.approx(-work, rel=1e-8)
    assert report.certificate.pairs[0]["friction_work"].value < 1e-8


@pytest.mark.parametrize("steps", [16, 7, 5, 1])
def test_wear_over_a_turn_does_not_depend_on_the_steps(steps):
    """Up to the distance of the nodes from the wheel, of the order h^2 / (8 R)."""
    wear = 1e-7  # too little to change the pressure
    problem, wheel = wheel_under_block(Worn(0.1, wear))
    contact = problem.equations.contacts[0]
    for step in range(steps):
        wheel.move(angle=TURN * (step + 1) / steps)
        problem.solve()
    j = np.argmax(contact.pressure)
    depth = contact.state.accepted_instant.memory["depth"][j]
    assert depth == pytest.approx(wear * contact.pressure[j] * TURN * RADIUS, rel=5e-3)


@pytest.mark.parametrize("slave", ["shaft", "ring"])
@pytest.mark.parametrize("per_turn", [8, 4, 3])
def test_shaft_in_a_ring_dissipates_the_work_of_its_moment(per_turn, slave):
    shaft = shaft_in_ring(fm.Coulomb(MU), slave=slave)
    contact = shaft.problem.equations.contacts[0]
    step = TURN / per_turn
    shaft.turn(step)
    report = shaft.turn(2.0 * step)
    sign = -1.0 if slave == "shaft" else 1.0
    assert contact.now.friction_work == pytest.approx(-sign * shaft.moment * step, rel=1e-3)
    assert contact.now.friction_work > 0.0
    assert report.certificate.pairs[0]["friction_work"].value < 1e-3


def test_direction_of_almost_half_a_turn_is_uncertain():
    shaft = shaft_in_ring(fm.Coulomb(MU))
    message = "known up to a full turn only, .* take smaller steps, in which bodies turn by less"
    with pytest.raises(fm.NotConvergedError, match=message):
        shaft.turn(0.85 * np.pi)


@pytest.mark.parametrize("angle", [-1.3 * np.pi, -1.6 * np.pi, 0.5 * np.pi])
def test_turn_that_may_have_had_the_other_direction_is_remarked(angle):
    """By 234, 288 or 90 degrees: nothing tells these from 126, 72 and 270 the other way round."""
    certificate = shaft_in_ring(fm.Coulomb(MU)).turn(angle).certificate
    assert certificate.violations() == []
    (remark,) = certificate.remarks()
    found = re.search(r"is (\d+) degrees, if not (\d+) the other way round", remark)
    turned, other = (float(text) for text in found.groups())
    # Friction twists shaft and ring: the sides turn by up to 6 degrees less than the bore.
    assert turned == pytest.approx(np.degrees(min(abs(angle), TURN - abs(angle))), abs=6.0)
    assert turned + other == 360.0


@pytest.mark.parametrize("slave", ["shaft", "ring"])
@pytest.mark.parametrize("degrees", [100.0, 150.0, -260.0, 300.0, 345.0, -360.0])
def test_turn_of_a_rigid_boundary_is_known(degrees, slave):
    """The ends of a step look like those of a turn by up to 180 degrees, maybe the other way."""
    shaft = shaft_in_ring(fm.Coulomb(0.2), slave=slave, on_axle=True)
    shaft.turn(np.radians(20.0))
    angle = np.radians(20.0 + degrees)
    if abs(degrees) > 180.0:
        with pytest.raises(fm.NotConvergedError, match="known up to a full turn only"):
            shaft.turn(angle)
        return
    assert shaft.turn(angle).certificate.remarks() == []
    work = shaft.problem.equations.contacts[0].now.friction_work
    assert work == pytest.approx(abs(shaft.moment) * np.radians(abs(degrees)), rel=1e-3)


@pytest.mark.parametrize("degrees", [225.0, 301.0, -330.0, 345.0, 352.0, 360.0, -360.0, 720.0])
@pytest.mark.parametrize("first", [0.0, 20.0])
def test_turn_beyond_half_a_turn_is_told(degrees, first):
    """The values are those of a turn the other way: friction is, too."""
    shaft = shaft_in_ring(fm.Coulomb(MU))
    shaft.turn(np.radians(first))
    try:
        remarks = shaft.turn(np.radians(first + degrees)).certificate.remarks()
    except fm.NotConvergedError as error:
        remarks = [str(error)]
    (told,) = (text for text in remarks if "RigidBoundary" in text or "take smaller" in text)
    if abs(degrees) > 300.0 and degrees % 360.0:
        other = 360.0 - abs(degrees)
        assert f"by {other:.0f} degrees in the step, if not by {abs(degrees):.0f}" in told


@pytest.mark.parametrize("degrees", [355.5, 357.0, -359.5, 361.0, 364.0, 717.0, 3.0])
def test_turn_that_looks_like_a_small_one_is_noted(degrees):
    """Once, and again if its sense changes; its certificate has no remark."""
    shaft = shaft_in_ring(fm.Coulomb(MU))
    angles, noted = np.radians(degrees) * np.arange(1, 4), []
    for angle in (*angles, angles[1]):
        report = shaft.turn(angle)
        assert report.certificate.remarks() == []
        noted.append(sum("their ends do not tell" in note for note in report.notes))
    assert noted == [1, 0, 0, 1]


@pytest.mark.parametrize("on_axle", [False, True])
def test_turn_of_known_direction_is_no_doubt(on_axle):
    """By an eighth of a known angle, or by a turn that is one of 120 a round."""
    shaft = shaft_in_ring(fm.Coulomb(MU), on_axle=on_axle)
    certificate = shaft.turn(TURN / 8 if on_axle else TURN / 120).certificate
    assert certificate.remarks() == []


def test_turn_without_friction_is_no_doubt():
    certificate = shaft_in_ring(fm.Frictionless()).turn(TURN / 12).certificate
    assert certificate.remarks() == []


def test_turns_of_a_path_are_known():
    shaft = shaft_in_ring(fm.Coulomb(MU))
    steps = fm.SteppingOptions(0.5)
    path = fm.follow_path(shaft.problem, lambda t: shaft.set_angle(t * TURN / 8), steps)
    assert [step.report.certificate.remarks() for step in path.steps] == [[], []]


def test_bent_beam_does_not_turn():
    """Its ends are prescribed; one is lifted."""
    x0 = np.array([[0.0, 0.0], [0.0, 0.2], [1.0, 0.0], [1.0, 0.2]])
    x1 = x0 + np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.3], [0.0, 0.3]])
    assert abs(turn_of(x0, x1, np.inf)[0]) > TURN / 36
    assert turn_of(x0, x1, STRETCHED)[0] == 0.0
    assert turn_of(x0, x0 @ rotation(0.2).T, STRETCHED)[0] == pytest.approx(0.2)


def test_path_takes_smaller_steps_than_half_a_turn():
    shaft = shaft_in_ring(fm.Coulomb(MU))
    path = fm.follow_path(shaft.problem, shaft.set_angle, fm.SteppingOptions(3.0), stop=3.0)
    assert path.num_cuts == 1
    contact = shaft.problem.equations.contacts[0]
    work = contact.now.friction_work
    assert work == pytest.approx(abs(shaft.moment) * path.steps[-1].step, rel=1e-3)
    turned = abs(shaft.moment) * 3.0  # but for the turn that strains the bodies before they slide
    assert 0.95 * turned < path.friction_work < turned


@pytest.mark.parametrize("angle", [1.0, 3.0, 4.0])
def test_whole_scene_turns_without_slip(angle):
    """Block and wheel about a far point, whichever pivot describes the wheel."""
    radius = 2.0
    wheel = fm.Circle((0.5, -radius), radius, name="wheel")
    problem, _ = block_on(wheel, law=fm.Coulomb(MU))
    wheel.move(y=0.02)
    problem.solve()
    contact, u = problem.equations.contacts[0], problem.equations.bulk.u
    X = problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2]
    about, R = np.array([3.0, 1.0]), rotation(angle)
    x = X + u.x.array.reshape(-1, 2)
    u.x.array[:] = (about + (x - about) @ R.T - X).ravel()
    centre = wheel.pivot + wheel.place[:2]
    x, y = about + R @ (centre - about) - wheel.pivot
    contact.start_step()
    wheel.move(x=x, y=y, angle=angle)
    contact.evaluate(u.x.array, problem.equations.linearization)
    assert np.abs(contact.slip).max() < 1e-14


@pytest.mark.parametrize("angle", [0.8, 2.0, 5.0])
def test_wheel_that_rolls_over_a_block_does_not_slip(angle):
    """In one step, which ends below a node; if it turns less, it slides by the rest.

    The facets beside the node are not deformed: an offset closes its mean gap.
    """
    problem, wheel = wheel_under_block(fm.Coulomb(MU), depth=0.0)
    contact, u = problem.equations.contacts[0], problem.equations.bulk.u
    node = np.abs(contact.slave.X[:, 0] - 0.5).argmin()
    end = contact.slave.X[node, 0] - 0.5
    wheel.move(x=end)
    contact.evaluate(u.x.array, problem.equations.linearization)
    contact.offset = np.full(len(contact.z), contact.gap[node])
    wheel.move(x=end - RADIUS * angle)
    contact.evaluate(u.x.array, problem.equations.linearization)
    contact.accept()
    contact.start_step()
    for fraction in (1.0, 0.9):
        wheel.move(x=end, angle=fraction * angle)
        contact.evaluate(u.x.array, problem.equations.linearization)
        slid = (1.0 - fraction) * RADIUS * angle
        assert contact.slip[node] == pytest.approx(-slid, rel=1e-12, abs=1e-13)


@pytest.mark.parametrize("pivot", [(0.0, 0.0), (30.0, -7.0)])
def test_slip_around_a_fixed_wheel_is_the_arc(pivot):
    """A block with a curved side slides along a wheel by a third of a turn.

    Its nodes are on the wheel, its facets are not: an offset closes the mean gaps.
    """
    radius, angle = 1.0, TURN / 3.0
    grid = Grid("block", sector(6, 2, radii=(radius, 1.3), angles=(-0.3, 0.3)))
    data = read(build, grids=[grid])
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)

    def distance(x):
        r = np.linalg.norm(x, axis=1)
        e = x / r[:, None]
        return r - radius, e, (np.eye(2) - e[:, :, None] * e[:, None]) / r[:, None, None]

    wheel = fm.SignedDistance(distance, pivot=pivot)
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)),
        u,
        [fm.ContactPair(data, "block/top", wheel, law=fm.Coulomb(MU))],
        bcs=[fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))],
        petsc_options_prefix="test_",
        newton=TIGHT,
    )
    contact = problem.equations.contacts[0]
    contact.offset = contact.gap
    X = V.tabulate_dof_coordinates()[:, :2]
    u.x.array[:] = (X @ rotation(angle).T - X).ravel()
    contact.evaluate(u.x.array, problem.equations.linearization)
    assert np.allclose(contact.slip, -angle * radius, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("other", [-1.0, 0.5])
def test_slip_between_two_turning_rings(other):
    """The shaft turns by 100 degrees, the ring by another angle: they slip by the difference."""
    shaft = shaft_in_ring(fm.Coulomb(MU))
    problem, angle = shaft.problem, np.radians(100.0)
    contact, u = problem.equations.contacts[0], problem.equations.bulk.u
    X = problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2]
    x = X + u.x.array.reshape(-1, 2)
    inner = (np.linalg.norm(X, axis=1) < 1.0 + 1e-9)[:, None]
    inner |= np.isclose(np.linalg.norm(X, axis=1), 1.03)[:, None]
    inner &= ~np.isclose(np.linalg.norm(X, axis=1), 1.0)[:, None]
    turned = np.where(inner, x @ rotation(angle).T, x @ rotation(other * 0.3).T)
    radius = np.linalg.norm(contact.operators.x, axis=1)
    contact.start_step()
    contact.evaluate((turned - X).ravel(), problem.equations.linearization)
    assert np.allclose(np.abs(contact.slip), (angle - 0.3 * other) * radius, rtol=1e-2)


@pytest.mark.parametrize("angle", [1.0, 5.0])
def test_tangent_of_turned_wheels(angle):
    """Prescribed by angle, and driven by a moment and a force."""
    problem, wheel = wheel_under_block(fm.Coulomb(MU))
    wheel.move(angle=angle)
    problem.solve()
    slopes = problem.check_tangent(print_table=False).slopes
    assert min(slopes.values()) > 1.9
    wheel.push(moment=0.5 * float(wheel.reaction[2]), y=0.0)
    problem.equations.contacts[0].start_step()
    slopes = problem.check_tangent(print_table=False).slopes
    assert min(slopes.values()) > 1.9


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("slip", ["partners", "operators"])
def test_tangent_of_turned_shafts(slip, degree):
    """In the middle of a step of a quarter of a turn."""
    shaft = shaft_in_ring(fm.Coulomb(MU), degree=degree, slip=slip, columns=24 // degree)
    shaft.turn(0.25 * TURN)
    slopes = shaft.problem.check_tangent(print_table=False).slopes
    assert min(slopes.values()) > 1.9


def test_a_chord_is_found_by_the_work_of_the_moment(monkeypatch):
    """Along the tangent, as if nothing had turned, the slip of an eighth of a turn is 10 % less."""
    problem, wheel = wheel_under_block(fm.Coulomb(MU))

    def remarked(angle):
        wheel.move(angle=angle)
        remarks = problem.solve().certificate.remarks()
        return any("the work of friction by slip differs by 10% from" in line for line in remarks)

    def along_chord(self, o):
        return np.einsum("jc,jc->j", o.tau, self.gap_vectors(o))

    assert not remarked(0.1) and not remarked(0.1 + TURN / 8)
    monkeypatch.setattr(PlanePartners, "slip", along_chord)
    assert remarked(0.1 + TURN / 4)


def test_rotations_of_bodies_differ_from_those_of_obstacles():
    """A supported body does not follow a wheel; a body that turned as far as an obstacle did."""

    def found(of_body, of_obstacle):
        known = of_body - TURN * np.round(of_body / TURN)  # up to full turns
        return rotation_past_obstacle(np.array([known]), of_obstacle)

    for angle in (0.3, 3.0, 5.0, TURN, -TURN, 20.0):
        assert found(0.1, angle).theta == pytest.approx(angle - 0.1)
        assert found(0.1, angle).doubt <= arcs.MAX_ROTATION
    for angle in (1.0, 3.0, 4.0, -4.0):
        assert found(angle, angle).theta == pytest.approx(0.0, abs=1e-14)
        assert found(angle - 0.2, angle).theta == pytest.approx(0.2)
    assert found(2.0, 0.0).theta == pytest.approx(-2.0)
    assert found(2.5, 0.0).doubt > arcs.MAX_ROTATION
    assert found(1.5, 5.0).doubt > arcs.MAX_ROTATION


@pytest.mark.serial
@pytest.mark.parametrize("scheme", ["conserving", "generalized_alpha"])
def test_grinding_wheel_throws_the_block_the_right_way(scheme):
    """By 5 radian in a time step; a heavy block lies on the wheel and is accelerated by mu g."""
    data = read(rectangles, size=0.25, block=(0.0, 0.0, 1.0, 0.5))
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    weight = fem.Constant(data.mesh, (0.0, 1.0))  # the residual has minus the load
    wheel = fm.Circle((0.5, -2.0), 2.0, name="wheel")
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 1e4, NU)) + ufl.inner(weight, v) * ufl.dx,
        u,
        [fm.ContactPair(data, "block/bottom", wheel, law=fm.Coulomb(MU))],
        petsc_options_prefix="test_",
    )
    problem.solve()
    motion, contact = fm.Dynamics(problem, 1.0, scheme=scheme), problem.equations.contacts[0]
    speed, dt = -500.0, 0.01  # clockwise: the block is thrown to the right
    for step in (1, 2):
        wheel.move(angle=speed * dt * step)
        motion.step(dt)
        friction = abs(contact.now.shear_force.sum())
        assert friction == pytest.approx(MU * normal_force(contact), rel=1e-6)
        assert contact.now.friction_work == pytest.approx(friction * 2.0 * -speed * dt, rel=1e-2)
    along = fem.assemble_scalar(fem.form(motion.velocity[0] * ufl.dx)) / 0.5
    along = data.mesh.comm.allreduce(along)
    assert along == pytest.approx(1.5 * dt * MU, rel=0.1)
