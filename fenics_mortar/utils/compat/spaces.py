# SPDX-License-Identifier: MIT
"""Function spaces and their dofs."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

from fenics_mortar.utils.arguments import check_kind, check_number
from fenics_mortar.utils.compat.compiler import quiet_compiler
from fenics_mortar.utils.compat.meshes import as_table, cell_name


@quiet_compiler()
def scalar_space(mesh: dmesh.Mesh, degree: int, family: str = "Lagrange") -> fem.FunctionSpace:
    """Create a space of scalar functions, as for a temperature solved for alone (collective).

    Args:
        mesh: The mesh, such as ``data.mesh``.
        degree: Polynomial degree.
        family: Family of elements, "Lagrange" or "DG", for example.

    Raises:
        ValueError: If ``mesh`` or ``degree`` is not valid.
    """
    # ``fem.FunctionSpace(mesh, element)`` became ``fem.functionspace`` in 0.7.
    check_kind("mesh", mesh, dmesh.Mesh, "a mesh of dolfinx, e.g. the attribute mesh of MeshData")
    expected = "a whole number, at least 0"
    check_number("degree", degree, expected, lambda number: number >= 0, whole=True)
    create = fem.functionspace if hasattr(fem, "functionspace") else fem.FunctionSpace
    return create(mesh, (family, degree))


@quiet_compiler()
def vector_space(mesh: dmesh.Mesh, degree: int) -> fem.FunctionSpace:
    """Create the Lagrange space of plane vectors, as for a displacement (collective).

    Args:
        mesh: The mesh, such as ``data.mesh``.
        degree: 1 or 2 for contact. On curved cells of order 2 take 2.

    Raises:
        ValueError: If ``mesh`` or ``degree`` is not valid.
    """
    # ``VectorFunctionSpace`` was removed in 0.8; the shape went into the element.
    check_kind("mesh", mesh, dmesh.Mesh, "a mesh of dolfinx, e.g. the attribute mesh of MeshData")
    expected = "a whole number, at least 1"
    check_number("degree", degree, expected, lambda number: number >= 1, whole=True)
    if hasattr(fem, "functionspace"):
        return fem.functionspace(mesh, ("Lagrange", degree, (2,)))
    return fem.VectorFunctionSpace(mesh, ("Lagrange", degree))


@quiet_compiler()
def mixed_space(mesh: dmesh.Mesh, *parts: tuple[Any, ...]) -> fem.FunctionSpace:
    """Create a space of several unknowns (collective).

    Args:
        mesh: The mesh.
        parts: Family, degree and, for vectors and tensors, the shape of each unknown. One of them
            is the displacement, ``("Lagrange", 2, (2,))`` for example;
            ``ContactProblem(displacement=i)`` if it is not the first.

    Raises:
        ValueError: If ``mesh`` is not a mesh or no part is given.

    Example:
        Taylor-Hood displacement and pressure for incompressible bodies, with the shear modulus 1:

        >>> from mpi4py import MPI
        >>> from fenics_mortar.energies import mixed_neo_hookean
        >>> mesh = dmesh.create_unit_square(MPI.COMM_WORLD, 2, 2)
        >>> W = mixed_space(mesh, ("Lagrange", 2, (2,)), ("Lagrange", 1))
        >>> w = fem.Function(W)
        >>> energy = mixed_neo_hookean(*ufl.split(w), mu=1.0)
        >>> residual = ufl.derivative(energy * ufl.dx(degree=4), w)

        Supports belong to the sub-space of the displacement, ``fm.dirichlet(W.sub(0), ...)``, and
        the problem is created with the whole function: ``fm.ContactProblem(residual, w, ...)``.
    """
    check_kind("mesh", mesh, dmesh.Mesh, "a mesh of dolfinx, e.g. the attribute mesh of MeshData")
    if not parts:
        raise ValueError("expected parts: each a family, a degree and, for vectors, the shape")
    if hasattr(ufl, "MixedElement"):
        elements = [_element(mesh.ufl_cell(), *part) for part in parts]
        return fem.FunctionSpace(mesh, ufl.MixedElement(*elements))
    basix_ufl = importlib.import_module("basix.ufl")
    elements = [
        basix_ufl.element(family, cell_name(mesh), degree, shape=shape[0] if shape else None)
        for family, degree, *shape in parts
    ]
    return fem.functionspace(mesh, basix_ufl.mixed_element(elements))


def _element(cell: Any, family: str, degree: int, shape: tuple[int, ...] = ()) -> Any:
    """Element of UFL until 2022, for values of a shape."""
    if not shape:
        return ufl.FiniteElement(family, cell, degree)
    if len(shape) == 1:
        return ufl.VectorElement(family, cell, degree, dim=shape[0])
    return ufl.TensorElement(family, cell, degree, shape=tuple(shape))


def is_part_of(V: fem.FunctionSpace, part: Any) -> bool:
    """Whether the space ``part`` is ``V`` or a component of it (local).

    Until 0.6 Python's space is the C++ space; conditions refer to one or the other.
    """
    outer, inner = (getattr(space, "_cpp_object", space) for space in (V, part))
    return outer.contains(inner)


@quiet_compiler()
def quadrature_space(mesh: dmesh.Mesh, degree: int, shape: tuple[int, ...]) -> fem.FunctionSpace:
    """Create the space of values at the quadrature points of a degree (collective).

    Elements of UFL were replaced by those of ``basix.ufl`` in 0.7.
    """
    check_kind("mesh", mesh, dmesh.Mesh, "a mesh of dolfinx, e.g. the attribute mesh of MeshData")
    if hasattr(ufl, "MixedElement"):
        kind = (ufl.FiniteElement, ufl.VectorElement, ufl.TensorElement)[len(shape)]
        size = {"dim": shape[0]} if len(shape) == 1 else {"shape": shape} if shape else {}
        element = kind("Quadrature", mesh.ufl_cell(), degree, quad_scheme="default", **size)
        return fem.FunctionSpace(mesh, element)
    basix_ufl = importlib.import_module("basix.ufl")
    element = basix_ufl.quadrature_element(cell_name(mesh), value_shape=shape, degree=degree)
    return fem.functionspace(mesh, element)


def quadrature_degree(function: Any) -> int | None:
    """Degree of the quadrature points at which a function exists, ``None`` for others (local).

    ``degree()`` of elements became ``embedded_superdegree`` with basix's elements, in 0.8.
    """
    element = function.ufl_element()
    if "Quadrature" not in repr(element):
        return None
    degree = element.degree if hasattr(element, "degree") else element.embedded_superdegree
    return int(degree() if callable(degree) else degree)


def is_sub_space(V: fem.FunctionSpace) -> bool:
    """Whether ``V`` is a view of a part of another space, such as ``W.sub(0)`` (local)."""
    return len(getattr(V, "_cpp_object", V).component()) > 0


def dofmap(V: fem.FunctionSpace) -> npt.NDArray[np.int32]:
    """Return the blocked local dofs of all local cells, ghosts too, shape (num_cells, num_dofs).

    The list became a two-dimensional array in 0.7.
    """
    return as_table(V.dofmap.list, V.dofmap.dof_layout)
