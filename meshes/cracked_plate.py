# SPDX-License-Identifier: MIT
"""A plate with a crack: a slit of no width, inside of the plate or from its left side.

Lengths are in any one unit; the centre of the plate is the origin. The two faces have different
curves and nodes at the same positions, and share the tips. The plate is cut along the crack and
from its tips to the sides, so that a face is on the outline of either part.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import dist
from typing import Any

from meshes._shared import add_lines, add_points, add_surface, divide, generate, write
from meshes.with_gmsh import gmsh


def build(
    *,
    points: Sequence[Sequence[float]] = ((-0.8, -0.6), (0.8, 0.6)),
    width: float = 40.0,
    height: float = 40.0,
    h: float = 0.04,
    growth: float = 0.2,
    facets: tuple[int, int] | None = None,
    cell: str = "triangle",
    order: int = 1,
) -> Any:
    """Build it as a new model of the running gmsh session; return ``gmsh.model``.

    Names: body ``plate``; boundaries ``crack/upper``, ``crack/lower``, ``plate/left``,
    ``plate/bottom``, ``plate/right`` and ``plate/top``.

    Args:
        points: Tip, kinks if any, and tip of the crack from left to right, shape (n, 2) [length].
            A first point on the left side is the mouth of the crack.
        width: Width of the plate [length].
        height: Its height [length].
        h: Size of cells at a tip [length].
        growth: Growth of this size with the distance from the nearest tip [1].
        facets: Numbers of equal facets of each straight part of the upper and the lower face; by
            default facets have the size of cells, on both faces the same.
        cell: ``"triangle"`` or ``"quadrilateral"``.
        order: Order of the cells.
    """
    x = 0.5 * width
    inside = all(abs(p[1]) < 0.5 * height for p in points) and points[-1][0] < x
    ascends = all(p[0] < q[0] for p, q in pairwise(points))
    if not (len(points) > 1 and inside and ascends and -x <= points[0][0]):
        raise ValueError("right is a crack inside of the plate, whose points ascend in x")
    gmsh.model.add("cracked_plate")
    is_edge = points[0][0] == -x
    y = 0.5 * height
    corners = add_points([(-x, -y), (x, -y), (x, y), (-x, y)])
    sides = add_points([(-x, points[0][1]), (x, points[-1][1])])
    tips = add_points([points[0], points[-1]])
    faces, left = {}, {"upper": sides[0], "lower": sides[0]}
    if is_edge:
        left["upper"] = add_points([points[0]])[0]
    for name, count in zip(left, facets or (0, 0)):
        start = left[name] if is_edge else tips[0]
        faces[name] = add_lines([start, *add_points(points[1:-1]), tips[1]])
        for curve in faces[name] if count else ():
            divide(curve, count)
    to_left = [] if is_edge else add_lines([sides[0], tips[0]])
    to_right = add_lines([tips[1], sides[1]])
    below = add_lines([left["lower"], *corners[:2], sides[1]])
    above = add_lines([sides[1], *corners[2:], left["upper"]])
    back = [-curve for curve in (*to_right[::-1], *faces["lower"][::-1], *to_left[::-1])]
    surfaces = [
        add_surface([*below, *back], cell),
        add_surface([*to_left, *faces["upper"], *to_right, *above], cell),
    ]
    boundaries = {
        "plate/left": [below[0], above[2]],
        "plate/bottom": [below[1]],
        "plate/right": [below[2], above[0]],
        "plate/top": [above[1]],
        **{f"crack/{name}": curves for name, curves in faces.items()},
    }
    ends = [points[-1]] if is_edge else [points[0], points[-1]]

    def size(_dim: int, _tag: int, x: float, y: float) -> float:
        return h + growth * min(dist((x, y), end[:2]) for end in ends)

    model = generate({"plate": surfaces}, boundaries, size)
    model.mesh.setOrder(order)
    return model


if __name__ == "__main__":
    write(build, "cracked_plate.msh")
