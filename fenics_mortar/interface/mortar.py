# SPDX-License-Identifier: MIT
"""Mortar operators of one slave and one master surface, in the plane and in space.

==========  ==========================================================================
symbol      meaning
==========  ==========================================================================
D[j, k]     int Phi_j N_k over the current slave surface; j, k slave nodes
M[j, l]     int Phi_j (N_l o chi); l master nodes, chi the projection to the master
g[j]        weighted gap int Psi_j g, g = n^ . (x_master - x_slave) >= 0 when open
n           averaged unit normal of a slave node
f_c         contact force: sum_j D[j, k] z_j on slave node k, -sum_j M[j, l] z_j on l
==========  ==========================================================================

With an out-of-plane thickness, as 2 pi r, all integrals are weighted by it at the current point of
the slave, and all units are multiplied by a length; see ``mesh.space``. In space integrals are
over areas: the units of D and M are those with a thickness.

Each rank has the integrals over its share of the slave facets. Nodal quantities are summed over the
ranks and equal on all of them. Derivatives are of type ``Block``, dense blocks of sparse matrices;
they are computed in ``integrals``, ``space_mortar`` and ``on_obstacle``. ``Linearization`` tells
which terms of the tangent are kept, ``MortarOptions`` the choices for a pair; ``BodiesBehind``
limits the search behind the slave, see ``outline``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from scipy.sparse import coo_array, csr_array

from fenics_mortar.kernels.blocks import add_contact_forces
from fenics_mortar.kernels.facets import BY_BASIS, BY_COVER, BY_STANDARD, DUAL, STANDARD
from fenics_mortar.utils.arrays import Array, Flags, Indices, read_only_view
from fenics_mortar.utils.ranks import from_all_ranks, sum_over_ranks

if TYPE_CHECKING:
    from fenics_mortar.interface.reference import Basis


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
    """A ``Block`` without entries, for rows (b, r) and columns (b, c) (local)."""
    return Block(rows[:0], columns[:0], np.empty((0, rows.shape[1], columns.shape[1])))


def entries_of(block: Block) -> tuple[Indices, Indices, Array]:
    """Rows, columns and values of a block's entries, shape (entries,) each [unit of the block]."""
    rows = np.broadcast_to(block.rows[:, :, None], block.values.shape)
    columns = np.broadcast_to(block.columns[:, None, :], block.values.shape)
    return rows.ravel(), columns.ravel(), block.values.ravel()


# Derivatives of numbers at nodes by entries of D or M, see ``MortarOperators.matrices_derivative``.
ByEntries = Callable[[Indices, Indices], Array]
# Numbers of the columns of a matrix, and the matrix.
NumberedColumns = tuple[Indices, csr_array]


def compressed(blocks: Iterable[Block], num_rows: int) -> NumberedColumns:
    """Sum of blocks with few columns of many, without zeros and columns of -1."""
    i, j, v = (np.concatenate(parts) for parts in zip(*map(entries_of, blocks), strict=True))
    used = (j >= 0) & (v != 0.0)
    numbers, at = np.unique(j[used], return_inverse=True)
    return numbers, coo_array((v[used], (i[used], at)), shape=(num_rows, numbers.size)).tocsr()


def as_block(matrix: csr_array, rows: Indices, columns: Indices) -> Block:
    """A sparse matrix as a block per entry, with the numbers of its rows and columns."""
    found = matrix.tocoo()
    return Block(
        rows[found.row][:, None], columns[found.col][:, None], found.data.reshape(-1, 1, 1)
    )


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


class BodiesBehind(NamedTuple):
    """Bodies behind the facets of a slave surface: arguments of the kernels.

    Attributes:
        safe: Depth behind each slave facet up to which all partners count, shape (f,) [length].
        slave_bodies: Bodies of the slave facets, shape (f,).
        master_bodies: Bodies of the master facets, shape (m,).
        outline: Present positions of the nodes (b, dim) [length], segments (p, dim) with the body
            on the left, and bodies of the segments (p,); in space also a tree and space for hits.
    """

    safe: Array
    slave_bodies: Indices
    master_bodies: Indices
    outline: tuple[Any, ...]

    def of(self, facets: Indices) -> BodiesBehind:
        """The bodies behind the slave facets with the numbers ``facets`` (k,)."""
        return self._replace(safe=self.safe[facets], slave_bodies=self.slave_bodies[facets])


Integration = Literal["segments", "elements", "nodes"]
Weighting = Literal["opposite", "unit", "own"]
GapWeights = Literal["cover", "basis", "standard"]
BASES = dict.fromkeys(("dual", "vertices"), DUAL)
BASES |= dict.fromkeys(("standard", "linear", "quadratic"), STANDARD)
GAP_WEIGHTS = {"basis": BY_BASIS, "cover": BY_COVER, "standard": BY_STANDARD}


