# SPDX-License-Identifier: MIT
"""Normals at corners inside a slave surface: normal of the one facet that faces the master.

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

At sharp edges in space the same holds. The facets at a node of a sharp edge are divided into sides,
within which the surface is smooth. The normal is the average over the side that faces the nearest
part of the master, or over all facets if the master is oblique to all sides, as below a wedge.
Facets of the other sides have no partner, unless another node of theirs on a sharp edge takes their
normal.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse.csgraph import connected_components

from fenics_mortar.kernels.space.normals import edge_coefficients
from fenics_mortar.kernels.space.shapes import triangles_of
from fenics_mortar.kernels.space.triangles import facing_normals
from fenics_mortar.kernels.tree import build_tree, spatial_order
from fenics_mortar.utils.arrays import Array, Flags, Indices

if TYPE_CHECKING:
    from fenics_mortar.interface.curve_surface import Curve

# A node is a corner if the undeformed outline turns there by more than this angle [radian], that of
# a regular hexagon; curves are meshed finer.
TURN = np.pi / 3.0
# Present turn of a corner [radian], 40 degrees, up to which the averaged normal is used. It is well
# below ``TURN``: strains do not turn corners of hexagons by so much, and the choice is not theirs.
BLUNT = TURN * 2.0 / 3.0
# Master facets are equally near to a corner if their distances differ by less than this fraction of
# the shorter facet at the corner [1]; their mean normal is used.
EQUALLY_NEAR = 0.1


def links_at_corners(
    surface: Curve, x: Array, master: Curve, m: Array
) -> tuple[tuple[Indices, Indices], Flags]:
    """Links along a slave, cut at corners that take the normal of one facet (local).

    Args:
        surface: The slave.
        x: Positions of its nodes, shape (slave nodes, 2) [length].
        master: The master, with the body on the left of its facets.
        m: Positions of its nodes, shape (master nodes, 2) [length].

    Returns:
        Nodes before and after each one, (slave nodes,) each, and marks of the facets round a
        corner, which have no partner, (facets,), bool.
    """
    if surface.turns.max(initial=0.0) <= TURN:
        return (surface.previous, surface.following), np.zeros(len(surface.facets), bool)
    corners = corners_of(surface)
    roles = surface.roles
    candidates = None if roles is None else roles.masters_of_nodes(surface.facets, corners)
    ends = m[master.facets[:, [0, -1]]]
    facets = choose_facets(surface, corners, x, ends, candidates)
    return one_sided(surface, corners, facets)


def corners_of(surface: Curve) -> Indices:
    """Nodes at which the outline of a body turns left by more than ``TURN``, shape (k,) (local)."""
    return np.flatnonzero(surface.turns > TURN)


def choose_facets(
    surface: Curve, corners: Indices, x: Array, master: Array, candidates: Flags | None = None
) -> Indices:
    """Facet whose normal is used at each corner: -1 before it, 1 after it, 0 both (local).

    Args:
        surface: The slave.
        corners: Nodes, shape (k,).
        x: Positions of the slave's nodes, shape (slave nodes, 2) [length].
        master: Ends of the master's facets, the body on their left, shape (m, 2, 2) [length].
        candidates: Facets that may be masters at each corner, shape (k, m), bool; by default all.

    Returns:
        Shape (k,).
    """
    before, after = surface.chords(x, corners)
    tangents = np.stack([_unit(before), _unit(_unit(before) + _unit(after)), _unit(after)])
    normals = np.stack([tangents[..., 1], -tangents[..., 0]], axis=-1)
    radius = EQUALLY_NEAR * np.minimum(np.hypot(*before.T), np.hypot(*after.T))
    towards = np.array([
        _facing(x[j], n, radius[k], master if candidates is None else master[candidates[k]])
        for k, (j, n) in enumerate(zip(corners, normals[1], strict=True))
    ])  # fmt: skip
    return _nearest(normals, 1, towards) - 1


def _facing(point: Array, n: Array, radius: float, master: Array) -> Array:
    """Reversed normal of the master's facets nearest to a corner that face ``n``, shape (2,).

    ``n`` if no facet does.
    """
    chord = master[:, 1] - master[:, 0]
    square = (chord**2).sum(axis=1)
    reversed_normals = np.stack([-chord[:, 1], chord[:, 0]], axis=1) / np.sqrt(square)[:, None]
    faces = reversed_normals @ n > 0.0
    if not faces.any():
        return n
    arm = point - master[:, 0]
    s = np.clip((arm * chord).sum(axis=1) / square, 0.0, 1.0)
    away = np.where(faces, np.hypot(*(arm - s[:, None] * chord).T), np.inf)
    near = away <= away.min() + radius
    return _unit(reversed_normals[near].sum(axis=0))


def one_sided(
    surface: Curve, corners: Indices, facets: Indices
) -> tuple[tuple[Indices, Indices], Flags]:
    """Links along the curve, cut at corners, and facets that have no partner (local).

    Args:
        surface: The slave.
        corners: Nodes, shape (k,).
        facets: The result of ``choose_facets``, shape (k,).

    Returns:
        Nodes before and after each one, (slave nodes,), and marks (facets,), bool. A facet between
        two corners keeps its partner if its normal is used at one of them.
    """
    previous, following = surface.previous.copy(), surface.following.copy()
    previous[corners[facets > 0]] = -1
    following[corners[facets < 0]] = -1
    first, last = surface.facets[:, 0], surface.facets[:, -1]
    taken = np.isin(first, corners[facets > 0]) | np.isin(last, corners[facets < 0])
    left = np.isin(first, corners[facets < 0]) | np.isin(last, corners[facets > 0])
    return (previous, following), left & ~taken


def _nearest(normals: Array, middle: int, towards: Array) -> Indices:
    """Which of the ``normals`` (s, k, dim) is nearest to ``towards`` (k, dim), shape (k,) (local).

    The average, that of the number ``middle``, where the nearest is within half of ``BLUNT`` of it.
    """
    nearest = np.argmax(np.einsum("skc,kc->sk", normals, towards), axis=0)
    chosen = normals[nearest, np.arange(nearest.size)]
    is_blunt = np.einsum("kc,kc->k", chosen, normals[middle]) > np.cos(0.5 * BLUNT)
    return np.where(is_blunt, middle, nearest)


def _unit(vectors: Array) -> Array:
    """Unit vectors along the given vectors (..., dim), zero for zero."""
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(size > 0.0, size, 1.0)


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
            labels = connected_components(cosines >= np.cos(TURN), directed=False)[1]
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
        towards = _facing_faces(x[self.nodes], of_sides[:, -1], (master, m), shortest, largest)
        chosen = _nearest(of_sides.transpose(1, 0, 2), of_sides.shape[1] - 1, towards)[k]
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


def _facing_faces(
    points: Array, n: Array, other: tuple[Any, Array], shortest: Array, largest: float
) -> Array:
    """Reversed normals of the master's facets nearest to points that face ``n``, (k, 3).

    ``n`` if no facet does.
    """
    master, m = other
    triangles = triangles_of(master.facets)[0]
    triangles = triangles[spatial_order(m[triangles[:, 0]])]
    at = m, triangles, build_tree(m, triangles)
    return np.asarray(facing_normals(*at, points, n, EQUALLY_NEAR * shortest, shortest, largest))
