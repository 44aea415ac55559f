# SPDX-License-Identifier: MIT
"""Families of the stability study: cells, units, parameters, rigid tools, ranks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from demos.studies.stability.families_steps import ironing
from demos.studies.stability.family import (
    FIXED,
    down,
    expect,
    family,
    ground,
    punch_on_ground,
    turned,
    two_blocks,
)
from demos.studies.stability.model import (
    Scene,
    Support,
    Tool,
    block,
    fm,
    legs,
    mapped,
)


@family("cells", "quadrilaterals", "triangles")
def cells(kind: str) -> Scene:
    """The punch with different cells."""
    return punch_on_ground(steps=4, depth=0.12, cell=kind[:-1])


@family("weight of the gap c_n", 1e-8, 1e-4, 1, 1e4, 1e8)
def weight_of_gap(c_n: float) -> Scene:
    """Different weights of the gap, on which the result must not depend."""
    return punch_on_ground(steps=4, depth=0.12, pair={"c_n": c_n})


@family("Poisson's ratio", 0.3, 0.45, 0.49, 0.499, 0.4999)
def poisson(nu: float) -> Scene:
    """Nearly incompressible bodies."""
    return punch_on_ground(steps=4, depth=0.08, nu=nu)


@family("unload and touch again: steps per leg", 1, 4)
def unload(count: int) -> Scene:
    """Down, up, aside, down, up."""
    low, high = -0.08, 0.1
    path = legs(
        *(
            (count, (x, y, 0.0))
            for x, y in ((0.0, low), (0.0, high), (0.3, high), (0.3, low), (0.3, high))
        )
    )
    scene = punch_on_ground(
        steps=5 * count,
        check=lambda posed: "" if not posed.forces.any() else "force after unloading",
    )
    return replace(scene, supports=[FIXED, Support(["punch/top"], path)])


@family("unit of length", 1e-6, 1e-3, 1, 1e3, 1e6)
def unit_of_length(scale: float) -> Scene:
    """The punch in other units of length."""
    return punch_on_ground(steps=4, depth=0.12).scaled(scale, 1.0)


@family("unit of stress", 1e-6, 1, 1e6, 1e12)
def unit_of_stress(scale: float) -> Scene:
    """The punch in other units of stress."""
    return punch_on_ground(steps=4, depth=0.12).scaled(1.0, scale)


def egg() -> fm.Spline:
    """An ellipse on its side, turned by 60 degrees."""
    t = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    x = turned(np.column_stack([0.4 * np.cos(t), 0.25 * np.sin(t)]), 60.0)
    return fm.Spline(x - [-0.03, x[:, 1].min() - 0.01], name="tool")


# Rigid tools, and their further driven motions
TOOLS: dict[str, tuple[Callable[[], fm.Obstacle], dict[str, float]]] = {
    "roller": (lambda: fm.Circle((0.0, 0.55), 0.5, name="tool"), {}),
    "corner": (
        lambda: fm.Polygon([(0.9, 0.85), (0.0, 0.05), (-0.6, 0.85)], 0.05, name="tool"), {},
    ),
    "loose plate": (lambda: fm.Plane((0.15, 0.05), (0.1, -1.0), name="tool"), {"moment": 0.0}),
    "free egg": (egg, {"x": 0.0, "moment": 0.0}),
}  # fmt: skip


@family("rigid tool by force: tool, force / (E width)", *(
    f"{tool}, {force}" for tool in TOOLS for force in (0.01, 0.05, 0.2)
))  # fmt: skip
def rigid_tool(value: str) -> Scene:
    """The tool comes from a distance; the plate is tilted and off its middle; the egg rolls."""
    tool, part = value.split(", ")
    make, loose = TOOLS[tool]
    force = -1.6 * float(part)
    return Scene(
        bodies=[ground(16, 6, width=1.6, height=0.8)],
        pairs=[("ground/top", "tool")],
        supports=[FIXED],
        steps=4,
        motions=[Tool("tool", make, {"y": force} | loose)],
        check=lambda posed: expect("force", posed.forces[0, 1], force, 1e-5),
    )


@family("few facets on a round master: facets", 3, 5)
def coarse_on_round(facets: int) -> Scene:
    """Three facets of the slave on a convex master: active sets tend to cycle."""
    dome = mapped(
        24, 5, lambda s, t: (2.0 * (s - 0.5), -0.8 + (0.8 - 0.5 * (2.0 * (s - 0.5)) ** 2 / 1.5) * t)
    )
    return two_blocks(
        block(facets, 3, width=1.0, height=0.6, corner=(-0.45, 0.0)), dome, down(0.2), 4
    )


@family("ranks", 1, 2, 3, 4, 5, methods=("default", "saddle", "standard"))
def ranks(count: int) -> Scene:
    """Ironing with a partly covered surface: equal iterations and forces on any number of ranks."""
    return replace(ironing(1), ranks=count)
