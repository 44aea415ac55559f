# SPDX-License-Identifier: MIT
"""The matrix R of the condensed system, by its entries; see ``condensed``.

R has a row for every contact dof and a column for every multiplier. Each rank keeps the columns of
its own multipliers, since it owns the corresponding slave rows of K; rows are those of all ranks.
R has few entries, and their pattern changes in half of the iterations: PETSc would spend more time
on patterns than on values.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from fenics_mortar.la.sparse import Entries, SomeRows
from fenics_mortar.utils.arrays import Array, Flags, Indices, summed
from fenics_mortar.utils.ranks import sum_over_ranks


class Elimination:
    """The matrix R.

    Args:
        comm: Communicator.
        rows: The contact dofs.
        first: Number of the first component of this rank's multipliers.
        size: Number of these components.

    Attributes:
        entries: Rows, columns and values of the entries [1] in the columns of this rank.
    """

    def __init__(self, comm: MPI.Comm, rows: SomeRows, first: int, size: int) -> None:
        self._comm, self._rows, self._first, self._size = comm, rows, first, size
        self.entries: Entries

    def set_entries(self, i: Indices, j: Indices, v: Array) -> None:
        """Set the entries to the sum of those of all ranks (collective).

        Args:
            i: Numbers of contact dofs, shape (entries,).
            j: Numbers of multiplier components of any rank, of that shape.
            v: Values [1], of that shape.
        """
        j = j - self._first
        if self._comm.size > 1:
            is_mine = self._has(j)
            others = i[~is_mine], j[~is_mine] + self._first, v[~is_mine]
            parts = [(i[is_mine], j[is_mine], v[is_mine])]
            for rows, columns, values in self._comm.allgather(others):
                here = self._has(columns - self._first)
                parts.append((rows[here], columns[here] - self._first, values[here]))
            i, j, v = (np.concatenate(part) for part in zip(*parts, strict=True))
        self.entries = i, j, v

    def _has(self, j: Indices) -> Flags:
        """Whether multipliers are those of this rank, shape of ``j``, bool (local)."""
        return (j >= 0) & (j < self._size)

    def times(self, values: Array) -> Array:
        """R x [unit of x] in the owned contact dofs, for ``values`` x of this rank (collective)."""
        i, j, v = self.entries
        product = summed(v * values[j], i, self._rows.rows.size)
        if self._comm.size > 1:
            product = sum_over_ranks(self._comm, product)
        return product[self._rows.numbers]

    def transposed_times(self, values: Array) -> Array:
        """R^T w [unit of w], for ``values`` w of the owned contact dofs (collective)."""
        everywhere = np.zeros(self._rows.rows.size)
        everywhere[self._rows.numbers] = values
        everywhere = sum_over_ranks(self._comm, everywhere)
        i, j, v = self.entries
        return summed(v * everywhere[i], j, self._size)
