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
accepted state. In space it is the only one where D and M change. Both are objective. In closed
contact they differ by the change of the tangential part of the weighted gap vectors, which is
small: the shear of sticking blocks differs by 5e-6; the forces of sliding blocks and the numbers of
iterations are equal.

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
where supports turn bodies, after their motions, see ``arcs``. The partner of a node beyond the end
of the master is the nearest point of the nearest master facet, extended as a straight line; such a
node has no D_old, and s_j = 0. On a rigid obstacle the partner is the nearest point of the obstacle
and moves with it; slip is the motion of the node relative to the obstacle, found from its pivot,
with both measures. With small sliding nothing but an obstacle rotates.
"""

from __future__ import annotations

import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from scipy.sparse import coo_array, csr_array, dia_array, eye, vstack

from fenics_mortar.contact import arcs
from fenics_mortar.interface.facing import Facing, nearest_on_master
from fenics_mortar.interface.integrals import evaluate_normals, share_of
from fenics_mortar.interface.mortar import Block, MortarOperators
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.obstacles.rigid_motion import inverse_jacobians, turns_between
from fenics_mortar.utils.arrays import ROUNDING, TINY, Array, Flags, Indices, at_rows, norms

if TYPE_CHECKING:
    from mpi4py import MPI

    from fenics_mortar.contact.fields import ContactFields
    from fenics_mortar.interface.curve_surface import Curve
    from fenics_mortar.interface.outline import Outline


def entries_of(matrix: csr_array, comm: MPI.Comm | None = None) -> tuple[Indices, Indices, Array]:
    """Rows, columns and values [of the matrix] of all entries, (k,) each (local).

    Given a communicator, those of the share of this rank.
    """
    found = matrix.tocoo()
    mine = np.arange(found.nnz)
    mine = mine if comm is None else share_of(mine, comm)
    return found.row[mine].astype(np.int64), found.col[mine].astype(np.int64), found.data[mine]


def by_positions(
    o: MortarOperators, matrices: tuple[csr_array, csr_array], vectors: Array
) -> Iterator[Block]:
    """Blocks of vectors_j . (D dx - M dm)_j of this rank, for vectors (slave nodes, dim) (local).

    ``matrices``: D and M.
    """
    for surface, matrix, sign in zip((o.slave, o.master), matrices, (1.0, -1.0), strict=True):
        j, k, weights = entries_of(matrix, o.slave.comm)
        values = sign * weights[:, None] * vectors[j]
        yield Block(j[:, None], surface.dofs[k], values[:, None])


class Pairing(NamedTuple):
    """Partners of the slave nodes.

    Attributes:
        D: Weights of slave nodes, shape (slave nodes, slave nodes), rows sum to one [1].
        M: Weights of master nodes, (slave nodes, master nodes), rows sum to one [1]; no columns for
            an obstacle.
        start: r_0 of ``arcs``: b_j, or vectors from the pivot, (slave nodes, dim) [length].
        angle: ``Orientation.angle`` at that state, (slave nodes,) [radian]; zero on an obstacle and
            in space.
    """

    D: csr_array
    M: csr_array
    start: Array
    angle: Array


@dataclass(frozen=True, kw_only=True)
class Partners(ABC):
    """Partners of all slave nodes at an accepted state, from which slip is counted.

    Equal on all ranks.

    Attributes:
        pairing: Function that returns the ``Pairing``, evaluated in its first call: without
            friction it is hardly ever called, and it takes a twentieth of the time of a step.
        D, M, start, angle: See ``Pairing``.
        x, m: Positions of slave and master nodes, shapes (nodes, dim) [length].
        normals: Normals of contact at that state, shape (slave nodes, dim).
        weight: Weights w_j at that state, zero without rows, (slave nodes,) [length], in space
            [area].
        least: Diagonal entries of D above which contact closes the gap of a node, inf if a law acts
            at open gaps, shape (slave nodes,) [length], in space [area].
        present: s_j, weight of the present D and M, shape (slave nodes,) [1 / length], in space
            [1 / area].
        planes: ``Contact.across_planes`` at that state.
        feet: The nearest points of an obstacle in its own frame, shape (slave nodes, dim) [length].
        place: Place of the obstacle at that state, shape (m,) [length, radian].
        counted: Slip of the step that is counted at that state, shape (slave nodes,), in space
            (slave nodes, 3) [length].
        shear: z_tau at that state, in space the tangential part of z, zero where open, shape
            (slave nodes,), in space (slave nodes, 3) [stress].
        pressure: z_n at that state, zero where open, shape (slave nodes,) [stress].
        gap: Mean gap at that state, inf at uncovered nodes, shape (slave nodes,) [length].
        facing: Gauss points of both sides that face each other, for pairs of two bodies in the
            plane with friction; else ``None``.
        turns: ``Contact.turns`` at that state; empty if no rigid boundary leads a body.
        led: Nodes whose partners are those after motions that lead bodies, see ``arcs``.
    """

    pairing: Callable[[], Pairing]
    x: Array
    m: Array
    normals: Array
    weight: Array
    least: Array
    present: Array
    planes: Any
    feet: Array
    place: Array
    counted: Array
    shear: Array
    pressure: Array
    gap: Array
    facing: Facing | None = None
    turns: tuple[Array, ...] = ()
    led: arcs.Led | None = None
    _found: dict[str, Any] = field(default_factory=dict, init=False, repr=False)

    D = property(lambda self: self.pairing().D)
    M = property(lambda self: self.pairing().M)
    start = property(lambda self: self.pairing().start)
    angle = property(lambda self: self.pairing().angle)

    def __getstate__(self) -> dict[str, Any]:
        """The attributes, for a pickle: without surfaces, which belong to a communicator."""
        return {**vars(self), "pairing": partial(Pairing, *self.pairing()), "_found": {}}

    def at(self, o: Any) -> Any:
        """Rotations and slip since that state, without ``counted``: the result of ``_evaluate``.

        Collective between surfaces at the first access to ``o.vectors``, local past an obstacle.
        Evaluated once for the same operators.
        """
        of, found = self._found.get("at", (None, None))
        if of is None or of() is not o:
            found = self._evaluate(o)
            self._found["at"] = weakref.ref(o), found
        return found

    def led_by(self, there: Self, led: arcs.Led) -> Self:
        """These partners, with those ``there``, found after the motions, at new nodes (local)."""
        rows: dict[str, Any] = {
            name: led.origin(getattr(self, name), getattr(there, name)) for name in OF_PARTNERS
        }
        D, M = (rows_of(led.new, *both) for both in ((self.D, there.D), (self.M, there.M)))
        pairing = partial(Pairing, D, M, rows.pop("start"), rows.pop("angle"))
        return replace(self, pairing=pairing, led=led, **rows)

    def gap_vectors(self, o: Any) -> Array:
        """Vectors from partners to nodes at positions of ``o``, (slave nodes, dim) [length]."""
        if isinstance(o, ObstacleOperators):
            return np.asarray(o.x - o.obstacle.to_space(self.feet))
        return np.asarray(self.D @ o.x - self.M @ o.m)

    def vectors(self, o: Any) -> Array:
        """Vectors r of ``arcs``: b_j, or those from the pivot, (slave nodes, dim) [length].

        Collective between surfaces at the first access to ``o.vectors``.
        """
        if isinstance(o, ObstacleOperators):
            return np.asarray(o.x - o.obstacle.present_pivot)
        r = self.gap_vectors(o)
        return r - self.present[:, None] * o.vectors if self.present.any() else r

    def by_vectors(self, o: Any, by_vector: Array, along: Array) -> Iterator[Block]:
        """Blocks of by_vector_j . dr_j + along_j . dV_j of this rank, V as in ``arcs`` (local).

        Args:
            o: Operators.
            by_vector: Shape (slave nodes, dim) [any unit].
            along: Factors of the vectors of slip, shape (slave nodes, dim) [any unit].
        """
        yield from by_positions(o, (self.D, self.M), by_vector)
        if self.led is not None:  # along . (w x dx) = -(w x along) . dx
            own = o.slave.owned[self.led.new[o.slave.owned]]
            values = -0.5 * arcs.moved_by(self.led.turn[own], along[own])
            yield Block(own[:, None], o.slave.dofs[own], values[:, None])
        if self.present.any():
            yield from o.vector_derivative(-self.present[:, None] * by_vector)

    @abstractmethod
    def _evaluate(self, o: Any) -> Any:
        """Slip at operators ``o``: ``Evaluated``, in space ``Screw`` or ``PastObstacle``."""


# Attributes of partners that are those after motions at nodes of ``Led.new``.
OF_PARTNERS = ("start", "angle", "normals", "present", "feet")


class Evaluated(NamedTuple):
    """Orientation, rotations and slip at the positions of some operators, see ``arcs``.

    The orientation is ``None`` on an obstacle, and if surfaces do not rotate.
    """

    orientation: arcs.Orientation | None
    rotations: arcs.Rotations
    arc: arcs.Arc


class PlanePartners(Partners):
    """Partners of slave nodes in the plane."""

    def doubt(self, o: MortarOperators, turns: tuple[Array, ...], active: Flags) -> Array:
        """Difference between the rotations of ``arcs`` and those that are known, (n,) [radian].

        Local. Where no rigid boundary determines the turn of a body, it is ``Rotations.doubt``.

        Args:
            o: Operators.
            turns: ``Contact.turns`` at their positions.
            active: Nodes in contact, shape (n,), bool.
        """
        theta = self.relative_turn(o)
        known = [(now - then)[:, 0] for now, then in zip(turns, self.turns, strict=True)]
        if isinstance(o, ObstacleOperators):
            doubt = self._past_obstacle(o, self).doubt
            if not turns:
                return doubt
            relative = float(o.obstacle.place[2] - self.place[2]) - known[0]
            return np.where(np.isnan(known[0]), doubt, np.abs(theta - relative))
        if not turns:
            return arcs.rotation_of_surfaces(theta, np.zeros_like(theta)).doubt
        slave, master = map(np.nan_to_num, known)
        apart = np.abs(theta - (self.M @ master - slave))
        return arcs.doubt_beside_known(np.abs(theta), apart, active & (self.pressure != 0.0))

    def relative_turn(self, o: MortarOperators) -> Array:
        """Rotation of the master relative to the slave since that state, (n,) [radian] (local)."""
        theta = self.at(o).rotations.theta
        return theta if self.led is None else theta - self.led.turn[:, 0]

    def _past_obstacle(self, o: ObstacleOperators, since: Self | arcs.Led) -> arcs.Rotations:
        """Rotations past an obstacle since that state, or since the motions (local)."""
        body = np.zeros(len(o.x))
        if self.planes is not None:
            body = arcs.surface_rotation(o.slave, since.x, o.x)
        return arcs.rotation_past_obstacle(body, float(o.obstacle.place[2] - since.place[2]))

    def _evaluate(self, o: MortarOperators) -> Evaluated:
        if isinstance(o, ObstacleOperators):
            now, turned = None, self._past_obstacle(o, self)
            if self.led is not None:
                after = self._past_obstacle(o, self.led)
                turned = arcs.Rotations(*map(self.led.origin, turned, after))
            start = arcs.rotated_by(o.n, -turned.beta)
        else:
            now = None if self.planes is None else arcs.orientation(o, self.M, self.planes)
            angle = self.angle if now is None else now.angle
            turned, start = arcs.rotation_of_surfaces(angle, self.angle), self.normals
        ends = (self.vectors(o), o.n), (self.start, start)
        found = arcs.arc(*ends, turned.theta, turned.beta, self._closed(o))
        if self.led is not None:  # tau . V
            way = self.led.way_at(o.x)
            along, across = (np.einsum("jc,jc->j", v, way) for v in (arcs.quarter_turn(o.n), o.n))
            found = found._replace(slip=found.slip + along, by_normal=found.by_normal - across)
        return Evaluated(now, turned, found)

    def _closed(self, o: MortarOperators) -> Array:
        """Mean gaps that contact closes, zero elsewhere, shape (slave nodes,) [length] (local)."""
        on = o.diagonal > self.least
        return np.where(on, o.gap / np.where(on, o.weight, 1.0), 0.0)

    def slip(self, o: MortarOperators) -> Array:
        """Slip since that state, shape (slave nodes,) [length]."""
        return self.at(o).arc.slip + self.counted

    def by_normal(self, o: MortarOperators) -> Array:
        """Derivative of the slip by the normal, shape (n, 2) [length].

        On an obstacle n_0 is n turned back with the slave's material, since nodes may pass its
        surface.
        """
        found, on_obstacle = self.at(o).arc, isinstance(o, ObstacleOperators)
        by_turn = found.by_normal + found.by_start_normal if on_obstacle else found.by_normal
        return np.asarray(by_turn[:, None] * arcs.quarter_turn(o.n))

    def derivative(self, o: MortarOperators, along: Array) -> Iterator[Block]:
        """Blocks of this rank of the derivative of the slip at constant mean gaps, times ``along``.

        Rows are slave nodes, columns displacement dofs; ``along`` has the shape of the slip [any].
        The other term is ``Arc.by_gap`` times the derivative of the mean gap.
        """
        (now, _, found), factor, own = self.at(o), along[:, None], o.slave.owned
        turned = o.normal_derivative(factor * self.by_normal(o))[own]
        yield Block(own[:, None], o.normal_columns()[own], turned[:, None])
        yield from self.by_vectors(o, factor * found.by_vector, factor * arcs.quarter_turn(o.n))
        if self.planes is None or not o.linearization.normals:
            return
        if isinstance(o, ObstacleOperators):
            normals = evaluate_normals(o.slave, o.x, "opposite")
            yield rotation_derivative(o, normals, along * found.by_body)
        else:
            yield from self.by_angle(o, now, along * found.by_angle)

    def by_angle(self, o: MortarOperators, at: arcs.Orientation, weights: Array) -> Iterator[Block]:
        """Blocks of weights_j times the derivative of ``Orientation.angle``, of this rank.

        Args:
            o: Operators of the positions of ``at``.
            at: The angle and its parts.
            weights: Shape (slave nodes,) [length].
        """
        yield rotation_derivative(o, (at.slave, at.d_slave), -weights)
        j, l, share = entries_of(self.M, o.slave.comm)
        along = share[:, None] * (weights[:, None] * at.by_partners)[j]
        values = np.einsum("bc,bcq->bq", along, at.d_master[l])
        yield Block(j[:, None], o.master.near_dofs[l, : values.shape[1]], values[:, None])

    def derivative_by_motions(self, o: ObstacleOperators) -> Array:
        """Derivative of the slip by obstacle motions at constant gap, (slave nodes, 3) [1]."""
        found = self.at(o).arc
        turned = np.einsum("jam,ja->jm", o.dn_dq, self.by_normal(o))
        return turned + np.column_stack([-found.by_vector, found.by_rotation / o.arm])

    def pairs(self, o: MortarOperators) -> tuple[Indices, Indices]:
        """Slave nodes and the master nodes coupled to them, each (k,).

        With rotations slip depends on the normals at the partners, and so on the nodes beside.
        """
        j, l, _ = entries_of(self.M)
        if self.planes is None:
            return j, l
        master: Curve = o.master
        near = master.along(l, range(-master.degree, master.degree + 1))
        coupled = (j[:, None] * master.num_nodes + near)[near >= 0]
        return np.divmod(np.unique(coupled), master.num_nodes)


class SpacePartners(Partners):
    """Partners of slave nodes in space."""

    def slip(self, o: Any) -> Array:
        """Slip since that state, shape (slave nodes, 3) [length]; collective as ``at``."""
        return self.at(o).slip + self.counted + (0.0 if self.led is None else self.led.way_at(o.x))

    def materials(self, o: Any) -> list[arcs.Material]:
        """Materials of the slave at its nodes, and of a master surface at the partners (local).

        Without rotations if ``planes`` is ``None``.
        """
        if "materials" in self._found:
            return self._found["materials"]
        weights, starts = [csr_array(eye(len(self.x))), self.M], (self.x, self.m)
        led, mirrored = self.led, self.planes
        if mirrored is None:
            weights = [csr_array(each.shape) for each in weights]
            mirrored = [np.zeros(x.shape, bool) for x in starts]
        after = (None, None) if led is None else ((led.new, led.x), (led.new, led.m))
        sides = zip(weights, (o.slave, o.master), starts, mirrored, after, strict=True)
        found = [arcs.Material(*side) for side in sides if side[1].num_nodes]
        self._found["materials"] = found
        return found

    def _evaluate(self, o: Any) -> arcs.Screw | arcs.PastObstacle:
        sides = zip(self.materials(o), (o.x, o.m), strict=False)
        slave, *masters = (side.turned(x) for side, x in sides)
        ends = self.vectors(o), self.start
        if isinstance(o, ObstacleOperators):
            return arcs.past_obstacle(*ends, slave, self.turns_past(o))
        return arcs.screw(*ends, slave, *masters)

    def derivative(self, o: Any, along: Array) -> Iterator[Block]:
        """See ``PlanePartners``: blocks of along_j . ds_j, ``along`` (slave nodes, 3) [any]."""
        found = self.at(o)
        by_vector, *by_spins = found.weights(along)
        yield from self.by_vectors(o, by_vector, along)
        if self.planes is not None and o.linearization.normals:
            sides = (found.slave,) if len(by_spins) == 1 else (found.slave, found.master)
            turned = zip(self.materials(o), sides, by_spins, strict=True)
            yield from (material.rows(at.by_products(spin)) for material, at, spin in turned)

    def derivative_by_motions(self, o: ObstacleOperators) -> Array:
        """See ``PlanePartners``, shape (slave nodes, 3, 6) [1]."""
        found, spin = self.at(o), inverse_jacobians(self.turns_past(o))
        return np.concatenate([-found.by_vector, found.by_relative @ spin / o.arm], axis=2)

    def pairs(self, o: Any) -> tuple[Indices, Indices]:
        """See ``PlanePartners``, each (k,)."""
        turns = self.planes is not None and o.master.num_nodes
        return self.materials(o)[1].pairs if turns else entries_of(self.M)[:2]

    def doubt(self, o: Any, turns: tuple[Array, ...], active: Flags) -> Array:
        """See ``PlanePartners``, (n,) [radian].

        Collective at the first access to ``o.vectors``.
        """
        if isinstance(o, ObstacleOperators):
            of_step = self.unled().at(o)
            if not turns:
                return of_step.doubt
            known, _ = _turned(self.turns, turns)
            return np.where(np.isnan(known[:, 0]), of_step.doubt, norms(of_step.of_slave - known))
        found, led = self.at(o), self.led
        L, _ = arcs.vectors_of(found.slave.Q.swapaxes(1, 2) @ found.master.Q)
        if not turns:
            return found.doubt if led is None else norms(L - led.turn)
        doubt = norms(L - self._known(self.turns, turns))
        if led is not None:
            doubt = led.origin(doubt, norms(L - self._known(led.turns, turns)))
        return arcs.doubt_beside_known(norms(L), doubt, active & (self.pressure != 0.0))

    def _known(self, before: tuple[Array, ...], now: tuple[Array, ...]) -> Array:
        """Turns of the partners past the nodes between two results of ``Contact.turns`` (local)."""
        slave, master = (np.nan_to_num(turn) for turn in _turned(before, now))
        return turns_between(slave, np.asarray(self.M @ master), own=True)

    def unled(self) -> Self:
        """These partners without motions that lead bodies; rotations are those of the step."""
        return self if self.led is None else replace(self, led=None)

    def rotation_of_slave(self, o: Any) -> Array:
        """Rotations of the slave's material since that state, led or not, (n, 3, 3) [1] (local)."""
        return self.unled().materials(o)[0].turned(o.x).Q

    def carried_derivative(self, o: Any, carried: Array, along: Array) -> Iterator[Block]:
        """Blocks of along_j . dv_j, of this rank, for vectors that turn with the slave.

        Args:
            o: Operators.
            carried: The vectors v, turned since that state, shape (slave nodes, 3) [any].
            along: Shape (slave nodes, 3) [any].
        """
        if self.planes is not None and o.linearization.normals:
            material = self.unled().materials(o)[0]
            yield material.rows(material.turned(o.x).by_products(np.cross(carried, along)))

    def turns_past(self, o: ObstacleOperators) -> Array:
        """``turn`` at each node, of led ones since the motions, (slave nodes, 3) [radian]."""
        turn, led = np.tile(o.obstacle.turn_since(self.place), (len(self.x), 1)), self.led
        return turn if led is None else led.origin(turn, o.obstacle.turn_since(led.place)[None])


