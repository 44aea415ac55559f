# SPDX-License-Identifier: MIT
"""Random rough obstacles in space that are pressed into a block, then moved and turned.

Spheres, cylinders, rings and punches, extruded or revolved, at any angle; the whole scene may be
turned. Judged by own distances and by the sums of forces and moments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from demos.studies.stability.physics import size
from demos.studies.stability.random_towers import draw_cells, draw_frame
from demos.studies.stability.space_case import Friction, Solid, SpaceCase, Tool, moving, still
from demos.studies.stability.space_runs import ALONE, Run, solver
from demos.studies.stability.space_scene import turned
from meshes.mapped_boxes import Box, block

# Depth at which round obstacles surely press, times their radius [unit^2]: mean gaps of facets are
# closed.
SAG = 0.03
# The same with multipliers at corners alone, whose mean gaps reach over all facets around them.
SAG_LINEAR = 0.06
# Largest depth by kind [unit]: facets are larger than the edges of punches, and have to stay flat.
DEEPEST = {
    "sphere": 0.06, "cylinder": 0.06, "plane": 0.06, "torus": 0.02, "extruded": 0.02,
    "revolved": 0.02,
}  # fmt: skip


def draw_tools(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[..., Any]]:
    """Draw an obstacle above a block and its judge."""
    cell, degree = draw_cells(rng)
    kinds = ["sphere", "cylinder", "plane", "torus", "extruded", "revolved"]
    linear = (cell, degree) == ("tetrahedron", 2)  # multipliers at corners alone, on large facets
    kind = str(rng.choice(kinds[:3] if linear else kinds))
    n = [int(m) for m in rng.integers(4, 7, 2)] if degree == 1 else [3, 3]
    jiggle = float(rng.choice([0.0, 0.2]))
    x = block((*n, 2), size=(1.0, 1.0, 0.6), corner=(-0.5, -0.5, -0.6), jiggle=jiggle,
              seed=int(rng.integers(100)))  # fmt: skip
    x = turned(x, (0.0, 0.0, rng.uniform(-0.8, 0.8)), (0.0, 0.0, 0.0))
    mu = float(rng.choice([0.0, rng.uniform(0.1, 0.8)]))
    depth = size(rng, 0.004, DEEPEST[kind])
    tool, lift = _tool(rng, kind)
    if kind in ("sphere", "cylinder"):
        depth = max(depth, (SAG_LINEAR if linear else SAG) / tool.radius)
    angle, slide = rng.uniform(-np.pi, np.pi), depth * rng.uniform(0.0, 3.0)
    turn = depth * np.array([0.3, 0.3, 4.0]) * rng.uniform(-1.0, 1.0, 3)
    turn *= float(rng.choice([0.0, 1.0]))
    down = np.array([0.0, 0.0, -depth - lift])
    aside = slide * np.array([np.cos(angle), np.sin(angle), 0.0])
    along = np.append(down + aside, turn)
    about = tool.point.copy()
    motion = moving(down, along, about=about)
    tool = Tool(tool.kind, tool.point, tool.axis, tool.radius, motion, tool.first, tool.rounding)
    way = str(rng.choice(ALONE))
    drawn = {
        "scene": kind, "cell": cell, "degree": degree, "cells": n, "jiggle": jiggle, "mu": mu,
        "depth": depth, "radius": tool.radius, "axis": tool.axis.tolist(), "slide": slide,
        "turn": turn.tolist(), "rounding": tool.rounding, "again": way,
    }  # fmt: skip
    frame = draw_frame(rng)
    case = SpaceCase(
        drawn, [Solid(Box("block", x), 1.0, rng.uniform(0.0, 0.4))], [("block/top", "tool")],
        [Friction(mu)], {"block/bottom": still()}, {"tool": tool}, cell, degree, 2.0,
        int(rng.integers(1, 4)), frame, depth,
    )  # fmt: skip
    return drawn, solver(case, way, int(rng.integers(2**31)), _check)


def _tool(rng: np.random.Generator, kind: str) -> tuple[Tool, float]:
    """A tool that touches z = 0 or is above by the second number."""
    lift = float(rng.choice([0.0, rng.uniform(0.0, 0.05)]))
    at = np.append(rng.uniform(-0.1, 0.1, 2), lift)
    tilt = np.append(rng.uniform(-0.02, 0.02, 2), 1.0)
    up = tilt / np.linalg.norm(tilt)
    angle = rng.uniform(-np.pi, np.pi)
    level = np.array([np.cos(angle), np.sin(angle), 0.0])
    radius, rounding = rng.uniform(0.3, 1.0), 0.3
    first = None
    if kind in ("sphere", "cylinder"):
        radius = size(rng, 0.5, 5.0)
        at[2] += radius
        up = level if kind == "cylinder" else up
    elif kind == "torus":
        radius = rng.uniform(0.25, 0.35)
        at[2] += radius / 3.0
    elif kind == "plane":
        up = -up
    else:
        radius = rng.uniform(0.2, 0.3)
        first = np.cross(up, level)
        first /= np.linalg.norm(first)
    return Tool(kind, at, up, radius, still(), first, rounding), lift


def _check(run: Run) -> Iterator[str]:
    """The block pushes the tool up."""
    force = run.forces[-1][0]
    if not force[2] > 0.0:
        yield f"the tool is pulled down: {force}"
