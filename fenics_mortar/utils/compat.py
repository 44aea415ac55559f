# SPDX-License-Identifier: MIT
"""All differences between dolfinx 0.5.2, 0.9 and 0.11, and what petsc4py leaves to its users.

Functions check the interface (``hasattr``, ``callable``), never a version number, so that other
releases work if their interface agrees. Docstrings name the release of each change.

``petsc_function`` gives functions of PETSc, ``free_garbage`` releases unreferenced objects.
"""

from __future__ import annotations

import ctypes
import importlib
import importlib.util
import inspect
import logging
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import basix
import dolfinx.fem.petsc
import ufl
from dolfinx import fem, la
from dolfinx import mesh as dmesh
from ufl.algorithms import compute_form_data

from fenics_mortar.utils.errors import MortarError, check_kind, check_number

if TYPE_CHECKING:
    from fenics_mortar.utils.arrays import Array, Indices, Numbers

# PT-SCOTCH 7, which divides meshes, calls MPI from two threads of a rank unless told to use one: on
# small meshes it then waits for ever (7.0.16, Open MPI 5, 5 cells on 5 ranks: within 200 meshes).
os.environ.setdefault("SCOTCH_PTHREAD_NUMBER", "1")

_petsc = ctypes.CDLL(PETSc.__file__)
# Types of arguments: PETSc's integers, communicators, and handles of objects, arrays or addresses.
INT = np.ctypeslib.as_ctypes_type(PETSc.IntType)
COMM = ctypes.c_int if MPI._sizeof(MPI.Comm) == ctypes.sizeof(ctypes.c_int) else ctypes.c_void_p
POINTER = ctypes.c_void_p
# Number of communicators of earlier problems that are kept to free their garbage.
MAX_KEPT = 8
_kept: dict[tuple[int, ...], deque[list[PETSc.IS]]] = {}


def petsc_function(name: str, *types: Any, checked: bool = True) -> Any:
    """A function of PETSc (local).

    Functions that petsc4py does not wrap, or in its newest versions only, are called through ctypes
    from the library that it has loaded.

    Args:
        name: Its name.
        types: Types of its arguments.
        checked: Whether the function raises a ``MortarError`` for error codes; otherwise they are
            returned.
    """
    function: Any = getattr(_petsc, name)
    function.argtypes = types
    if checked:
        function.errcheck = _check
    return function


def _check(code: int, function: Any, arguments: tuple[Any, ...]) -> None:
    if code:
        raise MortarError(f"PETSc's function {function.__name__} failed with error {code}")


def free_garbage(comm: MPI.Comm, *objects: Any) -> None:
    """Free the PETSc objects without references on all ranks (collective).

    petsc4py stores such objects until this call, since their destruction is collective: some
    vectors in each iteration, matrices and factors of each problem. They are stored by
    communicator, and each vector and matrix of dolfinx has its own communicator, shared by its
    duplicates.

    Args:
        comm: A communicator whose garbage is freed.
        objects: PETSc objects whose communicators are included.
    """
    for each in (comm, *(some.comm for some in objects)):
        PETSc.garbage_cleanup(each)


