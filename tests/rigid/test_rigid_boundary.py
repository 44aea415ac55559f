# SPDX-License-Identifier: MIT
"""Boundaries of deformable bodies that move as rigid ones, moved or loaded at a point."""

from itertools import pairwise

import numpy as np
import pytest
from array_meshes import tagged
from refusal import COMM, refused
from remote_scenes import INNER, NU, OUTER, E, blocks, cylinder, lever, ring, wheel
from scenes import TIGHT, internal, linear_elastic, nodal

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

import fenics_mortar as fm
from fenics_mortar import sensitivity

G = E / (2.0 * (1.0 + NU))
# Moment per angle and thickness of a ring whose outer edge is fixed, from tau = M / (2 pi r^2).
TORSION = 4.0 * np.pi * G * INNER**2 * OUTER**2 / (OUTER**2 - INNER**2)


@pytest.mark.parametrize("drive", ["moment", "angle"])
def test_hub_has_the_torsional_stiffness_of_a_ring(drive):
    """Curved quadratic cells: the error of 24 x 3 of them is 5e-5, the angle is small."""
    problem, hub = ring(linear_elastic)
    small = 1e-5
    if drive == "angle":
        hub.move(angle=small)
    else:
        hub.push(moment=small * TORSION)
    report = problem.solve()
    assert hub.reaction[2] / hub.place[2] == pytest.approx(TORSION, rel=2e-4)
    assert np.abs(hub.reaction[:2]).max() < 1e-12 * hub.reaction[2]
    assert any("rigid boundary 'hub', turned by 1e-05" in note for note in report.notes)


def energy_of(u):
    """Energy stored in a neo-Hookean body."""
    psi = fm.energies.neo_hookean(u, *fm.energies.lame(E, NU))
    form = fem.form(psi * ufl.dx(metadata={"quadrature_degree": 4}))
    return COMM.allreduce(fem.assemble_scalar(form))


def test_work_of_the_moment_in_a_quarter_turn_is_the_stored_energy():
    """Boole's rule over 12 steps; half of them change the result by less than 1e-5 of it."""
    problem, hub = ring(columns=16, rows=2)
    angles, moments = np.linspace(0.0, np.pi / 2.0, 13), [0.0]
    for angle in angles[1:]:
        hub.move(angle=angle)
        problem.solve()
        moments.append(hub.reaction[2])
    weights = np.array([7, 32, 12, 32, 14, 32, 12, 32, 14, 32, 12, 32, 7]) / 22.5
    work = weights @ moments * (angles[1] - angles[0])
    assert work == pytest.approx(energy_of(problem.equations.bulk.u), rel=1e-5)
    hub.push(moment=0.95 * moments[-1])
    problem.solve()
    assert moments[-2] < hub.reaction[2] < moments[-1] and angles[-2] < hub.place[2] < angles[-1]


RIGID = {
    "apart": "upper/top",
    "with the master": ["upper/bottom", "upper/left"],
    "around": ["upper/top", "upper/left"],
}


@pytest.mark.parametrize("algorithm, degree", [("condensed", 1), ("saddle", 2)])
@pytest.mark.parametrize("rigid", RIGID)
def test_forces_and_motions_have_the_same_solution(rigid, algorithm, degree):
    """The reaction to a prescribed motion, as a push; without friction there is one solution."""
    options = {"algorithm": algorithm, "degree": degree, "law": fm.Frictionless()}
    (moved, grip), (driven, free) = (blocks(RIGID[rigid], **options) for _ in range(2))
    grip.move(x=0.005, y=-0.03, angle=0.01)
    moved.solve()
    free.move(x=0.005)
    free.push(y=grip.reaction[1], moment=grip.reaction[2])
    report = driven.solve()
    assert report.certificate.violations() == []
    assert np.abs(free.reaction - grip.reaction).max() < 1e-10 * np.abs(grip.reaction).max()
    assert np.abs(free.place - grip.place).max() < 1e-10
    assert np.abs(nodal(driven) - nodal(moved)).max() < 1e-10
    ratios = [b / a for a, b in pairwise(report.residuals) if a < 1e-3 * report.force]
    assert ratios[0] < 1e-3  # the last steps are quadratic, down to rounding


@pytest.mark.each
@pytest.mark.parametrize("rigid", RIGID)
def test_tangent_has_slopes_of_two(rigid):
    """With driven motions, also where the boundary shares nodes with the contact."""
    problem, grip = blocks(RIGID[rigid])
    grip.move(x=0.005, y=-0.03, angle=0.01)
    problem.solve()
    grip.push(x=1.0, y=-3.0, moment=0.2)
    slopes = problem.check_tangent(print_table=False).slopes
    assert min(slopes.values()) > 1.95, slopes


