# SPDX-License-Identifier: MIT
"""Sums of the vectors of the linearized equations."""

from __future__ import annotations

from collections.abc import Iterable

from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.utils.arrays import Array

# Factor and vector.
Term = tuple[float, LinearVector]


def combine(terms: Iterable[Term]) -> LinearVector:
    """Sum of factor times vector; parts that are ``None`` in all vectors are ``None`` (local)."""
    u: Array | None = None
    z: list[Array] | None = None
    q: Array | None = None
    for factor, vector in terms:
        u, q = _plus(u, factor, vector.u), _plus(q, factor, vector.q)
        if vector.z is not None:
            scaled = [factor * values for values in vector.z]
            z = scaled if z is None else [a + b for a, b in zip(z, scaled, strict=True)]
    return LinearVector(u, z, q)


def _plus(total: Array | None, factor: float, values: Array | None) -> Array | None:
    """Sum of an array and factor times another one; ``None`` is zero (local)."""
    if values is None:
        return total
    return factor * values if total is None else total + factor * values
