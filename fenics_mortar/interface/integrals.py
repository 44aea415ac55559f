# SPDX-License-Identifier: MIT
"""Mortar operators of curves in the plane, with their derivatives; see ``mortar``.

An evaluation averages the nodal normals (``evaluate_normals``), finds the segments, intersections
of slave and master facets (``find_segments``), integrates over their quadrature points, and sums
over the ranks (``evaluate_mortar``). Normals, input and sums are also those of ``space_mortar`` and
``on_obstacle``.

Formulas: Popp, Gee & Wall (2009); consistent treatment of partly covered facets: Popp, Seitz, Gee
& Wall (2013).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from mpi4py import MPI

import numpy as np

from fenics_mortar.interface.mortar import LINEARIZATIONS, Block, BodiesBehind, MortarOperators
from fenics_mortar.interface.reference import Basis, facet_rule, gauss_rule, hand_over
from fenics_mortar.kernels import points as point_kernels
from fenics_mortar.kernels import projection, search
from fenics_mortar.kernels.space import normals as space_normals
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags, Indices, summed
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.ranks import sum_over_ranks

if TYPE_CHECKING:
    from fenics_mortar.interface.corners import SharpEdges
    from fenics_mortar.interface.mortar import ByEntries, Linearization, MortarOptions, Weighting
    from fenics_mortar.interface.surfaces import Surface


def nothing_behind(num_facets: int) -> BodiesBehind:
    """No bodies behind ``num_facets`` slave facets: no limits of the search."""
    none: Indices = np.empty(0, np.int64)
    outline = np.empty((0, 2)), np.empty((0, 2), np.int64), none
    return BodiesBehind(np.full(num_facets, np.inf), none, none, outline)


@dataclass(frozen=True)
class Segments:
    """Segments of some slave facets, found at given positions.

    Attributes:
        facets: Slave facets that were searched, shape (f,).
        partial: Whether the multiplier functions of a facet vary with its segments, shape (f,),
            bool: it is curved, its thickness varies with its position, or it is partly covered by
            segments with moving ends.
        offsets: Segments of facet i are offsets[i]:offsets[i + 1], shape (f + 1,).
        pair_offsets: Pairs of segments coupled by these functions: those of facet i are
            pair_offsets[i]:pair_offsets[i + 1], shape (f + 1,).
        slave: Slave nodes of each segment, shape (n, K).
        master: Master nodes, shape (n, K).
        ends: Ends on the slave facet, -1 ... 1, shape (n, 2).
        end_is_fixed: Whether an end is a fixed point of the slave facet, shape (n, 2); else the
            lower / upper end is the partner of the last / first master node.
        points: Quadrature points of all segments between their ends, -1 ... 1, shape (p,); in
            space, of whole facets on an obstacle, shape (p, 2).
        weights: Their weights, whose sum is 2 for each segment, shape (p,).
        spans: Segment i has the points spans[i, 0]:spans[i, 1], shape (n, 2).
        pairs: Segments (i, k) of which M of i depends on the nodes of k, shape (p, 2).
    """

    facets: Indices
    partial: Flags
    offsets: Indices
    pair_offsets: Indices
    slave: Indices
    master: Indices
    ends: Array
    end_is_fixed: Flags
    points: Array
    weights: Array
    spans: Indices
    pairs: Indices

    @cached_property
    def num_segments(self) -> int:
        """Number of segments."""
        return self.slave.shape[0]

    @property
    def owner(self) -> Indices:
        """Position in ``facets`` of the facet of each segment, shape (n,)."""
        return np.repeat(np.arange(self.facets.size), np.diff(self.offsets))


@clock("search")
def find_segments(
    slave: Surface, master: Surface, x: Array, n: Array, m: Array, facets: Indices,
    options: MortarOptions, behind: BodiesBehind | None = None,
) -> Segments:  # fmt: skip
    """Find the segments of the given slave facets.

    ============  =========================================================================
    integration   segments of a slave facet
    ============  =========================================================================
    "segments"    its intersections with master facets, each with a Gauss rule
    "elements"    runs of points with the same partner; the points are one Gauss rule for the
                  whole facet. Segment ends are fixed, such that each point has a length
                  equal to its weight
    "nodes"       as "elements", with the Lobatto rule, whose points are the nodes
    ============  =========================================================================

    The last two do not resolve the kinks at ends of master facets inside a slave facet: forces
    balance, but the patch test is not satisfied (Farah, Popp & Wall 2015). "nodes" is
    node-to-segment contact.

    Args:
        slave: The side that carries the multiplier.
        master: The side projected to.
        x: Current positions of the slave nodes, shape (slave nodes, 2) [length].
        n: Unit normals of the slave nodes, shape (slave nodes, 2).
        m: Current positions of the master nodes, shape (master nodes, 2) [length].
        facets: Slave facets to search, shape (f,).
        options: Kind of segments, quadrature and limits of the search.
        behind: Limits of the search behind the slave facets; none by default.

    Returns:
        The segments. Of overlapping segments only the nearest is kept. With "elements" a facet with
        fewer partners than nodes has no segments, since its dual basis would not exist. Lengths in
        xi below ``ROUNDING`` are ignored: covered and missing lengths of facets, overlaps of
        segments, distances of fixed points from master nodes.

    Note:
        Local: no communication.
    """
    geometry, nodes = (x, n, m), slave.facets[facets]
    behind = nothing_behind(facets.size) if behind is None else behind.of(facets)
    search_for = geometry, nodes, master.facets, options.radius
    limits = options.min_cosine, ROUNDING
    integration, points = options.integration, options.points
    if integration == "segments":
        roles = slave.roles.of(facets) if slave.roles else None
        sight = (behind[:3], behind.outline, ROUNDING)
        offsets, masters, fixed, ends, couples = search.find_segments(
            *search_for, *sight, limits, roles, slave.functions_move
        )
        spans = np.empty(ends.shape, np.int64)
        spans[:] = 0, points
        rules = ends, fixed, *gauss_rule(points), spans
    else:
        rule = facet_rule(integration, nodes.shape[1], points)
        min_points = nodes.shape[1] if integration == "elements" else 1
        offsets, masters, rules = _runs(
            (*search_for, (*behind, ROUNDING), limits), *rule, min_points=min_points
        )
        couples = search.couple_segments(offsets, *rules[:2], slave.functions_move)
    owner, partial, pair_offsets, pairs = couples
    on_slave, on_master = nodes[owner], master.facets[masters]
    return Segments(facets, partial, offsets, pair_offsets, on_slave, on_master, *rules, pairs)


def _runs(
    search_for: tuple[Any, ...], xi: Array, w: Array, *, min_points: int
) -> tuple[Indices, Indices, tuple[Any, ...]]:
    """Offsets, master facets and quadrature of runs of points of the rule ``xi``, ``w``.

    The latter are ends, whether they are fixed, points, weights and spans, see ``Segments``.
    """
    offsets, masters, runs = search.find_points(*search_for, xi, min_points)
    cuts = np.concatenate([[-1.0], np.cumsum(w)[:-1] - 1.0, [1.0]])
    ends, lengths = cuts[runs], np.diff(runs, axis=1)[:, 0]
    stops = np.cumsum(lengths)
    owner, starts = np.repeat(np.arange(len(runs)), lengths), stops - lengths
    which = runs[owner, 0] + np.arange(owner.size) - starts[owner]
    centres, halves = ends.mean(axis=1), (ends[:, 1] - ends[:, 0]) / 2.0
    s, weights = (xi[which] - centres[owner]) / halves[owner], w[which] / halves[owner]
    spans = np.stack([starts, stops], axis=1)
    return offsets, masters, (ends, np.ones(ends.shape, bool), s, weights, spans)


WEIGHTINGS = {"opposite": projection.OPPOSITE, "unit": projection.UNIT, "own": projection.OWN}


def basis_on(surface: Any, basis: Basis) -> Basis:
    """Basis of the multipliers on a surface (local).

    Triangles with six nodes have "linear" functions at their corners: there the integral of the
    quadratic function is zero, and a dual one does not exist. With "quadratic" they have those of
    ``reference.functions_of``; on other facets these are dual.
    """
    if surface.dim == 3 and surface.facets.shape[1] == 6:
        return basis if basis == "quadratic" else "linear"
    return "dual" if basis == "quadratic" else basis


def evaluate_normals(
    surface: Any, x: Array, weighting: Weighting, links: tuple[Indices, ...] | None = None,
    planes: Array | None = None,
) -> tuple[Array, Array]:  # fmt: skip
    """Averaged unit normals of nodes, and their derivatives (local).

    Args:
        surface: The surface.
        x: Current positions of its n nodes, shape (n, dim) [length].
        weighting: Weights of the facet normals at a node.
        links: Nodes before and after each node of a curve, (n,) each, or in space the facets around
            each node, see ``Surface.around``, if not those of the surface.
        planes: Normals that replace those of nodes on symmetry planes, nan elsewhere, shape (n, 2);
            in space matrices that remove components of normals, shape (n, 3, 3).

    Returns:
        Normals (n, dim) and derivatives by the nodes of the stencil, (n, dim, dim s) [1 / length];
        see ``kernels.projection`` and ``kernels.space.normals``.
    """
    n, dn = np.empty_like(x), np.zeros((*x.shape, surface.stencil_dofs.shape[1]))
    choice = WEIGHTINGS[weighting]
    if surface.dim == 2:
        links = (surface.previous, surface.following) if links is None else links
        projection.tabulate_normals(x, *links, surface.inner, choice, n, dn)
        if planes is not None and (on := np.isfinite(planes[:, 0])).any():
            n[on], dn[on] = planes[on], 0.0
    else:
        space_normals.tabulate_normals(
            x, surface.facets, links or surface.around, surface.stencil, choice, planes, n, dn
        )
    return n, dn


class MortarInput(NamedTuple):
    """Two surfaces at given positions, and what of them is evaluated.

    Attributes:
        slave: The side that carries the multiplier.
        master: The side projected to, without nodes on an obstacle.
        x: Current positions of the slave nodes, shape (slave nodes, dim) [length].
        m: Current positions of the master nodes, shape (master nodes, dim) [length].
        multiplier_nodes: Whether a slave node carries a multiplier, shape (slave nodes,), bool. The
            functions of other nodes are handed over to their neighbours.
        planes: See ``evaluate_normals``; the normals of an obstacle are replaced likewise.
        options: Discretization.
        linearization: Derivatives to evaluate; the others are zero.
        behind: Limits of the search behind the slave facets at these positions.
        edges: Corners of the slave that take the normal of one facet; see ``corners``.
        searched: Operators at the same positions and with the same linearization, but other
            multiplier nodes: their normals and segments are used if the facets are equal.
    """

    slave: Any
    master: Any
    x: Array
    m: Array
    multiplier_nodes: Flags
    planes: Array
    options: MortarOptions
    linearization: Linearization
    behind: BodiesBehind | None = None
    edges: SharpEdges | None = None
    searched: Any = None


def choose_facets(given: MortarInput) -> tuple[Indices, Any, tuple[Array, Array]]:
    """This rank's share of the facets with multipliers, and their normals (local).

    Returns:
        The facets, shape (f,); the segments of ``searched``, if these are those of the facets, else
        ``None``; normals of all slave nodes [1] and their derivatives [1/length].
    """
    slave, options, searched = given.slave, given.options, given.searched
    used, links = given.multiplier_nodes[slave.facets].any(axis=1), None
    if given.edges is not None and given.edges.nodes.size:
        at = given.x, given.master, given.m
        links, alone = given.edges.links(given.edges.choose(*at, options.radius))
        used &= ~alone
    share = share_of(used.nonzero()[0], slave.comm)
    if searched is not None and np.array_equal(searched.segments.facets, share):
        return share, searched.segments, (searched.n, searched.dn)
    n, dn = evaluate_normals(slave, given.x, options.weighting, links, given.planes)
    return share, None, (n, dn if given.linearization.normals else np.zeros_like(dn))


@dataclass(frozen=True, kw_only=True)
class PlaneOperators(MortarOperators):
    """D, M, weighted gap and normals of two curves; tau = (-n_y, n_x).

    Derivatives are stored as dense blocks. With K nodes per facet, 2 or 3, a segment has
    C = 8 K - 4 columns: the components of the slave nodes of the previous facet, of its own and of
    the next one, and of its master nodes.

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
        s = self.segments
        of_master = self.master.dofs[s.master].reshape(len(s.master), 2 * s.master.shape[1])
        return np.concatenate([self.slave.near_dofs[s.slave[:, 0]], of_master], axis=1)

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
        """Block of d(D^T z)/dd [stress] at fixed ``z`` of c components (local)."""
        nodes, dofs = self.segments.slave, self.slave.dofs if dofs is None else dofs
        return _force_block(self.dD, z[nodes], dofs[nodes], self.columns)

    def master_force_derivative(self, z: Array, dofs: Indices | None = None) -> Block:
        """Block of -d(M^T z)/dd [stress] at fixed ``z`` of c components (local)."""
        s, (i, k) = self.segments, self.segments.pairs.T
        dofs = self.master.dofs if dofs is None else dofs
        return _force_block(self.dM, -z[s.slave[i]], dofs[s.master[i]], self.columns[k])

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
        of_matrices = self.matrices_derivative(
            lambda j, k: np.einsum("...c,...c->...", along[j], self.x[k])[..., None],
            lambda j, l: -np.einsum("...c,...c->...", along[j], self.m[l])[..., None],
        )
        return [*self.jump_derivative(along), *of_matrices]

    def matrix_derivative(self, on_slave: Array, on_master: Array) -> list[Block]:
        """Blocks of d(D v - M w)/dd at constant nodal values of a scalar field (local)."""
        return self.matrices_derivative(
            lambda _, k: on_slave[k][..., None], lambda _, l: -on_master[l][..., None]
        )

    def matrices_derivative(self, by_D: ByEntries, by_M: ByEntries) -> list[Block]:
        """Blocks of numbers at nodes, linear in D and M, see ``MortarOperators`` (local)."""
        if self.linearization.frozen:
            return []
        s, (i, k) = self.segments, self.segments.pairs.T
        j, l = s.slave[i], s.master[i]
        by = by_D(s.slave[:, :, None], s.slave[:, None]), by_M(j[:, :, None], l[:, None])
        of_D = np.einsum("sjkq,sjk->sjq", self.dD, by[0][..., 0])
        of_M = np.einsum("pjlq,pjl->pjq", self.dM, by[1][..., 0])
        return [Block(s.slave, self.columns, of_D), Block(j, self.columns[k], of_M)]

    def freeze(self) -> Self:
        """Copy with constant D, M and n, for small motions; see ``after_small_motion``."""
        at_rest = {name: np.zeros_like(getattr(self, name)) for name in ("dn", "dD", "dM", "dgap")}
        return replace(self, linearization=LINEARIZATIONS["frozen"], **at_rest)

    def minus_offset(self, offset: Array) -> Self:
        """Operators for the gap minus an offset, interpolated between nodes (collective)."""
        s, nodes = self.segments, self.facet_nodes
        change = np.einsum("ejk,ek->ej", self.D, offset[nodes])
        nodal = summed(change.ravel(), nodes.ravel(), self.slave.num_nodes)
        nodal = sum_over_ranks(self.slave.comm, nodal)
        derivative = np.einsum("sjkq,sk->sjq", self.dD, offset[s.slave])
        return replace(self, gap=self.gap - nodal, dgap=self.dgap - derivative)


