# SPDX-License-Identifier: MIT
"""Evaluation of the mortar operators: normals, segments, integrals, sums over the ranks."""

from __future__ import annotations

from functools import cache

from mpi4py import MPI

import numpy as np

from fenics_mortar.interface.behind import BodiesBehind
from fenics_mortar.interface.corners import links_at_corners
from fenics_mortar.interface.curve_surface import Curve
from fenics_mortar.interface.mortar import Linearization
from fenics_mortar.interface.plane_mortar import PlaneOperators
from fenics_mortar.interface.segments import (
    MortarOptions,
    Segments,
    evaluate_normals,
    find_segments,
)
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.kernels import segments
from fenics_mortar.utils.arrays import Array, Flags, Indices, read_only_view, summed
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.ranks import sum_over_ranks


def share_of(items: Indices, comm: MPI.Comm) -> Indices:
    """This rank's contiguous share of ``items`` (k,); all shares are equal to one item (local)."""
    bounds = [items.size * rank // comm.size for rank in (comm.rank, comm.rank + 1)]
    return items[bounds[0] : bounds[1]]


@clock("integrals")
def evaluate_mortar(
    slave: Curve,
    master: Curve,
    x: Array,
    m: Array,
    multiplier_nodes: Flags,
    prescribed_normals: Array,
    options: MortarOptions,
    linearization: Linearization,
    behind: BodiesBehind | None = None,
    searched: PlaneOperators | None = None,
) -> PlaneOperators:
    """Evaluate the mortar operators at current positions (collective).

    Args:
        slave: The side that carries the multiplier.
        master: The side projected to.
        x: Current positions of the slave nodes, shape (slave nodes, 2) [length].
        m: Current positions of the master nodes, shape (master nodes, 2) [length].
        multiplier_nodes: Whether a slave node carries a multiplier, shape (slave nodes,), bool. The
            functions of other nodes are handed over to their neighbours.
        prescribed_normals: Normals that replace the averaged ones, shape (slave nodes, 2); nan
            where none is prescribed.
        options: Discretization.
        linearization: Derivatives to evaluate; the others are zero.
        behind: Limits of the search behind the slave facets at these positions.
        searched: Operators at the same positions and with the same linearization, but other
            multiplier nodes: their normals and segments are used if the facets are equal.

    Returns:
        The operators.
    """
    used, links = multiplier_nodes[slave.facets].any(axis=1), None
    if options.corners:
        links, alone = links_at_corners(slave, x, master, m)
        used &= ~alone
    share = share_of(used.nonzero()[0], slave.comm)
    if searched is not None and np.array_equal(searched.segments.facets, share):
        n, dn, s = searched.n, searched.dn, searched.segments
    else:
        n, dn = evaluate_normals(slave, x, options.weighting, links)
        given = np.isfinite(prescribed_normals[:, 0])
        if given.any():
            n[given], dn[given] = prescribed_normals[given], 0.0
        if not linearization.normals:
            dn = np.zeros_like(dn)
        s = find_segments(slave, master, x, n, m, share, options, behind)
    D, dD, M, dM, gap, dgap, cover = _integrate(
        slave, s, (x, n, dn, m), multiplier_nodes, options, linearization.segments
    )
    diagonal, gap, cover, weight = sum_over_facets(slave, slave.facets[share], D, gap, cover)
    count = len(s.slave)
    num_segments = count if slave.comm.size == 1 else slave.comm.allreduce(count)
    return PlaneOperators(
        slave=slave, master=master, x=x, m=m, n=n, dn=dn, segments=s, D=D, M=M, dD=dD, dM=dM,
        dgap=dgap, diagonal=diagonal, gap=gap, cover=cover, weight=weight,
        num_segments=num_segments, linearization=linearization,
    )  # fmt: skip


def sum_over_facets(
    slave: Surface, nodes: Indices, D: Array, gap: Array, cover: Array
) -> tuple[Array, Array, Array, Array]:
    """Assemble integrals of facets at the slave nodes, over all ranks (collective).

    Args:
        slave: The slave surface.
        nodes: Nodes of this rank's share of facets, shape (f, K).
        D: Slave matrices of these facets, shape (f, K, K) [length].
        gap: Weighted gaps, shape (f, K) [length^2].
        cover: Integrals of N over the covered parts, shape (f, K) [length].

    Returns:
        Diagonal of D, weighted gap, cover and row sum of D, each (slave nodes,).
    """
    count = slave.num_nodes
    on_facets = np.empty((4, *nodes.shape))
    on_facets[0], on_facets[1], on_facets[2] = D.diagonal(axis1=1, axis2=2), gap, cover
    on_facets[3] = D.sum(axis=2)
    rows = nodes + count * np.arange(4)[:, None, None]
    sums = np.bincount(rows.ravel(), on_facets.ravel(), 4 * count)
    nodal = sums.reshape(4, count)
    if slave.comm.size > 1 or not nodes.size:  # numpy's sums of nothing are integers
        nodal = sum_over_ranks(slave.comm, nodal)
    return nodal[0], nodal[1], nodal[2], nodal[3]


def integrate_segments(
    s: Segments,
    nodes: Indices,
    geometry: tuple[Array, Array, Array, Array],
    weights: Array,
    options: tuple[int, int, bool],
    thickness: tuple[Array, float] | None,
) -> tuple[Array, ...]:
    """D, dD, M, dM, g, dg and cover of f facets, as in ``PlaneOperators`` (local).

    Args:
        s: The segments.
        nodes: Nodes of their slave facets, shape (f, K).
        geometry: Slave positions, normals, their derivatives, and master positions.
        weights: Hand-over H, shape (f, K, K).
        options: Basis, weights of the gap, and whether the ends of segments have derivatives.
        thickness: See ``kernels.segments``.
    """
    (number, size), count, kind = nodes.shape, len(s.slave), geometry[0].dtype
    columns = 8 * size - 4
    D, M = np.zeros((number, size, size), kind), np.empty((count, size, size), kind)
    g, cover = np.zeros((number, size), kind), np.zeros((number, size), kind)
    dD, dg = np.empty((count, size**2, columns), kind), np.empty((count, size, columns), kind)
    dM = np.empty((len(s.pairs), size**2, columns), kind)
    segments.integrate_segments(
        geometry, (nodes, weights, s.partial), (s.master, s.end_is_fixed, s.ends), s.offsets,
        s.pair_offsets, (s.points, s.weights, s.spans), options, (D, M, g, cover), (dD, dM, dg),
        thickness,
    )  # fmt: skip
    shape = size, size, columns
    return D, dD.reshape(-1, *shape), M, dM.reshape(-1, *shape), g, dg, cover


def _integrate(
    slave: Curve,
    s: Segments,
    geometry: tuple[Array, Array, Array, Array],
    multiplier_nodes: Flags,
    options: MortarOptions,
    move_ends: bool,
) -> tuple[Array, ...]:
    """D, dD, M, dM, g, dg and cover of the facets of this share (collective).

    If the cover ends inside a quadratic facet, the integral of the shape function of the far node
    can be negative. Such a node carries no multiplier: its function is handed over to its
    neighbour, without a jump.
    """
    nodes = slave.facets[s.facets]
    thickness = slave.thickness.for_kernels if slave.thickness else None
    if nodes.shape[1] > 2:
        cover = np.empty(nodes.shape)
        segments.tabulate_covers(geometry[0], nodes, s.ends, s.offsets, s.rule, cover, thickness)
        nodal = summed(cover.ravel(), nodes.ravel(), slave.num_nodes)
        nodal = sum_over_ranks(slave.comm, nodal)
        multiplier_nodes = multiplier_nodes & (nodal > 0.0)
    weights = hand_over(multiplier_nodes[nodes])
    found = integrate_segments(s, nodes, geometry, weights, (*options.kinds, move_ends), thickness)
    if options.integration == "nodes":
        found[0][weights == 0.0] = 0.0  # remove rounding
    return found


def hand_over(multiplier_nodes: Flags) -> Array:
    """Fraction of node k's function that is added to node j's, per facet, shape (f, K, K) [1].

    Multiplier nodes keep their own function; other functions are split equally among the nearest
    multiplier nodes of the facet.
    """
    bits, of_sets = _hand_overs(multiplier_nodes.shape[1])
    return of_sets.take(multiplier_nodes.dot(bits), axis=0)


@cache
def _hand_overs(size: int) -> tuple[Indices, Array]:
    """``hand_over`` for all sets of multiplier nodes on a facet.

    Returns:
        Contribution of each node that carries a multiplier to the number of the set, shape (K,),
        and the fractions of each set, shape (2**K, K, K) [1].
    """
    index = np.arange(size)
    carries = (np.arange(1 << size)[:, None] >> index & 1 == 1)[:, :, None]
    distance = np.where(carries, np.abs(index[:, None] - index).astype(float), np.inf)
    nearest = (distance == distance.min(axis=1, keepdims=True)) & carries
    fractions = nearest / np.maximum(nearest.sum(axis=1, keepdims=True), 1)
    return 1 << index, read_only_view(fractions)
