# SPDX-License-Identifier: MIT
"""Normals at sharp edges inside a slave surface in space: those of the side that faces the master.

The counterpart of ``corners`` in the plane, where the reasons are. The facets at a node of a sharp
edge are divided into sides, within which the surface is smooth. The normal is the average over the
side that faces the nearest part of the master, or over all facets if the master is oblique to all
sides, as below a wedge. Facets of the other sides have no partner, unless another node of theirs on
a sharp edge takes their normal.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_mortar.interface.curve_surface import TURN
from fenics_mortar.kernels.space.inside import facing_normals
from fenics_mortar.kernels.space.normals import edge_coefficients
from fenics_mortar.kernels.space.pairs import spatial_order
from fenics_mortar.kernels.tree import build_tree
from fenics_mortar.utils.arrays import Array, Flags, Indices

# Master facets are equally near to a node if their distances differ by less than this fraction of
# the shortest edge at the node [1]; their mean normal is used.
EQUALLY_NEAR = 0.1

Around = tuple[Indices, Indices, Indices]


class SharpEdges:
    """Nodes of a surface on edges that turn by more than ``TURN`` away from the body, and sides.

    Args:
        surface: The surface, ``Faces``.

    Attributes:
        nodes: The nodes, shape (k,).
        sides: Side of each facet at each node in the order of ``Faces.around``, numbers from 0 on
            at each of the nodes, -1 at other nodes, shape (e,).
    """

    def __init__(self, surface: Any) -> None:
        self._surface = surface
        self._edges = np.array(edge_coefficients(surface.facets.shape[1]))
        starts, facet, _ = surface.around
        n, p, q = self._at_nodes(surface.X)
        owner = np.repeat(np.arange(surface.num_nodes), np.diff(starts))
        mean = np.zeros((surface.num_nodes, 3))
        np.add.at(mean, owner, n)
        turned = np.einsum("ec,ec->e", n, _unit(mean)[owner]) < np.cos(0.5 * TURN)
        self.sides, nodes = np.full(facet.size, -1), []
        for j in np.unique(owner[turned]):
            here = slice(starts[j], starts[j + 1])
            cosines = n[here] @ n[here].T
            if cosines.min(initial=1.0) >= np.cos(TURN):
                continue
            into = _unit(_unit(p[here]) + _unit(q[here]))
            away = into @ n[here].T  # of the facet in the row, over the facet in the column
            labels = _connected(cosines >= np.cos(TURN))
            if labels.max() and (away[labels[:, None] != labels] < -np.sin(0.5 * TURN)).any():
                self.sides[here] = labels
                nodes.append(j)
        self.nodes = np.array(nodes, np.int64)

    def choose(self, x: Array, master: Any, m: Array, largest: float) -> tuple[Around, Flags]:
        """Facets that determine the normal at each node, and those without partner (local).

        Args:
            x: Positions of the nodes, shape (n, 3) [length].
            master: The other surface.
            m: Positions of its nodes, shape (nodes of the master, 3) [length].
            largest: Distance up to which the master is searched [length].

        Returns:
            ``Faces.around`` with the chosen facets only, and marks of the facets, (f,), bool.
        """
        starts, facet, _ = around = self._surface.around
        alone = np.zeros(len(self._surface.facets), bool)
        if not self.nodes.size:
            return around, alone
        n, p, q = self._at_nodes(x)
        owner = np.repeat(np.arange(self._surface.num_nodes), np.diff(starts))
        at = np.full(self._surface.num_nodes, -1)
        at[self.nodes] = np.arange(self.nodes.size)
        entries = np.flatnonzero(self.sides >= 0)
        k, side = at[owner[entries]], self.sides[entries]
        of_sides = np.zeros((self.nodes.size, side.max() + 2, 3))
        np.add.at(of_sides, (k, side), n[entries])
        of_sides = _unit(of_sides)
        of_sides[:, -1] = _unit(of_sides.sum(axis=1))
        shortest = np.full(self.nodes.size, np.inf)
        edges = np.minimum(*(np.linalg.norm(e[entries], axis=1) for e in (p, q)))
        np.minimum.at(shortest, k, edges)
        towards = _facing(x[self.nodes], of_sides[:, -1], (master, m), shortest, largest)
        chosen = np.argmax(np.einsum("ksc,kc->ks", of_sides, towards), axis=1)[k]
        kept = (chosen == of_sides.shape[1] - 1) | (chosen == side)
        alone[facet[entries[~kept]]] = True
        alone[facet[entries[chosen == side]]] = False
        stays = np.ones(facet.size, bool)
        stays[entries[~kept]] = False
        counts = np.bincount(owner[stays], minlength=self._surface.num_nodes)
        begins = np.concatenate([[0], np.cumsum(counts)])
        return (begins, facet[stays], around[2][stays]), alone

    def _at_nodes(self, x: Array) -> tuple[Array, Array, Array]:
        """Unit normal and both edges of the facets at the nodes, (e, 3) each, see ``around``."""
        _, facet, place = self._surface.around
        corners = x[self._surface.facets[facet]]
        p, q = (np.einsum("ek,ekc->ec", of_edge[place], corners) for of_edge in self._edges)
        return _unit(np.cross(p, q)), p, q


def _facing(
    points: Array, n: Array, other: tuple[Any, Array], shortest: Array, largest: float
) -> Array:
    """Reversed normals of the master's facets nearest to points that face ``n``, (k, 3).

    ``n`` if no facet does.
    """
    master, m = other
    corners = master.corners
    fans = [corners[:, [0, i, i + 1]] for i in range(1, corners.shape[1] - 1)]
    triangles = np.concatenate(fans)
    triangles = triangles[spatial_order(m, triangles)]
    at = m, triangles, build_tree(m, triangles)
    return np.asarray(facing_normals(*at, points, n, EQUALLY_NEAR * shortest, shortest, largest))


def _connected(near: Flags) -> Indices:
    """Labels from 0 on of the groups that a symmetric relation (e, e) connects, (e,)."""
    reach = np.linalg.matrix_power(near.astype(float), len(near)) > 0.0
    return np.unique(reach.argmax(axis=1), return_inverse=True)[1]


def _unit(vectors: Array) -> Array:
    """Unit vectors along the given vectors (..., 3), zero for zero."""
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(size > 0.0, size, 1.0)
