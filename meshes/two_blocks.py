# SPDX-License-Identifier: MIT
"""Two blocks, one upon the other, with meshes that do not match.

Lengths are in any one unit. The lower block stands on y = 0 with its left side on x = 0; the
interface is a straight line through the middle of the lower block's top. The defaults have the
10 x 10 and 20 x 10 quadrilaterals of Foltyn and Vlach (2016), who do not give their lengths; with
``split=True`` there are the halves of sides on which they prescribe the displacement.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from meshes._shared import add_block, generate, turn, write
from meshes.with_gmsh import gmsh


def build(
    *,
    cell: str = "quadrilateral",
    n_upper: int = 10,
    n_lower: int = 20,
    layers_upper: int = 10,
    layers_lower: int = 10,
    width_upper: float = 1.0,
    width_lower: float = 2.2,
    height_upper: float = 1.0,
    height_lower: float = 1.0,
    offset: float | None = None,
    gap: float = 0.0,
    inclination: float = 0.0,
    rotation: float = 0.0,
    grading: float = 1.0,
    split: bool = False,
) -> Any:
    """Build the blocks as a new model of the running gmsh session; return ``gmsh.model``.

    Names: bodies ``upper`` and ``lower``; boundaries ``upper/bottom``, ``upper/right``,
    ``upper/top``, ``upper/left``, and the same of ``lower``.

    Args:
        cell: ``"triangle"`` or ``"quadrilateral"``.
        n_upper: Number of facets of the upper block along the interface.
        n_lower: The same of the lower block.
        layers_upper: Number of layers of cells of the upper block.
        layers_lower: The same of the lower block.
        width_upper: Width of the upper block [length].
        width_lower: Width of the lower block [length].
        height_upper: Height of the upper block in the middle of its width [length].
        height_lower: The same of the lower block [length].
        offset: x of the upper block's left side [length], before gap and rotation; ``None`` puts
            it upon the middle of the lower block.
        gap: Distance of the blocks, along the normal of the interface [length].
        inclination: Angle of the interface to the x-axis, counterclockwise [radian].
        rotation: Angle by which all is turned about the origin, counterclockwise [radian].
        grading: Height of the layer farthest from the interface by that of the nearest.
        split: Whether the sides of the upper block are split at half their height: the names are
            then ``upper/left/top``, ``upper/left/bottom`` and so on the right.
    """
    if split and (layers_upper % 2 or grading != 1.0):
        raise ValueError("sides are split at half height only with even layers_upper, grading 1")
    slope, middle = np.tan(inclination), 0.5 * width_lower
    left = middle - 0.5 * width_upper if offset is None else offset
    right = left + width_upper

    def interface(x: float) -> tuple[float, float]:
        return x, height_lower + slope * (x - middle)

    def above(x: float) -> tuple[float, float]:
        return x, interface(0.5 * (left + right))[1] + height_upper

    lower = np.array([(0, 0), (width_lower, 0), interface(width_lower), interface(0)])
    upper = np.array([interface(left), interface(right), above(right), above(left)])
    upper += gap * np.array([-np.sin(inclination), np.cos(inclination)])

    gmsh.model.add("two_blocks")
    bodies, boundaries = {}, {}
    for name, corners, counts, ratio, halves in (
        ("lower", lower, (n_lower, layers_lower), 1.0 / grading, False),
        ("upper", upper, (n_upper, layers_upper), grading, split),
    ):
        x = turn(corners, rotation)
        surface, sides = add_block(x, *counts, cell, ratio=ratio, split=halves)
        bodies[name] = [surface]
        boundaries |= {f"{name}/{side}": [curve] for side, curve in sides.items()}
    return generate(bodies, boundaries)


if __name__ == "__main__":
    write(build, "two_blocks.msh")
