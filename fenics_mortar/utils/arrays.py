# SPDX-License-Identifier: MIT
"""Arrays: types, read-only values, tolerances, least squares; points and segments in the plane.

The tolerances are relative differences below which numbers are considered equal.
"""

from __future__ import annotations

from typing import Any, Self

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
# Local numbers and tags of dolfinx.
Numbers = npt.NDArray[np.int32]


class Value:
    """Base of frozen dataclasses whose arrays are read-only."""

    def __post_init__(self) -> None:
        """Replace writable arrays by read-only copies."""
        for name, value in vars(self).items():
            vars(self)[name] = protected(value)

    def __setstate__(self, values: dict[str, Any]) -> None:
        """Values of a pickle or a deep copy, whose arrays are new and writable (local)."""
        for value in values.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        vars(self).update(values)

    def replaced(self, **values: Any) -> Self:
        """As ``dataclasses.replace``, without repeated checks of unchanged attributes (local).

        Args:
            values: The changed attributes, with their shapes and units.

        Raises:
            TypeError: If there is no attribute of a name.
        """
        new = object.__new__(type(self))
        vars(new).update(vars(self))
        for name, value in values.items():
            if name not in vars(self):
                raise TypeError(f"{type(self).__name__} has no attribute '{name}'")
            vars(new)[name] = protected(value)
        return new


def summed(values: Array, numbers: Indices, size: int) -> Array:
    """Sums (size,) of ``values`` (n,) [any unit] with equal ``numbers`` (n,), or n = 0 (local)."""
    sums = np.bincount(numbers, values, size)
    return sums.astype(np.float64, copy=False)  # without values numpy returns integers


def norms(vectors: Array) -> Array:
    """Lengths (n,) of vectors (n, 2) or (n, 3) [their unit] (local)."""
    return np.hypot(*vectors.T) if vectors.shape[1] == 2 else np.linalg.norm(vectors, axis=1)


def at_rows(record: Any, rows: Flags | Indices) -> Any:
    """A record (named tuple) of arrays (n, ...) with some of their ``rows`` (local)."""
    return type(record)(*(values[rows] for values in record))


def values_at(wanted: Indices, keys: Indices, values: npt.NDArray[Any], missing: int) -> Any:
    """The values (k,) that belong to some keys (local).

    Args:
        wanted: Integers, shape (k,).
        keys: Integers in any order, shape (n,).
        values: Integers that belong to ``keys``, shape (n,).
        missing: The value of those that are not among ``keys``.
    """
    if not keys.size:
        return np.full(wanted.shape, missing, values.dtype)
    order = np.argsort(keys, kind="stable")
    at = order[np.minimum(np.searchsorted(keys[order], wanted), order.size - 1)]
    return np.where(keys[at] == wanted, values[at], missing).astype(values.dtype)


