# SPDX-License-Identifier: MIT
"""Dirichlet conditions on named boundaries."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem

from fenics_mortar.mesh.data import MeshData, Names
from fenics_mortar.utils import compat
from fenics_mortar.utils.errors import MeshError, check_kind, check_same_texts, together

# All components of a vector, and one of them, in messages, by dimension.
ALL = {2: "both", 3: "all"}
ONE = {2: "component=0 or component=1", 3: "component=0, 1 or 2"}


def dirichlet(
    V: fem.FunctionSpace,
    data: MeshData,
    boundary: Names,
    value: fem.Constant | fem.Function | npt.ArrayLike,
    component: int | None = None,
) -> fem.DirichletBC:
    """Prescribe displacement, a component of it or a scalar field on boundaries (collective).

    Args:
        V: Space of the displacement, see :func:`vector_space`, or its sub-space ``W.sub(0)`` of a
            mixed space; of a scalar field ``W.sub(1)``, for example.
        data: Mesh on which ``V`` is defined.
        boundary: Name or tag of a boundary, or a sequence of them.
        value: Prescribed value [length]: numbers of shape (dim,), a constant of this shape or a
            function of ``V``; with ``component`` and for scalar fields a number or a scalar
            constant. Later changes of constants and functions take effect. In a mixed space,
            functions belong to the collapsed sub-space, and constants prescribe a scalar field or
            one component at a time.
        component: 0 for x, 1 for y, 2 for z in space, ``None`` for all.

    Returns:
        A boundary condition of dolfinx.

    Raises:
        MeshError: If a boundary is unknown or empty, the space is not that of a displacement on
            this mesh, or the value does not fit.
        ValueError: If ``data`` or ``V`` is of another type.
    """
    check_kind("data", data, MeshData, "the MeshData of the mesh")
    check_kind("V", V, fem.FunctionSpace, "a space of dolfinx, e.g. vector_space(mesh, 1)")
    is_scalar = ufl.TestFunction(V).ufl_shape == ()
    is_number = is_scalar and not isinstance(value, fem.Function)
    in_sub_space = component is None and compat.is_sub_space(V) and not is_number
    with together(data.mesh.comm, "dirichlet"):
        _check_component(component, data.mesh.geometry.dim)
        if is_scalar and component is not None:
            raise MeshError(f"component is {component!r}, but the field has none; omit it")
        if V.mesh is not data.mesh:
            raise MeshError("the space belongs to another mesh than the boundaries")
        tags = data.boundary_tags(boundary)
        value = value if in_sub_space else _boundary_value(V, value, component)
    check_same_texts(data.mesh.comm, "dirichlet", {"boundary": tags, "component": component})
    facets = data.boundary_facets(boundary)
    dim = data.mesh.topology.dim
    data.mesh.topology.create_connectivity(dim - 1, dim)
    if in_sub_space:
        return _dirichlet_in_sub_space(V, facets, value)
    space = V if component is None else V.sub(int(component))
    dofs = fem.locate_dofs_topological(space, dim - 1, facets)
    if isinstance(value, fem.Function):
        return fem.dirichletbc(value, dofs)
    return fem.dirichletbc(value, dofs, space)


def _check_component(component: Any, dim: int) -> None:
    """Raise unless a component is one of a vector of the space, or ``None`` (local)."""
    known = range(dim)
    if isinstance(component, (Sequence, np.ndarray)) or component not in (None, *known):
        allowed = "0, 1 or None for both" if dim == 2 else "0, 1, 2 or None for all"
        raise MeshError(f"component is {component!r}; expected {allowed}")


def _dirichlet_in_sub_space(
    sub_space: fem.FunctionSpace,
    facets: npt.NDArray[np.int32],
    value: fem.Constant | fem.Function | npt.ArrayLike,
) -> fem.DirichletBC:
    """Prescribe all components in a sub-space, which needs a function (collective)."""
    dim = sub_space.mesh.geometry.dim
    if isinstance(value, fem.Constant):
        raise MeshError(
            f"a constant cannot prescribe {ALL[dim]} components in a sub-space; prescribe one "
            f"component at a time, by {ONE[dim]}, or use a function of the collapsed sub-space"
        )
    if not isinstance(value, fem.Function):
        space, _ = sub_space.collapse()
        numbers, value = _boundary_value(space, value, None), fem.Function(space)
        value.x.array.reshape(-1, dim)[:] = numbers
    given = value.function_space
    fits = given.mesh is sub_space.mesh and not compat.is_sub_space(given)
    if not fits or given.ufl_element() != sub_space.ufl_element():
        raise MeshError("expected a function of the collapsed sub-space, W.sub(0).collapse()[0]")
    dofs = fem.locate_dofs_topological((sub_space, given), dim - 1, facets)
    return fem.dirichletbc(value, dofs, sub_space)


def _boundary_value(
    V: fem.FunctionSpace, value: fem.Constant | fem.Function | npt.ArrayLike, component: int | None
) -> fem.Constant | fem.Function | npt.NDArray:
    """Check that the value fits the space or its component; convert numbers (local)."""
    dim = V.mesh.geometry.dim
    if isinstance(value, fem.Function):
        if component is not None or value.function_space != V:
            raise MeshError(
                f"a function prescribes {ALL[dim]} components and has to belong to the same space"
            )
        return value
    if not isinstance(value, fem.Constant):
        try:
            value = np.array(value, dtype=PETSc.ScalarType)
        except (TypeError, ValueError):
            allowed = "numbers, a Constant or a Function"
            raise MeshError(f"the prescribed value is {value!r}; expected {allowed}") from None
    shape = value.ufl_shape if isinstance(value, fem.Constant) else value.shape
    expected = ufl.TestFunction(V).ufl_shape if component is None else ()
    if component is None and expected not in ((), (dim,)):
        raise MeshError(
            "the space is not that of a displacement or scalar field; of a mixed space W take "
            "W.sub(0)"
        )
    if shape != expected:
        advice = ""
        if expected == (dim,) and shape == ():
            advice = f"; a number prescribes one component, {ONE[dim]}"
        elif component is not None and shape == (dim,):
            advice = f"; omit component to prescribe {ALL[dim]} components"
        raise MeshError(f"the prescribed value has shape {shape}; expected {expected}{advice}")
    return value
