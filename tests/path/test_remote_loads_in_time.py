# SPDX-License-Identifier: MIT
"""Forces at points in time steps: momentum of a free block, torque on a disk, two halves."""

import numpy as np
import pytest
import space_scenes
from scenes import internal, linear_elastic, neo_hookean

from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_grids import Grid, block, mesh, sector

DENSITY, FORCE, TORQUE = 2.0, np.array([0.7, 0.2]), 3.0
CASES = [
    (fm.SpreadLoad, "conserving"),
    (fm.SpreadLoad, "massless"),
    (fm.RigidBoundary, "massless"),
    (fm.RigidBoundary, "generalized_alpha"),
]


@pytest.mark.parametrize(("load", "scheme"), CASES)
def test_momentum_of_a_free_block_is_force_times_time(load, scheme):
    """To rounding, with all motions driven; the force in the report is that of the user."""
    data = mesh([Grid("block", block(6, 4, width=2.0, height=1.0))])
    u = fem.Function(fm.vector_space(data.mesh, 1))
    side = load(data, "block/left", pivot=(0.0, 0.3), name="side")
    residual, options = internal(u, neo_hookean(u, 100.0, 0.3)), {"remote": [side]}
    problem = fm.ContactProblem(residual, u, [], **options, petsc_options_prefix="free_")
    motion = fm.Dynamics(problem, density=DENSITY, scheme=scheme)
    side.push(x=FORCE[0], y=FORCE[1], moment=0.0)
    for _ in range(10):
        motion.step(0.05)
    assert motion.momentum()[:2] == pytest.approx(FORCE * motion.time, rel=1e-13)
    assert side.reaction == pytest.approx([*FORCE, 0.0], abs=1e-12)
    assert side.place[0] > 0.5 * FORCE[0] / (2.0 * DENSITY) * motion.time**2


def disk(scheme):
    """A nearly rigid disk with a bore as a hub, and its moment of inertia."""
    data = mesh([Grid("disk", sector(48, 4, radii=(0.3, 1.0)), closed=True)])
    u = fem.Function(fm.vector_space(data.mesh, 1))
    hub = fm.RigidBoundary(data, "disk/top", pivot=(0.0, 0.0), name="hub")
    hub.push(x=0.0, y=0.0, moment=0.0)
    residual = internal(u, neo_hookean(u, 1e5, 0.3))
    problem = fm.ContactProblem(residual, u, [], remote=[hub], petsc_options_prefix="disk_")
    motion = fm.Dynamics(problem, density=DENSITY, scheme=scheme)
    motion.velocity.interpolate(lambda x: np.stack([-x[1], x[0]]))
    return problem, motion, hub, motion.momentum()[2]


@pytest.mark.serial
def test_torque_turns_a_disk():
    """Angular acceleration M / J; angular momentum of second order in the step."""
    errors = []
    for steps in (20, 40):
        _, motion, hub, inertia = disk("massless")
        motion.velocity.x.array[:] = 0.0
        hub.push(moment=TORQUE)
        for _ in range(steps):
            motion.step(1.0 / steps)
        assert hub.place[2] == pytest.approx(0.5 * TORQUE / inertia, rel=1e-3)
        errors.append(abs(motion.momentum()[2] / TORQUE - 1.0))
    assert errors[0] < 1e-3 and errors[1] < errors[0] / 2.0


def test_spinning_disk_starts_with_centripetal_accelerations():
    """Also at its rigid boundary: without them accelerations would alternate."""
    problem, motion, hub, _ = disk("massless")
    motion.step(1e-4)
    w = problem.state().rates.acceleration.reshape(-1, 2)
    X = problem.equations.bulk.V.tabulate_dof_coordinates()[: len(w), :2]
    bore = np.hypot(*X.T) < 0.31
    assert w[bore] == pytest.approx(-X[bore], abs=2e-2)
    assert hub.place[2] == pytest.approx(1e-4, rel=1e-6)


