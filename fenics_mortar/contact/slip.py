# SPDX-License-Identifier: MIT
"""Slip of slave nodes relative to the material points that they faced.

At each accepted state the partners of a slave node are given by the rows of D and M over the node's
weight w_j. The distance vector of a node and its partners at new positions is

    b_j = [(D_jk / w_j)_old - s_j D_jk] x_k - [(M_jl / w_j)_old - s_j M_jl] x_l,

and the slip of the step is the change of tau_j . b_j since that state, with the present tangent
tau_j. The two measures differ in s_j:

==============  ============  ======================================================================
measure         s_j           slip u_j
==============  ============  ======================================================================
``partners``    0             tau_j . b_j minus its value at the accepted state
``operators``   1 / w_j,old   -tau_j . [(D - D_old) x - (M - M_old) x]_j / w_j,old
==============  ============  ======================================================================

"operators" is the common measure (Gitterle, Popp, Gee & Wall 2010); its b_j vanishes at the
accepted state. Both are objective. In closed contact they differ by the change of the tangential
part of the weighted gap vectors, which is small: the shear of sticking blocks differs by 5e-6; the
forces of sliding blocks and the numbers of iterations are equal.

They differ more where a gap closes in the step. The motion before closure is not slip, but both
measures count its component along the slave's tangent, and the tangents of two arcs rotate as these
flatten. With "partners", the tangent of open nodes at the accepted state is therefore the mean of
both sides. Two cylinders pressed together in one step and then sheared
(``demos.studies.accuracy.cattaneo``):

==============  ===========================================================
measure         error of the shear, relative to Cattaneo and Mindlin
==============  ===========================================================
``partners``    1.5 % (1.1 % if pressed without friction)
``operators``   39 %
==============  ===========================================================

In ironing with long steps, where one side rotates only, shear times slip is 0.05 % below the work
of the shear forces, with the slave's tangent 0.02 % above. "partners" needs no derivatives of D and
M and is also defined with constant D and M; it is the default. "operators" is for comparison.

Open nodes have partners as well: slip is counted from the points faced at the start of the step.
The partner of a node beyond the end of the master is the nearest point of the nearest master facet,
extended as a straight line; such a node has no D_old, and s_j = 0. On a rigid obstacle the partner
is the nearest point of the obstacle and moves with it; it lies along the normal, so that both
measures are equal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array, csr_array

from fenics_mortar.interface.facing import Facing, face, nearest_facets
from fenics_mortar.interface.integrals import evaluate_normals, share_of
from fenics_mortar.interface.mortar import Block, MortarOperators
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.utils.arrays import Array, Indices

Measure = Literal["partners", "operators"]
# Rows, columns and values of a matrix.
Entries = tuple[Indices, Indices, Array]


class Pairing:
    """Matrices of the partners and b_j at the accepted state, computed when first read (local).

    Without friction they are hardly ever read.

    Args:
        build: Function that returns ``D``, ``M`` and ``start`` of ``Partners``, the last without
            ``counted``.
    """

    def __init__(self, build: Callable[[], tuple[csr_array, csr_array, Array]]) -> None:
        self._build = build

    @cached_property
    def built(self) -> tuple[csr_array, csr_array, Array]:
        """D [1], M [1] and start (slave nodes,) [length] from the function, called once."""
        found = self._build()
        del self._build
        return found

    def __getstate__(self) -> dict[str, Any]:
        """The matrices, for a pickle: the function may have none (local)."""
        return {"built": self.built}


@dataclass(frozen=True)
class Partners:
    """Partners of all slave nodes at an accepted state, equal on all ranks.

    Attributes:
        pairing: ``D``, ``M`` and ``start``.
        feet: The nearest points of an obstacle in its own frame, shape (slave nodes, 2) [length].
        present: s_j, weight of the present D and M, shape (slave nodes,) [1 / length].
        counted: Slip of the step that is counted at that state, shape (slave nodes,) [length].
        shear: z_tau at that state, zero where open, shape (slave nodes,) [stress].
        pressure: z_n at that state, zero where open, shape (slave nodes,) [stress].
        gap: Mean gap at that state, inf at uncovered nodes, shape (slave nodes,) [length].
        facing: Gauss points of both sides that face each other, for pairs of two bodies with
            friction; else ``None``.
    """

    pairing: Pairing
    feet: Array
    present: Array
    counted: Array
    shear: Array
    pressure: Array
    gap: Array
    facing: Facing | None = None

    @property
    def D(self) -> csr_array:
        """Weights of slave nodes, shape (slave nodes, slave nodes), rows sum to one [1]."""
        return self.pairing.built[0]

    @property
    def M(self) -> csr_array:
        """Weights of master nodes, (slave nodes, master nodes), rows sum to one [1].

        No columns for an obstacle.
        """
        return self.pairing.built[1]

    @property
    def start(self) -> Array:
        """tau_j . b_j at that state minus the slip counted, shape (slave nodes,) [length]."""
        return self.pairing.built[2] - self.counted

    def gap_vectors(self, o: MortarOperators) -> Array:
        """Distance vectors b_j at the positions of ``o``, shape (slave nodes, 2) [length]."""
        if isinstance(o, ObstacleOperators):
            return o.x - o.obstacle.to_space(self.feet)
        gap_vectors = self.D @ o.x - self.M @ o.m
        return (
            gap_vectors - self.present[:, None] * o.vectors if self.present.any() else gap_vectors
        )

    def slip(self, o: MortarOperators) -> Array:
        """Slip since that state, shape (slave nodes,) [length]."""
        return np.einsum("ja,ja->j", o.tau, self.gap_vectors(o)) - self.start

    def derivative(self, o: MortarOperators) -> Iterator[Block]:
        """Blocks tau_j . db_j of this rank's share: rows slave nodes, columns dofs [1].

        The other term of the slip's derivative, due to the change of tau, is
        ``o.tangential_derivative(b)``.
        """
        for surface, matrix, sign in ((o.slave, self.D, 1.0), (o.master, self.M, -1.0)):
            entries = matrix.tocoo()
            mine = share_of(np.arange(entries.nnz), o.slave.comm)
            j, k = entries.row[mine].astype(np.int64), entries.col[mine].astype(np.int64)
            values = sign * entries.data[mine, None] * o.tau[j]
            yield Block(j[:, None], surface.dofs_of(k[:, None]), values[:, None])
        if self.present.any():
            yield from o.vector_derivative(-self.present[:, None] * o.tau)

    def derivative_by_motions(self, o: ObstacleOperators) -> Array:
        """Derivative of the slip with respect to obstacle motions, shape (slave nodes, 3) [1]."""
        turned = np.stack([-o.dn_dq[:, 1], o.dn_dq[:, 0]], axis=1)
        V = o.obstacle.motions(o.obstacle.to_space(self.feet), o.arm)
        return np.einsum("jam,ja->jm", turned, self.gap_vectors(o)) - np.einsum(
            "jmc,jc->jm", V, o.tau
        )

    def pairs(self) -> tuple[Indices, Indices]:
        """Slave nodes and the master nodes coupled to them, each (k,)."""
        entries = self.M.tocoo()
        return entries.row.astype(np.int64), entries.col.astype(np.int64)


def find_partners(
    o: MortarOperators,
    faces: npt.NDArray[np.bool_],
    touches: npt.NDArray[np.bool_],
    measure: Measure = "partners",
    *,
    master_planes: Array,
    between: bool = False,
) -> Partners:
    """Partners at the state of ``o`` (collective).

    Args:
        o: Operators of the accepted state.
        faces: Slave nodes with rows in D and M, shape (slave nodes,), bool.
        touches: Slave nodes in contact or with a constant tangent, shape (slave nodes,), bool.
        measure: Measure of slip, see the docstring of the module.
        master_planes: Normals of master nodes on symmetry planes, nan elsewhere, (nodes, 2).
        between: Whether to find ``Partners.facing``.
    """
    none = np.zeros(len(o.x))
    if isinstance(o, ObstacleOperators):
        feet = o.obstacle.to_own_frame(o.x + o.phi[:, None] * o.n)
        tangent = np.where(touches[:, None], o.tau, _mean_tangents(o, master_planes))
        start = np.einsum("ja,ja->j", tangent, o.x - o.obstacle.to_space(feet))
        built = csr_array(np.eye(len(o.x))), csr_array((len(o.x), 0)), start
        return Partners(Pairing(lambda: built), feet, none, none, none, none, none)
    s = o.segments
    per_weight = np.where(faces, 1.0 / np.where(faces, o.weight, 1.0), 0.0)
    on_slave = _replicate(o, o.facet_nodes, o.facet_nodes, o.D, per_weight)
    on_master = _replicate(o, s.slave, s.master, o.M, per_weight)
    present = per_weight if measure == "operators" else none
    vectors = present[:, None] * o.vectors if present.any() else 0.0  # collective

    def build() -> tuple[csr_array, csr_array, Array]:
        own, nearest = _nearest(o, np.flatnonzero(~faces))
        D, M = _sum(own, on_slave, len(o.x), len(o.x)), _sum(nearest, on_master, len(o.x), len(o.m))
        tangent = np.where(touches[:, None], o.tau, _mean_tangents(o, master_planes, M))
        return D, M, np.einsum("ja,ja->j", tangent, D @ o.x - M @ o.m - vectors)

    facing = face(o, s) if between else None
    feet = np.zeros_like(o.x)
    return Partners(Pairing(build), feet, present, none, none, none, none, facing)


def _mean_tangents(o: MortarOperators, planes: Array, M: csr_array | None = None) -> Array:
    """Mean tangents of slave nodes and the facets opposite, shape (slave nodes, 2).

    The slave's tangent is used where the nearest facet has a similar normal, as on the back of a
    plate.
    """
    n = o.n
    if M is not None and o.master.num_nodes:
        found, _ = evaluate_normals(o.master, o.m, "opposite")
        opposite = -(M @ np.where(np.isfinite(planes), planes, found))
        faces = np.einsum("ja,ja->j", n, opposite) > 0.0
        n = np.where(faces[:, None], n + opposite, n)
    n = n / np.linalg.norm(n, axis=1)[:, None]
    return np.stack([-n[:, 1], n[:, 0]], axis=1)


def _replicate(
    o: MortarOperators, rows: Indices, columns: Indices, values: Array, scale: Array
) -> Entries:
    """Entries of the blocks (b, K, K) of all ranks with scaled rows, replicated (collective)."""
    used = (values != 0.0) & (scale[rows] != 0.0)[:, :, None]
    i = np.broadcast_to(rows[:, :, None], values.shape)[used]
    k = np.broadcast_to(columns[:, None, :], values.shape)[used]
    mine = i, k, values[used] * scale[i]
    if o.slave.comm.size == 1:
        return mine
    gathered = o.slave.comm.allgather(mine)
    i, k, v = (np.concatenate(column) for column in zip(*gathered, strict=True))
    return i, k, v


def _nearest(o: MortarOperators, j: Indices) -> tuple[Entries, Entries]:
    """Entries of D and M that pair the nodes ``j`` with the line of the nearest master facet."""
    roles = o.slave.roles
    candidates = None if roles is None else roles.masters_of_nodes(o.slave.facets, j)
    ends, fraction = nearest_facets(o.x[j], o.m, o.master, candidates)
    values = np.stack([1.0 - fraction, fraction], axis=1).ravel()
    return (j, j, np.ones(j.size)), (np.repeat(j, 2), ends.ravel(), values)


def _sum(one: Entries, other: Entries, rows: int, columns: int) -> csr_array:
    """Matrix of shape (rows, columns) with the entries of both."""
    i, k, v = (np.concatenate(entries) for entries in zip(one, other, strict=True))
    return coo_array((v, (i, k)), shape=(rows, columns)).tocsr()
