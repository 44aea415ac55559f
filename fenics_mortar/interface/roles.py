# SPDX-License-Identifier: MIT
"""Slave and master roles of the facets of a surface that may touch itself; see ``self_contact``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fenics_mortar.kernels.roles import tabulate_masters
from fenics_mortar.utils.arrays import Array, Flags, Indices


class Roles(NamedTuple):
    """Order of the facets of a surface and their positions along its curves.

    Attributes:
        keys: Position of each facet in the order, and number of its curve, shape (f, 2).
        arcs: Start and end of each facet along its curve, undeformed, and length of the curve if it
            is closed, else inf, shape (f, 3) [length].
        ends: Of both ends of each facet the junction of cracks there, -1 for none, and the crack
            that leaves it, shape (f, 2, 2).
    """

    keys: Indices
    arcs: Array
    ends: Indices

    def of(self, facets: Indices) -> tuple[Indices, Indices, Array, Indices]:
        """Arguments of the kernels for the slave facets ``facets`` (k,); see ``kernels.roles``."""
        return facets, self.keys, self.arcs, self.ends

    def masters_of(self, facets: Indices) -> Flags:
        """Whether each facet is a master of the facets ``facets`` (k,), shape (k, f), bool."""
        masters = np.empty((facets.size, len(self.keys)), bool)
        tabulate_masters(self.keys, self.arcs, self.ends, facets, masters)
        return masters

    def masters_of_nodes(self, facets: Indices, nodes: Indices) -> Flags:
        """Whether a facet is a master of a facet at each of ``nodes`` (k,), (k, f), bool (local).

        Args:
            facets: Nodes of the facets, shape (f, K).
            nodes: Numbers of the nodes, shape (k,).
        """
        masters = np.zeros((nodes.size, len(self.keys)), bool)
        index = np.full(facets.max() + 1, -1)
        index[nodes] = np.arange(nodes.size)
        facet, column = np.nonzero(index[facets] >= 0)
        np.logical_or.at(masters, index[facets[facet, column]], self.masters_of(facet))
        return masters
