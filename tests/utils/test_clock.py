# SPDX-License-Identifier: MIT
"""The whole time is distributed over phases, and none is counted twice."""

import time

import pytest
from scenes import pressed_blocks

from fenics_mortar.utils.clock import PHASES, Clock


def test_time_of_an_inner_phase_is_not_that_of_the_outer(monkeypatch):
    ticks = iter(range(0, 600, 100))
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(ticks)))
    clock = Clock()  # 0
    with clock("assembly"), clock("search"):  # 100, 200
        pass  # 300, 400
    seconds = clock.read()  # 500
    assert seconds["search"] == 100.0 and seconds["assembly"] == 200.0
    assert seconds["other"] == 200.0 and sum(seconds.values()) == 500.0


def test_a_phase_ends_where_it_raises():
    clock = Clock()
    with pytest.raises(ValueError), clock("solve"):
        raise ValueError
    clock.read()
    assert clock.read()["solve"] == 0.0


def test_record_of_a_solve_holds_all_phases():
    scene = pressed_blocks(n_upper=4, n_lower=5, layers_upper=2, layers_lower=2)
    scene.loads["push"].value[1] = -0.01
    report = scene.problem.solve()
    assert tuple(report.total_seconds()) == PHASES
    assert report.iterations[0].seconds["residual"] > 0.0  # the place is that of the set-up
    for iteration in report.iterations[1:]:
        assert min(iteration.seconds.values()) > 0.0
