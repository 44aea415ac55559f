# SPDX-License-Identifier: MIT
"""Files that some ranks read and write, with errors raised on all ranks; Markdown."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

from mpi4py import MPI

from fenics_mortar.utils.errors import MortarError, check_kind, raise_together

T = TypeVar("T")


def without_suffix(comm: MPI.Comm, path: str | Path, suffix: str) -> Path:
    """The path of the first rank without its suffix, if present (collective).

    Raises:
        ValueError: On all ranks, if the path is neither a string nor path-like.
        MortarError: On all ranks, if the path has no file name.
    """
    check_kind("path", comm.bcast(path), (str, os.PathLike), "the name of a file")
    path = Path(str(comm.bcast(path)).removesuffix(suffix))
    if not path.name:
        raise MortarError(f"'{path}' is not a file name; expected e.g. 'results/name{suffix}'")
    return path


def make_folder(comm: MPI.Comm, folder: Path) -> None:
    """Create a folder if missing (collective).

    Raises:
        MortarError: On all ranks, if it cannot be created.
    """
    make = partial(folder.mkdir, parents=True, exist_ok=True)
    try_together(comm, comm.rank == 0, make, f"cannot create the folder '{folder}'")


def try_together(comm: MPI.Comm, here: bool, work: Callable[[], T], message: str) -> T | None:
    """Call ``work`` on ranks with ``here``; an error is raised on all ranks (collective).

    Raises:
        MortarError: On all ranks; ``message`` and the error.
    """
    error, done = None, None
    try:
        if here:
            done = work()
    except Exception as exception:  # any error: it must be raised on all ranks
        error = MortarError(f"{message}: {exception}")
        error.__cause__ = exception
    raise_together(comm, error)
    return done


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file beside ``path`` and move it there once it is complete and on disk (local).

    An earlier file at ``path`` is kept if writing fails or the process is killed.

    Args:
        path: Path of the file; links are followed.
        write: Function that writes to a path, which has the suffix of ``path``.

    Raises:
        OSError: If it cannot be written.
        Exception: Any error of ``write``.
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
    """Flush a file, or the names in a folder, to disk."""
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


class Markdown:
    """Base of objects whose ``str`` is Markdown."""

    def _repr_markdown_(self) -> str:
        """Text that a notebook renders (local)."""
        return str(self)


class MarkdownText(Markdown, str):
    """A text in Markdown."""


def markdown_table(
    head: Sequence[str], rows: Iterable[Sequence[str]], *, left: Sequence[int] = ()
) -> str:
    """Markdown table, columns aligned to the right but those with the numbers ``left`` (local)."""
    lines = [f"| {' | '.join(cells)} |" for cells in (head, *rows)]
    marks = ["---|" if number in left else "---:|" for number in range(len(head))]
    return "\n".join([lines[0], f"|{''.join(marks)}", *lines[1:]])
