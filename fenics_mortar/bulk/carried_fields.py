# SPDX-License-Identifier: MIT
"""Nodal fields that are carried along a body by a translation.

The carried field at X is the field at X - s. A rank interpolates in its own cells, so that no rank
stores a whole body. Only positions that a rank does not find there are sent to the others: those
beyond the outline of its part of the body, within a distance of |s|.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.kernels.locate import locate
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.rounding import ROUNDING

# Triangles between the nodes of a cell, by their number in a cell; nodes are in the order of
# dolfinx: corners, edges, interior.
TRIANGLES = {
    3: [(0, 1, 2)],
    4: [(0, 1, 2), (1, 3, 2)],
    6: [(0, 5, 4), (5, 1, 3), (4, 3, 2), (3, 4, 5)],
    9: [(8, 0, 4), (8, 4, 1), (8, 1, 6), (8, 6, 3), (8, 3, 7), (8, 7, 2), (8, 2, 5), (8, 5, 0)],
}


class CarriedFields:
    """Piecewise linear fields on the nodes of a body.

    Args:
        comm: Communicator.
        X: Reference positions of the local nodes of the body, ghosts included, (n, 2) [length].
        cells: Nodes of the local cells of the body, numbered as in ``X``, shape (cells, k).
    """

    def __init__(self, comm: MPI.Comm, X: Array, cells: Indices) -> None:
        self._comm, self._X = comm, X
        split = np.array(TRIANGLES[cells.shape[1]])
        self._triangles: Indices = cells[:, split].reshape(-1, 3).astype(np.int64)
        self._neighbours = neighbours_of(self._triangles)
        corners = self._triangles.ravel()
        self._at_nodes = np.argsort(corners, kind="stable") // 3
        self._starts = np.searchsorted(np.sort(corners), np.arange(len(X) + 1))

    def carried(self, values: Array, s: Array) -> Array:
        """Values of a field carried along by ``s`` (collective).

        Args:
            values: Values at the local nodes, shape (n, 2) [unit].
            s: The translation, shape (2,), equal on all ranks [length].

        Returns:
            Values at the local nodes, shape (n, 2) [unit]; nan where X - s is outside of the body.
        """
        points = self._X - s
        result = self._interpolated(points, self._first_triangles(np.arange(len(points))), values)
        missing = np.flatnonzero(np.isnan(result[:, 0]))
        asked: list[Array] = self._comm.allgather(points[missing])
        answers = [self._search(where, values) for where in asked]
        for found in self._comm.alltoall(answers):
            rest = np.isnan(result[missing, 0])
            result[missing[rest]] = found[rest]
        return result

    def _first_triangles(self, nodes: Indices, place: int = 0) -> Indices:
        """A triangle at each node, shape (nodes,); ``place`` counts those at the same node."""
        if not len(self._triangles):
            return np.zeros(len(nodes), np.int64)
        first, end = self._starts[nodes], self._starts[nodes + 1]
        return self._at_nodes[np.clip(np.minimum(first + place, end - 1), 0, None)]

    def _interpolated(self, points: Array, seeds: Indices, values: Array) -> Array:
        """Values (p, 2) at points (p, 2), nan where a walk from ``seeds`` (p,) ends outside."""
        if not len(self._triangles):
            return np.full(points.shape, np.nan)
        found, weights = np.empty(len(points), np.int64), np.empty((len(points), 3))
        locate(points, seeds, self._X, self._triangles, self._neighbours, found, weights)
        at = np.einsum("nk,nkc->nc", weights, values[self._triangles[found]])
        return np.where(found[:, None] >= 0, at, np.nan)

    def _search(self, points: Array, values: Array) -> Array:
        """Values (p, 2) at points (p, 2), nan outside of the cells of this rank (local).

        Walks begin at all triangles at the nearest node: outlines may be concave.
        """
        result = np.full(points.shape, np.nan)
        if not (len(points) and len(self._triangles)):
            return result
        low, high = self._X.min(axis=0), self._X.max(axis=0)
        margin = ROUNDING * (high - low).max()
        near = (points >= low - margin) & (points <= high + margin)
        rest = np.flatnonzero(near.all(axis=1))
        _, nearest = self._tree.query(points[rest]) if rest.size else (None, rest)
        for place in range(int(np.diff(self._starts).max())):
            seeds = self._first_triangles(nearest, place)
            result[rest] = self._interpolated(points[rest], seeds, values)
            still = np.isnan(result[rest, 0])
            rest, nearest = rest[still], nearest[still]
            if not rest.size:
                break
        return result

    @cached_property
    def _tree(self) -> Any:
        """Search tree of the nodes."""
        from scipy.spatial import cKDTree  # not imported by problems without such fields

        return cKDTree(self._X)


def neighbours_of(triangles: Indices) -> Indices:
    """Triangle opposite to each node of each triangle, -1 at the boundary, (t, 3) (local)."""
    sides = np.sort(np.stack([np.roll(triangles, -1 - k, axis=1)[:, :2] for k in range(3)], 1), 2)
    sides = sides.reshape(-1, 2)
    order = np.lexsort(sides.T)
    same = (np.diff(sides[order], axis=0) == 0).all(axis=1)
    first, second = order[:-1][same], order[1:][same]
    neighbours = np.full(3 * len(triangles), -1)
    neighbours[first], neighbours[second] = second // 3, first // 3
    return neighbours.reshape(-1, 3)
