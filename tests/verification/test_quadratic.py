# SPDX-License-Identifier: MIT
"""Displacements of degree 2: exact patch tests on straight and curved cells."""

from itertools import product

import numpy as np
import pytest
from scenes import (
    homogeneous_blocks,
    internal,
    linear_elastic,
    neo_hookean,
    pair_options,
    pressed_blocks,
    read,
    rotation,
)
from scipy.optimize import brentq
from test_patch import (
    CELLS,
    EXACT,
    NU,
    SLAVES,
    STRETCH,
    E,
    assert_uniform,
    blocks,
    half_of,
    uniaxial,
)

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.energies import lame
from meshes import rings

RATIOS = [(5, 7), (3, 10), (1, 17)]
BASES = ["dual", "standard", "vertices", "linear"]
ANGLES = [30, pytest.param(0, marks=pytest.mark.serial)]


@pytest.mark.once
@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("material, angle", [(neo_hookean, 30), (linear_elastic, 0)])
def test_uniaxial_pressure_is_uniform(material, angle, basis):
    a, pressure = uniaxial(material)
    turn = rotation(np.radians(angle))
    gradient = turn @ np.diag([a - 1, STRETCH - 1]) @ turn.T
    for counts, slave, cell in half_of(
        RATIOS, SLAVES, CELLS, skip=BASES.index(basis) + (angle > 0)
    ):
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


@pytest.mark.once
@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("angle", ANGLES)
def test_all_round_pressure_passes_an_inclined_interface(angle, basis):
    """The end nodes are prescribed and hand their functions to the nodes inside their facets."""
    mu, lmbda = lame(E, NU)
    a = 0.95
    pressure = -(mu * (a - 1 / a) + 2 * lmbda * np.log(a) / a) / a
    boundaries = [f"{body}/{side}" for body in SLAVES for side in ("left", "right")]
    for counts, slave, cell in half_of(
        RATIOS, SLAVES, CELLS, skip=BASES.index(basis) + (angle > 0)
    ):
        if basis in ("vertices", "linear") and slave == "upper" and counts[0] == 1:
            continue  # both ends of the only facet are prescribed
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


@pytest.mark.once
@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("angle", ANGLES)
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

    for counts, slave, cell in half_of(
        RATIOS[1:], SLAVES, CELLS, skip=BASES.index(basis) + (angle > 0)
    ):
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
        assert scene.contact.active[scene.contact.multiplier_nodes].all()
        assert np.abs(scene.contact.pressure / exact - 1).max() < EXACT
        assert np.abs(scene.u.x.array - scene.loads["exact"].x.array).max() < 1e-12


@pytest.mark.parametrize("slave, cell", [*product(SLAVES, CELLS)])
def test_multipliers_at_vertices_can_be_condensed(slave, cell):
    """The lower block is wider: as the slave it has partly covered facets."""
    multipliers = []
    for algorithm in ("condensed", "saddle"):
        scene = pressed_blocks(
            slave=slave, degree=2, pair={"basis": "vertices"}, problem={"algorithm": algorithm},
            cell=cell, n_upper=7, n_lower=11, layers_upper=4, layers_lower=4,
        )  # fmt: skip
        scene.loads["push"].value[:] = (0.03, -0.06)
        report = scene.problem.solve()
        slave_side = scene.contact.slave
        assert not (scene.contact.active & slave_side.inner).any()
        assert np.abs(scene.contact.z[slave_side.inner]).max() == 0.0
        assert scene.contact.active.sum() >= 6
        assert not report.certificate.violations() and report.num_iterations <= 10
        slopes = scene.problem.check_tangent().slopes
        assert all(slope > 1.9 for slope in slopes.values()), slopes
        multipliers.append(scene.contact.z)
    condensed, saddle = multipliers
    assert np.abs(condensed - saddle).max() < 1e-9 * np.abs(saddle).max()


INNER, INTERFACE, OUTER, INTERFERENCE = 1.0, 2.0, 3.0, 0.02


def curved_rings(**options):
    """The rings with cells of order 2, whose inner nodes lie on the circles."""
    model = rings.build(interference=INTERFERENCE, **options)
    model.mesh.setOrder(2)
    return model


def press_fit(n, slave, cell, basis="dual"):
    """Two rings fixed at the inmost and the outmost circle, linear elastic, not yet solved."""
    options = {"n_inner": n, "n_outer": 4 * n // 3, "layers_inner": n // 6, "layers_outer": n // 6}
    data = read(curved_rings, cell=cell, **options)
    V = fm.vector_space(data.mesh, 2)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, name, np.zeros(2)) for name in ("inner/inside", "outer/outside")]
    sides = ["inner/outside", "outer/inside"]
    sides = sides if slave == "inner" else sides[::-1]
    pair = fm.ContactPair(data, *sides, **pair_options(basis=basis))
    residual = internal(u, linear_elastic(u, E, NU))
    return fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="fit_")


def press_fit_pressure():
    """Force over deformed length: u = A r + B / r, sigma = 2 (lambda + mu) A - 2 mu B / r^2."""
    mu, lmbda = lame(E, NU)
    radius = INTERFACE + INTERFERENCE

    def traction(R, r, u):
        A, B = np.linalg.solve([[R, 1 / R], [r, 1 / r]], [0.0, u])
        return 2 * (lmbda + mu) * A - 2 * mu * B / r**2

    def imbalance(u):
        outside = traction(OUTER, INTERFACE, INTERFERENCE + u) * INTERFACE
        return traction(INNER, radius, u) * radius - outside

    u = brentq(imbalance, -INTERFERENCE, 0.0, xtol=1e-16)
    return -traction(INNER, radius, u) * radius / (radius + u)


@pytest.mark.once
@pytest.mark.parametrize("slave, cell", [*product(("inner", "outer"), CELLS)])
def test_press_fit_of_curved_cells_converges_to_the_exact_pressure(slave, cell):
    """At least second order. With straight cells, corners carry all forces: no convergence."""
    exact, errors = press_fit_pressure(), []
    for n in (12, 24):
        problem = press_fit(n, slave, cell)
        problem.solve()
        (contact,) = problem.equations.contacts
        assert contact.active.all()
        errors.append(np.abs(contact.pressure / exact - 1).max())
    assert errors[1] < errors[0] / 4
    assert errors[1] < 0.02


@pytest.mark.once
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("basis", BASES)
def test_tangent_of_curved_cells_has_second_order_remainder(cell, basis):
    problem = press_fit(12, "outer", cell, basis)
    problem.solve()
    assert problem.certificate().pairs[0]["force"].value < 1e-14
    slopes = problem.check_tangent(print_table=False).slopes
    assert slopes.pop("bulk") == np.inf  # linear elastic: the remainder is rounding
    for name, slope in slopes.items():
        assert slope == pytest.approx(2.0, abs=0.05), name