def _turned(before: tuple[Array, ...], now: tuple[Array, ...]) -> list[Array]:
    """Known rotation vectors of both sides between two results of ``Contact.turns`` (local)."""
    return [turns_between(*ends) for ends in zip(before, now, strict=True)]


def rows_of(new: Flags, rows: csr_array, led: csr_array) -> csr_array:
    """A matrix with the rows of ``led`` at ``new`` (n,), bool, and of ``rows`` elsewhere."""
    chosen = np.where(new, len(new), 0) + np.arange(len(new))
    return csr_array(vstack([rows, led], format="csr")[chosen])


def rotation_derivative(o: MortarOperators, normals: tuple[Array, Array], weights: Array) -> Block:
    """Weights (slave nodes,) times the derivative of the angle of the slave, owned nodes [weights].

    The block has a row per node. ``normals``: averaged normals and their derivatives, see
    ``evaluate_normals``.
    """
    (s, ds), own = normals, o.slave.owned
    values = np.einsum("jc,jcq->jq", (weights[:, None] * arcs.quarter_turn(s))[own], ds[own])
    return Block(own[:, None], o.slave.near_dofs[own, : ds.shape[2]], values[:, None])


def find_partners(f: ContactFields) -> PlanePartners | SpacePartners:
    """Partners at the accepted state of some fields, which counts no slip (collective)."""
    c, o, per_weight = f.interface, f.operators, f.per_weight
    none, moves, planes = np.zeros(len(o.x)), np.zeros_like(o.x), c.across_planes
    feet, place, in_plane = moves, np.zeros(0), o.slave.dim == 2
    present = per_weight if c.slip_measure == "operators" else none

    kept = [o]  # until the pairing is known: operators are large

    @cache
    def pairing() -> Pairing:
        (at,) = kept
        D, M = weights_of_partners(at, per_weight)
        angle = none
        if in_plane and planes is not None:
            angle = arcs.orientation(at, M, planes).angle
        kept.clear()
        return Pairing(D, M, np.where(present[:, None] != 0.0, 0.0, D @ at.x - M @ at.m), angle)

    found: Callable[[], Pairing] = pairing
    if isinstance(o, ObstacleOperators):
        feet, place = o.obstacle.to_own_frame(o.nearest_points()), o.obstacle.place.copy()
        own, no_master = csr_array(eye(len(o.x))), csr_array((len(o.x), 0))
        found = partial(Pairing, own, no_master, o.x - o.obstacle.present_pivot, none)
    elif not in_plane:
        found = partial(Pairing, *pairing())
    elif o.slave.comm.size > 1:
        _ = o.matrices  # collective
    kind = PlanePartners if in_plane else SpacePartners
    return kind(
        pairing=found, x=o.x, m=o.m, normals=o.n, weight=np.where(per_weight > 0.0, o.weight, 0.0),
        least=f.nodal_areas * (np.inf if c.pair.law.bridges_gap else ROUNDING), present=present,
        planes=planes, feet=feet, place=place, counted=none if in_plane else moves, shear=none,
        pressure=none, gap=none,
    )  # fmt: skip


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


