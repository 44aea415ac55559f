# SPDX-License-Identifier: MIT
"""Assemblies supported by friction: arches, walls, T-junctions, towers."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scenes import linear_elastic, rotation
from supported_parts import Body, Flat, Touch, structure
from supported_problem import NU, Assembly, floor_of, pose

import fenics_mortar as fm
from demos.studies.stability.limit_analysis import judge
from meshes.mapped_grids import Grid, block, sector


def arch(
    thickness: float = 0.15,
    number: int = 7,
    mu: float = 0.8,
    *,
    n: int = 1,
    rows: int = 2,
    E: float = 1e6,
    weight: float = 1.0,
    **options: Any,
) -> Assembly:
    """A semicircular arch of voussoirs with mean radius one, on rigid springings."""
    law = fm.Coulomb(mu)
    angles = np.linspace(0.0, np.pi, number + 1)
    radii = (1.0 - 0.5 * thickness, 1.0 + 0.5 * thickness)
    bodies = [
        Body(
            Grid(f"v{k}", sector(n, rows + k % 2, radii=radii, angles=(angles[k], angles[k + 1]))),
            weight=weight / number,
        )
        for k in range(number)
    ]
    springing = Flat((0.0, 0.0), (0.0, 1.0), "springing")
    touches = [Touch(f"v{k}/right", f"v{k + 1}/left", law) for k in range(number - 1)]
    touches += [Touch("v0/left", springing, law), Touch(f"v{number - 1}/right", springing, law)]
    return pose(
        f"arch t/R={thickness:g} n={number} mu={mu:g}", bodies, touches, [{"weight": 1.0}], E=E,
        **options,
    )  # fmt: skip


def wall(
    rows: int = 2,
    cols: int = 2,
    mu: float = 0.6,
    *,
    push: float = 0.25,
    load: str = "all",
    base: str = "plane",
    cells: Sequence[int] = (4,),
    layers: int = 2,
    upright: bool = True,
    size: tuple[float, float] = (1.0, 0.5),
    press: float | None = None,
    weight: float = 1.0,
    friction: bool = True,
    E: float = 1e4,
    **options: Any,
) -> Assembly:
    """Bricks in running bond; odd rows begin and end with half a brick.

    Weight one per brick, then a push of the fraction ``push`` of mu times the weight.

    Args:
        rows, cols: Rows, and whole bricks in the lowest one.
        mu: Friction of all joints.
        push: Force along x over mu times the weight [1].
        load: Which bricks are pushed: "all", or the "top" row.
        base: "plane" or "body".
        cells: Facets along a whole brick, for successive bricks.
        layers: Cells over the height of a brick.
        upright: Whether the upright joints are paired; else they are open by 1 % of the width.
        size: Width and height of a brick.
        press: Force of jaws at both sides, rigid planes; none by default.
        weight: Weight of a whole brick.
        friction: Whether there is friction at all.
        E: Young's modulus.
    """
    law = fm.Coulomb(mu) if friction else None
    width, height = size
    places: list[list[tuple[str, float, float]]] = []
    bodies, count = [], 0
    for r in range(rows):
        ends = [0.0, *(width * (k + 0.5) for k in range(cols)), cols * width]
        ends = [k * width for k in range(cols + 1)] if r % 2 == 0 else ends
        line = []
        for c, (a, b) in enumerate(itertools.pairwise(ends)):
            part = (b - a) / width
            b -= 0.01 * width * (not upright and c < len(ends) - 2)  # bulging bricks do not meet
            n = max(round(part * cells[count % len(cells)]), 1)
            x = block(n, layers, width=b - a, height=height, corner=(a, r * height))
            pushed = part * weight if load == "all" or r == rows - 1 else 0.0
            bodies.append(Body(Grid(f"b{r}_{c}", x), weight=part * weight, push=pushed))
            line.append((f"b{r}_{c}", a, b))
            count += 1
        places.append(line)
    under, floor = floor_of(
        base, width=(cols + 1.0) * width, columns=2 * cols + 3, left=-0.5 * width
    )
    touches = [Touch(f"{name}/bottom", floor, law) for name, *_ in places[0]]
    for low, high in itertools.pairwise(places):
        touches += [
            Touch(f"{one}/bottom", f"{other}/top", law)
            for one, a, b in high
            for other, c, d in low
            if min(b, d) - max(a, c) > 1e-6 * width
        ]
    if upright:
        touches += [
            Touch(f"{one[0]}/right", f"{other[0]}/left", law)
            for line in places
            for one, other in itertools.pairwise(line)
        ]
    if press is not None:
        left = Flat((0.0, 0.0), (1.0, 0.0), "left jaw")
        right = Flat((cols * width, 0.0), (-1.0, 0.0), "right jaw", force=(-press, 0.0))
        touches += [Touch(f"{line[0][0]}/left", left, law) for line in places]
        touches += [Touch(f"{line[-1][0]}/right", right, law) for line in places]
    pushes = sum(body.push for body in bodies)
    share = push * mu * sum(b.weight for b in bodies) / pushes
    if load == "top":
        share = push * mu
    path = [{"weight": 1.0}] + ([{"weight": 1.0, "push": share}] if push else [])
    return pose(
        f"wall {rows}x{cols} ({count} bricks) mu={mu:g} push={push:g} {load} {base}"
        f" cells={','.join(map(str, cells))}{'' if upright else ' no upright joints'}"
        f"{'' if press is None else f' jaws={press:g}'}{'' if friction else ' frictionless'}",
        [*bodies, *under],
        touches,
        path,
        E=E,
        small=5.0 * (rows * weight * (1.0 + push * mu) + (press or 0.0)) / E,
        **options,
    )


def t_junction(
    cells: Sequence[int] = (3, 3, 5),
    mu: float = 0.5,
    *,
    slave: str = "upper",
    pressure: float = 1.0,
    side: float | None = 0.0,
    material: Callable[..., Any] | None = None,
    E: float = 1e3,
    layers: int = 2,
    joint_slave: str = "A",
    **options: Any,
) -> Assembly:
    """C on A and B side by side, with friction everywhere: a homogeneous state without slip.

    A and B stand on a frictionless guide, A's left side is fixed along x; ``pressure`` on C's top,
    ``side`` on the right sides of B and C and the left one of C [stress]; ``None`` fixes these
    along x instead. The exact solution is a linear displacement, with ``pressure`` on the level
    joint per reference length and ``side`` on the upright one; see ``t_junction_exact``.

    Args:
        cells: Facets along A, B and C.
        slave: "upper": C is the slave of A and B, "lower": A and B are.
        joint_slave: Which side of the upright joint is the slave.
    """
    law = fm.Coulomb(mu)
    a, b, c = cells
    bodies = [
        Body(Grid("A", block(a, layers, width=1.0, height=1.0, corner=(-1.0, 0.0)))),
        Body(Grid("B", block(b, layers + 1, width=1.0, height=1.0))),
        Body(Grid("C", block(c, layers, width=2.0, height=1.0, corner=(-1.0, 1.0)))),
    ]
    level = [("C/bottom", "A/top"), ("C/bottom", "B/top")]
    if slave == "lower":
        level = [pair[::-1] for pair in level]
    joint = ("A/right", "B/left") if joint_slave == "A" else ("B/left", "A/right")
    prescribed = [("A/bottom", 1, 0.0), ("B/bottom", 1, 0.0), ("A/left", 0, 0.0)]
    loaded = ["C/top", "B/right", "C/right", "C/left"]
    sides = "fixed" if side is None else f"{side:g}"
    if side is None:
        prescribed += [(name, 0, 0.0) for name in loaded[1:]]
        loaded, side = loaded[:1], pressure * NU / (1.0 - NU)
    scene = pose(
        f"T-junction cells={','.join(map(str, cells))} mu={mu:g} side={sides} slave={slave}"
        f",{joint_slave}",
        bodies,
        [Touch(*pair, law) for pair in (*level, joint)],
        [{}],
        E=E,
        material=material or linear_elastic,
        traction=loaded,
        prescribed=prescribed,
        small=20.0 * (pressure + side) / E,
        note=lambda scene: f"pressure off by {t_junction_error(scene):.1e}",
        wrong=lambda scene: "pressure" if t_junction_error(scene) > 1e-6 else "",
        **options,
    )
    R = rotation(scene.turn)
    for name, direction, size in (
        ("C/top", (0.0, -1.0), pressure),
        ("B/right", (-1.0, 0.0), side),
        ("C/right", (-1.0, 0.0), side),
        ("C/left", (1.0, 0.0), side),
    ):
        if name in loaded:
            scene.traction[name].value[:] = size * R @ direction
    scene.exact = t_junction_exact(pressure, side, E)  # type: ignore[attr-defined]
    return scene


def t_junction_exact(pressure: float, side: float, E: float) -> dict[str, float]:
    """Strains, and pressures per deformed length of the joints, by linear elasticity."""
    strain_x = (1.0 + NU) / E * (-(1.0 - NU) * side + NU * pressure)
    strain_y = (1.0 + NU) / E * (-(1.0 - NU) * pressure + NU * side)
    return {
        "strain_x": strain_x,
        "strain_y": strain_y,
        "level": pressure / (1.0 + strain_x),
        "upright": side / (1.0 + strain_y),
    }


def t_junction_error(scene: Assembly) -> float:
    """Largest error of pressure and shear at nodes that carry any, over the largest pressure."""
    exact, worst = scene.exact, 0.0  # type: ignore[attr-defined]
    for contact, what in zip(scene.problem.equations.contacts, ("level", "level", "upright")):
        on = contact.multiplier_nodes & contact.covered
        z_n, z_tau = contact.pressure[on], contact.z_tau[on]
        worst = max(worst, np.abs(z_n - exact[what]).max(), np.abs(z_tau).max())
    return float(worst / max(exact["level"], exact["upright"]))


def tower(
    seed: int = 1,
    *,
    part: float = 0.5,
    base: str = "plane",
    E: float = 1e5,
    **options: Any,
) -> Assembly:
    """4 to 8 blocks with random sizes, offsets and friction; then a lateral force.

    ``part``: lateral force, distributed like the weight, over the limit load [1].
    """
    rng = np.random.default_rng(seed)
    while True:
        bodies, touches = _tower(rng, base)
        directions = {"gravity": np.array([0.0, -1.0]), "push": np.array([1.0, 0.0])}
        found = judge(structure(bodies, touches, directions, {"weight": 1.0}, {"push": 1.0}))
        if found.feasible and found.factor > 0.02:
            break
    size = part * found.factor
    return pose(
        f"tower seed={seed} blocks={sum(not b.clamped for b in bodies)} part={part:g} {base}",
        bodies,
        touches,
        [{"weight": 1.0}, {"weight": 1.0, "push": size}],
        E=E,
        small=100.0 * sum(body.weight for body in bodies) / E,
        **options,
    )


def _tower(rng: np.random.Generator, base: str) -> tuple[list[Body], list[Touch]]:
    """A tower that may stand or not."""
    under, floor = floor_of(base, width=4.0, columns=9, left=-2.0)
    mu, x, y = rng.uniform(0.2, 0.9), 0.0, 0.0
    bodies, touches, before = [], [], floor
    width = rng.uniform(0.8, 1.4)
    for k in range(rng.integers(4, 9)):
        height = rng.uniform(0.3, 0.8)
        n = int(rng.integers(2, 6))
        grid = block(n, 2, width=width, height=height, corner=(x - 0.5 * width, y))
        weight = width * height
        bodies.append(Body(Grid(f"b{k}", grid), weight=weight, push=weight))
        touches.append(Touch(f"b{k}/bottom", before, fm.Coulomb(mu * rng.uniform(0.8, 1.2))))
        before, y = f"b{k}/top", y + height
        wide = width * rng.uniform(0.8, 1.1)
        x, width = x + rng.uniform(-0.2, 0.2) * width, wide
    return [*bodies, *under], touches
