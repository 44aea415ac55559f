# SPDX-License-Identifier: MIT
"""Sparsity pattern of contact terms with a margin for sliding over a few facets.

A pattern of the present segments alone would change, and with it the symbolic factorization,
whenever a new segment appears. Explicit zeros for neighbouring master facets cost little, since
contact surfaces are small compared with the bulk. Open facets are included, so that contact may
grow. A new pattern is needed only if an acting multiplier couples nodes outside of it: facets that
are far apart change partners after small rotations, but add nothing to the matrix.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fenics_mortar.interface.mortar import Block, MortarOperators
from fenics_mortar.utils.arrays import Indices

# Margin on either side of the master facets that a slave facet meets [facets]: a Newton iteration
# rarely slides further.
MARGIN = 4


class Reach:
    """Master nodes that the slave facets of this rank may couple to; all methods are local.

    Args:
        o: Operators at the present state.
        multiplier_nodes: Whether a slave node carries a multiplier, shape (slave nodes,), bool.
        faced: Slave nodes, and the master nodes that slip couples them to, shape (p,) each.

    Attributes:
        multiplier_nodes: Whether a slave node carries a multiplier, shape (slave nodes,), bool.
        idle: Whether it carries none, or multipliers of other nodes act on it as well.
    """

    def __init__(
        self,
        o: MortarOperators,
        multiplier_nodes: npt.NDArray[np.bool_],
        faced: tuple[Indices, Indices],
    ) -> None:
        self._slave, self._master = o.slave, o.master
        self.multiplier_nodes, self.idle = multiplier_nodes.copy(), _idle(o, multiplier_nodes)
        everywhere = np.ones(o.slave.num_nodes, bool)
        self._met = np.union1d(_met(o, MARGIN, everywhere), _faced(o, *faced))
        facet, partner = np.divmod(self._met, o.master.num_nodes + 1)
        meets = partner < o.master.num_nodes
        self._own, self._facet, self._partner = np.unique(facet), facet[meets], partner[meets]

    def contains(
        self,
        o: MortarOperators,
        multiplier_nodes: npt.NDArray[np.bool_],
        faced: tuple[Indices, Indices],
        acting: npt.NDArray[np.bool_],
    ) -> bool:
        """Whether the pattern contains all couplings of a state.

        Args:
            o: Operators of the state.
            multiplier_nodes: Of the state, shape (slave nodes,), bool.
            faced: Of the state, see the class.
            acting: Slave nodes whose multipliers act; others add nothing, (slave nodes,), bool.
        """
        slips = acting[faced[0]]
        pairs = np.concatenate([_met(o, 0, acting), _faced(o, *(side[slips] for side in faced))])
        inside = np.append(self._met, -1)[np.searchsorted(self._met, pairs)] == pairs
        near = o.facet_nodes[acting[o.facet_nodes].any(axis=1)]
        same = (self.multiplier_nodes == multiplier_nodes) & (
            self.idle == _idle(o, multiplier_nodes)
        )
        return bool(inside.all() and same[near].all())

    def derivative_pattern(self) -> Block:
        """Zeros at all possible derivatives of contact forces and gaps, in displacement dofs."""
        _, rows, columns = self._coupled()
        return zeros(rows, columns)

    def law_pattern(self) -> tuple[Indices, Indices]:
        """Slave nodes (p,), and dofs (p, 2) of the nodes that their rows of the law may contain."""
        slave, _, columns = self._coupled()
        return slave[slave >= 0], columns[slave >= 0]

    def _coupled(self) -> tuple[Indices, Indices, Indices]:
        """Pairs of nodes coupled by a facet: slave node (-1 for a master node) and dofs of both."""
        degree = self._slave.degree
        near = self._slave.along(self._own, range(-degree, 2 * degree + 1))
        place, which = np.nonzero(near >= 0)
        facet = np.concatenate([self._own[place], self._facet])
        dofs = np.concatenate(
            [self._slave.dofs[near[place, which]], self._master.dofs[self._partner]]
        )
        slave = np.concatenate([near[place, which], np.full(self._facet.size, -1)])
        order = np.argsort(facet, kind="stable")
        i, k = (order[places] for places in _pairs_within(facet[order]))
        return slave[i], dofs[i], dofs[k]

    def force_pattern(self, acting: npt.NDArray[np.bool_]) -> tuple[Indices, Indices]:
        """Dofs (p, 2) of nodes on which multipliers of other nodes (p,) may act.

        These are dofs of master nodes and of ``idle`` slave nodes.

        Args:
            acting: Slave nodes whose multipliers count, shape (slave nodes,), bool.
        """
        degree = self._slave.degree
        carriers = self._slave.along(self._facet, range(degree + 1))
        on_master = np.repeat(self._master.dofs[self._partner], degree + 1, axis=0)
        own = self._slave.along(self._own, range(degree + 1))
        idle, sharer = (np.ravel(a) for a in np.broadcast_arrays(own[:, :, None], own[:, None]))
        dofs = np.concatenate([on_master, self._slave.dofs[idle]])
        multiplier = np.concatenate([carriers.ravel(), sharer])
        acts = acting[multiplier]
        acts[len(on_master) :] &= self.idle[idle]
        return dofs[acts], multiplier[acts]


def _idle(o: MortarOperators, multiplier_nodes: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Slave nodes without multiplier or loaded by multipliers of others, (slave nodes,), bool.

    The latter are nodes of curved facets just beyond the edge of the master, see ``mortar``.
    """
    facet, _, k = np.nonzero(o.D * (1.0 - np.eye(o.D.shape[1])))
    idle = ~multiplier_nodes
    idle[o.facet_nodes[facet, k]] = True
    return idle


def _met(o: MortarOperators, margin: int, slaves: npt.NDArray[np.bool_]) -> Indices:
    """Numbers of pairs of a slave facet with any of ``slaves`` and a master node it meets.

    A pair (first node i of the facet, master node k) has the number i (master nodes + 1) + k. Each
    facet also has a pair with k = master nodes, since a rigid obstacle has no nodes.
    """
    s, degree, none = o.segments, o.master.degree, o.master.num_nodes
    counts = slaves[s.slave].any(axis=1)
    slave, master = s.slave[counts, 0], s.master[counts]
    masters = np.full((len(slave), 1), none)
    if none and not margin:
        masters = np.hstack([masters, master])
    elif none:
        near = o.master.along(master[:, 0], range(-margin * degree, (margin + 1) * degree + 1))
        masters = np.hstack([masters, near])
    pairs = slave[:, None] * (none + 1) + masters
    return pairs[masters >= 0]


def _faced(o: MortarOperators, slave: Indices, master: Indices) -> Indices:
    """Numbers as of ``_met`` of pairs of slave and master nodes, one facet per slave node."""
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


def zeros(rows: Indices, columns: Indices) -> Block:
    """Zeros in ``rows`` (p, k) and ``columns`` (p, l)."""
    return Block(rows, columns, np.zeros((*rows.shape, columns.shape[1])))
