# SPDX-License-Identifier: MIT
"""Slip of slave nodes relative to the material points that they faced.

At each accepted state the partners of a slave node are given by the rows of D and M over the node's
weight w_j. The distance vector of a node and its partners at new positions is

    b_j = [(D_jk / w_j)_old - s_j D_jk] x_k - [(M_jl / w_j)_old - s_j M_jl] x_l,

and the slip of the step is the length of the way that ``arcs`` finds from b_j at that state and at
present. Without relative rotation of the two surfaces it is the change of tau_j . b_j. The two
measures differ in s_j:

==============  ============  ======================================================================
measure         s_j           slip u_j without relative rotation
==============  ============  ======================================================================
``partners``    0             tau_j . b_j minus its value at the accepted state
``operators``   1 / w_j,old   -tau_j . [(D - D_old) x - (M - M_old) x]_j / w_j,old
==============  ============  ======================================================================

"operators" is the common measure (Gitterle, Popp, Gee & Wall 2010); its b_j vanishes at the
accepted state. Both are objective. In closed contact they differ by the change of the tangential
part of the weighted gap vectors, which is small: the shear of sticking blocks differs by 5e-6; the
forces of sliding blocks and the numbers of iterations are equal.

They differ more where a gap closes in the step. The motion before closure is not slip, but
"operators" counts its component along the slave's tangent, and the tangents of two arcs rotate as
these flatten. With "partners" the gap at the accepted state and half of the relative rotation
cancel it. Two cylinders pressed together in one step and then sheared
(``demos.studies.accuracy.cattaneo``):

==============  ===========================================================
measure         error of the shear, relative to Cattaneo and Mindlin
==============  ===========================================================
``partners``    1.5 % (1.1 % if pressed without friction)
``operators``   39 %
==============  ===========================================================

"partners" needs no derivatives of D and M and is also defined with constant D and M; it is the
default. "operators" is for comparison.

Open nodes have partners as well: slip is counted from the points faced at the start of the step, or
where supports turn bodies, after their motions, see ``arcs``.
The partner of a node beyond the end of the master is the nearest point of the nearest master facet,
extended as a straight line; such a node has no D_old, and s_j = 0. On a rigid obstacle the partner
is the nearest point of the obstacle and moves with it; slip is the motion of the node relative to
the obstacle, found from its pivot, with both measures. With small sliding nothing but an obstacle
rotates.

"""

from __future__ import annotations

import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from mpi4py import MPI

import numpy as np
from scipy.sparse import coo_array, csr_array, dia_array, eye, vstack

from fenics_mortar.contact.arcs import (
    Arc,
    Led,
    Orientation,
    Rotations,
    arc,
    doubt_beside_known,
    moved_by,
    orientation,
    quarter_turn,
    rotated_by,
    rotation_of_surfaces,
    rotation_past_obstacle,
    surface_rotation,
)
from fenics_mortar.interface.facing import Facing, face, nearest_on_master
from fenics_mortar.interface.integrals import evaluate_normals, share_of
from fenics_mortar.interface.mortar import Block, MortarOperators
from fenics_mortar.interface.on_obstacle import ObstacleOperators

if TYPE_CHECKING:
    from fenics_mortar.contact.pair import Measure
    from fenics_mortar.interface.curve_surface import Curve
    from fenics_mortar.obstacles.obstacle import Obstacle
    from fenics_mortar.utils.arrays import Array, Flags, Indices


class Evaluated(NamedTuple):
    """Orientation, rotations and slip at the positions of some operators, see ``arcs``.

    The orientation is ``None`` on an obstacle, and if surfaces do not rotate.
    """

    orientation: Orientation | None
    rotations: Rotations
    arc: Arc


