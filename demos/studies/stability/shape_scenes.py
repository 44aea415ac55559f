# SPDX-License-Identifier: MIT
"""Problems of thin, folded or coiled bodies and of pads, drawn by random numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from demos.studies.stability.case import Prescribed
from demos.studies.stability.random_bodies import Array, draw_cells
from demos.studies.stability.shape_case import ShapeCase, grips, motion_along, shape_case
from demos.studies.stability.shapes import Shape, box, mapped, strip
from demos.studies.stability.user_laws import Rule


def ring(rng: np.random.Generator, seed: int, family: str) -> ShapeCase:
    """A C-ring whose ends are moved together, and along each other."""
    thickness, gap = rng.uniform(0.08, 0.3), rng.uniform(0.03, 0.25)
    columns, rows = int(rng.integers(20, 45)), int(rng.integers(2, 6))
    # ends that are parallel: the first and the last part of the middle are straight
    angle = np.linspace(np.arcsin(gap / 2), 2 * np.pi - np.arcsin(gap / 2), columns + 1)
    middle = np.column_stack([np.cos(angle), np.sin(angle)])
    x = strip(middle, thickness, rows)
    x[:, [0, -1], 1] = [0.5 * gap, -0.5 * gap]
    body = mapped(rng, "ring", x, draw_cells(rng))
    grip = max(2, columns // 8)
    body = body.covered(first=body.sides["start"], last=body.sides["end"])
    outer = _side(body, x, 0)
    body = body.gripped(fixed=outer[1:grip], moved=outer[-grip:-1])
    push = rng.uniform(0.05, 0.3) * thickness
    slide = rng.choice([0.0, 1.0]) * rng.uniform(-0.3, 0.3) * thickness
    motion = motion_along([(0.0, gap + push), (slide, gap + push)])
    pairs = [("ring/first", "ring/last")]
    about = {"scene": "ring", "thickness": thickness, "gap": gap, "push": push / thickness}
    return shape_case(rng, seed, family, about, [body], pairs, grips("ring", motion))


def folds(rng: np.random.Generator, seed: int, family: str) -> ShapeCase:
    """A strip folded once or twice, whose arms are pressed together."""
    folds, thickness = int(rng.integers(1, 3)), rng.uniform(0.04, 0.12)
    gap, facet = rng.uniform(0.3, 1.5) * thickness, rng.uniform(0.04, 0.1)
    radius, length = 0.5 * (gap + thickness), 1.0
    line, parts = _folded(length, radius, folds, facet)
    x = strip(line, thickness, int(rng.integers(1, 4)))
    body = mapped(rng, "strip", x, draw_cells(rng))
    pairs, sides = [], {}
    for fold in range(folds):
        # the strip turns left round the first fold, right round the second
        inner = _side(body, x, -1 if fold % 2 == 0 else 0)
        lower, upper = (inner[parts[k] : parts[k + 1] + 1] for k in (2 * fold, 2 * fold + 2))
        sides |= {f"lower{fold}": lower, f"upper{fold}": upper}
        pairs.append((f"strip/lower{fold}", f"strip/upper{fold}"))
    body = body.covered(**sides)
    bottom, top = _side(body, x, 0), _side(body, x, -1 if folds == 2 else 0)
    first, last = bottom[parts[0] : parts[1] + 1], top[parts[-2] : parts[-1] + 1]
    some = max(2, len(last) // 3)
    where = last[-some:] if rng.random() < 0.5 else last[len(last) // 2 - some // 2 :][:some]
    body = body.gripped(fixed=first, moved=where)
    push = rng.uniform(0.05, 0.3) * thickness
    slide = rng.choice([0.0, 1.0]) * rng.uniform(-0.5, 0.5) * facet
    depth = -folds * gap - push
    motion = motion_along([(0.0, depth), (slide, depth)])
    about = {"scene": f"{folds} folds", "thickness": thickness, "gap": gap / thickness}
    return shape_case(rng, seed, family, about, [body], pairs, grips("strip", motion))


def _folded(length: float, radius: float, folds: int, facet: float) -> tuple[Array, list[int]]:
    """Middle of a folded strip, and the numbers of the points at which its parts begin and end."""
    along = max(round(length / facet), 4)
    around = max(round(np.pi * radius / facet), 6)
    points, parts = [np.zeros(2)], [0]
    heading = 1.0
    for arm in range(folds + 1):
        points += [points[-1] + [heading * length * k / along, 0.0] for k in range(1, along + 1)]
        parts.append(len(points) - 1)
        if arm < folds:
            centre, start = points[-1] + [0.0, radius], -0.5 * np.pi
            turn = start + heading * np.linspace(0.0, np.pi, around + 1)[1:]
            points += list(centre + radius * np.column_stack([np.cos(turn), np.sin(turn)]))
            parts.append(len(points) - 1)
            heading = -heading
    return np.array(points), parts


def spiral(rng: np.random.Generator, seed: int, family: str) -> ShapeCase:
    """Two windings of a spiral, the outer one pressed on the inner one."""
    thickness = rng.uniform(0.05, 0.12)
    pitch = thickness * rng.uniform(1.3, 2.2)
    turn = int(rng.integers(24, 40))
    angle = 2.0 * np.pi * np.arange(2 * turn + 1) / turn
    radius = 0.6 + pitch * angle / (2 * np.pi)
    middle = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    x = strip(middle, thickness, int(rng.integers(1, 3)))
    body = mapped(rng, "spiral", x, draw_cells(rng))
    inner, outer = _side(body, x, 0), _side(body, x, -1)
    # the last row is on the left of the curve: inside
    half = turn // 2
    body = body.covered(winding=inner[: turn + 1], around_it=outer[turn:])
    grip = max(2, turn // 12)
    place = turn + half + int(rng.integers(-turn // 6, turn // 6 + 1))
    moved = inner[place - grip : place + grip + 1]
    body = body.gripped(fixed=_side(body, x, -1)[half - half // 2 : half + half // 2], moved=moved)
    inward = -middle[place] / np.linalg.norm(middle[place])
    depth = pitch - thickness + rng.uniform(0.05, 0.25) * thickness
    motion = motion_along([depth * inward])
    pairs = [("spiral/winding", "spiral/around_it")]
    about = {"scene": "spiral", "thickness": thickness, "pitch": pitch / thickness}
    return shape_case(rng, seed, family, about, [body], pairs, grips("spiral", motion))


def _whole(body: Shape) -> Shape:
    """The body with its outline as one surface."""
    return body.covered(outline=body.sides["around"])


def plates(rng: np.random.Generator, seed: int, family: str) -> ShapeCase:
    """A thin plate pressed on a wider one, and moved along."""
    heights = rng.uniform(0.03, 0.15, 2)
    width, cells = rng.uniform(0.5, 1.0), draw_cells(rng)
    a, b = (int(n) for n in rng.integers(8, 20, 2))
    lower = mapped(rng, "lower", box(-0.8, -heights[0], 1.6, heights[0], a, 2), cells)
    gap = rng.choice([0.0, 1.0]) * rng.uniform(0.0, 0.3) * heights.min()
    upper = box(-0.5 * width, gap, width, heights[1], b, int(rng.integers(1, 4)))
    upper = mapped(rng, "upper", upper, cells, E=10.0 ** rng.uniform(-1.0, 1.0))
    depth = gap + rng.uniform(0.05, 0.4) * heights.min()
    slide = rng.choice([0.0, 1.0]) * rng.uniform(-0.2, 0.2)
    bodies = [_whole(lower), _whole(upper)]
    prescribed = [
        Prescribed("lower/low", np.zeros((2, 2))),
        Prescribed("upper/high", motion_along([(0.0, -depth), (slide, -depth)])),
    ]
    pairs = [("lower/outline", "upper/outline")]
    about = {"scene": "plates", "heights": heights.tolist(), "depth": depth / heights.min()}
    return shape_case(rng, seed, family, about, bodies, pairs, prescribed)


def _arms(rng: np.random.Generator, gap: float, overlap: float) -> list[Shape]:
    """Two arms whose ends are above each other, the right one higher."""
    cells, thickness = draw_cells(rng), rng.uniform(0.05, 0.12, 2)
    counts = rng.integers(8, 18, 2)
    left = box(-1.0, -thickness[0], 1.0, thickness[0], int(counts[0]), int(rng.integers(1, 3)))
    right = box(-overlap, gap, 1.0, thickness[1], int(counts[1]), int(rng.integers(1, 3)))
    return [
        _whole(mapped(rng, "left", left, cells)),
        _whole(mapped(rng, "right", right, cells, E=10.0 ** rng.uniform(-0.5, 0.5))),
    ]


def passing(rng: np.random.Generator, seed: int, family: str) -> ShapeCase:
    """An arm goes past another: aside, down, back below it; and perhaps up to meet it again."""
    overlap = rng.uniform(0.04, 0.3)
    bodies = _arms(rng, 0.0, overlap)
    down = -sum(float(np.ptp(body.x[:, 1])) for body in bodies) - rng.uniform(0.02, 0.1)
    aside = overlap + rng.uniform(0.02, 0.2)
    motion = [(aside, 0.05), (aside, down), (-rng.uniform(0.0, 0.3), down)]
    meets = rng.random() < 0.5
    if meets:
        motion.append((motion[-1][0], down + rng.uniform(0.12, 0.2)))
    prescribed = [
        Prescribed("left/start", np.zeros((2, 2))),
        Prescribed("right/end", motion_along(motion)),
    ]
    about = {"scene": "arm goes past", "overlap": overlap, "meets": meets}
    pairs = [("left/outline", "right/outline")]
    case = shape_case(rng, seed, family, about, bodies, pairs, prescribed)
    return replace(case, ends_free=not meets)


def catching(rng: np.random.Generator, seed: int, family: str) -> ShapeCase:
    """An arm is pressed upon another and bends it, or is lifted again."""
    overlap = rng.uniform(0.15, 0.5)
    gap = rng.choice([0.0, rng.uniform(0.0, 0.05)])
    bodies = _arms(rng, gap, overlap)
    depth, lifted = gap + rng.uniform(0.02, 0.2), rng.random() < 0.4
    motion = [(0.0, -depth)] + [(0.0, 0.1)] * lifted
    prescribed = [
        Prescribed("left/start", np.zeros((2, 2))),
        Prescribed("right/end", motion_along(motion)),
    ]
    about = {"scene": "arm on arm", "overlap": overlap, "depth": depth, "lifted": lifted}
    pairs = [("left/outline", "right/outline")]
    case = shape_case(rng, seed, family, about, bodies, pairs, prescribed)
    return replace(case, ends_free=lifted)


def hook(rng: np.random.Generator, seed: int, family: str) -> ShapeCase:
    """A barb on an arm is pushed over a ridge and rests behind it."""
    barb, wide = rng.uniform(0.05, 0.1), rng.uniform(0.3, 0.45)
    ridge_wide, ridge_high = wide + rng.uniform(0.0, 0.1), rng.uniform(0.05, 0.1)
    cells = draw_cells(rng)
    columns = [int(n) for n in rng.integers(30, 44, 2)]
    s, t = np.meshgrid(np.linspace(0, 1, columns[0] + 1), np.linspace(0, 1, 3))
    x = 2.0 * s
    low = -barb * _bump(x, wide, wide)
    hook = np.stack([x, low + (0.12 - low) * t], axis=-1)
    s, t = np.meshgrid(np.linspace(0, 1, columns[1] + 1), np.linspace(0, 1, 4))
    x = -1.7 + 1.5 * s
    high = ridge_high * _bump(x, -0.6, ridge_wide)
    catch = np.stack([x, -0.2 - barb + (0.2 + high) * t], axis=-1)
    bodies = [
        _whole(mapped(rng, "hook", hook, cells)),
        _whole(mapped(rng, "catch", catch, cells, E=10.0 ** rng.uniform(0.0, 1.0))),
    ]
    lift = rng.uniform(0.2, 0.5) * ridge_high
    prescribed = [
        Prescribed("catch/low", np.zeros((2, 2))),
        Prescribed("hook/end", motion_along([(-0.75, lift), (-1.5, lift)])),
    ]
    about = {"scene": "hook", "barb": barb, "wide": wide, "ridge": ridge_high}
    pairs = [("hook/outline", "catch/outline")]
    case = shape_case(rng, seed, family, about, bodies, pairs, prescribed)
    # the hook comes to rest behind the ridge; contact with the arm depends on lift
    return case


def _bump(x: Array, middle: float, width: float) -> Array:
    """A smooth bump of height one."""
    return np.cos(0.5 * np.pi * np.clip((x - middle) / width, -1.0, 1.0)) ** 2


def tubes(rng: np.random.Generator, seed: int, family: str) -> ShapeCase:
    """A tube in one that is too narrow for it, the pressure from Lame's solution."""
    walls, interference = rng.uniform(0.06, 0.2, 2), rng.uniform(1e-3, 4e-3)
    columns = 4 * int(rng.integers(6, 13))
    grids = []
    for low, high in ((1.0 - walls[0], 1.0 + interference), (1.0, 1.0 + walls[1])):
        angle = 2.0 * np.pi * np.arange(columns + 1) / columns
        r = np.linspace(low, high, int(rng.integers(2, 5)))[:, None]
        grids.append(np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1))
    cells = draw_cells(rng)
    ratio = 10.0 ** rng.uniform(-0.5, 0.5)
    inner = mapped(rng, "inner", grids[0], cells, closed=True)
    outer = mapped(rng, "outer", grids[1], cells, closed=True, E=ratio)
    softness = _widening(inner, 1.0 - walls[0], 1.0, False)
    softness += _widening(outer, 1.0, 1.0 + walls[1], True)
    prescribed = []
    for body, grid in ((inner, grids[0]), (outer, grids[1])):
        rows = np.arange(len(body.x)).reshape(grid.shape[0], columns)
        quarter = columns // 4
        chains = {f"q{k}": rows[:, k * quarter] for k in range(4)}
        body = body.gripped(**chains)
        prescribed += [
            Prescribed(f"{body.name}/q{k}", np.zeros((2, 2)), 1 - k % 2) for k in range(4)
        ]
        inner, outer = (body, outer) if body.name == "inner" else (inner, body)
    inner, outer = inner.covered(face=inner.sides["high"]), outer.covered(face=outer.sides["low"])
    about = {"scene": "tubes", "walls": walls.tolist(), "interference": interference}
    pairs = [("inner/face", "outer/face")]
    case = shape_case(rng, seed, family, about, [inner, outer], pairs, prescribed, step=1.0)
    case = replace(case, rules=[Rule("Coulomb", 0.0)])
    return replace(case, pressure=interference / softness)


