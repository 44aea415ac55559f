# SPDX-License-Identifier: MIT
"""Mortar operators of faces in space, with their derivatives; see ``mortar``.

=========  =========================================================================  ===========
symbol     meaning, of a slave facet with K nodes                                     shape
=========  =========================================================================  ===========
De, Me     int N_j, int N_j N_k over the covered part                                 (K,), (K, K)
B, G       int N_j N_l of a master facet, int N_j g                                   (K, K'), (K,)
A          multiplier functions Phi = A N: diag(De) Me^-1 (dual) or 1 (standard)      (K, K)
H          hand-over: H[j, k] is the fraction of function k added to that of j        (K, K)
c          traction in the plain basis, Me c = diag(De) H^T z (dual), H^T z           (K, 3)
=========  =========================================================================  ===========

    D = H A Me,   M = H A B,   g~ = H A G;   forces  Me c  and  -B^T c.

A depends on the whole cover of a facet. Its derivative is not formed: with c and gamma of

    Me c = diag(De) z,   Me gamma = G,   Me v = B y,

the derivatives of forces, gaps and distance vectors are integrals of functions whose coefficients
are constant, plus -B^T dc with Me dc = d(De) z - d(Me) c; see ``kernels.space.linearize``. The
columns of a facet are its own nodes, then the nodes of all master facets that it faces.

Formulas: Puso & Laursen (2004); Popp, Gitterle, Gee & Wall (2010); dual functions of the covered
part: Cichosz & Bischoff (2011), Popp, Seitz, Gee & Wall (2013).

``evaluate_space`` averages the nodal normals, finds the pairs of facets, and integrates over them;
``SpaceOperators`` differentiates the integrals.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Self

import numpy as np

from fenics_mortar.interface import reference
from fenics_mortar.interface.faces import Faces, FacetPairs
from fenics_mortar.interface.integrals import MortarInput, choose_facets, sum_over_facets
from fenics_mortar.interface.mortar import LINEARIZATIONS, Block, MortarOperators, without_values
from fenics_mortar.kernels.facets import BY_STANDARD, DUAL
from fenics_mortar.kernels.space import integrals
from fenics_mortar.kernels.space import pairs as pair_kernels
from fenics_mortar.kernels.space.integrals import listed_points
from fenics_mortar.kernels.space.linearize import linearize_facets
from fenics_mortar.kernels.space.normals import padded
from fenics_mortar.kernels.space.shapes import triangle_rule
from fenics_mortar.utils.arrays import Array, Flags, Indices, summed
from fenics_mortar.utils.ranks import sum_over_ranks

if TYPE_CHECKING:
    from fenics_mortar.interface.mortar import BodiesBehind, ByEntries, MortarOptions
    from fenics_mortar.interface.reference import Basis
    from fenics_mortar.interface.surfaces import FaceRoles


class Moments(NamedTuple):
    """Integrals over the covered parts of f facets and of p pairs, see the module (local).

    Attributes:
        De: Shape (f, K) [area].
        Me: Shape (f, K, K) [area].
        G: Shape (f, K) [volume].
        B: Shape (p, K, K') [area].
        inverse: Inverse of Me, zero without cover, shape (f, K, K) [1 / area].
        complete: Whether the whole facet has partners, shape (f,), bool.
    """

    De: Array
    Me: Array
    G: Array
    B: Array
    inverse: Array
    complete: Flags


@dataclass(frozen=True, kw_only=True)
class SpaceOperators(MortarOperators):
    """D, M, weighted gap and normals of two surfaces in space.

    Attributes:
        moments: Integrals of the facets of this share.
        H: Hand-over, shape (f, K, K) [1].
        A: Coefficients of the multiplier functions, shape (f, K, K) [1].
        is_dual: Whether they are dual.
        gap_by_dual: Whether they weight the gap too, or the plain functions (Petrov-Galerkin).
        rule: Points (q, 2) and weights (q,) of a triangle.
        offset: Length subtracted from the gap, shape (slave nodes,) [length].
    """

    moments: Moments
    H: Array
    A: Array
    is_dual: bool
    gap_by_dual: bool
    rule: tuple[Array, Array]
    offset: Array
    is_linearized_late: ClassVar[bool] = True
    # derivatives found so far, and the multipliers ``z`` (slave nodes, c) of the forces
    _found: dict[str, Array] = field(default_factory=dict, init=False, compare=False, repr=False)
    # the last two results of ``near``: with multipliers that act, and with slip
    _near: dict[bytes, Self] = field(default_factory=dict, init=False, compare=False, repr=False)

    @cached_property
    def columns(self) -> Indices:
        """Displacement dofs of the columns of each facet, -1 for none, shape (f, 3 (K + L))."""
        sides = self.slave.dofs_of(self.facet_nodes), self.master.dofs_of(self.segments.merged)
        return np.concatenate(sides, axis=1)

    def near(self, nodes: Flags) -> Self:
        """Operators with the derivatives of facets with some of these nodes (local).

        Nodal values and the number of segments are those of all facets.
        """
        used = nodes[self.facet_nodes].any(axis=1)
        if used.all():
            return self
        key = used.tobytes()
        if key not in self._near:
            for older in list(self._near)[:-1]:
                del self._near[older]
            pairs = used[self.segments.owner]
            chosen = (used, used, used, pairs, used, used)
            self._near[key] = replace(
                self, segments=self.segments.of_facets(used), D=self.D[used], M=self.M[pairs],
                moments=Moments(*(m[on] for m, on in zip(self.moments, chosen, strict=True))),
                H=self.H[used], A=self.A[used],
            )  # fmt: skip
        return self._near[key]

    def linearize_at(self, z: Array) -> None:
        """Compute the derivatives of weights and gaps, and those of the forces of ``z`` (local).

        All in one pass over the points: without this call the first two are computed at z = 0, and
        all again for the forces. Frozen operators have none.

        Args:
            z: Shape (slave nodes, 3) [stress].
        """
        found = self._found
        if self.linearization.frozen or ("z" in found and np.array_equal(found["z"], z)):
            return
        G = np.nan_to_num(self.moments.G)  # of folded facets the gap is nan, not its derivative
        gamma = np.einsum("fjk,fk->fj", self.moments.inverse, G) * self.gap_by_dual
        of_gap = self.A if self.gap_by_dual else np.tile(np.eye(gamma.shape[1]), (len(gamma), 1, 1))
        fixed, c = self._tractions(z)
        (count, size), width = gamma.shape, self.columns.shape[1]
        out = (
            np.empty((count, size, width)), np.empty((count, size, width + 3 * size)),
            np.empty((count, 3 * size, width)), np.empty((count, width - 3 * size, width)), None,
        )  # fmt: skip
        self._fill((of_gap, gamma, fixed, c, None, None, None), out)
        found.update(weight=out[0], gap=out[1], X=out[2], Y=out[3], z=z.copy())

    def _tractions(self, z: Array) -> tuple[Array, Array]:
        """Coefficients s, c of the forces of ``z``, see ``linearize``, (f, K, a) each (local)."""
        moments, at_nodes = self.moments, self._handed_over(z)
        if not self.is_dual:
            return np.zeros_like(at_nodes), at_nodes
        return at_nodes, moments.inverse @ (moments.De[:, :, None] * at_nodes)

    def _of_forces(self, z: Array) -> tuple[Array, Array]:
        """Derivatives X and Y of the forces of ``z``, see ``linearize`` (local).

        Those of three components are kept with the derivatives of weights and gaps.
        """
        if z.shape[1] == 3:
            self.linearize_at(z)
            return self._found["X"], self._found["Y"]
        fixed, c = self._tractions(z)
        (count, size, parts), width = c.shape, self.columns.shape[1]
        others = self.segments.merged.shape[1]
        X, Y = np.empty((count, parts * size, width)), np.empty((count, parts * others, width))
        self._fill((None, None, fixed, c, None, None, None), (None, None, X, Y, None))
        return X, Y

    def _fill(self, coefficients: tuple[Array | None, ...], out: tuple[Array | None, ...]) -> None:
        """Call ``linearize_facets`` for the facets of this share (local)."""
        s = self.segments
        linearize_facets(
            (self.x, self.n, self.m), self.facet_nodes, s.master, s.offsets, s.places, self.rule,
            coefficients, out,
        )  # fmt: skip

    @property
    def _weights_and_gaps(self) -> tuple[Array, Array]:
        """Derivatives of De and of g~ before the hand-over; the latter also by normals (local)."""
        if "gap" not in self._found:
            self.linearize_at(np.zeros_like(self.x))
        return self._found["weight"], self._found["gap"]

    def weight_derivative(self) -> list[Block]:
        """Blocks of dw/dd [1], w = row sums of D; rows: slave nodes, columns: displacement dofs."""
        if self.linearization.frozen:
            return []
        return [Block(self.facet_nodes, self.columns, self.H @ self._weights_and_gaps[0])]

    def gap_derivative(self) -> list[Block]:
        """Blocks of dg/dd [length]; rows: slave nodes, columns: displacement dofs."""
        if self.linearization.frozen:
            return self.jump_derivative(-self.n)
        by_weight, by_gap = self._weights_and_gaps
        nodes, size = self.facet_nodes, self.facet_nodes.shape[1]
        of_positions = by_gap[..., : -3 * size]
        if self.offset.any():
            of_positions = of_positions - self._by_offset(by_weight)
        blocks = [Block(nodes, self.columns, self.H @ of_positions)]
        if self.linearization.normals:
            of_normals = (self.H @ by_gap[..., -3 * size :]).reshape(len(nodes), size, size, 3)
            values = np.einsum("fjkc,fkcq->fkjq", of_normals, self.dn[nodes])
            rows = np.repeat(nodes, size, axis=0)
            columns = self.normal_columns()[nodes].reshape(rows.shape[0], values.shape[3])
            blocks.append(Block(rows, columns, values.reshape(*rows.shape, values.shape[3])))
        return blocks

    def _by_offset(self, by_weight: Array) -> Array:
        """Derivative of int Phi_j offset before the hand-over, (f, K, C) [length] (local).

        ``by_weight`` is that of De.
        """
        at_nodes = self.offset[self.facet_nodes]
        if self.is_dual:
            return by_weight * at_nodes[:, :, None]
        c = at_nodes[:, :, None]
        change = np.empty((*at_nodes.shape, self.columns.shape[1]))
        fixed = np.zeros_like(c)
        self._fill((None, None, fixed, c, None, None, None), (None, None, change, None, None))
        return -change

    def slave_force_derivative(self, z: Array, dofs: Indices | None = None) -> Block:
        """Block of d(D^T z)/dd [stress] at fixed ``z`` of c components (local)."""
        nodes, parts = self.facet_nodes, z.shape[1]
        rows = (self.slave.dofs if dofs is None else dofs)[nodes]
        shape, width = (len(nodes), parts * nodes.shape[1]), self.columns.shape[1]
        if self.linearization.frozen:
            return without_values(rows.reshape(shape), self.columns)
        if parts == 3:
            self.linearize_at(z)
        if self.is_dual:
            values = self._handed_over(z)[..., None] * self._weights_and_gaps[0][:, :, None]
        else:
            values = -self._of_forces(z)[0]
        return Block(rows.reshape(shape), self.columns, values.reshape(*shape, width))

    def master_force_derivative(self, z: Array, dofs: Indices | None = None) -> Block:
        """Block of -d(M^T z)/dd [stress] at fixed ``z`` of c components (local)."""
        s, moments, (count, size) = self.segments, self.moments, self.facet_nodes.shape
        of_nodes = self.master.dofs if dofs is None else dofs
        rows = np.where(s.merged[..., None] >= 0, of_nodes[s.merged], -1)
        rows = rows.reshape(count, z.shape[1] * s.merged.shape[1])
        if self.linearization.frozen:
            return without_values(rows, self.columns)
        X, values = self._of_forces(z)
        if self.is_dual:
            of_c = np.zeros((count, size, s.merged.shape[1]))
            at = s.owner[:, None, None], np.arange(size)[:, None], s.places[:, None]
            np.add.at(of_c, at, moments.inverse[s.owner] @ moments.B)
            by_tractions = X.reshape(count, size, z.shape[1] * self.columns.shape[1])
            by_c = np.swapaxes(of_c, 1, 2) @ by_tractions
            values = values - by_c.reshape(values.shape)
        return Block(rows, self.columns, values)

    def _handed_over(self, z: Array) -> Array:
        """Multipliers of the functions of the facets' nodes before the hand-over, (f, K, c)."""
        return np.einsum("fjk,fjc->fkc", self.H, z[self.facet_nodes])

    def vector_derivative(self, along: Array) -> list[Block]:
        """Blocks of along_j . d(D x - M m)_j/dd [length] for directions ``along`` (nodes, 3)."""
        if self.linearization.frozen:
            return []
        near = self.near(along.any(axis=1))
        nodes = near.facet_nodes
        values = np.einsum("fjk,fjb,fkbq->fjq", near.H, along[nodes], near._of_vectors)
        return [*near.jump_derivative(along), Block(nodes, near.columns, values)]

    @cached_property
    def _of_vectors(self) -> Array:
        """Derivative of D x - M m by D and M before the hand-over, (f, K, 3, C) (local)."""
        return self._by_matrices(self.x[self.facet_nodes], self.m[self.segments.master])

    def _by_matrices(self, v: Array, w: Array) -> Array:
        """Derivative of D v - M w at constant v, w before the hand-over, (f, K, b, C) (local).

        Args:
            v: Constant values at the nodes of the facets, shape (f, K, b).
            w: Those at the master nodes of the pairs, shape (p, K', b).
        """
        s, moments, seen, q = self.segments, self.moments, v, np.zeros_like(v)
        if self.is_dual:
            seen = np.zeros_like(v)
            np.add.at(seen, s.owner, moments.B @ w)
            seen = moments.inverse @ seen
            q = v - seen
        change = np.empty((*v.shape, self.columns.shape[1]))
        self._fill((self.A, None, None, None, q, seen, w), (None, None, None, None, change))
        return change

    def rounding_of_vectors(self) -> Array:
        """Rounding of D x - M m over that of a position, (slave nodes,) [area] (collective).

        Roots of the sums of squares of all products in the rows of H A Me: their errors have
        random signs.
        """
        nodes, comm = self.facet_nodes, self.slave.comm
        squares = (self.H @ self.A) ** 2 @ (self.moments.Me**2).sum(axis=2)[:, :, None]
        total = summed(squares.ravel(), nodes.ravel(), len(self.x))
        return np.asarray(np.sqrt(sum_over_ranks(comm, total) if comm.size > 1 else total))

    def matrix_derivative(self, on_slave: Array, on_master: Array) -> list[Block]:
        """Blocks of d(D v - M w)/dd at constant nodal values of a scalar field (local)."""
        if self.linearization.frozen:
            return []
        values = on_slave[self.facet_nodes], on_master[self.segments.master]
        change = self._by_matrices(*(v[..., None] for v in values))[:, :, 0]
        return [Block(self.facet_nodes, self.columns, self.H @ change)]

    def matrices_derivative(self, by_D: ByEntries, by_M: ByEntries) -> list[Block]:
        """Blocks of numbers at nodes that are linear in D and M, see ``MortarOperators`` (local).

        The matrices of a facet are differentiated three columns at a time.
        """
        s, nodes, (count, size) = self.segments, self.facet_nodes, self.facet_nodes.shape
        if self.linearization.frozen or not count:
            return []
        of_D = np.swapaxes(by_D(nodes[:, :, None], nodes[:, None]), 2, 3)
        of_M = np.swapaxes(by_M(nodes[:, :, None], s.merged[:, None]), 2, 3)
        total = np.zeros((*of_D.shape[:3], self.columns.shape[1]))
        none_v, none_w = np.zeros((count, size, 3)), np.zeros((*s.master.shape, 3))
        if self.is_dual:
            diagonal = of_D * self.H[:, :, None]
            total += np.einsum("fjak,fkq->fjaq", diagonal, self._weights_and_gaps[0])
        for first in range(0, 0 if self.is_dual else size, 3):
            v, used = none_v.copy(), np.arange(first, min(first + 3, size))
            v[:, used, used - first] = 1.0
            total += self._chained(of_D[..., used], self._by_matrices(v, none_w))
        for first in range(0, of_M.shape[3], 3):
            chosen = s.places[:, :, None] == first + np.arange(3)
            change = self._by_matrices(none_v, chosen.astype(float))
            total -= self._chained(of_M[..., first : first + 3], change)
        rows = (of_D.shape[2] * nodes[:, :, None] + np.arange(of_D.shape[2])).reshape(count, -1)
        return [Block(rows, self.columns, total.reshape(*rows.shape, total.shape[3]))]

    def _chained(self, by: Array, change: Array) -> Array:
        """Chain rule with columns of D or M: shapes (f, K, a, b), (f, K, 3, C), (f, K, a, C)."""
        return np.einsum(
            "fjab,fji,fibq->fjaq", by, self.H, change[:, :, : by.shape[3]], optimize=True
        )

    def smallest_gaps(self, offset: Array) -> tuple[Array, Array]:
        """Smallest gap of each pair at corners and points of its cells, and its place (local).

        Args:
            offset: Subtracted from the gaps, shape (slave nodes,) [length].

        Returns:
            Gaps, inf without a common part, (p,), and places on the slave, (p, 3), both [length].
        """
        s, corners = self.segments, np.eye(3)
        rule = np.concatenate([corners, self.rule[0]]), np.ones(3 + len(self.rule[0]))
        smallest, where = np.empty(s.num_segments), np.zeros((s.num_segments, 3))
        geometry = self.x + offset[:, None] * self.n, self.n, self.m
        _integrate(geometry, self.facet_nodes, s, rule, (smallest, where))
        return smallest, where

    def covered_corners(self, facets: Flags) -> tuple[Indices, Array]:
        """Corners of the covered parts of some ``facets`` (f,) of this share, bool (local).

        Returns:
            Number of the pair of each corner (c,), and the slave's shape functions there (c, K)
            [1].
        """
        s, mine = self.segments, facets[self.segments.owner]
        offsets = np.append(0, np.cumsum(np.where(facets, np.diff(s.offsets), 0)))
        corners = np.eye(3), np.ones(3)
        pair, (_, N, _) = listed_points(
            (self.x, self.m), self.facet_nodes, s.master[mine], offsets, corners
        )
        return np.flatnonzero(mine)[pair], N[:, 0]

    def freeze(self) -> Self:
        """Copy with constant D, M and n, for small motions; see ``after_small_motion``."""
        return replace(self, dn=np.zeros_like(self.dn), linearization=LINEARIZATIONS["frozen"])

    def minus_offset(self, offset: Array) -> Self:
        """Operators for the gap minus an offset, interpolated between nodes (collective)."""
        jump = self.jump(np.repeat(offset[:, None], 3, axis=1), np.zeros_like(self.m))
        return replace(self, gap=self.gap - jump[:, 0], offset=self.offset + offset)


# Smallest weight of a multiplier node after the hand-over, over that of its own function [1]: below
# it functions of negative integral cancel most of its own, and the mean gap is no longer a mean.
LEAST_WEIGHT = 0.5


def _merge(owner: Indices, master: Indices, count: int) -> tuple[Indices, Indices]:
    """Master nodes of all pairs of a facet, and the places of each pair's nodes among them (local).

    Args:
        owner: Facet of each pair, ascending, shape (p,).
        master: Master nodes of the pairs, shape (p, K').
        count: Number of facets.

    Returns:
        Nodes, ascending, -1 for none, shape (count, L), and places, shape (p, K').
    """
    size = master.max(initial=0) + 1
    keys, number = np.unique((owner[:, None] * size + master).ravel(), return_inverse=True)
    facet, node = np.divmod(keys, size)
    at = np.arange(keys.size) - np.searchsorted(facet, facet)
    return padded(facet, node, count), at[number].reshape(master.shape)


def find_pairs(
    slave: Faces, master: Faces, x: Array, m: Array, share: Indices, options: MortarOptions,
    behind: BodiesBehind | None = None,
) -> FacetPairs:  # fmt: skip
    """Master facets that the slave facets ``share`` (f,) face, within the limits (local)."""
    offsets, masters = pair_kernels.find_pairs(
        x, m, slave.facets, master.facets, share, options.radius, options.min_cosine,
        behind and tuple(behind.of(share)), slave.roles and slave.roles.of(share),
    )  # fmt: skip
    owner = np.repeat(np.arange(share.size), np.diff(offsets))
    on_master = master.facets[masters]
    merged, places = _merge(owner, on_master, share.size)
    return FacetPairs(
        facets=share, offsets=offsets, slave=slave.facets[share][owner], master=on_master,
        numbers=masters, owner=owner, merged=merged, places=places,
    )  # fmt: skip


def evaluate_space(given: MortarInput) -> SpaceOperators:
    """Evaluate the mortar operators of faces at current positions (collective).

    Functions of nodes without multiplier are handed over to the others of their facets.
    """
    slave, master, x, m, multiplier_nodes, _, options, linearization, behind, *_ = given
    share, s, (n, dn) = choose_facets(given)
    if s is None:
        s = find_pairs(slave, master, x, m, share, options, behind)
    nodes, rule = slave.facets[share], triangle_rule(options.points)
    De, Me, G, B, complete = _integrate((x, n, m), nodes, s, rule)
    moments = Moments(De, Me, G, B, reference.inverse_of(Me), complete)
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
    sums = sum_over_facets(slave, nodes, D, gap, reference.covers(moments.De))
    if slave.roles is not None:
        sums["cover"][_constrained_twice(slave, slave.roles, s)] = 0.0
    if options.basis in reference.COMBINED:  # integrals of their products may be negative
        sums["diagonal"] = sums["weight"]
    count = s.num_segments
    return SpaceOperators(
        slave=slave, master=master, x=x, m=m, n=n, dn=dn, segments=s, D=D, M=M,
        **sums,
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
    nodes, masters = (np.broadcast_to(a, shape) for a in (s.slave[:, :, None], s.master[:, None]))
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
    if kind in reference.AT_VERTICES or nodes.shape[1] < 6:  # no integral is negative
        return reference.hand_over(multiplier_nodes[nodes], 3, kind)
    integrals_of = moments.De @ reference.functions_of(nodes.shape[1], kind).T
    own = sum_over_facets(slave, nodes, moments.Me, integrals_of, integrals_of)["cover"]
    carries = multiplier_nodes & (own > 0.0)
    while True:
        H = reference.hand_over(carries[nodes], 3, kind)
        given = np.einsum("fjk,fk->fj", H, moments.De)
        weight = sum_over_facets(slave, nodes, moments.Me, given, given)["cover"]
        reduced = carries & (weight < LEAST_WEIGHT * own)
        if not reduced.any():
            return H
        carries &= ~reduced


def _integrate(
    geometry: tuple[Array, Array, Array], nodes: Indices, s: FacetPairs, rule: tuple[Array, Array],
    deepest: tuple[Array, Array] | None = None,
) -> tuple[Array, Array, Array, Array, Flags]:  # fmt: skip
    """Integrals De, Me, G, B of the slave facets with ``nodes`` (f, K); whether complete (local).

    With ``deepest`` this is filled instead, see ``kernels.space.integrals``.

    The gap is nan on facets that are folded over their own plane, as in some Newton iterates: the
    residual is not finite then, and the step is cut.
    """
    count, size = nodes.shape
    De, Me, G = np.zeros((count, size)), np.zeros((count, size, size)), np.zeros((count, size))
    B = np.zeros((s.num_segments, size, s.master.shape[1]))
    complete, folded = np.zeros((2, count), bool)
    values = De, Me, G, B, complete, folded
    integrals.integrate_facets(geometry, nodes, s.master, s.offsets, rule, values, deepest)
    G[folded] = np.nan
    return De, Me, G, B, complete
