# SPDX-License-Identifier: MIT
"""Linear interpolation between the nodes of a body, on its cells divided into triangles."""

from __future__ import annotations

from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from fenics_mortar.kernels.locate import box_triangles, interpolate
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices

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
    """Triangles between the nodes of a body, equal on all ranks.

    Attributes:
        X: Reference positions of the nodes, shape (n, 2) [length].
        nodes: Nodes of the triangles, shape (t, 3).
        boxes: Tree of their boxes, see ``kernels.tree``.
    """

    X: Array
    nodes: Indices
    boxes: Array

    def interpolate(self, values: Array, points: Array) -> Array:
        """Interpolate values (n, 2) at points (p, 2), nan outside: shape (p, 2) (local)."""
        found = np.empty((len(points), 2))
        interpolate(points, self.boxes, self.X, self.nodes, values, found)
        return found


def triangulate(space: DisplacementSpace, mine: Indices) -> Triangles:
    """Divide the cells of a body into triangles (collective).

    Args:
        space: Nodes of the displacement.
        mine: Local nodes of the body, ascending, shape (n,).
    """
    V = space.V
    comm, index_map, X = V.mesh.comm, V.dofmap.index_map, V.tabulate_dof_coordinates()[:, :2]
    to_global = np.asarray(index_map.local_to_global(mine.astype(np.int32)), np.int64)
    owned = mine < space.num_nodes
    number = np.full(len(X), -1)
    number[mine] = np.searchsorted(gathered(comm, to_global[owned]), to_global)
    cells = number[compat.dofmap(V)[: V.mesh.topology.index_map(2).size_local]]
    cells = cells[cells[:, 0] >= 0][:, np.array(DIVISIONS[cells.shape[1]])].reshape(-1, 3)
    X, triangles = gathered(comm, X[mine[owned]]), gathered(comm, cells)
    return Triangles(X, triangles, box_triangles(X, triangles))


def gathered(comm: MPI.Comm, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Concatenate the rows of all ranks in their order (collective)."""
    return values if comm.size == 1 else np.concatenate(comm.allgather(values))
