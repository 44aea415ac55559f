# SPDX-License-Identifier: MIT
"""Work with files that some ranks do for all, and that fails on all ranks or on none."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeVar

from mpi4py import MPI

from fenics_mortar.utils.errors import MortarError, raise_together

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


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Make a file beside ``path`` and put it in its place once it is whole and on the disk (local).

    What was at ``path`` before stays if writing fails or the process is killed.

    Args:
        path: Where the file is to be; of a link, what it leads to.
        write: Writes to a path, which ends as ``path`` does.

    Raises:
        OSError: If it cannot be written, and whatever ``write`` raises.
    """
    path = Path(os.path.realpath(path))
    beside = path.with_name(f".unfinished-{path.name}")
    try:
        write(beside)
        _flush(beside)
        os.replace(beside, path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise
    _flush(path.parent)


def _flush(path: Path) -> None:
    """Have the disk hold a file, or the names in a folder."""
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)
