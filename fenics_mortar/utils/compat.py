# SPDX-License-Identifier: MIT
"""All differences between dolfinx 0.5.2, 0.9 and 0.11, and nothing else.

Functions check the interface (``hasattr``, ``callable``) and never a version number, so that other
releases work as far as their interface agrees. The docstrings name the release of a change.
"""

from __future__ import annotations

import ctypes
import importlib
import importlib.util
import inspect
import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import dolfinx.fem.petsc  # must be explicit in every release
import ufl
from dolfinx import fem, la
from dolfinx import mesh as dmesh

from fenics_mortar.utils.arguments import check_kind, check_number

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]


def _is_told(record: logging.LogRecord) -> bool:
    """Tell whether a record is of another origin than setuptools, or a warning."""
    return record.levelno >= logging.WARNING or "distutils" not in record.pathname


@contextmanager
def quiet_compiler() -> Iterator[None]:
    """Context without the lines "INFO:root:building ..." of the form compiler (local).

    To compile, cffi calls setuptools, which sets the level of the root logger, and logs to it each
    command of the C compiler. FFCx hides these since 0.9. Level and handlers are put back; warnings
    and records of other origin pass.
    """
    root = logging.getLogger()
    level, handlers = root.level, root.handlers[:]
    root.addFilter(_is_told)
    try:
        yield
    finally:
        root.removeFilter(_is_told)
        root.setLevel(level)
        root.handlers[:] = handlers


def scalar_is_complex() -> bool:
    """Tell whether PETSc was built with complex scalars."""
    return np.issubdtype(PETSc.ScalarType, np.complexfloating)


def cell_name(mesh: dmesh.Mesh) -> str:
    """Return ``"triangle"`` or ``"quadrilateral"``.

    ``mesh.ufl_cell().cellname`` became a property in 0.10; the enumeration did not change.
    """
    return mesh.topology.cell_type.name


# Function spaces, functions and expressions


@quiet_compiler()
def scalar_space(mesh: dmesh.Mesh, degree: int, family: str = "Lagrange") -> fem.FunctionSpace:
    """Create a scalar space, e.g. ``family="DG"`` of degree 0 (collective).

    ``fem.FunctionSpace(mesh, element)`` became ``fem.functionspace`` in 0.7.
    """
    create = fem.functionspace if hasattr(fem, "functionspace") else fem.FunctionSpace
    return create(mesh, (family, degree))


@quiet_compiler()
def vector_space(mesh: dmesh.Mesh, degree: int) -> fem.FunctionSpace:
    """Create the Lagrange space of plane vectors (collective).

    ``VectorFunctionSpace`` was removed in 0.8; the shape went into the element.

    Raises:
        ValueError: If ``mesh`` or ``degree`` is not valid.
    """
    check_kind("mesh", mesh, dmesh.Mesh, "a mesh of dolfinx, e.g. the attribute mesh of MeshData")
    expected = "a whole number, at least 1"
    check_number("degree", degree, expected, lambda number: number >= 1, whole=True)
    if hasattr(fem, "functionspace"):
        return fem.functionspace(mesh, ("Lagrange", degree, (2,)))
    return fem.VectorFunctionSpace(mesh, ("Lagrange", degree))


