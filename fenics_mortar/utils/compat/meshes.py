# SPDX-License-Identifier: MIT
"""Meshes and function spaces."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

from fenics_mortar.utils.compat.libraries import quiet_compiler
from fenics_mortar.utils.errors import check_kind, check_number

# Number of vertices of the cells.
CORNERS = {"triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8}
# Dimensions of the cells of solids; others belong to the plane.
DIMENSIONS = {"tetrahedron": 3, "hexahedron": 3}


def cell_name(mesh: dmesh.Mesh) -> str:
    """Return ``"triangle"``, ``"quadrilateral"``, ``"tetrahedron"`` or ``"hexahedron"``.

    ``mesh.ufl_cell().cellname`` became a property in 0.10; the enumeration did not change.
    """
    return mesh.topology.cell_type.name


def num_corners(mesh: dmesh.Mesh) -> int:
    """Return the number of vertices of a cell, 3 or 4 in the plane, 4 or 8 in space."""
    return CORNERS[cell_name(mesh)]


@quiet_compiler()
def create_mesh(
    comm: MPI.Comm, cells: npt.ArrayLike, x: npt.ArrayLike, cell_name: str, degree: int = 1
) -> dmesh.Mesh:
    """Create a mesh of the plane or of space from arrays (collective).

    ``ufl.VectorElement`` was replaced by ``basix.ufl.element``, and in 0.10 element and ``x`` were
    exchanged.

    Args:
        comm: Communicator of the mesh.
        cells: Global numbers of the nodes in basix order, shape (num_cells, nodes per cell); each
            rank passes its part, possibly of shape (0, nodes per cell).
        x: Coordinates of this rank's part of the nodes, shape (num_nodes, dim) [length]; the parts
            are numbered one rank after the other.
        cell_name: ``"triangle"``, ``"quadrilateral"``, ``"tetrahedron"`` or ``"hexahedron"``.
        degree: Degree of the geometry.
    """
    cells = np.ascontiguousarray(cells, dtype=np.int64)
    dim = DIMENSIONS.get(cell_name, 2)
    x = np.ascontiguousarray(x, dtype=np.float64).reshape(-1, dim)
    if hasattr(ufl, "VectorElement"):
        # With the variant that FFCx would give it: see settle_coordinate_element.
        scalar = ufl.FiniteElement("Lagrange", cell_name, degree, variant="equispaced")
        return dmesh.create_mesh(comm, cells, x, ufl.Mesh(ufl.VectorElement(scalar)))
    basix_ufl = importlib.import_module("basix.ufl")
    element = basix_ufl.element("Lagrange", cell_name, degree, shape=(dim,))
    return dmesh.create_mesh(comm, cells, x=x, e=ufl.Mesh(element))


def geometry_dofmap(mesh: dmesh.Mesh) -> npt.NDArray[np.int32]:
    """Return the local geometry nodes of all local cells, shape (num_cells, num_nodes).

    The list became a two-dimensional array in 0.7, one of several (``dofmaps``) in 0.11.
    """
    geometry = mesh.geometry
    if hasattr(geometry, "dofmaps") and not callable(geometry.dofmaps):
        return np.asarray(geometry.dofmaps[0])
    return as_table(geometry.dofmap, geometry.cmap.create_dof_layout())


def as_table(table: Any, layout: Any) -> npt.NDArray[np.int32]:
    """View an adjacency list (until 0.6) as an array (cells, dofs), also without cells."""
    if isinstance(table, np.ndarray):
        return table
    return table.array.reshape(table.num_nodes, layout.num_dofs)


def are_tags_of(tags: Any, mesh: dmesh.Mesh) -> bool:
    """Whether tags were made on the topology of a mesh (local, equal on all ranks).

    Tags of release 0.5 have a mesh, those of later ones a topology, which from 0.9 on is within an
    object of Python.
    """
    own = tags.topology if hasattr(tags, "topology") else tags.mesh.topology
    other = mesh.topology
    return getattr(own, "_cpp_object", own) is getattr(other, "_cpp_object", other)


def settle_coordinate_element(mesh: dmesh.Mesh) -> None:
    """Give the mesh's domain the element that the form compiler gives it, on all ranks (local).

    FFCx 0.5 replaces the element by one with a variant while it compiles a form. Ranks that load
    the result from the cache keep the old one, so that signatures of later forms differ.
    """
    domain = mesh.ufl_domain()
    element = getattr(domain, "_ufl_coordinate_element", None)
    if not hasattr(ufl, "VectorElement") or not isinstance(element, ufl.VectorElement):
        return
    if element.sub_elements()[0]._variant is None:
        degree, rule = element.degree(), element.quadrature_scheme()
        scalar = ufl.FiniteElement(
            element.family(), element.cell(), degree, rule, variant="equispaced"
        )
        domain._ufl_coordinate_element = ufl.VectorElement(scalar)


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
    """Create the Lagrange space of vectors, as for a displacement (collective).

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
        return fem.functionspace(mesh, ("Lagrange", degree, (mesh.geometry.dim,)))
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


def collapsed(V: fem.FunctionSpace) -> tuple[fem.FunctionSpace, npt.NDArray[np.int64]]:
    """A sub-space as a space of its own, and the local dofs of its own in the whole (collective).

    ``collapse`` of dolfinx 0.5 crashes on ranks without cells, for scalar sub-spaces.
    """
    index_map = V.mesh.topology.index_map(V.mesh.topology.dim)
    cells = index_map.size_local + index_map.num_ghosts
    if V.num_sub_spaces or V.mesh.comm.allreduce(cells, MPI.MIN) > 0:
        space, dofs = V.collapse()
        return space, np.asarray(dofs, np.int64)
    create = fem.functionspace if hasattr(fem, "functionspace") else fem.FunctionSpace
    space = create(V.mesh, V.ufl_element())
    index_map = space.dofmap.index_map
    dofs = np.zeros(index_map.size_local + index_map.num_ghosts, np.int64)
    dofs[dofmap(space)] = dofmap(V)
    return space, dofs


def dofmap(V: fem.FunctionSpace) -> npt.NDArray[np.int32]:
    """Return the blocked local dofs of all local cells, ghosts too, shape (num_cells, num_dofs).

    The list became a two-dimensional array in 0.7.
    """
    return as_table(V.dofmap.list, V.dofmap.dof_layout)
