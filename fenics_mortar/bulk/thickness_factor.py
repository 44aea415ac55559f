# SPDX-License-Identifier: MIT
"""Remark on residuals without the out-of-plane thickness that weights the interface.

Nothing in a residual tells its units. The thickness is therefore looked for among the factors of
its integrals: numbers, constants and functions with its value, and 2 pi with axisymmetry. It may
also be a part of the parameters of the material, so that there is a remark, not an error.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem
from ufl.constantvalue import ScalarValue
from ufl.corealg.traversal import unique_pre_traversal

from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.rounding import ROUNDING

KINDS = {"cell": "cells", "exterior_facet": "boundaries", "interior_facet": "inner facets"}


def remark_on_thickness(residual: Any, u: Any, space: DisplacementSpace) -> str:
    """Remark on integrals in which the thickness does not occur; "" if there are none (collective).

    Args:
        residual: UFL form.
        u: Displacement or mixed function.
        space: The displacement's space, with the thickness.
    """
    thickness = space.thickness
    if thickness is None or thickness.constant == 1.0:
        return ""
    factors, name = [thickness.constant], "thickness"
    if space.is_axisymmetric:
        factors, name = [2.0 * np.pi, np.pi], "2 pi"
    missing = {
        KINDS.get(integral.integral_type(), integral.integral_type())
        for integral in residual.integrals()
        if not _has_factor(integral.integrand(), u, factors, space.V.mesh.comm)
    }
    if not missing:
        return ""
    given = "" if callable(factors[0]) else f" of {factors[0]:.4g}"
    return (
        f"the {name}{given} does not occur in the integrals of the residual over "
        f"{' and '.join(sorted(missing))}, but those over the interface are weighted by it: "
        "multiply the measures of the residual by it, too; else the bodies are too soft for the "
        "contact (unless a parameter of the residual includes it)"
    )


def _has_factor(integrand: Any, u: Any, factors: list[Any], comm: MPI.Comm) -> bool:
    """Whether a factor may occur in an integrand; always if it is a function of position."""
    parts = list(unique_pre_traversal(integrand))
    functions = [part for part in parts if isinstance(part, ufl.Coefficient) and part is not u]
    if callable(factors[0]):
        return bool(functions) or any(isinstance(p, ufl.classes.SpatialCoordinate) for p in parts)
    near = [
        abs(value - factor) <= ROUNDING * factor for value in _numbers(parts) for factor in factors
    ]
    if len(factors) > 1:  # a function may be the radius times 2 pi
        return any(near) or bool(functions)
    return any(near) or any(_may_equal(f, factors, comm) for f in functions)


def _numbers(parts: list[Any]) -> Iterator[float]:
    """Numbers and components of constants among the parts of an integrand."""
    for part in parts:
        if isinstance(part, ScalarValue):
            yield float(np.real(part.value()))
        elif isinstance(part, fem.Constant):
            yield from np.real(np.ravel(part.value)).tolist()


def _may_equal(function: Any, factors: list[float], comm: MPI.Comm) -> bool:
    """Whether a function has the value of a factor somewhere (collective)."""
    values = np.real(function.x.array)
    here = any((np.abs(values - factor) <= ROUNDING * factor).any() for factor in factors)
    return bool(comm.allreduce(here, MPI.LOR))
