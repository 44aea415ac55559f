# SPDX-License-Identifier: MIT
"""Random towers in space, on a plane or a held block: weights in any direction, pulls, no supports.

Blocks of a tower are turned about the vertical, and rest on each other by contact alone. The load
of each is inclined, and one of them is pulled aside until a part of the limit load of rigid bodies,
or beyond. Each contact carries all loads above it: that is the judge, by linear programs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.optimize import linprog

from demos.studies.stability.physics import differs, size
from demos.studies.stability.random_bodies import Array
from demos.studies.stability.space_case import (
    Frame,
    Friction,
    Solid,
    SpaceCase,
    Tool,
    random_turn,
    still,
)
from demos.studies.stability.space_runs import AGAIN, Run, solver
from demos.studies.stability.space_scene import turned, volume
from meshes.mapped_boxes import Box, block

# Directions of the pyramid within the cone of friction.
SIDES = 16
# Parts of the areas' sizes and of friction with which a tower certainly stands, and with which it
# certainly does not: nodal forces bear less than distributed ones, and edges bend.
SURE, NEVER = (0.75, 0.85), (1.1, 1.1)
# Largest motion of a tower that stands, over the load's strain times its height [1].
FARTHEST = 1000.0
# Largest error of the force on the ground over the load [1]: springs may carry what is negligible.
OF_LOAD = 5e-3
# Strain of the softest block above which blocks without friction may slide off each other [1]:
# edges of blocks press into each other, and surfaces tilt by some ten times the strain.
TILTS = 1e-4


def draw_frame(rng: np.random.Generator) -> Frame:
    """A frame turned in any way, in any units, or that of the drawing."""
    if rng.random() < 0.3:
        return Frame(np.eye(3), np.zeros(3), 1.0, 1.0)
    return Frame(
        random_turn(rng), rng.uniform(-2.0, 2.0, 3), size(rng, 1e-3, 1e3), size(rng, 1e-3, 1e9)
    )


def draw_cells(rng: np.random.Generator) -> tuple[str, int]:
    """Kind and degree."""
    return str(rng.choice(["tetrahedron", "hexahedron", "hexahedron"])), int(rng.integers(1, 3))


def draw_towers(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[..., Any]]:
    """Draw a tower and its judge."""
    cell, degree = draw_cells(rng)
    strain, mu = size(rng, 1e-6, 1e-3), float(rng.choice([0.0, *rng.uniform(0.1, 0.9, 3)]))
    on_plane = bool(rng.random() < 0.4)
    count = int(rng.integers(1, 4)) + on_plane
    boxes, areas = _blocks(rng, count, degree, on_plane)
    azimuth, tilt = rng.uniform(-np.pi, np.pi), 0.0
    if mu:
        tilt = float(rng.choice([0.0, rng.uniform(0.0, 0.75) * mu]))
    down = np.array([tilt * np.cos(azimuth), tilt * np.sin(azimuth), -1.0])
    weights = rng.choice([0.0, 1.0, rng.uniform(0.3, 3.0)], count)
    weights[rng.integers(count)] = 1.0
    solids = [Solid(box, 1.0, 0.3) for box in boxes]
    bodies = [volume(solid) for solid in solids]
    loads = np.array([w * v for w, (v, _) in zip(weights, bodies, strict=True)])
    centres = np.array([centre for _, centre in bodies])
    pull, level = np.zeros(3), int(rng.integers(count))
    low, high = (_factor(areas, centres, loads, down, None, mu, s) for s in (SURE, NEVER))
    standing = low >= 0.0
    fails = None if not standing else False
    if mu and standing and rng.random() < 0.7:
        angle = rng.uniform(-np.pi, np.pi)
        along = loads.sum() * np.array([np.cos(angle), np.sin(angle), rng.uniform(-0.2, 0.1)])
        low, high = (
            _factor(areas, centres, loads, down, (level, along), mu, s) for s in (SURE, NEVER)
        )
        beyond = degree == 1 and rng.random() < 0.2  # it is refused after long searches for a place
        factor = 1.02 * high + 0.02 if beyond else float(rng.choice([0.5, 0.9, 1.0])) * low
        fails = bool(factor > high) if low >= 0.0 else None
        pull = factor * along
    elif high < 0.0:
        fails = True
    solids = _loaded(solids, bodies, weights, strain, down, pull, level)
    stiff = [size(rng, 0.1, 10.0) for _ in solids]
    if not (mu or fails) and count > 1 and strain > TILTS * min(stiff):
        fails = None
    solids = [Solid(s.box, E, s.nu, s.force) for s, E in zip(solids, stiff, strict=True)]
    way = str(rng.choice(AGAIN))
    about = {
        "scene": f"{count} on {'a plane' if on_plane else 'a block'}", "cell": cell,
        "degree": degree, "strain": strain, "mu": mu, "tilt": tilt, "weights": weights.tolist(),
        "pull": (pull / loads.sum()).tolist(), "level": level, "fails": fails, "again": way,
        "facets": [b.x.shape for b in boxes],
    }  # fmt: skip
    tools, held = {}, {}
    names = [f"{box.name}/bottom" for box in boxes]
    tops = [f"{box.name}/top" for box in boxes]
    if on_plane:
        tools["plane"] = Tool("plane", np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.0, still())
        tops.insert(0, "plane")
    else:
        ground = Box("ground", block((4, 4, 1), size=(2.0, 2.0, 0.5), corner=(-1.0, -1.0, -0.5)))
        solids = [Solid(ground, 3.0, 0.3), *solids]
        tops.insert(0, "ground/top")
        held["ground/bottom"] = still()
    pairs = list(zip(names, tops[:-1], strict=True))
    case = SpaceCase(
        about, solids, pairs, [Friction(mu)] * count, held, tools, cell, degree,
        2.0 if pull.any() else 1.0, int(rng.integers(1, 3)), draw_frame(rng), strain,
    )  # fmt: skip
    if rng.random() < 0.3 and case.can_be_swapped:
        case = case.swapped()
        about["slave"] = "lower"
    check = _check(case, loads * strain, down, pull * strain, mu == 0.0)
    return about, solver(case, way, int(rng.integers(2**31)), check, fails)


def _blocks(
    rng: np.random.Generator, count: int, degree: int, on_plane: bool
) -> tuple[list[Box], list[Array]]:
    """Blocks from bottom to top, and the corners of each area of contact (n, 3), lowest first."""
    boxes, areas, z = [], [], 0.0
    below = None if on_plane else np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    at = np.zeros(2)
    for k in range(count):
        a, b, h = rng.uniform(0.6, 1.3), rng.uniform(0.6, 1.3), rng.uniform(0.25, 0.8)
        yaw = float(rng.choice([0.0, rng.uniform(-0.8, 0.8)]))
        at = at + rng.uniform(-0.12, 0.12, 2) * float(rng.choice([0.0, 1.0]))
        n = [int(m) for m in rng.integers(2, 5 if degree == 1 else 3, 2)]
        x = block((*n, 1), size=(a, b, h), corner=(at[0] - a / 2, at[1] - b / 2, z))
        x = turned(x, (0.0, 0.0, yaw), (*at, 0.0))
        outline = x[[0, -1, -1, 0], [0, 0, -1, -1], 0, :2]
        area = outline if below is None else clipped(outline, below)
        areas.append(np.column_stack([area, np.full(len(area), z)]))
        boxes.append(Box(f"b{k}", x))
        below, z = outline, z + h
    return boxes, areas


def clipped(polygon: Array, other: Array) -> Array:
    """Common part of two convex polygons (n, 2), both counter-clockwise."""
    for p, q in zip(other, np.roll(other, -1, axis=0), strict=True):
        inward = np.array([p[1] - q[1], q[0] - p[0]])
        found = []
        for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            s, t = (a - p) @ inward, (b - p) @ inward
            if s >= 0.0:
                found.append(a)
            if s * t < 0.0:
                found.append(a + (b - a) * s / (s - t))
        polygon = np.array(found)
    return polygon


def _loaded(
    solids: list[Solid], bodies: Any, weights: Array, strain: float, down: Array, pull: Array,
    level: int,
) -> list[Solid]:  # fmt: skip
    """Bodies with their weights at time 1 and the pull on one of them at time 2."""
    found = []
    for k, (solid, (own, _)) in enumerate(zip(solids, bodies, strict=True)):
        first = strain * weights[k] * down
        second = first + (strain * pull / own if k == level else 0.0)
        found.append(Solid(solid.box, solid.E, solid.nu, np.array([0.0 * first, first, second])))
    return found


def _factor(
    areas: list[Array], centres: Array, loads: Array, down: Array, pull: Any, mu: float,
    parts: tuple[float, float],
) -> float:  # fmt: skip
    """Largest factor of the pull that all areas of contact bear; -1 if not even the weights."""
    found = np.inf
    for k, area in enumerate(areas):
        own = area.mean(axis=0)
        points = own + parts[0] * (area - own)
        wrench = sum(
            _wrench(w * down, c - own) for w, c in zip(loads[k:], centres[k:], strict=True)
        )
        aside = np.zeros(6)
        if pull is not None and pull[0] >= k:
            aside = _wrench(pull[1], centres[pull[0]] - own)
        found = min(found, _limit(points - own, mu * parts[1], np.asarray(wrench), aside))
    return found


def _wrench(force: Array, at: Array) -> Array:
    return np.concatenate([force, np.cross(at, force)])


def _limit(points: Array, mu: float, wrench: Array, aside: Array) -> float:
    """Largest factor of ``aside`` that forces at points bear with ``wrench``, by a program."""
    angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
    edges = np.stack([mu * np.cos(angles), mu * np.sin(angles), np.ones(SIDES)], axis=1)
    if not mu:
        edges = edges[:1]
    columns = np.array([_wrench(edge, p) for p in points for edge in edges]).T
    scale = max(np.abs(wrench).max(), np.abs(aside).max()) or 1.0
    found = linprog(
        np.append(np.zeros(columns.shape[1]), -1.0),
        A_eq=np.column_stack([columns, aside / scale]), b_eq=-wrench / scale,
        bounds=[(0.0, None)] * columns.shape[1] + [(0.0, 1e3)], method="highs",
    )  # fmt: skip
    return float(found.x[-1]) if found.status == 0 else -1.0


def _check(
    case: SpaceCase, loads: Array, down: Array, pull: Array, drifts: bool
) -> Callable[[Run], Iterator[str]]:
    """The lowest contact bears all loads, and the tower stands where it was."""

    def check(run: Run) -> Iterator[str]:
        time, slave = len(run.forces), run.scene.case.pairs[0][0]
        sign = -1.0 if slave == "ground/top" else 1.0
        total = loads.sum() * down + (pull if time == 2 else 0.0)
        yield from differs("the force on the ground", sign * run.forces[-1][0], total, OF_LOAD)
        moved = np.abs(run.positions[-1] - run.positions[0]).max()
        if not drifts and not moved <= FARTHEST * case.strain:
            yield f"the tower moved by {moved / case.strain:.2g} strains"

    return check
