# SPDX-License-Identifier: MIT
"""Estimates of the errors of simpler models in space, compared with true errors."""

import numpy as np
import pytest
from space_pair_scenes import two_blocks

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from fenics_mortar.models.model_error import (
    ENERGY,
    QUANTITIES,
    SolutionQuantities,
    angles_of,
    differences,
    largest_strain,
    polar,
    strained,
)
from fenics_mortar.obstacles.rigid_motion import rotation_by
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, block, mapped

COUNTS = (3, 3, 2), (4, 4, 2)


def solved(push, **options):
    scene = two_blocks(counts=COUNTS, **options)
    scene.motions["upper/top"].value[:] = push
    return scene, scene.solve()


def check(scene, push, full, names=QUANTITIES, limits=(0.5, 2.0)):
    """Compare the last estimate of a scene with the difference from the richer one."""
    scene.motions["upper/top"].value[:] = push
    found = scene.solve().model_check.assumptions[-1]
    here, other = (SolutionQuantities.of(s.problem) for s in (scene, full))
    true = differences(scene.problem, here, other)
    for name in names:
        ratio = found.errors[name] / true[name]
        assert limits[0] < ratio < limits[1], (name, true, found.errors)
    assert true[ENERGY] > 1e-4
    return found


def linear_blocks(sliding="finite", **options):
    """Blocks of a linear material, with the residual at finite strain as the richer model."""
    scene = two_blocks(counts=COUNTS)
    u, mu_lambda = scene.u, energies.lame(100.0, 0.3)
    forms = [
        ufl.derivative(energy(u, *mu_lambda) * ufl.dx(degree=3), u)
        for energy in (energies.linear_elastic, energies.neo_hookean)
    ]
    pairs = [fm.ContactPair(scene.data, "upper/bottom", "lower/top", sliding=sliding)]
    bcs = scene.problem.equations.bulk.bcs
    scene.problem = fm.ContactProblem(
        forms[0], u, pairs, bcs=bcs, petsc_options_prefix="linear_",
        model_check=fm.ModelCheck(0.02, finite_strain=forms[1], **options),
    )  # fmt: skip
    return scene


@pytest.mark.parametrize("push", [(0.0, 0.0, -0.02), (0.06, 0.03, -0.15)])
@pytest.mark.parametrize("sliding", ["finite", "small"])
def test_linear_strain_and_small_sliding(sliding, push):
    full, _ = solved(push)
    found = check(linear_blocks(sliding), push, full)
    assert "linear strain" in found.name


@pytest.mark.parametrize("friction", [0.01, 0.3])
def test_frictionless_against_friction(friction):
    """The lower block is wider, so that the surfaces tend to slip in all directions."""
    push = (0.03, 0.02, -0.08)
    full, _ = solved(push, law=fm.Coulomb(friction))
    scene = two_blocks(counts=COUNTS, model_check=fm.ModelCheck(0.02, friction=friction))
    found = check(scene, push, full, limits=(0.8, 1.25))
    assert "stick requires" in found.indicator


@pytest.mark.serial
def test_friction_counts_the_slip_of_all_steps():
    """The last of three steps to one push makes a third of the shear."""
    push, number = np.array((0.03, 0.02, -0.08)), 0.3
    rough = two_blocks(counts=COUNTS, law=fm.Coulomb(number))
    scene = two_blocks(counts=COUNTS, model_check=fm.ModelCheck(0.02, friction=number))
    for part in (1 / 3, 2 / 3, 1.0):
        for each in (rough, scene) if part < 1.0 else (rough,):
            each.motions["upper/top"].value[:] = part * push
            each.solve()
    check(scene, push, rough, limits=(0.75, 1.35))


def cap_under(tool, *, cell, order, basis="dual", stiffer=10.0, depth=0.02, angle=(0.0, 0.0, 0.0)):
    """A block under a stiffer spherical cap, or a rigid sphere; the cap alone, if ``alone``.

    Block and sphere are rotated by ``angle`` about the origin, a cap is not.
    """
    radius, width = 2.0, 0.5

    def position(s, t, r):
        x, y = width * (s - 0.5), width * (t - 0.5)
        sagitta = radius - np.sqrt(radius**2 - x**2 - y**2)
        return x, y, 0.5 + sagitta * (1.0 - r) + 0.5 * r

    cap = Box("cap", mapped((6, 6, 4), position, order=order))
    x = block((6, 6, 4), size=(0.4, 0.4, 0.5), corner=(-0.2, -0.2, 0.0), order=order)
    turn = rotation_by(np.array(angle))
    soft = Box("soft", x @ turn.T)
    boxes = {"meshed": [cap, soft], "rigid": [soft], "alone": [cap]}[tool]
    data = mapped_boxes.mesh(boxes, cell=cell, order=order)
    V = fm.vector_space(data.mesh, order)
    u, dx = fem.Function(V), ufl.dx(subdomain_data=data.cell_tags, degree=2 * order + 1)
    parts = [
        energies.linear_elastic(u, *energies.lame(E, 0.3)) * dx(data.bodies[name])
        for name, E in (("soft", 100.0), ("cap", stiffer * 100.0)) if name in data.bodies
    ]  # fmt: skip
    push = (0.0, 0.0, 0.0 if tool == "alone" else -depth)
    bcs = [] if tool == "alone" else [fm.dirichlet(V, data, "soft/bottom", (0.0, 0.0, 0.0))]
    bcs += [] if tool == "rigid" else [fm.dirichlet(V, data, "cap/top", push)]
    residual = ufl.derivative(sum(parts), u)
    if tool == "alone":
        return lambda sphere: fm.ElasticObstacle(sphere, residual, u, data, "cap/bottom", bcs=bcs)
    sphere = fm.Sphere((0.0, 0.0, 0.5 + radius), radius, pivot=(0.0, 0.0, 0.0))
    x, y, z = turn @ (0.0, 0.0, -depth)
    sphere.move(x=x, y=y, z=z, angle=angle)
    master = sphere if tool == "rigid" else "cap/bottom"
    problem = fm.ContactProblem(
        residual, u,
        [fm.ContactPair(data, "soft/top", master, discretization=fm.Discretization(basis=basis))],
        bcs=bcs, petsc_options_prefix="cap_",
    )  # fmt: skip
    problem.solve()
    return problem


