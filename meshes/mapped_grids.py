# SPDX-License-Identifier: MIT
"""Bodies of grids of cells whose nodes may be anywhere: blocks, wedges, arches, rings, disks.

A body is an array of positions, (columns + 1, rows + 1, 2), the first index running along the
bottom from left to right, the second from bottom to top. So every node is where the formula of the
body puts it, the same with all releases of gmsh, and a surface may have any shape. ``mesh`` needs
no gmsh, ``build`` makes a model of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

import fenics_mortar as fm

CELLS = ("triangle", "quadrilateral")
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


def check_cell(cell: str) -> None:
    """Raise ``ValueError`` if ``cell`` is neither triangle nor quadrilateral."""
    if cell not in CELLS:
        raise ValueError(f"cell is {cell!r}; right is one of {CELLS}")


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


def arrays(grids: Sequence[Grid], *, cell: str = "quadrilateral", order: int = 1) -> dict[str, Any]:
    """Points, cells, bodies and boundaries of all grids: arguments of ``mesh_from_arrays``.

    Args:
        grids: The bodies.
        cell: ``"triangle"`` or ``"quadrilateral"``.
        order: Order of the cells; of order 2, whose sides bend, each takes 3 x 3 nodes of a grid.
    """
    check_cell(cell)
    points, cells, bodies = [], [], {}
    facets: dict[str, list[np.ndarray]] = {}
    num_points = num_cells = 0
    for grid in grids:
        numbers = grid.numbers()
        x = grid.x.reshape(-1, 2)[np.unique(numbers, return_index=True)[1]]
        own = num_points + cells_of(numbers, x, cell, order)
        numbers = num_points + numbers
        sides = (numbers[:, 0], numbers[-1], numbers[::-1, -1], numbers[0, ::-1])
        for side, nodes in zip(SIDES, sides):
            if not grid.closed or side in ("bottom", "top"):
                pieces = sliding_window_view(nodes, order + 1)[::order]
                facets.setdefault(grid.boundary(side), []).append(pieces[:, LINE[order]])
        bodies[grid.name] = num_cells + np.arange(len(own))
        points.append(x)
        cells.append(own)
        num_points, num_cells = num_points + len(x), num_cells + len(own)
    return {
        "points": np.concatenate(points),
        "cells": np.concatenate(cells),
        "bodies": bodies,
        "boundaries": {name: np.concatenate(pieces) for name, pieces in facets.items()},
    }


def mesh(grids: Sequence[Grid], *, comm: MPI.Comm = MPI.COMM_WORLD, **options: Any) -> fm.MeshData:
    """Mesh of all bodies (collective); see ``arrays`` for the options."""
    return fm.mesh_from_arrays(**arrays(grids, **options), comm=comm)


def build(grids: Sequence[Grid], *, cell: str = "quadrilateral", order: int = 1) -> Any:
    """Build all bodies as a new model of the running gmsh session; return ``gmsh.model``."""
    from meshes._shared import name_group
    from meshes.with_gmsh import gmsh

    found = arrays(grids, cell=cell, order=order)
    x = np.pad(found["points"], ((0, 0), (0, 1)))
    gmsh.model.add("mapped_grids")
    parts = [(2, GMSH_FAMILIES[cell], n, found["cells"][c]) for n, c in found["bodies"].items()]
    parts += [(1, "Line", name, facets) for name, facets in found["boundaries"].items()]
    for dim, family, name, nodes in parts:
        entity = gmsh.model.addDiscreteEntity(dim)
        if dim == 2:
            own = np.unique(nodes)
            gmsh.model.mesh.addNodes(2, entity, own + 1, x[own].ravel())
        kind = gmsh.model.mesh.getElementType(family, order)
        gmsh.model.mesh.addElementsByType(entity, kind, [], nodes.ravel() + 1)
        name_group(dim, [entity], name)
    return gmsh.model


def cells_of(numbers: np.ndarray, x: np.ndarray, cell: str, order: int) -> np.ndarray:
    """Nodes of the cells of a grid of ``numbers`` at ``x`` (n, 2), counterclockwise."""
    squares = sliding_window_view(numbers, (order + 1, order + 1))[::order, ::order]
    squares = squares.reshape(-1, order + 1, order + 1)
    corners = squares[:, ::order, ::order].reshape(-1, 4)[:, [0, 2, 3, 1]]
    if turns_left(x, corners) < 0.0:
        squares = squares[:, :, ::-1]
    nodes = [squares[:, i, j] for piece in NODES[cell][order] for i, j in piece]
    return np.stack(nodes, axis=1).reshape(-1, len(NODES[cell][order][0]))


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
    from meshes._shared import write

    write(wheel_on_block, "mapped_grids.msh")
