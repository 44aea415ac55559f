# SPDX-License-Identifier: MIT
"""Slave and master roles of the facets of a surface that may touch itself.

All facets are put into one order. Of two facets that face each other, the first one is the slave. A
facet or node may be a slave of one facet and a master of another. Connected parts of a surface,
curves in the plane, are ordered by mean facet size, finest first, since a slave should be finer
than its master. Facets whose nodes are all prescribed come last, since they carry no multipliers.
The order follows from the undeformed mesh. Roles therefore do not change during a solve and do not
depend on ranks or numbering.

In the plane facets are ordered along each curve. If a curve is folded, one side of the fold
precedes the other along the curve. Roles change only at the bend, and at the start of a closed
curve.

In space the facets of each connected part are swept from one facet, nearest first, along the
surface. Where a part is folded, the points that meet are mirror images in the fold: the side of the
fold with the first facet is nearer to it everywhere. Roles change at the fold alone, wherever the
first facet lies. Only if it lay in the fold itself, as on the crease of a tube, both sides would be
equally far. It is therefore the extreme one in a direction that no mesh has.

Where other parts of a surface meet, as after a shear, roles may change on a line in the contact.
Two nodes that face each other there would have one gap; one of them hands its multiplier over, see
``space_mortar``.

Facets that are neighbours along the surface are not paired, see ``kernels.sight``; like any other
facet in between, they hide facets behind them. Facets that meet at a junction of cracks but are not
faces of one crack are not paired either: they touch in a point, as parts opposite each other where
two cracks cross. Corners that overlap by rounding could be separated along either crack, and the
gap along the crack that slides would be minus the slip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from fenics_mortar.interface.curve_surface import FOLD, Curve, chains
from fenics_mortar.interface.faces import Faces
from fenics_mortar.interface.surfaces import CurveRoles, FaceRoles
from fenics_mortar.kernels.passage import depths_inside
from fenics_mortar.kernels.space.normals import padded
from fenics_mortar.utils.arrays import SAME_PLACE, Array, Flags, Indices, cross_in_plane
from fenics_mortar.utils.errors import SurfaceError, format_point

# Digits to which the logarithm of the mean facet size is compared: parts with equal meshes are
# then ordered by their coordinates, not by rounding.
DIGITS = round(-np.log10(SAME_PLACE))
# Direction in which facets are ordered by their places [1]: no plane of symmetry contains it.
OBLIQUE = np.array([0.8320502943, 0.4902612396, 0.2594961847])


def _keys(surface: Any, part: Indices, within: Sequence[Array], fixed: Flags) -> Indices:
    """``Roles.keys`` of facets in parts (f,), numbered by their places (local).

    Args:
        surface: The surface.
        part: Part of each facet, shape (f,).
        within: Keys of the order in a part, the last one first, shape (f,) each.
        fixed: Whether a facet carries no multipliers, shape (f,), bool.
    """
    mean = np.bincount(part, surface.facet_sizes) / np.bincount(part)
    of_parts = np.argsort(np.round(np.log10(mean), DIGITS), kind="stable")
    keys = np.stack([part, part], axis=1)
    keys[np.lexsort((*within, np.argsort(of_parts)[part], fixed)), 0] = np.arange(part.size)
    return keys


def _roles_of_faces(surface: Faces, fixed: Flags) -> FaceRoles:
    """Roles of the facets of faces (local); see ``_keys``.

    Raises:
        SurfaceError: If facets fold back on each other at an edge, as at the tip of a crack.
    """
    graph = shared_nodes(surface.facets, surface.num_nodes)
    places = surface.X[surface.corners].mean(axis=1)
    _check_folds(surface, places)
    _, part = connected_components(graph, directed=False)
    along = np.round((places @ OBLIQUE) / (SAME_PLACE * surface.extent))
    by_place = np.lexsort((*places.T, along))
    _, first = np.unique(part[by_place], return_index=True)  # of each part
    distances = _distances(graph, places, by_place[first])
    distances = np.round(distances / (SAME_PLACE * surface.extent))
    part = np.argsort(np.argsort(first))[part]
    return FaceRoles(_keys(surface, part, (along, distances), fixed), _near(graph))


def shared_nodes(facets: Indices, num_nodes: int) -> csr_array:
    """Number of common nodes of ``facets`` (f, K), with itself too, shape (f, f)."""
    count, size = facets.shape
    owner = np.repeat(np.arange(count), size)
    at = owner, facets.ravel()
    incidence = coo_array((np.ones(owner.size), at), shape=(count, num_nodes)).tocsr()
    return csr_array(incidence @ incidence.T)


def _check_folds(surface: Faces, places: Array) -> None:
    """Check that no facet lies in front of one that it shares an edge with; see ``FOLD`` (local).

    Args:
        surface: The surface.
        places: Middles of the facets, shape (f, 3) [length].
    """
    i, j = (shared_nodes(surface.corners, surface.num_nodes) > 1.0).nonzero()
    x = surface.X[surface.corners]
    normals = np.cross(x[:, 1] - x[:, 0], x[:, -1] - x[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    ahead = np.einsum("kc,kc->k", places[j] - places[i], normals[i])
    opposite = np.einsum("kc,kc->k", normals[i], normals[j]) < np.cos(FOLD)
    folded = np.flatnonzero(opposite & (ahead > -SAME_PLACE * surface.facet_sizes[i]))
    if folded.size:
        at = 0.5 * (places[i[folded[0]]] + places[j[folded[0]]])
        raise SurfaceError(
            f"surface '{surface.name}' folds back on itself at {format_point(at)}, as at the tip "
            "of a crack: there is no normal; expected a slot with a bottom, since cracks in space "
            "are not supported"
        )


def _distances(graph: csr_array, places: Array, firsts: Indices) -> Array:
    """Lengths of the shortest ways from facets to the first ones, by their middles, (f,)."""
    i, j = graph.nonzero()
    lengths = np.linalg.norm(places[i] - places[j], axis=1)
    ways = coo_array((lengths, (i, j)), shape=graph.shape).tocsr()
    return np.asarray(dijkstra(ways, indices=firsts, min_only=True))


def _near(graph: csr_array) -> Indices:
    """Each facet, its neighbours and theirs, ascending, -1 for none, shape (f, c).

    The mesh cannot resolve a fold between them, as in the plane, see ``kernels.sight``.
    """
    i, j = (graph @ graph).nonzero()
    order = np.lexsort((j, i))
    return padded(i[order], j[order], graph.shape[0])


def in_contact_with_itself(surface: Any, may_carry: Flags) -> Any:
    """Copy of a surface with the roles of its facets (local).

    Args:
        surface: The surface.
        may_carry: Whether a node may carry a multiplier, shape (nodes,), bool.
    """
    roles_of: Any = _roles_of_faces if isinstance(surface, Faces) else _roles_of_curves
    return replace(surface, roles=roles_of(surface, ~may_carry[surface.facets].any(axis=1)))


def _roles_of_curves(surface: Curve, fixed: Flags) -> CurveRoles:
    """Roles of the facets of curves (local); see ``_keys``."""
    part, arcs = np.empty(len(surface.facets), np.int64), np.empty((len(surface.facets), 3))
    for number, facets in enumerate(facets_by_curve(surface)):
        along = np.concatenate([[0.0], np.cumsum(surface.facet_sizes[facets])])
        closed = surface.facets[facets[0], 0] == surface.facets[facets[-1], -1]
        part[facets] = number
        arcs[facets, :2] = np.stack([along[:-1], along[1:]], axis=1)
        arcs[facets, 2] = along[-1] if closed else np.inf
    return CurveRoles(_keys(surface, part, (arcs[:, 0],), fixed), arcs, ends_at_junctions(surface))


def ends_at_junctions(surface: Curve) -> Indices:
    """Junction of cracks at both ends of each facet and crack that leaves it, (f, 2, 2) (local).

    -1 where there is none. Faces are those of one crack if they fold back on each other at the
    junction, see ``curve_surface.FOLD``. Tips count as junctions of one crack.
    """
    found = np.full((len(surface.facets), 2, 2), -1, np.int64)
    _, node, count = np.unique(surface.nodes, return_inverse=True, return_counts=True)
    facet, end = np.nonzero(count[node][surface.facets[:, [0, -1]]] > 1)
    X = surface.X[surface.facets[facet, -end]]
    along = surface.X[surface.facets[facet, np.where(end, -2, 1)]] - X
    along /= np.hypot(*along.T)[:, None]
    near = SAME_PLACE * surface.facet_sizes[facet]
    for i in range(facet.size):
        here = np.hypot(*(X - X[i]).T) < near
        folded = here & (along @ along[i] > -np.cos(FOLD))
        found[facet[i], end[i]] = np.argmax(here), np.argmax(folded)
    return found


def facets_by_curve(surface: Curve) -> list[Indices]:
    """Numbers of the facets of each curve, in order along it, shape (facets,) each (local)."""
    begins = np.full(surface.num_nodes, -1)
    begins[surface.facets[:, 0]] = np.arange(len(surface.facets))
    starts = np.flatnonzero(surface.previous[surface.facets[:, 0]] < 0)
    return chains(begins[surface.facets[:, -1]], [*starts, *range(len(surface.facets))])


def starts_of_holes(surface: Any) -> Indices:
    """First nodes of closed curves around empty holes, none in space, shape (k,) (local).

    At the start of such a curve roles change within a face that may touch the opposite face. With
    multipliers on both faces, the gap between two nodes that meet would be constrained twice.
    """
    found: list[int] = []
    for facets in facets_by_curve(surface) if surface.dim == 2 else []:
        first = surface.facets[facets, 0]
        start, end = surface.X[first], np.roll(surface.X[first], -1, axis=0)
        if surface.facets[facets[-1], -1] != first[0] or cross_in_plane(start, end).sum() > 0.0:
            continue
        others = np.setdiff1d(surface.facets.ravel(), surface.facets[facets].ravel())
        chords = np.ascontiguousarray(surface.facets[facets][:, [0, -1]])
        if not depths_inside(surface.X, chords, surface.X[others]).any():
            found.append(first[0])
    return np.array(found, np.int64)