@quiet_compiler()
def mixed_space(mesh: dmesh.Mesh, *parts: tuple[Any, ...]) -> fem.FunctionSpace:
    """Create a space of several unknowns.

    Collective. ``ufl.MixedElement`` was replaced by ``basix.ufl.mixed_element`` in 0.7.

    Args:
        mesh: The mesh.
        parts: Family, degree and, for vectors, the shape of each unknown.

    Raises:
        ValueError: If ``mesh`` is not a mesh or no part is given.

    Example:
        Taylor-Hood displacement and pressure for incompressible bodies, with the shear modulus 1:

        >>> from mpi4py import MPI
        >>> mesh = dmesh.create_unit_square(MPI.COMM_WORLD, 2, 2)
        >>> W = mixed_space(mesh, ("Lagrange", 2, (2,)), ("Lagrange", 1))
        >>> w = fem.Function(W)
        >>> (u, p), (v, q) = ufl.split(w), ufl.TestFunctions(W)
        >>> F = ufl.Identity(2) + ufl.grad(u)
        >>> J, inverse = ufl.det(F), ufl.inv(F).T
        >>> stress = F - inverse + p * J * inverse
        >>> residual = (ufl.inner(stress, ufl.grad(v)) + q * (J - 1)) * ufl.dx

        Supports belong to the sub-space of the displacement, ``fm.dirichlet(W.sub(0), ...)``, and
        the problem gets the whole function: ``fm.ContactProblem(residual, w, ...)``.
    """
    check_kind("mesh", mesh, dmesh.Mesh, "a mesh of dolfinx, e.g. the attribute mesh of MeshData")
    if not parts:
        raise ValueError("expected parts: each a family, a degree and, for vectors, the shape")
    if hasattr(ufl, "MixedElement"):
        cell = mesh.ufl_cell()
        elements = [
            (ufl.VectorElement if len(part) == 3 else ufl.FiniteElement)(part[0], cell, part[1])
            for part in parts
        ]
        return fem.FunctionSpace(mesh, ufl.MixedElement(*elements))
    basix_ufl = importlib.import_module("basix.ufl")
    elements = [
        basix_ufl.element(family, cell_name(mesh), degree, shape=shape[0] if shape else None)
        for family, degree, *shape in parts
    ]
    return fem.functionspace(mesh, basix_ufl.mixed_element(elements))


def is_part_of(V: fem.FunctionSpace, part: Any) -> bool:
    """Tell whether the space ``part`` is ``V`` or a component of it.

    Python's space is the C++ space until 0.6; conditions give the one or the other.
    """
    outer, inner = (getattr(space, "_cpp_object", space) for space in (V, part))
    return outer.contains(inner)


def is_sub_space(V: fem.FunctionSpace) -> bool:
    """Tell whether ``V`` is a view of a part of another space, as ``W.sub(0)`` is."""
    return len(getattr(V, "_cpp_object", V).component()) > 0


def petsc_vec(function: fem.Function) -> PETSc.Vec:
    """Return the PETSc vector, with ghosts, that shares the memory of ``function``.

    ``Function.vector`` became ``Function.x.petsc_vec`` in 0.9. The vector lives as long as the
    function does: do not destroy it.
    """
    return function.x.petsc_vec if hasattr(function.x, "petsc_vec") else function.vector


@quiet_compiler()
def interpolate_expression(function: fem.Function, expression: ufl.core.expr.Expr) -> None:
    """Interpolate a UFL expression into ``function`` and update its ghosts (collective).

    ``element.interpolation_points`` became a property in 0.10. The expression has to contain at
    least one function, constant or coordinate of the mesh.
    """
    points = function.function_space.element.interpolation_points
    points = points() if callable(points) else points
    function.interpolate(fem.Expression(expression, points, **_own_options(fem.Expression)))
    function.x.scatter_forward()


def dofmap(V: fem.FunctionSpace) -> Indices:
    """Return the blocked local dofs of all local cells, ghosts too, shape (num_cells, num_dofs).

    The list became a two-dimensional array in 0.7.
    """
    return _as_table(V.dofmap.list, V.dofmap.dof_layout)


def geometry_dofmap(mesh: dmesh.Mesh) -> Indices:
    """Return the local geometry nodes of all local cells, shape (num_cells, num_nodes).

    The list became a two-dimensional array in 0.7, one of several (``dofmaps``) in 0.11.
    """
    geometry = mesh.geometry
    if hasattr(geometry, "dofmaps") and not callable(geometry.dofmaps):
        return np.asarray(geometry.dofmaps[0])
    return _as_table(geometry.dofmap, geometry.cmap.create_dof_layout())


