# SPDX-License-Identifier: MIT
"""Friction of bodies and obstacles that turn in space: slip is the length of the way."""

import numpy as np
import pytest
import space_scenes
from refusal import refused
from scipy.sparse import csr_array, eye

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact import arcs
from fenics_mortar.contact.arcs import Turned, past_obstacle, screw
from fenics_mortar.obstacles.rigid_motion import rotation_by
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, mapped

RANDOM = np.random.default_rng(3)
N = 5


def rotations(vectors):
    """Rotations by vectors (n, 3), as those of a material."""
    return Turned(np.array([rotation_by(v) for v in vectors]), np.tile(np.eye(3), (N, 1, 1)))


def of_size(size):
    """Random rotation vectors of one size."""
    v = RANDOM.normal(size=(N, 3))
    return size * v / np.linalg.norm(v, axis=1)[:, None]


def turned(at, vectors):
    """Vectors (n, 3) turned by rotations."""
    return np.einsum("nab,nb->na", at.Q, vectors)


@pytest.mark.serial
@pytest.mark.parametrize("size", [1e-6, 0.1, 0.6, 2.3])
@pytest.mark.parametrize("turning", ["slave", "master"])
def test_slip_of_surfaces_is_the_way_on_a_circle(turning, size):
    """Either side turns about any axis, and both by any rotation on top."""
    w, centre, x = of_size(size), RANDOM.normal(size=(N, 3)), RANDOM.normal(size=(N, 3))
    own, none, top = rotations(w), rotations(np.zeros((N, 3))), rotations(of_size(1.7))
    moved = centre + turned(own, x - centre)
    gaps = moved - x if turning == "slave" else x - moved
    slave, master = (own, none) if turning == "slave" else (none, own)
    with_top = [Turned(top.Q @ side.Q, side.stiff) for side in (slave, master)]
    found = screw(turned(top, gaps), np.zeros((N, 3)), *with_top)
    way = np.cross(w, x - centre)
    expected = turned(with_top[0], way) if turning == "slave" else -turned(top, way)
    assert np.allclose(found.slip, expected, rtol=0, atol=1e-13)
    assert np.allclose(found.doubt, size, rtol=0, atol=1e-13)


@pytest.mark.serial
@pytest.mark.parametrize("turns", [0.3, 3.0, 6.2, 2.0 * np.pi, 20.0])
def test_slip_past_an_obstacle_is_the_way(turns):
    """It turns in place by any number of turns, or carries the body along."""
    w, r = of_size(turns)[0], RANDOM.normal(size=(N, 3))
    found = past_obstacle(r, r, rotations(np.zeros((N, 3))), w)
    assert np.allclose(found.slip, -np.cross(w, r), rtol=0, atol=1e-12)
    with_it = rotations(np.tile(w, (N, 1)))
    angle = abs(np.arctan2(np.sin(turns), np.cos(turns)))
    if angle > arcs.TILTED:
        found = past_obstacle(turned(with_it, r), r, with_it, w)
        assert np.allclose(found.slip, 0.0, rtol=0, atol=1e-12)


@pytest.mark.serial
@pytest.mark.parametrize("size", [0.3, 1.5, 2.6, 3.1])
def test_slip_of_a_wheel_past_an_obstacle_is_the_way(size):
    """It turns in place about any axis, whatever the pivot of the obstacle."""
    f, centre, x = of_size(size), RANDOM.normal(size=(N, 3)), RANDOM.normal(size=(N, 3))
    Q, none = rotations(f), np.zeros(3)
    found = past_obstacle(centre + turned(Q, x - centre), x, Q, none)
    assert np.allclose(found.slip, turned(Q, np.cross(f, x - centre)), rtol=0, atol=1e-12)
    assert np.allclose(found.of_slave, f, rtol=0, atol=1e-12)


def _spun(at, spin):
    """Rotations with a further spin (n, 3)."""
    return Turned(np.array([rotation_by(s) @ Q for s, Q in zip(spin, at.Q)]), at.stiff)


