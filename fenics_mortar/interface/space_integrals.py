# SPDX-License-Identifier: MIT
"""Evaluation of the mortar operators in space: normals, pairs of facets, integrals."""

from __future__ import annotations

import numpy as np

from fenics_mortar.interface.faces import Faces, covers
from fenics_mortar.interface.integrals import (
    BodiesBehind,
    MortarOptions,
    evaluate_normals,
    share_of,
    sum_over_facets,
)
from fenics_mortar.interface.mortar import Linearization
from fenics_mortar.interface.reference import AT_VERTICES, COMBINED, Basis, functions_of, hand_over
from fenics_mortar.interface.roles import FaceRoles
from fenics_mortar.interface.space_mortar import (
    FacetPairs,
    Moments,
    SpaceOperators,
    inverse_of,
    merge,
)
from fenics_mortar.kernels.basis import BY_STANDARD, DUAL
from fenics_mortar.kernels.space import integrals, pairs
from fenics_mortar.kernels.space.shapes import triangle_rule
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.clock import clock

# Smallest weight of a multiplier node after the hand-over, over that of its own function [1]: below
# it functions of negative integral cancel most of its own, and the mean gap is no longer a mean.
LEAST_WEIGHT = 0.5


@clock("integrals")
def evaluate_space(
    slave: Faces,
    master: Faces,
    x: Array,
    m: Array,
    multiplier_nodes: Flags,
    projectors: Array,
    options: MortarOptions,
    linearization: Linearization,
    behind: BodiesBehind | None = None,
    searched: SpaceOperators | None = None,
) -> SpaceOperators:
    """Evaluate the mortar operators at current positions (collective).

    Args:
        slave: The side that carries the multiplier.
        master: The side projected to.
        x: Current positions of the slave nodes, shape (slave nodes, 3) [length].
        m: Current positions of the master nodes, shape (master nodes, 3) [length].
        multiplier_nodes: Whether a slave node carries a multiplier, shape (slave nodes,), bool. The
            functions of other nodes are handed over to the others of their facets.
        projectors: See ``evaluate_normals``.
        options: Discretization.
        linearization: Derivatives to evaluate; the others are zero.
        behind: Limits of the search behind the slave facets; none by default.
        searched: Operators at the same positions and with the same linearization, but other
            multiplier nodes: their normals and pairs are used if the facets are equal.

    """
    used, around = multiplier_nodes[slave.facets].any(axis=1), None
    if options.corners:
        around, alone = slave.sharp_edges.choose(x, master, m, options.radius)
        used &= ~alone
    share = share_of(used.nonzero()[0], slave.comm)
    if searched is not None and np.array_equal(searched.segments.facets, share):
        n, dn, s = searched.n, searched.dn, searched.segments
    else:
        n, dn = evaluate_normals(slave, x, options.weighting, around, projectors)
        if not linearization.normals:
            dn = np.zeros_like(dn)
        s = find_pairs(slave, master, x, m, share, options, behind)
    nodes, rule = slave.facets[share], triangle_rule(options.points)
    moments = _integrate((x, n, m), nodes, s, rule)
    is_dual = options.kinds[0] == DUAL
    H = _hand_over(slave, nodes, moments, multiplier_nodes, options.basis)
    A = moments.De[:, :, None] * moments.inverse
    if not is_dual:
        A = np.tile(np.eye(nodes.shape[1]), (len(nodes), 1, 1))  # kernels need all entries
    functions = H @ A
    D = functions @ moments.Me
    if is_dual:  # remove rounding, from D and by one refinement from the functions
        rest, D = H * moments.De[:, None] - D, H * moments.De[:, None]
        functions = functions + rest @ moments.inverse
    M = functions[s.owner] @ moments.B
    by_dual = is_dual and options.kinds[1] != BY_STANDARD
    gap = np.einsum("fjk,fk->fj", functions if by_dual else H, moments.G)
    diagonal, gap, cover, weight = sum_over_facets(slave, nodes, D, gap, covers(moments.De))
    if slave.roles is not None:
        cover[_constrained_twice(slave, slave.roles, s)] = 0.0
    if options.basis in COMBINED:  # integrals of their products may be negative
        diagonal = weight
    count = s.num_segments
    return SpaceOperators(
        slave=slave, master=master, x=x, m=m, n=n, dn=dn, segments=s, D=D, M=M,
        diagonal=diagonal, gap=gap, cover=cover, weight=weight,
        num_segments=count if slave.comm.size == 1 else slave.comm.allreduce(count),
        linearization=linearization, moments=moments, H=H, A=A, is_dual=is_dual,
        gap_by_dual=by_dual, rule=rule,
        offset=np.zeros(len(x)),
    )  # fmt: skip