def test_names_of_boundaries_are_those_of_a_remote_load():
    """Without pairs; the outer edge has the opposite moment about the pivot."""
    problem, hub = ring(linear_elastic)
    hub.push(moment=1e-5 * TORSION)
    problem.solve()
    moment = problem.reaction("ring/bottom", about=hub.pivot).moment
    assert moment == pytest.approx(-hub.reaction[2], rel=1e-9)


def test_reaction_by_name_is_that_of_the_boundary():
    """About the present pivot; equilibrium of all supports."""
    problem, grip = blocks("upper/top")
    grip.move(x=0.005, y=-0.03, angle=0.01)
    problem.solve()
    grip.push(y=1.1 * grip.reaction[1])
    problem.solve()
    force, moment, _ = problem.reaction("upper/top", about=grip.pivot + grip.place[:2])
    assert np.array([*force, moment]) == pytest.approx(grip.reaction, rel=1e-10)
    below = problem.reaction("lower/bottom").force
    assert force + below == pytest.approx(np.zeros(2), abs=1e-10 * np.abs(force).max())


def test_lever_is_in_equilibrium_about_its_hinge():
    """Force times arm on both sides, at the present positions; nothing else stops the lever."""
    problem, hinge, handle, stop = lever()
    hinge.push(moment=0.0)
    handle.push(x=0.0, y=-0.02, moment=0.0)
    report = problem.solve()
    assert report.certificate.violations() == []
    assert any("moved rigidly until contact stopped it" in note for note in report.notes)
    arm = handle.pivot[0] + handle.place[0] - hinge.pivot[0]
    about_hinge = stop.reaction[2] - hinge.pivot[0] * stop.reaction[1]
    assert 0.02 * arm == pytest.approx(-about_hinge, rel=1e-9)
    assert hinge.reaction[1] - 0.02 == pytest.approx(stop.reaction[1], rel=1e-9)
    assert abs(hinge.reaction[2]) < 1e-12 and hinge.place[2] < -0.05


def test_wheel_falls_on_the_road_and_rolls_under_its_axle():
    """The axle is loaded and turned; friction drives the wheel, and no force resists it."""
    problem, axle, road = wheel()
    axle.push(y=-3.0)
    report = problem.solve()
    assert any("body 'wheel' was moved rigidly" in note for note in report.notes)
    assert road.reaction[1] == pytest.approx(-3.0, rel=1e-9)
    radius = axle.pivot[1] + axle.place[1]
    axle.push(x=0.0)
    for angle in (-0.05, -0.1, -0.15, -0.2):
        axle.move(angle=angle)
        report = problem.solve(accept_violations=True)
    assert abs(axle.reaction[0]) < 1e-9
    # The circumference is compressed in contact: the way is between those of both radii.
    assert 0.2 * radius < axle.place[0] < 0.2


def test_torque_on_the_axle_is_friction_times_radius():
    """The wheel is held in x; the torque is that of the road's shear at the present positions."""
    problem, axle, road = wheel()
    axle.push(y=-3.0, moment=0.3)
    problem.solve()
    x, y = axle.pivot + axle.place[:2]
    force, moment = road.reaction[:2], road.reaction[2]
    about_axle = moment - (x * force[1] - y * force[0])
    assert about_axle == pytest.approx(0.3, rel=1e-9)
    assert axle.reaction == pytest.approx((force[0], -3.0, 0.3), rel=1e-9)


def test_axial_push_of_a_body_of_revolution():
    """The load of the end of a cylinder is that on the whole end, and has no moment."""
    problem, end = cylinder()
    end.move(y=-0.02)
    problem.solve()
    reaction = end.reaction.copy()
    assert reaction[0] == reaction[2] == 0.0
    end.push(y=reaction[1])
    end.place = np.zeros(3)
    problem.equations.bulk.u.x.array[:] = 0.0
    problem.solve()
    assert end.place == pytest.approx((0.0, -0.02, 0.0), abs=1e-12)
    end.push(x=1.0)
    with refused(fm.MortarError, "pushed radially or turned"):
        problem.solve()


