# SPDX-License-Identifier: MIT
"""Slave and master roles of the facets of a surface that may touch itself; see ``self_contact``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_mortar.kernels.roles import tabulate_masters
from fenics_mortar.utils.arrays import Array, Flags, Indices


@dataclass(frozen=True)
class Roles(ABC):
    """Order of the facets of a surface.

    Attributes:
        keys: Position of each facet in the order, and number of its connected part, shape (f, 2).
    """

    keys: Indices

    @abstractmethod
    def of(self, facets: Indices) -> tuple[Any, ...]:
        """Arguments of the kernels for the slave facets ``facets`` (k,)."""

    @abstractmethod
    def masters_of(self, facets: Indices) -> Flags:
        """Whether each facet is a master of the facets ``facets`` (k,), shape (k, f), bool."""

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


@dataclass(frozen=True)
class CurveRoles(Roles):
    """Order of the facets of curves and their positions along these.

    Attributes:
        arcs: Start and end of each facet along its curve, undeformed, and length of the curve if it
            is closed, else inf, shape (f, 3) [length].
        ends: Of both ends of each facet the junction of cracks there, -1 for none, and the crack
            that leaves it, shape (f, 2, 2).
    """

    arcs: Array
    ends: Indices

    def of(self, facets: Indices) -> tuple[Indices, Indices, Array, Indices]:
        """See ``Roles`` and ``kernels.roles``."""
        return facets, self.keys, self.arcs, self.ends

    def masters_of(self, facets: Indices) -> Flags:
        """See ``Roles``."""
        masters = np.empty((facets.size, len(self.keys)), bool)
        tabulate_masters(self.keys, self.arcs, self.ends, facets, masters)
        return masters


@dataclass(frozen=True)
class FaceRoles(Roles):
    """Order of the facets of faces, and those that are too near to touch each other.

    Attributes:
        near: Each facet, its neighbours and theirs, -1 for none, shape (f, c).
    """

    near: Indices

    def of_nodes(self, facets: Indices, count: int) -> tuple[Indices, Indices]:
        """First and last position in the order of the facets at each node, (count,) each (local).

        Args:
            facets: Nodes of the facets, shape (f, K).
            count: Number of nodes.
        """
        order = self.keys[:, :1]
        earliest, latest = np.full(count, len(order)), np.full(count, -1)
        np.minimum.at(earliest, facets, order)
        np.maximum.at(latest, facets, order)
        return earliest, latest

    def of(self, facets: Indices) -> tuple[Indices, Indices]:
        """See ``Roles`` and ``kernels.space.pairs``: of all facets."""
        return np.ascontiguousarray(self.keys[:, 0]), self.near

    def masters_of(self, facets: Indices) -> Flags:
        """See ``Roles``."""
        order = self.keys[:, 0]
        masters = order[facets, None] < order
        at, column = np.nonzero(self.near[facets] >= 0)
        masters[at, self.near[facets[at], column]] = False
        return masters
