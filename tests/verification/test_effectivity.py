# SPDX-License-Identifier: MIT
"""The estimate against the error that is known, and what grading by it is worth."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parents[2] / "demos" / "accuracy"))
import adapt
from norms import errors
from scenes_exact import Choice, hertz, press_fit

pytestmark = pytest.mark.serial


def linear_press_fit(n, choice):
    return press_fit(n, choice, law="linear")


@pytest.mark.parametrize(
    "scene, element, sizes",
    [
        (hertz, "P1", (16, 64)),
        (hertz, "P2", (16, 64)),
        (hertz, "Q1", (16, 32)),
        (press_fit, "P1", (48, 96)),
        (press_fit, "P2", (24, 48)),
        (linear_press_fit, "P1", (48, 96)),
        (linear_press_fit, "Q2", (24, 48)),
    ],
)
def test_estimate_is_of_the_size_of_the_error(scene, element, sizes):
    """Between a third and three times the error, and not drifting away from it."""
    found = []
    for n in sizes:
        posed = scene(n, Choice(element))
        posed.problem.solve()
        found.append(posed.problem.estimate().relative / errors(posed)["energy"])
    assert min(found) > 0.3 and max(found) < 3.0, found
    # an estimate of a lower order than the error would grow by a root of two or more per halving
    assert np.log(found[1] / found[0]) < 0.25 * np.log(sizes[1] / sizes[0]), found


def test_graded_meshes_take_a_fraction_of_the_unknowns():
    """A third on meshes this coarse; adapt.py shows it on finer ones."""
    (row,) = adapt.uniform("P1", [0.1])
    rows, _ = adapt.adaptive("P1", 0.4, row["pressure"])
    assert rows[-1]["pressure"] <= row["pressure"]
    assert 2 * rows[-1]["dofs"] < row["dofs"]
    assert all(0.3 < row["effectivity"] < 3.0 for row in rows)
