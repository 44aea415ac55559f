# SPDX-License-Identifier: MIT
"""Bodies in space of boxes of cells whose nodes may be anywhere: blocks, plates, spheres, rings.

The counterpart in space of ``mapped_grids``. A body is an array of positions, (n + 1, m + 1, k + 1,
3): the first index runs from left to right (x of a block), the second from front to back (y), the
third from bottom to top (z). ``mesh`` needs no gmsh, ``build`` makes a model of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import permutations
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

import fenics_mortar as fm

CELLS = ("tetrahedron", "hexahedron")
SIDES = ("left", "right", "front", "back", "bottom", "top")
# Places in a cube of 3 x 3 x 3 nodes, in the order of VTK.
CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
RING = [(0, 1), (1, 2), (2, 3), (3, 0)]
EDGES = {
    "hexahedron": [*RING, *((i + 4, j + 4) for i, j in RING), *((i, i + 4) for i in range(4))],
    "tetrahedron": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
}
FACES = [(0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (2, 3, 7, 6), (0, 1, 2, 3), (4, 5, 6, 7)]
# Names of cells and facets in gmsh, and the order of its nodes of order 2 in that of VTK.
GMSH = {"tetrahedron": ("Tetrahedron", "Triangle"), "hexahedron": ("Hexahedron", "Quadrangle")}
TO_GMSH = {
    10: [0, 1, 2, 3, 4, 5, 6, 7, 9, 8],
    27: [*range(8), 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14, 24, 22, 20, 21, 23, 25, 26],
}


@dataclass(frozen=True)
class Box:
    """One body.

    Attributes:
        name: Name of the body.
        x: Positions of the nodes, shape (order n + 1, order m + 1, order k + 1, 3) [length].
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
        """Numbers of the nodes from 0 on, in the shape of the nodes."""
        shape = (self.x.shape[0] - self.closed, *self.x.shape[1:3])
        numbers = np.arange(np.prod(shape)).reshape(shape)
        return np.concatenate([numbers, numbers[:1]]) if self.closed else numbers


def mapped(
    counts: tuple[int, int, int],
    position: Callable[[np.ndarray, np.ndarray, np.ndarray], Sequence[np.ndarray]],
    *,
    order: int = 1,
    jiggle: float = 0.0,
    seed: int = 0,
) -> np.ndarray:
    """Positions of a box; ``position`` maps s, t, r in [0, 1] to x, y, z, arrays of one shape.

    Args:
        counts: Numbers of cells from left to right, from front to back, from bottom to top.
        position: The map.
        order: Order of the cells.
        jiggle: Largest random motion of the corners of cells, by the distance of neighbours in s, t
            and r; on the sides it is parallel to them, so that each side keeps its shape. Diagonals
            of order 2 then bend.
        seed: Of the random numbers.
    """
    axes = (np.linspace(0.0, 1.0, n + 1) for n in counts)
    parameters = np.array(np.meshgrid(*axes, indexing="ij"))
    shift = np.random.default_rng(seed).uniform(-jiggle, jiggle, parameters.shape)
    for axis, n in enumerate(counts):
        of_axis = np.moveaxis(shift[axis], axis, 0)
        of_axis[[0, -1]] = 0.0
        parameters[axis] += shift[axis] / n
    for axis in range(1, 4) if order == 2 else ():
        parameters = _with_middles(parameters, axis)
    s, t, r = parameters
    return np.stack([np.broadcast_to(x, s.shape) for x in position(s, t, r)], axis=3)


def _with_middles(values: np.ndarray, axis: int) -> np.ndarray:
    """Values with those in the middle between neighbours along an axis."""
    values = np.moveaxis(values, axis, 0)
    finer = np.empty((2 * len(values) - 1, *values.shape[1:]))
    finer[::2], finer[1::2] = values, 0.5 * (values[1:] + values[:-1])
    return np.moveaxis(finer, 0, axis)


def block(
    counts: tuple[int, int, int],
    *,
    size: Sequence[float] = (1.0, 1.0, 1.0),
    corner: Sequence[float] = (0.0, 0.0, 0.0),
    **options: Any,
) -> np.ndarray:
    """A block of ``size`` with its lower left front corner at ``corner``; see ``mapped``."""

    def position(*parameters: np.ndarray) -> list[np.ndarray]:
        return [c + a * s for c, a, s in zip(corner, size, parameters, strict=True)]

    return mapped(counts, position, **options)


def arrays(boxes: Sequence[Box], *, cell: str = "hexahedron", order: int = 1) -> dict[str, Any]:
    """Points, cells, bodies and boundaries of all boxes: arguments of ``mesh_from_arrays``.

    Args:
        boxes: The bodies.
        cell: ``"tetrahedron"`` (six in each cube of nodes) or ``"hexahedron"``.
        order: Order of the cells; those of order 2, whose edges bend, take 3 x 3 x 3 nodes each.
    """
    if cell not in CELLS:
        raise ValueError(f"cell is {cell!r}; right is one of {CELLS}")
    points, cells, bodies = [], [], {}
    facets: dict[str, list[np.ndarray]] = {}
    num_points = num_cells = 0
    for box in boxes:
        numbers = box.numbers()
        x = box.x.reshape(-1, 3)[np.unique(numbers, return_index=True)[1]]
        own = num_points + cells_of(numbers, x, cell, order)
        for side, nodes in _sides(num_points + numbers).items():
            if not box.closed or side not in SIDES[:2]:
                facets.setdefault(box.boundary(side), []).append(_facets(nodes, cell, order))
        bodies[box.name] = num_cells + np.arange(len(own))
        points.append(x)
        cells.append(own)
        num_points, num_cells = num_points + len(x), num_cells + len(own)
    return {
        "points": np.concatenate(points),
        "cells": np.concatenate(cells),
        "bodies": bodies,
        "boundaries": {name: np.concatenate(pieces) for name, pieces in facets.items()},
    }


