# SPDX-License-Identifier: MIT
"""Friction: derivatives, exact states, both systems, bad input."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
from friction_scenes import LAWS, MEASURES, MESH, NU, SMALL, E, block_on, blocks, drive
from scenes import homogeneous_blocks, internal, linear_elastic, pair_options, pressed_blocks, read

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact.law import GRAZE, Nodal, Row
from fenics_mortar.contact.rows import strength
from fenics_mortar.energies import lame
from fenics_mortar.rigid.complementarity import largest_adhesion
from meshes import mapped_grids
from meshes.mapped_grids import Grid, mapped

NO_MESH = fm.MeshData(SimpleNamespace(comm=MPI.COMM_SELF), None, None)


class Creeping(fm.Law):
    """Law in the docstring of ``laws``."""

    def branch(self, node: Nodal, before):
        return np.ones_like(before)

    def tangential(self, node: Nodal, branch) -> Row:
        part = np.tanh(node.slip / 0.01)
        return Row(
            node.z_tau - 0.3 * node.z_n * part,
            by_slip=-0.3 * node.z_n * (1.0 - part**2) / 0.01,
            by_z_n=-0.3 * part,
            by_z_tau=1.0,
        )

    def friction_limit(self, pressure):
        return 0.3 * pressure


def slopes(problem, branches=None):
    """Slopes of the whole system; 1 if a term is missing."""
    if branches is not None:
        problem.equations.contacts[0].change(
            branch=np.resize(branches, problem.equations.contacts[0].branch.size)
        )
    return problem.check_tangent(print_table=False).slopes["whole"]


@pytest.mark.once
@pytest.mark.parametrize(
    "law, pair",
    [
        *((law, {}) for law in [*LAWS, "creeping"]),
        ("coulomb", {"slip": "operators"}),
        ("coulomb", {"slip": "operators", "basis": "standard"}),
    ],
)
@pytest.mark.parametrize("degree", [1, 2])
def test_tangent_has_slope_two(law, pair, degree):
    """Solved sets; then all nodes set to stick, to slide, and to slide in both directions."""
    scene = blocks(LAWS.get(law) or Creeping(), degree=degree, pair=pair)
    drive(scene, (0.0, -0.03), (0.02, -0.04))
    for branches in (None, [0], [1], [1, 0, -1, 0]):
        assert slopes(scene.problem, branches) == pytest.approx(2.0, abs=0.02)


@pytest.mark.once
@pytest.mark.parametrize("degree", [1, 2])
def test_tangent_on_an_obstacle_has_slope_two(degree):
    """The obstacle's motions are directions of the test, too."""
    circle = fm.Circle((0.5, -2.0), 2.03)
    problem, _ = block_on(circle, degree=degree, law=fm.Coulomb(0.4))
    problem.solve()
    circle.move(x=0.01, angle=0.002)
    problem.solve()
    for branches in (None, [0], [1, 0, -1]):
        assert slopes(problem, branches) == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize("algorithm", ["saddle", "condensed"])
@pytest.mark.parametrize("degree", [1, 2])
def test_sticking_blocks_deform_as_one_block(algorithm, degree):
    """A homogeneous deformation with shear: the multiplier is minus Cauchy's traction.

    It is exact up to rounding: the state lies in both spaces, and the meshes do not match.
    """
    gradient = np.array([[0.01, 0.03], [0.0, -0.1]])
    sides = [f"{body}/{side}" for body in ("upper", "lower") for side in ("left", "right")]
    scene = homogeneous_blocks(
        gradient,
        ["upper/top", "lower/bottom", *sides],
        degree=degree,
        pair={"law": fm.Coulomb(0.9)},
        problem={"algorithm": algorithm},
        **SMALL,
    )
    scene.problem.solve()
    contact, F = scene.contact, np.eye(2) + gradient
    mu, lmbda = lame(E, NU)
    J = np.linalg.det(F)
    cauchy = (mu * (F @ F.T - np.eye(2)) + lmbda * np.log(J) * np.eye(2)) / J
    on = contact.covered
    exact = cauchy @ [0.0, 1.0]  # the slave's normal is (0, -1), z minus its traction
    assert contact.sticking[on].all()
    assert np.abs(exact[0]) > 1.0
    assert np.abs(contact.z[on] - exact).max() < 1e-10 * np.abs(exact).max()