@pytest.mark.parametrize(
    "cell, order, basis",
    [("hexahedron", 1, "dual"), ("tetrahedron", 2, "dual"), ("tetrahedron", 2, "quadratic")],
)
def test_rigid_sphere_against_a_stiffer_body(cell, order, basis):
    """The elastic body alone tells what its elasticity changes, to second order: a tenth here."""
    rigid, full = (cap_under(t, cell=cell, order=order, basis=basis) for t in ("rigid", "meshed"))
    tool = cap_under("alone", cell=cell, order=order, basis=basis)(rigid.obstacles[0])
    before = rigid.state()
    report = fm.ModelCheck(elastic_obstacles=[tool]).assess(rigid)
    (assumption,) = report.assumptions
    assert np.array_equal(before.u, rigid.state().u) and "of its surface" in assumption.indicator
    forces = [p.contacts[0].total_force[2] for p in (rigid, full)]
    peaks = [p.contacts[0].pressure.max() for p in (rigid, full)]
    force, peak = forces[0] / forces[1] - 1.0, peaks[0] / peaks[1] - 1.0
    # Facets with middle nodes deviate from the sphere by a thousandth of the depth.
    of_mesh = assumption.mesh.errors if order == 1 else dict.fromkeys(QUANTITIES, 0.0)
    found = {name: assumption.errors[name] + of_mesh[name] for name in QUANTITIES}
    assert 0.8 < found["total force"] / force < 1.25, (assumption, force)
    assert 0.5 < found["peak pressure"] / peak < 2.0, (assumption, peak)
    if order == 1:
        rigid = cap_under("rigid", cell=cell, order=order, basis=basis, angle=(0.3, -0.5, 1.1))
        tool = cap_under("alone", cell=cell, order=order, basis=basis)(rigid.obstacles[0])
        (turned,) = fm.ModelCheck(elastic_obstacles=[tool]).assess(rigid).assumptions
        assert turned.errors == pytest.approx(assumption.errors, rel=1e-6)
    (give,) = tool.displacements(rigid.equations.contacts)
    on = rigid.equations.contacts[0].active
    assert (give[on & rigid.equations.contacts[0].multiplier_nodes] > 0.0).all()


def test_strain_and_rotation_of_a_known_state():
    """A rotation by 0.1 radian about an oblique axis after stretches of 3 and -2 %."""
    scene = two_blocks(counts=COUNTS)
    turn = rotation(0.1)
    H = turn @ np.diag([1.03, 1.0, 0.98]) - np.eye(3)
    scene.u.interpolate(lambda X: H @ X[:3])
    assert largest_strain(scene.problem) == pytest.approx((0.1, 0.03), rel=1e-10)


def test_rigid_motions_of_the_bodies_are_no_strain():
    scene = two_blocks(counts=COUNTS)
    bulk, turn = scene.problem.equations.bulk, rotation(0.7)
    scene.u.interpolate(lambda X: turn @ np.diag([1.02, 1.0, 1.0]) @ X[:3] - X[:3])
    rest = strained(scene.problem, bulk.u.x.array[: bulk.num_owned])[bulk.space.owned_dofs] @ turn
    X = bulk.V.tabulate_dof_coordinates()[: len(rest)]
    # both are symmetric to x = 0.7
    assert rest[:, 0] == pytest.approx(0.02 * (X[:, 0] - 0.7), abs=1e-12)
    assert np.abs(rest[:, 1:]).max(initial=0.0) < 1e-12


def rotation(angle):
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    K = np.cross(np.eye(3), -axis)
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


@pytest.mark.parametrize("dim", [2, 3])
def test_polar_decomposition(dim):
    """F = R U with a rotation R, for all signs of det F; the angle of a product of rotations."""
    F = np.random.default_rng(3).normal(size=(20, dim, dim))
    R, stretches = polar(F)
    assert np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(dim)).max() < 1e-14
    assert np.linalg.det(R) == pytest.approx(np.ones(20), rel=1e-14)
    assert stretches.prod(axis=1) == pytest.approx(np.linalg.det(F), rel=1e-12)
    U = np.swapaxes(R, 1, 2) @ F
    assert np.abs(U - np.swapaxes(U, 1, 2)).max() < 1e-13
    for angle in (1e-9, 0.4, 3.0):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s], [s, c]]) if dim == 2 else rotation(angle)
        assert angles_of(turn[None]) == pytest.approx([angle], rel=1e-6)
