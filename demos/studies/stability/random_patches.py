# SPDX-License-Identifier: MIT
"""Random blocks that are pressed onto others in space and pulled in any direction with friction.

Flat or curved blocks, turned about the vertical, are pressed and pulled. In the last step some turn
with what they stand on: forces turn with them, and nothing slips. Judged by own distances and sums;
a flat block on a rigid plane that slides transfers the friction limit against the pull.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from demos.studies.stability.physics import differs, size
from demos.studies.stability.random_bodies import Array
from demos.studies.stability.random_towers import draw_cells, draw_frame
from demos.studies.stability.space_case import (
    Friction,
    Motion,
    Solid,
    SpaceCase,
    Tool,
    moving,
)
from demos.studies.stability.space_runs import AGAIN, ALONE, Run, solver
from demos.studies.stability.space_scene import turned
from meshes.mapped_boxes import Box, block, mapped

# Largest difference of the force of a block that slides from the friction limit along the pull, by
# degree [1]: it bends and turns a little as it starts to slide.
OF_LIMIT = 0.1
# Rise of a round block over a facet, times its radius [unit^2].
SAG = 0.05
# Largest change of forces by a common rotation [1]: facets that are curved have other partners.
OF_TURN = 1e-3


def draw_patches(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[..., Any]]:
    """Draw two blocks, or one on a plane, and the judge."""
    cell, degree = draw_cells(rng)
    on_plane = bool(rng.random() < 0.4)
    depth, mu = size(rng, 1e-4, 0.03), float(rng.choice([0.0, *rng.uniform(0.1, 1.0, 3)]))
    shear = depth * rng.uniform(0.05, 0.5) if rng.random() < 0.2 else 0.0
    # Round blocks rise less over a facet than they are pressed.
    least = max(1.5, SAG / depth)
    radii = [float(rng.choice([np.inf, size(rng, least, 10.0 * least)])) for _ in range(2)]
    h = rng.uniform(0.3, 0.6)
    upper = _cap(rng, degree, radii[0], rng.uniform(0.5, 0.9, 2), h)
    upper = turned(upper, (0.0, 0.0, rng.uniform(-0.8, 0.8)), np.zeros(3))
    gap = float(rng.choice([0.0, 0.0, depth * rng.uniform(0.0, 1.0), -1e-3 * depth]))
    upper = upper + np.append(rng.uniform(-0.1, 0.1, 2), gap)
    angle = rng.uniform(-np.pi, np.pi)
    far = float(rng.choice([0.5, 2.0, 6.0])) * depth * max(mu, 0.1)
    pull = far * np.array([np.cos(angle), np.sin(angle), 0.0])
    down = np.array([0.0, 0.0, -depth - gap])
    moves = [down, down + pull]
    last = str(rng.choice(["", "across", "together"]))
    middle, spin = np.array([0.0, 0.0, 0.2]), rng.uniform(-0.5, 0.5, 3)
    if last == "across":
        moves.append(down + pull + np.cross((0.0, 0.0, 1.0), pull))
    elif last == "together":
        moves.append(down + pull)
    # In every part of the last step it turns like the ground, about the middle before it moved.
    motion = moving(*moves, about=middle - down - pull)
    motion.moves[3:, 3:] = spin if last == "together" else 0.0
    ground = _turning(len(moves), middle, spin if last == "together" else 0.0 * spin)
    E = size(rng, 0.1, 10.0)
    solids = [Solid(Box("upper", upper), E, rng.uniform(0.0, 0.4))]
    tools, held = {}, {"upper/top": motion}
    pair = ("upper/bottom", "plane" if on_plane else "lower/top")
    if on_plane:
        tools["plane"] = Tool("plane", np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.0, ground)
    else:
        lower = Box("lower", _cap(rng, degree, radii[1], np.array([1.3, 1.3]), -0.4))
        solids.append(Solid(lower, 1.0, rng.uniform(0.0, 0.4)))
        held["lower/bottom"] = ground
    way = str(rng.choice(ALONE if on_plane else AGAIN))
    about = {
        "scene": f"{'plane' if on_plane else 'block'} {last}".strip(), "cell": cell,
        "degree": degree, "depth": depth, "mu": mu, "shear": shear, "radii": radii, "gap": gap,
        "far": far, "angle": angle, "E": E, "facets": upper.shape, "again": way,
    }  # fmt: skip
    case = SpaceCase(
        about, solids, [pair], [Friction(mu, shear)], held, tools, cell, degree,
        float(len(moves)), int(rng.integers(1, 4)), draw_frame(rng), depth,
    )  # fmt: skip
    if rng.random() < 0.4 and case.can_be_swapped:
        case = case.swapped()
        about["slave"] = "lower"
    return about, solver(case, way, int(rng.integers(2**31)), _check(case, pull, last, spin))


def _turning(times: int, middle: Array, spin: Array) -> Motion:
    """No motion but a rotation in the last unit of time."""
    moves = np.zeros((times + 1, 6))
    moves[-1, 3:] = spin
    return Motion(moves, middle)


def _cap(rng: np.random.Generator, degree: int, radius: float, sides: Array, height: float) -> Any:
    """A block around x = y = 0 from z = 0 to a height, round at z = 0; below if negative."""
    n = [int(m) for m in (rng.integers(3, 6, 2) if degree == 1 else rng.integers(2, 4, 2))]
    options = {"jiggle": float(rng.choice([0.0, 0.2])), "seed": int(rng.integers(100))}
    if not np.isfinite(radius):
        corner = (*(-0.5 * sides), min(height, 0.0))
        return block((*n, 1), size=(*sides, abs(height)), corner=corner, **options)

    def position(s: Array, t: Array, r: Array) -> list[Array]:
        x, y = sides[0] * (s - 0.5), sides[1] * (t - 0.5)
        sag = np.sign(height) * (radius - np.sqrt(radius**2 - x**2 - y**2))
        part = r if height > 0.0 else 1.0 - r
        return [x, y, (1.0 - part) * sag + part * height]

    return mapped((*n, 1), position, **options)


def _check(case: SpaceCase, pull: Array, last: str, spin: Array) -> Callable[[Run], Iterator[str]]:
    """Forces of sliding on a plane and of common rotations."""
    rule = case.laws[0]

    def check(run: Run) -> Iterator[str]:
        time, force = len(run.forces), run.forces[-1][0]
        view = run.scene.problem.contacts[0]
        flat = case.tools and not np.isfinite(case.about["radii"][0])
        if time == 2 and flat and rule.mu and not rule.shear and not view.sticking.any():
            along = pull / np.linalg.norm(pull)
            limit = -rule.mu * force[2] * along
            yield from differs("friction", force[:2], limit[:2], OF_LIMIT)
        if time == 3 and last == "together":
            turn = Rotation.from_rotvec(spin)
            yield from differs("the turned force", force, turn.apply(run.forces[1][0]), OF_TURN)

    return check
