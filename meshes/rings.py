# SPDX-License-Identifier: MIT
"""Two concentric rings, one inside of the other, as in a press fit.

Lengths are in any one unit; the centre is the origin. The inner ring reaches from radius ``a`` to
``b + interference``, the outer one from ``b`` to ``c``: with a positive interference the bodies
overlap before they are pressed apart. All nodes on the four circles are exactly on them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from meshes._shared import add_lines, add_points, add_surface, divide, generate, write
from meshes.with_gmsh import gmsh


def build(
    *,
    cell: str = "quadrilateral",
    a: float = 1.0,
    b: float = 2.0,
    c: float = 3.0,
    interference: float = 0.0,
    n_inner: int = 32,
    n_outer: int = 40,
    layers_inner: int = 4,
    layers_outer: int = 4,
    angles_inner: Sequence[float] | None = None,
    angles_outer: Sequence[float] | None = None,
) -> Any:
    """Build the rings as a new model of the running gmsh session; return ``gmsh.model``.

    Names: bodies ``inner`` and ``outer``; boundaries ``inner/inside``, ``inner/outside``,
    ``outer/inside`` and ``outer/outside``.

    Args:
        cell: ``"triangle"`` or ``"quadrilateral"``.
        a: Inner radius of the inner ring [length].
        b: Radius of the interface [length].
        c: Outer radius of the outer ring [length].
        interference: How much larger than ``b`` the inner ring is made [length].
        n_inner: Number of facets of each circle of the inner ring.
        n_outer: The same of the outer ring.
        layers_inner: Number of layers of cells of the inner ring.
        layers_outer: The same of the outer ring.
        angles_inner: Angles of the nodes of the inner ring, increasing by less than pi from one
            to the next [radian]; instead of ``n_inner``.
        angles_outer: The same of the outer ring, instead of ``n_outer``.
    """
    if not 0.0 < a < b < c or interference < 0.0:
        raise ValueError("right is 0 < a < b < c and interference >= 0")
    gmsh.model.add("rings")
    centre = add_points([(0.0, 0.0)])[0]
    bodies, boundaries = {}, {}
    for name, radii, facets, layers, angles in (
        ("inner", (a, b + interference), n_inner, layers_inner, angles_inner),
        ("outer", (b, c), n_outer, layers_outer, angles_outer),
    ):
        if angles is None:
            angles = 2.0 * np.pi * np.arange(facets) / facets
        bodies[name], inside, outside = add_ring(centre, radii, np.asarray(angles), layers, cell)
        boundaries |= {f"{name}/inside": inside, f"{name}/outside": outside}
    return generate(bodies, boundaries)


def add_ring(
    centre: int, radii: tuple[float, float], angles: np.ndarray, layers: int, cell: str
) -> tuple[list[int], list[int], list[int]]:
    """Add a ring, one sector per facet; return the surfaces and the arcs inside and outside."""
    steps = np.diff(angles, append=angles[0] + 2.0 * np.pi)
    if angles.ndim != 1 or not ((steps > 0.0) & (steps < np.pi)).all():
        raise ValueError("angles of nodes have to increase by less than pi, in one turn")
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = [add_points(radius * directions) for radius in radii]
    inside, outside = ([add_arc(centre, p, q) for p, q in pairs(circle)] for circle in points)
    spokes = [add_lines(ends)[0] for ends in zip(*points)]
    for curve in inside + outside:
        divide(curve, 1)
    for curve in spokes:
        divide(curve, layers)
    sectors = zip(pairs(spokes), inside, outside, pairs(points[0]), pairs(points[1]))
    surfaces = [
        add_surface([spoke, outer, -following, -inner], cell, [p, s, t, q])
        for (spoke, following), inner, outer, (p, q), (s, t) in sectors
    ]
    return surfaces, inside, outside


def add_arc(centre: int, start: int, end: int) -> int:
    """Add an arc, counterclockwise and shorter than a half circle; arguments are gmsh points."""
    return gmsh.model.geo.addCircleArc(start, centre, end)


def pairs(items: Sequence[int]) -> list[tuple[int, int]]:
    """Pair each item with the next one, and the last with the first."""
    return list(zip(items, [*items[1:], items[0]]))


if __name__ == "__main__":
    write(build, "rings.msh")
