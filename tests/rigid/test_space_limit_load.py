# SPDX-License-Identifier: MIT
"""Limit analysis of rigid bodies in space, with pyramids of friction, against closed forms."""

import numpy as np
import pytest

from fenics_mortar.rigid.complementarity import Touching, unresisted_motion

pytestmark = pytest.mark.serial
MU = 0.4


def feet(width, mu=0.0, shear=0.0, adhesion=0.0, turn=0.0):
    """A block on four nodes; its motions are three translations and three rotations."""
    at = 0.5 * width * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    c, s = np.cos(turn), np.sin(turn)
    x = np.column_stack([at @ np.array([[c, s], [-s, c]]), np.full(4, -0.5)])
    axes = np.eye(3)
    moved = np.repeat(axes[:, None], 4, axis=1)
    motions = np.concatenate([moved, np.cross(axes[:, None], x[None])])
    slip = np.moveaxis(motions[:, :, :2], 0, 2)
    nodes = (np.full(4, float(value)) for value in (mu, shear, adhesion))
    return Touching(motions[:, :, 2].T, slip, *nodes)


def moves(load, touching):
    return unresisted_motion(np.array(load, float), touching).any()


@pytest.mark.parametrize("angle", [0.0, np.pi / 8, np.pi / 16, 0.3, 2.0])
def test_feet_slide_at_mu_in_any_direction(angle):
    """Also between the directions of the pyramids, and outside of their errors."""
    touching, pull = feet(4.0, MU, turn=0.7), np.array([np.cos(angle), np.sin(angle)])
    for part, expected in ((0.99, False), (1.01, True)):
        assert moves([*(part * MU * pull), -1.0, 0, 0, 0], touching) == expected
    assert not moves([*(0.9 * pull), -1.0, 0, 0, 0], feet(4.0, np.inf))


def test_feet_tip_over_edges_and_corners_and_spin():
    for turn, lever in ((0.0, 0.3), (np.pi / 4, 0.3 * np.sqrt(2.0))):
        touching = feet(0.6, 0.9, turn=turn)
        for part, expected in ((0.99, False), (1.01, True)):
            assert moves([part * 2.0 * lever, 0, -1.0, 0, 0, 0], touching) == expected
    for part, expected in ((0.99, False), (1.01, True)):
        moment = part * MU * np.sqrt(2.0) / 2.0
        assert moves([0, 0, -1.0, 0, 0, moment], feet(1.0, MU)) == expected


def test_feet_without_friction_with_shear_and_with_adhesion():
    assert not moves([0, 0, -1.0, 0.1, 0.1, 0], feet(1.0))
    assert moves([1e-3, 0, -1.0, 0, 0, 0], feet(1.0))
    for pull, expected in ((0.79, False), (0.81, True)):
        sides = np.array([np.cos(0.5), np.sin(0.5)])
        assert moves([*(pull * sides), -1.0, 0, 0, 0], feet(4.0, MU, shear=0.1)) == expected
    for lift, expected in ((0.79, False), (0.81, True)):
        assert moves([0, 0, lift, 0, 0, 0], feet(1.0, adhesion=0.2)) == expected
