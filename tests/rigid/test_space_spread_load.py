# SPDX-License-Identifier: MIT
"""Loads at a point in space that are spread over a boundary free to deform."""

from petsc4py import PETSc

import numpy as np
import pytest
from refusal import refused
from space_scenes import SIZE, YOUNG, held, of, solid
from test_space_contact import TIGHT, law_of
from test_space_rigid_boundary import SIDES

import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_vector

import fenics_mortar as fm
from fenics_mortar import energies
from fenics_mortar.obstacles.rigid_motion import motion_between, rotation_by, rotation_less_one
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, block


def pulled(cell="hexahedron", order=1, pivot=(0.7, 1.5, 2.5), **options):
    """A block on its bottom with a load spread over its top; also the load, bound to the mesh."""
    scene = solid(cell, order, counts=(2, 2, 2), **options)
    held(scene)
    load = fm.SpreadLoad(scene.data, "block/top", pivot=pivot, name="eye")
    problem = scene.set_up(remote=[load], newton=TIGHT).problem
    return scene, load, problem.equations.motions.spread[0]


def linear(u, mu, lmbda):
    """Energy of small strains."""
    return energies.linear_elastic(u, mu, lmbda)


@pytest.mark.parametrize("cell, order", [("hexahedron", 1), ("tetrahedron", 2)])
def test_force_through_the_middle_is_a_uniform_traction(cell, order):
    """Of a block on rollers: the mean displacement of its end is F L / E A."""
    scene = solid(cell, order, counts=(2, 2, 2), energy=linear, jiggle=0.0)
    V, sides = scene.u.function_space, ("left", "front", "bottom")
    for i, side in enumerate(sides):
        scene.bcs.append(fm.dirichlet(V, scene.data, f"block/{side}", 0.0, i))
    load = fm.SpreadLoad(scene.data, "block/top", pivot=(*SIZE[:2] / 2, 5.0), name="eye")
    scene.set_up(remote=[load], newton=TIGHT)
    load.push(z=0.3)
    scene.problem.solve()
    area = SIZE[0] * SIZE[1]
    assert load.place[2] == pytest.approx(0.3 * SIZE[2] / (YOUNG * area), rel=1e-9)
    assert np.abs(load.place[3:]).max() < 1e-12


@pytest.mark.parametrize("cell, order", [("hexahedron", 1), ("tetrahedron", 2), ("tetrahedron", 1)])
def test_forces_are_those_of_a_linear_traction(cell, order):
    """F / A + w x (X - X_0) of the rectangle, with its second moments, against the form in UFL."""
    scene, load, bound = pulled(cell, order, jiggle=0.0)
    force, moment = np.array((0.6, -0.4, 0.5)), np.array((0.5, 0.3, -0.6))
    load.push(x=force[0], y=force[1], z=force[2], moment=moment)
    bound.evaluate(np.zeros_like(scene.u.x.array))
    middle, area = SIZE * (0.5, 0.5, 1.0), SIZE[0] * SIZE[1]
    second = np.array([SIZE[1] ** 2, SIZE[0] ** 2, SIZE[0] ** 2 + SIZE[1] ** 2]) * area / 12.0
    w = (moment + np.cross(load.pivot - middle, force)) / second
    X = ufl.SpatialCoordinate(scene.data.mesh)
    traction = ufl.as_vector(force / area) + ufl.cross(ufl.as_vector(w), X - ufl.as_vector(middle))
    ds = ufl.ds(subdomain_data=scene.data.facet_tags)(scene.data.boundaries["block/top"], degree=4)
    v = ufl.TestFunction(scene.u.function_space)
    expected = assemble_vector(fem.form(ufl.inner(traction, v) * ds))
    expected.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
    found = bound.forces(scene.problem.equations.bulk.num_owned)
    assert np.abs(found - expected.array).max(initial=0.0) < 1e-12


def test_resultants_act_about_the_moved_pivot():
    """Reaction of the support at finite strain: force, and moment about the moved pivot."""
    scene, load, _ = pulled()
    force, moment = np.array((0.6, -0.4, 0.5)), np.array((0.5, 0.3, -0.6))
    load.push(x=force[0], y=force[1], z=force[2], moment=moment)
    report = scene.problem.solve()
    residuals = report.residuals
    assert residuals[-1] < 1e-3 * residuals[-2] + 1e-14 and residuals[-2] < 1e-3 * residuals[-3]
    about = load.pivot + load.place[:3]
    below = scene.problem.reaction("block/bottom", about, data=scene.data)
    assert np.abs(below.force + force).max() < 1e-10
    assert np.abs(below.moment + moment).max() < 1e-9
    assert np.abs(load.place[:3]).max() > 0.1 and np.abs(load.place[3:]).max() > 0.1
    assert any("spread load 'eye', moved by" in note for note in report.notes)


