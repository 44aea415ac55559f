# SPDX-License-Identifier: MIT
"""PETSc, gmsh and the form compiler, whose interfaces differ between releases as well."""

from __future__ import annotations

import ctypes
import inspect
import logging
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc

import numpy as np

import ufl.corealg

from fenics_mortar.utils.errors import MeshError
from fenics_mortar.utils.petsc import POINTER, petsc_function


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


def free_forms() -> None:
    """Let UFL free the forms that it has differentiated (local).

    In Python 3.13.0 and 3.13.1 ``functools.singledispatchmethod`` keeps all its objects alive, by a
    cache whose values refer to their keys (CPython issue 127750). UFL's rules since 2025.1 use it:
    no mesh would be freed, nor its nine communicators, of which MPICH has 2048. The cache is
    replaced by ``None``, by which Python itself turns it off.
    """
    module = getattr(ufl.corealg, "dag_traverser", None)
    rules = [] if module is None else [module.DAGTraverser]
    while rules:
        rule = rules.pop()
        rules += rule.__subclasses__()
        for method in vars(rule).values():
            if getattr(method, "_method_cache", None) is not None:
                method._method_cache = None


free_forms()


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
