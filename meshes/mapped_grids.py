# SPDX-License-Identifier: MIT
"""Bodies of grids of cells whose nodes may be anywhere: blocks, wedges, arches, rings, disks.

A body is an array of positions, (columns + 1, rows + 1, 2), the first index running along the
bottom from left to right, the second from bottom to top. So every node is where the formula of the
body puts it, the same with all releases of gmsh, and a surface may have any shape.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import gmsh
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from meshes._shared import check_cell, name_group, write

SIDES = ("bottom", "right", "top", "left")
# The nodes of a facet, and those of the cells that a square of nodes is made into, by order and as
# gmsh counts them.
LINE = {1: [0, 1], 2: [0, 2, 1]}
EDGES = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
NODES: dict[str, dict[int, list[list[tuple[int, int]]]]] = {
    "quadrilateral": {1: [[(0, 0), (1, 0), (1, 1), (0, 1)]], 2: [[*EDGES, (1, 1)]]},
    "triangle": {
        1: [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]],
        2: [
            [(0, 0), (2, 0), (2, 2), (1, 0), (2, 1), (1, 1)],
            [(0, 0), (2, 2), (0, 2), (1, 1), (1, 2), (0, 1)],
        ],
    },
}
GMSH_FAMILIES = {"triangle": "Triangle", "quadrilateral": "Quadrangle"}


@dataclass(frozen=True)
class Grid:
    """One body.

    Attributes:
        name: Name of the body.
        x: Positions of the nodes, shape (order columns + 1, order rows + 1, 2) [length].
        joined: Names of boundaries, by side, where they are not ``name/side``; sides of the same
            name, of other bodies too, are one boundary.
        closed: Whether the right side is joined to the left one, as in a ring.
    """

    name: str
    x: np.ndarray
    joined: dict[str, str] = field(default_factory=dict)
    closed: bool = False

    def boundary(self, side: str) -> str:
        """Name of the boundary on one of ``SIDES``."""
        return self.joined.get(side, f"{self.name}/{side}")

    def numbers(self) -> np.ndarray:
        """Numbers of the nodes from 0 on, shape (columns + 1, rows + 1)."""
        columns, rows = self.x.shape[0] - self.closed, self.x.shape[1]
        numbers = np.arange(columns * rows).reshape(columns, rows)
        return np.vstack([numbers, numbers[:1]]) if self.closed else numbers


def mapped(
    columns: int, rows: int, position: Callable[[np.ndarray, np.ndarray], Sequence[np.ndarray]]
) -> np.ndarray:
    """Positions of a grid; ``position`` maps s, t in [0, 1] to x, y, arrays of one shape."""
    s, t = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1), indexing="ij")
    return np.stack([np.broadcast_to(x, s.shape) for x in position(s, t)], axis=2)


def block(
    columns: int, rows: int, *, width: float, height: float, corner: Sequence[float] = (0.0, 0.0)
) -> np.ndarray:
    """A rectangle with its lower left corner at ``corner``."""
    return mapped(columns, rows, lambda s, t: (corner[0] + width * s, corner[1] + height * t))


def sector(
    columns: int,
    rows: int,
    *,
    radii: tuple[float, float],
    angles: tuple[float, float] = (0.0, 2.0 * np.pi),
    centre: Sequence[float] = (0.0, 0.0),
) -> np.ndarray:
    """Part of a ring, counterclockwise from the first angle: bottom is outside, top inside."""

    def position(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        radius = radii[1] + (radii[0] - radii[1]) * t
        angle = angles[0] + (angles[1] - angles[0]) * s
        return centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)

    return mapped(columns, rows, position)


def build(grids: Sequence[Grid], *, cell: str = "quadrilateral", order: int = 1) -> Any:
    """Build all bodies as a new model of the running gmsh session; return ``gmsh.model``.

    Args:
        grids: The bodies.
        cell: ``"triangle"`` or ``"quadrilateral"``.
        order: Order of the cells; of order 2, whose sides bend, each takes 3 x 3 nodes of a grid.
    """
    check_cell(cell)
    gmsh.model.add("mapped_grids")
    lines: dict[str, list[np.ndarray]] = {}
    first = 1
    for grid in grids:
        numbers = first + grid.numbers()
        first = int(numbers.max()) + 1
        add_cells(grid, numbers, cell, order)
        sides = (numbers[:, 0], numbers[-1], numbers[::-1, -1], numbers[0, ::-1])
        for side, nodes in zip(SIDES, sides):
            if not grid.closed or side in ("bottom", "top"):
                facets = sliding_window_view(nodes, order + 1)[::order]
                lines.setdefault(grid.boundary(side), []).append(facets[:, LINE[order]])
    for name, facets in lines.items():
        curve = gmsh.model.addDiscreteEntity(1)
        kind = gmsh.model.mesh.getElementType("Line", order)
        gmsh.model.mesh.addElementsByType(curve, kind, [], np.concatenate(facets).ravel())
        name_group(1, [curve], name)
    return gmsh.model


def add_cells(grid: Grid, numbers: np.ndarray, cell: str, order: int) -> None:
    """Add nodes and cells of one body."""
    surface = gmsh.model.addDiscreteEntity(2)
    tags, place = np.unique(numbers, return_index=True)
    x = np.zeros((tags.size, 3))
    x[:, :2] = grid.x.reshape(-1, 2)[place]
    gmsh.model.mesh.addNodes(2, surface, tags, x.ravel())
    cells = sliding_window_view(numbers, (order + 1, order + 1))[::order, ::order]
    cells = cells.reshape(-1, order + 1, order + 1)
    corners = cells[:, ::order, ::order].reshape(-1, 4)[:, [0, 2, 3, 1]]
    if turns_left(x[:, :2], corners - tags[0]) < 0.0:
        cells = cells[:, :, ::-1]
    nodes = [cells[:, i, j] for branch in NODES[cell][order] for i, j in branch]
    kind = gmsh.model.mesh.getElementType(GMSH_FAMILIES[cell], order)
    gmsh.model.mesh.addElementsByType(surface, kind, [], np.stack(nodes, axis=1).ravel())
    name_group(2, [surface], grid.name)


def turns_left(x: np.ndarray, quads: np.ndarray) -> float:
    """Sum of the cells' areas, negative if their nodes run clockwise."""
    a, b = x[quads[:, 2]] - x[quads[:, 0]], x[quads[:, 3]] - x[quads[:, 1]]
    return 0.5 * float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())


def wheel_on_block() -> Any:
    """A ring above a block: an example."""
    ring = sector(48, 3, radii=(0.6, 1.0), centre=(0.0, 1.1))
    ground = block(24, 6, width=3.0, height=0.8, corner=(-1.5, -0.8))
    return build([Grid("wheel", ring, closed=True), Grid("block", ground)])


if __name__ == "__main__":
    write(wheel_on_block, "mapped_grids.msh")
