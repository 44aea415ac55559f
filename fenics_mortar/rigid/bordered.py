# SPDX-License-Identifier: MIT
"""Bordered systems: few unknowns q beside those of a large system A, which alone is factored.

    A x + C q = b
    G x + E q = c

The few are eliminated, with the answers of A to the columns of C; what is left is a small dense
system. The transposed system has the same form, with the rows of G for columns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, raise_together


@dataclass(frozen=True)
class Border:
    """C, G and E of m unknowns beside n of this rank.

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
        """The border for unknowns q / ``units`` and equations times ``units``, shape (m,)."""
        each = units[:, None]
        return type(self)(each * self.columns, each * self.rows, each * self.corner * units)

    def part(self, some: npt.NDArray[np.bool_]) -> Self:
        """The border of some of the unknowns and their equations, (m,)."""
        return type(self)(self.columns[some], self.rows[some], self.corner[np.ix_(some, some)])


def solve_bordered(
    solve: Callable[[Array], Array], border: Border, x: Array, c: Array, comm: MPI.Comm
) -> tuple[Array, Array]:
    """Solve a bordered system (collective).

    Args:
        solve: Solves A x = b for the part of this rank (collective).
        border: C, G and E.
        x: Solution of A x = b without the border, the part of this rank, shape (n,).
        c: Right-hand side of the m further equations, shape (m,), equal on all ranks.
        comm: Communicator.

    Returns:
        x, shape (n,), and q, shape (m,), equal on all ranks.

    Raises:
        MortarError: On all ranks, if A or the small dense system is singular.
    """
    if not c.size:
        return x, np.zeros(0)
    answers = np.array([solve(column) for column in border.columns])
    products = comm.allreduce(border.rows @ np.vstack([x, answers]).T)
    q, error = np.empty_like(c), None
    try:
        q = np.linalg.solve(border.corner - products[:, 1:], c - products[:, 0])
    except np.linalg.LinAlgError as singular:
        error = MortarError(f"the balance of the obstacles is singular: {singular}")
    raise_together(comm, error)
    comm.Bcast(q)
    return x - q @ answers, q
