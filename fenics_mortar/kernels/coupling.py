# SPDX-License-Identifier: MIT
"""Couplings of slave facets and master nodes within a sparsity pattern; see ``la.coupling``."""

import numpy as np

from fenics_mortar.kernels import kernel


@kernel
def are_known(known, slave, master, acting, num_masters):
    """Whether a pattern contains the couplings of all segments with an acting multiplier.

    Args:
        known: Numbers of pairs of a slave facet and a master node, ascending, shape (n,): first
            slave node times (``num_masters`` + 1) plus master node, or ``num_masters`` for none.
        slave: Slave nodes of the segments, shape (s, K).
        master: Their master nodes, shape (s, L).
        acting: Slave nodes whose multipliers act, shape (slave nodes,), bool.
        num_masters: Number of master nodes.
    """
    for s in range(slave.shape[0]):
        acts = False
        for j in slave[s]:
            acts = acts or acting[j]
        if acts:
            base = slave[s, 0] * (num_masters + 1)
            if not _contains(known, base + num_masters):
                return False
            for k in master[s]:
                if not _contains(known, base + k):
                    return False
    return True


@kernel
def _contains(known, number):
    """Whether the ascending array ``known`` contains a number."""
    place = np.searchsorted(known, number)
    return place < known.shape[0] and known[place] == number
