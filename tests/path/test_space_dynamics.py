# SPDX-License-Identifier: MIT
"""Time steps of solids in contact: impacts of free blocks and of a spinning ball, conservation."""

from mpi4py import MPI

import numpy as np
import pytest
from refusal import refused

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from meshes.mapped_boxes import SIDES, Box, block, mapped, mesh

STEP = fm.SteppingOptions(step=0.02)


def moving(data, pairs, mu, velocity, scheme):
    """Neo-Hookean bodies of density 1, with ``pairs`` of sides; ``velocity`` of points by body."""
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    psi = energies.neo_hookean(u, *energies.lame(100.0, 0.3))
    psi *= ufl.dx(metadata={"quadrature_degree": 3})
    law = fm.Coulomb(mu) if mu else None
    pairs = [fm.ContactPair(data, *sides, law=law) for sides in pairs]
    problem = fm.ContactProblem(
        ufl.derivative(psi, u, v), u, pairs, petsc_options_prefix="test_space_dynamics_"
    )
    motion = fm.Dynamics(problem, density=1.0, scheme=scheme, energy=psi)
    for body, of_points in velocity.items():
        motion.velocity.interpolate(of_points, data.cell_tags.find(data.bodies[body]))
    return problem, motion


def flying(cell, mu, scheme, layers=2):
    """Two free blocks, one turned, that fly towards each other; the upper one also sideways."""
    c, s = np.cos(0.4), np.sin(0.4)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    upper = block((2, 2, layers), size=(1.0, 1.0, 0.6), corner=(-0.5, -0.5, 0.02)) @ turn
    lower = block((3, 3, 2), size=(1.4, 1.4, 0.6), corner=(-0.7, -0.6, -0.6))
    data = mesh([Box("upper", upper), Box("lower", lower)], cell=cell, comm=MPI.COMM_WORLD)
    velocity = {
        "upper": lambda x: np.outer((0.4, 0.1, -1.0), np.ones_like(x[0])),
        "lower": lambda x: np.outer((0.0, 0.0, 0.5), np.ones_like(x[0])),
    }
    return moving(data, [("upper/bottom", "lower/top")], mu, velocity, scheme)


@pytest.mark.parametrize(("cell", "mu"), [("hexahedron", 0.0), ("tetrahedron", 0.3)])
def test_an_impact_conserves_momentum_and_energy(cell, mu):
    """Both momenta to rounding in all axes; energy but for the work of friction."""
    problem, motion = flying(cell, mu, "conserving")
    before = motion.momentum()
    assert before.shape == (6,)
    record = motion.run(0.12, STEP)
    touched = any(contact.active.any() for contact in problem.contacts)
    assert problem.equations.comm.allreduce(touched, MPI.LOR)
    assert max(step.report.num_iterations for step in record.steps) <= 12
    np.testing.assert_allclose(motion.momentum(), before, atol=1e-12)
    lost = record.start.total - record.steps[-1].energies.total
    assert (lost > 0.01 * record.start.total) == (mu > 0.0)
    # Lobatto's rule of sixth order for the energy of the bodies; both are about 0.7.
    assert lost == pytest.approx(record.friction_work, abs=1e-7 * record.start.total)


def test_with_mass_on_the_surfaces_errors_are_those_of_the_steps():
    _, motion = flying("hexahedron", 0.0, "generalized_alpha")
    before = motion.momentum()
    motion.run(0.12, STEP)
    size = np.abs(before[:3]).max()
    np.testing.assert_allclose(motion.momentum()[:3], before[:3], atol=1e-10 * size)
    np.testing.assert_allclose(motion.momentum()[3:], before[3:], atol=1e-2 * size)


def test_masses_moved_inside_leave_the_inertia_of_the_body():
    """Mass, centre of mass and all six products of inertia; no mass at the slave's nodes."""
    momenta = []
    for scheme in ("generalized_alpha", "conserving"):
        problem, motion = flying("tetrahedron", 0.0, scheme)
        space = problem.equations.bulk.space
        rigid = [lambda x, i=i: np.outer(np.eye(3)[i], np.ones_like(x[0])) for i in range(3)]
        rigid += [lambda x, i=i: np.cross(np.eye(3)[i], x.T).T for i in range(3)]
        momenta.append([])
        for field in rigid:
            motion.velocity.interpolate(field)
            motion.velocity.x.scatter_forward()
            momenta[-1].append(motion.momentum())
        if scheme == "conserving":
            masses = motion._inertia.M.getDiagonal().array_r[space.owned_dofs]
            count = space.V.mesh.comm.allreduce(int((masses == 0.0).all(axis=1).sum()))
            assert count == 9
    np.testing.assert_allclose(momenta[1], momenta[0], atol=1e-13)


def test_a_body_of_one_layer_of_cells_cannot_take_over_the_mass():
    with refused(fm.MortarError, "fewer than two layers of nodes behind the slave surface"):
        flying("hexahedron", 0.0, "conserving", layers=1)


