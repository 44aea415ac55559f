# SPDX-License-Identifier: MIT
"""Energies of ``fm.energies``: small strains, reference, rotations, dimensions, closed forms."""

from mpi4py import MPI

import numpy as np
import pytest

import ufl
from dolfinx import fem, mesh
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives

import fenics_mortar as fm
from fenics_mortar import energies

E, NU = 100.0, 0.3
MU, LMBDA = energies.lame(E, NU)
C_1, C_2 = 0.3 * MU, 0.2 * MU
LAWS = {
    "neo-Hooke": lambda F: energies.neo_hookean(F, MU, LMBDA),
    "St. Venant": lambda F: energies.st_venant_kirchhoff(F, MU, LMBDA),
    "Mooney": lambda F: energies.mooney_rivlin(F, C_1, C_2, LMBDA + 2 * MU / 3),
    # its pressure by the equation of the pressure
    "mixed": lambda F: energies.mixed_neo_hookean(F, LMBDA * (ufl.det(F) - 1), MU, 1 / LMBDA),
}
finite = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
dimensions = pytest.mark.parametrize("dim", [2, 3])


def number(expression):
    """Value of an expression of numbers."""
    return float(apply_algebra_lowering(apply_derivatives(apply_algebra_lowering(expression)))(()))


def energy(law, F):
    return number(law(ufl.as_matrix(F.tolist())))


def stress(law, F):
    P = energies.stress(law, ufl.as_matrix(F.tolist()))
    return np.array([[number(P[i, j]) for j in range(len(F))] for i in range(len(F))])


def some(dim, seed=0):
    """A displacement gradient with stretch, shear and rotation."""
    return np.random.default_rng(seed).uniform(-0.3, 0.3, (dim, dim))


def rotation(dim):
    Q = np.linalg.qr(some(dim, 1))[0]
    Q[:, 0] *= np.linalg.det(Q)
    return Q


def test_lame_parameters_give_young_modulus_and_poisson_ratio():
    tension = np.diag([1.0, -NU, -NU])
    found = stress(lambda e: energies.linear_elastic(e, MU, LMBDA), tension)
    assert np.abs(found - np.diag([E, 0.0, 0.0])).max() < 1e-12 * E


@finite
@dimensions
def test_small_strains_are_linear_elastic(law, dim):
    """The difference of the energies is of third order in the displacement."""
    H, differences = some(dim), []
    for t in (4e-3, 2e-3, 1e-3):
        exact = energy(lambda e: energies.linear_elastic(e, MU, LMBDA), t * (H + H.T) / 2)
        differences.append(abs(energy(law, np.eye(dim) + t * H) - exact))
    slopes = np.log2(np.array(differences[:-1]) / differences[1:])
    assert np.abs(slopes - 3.0).max() < 0.1


@finite
@dimensions
def test_reference_has_no_energy_and_no_stress(law, dim):
    assert abs(energy(law, np.eye(dim))) < 1e-12 * E
    assert np.abs(stress(law, np.eye(dim))).max() < 1e-12 * E


@finite
@dimensions
def test_rotations_change_no_energy_and_turn_the_stress(law, dim):
    F, Q = np.eye(dim) + some(dim), rotation(dim)
    assert np.abs(Q - np.eye(dim)).max() > 0.5
    assert energy(law, Q @ F) == pytest.approx(energy(law, F), rel=1e-12)
    assert np.abs(stress(law, Q @ F) - Q @ stress(law, F)).max() < 1e-12 * E


@finite
def test_plane_strain_has_no_stretch_out_of_the_plane(law):
    F, in_space = np.eye(2) + some(2), np.eye(3)
    in_space[:2, :2] = F
    assert energy(law, F) == pytest.approx(energy(law, in_space), rel=1e-13)
    assert np.abs(stress(law, F) - stress(law, in_space)[:2, :2]).max() < 1e-12 * E


@dimensions
def test_stress_of_the_neo_hookean_law(dim):
    F = np.eye(dim) + some(dim)
    inverse = np.linalg.inv(F).T
    exact = MU * (F - inverse) + LMBDA * np.log(np.linalg.det(F)) * inverse
    assert np.abs(stress(LAWS["neo-Hooke"], F) - exact).max() < 1e-12 * E


def test_stress_of_the_st_venant_kirchhoff_law():
    F = np.eye(3) + some(3)
    G = (F.T @ F - np.eye(3)) / 2
    exact = F @ (2 * MU * G + LMBDA * np.trace(G) * np.eye(3))
    assert np.abs(stress(LAWS["St. Venant"], F) - exact).max() < 1e-12 * E


