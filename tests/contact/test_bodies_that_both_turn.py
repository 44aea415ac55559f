# SPDX-License-Identifier: MIT
"""Slip between bodies that both turn: contact stays in place while material passes through it."""

import numpy as np
import pytest
from scenes import rotation
from turning_scenes import problem_of, rollers, shaft_in_ring

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact.arcs import Carried, way_of
from fenics_mortar.contact.slip import lead
from fenics_mortar.obstacles.rigid_motion import rotation_by
from meshes.mapped_grids import Grid, block, sector

MU, TURN = 0.2, 2.0 * np.pi
TYRES = {
    "equal": {"columns": (96, 110)},
    "small slave": {"columns": (62, 150), "radii": (0.25, 0.75), "hubs": (0.1, 0.35)},
    "small master": {"columns": (120, 74), "radii": (0.5, 0.25), "hubs": (0.2, 0.1)},
}


def turned_twice(tyres, ratio, per_turn, depth=0.01):
    """The problem after two steps of two tyres, and both hubs; the right turns ``ratio`` as far."""
    problem, left, right = rollers(fm.Coulomb(MU), **TYRES[tyres])
    right.move(x=-depth)
    problem.solve()
    for step in (1, 2):
        left.move(angle=step * TURN / per_turn)
        right.move(x=-depth, angle=ratio * step * TURN / per_turn)
        report = problem.solve()
    return problem, left, right, report


@pytest.mark.parametrize("slave", ["shaft", "ring"])
@pytest.mark.parametrize("grow, shrink", [(0.035, 0.0), (0.02, 0.005)])
def test_a_shaft_that_is_widened_while_all_turns_about_one_pivot_does_not_slip(slave, grow, shrink):
    """Nodes come into contact in the step. By ``grow`` the bore moves, not as one: not led."""
    law = fm.Coulomb(0.5)
    scene = shaft_in_ring(law, interference=-0.004, columns=24, slave=slave)
    R = rotation(0.6)
    scene.bore.interpolate(lambda x: ((1.0 + grow) * R - np.eye(2)) @ x[:2])
    scene.outside.interpolate(lambda x: ((1.0 - shrink) * R - np.eye(2)) @ x[:2])
    scene.problem.solve()
    contact = scene.problem.equations.contacts[0]
    assert contact.active.all()
    slid = law.mu * contact.pressure.max() * 2.0 * np.pi  # the moment if all slides, radius 1
    assert abs(scene.moment) < 1e-4 * slid


@pytest.mark.parametrize("per_turn", [16, 8, 5])
@pytest.mark.parametrize("ratio", [1.0, 0.4, -0.3, -3.0])
@pytest.mark.parametrize("tyres", TYRES)
def test_friction_does_the_work_of_its_moments(tyres, ratio, per_turn):
    """All nodes slide at their limit, the way that the faster side goes.

    Slip is that of the surfaces' speeds, but for the approach of the tyres, 1 to 4 % of a radius.
    """
    problem, left, right, report = turned_twice(tyres, ratio, per_turn)
    contact, angles = problem.equations.contacts[0], np.array([1.0, ratio]) * TURN / per_turn
    o, work = contact.operators, 0.0
    sides = zip((left, right), o.force(contact.shear), (o.x, o.m), angles, strict=True)
    for hub, force, x, angle in sides:
        arms = x - hub.pivot - hub.place[:2]
        work += angle * (arms[:, 0] * force[:, 1] - arms[:, 1] * force[:, 0]).sum()
    rolled = MU * contact.pressure.max() * np.abs(angles).max()  # where slip is a tenth of the way
    assert contact.now.friction_work == pytest.approx(work, rel=0.01, abs=1e-4 * rolled)
    assert work > 0.0
    if per_turn < 16:  # from tyres turned with their hubs; up to 34 otherwise
        assert report.num_iterations <= 6
    radii = TYRES[tyres].get("radii", (0.5, 0.5))
    slip = contact.slip[contact.active]
    assert np.allclose(slip, angles @ radii, rtol=0.02, atol=0.01 * abs(angles).max()), slip
    assert report.certificate.violations() == []


