# SPDX-License-Identifier: MIT
"""Integration over segments, whole facets or at nodes: patch tests and common properties."""

from mpi4py import MPI

import numpy as np
import pytest
from curves import Curves
from scenes import PARTLY_COVERED, disturbed, homogeneous_blocks, pressed_blocks
from test_operators import dense, moved_scene
from test_patch import EXACT, STRETCH, assert_uniform, neo_hookean, uniaxial

from fenics_mortar.kernels.facets import STANDARD

comm = MPI.COMM_WORLD
FIXED = [{"integration": "elements"}, {"integration": "nodes"}]
MESH = {"n_upper": 7, "n_lower": 11, "layers_upper": 4, "layers_lower": 4}


def patch(counts, pair, degree=1):
    """The uniaxial patch test, solved; and the exact pressure."""
    a, pressure = uniaxial(neo_hookean)
    scene = homogeneous_blocks(
        np.diag([a - 1, STRETCH - 1]),
        ["lower/bottom", "upper/top"],
        pair=pair,
        degree=degree,
        n_upper=counts[0],
        n_lower=counts[1],
        layers_upper=3,
        layers_lower=4,
    )
    scene.problem.solve()
    return scene, pressure


def load_error(slaves, masters, **options):
    """Largest relative error of the master's nodal forces under a uniform pressure, flat facets."""

    def flat(count):
        return np.stack([np.linspace(0, 1, count + 1), np.zeros(count + 1)], axis=1)

    pair = Curves(flat(slaves), flat(masters)[::-1].copy(), **options)
    found, exact = np.zeros(masters + 1), np.full(masters + 1, 1 / masters)
    exact[[0, -1]] /= 2
    np.add.at(found, pair.nodes[1], pair.evaluate(pair.positions)["M"].sum(axis=1))
    return np.abs(found / exact - 1).max()


@pytest.mark.serial
@pytest.mark.parametrize(
    "counts, errors", [((4, 3), [6e-3, 3e-3, 8e-4, 1e-4]), ((3, 10), [9e-1, 1e-1, 1e-2, 3e-3])]
)
def test_uniform_pressure_error_falls_with_points_per_facet(counts, errors):
    """Magnitudes of an independent code for 2, 5, 10 and 20 points, known to one digit."""
    for points, error in zip((2, 5, 10, 20), errors, strict=True):
        found = load_error(*counts, integration="elements", points=points)
        assert found == pytest.approx(error, rel=0.25)
    assert load_error(*counts, points=3) < 1e-14
    assert load_error(*counts, integration="nodes", basis=STANDARD) > 0.1


@pytest.mark.once
def test_segments_pass_the_patch_test_and_nodes_fail_it():
    scene, pressure = patch((5, 7), {})
    assert_uniform(scene, pressure)
    scene, pressure = patch((5, 7), {"integration": "nodes"})
    contact = scene.contact
    assert np.abs(contact.pressure / pressure - 1).max() > 0.05


@pytest.mark.once
@pytest.mark.parametrize("degree", [1, 2])
def test_more_points_per_facet_pass_the_patch_test_better(degree):
    errors = []
    for points in (3, 30):
        scene, pressure = patch((5, 7), {"integration": "elements", "points": points}, degree)
        errors.append(np.abs(scene.contact.pressure / pressure - 1).max())
    assert 1e-5 < errors[1] < errors[0] / 10


@pytest.mark.serial
@pytest.mark.parametrize("degree", [1, 2])
def test_default_points_per_facet_pass_the_patch_test_to_half_a_percent(degree):
    """With 5 points on facets of three nodes, the error would be 5 percent."""
    scene, pressure = patch((5, 8), {"integration": "elements"}, degree)
    assert 5e-4 < np.abs(scene.contact.pressure / pressure - 1).max() < 5e-3