class Entries(NamedTuple):
    """Rows, columns and values of the entries of a matrix, shape (k,) each."""

    rows: Indices
    columns: Indices
    values: Array

    def share(self, comm: MPI.Comm) -> Entries:
        """Those of this rank (local)."""
        mine = share_of(np.arange(self.rows.size), comm)
        return Entries(self.rows[mine], self.columns[mine], self.values[mine])


def entries_of(matrix: csr_array) -> Entries:
    """The entries of a sparse matrix (local)."""
    found = matrix.tocoo()
    return Entries(found.row.astype(np.int64), found.col.astype(np.int64), found.data)


def by_positions(
    o: MortarOperators, entries: tuple[Entries, Entries], vectors: Array
) -> Iterator[Block]:
    """Blocks of vectors_j . (D dx - M dm)_j of this rank, for vectors (slave nodes, dim) (local).

    ``entries``: those of D and M.
    """
    for surface, each, sign in zip((o.slave, o.master), entries, (1.0, -1.0), strict=True):
        j, k, weights = each.share(o.slave.comm)
        values = sign * weights[:, None] * vectors[j]
        yield Block(j[:, None], surface.dofs[k], values[:, None])


class Pairing:
    """What is found from an accepted state on, when it is first read (local).

    Without friction it is hardly ever read.

    Args:
        build: Function that returns ``D``, ``M``, ``start`` and ``angle`` of ``AtStart``.
    """

    def __init__(self, build: Callable[[], tuple[csr_array, csr_array, Array, Array]]) -> None:
        self._build = build
        self._last: tuple[weakref.ref[MortarOperators], Any] | None = None
        self._found: dict[str, Any] = {}

    @cached_property
    def built(self) -> tuple[csr_array, csr_array, Array, Array]:
        """D [1], M [1], start [length] and angle [radian] from the function, called once."""
        found = self._build()
        del self._build
        return found

    def __getstate__(self) -> dict[str, Any]:
        """The matrices, for a pickle: the function may have none (local)."""
        return {"built": self.built, "_last": None, "_found": {}}

    def at(self, o: MortarOperators, find: Callable[[Any], Any]) -> Any:
        """The result of the function for operators ``o``, called once for the same ones."""
        if self._last is None or self._last[0]() is not o:
            self._last = weakref.ref(o), find(o)
        return self._last[1]

    def once(self, name: str, find: Callable[[], Any]) -> Any:
        """The result of the function for a name, called once."""
        if name not in self._found:
            self._found[name] = find()
        return self._found[name]


