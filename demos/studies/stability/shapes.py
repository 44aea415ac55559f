# SPDX-License-Identifier: MIT
"""Thin bodies from maps of a grid, strips and boxes, with any part of the outline as a surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from demos.studies.stability.random_bodies import Array, Body, corner_areas, split


@dataclass(frozen=True)
class Shape(Body):
    """A body with chains of boundary nodes as surfaces, and other chains as grips.

    Attributes:
        grips: Chains of ``sides`` that are not surfaces: "around" is the outline.
    """

    grips: tuple[str, ...] = ("around",)

    @property
    def outline(self) -> Array:
        """Nodes along the outline, shape (k,); for a ring both circles and the cut, twice."""
        if "around" in self.sides:
            return self.sides["around"][:-1]
        return np.concatenate([self.sides["low"], self.sides["high"]])

    @property
    def surfaces(self) -> list[str]:
        """The sides that are tagged."""
        return [name for name in self.sides if name not in self.grips]

    def gripped(self, **chains: Array) -> Shape:
        """The body with more grips."""
        return replace(self, sides=self.sides | chains, grips=(*self.grips, *chains))

    def covered(self, **chains: Array) -> Shape:
        """The body with more surfaces."""
        return replace(self, sides=self.sides | chains)


def mapped(
    rng: np.random.Generator,
    name: str,
    x: Array,
    cells: str,
    *,
    closed: bool = False,
    E: float = 1.0,
) -> Shape:
    """A body from a grid of positions; it may be closed along its columns.

    Args:
        rng: Source of random splits of quadrilaterals.
        name: Its name.
        x: Places, shape (rows + 1, columns + 1, 2) [length].
        cells: Result of ``draw_cells``.
        closed: Whether the last column is the first.
        E: Young's modulus.

    Returns:
        A body whose only chains are "low" and "high", the first and the last row, "start" and
        "end", the first and the last column, and "around", the outline, unless it is closed; none
        is a surface.
    """
    if closed:
        x = x[:, :-1]
    nodes = np.arange(x.shape[0] * x.shape[1]).reshape(x.shape[:2])
    if closed:
        nodes = np.column_stack([nodes, nodes[:, 0]])
    places = x.reshape(-1, 2)
    quads = split(rng, nodes, "quads")
    order = 1 if corner_areas(places[quads]).sum() > 0.0 else -1
    tags = split(rng, nodes[:, ::order], cells)
    low, high, start, end = nodes[0], nodes[-1], nodes[:, 0], nodes[:, -1]
    chains = {"low": low, "high": high}
    if not closed:
        around = np.concatenate([low[:-1], end[:-1], high[:0:-1], start[::-1]])
        chains |= {"start": start, "end": end, "around": around}
    sides = {side: chain[::order].copy() for side, chain in chains.items()}
    thickness = float(np.linalg.norm(x[-1] - x[0], axis=1).min())
    nu = float(rng.uniform(0.0, 0.4))
    return Shape(name, places, tags, sides, float(E), nu, thickness, tuple(sides))


def strip(middle: Array, thickness: float, rows: int) -> Array:
    """Positions of a strip along a curve, shape (rows + 1, points, 2).

    Args:
        middle: Its middle, shape (points, 2) [length].
        thickness: Its thickness; the last row is on the left of the curve.
        rows: Cells across.
    """
    along = np.gradient(middle, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    left = np.column_stack([-along[:, 1], along[:, 0]])
    across = np.linspace(-0.5, 0.5, rows + 1)[:, None, None]
    return middle + across * thickness * left


def box(x: float, y: float, width: float, height: float, columns: int, rows: int) -> Array:
    """Positions of a rectangle with its lower left corner at (x, y)."""
    s, t = np.meshgrid(np.linspace(0.0, width, columns + 1), np.linspace(0.0, height, rows + 1))
    return np.stack([x + s, y + t], axis=-1)
