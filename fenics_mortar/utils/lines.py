# SPDX-License-Identifier: MIT
"""Intersections of straight line segments in the plane."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fenics_mortar.utils.near import near

Array = npt.NDArray[np.float64]
Pairs = npt.NDArray[np.int64]


def near_pairs(start: Array, end: Array) -> Pairs:
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
    start: Array, end: Array, pairs: Pairs, tolerance: float = 0.0, *, touching: bool = False
) -> npt.NDArray[np.bool_]:
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
