# SPDX-License-Identifier: MIT
"""Reductions of one number over the ranks, without calls of MPI on one rank."""

from __future__ import annotations

from mpi4py import MPI


def on_any(comm: MPI.Comm, flag: bool) -> bool:
    """Whether ``flag`` is true on any rank (collective)."""
    return bool(flag) if comm.size == 1 else bool(comm.allreduce(bool(flag), MPI.LOR))


def on_all(comm: MPI.Comm, flag: bool) -> bool:
    """Whether ``flag`` is true on all ranks (collective)."""
    return bool(flag) if comm.size == 1 else bool(comm.allreduce(bool(flag), MPI.LAND))