@dataclass(frozen=True, kw_only=True)
class AtStart(ABC):
    """An accepted state, from which slip is counted, equal on all ranks.

    Attributes:
        pairing: ``D``, ``M``, ``start`` and ``angle``.
        x, m: Positions of slave and master nodes, shapes (nodes, dim) [length].
        normals: Normals of contact at that state, shape (slave nodes, dim).
        least: Diagonal entries of D above which contact closes the gap of a node, inf if a law acts
            at open gaps, shape (slave nodes,) [length], in space [area].
        present: s_j, weight of the present D and M, shape (slave nodes,) [1 / length], in space
            [1 / area].
        feet: The nearest points of an obstacle in its own frame, shape (slave nodes, dim) [length].
        place: Place of the obstacle at that state, shape (m,) [length, radian].
        counted: Slip of the step that is counted at that state, shape (slave nodes,), in space
            (slave nodes, 3) [length].
        shear: z_tau at that state, in space the tangential part of z, zero where open, shape
            (slave nodes,), in space (slave nodes, 3) [stress].
        pressure: z_n at that state, zero where open, shape (slave nodes,) [stress].
        gap: Mean gap at that state, inf at uncovered nodes, shape (slave nodes,) [length].
        facing: Gauss points of both sides that face each other, for pairs of two bodies with
            friction; else ``None``.
        turns: ``Contact.turns`` at that state; empty if no rigid boundary leads a body.
        led: Nodes whose partners are those after motions that lead bodies, see ``arcs``.
    """

    pairing: Pairing
    x: Array
    m: Array
    normals: Array
    least: Array
    present: Array
    feet: Array
    place: Array
    counted: Array
    shear: Array
    pressure: Array
    gap: Array
    facing: Facing | None = None
    turns: tuple[Array, ...] = ()
    led: Led | None = None

    def led_by(self, there: Self, led: Led) -> Self:
        """These partners, with those ``there``, found after the motions, at new nodes (local)."""

        def build() -> tuple[csr_array, csr_array, Array, Array]:
            D, M, start, angle = zip(self.pairing.built, there.pairing.built, strict=True)
            at_new = led.origin(*start), led.origin(*angle)
            return rows_of(led.new, *D), rows_of(led.new, *M), *at_new

        rows: dict[str, Any] = {
            name: led.origin(getattr(self, name), getattr(there, name)) for name in OF_PARTNERS
        }
        return replace(self, pairing=Pairing(build), led=led, **rows)

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
        """r_0 of ``arcs``: b_j, or vectors from the pivot, (slave nodes, dim) [length]."""
        return self.pairing.built[2]

    @property
    def entries(self) -> tuple[Entries, Entries]:
        """Entries of D and M."""
        return self.pairing.once("entries", lambda: (entries_of(self.D), entries_of(self.M)))

    def gap_vectors(self, o: Any) -> Array:
        """Vectors from partners to nodes at positions of ``o``, (slave nodes, dim) [length]."""
        if isinstance(o, ObstacleOperators):
            return np.asarray(o.x - o.obstacle.to_space(self.feet))
        return np.asarray(self.D @ o.x - self.M @ o.m)

    def vectors(self, o: Any) -> Array:
        """R of ``arcs``: b_j, or vectors from the pivot, (slave nodes, dim) [length].

        Collective between surfaces at the first access to ``o.vectors``.
        """
        if isinstance(o, ObstacleOperators):
            return o.x - centre_of(o.obstacle)
        r = self.gap_vectors(o)
        return r - self.present[:, None] * o.vectors if self.present.any() else r

    def by_vectors(self, o: Any, by_vector: Array, along: Array) -> Iterator[Block]:
        """Blocks of by_vector_j . dr_j + along_j . dV_j of this rank, V as in ``arcs`` (local).

        Args:
            o: Operators.
            by_vector: Shape (slave nodes, dim) [1].
            along: Directions of slip, shape (slave nodes, dim) [1].
        """
        yield from by_positions(o, self.entries, by_vector)
        if self.led is not None:  # along . (w x dx) = -(w x along) . dx
            own = o.slave.owned[self.led.new[o.slave.owned]]
            values = -0.5 * moved_by(self.led.turn[own], along[own])
            yield Block(own[:, None], o.slave.dofs[own], values[:, None])
        if self.present.any():
            yield from o.vector_derivative(-self.present[:, None] * by_vector)

    def at(self, o: Any) -> Any:
        """Rotations and slip since that state, without ``counted``: the result of ``_evaluate``.

        Collective between surfaces at the first access to ``o.vectors``, local past an obstacle.
        """
        return self.pairing.at(o, self._evaluate)

    @abstractmethod
    def _evaluate(self, o: Any) -> Any:
        """Slip at operators ``o``: ``Evaluated``, in space ``Screw`` or ``PastObstacle``."""


# Attributes of partners that are those after motions at nodes of ``Led.new``.
OF_PARTNERS = ("normals", "present", "feet")


