# SPDX-License-Identifier: MIT
"""Input of other codes for our problem, and tables of measurements."""

import numpy as np
import pytest

from demos.studies.accuracy.peer import given_hertz
from demos.studies.accuracy.posed import ELEMENTS, Choice
from demos.studies.accuracy.report import cost, rate, rate_beside
from demos.studies.accuracy.scenes_exact import HALF_SIDE, hertz

pytestmark = pytest.mark.serial


@pytest.mark.parametrize("element", ELEMENTS)
def test_arrays_define_the_problem(element):
    posed = hertz(8, Choice(element))
    problem = given_hertz(posed)
    corners = 3 if element[0] == "P" else 4
    x = problem.x[problem.cells[:, :corners]]
    following = np.roll(x, -1, axis=1)
    areas = (x[..., 0] * following[..., 1] - x[..., 1] * following[..., 0]).sum(axis=1) / 2
    assert areas.min() > 0
    side = 2 * HALF_SIDE * 0.5
    # except for the gap, about side^2 / 24 R of the square, 8e-5
    assert areas.sum() == pytest.approx(side * side, rel=1e-4)
    if problem.cells.shape[1] > 4:
        middles = problem.x[problem.cells[:, corners : 2 * corners]]
        assert np.abs(middles - (x + following) / 2).max() < 1e-4
    for facets in (problem.slave[problem.facets], problem.master):
        along = problem.x[facets[:, 1]] - problem.x[facets[:, 0]]
        assert np.abs(along.sum(axis=0)) == pytest.approx([side, 0.0], abs=1e-12)
    prescribed = problem.prescribed.all(axis=1)
    x = problem.x[prescribed].T
    exact = posed.displacement(x, x[1] > 0)
    assert np.abs(problem.values[prescribed].T - exact).max() < 1e-12 * np.abs(exact).max()
    # the tractions of both sides are mirror images
    assert abs(problem.load[:, 0].sum()) < 1e-12 * np.abs(problem.load).sum()
    assert (problem.E, problem.nu) == pytest.approx((1.0, 0.3))


def test_tables_follow_power_laws():
    """Errors n^-3/2 and seconds n^2: 1 % is at n = 100^(2/3), 464 seconds; 1e-6 is too far."""
    rows = [{"n": n, "energy": n**-1.5, "seconds": n**2.0} for n in (4, 8, 16, 32)]
    assert rate(rows, "energy") == pytest.approx(1.5)
    assert cost(rows, 0.01, "seconds") == "460"
    assert cost(rows, 0.004, "seconds") == "~1,600"
    assert cost(rows, 1e-6, "seconds") == "-"


def test_deviating_rates_have_a_reason():
    """Facets of degree 2, a third of them in contact."""
    rows = [{"n": n, "element": "P2", "pressure": 1.0 / n} for n in (16, 32, 64, 128)]
    assert rate_beside(rows, "pressure", 1.1) == "1.00 (1.1)"
    assert rate_beside(rows[:3], "pressure", 0.5) == (
        "1.00 (0.5), too coarse: from 2.7 facets in contact on"
    )
    assert rate_beside(rows[1:], "pressure", 0.5) == "1.00 (0.5), not as predicted"
