# SPDX-License-Identifier: MIT
"""Paths in space whose contact opens in a step: lifted off, or past the other side."""

import numpy as np
import pytest
from crossing_scenes import move_body
from space_pair_scenes import bodies, two_blocks

import fenics_mortar as fm
from fenics_mortar.path.stepping import describe_jump
from meshes.mapped_boxes import Box, block

FLOOR = fm.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def on_floor(**options):
    """A block on a rigid plane."""
    x = block((2, 2, 1), size=(1.0, 1.0, 0.5))
    return bodies([Box("upper", x)], ["upper/top"], [("upper/bottom", FLOOR)], **options)


@pytest.mark.parametrize("scene", [on_floor, two_blocks])
@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_block_is_pressed_and_lifted_off(scene, mu):
    made = scene(law=fm.Coulomb(mu) if mu else None)

    def loads(time):
        made.move("upper/top", (0.02 * time, 0.0, -0.02 if time == 1.0 else 0.1 * (time - 1.0)))

    options, active = fm.SteppingOptions(step=1.0), []
    fm.follow_path(
        made.problem, loads, options, stop=2.0,
        on_step=lambda *_: active.append(made.problem.contacts[0].active.any()),
    )  # fmt: skip
    assert active == [True, False]


@pytest.mark.parametrize("scene, low", [(on_floor, 0.2), (two_blocks, 1.2)])
@pytest.mark.parametrize("depth, told", [(0.1, False), (0.5, True)])
def test_blocks_past_each_other_are_told(scene, low, depth, told):
    """From half the length of a node on, 0.25 at corners, as if no contact had remained."""
    made = scene()
    made.move("upper/top", (0.0, 0.0, -0.01)).solve()
    before = made.problem.state()
    down = np.array([0.0, 0.0, -depth])
    move_body(made.problem, lambda X: X[:, 2] > low, lambda X: X + down)
    equations = made.problem.equations
    equations.evaluate_operators()
    contact = equations.contacts[0]
    contact.change(active=np.zeros_like(contact.active))
    text = describe_jump(made.problem, before)
    assert ("jumped past each other" in text) == told
