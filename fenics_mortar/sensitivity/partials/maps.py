# SPDX-License-Identifier: MIT
"""Partial derivatives of a pair as sparse matrices, equal on all ranks, and its vectors.

The vector of a pair has all values on which its equations depend: displacements of the slave and
master nodes [length], multipliers [stress], and motions of the obstacle [length]. Residuals have
the forces on these in the same places, and the rows of the multipliers in place of the multipliers.
Values of the nodes are stored node by node: the entry (j, c) of an array (nodes, n) is at n j + c.
Vectors have d components, and obstacles m motions: 2 and 3 in the plane, 3 and 6 in space.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.interface import Interface
from fenics_mortar.interface.curve_surface import Curve
from fenics_mortar.interface.mortar import Block
from fenics_mortar.utils.arrays import Array, Indices

NO_BLOCK = Block(np.empty((0, 1), np.int64), np.empty((0, 1), np.int64), np.empty((0, 1, 1)))


@dataclass(frozen=True)
class Matrix:
    """Sparse matrix by its entries; entries at the same place are added; all methods are local.

    Most of these matrices are used once. To make or transpose one of scipy takes ten times as long
    as a product, for pairs of some hundred nodes longer than the derivatives themselves.

    Attributes:
        rows, columns: Places of the entries, shape (entries,) each.
        values: The entries, shape (entries,).
        shape: Numbers of rows and columns.
    """

    rows: Indices
    columns: Indices
    values: Array
    shape: tuple[int, int]

    @classmethod
    def dense(cls, values: Array) -> Matrix:
        """Matrix with all entries of an array (rows, columns)."""
        rows, columns = np.indices(values.shape).reshape(2, -1)
        return cls(rows, columns, values.ravel(), (len(values), values.shape[1]))

    @property
    def T(self) -> Matrix:
        """The transpose."""
        return Matrix(self.columns, self.rows, self.values, self.shape[::-1])

    def __matmul__(self, x: Array) -> Array:
        """Product with a vector (columns,)."""
        total = np.bincount(self.rows, self.values * x[self.columns], self.shape[0])
        return np.asarray(total, float)  # integers without entries


# Derivatives of nodal fields by their names, shape (slave nodes, m) each; those of fields with c
# components (slave nodes c, m).
Changes = dict[str, Matrix]


class Layout:
    """Places of the values of a pair in its vector; see ``maps``.

    Args:
        contact: The pair.

    Attributes:
        dim: Number of coordinates d.
        num_motions: Number of motions m.
        on_slave, on_master: Displacements of both surfaces.
        z: Multipliers.
        motion: Motions of the obstacle.
        size: Length of the vector.
    """

    def __init__(self, contact: Interface) -> None:
        self._sides = contact.slave, contact.master
        self.dim: int = contact.slave.dim
        self.num_motions: int = self.dim * (self.dim + 1) // 2
        sizes = [side.dofs.size for side in self._sides] + [contact.z.size, self.num_motions]
        ends = np.cumsum([0, *sizes]).tolist()
        self.on_slave, self.on_master, self.z, self.motion = map(slice, ends[:-1], ends[1:])
        self.size: int = ends[-1]

    @cached_property
    def _sorted(self) -> tuple[Indices, Indices]:
        """Places of all displacement dofs in the order of the dofs, and the dofs in this order."""
        dofs = np.concatenate([side.dofs.ravel() for side in self._sides])
        order = np.argsort(dofs, kind="stable")
        return order, dofs[order]

    def places(self, dofs: Indices) -> Indices:
        """Places of displacement dofs, any shape; -1 for -1 (local)."""
        order, in_order = self._sorted
        at = np.searchsorted(in_order, np.maximum(dofs, in_order[0]))
        return np.where(dofs >= 0, order[at], -1)

    def matrix(self, blocks: Iterable[Block], count: int) -> Matrix:
        """Sum over ranks of blocks with dofs as columns, (count, size) (collective)."""
        placed = (Block(rows, self.places(columns), values) for rows, columns, values in blocks)
        return assembled(placed, (count, self.size), self._sides[0].comm)

    def nodal(
        self, blocks: Iterable[Block], by_z: Array | None = None, by_motion: Array | None = None
    ) -> Matrix:
        """Derivative of values of the slave nodes, shape (slave nodes, size) (collective).

        Args:
            blocks: Derivative with respect to displacements: rows are slave nodes, columns global
                dofs; each rank has a part.
            by_z: That with respect to the multiplier of the node, shape (slave nodes, d).
            by_motion: That with respect to the motions of the obstacle, shape (slave nodes, m).
        """
        slave = self._sides[0]
        j = np.arange(slave.num_nodes)[:, None]
        placed = [Block(rows, self.places(columns), values) for rows, columns, values in blocks]
        if by_z is not None:
            places = self.z.start + self.dim * j + np.arange(self.dim)
            placed.append(rows_at_nodes(slave, places, by_z))
        if by_motion is not None:
            places = self.motion.start + 0 * j + np.arange(self.num_motions)
            placed.append(rows_at_nodes(slave, places, by_motion))
        return assembled(placed, (slave.num_nodes, self.size), slave.comm)


def assembled(
    blocks: Iterable[Block], shape: tuple[int, int], comm: MPI.Comm | None = None
) -> Matrix:
    """Matrix of blocks; rows and columns of -1 are ignored.

    With a communicator the blocks of all ranks (collective), else those given (local).
    """
    parts = [
        (
            np.repeat(rows, columns.shape[1]),
            np.repeat(columns[:, None], rows.shape[1], axis=1).ravel(),
            values.ravel(),
        )
        for rows, columns, values in [NO_BLOCK, *blocks]
    ]
    entries = [np.concatenate(several) for several in zip(*parts, strict=True)]
    if comm is not None and comm.size > 1:
        entries = [np.concatenate(several) for several in zip(*comm.allgather(entries))]
    on = (entries[0] >= 0) & (entries[1] >= 0)
    rows, columns, values = (several[on] for several in entries)
    return Matrix(rows, columns, values, shape)


def by_node(values: Array) -> Matrix:
    """Matrix of r values of each node that depend on c values of the same node (local).

    Args:
        values: The blocks, shape (nodes, r, c).

    Returns:
        Shape (nodes r, nodes c).
    """
    count, r, c = values.shape
    j = np.arange(count)[:, None]
    return assembled(
        [Block(r * j + np.arange(r), c * j + np.arange(c), values)], (count * r, count * c)
    )


def through_fields(by: Mapping[str, Array], changes: Changes) -> Matrix:
    """Chain rule: derivative of values of the nodes that depend on nodal fields (local).

    Args:
        by: Derivatives of n values of a node with respect to its fields, (slave nodes, n) each;
            with respect to fields with c components (slave nodes, n, c).
        changes: Derivatives of fields, at least of one, shape (slave nodes, m) each; those on which
            the values do not depend are ignored.

    Returns:
        Shape (slave nodes n, m).
    """
    blocks = []
    count, n = next(iter(by.values())).shape[:2]
    for name, change in changes.items():
        if name not in by:
            continue
        factors = by[name].reshape(count, n, -1)
        j, component = np.divmod(change.rows, factors.shape[2])
        values = change.values[:, None, None] * factors[j, :, component][:, :, None]
        blocks.append(Block(n * j[:, None] + np.arange(n), change.columns[:, None], values))
    return assembled(blocks, (count * n, change.shape[1]))


def interleaved(parts: Sequence[Matrix], count: int) -> Matrix:
    """Matrix of vectors of the nodes from those of their c components, (count, m) each (local).

    Shape (count c, m).
    """
    c = len(parts)
    rows = np.concatenate([c * part.rows + a for a, part in enumerate(parts)])
    columns = np.concatenate([part.columns for part in parts])
    values = np.concatenate([part.values for part in parts])
    return Matrix(rows, columns, values, (count * c, parts[0].shape[1]))


def rows_at_nodes(slave: Curve, columns: Indices, values: Array) -> Block:
    """Block with one row per slave node, of the nodes owned by this rank (local).

    Args:
        slave: The slave surface.
        columns: Global dofs, shape (slave nodes, c).
        values: Shape (slave nodes, c).
    """
    j = slave.owned
    return Block(j[:, None], columns[j], values[j][:, None, :])