@pytest.mark.serial
@pytest.mark.parametrize("size", [0.0, 0.2, 0.7, 2.3])
def test_derivatives_of_slip(size):
    """Central differences; their error is that of rounding over the step."""
    r, r_0, along, h = *RANDOM.normal(size=(3, N, 3)), 1e-6
    s, m, w = rotations(of_size(0.4)), rotations(of_size(size)), of_size(size + 1.0)[0]
    for change in np.eye(3):
        d = np.tile(change, (N, 1))
        for number, by in enumerate(screw(r, r_0, s, m).weights(along)):
            ends = [
                screw(r + (number == 0) * e, r_0, _spun(s, (number == 1) * e),
                      _spun(m, (number == 2) * e)).slip
                for e in (h * d, -h * d)
            ]  # fmt: skip
            quotient = ((ends[0] - ends[1]) * along).sum(axis=1) / (2.0 * h)
            assert np.allclose(quotient, (by * d).sum(axis=1), rtol=0, atol=1e-8)
        for number, by in enumerate(past_obstacle(r, r_0, m, w).weights(along)):
            ends = [
                past_obstacle(r + (number == 0) * e, r_0, _spun(m, (number == 1) * e), w).slip
                for e in (h * d, -h * d)
            ]
            quotient = ((ends[0] - ends[1]) * along).sum(axis=1) / (2.0 * h)
            assert np.allclose(quotient, (by * d).sum(axis=1), rtol=0, atol=1e-8)


@pytest.mark.parametrize("mirrored", [False, True])
def test_material_turns_with_its_nodes(mirrored):
    """A rigid rotation is found exactly; on symmetry planes the rotation about their normal."""
    scene = space_scenes.solid(order=1)
    space_scenes.held(scene)
    obstacle = fm.Plane((0.0, 0.0, 1.6), (0.0, 0.0, -1.0))
    scene.set_up([fm.ContactPair(scene.data, "block/top", obstacle)])
    surface = scene.problem.equations.contacts[0].slave
    n = surface.num_nodes
    across = np.zeros((n, 3), bool)
    w = np.array([0.4, -0.8, 1.1])
    if mirrored:
        across[:, 0], w = True, np.array([0.7, 0.0, 0.0])
    material = arcs.Material(csr_array(eye(n)), surface, surface.X, across)
    x = surface.X @ rotation_by(w).T
    assert np.allclose(material.turned(x).Q, rotation_by(w), rtol=0, atol=1e-13)
    rng = np.random.default_rng(1)
    x, direction = x + 0.05 * rng.normal(size=x.shape), rng.normal(size=x.shape)
    along = rng.normal(size=x.shape)
    block = material.rows(material.turned(x).by_products(along))
    values = dict(zip(surface.dofs.ravel().tolist(), direction.ravel().tolist()))
    change = np.zeros(n)
    for j, columns, row in zip(block.rows[:, 0], block.columns, block.values[:, 0]):
        change[j] += sum(values[int(c)] * v for c, v in zip(columns, row))
    change, h = scene.data.mesh.comm.allreduce(change), 1e-6
    after, before = (material.turned(x + e * direction).Q for e in (h, -h))
    spin = arcs.vectors_of(after @ before.swapaxes(1, 2))[0] / (2.0 * h)
    assert np.allclose((along * spin).sum(axis=1), change, rtol=0, atol=1e-7)


def wheel_on_block(law):
    """A wheel pressed from above into a block."""
    wheel = fm.Cylinder((0.5, 0.0, 1.5), (0, 1, 0), 0.5, name="wheel")
    scene = space_scenes.solid(counts=(8, 2, 4), size=(1.0, 0.5, 1.0), jiggle=0.0)
    space_scenes.held(scene)
    scene.set_up([fm.ContactPair(scene.data, "block/top", wheel, law=law)])
    wheel.move(z=-0.02)
    scene.problem.solve()
    return scene.problem, wheel