def _widening(body: Shape, a: float, b: float, inside: bool) -> float:
    """Displacement of a face of a tube under unit pressure on this face, in plane strain."""
    E, nu = body.E / (1 - body.nu**2), body.nu / (1 - body.nu)
    r = a if inside else b
    ratio = (a**2 + b**2) / (b**2 - a**2)
    return float(r / E * (ratio + nu if inside else ratio - nu))


def pad(rng: np.random.Generator, seed: int, family: str) -> ShapeCase:
    """A pad pressed on a plane or on a block, and rubbed along it."""
    cells, height = draw_cells(rng), rng.uniform(0.2, 0.8)
    counts = int(rng.integers(3, 14)), int(rng.integers(2, 5))
    pad = mapped(rng, "pad", box(-0.5, 0.0, 1.0, height, *counts), cells)
    pad = pad.covered(bottom=pad.sides["low"])
    bodies, planes, master = [pad], {}, "floor"
    prescribed = [Prescribed("pad/high", np.zeros((2, 2)))]
    if family == "laws" and rng.random() < 0.5:
        planes = {"floor": (np.zeros(2), np.array([0.0, 1.0]))}
    else:
        stiffness = 10.0 ** rng.uniform(-0.5, 1.5)
        columns = int(rng.integers(5, 20))
        base = mapped(rng, "base", box(-1.0, -0.6, 2.0, 0.6, columns, 3), cells, E=stiffness)
        bodies, master = [base.covered(top=base.sides["high"]), pad], "base/top"
        prescribed.append(Prescribed("base/low", np.zeros((2, 2))))
    depth = height * 10.0 ** rng.uniform(-3.0, -1.5)
    mu = rng.uniform(0.1, 0.8)
    slide = rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 6.0) * depth
    prescribed[0] = replace(prescribed[0], motion=motion_along([(0.0, -depth), (slide, -depth)]))
    kinds = ["tanh", "Stribeck", "saturating", "sticky"] if family == "laws" else ["Coulomb"]
    kind = str(rng.choice(kinds))
    length = depth * 10.0 ** rng.uniform(-3.0, -0.3)
    stress = depth / height * 10.0 ** rng.uniform(-1.5, 1.0)
    rule = Rule(kind, mu, mu * rng.uniform(0.4, 0.9), length, stress)
    if kind == "sticky":
        rule = replace(rule, stress=0.3 * depth / height * rng.random())
    about = {"scene": f"pad, {kind}", "depth": depth, "slide/depth": slide / depth, "mu": mu}
    case = shape_case(rng, seed, family, about, bodies, [("pad/bottom", master)], prescribed)
    return replace(case, rules=[rule], planes=planes)


def _side(body: Shape, x: Array, row: int) -> Array:
    """Numbers of the nodes of a row of a body's grid."""
    return np.arange(len(body.x)).reshape(x.shape[:2])[row]
