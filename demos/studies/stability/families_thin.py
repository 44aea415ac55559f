# SPDX-License-Identifier: MIT
"""Families of the stability study: curved and thin bodies."""

from __future__ import annotations

from typing import Any

import numpy as np

from demos.studies.stability.family import FIXED, down, expect, family, ground, punch
from demos.studies.stability.model import (
    Body,
    Grid,
    Posed,
    Scene,
    Support,
    block,
    legs,
    mapped,
    sector,
)


@family("parabola between two slave nodes: facet / radius", 0.2, 0.5, 1)
def between_nodes(ratio: float) -> Scene:
    """A fine round master touches a coarse flat slave between its nodes."""
    facet = 0.25
    tool = punch(24, 4, width=0.25, height=0.3, radius=facet / ratio, middle=0.11)
    return Scene(
        bodies=[ground(8, 4, width=2.0, height=0.8), Body(Grid("tool", tool), E=10.0)],
        pairs=[("ground/top", "tool/bottom")],
        supports=[FIXED, Support(["tool/top"], down(0.05))],
        steps=2,
    )


@family("ring between plates: thickness / radius", 0.2, 0.1, 0.05)
def thin_ring(thickness: float) -> Scene:
    """The ring is supported by contact alone; rays of the plates intersect it twice."""
    ring = sector(48, 2, radii=(1.0 - thickness, 1.0), centre=(0.0, 1.0))
    plates = [
        Body(Grid(name, block(24, 2, width=2.4, height=0.2, corner=(-1.2, y))), E=10.0)
        for name, y in (("ground", -0.2), ("plate", 2.0))
    ]
    return Scene(
        bodies=[*plates, Body(Grid("ring", ring, closed=True))],
        pairs=[("ground/top", "ring/bottom"), ("plate/bottom", "ring/bottom")],
        supports=[FIXED, Support(["plate/top"], down(0.5))],
        steps=10,
        check=lambda posed: expect("force above", posed.forces[1, 1], -posed.forces[0, 1], 1e-6),
    )


@family("thin sheet, both faces the master: thickness / facet", 2, 1, 0.5)
def thin_sheet(ratio: float) -> Scene:
    """The wrong face of the sheet is within the search radius of the punch."""
    thickness = 0.05 * ratio
    sheet = block(40, 2, width=2.0, height=thickness, corner=(-1.0, -thickness))
    faces = dict.fromkeys(("bottom", "top"), "sheet/faces")
    ends = dict.fromkeys(("left", "right"), "sheet/ends")
    tool = punch(24, 4, width=0.8, height=0.5, radius=0.5)
    return Scene(
        bodies=[Body(Grid("sheet", sheet, joined=faces | ends)), Body(Grid("tool", tool))],
        pairs=[("tool/bottom", "sheet/faces")],
        supports=[Support(["sheet/ends"]), Support(["tool/top"], down(0.25))],
        steps=5,
    )


@family("sheet hit in one step: step / thickness", 1, 5, 20)
def tunnelling(ratio: float) -> Scene:
    """The punch starts above the sheet and would end behind it in one step."""
    thickness = 0.2 / ratio
    sheet = block(40, 2, width=2.0, height=thickness, corner=(-1.0, -thickness - 0.05))
    ends = dict.fromkeys(("left", "right"), "sheet/ends")
    tool = punch(24, 4, width=0.8, height=0.5, radius=0.5)
    return Scene(
        bodies=[Body(Grid("sheet", sheet, joined=ends)), Body(Grid("tool", tool))],
        pairs=[("tool/bottom", "sheet/top")],
        supports=[Support(["sheet/ends"]), Support(["tool/top"], down(0.25))],
        steps=1,
    )


@family("one cantilever pushed past another: overlap / length", 0.05, 0.2)
def cantilevers(overlap: float) -> Scene:
    """The tips bend, slip off each other and spring back: the path has a jump."""
    left = block(24, 3, width=1.0, height=0.1, corner=(-1.0, -0.1))
    right = block(20, 3, width=1.0, height=0.1, corner=(-overlap, 0.0))
    return Scene(
        bodies=[Body(Grid("left", left)), Body(Grid("right", right))],
        pairs=[("left/top", "right/bottom")],
        supports=[Support(["left/left"]), Support(["right/right"], down(1.0))],
        steps=20,
        check=lambda posed: "" if not posed.forces.any() else "force after they have parted",
    )


