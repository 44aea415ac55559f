# SPDX-License-Identifier: MIT
"""Checked copies of the points and chains of points that describe obstacles."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.utils.arguments import check_number
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.lines import lines_cross, near_pairs


def edges_of(corners: Array) -> Array:
    """Vectors from each corner of a polygon (k, 2) to the next one, (k, 2) [length] (local)."""
    return np.roll(corners, -1, axis=0) - corners


def check_chain(points: npt.ArrayLike) -> Array:
    """Copy of three or more points of the plane, shape (k, 2) [length] (local).

    Raises:
        ValueError: For other values.
    """
    chain = check_floats("points", points)
    if chain.ndim != 2 or chain.shape[1] != 2 or len(chain) < 3 or not np.isfinite(chain).all():
        raise ValueError(
            f"points of shape {chain.shape}: expected at least three finite points (k, 2)"
        )
    return chain


def check_simple(what: str, chain: Array, *, closed: bool) -> None:
    """Raise an error if the chain of points (k, 2) intersects itself (local).

    Raises:
        ValueError: If two edges that are not neighbours intersect.
    """
    start, end = (chain, np.roll(chain, -1, axis=0)) if closed else (chain[:-1], chain[1:])
    pairs = near_pairs(start, end)
    after = (pairs[:, 1] - pairs[:, 0]) % (len(start) if closed else len(start) + 1)
    pairs = pairs[(after > 1) & (after < len(start) - 1 if closed else after > 1)]
    meets = lines_cross(start, end, pairs, touching=True)
    if meets.any():
        i, j = pairs[np.argmax(meets)]
        raise ValueError(
            f"the {what} intersects itself: edges from {format_point(start[i])} to "
            f"{format_point(end[i])} and from {format_point(start[j])} to {format_point(end[j])}; "
            "list the points in order along the curve"
        )


def check_floats(name: str, values: Any) -> Array:
    """Copy of an array of real numbers, of any shape [any unit] (local).

    Raises:
        ValueError: If the values are not real numbers.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name}={values!r}: expected real numbers")
    return np.array(array, float)


def check_finite(name: str, value: float) -> float:
    """A finite number [any unit] (local).

    Raises:
        ValueError: For other values.
    """
    check_number(name, value, "a finite number", np.isfinite)
    return float(value)


def check_vector(name: str, value: npt.ArrayLike) -> Array:
    """Copy of a finite vector of the plane, shape (2,) [any unit] (local).

    Raises:
        ValueError: For other values.
    """
    vector = check_floats(name, value)
    if vector.shape != (2,) or not np.isfinite(vector).all():
        raise ValueError(f"{name}={value!r}: expected two finite numbers")
    return vector