def accepted(
    o: Any, per_weight: Array, measure: Measure, least: Array, angle: Callable[[csr_array], Array]
) -> dict[str, Any]:
    """Fields of ``AtStart`` at the state of operators, which counts no slip (collective).

    Args:
        o: Operators of the accepted state.
        per_weight: 1 / w_j of slave nodes with rows in D and M, else 0, shape (slave nodes,)
            [1 / length], in space [1 / area].
        measure: Measure of slip, see above.
        least: See ``AtStart``.
        angle: Function of ``M`` that returns ``angle``.
    """
    none, moves = np.zeros(len(o.x)), np.zeros_like(o.x)
    given = {"x": o.x, "m": o.m, "normals": o.n, "least": least}
    given |= {"shear": none, "pressure": none, "gap": none, "present": none}
    given |= {"counted": none if o.slave.dim == 2 else moves, "feet": moves, "place": np.zeros(0)}
    if isinstance(o, ObstacleOperators):
        given |= {"feet": o.obstacle.to_own_frame(o.nearest_points())}
        ends = csr_array(eye(len(o.x))), csr_array((len(o.x), 0)), o.x - centre_of(o.obstacle), none
        return given | {"pairing": Pairing(lambda: ends), "place": o.obstacle.place.copy()}
    if o.slave.comm.size > 1:
        _ = o.matrices  # collective
    present = per_weight if measure == "operators" else none

    def build() -> tuple[csr_array, csr_array, Array, Array]:
        D, M = weights_of_partners(o, per_weight)
        return D, M, np.where(present[:, None] != 0.0, 0.0, D @ o.x - M @ o.m), angle(M)

    return given | {"pairing": Pairing(build), "present": present}


