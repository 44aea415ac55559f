# SPDX-License-Identifier: MIT
"""Checks of bodies of revolution and of the thickness: axis, and factors in the residual."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_type
from ufl.constantvalue import ScalarValue
from ufl.corealg.traversal import unique_pre_traversal

from fenics_mortar.bulk.checks import MEASURES
from fenics_mortar.utils import compat, errors, ranks
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags, Indices

if TYPE_CHECKING:
    from fenics_mortar.interface.surfaces import Surface
    from fenics_mortar.mesh.space import DisplacementSpace


# Numbers of which one is a factor of the measures of bodies of revolution [1].
PI = [2.0 * np.pi, np.pi]
# Types of expressions of UFL whose factors are those of their operands, or of the first one.
PRODUCTS = ufl.classes.Product, ufl.classes.Inner, ufl.classes.Dot
FIRST_OPERAND = ufl.classes.Division, ufl.classes.IndexSum, ufl.classes.CoefficientDerivative


def remark_on_thickness(
    residual: Any, u: Any, space: DisplacementSpace, surfaces: Sequence[Surface]
) -> str:
    """Remark on integrals with another thickness than the interface; "" without (collective).

    Nothing in a residual tells its units. The thickness is therefore looked for among the factors
    of its integrals: numbers, constants and functions with its value, and 2 pi with axisymmetry. It
    may also be a part of the parameters of the material, so that there is a remark, not an error.

    In plane problems there is a remark if the residual is one of bodies of revolution: with the
    factor 2 pi X_0, or the hoop strain u_0 / X_0.

    Args:
        residual: UFL form.
        u: Displacement or mixed function.
        space: The displacement's space, with the thickness.
        surfaces: The slaves, with the thickness at their nodes.
    """
    thickness = space.thickness
    varies = thickness is not None and callable(thickness.constant)
    if not (space.is_axisymmetric or varies):
        revolved = {part for integral in residual.integrals() for part in _revolved(integral, u)}
        if revolved:
            return (
                f"the residual contains {' and '.join(sorted(revolved))}, as of bodies of "
                "revolution, but the interface has the same thickness everywhere: create the "
                "problem with geometry='axisymmetric'; else contact forces and stiffness do not fit"
            )
    given = [s.thickness.constant for s in surfaces if s.thickness is not None]
    factors, name = np.unique(np.concatenate([np.ones(0), *given])).tolist(), "thickness"
    if space.is_axisymmetric:
        factors, name = PI, "2 pi"
    has_unit = 1.0 in factors
    factors = [factor for factor in factors if factor != 1.0]
    if thickness is None or not factors:
        return ""
    integrals = [(i.integral_type(), i.integrand()) for i in residual.integrals()]
    all_parts = [part for _, integrand in integrals for part in unique_pre_traversal(integrand)]
    if has_unit and all(_near(_values(all_parts), [factor]) for factor in factors):
        return ""  # parts of the bodies have the thickness one
    comm = space.V.mesh.comm
    missing = {
        MEASURES.get(kind, (kind,))[-1]
        for kind, integrand in integrals
        if not _has_factor(integrand, u, factors, comm, varies=varies)
    }
    if not missing:
        return ""
    value = f" of {factors[0]:.4g}" if space.is_axisymmetric or len(factors) == 1 else ""
    return (
        f"the {name}{value} does not occur in the integrals of the residual over "
        f"{' and '.join(sorted(missing))}, but those over the interface are weighted by it: "
        "multiply the measures of the residual by it, too; else the bodies are too soft for the "
        "contact (unless a parameter of the residual includes it)"
    )


def _revolved(integral: Any, u: Any) -> Iterator[str]:
    """Parts of an integral that only bodies of revolution have, as text."""
    radius = ufl.SpatialCoordinate(u.function_space.mesh)[0]
    if (True, True) in _weights(integral.integrand(), radius):
        yield "the factor 2 pi X[0]"
    for part in unique_pre_traversal(integral.integrand()):
        if isinstance(part, ufl.classes.Division) and part.ufl_operands[1] == radius:
            inside = list(unique_pre_traversal(part.ufl_operands[0]))
            if u in inside and not any(isinstance(p, ufl.classes.Grad) for p in inside):
                yield "the hoop strain u[0] / X[0]"


def _weights(expression: Any, radius: Any) -> set[tuple[bool, bool]]:
    """For each term of an expression, whether 2 pi, or pi, and X[0] are among its factors."""
    if not isinstance(expression, (*FIRST_OPERAND, *PRODUCTS, ufl.classes.Sum)):
        return {(_near(_values([expression]), PI), expression == radius)}
    first, *others = (_weights(each, radius) for each in expression.ufl_operands)
    if isinstance(expression, FIRST_OPERAND):
        return first
    if isinstance(expression, ufl.classes.Sum):
        return first.union(*others)
    return {(a or c, b or d) for (a, b), (c, d) in product(first, *others)}


def _has_factor(
    integrand: Any, u: Any, factors: list[float], comm: MPI.Comm, *, varies: bool
) -> bool:
    """Whether a factor may occur in an integrand; always if it ``varies`` as a function there."""
    parts = list(unique_pre_traversal(integrand))
    functions = [part for part in parts if isinstance(part, ufl.Coefficient) and part is not u]
    values = _values(parts)
    if varies or len(factors) > 1:  # a function may be the radius times 2 pi
        by_place = varies and any(isinstance(p, ufl.classes.SpatialCoordinate) for p in parts)
        return bool(functions) or by_place or _near(values, factors)
    values = np.concatenate([values, *(np.real(function.x.array) for function in functions)])
    return ranks.on_any_rank(comm, _near(values, factors))


def _near(values: Array, factors: list[float]) -> bool:
    """Whether one of some numbers (n,) has the value of a factor."""
    return any((np.abs(values - factor) <= ROUNDING * factor).any() for factor in factors)


def _values(parts: list[Any]) -> Array:
    """Numbers and components of constants among the parts of an integrand, (n,) [any unit]."""
    found = [part.value() for part in parts if isinstance(part, ScalarValue)]
    found += [part.value for part in parts if isinstance(part, fem.Constant)]
    return np.concatenate([np.zeros(0), *map(np.ravel, map(np.real, found))])


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
    count, where = errors.count_points(comm, X[X[:, 0] < -rounding])
    if count:
        raise errors.MeshError(
            f"{count} nodes have x < 0, one at {where}: with geometry='axisymmetric' x is the "
            "distance from the axis; expected the half of the meridian plane with x >= 0"
        )
    free = ~prescribed[space.owned_dofs[:, 0]]
    count, where = errors.count_points(comm, X[(np.abs(X[:, 0]) <= rounding) & free])
    if count:
        raise errors.MortarError(
            f"{count} nodes on the axis may move away from it, one at {where}: the radial "
            "component is not prescribed; add fm.dirichlet(V, data, name, 0.0, component=0) for "
            "the boundary on the axis"
        )


def check_radius(residual: Any, u: Any, space: DisplacementSpace) -> str:
    """Reject a residual of plane bodies with axisymmetry (local, equal on all ranks).

    Args:
        residual: UFL form.
        u: Displacement or mixed function.
        space: The displacement's space; without effect unless it is axisymmetric.

    Returns:
        Remark on boundary integrals without the radius; "" if there are none.

    Raises:
        ValueError: If integrals over cells depend neither on the coordinates nor on a function that
            could be the radius.
    """
    without = {
        integral.integral_type()
        for integral in (residual.integrals() if space.is_axisymmetric else ())
        if not extract_type(integral.integrand(), ufl.geometry.SpatialCoordinate)
        and not extract_type(integral.integrand(), ufl.Coefficient) - {u}
    }
    if "cell" in without:
        raise ValueError(
            "the residual does not contain the radius in integrals over cells: with "
            "geometry='axisymmetric' multiply its measures by 2 * pi * X[0], X = "
            "ufl.SpatialCoordinate(mesh), and add the hoop strain"
        )
    return (
        "the residual has boundary integrals without the radius: with geometry='axisymmetric' a "
        "traction needs the factor 2 pi X[0]"
    ) * bool(without)


def check_axis_values(space: DisplacementSpace, u: Any, bcs: list[Any], on_axis: Indices) -> None:
    """Reject values that move the axis radially (collective).

    Args:
        space: The displacement's space; without effect unless it is axisymmetric.
        u: Displacement or mixed function.
        bcs: Dirichlet conditions.
        on_axis: Dofs of ``radial_dofs_on_axis``.

    Raises:
        MortarError: On all ranks, if a radial component on the axis is prescribed otherwise than by
            zero.
    """
    if not space.is_axisymmetric:
        return
    values = np.zeros_like(u.x.array)
    compat.set_prescribed(values, bcs)
    moved = np.abs(values[on_axis])
    largest = space.V.mesh.comm.allreduce(float(moved.max(initial=0.0)), MPI.MAX)
    if largest > 0.0 and largest > _nodes(space)[1]:
        raise errors.MortarError(
            f"nodes on the axis are moved away from it by {largest:.3g}: expected 0 for their "
            "radial component"
        )


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
