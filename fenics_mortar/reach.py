# SPDX-License-Identifier: MIT
"""What contact may couple before it has slid over a few facets: room in the pattern of a matrix.

A pattern that held the present segments only would change whenever one appears, and with it the
symbolic factorization. Zeros for the master facets next to those that a slave facet meets cost
little, since contact is small beside the bulk.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fenics_mortar.mortar import Block, MortarOperators
from fenics_mortar.surfaces import Indices

# Master facets on either side of those that a slave facet meets.
MARGIN = 4


class Reach:
    """Master nodes that each slave facet of this rank's share may meet (all methods are local).

    Args:
        o: Operators at the present state.
        carries: Whether a slave node carries a multiplier, shape (slave nodes,), bool.
    """

    def __init__(self, o: MortarOperators, carries: npt.NDArray[np.bool_]) -> None:
        self._slave, self._master, self._carries = o.slave, o.master, carries.copy()
        self._met = _met(o, MARGIN)
        self._facet, self._partner = np.divmod(self._met, o.master.num_nodes)

    def holds(self, o: MortarOperators, carries: npt.NDArray[np.bool_]) -> bool:
        """Whether a state couples nothing else."""
        inside = np.isin(_met(o, 0), self._met, assume_unique=True)
        return bool(inside.all()) and np.array_equal(carries, self._carries)

    def derivative_pattern(self) -> Block:
        """Zeros wherever derivatives of contact forces and gaps may be, in displacement dofs."""
        first, degree = np.unique(self._facet), self._slave.degree
        near = self._slave.along(first, range(-degree, 2 * degree + 1))
        place, which = np.nonzero(near >= 0)
        facet = np.concatenate([first[place], self._facet])
        on_slave = self._slave.dofs[near[place, which]]
        order = np.argsort(facet, kind="stable")
        dofs = np.concatenate([on_slave, self._master.dofs[self._partner]])[order]
        i, k = _pairs_within(facet[order])
        return Block(dofs[i], dofs[k], np.zeros((i.size, 2, 2)))

    def force_pattern(self) -> tuple[Indices, Indices]:
        """Dofs (p, 2) where the multipliers of slave nodes (p,) may act, but for their own.

        These are of master nodes, and of slave nodes that carry no multiplier themselves.
        """
        steps = range(self._slave.degree + 1)
        carriers = self._slave.along(self._facet, steps)
        partner = np.broadcast_to(self._partner[:, None], carriers.shape)
        on_master = self._carries[carriers]
        own = self._slave.along(np.unique(self._facet), steps)
        idle, sharer = np.broadcast_arrays(own[:, :, None], own[:, None])
        on_slave = self._carries[sharer] & ~self._carries[idle]
        dofs = self._master.dofs[partner[on_master]], self._slave.dofs[idle[on_slave]]
        return np.concatenate(dofs), np.concatenate([carriers[on_master], sharer[on_slave]])


def _met(o: MortarOperators, margin: int) -> Indices:
    """Pairs of a slave facet, by its first node, and a master node, as sorted numbers."""
    s, degree = o.segments, o.master.degree
    masters = o.master.along(s.master[:, 0], range(-margin * degree, (margin + 1) * degree + 1))
    pairs = s.slave[:, :1] * o.master.num_nodes + masters
    return np.unique(pairs[masters >= 0])


def _pairs_within(group: Indices) -> tuple[Indices, Indices]:
    """All pairs (i, k) of places in one group; ``group`` (n,) is sorted."""
    _, start, group_of, counts = np.unique(
        group, return_index=True, return_inverse=True, return_counts=True
    )
    repeats = counts[group_of]
    i = np.repeat(np.arange(group.size), repeats)
    running = np.arange(i.size) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    return i, start[group_of][i] + running
