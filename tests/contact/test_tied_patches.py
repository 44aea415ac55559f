# SPDX-License-Identifier: MIT
"""Tied pairs: patch tests, rigid motions, balance, tangent, rings of two materials."""

import numpy as np
import pytest
from scenes import linear_elastic, pair_options, rotation
from tied_scenes import AROUND, ENDS, EXACT, ROLES, STRAIN, blocks, linear, off, ring_data, tied

import ufl

import fenics_mortar as fm
from fenics_mortar.energies import lame


@pytest.mark.once
@pytest.mark.parametrize(
    "angle, counts", [(0, (4, 4)), (0, (2, 34)), (30, (3, 10)), (90, (4, 4)), (90, (2, 34))]
)
@pytest.mark.parametrize("degree", [1, 2])
def test_a_homogeneous_finite_strain_passes_any_interface(degree, angle, counts):
    """All sides prescribed, so that the ends of the slave hand their functions over."""
    gradient = rotation(0.7) @ STRAIN - np.eye(2)
    for roles, cell in zip(ROLES, ("triangle", "quadrilateral"), strict=True):
        data = blocks(counts, cell=cell, rotation=np.radians(angle), inclination=0.2)
        problem, exact = tied(data, [fm.TiedPair(data, *roles)], AROUND, gradient, degree=degree)
        assert problem.solve().certificate.violations() == []
        assert off(problem, exact) < EXACT


@pytest.mark.each
@pytest.mark.parametrize(
    "basis, counts",
    [
        ("dual", (4, 4)),
        ("dual", (1, 17)),
        ("standard", (3, 10)),
        ("standard", (1, 17)),
        ("vertices", (3, 10)),
        ("linear", (1, 17)),
    ],
)
@pytest.mark.parametrize("degree", [1, 2])
def test_uniaxial_tension_passes_with_its_traction(degree, counts, basis):
    """Free sides; linear elastic with nu = 0: the traction is E times the strain."""
    for roles in ROLES:
        data = blocks(counts)
        pair = fm.TiedPair(data, *roles, **pair_options(basis=basis))
        problem, exact = tied(data, [pair], ENDS, np.diag([0.0, 0.01]), degree=degree, law=linear)
        problem.solve()
        assert off(problem, exact) < EXACT
        assert np.abs(problem.equations.contacts[0].pressure + 1.0).max() < 1e-11

    # Exact properties
    assert problem.estimate().relative < 1e-9  # the estimate of an exact solution vanishes


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("sides", [("inner/bottom", "outer/top"), ("outer/top", "inner/bottom")])
@pytest.mark.parametrize("degree", [1, 2])
def test_rotated_rings_are_stress_free(degree, sides, algorithm):
    """The gap of some 1e-2 or 1e-4 between the facets is removed: rigid motions are solutions."""
    turn, data = rotation(0.8) - np.eye(2), ring_data(degree)
    pair = fm.TiedPair(data, *sides)
    problem, exact = tied(data, [pair], ["outer/bottom"], turn, degree=degree, algorithm=algorithm)
    exact.interpolate(lambda X: turn @ X[:2])  # nodes have moved
    problem.solve()
    tie = problem.equations.contacts[0]
    assert np.abs(tie.D @ tie.slave.X - tie.M @ tie.master.X).max() < 1e-14
    assert np.abs(np.hypot(*tie.slave.X.T) - 2.0).max() > (1e-3 if degree == 1 else 1e-5)
    assert off(problem, exact) < EXACT and np.abs(tie.z).max() < 1e-10 * 100.0
    exact.interpolate(lambda X: turn @ X[:2] + 0.02 * X[:2] ** 2)
    problem.solve()
    assert np.abs(tie.z).max() > 0.1
    certificate = problem.certificate().pairs[0]
    assert certificate["moment"].value < 1e-14 and certificate["force"].value < 1e-14
    assert certificate["tie_distance"].value < 1e-13


def test_tied_gap_does_not_rotate_with_the_bodies():
    """A gap that is kept has a fixed direction: a rotation strains the bodies; a torque results."""
    data, turn = ring_data(1), rotation(0.8) - np.eye(2)
    pair = fm.TiedPair(data, "inner/bottom", "outer/top", gap="kept")
    problem, exact = tied(data, [pair], ["outer/bottom"], turn)
    problem.solve()
    assert np.abs(np.hypot(*problem.equations.contacts[0].slave.X.T) - 2.0).max() < 1e-14
    assert off(problem, exact) > 1e-3
    assert problem.certificate().pairs[0]["moment"].value > 1e-4


