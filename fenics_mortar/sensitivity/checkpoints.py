# SPDX-License-Identifier: MIT
"""Displacements of the steps of a path: all, or some from which the others are recomputed.

With a spacing n, the displacements of the steps 0, n, 2n, ... are stored, in memory or in files.
The steps between two stored ones are solved again when one of them is visited. A sweep through a
path of N steps therefore solves each step once more and stores N / n + n displacements. Interface
states are small and always stored.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from os import PathLike
from pathlib import Path

from mpi4py import MPI

import numpy as np

from fenics_mortar.utils.arguments import check_kind, check_number
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.files import make_folder, try_together


class Checkpoints:
    """Displacements (local dofs,) of steps by their number; methods are collective.

    Args:
        comm: Communicator.
        every: Spacing of the stored steps, at least 1.
        folder: Folder of the files, one per stored step and rank; ``None``: in memory.

    Raises:
        ValueError: If ``every`` is not a positive integer, or ``folder`` is not a name.
        MortarError: On all ranks, if the folder cannot be created.
    """

    def __init__(self, comm: MPI.Comm, every: int, folder: str | Path | None) -> None:
        check_number("every", every, "a spacing of at least 1", lambda n: n >= 1, whole=True)
        self._comm, self.every = comm, every
        expected = "the name of a folder, or None"
        check_kind("folder", comm.bcast(folder), (str, PathLike, type(None)), expected)
        self._folder = None if folder is None else Path(str(comm.bcast(str(folder))))
        if self._folder is not None:
            make_folder(comm, self._folder)
        self._kept: dict[int, Array] = {}
        self._segment: dict[int, Array] = {}

    @property
    def drops(self) -> bool:
        """Whether records are stored without their displacement."""
        return self.every > 1 or self._folder is not None

    def put(self, number: int, u: Array) -> None:
        """Store the displacement (local dofs,) of a step, for each multiple of the spacing.

        Raises:
            MortarError: On all ranks, if the file cannot be written.
        """
        if number % self.every:
            return
        if self._folder is None:
            self._kept[number] = u.copy()
            return
        file = self._file(number)
        try_together(self._comm, True, partial(np.save, file, u), f"cannot write '{file}'")

    def _file(self, number: int) -> Path:
        assert self._folder is not None
        return self._folder / f"step_{number}_rank_{self._comm.rank}.npy"

    def get(self, number: int, count: int, again: Callable[[int, Array], Array]) -> Array:
        """Displacement of a step, shape (local dofs,) [length].

        Args:
            number: Number of the step.
            count: Number of steps.
            again: Function that solves a step again from the displacement of the previous step.

        Raises:
            MortarError: On all ranks, if a file cannot be read; or any error of ``again``.
        """
        first = number - number % self.every
        if number == first:
            return self._read(first)
        if number not in self._segment:
            self._segment = {}
            u, found = self._read(first), {}
            for k in range(first + 1, min(first + self.every, count)):
                found[k] = u = again(k, u)
            self._segment = found
        return self._segment[number]

    def _read(self, number: int) -> Array:
        if self._folder is None:
            return self._kept[number]
        file = self._file(number)
        u = try_together(self._comm, True, partial(np.load, file), f"cannot read '{file}'")
        assert u is not None
        return np.asarray(u)
