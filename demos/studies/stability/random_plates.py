# SPDX-License-Identifier: MIT
"""Random thin plates in space that are bent onto balls, cylinders and rings.

One or both ends are clamped and moved down, over a rigid obstacle or an elastic one. Judged by own
distances and sums.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from demos.studies.stability.physics import size
from demos.studies.stability.random_towers import draw_frame
from demos.studies.stability.space_case import Friction, Solid, SpaceCase, Tool, moving, still
from demos.studies.stability.space_runs import AGAIN, ALONE, Run, solver
from meshes.mapped_boxes import Box, block, mapped

# Part by which held ends are moved less as long as they would be moved into a tool [unit].
LESS = 0.01


def _depth(tool: Tool, ends: dict[str, Any], down: float) -> float:
    """Depth of nodes of the held ends in a tool after their motion [unit]."""
    x = np.concatenate([x.reshape(-1, 3) for x in ends.values()])
    return -float(tool.distance(x - (0.0, 0.0, down), 0.0).min())


def draw_plates(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[..., Any]]:
    """Draw a plate and its judge."""
    thick, width = size(rng, 0.02, 0.1), rng.uniform(0.3, 0.8)
    cell = str(rng.choice(["hexahedron", "hexahedron", "tetrahedron"]))
    n = [int(rng.integers(5, 9)), int(rng.integers(2, 4)), 1]
    kind = str(rng.choice(["sphere", "cylinder", "torus", "ball"]))
    radius = size(rng, 0.4, 2.0)
    gap = float(rng.choice([0.0, rng.uniform(0.0, 0.1)]))
    mu = float(rng.choice([0.0, rng.uniform(0.1, 0.6)]))
    both = bool(rng.random() < 0.5)
    # The obstacle is met by the middle of the plate, whose facets may bridge it.
    bend = rng.uniform(0.05, 0.2) * min(1.0, 0.5 / radius)
    plate = block(tuple(n), size=(1.0, width, thick), corner=(-0.5, -0.5 * width, gap))
    solids, tools = [Solid(Box("plate", plate), 1.0, rng.uniform(0.0, 0.4))], {}
    at, held = np.array([*rng.uniform(-0.1, 0.1, 2), -radius]), {}
    if not both:
        at[0] += 0.2
    if kind == "ball":
        solids.append(Solid(Box("ball", _ball(rng, radius, at)), size(rng, 1.0, 100.0), 0.3))
        held["ball/bottom"] = still()
    else:
        angle = rng.uniform(-0.5, 0.5)
        axis = np.array([np.sin(angle), np.cos(angle), 0.0])
        if kind == "torus":
            radius, axis = rng.uniform(0.15, 0.25), np.array([0.0, 0.0, 1.0])
            at[2] = -radius / 3.0
        tools["tool"] = Tool(kind, at, axis, radius, still())
    ends = {"plate/left": plate[0], "plate/right": plate[-1]} if both else {"plate/left": plate[0]}
    while tools and bend > 0.0 and _depth(tools["tool"], ends, bend + gap) > 0.0:
        bend -= LESS
    held |= {end: moving((0.0, 0.0, -bend - gap)) for end in ends}
    way = str(rng.choice(AGAIN if kind == "ball" else ALONE))
    about = {
        "scene": f"{kind} {'both' if both else 'one'}", "cell": cell, "cells": n, "thick": thick,
        "width": width, "radius": radius, "gap": gap, "mu": mu, "bend": bend, "again": way,
    }  # fmt: skip
    pair = ("plate/bottom", "ball/top" if kind == "ball" else "tool")
    case = SpaceCase(
        about, solids, [pair], [Friction(mu)], held, tools, cell, 2, 1.0, int(rng.integers(2, 5)),
        draw_frame(rng), bend * thick,
    )  # fmt: skip
    if rng.random() < 0.4 and case.can_be_swapped:
        case = case.swapped()
        about["slave"] = "ball"
    return about, solver(case, way, int(rng.integers(2**31)), _check)


def _ball(rng: np.random.Generator, radius: float, centre: Any) -> Any:
    """The upper part of a ball, flat below."""
    n, half = int(rng.integers(3, 5)), min(0.4, 0.6 * radius)
    low = radius - np.sqrt(radius**2 - 2.0 * half**2) + 0.2

    def position(s: Any, t: Any, r: Any) -> list[Any]:
        x, y = half * (2.0 * s - 1.0), half * (2.0 * t - 1.0)
        top = np.sqrt(radius**2 - x**2 - y**2) - radius
        return [x + centre[0], y + centre[1], -low + r * (top + low)]

    return mapped((n, n, 1), position)


def _check(run: Run) -> Iterator[str]:
    """What is below pushes the plate up."""
    sign = -1.0 if run.scene.case.pairs[0][0] == "plate/bottom" else 1.0
    force = sign * run.forces[-1][0]
    if not force[2] > 0.0:
        yield f"the plate is pulled down: {force}"
