# SPDX-License-Identifier: MIT
"""Shapes of random problems of bodies supported by friction: blocks, walls, towers, arches.

Each function draws bodies, pairs and friction; loads are drawn in ``random_supported``.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from demos.studies.stability.case import Prescribed
from demos.studies.stability.random_bodies import Array, Body, draw_cells, split
from demos.studies.stability.supported_case import SupportedCase

# Width of upright joints that are not pairs [length]: bulging bodies do not meet in them.
OPEN = 0.02
DOWN = np.array([0.0, -1.0])


def quadrilateral(
    rng: np.random.Generator, name: str, corners: Array, counts: tuple[int, int], cells: str
) -> Body:
    """A body between four corners, counter-clockwise from the lower left, with E = 1."""
    s, t = np.meshgrid(np.linspace(0, 1, counts[0] + 1), np.linspace(0, 1, counts[1] + 1))
    a, b, c, d = np.asarray(corners, float)
    s, t = s[..., None], t[..., None]
    x = (1 - s) * (1 - t) * a + s * (1 - t) * b + s * t * c + (1 - s) * t * d
    nodes = np.arange(s.size).reshape(s.shape[:2])
    sides = {"bottom": nodes[0], "right": nodes[:, -1], "top": nodes[-1], "left": nodes[:, 0]}
    sides = {side: along.copy() for side, along in sides.items()}
    thickness = float(np.linalg.norm(d - a))
    nu = float(rng.uniform(0.0, 0.4))
    return Body(name, x.reshape(-1, 2), split(rng, nodes, cells), sides, 1.0, nu, thickness)


def _box(rng, name, x, y, width, height, counts, cells) -> Body:
    """A rectangle with its lower left corner at (x, y)."""
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)]) + np.array([x, y])
    return quadrilateral(rng, name, corners, counts, cells)


def _counts(rng: np.random.Generator, width: float = 1.0) -> tuple[int, int]:
    """Cells along and across a block."""
    return max(round(width * rng.integers(2, 6)), 1), int(rng.integers(1, 4))


def _scene(seed: int, about: dict[str, Any], bodies, pairs, **options: Any) -> SupportedCase:
    """Assemble a problem without loads."""
    still = np.zeros((3, 2))
    clamped = options.get("clamped", ())
    prescribed = [Prescribed(f"{name}/{side}", still) for name, side in options.pop("supports", [])]
    prescribed += [
        Prescribed(f"{name}/{side}", still, c) for name, side, c in options.pop("guides", [])
    ]
    about = {"supported": True, **about, "clamped": list(clamped)}
    return SupportedCase(seed, about, bodies, pairs, prescribed, "", still, 1.0, **options)


def _on(rng, x: float, width: float, cells: str) -> dict[str, Any]:
    """The ground below y = 0: a rigid plane, or a clamped block."""
    if rng.random() < 0.5:
        return {"bodies": [], "top": "floor", "planes": {"floor": (np.zeros(2), -DOWN)}}
    counts = (int(rng.integers(3, 9)), 2)
    ground = _box(rng, "ground", x - 0.4, -0.6, width + 0.8, 0.6, counts, cells)
    return {
        "bodies": [ground], "top": "ground/top", "planes": {},
        "clamped": ("ground",), "supports": [("ground", "bottom")],
    }  # fmt: skip


def _with_roles(rng: np.random.Generator, pairs: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Exchange the roles of some pairs of two bodies."""
    return [pair[::-1] if "/" in pair[1] and rng.random() < 0.5 else pair for pair in pairs]


def block(rng: np.random.Generator, seed: int) -> SupportedCase:
    """A block on the ground."""
    cells = draw_cells(rng)
    width, height = rng.uniform(0.5, 1.5), rng.uniform(0.3, 1.2)
    on = _on(rng, 0.0, width, cells)
    block = _box(rng, "block", 0.0, 0.0, width, height, _counts(rng, width), cells)
    pairs = _with_roles(rng, [("block/bottom", on.pop("top"))])
    bodies = [*on.pop("bodies"), block]
    return _scene(seed, {"scene": "block"}, bodies, pairs, friction=[rng.uniform(0.1, 1.0)], **on)


