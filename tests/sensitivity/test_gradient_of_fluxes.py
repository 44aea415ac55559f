# SPDX-License-Identifier: MIT
"""Gradients through conduction across contact."""

import numpy as np
import pytest
from heat_scenes import heated, stacked

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import sensitivity
from meshes.mapped_grids import Grid, block

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


@pytest.mark.once
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


@pytest.mark.serial
def test_constants_that_pairs_read_are_refused_also_where_the_objective_has_them():
    """Their derivative would be that of the objective alone."""
    scene = stacked((3, 3))
    jump = fem.Constant(scene.data.mesh, (0.0, 0.01))
    problem = scene.problem([fm.TiedPair(scene.data, "upper/bottom", "lower/top", jump=jump)])
    problem.solve()
    u, _ = ufl.split(scene.w)
    with pytest.raises(ValueError, match="is jump of TiedPair"):
        fm.gradient(ufl.dot(u, jump) * ufl.dx(degree=2), jump, problem)
    scene = heated([Grid("body", block(3, 3, width=1.0, height=1.0))])
    scene.prescribe("bottom", "body/bottom", 0, 1)
    scene.prescribe("side", "body/left", 0, 0)
    scene.prescribe("cold", "body/bottom", 1)
    tool, hot = fm.Plane((0.0, 0.99), (0.0, -1.0)), fem.Constant(scene.data.mesh, 5.0)
    heat = fm.Conductance(1, 2.0, temperature=hot)
    problem = scene.problem([fm.ContactPair(scene.data, "body/top", tool, fluxes=[heat])])
    problem.solve()
    _, T = ufl.split(scene.w)
    with pytest.raises(ValueError, match="is temperature of ContactPair"):
        fm.gradient(hot * T * ufl.dx(degree=2), hot, problem)


def with_large_conductance(h, resistance=1.0, degrees=(1, 1), **options):
    """Two bars whose conductance exceeds that of their cells, and an objective."""
    scene = stacked((5, 7), degrees=degrees, **options)
    heat = fm.Conductance(1, h)
    heat.scale = 1.0 / resistance
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[heat])
    problem = scene.problem([pair], newton=fm.NewtonOptions(residual_tolerance=1e-13))
    scene.set(top=-0.03, hot=10.0)
    problem.solve()
    return scene, problem, ufl.split(scene.w)[1] ** 2 * ufl.dx(degree=4)


@pytest.mark.parametrize("h", [3e4, 1e5, 1e6, 1e7, np.inf])
def test_solution_of_the_tangent_with_a_large_conductance(h):
    """The solution is linear in the temperature of the heated end."""
    scene, problem, _ = with_large_conductance(h, nu=0.0, alpha=0.0)
    bulk = problem.equations.bulk
    before, ends = scene.w.x.array[: bulk.num_owned].copy(), bulk.prescribed_dofs
    rhs = np.zeros(bulk.num_owned)
    rhs[ends[np.abs(before[ends] - 10.0) < 1e-9]] = 1.0
    found = problem.linear_solve(fm.LinearVector(u=rhs)).u
    scene.set(hot=11.0)
    problem.solve()
    change = scene.w.x.array[: bulk.num_owned] - before
    assert found == pytest.approx(change, rel=1e-10, abs=1e-10)


@pytest.mark.parametrize("h", [3e4, 1e5, 1e6, 1e7, np.inf])
def test_transposed_solution_with_a_large_conductance(h):
    scene, problem, _ = with_large_conductance(h, degrees=(2, 1), overhang=0.4)
    comm, count = scene.data.mesh.comm, problem.equations.bulk.num_owned
    shape, random = problem.equations.contacts[0].z.shape, np.random.default_rng(3)
    z = random.standard_normal((2, *shape))  # equal on all ranks
    one, other = (fm.LinearVector(u=random.standard_normal(count), z=[part]) for part in z)
    forward, transposed = problem.linear_solve(one), problem.linear_solve(other, transpose=True)
    assert forward.dot(other, comm) == pytest.approx(transposed.dot(one, comm), rel=1e-10)


@pytest.mark.parametrize("h", [1e5, 1e6, 1e7, 1e9])
def test_gradient_by_a_large_conductance(h):
    """Against a central difference in the resistance, in which the objective is nearly linear."""
    scene, problem, form = with_large_conductance(h, nu=0.0, alpha=0.0)
    control = sensitivity.ConductanceScale(0, 1)
    found = float(fm.gradient(form, control, problem)[control])
    ends = []
    for resistance in (0.8, 1.2):
        _, _, of_end = with_large_conductance(h, resistance, nu=0.0, alpha=0.0)
        ends.append(scene.data.mesh.comm.allreduce(fem.assemble_scalar(fem.form(of_end))))
    assert found == pytest.approx((ends[0] - ends[1]) / 0.4, rel=1e-6, abs=1e-11)
    along = sensitivity.tangent_linear(form, control, 1.0, problem)
    assert along.derivative == pytest.approx(found, rel=1e-10, abs=1e-13)
