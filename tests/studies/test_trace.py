# SPDX-License-Identifier: MIT
"""Length of one Newton iteration: Python calls, calls between modules; way to the integrals."""

import pytest

from demos.studies.performance import trace_iteration


@pytest.mark.serial
def test_an_iteration_takes_few_calls():
    report, _, _, calls, crossings = trace_iteration.measure()
    assert report.converged
    # 186 and 105 at the time of writing; 477 and 212 before data were passed on between functions.
    assert calls <= 189, calls
    assert crossings <= 105, crossings


@pytest.mark.serial
def test_few_functions_lie_between_solve_and_the_first_integral():
    way = trace_iteration.trace_way()
    assert way.frames[0].endswith("problem.py:solve"), way.frames
    assert way.frames[-1].endswith(":integrate_segments"), way.frames
    assert len(way.frames) <= 12, way.frames
    assert 1 <= len(way.modules) <= 25, way.modules  # 5 at the time of writing