def _constrained_twice(surface: Faces, roles: FaceRoles, s: FacetPairs) -> Flags:
    """Nodes of a surface in contact with itself whose gap is that of an earlier node (collective).

    Where roles change within the contact, see ``self_contact``, each of two nodes that face each
    other is on a slave and on a master facet, and both multipliers would close the same gap. The
    later node counts as not covered, and hands its function over.

    Returns:
        Shape (n,), bool.
    """
    count = surface.num_nodes
    shape = (*s.slave.shape, s.master.shape[1])
    nodes, masters = (
        np.broadcast_to(side, shape) for side in (s.slave[:, :, None], s.master[:, None])
    )
    mine = np.unique(nodes * count + masters)
    if surface.comm.size > 1:
        mine = np.unique(np.concatenate(surface.comm.allgather(mine)))
    nodes, masters = np.divmod(mine, count)
    nodes, masters = np.stack([nodes, masters])[:, np.isin(masters * count + nodes, mine)]
    earliest, _ = roles.of_nodes(surface.facets, count)
    twice = np.zeros(count, bool)
    twice[nodes[earliest[nodes] > earliest[masters]]] = True
    return twice


def _hand_over(
    slave: Faces, nodes: Indices, moments: Moments, multiplier_nodes: Flags, kind: Basis
) -> Array:
    """Hand-over of the functions of nodes without multiplier, (f, K, K) [1] (collective).

    Integrals of quadratic functions over a small cover may be negative, and so may their sum with
    those that are handed over to a node: its pressure would pull, and its active set not converge.
    Such nodes carry no multiplier, either.
    """
    functions = functions_of(nodes.shape[1], kind)
    if kind in AT_VERTICES or nodes.shape[1] < 6:  # no integral is negative
        return hand_over(multiplier_nodes[nodes], functions)
    integrals_of = moments.De @ functions.T
    own = sum_over_facets(slave, nodes, moments.Me, integrals_of, integrals_of)[2]
    carries = multiplier_nodes & (own > 0.0)
    while True:
        H = hand_over(carries[nodes], functions)
        given = np.einsum("fjk,fk->fj", H, moments.De)
        weight = sum_over_facets(slave, nodes, moments.Me, given, given)[2]
        reduced = carries & (weight < LEAST_WEIGHT * own)
        if not reduced.any():
            return H
        carries &= ~reduced


def find_pairs(
    slave: Faces, master: Faces, x: Array, m: Array, share: Indices, options: MortarOptions,
    behind: BodiesBehind | None = None,
) -> FacetPairs:  # fmt: skip
    """Master facets that the slave facets ``share`` (f,) face, within the limits (local)."""
    offsets, masters = pairs.find_pairs(
        x, m, slave.facets, master.facets, share, options.radius, options.min_cosine,
        behind and tuple(behind.of(share)), slave.roles and slave.roles.of(share),
    )  # fmt: skip
    owner = np.repeat(np.arange(share.size), np.diff(offsets))
    on_master = master.facets[masters]
    merged, places = merge(owner, on_master, share.size)
    return FacetPairs(
        facets=share, offsets=offsets, slave=slave.facets[share][owner], master=on_master,
        numbers=masters, owner=owner, merged=merged, places=places,
    )  # fmt: skip


def _integrate(
    geometry: tuple[Array, Array, Array], nodes: Indices, s: FacetPairs, rule: tuple[Array, Array]
) -> Moments:
    """Moments of the slave facets with ``nodes`` (f, K) (local).

    The gap is nan on facets that are folded over their own plane, as in some Newton iterates: the
    residual is not finite then, and the step is cut.
    """
    count, size = nodes.shape
    De, Me, G = np.zeros((count, size)), np.zeros((count, size, size)), np.zeros((count, size))
    B = np.zeros((s.num_segments, size, s.master.shape[1]))
    complete, folded = np.zeros((2, count), bool)
    integrals.integrate_facets(
        geometry, nodes, s.master, s.offsets, rule, (De, Me, G, B, complete, folded)
    )
    G[folded] = np.nan
    return Moments(De, Me, G, B, inverse_of(Me), complete)
