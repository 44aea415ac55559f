# SPDX-License-Identifier: MIT
"""Values combined over ranks, of one type and equal on all of them.

A typed reduction needs arrays of one type on all ranks, but numpy's sums and counts of nothing are
integers: a rank without cells or segments would add bytes of another type, or the others would
wait forever. No other module of the package calls MPI's typed reductions.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, TypeVar

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from fenics_mortar.utils.arrays import Array, Flags

T = TypeVar("T")


def sum_over_ranks(comm: MPI.Comm, values: npt.ArrayLike) -> npt.NDArray[Any]:
    """Sums of an array over all ranks, equal on all of them (collective).

    Args:
        comm: Communicator.
        values: Numbers [any unit], of one shape on all ranks. A contiguous array of floating-point
            numbers may be overwritten by the sums.

    Returns:
        The sums in double precision, of the shape of ``values`` [their unit].
    """
    if isinstance(values, np.ndarray) and values.dtype == np.float64 and values.flags.carray:
        total: npt.NDArray[Any] = values
    else:
        total = _floats(values)
    if comm.size > 1:
        comm.Allreduce(MPI.IN_PLACE, total)
    return total


def largest_over_ranks(comm: MPI.Comm, values: npt.ArrayLike) -> Array:
    """Largest values of an array over all ranks, nan if one of them is nan (collective).

    The result of MPI's maximum of nan and a number depends on their order, which differs between
    ranks.

    Args:
        comm: Communicator.
        values: Numbers [any unit], of one shape on all ranks.

    Returns:
        The largest values in double precision, of the shape of ``values`` [their unit].
    """
    mine = _floats(values)
    if comm.size == 1:
        return mine
    everywhere = np.empty((comm.size, *mine.shape))
    comm.Allgather(mine, everywhere)
    return np.asarray(everywhere.max(axis=0))


def any_over_ranks(comm: MPI.Comm, flags: Flags) -> Flags:
    """Whether flags, of one shape on all ranks, are true on at least one rank (collective).

    ``flags`` may be overwritten.
    """
    found = np.require(flags, np.bool_, ["C", "W"])
    if comm.size > 1:
        comm.Allreduce(MPI.IN_PLACE, found, MPI.LOR)
    return found


def from_all_ranks(comm: MPI.Comm, arrays: Iterable[npt.NDArray[Any]]) -> list[npt.NDArray[Any]]:
    """Arrays [any unit] of any shapes, each with the rows of all ranks in order (collective)."""
    if comm.size == 1:
        return list(arrays)
    return [np.concatenate(each) for each in zip(*comm.allgather(list(arrays)), strict=True)]


def agreed(comm: MPI.Comm, value: T) -> T:
    """The value of rank 0, on all ranks (collective).

    For verdicts on floating-point numbers that each rank computes: they may differ in their last
    digits, and no rank may raise an error or leave a loop alone.
    """
    return value if comm.size == 1 else comm.bcast(value)


def on_any_rank(comm: MPI.Comm, flag: bool) -> bool:
    """Whether ``flag`` is true on at least one rank (collective).

    On a single rank without communication: mpi4py pickles such values, which takes as long as a
    kernel on a small problem.
    """
    return flag if comm.size == 1 else bool(comm.allreduce(flag, MPI.LOR))


def on_all_ranks(comm: MPI.Comm, flag: bool) -> bool:
    """Whether ``flag`` is true on every rank (collective)."""
    return flag if comm.size == 1 else bool(comm.allreduce(flag, MPI.LAND))


def _floats(values: npt.ArrayLike) -> npt.NDArray[Any]:
    """A contiguous, writable array of at least double precision (local)."""
    return np.require(values, np.result_type(np.asarray(values), np.float64), ["C", "W"])
