# SPDX-License-Identifier: MIT
"""Length of one Newton iteration: Python calls, and calls between modules."""

import pytest

from demos.studies.performance import trace_iteration


@pytest.mark.serial
def test_an_iteration_takes_few_calls():
    report, _, _, calls, crossings = trace_iteration.measure()
    assert report.converged
    # 186 and 105 at the time of writing; 477 and 212 before data were passed on between functions.
    assert calls <= 189, calls
    assert crossings <= 105, crossings