def test_state_and_checkpoint_contain_the_place(tmp_path):
    """Restored, saved and read, the boundary is where it was, and a solve is at rest there."""
    problem, grip = blocks("upper/top")
    grip.push(y=-2.0)
    problem.solve()
    u, place, state = nodal(problem), grip.place.copy(), problem.state()
    fm.save_state(problem, tmp_path / "state")
    grip.push(y=-3.0)
    problem.solve()
    assert abs(grip.place[1] - place[1]) > 0.005
    problem.restore(state)
    assert (grip.place == place).all()
    other, own = blocks("upper/top")
    fm.load_state(other, tmp_path / "state")
    own.push(y=-2.0)
    report = other.solve()
    assert report.num_iterations <= 1 and np.abs(nodal(other) - u).max() < 1e-12


def test_variants_share_the_boundary():
    """A variant with small sliding moves the same object."""
    problem, grip = blocks("upper/top")
    grip.push(y=-2.0)
    problem.variant(sliding="small").solve()
    assert grip.reaction[1] == pytest.approx(-2.0) and grip.place[1] < 0.0


def test_mixed_function_has_a_rigid_displacement_only():
    """The pressure on the boundary is free, and force and motion agree."""
    problem, top = mixed_block()
    top.move(y=-0.05, angle=0.02)
    problem.solve()
    reaction, u = top.reaction.copy(), problem.equations.bulk.values.copy()
    top.push(**dict(zip(("x", "y", "moment"), reaction, strict=True)))
    top.place = np.zeros(3)
    problem.equations.bulk.values[:] = 0.0
    problem.solve()
    assert top.place == pytest.approx((0.0, -0.05, 0.02), abs=1e-11)
    assert np.abs(problem.equations.bulk.values - u).max() < 1e-9 * np.abs(u).max()


def mixed_block():
    """A nearly incompressible block between a fixed and a rigid side."""
    grid = dmesh.create_rectangle(COMM, [(0.0, 0.0), (2.0, 1.0)], (6, 3))
    data = tagged(grid, bottom=lambda x: np.isclose(x[1], 0.0), top=lambda x: np.isclose(x[1], 1.0))
    W = fm.mixed_space(grid, ("Lagrange", 2, (2,)), ("Lagrange", 1))
    w = fem.Function(W)
    u, p = ufl.split(w)
    mu, lmbda = fm.energies.lame(E, 0.49)
    psi = fm.energies.mixed_neo_hookean(u, p, mu, 1.0 / lmbda)
    residual = ufl.derivative(psi * ufl.dx(metadata={"quadrature_degree": 4}), w)
    bcs = [fm.dirichlet(W.sub(0), data, "bottom", (0.0, 0.0))]
    top = fm.RigidBoundary(data, "top", pivot=(1.0, 1.5))
    options = {"remote": [top], "newton": TIGHT, "petsc_options_prefix": "mixed_"}
    return fm.ContactProblem(residual, w, [], bcs=bcs, **options), top


def test_errors_name_the_boundary():
    """Wrong arguments, nodes with two conditions, and what is not implemented."""
    problem, grip = blocks(["upper/top", "upper/left"])
    data = grip.data
    with refused(ValueError, "pivot"):
        fm.RigidBoundary(data, "upper/top", pivot=(0.0, np.nan))
    with refused(fm.MeshError, "no boundary 'lid'"):
        fm.RigidBoundary(data, "lid", pivot=(0.0, 0.0))
    with refused(fm.MortarError, "gradients are not implemented with remote loads"):
        sensitivity.RecordedPath(problem)
    with refused(ValueError, "a remote load is given twice"):
        blocks("upper/top", more=[grip, grip])
    with refused(ValueError, "expected a list of remote loads"):
        blocks("upper/top", more=["upper/top"])
    grip.push(y=-2.0)
    dynamics = fm.Dynamics(problem, density=1.0)
    with refused(fm.MortarError, "remote load 'grip' is driven by forces.*'massless'"):
        dynamics.step(0.1)


def test_nodes_of_another_condition_must_not_be_driven():
    """A boundary may share nodes with a support along motions that are prescribed."""
    problem, end = cylinder()
    end.push(y=-1.0)
    problem.solve()
    data, u = end.data, problem.equations.bulk.u
    u.x.array[:] = 0.0
    both = fm.RigidBoundary(data, ["end", "bottom"], pivot=(0.0, 2.0), name="both")
    bcs = [fm.dirichlet(u.function_space, data, "bottom", (0.0, 0.0))]
    options = {"bcs": bcs, "remote": [both], "petsc_options_prefix": "both_"}
    plane = fm.ContactProblem(internal(u, linear_elastic(u, E, NU)), u, [], **options)
    both.push(y=-1.0)
    with refused(fm.MortarError, "5 nodes of rigid boundary 'both'"):
        plane.solve()