def mesh(boxes: Sequence[Box], *, comm: MPI.Comm = MPI.COMM_WORLD, **options: Any) -> fm.MeshData:
    """Mesh of all bodies (collective); see ``arrays`` for the options."""
    return fm.mesh_from_arrays(**arrays(boxes, **options), comm=comm)


def build(boxes: Sequence[Box], *, cell: str = "hexahedron", order: int = 1) -> Any:
    """Build all bodies as a new model of the running gmsh session; return ``gmsh.model``."""
    from meshes._shared import name_group
    from meshes.with_gmsh import gmsh

    found = arrays(boxes, cell=cell, order=order)
    cells = found["cells"]
    cells = cells[:, TO_GMSH.get(cells.shape[1], slice(None))]
    gmsh.model.add("mapped_boxes")
    parts = [(3, GMSH[cell][0], order, name, cells[c]) for name, c in found["bodies"].items()]
    # Facets have order 1, whatever that of the cells.
    parts += [(2, GMSH[cell][1], 1, name, f) for name, f in found["boundaries"].items()]
    for dim, family, degree, name, nodes in parts:
        entity = gmsh.model.addDiscreteEntity(dim)
        if dim == 3:
            own = np.unique(nodes)
            gmsh.model.mesh.addNodes(3, entity, own + 1, found["points"][own].ravel())
        kind = gmsh.model.mesh.getElementType(family, degree)
        gmsh.model.mesh.addElementsByType(entity, kind, [], nodes.ravel() + 1)
        name_group(dim, [entity], name)
    return gmsh.model


def cells_of(numbers: np.ndarray, x: np.ndarray, cell: str, order: int) -> np.ndarray:
    """Nodes of the cells of a box of ``numbers`` at ``x`` (n, 3), with positive volume."""
    cubes = sliding_window_view(numbers, 3 * (order + 1,))[::order, ::order, ::order]
    cubes = cubes.reshape(-1, *3 * (order + 1,))
    ends = x[cubes[:, [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, -1]]]
    corners = np.array([CORNERS] if cell == "hexahedron" else _tetrahedra())
    if np.linalg.det(ends[:, 1:] - ends[:, :1]).sum() < 0.0:
        corners = corners[:, [0, 3, 2, 1, 4, 7, 6, 5] if cell == "hexahedron" else [0, 1, 3, 2]]
    places = np.array([_places(some, cell, order) for some in corners]) * order // 2
    return cubes[:, places[..., 0], places[..., 1], places[..., 2]].reshape(-1, places.shape[1])


def _tetrahedra() -> list[list[tuple[int, int, int]]]:
    """Corners of the six tetrahedra of a cube, along paths from one corner to the opposite."""
    found = []
    for axes in permutations(range(3)):
        path = np.cumsum([(0, 0, 0), *(2 * np.eye(3, dtype=int)[a] for a in axes)], axis=0)
        odd = np.linalg.det(np.eye(3)[list(axes)]) < 0.0
        found.append([tuple(p) for p in (path[[0, 1, 3, 2]] if odd else path).tolist()])
    return found


def _places(corners: np.ndarray, cell: str, order: int) -> np.ndarray:
    """Places of the nodes of a cell with these corners, (n, 3), in a cube of 3 x 3 x 3."""
    if order == 1:
        return corners
    parts = [corners, corners[np.array(EDGES[cell])].sum(axis=1) // 2]
    if cell == "hexahedron":
        parts += [corners[np.array(FACES)].sum(axis=1) // 4, [(1, 1, 1)]]
    return np.concatenate(parts)


def _sides(numbers: np.ndarray) -> dict[str, np.ndarray]:
    """Nodes of the sides in rows and columns, by name."""
    ends = [np.moveaxis(numbers, axis, 0)[end] for axis in range(3) for end in (0, -1)]
    return dict(zip(SIDES, ends, strict=True))


def _facets(nodes: np.ndarray, cell: str, order: int) -> np.ndarray:
    """Corners of the facets of a side, shape (f, 4), or of its triangles (2 f, 3)."""
    squares = sliding_window_view(nodes, (order + 1, order + 1))[::order, ::order]
    quads = squares[:, :, ::order, ::order].reshape(-1, 4)[:, [0, 2, 3, 1]]
    return quads if cell == "hexahedron" else quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def two_blocks() -> Any:
    """A small block on a larger one: an example."""
    lower = block((6, 6, 3), size=(1.5, 1.5, 0.6), corner=(-0.25, -0.25, -0.6))
    upper = block((5, 4, 3), size=(1.0, 1.0, 0.6))
    return build([Box("lower", lower), Box("upper", upper)])


if __name__ == "__main__":
    from meshes._shared import write

    write(two_blocks, "mapped_boxes.msh")
