# SPDX-License-Identifier: MIT
"""Results of contacts in space, states and paths; what is refused by name."""

import numpy as np
import pytest
from refusal import refused
from space_pairs import ROLES, pressed, stack

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.utils.errors import NOT_IN_SPACE
from meshes.mapped_boxes import Box, mapped, mesh

COULOMB = fm.Coulomb(0.3)


def slid(law=COULOMB):
    scene = pressed(law=law, problem={"newton": fm.NewtonOptions(residual_tolerance=1e-11)})
    scene.move(0.0, 0.0, -0.04)
    scene.move(0.03, 0.01, -0.04)
    return scene


def test_public_properties_have_components_of_space():
    contact = slid().contact
    count = len(contact.nodes)
    vectors = ("positions", "normals", "tractions", "shear", "slip", "forces")
    assert {getattr(contact, name).shape for name in vectors} == {(count, 3)}
    numbers = ("pressure", "gap", "lengths", "active", "sticking", "status", "offset")
    assert {getattr(contact, name).shape for name in numbers} == {(count,)}
    parts = contact.pressure[:, None] * contact.normals + contact.shear
    assert np.abs(parts - contact.tractions).max() < 1e-12
    assert np.abs((contact.shear * contact.normals).sum(axis=1)).max() < 1e-12
    assert np.abs(contact.forces.sum(axis=0) - contact.total_force).max() < 1e-12
    assert contact.friction_work > 0.0
    assert contact.slave.X.shape == (count, 3) and contact.memory == {} and contact.fluxes == []


def test_parts_of_the_multipliers_of_ties():
    scene = stack(poisson=0.3).press().set_up(tie=True)
    scene.move(0.05, 0.02, -0.1)
    contact = scene.contact
    parts = contact.pressure[:, None] * contact.normals + contact.shear
    assert np.abs(parts - contact.tractions).max() < 1e-12 * np.abs(parts).max()
    assert contact.pressure.mean() > 1.0 and not contact.slip.any()


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_all_corners_of_a_cell_that_is_periodic_in_two_directions_show_one_pressure(cell):
    """The last corner is slave of both ties, and the node across is slave of one of them."""

    def rough(s, t, r):
        waves = np.cos(2 * np.pi * (s - 0.05)) * np.cos(2 * np.pi * (t - 0.02))
        return 2.0 * s, 2.0 * t, r * (1.0 + 0.03 * waves)

    data = mesh([Box("cell", mapped((4, 4, 1), rough))], cell=cell)
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    energy = fm.energies.linear_elastic(fm.energies.strain(u), *fm.energies.lame(100.0, 0.3))
    pairs = [
        fm.ContactPair(data, "cell/top", fm.Plane((0.0, 0.0, 1.01), (0.0, 0.0, -1.0))),
        fm.TiedPair(data, "cell/right", "cell/left", translation=(2.0, 0.0, 0.0)),
        fm.TiedPair(data, "cell/back", "cell/front", translation=(0.0, 2.0, 0.0)),
    ]
    problem = fm.ContactProblem(
        ufl.derivative(energy * ufl.dx(degree=3), u, v), u, pairs,
        bcs=[fm.dirichlet(V, data, "cell/bottom", np.zeros(3))], petsc_options_prefix="cell_",
    )  # fmt: skip
    problem.solve()
    contact = problem.contacts[0]
    corners = (np.abs(contact.slave.X[:, :2] - 1.0) > 1.0 - 1e-9).all(axis=1)
    assert corners.sum() == 4 and contact.pressure[corners].min() > 1.0
    assert np.ptp(contact.pressure[corners]) == 0.0 == np.ptp(contact.gap[corners])


def test_table_certificate_and_reactions_agree():
    scene = slid()
    contact, problem = scene.contact, scene.problem
    table = str(fm.contact_table(problem))
    force = ", ".join(f"{value:.4e}" for value in contact.total_force)
    assert f"({force})" in table
    assert problem.certificate().violations() == []
    above = problem.reaction("upper/top", data=scene.data)
    assert np.abs(above.force + contact.total_force).max() < 1e-8
    moment = np.cross(contact.positions, contact.forces).sum(axis=0)
    assert np.abs(above.moment + moment).max() < 1e-8


def test_states_are_restored_saved_and_loaded(tmp_path):
    scene = slid()
    folder = scene.data.mesh.comm.bcast(tmp_path)
    state, before = scene.problem.state(), scene.contact.tractions
    fm.save_state(scene.problem, folder / "state.npz")
    scene.move(0.1, 0.0, -0.05)
    assert np.abs(scene.contact.tractions - before).max() > 0.1
    after = scene.contact.tractions
    scene.problem.restore(state)
    assert np.array_equal(scene.contact.tractions, before)
    other = pressed(law=COULOMB, problem={"newton": fm.NewtonOptions(residual_tolerance=1e-11)})
    fm.load_state(other.problem, folder / "state.npz")
    assert np.array_equal(other.contact.tractions, before)
    other.move(0.1, 0.0, -0.05)
    assert np.abs(other.contact.tractions - after).max() < 1e-8


def test_paths_with_friction():
    scene = pressed(law=COULOMB)

    def load(time):
        scene.push.value[:] = (0.03 * time, 0.01 * time, -0.04 * time)

    report = fm.follow_path(scene.problem, load, fm.SteppingOptions(step=0.25))
    assert len(report.steps) == 4 and max(s.report.num_iterations for s in report.steps) < 9


@pytest.mark.parametrize(
    "options, what",
    [
        ({"discretization": fm.Discretization(integration="elements")}, "integration"),
        ({"discretization": fm.Discretization(integration="nodes")}, "integration"),
        ({"discretization": fm.Discretization(basis="vertices")}, "vertices"),
    ],
)
def test_options_of_pairs_are_refused(options, what):
    name = NOT_IN_SPACE[what].replace("(", r"\(").replace(")", r"\)")
    with refused(NotImplementedError, name):
        stack().press().set_up(pair=options)


def test_pairs_of_the_plane_are_refused():
    scene = stack().press()
    with refused(ValueError, "obstacle 'circle' has 2 coordinates, the mesh 3"):
        scene.set_up(roles=(ROLES[0][0], fm.Circle((0.0, 0.0), 1.0)))
