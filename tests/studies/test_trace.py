# SPDX-License-Identifier: MIT
"""Length of one Newton iteration: Python calls, and calls between modules."""

import pytest

from demos.studies.performance import trace_iteration


@pytest.mark.serial
def test_an_iteration_takes_few_calls():
    report, _, _, calls, crossings = trace_iteration.measure()
    assert report.converged
    # Less than half of the 477 and 212 before data were passed on from function to function.
    assert calls <= 215, calls
    assert crossings <= 104, crossings