def read_only_view(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """A read-only view of an array (local)."""
    view = array.view()
    view.flags.writeable = False
    return view


def protected(value: Any) -> Any:
    """A read-only copy of a writable array, and any other value itself (local)."""
    if isinstance(value, np.ndarray) and value.flags.writeable:
        value = value.copy()
        value.flags.writeable = False
    return value


# Spacing of double precision numbers at one, and the smallest positive normal number.
EPSILON = float(np.finfo(float).eps)
TINY = float(np.finfo(float).tiny)
# Results of a few operations that are equal in exact arithmetic differ by less than this fraction
# of the largest number in them [1]: 45 EPSILON.
LAST_DIGITS = 1e-14
# Results of whole computations that are equal in exact arithmetic differ by less than this fraction
# of the largest number in them [1]: seven digits more than EPSILON, for sums and cancellation.
ROUNDING = 1e-9
# Relative error of sums of up to thousands of terms, without cancellation [1].
SUM_ROUNDING = 1e-12
# Relative roundoff of assembled vectors and their resultants: sums of some hundred products [1].
ASSEMBLY_ROUNDING = 1e-13
# Relative size below which a quantity that vanishes at a solution is zero [1]: Newton's method
# stops at 1e-8.
SOLVED = 1e-6
# Positions are the same within this fraction of a facet [1]: coordinates in files may have as few
# as seven digits.
SAME_PLACE = 1e-6
# Half a facet [facet lengths], the resolution of a mesh. Faceted curves in contact are nearer to
# each other; deeper overlaps, and wider gaps between nodes in contact, are errors.
HALF_FACET = 0.5
# Frames that differ by less than this angle [radian] need not be rotated into each other: vectors,
# as contact forces with small sliding, differ by 2 % across and 0.02 % along, paths of length L by
# L / 200.
SMALL_ANGLE = 0.02
# Maximum number of steps of an iteration per unknown. Bisection of an interval of length 2 down to
# rounding takes 54, Newton's method for a few numbers 3 to 5, Lemke's method less than one pivot
# per variable.
MAX_STEPS = 60


def descending(sizes: npt.ArrayLike) -> Indices:
    """Numbers of ``sizes`` (n,) from the largest on (local).

    Those that are equal when rounded to ``SOLVED`` are in their own order: rounding differs with
    the number of ranks, which should not decide what a message names.
    """
    mantissas, exponents = np.frexp(np.asarray(sizes, float))
    return np.argsort(-np.ldexp(np.rint(mantissas / SOLVED), exponents), kind="stable")


def first_largest(sizes: npt.ArrayLike) -> int:
    """Number of the largest of ``sizes`` (n,), the first of equal ones as in ``descending``."""
    return int(descending(sizes)[0])


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
    sides = np.stack([cross_in_plane(first, c - a), cross_in_plane(first, d - a)])
    others = np.stack([cross_in_plane(second, a - c), cross_in_plane(second, b - c)])
    if not touching:
        return ((sides.min(axis=0) < -scale) & (sides.max(axis=0) > scale)) & (
            (others.min(axis=0) < -scale) & (others.max(axis=0) > scale)
        )
    separate = (np.sign(sides).prod(axis=0) > 0.0) | (np.sign(others).prod(axis=0) > 0.0)
    boxes = (np.maximum(a, b) >= np.minimum(c, d)) & (np.minimum(a, b) <= np.maximum(c, d))
    return ~separate & boxes.all(axis=1)


def angles_between(a: Array, b: Array) -> Array:
    """Angles from vectors ``a`` to ``b``, shapes (..., 2), shape (...) [radian] (local)."""
    return np.arctan2(cross_in_plane(a, b), (a * b).sum(axis=-1))


def cross_in_plane(a: Array, b: Array) -> Array:
    """Cross products of vectors (..., 2), shape (...) [product of their units] (local)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def nonnegative_least_squares(A: Array, b: Array) -> Array:
    """The x >= 0 with the smallest |A x - b| (Lawson & Hanson 1974, ch. 23; local).

    SciPy has the same method, but some releases (1.15) return points that are not stationary if
    columns depend on one another, as those of the nodes of a facet under rigid motions do.

    Args:
        A: Shape (m, n), few rows [1].
        b: Shape (m,) [1].

    Returns:
        x, shape (n,) [1]; the columns with x > 0 are linearly independent.
    """
    x, positive = np.zeros(A.shape[1]), list[int]()
    refused = np.zeros(x.size, bool)  # columns that rounding alone lets enter
    least = SUM_ROUNDING * np.linalg.norm(A, axis=0) * np.linalg.norm(b)
    for _ in range(MAX_STEPS * x.size):
        descent = A.T @ (b - A @ x)
        descent[refused | (x > 0.0) | (descent <= least)] = 0.0
        if not descent.any():
            break
        entering = int(descent.argmax())
        solution = np.linalg.lstsq(A[:, [*positive, entering]], b, rcond=None)[0]
        refused[entering] = solution[-1] <= 0.0
        if refused[entering]:
            continue
        refused[:] = False
        positive.append(entering)
        while solution.min(initial=1.0) <= 0.0:  # columns leave at the boundary
            now = x[positive]
            reach = np.full(now.size, np.inf)
            down = solution <= 0.0
            reach[down] = now[down] / (now[down] - solution[down])
            moved = now + reach.min() * (solution - now)
            stays = (moved > 0.0) & (reach > reach.min())
            x[positive] = np.where(stays, moved, 0.0)
            positive = [j for j, kept in zip(positive, stays, strict=True) if kept]
            solution = np.linalg.lstsq(A[:, positive], b, rcond=None)[0]
        x[positive] = solution
    return x