@pytest.mark.each
@pytest.mark.parametrize("angle", [0.5, 2.5, -4.0, 6.0, 2.0 * np.pi, 9.0])
def test_wheel_pushes_the_block_along_by_any_angle(angle):
    """The top of the block is dragged the way that the wheel's rim goes; slip is R angle."""
    problem, wheel = wheel_on_block(fm.Coulomb(0.1))
    wheel.move(angle=(0.0, angle, 0.0))
    report = problem.solve()
    contact = problem.contacts[0]
    assert report.certificate.violations() == [] and report.certificate.remarks() == []
    normal = np.abs((contact.forces * contact.normals).sum(axis=1)).sum()
    assert np.isclose(wheel.reaction[4], -np.sign(angle) * 0.1 * normal * 0.5, rtol=0.02)
    slip = contact.slip[np.abs(contact.pressure) > 0.0]
    size = np.linalg.norm(np.atleast_2d(slip), axis=1)
    assert np.allclose(size, 0.5 * abs(angle), rtol=0.07), size
    if angle != 2.0 * np.pi:  # where rotations by other axes have no vector near this one
        assert problem.check_tangent(print_table=False).slopes["whole"] > 1.9


def shaft_in_ring(around=24, *, on_axle=False, slave="shaft"):
    """A hollow shaft in a ring with interference; bore and outer side are prescribed.

    The bore has Dirichlet values, or is a rigid boundary ``on_axle``.
    """

    def sector(inner, outer):
        def position(s, t, r):
            radius = inner + t * (outer - inner)
            return radius * np.cos(2 * np.pi * s), radius * np.sin(2 * np.pi * s), 0.2 * r

        return mapped((around, 2, 1), position)

    shaft = Box("shaft", sector(0.5, 0.3)[:, :, ::-1], closed=True)
    ring = Box("ring", sector(0.8, 0.49)[:, :, ::-1], closed=True)
    data = mapped_boxes.mesh([shaft, ring])
    scene = space_scenes.of(data)
    bore = fem.Function(scene.u.function_space)
    axle = fm.RigidBoundary(data, "shaft/back", pivot=(0.0, 0.0, 0.0))
    if not on_axle:
        scene.bcs.append(fm.dirichlet(scene.u.function_space, data, "shaft/back", bore))
    space_scenes.held(scene, side="ring/front")
    sides = ["shaft/front", "ring/back"][:: 1 if slave == "shaft" else -1]
    pair = fm.ContactPair(data, *sides, law=fm.Coulomb(0.2))
    scene.set_up([pair], remote=[axle] if on_axle else [])

    def set_angle(angle):
        axle.move(angle=(0.0, 0.0, angle))
        R = rotation_by(np.array([0.0, 0.0, angle])) - np.eye(3)
        bore.interpolate(lambda x: R @ x)

    def turn(angle):
        set_angle(angle)
        return scene.problem.solve()

    scene.set_angle = set_angle
    return scene, turn


@pytest.mark.once
@pytest.mark.parametrize("steps", [4, 8])
def test_work_of_friction_of_a_shaft_is_moment_times_angle(steps):
    scene, turn = shaft_in_ring()
    turn(0.0)
    contact = scene.problem.contacts[0]
    angle = 2.0 * np.pi / steps
    turn(angle)
    report = turn(2.0 * angle)
    assert report.certificate.pairs[0]["friction_work"].value < 0.03
    moment = np.cross(contact.positions, contact.forces)[:, 2].sum()
    size = np.linalg.norm(contact.slip, axis=1)[contact.pressure > 0.0]
    assert np.allclose(size, 0.5 * angle, rtol=0.05), size
    assert np.isclose(abs(contact.friction_work), abs(moment) * angle, rtol=0.01)


@pytest.mark.serial
def test_rotation_that_is_known_up_to_full_turns_is_refused():
    _, turn = shaft_in_ring()
    turn(0.0)
    with refused(fm.NotConvergedError, "known up to a full turn only"):
        turn(2.6)


