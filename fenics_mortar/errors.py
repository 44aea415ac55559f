# SPDX-License-Identifier: MIT
"""The exceptions of the package, and the way in which all ranks raise together."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from mpi4py import MPI

T = TypeVar("T")


class MortarError(Exception):
    """Base class of everything this package raises."""


class MeshError(MortarError):
    """A mesh, a physical name or a tag is not what the call needs."""


class SurfaceError(MortarError):
    """A contact surface is empty, branching, degenerate or used twice."""


class NotConvergedError(MortarError):
    """Newton did not converge; ``report`` holds what happened until then."""

    def __init__(self, message: str, report: Any) -> None:
        super().__init__(message)
        self.report = report


def raise_together(comm: MPI.Comm, error: MortarError | None) -> None:
    """Raise on all ranks if any rank has an error: no rank may leave a collective call alone.

    Args:
        comm: Communicator of the call (collective).
        error: The error found on this rank, or ``None``.

    Raises:
        MortarError: The error of the lowest rank that has one, on every rank.
    """
    if comm.allreduce(error is not None):
        raise next(e for e in comm.allgather(error) if e is not None)


def call_together(comm: MPI.Comm, what: str, call: Callable[[], T]) -> T:
    """Call a function of the user; if it raises on any rank, raise on all (collective).

    Args:
        comm: Communicator of the call.
        what: What is called, in words.
        call: The function. It must not raise on one rank only before something collective in it.

    Raises:
        Exception: What ``call`` raised, on the ranks where it did.
        MortarError: On the others; says where and what that was.
    """
    error = None
    try:
        result = call()
    except Exception as exception:  # no rank may leave alone, whatever it is
        error = exception
    words = error and f"{what} raised on rank {comm.rank}: {type(error).__name__}: {error}"
    everywhere = list(filter(None, comm.allgather(words)))
    if error:
        raise error
    if everywhere:
        raise MortarError(everywhere[0])
    return result


def check_same(comm: MPI.Comm, values: Iterable[tuple[str, npt.ArrayLike]]) -> None:
    """Refuse numbers that are not the same on all ranks (collective).

    Args:
        comm: Communicator of the call.
        values: Names for messages, and numbers of any shape, the same shapes on all ranks.

    Raises:
        MortarError: On all ranks.
    """
    named, error = [(name, np.ravel(value)) for name, value in values], None
    first = comm.bcast([value for _, value in named])
    for (name, mine), other in zip(named, first, strict=True):
        differ = np.flatnonzero((mine != other) & ~(np.isnan(mine) & np.isnan(other)))
        if differ.size:
            error = MortarError(
                f"{name} is {other[differ[0]]:g} on rank 0 and {mine[differ[0]]:g} on rank "
                f"{comm.rank}; all ranks need the same value"
            )
    raise_together(comm, error)


def place(x: npt.NDArray[np.float64] | tuple[float, ...]) -> str:
    """A position in words."""
    return f"({x[0]:.4g}, {x[1]:.4g})"


def count_places(comm: MPI.Comm, places: npt.NDArray[np.float64]) -> tuple[int, str]:
    """Count the places (n, 2) of all ranks; put the lowest of them in words (collective)."""
    mine = [tuple(map(float, x)) for x in places]
    everything = [x for lowest in comm.allgather(sorted(mine)[:1]) for x in lowest]
    return comm.allreduce(len(mine)), place(min(everything)) if everything else "nowhere"