@pytest.mark.parametrize("stretch", [0.5, 2.0])
def test_tension_of_an_incompressible_mooney_rivlin_bar(stretch):
    """Rivlin: 2 (c_1 + c_2 / s) (s^2 - 1 / s)."""
    F = np.diag([stretch, stretch**-0.5, stretch**-0.5])
    cauchy = stress(LAWS["Mooney"], F) @ F.T
    exact = 2 * (C_1 + C_2 / stretch) * (stretch**2 - 1 / stretch)
    assert cauchy[0, 0] - cauchy[1, 1] == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("compliance", [0.0, 0.1])
def test_mixed_energies_enforce_the_change_of_volume(compliance):
    """Derivatives by the pressure."""
    H, p = some(2), ufl.variable(ufl.as_ufl(3.0))
    F, e = ufl.as_matrix((np.eye(2) + H).tolist()), ufl.as_matrix(((H + H.T) / 2).tolist())
    found = number(ufl.diff(energies.mixed_neo_hookean(F, p, MU, compliance), p))
    assert found == pytest.approx(np.linalg.det(np.eye(2) + H) - 1 - 3.0 * compliance, rel=1e-12)
    found = number(ufl.diff(energies.mixed_linear_elastic(e, p, MU, compliance), p))
    assert found == pytest.approx(np.trace(H) - 3.0 * compliance, rel=1e-12)


def test_mixed_linear_energy_with_its_pressure_is_that_of_the_displacement():
    H = some(3)
    e, p = (H + H.T) / 2, ufl.as_ufl(LMBDA * np.trace(H))
    mixed = energy(lambda e: energies.mixed_linear_elastic(e, p, MU, 1 / LMBDA), e)
    exact = energy(lambda e: energies.linear_elastic(e, MU, LMBDA), e)
    assert mixed == pytest.approx(exact, rel=1e-12)


# On meshes


def rectangle():
    """Radii from 1 to 2, height 1."""
    domain = mesh.create_rectangle(MPI.COMM_WORLD, [(1.0, 0.0), (2.0, 1.0)], (3, 3))
    return fem.Function(fm.vector_space(domain, 2))


def total(density, degree=4):
    form = fem.form(density * ufl.dx(metadata={"quadrature_degree": degree}))
    return MPI.COMM_WORLD.allreduce(fem.assemble_scalar(form))


def test_displacement_stands_for_its_gradient():
    u, H = rectangle(), some(2)
    u.interpolate(lambda x: H @ x[:2])
    assert total(LAWS["neo-Hooke"](u)) == pytest.approx(energy(LAWS["neo-Hooke"], np.eye(2) + H))
    linear = energy(lambda e: energies.linear_elastic(e, MU, LMBDA), (H + H.T) / 2)
    assert total(energies.linear_elastic(u, MU, LMBDA)) == pytest.approx(linear, rel=1e-12)


def test_body_of_revolution_is_stretched_around_the_axis():
    """Radial stretch 1.2, axial 0.9: the volume is 3 pi."""
    u, stretches = rectangle(), np.array([1.2, 0.9])
    u.interpolate(lambda x: (stretches - 1)[:, None] * x[:2])
    width = 2 * np.pi * ufl.SpatialCoordinate(u.function_space.mesh)[0]
    F = energies.deformation_gradient(u, "axisymmetric")
    exact = 3 * np.pi * energy(LAWS["neo-Hooke"], np.diag([1.2, 0.9, 1.2]))
    assert total(width * LAWS["neo-Hooke"](F)) == pytest.approx(exact, rel=1e-12)
    strain = energies.strain(u, "axisymmetric")
    linear = energy(lambda e: energies.linear_elastic(e, MU, LMBDA), np.diag([0.2, -0.1, 0.2]))
    found = total(width * energies.linear_elastic(strain, MU, LMBDA))
    assert found == pytest.approx(3 * np.pi * linear, rel=1e-12)


def test_virtual_work_of_a_stress_is_the_derivative_of_the_energy():
    u = rectangle()
    v, width = ufl.TestFunction(u.function_space), ufl.SpatialCoordinate(u.function_space.mesh)[0]
    u.interpolate(lambda x: (0.1 * x[0] * x[1], 0.2 * x[0] ** 2))
    F = energies.deformation_gradient(u, "axisymmetric")
    P = energies.stress(energies.neo_hookean, F, MU, LMBDA)
    work = width * ufl.inner(P, energies.displacement_gradient(v, "axisymmetric"))
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    residual = ufl.derivative(width * energies.neo_hookean(F, MU, LMBDA) * dx, u, v)
    found, exact = (
        fem.petsc.assemble_vector(fem.form(form)).array for form in (work * dx, residual)
    )
    assert np.abs(exact).max() > 1.0
    assert np.abs(found - exact).max() < 1e-12 * np.abs(exact).max()


def test_another_geometry_is_refused():
    with pytest.raises(ValueError, match="geometry='spherical': expected one of plane, axisymm"):
        energies.strain(rectangle(), "spherical")
