# SPDX-License-Identifier: MIT
"""Checks of bodies of revolution and of the thickness: axis, and factors in the residual.

**Remark on residuals whose out-of-plane thickness is not that which weights the interface.**
Nothing in a residual tells its units. The thickness is therefore looked for among the factors of
its integrals: numbers, constants and functions with its value, and 2 pi with axisymmetry. It may
also be a part of the parameters of the material, so that there is a remark, not an error.

In plane problems there is a remark if the residual is one of bodies of revolution: with the factor
2 pi X_0, or the hoop strain u_0 / X_0.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_type
from ufl.constantvalue import ScalarValue
from ufl.corealg.traversal import unique_pre_traversal

from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags, Indices
from fenics_mortar.utils.errors import MeshError, MortarError, count_points

# Numbers of which one is a factor of the measures of bodies of revolution [1].
PI: list[Any] = [2.0 * np.pi, np.pi]
# Types of expressions of UFL whose factors are those of their operands, or of the first one.
PRODUCTS = ufl.classes.Product, ufl.classes.Inner, ufl.classes.Dot
FIRST_OPERAND = ufl.classes.Division, ufl.classes.IndexSum, ufl.classes.CoefficientDerivative
KINDS = {"cell": "cells", "exterior_facet": "boundaries", "interior_facet": "inner facets"}


def remark_on_thickness(residual: Any, u: Any, space: DisplacementSpace) -> str:
    """Remark on integrals with another thickness than the interface; "" without (collective).

    Args:
        residual: UFL form.
        u: Displacement or mixed function.
        space: The displacement's space, with the thickness.
    """
    thickness = space.thickness
    if thickness is None or not (space.is_axisymmetric or callable(thickness.constant)):
        revolved = {part for integral in residual.integrals() for part in _revolved(integral, u)}
        if revolved:
            return (
                f"the residual contains {' and '.join(sorted(revolved))}, as of bodies of "
                "revolution, but the interface has the same thickness everywhere: create the "
                "problem with geometry='axisymmetric'; else contact forces and stiffness do not fit"
            )
    if thickness is None or thickness.constant == 1.0:
        return ""
    factors, name = [thickness.constant], "thickness"
    if space.is_axisymmetric:
        factors, name = PI, "2 pi"
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


def _revolved(integral: Any, u: Any) -> Iterator[str]:
    """Parts of an integral that only bodies of revolution have, as text."""
    if (True, True) in _weights(integral.integrand()):
        yield "the factor 2 pi X[0]"
    for part in unique_pre_traversal(integral.integrand()):
        if isinstance(part, ufl.classes.Division) and _is_radius(part.ufl_operands[1]):
            inside = list(unique_pre_traversal(part.ufl_operands[0]))
            if u in inside and not any(isinstance(p, ufl.classes.Grad) for p in inside):
                yield "the hoop strain u[0] / X[0]"


def _weights(expression: Any) -> set[tuple[bool, bool]]:
    """For each term of an expression, whether 2 pi, or pi, and X[0] are among its factors."""
    operands = expression.ufl_operands
    if isinstance(expression, FIRST_OPERAND):
        return _weights(operands[0])
    if isinstance(expression, ufl.classes.Sum):
        return _weights(operands[0]) | _weights(operands[1])
    if isinstance(expression, PRODUCTS):
        both = product(_weights(operands[0]), _weights(operands[1]))
        return {(a or c, b or d) for (a, b), (c, d) in both}
    near = [abs(value - pi) <= ROUNDING * pi for value in _values([expression]) for pi in PI]
    return {(any(near), _is_radius(expression))}


def _is_radius(expression: Any) -> bool:
    """Whether an expression is X[0]."""
    if not isinstance(expression, ufl.classes.Indexed):
        return False
    vector, index = expression.ufl_operands
    return isinstance(vector, ufl.classes.SpatialCoordinate) and [*map(str, index)] == ["0"]


def _has_factor(integrand: Any, u: Any, factors: list[Any], comm: MPI.Comm) -> bool:
    """Whether a factor may occur in an integrand; always if it is a function of position."""
    parts = list(unique_pre_traversal(integrand))
    functions = [part for part in parts if isinstance(part, ufl.Coefficient) and part is not u]
    if callable(factors[0]):
        return bool(functions) or any(isinstance(p, ufl.classes.SpatialCoordinate) for p in parts)
    near = [
        abs(value - factor) <= ROUNDING * factor for value in _values(parts) for factor in factors
    ]
    if len(factors) > 1:  # a function may be the radius times 2 pi
        return any(near) or bool(functions)
    return any(near) or any(_may_equal(f, factors, comm) for f in functions)


def _values(parts: list[Any]) -> Iterator[float]:
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


def check_axis(space: DisplacementSpace, prescribed: Flags) -> None:
    """Reject nodes with x < 0, and free radial components on the axis (collective).

    A displacement away from the axis has an unbounded hoop strain.

    Args:
        space: The displacement's space; without effect unless it is axisymmetric.
        prescribed: Local dofs with Dirichlet values, shape (local dofs,), bool.

    Raises:
        MeshError: On all ranks, for a node with x < 0.
        MortarError: On all ranks, if the radial component of a node on the axis is not prescribed.
    """
    if not space.is_axisymmetric:
        return
    comm = space.V.mesh.comm
    X, rounding = _nodes(space)
    count, where = count_points(comm, X[X[:, 0] < -rounding])
    if count:
        raise MeshError(
            f"{count} nodes have x < 0, one at {where}: with geometry='axisymmetric' x is the "
            "distance from the axis; expected the half of the meridian plane with x >= 0"
        )
    free = ~prescribed[space.owned_dofs[:, 0]]
    count, where = count_points(comm, X[(np.abs(X[:, 0]) <= rounding) & free])
    if count:
        raise MortarError(
            f"{count} nodes on the axis may move away from it, one at {where}: the radial "
            "component is not prescribed; add fm.dirichlet(V, data, name, 0.0, component=0) for "
            "the boundary on the axis"
        )


def check_radius(residual: Any, u: Any, space: DisplacementSpace) -> None:
    """Reject a residual of plane bodies with axisymmetry (local, equal on all ranks).

    Args:
        residual: UFL form.
        u: Displacement or mixed function.
        space: The displacement's space; without effect unless it is axisymmetric.

    Raises:
        ValueError: If integrals over cells depend neither on the coordinates nor on a function that
            could be the radius.
    """
    if "cell" in _without_radius(residual, u, space):
        raise ValueError(
            "the residual does not contain the radius in integrals over cells: with "
            "geometry='axisymmetric' multiply its measures by 2 * pi * X[0], X = "
            "ufl.SpatialCoordinate(mesh), and add the hoop strain"
        )


def remark_on_radius(residual: Any, u: Any, space: DisplacementSpace) -> str:
    """Remark on boundary integrals without the radius; "" if there are none (local).

    Arguments as for ``check_radius``.
    """
    if not _without_radius(residual, u, space) - {"cell"}:
        return ""
    return (
        "the residual has boundary integrals without the radius: with geometry='axisymmetric' a "
        "traction needs the factor 2 pi X[0]"
    )


class AxisConditions:
    """Check of the values prescribed on the axis; the constructor is collective.

    Args:
        space: The displacement's space; without effect unless it is axisymmetric.
        u: Displacement or mixed function.
        bcs: Dirichlet conditions.
    """

    def __init__(self, space: DisplacementSpace, u: Any, bcs: list[Any]) -> None:
        self._space, self._u, self._bcs = space, u, bcs
        self._dofs = radial_dofs_on_axis(space)

    def check(self) -> None:
        """Reject radial motions of the axis (collective).

        Raises:
            MortarError: On all ranks, if a radial component on the axis is prescribed otherwise
                than by zero.
        """
        if not self._space.is_axisymmetric:
            return
        values = np.zeros_like(self._u.x.array)
        compat.set_prescribed(values, self._bcs)
        moved = np.abs(values[self._dofs])
        largest = self._space.V.mesh.comm.allreduce(float(moved.max(initial=0.0)), MPI.MAX)
        _, rounding = _nodes(self._space)
        if largest > rounding:
            raise MortarError(
                f"nodes on the axis are moved away from it by {largest:.3g}: expected 0 for their "
                "radial component"
            )


def _without_radius(residual: Any, u: Any, space: DisplacementSpace) -> set[str]:
    """Types of the integrals that cannot be weighted by the radius."""
    if not space.is_axisymmetric:
        return set()
    integrals = [(part.integral_type(), part.integrand()) for part in residual.integrals()]
    return {
        kind
        for kind, integrand in integrals
        if not extract_type(integrand, ufl.geometry.SpatialCoordinate)
        and not extract_type(integrand, ufl.Coefficient) - {u}
    }


def radial_dofs_on_axis(space: DisplacementSpace) -> Indices:
    """Owned local dofs of radial components on the axis, (k,); none in a plane (collective)."""
    if not space.is_axisymmetric:
        return np.empty(0, np.int64)
    X, rounding = _nodes(space)
    return space.owned_dofs[np.abs(X[:, 0]) <= rounding, 0]


def _nodes(space: DisplacementSpace) -> tuple[Array, float]:
    """Positions (n, 2) of the owned nodes, and the rounding of positions [length] (collective)."""
    X = space.V.tabulate_dof_coordinates()[: space.num_nodes, :2]
    sizes = space.V.mesh.comm.allgather(float(np.abs(X).max(initial=0.0)))
    return X, ROUNDING * max(sizes)
