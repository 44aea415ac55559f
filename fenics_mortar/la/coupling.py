# SPDX-License-Identifier: MIT
"""Sparsity pattern of contact terms with a margin for sliding over a few facets.

A pattern of the present segments only, and with it the symbolic factorization, would change
whenever a segment appears. Explicit zeros for master facets next to the partners of a slave facet,
and for slave facets next to the contact zone, cost little, since contact surfaces are small
compared with the bulk. The pattern includes a multiplier at every slave node, and the forces of the
neighbours' multipliers, since the set of multiplier nodes may change. Open facets are included as
well, so that contact may grow. Only nodes with acting multipliers contribute to the matrix and have
to stay within the pattern; the partners of other nodes may be far away and may change with small
rotations. There is such a pattern in the plane only: in space its zeros would be most of the
entries, see ``sparse.with_rows``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import coo_array, csr_array

from fenics_mortar.contact.tied_rows import NO_ROWS, TiedField
from fenics_mortar.interface.mortar import Block, MortarOperators
from fenics_mortar.kernels.blocks import are_known

if TYPE_CHECKING:
    from fenics_mortar.contact.fluxes import Flux
    from fenics_mortar.utils.arrays import Flags, Indices

# Number of master facets in the pattern on either side of the partners of a slave facet, and of
# slave facets on either side of contact [facets]: sliding in a Newton iteration rarely exceeds the
# first. It is doubled each time contact exceeds the pattern, up to the last: 50 steps of ironing
# need 4 patterns instead of 11 then. A single solve would take up to 8 % longer with the last.
MARGIN, MAX_MARGIN = 4, 8


class Coupling:
    """Master nodes that the slave facets of this rank may couple to; all methods are local.

    Args:
        o: Operators at the present state.
        faced: Slave nodes, and master nodes coupled to them by slip.
        margin: Number of facets on either side, see ``MARGIN``.
    """

    def __init__(self, o: MortarOperators, faced: tuple[Indices, Indices], margin: int) -> None:
        self._slave, self._master = o.slave, o.master
        self._near_pairs = np.union1d(_near_pairs(o, margin), _faced(o, *faced))
        facet, partner = np.divmod(self._near_pairs, o.master.num_nodes + 1)
        meets = partner < o.master.num_nodes
        self._own, self._facet, self._partner = np.unique(facet), facet[meets], partner[meets]

    def contains(self, o: Any, faced: tuple[Indices, Indices], acting: Flags) -> bool:
        """Whether the pattern contains all couplings of a state.

        Args:
            o: Operators of the state.
            faced: Those of the state, see the class.
            acting: Slave nodes whose multipliers act; others do not contribute, (slave nodes,),
                bool.
        """
        s = o.segments
        if not are_known(self._near_pairs, s.slave, s.master, acting, o.master.num_nodes):
            return False
        if not faced[0].size:
            return True
        slips = acting[faced[0]]
        pairs = _faced(o, *(side[slips] for side in faced))
        return bool(np.isin(pairs, self._near_pairs).all())

    def derivative_pattern(self) -> Block:
        """Zeros at all possible derivatives of contact forces and gaps, in displacement dofs."""
        _, rows, columns = self._coupled()
        return zero_block(rows, columns)

    def law_pattern(self) -> tuple[Indices, Indices]:
        """Slave nodes (p,), and dofs (p, 2) of nodes that may occur in their law's rows."""
        slave, _, columns = self._coupled()
        return slave[slave >= 0], columns[slave >= 0]

    def _coupled(self) -> tuple[Indices, Indices, Indices]:
        """Pairs of nodes coupled by a facet: slave node (-1 for a master node) and dofs of both."""
        degree = self._slave.degree
        near = self._slave.along(self._own, range(-degree, 2 * degree + 1))
        index, which = np.nonzero(near >= 0)
        facet = np.concatenate([self._own[index], self._facet])
        dofs = np.concatenate(
            [self._slave.dofs[near[index, which]], self._master.dofs[self._partner]]
        )
        slave = np.concatenate([near[index, which], np.full(self._facet.size, -1)])
        order = np.argsort(facet, kind="stable")
        i, k = (order[group] for group in _pairs_within(facet[order]))
        return slave[i], dofs[i], dofs[k]

    def force_pattern(self) -> tuple[Indices, Indices]:
        """Dofs (p, 2) of nodes on which multipliers of slave nodes (p,) may act."""
        degree = self._slave.degree
        carriers = self._slave.along(self._facet, range(degree + 1))
        on_master = np.repeat(self._master.dofs[self._partner], degree + 1, axis=0)
        own = self._slave.along(self._own, range(degree + 1))
        borne, carrier = (np.ravel(a) for a in np.broadcast_arrays(own[:, :, None], own[:, None]))
        dofs = np.concatenate([on_master, self._slave.dofs[borne]])
        return dofs, np.concatenate([carriers.ravel(), carrier])

    # Fluxes of scalar fields: the loads of a slave node depend on all of its facets

    def flux_pattern(self, flux: Flux | TiedField) -> Block:
        """Zeros at all possible derivatives of a flux's loads, an entry each (collective).

        Those of a tied field are its constraint in the rows of the slave, of the condensed system.
        """
        if isinstance(flux, TiedField):
            return flux.pattern()
        j, dofs = self._reached([trace.dofs for trace in flux.traces])
        everywhere = [(j, dofs), self._reached([self._slave.dofs, self._master.dofs])]
        j, dofs = (np.concatenate(part) for part in zip(*everywhere, strict=True))
        carrier, load = self._loads(flux)
        loads = _marks(carrier, load, (self._slave.num_nodes, int(load.max(initial=-1)) + 1))
        numbers, at = np.unique(dofs, return_inverse=True)
        reached = flux.coupled @ _marks(j, at, (self._slave.num_nodes, numbers.size))
        rows, columns = (loads.T @ reached).nonzero()
        return zero_block(rows.astype(np.int64)[:, None], numbers[columns][:, None])

    def flux_force_pattern(self, flux: Flux | TiedField) -> tuple[Indices, Indices]:
        """Dofs (p, 1) on which multipliers of owned nodes (p,) may act by a flux (collective).

        None of a tied field, whose loads by multipliers are constant.
        """
        if isinstance(flux, TiedField):
            return NO_ROWS, NO_ROWS[:, 0]
        carrier, load = self._loads(flux)
        numbers, at = np.unique(load, return_inverse=True)
        loads = _marks(carrier, at, (self._slave.num_nodes, numbers.size))
        carrier, at = (flux.coupled @ loads).nonzero()
        mine = np.isin(carrier, self._slave.owned)
        return numbers[at[mine], None], carrier[mine].astype(np.int64)

    def _loads(self, flux: Flux) -> tuple[Indices, Indices]:
        """Slave nodes and the field's dofs that their fluxes may load, (p,) each (collective)."""
        pairs = self._reached([trace.dofs for trace in flux.traces])
        gathered = self._slave.comm.allgather(np.stack(pairs))
        j, dofs = np.unique(np.concatenate(gathered, axis=1), axis=1)
        return j, dofs

    def _reached(self, dofs: Sequence[Indices]) -> tuple[Indices, Indices]:
        """Slave nodes, and dofs of nodes that share a facet of this rank with them, (p,) each.

        Args:
            dofs: Those of the slave nodes and, unless it is an obstacle, of the master nodes,
                shape (nodes, r) each.
        """
        degree = self._slave.degree
        near = self._slave.along(self._own, range(-degree, 2 * degree + 1))
        nodes = [(near, self._own), (self._partner[:, None], self._facet)]
        found = [np.empty((2, 0), np.int64)]
        for of_nodes, (others, first) in zip(dofs, nodes, strict=False):
            carriers = self._slave.along(first, range(degree + 1))
            reached = np.where((others >= 0)[..., None], of_nodes[others], -1)
            both = np.broadcast_arrays(carriers[:, :, None, None], reached[:, None])
            pairs = np.stack([part.ravel() for part in both])
            found.append(np.unique(pairs[:, pairs[1] >= 0], axis=1))
        j, numbers = np.concatenate(found, axis=1)
        return j, numbers


