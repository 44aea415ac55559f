# SPDX-License-Identifier: MIT
"""Derivatives of nodal values of a pair as linear maps, with products and transposed products.

Used for sensitivities only. All vectors are replicated; all products are collective.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from fenics_mortar.interface.mortar import Block
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.ranks import sum_over_ranks


class PairVector(NamedTuple):
    """Values on which the equations of a pair depend, or forces on them; equal on all ranks.

    Attributes:
        on_slave: Displacements of the slave nodes, shape (slave nodes, 2) [length].
        on_master: Displacements of the master nodes, shape (master nodes, 2) [length].
        z: Multipliers, shape (slave nodes, 2) [stress].
        motion: Motions of the obstacle, shape (3,) [length].
    """

    on_slave: Array
    on_master: Array
    z: Array
    motion: Array

    def plus(self, other: PairVector) -> PairVector:
        """Sum of two vectors (local)."""
        return PairVector(*(a + b for a, b in zip(self, other, strict=True)))


@dataclass(frozen=True)
class Dofs:
    """Dofs of both surfaces of a pair, numbered 0, 1, ...: slave nodes first.

    Args:
        sides: Slave and master.
    """

    sides: tuple[Surface, Surface]
    order: Indices = field(init=False)
    sorted_dofs: Indices = field(init=False)

    def __post_init__(self) -> None:
        """Sort the dofs."""
        dofs = np.concatenate([side.dofs.ravel() for side in self.sides])
        order = np.argsort(dofs, kind="stable")
        object.__setattr__(self, "order", order)
        object.__setattr__(self, "sorted_dofs", dofs[order])

    @property
    def size(self) -> int:
        """Number of dofs of both surfaces."""
        return self.order.size

    def indices(self, dofs: Indices) -> Indices:
        """Numbers of global ``dofs`` of the surfaces, any shape; ``size`` for -1 (local)."""
        at = np.searchsorted(self.sorted_dofs, np.maximum(dofs, self.sorted_dofs[0]))
        return np.where(dofs >= 0, self.order[at], self.size)

    def flat(self, on_slave: Array, on_master: Array) -> Array:
        """Values at the dofs, and a zero for -1, shape (size + 1,) [their unit] (local)."""
        return np.concatenate([on_slave.ravel(), on_master.ravel(), [0.0]])

    def split(self, values: Array) -> tuple[Array, Array]:
        """Inverse of ``flat``: (slave nodes, 2) and (master nodes, 2) [their unit] (local)."""
        end = 2 * self.sides[0].num_nodes
        return values[:end].reshape(-1, 2), values[end : self.size].reshape(-1, 2)

    def along(self, blocks: Sequence[Block], values: Array, count: int) -> Array:
        """Product of blocks with dofs as columns, summed over the ranks (collective).

        Args:
            blocks: Blocks of this rank; rows are numbers from 0 to ``count`` - 1.
            values: Result of ``flat``.
            count: Number of rows.

        Returns:
            The product, shape (count,) [unit of the blocks times that of the values].
        """
        product = np.zeros(count)
        for block in blocks:
            part = np.einsum("brc,bc->br", block.values, values[self.indices(block.columns)])
            np.add.at(product, block.rows, part)
        return sum_over_ranks(self.sides[0].comm, product)

    def back(self, blocks: Sequence[Block], values: Array) -> Array:
        """Product of the transposed blocks, summed over the ranks: as ``flat`` (collective).

        Args:
            blocks: Blocks of this rank, with dofs as columns.
            values: Values of the rows, shape (rows,) [any unit].
        """
        product = np.zeros(self.size + 1)
        for block in blocks:
            part = np.einsum("brc,br->bc", block.values, values[block.rows])
            np.add.at(product, self.indices(block.columns), part)
        product = sum_over_ranks(self.sides[0].comm, product)
        product[-1] = 0.0
        return product


@dataclass(frozen=True)
class NodalDerivative:
    """Derivative of nodal values with respect to displacements, multipliers and motions.

    Attributes:
        dofs: Dofs of the pair.
        blocks: Derivative with respect to displacements: rows are slave nodes, columns global dofs;
            each rank has a part.
        by_z: Derivative with respect to the multiplier of the node, shape (slave nodes, 2).
        by_motion: Derivative with respect to the motions of the obstacle, shape (slave nodes, 3).
    """

    dofs: Dofs
    blocks: Sequence[Block]
    by_z: Array
    by_motion: Array

    def along(self, direction: PairVector) -> Array:
        """Change of the values along a direction, (slave nodes,) [their unit] (collective)."""
        values = self.dofs.flat(direction.on_slave, direction.on_master)
        change = self.dofs.along(self.blocks, values, len(self.by_z))
        by_z = np.einsum("jc,jc->j", self.by_z, direction.z)
        return change + by_z + self.by_motion @ direction.motion

    def back(self, weights: Array) -> PairVector:
        """Gradient of the sum of the values times ``weights`` (slave nodes,) (collective)."""
        product = self.dofs.back(self.blocks, weights)
        on_slave, on_master = self.dofs.split(product)
        z, motion = weights[:, None] * self.by_z, weights @ self.by_motion
        return PairVector(on_slave, on_master, z, motion)


def rows_at_nodes(slave: Surface, columns: Indices, values: Array) -> Block:
    """Block with one row per slave node, of the nodes owned by this rank (local).

    Args:
        slave: The slave surface.
        columns: Global dofs, shape (slave nodes, c).
        values: Shape (slave nodes, c).
    """
    j = slave.owned
    return Block(j[:, None], columns[j], values[j][:, None, :])
