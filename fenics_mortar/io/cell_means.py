# SPDX-License-Identifier: MIT
"""Means over the cells of UFL expressions with functions that exist at quadrature points only."""

from __future__ import annotations

from typing import Any

import numpy as np

import ufl
from ufl.algorithms import extract_coefficients

from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array


def degree_of_points(expression: Any) -> int | None:
    """Degree of the quadrature functions of an expression, ``None`` without them (local).

    Raises:
        ValueError: If they have different degrees.
    """
    found = [compat.quadrature_degree(f) for f in extract_coefficients(expression)]
    degrees = {degree for degree in found if degree is not None}
    if len(degrees) > 1:
        raise ValueError(
            f"its functions exist at the quadrature points of the degrees {sorted(degrees)}; "
            "expected one degree"
        )
    return degrees.pop() if degrees else None


class CellMeans:
    """The L2 projection of an expression onto constants on each cell (constructor collective).

    Args:
        mesh: The mesh.
        expression: Scalar, vector or tensor.
        degree: Degree of the quadrature, that of its quadrature functions.
    """

    def __init__(self, mesh: Any, expression: Any, degree: int) -> None:
        self._shape: tuple[int, ...] = expression.ufl_shape
        V = compat.scalar_space(mesh, 0, "DG")
        count = mesh.topology.index_map(2).size_local
        self._cells = compat.dofmap(V)[:count, 0]
        metadata = {"quadrature_degree": degree, "quadrature_scheme": "default"}
        measure = ufl.Measure("dx", domain=mesh, metadata=metadata)
        test = ufl.TestFunction(V)
        components = [expression[i] if i else expression for i in np.ndindex(self._shape)]
        self._forms = [compat.form(c * test * measure) for c in (ufl.as_ufl(1.0), *components)]

    def evaluate(self) -> Array:
        """Means [unit of the expression], (owned cells,) and the expression's shape (local)."""
        area, *sums = (compat.local_sums(form)[self._cells] for form in self._forms)
        return np.stack([each / area for each in sums], axis=1).reshape(-1, *self._shape)
