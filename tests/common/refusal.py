# SPDX-License-Identifier: MIT
"""Errors that all ranks must raise equally."""

import re
from contextlib import contextmanager

from mpi4py import MPI

import pytest

COMM = MPI.COMM_WORLD


@contextmanager
def refused(kind, *parts):
    """Check that each rank raises ``kind`` with a common message that contains all ``parts``."""
    error = None
    try:
        yield
    except Exception as raised:
        error = raised
    everywhere = COMM.allgather((type(error).__name__, str(error)))
    assert {name for name, _ in everywhere} == {kind.__name__}, everywhere
    assert len(set(everywhere)) == 1, everywhere
    for part in parts:
        assert re.search(part, everywhere[0][1]), everywhere[0][1]


@contextmanager
def refused_with_address(kind, message):
    """As ``refused``, for a message that contains an object, whose address differs."""
    with pytest.raises(kind, match=message):
        yield
    COMM.barrier()
