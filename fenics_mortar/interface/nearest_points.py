# SPDX-License-Identifier: MIT
"""Nearest points of a surface in space."""

from __future__ import annotations

import numpy as np

from fenics_mortar.interface.faces import CORNERS, Faces
from fenics_mortar.utils.arrays import Array, Indices


def nearest_points(x: Array, m: Array, surface: Faces) -> tuple[Indices, Array]:
    """Points of the facets around the nearest node that are nearest to given points (local).

    Facets are taken as triangles between their corners.

    Args:
        x: The points, shape (k, 3) [length].
        m: Positions of the surface's nodes, shape (n, 3) [length].
        surface: The surface.

    Returns:
        Corners of the triangle that has the nearest point, shape (k, 3), and their weights there,
        shape (k, 3) [1].
    """
    if not len(x):
        return np.empty((0, 3), np.int64), np.empty((0, 3))
    from scipy.spatial import cKDTree  # 50 ms, for solids only

    corners = surface.facets[:, : CORNERS[surface.facets.shape[1]]]
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
    """Barycentric coordinates of the points of triangles nearest to ``x`` (t, 3), shape (t, 3)."""
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
