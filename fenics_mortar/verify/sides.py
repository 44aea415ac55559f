# SPDX-License-Identifier: MIT
"""CellSides of the cells of a rank and their neighbours on all ranks."""

from __future__ import annotations

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Flags, Indices


class CellSides:
    """CellSides of the owned cells: facets, nodes, neighbours and prescribed components.

    The constructor is collective.

    Args:
        bulk: The bodies.
        vertices: Vertices of each side of the reference cell, shape (sides, 2).

    Attributes:
        facets: Local facets, shape (cells, sides).
        nodes: Local nodes of the displacement in order, shape (cells, sides, degree + 1).
        inner: Whether there is a cell on the other side, on any rank, shape (cells, sides).
        prescribed: Whether a component is prescribed at all nodes, shape (cells, sides, 2).
    """

    def __init__(self, bulk: Bulk, vertices: Indices) -> None:
        V, self._comm = bulk.V, bulk.comm
        topology, layout, index_map = V.mesh.topology, V.dofmap.dof_layout, V.dofmap.index_map
        topology.create_connectivity(2, 1)
        num_cells, num_sides = topology.index_map(2).size_local, len(vertices)
        facets = topology.connectivity(2, 1).array[: num_cells * num_sides]
        self.facets: Indices = facets.reshape(num_cells, num_sides).astype(np.int64)
        closures = [layout.entity_closure_dofs(1, k) for k in range(num_sides)]
        along = [[a, *inside, b] for a, b, *inside in closures]
        self.nodes: Indices = compat.dofmap(V)[:num_cells][:, along].astype(np.int64)
        self.prescribed = bulk.prescribed[bulk.space.dofs[self.nodes]].all(axis=2)
        names = index_map.local_to_global(self.nodes[..., [0, -1]].ravel().astype(np.int32))
        self._ends = np.asarray(names, np.int64).reshape(num_cells, num_sides, 2)
        self._num_nodes = index_map.size_global
        self._keys = self._key(self._ends)
        ones = np.ones((num_cells, num_sides, 1, 1))
        self.inner: Flags = self.sum_of_both(ones)[..., 0, 0] > 1.5

    def _key(self, ends: Indices) -> Indices:
        """One number for the two ends (..., 2) of a facet, in any order."""
        return ends.min(axis=-1) * self._num_nodes + ends.max(axis=-1)

    def first(self, t: Indices, k: Indices) -> Indices:
        """First global nodes of sides ``k`` (n,) of cells ``t`` (n,), shape (n,) (local)."""
        return self._ends[t, k, 0]

    def of_surface(self, surface: Surface) -> tuple[Indices, Indices, Indices]:
        """Cells, their sides, and the facets of the surface on these sides, each (n,) (local)."""
        keys = self._key(surface.nodes[surface.facets[:, [0, -1]]])
        order = np.argsort(keys)
        t, k = np.nonzero(~self.inner & np.isin(self._keys, keys))
        return t, k, order[np.searchsorted(keys[order], self._keys[t, k])]

    def sum_of_both(self, values: Array) -> Array:
        """Sum of values (cells, sides, q, c) of the one or two cells of a facet (collective).

        The q points of each side lie symmetrically between its first and its last node. The
        result has the shape of ``values`` [unit of values].
        """
        backward = (self._ends[..., 0] > self._ends[..., 1])[..., None, None]
        one_way = np.where(backward, values[:, :, ::-1], values)
        keys, where, count = np.unique(self._keys, return_inverse=True, return_counts=True)
        where = where.reshape(self._keys.shape)
        total = np.zeros((keys.size, *values.shape[2:]))
        np.add.at(total, where, one_way)
        alone = np.flatnonzero(count == 1)
        branches = self._comm.allgather((keys[alone], total[alone]))
        for _, (theirs, sums) in (p for p in enumerate(branches) if p[0] != self._comm.rank):
            _, mine, their = np.intersect1d(keys[alone], theirs, True, return_indices=True)
            total[alone[mine]] += sums[their]
        return np.where(backward, total[where][:, :, ::-1], total[where])
