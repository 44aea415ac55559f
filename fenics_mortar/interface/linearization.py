# SPDX-License-Identifier: MIT
"""Blocks of sparse matrices, and the terms of the tangent that are kept."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fenics_mortar.utils.arrays import Array, Indices


class Block(NamedTuple):
    """Dense blocks of a sparse matrix: values (b, r, c) at rows (b, r) and columns (b, c).

    Values are added; entries with a row or column of -1 are ignored.
    """

    rows: Indices
    columns: Indices
    values: Array


def scaled(block: Block, factors: Array) -> Block:
    """A block with the rows of nodes, times ``factors`` (nodes,) of the nodes (local)."""
    return block._replace(values=block.values * factors[block.rows][:, :, None])


def without_values(rows: Indices, columns: Indices) -> Block:
    """No blocks, where there would be some with rows (b, r) and columns (b, c) (local)."""
    return Block(rows[:0], columns[:0], np.empty((0, rows.shape[1], columns.shape[1])))


@dataclass(frozen=True)
class Linearization:
    """Terms of the consistent tangent that are kept; the residual is always exact.

    Attributes:
        normals: Whether to include derivatives of the nodal normals.
        segments: Whether to include the motion of the segment ends on the slave facets.
        frozen: Whether D, M and n are constant in the tangent: a fixed-point iteration for these
            (Popp, Gee & Wall 2009).
        exact: Whether to include also the derivatives of rapidly decreasing adhesion, which
            Newton's method converges better without; see ``ContactFields.law_rows``. For
            derivatives of a solution.
    """

    normals: bool = True
    segments: bool = True
    frozen: bool = False
    exact: bool = False


LINEARIZATIONS = {
    "full": Linearization(),
    "no_normals": Linearization(normals=False),
    "no_segments": Linearization(segments=False),
    "frozen": Linearization(normals=False, segments=False, frozen=True),
}
# For derivatives of a solution.
EXACT = Linearization(exact=True)
