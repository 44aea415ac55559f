# SPDX-License-Identifier: MIT
"""Mortar operators of curves in the plane, with their derivatives; see ``mortar``.

Formulas: Popp, Gee & Wall (2009); consistent treatment of partly covered facets: Popp, Seitz, Gee
& Wall (2013).

Derivatives are stored as dense blocks. With K nodes per facet, 2 or 3, a segment has C = 8 K - 4
columns: the components of the slave nodes of the previous facet, of its own and of the next one,
and of its master nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from fenics_mortar.interface.mortar import LINEARIZATIONS, Block, MortarOperators
from fenics_mortar.interface.segments import Segments
from fenics_mortar.kernels import projection
from fenics_mortar.kernels.blocks import weigh_derivatives
from fenics_mortar.utils.arrays import Array, Indices, read_only_view, summed
from fenics_mortar.utils.ranks import sum_over_ranks


@dataclass(frozen=True, kw_only=True)
class PlaneOperators(MortarOperators):
    """D, M, weighted gap and normals of two curves; tau = (-n_y, n_x).

    Attributes:
        dD: Derivative of D with respect to the nodes of each segment, shape (n, K, K, C) [1].
        dM: Derivative of M for each pair of segments, shape (p, K, K, C) [1].
        dgap: Derivative of the weighted gap with respect to the nodes of each segment, shape
            (n, K, C) [length].
    """

    dD: Array
    dM: Array
    dgap: Array

    @cached_property
    def columns(self) -> Indices:
        """Displacement dofs of the columns of each segment, shape (n, C); -1 where none."""
        on_slave = self.slave.near_dofs[self.segments.slave[:, 0]]
        return np.concatenate([on_slave, self.master_dofs], axis=1)

    @cached_property
    def master_dofs(self) -> Indices:
        """Displacement dofs of the master nodes of each segment, shape (n, 2 K)."""
        masters = self.segments.master
        return self.master.dofs[masters].reshape(len(masters), 2 * masters.shape[1])

    def sample_gaps(self, x: Array, s: Segments, points: Array) -> Array:
        """Gaps at points of segments, along the normals of this state (local).

        Args:
            x: Positions of the slave nodes, shape (slave nodes, 2) [length].
            s: Segments.
            points: Coordinates in each segment, -1 ... 1, shape (q,).

        Returns:
            Gaps, shape (n, q) [length].
        """
        gaps = np.zeros((s.num_segments, points.size))
        projection.sample_gaps((x, self.n, self.m), (s.slave, s.master), s.ends, points, gaps)
        return gaps

    def slave_force_derivative(self, z: Array, dofs: Indices | None = None) -> Block:
        """See ``MortarOperators``."""
        s = self.segments
        rows = self.slave.dofs if dofs is None else dofs
        rows = rows[s.slave].reshape(len(s.slave), s.slave.shape[1] * z.shape[1])
        values = np.empty((*rows.shape, self.dD.shape[3]))
        z = read_only_view(z) if z.flags.writeable else z
        weigh_derivatives(self.dD, np.arange(len(rows)), s.slave, z, 1.0, values)
        return Block(rows, self.columns, values)

    def master_force_derivative(self, z: Array, dofs: Indices | None = None) -> Block:
        """See ``MortarOperators``."""
        i, k = np.ascontiguousarray(self.segments.pairs.T)
        rows = self.master.dofs if dofs is None else dofs
        nodes = self.segments.master[i]
        rows = rows[nodes].reshape(len(i), nodes.shape[1] * z.shape[1])
        values = np.empty((*rows.shape, self.dM.shape[3]))
        z = read_only_view(z) if z.flags.writeable else z
        weigh_derivatives(self.dM, i, self.segments.slave, z, -1.0, values)
        return Block(rows, self.columns[k], values)

    def weight_derivative(self) -> list[Block]:
        """Blocks of dw/dd [1], w = row sums of D; rows: slave nodes, columns: displacement dofs."""
        if self.linearization.frozen:
            return []
        return [Block(self.segments.slave, self.columns, self.dD.sum(axis=2))]

    def gap_derivative(self) -> list[Block]:
        """Blocks of dg/dd [length]; rows: slave nodes, columns: displacement dofs."""
        if self.linearization.frozen:
            return self.jump_derivative(-self.n)
        return [Block(self.segments.slave, self.columns, self.dgap)]

    def vector_derivative(self, along: Array) -> list[Block]:
        """Blocks of along_j . d(D x - M m)_j/dd [length] for directions ``along`` (slave nodes, 2).

        For normal components use ``gap_derivative``. Frozen operators neglect this derivative,
        which is small in contact.
        """
        if self.linearization.frozen:
            return []
        s = self.segments
        i, k = s.pairs[:, 0], s.pairs[:, 1]
        by_D = np.einsum("sjkq,skc,sjc->sjq", self.dD, self.x[s.slave], along[s.slave])
        by_M = np.einsum("pjlq,plc,pjc->pjq", self.dM, self.m[s.master[i]], along[s.slave[i]])
        return [
            *self.jump_derivative(along),
            Block(s.slave, self.columns, by_D),
            Block(s.slave[i], self.columns[k], -by_M),
        ]

    def matrix_derivative(self, on_slave: Array, on_master: Array) -> list[Block]:
        """See ``MortarOperators``."""
        s = self.segments
        if self.linearization.frozen:
            return []
        by_D = np.einsum("sjkq,sk->sjq", self.dD, on_slave[s.slave])
        blocks = [Block(s.slave, self.columns, by_D)]
        if len(self.m):
            i, k = s.pairs[:, 0], s.pairs[:, 1]
            by_M = np.einsum("pjlq,pl->pjq", self.dM, on_master[s.master[i]])
            blocks.append(Block(s.slave[i], self.columns[k], -by_M))
        return blocks

    def freeze(self) -> Self:
        """Copy with constant D, M and n, for small motions; see ``after_small_motion``."""
        at_rest = {name: np.zeros_like(getattr(self, name)) for name in ("dn", "dD", "dM", "dgap")}
        return replace(self, linearization=LINEARIZATIONS["frozen"], **at_rest)

    def minus_offset(self, offset: Array) -> Self:
        """See ``MortarOperators``."""
        s, nodes = self.segments, self.facet_nodes
        change = np.einsum("ejk,ek->ej", self.D, offset[nodes])
        nodal = summed(change.ravel(), nodes.ravel(), self.slave.num_nodes)
        nodal = sum_over_ranks(self.slave.comm, nodal)
        derivative = np.einsum("sjkq,sk->sjq", self.dD, offset[s.slave])
        return replace(self, gap=self.gap - nodal, dgap=self.dgap - derivative)
