# SPDX-License-Identifier: MIT
"""Sides of the owned cells: neighbours on any rank, facets of surfaces, prescribed components.

Both cells of a side, and a surface, list the points of a symmetric rule in orders of their own.
They share the order by the linear functions of the corners, taken in the order of their global
numbers.
"""

from __future__ import annotations

from functools import cache
from itertools import permutations

import numpy as np

from fenics_mortar.bulk.cells import ReferenceCell
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.interface.obstacle_facets import gauss_points, tabulate
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Flags, Indices

# Decimals of the linear functions at points, which are equal or differ by 0.1 at least.
DECIMALS = 6


class CellSides:
    """Sides of the owned cells; the points are those of ``ReferenceCell.rule``.

    The constructor is collective.

    Args:
        bulk: The bodies.
        cell: The reference cell.

    Attributes:
        facets: Local facets, shape (cells, sides).
        inner: Whether there is a cell on the other side, on any rank, shape (cells, sides).
        prescribed: Whether a component is prescribed at all nodes, shape (cells, sides, dim).
    """

    def __init__(self, bulk: Bulk, cell: ReferenceCell) -> None:
        V, self._comm, dim = bulk.V, bulk.comm, bulk.space.dim
        topology, layout = V.mesh.topology, V.dofmap.dof_layout
        topology.create_connectivity(dim, dim - 1)
        shape = topology.index_map(dim).size_local, len(cell.sides)
        facets = topology.connectivity(dim, dim - 1).array[: shape[0] * shape[1]]
        self.facets: Indices = facets.reshape(shape).astype(np.int64)
        nodes = compat.dofmap(V)[: shape[0]]
        closures = [layout.entity_closure_dofs(dim - 1, k) for k in range(shape[1])]
        self.prescribed = bulk.prescribed[bulk.space.dofs[nodes[:, closures]]].all(axis=2)
        at = [[layout.entity_dofs(0, vertex)[0] for vertex in side] for side in cell.sides]
        corners = V.dofmap.index_map.local_to_global(nodes[:, at].ravel().astype(np.int32))
        self._corners = np.asarray(corners, np.int64).reshape(*shape, cell.sides.shape[1])
        self._order = common_order(self._corners)
        names = topology.index_map(dim - 1).local_to_global(facets.astype(np.int32))
        self._keys, where, count = np.unique(names, return_inverse=True, return_counts=True)
        self._where = where.reshape(shape)
        alone = self._keys[count == 1]
        others = [k for r, k in enumerate(self._comm.allgather(alone)) if r != self._comm.rank]
        shared = np.isin(alone, np.concatenate([alone[:0], *others]))
        self._shared = np.flatnonzero(count == 1)[shared]
        count[self._shared] = 2
        self.inner: Flags = count[self._where] > 1

    def of_surface(self, surface: Surface) -> tuple[Indices, Indices, Indices]:
        """Cells, their sides, and the facets of the surface on these sides, each (n,) (local)."""
        t, k = np.nonzero(~self.inner)
        theirs, mine = np.sort(surface.nodes[surface.corners]), np.sort(self._corners[t, k])
        both = np.concatenate([theirs, mine])
        number = np.unique(both, axis=0, return_inverse=True)[1].reshape(len(both))
        facet = np.full(len(both), -1)
        facet[number[: len(theirs)]] = np.arange(len(theirs))
        facet = facet[number[len(theirs) :]]
        on = facet >= 0
        return t[on], k[on], facet[on]

    def from_surface(self, surface: Surface, values: Array) -> tuple[Indices, Indices, Array]:
        """Values (facets, q, c) of a surface at the points of the sides on it (local).

        Returns:
            Cells (n,), their sides (n,), and values (n, q, c) [their unit].
        """
        t, k, facet = self.of_surface(surface)
        order = common_order(surface.nodes[surface.corners])[facet]
        common = np.take_along_axis(values[facet], order[..., None], axis=1)
        return t, k, _in_own_order(common, self._order[t, k])

    def sum_of_both(self, values: Array) -> Array:
        """Sum of values (cells, sides, q, c) of the one or two cells of a facet (collective).

        The result has the shape of ``values`` [unit of values].
        """
        common = np.take_along_axis(values, self._order[..., None], axis=2)
        total = np.zeros((self._keys.size, *values.shape[2:]))
        np.add.at(total, self._where, common)
        shared = self._shared
        parts = self._comm.allgather((self._keys[shared], total[shared]))
        for _, (theirs, sums) in (p for p in enumerate(parts) if p[0] != self._comm.rank):
            _, mine, their = np.intersect1d(self._keys[shared], theirs, True, return_indices=True)
            total[shared[mine]] += sums[their]
        return _in_own_order(total[self._where], self._order)


def common_order(corners: Indices) -> Indices:
    """Order of the points of facets that depends on the numbers of their corners alone (local).

    Args:
        corners: Global numbers of the corners, shape (..., c).

    Returns:
        Numbers of the points, shape (..., q).
    """
    size = corners.shape[-1]
    return _orders(size)[np.argsort(corners, axis=-1) @ size ** np.arange(size)]


@cache
def _orders(size: int) -> Indices:
    """Orders by the permutation of ``size`` corners, shape (size^size, q)."""
    shapes = tabulate(gauss_points(size)[0], size)[:, 0].round(DECIMALS)
    orders = np.zeros((size**size, len(shapes)), np.int64)
    for permutation in permutations(range(size)):
        place = permutation @ size ** np.arange(size)
        orders[place] = np.lexsort(shapes[:, permutation].T)
    return orders


def _in_own_order(common: Array, order: Indices) -> Array:
    """Values (..., q, c) in the common order, in the order of the facets' own points."""
    return np.take_along_axis(common, np.argsort(order, axis=-1)[..., None], axis=-2)
