# SPDX-License-Identifier: MIT
"""What petsc4py leaves to its users: functions of PETSc, and the release of unreferenced objects.

Functions that petsc4py does not wrap, or in its newest versions only, are called through ctypes
from the library that it has loaded. Unreferenced objects can only be freed by collective calls.
"""

from __future__ import annotations

import ctypes
from collections import deque
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
# Number of communicators of earlier problems that are kept to free their garbage.
MAX_KEPT = 8
_kept: dict[tuple[int, ...], deque[list[PETSc.IS]]] = {}


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
