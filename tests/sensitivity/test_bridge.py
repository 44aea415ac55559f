# SPDX-License-Identifier: MIT
"""Paths as functions for frameworks of automatic differentiation: value and pullback."""

import sys
from types import ModuleType

import numpy as np
import pytest
from refusal import refused
from taylor_scenes import SLIDE, blocks

import fenics_mortar as fm
from fenics_mortar.sensitivity import FrictionWork, Simulation, TotalForce, to_autograd

QUANTITIES = [TotalForce(0, (1.0, 0.3)), FrictionWork(0)]
AT = (100.0, 0.3)  # Young's modulus and friction of the scene


def simulation():
    """The path of sliding blocks by their modulus and friction; counts its solves."""
    scene = blocks(fm.Coulomb(0.3), places=SLIDE[:3])
    runs = []

    def run():
        runs.append(1)
        return scene.solve()

    controls = [scene.controls["E"], scene.controls["mu"]]
    return Simulation(scene.problem, run, QUANTITIES, controls), runs


def loss(values):
    """A function of all values, nonlinear."""
    return (values**2).sum() + values[-1, 0]


def by_values(values):
    weights = 2.0 * values
    weights[-1, 0] += 1.0
    return weights


def test_pullback_is_the_derivative_of_the_function():
    """Chained with a function of the values, against difference quotients of the whole."""
    simulate, runs = simulation()
    values = simulate(*AT)
    assert values.shape == (3, 2)
    found = simulate.pullback(by_values(values), *AT)
    assert len(runs) == 1  # the path is that of the call before
    for number, (value, step) in enumerate(zip(AT, (1e-2, 1e-5), strict=True)):
        ends = []
        for sign in (1.0, -1.0):
            at = list(AT)
            at[number] = value + sign * step
            ends.append(loss(simulate(*at)))
        assert float(found[number]) == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-5)
    assert len(runs) == 5
    again = simulate.pullback(by_values(values), *AT)  # solves anew
    assert len(runs) == 6 and np.allclose(again, found, rtol=1e-8)


def test_values_of_other_shapes_are_refused():
    simulate, runs = simulation()
    for wrong in ((100.0,), (100.0, (0.3, 0.3))):
        with refused(ValueError, "values of shapes"):
            simulate(*wrong)
    assert not runs


def test_differentiation_rule_without_autograd(monkeypatch):
    """Arguments passed to autograd: the function and its vector-Jacobian products."""
    rules = {}
    extend = ModuleType("autograd.extend")
    extend.primitive = lambda function: function
    extend.defvjp = lambda function, *of_arguments: rules.update({function: of_arguments})
    monkeypatch.setitem(sys.modules, "autograd", ModuleType("autograd"))
    monkeypatch.setitem(sys.modules, "autograd.extend", extend)
    simulate, _ = simulation()
    function = to_autograd(simulate)
    values = function(*AT)
    expected = simulate.pullback(by_values(values), *AT)
    assert len(rules[function]) == len(AT)
    for rule, wanted in zip(rules[function], expected, strict=True):
        assert rule(values, *AT)(by_values(values)) == pytest.approx(wanted, rel=1e-12)


def test_differentiation_rule_with_autograd():
    autograd = pytest.importorskip("autograd")
    simulate, _ = simulation()
    function = to_autograd(simulate)
    by_both = autograd.grad(lambda E, mu: loss(function(E * 2.0, mu)), argnum=(0, 1))
    found = by_both(AT[0] / 2.0, AT[1])
    expected = simulate.pullback(by_values(simulate(*AT)), *AT)
    assert np.allclose(found, [2.0 * expected[0], expected[1]], rtol=1e-8)
