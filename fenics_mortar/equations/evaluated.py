# SPDX-License-Identifier: MIT
"""An evaluation with which Newton's method may begin.

Whether a guess is used is decided by its residual. If the solve leaves this state unchanged before
the first iteration, the evaluation is not repeated.
"""

from __future__ import annotations

from operator import is_
from typing import NamedTuple

from mpi4py import MPI

import numpy as np

from fenics_mortar.equations.state import State
from fenics_mortar.newton.loop import Status


class Evaluated(NamedTuple):
    """An evaluated state, the present one at the end of its evaluation, and its status."""

    state: State
    status: Status

    def is_of(self, state: State, comm: MPI.Comm) -> bool:
        """Whether a state has the same unknowns, sets and settings (collective).

        Arrays of interfaces are values, and equal only if they are one object.
        """
        ours, theirs = self.state, state
        same = ours.converged == theirs.converged and ours.rates is theirs.rates
        same = same and np.array_equal(ours.u, theirs.u)
        same = same and np.array_equal(ours.places, theirs.places)
        for one, other in zip(ours.interfaces, theirs.interfaces, strict=True):
            same = same and all(map(is_, vars(one).values(), vars(other).values()))
        return bool(comm.allreduce(same, MPI.LAND))