def return_free_memory() -> None:
    """Return free memory of the C library to the system; without effect but with glibc (local).

    Matrices and factors of an iteration leave gaps that those of the next one do not fit into.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(ctypes.c_size_t(0))


def free_garbage_of_earlier(comm: MPI.Comm) -> None:
    """Free unreferenced PETSc objects on communicators kept by these ranks (collective)."""
    for earlier in _kept.get(_world_ranks(comm), ()):
        free_garbage(comm, *earlier)


def keep_communicators(comm: MPI.Comm, *objects: Any) -> None:
    """Keep communicators so that later problems can free the garbage on them (collective).

    Each mesh, vector and matrix of dolfinx has its own communicator; garbage on it can be reached
    only through an object on this communicator, which is kept here.

    Args:
        comm: Communicator of a mesh.
        objects: PETSc objects of the problem on it.
    """
    kept = _kept.setdefault(_world_ranks(comm), deque())
    if len(kept) == MAX_KEPT:
        for oldest in kept.popleft():
            oldest.destroy()
    none = np.empty(0, PETSc.IntType)
    kept.append([PETSc.IS().createGeneral(none, c) for c in (comm, *(o.comm for o in objects))])


def _world_ranks(comm: MPI.Comm) -> tuple[int, ...]:
    """World ranks of a communicator (collective)."""
    return tuple(comm.allgather(MPI.COMM_WORLD.rank))


def products(matrix: Any, vectors: Array, *, transpose: bool = False) -> Array:
    """A PETSc matrix, or its transpose, times rows (k, owned) [matrix times row] (collective)."""
    right, left = matrix.createVecs()
    given, found = (left, right) if transpose else (right, left)
    times = matrix.multTranspose if transpose else matrix.mult
    result = np.empty((len(vectors), found.getLocalSize()))
    for row, vector in zip(result, vectors, strict=True):
        given.array[:] = vector
        times(given, found)
        row[:] = found.array_r
    right.destroy()
    left.destroy()
    return result


# PETSc and the form compiler


def _is_reported(record: logging.LogRecord) -> bool:
    """Whether a log record is a warning or does not come from setuptools."""
    return record.levelno >= logging.WARNING or "distutils" not in record.pathname


@contextmanager
def quiet_compiler() -> Iterator[None]:
    """Context without the lines "INFO:root:building ..." of the form compiler (local).

    For compilation cffi calls setuptools, which sets the level of the root logger and logs each
    command of the C compiler. FFCx hides these records since 0.9. Level and handlers are restored;
    warnings and other records are not suppressed.
    """
    root = logging.getLogger()
    level, handlers = root.level, root.handlers[:]
    root.addFilter(_is_reported)
    try:
        yield
    finally:
        root.removeFilter(_is_reported)
        root.setLevel(level)
        root.handlers[:] = handlers


@contextmanager
def log_compilation(what: str) -> Iterator[None]:
    """Context that logs what the C compiler compiled and its time, level INFO (local).

    Code loaded from a cache is not logged, since no compiler runs then.

    Args:
        what: Description of the code.
    """
    begin, before = time.perf_counter(), os.times()
    yield
    after = os.times()
    if after.children_user > before.children_user:
        seconds = time.perf_counter() - begin
        logger = logging.getLogger("fenics_mortar")
        logger.info("compiled %s in %.1f s; later runs load it from the cache", what, seconds)


def own_options(function: Callable) -> dict[str, dict]:
    """Give ``function`` fresh dictionaries; ``..._params`` became ``..._options`` in 0.6."""
    names = ("form_compiler_params", "form_compiler_options", "jit_params", "jit_options")
    return {name: {} for name in names if name in inspect.signature(function).parameters}


def scalar_is_complex() -> bool:
    """Whether PETSc was built with complex scalars (local)."""
    return np.issubdtype(PETSc.ScalarType, np.complexfloating)


def petsc_has(*packages: str) -> bool:
    """Whether PETSc was built with one of these packages (local)."""
    return any(PETSc.Sys.hasExternalPackage(package) for package in packages)


def option_is_used(name: str) -> bool:
    """Whether PETSc has used an option of its database, given with prefix (local).

    ``PETSc.Options.used`` is missing in 3.18, for which the C function is called.
    """
    database = PETSc.Options()
    if hasattr(database, "used"):
        return bool(database.used(name))
    used = ctypes.c_int(0)
    options_used = petsc_function("PetscOptionsUsed", POINTER, ctypes.c_char_p, POINTER)
    options_used(None, name.encode(), ctypes.byref(used))
    return bool(used.value)


# Meshes and function spaces


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


def geometry_dofmap(mesh: dmesh.Mesh) -> Numbers:
    """Return the local geometry nodes of all local cells, shape (num_cells, num_nodes).

    The list became a two-dimensional array in 0.7, one of several (``dofmaps``) in 0.11.
    """
    geometry = mesh.geometry
    if hasattr(geometry, "dofmaps") and not callable(geometry.dofmaps):
        return np.asarray(geometry.dofmaps[0])
    return as_table(geometry.dofmap, geometry.cmap.create_dof_layout())


def as_table(table: Any, layout: Any) -> Numbers:
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
        elements = [_element(mesh, *part) for part in parts]
        return fem.FunctionSpace(mesh, ufl.MixedElement(*elements))
    basix_ufl = importlib.import_module("basix.ufl")
    elements = [
        basix_ufl.element(family, cell_name(mesh), degree, shape=shape[0] if shape else None)
        for family, degree, *shape in parts
    ]
    return fem.functionspace(mesh, basix_ufl.mixed_element(elements))


def _element(
    mesh: dmesh.Mesh, family: str, degree: int, shape: Sequence[int] = (), **rule: Any
) -> Any:
    """Element of UFL until 2022, for values of a shape."""
    kind = (ufl.FiniteElement, ufl.VectorElement, ufl.TensorElement)[len(shape)]
    size = {"dim": shape[0]} if len(shape) == 1 else {"shape": tuple(shape)} if shape else {}
    return kind(family, mesh.ufl_cell(), degree, **size, **rule)


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
        rule = {"quad_scheme": "default"}
        return fem.FunctionSpace(mesh, _element(mesh, "Quadrature", degree, shape, **rule))
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


def collapsed(V: fem.FunctionSpace) -> tuple[fem.FunctionSpace, Indices]:
    """A sub-space as a space of its own, and the local dofs of its own in the whole (collective).

    ``collapse`` of dolfinx 0.5 crashes on ranks without cells, for scalar sub-spaces; that of 0.11
    returns a list of arrays, one for each type of cell.
    """
    index_map = V.mesh.topology.index_map(V.mesh.topology.dim)
    cells = index_map.size_local + index_map.num_ghosts
    if V.num_sub_spaces or V.mesh.comm.allreduce(cells, MPI.MIN) > 0:
        space, dofs = V.collapse()
        return space, np.asarray(dofs, np.int64).reshape(-1)
    create = fem.functionspace if hasattr(fem, "functionspace") else fem.FunctionSpace
    space = create(V.mesh, V.ufl_element())
    index_map = space.dofmap.index_map
    dofs = np.zeros(index_map.size_local + index_map.num_ghosts, np.int64)
    dofs[dofmap(space)] = dofmap(V)
    return space, dofs


def dofmap(V: fem.FunctionSpace) -> Numbers:
    """Return the blocked local dofs of all local cells, ghosts too, shape (num_cells, num_dofs).

    The list became a two-dimensional array in 0.7.
    """
    return as_table(V.dofmap.list, V.dofmap.dof_layout)


# Forms and expressions: what is assembled and evaluated, and by which quadrature rules


@quiet_compiler()
def form(ufl_form: ufl.Form) -> fem.Form:
    """Compile a UFL form for PETSc's scalar type (collective).

    Release 0.5 modifies its default option dictionaries; each form therefore has separate ones.
    """
    rank = len(ufl_form.arguments())
    with log_compilation({1: "a residual or load", 2: "a tangent"}.get(rank, "an integral")):
        return fem.form(_with_tags_of_their_kind(ufl_form), **own_options(fem.form))


def _with_tags_of_their_kind(form: ufl.Form) -> ufl.Form:
    """Give integrals without tags those of the others of their kind, as release 0.9 demands."""
    given = [(i, i.integral_type(), i.subdomain_data()) for i in form.integrals()]
    known = {kind: tags for _, kind, tags in given if tags is not None}
    if not any(tags is None and kind in known for _, kind, tags in given):
        return form
    parts = [i.reconstruct(subdomain_data=known.get(k) if t is None else t) for i, k, t in given]
    return ufl.Form(parts)


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
    set_zero(b)
    return b


def set_zero(b: PETSc.Vec) -> None:
    """Set all entries to zero, ghosts included (collective).

    Without ``localForm``: an interruption before its end destroys the vector's ghosts.
    """
    b.set(0.0)
    if b.comm.size > 1:
        b.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)


def assemble_vector(b: PETSc.Vec, L: fem.Form) -> None:
    """Assemble a linear form into ``b``; owned entries are complete, ghosts stale; collective."""
    set_zero(b)
    dolfinx.fem.petsc.assemble_vector(b, L)
    if b.comm.size > 1:
        b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)


def local_sums(L: fem.Form) -> Array:
    """Contributions of this rank's cells to a linear form, (local dofs,) [its unit] (local)."""
    return np.array(fem.assemble_vector(L).array)


