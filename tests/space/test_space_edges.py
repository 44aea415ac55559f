# SPDX-License-Identifier: MIT
"""A block that is drawn over the edge of another one: facets that are covered in part."""

import numpy as np
import pytest
from space_pairs import KINDS, stack

import fenics_mortar as fm


@pytest.mark.parametrize("cell, degree", KINDS)
def test_forces_balance_beyond_an_edge(cell, degree):
    """Integrals of functions of quad9 over small covers are negative."""
    law = fm.Coulomb(0.2)
    scene = stack(cell, degree, upper=(3, 2, 1), lower=(2, 3, 1)).press().set_up(law)
    scene.move(0.0, 0.0, -0.05)
    covers = []
    for k in range(1, 5):
        report = scene.move(0.09 * k, 0.05 * k, -0.05)
        found = scene.problem.equations.contacts[0]
        on_slave, on_master = found.operators.force(found.z)
        force = np.abs(on_slave).sum()
        assert np.abs(on_slave.sum(axis=0) + on_master.sum(axis=0)).max() < 1e-12 * force
        assert report.num_iterations <= 12
        covers.append(found.operators.diagonal.sum())
    assert covers[-1] < 0.8 * covers[0]
