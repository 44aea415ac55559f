# SPDX-License-Identifier: MIT
"""Conditions combined over ranks."""

from mpi4py import MPI

from fenics_mortar.utils.ranks import on_all_ranks, on_any_rank

comm = MPI.COMM_WORLD


def test_a_condition_of_one_rank_holds_on_any_but_not_on_all():
    only_last = comm.rank == comm.size - 1
    assert on_any_rank(comm, only_last) is True
    assert on_all_ranks(comm, only_last) is (comm.size == 1)


def test_conditions_of_all_ranks_and_of_none():
    assert on_all_ranks(comm, True) is True and on_any_rank(comm, False) is False