def spinning_block(stiffness):
    """A block on a grip at one side, which spins about an axis through the grip's pivot."""
    scene = space_scenes.solid(counts=(3, 3, 3), size=(1.0, 1.0, 1.0), jiggle=0.0)
    data, u = scene.data, scene.u
    grip = fm.RigidBoundary(data, "block/left", pivot=(0.0, 0.5, 0.5), name="grip")
    residual = internal(u, neo_hookean(u, stiffness, 0.3))
    problem = fm.ContactProblem(residual, u, [], remote=[grip], petsc_options_prefix="spin_")
    motion = fm.Dynamics(problem, density=DENSITY, scheme="generalized_alpha")
    return problem, motion, grip


def test_push_on_a_grip_moves_a_block_in_space():
    """Momentum is force times time, to rounding; all six motions are driven."""
    _, motion, grip = spinning_block(100.0)
    force = np.array([*FORCE, -0.3])
    grip.push(x=force[0], y=force[1], z=force[2], moment=(0.0, 0.0, 0.0))
    for _ in range(4):
        motion.step(0.05)
    assert motion.momentum()[:3] == pytest.approx(force * motion.time, rel=1e-12)
    assert grip.reaction == pytest.approx([*force, 0.0, 0.0, 0.0], abs=1e-12)


def test_torque_turns_a_block_in_space():
    """On an axle along x: angular acceleration M / J with J = rho / 6 of the cube."""
    _, motion, grip = spinning_block(1e4)
    grip.push(moment=(TORQUE, None, None))
    for _ in range(10):
        motion.step(0.02)
    angle = 0.5 * TORQUE / (DENSITY / 6.0) * motion.time**2
    assert grip.place[3] == pytest.approx(angle, rel=0.01)
    assert np.abs(grip.place[[0, 1, 2, 4, 5]]).max() < 1e-12


def test_spinning_block_starts_with_centripetal_accelerations():
    """Other nodes, not yet under stress, do not accelerate: the grip turns as a free plate.

    By Euler's equations with moments of inertia 2 J, J and J about x, y and z through its pivot.
    """
    problem, motion, grip = spinning_block(1e5)
    spin = np.array([0.6, 0.0, 0.8])
    motion.velocity.interpolate(lambda x: np.cross(spin, (x.T - grip.pivot)).T)
    grip.push(moment=(0.0, 0.0, 0.0))
    motion.step(1e-4)
    space = problem.equations.bulk.space
    w = problem.state().rates.acceleration[space.dofs]
    r = space.positions()[space.dofs] - grip.pivot
    on_grip = np.abs(r[:, 0]) < 1e-9
    inertia = np.array([2.0, 1.0, 1.0])
    change = np.cross(inertia * spin, spin) / inertia
    exact = np.cross(spin, np.cross(spin, r)) + np.cross(change, r)
    assert np.abs((w - exact)[on_grip]).max(initial=0.0) < 5e-3


def test_section_pulls_two_halves_together():
    """Masses of 2 and 4 approach each other by F / m each, and no momentum arises."""
    grids = [
        Grid("lower", block(3, 4, width=1.0, height=1.0)),
        Grid("upper", block(3, 4, width=1.0, height=2.0, corner=(0.0, 1.0))),
    ]
    data = mesh(grids)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    cut = fm.Pretension(data, "upper/bottom", "lower/top", name="cut")
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 1e4, 0.0)), u, [cut], petsc_options_prefix="halves_"
    )
    motion = fm.Dynamics(problem, density=DENSITY, scheme="generalized_alpha", rho_inf=0.5)
    cut.push(0.3)
    for _ in range(40):
        motion.step(0.025)
    assert cut.force == pytest.approx(0.3, rel=1e-12)
    assert np.abs(motion.momentum()).max() < 1e-12
    assert cut.shortening == pytest.approx(0.5 * 0.3 * (1 / 2 + 1 / 4), rel=5e-3)
