# SPDX-License-Identifier: MIT
"""Shortened Newton steps: if the residual would grow, or surfaces would move far."""

from dataclasses import dataclass

import numpy as np
import pytest
from scenes import nodal, pressed_blocks

import fenics_mortar as fm
from fenics_mortar.newton.loop import Damped, NewtonOptions, Status, Step, solve


@dataclass
class Place:
    x: float

    def towards(self, other, fraction):
        return Place(self.x + fraction * (other.x - self.x))


class Arctan:
    """arctan(x) = 0, of which whole Newton steps diverge from |x| > 1.39."""

    def __init__(self, x):
        self.x, self.remedies = x, self

    def evaluate(self, *, start):
        return Status(abs(np.arctan(self.x)), 1.0, 0.0, 0, 0, 0.0)

    def advance(self):
        step = -np.arctan(self.x) * (1.0 + self.x**2)
        self.x += step
        return Step(abs(step) / 10.0, 1.0)

    def state(self):
        return Place(self.x)

    def restore(self, state):
        self.x = state.x

    def interface_motion(self, before):
        return abs(self.x - before.x)

    def merge_sets(self, period):
        raise AssertionError("there are no sets")

    def seconds(self):
        return {}

    def diagnose(self):
        return ""

    def drifts(self):
        return ""


@pytest.mark.serial
@pytest.mark.parametrize("options", [{"line_search": True}, {"max_motion": 1.0}])
def test_damped_steps_converge_where_whole_ones_diverge(options):
    chosen = NewtonOptions(**options)
    with np.errstate(over="ignore", invalid="ignore"), pytest.raises(fm.NotConvergedError):
        solve(Arctan(3.0), NewtonOptions())
    report = solve(Damped(Arctan(3.0), chosen), chosen)
    assert report.iterations[1].fraction < 1.0 and report.iterations[-1].fraction == 1.0
    assert report.residuals == sorted(report.residuals, reverse=True)


@pytest.mark.each
@pytest.mark.parametrize("options", [{"line_search": True}, {"max_motion": 0.25}])
def test_damped_and_full_steps_reach_the_same_state(options):
    states, reports = [], []
    for newton in (NewtonOptions(), NewtonOptions(**options)):
        scene = pressed_blocks(n_upper=5, n_lower=8, problem={"newton": newton})
        scene.loads["push"].value[:] = (0.15, -0.15)
        reports.append(scene.problem.solve())
        states.append(nodal(scene.problem))
    assert np.allclose(*states, rtol=0.0, atol=1e-9)
    assert all(report.certificate.violations() == [] for report in reports)
    if "max_motion" in options:  # the push is 0.15 over facets of 1/8: more than four iterations
        parts = [it.fraction for it in reports[1].iterations]
        assert min(parts) < 0.5 and reports[1].num_iterations > reports[0].num_iterations
    else:  # increases only within the limit of the shortest step
        steps = zip(reports[1].residuals, reports[1].iterations[1:], strict=False)
        assert all(it.residual <= before or it.fraction < 0.1 for before, it in steps)


def test_options_are_checked():
    with pytest.raises(ValueError, match="max_motion=0.0: expected a positive number of facets"):
        NewtonOptions(max_motion=0.0)
    with pytest.raises(ValueError, match="linear_bulk=True takes full steps"):
        pressed_blocks(problem={"newton": NewtonOptions(line_search=True), "linear_bulk": True})