@dataclass(frozen=True)
class MortarOptions:
    """Discretization of one pair.

    Attributes:
        basis: "dual" (D is diagonal), "standard" or, at vertices only, "vertices" and "linear";
            on triangles with six nodes "quadratic".
        weighting: Weights of the facet normals at a node: "opposite", "unit" or "own".
        gap_weights: Weights of the gap: "basis", "cover" or "standard"; see ``kernels.facets``.
        integration: "segments", "elements" or "nodes"; see ``integrals.find_segments``.
        points: Gauss points per segment, with "elements" per slave facet.
        radius: Search radius along the normal [length]; limits behind the slave: ``outline``.
        min_cosine: Smallest cosine between the slave's normal and the reversed master's [1].
        corners: Whether corners inside the slave take the normal of one facet; see ``corners``.
    """

    basis: Basis
    weighting: Weighting
    gap_weights: GapWeights
    integration: Integration
    points: int
    radius: float
    min_cosine: float
    corners: bool = False

    @cached_property
    def kinds(self) -> tuple[int, int]:
        """Basis and weights of the gap as integers, the arguments of the kernels.

        If the quadrature points are the nodes, standard and dual functions are equal for any cover.
        """
        if self.integration == "nodes":
            return STANDARD, BY_BASIS
        return BASES[self.basis], GAP_WEIGHTS[self.gap_weights]


