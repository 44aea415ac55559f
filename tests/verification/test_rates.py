# SPDX-License-Identifier: MIT
"""Rates of convergence to exact solutions, within 0.15 of theory."""

from functools import partial

import numpy as np
import pytest

from demos.studies.accuracy import carter, cylinders
from demos.studies.accuracy.cattaneo import half_planes
from demos.studies.accuracy.exact_flat import FlatInterface
from demos.studies.accuracy.exact_hertz import HalfPlanes
from demos.studies.accuracy.exact_rings import PressFit, linear
from demos.studies.accuracy.norms import errors
from demos.studies.accuracy.posed import ELEMENTS, Choice
from demos.studies.accuracy.scenes_exact import curved, flat, hertz, press_fit
from fenics_mortar.energies import lame

pytestmark = pytest.mark.serial
slides = partial(flat, friction=0.3)


def rates(scene, element, sizes, basis="dual"):
    """Rate of each error from the first mesh to the second."""
    found = []
    for n in sizes:
        posed = scene(n, Choice(element, basis))
        posed.problem.solve()
        found.append(errors(posed))
    factor = np.log(sizes[1] / sizes[0])
    with np.errstate(divide="ignore", invalid="ignore"):  # the half-width may be exact by chance
        ratios = {name: np.divide(found[0][name], found[1][name]) for name in found[0]}
        return {name: np.log(ratio) / factor for name, ratio in ratios.items()}


@pytest.mark.once
@pytest.mark.parametrize(
    "scene, element",
    [
        (flat, "P1"),
        (flat, "Q2"),
        (slides, "Q1"),
        (slides, "P2"),
        (curved, "P1"),
        (curved, "P2"),
    ],
)
def test_smooth_solutions_have_full_rates(scene, element):
    degree = ELEMENTS[element][1]
    found = rates(scene, element, (12, 24))
    assert found["energy"] == pytest.approx(degree, abs=0.15)
    assert found["displacement"] == pytest.approx(degree + 1, abs=0.15)


