# SPDX-License-Identifier: MIT
"""Bordered systems: a few unknowns q in addition to those of a large, factored system A.

    A x + C q = b
    G x + E q = c

Block elimination needs a solve with A for each column of C, and a small dense system for q. The
transposed system has the same form, with the rows of G as columns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, raise_together


@dataclass(frozen=True)
class Border:
    """C, G and E for m additional unknowns and n owned unknowns of A.

    Attributes:
        columns: C transposed, shape (m, n).
        rows: G, shape (m, n).
        corner: E, shape (m, m), equal on all ranks.
    """

    columns: Array
    rows: Array
    corner: Array

    @property
    def transposed(self) -> Self:
        """The border of the transposed system."""
        return type(self)(self.rows, self.columns, self.corner.T)

    def scaled(self, units: Array) -> Self:
        """The border for unknowns q / ``units`` and equations times ``units`` (m,)."""
        each = units[:, None]
        return type(self)(each * self.columns, each * self.rows, each * self.corner * units)

    def joined(self, other: Border) -> Self:
        """The border of the unknowns of both."""
        columns = np.vstack([self.columns, other.columns])
        rows = np.vstack([self.rows, other.rows])
        return type(self)(columns, rows, block_diag(self.corner, other.corner))

    def restricted_to(self, some: npt.NDArray[np.bool_]) -> Self:
        """The border of a subset of the unknowns and their equations; ``some``: (m,), bool."""
        return type(self)(self.columns[some], self.rows[some], self.corner[np.ix_(some, some)])


def solve_bordered(
    solve: Callable[[Array], Array], border: Border, x: Array, c: Array, comm: MPI.Comm
) -> tuple[Array, Array]:
    """Solve a bordered system (collective).

    Args:
        solve: Solves A x = b; takes and returns owned values, shape (n,) (collective).
        border: C, G and E.
        x: Solution of A x = b without the border, owned values, shape (n,).
        c: Right-hand side of the m additional equations, shape (m,), replicated.
        comm: Communicator.

    Returns:
        x, shape (n,), and q, shape (m,), equal on all ranks [units of the system].

    Raises:
        MortarError: On all ranks, if A or the small dense system is singular.
    """
    if not c.size:
        return x, np.zeros(0)
    solutions = np.array([solve(column) for column in border.columns])
    products = comm.allreduce(border.rows @ np.vstack([x, solutions]).T)
    q, error = np.empty_like(c), None
    try:
        q = np.linalg.solve(border.corner - products[:, 1:], c - products[:, 0])
    except np.linalg.LinAlgError as singular:
        error = MortarError(f"the balance of the driven motions is singular: {singular}")
    raise_together(comm, error)
    comm.Bcast(q)
    return x - q @ solutions, q