@pytest.mark.once
@pytest.mark.parametrize("law", ["coulomb", "tresca"])
def test_sliding_block_transfers_the_friction_limit(law):
    scene = blocks(LAWS[law])
    records = drive(scene, (0.0, -0.1), (0.1, -0.1), (0.2, -0.1), (0.3, -0.1))
    contact = scene.contact
    assert contact.active.all() and not contact.sticking.any()
    node = contact.nodal
    bound = 0.3 * node.z_n if law == "coulomb" else np.full_like(node.z_n, 1.0)
    assert np.abs(np.abs(node.z_tau) - bound).max() < 1e-12 * node.z_n.max()
    assert max(record.num_iterations for record in records) <= 8


@pytest.mark.once
def test_shear_beyond_the_friction_limit_is_reported():
    scene = blocks(fm.Coulomb(0.3))
    drive(scene, (0.0, -0.1), (0.1, -0.1))
    assert scene.problem.certificate().pairs[0]["shear"].value < 1e-10
    scene.contact.pair.law = fm.Coulomb(0.2)
    certificate = scene.problem.certificate()
    assert certificate.pairs[0]["shear"].value == pytest.approx(0.1, rel=1e-6)
    assert any("shear" in violation for violation in certificate.violations())


def test_wedge_agrees_with_the_closed_form():
    """H = W (tan a + mu) / (1 - mu tan a) for any deformation of the block."""
    angle, mu, weight = 0.2, 0.3, 4.0
    plane = fm.Plane((0.0, 0.0), (-np.sin(angle), np.cos(angle)))
    problem, along = block_on(plane, law=fm.Coulomb(mu), angle=angle, weight=weight)
    for shift in (0.05, 0.1):
        along.value = shift
        problem.solve()
    contact, W = problem.equations.contacts[0], 0.5 * weight
    assert contact.active.any() and not contact.sticking.any()
    force = contact.total_force
    H = W * (np.tan(angle) + mu) / (1.0 - mu * np.tan(angle))
    assert force == pytest.approx([-H, W], rel=1e-8)


@pytest.mark.once
@pytest.mark.parametrize("pair", MEASURES)
def test_both_algorithms_and_contact_dofs_agree(pair):
    """Condensed, saddle point, and reduced to the contact dofs of a linear bulk."""
    answers = []
    for options in ({"algorithm": "condensed"}, {"algorithm": "saddle"}, {"linear_bulk": True}):
        scene = pressed_blocks(
            material=linear_elastic,
            pair={"law": fm.Coulomb(0.3), **pair},
            problem=options,
            **MESH,
        )
        drive(scene, (0.0, -0.02), (0.03, -0.02))
        answers.append(scene.contact.z)
    for answer in answers[1:]:
        assert np.abs(answer - answers[0]).max() < 1e-10 * np.abs(answers[0]).max()


@pytest.mark.serial
@pytest.mark.parametrize(
    "wrong",
    [
        lambda: fm.Coulomb(-0.1),
        lambda: fm.Coulomb(0.1, c_t=0.0),
        lambda: fm.Coulomb(0.1, limit_by="force"),
        lambda: fm.Coulomb(0.1, max_shear=0.0),
        lambda: fm.Tresca(-1.0),
        lambda: fm.ContactPair(NO_MESH, 1, 2, law="coulomb"),
        lambda: fm.ContactPair(NO_MESH, 1, 2, **pair_options(slip="textbook")),
    ],
)
def test_invalid_numbers_are_refused(wrong):
    with pytest.raises(ValueError, match=r"mu=|c_t=|limit_by=|max_shear=|stress=|law=|slip="):
        wrong()


class Peeling(fm.Tresca):
    """With a limit that jumps where a node opens."""

    grazes = False


