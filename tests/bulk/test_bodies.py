# SPDX-License-Identifier: MIT
"""Descriptions of free rigid motions of a body."""

import numpy as np
import pytest

from fenics_mortar.bulk.bodies import FloatingBody

pytestmark = pytest.mark.serial


@pytest.mark.parametrize(
    "motion, description",
    [
        ((0.6, -0.8, 0.0), r"move along (0.6, -0.8)"),
        ((0.6, 0.8, 0.0), r"move along (0.6, 0.8)"),
        ((0.0, 1.0, 0.0), r"move along (0, 1)"),
        ((0.0, 0.0, 1.0), r"rotate about (3, 4)"),
        ((0.6, 0.0, 0.8), r"rotate about (3, 5.5)"),  # 0.6 over 0.8 / 2: 1.5 off
    ],
)
def test_free_motion_and_its_negative_have_the_same_description(motion, description):
    body = FloatingBody(0, np.array([3.0, 4.0]), 2.0, np.eye(3), 1.0, 4)
    for sign in (1.0, -1.0):
        assert body.describe(sign * np.array(motion)) == description


def test_driven_translation_keeps_its_direction():
    body = FloatingBody(0, np.array([3.0, 4.0]), 2.0, np.eye(3), 1.0, 4)
    falling = np.array([0.0, -2.0, 1e-7])
    assert body.describe(falling, directed=True) == "move along (0, -1)"
