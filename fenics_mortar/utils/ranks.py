# SPDX-License-Identifier: MIT
"""Conditions combined over ranks, without communication on a single rank.

mpi4py pickles such values, which takes as long as a kernel on a small problem.
"""

from __future__ import annotations

from mpi4py import MPI


def on_any_rank(comm: MPI.Comm, flag: bool) -> bool:
    """Whether ``flag`` is true on at least one rank (collective)."""
    return flag if comm.size == 1 else bool(comm.allreduce(flag, MPI.LOR))


def on_all_ranks(comm: MPI.Comm, flag: bool) -> bool:
    """Whether ``flag`` is true on every rank (collective)."""
    return flag if comm.size == 1 else bool(comm.allreduce(flag, MPI.LAND))
