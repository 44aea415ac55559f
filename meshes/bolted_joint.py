# SPDX-License-Identifier: MIT
"""Meridian half plane of two round plates clamped by a bolt that is cut in its middle.

The axis is x = 0. The plates reach from y = -10 to 0 and to 10, head and nut six farther; the bolt
is cut at y = 0. Lengths are in mm, for example. No gmsh is needed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

import numpy as np

import fenics_mortar as fm

SHANK, HOLE, HEAD, RIM = 5.0, 5.5, 8.0, 12.0
THICKNESS, HEIGHT = 10.0, 6.0


def cells_in(x: np.ndarray, y: np.ndarray, inside: Callable[[Any, Any], Any]) -> Any:
    """Nodes and cells of a grid of lines ``x``, ``y`` whose middles are ``inside``."""
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=2).reshape(-1, 2)
    i, j = np.meshgrid(np.arange(x.size - 1), np.arange(y.size - 1), indexing="ij")
    first = (i * y.size + j).ravel()
    cells = first[:, None] + np.array([0, y.size, y.size + 1, 1])
    cells = cells[inside(*points[cells].mean(axis=1).T)]
    used, cells = np.unique(cells, return_inverse=True)
    return points[used], cells.reshape(-1, 4)


def edges_where(points: np.ndarray, cells: np.ndarray, condition: Any) -> np.ndarray:
    """Ends of the outer edges whose ends both satisfy a condition, shape (f, 2)."""
    edges = np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2)
    _, index, count = np.unique(
        np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True
    )
    outer = edges[index[count == 1]]
    return outer[condition(*points.T)[outer].all(axis=1)]


def mesh(size: float = 1.0, comm: MPI.Comm = MPI.COMM_WORLD) -> fm.MeshData:
    """Mesh of quadrilaterals of a ``size`` that divides all lengths (collective).

    Bodies "head" and "nut", the halves of the bolt with "cut", "under" and "axis", and the plates
    "upper" and "lower" with "seat", "shoulder", "joint" and "rim". The shoulder is not covered by
    head or nut.
    """
    bodies, boundaries, points, cells = {}, {}, [], []
    num_points = num_cells = 0
    top = THICKNESS + HEIGHT
    for name, sign in (("head", 1.0), ("nut", -1.0), ("upper", 1.0), ("lower", -1.0)):
        if name in ("head", "nut"):
            x, y = (np.linspace(0.0, end, round(end / size) + 1) for end in (HEAD, top))
            found, own = cells_in(x, y, lambda r, z: (r < SHANK) | (z > THICKNESS))
            sides = {
                "cut": lambda r, z: z == 0.0,
                "under": lambda r, z: (z == THICKNESS) & (r >= SHANK),
                "axis": lambda r, z: r == 0.0,
            }
        else:
            x = np.append(
                np.linspace(HOLE, HEAD, round((HEAD - HOLE) / size) + 1)[:-1],
                np.linspace(HEAD, RIM, round((RIM - HEAD) / size) + 1),
            )
            y = np.linspace(0.0, THICKNESS, round(THICKNESS / size) + 1)
            found, own = cells_in(x, y, lambda r, z: r > 0.0)
            sides = {
                "seat": lambda r, z: (z == THICKNESS) & (r <= HEAD),
                "shoulder": lambda r, z: (z == THICKNESS) & (r >= HEAD),
                "joint": lambda r, z: z == 0.0,
                "rim": lambda r, z: r == RIM,
            }
        for side, condition in sides.items():
            boundaries[f"{name}/{side}"] = num_points + edges_where(found, own, condition)
        bodies[name] = num_cells + np.arange(len(own))
        cells.append(num_points + (own if sign > 0.0 else own[:, ::-1]))
        points.append(found * [1.0, sign])
        num_points, num_cells = num_points + len(found), num_cells + len(own)
    return fm.mesh_from_arrays(
        np.concatenate(points), np.concatenate(cells), bodies, boundaries, comm=comm
    )
