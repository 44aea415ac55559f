# SPDX-License-Identifier: MIT
"""Normals at corners and sharp edges inside a slave surface: of the side that faces the master.

The averaged normal at a corner, for example of a plate whose whole outline is the slave, is oblique
to both facets. If the plate lies on a flat surface, the force on the corner would act along this
normal, while the gap changes along the normal of the flat. The linear complementarity problem of
the active sets is then not symmetric and may have no solution: the corner opens and closes
alternately. Also, the facet round the corner would find partners on the flat along interpolated
normals, at positive gaps, and the nodal gap could close only with an overlap.

Therefore the normal at a corner is that of the facet that faces the nearest part of the master, and
the other facet has no partner, as at the end of a surface. If the master is oblique to both facets,
as below a wedge, the averaged normal is used, and also where the corner turns by less at present:
the master, dented below it, may face one facet or the other in turn, and neither choice has an
equilibrium. The choice among the three normals depends on the present positions only and is
piecewise constant; derivatives are those of the chosen normal.

At sharp edges in space the same holds. The facets at a node are divided into sides, within which
the surface is smooth; at a corner in the plane they are the facets before and after it. The normal
is the average over the side that faces the nearest part of the master, or over all facets if the
master is oblique to all sides, as below a wedge. Facets of the other sides have no partner, unless
another sharp node of theirs takes their normal.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse.csgraph import connected_components

from fenics_mortar.kernels.space.normals import edge_coefficients
from fenics_mortar.kernels.space.shapes import triangles_of
from fenics_mortar.kernels.space.triangles import NO_ROLES, facing_normals
from fenics_mortar.kernels.tree import build_tree, spatial_order
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags, Indices

# A node is a corner if the undeformed outline turns there by more than this angle [radian], that of
# a regular hexagon; curves are meshed finer.
TURN = np.pi / 3.0
# Present turn of a corner [radian], 40 degrees, up to which the averaged normal is used. It is well
# below ``TURN``: strains do not turn corners of hexagons by so much, and the choice is not theirs.
BLUNT = TURN * 2.0 / 3.0
# Master facets are equally near to a corner if their distances differ by less than this fraction of
# the shorter facet at the corner [1]; their mean normal is used.
EQUALLY_NEAR = 0.1
# Distances of corners from facets that are found at once [1], which take 60 MB.
DISTANCES_AT_ONCE = 1_000_000


def _unit(vectors: Array) -> Array:
    """Unit vectors along the given vectors (..., dim), zero for zero."""
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(size > 0.0, size, 1.0)


class SharpEdges:
    """Nodes at which a surface turns by more than ``TURN`` away from the body, and their sides.

    Args:
        surface: The surface.

    Attributes:
        nodes: The nodes, shape (k,): corners in the plane, those on edges in space.
        sides: Side of each facet at each node in the order of ``Surface.around``, numbers from 0 on
            at each of the nodes, in the plane before and after it, -1 at other nodes, shape (e,).
    """

    def __init__(self, surface: Any) -> None:
        self._surface = surface
        starts, self._facet, self._place = surface.around
        self._owner = np.repeat(np.arange(surface.num_nodes), np.diff(starts))
        self.sides = self._of_faces() if surface.dim == 3 else self._of_curve()
        self._entries = np.flatnonzero(self.sides >= 0)
        self.nodes, self._at = np.unique(self._owner[self._entries], return_inverse=True)

    def _of_curve(self) -> Indices:
        """``sides`` of a curve, at nodes where it turns to the left."""
        is_sharp = self._surface.turns[self._owner] > TURN
        return np.where(is_sharp, np.where(self._place == 0, 1, 0), -1)

    def _of_faces(self) -> Indices:
        """``sides`` of faces: connected facets that turn by less than ``TURN``.

        Where they turn away from the body, each of two facets is below the other one's plane. How
        far does not matter: little for thin wedges, whose sides are nearly parallel.
        """
        surface, starts = self._surface, self._surface.around[0]
        n, (p, q) = self._normals(surface.X, np.arange(self._facet.size))
        mean = np.zeros((surface.num_nodes, 3))
        np.add.at(mean, self._owner, n)
        turned = np.einsum("ec,ec->e", n, _unit(mean)[self._owner]) < np.cos(0.5 * TURN)
        sides = np.full(self._facet.size, -1)
        for j in np.unique(self._owner[turned]):
            here = slice(starts[j], starts[j + 1])
            cosines = n[here] @ n[here].T
            if cosines.min(initial=1.0) >= np.cos(TURN):
                continue
            into = _unit(_unit(p[here]) + _unit(q[here]))
            below = into @ n[here].T < -ROUNDING  # facet in the row, plane of that in the column
            labels = connected_components(cosines >= np.cos(TURN), directed=False)[1]
            if (below & below.T)[labels[:, None] != labels].any():
                sides[here] = labels
        return sides

    def choose(self, x: Array, master: Any, m: Array, largest: float) -> Indices:
        """Side whose normal is used at each of the nodes, -1 for the average of all, (k,) (local).

        Args:
            x: Positions of the surface's nodes, shape (n, dim) [length].
            master: The other surface.
            m: Positions of its nodes, shape (nodes of the master, dim) [length].
            largest: Distance up to which the master is searched in space [length].
        """
        n, edges = self._normals(x, self._entries)
        side, count = self.sides[self._entries], self.nodes.size
        of_sides = np.zeros((count, side.max() + 2, x.shape[1]))
        np.add.at(of_sides, (self._at, side), n)
        of_sides = _unit(of_sides)
        mean = of_sides[:, -1] = _unit(of_sides.sum(axis=1))
        shortest = np.full(count, np.inf)
        np.minimum.at(shortest, self._at, np.linalg.norm(edges, axis=2).min(axis=0))
        if x.shape[1] == 2:
            ends, masters = m[master.facets[:, [0, -1]]], self._masters()
            parts = np.array_split(np.arange(count), 1 + count * len(ends) // DISTANCES_AT_ONCE)
            found = [
                _facing_curve(x[self.nodes[at]], mean[at], shortest[at], ends, masters[at])
                for at in parts
            ]
            towards = np.concatenate(found)
        else:
            given = (master, m), largest, self._slaves()
            towards = _facing_faces(x[self.nodes], mean, shortest, *given)
        nearest = np.argmax(np.einsum("ksc,kc->ks", of_sides, towards), axis=1)
        chosen = of_sides[np.arange(count), nearest]
        is_blunt = np.einsum("kc,kc->k", chosen, mean) > np.cos(0.5 * BLUNT)
        return np.where(is_blunt, -1, nearest)

    def links(self, chosen: Indices) -> tuple[tuple[Indices, ...], Flags]:
        """What determines the normal at each node, and facets that have no partner (local).

        Args:
            chosen: The result of ``choose``, shape (k,).

        Returns:
            Nodes before and after each one, in space ``Surface.around``, with chosen facets only;
            marks of the facets, (f,), bool. A facet keeps its partner if a node takes its normal.
        """
        surface, side, chosen = self._surface, self.sides[self._entries], chosen[self._at]
        facet, left = self._facet[self._entries], (chosen >= 0) & (chosen != side)
        alone = np.zeros(len(surface.facets), bool)
        alone[facet[left]] = True
        alone[facet[chosen == side]] = False
        gone = self._entries[left]
        if surface.dim == 2:
            beside = np.stack([surface.previous, surface.following])
            beside[side[left], self._owner[gone]] = -1
            return (beside[0], beside[1]), alone
        stays = np.ones(self._facet.size, bool)
        stays[gone] = False
        starts = np.append(0, np.cumsum(stays))[surface.around[0]]
        return (starts, self._facet[stays], self._place[stays]), alone

    def _masters(self) -> Flags:
        """Whether a facet is a master of a facet at each of the nodes, (k, f), bool, or (k, 1)."""
        surface = self._surface
        if surface.roles is None:
            return np.ones((self.nodes.size, 1), bool)
        return np.asarray(surface.roles.masters_of_nodes(surface.facets, self.nodes))

    def _slaves(self) -> tuple[Any, Indices, Indices]:
        """Roles in space, and the facets at each of the nodes: starts (k + 1,), facets (e,)."""
        roles, entries = self._surface.roles, self._entries
        starts = np.searchsorted(self._at, np.arange(self.nodes.size + 1))
        return NO_ROLES if roles is None else roles.of(entries), starts, self._facet[entries]

    def _normals(self, x: Array, entries: Indices) -> tuple[Array, Array]:
        """Unit normals (e, dim) of some facets at nodes, and edges from these (dim - 1, e, dim)."""
        facets = self._surface.facets[self._facet[entries]]
        if x.shape[1] == 2:
            chords = x[facets[:, -1]] - x[facets[:, 0]]
            return _unit(np.stack([chords[:, 1], -chords[:, 0]], axis=1)), chords[None]
        of_edges = edge_coefficients(facets.shape[1])
        place = self._place[entries]
        edges = [np.einsum("ek,ekc->ec", of_edge[place], x[facets]) for of_edge in of_edges]
        return _unit(np.cross(*edges)), np.stack(edges)


def _facing_curve(
    points: Array, n: Array, shortest: Array, ends: Array, candidates: Flags
) -> Array:
    """Reversed normals of the master's facets nearest to points that face ``n``, (k, 2).

    ``n`` if no facet does.
    """
    chords = ends[:, 1] - ends[:, 0]
    reversed_normals = _unit(np.stack([-chords[:, 1], chords[:, 0]], axis=1))
    arms = points[:, None] - ends[:, 0]
    s = np.clip((arms * chords).sum(axis=2) / (chords**2).sum(axis=1), 0.0, 1.0)
    away = np.linalg.norm(arms - s[:, :, None] * chords, axis=2)
    away[~(candidates & (n @ reversed_normals.T > 0.0))] = np.inf
    nearest = away.min(axis=1, initial=np.inf)
    near = (away <= (nearest + EQUALLY_NEAR * shortest)[:, None]) & (away < np.inf)
    return np.where(nearest[:, None] < np.inf, _unit(near @ reversed_normals), n)


def _facing_faces(
    points: Array, n: Array, shortest: Array, other: tuple[Any, Array], largest: float,
    slaves: tuple[Any, Indices, Indices],
) -> Array:  # fmt: skip
    """``_facing_curve`` in space, up to a ``largest`` distance [length].

    ``slaves``: see ``SharpEdges._slaves``.
    """
    (master, m), (roles, *facets) = other, slaves
    triangles, owner = triangles_of(master.facets)
    order = spatial_order(m[triangles[:, 0]])
    triangles = triangles[order]
    at = m, triangles, build_tree(m, triangles)
    limits = EQUALLY_NEAR * shortest, shortest, largest
    return np.asarray(facing_normals(*at, points, n, *limits, (roles, owner[order], *facets)))