def circle_on_block(law, circle=None):
    """A circle is pressed on a block and slides in one large step."""
    circle = circle or fm.Circle((1.3, 2.0), 1.0)
    grid = Grid("block", mapped(20, 6, lambda s, t: (4.0 * s, t)))
    data = read(lambda: mapped_grids.build([grid]))
    u = fem.Function(fm.vector_space(data.mesh, 1))
    bcs = [fm.dirichlet(u.function_space, data, "block/bottom", (0.0, 0.0))]
    pair = fm.ContactPair(data, "block/top", circle, law=law)
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, E, NU)), u, [pair], bcs=bcs, petsc_options_prefix="test_"
    )
    circle.move(y=-0.05)
    problem.solve()
    circle.move(x=0.1)
    return problem


@pytest.mark.serial
@pytest.mark.once
def test_steps_with_grazing_nodes_do_not_depend_on_earlier_solves(tmp_path):
    """How often its shear has opened a node counts in one solve only."""
    moves = (0.204, 0.018), (-0.099, -0.017), (0.193, -0.04), (0.17, 0.02), (0.011, -0.017)
    circles = [fm.Circle((1.3, 2.0), 1.0) for _ in range(2)]
    going_on, continued = (circle_on_block(fm.Tresca(0.2 * E), circle) for circle in circles)
    going_on.solve()
    for x, y in moves:
        fm.save_state(going_on, tmp_path / "state.npz")
        fm.load_state(continued, tmp_path / "state.npz")
        forces = []
        for problem, circle in zip((going_on, continued), circles, strict=True):
            circle.move(x=x, y=y)
            problem.solve()
            forces.append(problem.equations.contacts[0].now.total_force)
        assert forces[0] == pytest.approx(forces[1], rel=1e-9)


@pytest.mark.serial
def test_peeling_edge_is_reported_with_a_remedy():
    """When an edge node closes, its shear opens it again."""
    with pytest.raises(fm.NotConvergedError, match=r"1 nodes of 'block/top' .*one at \(1.6.*peel"):
        circle_on_block(Peeling(0.1 * E)).solve()


@pytest.mark.serial
def test_an_edge_grazes_that_its_shear_would_peel_off():
    """It slides without pressure, with a part of the shear; Coulomb's law for mu to infinity."""
    problem = circle_on_block(fm.Tresca(0.1 * E))
    pressed, contact = problem.state(), problem.equations.contacts[0]
    assert problem.solve().num_iterations <= 12
    edge = contact.active_nodes[0]
    assert np.flatnonzero(contact.active & (np.abs(contact.branch) == GRAZE)).tolist() == [edge]
    shear, pressure = contact.z_tau.copy(), contact.pressure.copy()
    assert abs(pressure[edge]) < 1e-9 * pressure.max()
    assert abs(contact.gap[edge]) < 1e-10
    assert 0.0 < shear[edge] < 0.1 * E
    assert contact.now.slip[edge] > 0.0
    assert problem.check_tangent(print_table=False).slopes["whole"] > 1.95
    slopes = []  # of the shear by the pressure of the edge, whose shear is mu times its pressure
    for mu in (10.0, 30.0):
        problem.restore(pressed)
        contact.pair.law = fm.Coulomb(mu, max_shear=0.1 * E)
        problem.solve()
        assert contact.z_tau[edge] == pytest.approx(mu * contact.pressure[edge], rel=1e-9)
        slopes.append(np.abs(contact.z_tau - shear).max() / contact.pressure[edge])
    assert slopes[0] == pytest.approx(slopes[1], rel=0.03)


@pytest.mark.once
@pytest.mark.each
@pytest.mark.parametrize(
    "law, slope, shear",
    [
        (fm.Coulomb(0.3), 0.3, 0.0),
        (fm.Tresca(2.0), 0.0, 2.0),
        (fm.Coulomb(0.3, max_shear=4.5), 0.15, 1.5),  # 3 at the pressure 10, 4.5 at twice that
        (fm.Frictionless(), 0.0, 0.0),
    ],
    ids=str,
)
def test_friction_limit_is_linear_in_the_pressure(law, slope, shear):
    now = blocks(law).contact.now
    found, at_zero = strength(now, 10.0)
    assert found == pytest.approx(np.full(len(found), slope), abs=1e-14)
    assert np.array_equal(at_zero > 0.0, np.full(len(found), shear > 0.0))
    assert at_zero == pytest.approx(np.full(len(found), shear))
    assert not largest_adhesion(now).any()
