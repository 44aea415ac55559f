# SPDX-License-Identifier: MIT
"""Quantities of contact: values, and derivatives by state, state before and controls."""

from mpi4py import MPI

import numpy as np
import pytest
import sensitivity_scenes as scenes
from test_contact_controls import slid_block

import fenics_mortar as fm
from fenics_mortar.sensitivity.controls import Interference, LawParameter, ObstacleShape, Offset
from fenics_mortar.sensitivity.protocols import (
    ContactLength,
    FrictionWork,
    MeanGap,
    Moment,
    PeakPressure,
    PressureFunctional,
    PressureIntegral,
    TotalForce,
    effective_length,
)

comm = MPI.COMM_WORLD
TARGET = 2.0
QUANTITIES = {
    "force": TotalForce(0, (0.3, 1.0)),
    "moment": Moment(0, (0.2, 0.1)),
    "pressure": PressureIntegral(0),
    "square": PressureIntegral(0, 2),
    "misfit": PressureFunctional(0, lambda p: (p - TARGET) ** 2, lambda p: 2.0 * (p - TARGET)),
    "peak": PeakPressure(0, 6.0),
    "gap": MeanGap(0, np.array([0, 1])),
    "work": FrictionWork(0),
    "length": ContactLength(0),
    "effective length": effective_length(0),
    "function": (2.0 * TotalForce(0, (0.0, 1.0)) - 1.3) ** 2 + FrictionWork(0),
}


def check(problem, before, quantity):
    """Taylor tests by the present state and by the state before."""
    history = before if any(c.pair.law.has_friction for c in problem.equations.contacts) else None
    d = scenes.random_vector(problem, 3, (0.005, 1.0, 0.005))
    present, start = problem.state(), quantity.value(problem, before)

    def by_state(t):
        now = scenes.moved(problem, present, d, t)
        problem.equations.put(now)
        problem.equations.evaluate_operators()
        return quantity.value(problem, before)

    derivative = quantity.gradient(problem, before).dot(d, comm)
    assert abs(derivative) > 1e-7
    rate, errors = scenes.taylor(by_state, derivative)
    assert rate > 1.9, errors
    gradient = quantity.by_before(problem, history)
    if gradient is None:
        return

    def by_before(t):
        scenes.count_slip_from(problem, scenes.moved(problem, before, d, t), present)
        return quantity.value(problem, before)

    rate, errors = scenes.taylor(by_before, gradient.dot(d, comm))
    assert rate > 1.9, errors
    assert quantity.value(problem, before) == pytest.approx(start, rel=1e-12)


@pytest.mark.each
@pytest.mark.parametrize("name", QUANTITIES)
@pytest.mark.parametrize("degree", [1, 2])
def test_between_bodies(blocks, degree, name):
    check(*blocks(degree), QUANTITIES[name])


@pytest.fixture(scope="module")
def blocks():
    made = {}

    def of(degree):
        if degree not in made:
            scene, before, now = scenes.two_steps(fm.Coulomb(0.3), degree=degree)
            made[degree] = scene.problem, before, now
        problem, before, now = made[degree]
        problem.restore(now)
        return problem, before

    return of


@pytest.mark.once
@pytest.mark.parametrize("name", QUANTITIES)
def test_on_an_obstacle(name):
    check(*slid_block(fm.Circle((0.4, -1.5), 1.515), fm.Coulomb(0.3)), QUANTITIES[name])


def test_values(blocks):
    problem, _ = blocks(1)
    contact, view = problem.equations.contacts[0], problem.contacts[0]
    force, forces = view.total_force, view.forces
    x = view.positions - [0.2, 0.1]
    assert QUANTITIES["force"].value(problem) == pytest.approx(force @ [0.3, 1.0])
    moment = (x[:, 0] * forces[:, 1] - x[:, 1] * forces[:, 0]).sum()
    assert QUANTITIES["moment"].value(problem) == pytest.approx(moment, rel=1e-10)
    w, p = contact.operators.weight, view.pressure
    assert QUANTITIES["pressure"].value(problem) == pytest.approx(w @ p)
    assert PeakPressure(0, 200.0).value(problem) == pytest.approx(p.max(), rel=0.02)
    assert QUANTITIES["work"].value(problem) == view.friction_work
    assert MeanGap(0).value(problem) == pytest.approx(0.0, abs=1e-10)
    assert QUANTITIES["length"].value(problem) == pytest.approx(1.0, rel=0.05)
    assert QUANTITIES["effective length"].value(problem) < QUANTITIES["length"].value(problem)


@pytest.mark.parametrize("name", ["gap", "pressure", "work", "function"])
def test_explicit_derivatives(name):
    """At a fixed state, gaps, normals and slip depend on offsets and on the radius."""
    circle = fm.Circle((0.4, -1.5), 1.515)
    problem, before = slid_block(circle, fm.Coulomb(0.3))
    quantity, present = QUANTITIES[name], problem.state()
    for control in (Offset(0), Interference(0), ObstacleShape(circle, "radius")):
        start = control.get(problem)
        dm = 0.05 * np.random.default_rng(0).uniform(0.5, 1.0, start.shape)
        derivative = np.sum(quantity.by_control(problem, control, before) * dm)

        def value(t, control=control, start=start, dm=dm):
            control.set(problem, start + t * dm)
            now = present.with_settings_of(problem.state())
            scenes.count_slip_from(problem, before, now)
            return quantity.value(problem)

        rate, errors = scenes.taylor(value, derivative)
        assert rate > 1.9, errors
        control.set(problem, start)
    assert np.sum(quantity.by_control(problem, LawParameter(0, "mu"), before)) == 0.0
