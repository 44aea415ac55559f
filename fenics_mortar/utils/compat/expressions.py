# SPDX-License-Identifier: MIT
"""Values of UFL expressions."""

from __future__ import annotations

import inspect

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.compat.compiler import own_options, quiet_compiler


@quiet_compiler()
def interpolate_expression(function: fem.Function, expression: ufl.core.expr.Expr) -> None:
    """Interpolate a UFL expression into ``function`` and update its ghosts (collective).

    ``element.interpolation_points`` became a property in 0.10. The expression has to contain at
    least one function, constant or coordinate of the mesh.
    """
    points = function.function_space.element.interpolation_points
    points = points() if callable(points) else points
    function.interpolate(fem.Expression(expression, points, **own_options(fem.Expression)))
    function.x.scatter_forward()


@quiet_compiler()
def create_expression(expression: ufl.core.expr.Expr, points: npt.ArrayLike) -> fem.Expression:
    """Compile a UFL expression for reference ``points``, shape (num_points, 2) (collective)."""
    points = np.ascontiguousarray(points, dtype=np.float64)
    return fem.Expression(expression, points, **own_options(fem.Expression))


def evaluate_expression(
    expression: fem.Expression, mesh: dmesh.Mesh, cells: npt.NDArray[np.int32]
) -> Array:
    """Evaluate at the expression's points in local ``cells``, (num_cells, ...) [its unit] (local).

    ``Expression.eval`` takes the mesh since 0.7.
    """
    takes_mesh = "mesh" in inspect.signature(expression.eval).parameters
    return expression.eval(mesh, cells) if takes_mesh else expression.eval(cells)


def domain_of(expression: ufl.core.expr.Expr) -> ufl.AbstractDomain | None:
    """UFL domain of an expression; the method for it is deprecated since UFL 2023 (local)."""
    if hasattr(ufl.domain, "extract_unique_domain"):
        return ufl.domain.extract_unique_domain(expression)
    return expression.ufl_domain()