@family("block pushed into a narrower channel: facets per step", 0.5, 2, 5)
def channel(facets: float) -> Scene:
    """Two walls indent the block: 4 % interference, each side a separate pair."""
    count = round(20 / facets)
    mouth = mapped(
        30, 4, lambda s, t: (3.0 * s, 0.5 - 0.02 * np.clip((3.0 * s - 0.9) / 0.6, 0, 1) + 0.5 * t)
    )
    walls = {"upper": mouth, "lower": mouth[:, ::-1] * np.array([1.0, -1.0])}
    pushed = block(12, 12, width=0.8, height=1.0, corner=(0.05, -0.5))
    return Scene(
        bodies=[
            Body(Grid("pushed", pushed)),
            *(Body(Grid(name, x), E=10.0) for name, x in walls.items()),
        ],
        pairs=[("pushed/top", "upper/bottom"), ("pushed/bottom", "lower/top")],
        supports=[
            Support(["upper/top"]),
            Support(["lower/bottom"]),
            Support(["pushed/left"], legs((count, (20 * 0.8 / 12, 0.0, 0.0))), component=0),
        ],
        steps=count,
    )


def rings(facets: str) -> list[Body]:
    """Two rings with numbers of facets inner : outer."""
    inner, outer = map(int, facets.split(":"))
    return [
        Body(Grid("inner", sector(inner, 3, radii=(1.0, 2.0)), closed=True)),
        Body(Grid("outer", sector(outer, 3, radii=(2.0, 3.0)), closed=True)),
    ]


@family("press fit of polygons: facets inner : outer", "12:16", "24:32", "48:64")
def press_fit(facets: str) -> Scene:
    """An interference of 1 % of the radius; the inner ring is free to rotate."""
    a, b, c, nu, interference = 1.0, 2.0, 3.0, 0.3, 0.02
    # Lame for small strain, E = 1: radial displacement over pressure of the inner ring, free
    # inside, and of the outer one, fixed outside
    inner = b * (1 + nu) * ((1 - 2 * nu) * b**2 + a**2) / (b**2 - a**2)
    outer = (1 + nu) * (c**2 / b - b) / (1 / (1 - 2 * nu) + c**2 / b**2)
    right = interference / (inner + outer)

    def check(posed: Posed) -> str:
        contact = posed.problem.equations.contacts[0]
        weights = contact.operators.diagonal
        mean = float(weights @ contact.pressure / weights.sum())
        return expect("mean pressure", mean, right, 0.02 + (4 / int(facets.split(":")[0])) ** 2)

    return Scene(
        bodies=rings(facets),
        pairs=[("inner/bottom", "outer/top")],
        supports=[Support(["outer/bottom"])],
        steps=1,
        pair={"initial_gap": -interference},
        check=check,
    )


@family("polygon turned in a polygon by 30 degrees: facets", "12:16", "24:32", "48:64")
def turned_polygon(facets: str) -> Scene:
    """Concentric rings without play: corners have to pass each other."""
    return Scene(
        bodies=rings(facets),
        pairs=[("inner/bottom", "outer/top")],
        supports=[
            Support(["outer/bottom"]),
            Support(["inner/top"], legs((6, (0.0, 0.0, np.pi / 6)))),
        ],
        steps=6,
    )


def arch_and_tool(angle: float, thickness: float, **tool: Any) -> tuple[list[Body], float]:
    """A clamped arch of radius 1 below a slightly off-centre round tool; and its rise."""
    half = np.radians(angle)
    ends = (np.pi / 2 + half, np.pi / 2 - half)
    arch = sector(64, 2, radii=(1.0 - thickness, 1.0), angles=ends, centre=(0.0, -1.0))[:, ::-1]
    round_tool = punch(16, 4, width=0.5, height=0.4, radius=0.5, middle=0.02)
    bodies = [Body(Grid("arch", arch)), Body(Grid("tool", round_tool), E=10.0, **tool)]
    return bodies, 1.0 - np.cos(half)


@family("arch pushed through: half angle in degrees", 20, 40, 60, 90)
def pushed_arch(angle: float) -> Scene:
    """The force passes a maximum, the arch bends to one side and ends upside down."""
    bodies, rise = arch_and_tool(angle, 0.03)
    return Scene(
        bodies=bodies,
        pairs=[("tool/bottom", "arch/top")],
        supports=[
            Support(["arch/left", "arch/right"]),
            Support(["tool/top"], down(1.6 * rise)),
        ],
        steps=13,
    )


@family("arch under a weight: weight / what it bears", 0.5, 0.9, 1.2)
def loaded_arch(ratio: float) -> Scene:
    """Above its limit load the arch snaps through to the hanging state."""
    bodies, _ = arch_and_tool(50.0, 0.05, weight=(0.0, -ratio * 2.39e-4 / 0.2))
    return Scene(
        bodies=bodies,
        pairs=[("tool/bottom", "arch/top")],
        supports=[
            Support(["arch/left", "arch/right"]),
            Support(["tool/left", "tool/right"], component=0),
        ],
        steps=10,
    )