@pytest.mark.parametrize("per_turn", [8, 5])
def test_moments_of_hubs_do_the_work_of_friction(per_turn):
    """Of tyres that turn the same way; normal forces on facets make the moments of others waver."""
    problem, left, right, report = turned_twice("small slave", 1.0, per_turn)
    moments = abs(left.reaction[2] + right.reaction[2]) * TURN / per_turn
    assert problem.contacts[0].friction_work == pytest.approx(moments, rel=0.01)
    assert not any("turned" in text for text in report.certificate.remarks())


def carried(x, turn, start, end):
    """One node of a body that is led."""
    rows = x, np.atleast_1d(turn), start, end, [1.0]
    return Carried(*(np.array([each], float) for each in rows))


@pytest.mark.parametrize("angle", [0.1, TURN / 8, 3.0, 20.0])
@pytest.mark.parametrize("radii", [(1.0, 1.0), (0.3, 2.0)])
def test_wheels_that_roll_on_each_other_do_not_slip(angle, radii):
    """The point of contact is at the origin; further creep is slip."""
    pivots = [(-radii[0], 0.0), (radii[1], 0.0)]
    for creep in (0.0, 0.02):
        turns = angle / radii[0], -(1.0 - creep) * angle / radii[1]
        sides = [carried((0.0, 0.0), turn, p, p) for turn, p in zip(turns, pivots, strict=True)]
        assert way_of(*sides) == pytest.approx(np.array([[0.0, creep * angle]]), abs=1e-14)


def test_a_wheel_that_rolls_on_a_road_does_not_slip():
    """To the contact at the origin; past a belt that goes the other way it slips."""
    angle = TURN / 5
    wheel = carried((0.0, 0.0), -angle, (-angle, 1.0), (0.0, 1.0))
    road = carried((0.0, 0.0), 0.0, (0.0, 0.0), (0.0, 0.0))
    assert np.abs(way_of(wheel, road)).max() < 1e-15
    belt = carried((0.0, 0.0), 0.0, (0.0, -1.0), (-0.3, -1.0))
    assert way_of(wheel, belt) == pytest.approx(np.array([[0.3, 0.0]]))


@pytest.mark.parametrize("both", [0.0, 0.9, -2.0])
@pytest.mark.parametrize("dim", [2, 3])
def test_a_common_turn_adds_no_slip(dim, both):
    """Of two wheels that rub, and everything about a far point besides."""
    axis = np.array([0.0, 0.0, 1.0]) if dim == 3 else np.ones(1)
    R, far, angle = rotation_by(both * axis), np.full(dim, 3.0), np.copysign(TURN / 8, both)
    sides = []
    for x in (-1.0, 1.0):
        pivot = np.zeros(dim)
        pivot[0] = x
        end = far + R @ (pivot - far)
        sides.append(carried(far - R @ far, (both + angle) * axis, pivot, end))
    V = R.T @ way_of(*sides)[0]
    assert np.linalg.norm(V) == pytest.approx(2.0 * abs(angle))
    still = [side._replace(turn=both * axis[None]) for side in sides]
    assert np.abs(way_of(*still)).max() < 1e-14


def test_tyres_that_turn_together_do_not_slip():
    """Both hubs are led about a far point by a radian, and all nodes go along."""
    problem, left, right, _ = turned_twice("equal", 1.0, 8)
    contact, u = problem.equations.contacts[0], problem.equations.bulk.u
    X = problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2]
    about, R = np.array([3.0, 1.0]), rotation(1.0)
    x = X + u.x.array.reshape(-1, 2)
    for hub in (left, right):
        place = hub.place.copy()
        pivot = about + R @ (hub.pivot + place[:2] - about) - hub.pivot
        hub.move(x=pivot[0], y=pivot[1], angle=place[2] + 1.0)
    e = problem.equations
    contact.start_step()
    carried_nodes = e.crossings.led.carried(e.crossings.accepted)
    lead(contact, contact.partners, e.crossings.outline, carried_nodes)
    led = contact.partners.led
    assert led.new.any() and not led.new.all()
    u.x.array[:] = (about + (x - about) @ R.T - X).ravel()
    contact.evaluate(u.x.array, e.linearization)
    assert np.abs(contact.slip).max() < 1e-13