@pytest.mark.once
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("pair", FIXED)
def test_matching_nodes_pass_a_uniform_pressure(pair, degree):
    """Without Poisson's effect; with it, end nodes would slip off the edge of the master."""
    scene = pressed_blocks(
        n_upper=4, n_lower=4, width_upper=1.0, width_lower=1.0, nu=0.0, pair=pair, degree=degree
    )
    scene.loads["push"].value[1] = -0.1
    scene.problem.solve()
    pressure = -50.0 * (0.95 - 1 / 0.95)  # mu = 50, lambda = 0, each block of height 1
    assert scene.contact.active.all()
    # Newton stops at a residual relative to the whole force, of which some nodes have a 24th
    assert np.abs(scene.contact.pressure / pressure - 1).max() < 10 * EXACT


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("pair", FIXED)
def test_forces_of_both_sides_cancel_and_newton_is_quadratic(pair, slave, degree, algorithm):
    """The lower block is wider: as the slave it has partly covered facets or single points."""
    scene = pressed_blocks(
        slave=slave, pair=pair, degree=degree, problem={"algorithm": algorithm}, **MESH
    )
    for load in (0.5, 1.0):
        scene.loads["push"].value[:] = (0.02 * load, -0.06 * load)
        report = scene.problem.solve()
    contact = scene.contact
    on_slave, on_master = contact.operators.force(contact.z)
    assert np.abs(on_slave.sum(axis=0) + on_master.sum(axis=0)).max() < 1e-14 * (
        np.abs(on_slave).sum() + np.abs(on_master).sum()
    )
    r = np.array(report.residuals) / report.force
    k = int(np.argmax(r < 1e-5))  # some digits are correct: the next step doubles their number
    assert r[k] < 1e-5 and r[k + 1 :].min() < max(100 * r[k] ** 2, 1e-12)


@pytest.mark.once
@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("pair", [*FIXED, {"integration": "elements", "basis": "standard"}])
def test_assembled_tangent_has_second_order_remainder(pair, degree, slave):
    """The steps are so small that no point changes its partner; the blocks are not aligned."""
    scene = disturbed(pressed_blocks(slave=slave, pair=pair, degree=degree, **PARTLY_COVERED))
    check = scene.problem.check_tangent(print_table=False)
    for name, slope in check.slopes.items():
        assert slope == pytest.approx(2.0, abs=0.05), (name, check.table())


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("pair", FIXED)
def test_matrices_have_equal_row_sums_and_diagonal_D(pair, degree):
    problem = moved_scene(pair=pair, degree=degree).problem
    D, M = dense(problem.matrices.D()), dense(problem.matrices.M())
    assert np.abs(D.sum(axis=1) - M.sum(axis=1)).max() < 1e-15
    kept = np.diag(D) > 0.0  # a node with a negative integral hands its function over
    assert np.abs(D - np.diag(np.diag(D)))[:, kept].max() == 0.0


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("pair", FIXED)
def test_solution_does_not_depend_on_the_number_of_ranks(pair, degree):
    """All ranks together and each rank alone."""
    found = []
    for group in (comm, MPI.COMM_SELF):
        scene = pressed_blocks(pair=pair, degree=degree, comm=group, **MESH)
        scene.loads["push"].value[:] = (0.02, -0.06)
        scene.problem.solve()
        assert np.array_equal(scene.contact.z, group.bcast(scene.contact.z))
        found.append(scene.contact)
    together, alone = found
    assert np.array_equal(together.active, alone.active)
    assert np.abs(together.z - alone.z).max() < 1e-10 * np.abs(alone.z).max()


@pytest.mark.parametrize("pair", FIXED)
def test_measured_penetration_is_independent_of_the_integration(pair):
    """Penetration is also measured between nodes, on the segments."""
    scene = pressed_blocks(slave="lower", n_upper=11, n_lower=4, pair=pair)
    scene.loads["push"].value[:] = (0.02, -0.06)
    scene.problem.solve()
    certificate = scene.problem.certificate()
    assert certificate.violations() == []
    own = certificate.pairs[0]
    assert own["force"].value < 1e-14 and own["missed_nodes"].value == 0
    exact = comm.allreduce(scene.contact.intersections().num_segments)
    assert exact > scene.contact.operators.num_segments
    assert 1e-3 < own["penetration"].value < 0.2  # 0.005 and 0.1 facets, between the points