def petsc_vec(function: fem.Function) -> PETSc.Vec:
    """Return the PETSc vector, with ghosts, that shares the memory of ``function``.

    ``Function.vector`` became ``Function.x.petsc_vec`` in 0.9. The vector is valid as long as the
    function exists: do not destroy it.
    """
    return function.x.petsc_vec if hasattr(function.x, "petsc_vec") else function.vector


def set_prescribed(values: Array, bcs: list[Any]) -> None:
    """Write the prescribed values of ``bcs`` into an array of all dofs (local).

    Args:
        values: Shape (local dofs,); changed in place.
        bcs: Dirichlet conditions, of dolfinx or rigid boundaries; later ones prevail.

    ``fem.set_bc`` of an array became ``DirichletBC.set``; 0.9 has both and deprecates the first.
    """
    for bc in bcs:
        if hasattr(bc, "set"):
            bc.set(values)
        else:
            fem.set_bc(values, [bc])


def prescribed_value(bc: Any) -> Array:
    """The numbers prescribed by a condition, (1,) or (2,) [length]; empty for a function (local).

    ``DirichletBC`` became a class of Python in 0.7; ``g`` stayed.
    """
    return np.ravel(getattr(bc.g, "value", ()))


def condition_numbers(bc: Any) -> Array:
    """The values of a condition's function (local dofs,) or constant [length], not a copy (local).

    ``DirichletBC`` became a class of Python in 0.7; ``g`` stayed.
    """
    return bc.g.value if hasattr(bc.g, "value") else bc.g.x.array


