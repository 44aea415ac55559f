# SPDX-License-Identifier: MIT
"""Slip of bodies whose turns are part of the solution: rollers, driven hubs, bodies that ride."""

from functools import cache

import numpy as np
import pytest
from friction_scenes import NU, E
from scenes import TIGHT, internal, neo_hookean, rotation
from turning_scenes import problem_of

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact.arcs import Carried, Place, doubt_beside_known, way_past
from fenics_mortar.equations import turns
from fenics_mortar.obstacles.rigid_motion import rotation_by, turn_of
from fenics_mortar.verify.checks.friction_work import uncertain_rotation
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block, mapped, sector

MU, TURN = 0.3, 2.0 * np.pi


def turns_in_step(problem, x0):
    """Mean rotations of all bodies since the positions ``x0`` of the outlines [radian]."""
    crossings = problem.equations.crossings
    x1, bodies = crossings.accepted.x, crossings.led.bodies
    return [float(turn_of(x0[m], x1[m], np.inf)[0]) for m in bodies == np.unique(bodies)[:, None]]


@cache
def wheel_between(radius, depth):
    """A wheel without supports on a fixed ground, under a belt: problem, motion, state."""
    belt, bore = [], 0.3 * radius
    grids = [
        Grid("ground", block(60, 2, width=4.0, height=0.3, corner=(-1.0, -radius - 0.3))),
        Grid("belt", block(66, 2, width=4.0, height=0.3, corner=(-2.0, radius))),
        Grid("wheel", sector(72, 4, radii=(bore, radius), angles=(0.02, 0.02 + TURN)), closed=True),
    ]

    def held(data, V):
        belt.append(fem.Constant(data.mesh, (0.0, -2.0 * depth)))
        return [
            fm.dirichlet(V, data, "ground/bottom", (0.0, 0.0)),
            fm.dirichlet(V, data, "belt/top", belt[0]),
        ]

    problem = problem_of(
        grids,
        lambda data: [
            fm.ContactPair(data, "wheel/bottom", other, law=fm.Coulomb(MU))
            for other in ("ground/top", "belt/bottom")
        ],
        bcs=held,
    )
    problem.solve()
    return problem, belt[0], problem.state()


@pytest.mark.once
@pytest.mark.parametrize("per_turn", [16, 8])
@pytest.mark.parametrize("radius, depth", [(0.5, 0.01), (0.7, 0.012)])
def test_a_wheel_without_supports_rolls_between_ground_and_belt(radius, depth, per_turn):
    """By the way of the belt over its diameter, which is smaller where it is pressed."""
    problem, belt, pressed = wheel_between(radius, depth)
    problem.restore(pressed)
    start, angle = problem.equations.crossings.accepted.x, TURN / per_turn
    belt.value[0] = 2.0 * radius * angle
    certificate = problem.solve().certificate
    assert min(turns_in_step(problem, start)) == pytest.approx(-angle, rel=0.01)
    for contact in problem.equations.contacts:  # nothing but facets resists
        assert abs(contact.total_force[0]) < 0.03 * MU * abs(contact.total_force[1])
    assert certificate.violations() == []


@pytest.mark.parametrize("creep", [0.0, 0.1, -0.1])
def test_a_wheel_turned_by_values_rolls_and_slips_as_one_on_an_axle(creep):
    """Values on a rim tell neither the way of its centre within a step nor a fixed point."""
    axle, angle = [], TURN / 8
    grids = [
        Grid("tyre", sector(90, 3, radii=(0.2, 0.5), angles=(0.02, 0.02 + TURN)), closed=True),
        Grid("block", block(30, 4, width=1.5, height=0.3, corner=(-0.5, -0.8))),
    ]

    def held(data, V):
        axle.append(fem.Function(V))
        return [
            fm.dirichlet(V, data, "tyre/top", axle[0]),
            fm.dirichlet(V, data, "block/bottom", (0.0, 0.0)),
        ]

    problem = problem_of(
        grids,
        lambda data: [fm.ContactPair(data, "tyre/bottom", "block/top", law=fm.Coulomb(0.2))],
        bcs=held,
    )
    contact = problem.equations.contacts[0]
    for x, turned in ((0.0, 0.0), ((1.0 - creep) * 0.5 * angle, -angle)):
        R, shift = rotation(turned) - np.eye(2), np.array([[x], [-0.01]])
        axle[0].interpolate(lambda X, R=R, shift=shift: R @ X[:2] + shift)
        problem.solve()
    slip = contact.slip[contact.active]
    # its radius is up to 2 % smaller where it is pressed, and surfaces creep on top of each other
    assert np.allclose(np.abs(slip), abs(creep) * 0.5 * angle, atol=0.013 * angle), slip / angle
    if creep:
        shear, normal = contact.total_force
        assert shear == pytest.approx(np.sign(creep) * 0.2 * normal, rel=1e-2)


