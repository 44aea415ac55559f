# SPDX-License-Identifier: MIT
"""Mortar operators of one slave and one master surface, with their derivatives.

==========  ==========================================================================
symbol      meaning
==========  ==========================================================================
D[j, k]     int Phi_j N_k over the current slave surface; j, k slave nodes
M[j, l]     int Phi_j (N_l o chi); l master nodes, chi the projection to the master
g[j]        weighted gap int Psi_j g, g = n^ . (x_master - x_slave) >= 0 when open
n, tau      averaged unit normal of a slave node, tau = (-n_y, n_x)
f_c         contact force: sum_j D[j, k] z_j on slave node k, -sum_j M[j, l] z_j on l
==========  ==========================================================================

With an out-of-plane thickness, as 2 pi r, all integrals are weighted by it at the current point of
the slave, and all units below are multiplied by a length; see ``mesh.thickness``.

Formulas: Popp, Gee & Wall (2009); consistent treatment of partly covered facets: Popp, Seitz, Gee
& Wall (2013). Each rank has the integrals over its share of the slave facets. Nodal quantities
are summed over the ranks and equal on all of them.

Derivatives are stored as dense blocks. With K nodes per facet, 2 or 3, a segment has C = 8 K - 4
columns: the components of the slave nodes of the previous facet, of its own and of the next one,
and of its master nodes. A `Block` contains a stack of such blocks with their rows and columns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from scipy.sparse import coo_array, csr_array

from fenics_mortar.interface.segments import Segments
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.kernels import projection
from fenics_mortar.kernels.blocks import weigh_derivatives
from fenics_mortar.kernels.forces import add_contact_forces
from fenics_mortar.utils.arrays import Array, Indices, read_only_view, summed
from fenics_mortar.utils.ranks import sum_over_ranks


class Block(NamedTuple):
    """Dense blocks of a sparse matrix: values (b, r, c) at rows (b, r) and columns (b, c).

    Values are added; entries with a row or column of -1 are ignored.
    """

    rows: Indices
    columns: Indices
    values: Array


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


@dataclass(frozen=True)
class MortarOperators:
    """D, M, weighted gap and normals at given positions, with their derivatives.

    Attributes:
        slave, master: The two surfaces.
        x, m: Current positions of their nodes, shapes (slave nodes, 2), (master nodes, 2).
        n: Unit normals of the slave nodes, shape (slave nodes, 2).
        dn: Derivatives of n with respect to positions of the K - 1 nodes before, the node itself
            and the K - 1 nodes after, shape (slave nodes, 2, 4 K - 2) [1 / length].
        segments: Segments of this rank's share of the slave facets.
        D: Slave matrices of the facets of this share, shape (f, K, K) [length].
        M: Master matrices of its segments, shape (n, K, K) [length].
        dD: Derivative of D with respect to the nodes of each segment, shape (n, K, K, C) [1].
        dM: Derivative of M for each pair of segments, shape (p, K, K, C) [1].
        dgap: Derivative of the weighted gap with respect to the nodes of each segment, shape
            (n, K, C) [length].
        diagonal: D[j, j] of every slave node, shape (slave nodes,) [length].
        gap: Weighted gap of every slave node, shape (slave nodes,) [length^2].
        cover: Integral of N_j over the covered part, shape (slave nodes,) [length].
        weight: Integral of Phi_j, the row sum of D, shape (slave nodes,) [length].
        num_segments: Number of segments on all ranks.
        linearization: Derivatives that are included; the others are zero.
    """

    slave: Surface
    master: Surface
    x: Array
    m: Array
    n: Array
    dn: Array
    segments: Segments
    D: Array
    M: Array
    dD: Array
    dM: Array
    dgap: Array
    diagonal: Array
    gap: Array
    cover: Array
    weight: Array
    num_segments: int
    linearization: Linearization

    @cached_property
    def tau(self) -> Array:
        """Tangents (-n_y, n_x) of the slave nodes, shape (slave nodes, 2) [1]."""
        return np.stack([-self.n[:, 1], self.n[:, 0]], axis=1)

    @cached_property
    def facet_nodes(self) -> Indices:
        """Slave nodes of the facets of this share, shape (f, K)."""
        return self.slave.facets[self.segments.facets]

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

    def force(self, z: Array) -> tuple[Array, Array]:
        """Contact forces D^T z on slave and -M^T z on master nodes (collective).

        They add to the internal forces: the forces that act on the bodies have the opposite sign.

        Args:
            z: Multipliers of c components, shape (slave nodes, c) [stress]: two of contact, one
                for the flux of a scalar field.

        Returns:
            Arrays (slave nodes, c) and (master nodes, c) [stress length].
        """
        count, s = len(self.x), self.segments
        forces = np.zeros((count + len(self.m), z.shape[1]))
        on_slave, on_master = forces[:count], forces[count:]
        add_contact_forces(
            self.D,
            self.M,
            read_only_view(z) if z.flags.writeable else z,
            self.facet_nodes,
            s.slave,
            s.master,
            on_slave,
            on_master,
        )
        if self.slave.comm.size > 1:
            forces = sum_over_ranks(self.slave.comm, forces)
        return forces[:count], forces[count:]

    @cached_property
    def matrices(self) -> tuple[csr_array, csr_array]:
        """D (slave nodes, slave nodes) and M (slave nodes, master nodes), on all ranks [length].

        Collective at the first access.
        """
        s, nodes, count = self.segments, self.facet_nodes, len(self.x)
        return (
            self._replicated(nodes, nodes, self.D, (count, count)),
            self._replicated(s.slave, s.master, self.M, (count, len(self.m))),
        )

    def _replicated(
        self, rows: Indices, columns: Indices, values: Array, shape: tuple[int, int]
    ) -> csr_array:
        """Sum of the blocks (b, K, K) of all ranks without zeros (collective)."""
        used = values != 0.0
        i, j = np.broadcast_arrays(rows[:, :, None], columns[:, None, :])
        mine = i[used], j[used], values[used]
        if self.slave.comm.size > 1:
            gathered = self.slave.comm.allgather(mine)
            mine = tuple(np.concatenate(column) for column in zip(*gathered, strict=True))
        i, j, v = mine
        return coo_array((v, (i, j)), shape=shape).tocsr()

    def reaction(self, z: Array) -> tuple[Array, Array]:
        """Points of the master and forces there, each (master nodes, 2) (collective).

        Units [length] and [stress length]; signs as in ``force``.
        """
        return self.m, self.force(z)[1]

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

    def force_derivative(self, z: Array) -> list[Block]:
        """Blocks of d(D^T z)/dd and -d(M^T z)/dd [stress] at fixed ``z`` (slave nodes, 2)."""
        return [self.slave_force_derivative(z), self.master_force_derivative(z)]

    def slave_force_derivative(self, z: Array, dofs: Indices | None = None) -> Block:
        """Block of d(D^T z)/dd [stress] at fixed ``z`` of c components (local).

        Columns are displacement dofs.

        Args:
            z: Shape (slave nodes, c) [stress].
            dofs: Rows of each slave node, shape (slave nodes, c); displacement dofs by default.
        """
        s = self.segments
        rows = self.slave.dofs if dofs is None else dofs
        rows = rows[s.slave].reshape(len(s.slave), s.slave.shape[1] * z.shape[1])
        values = np.empty((*rows.shape, self.dD.shape[3]))
        z = read_only_view(z) if z.flags.writeable else z
        weigh_derivatives(self.dD, np.arange(len(rows)), s.slave, z, 1.0, values)
        return Block(rows, self.columns, values)

    def master_force_derivative(self, z: Array, dofs: Indices | None = None) -> Block:
        """Block of -d(M^T z)/dd [stress] at fixed ``z`` of c components (local).

        Columns are displacement dofs.

        Args:
            z: Shape (slave nodes, c) [stress].
            dofs: Rows of each master node, shape (master nodes, c); displacement dofs by default.
        """
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
            return _jump_derivative(self, -self.n)
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
            *_jump_derivative(self, along),
            Block(s.slave, self.columns, by_D),
            Block(s.slave[i], self.columns[k], -by_M),
        ]

    def freeze(self) -> Self:
        """Copy with constant D, M and n, for small motions; see ``after_small_motion``."""
        at_rest = {name: np.zeros_like(getattr(self, name)) for name in ("dn", "dD", "dM", "dgap")}
        return replace(self, linearization=LINEARIZATIONS["frozen"], **at_rest)

    def after_small_motion(self, x: Array, m: Array) -> Self:
        """Frozen operators after small motions of the nodes to ``x`` and ``m`` (collective).

        D, M and n are constant; g_j changes by -n_j . (D[j, k] dx_k - M[j, l] dm_l).

        Args:
            x: New positions of the slave nodes, shape (slave nodes, 2) [length].
            m: New positions of the master nodes, shape (master nodes, 2) [length].
        """
        jump = self.jump(x - self.x, m - self.m)
        return replace(self, x=x, m=m, gap=self.gap - np.einsum("jc,jc->j", self.n, jump))

    @cached_property
    def vectors(self) -> Array:
        """Weighted gap vectors D x - M m, shape (slave nodes, 2) [length^2].

        Collective at the first access.
        """
        return self.jump(self.x, self.m)

    def jump(self, on_slave: Array, on_master: Array) -> Array:
        """Weighted jump D v - M w of nodal values of c components (collective).

        Args:
            on_slave: v, shape (slave nodes, c) [unit].
            on_master: w, shape (master nodes, c) [unit].

        Returns:
            The jump, shape (slave nodes, c) [unit length].
        """
        s, nodes = self.segments, self.facet_nodes
        total = np.zeros_like(on_slave)
        np.add.at(total, nodes, np.einsum("ejk,ekc->ejc", self.D, on_slave[nodes]))
        np.add.at(total, s.slave, -np.einsum("sjl,slc->sjc", self.M, on_master[s.master]))
        return sum_over_ranks(self.slave.comm, total)

    def normal_columns(self) -> Indices:
        """Displacement dofs of the columns of ``dn``, shape (slave nodes, 4 K - 2)."""
        return self.slave.near_dofs[:, : 2 * (2 * self.slave.degree + 1)]

    def normal_derivative(self, z: Array) -> Array:
        """dn_j/dd . z_j at fixed ``z`` (slave nodes, 2): shape (slave nodes, 4 K - 2).

        Columns as in ``dn`` [unit of z / length].
        """
        return np.einsum("jc,jcq->jq", z, self.dn)

    def tangential_derivative(self, z: Array) -> Array:
        """dtau_j/dd . z_j at fixed ``z`` (slave nodes, 2): shape (slave nodes, 4 K - 2).

        Columns as in ``dn`` [unit of z / length].
        """
        return z[:, 1:] * self.dn[:, 0] - z[:, :1] * self.dn[:, 1]


def minus_offset(o: MortarOperators, offset: Array) -> MortarOperators:
    """Operators for the gap minus an offset, interpolated between nodes (collective).

    The weighted gap becomes g_j - sum_k D[j, k] offset_k.

    Args:
        o: Operators of the gap itself.
        offset: Shape (slave nodes,) [length].
    """
    s, nodes = o.segments, o.facet_nodes
    change = np.einsum("ejk,ek->ej", o.D, offset[nodes])
    nodal = summed(change.ravel(), nodes.ravel(), o.slave.num_nodes)
    nodal = sum_over_ranks(o.slave.comm, nodal)
    derivative = np.einsum("sjkq,sk->sjq", o.dD, offset[s.slave])
    return replace(o, gap=o.gap - nodal, dgap=o.dgap - derivative)


def _jump_derivative(o: MortarOperators, along: Array) -> list[Block]:
    """Blocks of along_j . (D_jk dx_k - M_jl dm_l) [length] for constant D and M."""
    s, nodes = o.segments, o.facet_nodes
    on_slave = np.einsum("ejk,ejc->ejkc", o.D, along[nodes])
    on_master = -np.einsum("sjl,sjc->sjlc", o.M, along[s.slave])
    sides = (
        (nodes, o.slave.dofs_of(nodes), on_slave),
        (s.slave, o.master.dofs_of(s.master), on_master),
    )
    return [
        Block(rows, columns, values.reshape(*rows.shape, columns.shape[1]))
        for rows, columns, values in sides
    ]