def lead_by_solution(
    contact: Any, outline: Outline, carried: arcs.Carried, bodies: Indices
) -> float:
    """As ``lead``, by the motions of bodies to the present state (collective).

    Args:
        contact: See ``lead``, as the next three.
        outline: Outlines of the bodies.
        carried: Nodes after the motions.
        bodies: Their bodies.

    Returns:
        Largest change of the slip of active nodes, over their way by turns [1].
    """
    before, kept = contact.slip, contact.partners
    way = lead(contact, contact.accepted_partners, outline, carried, bodies)
    counts = contact.active & (contact.partners.pressure == 0.0)
    if contact.partners is kept or not counts.any():
        return 0.0
    change = (contact.slip - before)[counts].reshape(int(counts.sum()), -1)
    return float(norms(change).max()) / max(float(way[counts].max()), TINY)


def lead(
    contact: Any, partners: Partners, outline: Outline, carried: arcs.Carried,
    bodies: Indices | None = None,
) -> Array:  # fmt: skip
    """Count slip of nodes without force from where motions carry them, see ``arcs``.

    Collective. Bonds across gaps keep the points between which they are.

    Args:
        contact: The contact, evaluated at the present state.
        partners: Partners at the start of the step.
        outline: Outlines of the bodies of all pairs.
        carried: Their nodes after the motions.
        bodies: Bodies of these nodes, for motions to the present state.

    Returns:
        Ways of nodes by turns, shape (slave nodes,) [length].
    """
    new = (partners.pressure == 0.0) & (not contact.pair.law.bridges_gap)
    at = [outline.indices_of(side.nodes) for side in (contact.slave, contact.master)]
    slave, master = (at_rows(carried, i) for i in at)
    turns = np.concatenate([slave.turn, master.turn])
    if not new.any() or not turns.any() or np.isnan(turns).any():
        return np.zeros(len(new))  # from a start that one side has left only, slip is wrong
    o = contact.evaluation.at_outline(outline, carried.x, contact.state)
    there = find_partners(type(contact.now)(contact, contact.state, o))
    place = np.zeros(0) if contact.obstacle is None else contact.obstacle.place.copy()
    if contact.obstacle is None:
        master = arcs.Carried(*(there.M @ values for values in master))
    else:
        master = arcs.carried_by(contact.obstacle, partners.place, there.feet)
    way = arcs.way_of(slave, master)
    if bodies is not None:
        faced = [np.rint(each.M @ (bodies[at[1]] + 1)) for each in (partners, there)]
        of_pairs = _place_of(contact, partners, bodies[at[0]] + 1, *faced)
        told = np.isfinite(of_pairs.start[:, 0])
        way[told] = arcs.way_past(of_pairs, slave, master)[told]
        led = contact.partners.led
        new &= told if led is None else told | led.new
        new &= bodies[at[0]] + 1 != faced[1]
    at_new = (np.where(new[:, None], values, 0.0) for values in (slave.turn - master.turn, way))
    led = arcs.Led(new, slave.x, o.m, place, contact.turns(), *at_new)
    contact.change(partners=partners.led_by(there, led))
    sides = (norms(side.turn) * norms(side.x - side.end) for side in (slave, master))
    return np.add(*sides)


def _place_of(
    contact: Any, partners: Partners, own: Indices, before: Array, after: Array
) -> arcs.Place:
    """Motion of the place of contact of each two bodies, to the present state (local).

    Args:
        contact: The contact, evaluated at the present state.
        partners: Partners at the start of the step.
        own: Bodies of slave nodes, numbers from 1 on, shape (slave nodes,).
        before: Those that they faced at the start, 0 for an obstacle.
        after: Those that they came into contact with.
    """
    x, count = (partners.x, contact.operators.x), 1 + own.max(initial=0)
    loads = partners.pressure, np.where(contact.active, contact.now.z_n, 0.0)
    ends = [
        arcs.LoadedNodes(at, evaluate_normals(contact.slave, at, "opposite")[0],
                 contact.slave.nodal_areas * np.maximum(load, 0.0), own + count * other)
        for at, load, other in zip(x, loads, (before, after), strict=True)
    ]  # fmt: skip
    return arcs.place_between(*ends)
