# SPDX-License-Identifier: MIT
"""Families of the stability study: contact with itself, bodies of revolution, laws with memory."""

from __future__ import annotations

import numpy as np

from demos.studies.stability.family import FIXED, down, family, ground
from demos.studies.stability.model import Body, Grid, Scene, Support, block, fm, legs
from fenics_mortar import laws

# Contact with itself has the saddle-point system, exact segments and no other choice of sides.
OF_ITSELF = ("default", "standard", "plain", "no_normals", "no_segments", "frozen")


@family("hairpin closed upon itself: thickness / radius", 0.2, 0.5, 1, methods=OF_ITSELF)
def hairpin(ratio: float) -> Scene:
    """The ends of a hairpin are rotated, so that its arms touch, and slid along each other."""
    radius, length = 0.2, 1.0
    angles = -0.5 * np.pi - np.linspace(0.0, np.pi, 17)
    bend = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    x = np.linspace(length, 0.0, 21)[:-1]
    arms = [np.stack([x, np.full(20, y)], axis=1) for y in (-radius, radius)]
    middle = np.concatenate([arms[0], bend, arms[1][::-1]])
    along = np.gradient(middle, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    thickness = ratio * radius
    shape = middle[:, None] + thickness * np.linspace(-0.5, 0.5, 4)[:, None] * across[:, None]
    close, turn = 0.5 * (2.0 * radius - thickness), 0.8
    return Scene(
        bodies=[Body(Grid("pin", shape))],
        pairs=[("pin/bottom", None)],
        supports=[
            Support(
                ["pin/left"],
                legs((5, (0.0, 0.0, -turn)), (5, (0.0, 0.0, -turn))),
                centre=(length, -radius),
            ),
            Support(
                ["pin/right"],
                legs((5, (0.0, -close, turn)), (5, (-0.15, -close, turn))),
                centre=(length, radius),
            ),
        ],
        steps=10,
        pair={"law": fm.Coulomb(0.3)},
    )


@family("cone on a cylinder: angle of its flank", 0, 10, 30, 45)
def cone(angle: float) -> Scene:
    """A blunt cone is pressed into a cylinder, both bodies of revolution, with friction."""
    tip, width = 0.1, 0.6
    x = block(12, 5, width=width, height=0.6)
    flank = np.tan(np.radians(angle)) * np.maximum(x[..., 0] - tip, 0.0)
    x[..., 1] += flank * (1.0 - x[..., 1] / 0.6)
    low = ground(18, 8, width=2.4, height=1.0)
    shape = low.grid.x.copy()
    shape[..., 0] = 0.5 * (shape[..., 0] + 1.2)
    return Scene(
        bodies=[Body(Grid("ground", shape)), Body(Grid("cone", x), E=10.0)],
        pairs=[("ground/top", "cone/bottom")],
        supports=[
            FIXED,
            Support(["cone/top"], down(0.08)),
            Support(["ground/left", "cone/left"], component=0),
        ],
        steps=4,
        pair={"law": fm.Coulomb(0.3)},
        geometry="axisymmetric",
    )


@family("wear of a slider: depth by pressure and path", 0.01, 0.1, 1)
def wear(coefficient: float) -> Scene:
    """A block is pressed and slid by its width, and wears by the law of Archard."""
    upper = Body(Grid("upper", block(8, 4, width=0.5, height=0.4, corner=(-0.6, 0.0))))
    return Scene(
        bodies=[ground(24, 5, width=2.0, height=0.5, E=5.0), upper],
        pairs=[("upper/bottom", "ground/top")],
        supports=[
            FIXED,
            Support(["upper/top"], legs((2, (0.0, -0.02, 0.0)), (10, (0.5, -0.02, 0.0)))),
        ],
        steps=12,
        pair={"law": laws.Worn(0.2, coefficient)},
    )
