# SPDX-License-Identifier: MIT
"""A half ball on a block of tetrahedra, with a fine mesh where they meet, as in Hertz's problem.

Lengths are in any one unit. The block's top is z = 0; the lowest point of the half ball is above
the origin, its flat side is on top.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from meshes._shared import name_group, write
from meshes.with_gmsh import gmsh

# Distance from a plane below which a side is on it, over the size of the block [1]
ON_PLANE = 1e-6


def build(
    *,
    radius: float = 1.0,
    width: float = 3.0,
    height: float = 1.5,
    gap: float = 0.0,
    h: float = 0.04,
    h_block: float | None = None,
    fine: float = 0.25,
    growth: float = 0.4,
) -> Any:
    """Build both bodies as a new model of the running gmsh session; return ``gmsh.model``.

    Names: bodies ``ball`` and ``block``; boundaries ``ball/sphere``, ``ball/top``, ``block/top``,
    ``block/bottom``, ``block/sides``.

    Args:
        radius: Radius of the ball [length].
        width: Length of the sides of the block's top, a square [length].
        height: Height of the block [length].
        gap: Height of the ball's lowest point above the block [length].
        h: Size of the ball's facets at the contact point [length].
        h_block: The same of the block; 0.8 ``h`` if ``None``, so that nodes do not match.
        fine: Distance from the contact point up to which the size is kept [length].
        growth: Growth of the size per distance from there on.
    """
    gmsh.model.add("half_ball_on_block")
    occ = gmsh.model.occ
    ball = occ.addSphere(0.0, 0.0, gap + radius, radius, angle1=-0.5 * np.pi, angle2=0.0)
    block = occ.addBox(-0.5 * width, -0.5 * width, -height, width, width, height)
    occ.synchronize()
    for name, volume, sides in (
        ("ball", ball, {"top": gap + radius}),
        ("block", block, {"top": 0.0, "bottom": -height}),
    ):
        name_group(3, [volume], name)
        _name_sides(name, volume, sides, "sphere" if name == "ball" else "sides", ON_PLANE * width)
    h_block = 0.8 * h if h_block is None else h_block

    def size(dim: int, tag: int, x: float, y: float, z: float, *_: float) -> float:
        """Sizes of edges and facets follow from those of points on both bodies."""
        at_contact = h_block if z < 0.5 * gap + ON_PLANE * width else h
        return float(at_contact + growth * max(0.0, np.sqrt(x**2 + y**2 + z**2) - fine))

    gmsh.model.mesh.setSizeCallback(size)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.removeSizeCallback()
    return gmsh.model


def _name_sides(
    body: str, volume: int, planes: dict[str, float], rest: str, tolerance: float
) -> None:
    """Name the horizontal sides at the heights ``planes``, and all others ``rest``."""
    found: dict[str, list[int]] = {}
    for _, side in gmsh.model.getBoundary([(3, volume)], oriented=False):
        _, _, low, _, _, high = gmsh.model.getBoundingBox(2, side)
        names = [n for n, z in planes.items() if max(abs(low - z), abs(high - z)) < tolerance]
        found.setdefault(names[0] if names else rest, []).append(side)
    for name, sides in found.items():
        name_group(2, sides, f"{body}/{name}")


if __name__ == "__main__":
    write(build, "half_ball_on_block.msh")
