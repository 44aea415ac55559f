# SPDX-License-Identifier: MIT
"""Forms, and the matrices and vectors assembled from them."""

from __future__ import annotations

import importlib
from typing import Any

from petsc4py import PETSc

import numpy as np

import dolfinx.fem.petsc  # needs an explicit import in every release
import ufl
from dolfinx import fem, la

from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.compat.compiler import log_compilation, own_options, quiet_compiler


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