def _courses(
    rng: np.random.Generator, seed: int, rows: list[list[float]], name: str
) -> SupportedCase:
    """Rows of blocks on top of each other; ``rows``: positions of the joints of each."""
    cells, upright = draw_cells(rng), rng.random() < 0.8
    alike = int(rng.integers(2, 5)) if rng.random() < 0.4 else 0
    on = _on(rng, rows[0][0], rows[0][-1] - rows[0][0], cells)
    bodies, pairs, below, y = on.pop("bodies"), [], [], 0.0
    for r, joints in enumerate(rows):
        height, row = rng.uniform(0.3, 0.7), []
        for c, (a, b) in enumerate(itertools.pairwise(joints)):
            b -= OPEN * (not upright and c < len(joints) - 2)
            counts = (max(round((b - a) * alike), 1), 2) if alike else _counts(rng, b - a)
            bodies.append(_box(rng, f"b{r}_{c}", a, y, b - a, height, counts, cells))
            row.append((f"b{r}_{c}", a, b))
        if not below:
            pairs += [(f"{one}/bottom", on["top"]) for one, *_ in row]
        pairs += [
            (f"{one}/bottom", f"{other}/top")
            for one, a, b in row
            for other, c, d in below
            if min(b, d) - max(a, c) > 1e-6
        ]
        if upright:
            pairs += [(f"{p[0]}/right", f"{q[0]}/left") for p, q in itertools.pairwise(row)]
        below, y = row, y + height
    on.pop("top")
    mu = rng.uniform(0.1, 1.0)
    friction = [float(mu * rng.uniform(0.7, 1.0)) for _ in pairs]
    about = {"scene": name, "upright": upright, "conforming": bool(alike)}
    return _scene(seed, about, bodies, _with_roles(rng, pairs), friction=friction, **on)


def wall(rng: np.random.Generator, seed: int) -> SupportedCase:
    """A wall with random joints, or in running bond."""
    rows, length = int(rng.integers(2, 5)), float(rng.integers(1, 4))
    courses = []
    for r in range(rows):
        joints = np.arange(1.0, length) if r % 2 == 0 else np.arange(0.5, length)
        if rng.random() < 0.5:
            joints = joints + rng.uniform(-0.2, 0.2, joints.size)
        courses.append([0.0, *joints.tolist(), length])
    return _courses(rng, seed, courses, "wall")


def tower(rng: np.random.Generator, seed: int) -> SupportedCase:
    """Blocks on top of each other with offsets."""
    x, courses = 0.0, []
    for _ in range(rng.integers(2, 9)):
        width = rng.uniform(0.8, 1.3)
        courses.append([x - 0.5 * width, x + 0.5 * width])
        x += rng.uniform(-0.2, 0.2)
    return _courses(rng, seed, courses, "tower")


def junction(rng: np.random.Generator, seed: int) -> SupportedCase:
    """A block on two others in contact."""
    left, right = rng.uniform(0.6, 1.2, 2)
    ends = [rng.uniform(-0.9, -0.3) * left, rng.uniform(0.3, 0.9) * right]
    if rng.random() < 0.3:
        ends = [-left, right]
    return _courses(rng, seed, [[-left, 0.0, right], ends], "T-junction")


def groove(rng: np.random.Generator, seed: int) -> SupportedCase:
    """A block on its corner in a groove that fits."""
    cells, half = draw_cells(rng), rng.uniform(0.3, 1.2)
    e = np.array([np.cos(half), np.sin(half)])  # along the right flank
    f = np.array([-e[1], e[0]]) if rng.random() < 0.5 else np.array([-e[0], e[1]])
    length, width = rng.uniform(0.6, 1.2, 2)
    corners = np.array([0.0 * e, length * e, length * e + width * f, width * f])
    counts = int(rng.integers(2, 5)), int(rng.integers(2, 5))
    block = quadrilateral(rng, "block", corners, counts, cells)
    normal_e, normal_f = np.array([-e[1], e[0]]), np.array([f[1], -f[0]])
    mu = rng.uniform(0.1, 0.9)
    options: dict[str, Any] = {}
    if rng.random() < 0.5:
        zero = np.zeros(2)
        options["planes"] = {"right": (zero, normal_e), "left": (zero, normal_f)}
        bodies, pairs = [block], [("block/bottom", "right"), ("block/left", "left")]
    else:
        flanks = []
        for name, along, normal, reach in (
            ("right", e, normal_e, length), ("left", f, normal_f, width),
        ):  # fmt: skip
            a, b = 0.0 * along, 1.3 * reach * along
            low, high = a - 0.5 * normal + 0.2 * along, b - 0.5 * normal
            body = [low, high, b, a] if name == "right" else [high, low, a, b]
            counts = (int(rng.integers(2, 6)), 2)
            flanks.append(quadrilateral(rng, name, np.array(body), counts, cells))
        bodies = [block, *flanks]
        pairs = _with_roles(rng, [("block/bottom", "right/top"), ("block/left", "left/top")])
        options["clamped"] = ("right", "left")
        options["supports"] = [("right", "bottom"), ("left", "bottom")]
    about = {"scene": "groove"}
    return _scene(seed, about, bodies, pairs, friction=[mu, mu], **options)


