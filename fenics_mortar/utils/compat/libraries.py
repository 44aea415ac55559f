# SPDX-License-Identifier: MIT
"""PETSc and gmsh, whose interfaces differ between releases as well."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc

import numpy as np

from fenics_mortar.utils.errors import MeshError
from fenics_mortar.utils.petsc import POINTER, petsc_function


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


def gmsh_is_initialized(gmsh: Any) -> bool:
    """Whether the module ``gmsh`` has been initialized (local).

    Release 4.8 has no ``isInitialized``: before initialization any call fails and prints an error,
    which is hidden.
    """
    if hasattr(gmsh, "isInitialized"):
        return bool(gmsh.isInitialized())
    with _no_error_output():
        try:
            return gmsh.logger.getWallTime() >= 0.0
        except Exception:  # gmsh raises Exception itself
            return False


def cure_of_gmsh(error: Exception) -> str:
    """What to install after an ``import gmsh`` that failed with ``error`` (local).

    The wheel needs libraries of a desktop, which it does not bring.
    """
    if isinstance(error, ImportError):
        return "install gmsh: by apt-get install python3-gmsh (Debian), or pip install gmsh"
    return (
        "gmsh's wheel needs libraries of the system; as root: apt-get install libglu1-mesa libgl1 "
        "libxcursor1 libxft2 libxinerama1 libgomp1 (Debian, Ubuntu), or dnf install mesa-libGLU "
        "mesa-libGL libXcursor libXft libXinerama libgomp (Fedora)"
    )


def missing_gmsh(purpose: str, error: Exception) -> MeshError:
    """The error to raise after an ``import gmsh`` that failed with ``error`` (local).

    Args:
        purpose: What gmsh is needed for, as "to read 'a.msh'".
        error: The error of the import.
    """
    cure = cure_of_gmsh(error)
    return MeshError(f"the Python module gmsh is needed {purpose}: {error}; {cure}")


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
