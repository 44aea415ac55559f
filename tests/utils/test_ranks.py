# SPDX-License-Identifier: MIT
"""Values combined over ranks: conditions, and arrays of one type."""

import re
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import fenics_mortar as fm
from fenics_mortar.utils.ranks import (
    agreed,
    any_over_ranks,
    largest_over_ranks,
    on_all_ranks,
    on_any_rank,
    sum_over_ranks,
)

comm = MPI.COMM_WORLD
IS_LAST = comm.rank == comm.size - 1


def test_a_condition_of_one_rank_holds_on_any_but_not_on_all():
    assert on_any_rank(comm, IS_LAST) is True
    assert on_all_ranks(comm, IS_LAST) is (comm.size == 1)


def test_conditions_of_all_ranks_and_of_none():
    assert on_all_ranks(comm, True) is True and on_any_rank(comm, False) is False


def test_sums_where_a_rank_has_nothing_to_count():
    """Of nothing numpy counts integers."""
    number = np.zeros(0 if IS_LAST else 2, np.int64)
    mine = np.bincount(number, 0.5 * np.ones(number.size), 3)
    assert mine.dtype == (np.int64 if IS_LAST else np.float64)
    found = sum_over_ranks(comm, mine)
    assert found.dtype == np.float64 and found.tolist() == [comm.size - 1.0, 0.0, 0.0]


@pytest.mark.parametrize("shape", [(), (0,), (2, 2)])
def test_sums_have_the_shape_of_the_values(shape):
    """Also of lists, of other types, and of arrays that are not contiguous or read-only."""
    ones = np.ones(shape, np.float32 if IS_LAST else np.int64)
    for values in (ones, ones.tolist(), np.broadcast_to(1.0, shape), ones.T.copy().T):
        found = sum_over_ranks(comm, values)
        assert found.dtype == np.float64 and np.array_equal(found, comm.size * np.ones(shape))
    assert sum_over_ranks(comm, 1j * ones).dtype == np.complex128


def test_the_largest_value_is_nan_on_all_ranks_if_one_is():
    """MPI's maximum of nan and a number depends on their order."""
    values = np.array([comm.rank, np.nan if IS_LAST else 1.0, -1 - comm.rank])
    found = largest_over_ranks(comm, values)
    assert found[0] == comm.size - 1 and np.isnan(found[1]) and found[2] == -1.0


def test_flags_and_agreed_values():
    found = any_over_ranks(comm, np.arange(comm.size) == comm.rank)
    assert found.dtype == bool and found.all()
    assert agreed(comm, {"rank": comm.rank}) == {"rank": 0}


@pytest.mark.serial
def test_no_other_module_calls_typed_reductions():
    """The type of an array without entries is that of numpy, not of the other ranks."""
    package = Path(fm.__file__).parent
    found = [
        str(path.relative_to(package))
        for path in sorted(package.rglob("*.py"))
        if re.search(r"\.(Allreduce|Reduce|Allgather|Gather|Scan|Exscan)\(", path.read_text())
    ]
    assert found == ["utils/ranks.py"]
