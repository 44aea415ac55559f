# SPDX-License-Identifier: MIT
"""PETSc matrices from dense blocks, in coordinate form.

Any rank may add to any row; duplicates are summed and negative indices left out. Nothing has to be
preallocated by hand, which on PETSc 3.18 is the difference between milliseconds and minutes.
petsc4py wraps these functions only in its newest releases, so they are called through ctypes, from
the very library that petsc4py has loaded.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from fenics_mortar.errors import MortarError
from fenics_mortar.mortar import Block

# A matrix is symmetric up to this part of its size.
SYMMETRIC = 1e-12

_petsc = ctypes.CDLL(PETSc.__file__)
_set_pattern = _petsc.MatSetPreallocationCOO
_set_pattern.argtypes = [ctypes.c_void_p, ctypes.c_ssize_t, ctypes.c_void_p, ctypes.c_void_p]
_set_values = _petsc.MatSetValuesCOO
_set_values.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int]


class BlockMatrix:
    """A matrix filled from blocks again and again; the pattern is kept while it does not change.

    Args:
        comm: Communicator (all methods are collective).
        rows: Number of rows this rank owns.
        columns: Number of columns this rank owns.
        block_size: Block size told to PETSc.

    Attributes:
        mat: The matrix, once assembled.
        num_patterns: How many different patterns it has had so far.
    """

    def __init__(self, comm: MPI.Comm, rows: int, columns: int, block_size: int = 1) -> None:
        self._comm = comm
        self._sizes = ((rows, None), (columns, None))
        self._block_size = block_size
        self._pattern: tuple[npt.NDArray, npt.NDArray] | None = None
        self.mat: Any = None
        self.num_patterns = 0

    def assemble(self, blocks: Iterable[Block]) -> PETSc.Mat:
        """Sum the blocks into the matrix and return it."""
        i, j, v = flatten(blocks)
        same = self._pattern is not None and all(
            np.array_equal(old, new) for old, new in zip(self._pattern, (i, j), strict=True)
        )
        if not self._comm.allreduce(same, MPI.LAND):
            self._new_pattern(i, j)
        _check(_set_values(self.mat.handle, v.ctypes.data, 1))
        return self.mat

    def _new_pattern(self, i: npt.NDArray, j: npt.NDArray) -> None:
        if self.mat is not None:
            self.mat.destroy()
        self._pattern = (i, j)
        self.num_patterns += 1
        self.mat = PETSc.Mat().create(self._comm)
        self.mat.setSizes(self._sizes)
        self.mat.setType(PETSc.Mat.Type.AIJ)
        self.mat.setBlockSize(self._block_size)
        rows, columns = i.copy(), j.copy()  # PETSc overwrites them
        _check(_set_pattern(self.mat.handle, i.size, rows.ctypes.data, columns.ctypes.data))


def flatten(blocks: Iterable[Block]) -> tuple[npt.NDArray, npt.NDArray, npt.NDArray]:
    """Row, column and value of every entry of the blocks."""
    i, j, v = [], [], []
    for rows, columns, values in blocks:
        i.append(np.broadcast_to(rows[:, :, None], values.shape).ravel())
        j.append(np.broadcast_to(columns[:, None, :], values.shape).ravel())
        v.append(values.ravel())
    if not v:
        return np.empty(0, PETSc.IntType), np.empty(0, PETSc.IntType), np.empty(0)
    return (
        np.concatenate(i).astype(PETSc.IntType),
        np.concatenate(j).astype(PETSc.IntType),
        np.concatenate(v).astype(np.float64),
    )


def is_symmetric(K: PETSc.Mat) -> bool:
    """Whether x . K y = y . K x for two vectors without structure (collective)."""
    x, y = K.createVecs()
    Kx, Ky = x.duplicate(), x.duplicate()
    start = K.getOwnershipRange()[0]
    places = np.arange(start, start + x.getLocalSize(), dtype=float)
    x.array[:], y.array[:] = np.sin(places**2), np.cos(1.0 + places**2)
    K.mult(x, Kx)
    K.mult(y, Ky)
    return bool(abs(x.dot(Ky) - y.dot(Kx)) <= SYMMETRIC * x.norm() * Ky.norm())


def _check(code: int) -> None:
    if code:
        raise MortarError(f"PETSc refused a matrix in coordinate form, error {code}")
