# SPDX-License-Identifier: MIT
"""The exceptions of the package, and the way in which all ranks raise together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from mpi4py import MPI

T = TypeVar("T")
# So many numbers of an array are told in a message.
MOST_NUMBERS = 6


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


class RaisedElsewhereError(MortarError):
    """What a user handed in raised on another rank.

    That rank is on its way out of the call, so nothing may catch this and go on.
    """


class NotFiniteError(MortarError):
    """A law or a distance of the user gave nan or infinity for finite arguments."""


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
    leave_together(comm, what, error)
    return result


def leave_together(comm: MPI.Comm, what: str, error: Exception | None) -> None:
    """Raise on all ranks if any rank has an error, of whatever kind (collective).

    Args:
        comm: Communicator of the call.
        what: What raised it, in words.
        error: The error of this rank, or ``None``.

    Raises:
        Exception: ``error``, where there is one.
        MortarError: On the other ranks; the same one if it is the package's own, else a
            ``RaisedElsewhereError`` that says where and what it was.
    """
    ours = isinstance(error, MortarError) and not isinstance(error, NotConvergedError)
    words = f"{what} raised on rank {comm.rank}: {type(error).__name__}: {error}"
    told = error if ours or error is None else RaisedElsewhereError(words)
    everywhere = [other for other in comm.allgather(told) if other is not None]
    if error is not None and not ours:
        raise error
    if everywhere:
        raise everywhere[0]


@contextmanager
def together(comm: MPI.Comm, what: str) -> Iterator[None]:
    """Context of local checks: what one rank refuses, all refuse (collective).

    Args:
        comm: Communicator of the call.
        what: What is checked, in words.

    Raises:
        Exception: See ``leave_together``.
    """
    error = None
    try:
        yield
    except Exception as exception:  # no rank may leave alone, whatever it is
        error = exception
    leave_together(comm, what, error)


@contextmanager
def going_on() -> Iterator[None]:
    """Context after whose errors work goes on, unless another rank has left with one of its own."""
    try:
        yield
    except RaisedElsewhereError:
        raise
    except MortarError:
        pass


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


def check_same_words(comm: MPI.Comm, what: str, values: Mapping[str, Any]) -> None:
    """Refuse options of any kind that are not the same on all ranks (collective).

    Args:
        comm: Communicator of the call.
        what: What has the options, in words.
        values: The options by name. Of objects their kind and public numbers and words count.

    Raises:
        MortarError: On all ranks.
    """
    mine, error = [(name, in_words(value)) for name, value in values.items()], None
    first = comm.bcast(mine)
    for (name, here), (_, there) in zip(mine, first, strict=False):
        if here != there and error is None:
            error = MortarError(
                f"{what}: {name} is {there} on rank 0 and {here} on rank {comm.rank}; all ranks "
                "need the same"
            )
    raise_together(comm, error)


def in_words(value: Any) -> str:
    """A value in words that are equal for equal values, without addresses in memory."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, complex, str)):
        return repr(value)
    if isinstance(value, np.ndarray):
        numbers = ", ".join(map(str, value.ravel()[:MOST_NUMBERS].tolist()))
        return f"[{numbers}] of shape {value.shape}, with a sum of {value.sum():.17g}"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{in_words(k)}: {in_words(v)}' for k, v in value.items())}}}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(in_words, value))}]"
    plain = (bool, int, float, str, np.generic, type(None))
    shown = {k: v for k, v in getattr(value, "__dict__", {}).items() if isinstance(v, plain)}
    numbers = ", ".join(f"{k}={in_words(v)}" for k, v in shown.items() if not k.startswith("_"))
    return f"{type(value).__name__}({numbers})"


def place(x: npt.NDArray[np.float64] | tuple[float, ...]) -> str:
    """A position in words."""
    return f"({x[0]:.4g}, {x[1]:.4g})"


def count_places(comm: MPI.Comm, places: npt.NDArray[np.float64]) -> tuple[int, str]:
    """Count the places (n, 2) of all ranks; put the lowest of them in words (collective)."""
    mine = [tuple(map(float, x)) for x in places]
    everything = [x for lowest in comm.allgather(sorted(mine)[:1]) for x in lowest]
    return comm.allreduce(len(mine)), place(min(everything)) if everything else "nowhere"