@dataclass(frozen=True, kw_only=True)
class Partners(AtStart):
    """Partners of all slave nodes at an accepted state, equal on all ranks.

    Attributes:
        planes: Normals of master nodes on symmetry planes, nan elsewhere, (master nodes, 2);
            ``None`` if surfaces do not rotate, with small sliding.
        weight: Weights w_j at that state, shape (slave nodes,) [length].
    """

    planes: Array | None
    weight: Array

    @property
    def angle(self) -> Array:
        """``Orientation.angle`` at that state, (slave nodes,) [radian]; zero on an obstacle."""
        return self.pairing.built[3]

    def doubt(self, o: MortarOperators, turns: tuple[Array, ...], active: Flags) -> Array:
        """Difference between the rotations of ``arc`` and those that are known, (n,) [radian].

        Local. ``Rotations.doubt`` where no rigid boundary tells by how much a body has turned.

        Args:
            o: Operators.
            turns: ``Contact.turns`` at their positions.
            active: Nodes in contact, shape (n,), bool.
        """
        theta = self.relative_turn(o)
        ends = zip(turns, self.turns, strict=True)
        known = [(now - then)[:, 0] for now, then in ends]
        if isinstance(o, ObstacleOperators):
            doubt = self._from_start(o).doubt
            if not turns:
                return doubt
            relative = float(o.obstacle.place[2] - self.place[2]) - known[0]
            return np.where(np.isnan(known[0]), doubt, np.abs(theta - relative))
        if not turns:
            return rotation_of_surfaces(theta, np.zeros_like(theta)).doubt
        slave, master = map(np.nan_to_num, known)
        apart = np.abs(theta - (self.M @ master - slave))
        return doubt_beside_known(np.abs(theta), apart, active & (self.pressure != 0.0))

    def relative_turn(self, o: MortarOperators) -> Array:
        """Rotation of the master relative to the slave since that state, (n,) [radian] (local)."""
        theta = self.at(o).rotations.theta
        return theta if self.led is None else theta - self.led.turn[:, 0]

    def _from_start(self, o: ObstacleOperators) -> Rotations:
        """Rotations past an obstacle since that state, led or not (local)."""
        body = np.zeros(len(o.x))
        if self.planes is not None:
            body = surface_rotation(o.slave, self.x, o.x)
        return rotation_past_obstacle(body, float(o.obstacle.place[2] - self.place[2]))

    def _past_obstacle(self, o: ObstacleOperators) -> Rotations:
        """Rotations of ``arc`` past an obstacle: at led nodes, those after the motions (local)."""
        found = self._from_start(o)
        if self.led is None:
            return found
        body = surface_rotation(o.slave, self.led.x, o.x)
        after = rotation_past_obstacle(body, float(o.obstacle.place[2] - self.led.place[2]))
        return Rotations(*map(self.led.origin, found, after))

    def _evaluate(self, o: MortarOperators) -> Evaluated:
        if isinstance(o, ObstacleOperators):
            now, turned = None, self._past_obstacle(o)
            start = rotated_by(o.n, -turned.beta)
        else:
            now = None if self.planes is None else orientation(o, self.M, self.planes)
            turned = rotation_of_surfaces(self.angle if now is None else now.angle, self.angle)
            start = self.normals
        ends = (self.vectors(o), o.n), (self.start, start)
        found = arc(*ends, turned.theta, turned.beta, self._closed(o))
        if self.led is not None:  # tau . V
            way = self.led.way_at(o.x)
            along, across = (np.einsum("jc,jc->j", v, way) for v in (quarter_turn(o.n), o.n))
            found = found._replace(slip=found.slip + along, by_normal=found.by_normal - across)
        return Evaluated(now, turned, found)

    def _closed(self, o: MortarOperators) -> Array:
        """Mean gaps that contact closes, zero elsewhere, shape (slave nodes,) [length] (local)."""
        on = o.diagonal > self.least
        return np.where(on, o.gap / np.where(on, o.weight, 1.0), 0.0)

    def slip(self, o: MortarOperators) -> Array:
        """Slip since that state, shape (slave nodes,) [length]."""
        return self.at(o).arc.slip + self.counted

    def rotated(self, o: MortarOperators) -> Array:
        """Vectors v_j so that d(tau_j) . v_j is the change of slip by dn_j, (n, 2) [length]."""
        return -_by_normal(o, self.at(o).arc)[:, None] * o.n

    def derivative(self, o: MortarOperators) -> Iterator[Block]:
        """Blocks of the slip's derivative of this rank: rows slave nodes, columns dofs [1].

        The other terms are ``o.tangential_derivative(self.rotated(o))``, due to the rotation of the
        contact normals, and ``Arc.by_gap`` times the derivative of the mean gap.
        """
        now, _, found = self.at(o)
        yield from self.by_vectors(o, found.by_vector, quarter_turn(o.n))
        if self.planes is None or not o.linearization.normals:
            return
        if isinstance(o, ObstacleOperators):
            yield rotation_derivative(o, found.by_body)
        elif now is not None:
            yield from self.by_angle(o, now, found.by_angle)

    def by_angle(self, o: MortarOperators, at: Orientation, weights: Array) -> Iterator[Block]:
        """Blocks of weights_j times the derivative of ``Orientation.angle``, of this rank.

        Args:
            o: Operators of the positions of ``at``.
            at: The angle and its parts.
            weights: Shape (slave nodes,) [length].
        """
        yield _of_normals(o, (at.slave, at.d_slave), -weights)
        j, l, share = self.entries[1].share(o.slave.comm)
        along = share[:, None] * (weights[:, None] * at.by_partners)[j]
        values = np.einsum("bc,bcq->bq", along, at.d_master[l])
        yield Block(j[:, None], o.master.near_dofs[l, : values.shape[1]], values[:, None])

    def derivative_by_motions(self, o: ObstacleOperators) -> Array:
        """Derivative of the slip by obstacle motions at constant gap, (slave nodes, 3) [1]."""
        found = self.at(o).arc
        tau = quarter_turn(o.n)
        turned = np.einsum("jam,ja->jm", o.dn_dq, tau) * _by_normal(o, found)[:, None]
        by_angle = found.by_rotation / o.arm
        return turned + np.column_stack([-found.by_vector, by_angle])

    def pairs(self, o: MortarOperators) -> tuple[Indices, Indices]:
        """Slave nodes and the master nodes coupled to them, each (k,).

        With rotations slip depends on the normals at the partners, and so on the nodes beside.
        """
        return self.pairing.once("pairs", lambda: self._pairs(o.master))

    def _pairs(self, master: Curve) -> tuple[Indices, Indices]:
        j, l, _ = self.entries[1]
        if self.planes is None:
            return j, l
        near = master.along(l, range(-master.degree, master.degree + 1))
        coupled = (j[:, None] * master.num_nodes + near)[near >= 0]
        return np.divmod(np.unique(coupled), master.num_nodes)


