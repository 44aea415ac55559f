# SPDX-License-Identifier: MIT
"""Functions of all mesh scripts: names, chains of lines, structured patches, writing a file."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from meshes.mapped_grids import check_cell
from meshes.with_gmsh import gmsh


def add_points(x: Sequence[Sequence[float]]) -> list[int]:
    """Add points of the plane, ``x`` of shape (num_points, 2); return their gmsh tags."""
    return [gmsh.model.geo.addPoint(float(p[0]), float(p[1]), 0.0) for p in x]


def add_lines(points: Sequence[int], *, closed: bool = False) -> list[int]:
    """Join points, given by their gmsh tags, by straight lines; return the tags of these."""
    ends = [*points[1:], points[0]] if closed else points[1:]
    return [gmsh.model.geo.addLine(p, q) for p, q in zip(points, ends)]


def divide(curve: int, facets: int, ratio: float = 1.0) -> None:
    """Divide a curve into facets, the last ``ratio`` times as long as the first."""
    if facets < 1:
        raise ValueError(f"a curve cannot be divided into {facets} facets")
    progression = ratio ** (1.0 / max(facets - 1, 1))
    gmsh.model.geo.mesh.setTransfiniteCurve(abs(curve), facets + 1, "Progression", progression)


def add_surface(curves: Sequence[int], cell: str, corners: Sequence[int] | None = None) -> int:
    """Add the surface inside of curves; return its gmsh tag.

    Args:
        curves: Tags of the curves one after the other counterclockwise, negative if run backwards.
        cell: ``"triangle"`` or ``"quadrilateral"``.
        corners: Tags of four points, between which rows and columns of cells run; none if the
            mesh has no structure.
    """
    check_cell(cell)
    geo = gmsh.model.geo
    surface = geo.addPlaneSurface([geo.addCurveLoop(list(curves))])
    if corners is not None:
        geo.mesh.setTransfiniteSurface(surface, "Left", list(corners))
    if cell == "quadrilateral":
        geo.mesh.setRecombine(2, surface)
    return surface


def add_block(
    x: np.ndarray, columns: int, layers: int, cell: str, *, ratio: float = 1.0, split: bool = False
) -> tuple[int, dict[str, int]]:
    """Add a block of four straight sides with a structured mesh.

    Args:
        x: Corners, shape (4, 2), counterclockwise from the lower left [length].
        columns: Number of facets of bottom and top.
        layers: Number of facets of left and right side, of both halves together if ``split``.
        cell: ``"triangle"`` or ``"quadrilateral"``.
        ratio: Height of the top layer by that of the bottom layer.
        split: Whether left and right side are two curves each, named top and bottom.

    Returns:
        gmsh tag of the surface, and of the curves by the name of the side.
    """
    corners = add_points(x)

    def side(i: int, *names: str) -> dict[str, int]:
        j = (i + 1) % 4
        middle = add_points([0.5 * (x[i] + x[j])]) if len(names) == 2 else []
        return dict(zip(names, add_lines([corners[i], *middle, corners[j]])))

    bottom, top = side(0, "bottom"), side(2, "top")
    right = side(1, "right/bottom", "right/top") if split else side(1, "right")
    left = side(3, "left/top", "left/bottom") if split else side(3, "left")
    for curves, facets, last_by_first in (
        (bottom, columns, 1.0),
        (right, layers // len(right), ratio),
        (top, columns, 1.0),
        (left, layers // len(left), 1.0 / ratio),
    ):
        for curve in curves.values():
            divide(curve, facets, last_by_first)
    sides = bottom | right | top | left
    return add_surface(list(sides.values()), cell, corners), sides


def name_group(dim: int, entities: Sequence[int], name: str) -> None:
    """Make a physical group of surfaces (``dim`` 2, a body) or curves (1, a boundary)."""
    tag = gmsh.model.addPhysicalGroup(dim, [abs(e) for e in entities])
    gmsh.model.setPhysicalName(dim, tag, name)


def generate(
    bodies: dict[str, list[int]],
    boundaries: dict[str, list[int]],
    size: Callable[[int, int, float, float], float] | None = None,
) -> Any:
    """Name the surfaces and curves of the current geometry, mesh it, and return ``gmsh.model``.

    Args:
        bodies: gmsh tags of the surfaces of each body.
        boundaries: gmsh tags of the curves of each boundary.
        size: Size of cells [length] in the entity of given dimension and tag at given x and y, for
            meshes without structure.
    """
    gmsh.model.geo.synchronize()
    for name, surfaces in bodies.items():
        name_group(2, surfaces, name)
    for name, curves in boundaries.items():
        name_group(1, curves, name)
    if size is not None:  # after 4.8 there is a sixth argument
        gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, *_: size(dim, tag, x, y))
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.removeSizeCallback()
    return gmsh.model


def turn(x: Sequence[Sequence[float]], angle: float) -> np.ndarray:
    """Turn points, shape (num_points, 2), about the origin, counterclockwise [radian]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(x) @ np.array([[c, s], [-s, c]])


def write(build: Callable[[], Any], default: str) -> None:
    """Build a mesh by the script's defaults; write it to the file given as first argument."""
    gmsh.initialize()
    build()
    gmsh.write(sys.argv[1] if len(sys.argv) > 1 else default)
    gmsh.finalize()
