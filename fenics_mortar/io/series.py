# SPDX-License-Identifier: MIT
"""Time series of several blocks for ParaView.

``<path>.pvd`` lists the steps, one ``.vtm`` file each, which names the blocks and the ``.vtu`` file
of each of them; these are in the folder ``<path>``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

from mpi4py import MPI

from fenics_mortar.utils.files import make_folder, try_together, write_whole


class SeriesBlock(NamedTuple):
    """A block of each step: name of its group, its name, name of its files, writing rank."""

    group: str
    name: str
    file: str
    rank: int


class Series:
    """Steps of a series.

    The constructor is collective.

    Args:
        comm: Communicator.
        path: Path without suffix.
        blocks: The blocks of a step, groups one after the other; equal on all ranks.

    Raises:
        MortarError: On all ranks, if the folder cannot be created.
    """

    def __init__(self, comm: MPI.Comm, path: Path, blocks: Sequence[SeriesBlock]) -> None:
        self._comm, self._path, self._blocks = comm, path, list(blocks)
        self._times: list[float] = []
        make_folder(comm, path)

    def count(self, group: str) -> int:
        """Number of blocks of a group (local)."""
        return sum(block.group == group for block in self._blocks)

    def write(self, time: float, pieces: Sequence[Callable[[], Any]]) -> None:
        """Write a step, then the list of all steps (collective).

        Args:
            time: Time of the step.
            pieces: For each block a function that creates its mesh on the rank that writes it.

        Raises:
            MortarError: On all ranks, if a file cannot be written.
        """
        step, rank = len(self._times), self._comm.rank
        for block, piece in zip(self._blocks, pieces, strict=True):
            file = self._path / f"{block.file}_{step:06d}.vtu"
            work = partial(write_whole, file, partial(_write_piece, piece))
            try_together(self._comm, rank == block.rank, work, f"cannot write '{file}'")
        self._times.append(float(time))
        texts = {
            self._path / f"step_{step:06d}.vtm": self._step(step),
            self._path.with_name(f"{self._path.name}.pvd"): self._index(),
        }
        for file, text in texts.items():
            work = partial(write_whole, file, partial(_write_text, text))
            try_together(self._comm, rank == 0, work, f"cannot write '{file}'")

    def _step(self, step: int) -> str:
        """Text of the file that lists the blocks of a step."""
        from xml.sax.saxutils import quoteattr  # imports the library for HTTP

        lines = ['<VTKFile type="vtkMultiBlockDataSet" version="1.0"><vtkMultiBlockDataSet>']
        for i, (group, blocks) in enumerate(groupby(self._blocks, lambda block: block.group)):
            lines.append(f'<Block index="{i}" name={quoteattr(group)}>')
            for k, block in enumerate(blocks):
                file = quoteattr(f"{block.file}_{step:06d}.vtu")
                lines.append(f'<DataSet index="{k}" name={quoteattr(block.name)} file={file}/>')
            lines.append("</Block>")
        return _document([*lines, "</vtkMultiBlockDataSet></VTKFile>"])

    def _index(self) -> str:
        """Text of the file that lists the steps."""
        from xml.sax.saxutils import quoteattr

        lines = ['<VTKFile type="Collection" version="0.1"><Collection>']
        for step, time in enumerate(self._times):
            file = quoteattr(f"{self._path.name}/step_{step:06d}.vtm")
            lines.append(f'<DataSet timestep="{time!r}" part="0" file={file}/>')
        return _document([*lines, "</Collection></VTKFile>"])


def _document(lines: Sequence[str]) -> str:
    return "\n".join(['<?xml version="1.0"?>', *lines, ""])


def _write_piece(piece: Callable[[], Any], path: Path) -> None:
    piece().write(path)


def _write_text(text: str, path: Path) -> None:
    path.write_text(text)