@pytest.mark.parametrize(
    ("degrees", "slave"),
    [(100.0, "shaft"), (150.0, "ring"), (160.0, "shaft"), (-210.0, "shaft"), (-260.0, "ring"),
     (300.0, "shaft"), (345.0, "ring"), (-360.0, "shaft")],
)  # fmt: skip
def test_turn_of_a_rigid_boundary_is_known(degrees, slave):
    """The ends of a step look like those of a turn by up to 180 degrees, maybe the other way."""
    scene, turn = shaft_in_ring(on_axle=True, slave=slave)
    turn(np.radians(20.0))
    angle = np.radians(20.0 + degrees)
    if abs(degrees) > 180.0:
        with refused(fm.NotConvergedError, "known up to a full turn only"):
            turn(angle)
        return
    report, contact = turn(angle), scene.problem.contacts[0]
    assert report.certificate.remarks() == []
    moment = np.cross(contact.positions, contact.forces)[:, 2].sum()
    work = abs(moment) * np.radians(abs(degrees))
    assert np.isclose(contact.friction_work, work, rtol=0.02), (contact.friction_work, work)


@pytest.mark.parametrize("degrees", [225.0, 301.0, -345.0, 360.0])
def test_turn_by_values_beyond_half_a_turn_is_told(degrees):
    """The values are those of a turn the other way: friction is, too."""
    _, turn = shaft_in_ring()
    turn(np.radians(20.0))
    try:
        remarks = turn(np.radians(20.0 + degrees)).certificate.remarks()
    except fm.NotConvergedError as error:
        remarks = [str(error)]
    (told,) = (text for text in remarks if "RigidBoundary" in text or "take smaller" in text)
    if 300.0 < abs(degrees) < 360.0:
        other = 360.0 - abs(degrees)
        assert f"by {other:.0f} degrees in the step, if not by {abs(degrees):.0f}" in told


@pytest.mark.serial
@pytest.mark.parametrize(("turned", "known"), [(150.0, True), (-330.0, False)])
def test_tyre_on_a_rigid_hub_in_space_is_known_to_turn(turned, known):
    """A hollow cylinder on a plane, turned about its axis by a rigid hub."""
    problem, hub = tyre_on_plane()
    hub.move(z=-0.02, angle=(0.0, np.radians(20.0), 0.0))
    problem.solve()
    hub.move(z=-0.02, angle=(0.0, np.radians(20.0 + turned), 0.0))
    if not known:
        with refused(fm.NotConvergedError, "known up to a full turn only"):
            problem.solve()
        return
    report, contact = problem.solve(), problem.contacts[0]
    assert not any("rotation" in text for text in report.certificate.remarks())
    normal = np.abs((contact.forces * contact.normals).sum(axis=1)).sum()
    # the lowest point moves to -x, friction acts to +x
    assert np.isclose(contact.forces[:, 0].sum() * np.sign(turned), 0.2 * normal, rtol=0.02)


def tyre_on_plane():
    """A hollow cylinder along y about a rigid hub, above a fixed plane with friction."""

    def position(s, t, r):
        radius = 0.35 + 0.15 * t
        return radius * np.cos(2 * np.pi * s), 0.2 * r, radius * np.sin(2 * np.pi * s)

    data = mapped_boxes.mesh([Box("tyre", mapped((24, 2, 1), position), closed=True)])
    scene = space_scenes.of(data)
    hub = fm.RigidBoundary(data, "tyre/front", pivot=(0.0, 0.0, 0.0))
    plane = fm.Plane((0.0, 0.0, -0.5), (0.0, 0.0, 1.0))
    scene.set_up([fm.ContactPair(data, "tyre/back", plane, law=fm.Coulomb(0.2))], remote=[hub])
    hub.move(z=-0.02)
    scene.problem.solve()
    return scene.problem, hub


@pytest.mark.parametrize("degrees", [250.0, -330.0, 360.0])
def test_shaft_turns_in_steps_of_known_direction(degrees):
    """In one step of the path, cut until each part is below 135 degrees; friction opposes all."""
    scene, turn = shaft_in_ring()
    turn(0.0)
    angle, steps = np.radians(degrees), fm.SteppingOptions(1.0, smallest=1.0 / 64)
    path = fm.follow_path(scene.problem, lambda t: scene.set_angle(t * angle), steps)
    assert all(step.step * abs(degrees) < 135.1 for step in path.steps)
    assert path.num_cuts > 0
    assert sum(step.work.friction for step in path.steps) > 0.0
    contact = scene.problem.contacts[0]
    assert np.cross(contact.positions, contact.forces)[:, 2].sum() * degrees < 0.0