def lens_on_block(slave, turned_by, about):
    """A block without supports, slightly curved below, on one that is turned; load and motion."""

    def bent(s, t):
        return s - 0.5, 0.4 * t + 0.03 * (1.0 - t) * (2.0 * s - 1.0) ** 2

    grids = [
        Grid("table", block(20, 4, width=1.6, height=0.4, corner=(-0.8, -0.4))),
        Grid("lens", mapped(14, 4, bent)),
    ]
    data = mapped_grids.mesh(grids)
    V = fm.vector_space(data.mesh, 1)
    u, v, weight = fem.Function(V), ufl.TestFunction(V), fem.Constant(data.mesh, (0.0, 0.0))
    dx = ufl.dx(domain=data.mesh, subdomain_data=data.cell_tags)(data.bodies["lens"])
    given, values = {"bcs": [], "remote": []}, fem.Function(V)
    if turned_by == "axle":
        given["remote"].append(fm.RigidBoundary(data, "table/bottom", pivot=about))
    else:
        given["bcs"].append(fm.dirichlet(V, data, "table/bottom", values))
    sides = ("lens/bottom", "table/top")[:: 1 if slave == "lens" else -1]
    residual = internal(u, neo_hookean(u, E, NU)) - ufl.inner(weight, v) * dx

    problem = fm.ContactProblem(
        residual, u, [fm.ContactPair(data, *sides, law=fm.Coulomb(0.5))], newton=TIGHT,
        petsc_options_prefix="lens_", **given,
    )  # fmt: skip

    def load(size, angle):
        R, pivot = rotation(angle), np.array(about)[:, None]
        weight.value[:] = R @ np.array([0.0, -size])
        values.interpolate(lambda x: (R - np.eye(2)) @ (x[:2] - pivot))
        for axle in given["remote"]:
            axle.move(x=0.0, y=0.0, angle=angle)
        problem.solve()
        return problem.equations.contacts[0]

    return load


def loaded_lens(slave, turned_by, about, angle):
    """Shear over pressure of ``lens_on_block`` whose weight grows while all turns."""
    load = lens_on_block(slave, turned_by, about)
    load(1.0, 0.0)
    contact = load(8.0, angle)
    force = rotation(angle).T @ contact.total_force
    assert abs(force[0]) < 1e-8 * abs(force[1])
    return contact.z_tau / contact.pressure.max()


@cache
def lens_that_does_not_turn(slave):
    """``loaded_lens`` without a turn."""
    return loaded_lens(slave, "values", (0.0, 0.0), 0.0)


@pytest.mark.parametrize("turned_by", ["axle", "values"])
@pytest.mark.parametrize("about", [(0.0, 0.0), (2.0, -1.0)])
@pytest.mark.parametrize("slave", ["lens", "table"])
def test_a_block_that_rides_on_one_that_turns_does_not_slip(slave, about, turned_by):
    """Its weight grows meanwhile, and presses further nodes into contact."""
    found = loaded_lens(slave, turned_by, about, 0.2)
    assert np.abs(found - lens_that_does_not_turn(slave)).max() < 0.02


@pytest.mark.parametrize("angle", [1.3, -2.6])
def test_the_turn_of_a_block_that_rides_on_an_axle_of_known_angle_is_known(angle):
    """By 75 and 149 degrees in one step, while further nodes come into contact."""
    load = lens_on_block("table", "axle", (0.0, 0.0))
    num_active = load(1.0, 0.0).active.sum()
    contact = load(8.0, angle)
    assert contact.active.sum() > num_active
    assert uncertain_rotation(contact)[0] < np.radians(20.0)