@pytest.mark.serial
def test_corners_of_single_tetrahedra_find_nodes_that_take_over_their_mass():
    """A surface all around; the ball that it meets is pushed away, momenta and energy remain."""
    boxes = []
    for name, at in (("a", (0.0, 0.0, 0.0)), ("b", (0.25, 0.15, 0.955))):
        x = mapped((4, 4, 4), ball)
        boxes.append(Box(name, x + np.array(at), {side: f"{name}/skin" for side in SIDES}))
    data = mesh(boxes, cell="tetrahedron", comm=MPI.COMM_WORLD)
    falls = {"b": lambda x: np.outer((0.0, 0.0, -1.5), np.ones_like(x[0]))}
    problem, motion = moving(data, [("a/skin", "b/skin")], 0.0, falls, "conserving")
    before = motion.momentum()
    record = motion.run(0.06, STEP)
    assert any(contact.active.any() for contact in problem.contacts)
    np.testing.assert_allclose(motion.momentum(), before, atol=1e-12)
    assert record.steps[-1].energies.total == pytest.approx(record.start.total, rel=1e-7)


@pytest.mark.parametrize("scheme", ["conserving", "generalized_alpha"])
def test_blocks_of_one_list_of_surfaces_collide_as_those_of_pairs(scheme):
    """Self-contact: momenta and energy remain; with all masses it is the motion of two pairs."""
    found = []
    for of_each in (True, False):
        boxes = [
            Box(f"b{i}", block((n, n, 2), size=(1.0, 1.0, 0.5), corner=(0.0, 0.0, 0.52 * i), seed=i,
                               jiggle=0.1))
            for i, n in enumerate((2, 3, 4))
        ]  # fmt: skip
        data = mesh(boxes, comm=MPI.COMM_WORLD)
        sides = [
            f"b{i}/{side}" for i, side in ((0, "top"), (1, "bottom"), (1, "top"), (2, "bottom"))
        ]
        given = [(sides[1], sides[0]), (sides[3], sides[2])] if of_each else [(sides,)]
        speeds = {"b0": (0.0, 0.0, 1.0), "b1": (0.2, 0.0, 0.0), "b2": (0.0, 0.1, -1.0)}
        velocity = {
            name: lambda x, v=v: np.outer(v, np.ones_like(x[0])) for name, v in speeds.items()
        }
        problem, motion = moving(data, given, 0.3, velocity, scheme)
        before = motion.momentum()
        record = motion.run(0.08, STEP)
        found.append(problem.equations.bulk.u.x.array.copy())
        assert any(contact.active.any() for contact in problem.contacts)
        if scheme == "conserving":
            np.testing.assert_allclose(motion.momentum(), before, atol=1e-13)
            lost = record.start.total - record.steps[-1].energies.total
            assert lost == pytest.approx(record.friction_work, abs=1e-7 * record.start.total)
    if scheme == "generalized_alpha":  # with "conserving" both sides of self-contact have no mass
        np.testing.assert_allclose(found[1], found[0], atol=1e-10)


def ball(*parameters):
    """A ball of radius 0.5 of a cube of parameters."""
    X = np.stack([2.0 * p - 1.0 for p in parameters])
    far, norm = np.abs(X).max(axis=0), np.linalg.norm(X, axis=0)
    to_sphere = far / np.where(norm > 0.0, norm, 1.0)
    return list(0.5 * X * ((1.0 - far**2) * 0.6 + far**2 * to_sphere))


@pytest.mark.serial
def test_a_spinning_ball_bounces_off_sideways():
    """While it slides, its impulse is inclined by the friction; the spin feeds the motion."""
    joined = {side: "ball/surface" for side in SIDES}
    data = mesh([Box("ball", mapped((4, 4, 4), ball), joined)], comm=MPI.COMM_WORLD)
    spin = {"ball": lambda x: np.cross((0.0, 6.0, 0.0), x.T).T - np.array([[0.0], [0.0], [1.0]])}
    floor = fm.Plane((0.0, 0.0, -0.49), (0.0, 0.0, 1.0))
    _, motion = moving(data, [("ball/surface", floor)], 0.1, spin, "conserving")
    before = motion.momentum()
    record = motion.run(0.28, fm.SteppingOptions(step=0.04))
    gained = motion.momentum() - before
    assert gained[2] > 1.5 * abs(before[2])
    # Nodal normals of the facets differ from that of the plane by second order: 1 %.
    assert gained[0] == pytest.approx(0.1 * gained[2], rel=0.02)
    assert abs(gained[1]) < 1e-10
    # Moment of the friction at the radius; that of the pressures is one of the facets' shape.
    assert gained[4] == pytest.approx(-0.5 * gained[0], abs=0.05 * gained[2])
    lost = record.start.total - record.steps[-1].energies.total
    assert lost == pytest.approx(record.friction_work, abs=1e-6 * record.start.total)