def _marks(rows: Indices, columns: Indices, shape: tuple[int, int]) -> csr_array:
    """Matrix with positive entries at rows and columns (p,)."""
    return coo_array((np.ones(rows.size), (rows, columns)), shape=shape).tocsr()


def _near_pairs(o: MortarOperators, margin: int) -> Indices:
    """Numbers of pairs of a slave facet and a master node within ``margin`` of those it faces.

    A pair (first node i of the facet, master node k) has the number i (master nodes + 1) + k. Each
    facet also has a pair with k = master nodes, since a rigid obstacle has no nodes.
    """
    s, degree, none = o.segments, o.master.degree, o.master.num_nodes
    slave, master = _with_next_facets(o, margin, s.slave[:, 0], s.master)
    masters = np.full((len(slave), 1), none)
    if none:
        near = o.master.along(master[:, 0], range(-margin * degree, (margin + 1) * degree + 1))
        masters = np.hstack([masters, near])
    pairs = slave[:, None] * (none + 1) + masters
    return pairs[masters >= 0]


def _with_next_facets(
    o: MortarOperators, margin: int, slave: Indices, master: Indices
) -> tuple[Indices, Indices]:
    """Pairs of facets by the slave's first nodes, including slave facets next to contact.

    Slave facets without a partner are paired with the partners of facets up to ``margin`` away.
    """
    degree = o.slave.degree
    near = o.slave.along(slave, range(-margin * degree, margin * degree + 1, degree))
    ends = o.slave.along(near.ravel(), range(degree, degree + 1)).reshape(near.shape)
    index, which = np.nonzero((near >= 0) & (ends >= 0) & ~np.isin(near, slave))
    next_ = near[index, which]
    return np.concatenate([slave, next_]), np.concatenate([master, master[index]])


def _faced(o: MortarOperators, slave: Indices, master: Indices) -> Indices:
    """Numbers, as in ``_near_pairs``, of slave and master nodes, one facet per slave node."""
    facets = o.facet_nodes
    first = np.full(o.slave.num_nodes, -1)
    first[facets] = facets[:, :1]
    here = first[slave] >= 0
    return first[slave[here]] * (o.master.num_nodes + 1) + master[here]


def _pairs_within(group: Indices) -> tuple[Indices, Indices]:
    """All pairs of positions (i, k) within the same group; ``group`` (n,) is sorted."""
    _, start, group_of, counts = np.unique(
        group, return_index=True, return_inverse=True, return_counts=True
    )
    repeats = counts[group_of]
    i = np.repeat(np.arange(group.size), repeats)
    running = np.arange(i.size) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    return i, start[group_of][i] + running


def zero_block(rows: Indices, columns: Indices) -> Block:
    """Zeros in ``rows`` (p, k) and ``columns`` (p, l)."""
    return Block(rows, columns, np.zeros((*rows.shape, columns.shape[1])))
