# SPDX-License-Identifier: MIT
"""Scenes of bodies supported by friction or adhesion, each with the verdict of limit analysis.

    python3 tests/common/supported.py               all scenes, a row for each step
    python3 tests/common/supported.py wall tower    scenes whose names begin with these words

A scene is created in a local frame and rotated as a whole. Its loads are dead: the weight of
bodies, a push on some of them and a torque, all distributed over the body; ``Assembly.set`` sets
their size. ``Assembly.path`` has the loads of its steps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scenes import rotation
from supported_parts import Array, Body, Flat, Glue, Touch
from supported_problem import Assembly, floor_of, pose
from supported_walls import arch, t_junction, tower, wall

import fenics_mortar as fm
from meshes.mapped_grids import Grid, block, mapped, sector

__all__ = [
    "arch", "block_and_wall", "hanging", "incline", "jaws", "ladder", "pressed", "t_junction",
    "tower", "wall", "wheel",
]  # fmt: skip


def incline(
    slope: float = 0.4,
    mu: float = 0.5,
    base: str = "plane",
    *,
    width: float = 1.0,
    height: float = 0.5,
    n: int = 4,
    rows: int = 2,
    n_base: int = 7,
    weight: float = 1.0,
    turn: float | None = None,
    **options: Any,
) -> Assembly:
    """A block on an incline; by default turned so that gravity points down."""
    bodies, floor = floor_of(base, width=3.0 * width, columns=n_base, left=-width)
    grid = Grid("block", block(n, rows, width=width, height=height))
    bodies = [Body(grid, weight=weight), *bodies]
    return pose(
        f"incline tan={np.tan(slope):.3f} mu={mu:g} {base}",
        bodies,
        [Touch("block/bottom", floor, fm.Coulomb(mu))],
        [{"weight": 1.0}],
        gravity=(np.sin(slope), -np.cos(slope)),
        turn=-slope if turn is None else turn,
        **options,
    )


def block_and_wall(
    push: float = 0.1,
    mu: float = 0.5,
    base: str = "plane",
    *,
    gap: float = 0.3,
    width: float = 1.0,
    height: float = 0.5,
    n: int = 4,
    rows: int = 2,
    n_base: int = 9,
    weight: float = 1.0,
    at_once: bool = False,
    **options: Any,
) -> Assembly:
    """A block pushed towards a frictionless wall."""
    bodies, floor = floor_of(base, width=3.0 * width, columns=n_base, left=-width)
    grid = Grid("block", block(n, rows, width=width, height=height))
    wall = Flat((width + gap, 0.0), (-1.0, 0.0), "wall")
    path = [{"weight": 1.0}, {"weight": 1.0, "push": push}]
    return pose(
        f"block and wall push={push:g} mu={mu:g} {base}{' at once' if at_once else ''}",
        [Body(grid, weight=weight, push=1.0), *bodies],
        [Touch("block/bottom", floor, fm.Coulomb(mu)), Touch("block/right", wall)],
        path[1:] if at_once else path,
        stop=gap,
        note=lambda scene: f"wall force {-scene.force(1)[0]:.3g}",
        wrong=wall_force,
        **options,
    )


def wall_force(scene: Assembly) -> str:
    """Force on the wall: the push minus friction after sliding; zero for a sticking block."""
    push, (slid, *_) = scene.path[-1].get("push", 0.0), scene.motion("block")
    slid = slid > 0.5 * scene.stop
    pushed = scene.push.value @ rotation(scene.turn)[:, 0]
    exact = max(pushed - scene.touches[0].law.mu, 0.0) if slid else 0.0
    found = -scene.force(1)[0]
    size = max(abs(push), 1e-300)
    return (
        f"wall force {found:.3g} instead of {exact:.3g}" if abs(found - exact) > 0.02 * size else ""
    )


def wheel(
    part: float = 0.01,
    mu: float = 0.3,
    groove: str = "planes",
    *,
    radius: float = 1.0,
    n: int = 24,
    n_groove: int = 8,
    weight: float = 1.0,
    **options: Any,
) -> Assembly:
    """A wheel in a right-angled groove under a fraction of its limit torque."""
    x = sector(n, 2, radii=(0.4 * radius, radius))
    most = np.sqrt(2.0) * mu / (1.0 + mu**2) * weight * radius
    bottom = -np.sqrt(2.0) * radius
    half = np.sqrt(0.5) * radius
    places = [(half, -half), (-half, -half)]
    law, bodies, touches = fm.Coulomb(mu), [], []
    wheel = Body(Grid("wheel", x, closed=True), weight=weight, torque=most)
    if groove == "planes":
        for side, place in zip((1.0, -1.0), places):
            flat = Flat((0.0, bottom), (-side, 1.0), "right" if side > 0 else "left")
            touches.append(Touch("wheel/bottom", flat, law, at=[place]))
    else:

        def shape(s: Array, t: Array) -> tuple[Array, Array]:
            across = 1.5 * radius * (2.0 * s - 1.0)
            top = bottom + np.abs(across)
            return across, bottom - radius + t * (top - bottom + radius)

        notch = Grid("groove", mapped(n_groove, 3, shape))
        bodies.append(Body(notch, clamped=("bottom",)))
        touches.append(Touch("wheel/bottom", "groove/top", law, at=places))
    return pose(
        f"wheel torque={part:g} mu={mu:g} {groove}",
        [wheel, *bodies],
        touches,
        [{"weight": 1.0}, {"weight": 1.0, "torque": part}],
        note=lambda scene: f"turned {scene.motion('wheel')[2]:.2g}",
        reserve=np.inf,  # a polygon rests on its facets, and a dead couple decreases with rotation
        **options,
    )


def ladder(
    angle: float = 1.0,
    mu: float = 0.4,
    *,
    length: float = 1.0,
    thick: float = 0.05,
    n: int = 8,
    rows: int = 1,
    base: str = "plane",
    on_corner: bool = False,
    weight: float = 1.0,
    E: float = 1e5,
    **options: Any,
) -> Assembly:
    """A beam at an angle ``angle`` [radian] above a rough floor, against a frictionless wall.

    On a plane it stands on its corner; on a body on a level foot, or ``on_corner`` with its end and
    its lower side as slave.
    """
    square = base == "plane" or on_corner
    e = np.array([np.cos(angle), np.sin(angle)])
    across = thick * np.array([-e[1], e[0]])
    head = length * e + (0.0 if square else np.array([thick / e[1], 0.0]))

    def shape(s: Array, t: Array) -> tuple[Array, Array]:
        low, high = head - length * e, head + across
        start = high - length * e if square else np.zeros(2)
        x = [(1 - t) * (a + s * (b - a)) + t * (c + s * (d - c))
             for a, b, c, d in zip(low, head, start, high)]  # fmt: skip
        return x[0], x[1]

    bodies, floor = floor_of(base, width=length, columns=4, left=-0.5 * length)
    wall = Flat(tuple(head), (-1.0, 0.0), "wall")
    at = [(0.0, 0.0)] if square else None
    joined = {"bottom": "ladder/left"} if on_corner else {}
    return pose(
        f"ladder tan={np.tan(angle):.3f} mu={mu:g} {base}",
        [Body(Grid("ladder", mapped(n, rows, shape), joined), weight=weight), *bodies],
        [
            Touch("ladder/left", floor, fm.Coulomb(mu), at=at),
            Touch("ladder/right", wall, at=[head]),
        ],
        [{"weight": 1.0}],
        E=E,
        small=0.5 * weight * length**3 / (E * thick**3),
        **options,
    )


def hanging(
    weight: float = 0.5,
    pull: float = 1.0,
    base: str = "plane",
    *,
    mu: float = 0.3,
    push: float = 0.0,
    width: float = 1.0,
    height: float = 0.5,
    fade: float = 0.01,
    n: int = 4,
    rows: int = 2,
    **options: Any,
) -> Assembly:
    """A block on an adhesive ceiling with the strength ``pull`` per width."""
    grid = Grid("block", block(n, rows, width=width, height=height, corner=(0.0, -height)))
    bodies = [Body(grid, weight=1.0, push=1.0)]
    ceiling: str | Flat = Flat((0.0, 0.0), (0.0, -1.0), "ceiling")
    if base == "body":
        x = block(5, 2, width=2.0 * width, height=height, corner=(-0.5 * width, 0.0))
        bodies.append(Body(Grid("ceiling", x), clamped=("top",)))
        ceiling = "ceiling/bottom"
    path = [{"weight": weight}] + ([{"weight": weight, "push": push}] if push else [])
    return pose(
        f"hanging weight={weight:g} pull={pull:g} {base}{f' push={push:g}' if push else ''}",
        bodies,
        [Touch("block/top", ceiling, Glue(mu, pull / width, fade))],
        path,
        **options,
    )


def jaws(
    weight: float = 0.5,
    force: float = 1.0,
    mu: float = 0.5,
    kind: str = "planes",
    *,
    blocks: int = 1,
    width: float = 1.0,
    height: float = 0.5,
    n: int = 3,
    E: float = 1e4,
    **options: Any,
) -> Assembly:
    """Blocks in a row between two jaws that a force presses together; weight in a second step."""
    law = fm.Coulomb(mu)
    row = [
        Body(
            Grid(
                f"block{k}", block(3, n + k % 2, width=width, height=height, corner=(k * width, 0))
            ),
            weight=1.0 / blocks,
        )
        for k in range(blocks)
    ]
    touches = [Touch(f"block{k}/right", f"block{k + 1}/left", law) for k in range(blocks - 1)]
    end = blocks * width
    bodies, path = list(row), [{"weight": 0.0}, {"weight": weight}]
    if kind == "planes":
        touches += [
            Touch("block0/left", Flat((0.0, 0.0), (1.0, 0.0), "left"), law),
            Touch(
                f"block{blocks - 1}/right",
                Flat((end, 0.0), (-1.0, 0.0), "right", force=(-force, 0.0)),
                law,
            ),
        ]
    else:
        still = block(2, n + 2, width=width, height=2.0 * height, corner=(-width, -0.5 * height))
        moves = block(2, n + 2, width=width, height=2.0 * height, corner=(end, -0.5 * height))
        bodies += [
            Body(Grid("left", still), clamped=("left",)),
            Body(Grid("right", moves), push=1.0, guided=(("top", 1),)),
        ]
        touches += [
            Touch("block0/left", "left/right", law),
            Touch(f"block{blocks - 1}/right", "right/left", law),
        ]
        path = [{"push": -force}, {"push": -force, "weight": weight}]
    return pose(
        f"jaws weight={weight:g} force={force:g} mu={mu:g} {kind} blocks={blocks}",
        bodies,
        touches,
        path if weight else path[:1],
        E=E,
        small=20.0 * (force + weight) / E,
        **options,
    )


def pressed(
    push: float = 0.1,
    depth: float = 1e-4,
    mu: float = 0.5,
    base: str = "plane",
    *,
    width: float = 1.0,
    height: float = 0.5,
    n: int = 4,
    rows: int = 2,
    E: float = 1e4,
    **options: Any,
) -> Assembly:
    """A block whose top is moved down by ``depth``, free along x; supported by friction alone.

    ``push`` is a fraction of about mu times the pressing force.
    """
    bodies, floor = floor_of(base, width=3.0 * width, columns=7, left=-width)
    grid = Grid("block", block(n, rows, width=width, height=height))
    force = E * depth * width / height
    return pose(
        f"pressed push={push:g} mu={mu:g} {base}",
        [Body(grid, push=mu * force, guided=(("top", 1),)), *bodies],
        [Touch("block/bottom", floor, fm.Coulomb(mu))],
        [{}, {"push": push}],
        prescribed=[("block/top", 1, -depth)],
        small=20.0 * depth,
        E=E,
        note=lambda scene: (
            f"shear/pressure {-scene.force(0)[0] / max(scene.force(0)[1], 1e-300):.3g}"
        ),
        **options,
    )
