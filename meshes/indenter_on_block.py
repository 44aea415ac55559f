# SPDX-License-Identifier: MIT
"""A round-bottomed indenter above a long block, as in shallow ironing.

Lengths are in any one unit: the block is 12 x 4 with its lower left corner at the origin; the
indenter has the width 1.2, straight sides of 0.9 and below an arc of the chord 1.2 and the sag 0.3,
which is a radius of 0.75. Its left side is at x = 0.2 and its lowest point 0.2 above the block.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from meshes._shared import add_block, add_lines, add_points, add_surface, divide, generate, write
from meshes.with_gmsh import gmsh

LENGTH, HEIGHT = 12.0, 4.0
LEFT, WIDTH, SAG, SIDE, CLEARANCE = 0.2, 1.2, 0.3, 0.9, 0.2
RADIUS = (0.25 * WIDTH**2 + SAG**2) / (2.0 * SAG)


def build(
    *,
    cell: str = "quadrilateral",
    n_block: int = 60,
    layers_block: int = 20,
    n_indenter: int = 12,
    layers_indenter: int = 9,
    grading: float = 1.0,
) -> Any:
    """Build both bodies as a new model of the running gmsh session; return ``gmsh.model``.

    Names: bodies ``indenter`` and ``block``; boundaries ``indenter/arc``, ``indenter/right``,
    ``indenter/top``, ``indenter/left``, ``block/bottom``, ``block/right``, ``block/top``,
    ``block/left``.

    Args:
        cell: ``"triangle"`` or ``"quadrilateral"``.
        n_block: Number of facets of the block's top.
        layers_block: Number of layers of cells of the block.
        n_indenter: Number of facets of the indenter's arc; even, with a node at the lowest point.
        layers_indenter: Number of layers of cells of the indenter.
        grading: Height of the block's lowest layer by that of the top one.
    """
    if n_indenter % 2:
        raise ValueError(f"n_indenter is {n_indenter}; right is an even number")
    gmsh.model.add("indenter_on_block")
    corners = np.array([(0.0, 0.0), (LENGTH, 0.0), (LENGTH, HEIGHT), (0.0, HEIGHT)])
    block, sides = add_block(corners, n_block, layers_block, cell, ratio=1.0 / grading)
    indenter, edges = add_indenter(n_indenter, layers_indenter, cell)
    boundaries = {f"block/{side}": [curve] for side, curve in sides.items()}
    boundaries |= {f"indenter/{edge}": curves for edge, curves in edges.items()}
    return generate({"block": [block], "indenter": [indenter]}, boundaries)


def add_indenter(columns: int, layers: int, cell: str) -> tuple[int, dict[str, list[int]]]:
    """Add the indenter; return its surface, and its curves by the name of the edge."""
    middle, right = LEFT + 0.5 * WIDTH, LEFT + WIDTH
    lowest = HEIGHT + CLEARANCE
    start, top = lowest + SAG, lowest + SAG + SIDE
    x = [(LEFT, start), (middle, lowest), (right, start), (right, top), (LEFT, top)]
    p = add_points(x)
    centre = add_points([(middle, lowest + RADIUS)])[0]
    arcs = [gmsh.model.geo.addCircleArc(s, centre, t) for s, t in ((p[0], p[1]), (p[1], p[2]))]
    sides = add_lines([p[2], p[3], p[4], p[0]])
    for curve, facets in zip(arcs + sides, (columns // 2, columns // 2, layers, columns, layers)):
        divide(curve, facets)
    surface = add_surface(arcs + sides, cell, [p[0], p[2], p[3], p[4]])
    return surface, {"arc": arcs, "right": sides[:1], "top": sides[1:2], "left": sides[2:]}


if __name__ == "__main__":
    write(build, "indenter_on_block.msh")