def row(rng: np.random.Generator, seed: int) -> SupportedCase:
    """Blocks in a row between a clamped and a guided jaw, which is pressed."""
    cells, x, mu = draw_cells(rng), 0.0, rng.uniform(0.3, 1.0)
    height = rng.uniform(0.5, 1.0)
    bodies = [_box(rng, "left", -0.6, -0.2, 0.6, height + 0.4, _counts(rng), cells)]
    names = ["left"]
    for k in range(rng.integers(1, 5)):
        width = rng.uniform(0.4, 1.0)
        bodies.append(_box(rng, f"b{k}", x, 0.0, width, height, _counts(rng, 2 * width), cells))
        names.append(f"b{k}")
        x += width
    bodies.append(_box(rng, "right", x, -0.2, 0.6, height + 0.4, _counts(rng), cells))
    names.append("right")
    pairs = [(f"{p}/right", f"{q}/left") for p, q in itertools.pairwise(names)]
    return _scene(
        seed,
        {"scene": "row", "pressed": "right"},
        bodies,
        _with_roles(rng, pairs),
        friction=[mu] * len(pairs),
        clamped=("left",),
        supports=[("left", "left")],
        guides=[("right", "top", 1)],
    )


def arch(rng: np.random.Generator, seed: int) -> SupportedCase:
    """Voussoirs between rigid springings."""
    cells, number = draw_cells(rng), int(rng.integers(3, 9))
    thickness, mu = rng.uniform(0.08, 0.3), rng.uniform(0.4, 1.0)
    angles = np.linspace(0.0, np.pi, number + 1)
    bodies = []
    for k, (a, b) in enumerate(itertools.pairwise(angles)):
        corners = [
            r * np.array([np.cos(t), np.sin(t)])
            for r, t in ((1 + thickness / 2, a), (1 + thickness / 2, b),
                         (1 - thickness / 2, b), (1 - thickness / 2, a))
        ]  # fmt: skip
        counts = (int(rng.integers(1, 3)), int(rng.integers(1, 4)))
        bodies.append(quadrilateral(rng, f"v{k}", np.array(corners), counts, cells))
    pairs = [(f"v{k}/right", f"v{k + 1}/left") for k in range(number - 1)]
    pairs = _with_roles(rng, pairs)
    pairs += [("v0/left", "springing"), (f"v{number - 1}/right", "springing")]
    return _scene(
        seed,
        {"scene": "arch", "t/R": thickness},
        bodies,
        pairs,
        friction=[mu] * len(pairs),
        planes={"springing": (np.zeros(2), -DOWN)},
    )


def hanging(rng: np.random.Generator, seed: int) -> SupportedCase:
    """Blocks that hang below each other, the first from a rigid or a clamped ceiling.

    Friction is proportional to pressure alone, so that blocks are fixed sideways by a guide only;
    loads pull straight down.
    """
    cells, y = draw_cells(rng), 0.0
    widths = rng.uniform(0.5, 1.3, rng.integers(1, 4))
    options: dict[str, Any] = {}
    if rng.random() < 0.5:
        above, bodies, options["planes"] = "ceiling", [], {"ceiling": (np.zeros(2), DOWN)}
    else:
        counts = (int(rng.integers(3, 9)), 2)
        above, bodies = "base/bottom", [_box(rng, "base", -1.0, 0.0, 2.0, 0.5, counts, cells)]
        options |= {"clamped": ("base",), "supports": [("base", "top")]}
    pairs, heights, x = [], [], 0.0
    for k, width in enumerate(widths):
        height = rng.uniform(0.2, 0.8)
        y -= height
        counts = _counts(rng, width)
        bodies.append(_box(rng, f"b{k}", x - width / 2, y, width, height, counts, cells))
        pairs.append((f"b{k}/top", above))
        above = f"b{k}/bottom"
        heights.append(height)
        x += rng.uniform(-0.1, 0.1)
    if guided := rng.random() < 0.7:
        options["guides"] = [(f"b{k}", "left", 0) for k in range(len(widths))]
    hung = np.cumsum((widths * heights)[::-1])[::-1]
    narrow = np.minimum(widths, np.r_[2.0, widths[:-1]])
    pulls = hung / narrow * rng.uniform(1.5, 5.0, len(widths))
    friction = rng.uniform(0.1, 0.8) * rng.uniform(0.7, 1.0, len(pairs))
    about = {"scene": f"{len(pairs)} hanging", "guided": guided, "straight": True}
    return _scene(
        seed, about, bodies, _with_roles(rng, pairs), friction=friction.tolist(),
        pulls=pulls.tolist(), fade=float(rng.uniform(0.03, 0.1)), **options,
    )  # fmt: skip


def glued(rng: np.random.Generator, seed: int) -> SupportedCase:
    """A tall standing block that sticks: adhesion prevents it from tipping."""
    cells = draw_cells(rng)
    width, height = rng.uniform(0.3, 0.6), rng.uniform(0.8, 1.5)
    on = _on(rng, 0.0, width, cells)
    block = _box(rng, "block", 0.0, 0.0, width, height, _counts(rng, 2 * width), cells)
    pairs = _with_roles(rng, [("block/bottom", on.pop("top"))])
    bodies = [*on.pop("bodies"), block]
    return _scene(
        seed, {"scene": "glued"}, bodies, pairs, friction=[rng.uniform(2.0, 4.0)],
        pulls=[height * rng.uniform(0.2, 3.0)], fade=float(rng.uniform(0.03, 0.1)), **on,
    )  # fmt: skip