@pytest.mark.parametrize("ratio", [1.0, -0.98])
@pytest.mark.parametrize("degree", [1, 2])
def test_tangent_of_tyres_that_both_turn(degree, ratio):
    """While they rub, and while some nodes stick as they roll."""
    problem, left, right = rollers(fm.Coulomb(MU), columns=(48, 55), degree=degree, layers=2)
    right.move(x=-0.02)
    problem.solve()
    left.move(angle=TURN / 8)
    right.move(x=-0.02, angle=ratio * TURN / 8)
    problem.solve()
    assert problem.check_tangent(print_table=False).slopes["whole"] > 1.9


@pytest.mark.parametrize("ratio", [-0.98, -1.02])
def test_creep_of_tyres_drags_them_the_right_way(ratio):
    """The faster surface is held back, the slower one driven: 2 % of an eighth of a turn."""
    problem, *_ = turned_twice("equal", ratio, 8)
    # the left surface moves up at the contact
    assert np.sign(problem.equations.contacts[0].total_force[1]) == np.sign(-(1.0 + ratio))


def tyre(columns, name="tyre"):
    """A ring of radii 0.2 and 0.5 about the origin."""
    return Grid(name, sector(columns, 3, radii=(0.2, 0.5), angles=(0.02, 0.02 + TURN)), closed=True)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("ratio", "per_turn"), [(1.0, 8), (-0.5, 8), (-5.0, 8), (1.0, 5), (-0.5, 5)]
)
def test_tyre_on_a_wheel_that_turns(ratio, per_turn):
    """A rigid wheel of radius 1; the tyre turns by prescribed values, the wheel by its angle."""
    hub, wheel = [], fm.Circle((0.0, -1.5), 1.0, name="wheel")

    def held(_, V):
        hub.append(fem.Function(V))
        return [fm.dirichlet(V, _, "tyre/top", hub[0])]

    problem = problem_of(
        [tyre(120)],
        lambda data: [fm.ContactPair(data, "tyre/bottom", wheel, law=fm.Coulomb(MU))],
        bcs=held,
    )

    def turn(angle):
        R = rotation(angle) - np.eye(2)
        hub[0].interpolate(lambda x: R @ x[:2])
        wheel.move(y=0.01, angle=ratio * angle)
        problem.solve()

    step = TURN / per_turn
    for angle in (0.0, step, 2.0 * step):
        turn(angle)
    contact = problem.equations.contacts[0]
    slip = contact.slip[contact.active]
    assert np.allclose(slip, step * (0.5 + ratio), rtol=0.02, atol=0.01 * abs(step * ratio)), slip


@pytest.mark.parametrize("creep", [0.0, 0.1])
def test_tyre_that_rolls_along_a_block(creep):
    """By an eighth of a turn; the hub goes as far as the surface, or by a tenth less."""
    grids = [tyre(120), Grid("block", block(40, 4, width=2.0, height=0.3, corner=(-0.5, -0.8)))]
    axle = []

    def led(data, _):
        axle.append(fm.RigidBoundary(data, "tyre/top", pivot=(0.0, 0.0)))
        return axle

    problem = problem_of(
        grids,
        lambda data: [fm.ContactPair(data, "tyre/bottom", "block/top", law=fm.Coulomb(MU))],
        bcs=lambda data, V: [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))],
        remote=led,
    )
    axle[0].move(y=-0.01)
    problem.solve()
    angle = TURN / 8
    axle[0].move(x=(1.0 - creep) * 0.5 * angle, y=-0.01, angle=-angle)
    problem.solve()
    contact = problem.equations.contacts[0]
    normal, shear = contact.total_force[1], contact.total_force[0]
    slip = contact.slip[contact.active]
    if creep:  # the lowest point moves back
        assert shear == pytest.approx(MU * normal, rel=1e-2)
        assert np.allclose(np.abs(slip), creep * 0.5 * angle, atol=6e-3), slip
    else:  # the tyre is 1 % too far: its radius is smaller where it is pressed
        assert np.abs(slip).max() < 4e-3, slip
