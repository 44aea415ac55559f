# SPDX-License-Identifier: MIT
"""Linear interpolation between the nodes of a body, on its cells divided into triangles.

Each rank interpolates in its own cells, so that no rank stores a whole body. Only points that a
rank does not find there are sent to the others.
"""

from __future__ import annotations

from typing import NamedTuple

from mpi4py import MPI

import numpy as np

from fenics_mortar.kernels.locate import box_triangles, interpolate
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.rounding import TINY

# Triangles between the nodes of a cell, by the number of nodes; for their order see ``bulk.cells``.
DIVISIONS = {
    3: [[0, 1, 2]],
    4: [[0, 1, 2], [1, 3, 2]],
    6: [[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]],
    9: [
        [0, 4, 8], [4, 1, 6], [8, 4, 6], [0, 8, 5], [5, 8, 7], [5, 7, 2], [8, 6, 3], [8, 3, 7],
    ],
}  # fmt: skip


class Triangles(NamedTuple):
    """Triangles between the local nodes of a body.

    Attributes:
        comm: Communicator.
        X: Reference positions of the local nodes, ghosts included, shape (n, 2) [length].
        nodes: Nodes of the triangles, shape (t, 3).
        boxes: Tree of their boxes, see ``kernels.tree``; empty without triangles.
    """

    comm: MPI.Comm
    X: Array
    nodes: Indices
    boxes: Array

    def interpolate(self, values: Array, points: Array) -> Array:
        """Interpolate a field at points in the body (collective).

        Args:
            values: Values at the local nodes, shape (n, 2) [unit].
            points: Points of this rank, mostly in its own cells, shape (p, 2) [length].

        Returns:
            Values at these points, nan outside of the body, shape (p, 2) [unit].
        """
        result = self._interpolate_here(values, points)
        if self.comm.size == 1:
            return result
        missing = np.flatnonzero(np.isnan(result[:, 0]))
        requests: list[Array] = self.comm.allgather(points[missing])
        requests[self.comm.rank] = np.empty((0, 2))
        answers = self.comm.alltoall([self._interpolate_here(values, there) for there in requests])
        for rank, found in enumerate(answers):
            if rank != self.comm.rank:
                rest = np.isnan(result[missing, 0])
                result[missing[rest]] = found[rest]
        return result

    def _interpolate_here(self, values: Array, points: Array) -> Array:
        """Values (p, 2) at points (p, 2), nan outside of the cells of this rank (local)."""
        found = np.full((len(points), 2), np.nan)
        if len(self.nodes) and len(points):
            interpolate(points, self.boxes, self.X, self.nodes, values, found)
        return found


def triangulate(space: DisplacementSpace, mine: Indices) -> Triangles:
    """Divide the local cells of a body into triangles (local).

    Args:
        space: Nodes of the displacement.
        mine: Local nodes of the body, ghosts included, ascending, shape (n,).
    """
    V = space.V
    X = V.tabulate_dof_coordinates()[:, :2]
    number = np.full(len(X), -1)
    number[mine] = np.arange(len(mine))
    cells = number[compat.dofmap(V)]
    triangles = cells[cells[:, 0] >= 0][:, np.array(DIVISIONS[cells.shape[1]])].reshape(-1, 3)
    return triangles_of(V.mesh.comm, X[mine], triangles)


def triangles_of(comm: MPI.Comm, X: Array, nodes: Indices) -> Triangles:
    """Triangles between nodes at ``X`` (n, 2) [length], their ``nodes`` (t, 3) (local).

    A search takes O(log t) only if neighbours in the order are neighbours in space: triangles are
    sorted along a Morton curve.
    """
    if not len(nodes):
        return Triangles(comm, X, nodes, np.empty((0, 4)))
    nodes = nodes[np.argsort(_morton_codes(X[nodes].mean(axis=1)), kind="stable")]
    return Triangles(comm, X, nodes, box_triangles(X, nodes))


def _morton_codes(points: Array) -> Indices:
    """Numbers of points (n, 2) [length] along a Morton curve, (n,), int (local)."""
    corner, size = points.min(axis=0), max(np.ptp(points, axis=0).max(), TINY)
    codes = ((points - corner) / size * (2**16 - 1)).astype(np.int64)
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        codes = (codes | (codes << shift)) & mask  # a zero bit before each bit
    return codes[:, 0] | (codes[:, 1] << 1)
