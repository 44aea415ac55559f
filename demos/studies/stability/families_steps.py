# SPDX-License-Identifier: MIT
"""Families of the stability study: sizes of steps, contrasts of stiffness and of meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from demos.studies.stability.family import (
    FIXED,
    down,
    expect,
    family,
    ground,
    punch,
    punch_on_ground,
    two_blocks,
)
from demos.studies.stability.model import (
    Body,
    Grid,
    Pose,
    Scene,
    Support,
    block,
    fm,
    legs,
    mapped,
    sector,
)


@family("punch pushed in: step / facet", 0.1, 0.5, 1, 2.5, 5)
def step_size(ratio: float) -> Scene:
    """Steps of half a facet to five facets, a quarter of the punch's radius in total."""
    return punch_on_ground(steps=round(5 / ratio), depth=0.25)


@family("ironing: slide per step / facet", 0.1, 0.5, 1, 3, 10)
def ironing(facets: float) -> Scene:
    """A round tool, ten times stiffer, pressed into a block and drawn along it."""
    count = {0.1: 20, 0.5: 16, 1: 15, 3: 6, 10: 2}[facets]
    tool = punch(12, 4, width=0.8, height=0.5, radius=0.5, middle=-1.0)
    slide = facets * count * 0.1
    return Scene(
        bodies=[
            ground(40, 6, width=4.0, height=0.8),
            Body(Grid("tool", tool), E=10.0),
        ],
        pairs=[("ground/top", "tool/bottom")],
        supports=[
            FIXED,
            Support(["tool/top"], legs((3, (0.0, -0.15, 0.0)), (count, (slide, -0.15, 0.0)))),
        ],
        steps=3 + count,
    )


@family("ironing with friction: mu", 0.1, 0.3, 0.6, 1, 2)
def rubbing(mu: float) -> Scene:
    """Ironing with friction, one facet per step."""
    return replace(ironing(1), pair={"law": fm.Coulomb(mu)})


@family("ironing, mu = 0.3: slide per step / facet", 0.1, 0.5, 1, 3, 10)
def rubbing_fast(facets: float) -> Scene:
    """Ironing with friction: nodes slide far in one step, and come into contact during the step."""
    return replace(ironing(facets), pair={"law": fm.Coulomb(0.3)})


@family("block drawn to and fro, mu = 0.3: steps per stroke", 1, 2, 5, 20)
def reversal(steps: int) -> Scene:
    """A block on a block; in each stroke all nodes slide, stick and slide again."""
    there, back, low = (0.1, -0.04, 0.0), (-0.1, -0.04, 0.0), (0.0, -0.04, 0.0)
    upper = block(8, 6, width=0.8, height=0.5, corner=(-0.4, 0.0))
    lower = block(18, 6, width=1.6, height=0.5, corner=(-0.8, -0.5))
    path = legs((steps, low), (steps, there), (2 * steps, back), (2 * steps, there), (steps, low))
    return two_blocks(upper, lower, path, 7 * steps, pair={"law": fm.Coulomb(0.3)})