@dataclass(frozen=True, kw_only=True)
class MortarOperators(ABC):
    """D, M, weighted gap and normals at given positions, with their derivatives.

    Attributes:
        slave, master: The two surfaces.
        x, m: Current positions of their nodes, shapes (slave nodes, dim), (master nodes, dim).
        n: Unit normals of the slave nodes, shape (slave nodes, dim).
        dn: Derivatives of n with respect to the positions of the nodes in ``Surface.stencil``,
            shape (slave nodes, dim, c) [1 / length].
        segments: Intersections of this rank's share of the slave facets with master facets, with
            the facets, and the nodes of both sides by intersection.
        D: Slave matrices of the facets of this share, shape (f, K, K) [length].
        M: Master matrices of the intersections, shape (s, K, K') [length].
        diagonal: D[j, j] of every slave node, shape (slave nodes,) [length]; in space the weight of
            multipliers at corners alone.
        gap: Weighted gap of every slave node, shape (slave nodes,) [length^2].
        cover: Integral of N_j over the covered part, shape (slave nodes,) [length].
        weight: Integral of Phi_j, the row sum of D, shape (slave nodes,) [length].
        num_segments: Number of intersections on all ranks.
        linearization: Derivatives that are included; the others are zero.
        is_linearized_late: Whether derivatives are computed when asked for, not with the integrals.
    """

    slave: Any
    master: Any
    x: Array
    m: Array
    n: Array
    dn: Array
    segments: Any
    D: Array
    M: Array
    diagonal: Array
    gap: Array
    cover: Array
    weight: Array
    num_segments: int
    linearization: Linearization
    is_linearized_late: ClassVar[bool] = False

    @cached_property
    def tau(self) -> Array:
        """Tangents (-n_y, n_x) of the slave nodes in the plane, shape (slave nodes, 2) [1]."""
        return np.stack([-self.n[:, 1], self.n[:, 0]], axis=1)

    @cached_property
    def facet_nodes(self) -> Indices:
        """Slave nodes of the facets of this share, shape (f, K)."""
        return self.slave.facets[self.segments.facets]

    def force(self, z: Array) -> tuple[Array, Array]:
        """Contact forces D^T z on slave and -M^T z on master nodes (collective).

        They add to the internal forces: the forces that act on the bodies have the opposite sign.

        Args:
            z: Multipliers of c components, shape (slave nodes, c) [stress]: those of contact, one
                for the flux of a scalar field.

        Returns:
            Arrays (slave nodes, c) and (master nodes, c) [stress length].
        """
        count, s = len(self.x), self.segments
        forces = np.zeros((count + len(self.m), z.shape[1]))
        z = read_only_view(z) if z.flags.writeable else z
        add_contact_forces(self.D, z, self.facet_nodes, self.facet_nodes, 1.0, forces[:count])
        add_contact_forces(self.M, z, s.slave, s.master, -1.0, forces[count:])
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
        """Sum of the blocks (b, K, K') of all ranks without zeros (collective)."""
        used = values != 0.0
        i, j = np.broadcast_arrays(rows[:, :, None], columns[:, None, :])
        i, j, v = from_all_ranks(self.slave.comm, (i[used], j[used], values[used]))
        return coo_array((v, (i, j)), shape=shape).tocsr()

    def reaction(self, z: Array) -> tuple[Array, Array]:
        """Points of the master and forces there, each (master nodes, dim) (collective).

        Units [length] and [stress length]; signs as in ``force``.
        """
        return self.m, self.force(z)[1]

    @abstractmethod
    def freeze(self) -> Self:
        """Copy with constant D, M and n, for small motions; see ``after_small_motion``."""

    @abstractmethod
    def minus_offset(self, offset: Array) -> Self:
        """Operators for the gap minus an offset, interpolated between nodes (collective).

        The weighted gap becomes g_j - sum_k D[j, k] offset_k.

        Args:
            offset: Shape (slave nodes,) [length].
        """

    def near(self, nodes: Flags) -> Self:
        """Operators with the derivatives of the facets that have some of these nodes (local).

        In the plane they have those of all facets, which are found with the integrals.

        Args:
            nodes: Shape (slave nodes,), bool.
        """
        return self

    def force_derivative(self, z: Array) -> list[Block]:
        """Blocks of d(D^T z)/dd and -d(M^T z)/dd [stress] at fixed ``z`` (slave nodes, dim)."""
        return [self.slave_force_derivative(z), self.master_force_derivative(z)]

    @abstractmethod
    def slave_force_derivative(self, z: Array, dofs: Indices | None = None) -> Block:
        """Block of d(D^T z)/dd [stress] at fixed ``z`` of c components (local).

        Columns are displacement dofs.

        Args:
            z: Shape (slave nodes, c) [stress].
            dofs: Rows of each slave node, shape (slave nodes, c); displacement dofs by default.
        """

    @abstractmethod
    def master_force_derivative(self, z: Array, dofs: Indices | None = None) -> Block:
        """Block of -d(M^T z)/dd [stress] at fixed ``z`` of c components (local).

        Columns are displacement dofs.

        Args:
            z: Shape (slave nodes, c) [stress].
            dofs: Rows of each master node, shape (master nodes, c); displacement dofs by default.
        """

    def rounding_of_vectors(self) -> Array:
        """Rounding of D x - M m over that of a position, (slave nodes,) [area] (collective).

        In the plane and on obstacles zero: it is negligible.
        """
        return np.zeros(len(self.x))

    @abstractmethod
    def weight_derivative(self) -> list[Block]:
        """Blocks of dw/dd [1], w = row sums of D; rows: slave nodes, columns: displacement dofs."""

    @abstractmethod
    def gap_derivative(self) -> list[Block]:
        """Blocks of dg/dd [length]; rows: slave nodes, columns: displacement dofs."""

    @abstractmethod
    def vector_derivative(self, along: Array) -> list[Block]:
        """Blocks of along_j . d(D x - M m)_j/dd [length] for directions ``along`` (nodes, dim).

        For normal components use ``gap_derivative``. Frozen operators neglect this derivative,
        which is small in contact.
        """

    @abstractmethod
    def matrix_derivative(self, on_slave: Array, on_master: Array) -> list[Block]:
        """Blocks of d(D v - M w)/dd at constant nodal values of a scalar field (local).

        Rows are slave nodes, columns displacement dofs [unit of the field]; frozen operators have
        none.

        Args:
            on_slave: v, shape (slave nodes,) [any unit].
            on_master: w, shape (master nodes,) [that of v].
        """

    @abstractmethod
    def matrices_derivative(self, by_D: ByEntries, by_M: ByEntries) -> list[Block]:
        """Blocks of r numbers at each slave node that are linear in its row of D and M (local).

        In the plane r = 1. Rows are numbers, those of node j from r j on, columns displacement
        dofs; frozen operators have none.

        Args:
            by_D: Function of slave nodes j and k, arrays that broadcast, whose values are the
                derivatives of the numbers of j by D[j, k], shape (..., r).
            by_M: Likewise by M[j, l], of slave nodes j and master nodes l.
        """

    def after_small_motion(self, x: Array, m: Array) -> Self:
        """Frozen operators after small motions of the nodes to ``x`` and ``m`` (collective).

        D, M and n are constant; g_j changes by -n_j . (D[j, k] dx_k - M[j, l] dm_l).

        Args:
            x: New positions of the slave nodes, shape (slave nodes, dim) [length].
            m: New positions of the master nodes, shape (master nodes, dim) [length].
        """
        jump = self.jump(x - self.x, m - self.m)
        return replace(self, x=x, m=m, gap=self.gap - np.einsum("jc,jc->j", self.n, jump))

    @cached_property
    def vectors(self) -> Array:
        """Weighted gap vectors D x - M m, shape (slave nodes, dim) [length^2].

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

    def jump_derivative(self, along: Array) -> list[Block]:
        """Blocks of along_j . (D_jk dx_k - M_jl dm_l) [length] for constant D and M (local)."""
        s, nodes = self.segments, self.facet_nodes
        on_slave = np.einsum("ejk,ejc->ejkc", self.D, along[nodes])
        on_master = -np.einsum("sjl,sjc->sjlc", self.M, along[s.slave])
        sides = (
            (nodes, self.slave.dofs_of(nodes), on_slave),
            (s.slave, self.master.dofs_of(s.master), on_master),
        )
        return [
            Block(rows, columns, values.reshape(*rows.shape, columns.shape[1]))
            for rows, columns, values in sides
        ]

    def normal_columns(self) -> Indices:
        """Displacement dofs of the columns of ``dn``, shape (slave nodes, c)."""
        return np.asarray(self.slave.stencil_dofs)

    def normal_derivative(self, z: Array) -> Array:
        """dn_j/dd . z_j at fixed ``z`` (slave nodes, dim), (slave nodes, c) [z / length].

        Columns as in ``dn``.
        """
        return np.einsum("jc,jcq->jq", z, self.dn)