def _force_block(dX: Array, z: Array, rows: Indices, columns: Indices) -> Block:
    """Block of d(X^T z) at fixed ``z`` for segments or pairs of them (local).

    Args:
        dX: Derivatives of D or M, shape (p, K, K', C) [1].
        z: Multipliers of a components at the slave nodes, shape (p, K, a) [stress].
        rows: Rows of the other nodes, shape (p, K', a).
        columns: Columns, shape (p, C).
    """
    (count, size, others, width), parts = dX.shape, z.shape[2]
    by_part = np.swapaxes(z, 1, 2) @ dX.reshape(count, size, others * width)
    values = np.swapaxes(by_part.reshape(count, parts, others, width), 1, 2)
    shape = count, others * parts
    return Block(rows.reshape(shape), columns, values.reshape(*shape, width))


def share_of(items: Indices, comm: MPI.Comm) -> Indices:
    """This rank's contiguous share of ``items`` (k,); all shares are equal to one item (local)."""
    bounds = [items.size * rank // comm.size for rank in (comm.rank, comm.rank + 1)]
    return items[bounds[0] : bounds[1]]


def evaluate_mortar(given: MortarInput) -> PlaneOperators:
    """Evaluate the mortar operators of curves at current positions (collective)."""
    slave, master, x, m, multiplier_nodes, _, options, linearization, behind, *_ = given
    share, s, (n, dn) = choose_facets(given)
    if s is None:
        s = find_segments(slave, master, x, n, m, share, options, behind)
    nodes = slave.facets[share]
    thickness = (slave.thickness.constant, slave.thickness.by_x) if slave.thickness else None
    if nodes.shape[1] > 2:
        multiplier_nodes = multiplier_nodes & _covered(slave, s, x, thickness)
    weights = hand_over(multiplier_nodes[nodes])
    D, dD, M, dM, gap, dgap, cover = integrate_segments(
        s, nodes, (x, n, dn, m), weights, (*options.kinds, linearization.segments), thickness
    )
    if options.integration == "nodes":
        D[weights == 0.0] = 0.0  # remove rounding
    count = len(s.slave)
    return PlaneOperators(
        slave=slave, master=master, x=x, m=m, n=n, dn=dn, segments=s, D=D, M=M, dD=dD, dM=dM,
        dgap=dgap, **sum_over_facets(slave, nodes, D, gap, cover), linearization=linearization,
        num_segments=count if slave.comm.size == 1 else slave.comm.allreduce(count),
    )  # fmt: skip


def sum_over_facets(
    slave: Surface, nodes: Indices, D: Array, gap: Array, cover: Array
) -> dict[str, Array]:
    """Assemble integrals of facets at the slave nodes, over all ranks (collective).

    Args:
        slave: The slave surface.
        nodes: Nodes of this rank's share of facets, shape (f, K).
        D: Slave matrices of these facets, shape (f, K, K) [length].
        gap: Weighted gaps, shape (f, K) [length^2].
        cover: Integrals of N over the covered parts, shape (f, K) [length].

    Returns:
        ``diagonal``, ``gap``, ``cover`` and ``weight`` of ``MortarOperators``.
    """
    count = slave.num_nodes
    on_facets = np.empty((4, *nodes.shape))
    on_facets[0], on_facets[1], on_facets[2] = D.diagonal(axis1=1, axis2=2), gap, cover
    on_facets[3] = D.sum(axis=2)
    rows = nodes + count * np.arange(4)[:, None, None]
    nodal = np.bincount(rows.ravel(), on_facets.ravel(), 4 * count).reshape(4, count)
    if slave.comm.size > 1 or not nodes.size:  # numpy's sums of nothing are integers
        nodal = sum_over_ranks(slave.comm, nodal)
    return dict(zip(("diagonal", "gap", "cover", "weight"), nodal, strict=True))


def integrate_segments(
    s: Segments, nodes: Indices, geometry: tuple[Array, Array, Array, Array], weights: Array,
    options: tuple[int, int, bool], thickness: tuple[Array, float] | None,
) -> tuple[Array, ...]:  # fmt: skip
    """D, dD, M, dM, g, dg and cover of f facets, as in ``PlaneOperators`` (local).

    Args:
        s: The segments.
        nodes: Nodes of their slave facets, shape (f, K).
        geometry: Slave positions, normals, their derivatives, and master positions.
        weights: Hand-over H, shape (f, K, K).
        options: Basis, weights of the gap, and whether the ends of segments have derivatives.
        thickness: See ``kernels.points``.
    """
    return point_kernels.integrate_segments(
        geometry, (nodes, weights, s.partial), (s.master, s.end_is_fixed, s.ends), s.offsets,
        s.pair_offsets, (s.points, s.weights, s.spans), options, thickness,
    )  # fmt: skip


def _covered(slave: Surface, s: Segments, x: Array, thickness: tuple[Array, float] | None) -> Flags:
    """Whether the integral of a node's shape function is positive, (slave nodes,) (collective).

    If the cover ends inside a quadratic facet, that of the far node can be negative. Such a node
    carries no multiplier: its function is handed over to its neighbour, without a jump.
    """
    nodes, rule = slave.facets[s.facets], (s.points, s.weights, s.spans)
    cover = np.empty(nodes.shape)
    point_kernels.tabulate_covers(x, nodes, s.ends, s.offsets, rule, cover, thickness)
    nodal = summed(cover.ravel(), nodes.ravel(), slave.num_nodes)
    return np.asarray(sum_over_ranks(slave.comm, nodal) > 0.0)