@pytest.mark.parametrize("cell, order", [("hexahedron", 2), ("tetrahedron", 1)])
def test_forces_are_work_conjugate_to_the_mean_motion(cell, order):
    """At a random displacement with a finite rotation, along a random change of it."""
    scene, load, bound = pulled(cell, order)
    load.push(x=0.6, y=-0.4, z=0.5, moment=(0.5, 0.3, -0.6))
    values, space = scene.u.x.array, scene.problem.equations.bulk.space
    X, turn = space.positions()[space.dofs], np.array((0.5, -0.9, 0.7))
    fields = [
        np.stack([np.sin((i + 1) * X @ k + i) for k in np.eye(3)[:, ::-1] + 0.3], axis=1)
        for i in range(2)
    ]
    start, change = np.zeros_like(values), np.zeros_like(values)
    start[space.dofs] = 0.1 * fields[0] + X @ rotation_less_one(turn).T
    change[space.dofs] = fields[1]
    ends, h = [], 1e-5
    for sign in (1.0, -1.0):
        bound.evaluate(start + sign * h * change)
        bound.record()
        ends.append(load.place)
    motion = motion_between(ends[1], ends[0], 1.0) / (2.0 * h)
    bound.evaluate(start)
    forces = bound.forces(scene.problem.equations.bulk.num_owned)
    work = scene.data.mesh.comm.allreduce(float(forces @ change[: forces.size]))
    assert work == pytest.approx(float(load.load @ motion), rel=1e-8)
    assert abs(work) > 0.1


def test_mean_rotation_is_that_of_the_boundary_over_turns():
    """Rigid motions about one axis, by more than two turns."""
    scene, load, bound = pulled()
    space, axis = scene.problem.equations.bulk.space, np.array((2.0, -1.0, 2.0)) / 3.0
    X, values = space.positions()[space.dofs], np.zeros_like(scene.u.x.array)
    for angle in np.linspace(0.0, 14.0, 15):
        values[space.dofs] = X @ rotation_less_one(angle * axis).T + (0.1, 0.2, 0.3)
        bound.evaluate(values)
    bound.record()
    assert np.abs(load.place[3:] - 14.0 * axis).max() < 1e-10
    moved = rotation_by(14.0 * axis) @ load.pivot + (0.1, 0.2, 0.3)
    assert np.abs(load.pivot + load.place[:3] - moved).max() < 1e-10


@pytest.mark.once
@pytest.mark.parametrize("spread", [("upper/right",), ("upper/right", "upper/top")])
def test_tangent_has_slopes_of_two(spread):
    """Also if some nodes belong to a rigid boundary as well, whose balance has the load."""
    boxes = [
        Box("upper", block((2, 2, 2), size=(1, 1, 0.5), corner=(0.2, 0.2, 0.5))),
        Box("lower", block((3, 3, 2), size=(1.4, 1.4, 0.5))),
    ]
    scene = of(mapped_boxes.mesh(boxes))
    held(scene, side="lower/bottom")
    grip = fm.RigidBoundary(scene.data, "upper/top", pivot=(0.5, 0.6, 1.3))
    pull = fm.SpreadLoad(scene.data, list(spread), pivot=(1.6, 0.5, 0.9))
    pair = fm.ContactPair(scene.data, *SIDES["upper"], law=law_of(0.3))
    problem = scene.set_up([pair], remote=[grip, pull], newton=TIGHT).problem
    grip.move(z=-0.03, angle=(0.01, 0.02, 0.1))
    pull.push(x=0.3, y=0.2, z=-0.3, moment=(0.05, -0.1, 0.08))
    report = problem.solve()
    assert report.residuals[-1] < 1e-3 * report.residuals[-2] + 1e-14
    grip.push(z=-0.8, moment=(0.0, 0.0, 0.02))
    slopes = problem.check_tangent(print_table=False).slopes
    assert min(slopes.values()) > 1.95, slopes


def test_what_is_refused():
    scene, load, _ = pulled()
    with refused(ValueError, "has no prescribed motion"):
        load.move(z=1.0)
    load.push(moment=(None, None, 0.1))
    with refused(fm.MortarError, "load of spread load 'eye' is nan"):
        scene.problem.solve()
