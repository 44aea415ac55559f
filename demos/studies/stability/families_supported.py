# SPDX-License-Identifier: MIT
"""Families of the stability study: bodies supported by contact alone."""

from __future__ import annotations

import numpy as np

from demos.studies.stability.family import FIXED, down, expect, family, ground
from demos.studies.stability.model import (
    Body,
    Grid,
    Scene,
    Support,
    block,
    legs,
    sector,
)


@family("wheel falls on a block: gap / radius", 0.0, 0.1, 1, 10)
def falling_wheel(gap: float) -> Scene:
    """A wheel under its weight, without Dirichlet conditions."""
    weight = 0.02
    x = sector(40, 3, radii=(0.3, 1.0), centre=(0.03, 1.0 + gap))
    area = 0.5 * 40 * np.sin(2 * np.pi / 40) * (1.0**2 - 0.3**2)
    return Scene(
        bodies=[
            ground(30, 5, width=3.0, height=0.8),
            Body(Grid("wheel", x, closed=True), weight=(0.0, -weight)),
        ],
        pairs=[("wheel/bottom", "ground/top")],
        supports=[FIXED],
        steps=2,
        check=lambda posed: expect(
            "force",
            posed.forces[0, 1],
            weight * area,
            1e-6 + posed.problem.certificate().springs,  # forces of springs are reported, not wrong
        ),
    )


@family("block between plates: roles, gap / height", *(
    f"{roles} {gap}" for roles in ("slave-slave", "slave-master") for gap in (0.0, 0.05)
))  # fmt: skip
def sandwich(value: str) -> Scene:
    """Three bodies on top of each other; the middle one is supported by contact alone."""
    roles, gap = value.split()
    g = float(gap)
    shapes = {
        "ground": block(12, 3, width=1.2, height=0.5, corner=(-0.6, -0.5)),
        "middle": block(7, 4, width=0.8, height=1.0, corner=(-0.4, g)),
        "plate": block(10, 3, width=1.2, height=0.5, corner=(-0.6, 1.0 + 2 * g)),
    }
    above = ("middle/top", "plate/bottom")
    return Scene(
        bodies=[Body(Grid(name, x)) for name, x in shapes.items()],
        pairs=[("middle/bottom", "ground/top"), above if roles == "slave-slave" else above[::-1]],
        supports=[FIXED, Support(["plate/top"], down(0.1 + 2 * g))],
        steps=4,
        check=lambda posed: expect(
            "force below", abs(posed.forces[0, 1]), abs(posed.forces[1, 1]), 1e-6
        ),
    )


@family("three bodies meet in a point: slit between two", 0.0, 0.02)
def three_bodies(slit: float) -> Scene:
    """Two blocks side by side on a third, pressed down and together."""
    left = Grid(
        "left",
        block(5, 5, width=0.6, height=0.6, corner=(-0.6 - slit / 2, 0.0)),
        joined={"bottom": "both/bottom"},
    )
    right = Grid(
        "right",
        block(6, 7, width=0.6, height=0.6, corner=(slit / 2, 0.0)),
        joined={"bottom": "both/bottom"},
    )
    together = 0.02 + slit / 2
    return Scene(
        bodies=[ground(16, 5, width=1.6, height=0.6), Body(left), Body(right)],
        pairs=[("ground/top", "both/bottom"), ("right/left", "left/right")],
        supports=[
            FIXED,
            Support(["left/top", "right/top"], down(0.05), component=1),
            Support(["left/left"], down(0.0, aside=together), component=0),
            Support(["right/right"], down(0.0, aside=-together), component=0),
        ],
        steps=3,
    )


@family("prescribed slave nodes", "one end", "both ends", "across", "along")
def clamped_slave(which: str) -> Scene:
    """A block fixed at its sides, hence at the ends of the slave, is pushed from below."""
    sides = ["upper/left"] if which == "one end" else ["upper/left", "upper/right"]
    component = {"across": 0, "along": 1}.get(which)
    return Scene(
        bodies=[
            Body(Grid("upper", block(10, 5, width=1.0, height=0.6, corner=(-0.5, 0.0)))),
            ground(14, 5, width=1.4, height=0.6),
        ],
        pairs=[("upper/bottom", "ground/top")],
        supports=[
            Support(["ground/bottom"], legs((1, (0.0, 0.05, 0.0)))),
            Support(["upper/top"]),
            Support(sides, component=component),
        ],
        steps=2,
    )