def _as_table(table: Any, layout: Any) -> Indices:
    """View an adjacency list (until 0.6) as an array, also on a rank without cells."""
    if isinstance(table, np.ndarray):
        return table
    return table.array.reshape(table.num_nodes, layout.num_dofs)


# Forms, matrices and vectors


@quiet_compiler()
def form(ufl_form: ufl.Form) -> fem.Form:
    """Compile a UFL form for PETSc's scalar type (collective).

    0.5 writes into its default option dictionaries, so each form gets its own.
    """
    return fem.form(ufl_form, **_own_options(fem.form))


def create_matrix(a: fem.Form) -> PETSc.Mat:
    """Create the sparse matrix of a bilinear form, with the form's pattern (collective)."""
    return dolfinx.fem.petsc.create_matrix(a)


def assemble_matrix(A: PETSc.Mat, a: fem.Form) -> None:
    """Assemble a bilinear form into ``A`` without boundary conditions; collective."""
    A.zeroEntries()
    dolfinx.fem.petsc.assemble_matrix(A, a)
    A.assemble()


def create_vector(V: fem.FunctionSpace) -> PETSc.Vec:
    """Create a vector of zeros with ghosts and the layout of ``V`` (collective).

    ``la.create_petsc_vector`` became ``la.petsc.create_vector`` of a list in 0.10.
    """
    layout = V.dofmap.index_map, V.dofmap.index_map_bs
    if hasattr(la, "create_petsc_vector"):
        b = la.create_petsc_vector(*layout)
    else:
        b = importlib.import_module("dolfinx.la.petsc").create_vector([layout])
    with b.localForm() as local:
        local.set(0.0)
    return b


def assemble_vector(b: PETSc.Vec, L: fem.Form) -> None:
    """Assemble a linear form into ``b``; owned entries are complete, ghosts stale; collective."""
    with b.localForm() as local:
        local.set(0.0)
    dolfinx.fem.petsc.assemble_vector(b, L)
    b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)


def _own_options(function: Callable) -> dict[str, dict]:
    """Give ``function`` fresh dictionaries; ``..._params`` became ``..._options`` in 0.6."""
    names = ("form_compiler_params", "form_compiler_options", "jit_params", "jit_options")
    return {name: {} for name in names if name in inspect.signature(function).parameters}


# Meshes


@quiet_compiler()
def create_mesh(
    comm: MPI.Comm, cells: npt.ArrayLike, x: npt.ArrayLike, cell_name: str, degree: int = 1
) -> dmesh.Mesh:
    """Create a plane mesh from arrays (collective).

    ``ufl.VectorElement`` gave way to ``basix.ufl.element``, and in 0.10 element and ``x`` changed
    places.

    Args:
        comm: Communicator of the mesh.
        cells: Global numbers of the nodes in basix order, shape (num_cells, nodes per cell); each
            rank gives its part, possibly of shape (0, nodes per cell).
        x: Coordinates of this rank's part of the nodes, shape (num_nodes, 2) [length]; the parts
            are numbered one rank after the other.
        cell_name: ``"triangle"`` or ``"quadrilateral"``.
        degree: Degree of the geometry.
    """
    cells = np.ascontiguousarray(cells, dtype=np.int64)
    x = np.ascontiguousarray(x, dtype=np.float64).reshape(-1, 2)
    if hasattr(ufl, "VectorElement"):
        element = ufl.VectorElement("Lagrange", cell_name, degree)
        return dmesh.create_mesh(comm, cells, x, ufl.Mesh(element))
    basix_ufl = importlib.import_module("basix.ufl")
    element = basix_ufl.element("Lagrange", cell_name, degree, shape=(2,))
    return dmesh.create_mesh(comm, cells, x=x, e=ufl.Mesh(element))


