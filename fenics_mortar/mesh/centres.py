# SPDX-License-Identifier: MIT
"""Centres for cells of order 2 that have none: quadrilaterals of 8 nodes, hexahedra of 20."""

from __future__ import annotations

import numpy as np

from fenics_mortar.mesh.kinds import KINDS, codes_of, facets_of
from fenics_mortar.utils.arrays import Array, Indices


def with_centres(points: Array, cells: Indices, dim: int) -> tuple[Array, Indices]:
    """Points and cells with centres of faces and cells, so that the shape is the same (local).

    Args:
        points: Positions, shape (n, 2) or (n, 3) [length].
        cells: Numbers of the nodes of cells, shape (m, k), in the order of ``kinds``.
        dim: Dimension of the cells.

    Returns:
        Points and cells as given, or with 9 nodes instead of 8 in the plane, 27 instead of 20.
    """
    if (dim, cells.shape[1]) == (2, 8):
        return _with_groups(points, cells, [(cells, np.arange(len(cells)))])
    if (dim, cells.shape[1]) != (3, 20):
        return points, cells
    kind, count = KINDS[3, 27], len(cells)
    codes = codes_of(facets_of(cells, kind).reshape(-1, 4), len(points))
    _, first, number = np.unique(codes, return_index=True, return_inverse=True)
    faces = cells[:, kind.facet_nodes].reshape(-1, 8)[first]
    return _with_groups(
        points, cells, [(faces, number.reshape(count, 6)), (cells, np.arange(count))]
    )


def _with_groups(
    points: Array, cells: Indices, groups: list[tuple[Indices, Indices]]
) -> tuple[Array, Indices]:
    """Add centres of some entities (e, 8 or 20), given the numbers of these for each cell."""
    for nodes, number in groups:
        corners = 4 if nodes.shape[1] == 8 else 8
        at_corners, at_middles = points[nodes[:, :corners]], points[nodes[:, corners:]]
        weight = 0.5 if corners == 4 else 0.25  # of shape functions without centres
        centres = weight * at_middles.sum(axis=1) - 0.25 * at_corners.sum(axis=1)
        cells = np.column_stack([cells, len(points) + number])
        points = np.concatenate([points, centres])
    return points, cells
