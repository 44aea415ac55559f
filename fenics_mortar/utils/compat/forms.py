# SPDX-License-Identifier: MIT
"""Forms and expressions: what is assembled and evaluated, and by which quadrature rules."""

from __future__ import annotations

import importlib
import inspect
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import basix
import dolfinx.fem.petsc
import ufl
from dolfinx import fem, la
from dolfinx import mesh as dmesh
from ufl.algorithms import compute_form_data

from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.compat.libraries import log_compilation, own_options, quiet_compiler


@quiet_compiler()
def form(ufl_form: ufl.Form) -> fem.Form:
    """Compile a UFL form for PETSc's scalar type (collective).

    Release 0.5 modifies its default option dictionaries; each form therefore has separate ones.
    """
    rank = len(ufl_form.arguments())
    with log_compilation({1: "a residual or load", 2: "a tangent"}.get(rank, "an integral")):
        return fem.form(ufl_form, **own_options(fem.form))


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