@quiet_compiler()
def create_expression(expression: ufl.core.expr.Expr, points: npt.ArrayLike) -> fem.Expression:
    """Compile a UFL expression for reference ``points``, shape (num_points, 2) (collective)."""
    points = np.ascontiguousarray(points, dtype=np.float64)
    return fem.Expression(expression, points, **own_options(fem.Expression))


def evaluate_expression(expression: fem.Expression, mesh: dmesh.Mesh, cells: Numbers) -> Array:
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


# Name of a rule, and its degree, or its points if it is custom.
Rule = tuple[str, Any]


def quadrature_rules(form: ufl.Form, integral: Any) -> list[tuple[Rule, int]]:
    """Rules of one integral over cells of a form, and the subdomain of each (local).

    Returns:
        A rule and the number of its subdomain, -1 for all cells.
    """
    numbers = integral.subdomain_id()
    numbers = [_number(n) for n in (numbers if isinstance(numbers, tuple) else (numbers,))]
    given = integral.metadata() or {}
    name = given.get("quadrature_rule", "default")
    if name == "custom":
        points = tuple(map(tuple, np.asarray(given["quadrature_points"])[:, :2].tolist()))
        return [((name, points), number) for number in numbers]
    degree = given.get("quadrature_degree", -1)
    if isinstance(degree, int) and degree >= 0:
        return [((name, degree), number) for number in numbers]
    estimated = _estimated_degrees(form)
    return [((name, estimated[number]), number) for number in numbers]


def _number(number: Any) -> int:
    return -1 if number in ("everywhere", "otherwise") else int(number)


def _estimated_degrees(form: ufl.Form) -> dict[int, int]:
    """Degrees of the integrals over cells without a given one, by subdomain.

    The options are those of FFCx, on which the estimate depends.
    """
    data = compute_form_data(
        form,
        do_apply_function_pullbacks=True,
        do_apply_integral_scaling=True,
        do_apply_geometry_lowering=True,
        preserve_geometry_types=(ufl.classes.Jacobian,),
        do_apply_restrictions=True,
        do_append_everywhere_integrals=False,
    )
    found = dict[int, int]()
    for group in data.integral_data:
        if group.integral_type != "cell":
            continue
        numbers = group.subdomain_id
        for integral in group.integrals:
            if integral.metadata().get("quadrature_degree", -1) in (-1, None):
                degree = int(np.max(integral.metadata()["estimated_polynomial_degree"]))
                for n in numbers if isinstance(numbers, tuple) else (numbers,):
                    found[_number(n)] = degree
    return found


def quadrature_points(cell_name: str, rule: Rule) -> Array:
    """Points of a rule in the reference cell, shape (p, 2) [1] (local).

    The order of the arguments of ``basix.make_quadrature``, and the names of rules, differ between
    0.5 and 0.7; sets of polynomials, its last argument, are new there.
    """
    name, degree = rule
    cell = getattr(basix.CellType, cell_name)
    if name == "custom":
        return np.array(degree, float)
    if name == "vertex":
        return np.asarray(basix.geometry(cell))
    kinds = {key.lower(): kind for key, kind in basix.QuadratureType.__members__.items()}
    kind = kinds[name.lower().replace("-", "_")]
    rule_first = not hasattr(basix, "PolysetType")
    given = (kind, cell, degree) if rule_first else (cell, degree, kind)
    points, _ = basix.make_quadrature(*given)
    return np.asarray(points)


def subdomain_cells(tags: Any, number: int, count: int) -> Indices:
    """Cells of a subdomain of an integral, of the first ``count`` local cells (local).

    Args:
        tags: Subdomain data of the integral: tags of dolfinx, ``None``, or since 0.7 pairs of a
            number and its cells.
        number: Number of the subdomain, -1 for all cells.
        count: Number of the owned cells.
    """
    if number < 0:
        return np.arange(count)
    if hasattr(tags, "find"):
        cells = tags.find(number)
    else:
        cells = np.concatenate([np.empty(0), *(c for n, c in tags if n == number)])
    return np.asarray(cells[cells < count], np.int64)
