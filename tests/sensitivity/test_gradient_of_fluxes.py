# SPDX-License-Identifier: MIT
"""Gradients through conduction across contact."""

import pytest
from heat_scenes import stacked

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import sensitivity

MIXED = [fm.PressureConductance(3.0, 5.0), fm.GapConductance(0.2, 0.1)]
START = {"conductivity": 5.0, "scale": 1.3, "hot": 20.0, "top": -0.03}


def solved(values, **options):
    """Two bars, the upper one pushed and heated, and an objective of both fields."""
    scene = stacked((5, 7), degrees=(2, 1), overhang=0.4)
    heat = fm.Conductance(1, MIXED, **options)
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[heat])
    problem = scene.problem([pair], newton=fm.NewtonOptions(residual_tolerance=1e-13))
    heat.scale = values["scale"]
    scene.set(**{name: value for name, value in values.items() if name != "scale"})
    problem.solve()
    u, T = ufl.split(scene.w)
    return scene, problem, (T**2 + 100.0 * ufl.inner(u, u)) * ufl.dx(degree=4)


def value(values):
    """The objective."""
    scene, _, form = solved(values)
    return scene.data.mesh.comm.allreduce(fem.assemble_scalar(fem.form(form)))


def test_gradient_by_conductivity_and_conductance():
    """Adjoint gradients against central differences of whole solves, and the other direction."""
    scene, problem, form = solved(START)
    controls = [
        scene.given[n] if n != "scale" else sensitivity.ConductanceScale(0, 1) for n in START
    ]
    found = fm.gradient(form, controls, problem)
    for name, control in zip(START, controls, strict=True):
        step = 1e-4 * abs(START[name])
        ends = [value({**START, name: START[name] + sign * step}) for sign in (1.0, -1.0)]
        expected = (ends[0] - ends[1]) / (2.0 * step)
        assert float(found[control]) == pytest.approx(expected, rel=1e-6)
        along = sensitivity.tangent_linear(form, control, 1.0, problem)
        assert along.derivative == pytest.approx(float(found[control]), rel=1e-10)


def test_what_has_no_derivative_is_refused():
    _, problem, form = solved(START)
    with pytest.raises(fm.MortarError, match="fluxes across .* have no derivative"):
        fm.gradient(form, sensitivity.Offset(0), problem)
    with pytest.raises(ValueError, match="no such conductance"):
        fm.gradient(form, sensitivity.ConductanceScale(0, 2), problem)
    _, problem, form = solved(START, heating="friction")
    with pytest.raises(fm.MortarError, match="heating='friction' has no derivatives"):
        fm.gradient(form, sensitivity.ConductanceScale(0, 1), problem)
