# SPDX-License-Identifier: MIT
"""Nearest points of a surface in space."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fenics_mortar.interface.faces import CORNERS, Faces
from fenics_mortar.kernels.space.normals import facets_around
from fenics_mortar.utils.arrays import Array, Indices

# Numbers of the nearest nodes among which that of another part is looked for, one after the other,
# on a surface in contact with itself [1]: the last are those within 16 facets on a node's own part.
# Beyond there is no contact in one step.
TRIED = 32, 128, 1024
# Linear facets between all nodes of quadratic ones, by their number of nodes; see ``faces``.
DIVISIONS = {
    6: [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
    9: [[0, 4, 8, 7], [4, 1, 5, 8], [8, 5, 2, 6], [7, 8, 6, 3]],
}


class LinearFacets(NamedTuple):
    """Triangles or quadrilaterals with their corners alone, in the plane or in space.

    Attributes:
        facets: Nodes of each, shape (m, K).
        around: See ``Faces.around``.
    """

    facets: Indices
    around: tuple[Indices, Indices, Indices]


def linear_facets(facets: Indices, num_nodes: int) -> LinearFacets:
    """Linear facets between all nodes of facets (m, K), ordered as those of ``Faces`` (local)."""
    divisions = DIVISIONS.get(facets.shape[1])
    if divisions is not None:
        facets = facets[:, divisions].reshape(-1, len(divisions[0]))
    return LinearFacets(facets, facets_around(facets, num_nodes))


def nearest_on_master(o: Any, nodes: Indices) -> tuple[Indices, Array]:
    """Points of the master nearest to slave nodes at the state of ``o``; see ``nearest_points``.

    On a surface in contact with itself, of a part that faces the node and is its master. Where no
    such part is near, the node itself.
    """
    near = _nodes_of_masters(o, nodes) if o.slave.roles is not None else None
    return nearest_points(o.x[nodes], o.m, o.master, near)


def _nodes_of_masters(o: Any, nodes: Indices) -> Indices:
    """Nearest node of another part of a surface in contact with itself, or itself, (k,)."""
    from scipy.spatial import cKDTree

    surface, roles, found = o.slave, o.slave.roles, nodes.copy()
    count = surface.num_nodes
    earliest, latest = roles.of_nodes(surface.facets, count)
    facet, column = np.nonzero(roles.near >= 0)
    others = surface.facets[roles.near[facet, column]]
    beside = np.unique(surface.facets[facet][:, :, None] * count + others[:, None])
    tree, missing = cKDTree(o.x), np.arange(nodes.size)
    for number in np.minimum(TRIED, count):
        j = nodes[missing, None]
        l = tree.query(o.x[j[:, 0]], number)[1].reshape(missing.size, number)
        faces = np.einsum("jkc,jlc->jl", o.n[j], o.n[l]) < 0.0
        faces &= (earliest[j] < latest[l]) & ~np.isin(j * count + l, beside)
        at = faces.any(axis=1)
        found[missing[at]] = l[at, faces[at].argmax(axis=1)]
        missing = missing[~at]
    return found


def nearest_points(
    x: Array, m: Array, surface: Faces | LinearFacets, node: Indices | None = None
) -> tuple[Indices, Array]:
    """Points of the facets around the nearest node that are nearest to given points (local).

    Facets are taken as triangles between their corners.

    Args:
        x: The points, shape (k, dim) [length].
        m: Positions of the surface's nodes, shape (n, dim) [length].
        surface: The surface, or triangles in the plane.
        node: The nearest node of each point, shape (k,); looked for by default.

    Returns:
        Corners of the triangle that has the nearest point, shape (k, 3), and their weights there,
        shape (k, 3) [1].
    """
    if not len(x):
        return np.empty((0, 3), np.int64), np.empty((0, 3))
    from scipy.spatial import cKDTree  # 50 ms, for solids only

    corners = surface.facets[:, : CORNERS[surface.facets.shape[1]]]
    if node is None:
        used = np.unique(corners)
        node = used[cKDTree(m[used]).query(x)[1]]
    starts, facet, _ = surface.around
    counts = starts[node + 1] - starts[node]
    point = np.repeat(np.arange(len(x)), counts)
    at = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    near = corners[facet[starts[node[point]] + at]]
    fans = [near[:, [0, i, i + 1]] for i in range(1, corners.shape[1] - 1)]
    triangles, point = np.concatenate(fans), np.tile(point, len(fans))
    weights = _weights(x[point], m[triangles])
    distances = np.linalg.norm(np.einsum("tk,tkc->tc", weights, m[triangles]) - x[point], axis=1)
    order = np.lexsort((distances, point))
    first = order[np.searchsorted(point[order], np.arange(len(x)))]
    return triangles[first], weights[first]


def _weights(x: Array, corners: Array) -> Array:
    """Barycentric coordinates of the points of triangles nearest to ``x`` (t, dim), (t, 3)."""
    a, b, c = (corners[:, k] for k in range(3))
    u, v, w = b - a, c - a, x - a
    uu, uv, vv, wu, wv = (np.einsum("tc,tc->t", p, q) for p, q in
                          ((u, u), (u, v), (v, v), (w, u), (w, v)))  # fmt: skip
    det = uu * vv - uv * uv
    s, t = (wu * vv - wv * uv) / det, (wv * uu - wu * uv) / det
    inside = np.stack([1.0 - s - t, s, t], axis=1)
    best, least = inside, np.where((inside >= 0.0).all(axis=1), 0.0, np.inf)
    for i, j in ((0, 1), (1, 2), (2, 0)):  # the edges
        p, q = corners[:, i], corners[:, j]
        r = np.einsum("tc,tc->t", x - p, q - p) / np.einsum("tc,tc->t", q - p, q - p)
        r = np.clip(r, 0.0, 1.0)
        distance = np.linalg.norm(p + r[:, None] * (q - p) - x, axis=1)
        on_edge = np.zeros_like(inside)
        on_edge[:, i], on_edge[:, j] = 1.0 - r, r
        nearer = distance < least
        best, least = np.where(nearer[:, None], on_edge, best), np.where(nearer, distance, least)
    return best
