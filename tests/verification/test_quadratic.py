# SPDX-License-Identifier: MIT
"""Displacements of degree 2: what they pass exactly, on straight and on curved cells."""

from itertools import product

import numpy as np
import pytest
from scenes import homogeneous_blocks, lame, linear_elastic, neo_hookean, rotation
from test_patch import CELLS, EXACT, NU, SLAVES, STRETCH, E, assert_uniform, blocks, uniaxial

RATIOS = [(4, 4), (5, 7), (3, 10), (1, 17)]
BASES = ["dual", "standard"]


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("material", [neo_hookean, linear_elastic])
@pytest.mark.parametrize("angle", [0, 30])
def test_uniaxial_pressure_is_uniform(material, angle, basis):
    a, pressure = uniaxial(material)
    turn = rotation(np.radians(angle))
    gradient = turn @ np.diag([a - 1, STRETCH - 1]) @ turn.T
    for counts, slave, cell in product(RATIOS, SLAVES, CELLS):
        scene = homogeneous_blocks(
            gradient,
            ["lower/bottom", "upper/top"],
            material=material,
            slave=slave,
            cell=cell,
            degree=2,
            pair={"basis": basis},
            **blocks(counts, angle),
        )
        scene.problem.solve()
        assert_uniform(scene, pressure)


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("angle", [0, 30])
def test_all_round_pressure_passes_an_inclined_interface(angle, basis):
    """The end nodes are prescribed and hand their functions to the nodes inside their facets."""
    mu, lmbda = lame(E, NU)
    a = 0.95
    pressure = -(mu * (a - 1 / a) + 2 * lmbda * np.log(a) / a) / a
    boundaries = [f"{body}/{side}" for body in SLAVES for side in ("left", "right")]
    for counts, slave, cell in product(RATIOS, SLAVES, CELLS):
        scene = homogeneous_blocks(
            (a - 1) * np.eye(2),
            [*boundaries, "lower/bottom", "upper/top"],
            slave=slave,
            cell=cell,
            degree=2,
            pair={"basis": basis},
            inclination=np.radians(15),
            **blocks(counts, angle),
        )
        scene.problem.solve()
        assert_uniform(scene, pressure)


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("angle", [0, 30])
def test_linear_pressure_passes_a_flat_interface(angle, basis):
    """Bending and compression without Poisson's effect: exact for quadratic displacements.

    With s along the interface and h above it, u_h = -(e + c s) h, u_s = c h^2 / 2: sigma_hh =
    -E (e + c s), no other stress, and the interface does not move. The dual functions pass it since
    they integrate a linear pressure against a shape function to its value at the node.
    """
    e, c = 0.02, 0.015
    turn = rotation(np.radians(angle))

    def field(X):
        s, h = turn.T @ X[:2] - np.array([[0.0], [1.0]])
        return turn @ np.stack([c * h**2 / 2, -(e + c * s) * h])

    for counts, slave, cell in product(RATIOS[1:], SLAVES, CELLS):
        scene = homogeneous_blocks(
            np.zeros((2, 2)),
            ["lower/bottom", "upper/top"],
            material=linear_elastic,
            nu=0.0,
            slave=slave,
            cell=cell,
            degree=2,
            pair={"basis": basis},
            **blocks(counts, angle),
        )
        scene.loads["exact"].interpolate(field)
        scene.problem.solve()
        s = (scene.contact.slave.X @ turn)[:, 0]
        exact = E * (e + c * s)
        assert scene.contact.active.all()
        assert np.abs(scene.contact.pressure / exact - 1).max() < EXACT
        assert np.abs(scene.u.x.array - scene.loads["exact"].x.array).max() < 1e-12
