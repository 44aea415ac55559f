# SPDX-License-Identifier: MIT
"""Functions of PETSc that petsc4py does not wrap, or in its newest versions only.

They are called through ctypes from the library that petsc4py has loaded.
"""

from __future__ import annotations

import ctypes
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from fenics_mortar.utils.errors import MortarError

_petsc = ctypes.CDLL(PETSc.__file__)
# Types of arguments: PETSc's integers, communicators, and handles of objects, arrays or addresses.
INT = np.ctypeslib.as_ctypes_type(PETSc.IntType)
COMM = ctypes.c_int if MPI._sizeof(MPI.Comm) == ctypes.sizeof(ctypes.c_int) else ctypes.c_void_p
POINTER = ctypes.c_void_p


def petsc_function(name: str, *types: Any, checked: bool = True) -> Any:
    """A function of PETSc (local).

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
