# SPDX-License-Identifier: MIT
"""Random bodies: blocks of structured cells between random curves, and plane geometry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

Array = np.ndarray
Curve = Callable[[Array], Array]

# Largest slope of each contact curve: strains under a wedge are of the size of its slope.
STEEPEST = 0.35


@dataclass(frozen=True)
class Body:
    """A block of structured cells.

    Attributes:
        name: Its name; boundaries are called ``name/side``.
        x: Positions of the nodes, shape (n, 2) [length].
        cells: Their nodes, in the order of dolfinx, shape (m, 3 or 4).
        sides: Nodes along "bottom", "right", "top" and "left", counted from the lower left corner.
        E: Young's modulus [stress].
        nu: Poisson's ratio.
        thickness: Smallest distance of bottom and top [length].
    """

    name: str
    x: Array
    cells: Array
    sides: dict[str, Array]
    E: float
    nu: float
    thickness: float

    def refined(self) -> Body:
        """The body with four times the cells and unchanged polygons."""
        triangles = self.cells.shape[1] == 3
        local = [(0, 1), (0, 2), (1, 2)] if triangles else [(0, 1), (0, 2), (1, 3), (2, 3)]
        edges = np.sort(self.cells[:, local], axis=2)
        ends, number = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
        middle = len(self.x) + number.reshape(len(self.cells), -1)
        x = [self.x, self.x[ends].mean(axis=1)]
        if triangles:
            (a, b, c), (ab, ac, bc) = self.cells.T, middle.T
            parts = [(a, ab, ac), (b, bc, ab), (c, ac, bc), (ab, bc, ac)]
        else:
            (a, b, c, d), (ab, ac, bd, cd) = self.cells.T, middle.T
            x.append(self.x[self.cells].mean(axis=1))
            m = len(self.x) + len(ends) + np.arange(len(self.cells))
            parts = [(a, ab, ac, m), (ab, b, m, bd), (ac, m, c, cd), (m, bd, cd, d)]
        middle_of = {tuple(edge): len(self.x) + i for i, edge in enumerate(ends.tolist())}

        def finer(nodes: Array) -> Array:
            pairs = np.sort(np.stack([nodes[:-1], nodes[1:]], axis=1)).tolist()
            between = [middle_of[tuple(pair)] for pair in pairs]
            return np.append(np.stack([nodes[:-1], between], axis=1).ravel(), nodes[-1])

        sides = {side: finer(nodes) for side, nodes in self.sides.items()}
        cells = np.concatenate([np.stack(part, axis=1) for part in parts])
        return replace(self, x=np.concatenate(x), cells=cells, sides=sides)

    @property
    def outline(self) -> Array:
        """Nodes along the outline, shape (k,)."""
        s = self.sides
        return np.concatenate(
            [s["bottom"][:-1], s["right"][:-1], s["top"][:0:-1], s["left"][:0:-1]]
        )


# Plane geometry


def corner_areas(x: Array) -> Array:
    """Twice the area at each corner of triangles or tensor-ordered quadrilaterals, (m, corners)."""
    x = x[:, [0, 1, 2] if x.shape[1] == 3 else [0, 1, 3, 2]]
    after, before = np.roll(x, -1, axis=1) - x, np.roll(x, 1, axis=1) - x
    return after[..., 0] * before[..., 1] - after[..., 1] * before[..., 0]


def lengths(line: Array) -> Array:
    """Lengths of the segments of a polygonal line (k, 2), shape (k - 1,)."""
    return np.linalg.norm(np.diff(line, axis=0), axis=1)


def distances(points: Array, line: Array) -> Array:
    """Distance of points (n, 2) from a polygonal line (k, 2), shape (n,)."""
    a, p, edge = line[:-1], points[:, None], np.diff(line, axis=0)
    t = np.clip(((p - a) * edge).sum(axis=2) / (edge**2).sum(axis=1), 0.0, 1.0)
    return np.linalg.norm(p - a - t[..., None] * edge, axis=2).min(axis=1)


def depths(points: Array, outline: Array) -> Array:
    """Distance of points inside a polygon from its outline, 0 outside, shape (n,)."""
    a, b, p = outline, np.roll(outline, -1, axis=0), points[:, None]
    above = a[:, 1] > p[..., 1], b[:, 1] > p[..., 1]
    edge, arm = b - a, p - a
    on_left = edge[:, 0] * arm[..., 1] - edge[:, 1] * arm[..., 0] > 0.0
    crossings = ((above[0] != above[1]) & (on_left == above[1])).sum(axis=1)
    return np.where(crossings % 2 == 1, distances(points, np.vstack([a, a[:1]])), 0.0)


# Drawing


def draw_curve(rng: np.random.Generator, facet: float) -> tuple[Curve, str]:
    """A curve of slope at most ``STEEPEST`` within [-1, 1]."""
    slope = STEEPEST * rng.uniform(-1.0, 1.0)
    place = rng.uniform(-0.4, 0.4)
    kind = rng.choice(["flat", "tilted", "arc", "waves", "roof", "polygon"])
    if kind == "flat":
        return np.zeros_like, kind
    if kind == "tilted":
        return lambda x: 0.5 * slope * x, kind
    if kind == "arc":
        return lambda x: 0.5 * slope * (x - place) ** 2, kind
    if kind == "waves":
        number = 2 * np.pi / max(rng.uniform(0.4, 2.0), 6.0 * facet)
        return lambda x: slope / number * np.sin(number * (x - place)), kind
    if kind == "roof":
        return lambda x: slope * np.abs(x - place), kind
    corners = np.sort(np.concatenate([[-1.5, 1.5], rng.uniform(-0.7, 0.7, rng.integers(2, 6))]))
    slopes = STEEPEST * rng.uniform(-1.0, 1.0, corners.size - 1)
    heights = np.cumsum([0.0, *(slopes * np.diff(corners))])
    return lambda x: np.interp(x, corners, heights), kind


def draw_cells(rng: np.random.Generator) -> str:
    """Quadrilaterals, or triangles by one of the ways to halve them."""
    return str(rng.choice(["quads", "left", "right", "crossed", "random"]))


def draw_block(rng, name, cells, facet, place, top, bottom, E, shear=0.0) -> Body:
    """A block with a curved top or bottom, or both; the side without a curve is far away.

    Args:
        rng: Source of numbers.
        name: Name of the body.
        cells: Result of ``draw_cells``.
        facet: Approximate length of its facets.
        place: Position of its middle, and its width.
        top: Curve, or ``None``.
        bottom: Curve, or ``None``.
        E: Young's modulus.
        shear: Shift of the far side over the thickness.
    """
    middle, width = place
    height, far_slope = rng.uniform(0.35, 1.2), 0.1 * rng.uniform(-1.0, 1.0)
    if bottom is None and top is None:
        raise ValueError("a block needs a curve")
    nx, ny = max(round(width / facet), 3), int(rng.integers(3, 8))
    s, t = _spacing(rng, nx), np.cumsum([0.0, *np.geomspace(1.0, rng.uniform(1.0, 4.0), ny)])
    t /= t[-1]
    if bottom is None:
        t = 1.0 - t[::-1]
    s, t = np.meshgrid(s, t)
    if rng.random() < 0.5:
        s, t = _jittered(rng, s), _jittered(rng, t.T).T
    x = middle + width * (s - 0.5)
    if bottom is None:
        high = top(x)
        low = np.full_like(x, -height) + far_slope * x
        x_shift = shear * (1.0 - t)
    elif top is None:
        low = bottom(x)
        high = np.full_like(x, height) + far_slope * x
        x_shift = shear * t
    else:
        low, high, x_shift = bottom(x), height + top(x), 0.0 * t
    y = low + t * (high - low)
    nodes = np.arange(x.size).reshape(x.shape)
    sides = {"bottom": nodes[0], "right": nodes[:, -1], "top": nodes[-1], "left": nodes[:, 0]}
    nu = float(rng.uniform(0.0, 0.45))
    positions = np.stack([x + x_shift, y], axis=-1).reshape(-1, 2)
    return Body(
        name,
        positions,
        split(rng, nodes, cells),
        {side: along.copy() for side, along in sides.items()},
        float(E),
        nu,
        float((high - low).min()),
    )


def _spacing(rng: np.random.Generator, count: int) -> Array:
    """Positions from 0 to 1: equal, graded to one end, or random lengths."""
    kind = rng.integers(3)
    if kind == 0:
        lengths = np.ones(count)
    elif kind == 1:
        lengths = np.geomspace(1.0, rng.uniform(0.25, 4.0), count)
    else:
        lengths = rng.uniform(0.5, 1.5, count)
    places = np.cumsum([0.0, *lengths])
    return places / places[-1]


def _jittered(rng: np.random.Generator, places: Array) -> Array:
    """Move inner nodes by up to a quarter of the distance of their neighbours in the row."""
    places = places.copy()
    room = np.minimum(np.diff(places[:, :-1]), np.diff(places[:, 1:]))[1:-1]
    places[1:-1, 1:-1] += 0.25 * rng.uniform(-1.0, 1.0, room.shape) * room
    return places


def split(rng: np.random.Generator, nodes: Array, cells: str) -> Array:
    """Quadrilaterals in tensor order, or two triangles of each."""
    a, b, c, d = (
        n.ravel() for n in (nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, :-1], nodes[1:, 1:])
    )
    if cells == "quads":
        return np.stack([a, b, c, d], axis=1)
    i, j = (n.ravel() for n in np.indices(np.array(nodes.shape) - 1))
    right = {
        "left": np.zeros(a.size, bool),
        "right": np.ones(a.size, bool),
        "crossed": (i + j) % 2 == 0,
        "random": rng.random(a.size) < 0.5,
    }[cells][:, None]
    first = np.where(right, np.stack([a, b, d], axis=1), np.stack([a, b, c], axis=1))
    second = np.where(right, np.stack([a, d, c], axis=1), np.stack([b, d, c], axis=1))
    return np.concatenate([first, second])


def put_above(upper: Body, lower: Body, gap: float) -> Body:
    """Put a body above another one, with a given smallest distance of their polygons."""
    under, over = upper.x[upper.sides["bottom"]], lower.x[lower.sides["top"]]
    left, right = max(under[0, 0], over[0, 0]), min(under[-1, 0], over[-1, 0])
    x = np.concatenate([under[:, 0], over[:, 0], [left, right]])
    x = x[(x >= left) & (x <= right)]
    distance = (np.interp(x, *under.T) - np.interp(x, *over.T)).min()
    return replace(upper, x=upper.x + np.array([0.0, gap - distance]))
