# SPDX-License-Identifier: MIT
"""Derivatives of solutions against closed forms: press fit by interference, wedge by friction."""

import numpy as np
import pytest
import revolved
from friction_scenes import block_on
from test_axisymmetric import INTERFERENCE, lame_pressure, press_fit

import fenics_mortar as fm
from fenics_mortar.sensitivity.controls import Interference, LawParameter
from fenics_mortar.sensitivity.protocols import PressureIntegral, TotalForce


@pytest.mark.serial
def test_press_fit_by_interference():
    """Lame: the pressure is proportional to the interference, dp/dD = p / D."""
    problem = press_fit(16, revolved.linear_elastic, sliding="small")
    view, gap = problem.contacts[0], Interference(0)
    area = problem.equations.contacts[0].operators.weight.sum()
    gradient = fm.gradient(PressureIntegral(0), gap, problem)
    by_gap = float(gradient[gap]) / area
    assert by_gap == pytest.approx(view.pressure.mean() / INTERFERENCE, rel=1e-9)
    assert by_gap == pytest.approx(lame_pressure() / INTERFERENCE, rel=1e-6)


@pytest.mark.once
def test_wedge_by_friction():
    """H = W (tan a + mu) / (1 - mu tan a): dH/dmu = W (1 + tan^2 a) / (1 - mu tan a)^2."""
    angle, mu, weight = 0.2, 0.3, 4.0
    plane = fm.Plane((0.0, 0.0), (-np.sin(angle), np.cos(angle)))
    problem, along = block_on(plane, law=fm.Coulomb(mu), angle=angle, weight=weight)
    path = fm.sensitivity.RecordedPath(problem)
    for shift in (0.05, 0.1):
        along.value = shift
        problem.solve()
        path.record()
    friction, slope, W = LawParameter(0, "mu"), np.tan(angle), 0.5 * weight
    exact = W * (1.0 + slope**2) / (1.0 - mu * slope) ** 2
    for solved in (path, problem):
        gradient = fm.gradient(TotalForce(0, (-1.0, 0.0)), friction, solved)
        assert float(gradient[friction]) == pytest.approx(exact, rel=1e-8)