@pytest.mark.parametrize("basis", ["dual", "standard"])
@pytest.mark.parametrize("degree", [1, 2])
def test_tangent_has_second_order_remainder_and_newton_is_quadratic(degree, basis):
    data = blocks((6, 5), rotation=0.4, width_lower=1.3)
    pair = fm.TiedPair(data, *ROLES[0], **pair_options(basis=basis))
    shear = np.array([[0.0, 0.2], [0.0, 0.1]])
    problem, _ = tied(data, [pair], ENDS, shear, degree=degree, start=0.0)
    report = problem.solve()
    r = np.array(report.residuals) / report.force
    k = int(np.argmax(r < 1e-4))
    assert r[k] < 1e-4 and r[k + 1] < max(100 * r[k] ** 2, 1e-12)
    check = problem.check_tangent(print_table=False)
    assert min(check.slopes.values()) > 1.95, check.table()


@pytest.mark.parametrize("roles", ROLES)
@pytest.mark.parametrize("degree", [1, 2])
def test_forces_balance_where_facets_have_no_partner_in_part(degree, roles):
    """The upper block protrudes at both sides, by parts of facets."""
    data = blocks((7, 5), width_upper=1.33, width_lower=1.2)
    shear = np.array([[0.0, 0.3], [0.0, 0.2]])
    problem, _ = tied(data, [fm.TiedPair(data, *roles)], ENDS, shear, degree=degree, start=0.0)
    report = problem.solve()
    certificate = report.certificate.pairs[0]
    assert report.certificate.violations() == []
    assert certificate["force"].value < 1e-14 and certificate["moment"].value < 1e-14
    assert certificate["tie_distance"].value < 1e-13
    tie = problem.equations.contacts[0]
    assert np.abs(tie.D.sum(axis=1) - tie.M.sum(axis=1)).max() < 1e-15


@pytest.mark.serial
def test_two_rings_of_different_materials_have_lames_displacement():
    """u = A r + B / r in each ring; displacement and pressure are equal where they meet."""
    (a, b, c), E = (1.0, 2.0, 3.0), {"inner": 100.0, "outer": 300.0}
    (mu, lmbda), (mu2, lmbda2) = (lame(e, 0.3) for e in E.values())
    rows = [[a, 1 / a, 0, 0], [b, 1 / b, -b, -1 / b], [0, 0, c, 1 / c]]
    stress = [2 * (mu + lmbda), -2 * mu / b**2, -2 * (mu2 + lmbda2), 2 * mu2 / b**2]
    A, B, A2, B2 = np.linalg.solve([*rows, stress], [0.0, 0.0, 0.01, 0.0])
    pressure = -(2 * (mu + lmbda) * A - 2 * mu * B / b**2)
    data = ring_data(2)

    def law(u):
        dx = ufl.Measure("dx", subdomain_data=data.cell_tags, metadata={"quadrature_degree": 4})
        v = ufl.grad(ufl.TestFunction(u.function_space))
        parts = ((linear_elastic(u, e, 0.3), data.body_tag(name)) for name, e in E.items())
        return sum(ufl.inner(stress, v) * dx(tag) for stress, tag in parts)

    pair, none = fm.TiedPair(data, "inner/bottom", "outer/top"), np.zeros((2, 2))
    problem, exact = tied(data, [pair], ["inner/top", "outer/bottom"], none, degree=2, law=law)
    X = exact.function_space.tabulate_dof_coordinates()[:, :2]
    r = np.hypot(*X.T)[:, None]
    exact.x.array[:] = (np.where(r < b, A * r + B / r, A2 * r + B2 / r) * X / r).ravel()
    problem.solve()
    # 12 quadratic facets: about (pi / 12)^4 / 10 in the displacement, (pi / 12)^3 in the pressure
    assert off(problem, exact) < 1e-3 * 0.01
    assert np.abs(problem.equations.contacts[0].pressure / pressure - 1).max() < 0.02
