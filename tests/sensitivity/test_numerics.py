# SPDX-License-Identifier: MIT
"""Derivatives by the choices of the numerics: offsets by faceting, weights, residual left."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from refusal import refused
from scenes import internal, linear_elastic, read
from taylor_scenes import ROLL, SLIDE, blocks, obstacle_on_block

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.laws import Worn
from fenics_mortar.sensitivity import Numerics, TotalForce, by_numerics, total
from fenics_mortar.sensitivity.controls import NumericWeight
from fenics_mortar.sensitivity.numerics import (
    RemainingResidual,
    mean_bulges,
    offset_by_faceting,
)
from meshes import half_cylinder_on_block

FORCE = TotalForce(0, (1.0, 0.3))
RADIUS = 8.0


def cylinder(degree):
    """Half cylinder and block, not loaded."""
    shape = {"radius": RADIUS, "width": 24.0, "height": 12.0, "fine": 2.0, "growth": 0.3, "h": 0.5}
    data = read(half_cylinder_on_block.build, **shape)
    u = fem.Function(fm.vector_space(data.mesh, degree))
    return data, u


@pytest.mark.parametrize("law", [None, fm.Tresca(1.0), fm.Coulomb(0.3), Worn(0.3, 0.05)], ids=str)
def test_weights_have_no_effect(law):
    """Neither that of the active-set test nor the stiffness of the rows; nodes stick and slide."""
    path = blocks(law, places=SLIDE[:3]).solve()
    report = by_numerics(FORCE, path, over_steps=total)
    (pair,) = report.pairs
    assert abs(pair.by_c_n) < 1e-12 * abs(report.value)
    assert abs(pair.by_stiffness) < 1e-11 * abs(report.value)
    assert abs(pair.by_offset).max() > abs(report.value)  # the quantity depends on these


@pytest.mark.parametrize("law", [fm.Coulomb(0.3), Worn(0.3, 0.05)], ids=["Coulomb", "wear"])
def test_adjoint_is_tangent_linear(law):
    path = blocks(law, places=SLIDE[:3]).solve()
    for control in (NumericWeight(0, "c_n"), NumericWeight(0, "stiffness"), RemainingResidual()):
        by_all = fm.gradient(FORCE, control, path)
        along = fm.sensitivity.tangent_linear(FORCE, control, 1.0, path)
        assert float(by_all[control]) == pytest.approx(along.derivative, rel=1e-6, abs=1e-14)


@pytest.mark.parametrize("on", ["block", "obstacle"])
def test_residual_left_is_the_error_of_the_objective(on):
    """Newton's method stopped early, against its limit."""
    values, estimates = [], []
    for tolerance in (1e-3, 1e-12):
        inexact = {"linearization": "no_normals"}  # which converges linearly
        if on == "block":
            scene = blocks(fm.Coulomb(0.3), places=SLIDE[:1], **inexact)
        else:
            circle = fm.Circle((0.52, 1.8), 0.8)
            scene = obstacle_on_block(circle, fm.Coulomb(0.3), places=ROLL[:1], **inexact)
        scene.problem.equations.newton = replace(
            scene.problem.equations.newton,
            residual_tolerance=tolerance,
            increment_tolerance=tolerance,
        )
        report = by_numerics(FORCE, scene.solve())
        values.append(report.value)
        estimates.append(report.residual)
    error = values[0] - values[1]
    allowed = 1e-11 * abs(values[1])
    assert abs(error) > 10.0 * allowed > abs(estimates[1])
    assert estimates[0] == pytest.approx(error, rel=0.05)


@pytest.mark.parametrize("degree", [1, 2])
def test_bulges_of_a_circle(degree):
    """Mean height of an arc over its chord: l^2 / 12 R, where facets are equal."""
    data, u = cylinder(degree)
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 100.0, 0.3)), u,
        [fm.ContactPair(data, "cylinder/arc", "block/top")],
        bcs=[fm.dirichlet(u.function_space, data, "block/bottom", (0.0, 0.0)),
             fm.dirichlet(u.function_space, data, "cylinder/top", (0.0, 0.0))],
        petsc_options_prefix="cylinder_",
    )  # fmt: skip
    (contact,) = problem.equations.contacts
    slave = contact.slave
    bottom = np.abs(slave.X[:, 0]) < 0.8
    chords = slave.lengths[(np.abs(slave.X[slave.facets][..., 0]) < 1.0).all(axis=1)]
    assert np.ptp(chords) < 1e-3 * chords.mean()
    expected = chords.mean() ** 2 / 12.0 / RADIUS
    assert np.allclose(mean_bulges(slave)[bottom], expected, rtol=1e-2)
    assert np.abs(mean_bulges(contact.master)).max() < 1e-12
    assert np.allclose(offset_by_faceting(contact), mean_bulges(slave), atol=1e-12)
    met = SimpleNamespace(x=slave.X, m=slave.X)  # each node meets one with its own bulge
    itself = SimpleNamespace(slave=slave, master=slave, operators=met)
    assert np.allclose(offset_by_faceting(itself), 2.0 * mean_bulges(slave), atol=1e-12)


def test_solve_reports_numerical_sensitivities():
    scene = blocks(fm.Coulomb(0.3))
    scene.move(SLIDE[0])
    assert scene.problem.solve().sensitivity is None
    scene.move(SLIDE[1])
    before = scene.problem.solve(sensitivity=Numerics(FORCE)).sensitivity
    assert before.value == pytest.approx(FORCE.value(scene.problem), rel=1e-12)
    text = str(before)
    assert "| pair 0: factor of c_n | " in text and text.count("\n") == 7
    height = 1e-6  # a nodal offset changes the force by its derivative
    (contact,) = scene.problem.equations.contacts
    contact.offset = contact.offset + height
    after = scene.problem.solve(sensitivity=Numerics(FORCE)).sensitivity
    assert after.value != before.value


def test_invalid_numerics_are_refused():
    scene = blocks()
    with refused(ValueError, "expected a fm.sensitivity.Numerics"):
        scene.problem.solve(sensitivity=3.0)
    scene.move((0.0, -0.03))
    assert scene.problem.solve().converged
