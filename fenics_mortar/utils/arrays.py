# SPDX-License-Identifier: MIT
"""Types of arrays, and arrays that are values.

Relative differences below which numbers are considered equal.
"""

from __future__ import annotations

from typing import Any, Self

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


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
