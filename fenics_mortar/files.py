# SPDX-License-Identifier: MIT
"""Work with files that some ranks do for all, and that fails on all ranks or on none."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeVar

from mpi4py import MPI

from fenics_mortar.errors import MortarError, raise_together

T = TypeVar("T")


def without_suffix(comm: MPI.Comm, path: str | Path, suffix: str) -> Path:
    """The path of the first rank without its suffix, if it has that (collective)."""
    path = Path(str(comm.bcast(path)).removesuffix(suffix))
    if not path.name:
        raise MortarError(f"'{path}' is no name of a file; right is e.g. 'results/name{suffix}'")
    return path


def make_folder(comm: MPI.Comm, folder: Path) -> None:
    """Make a folder where there is none (collective)."""
    make = partial(folder.mkdir, parents=True, exist_ok=True)
    try_together(comm, comm.rank == 0, make, f"cannot make the folder '{folder}'")


def try_together(comm: MPI.Comm, here: bool, work: Callable[[], T], message: str) -> T | None:
    """Do ``work`` if it is due ``here``; raise on all ranks if it fails on one (collective)."""
    error, done = None, None
    try:
        if here:
            done = work()
    except Exception as exception:  # no rank may leave alone, whatever it is
        error = MortarError(f"{message}: {exception}")
        error.__cause__ = exception
    raise_together(comm, error)
    return done
