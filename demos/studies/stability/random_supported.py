# SPDX-License-Identifier: MIT
"""Random problems of bodies supported by contact with friction alone, each from a seed.

First the weight grows until time 1, then another load. This load is drawn as a fraction of the
limit load of the rigid bodies, from small to above one. Existence of an equilibrium, and the time
at which it ends, are therefore known for each case.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from demos.studies.stability import supported_scenes as scenes
from demos.studies.stability.limit_analysis import judge
from demos.studies.stability.placement import draw_placement
from demos.studies.stability.supported_case import SupportedCase
from demos.studies.stability.supported_limits import rigid

# Largest displacement of elastic bodies over the sum of the loads over Young's modulus [1].
YIELDING = 60.0
DRAWN = [
    scenes.block,
    scenes.wall,
    scenes.tower,
    scenes.junction,
    scenes.groove,
    scenes.row,
    scenes.arch,
]


def hanging_case(seed: int) -> SupportedCase:
    """Draw a problem of blocks that hang by adhesion."""
    rng = np.random.default_rng([seed, 18])
    draw = scenes.hanging if rng.random() < 0.7 else scenes.glued
    return _placed(rng, _loaded(rng, draw(rng, seed)))


def supported_case(seed: int) -> SupportedCase:
    """Draw a problem; seeds are independent of those of ``random_case``."""
    rng = np.random.default_rng([seed, 17])
    draw = rng.choice(DRAWN)
    return _placed(rng, _loaded(rng, draw(rng, seed)))


def _loaded(rng: np.random.Generator, case: SupportedCase) -> SupportedCase:
    """Draw weight, another load as a fraction of the limit load, and stiffness."""
    areas = np.array([area for area, *_ in case.areas])
    free = np.array([body.name not in case.clamped for body in case.bodies])
    pressed = np.array([body.name == case.about.get("pressed") for body in case.bodies])
    total = areas[free].sum()
    dead, live = np.zeros((2, len(areas), 3))
    if pressed.any():
        dead[pressed, 0] = -total
        live[free & ~pressed, 1] = -areas[free & ~pressed]
    else:
        dead[free, 1] = -areas[free]
        where = free
        if rng.random() < 0.3:
            where = free & (np.arange(len(areas)) == rng.choice(np.flatnonzero(free)))
        angle = rng.choice([0.0, np.pi]) + rng.uniform(-0.4, 0.4)
        if "straight" in case.about:
            angle = -0.5 * np.pi
        live[where, :2] = areas[where, None] * np.array([np.cos(angle), np.sin(angle)])
    case = replace(case, loads=np.array([0.0 * dead, dead, dead + live]))
    verdict = judge(rigid(case))
    part = rng.uniform(0.05, 0.85) if rng.random() < 0.7 else rng.uniform(1.15, 1.6)
    most = verdict.factor if np.isfinite(verdict.factor) else 3.0
    size = part * max(most, 0.02)
    loads = np.array([0.0 * dead, dead, dead + size * live])
    end = 1.0 + verdict.factor / size if verdict.feasible else 0.0
    stiffness = total * 10.0 ** rng.uniform(3.5, 5.0)
    bodies = [replace(body, E=stiffness * 10.0 ** rng.uniform(0.0, 0.5)) for body in case.bodies]
    sizes = np.abs(loads[1]).sum() + np.abs(loads[2] - loads[1]).sum()
    step = float(rng.choice([0.25, 0.5, 1.0]))
    about = {
        "friction": [float(min(case.friction)), float(max(case.friction))],
        "stiffness": float(stiffness / total),
        "factor": float(verdict.factor),
        "part": float(part),
        "end": float(end),
        "step": step,
    }
    return replace(
        case, bodies=bodies, loads=loads, end=end, step=step,
        yielding=float(YIELDING * sizes / stiffness), about=case.about | about,
    )  # fmt: skip


def _placed(rng: np.random.Generator, case: SupportedCase) -> SupportedCase:
    """Rotate, translate and scale a problem; guides need directions along the axes."""
    placement = draw_placement(
        rng, guided=any(prescribed.component is not None for prescribed in case.prescribed)
    )
    rotation, length, stress = placement.rotation, placement.length, placement.stress
    bodies = list(map(placement.body, case.bodies))
    prescribed = [
        h
        if h.component is None
        else replace(h, component=int(np.abs(rotation[:, h.component]).argmax()))
        for h in case.prescribed
    ]
    planes = {name: (placement.points(x), n @ rotation.T) for name, (x, n) in case.planes.items()}
    loads = stress * length * case.loads
    loads[..., :2] = loads[..., :2] @ rotation.T
    loads[..., 2] *= length
    about = (
        case.about
        | placement.about(bodies)
        | {
            "bodies": len(bodies),
            "dofs": 2 * len(case.x),
        }
    )
    return replace(
        case, bodies=bodies, prescribed=prescribed, planes=planes, loads=loads,
        pulls=[stress * pull for pull in case.pulls], fade=length * case.fade,
        yielding=length * case.yielding, about=about,
    )  # fmt: skip