def rows_of(new: Flags, rows: csr_array, led: csr_array) -> csr_array:
    """A matrix with the rows of ``led`` at ``new`` (n,), bool, and of ``rows`` elsewhere."""
    chosen = np.where(new, len(new), 0) + np.arange(len(new))
    return csr_array(vstack([rows, led], format="csr")[chosen])


def _by_normal(o: MortarOperators, found: Arc) -> Array:
    """Derivative of the slip with respect to a rotation of n, (slave nodes,) [length].

    On an obstacle n_0 is n turned back with the slave's material, since nodes may pass its surface.
    """
    on_obstacle = isinstance(o, ObstacleOperators)
    return found.by_normal + found.by_start_normal if on_obstacle else found.by_normal


def rotation_derivative(o: MortarOperators, weights: Array) -> Block:
    """Weights (slave nodes,) times the derivative of the angle of the slave, owned nodes [weights].

    The block has a row per node.
    """
    return _of_normals(o, evaluate_normals(o.slave, o.x, "opposite"), weights)


def _of_normals(o: MortarOperators, normals: tuple[Array, Array], weights: Array) -> Block:
    """As ``rotation_derivative``, with the averaged normals and their derivatives."""
    (s, ds), own = normals, o.slave.owned
    values = np.einsum("jc,jcq->jq", (weights[:, None] * quarter_turn(s))[own], ds[own])
    return Block(own[:, None], o.slave.near_dofs[own, : ds.shape[2]], values[:, None])


def centre_of(obstacle: Obstacle) -> Array:
    """Present position of the pivot of an obstacle, shape (dim,) [length]."""
    return np.asarray(obstacle.pivot + obstacle.place[: obstacle.dim])


def find_partners(
    o: Any,
    per_weight: Array,
    measure: Measure,
    *,
    least: Array,
    master_planes: Array | None,
    between: bool,
) -> Partners:
    """Partners at the state of ``o`` (collective).

    Args:
        o: Operators of the accepted state.
        per_weight: See ``accepted``.
        measure: Measure of slip.
        least: See ``AtStart``.
        master_planes: Normals of master nodes on symmetry planes, nan elsewhere, (nodes, 2);
            ``None`` if surfaces do not rotate.
        between: Whether to find ``Partners.facing``.
    """

    def angle(M: csr_array) -> Array:
        return none if master_planes is None else orientation(o, M, master_planes).angle

    none = np.zeros(len(o.x))
    given = accepted(o, per_weight, measure, least, angle)
    if between and not isinstance(o, ObstacleOperators):
        given |= {"facing": face(o, o.segments)}
    return Partners(planes=master_planes, weight=o.weight, **given)


def weights_of_partners(o: MortarOperators, per_weight: Array) -> tuple[csr_array, csr_array]:
    """D and M over the weights; at nodes without partners those of the nearest points.

    Rows sum to one [1]. Collective at the first access to ``o.matrices``.
    """
    scale = dia_array((per_weight[None], [0]), shape=(len(o.x),) * 2)
    D, M = (csr_array(scale @ matrix) for matrix in o.matrices)
    j = np.flatnonzero(per_weight == 0.0)
    nodes, weights = nearest_on_master(o, j)
    at = np.repeat(j, nodes.shape[1]), nodes.ravel()
    D = csr_array(D + coo_array((np.ones(j.size), (j, j)), shape=D.shape))
    return D, csr_array(M + coo_array((weights.ravel(), at), shape=M.shape))