@quiet_compiler()
def model_to_mesh(
    model: Any, comm: MPI.Comm, rank: int = 0
) -> tuple[dmesh.Mesh, dmesh.MeshTags, dmesh.MeshTags]:
    """Make mesh, cell tags and facet tags of the plane gmsh model on rank ``rank`` (collective).

    ``io.gmshio`` became ``io.gmsh`` in 0.10 and its triple a tuple with names, in which tags can
    be missing; here they are empty then. With 0.5 the mesh has ghost cells.

    Args:
        model: The module ``gmsh.model`` on rank ``rank``, anything on the others.
        comm: Communicator of the mesh.
        rank: The rank that has the model.
    """
    new = importlib.util.find_spec("dolfinx.io.gmsh") is not None
    gmshio = importlib.import_module("dolfinx.io.gmsh" if new else "dolfinx.io.gmshio")
    mesh, *tags = gmshio.model_to_mesh(model, comm, rank, gdim=2)[:3]
    mesh.topology.create_entities(1)
    none = np.empty(0, dtype=np.int32)
    tags = [dmesh.meshtags(mesh, d, none, none) if t is None else t for d, t in zip((2, 1), tags)]
    return mesh, tags[0], tags[1]


def gmsh_is_initialized(gmsh: Any) -> bool:
    """Tell whether the module ``gmsh`` has been initialized.

    4.8 has no ``isInitialized``: there any call fails before, and prints an error; it is hidden.
    """
    if hasattr(gmsh, "isInitialized"):
        return bool(gmsh.isInitialized())
    with _no_error_output():
        try:
            return gmsh.logger.getWallTime() >= 0.0
        except Exception:  # gmsh raises Exception itself
            return False


@contextmanager
def _no_error_output() -> Iterator[None]:
    """Context without standard error of this process, also of compiled libraries (local)."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


# Boundary conditions


def set_prescribed(values: Array, bcs: list[Any]) -> None:
    """Write the prescribed values of ``bcs`` into an array of all dofs (local).

    Args:
        values: Shape (local dofs,); changed in place.
        bcs: Dirichlet conditions.

    ``fem.set_bc`` of an array became ``DirichletBC.set``; 0.9 has both and warns of the first.
    """
    for bc in bcs:
        if hasattr(bc, "set"):
            bc.set(values)
        else:
            fem.set_bc(values, [bc])


def prescribed_value(bc: Any) -> Array:
    """The numbers prescribed by a condition, shape (1,) or (2,); empty for a function (local).

    ``DirichletBC`` became a class of Python in 0.7; ``g`` stayed.
    """
    return np.ravel(getattr(bc.g, "value", ()))


# Values of expressions


@quiet_compiler()
def create_expression(expression: ufl.core.expr.Expr, points: npt.ArrayLike) -> fem.Expression:
    """Compile a UFL expression for reference ``points``, shape (num_points, 2) (collective)."""
    points = np.ascontiguousarray(points, dtype=np.float64)
    return fem.Expression(expression, points, **_own_options(fem.Expression))


def evaluate_expression(expression: fem.Expression, mesh: dmesh.Mesh, cells: Indices) -> Array:
    """Evaluate at the expression's points in local ``cells``, shape (num_cells, ...) (local).

    ``Expression.eval`` takes the mesh since 0.7.
    """
    takes_mesh = "mesh" in inspect.signature(expression.eval).parameters
    return expression.eval(mesh, cells) if takes_mesh else expression.eval(cells)


def option_is_used(name: str) -> bool:
    """Tell whether PETSc has used an option of its database, given with prefix (local).

    ``PETSc.Options.used`` is missing in 3.18; there the C function is called.
    """
    database = PETSc.Options()
    if hasattr(database, "used"):
        return bool(database.used(name))
    used = ctypes.c_int(0)
    ask = ctypes.CDLL(PETSc.__file__).PetscOptionsUsed
    ask.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.POINTER(ctypes.c_int)]
    ask(None, name.encode(), ctypes.byref(used))
    return bool(used.value)