@family("pressed on a slope of 27 degrees: mu", 0, 0.2, 0.4, 0.5, 0.6, 1, 2)
def slope(mu: float) -> Scene:
    """A block whose bottom rises by one half, pressed straight down; it sticks above mu = 0.5."""

    def above(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = 0.8 * (s - 0.5)
        return x, 0.5 * x + (0.6 - 0.5 * x) * t

    def below(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = 1.6 * (s - 0.5)
        return x, -0.8 + (0.8 + 0.5 * x) * t

    upper, lower = mapped(8, 6, above), mapped(18, 6, below)
    return two_blocks(upper, lower, down(0.06, steps=3), 3, pair={"law": fm.Coulomb(mu)})


@family("roll by 30 degrees: degrees per step", 1, 5, 10, 30)
def roll(degrees: float) -> Scene:
    """Half a wheel pressed on a block and rolled along it."""
    count, angle = round(30 / degrees), np.radians(30)
    wheel = sector(40, 4, radii=(0.4, 1.0), angles=(1.1 * np.pi, 1.9 * np.pi), centre=(0.0, 1.0))
    return Scene(
        bodies=[ground(36, 6, width=3.0, height=0.8), Body(Grid("wheel", wheel))],
        pairs=[("wheel/bottom", "ground/top")],
        supports=[
            FIXED,
            Support(
                ["wheel/left", "wheel/right", "wheel/top"],
                legs((1, (0.0, -0.06, 0.0)), (count, (angle, -0.06, -angle))),
                centre=(0.0, 1.0),
            ),
        ],
        steps=1 + count,
    )


@family("pressed blocks turned by 90 degrees: degrees per step", 5, 15, 30, 45)
def turn_all(degrees: float) -> Scene:
    """Two blocks pressed together, then both ends rotated about one centre, and so is the force."""
    count = round(90 / degrees)
    centre = (0.0, -0.8)

    def pose(time: float) -> Pose:
        *_, angle = around(time)
        push = -0.05 * min(1.0, time * (count + 1))
        return -np.sin(angle) * push, np.cos(angle) * push, angle

    around = legs((1, (0.0, 0.0, 0.0)), (count, (0.0, 0.0, np.pi / 2)))
    scene = two_blocks(
        block(8, 6, width=1.0, height=0.8, corner=(-0.5, 0.0)),
        block(14, 6, width=1.6, height=0.8, corner=(-0.8, -0.8)),
        pose,
        count + 1,
        check=lambda posed: (
            "" if abs(posed.forces[0, 1]) < 1e-6 * abs(posed.forces[0, 0]) else "force not turned"
        ),
    )
    supports = [
        Support(["ground/bottom"], around, centre=centre),
        Support(["upper/top"], pose, centre=centre),
    ]
    return replace(scene, supports=supports)


@family("block bounces along a plank, 40 steps", "linear", "neo-Hookean")
def bouncing(material: str) -> Scene:
    """After MOOSE's test of this name, whose iterations are published: five bounces of a block."""

    def pose(time: float) -> Pose:
        return 2.0 * time, 0.2 * np.cos(10.0 * np.pi * time) - 0.2, 0.0

    return two_blocks(
        block(5, 5, width=0.6, height=0.6, corner=(-1.3, 0.21)),
        block(24, 5, width=3.0, height=0.8, corner=(-1.5, -0.8)),
        pose,
        40,
        linear=material == "linear",
    )


# Contrast of stiffness and mesh


@family("stiffness of slave / master", 1e-6, 1e-3, 1, 1e3, 1e6)
def stiffness(ratio: float) -> Scene:
    """Two blocks pressed unevenly."""
    return two_blocks(
        block(8, 6, width=1.0, height=0.8, corner=(-0.5, 0.0)),
        block(14, 6, width=1.6, height=0.8, corner=(-0.8, -0.8)),
        down(0.06, turn=0.03),
        4,
        stiff={"upper": ratio},
    )


@family("facets of slave : master", "2:60", "3:30", "9:10", "30:3", "60:2")
def mesh_ratio(ratio: str) -> Scene:
    """Two blocks with different facet lengths."""
    slave, master = map(int, ratio.split(":"))
    return two_blocks(
        block(slave, 5, width=1.0, height=0.8, corner=(-0.5, 0.0)),
        block(master, 5, width=1.2, height=0.8, corner=(-0.6, -0.8)),
        down(0.06, turn=0.03),
        4,
    )


@family("nodes on nodes, shifted by", 0.0, 1e-16, 1e-14, 1e-12, 1e-9, 1e-6)
def node_on_node(shift: float) -> Scene:
    """Matching meshes: the last node of the slave passes the edge of the master by very little."""
    return two_blocks(
        block(8, 4, width=1.0, height=0.6, corner=(-0.5 + shift, 0.0)),
        block(8, 4, width=1.0, height=0.6, corner=(-0.5, -0.6)),
        down(0.06),
        3,
        nu=0.0,
        # plane strain without lateral strain: one bar of height 1.2, compressed by 0.06
        check=lambda posed: expect("force", posed.forces[0, 1], bar_force(0.06 / 1.2), 1e-4),
    )


def bar_force(shortening: float, E: float = 1.0) -> float:
    """Force of a bar of width 1, nu = 0, neo-Hookean: P = mu (F - 1 / F), mu = E / 2."""
    F = 1.0 - shortening
    return 0.5 * E * (1.0 / F - F)
