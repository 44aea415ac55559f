# SPDX-License-Identifier: MIT
"""Stick that follows from other constraints: detected, elastic, exact in patch tests."""

import numpy as np
import pytest
import supported
from small_scenes import small_blocks

import fenics_mortar as fm
from fenics_mortar.equations.linearized_contact import dependent, repeating


@pytest.mark.serial
def test_dependent_rows_are_found_in_order():
    x, y, z = np.eye(3)
    rows = np.array([x, y, (x + y) / np.sqrt(2.0), z, (x - z) / np.sqrt(2.0)])
    assert dependent(rows).tolist() == [False, False, True, False, True]
    nearly = (x + 0.01 * y) / np.hypot(1.0, 0.01)
    assert dependent(np.array([x, nearly])).tolist() == [False, True]


@pytest.mark.serial
def test_only_rows_of_shared_slave_nodes_are_compared():
    """Pair 0: slave nodes 1, 2 on master node 3; pair 1: slave node 3 on 1; node 2 occurs once."""
    pair = np.array([0, 0, 0, 0, 1, 1])
    row = np.array([0, 0, 2, 2, 0, 0])
    node = np.array([1, 3, 2, 3, 3, 1])
    own = np.array([True, False, True, False, True, False])
    assert repeating(pair, row, node, own).tolist() == [True, True, False, False, True, True]


@pytest.mark.parametrize("cells", [(2, 2, 3), (3, 4, 5), (2, 2, 4)])
@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_uniform_pressure_across_a_joint_is_exact(cells, slave):
    """A facet spans the joint of two blocks; its closed gaps prevent slip of their corners."""
    scene = supported.t_junction(cells, side=0.5, slave=slave)
    (report,) = scene.solve()
    assert report.num_iterations <= 10
    assert scene.wrong(scene) == ""


@pytest.mark.once
@pytest.mark.parametrize("mu, cells", [(0.2, (4,)), (0.6, (4, 6, 2)), (0.4, (3, 5))])
def test_walls_take_few_iterations_and_report_redundant_shears(mu, cells):
    """Running bond, weight, then a quarter of the limit push; 68 to 78 iterations before."""
    scene = supported.wall(2, 2, mu, push=0.25, cells=cells)
    reports = list(scene.solve())
    assert max(report.num_iterations for report in reports) <= 10
    assert all(report.certificate.violations() == [] for report in reports)
    redundant = sum(int(contact.redundant.sum()) for contact in scene.problem.equations.contacts)
    notes = [note for note in reports[-1].notes if "not unique" in note]
    assert bool(redundant) == bool(notes)
    if cells == (4,):
        assert redundant > 0


@pytest.mark.once
def test_repeated_solve_keeps_redundant_shears():
    scene = supported.wall(2, 2, 0.6, push=0.25)
    list(scene.solve())
    before = [contact.z.copy() for contact in scene.problem.equations.contacts]
    scene.problem.solve()
    largest = max(np.abs(z).max() for z in before)
    for contact, z in zip(scene.problem.equations.contacts, before, strict=True):
        # Accuracy: the residual's tolerance over the compliance of elastic stick.
        assert np.abs(contact.z - z).max() < 1e-5 * largest


def test_next_solve_clears_redundancy_marks():
    """Within a solve a mark remains as long as the node sticks."""
    problem = small_blocks(pair={"law": fm.Coulomb(0.5)}).problem
    contact = problem.equations.contacts[0]
    for start in (False, True):
        contact.change(redundant=np.ones(contact.slave.num_nodes, bool))
        problem.equations.evaluate(start=start)
        assert contact.redundant.any() != start
