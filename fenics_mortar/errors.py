# SPDX-License-Identifier: MIT
"""The exceptions of the package, and the way in which all ranks raise together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mpi4py import MPI


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
    if not comm.allreduce(error is not None):
        return
    first = next(e for e in comm.allgather(error) if e is not None)
    raise first if error is None else error
