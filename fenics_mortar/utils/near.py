# SPDX-License-Identifier: MIT
"""Pairs of nearby points, found with bins as wide as the distance."""

from __future__ import annotations

import numpy as np

from fenics_mortar.utils.arrays import Array, Indices


def near(a: Array, b: Array, radius: float) -> tuple[Indices, Indices]:
    """Numbers i, j of all pairs with a distance of at most ``radius``, each (k,) (local).

    A point is compared with those in its own and the eight adjacent bins, three runs of a sorted
    list.

    Args:
        a: Points, shape (n, 2) [length].
        b: Points, shape (m, 2) [length].
        radius: Largest distance, positive [length].
    """
    if not (len(a) and len(b)):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    low = np.minimum(a.min(axis=0), b.min(axis=0))
    bins_a, bins_b = (np.floor((points - low) / radius).astype(np.int64) for points in (a, b))
    stride = max(bins_a[:, 1].max(), bins_b[:, 1].max()) + 3  # an empty bin between two columns
    keys_a, keys_b = (bins[:, 0] * stride + bins[:, 1] for bins in (bins_a, bins_b))
    order = np.argsort(keys_b, kind="stable")
    keys_b = keys_b[order]
    pairs = []
    for column in (-stride, 0, stride):
        first = np.searchsorted(keys_b, keys_a + column - 1, side="left")
        count = np.searchsorted(keys_b, keys_a + column + 1, side="right") - first
        i = np.repeat(np.arange(len(a)), count)
        start = np.repeat(first - np.cumsum(count) + count, count)
        pairs.append((i, order[start + np.arange(i.size)]))
    i, j = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    close = ((a[i] - b[j]) ** 2).sum(axis=1) <= radius**2
    return i[close], j[close]
