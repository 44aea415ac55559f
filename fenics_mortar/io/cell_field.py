# SPDX-License-Identifier: MIT
"""UFL expressions evaluated at the midpoints of the cells, or averaged over them."""

from __future__ import annotations

from typing import Any

import numpy as np

import ufl
from ufl.algorithms import extract_arguments
from ufl.domain import extract_domains

from fenics_mortar.bulk.reference_cell import ReferenceCell
from fenics_mortar.io.cell_means import CellMeans, degree_of_points
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.files import try_together


class CellField:
    """A UFL expression at the midpoints of the owned cells, compiled once (collective).

    If it contains functions that exist at quadrature points only, its mean over each cell.

    Args:
        problem: The problem on whose mesh it is evaluated.
        expression: Scalar, vector or tensor.
        name: Name of the field.
        rank: Largest allowed rank of the expression.

    Raises:
        MortarError: On all ranks, if it cannot be evaluated.
    """

    def __init__(self, problem: ContactProblem, expression: Any, name: str, rank: int = 2) -> None:
        V = problem.equations.bulk.V
        self._mesh = V.mesh
        self._shape: tuple[int, ...] = ()
        self._compiled: Any = None
        self._means: CellMeans | None = None

        def compile_it() -> None:
            _check_name(name)
            self._shape = ufl.as_ufl(expression).ufl_shape
            if len(self._shape) > rank or max(self._shape, default=1) > 3:
                expected = "a scalar, vector or tensor" if rank else "a scalar"
                raise ValueError(f"its shape is {self._shape}; expected {expected}")
            if extract_arguments(ufl.as_ufl(expression)):
                raise ValueError("it contains a test or trial function")
            if any(domain != V.ufl_domain() for domain in extract_domains(ufl.as_ufl(expression))):
                raise ValueError("it contains a function or constant of another mesh")
            degree = degree_of_points(ufl.as_ufl(expression))
            if degree is not None:
                self._means = CellMeans(V.mesh, ufl.as_ufl(expression), degree)
                return
            midpoint = ReferenceCell(compat.cell_name(V.mesh)).midpoint
            self._compiled = compat.create_expression(expression, midpoint)

        try_together(
            problem.equations.comm, True, compile_it, f"field {name!r} cannot be evaluated"
        )

    def evaluate(self) -> Array:
        """Values [unit of the field], shape (owned cells,) and that of the expression (local)."""
        if self._means is not None:
            return self._means.evaluate()
        cells = np.arange(self._mesh.topology.index_map(2).size_local, dtype=np.int32)
        values = compat.evaluate_expression(self._compiled, self._mesh, cells)
        return np.asarray(values).reshape(cells.size, *self._shape)


def check_name(problem: ContactProblem, name: Any) -> None:
    """Reject names of fields that are not strings or already used (collective).

    Raises:
        MortarError: On all ranks.
    """
    message = f"field {name!r} cannot be evaluated"
    try_together(problem.equations.comm, True, lambda: _check_name(name), message)


def _check_name(name: Any) -> None:
    if not isinstance(name, str) or not name or name == "displacement":
        raise ValueError("expected a non-empty string other than 'displacement'")
