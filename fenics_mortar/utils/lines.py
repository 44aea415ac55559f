# SPDX-License-Identifier: MIT
"""Points near each other, and straight line segments that intersect, in the plane."""

from __future__ import annotations

import numpy as np

from fenics_mortar.utils.arrays import Array, Flags, Indices


def near(a: Array, b: Array, radius: float) -> tuple[Indices, Indices]:
    """Numbers i, j of all pairs with a distance of at most ``radius``, each (k,) (local).

    They are found with bins as wide as the distance: a point is compared with those in its own and
    the eight adjacent bins, three runs of a sorted list.

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


def near_pairs(start: Array, end: Array) -> Indices:
    """Pairs (k, 2) of lines from ``start`` to ``end`` (n, 2) that may intersect (local).

    The criterion is the distance of midpoints; pairs are unique and in ascending order.
    """
    if len(start) < 2:
        return np.empty((0, 2), np.int64)
    longest = float(np.linalg.norm(end - start, axis=1).max())
    middles = 0.5 * (start + end)
    i, j = near(middles, middles, 1.001 * longest)
    pairs = np.stack([i, j], axis=1)[i < j]
    return pairs[np.lexsort(pairs.T[::-1])].astype(np.int64)


def lines_cross(
    start: Array, end: Array, pairs: Indices, tolerance: float = 0.0, *, touching: bool = False
) -> Flags:
    """Whether the lines of each pair cross, shape (k,) (local).

    Args:
        start: Start points of the lines, shape (n, 2) [length].
        end: End points, shape (n, 2) [length].
        pairs: Numbers of lines, shape (k, 2).
        tolerance: Fraction of its length by which each line has to extend beyond the other one.
        touching: Whether a common point suffices.
    """
    (a, b), (c, d) = ((start[pairs[:, i]], end[pairs[:, i]]) for i in range(2))
    first, second = b - a, d - c
    scale = tolerance * np.maximum((first**2).sum(axis=1), (second**2).sum(axis=1))
    sides = np.stack([_cross_product(first, c - a), _cross_product(first, d - a)])
    others = np.stack([_cross_product(second, a - c), _cross_product(second, b - c)])
    if not touching:
        return ((sides.min(axis=0) < -scale) & (sides.max(axis=0) > scale)) & (
            (others.min(axis=0) < -scale) & (others.max(axis=0) > scale)
        )
    separate = (np.sign(sides).prod(axis=0) > 0.0) | (np.sign(others).prod(axis=0) > 0.0)
    boxes = (np.maximum(a, b) >= np.minimum(c, d)) & (np.minimum(a, b) <= np.maximum(c, d))
    return ~separate & boxes.all(axis=1)


def _cross_product(a: Array, b: Array) -> Array:
    """Cross product of vectors (n, 2), shape (n,)."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
