# SPDX-License-Identifier: MIT
"""Obstacles that forces and moments drive: their place is unknown, and found by the solve."""

import numpy as np
import pytest
import two_blocks
from scenes import TIGHT, internal, neo_hookean, read, rectangles
from test_obstacles import KINDS, block_under

from dolfinx import fem

import fenics_mortar as fm

SCENES = [
    ("plane", ("y", "moment")),
    ("circle", ("x", "y")),
    ("hole", ("y",)),
    ("open", ("x", "y", "moment")),
    ("closed", ("y", "moment")),
]
LOADS = ("x", "y", "moment")


def pushed(obstacle, reaction, free):
    """Drive the motions ``free`` by the opposite of what contact does."""
    loads = dict(zip(LOADS, -reaction, strict=True))
    obstacle.push(**{name: loads[name] for name in free})


@pytest.mark.parametrize("kind, free", SCENES)
@pytest.mark.parametrize("degree, algorithm", [(1, "condensed"), (1, "saddle"), (2, "condensed")])
def test_force_leads_to_where_displacement_did(kind, free, degree, algorithm):
    """The reaction of a prescribed motion, fed back as a load to one that starts elsewhere."""
    moved, driven = KINDS[kind](), KINDS[kind]()
    given, found = (block_under(o, degree=degree, algorithm=algorithm) for o in (moved, driven))
    moved.move(x=0.03, y=-0.06, angle=0.02)
    given.solve()
    driven.move(x=0.03, angle=0.02)
    pushed(driven, moved.reaction, free)
    report = found.solve()
    assert report.certificate.violations() == []
    # near the edge of an active set the pressure follows the place by some 1e3 of the rounding
    z, exact = found.contacts[0].z, given.contacts[0].z
    assert np.abs(z - exact).max() < 1e-10 * np.abs(exact).max()
    assert np.abs(driven.place - moved.place).max() < 1e-10
    assert (
        np.abs(driven.reaction + np.nan_to_num(driven.load, nan=0.0))[
            np.isfinite(driven.load)
        ].max()
        < 1e-11
    )


@pytest.mark.parametrize("kind", ["plane", "open"])
def test_newton_is_quadratic(kind):
    obstacle = KINDS[kind]()
    problem = block_under(obstacle)
    obstacle.push(y=-5.0, moment=0.0)
    residuals = problem.solve().residuals
    assert residuals[-2] < 1e-3 * residuals[-3] and residuals[-1] < 1e-3 * residuals[-2]
