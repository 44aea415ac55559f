# SPDX-License-Identifier: MIT
"""The exceptions of the package, and the way in which all ranks raise together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

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
    if comm.allreduce(error is not None):
        raise next(e for e in comm.allgather(error) if e is not None)


def place(x: npt.NDArray[np.float64] | tuple[float, ...]) -> str:
    """A position in words."""
    return f"({x[0]:.4g}, {x[1]:.4g})"


def count_places(comm: MPI.Comm, places: npt.NDArray[np.float64]) -> tuple[int, str]:
    """Count the places (n, 2) of all ranks; put the lowest of them in words (collective)."""
    mine = [tuple(map(float, x)) for x in places]
    everything = [x for lowest in comm.allgather(sorted(mine)[:1]) for x in lowest]
    return comm.allreduce(len(mine)), place(min(everything)) if everything else "nowhere"