def test_bodies_beside_an_axle_ride_or_roll():
    """Turns by 70 degrees, and by 200 degrees the other way round, beside one of 70 degrees."""
    relative, apart = np.radians([[0.0, 1.0, 90.0], [70.0, 71.0, 160.0]])
    for kept, doubt in (([True, False, False], [0.0, 1.0, 160.0]), ([False] * 3, [70, 71, 160])):
        found = doubt_beside_known(relative, apart, np.array(kept))
        assert np.degrees(found) == pytest.approx(doubt)
    rests = doubt_beside_known(np.zeros(1), np.full(1, TURN), np.ones(1, bool))
    assert rests == pytest.approx(TURN)  # not known from a shaft that turns fully
    against = np.radians([200.0, 280.0, 330.0])  # nor from one that turns the other way
    assert doubt_beside_known(np.zeros(3), against, np.ones(3, bool)) == pytest.approx(against)


def carried(x, turn, start, end, straight=0.0):
    """One node of a body that is led."""
    rows = x, np.atleast_1d(turn), start, end, [straight]
    return Carried(*(np.array([each], float) for each in rows))


@pytest.mark.parametrize("angle", [0.1, TURN / 8, 2.0])
@pytest.mark.parametrize("arm", [(0.0, 1.0), (0.3, 0.4), (5.0, -2.0)])
@pytest.mark.parametrize("dim", [2, 3])
def test_any_point_of_a_body_tells_its_slip_in_the_frame_of_the_contact(dim, arm, angle):
    """A wheel of radius 1 rolls along a road and slips: ends of any of its points tell the rest."""
    axis = np.array([0.0, 0.0, 1.0]) if dim == 3 else np.ones(1)
    R, far = rotation_by(-angle * axis), np.pad(arm, (0, dim - 2))
    centre, way, none = np.eye(dim)[1], 0.9 * angle * np.eye(dim)[0], np.zeros(dim)
    wheel = carried(way, -angle * axis, centre + far, centre + way + R @ far)
    road = carried(way, 0.0 * axis, none, none)
    for tilt in (0.0, 0.4):  # everything turns besides
        Q, spin = rotation_by(tilt * axis), (tilt * axis)[None]
        sides = [
            side._replace(x=side.x @ Q.T, turn=side.turn + spin, end=side.end @ Q.T)
            for side in (wheel, road)
        ]
        V = way_past(Place(none[None], (Q @ way)[None], spin), *sides)[0]
        V = V + np.cross(np.pad(sides[0].turn[0] - sides[1].turn[0], (3 - axis.size, 0)),
                         0.5 * np.pad(Q @ way, (0, 3 - dim)))[:dim]  # fmt: skip
        assert Q.T @ V == pytest.approx(-0.1 * angle * np.eye(dim)[0], abs=1e-12)


def test_a_wheel_rolls_between_moved_obstacles():
    """Each step from where the obstacles are: bodies follow them once, not in each solve."""
    radius, angle = 0.5, TURN / 16
    grids = [
        Grid("wheel", sector(72, 4, radii=(0.15, radius), angles=(0.02, 0.02 + TURN)), closed=True)
    ]
    ground, belt = (fm.Plane((0.0, y), (0.0, -np.sign(y))) for y in (-radius, radius))
    problem = problem_of(
        grids,
        lambda data: [
            fm.ContactPair(data, "wheel/bottom", plane, law=fm.Coulomb(MU))
            for plane in (ground, belt)
        ],
    )
    belt.move(y=-0.02)
    problem.solve()
    for step in (1, 2):
        start = problem.equations.crossings.accepted.x
        belt.move(x=2.0 * radius * angle * step, y=-0.02)
        report = problem.solve()
        assert turns_in_step(problem, start)[0] == pytest.approx(-angle, rel=0.02)
        assert report.num_iterations < 20


def test_slip_that_does_not_settle_fails_the_step(monkeypatch):
    load = lens_on_block("lens", "axle", (0.0, 0.0))
    load(1.0, 0.0)
    monkeypatch.setattr(turns, "lead_by_solution", lambda *_: 0.02)
    with pytest.raises(fm.NotConvergedError, match="still changes by 0.02 of their way"):
        load(1.0, 0.2)
