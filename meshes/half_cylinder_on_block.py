# SPDX-License-Identifier: MIT
"""A half cylinder on a block, with a fine mesh where they meet, as in Hertz's problem.

Lengths are in any one unit. The block's top is y = 0, symmetric about x = 0; the lowest point of
the half cylinder is above the origin, its flat side is on top. There is a node at the contact point
on both sides. Facets are the same with all releases of gmsh, the cells inside need not be.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from meshes._shared import add_lines, add_points, add_surface, generate, write
from meshes.with_gmsh import gmsh


def build(
    *,
    cell: str = "triangle",
    radius: float = 1.0,
    width: float = 4.0,
    height: float = 2.0,
    gap: float = 0.0,
    h: float = 0.02,
    h_block: float | None = None,
    fine: float = 0.2,
    growth: float = 0.15,
) -> Any:
    """Build both bodies as a new model of the running gmsh session; return ``gmsh.model``.

    Names: bodies ``cylinder`` and ``block``; boundaries ``cylinder/arc``, ``cylinder/top``,
    ``block/bottom``, ``block/right``, ``block/top``, ``block/left``.

    Args:
        cell: ``"triangle"`` or ``"quadrilateral"``; only these cells are left.
        radius: Radius of the cylinder [length].
        width: Width of the block [length].
        height: Height of the block [length].
        gap: Height of the cylinder's lowest point above the block [length].
        h: Size of the cylinder's facets at the contact point [length].
        h_block: The same of the block; 0.7 ``h`` if ``None``, so that nodes do not match.
        fine: Distance from the contact point up to which the size is kept [length].
        growth: Growth of the size per distance from there on.
    """
    gmsh.model.add("half_cylinder_on_block")
    cylinder, edges = add_half_disk(radius, gap, cell)
    block, sides = add_symmetric_block(width, height, cell)
    boundaries = {f"cylinder/{name}": curves for name, curves in edges.items()}
    boundaries |= {f"block/{name}": curves for name, curves in sides.items()}
    of_block = {(2, block)} | {(1, curve) for curves in sides.values() for curve in curves}
    h_block = 0.7 * h if h_block is None else h_block

    def size(dim: int, tag: int, x: float, y: float) -> float:
        at_contact = h_block if (dim, tag) in of_block else h
        return at_contact + growth * max(0.0, np.hypot(x, y) - fine)

    with only_quadrilaterals():
        return generate({"cylinder": [cylinder], "block": [block]}, boundaries, size)


def add_half_disk(radius: float, gap: float, cell: str) -> tuple[int, dict[str, list[int]]]:
    """Add the half disk; return its surface, and its curves by name."""
    left, lowest, right, centre = add_points(
        [(-radius, gap + radius), (0.0, gap), (radius, gap + radius), (0.0, gap + radius)]
    )
    arc = [
        gmsh.model.geo.addCircleArc(start, centre, end)
        for start, end in ((left, lowest), (lowest, right))
    ]
    top = add_lines([right, left])
    return add_surface(arc + top, cell), {"arc": arc, "top": top}


def add_symmetric_block(width: float, height: float, cell: str) -> tuple[int, dict[str, list[int]]]:
    """Add the block, with a node in the middle of its top; return its surface and curves."""
    x, y = 0.5 * width, -height
    points = add_points([(-x, y), (x, y), (x, 0.0), (0.0, 0.0), (-x, 0.0)])
    bottom, right, *top, left = add_lines(points, closed=True)
    sides = {"bottom": [bottom], "right": [right], "top": top, "left": [left]}
    return add_surface([bottom, right, *top, left], cell), sides


@contextmanager
def only_quadrilaterals() -> Iterator[None]:
    """Let gmsh leave no triangles where surfaces are recombined."""
    name, full_quad = "Mesh.RecombinationAlgorithm", 3
    before = gmsh.option.getNumber(name)
    gmsh.option.setNumber(name, full_quad)
    try:
        yield
    finally:
        gmsh.option.setNumber(name, before)


if __name__ == "__main__":
    write(build, "half_cylinder_on_block.msh")
