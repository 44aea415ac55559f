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


@pytest.mark.serial
def test_weights_of_multiplier_nodes_are_positive():
    """A small block on quadratic facets that it covers in part, its edges at many places.

    The functions of nodes beyond the edge have negative integrals. Handed over to a node with a
    small integral of its own they made its weight negative: it pulled where it closed.
    """
    for corner in np.linspace(0.05, 0.45, 5):
        scene = stack(
            "hexahedron", 2, upper=(2, 2, 1), lower=(2, 2, 1), jiggle=0.0, poisson=0.3,
            sizes=((0.5, 0.4, 0.3), (1.0, 1.0, 0.4)), offset=(corner, 0.4 * corner, -1e-3),
        ).press()  # fmt: skip
        scene.set_up(roles=("lower/top", "upper/bottom"), newton=fm.NewtonOptions())
        report = scene.move(0.0, 0.0, -0.01)
        found = scene.problem.equations.contacts[0]
        used = found.covered
        assert found.operators.weight[used].min() > 0.0
        assert (found.operators.weight[~used] == 0.0).all()
        assert report.certificate.violations() == [] and report.num_iterations < 15


def test_all_corners_of_partly_covered_triangles_carry():
    """As above; integrals of linear times quadratic functions over such a cover are negative.

    They had been taken as the weight of the node, which then took no part in contact: a block that
    rested on it could not be supported.
    """
    negative = 0
    for corner in np.linspace(0.05, 0.45, 5):
        scene = stack(
            "tetrahedron", 2, upper=(2, 2, 1), lower=(2, 2, 1), jiggle=0.0, poisson=0.3,
            sizes=((0.5, 0.4, 0.3), (1.0, 1.0, 0.4)), offset=(corner, 0.4 * corner, -1e-3),
        ).press()  # fmt: skip
        scene.set_up(roles=("lower/top", "upper/bottom"), newton=fm.NewtonOptions())
        report = scene.move(0.0, 0.0, -0.01)
        found = scene.problem.equations.contacts[0]
        assert (found.covered == (found.multiplier_nodes & (found.operators.cover > 0.0))).all()
        assert report.certificate.violations() == [] and report.num_iterations < 15
        negative += int((found.operators.matrices[0].diagonal()[found.covered] < 0.0).sum())
    assert negative > 0
