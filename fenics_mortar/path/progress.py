# SPDX-License-Identifier: MIT
"""Progress of a path: records of the logger ``fenics_mortar``, and a bar in the terminal.

Rank 0 logs each accepted step and each cut with level INFO, and the table of each solve with level
DEBUG. Nothing is shown unless the program sets up logging::

    logging.basicConfig()
    logging.getLogger("fenics_mortar").setLevel(logging.INFO)
"""

from __future__ import annotations

import importlib
import logging
from types import TracebackType
from typing import Any

from mpi4py import MPI

from fenics_mortar.newton.report import NewtonReport
from fenics_mortar.utils.arguments import check_flag

LOGGER = logging.getLogger("fenics_mortar")
LOGGER.addHandler(logging.NullHandler())


class Progress:
    """Log and bar of one path; a context that closes the bar; methods are local.

    Args:
        comm: Communicator of the problem; rank 0 logs and draws.
        start: First time of the path.
        stop: Its final time.
        bar: Whether to draw a bar.

    Raises:
        ValueError: If a bar is requested and the package tqdm is missing.
    """

    def __init__(self, comm: MPI.Comm, start: float, stop: float, *, bar: bool = False) -> None:
        self._first = comm.rank == 0
        self._bar: Any = None
        if bar and self._first:
            form = "{l_bar}{bar}| {n:.4g}/{total:.4g} [{elapsed}<{remaining}{postfix}]"
            self._bar = _tqdm()(total=stop - start, bar_format=form, desc="path")
        self._num_steps = self._num_cuts = 0
        self._time = start

    def accept(self, time: float, report: NewtonReport) -> None:
        """Log the accepted step to ``time``."""
        self._num_steps += 1
        self._log(f"step {self._num_steps}, time {time:.6g}: {report.reason}", report)
        if self._bar is not None:
            counts = f"{self._num_steps} steps, {self._num_cuts} cuts"
            self._bar.set_postfix_str(counts, refresh=False)
            self._bar.update(time - self._time)
        self._time = time

    def cut(self, time: float, reason: str, report: NewtonReport) -> None:
        """Log the failed step to ``time``."""
        self._num_cuts += 1
        self._log(f"time {time:.6g}: cut, {reason}", report)

    def _log(self, line: str, report: NewtonReport) -> None:
        if self._first:
            LOGGER.info("%s", line)
            LOGGER.debug("%s", report)

    def __enter__(self) -> Progress:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the bar."""
        if self._bar is not None:
            self._bar.close()


def check_bar(requested: Any) -> None:
    """Reject a bar that cannot be drawn (local).

    Raises:
        ValueError: If ``requested`` is not a flag, or the package tqdm is missing.
    """
    check_flag("progress", requested)
    if requested:
        _tqdm()


def _tqdm() -> Any:
    """The bar's class."""
    try:
        return importlib.import_module("tqdm").tqdm
    except ImportError as error:
        message = "progress=True needs the package tqdm: Debian's python3-tqdm, or pip install tqdm"
        raise ValueError(message) from error
