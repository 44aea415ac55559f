# SPDX-License-Identifier: MIT
"""Sparsity pattern of contact terms in space, with a margin for sliding; see ``coupling``.

Patterns are products of incidence matrices, so that each pair of nodes occurs once.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, hstack

from fenics_mortar.interface.faces import Faces
from fenics_mortar.interface.linearization import Block
from fenics_mortar.interface.space_mortar import SpaceOperators
from fenics_mortar.la.coupling import MARGIN, Coupling, zero_block
from fenics_mortar.utils.arrays import Flags, Indices


class FaceCoupling(Coupling):
    """Master nodes that the slave facets of this rank may couple to; all methods are local.

    Facets around those that face each other are included, a ring of them for a margin of
    ``MARGIN``: a ring has eight times as many facets as a side of a curve.

    Args:
        o: Operators at the present state.
        faced: Slave nodes, and master nodes coupled to them by slip.
        margin: Number of facets on either side in the plane, see ``MARGIN``.
    """

    def __init__(self, o: SpaceOperators, faced: tuple[Indices, Indices], margin: int) -> None:
        self._slave, self._master = o.slave, o.master
        rings, s = max(1, margin // MARGIN), o.segments
        meets = _marks(s.facets[s.owner], s.master, (len(o.slave.facets), o.master.num_nodes))
        meets = meets + _by_slip(o, faced)
        own = _incidence(o.slave)
        near_facets, near_nodes = own @ own.T, _incidence(o.master)
        near_nodes = near_nodes.T @ near_nodes
        for _ in range(rings):
            meets = near_facets @ meets @ near_nodes
        self._near = _ones(meets)
        mine = np.zeros(len(o.slave.facets))
        mine[s.facets] = 1.0
        self._mine = np.flatnonzero(np.maximum(mine, np.diff(self._near.indptr) > 0))

    def contains(self, o: SpaceOperators, faced: tuple[Indices, Indices], acting: Flags) -> bool:
        """See ``Coupling``."""
        s = o.segments
        acts = acting[s.slave].any(axis=1)
        shape = len(o.slave.facets), o.master.num_nodes
        now = _marks(s.facets[s.owner[acts]], s.master[acts], shape)
        slips = acting[faced[0]]
        now = now + _by_slip(o, (faced[0][slips], faced[1][slips]))
        inside = bool((_ones(now) - _ones(now).multiply(self._near)).nnz == 0)
        used = s.facets[acting[o.facet_nodes].any(axis=1)]
        return inside and bool(np.isin(used, self._mine).all())

    @cached_property
    def _nodes(self) -> csr_array:
        """Nodes that each facet couples: slave nodes, then master nodes, (facets, nodes)."""
        ring = self._slave.stencil
        reached = _incidence(self._slave) @ _marks(
            np.arange(self._slave.num_nodes), ring, (self._slave.num_nodes,) * 2
        )
        return csr_array(hstack([reached, self._near]))[self._mine]

    @cached_property
    def _loaded(self) -> csr_array:
        """Nodes that the forces of each facet act on, in the order of ``_nodes``."""
        return csr_array(hstack([_incidence(self._slave), self._near]))[self._mine]

    @property
    def _dofs(self) -> Indices:
        """Dofs of slave nodes, then master nodes, shape (nodes, 3)."""
        return np.concatenate([self._slave.dofs, self._master.dofs])

    def derivative_pattern(self) -> Block:
        """See ``Coupling``."""
        i, k = (self._loaded.T @ self._nodes).nonzero()
        return zero_block(self._dofs[i], self._dofs[k])

    def law_pattern(self) -> tuple[Indices, Indices]:
        """See ``Coupling``."""
        i, k = (_incidence(self._slave)[self._mine].T @ self._nodes).nonzero()
        return i.astype(np.int64), self._dofs[k]

    def force_pattern(self) -> tuple[Indices, Indices]:
        """See ``Coupling``."""
        i, j = (self._loaded.T @ _incidence(self._slave)[self._mine]).nonzero()
        return self._dofs[i], j.astype(np.int64)

    def _borne(self, dofs: Sequence[Indices]) -> tuple[Indices, Indices]:
        """See ``Coupling``."""
        return self._meeting(self._loaded, dofs)

    def _reached(self, dofs: Sequence[Indices]) -> tuple[Indices, Indices]:
        """See ``Coupling``."""
        return self._meeting(self._nodes, dofs)

    def _meeting(self, of_facets: csr_array, dofs: Sequence[Indices]) -> tuple[Indices, Indices]:
        """Slave nodes, and ``dofs`` of the nodes ``of_facets`` at each of them, (p,) each."""
        j, k = (_incidence(self._slave)[self._mine].T @ of_facets).nonzero()
        starts, found = (0, self._slave.num_nodes), []
        for start, of_nodes in zip(starts, dofs, strict=False):
            here = (k >= start) & (k < start + len(of_nodes))
            numbers = of_nodes[k[here] - start]
            pairs = np.stack([np.repeat(j[here], numbers.shape[1]), numbers.ravel()])
            found.append(np.unique(pairs[:, pairs[1] >= 0], axis=1))
        carriers, numbers = np.concatenate(found, axis=1).astype(np.int64)
        return carriers, numbers


def _incidence(surface: Faces) -> csr_array:
    """Nodes of the facets, shape (facets, nodes)."""
    shape = len(surface.facets), surface.num_nodes
    return _marks(np.arange(len(surface.facets)), surface.facets, shape)


def _marks(rows: Indices, columns: Indices, shape: tuple[int, int]) -> csr_array:
    """Ones at ``rows`` (r,) and ``columns`` (r, c), without those of -1."""
    i = np.repeat(rows, columns.shape[1])
    j = columns.ravel()
    used = j >= 0
    return _ones(csr_array((np.ones(used.sum()), (i[used], j[used])), shape=shape))


def _ones(matrix: csr_array) -> csr_array:
    """Ones at the entries of a matrix."""
    found = csr_array(matrix)
    found.sum_duplicates()
    found.data[:] = 1.0
    return found


def _by_slip(o: SpaceOperators, faced: tuple[Indices, Indices]) -> csr_array:
    """Master nodes coupled by slip to a facet of each slave node, (facets, master nodes)."""
    facet = np.full(o.slave.num_nodes, -1)
    facet[o.facet_nodes] = o.segments.facets[:, None]
    j, l = faced
    here = facet[j] >= 0
    shape = len(o.slave.facets), o.master.num_nodes
    return _marks(facet[j[here]], l[here][:, None], shape)
