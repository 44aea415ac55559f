# SPDX-License-Identifier: MIT
"""Limit analysis of rigid bodies: what contact can support, against closed forms."""

import numpy as np
import pytest

from fenics_mortar.rigid.complementarity import Touching, unresisted_motion

pytestmark = pytest.mark.serial


def block(width, mu=0.0, shear=0.0, adhesion=0.0, turn=0.0):
    """A block on two nodes; its motions: along the plane, normal to it, and rotation."""
    x = np.array([-0.5 * width, 0.5 * width])
    opening = np.stack([0.0 * x, 1.0 + 0.0 * x, x], axis=1)
    height = 0.5  # of the centre above the plane
    slip = np.stack([1.0 + 0.0 * x, 0.0 * x, height + 0.0 * x], axis=1)
    cosine, sine = np.cos(turn), np.sin(turn)
    R = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    nodes = (np.full(2, float(value)) for value in (mu, shear, adhesion))
    return Touching(opening @ R.T, slip @ R.T, *nodes), R


def moves(load, touching):
    return bool(unresisted_motion(np.array(load), touching).any())


@pytest.mark.parametrize("turn", [0.0, 0.7])
@pytest.mark.parametrize("mu", [0.1, 0.5, 0.9])
def test_block_slides_at_mu_and_tips_at_its_width(mu, turn):
    for width, critical in ((4.0, mu), (0.6, min(mu, 0.6))):
        touching, R = block(width, mu, turn=turn)
        for part, expected in ((0.99, False), (1.01, True)):
            assert moves(R @ [part * critical, -1.0, 0.0], touching) == expected


def test_shear_without_pressure_adds_to_friction_and_adhesion_supports_a_block():
    touching, _ = block(4.0, mu=0.5, shear=0.1)
    assert not moves([0.69, -1.0, 0.0], touching)
    assert moves([0.71, -1.0, 0.0], touching)
    touching, _ = block(4.0, adhesion=0.3)
    assert not moves([0.0, 0.59, 0.0], touching)
    assert moves([0.0, 0.61, 0.0], touching)


def test_sticking_block_is_supported_for_any_push():
    touching, _ = block(10.0, mu=np.inf)
    assert not moves([3.0, -1.0, 0.0], touching)
    assert moves([3.0, 0.1, 0.0], touching)


def test_only_the_unsupported_body_moves():
    """Two blocks side by side on one plane, the second pushed beyond its friction."""
    one, _ = block(4.0, mu=0.5)
    zero = np.zeros_like(one.opening)
    both = Touching(
        np.block([[one.opening, zero], [zero, one.opening]]),
        np.block([[one.slip, zero], [zero, one.slip]]),
        *(np.tile(values, 2) for values in one[2:]),
    )
    motion = unresisted_motion(np.array([0.4, -1.0, 0.0, 0.6, -1.0, 0.0]), both)
    assert motion[3] == pytest.approx(1.0) and abs(motion[0]) < 1e-6


def test_no_contact_and_no_load():
    touching, _ = block(1.0)
    none = Touching(*(values[:0] for values in touching))
    assert moves([0.0, -1.0, 0.0], none)
    assert not moves([0.0, 0.0, 0.0], none)
