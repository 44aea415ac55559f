# SPDX-License-Identifier: MIT
"""Families of the stability study: edges, partial cover, corners."""

from __future__ import annotations

import numpy as np

from demos.studies.stability.family import FIXED, down, family, ground, turned, two_blocks
from demos.studies.stability.model import (
    Body,
    Grid,
    Scene,
    Support,
    block,
    legs,
    mapped,
)


@family("cover of the last slave facet", 1, 0.5, 0.1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10)
def edge_cover(cover: float) -> Scene:
    """The slave hangs over the edge of the master."""
    end = 0.75 + 0.25 * cover
    return two_blocks(
        block(4, 4, width=1.0, height=0.8),
        block(10, 5, width=end + 0.3, height=0.8, corner=(-0.3, -0.8)),
        down(0.05),
        2,
    )


@family("slide over a table's edge: facets per step", 0.25, 1, 2)
def slide_off(facets: float) -> Scene:
    """A block drawn over an edge until half of it hangs."""
    count = round(4 / facets)
    return two_blocks(
        block(8, 5, width=1.0, height=0.6),
        block(11, 5, width=1.5, height=0.8, corner=(-0.3, -0.8)),
        legs((1, (0.0, -0.03, 0.0)), (count, (0.7, -0.03, 0.0))),
        1 + count,
    )


@family("island on one slave facet: width / facet", 0.5, 0.1, 1e-2, 1e-3, 1e-4)
def island(ratio: float) -> Scene:
    """The master, a slender bar, stands in the middle of one facet of the slave."""
    width = 0.4 * ratio
    bar = block(2, 4, width=width, height=0.4, corner=(-width / 2, 0.0))
    return Scene(
        bodies=[ground(5, 4, width=2.0, height=0.8), Body(Grid("bar", bar))],
        pairs=[("ground/top", "bar/bottom")],
        supports=[FIXED, Support(["bar/top"], down(0.02))],
        steps=2,
    )


# Corners


def square(name: str, angle: float, place: tuple[float, float], upwards: bool) -> Body:
    """A square that stands on a corner, or hangs below it; that corner is at ``place``."""
    x = turned(block(6, 6, width=0.8, height=0.8), angle)
    x = np.array(place) + (-x if upwards else x)
    joined = {side: f"{name}/tip" for side in ("bottom", "left")}
    joined |= {side: f"{name}/back" for side in ("top", "right")}
    return Body(Grid(name, x, joined=joined))


@family("corner on flat: angle, who is slave", *(
    f"{a} {who}" for a in (45, 30, 10, 3) for who in ("corner", "flat")
))  # fmt: skip
def corner_on_flat(value: str) -> Scene:
    """A square pressed on a block with one corner first."""
    angle, who = value.split()
    sides = ("tip/tip", "ground/top") if who == "corner" else ("ground/top", "tip/tip")
    return Scene(
        bodies=[
            ground(20, 6, width=2.0, height=0.8),
            square("tip", float(angle), (0.03, 0.0), upwards=False),
        ],
        pairs=[sides],
        supports=[FIXED, Support(["tip/back"], down(0.12))],
        steps=4,
    )


@family("corner close above a flat: gap / facet", 0.1, 1e-2, 1e-3)
def near_miss(ratio: float) -> Scene:
    """A block comes down by half of the gap: there must be no force, also beside an edge."""
    gap = 0.1 * ratio
    return Scene(
        bodies=[
            ground(20, 6, width=2.0, height=0.8),
            square("tip", 10.0, (0.03, gap), upwards=False),
        ],
        pairs=[("ground/top", "tip/tip")],
        supports=[FIXED, Support(["tip/back"], down(gap / 2))],
        steps=1,
        check=lambda posed: "" if not posed.forces.any() else "force without touch",
    )


@family("corner on corner: offset / facet", 0.0, 0.01, 0.1, 0.5, 1.5)
def corner_on_corner(offset: float) -> Scene:
    """Two squares, tip to tip, with a small offset."""
    return Scene(
        bodies=[
            square("lower", 45, (0.0, 0.0), upwards=True),
            square("upper", 45, (offset * 0.8 / 6, 0.0), upwards=False),
        ],
        pairs=[("upper/tip", "lower/tip")],
        supports=[Support(["lower/back"]), Support(["upper/back"], down(0.15))],
        steps=5,
    )


@family("wedge in a groove: kink of the slave in degrees", 10, 30, 60, 90)
def kinked_slave(angle: float) -> Scene:
    """A block with a V-shaped bottom in a matching groove."""
    slope = np.tan(np.radians(angle / 2))

    def wedge(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        low = slope * np.abs(s - 0.5)
        return s - 0.5, low + (1.2 - low) * t

    def groove(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = 1.5 * (s - 0.5)
        return x, -0.8 + (0.8 + slope * np.abs(x)) * t

    return two_blocks(mapped(8, 6, wedge), mapped(14, 6, groove), down(0.06), 3)