@pytest.mark.once
@pytest.mark.parametrize("element", ["P1", "Q2"])
def test_press_fit_on_a_curved_interface_has_full_rates_of_energy(element):
    degree = ELEMENTS[element][1]
    found = rates(press_fit, element, (96 // degree, 192 // degree))
    assert found["energy"] == pytest.approx(degree, abs=0.15)


@pytest.mark.once
@pytest.mark.parametrize(
    "element, basis, rate", [("Q1", "dual", 1.0), ("P2", "dual", 1.5), ("Q2", "vertices", 1.5)]
)
def test_hertz_has_the_rates_that_the_ends_of_the_contact_allow(element, basis, rate):
    """Over two halvings, after which the ends have the same position in a facet again.

    The solution is smooth except for r^(3/2) at the ends of the contact.
    """
    found = rates(hertz, element, (32, 128), basis)
    assert found["energy"] == pytest.approx(rate, abs=0.15)
    assert found["pressure"] == pytest.approx(1.0, abs=0.15)
    assert found["pressure max"] == pytest.approx(0.5, abs=0.15)


@pytest.mark.once
@pytest.mark.parametrize("element, rate, most", [("P1", 1.39, 0.034), ("P2", 1.72, 0.015)])
def test_shear_agrees_with_cattaneo_and_mindlin(element, rate, most):
    """Meshes graded towards the ends of contact and stick; results as in ``cattaneo.py``."""
    coarse, fine = (half_planes(n, element, graded=True)[0] for n in (32, 64))
    assert fine < most
    assert np.log2(coarse / fine) == pytest.approx(rate, abs=0.15)


@pytest.mark.once
def test_wheel_rolls_by_carters_theory():
    """Within the error at four facets per half-width: 1 / 8 of it between nodes."""
    found = carter.roll(4, size=200.0)
    assert found.pulls[-1] == pytest.approx(carter.PART, rel=0.01)
    assert found.creepage == pytest.approx(1.0, abs=0.05)
    assert found.stuck == pytest.approx(1.0, abs=0.125 / np.sqrt(1 - carter.PART))
    assert found.error < 0.1
    assert max(found.iterations) <= 6


@pytest.mark.once
@pytest.mark.parametrize("degree, h", [(1, 0.05), (2, 0.1)])
def test_cylinder_on_cylinder_agrees_with_hertz(degree, h):
    """Within the error of the theory, (a / R)^2 = 0.7 %; force within Newton's tolerance."""
    assert cylinders.HALF_WIDTH == pytest.approx(0.680778, abs=1e-6)
    assert cylinders.PEAK == pytest.approx(9.351351, abs=1e-6)
    problem = cylinders.pose(h, degree)
    problem.solve()
    found = cylinders.compare(problem)
    assert found["force"] == pytest.approx(1.0, abs=1e-6)
    assert found["half-width"] == pytest.approx(1.0, abs=0.01)
    assert found["peak"] == pytest.approx(1.0, abs=0.01)


def test_small_press_fit_agrees_with_lame():
    """Lame's formula for radii 1, 2, 3, E = 1, nu = 0.3; its error is of order interference / b."""
    a, b, c, nu, interference = 1.0, 2.0, 3.0, 0.3, 1e-5
    inner = ((1 - 2 * nu) * b**2 + a**2) / (b**2 - a**2)
    outer = ((1 - 2 * nu) * b**2 + c**2) / (c**2 - b**2)
    lame = interference / (b * (1 + nu) * (inner + outer))
    for law in (linear, PressFit.law):
        found = PressFit(law=law, interference=interference).contact_pressure
        assert found == pytest.approx(lame, rel=3 * interference / b)


@pytest.mark.parametrize("shear", [{}, {"friction": 0.3, "stuck": 0.2}])
def test_potentials_of_hertz_agree_with_the_displacement(shear):
    """Hooke's law of central differences; their error is about the step squared, 1e-10."""
    exact, step = HalfPlanes(R=4.0, **shear), 1e-5
    x = np.random.default_rng(0).uniform(-2, 2, (2, 50))
    gradient = np.stack(
        [
            (exact.displacement(x + h) - exact.displacement(x - h)) / (2 * step)
            for h in step * np.eye(2)[:, :, None]
        ],
        axis=1,
    )
    strain = (gradient + gradient.transpose(1, 0, 2)) / 2
    lmbda = 2 * exact.mu * exact.nu / (1 - 2 * exact.nu)
    stress = 2 * exact.mu * strain + lmbda * np.trace(strain) * np.eye(2)[:, :, None]
    assert np.abs(stress - exact.stress(x)).max() < 1e-7 * np.abs(stress).max()
    x = np.stack([np.linspace(-0.6, 0.6, 30), np.full(30, -1e-12)])
    for side in (x, -x):
        shear, pressure = exact.stress(side)[:, 1]
        assert np.abs(shear - exact.shear(side[0])).max() < 1e-5 * exact.peak
        assert np.abs(pressure + exact.pressure(side[0])).max() < 1e-5 * exact.peak


def test_parts_of_the_flat_interface_meet_with_one_pressure_and_shear():
    """Cauchy's stress by the law from the gradient on both sides, to rounding."""
    exact = FlatInterface(friction=0.3, slid=0.5, stretches=(0.05, 0.2))
    mu, lmbda = lame(exact.E, exact.nu)
    X = np.stack([np.linspace(0.0, 1.0, 30), np.zeros(30)])
    for upper in (np.zeros(30, bool), np.ones(30, bool)):
        x = X - np.stack([exact.slid * upper, np.zeros(30)])
        meets = X + exact.displacement(X, np.zeros(30, bool))
        assert np.abs(x + exact.displacement(x, upper) - meets).max() < 1e-14
        F = np.eye(2) + np.moveaxis(exact.gradient(x, upper), -1, 0)
        J = np.linalg.det(F)[:, None, None]
        stress = (mu * (F @ F.swapaxes(1, 2) - np.eye(2)) + lmbda * np.log(J) * np.eye(2)) / J
        assert -stress[:, 1, 1] == pytest.approx(exact.pressure(X[0]), rel=1e-13)
        assert stress[:, 0, 1] == pytest.approx(0.3 * exact.pressure(X[0]), rel=1e-13)
