# SPDX-License-Identifier: MIT
"""Errors on one rank only, and the resulting errors on the others."""

from contextlib import contextmanager

from mpi4py import MPI

import pytest

import fenics_mortar as fm

COMM = MPI.COMM_WORLD
LAST = COMM.rank == COMM.size - 1
several_ranks = pytest.mark.usefixtures("several_ranks")


@contextmanager
def raised_on_the_last_rank(kind, message):
    """Check that the last rank raises ``kind``, and all others an error with this message."""
    with pytest.raises(kind if LAST else fm.MortarError) as caught:
        yield
    expected = message if LAST else f"raised on rank {COMM.size - 1}: {kind.__name__}: .*{message}"
    caught.match(expected)


def either(one, other):
    """``one``, or ``other`` on the last of several ranks."""
    return other if LAST and COMM.size > 1 else one
