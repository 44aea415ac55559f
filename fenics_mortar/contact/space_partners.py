# SPDX-License-Identifier: MIT
"""Partners of slave nodes in space: the material points that they faced at an accepted state.

Slip is the length of the way along the surface that ``arcs`` finds from vectors r between
partners and nodes at that state and at present. On a surface these are

    r_j = {[D_old x - M_old y]_j - [D x - M y]_j} / w_j,old,

zero at that state; only changes of D and M count (Gitterle, Popp, Gee & Wall 2010). With small
sliding, where D and M are constant and nothing but an obstacle rotates, r is the distance vector
[D x - M y]_j / w_j, and slip its change. A node without rows at the accepted state has there the
nearest point of the master as its partner, and r is the distance vector, too.

On an obstacle the partner is the nearest point, and r leads from the pivot of the obstacle to the
node.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array, eye

from fenics_mortar.contact.arcs import (
    Material,
    doubt_beside_known,
    past_obstacle,
    screw,
    vectors_of,
)
from fenics_mortar.contact.slip import (
    AtLastOperators,
    AtStart,
    Entries,
    at_start,
    by_positions,
    entries_of,
    per_weight_of,
    rows_of,
    weights_of_partners,
)
from fenics_mortar.interface.mortar import Block
from fenics_mortar.obstacles.rigid_motion import inverse_jacobians, turns_between
from fenics_mortar.utils.arrays import Array, Flags, Indices, norms

if TYPE_CHECKING:
    from fenics_mortar.contact.arcs import Led, PastObstacle, Screw
    from fenics_mortar.contact.pair import Measure
    from fenics_mortar.interface.on_obstacle import ObstacleOperators
    from fenics_mortar.interface.space_mortar import SpaceOperators


class Evaluations(AtLastOperators):
    """Materials of a step, and slip at the positions of the last operators; not in a pickle."""

    _materials: list[Material] | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Nothing: what is kept is computed again (local)."""
        return {}

    def materials(
        self,
        weights: Sequence[csr_array],
        surfaces: Sequence[Any],
        starts: Sequence[Array],
        mirrored: Sequence[Flags] | None,
        led: Led | None,
    ) -> list[Material]:
        """``Material`` of each surface, made once; without rotations if ``mirrored`` is ``None``.

        See ``Material`` for the arguments; ``led`` as of ``SpacePartners`` (local).
        """
        if self._materials is None:
            if mirrored is None:
                weights = [csr_array(each.shape) for each in weights]
                mirrored = [np.zeros(x.shape, bool) for x in starts]
            after = (None, None) if led is None else ((led.new, led.x), (led.new, led.m))
            sides = zip(weights, surfaces, starts, mirrored, after)
            self._materials = [Material(*side) for side in sides]
        return self._materials


@dataclass(frozen=True, kw_only=True)
class _Accepted(AtStart, ABC):
    """An accepted state, equal on all ranks.

    Attributes:
        mirrored: Components of slave and master nodes across symmetry planes, shapes (nodes, 3),
            bool; ``None`` if surfaces do not rotate, with small sliding.
        found: What is found from that state on.
    """

    mirrored: tuple[Flags, Flags] | None
    found: Evaluations = field(default_factory=Evaluations, repr=False, compare=False)

    @abstractmethod
    def _evaluate(self, o: Any) -> Any:
        """Rotations and slip since that state, without ``counted``."""

    def at(self, o: Any) -> Any:
        """``Screw`` or ``PastObstacle``: rotations and slip since that state, without ``counted``.

        Collective between surfaces at the first access to ``o.vectors``, local past an obstacle.
        """
        return self.found.at(o, self._evaluate)

    def slip(self, o: Any) -> Array:
        """Slip since that state, shape (slave nodes, 3) [length]; collective as ``at``."""
        return self.at(o).slip + self.counted + (0.0 if self.led is None else self.led.way_at(o.x))


@dataclass(frozen=True, kw_only=True)
class SpacePartners(_Accepted):
    """Partners of all slave nodes at an accepted state, equal on all ranks.

    Attributes:
        D: Weights of slave nodes, shape (slave nodes, slave nodes), rows sum to one [1].
        M: Weights of master nodes, shape (slave nodes, master nodes), rows sum to one [1].
        start: Vectors r at that state, shape (slave nodes, 3) [length].
        weight: w_j at that state, zero without rows, shape (slave nodes,) [area].
        present: Weight of the present D and M in r, shape (slave nodes,) [1 / area].
    """

    D: csr_array
    M: csr_array
    start: Array
    weight: Array
    present: Array

    def led_by(self, there: SpacePartners, led: Led) -> SpacePartners:
        """See ``slip.Partners`` (local)."""
        matrices: dict[str, Any] = {
            name: rows_of(led.new, *_both(self, there, name)) for name in ("D", "M")
        }
        vectors: dict[str, Any] = {
            name: led.origin(*_both(self, there, name)) for name in ("start", "present")
        }
        return replace(self, led=led, found=Evaluations(), **matrices, **vectors)

    def gap_vectors(self, o: SpaceOperators) -> Array:
        """Vectors from partners to nodes at positions of ``o``, (slave nodes, 3) [length]."""
        return np.asarray(self.D @ o.x - self.M @ o.m)

    def doubt(self, o: SpaceOperators, turns: tuple[Array, ...], active: Flags) -> Array:
        """See ``slip.Partners`` (n,) [radian].

        Collective at the first access to ``o.vectors``.
        """
        found, led = self.at(o), self.led
        L, _ = vectors_of(found.slave.Q.swapaxes(1, 2) @ found.master.Q)
        if not turns:
            return found.doubt if led is None else norms(L - led.turn)
        doubt = norms(L - self._known(self.turns, turns))
        if led is not None:
            doubt = led.origin(doubt, norms(L - self._known(led.turns, turns)))
        return doubt_beside_known(norms(L), doubt, active & (self.pressure != 0.0))

    def _known(self, before: tuple[Array, ...], now: tuple[Array, ...]) -> Array:
        """Turns of the partners past the nodes between two results of ``Contact.turns`` (local)."""
        slave, master = (np.nan_to_num(turn) for turn in _turned(before, now))
        return turns_between(slave, np.asarray(self.M @ master), own=True)

    def _evaluate(self, o: SpaceOperators) -> Screw:
        r = self.gap_vectors(o)
        if self.present.any():
            r = r - self.present[:, None] * o.vectors
        sides = zip(self.materials(o), (o.x, o.m), strict=True)
        return screw(np.asarray(r), self.start, *(side.turned(x) for side, x in sides))

    def materials(self, o: SpaceOperators) -> list[Material]:
        """Materials of both sides at the nodes and at their partners."""
        weights = csr_array(eye(len(o.x))), self.M
        sides = (o.slave, o.master), (self.x, self.m), self.mirrored
        return self.found.materials(weights, *sides, self.led)

    def rotation_of_slave(self, o: SpaceOperators) -> Array:
        """Rotations of the slave's material since that state, led or not, (n, 3, 3) [1] (local)."""
        if self.led is None:
            return self.at(o).slave.Q
        return replace(self, led=None, found=Evaluations()).materials(o)[0].turned(o.x).Q

    def derivative(self, o: SpaceOperators, along: Array) -> Iterator[Block]:
        """Blocks of along_j . ds_j of this rank, for vectors ``along`` (slave nodes, 3).

        Rows are slave nodes, columns displacement dofs.
        """
        found = self.at(o)
        by_vector, *by_spins = found.weights(along)
        yield from by_positions(o, self.entries, by_vector)
        yield from _by_led(self.led, o, along)
        if self.present.any():
            yield from o.vector_derivative(-self.present[:, None] * by_vector)
        if self.mirrored is not None and o.linearization.normals:
            turned = zip(self.materials(o), (found.slave, found.master), by_spins, strict=True)
            yield from (material.rows(at, spin) for material, at, spin in turned)

    @cached_property
    def entries(self) -> tuple[Entries, Entries]:
        """Entries of D and M."""
        return entries_of(self.D), entries_of(self.M)

    def pairs(self, o: SpaceOperators) -> tuple[Indices, Indices]:
        """Slave nodes and the master nodes coupled to them, each (k,)."""
        return self.materials(o)[1].pairs if self.mirrored is not None else self.entries[1][:2]


@dataclass(frozen=True, kw_only=True)
class ObstaclePartners(_Accepted):
    """Partners on an obstacle in space at an accepted state, equal on all ranks.

    Attributes:
        feet: The nearest points of the obstacle in its own frame, shape (slave nodes, 3) [length].
        place: Place of the obstacle at that state, shape (6,) [length, radian].
    """

    feet: Array
    place: Array

    def led_by(self, there: ObstaclePartners, led: Led) -> ObstaclePartners:
        """See ``slip.Partners`` (local)."""
        feet = led.origin(*_both(self, there, "feet"))
        return replace(self, led=led, found=Evaluations(), feet=feet)

    def gap_vectors(self, o: ObstacleOperators) -> Array:
        """See ``SpacePartners`` [length]."""
        return np.asarray(o.x - o.obstacle.to_space(self.feet))

    def doubt(self, o: ObstacleOperators, turns: tuple[Array, ...], active: Flags) -> Array:
        """See ``slip.Partners`` (n,) [radian] (local)."""
        start = self if self.led is None else replace(self, led=None, found=Evaluations())
        found = start.at(o)
        if not turns:
            return found.doubt
        known, _ = _turned(self.turns, turns)
        return np.where(np.isnan(known[:, 0]), found.doubt, norms(found.of_slave - known))

    def _evaluate(self, o: ObstacleOperators) -> PastObstacle:
        pivot, led = o.obstacle.pivot, self.led
        start = self.x - (pivot + self.place[:3])
        if led is not None:
            start = led.origin(start, led.x - (pivot + led.place[:3]))
        now, slave = pivot + o.obstacle.place[:3], self.material(o).turned(o.x)
        return past_obstacle(o.x - now, start, slave, self.turns_past(o))

    def turns_past(self, o: ObstacleOperators) -> Array:
        """``turn`` at each node, of led ones since the motions, (slave nodes, 3) [radian]."""
        places = [self.place] if self.led is None else [self.place, self.led.place]
        turns = [np.tile(o.obstacle.turn_since(at), (len(self.x), 1)) for at in places]
        return turns[0] if self.led is None else self.led.origin(*turns)

    def turn(self, o: ObstacleOperators) -> Array:
        """Rotation vector of the obstacle since that state, shape (3,) [radian]."""
        return o.obstacle.turn_since(self.place)

    def material(self, o: ObstacleOperators) -> Material:
        """The slave's material at its nodes."""
        return self.found.materials([self.D], [o.slave], [self.x], self.mirrored, self.led)[0]

    def derivative(self, o: ObstacleOperators, along: Array) -> Iterator[Block]:
        """Blocks of along_j . ds_j of this rank, for vectors ``along`` (slave nodes, 3).

        Rows are slave nodes, columns displacement dofs.
        """
        own, found = o.slave.owned, self.at(o)
        by_vector, by_spin = found.weights(along)
        yield Block(own[:, None], o.slave.dofs[own], by_vector[own][:, None])
        yield from _by_led(self.led, o, along)
        if self.mirrored is not None and o.linearization.normals:
            yield self.material(o).rows(found.slave, by_spin)

    @cached_property
    def D(self) -> csr_array:
        """See ``SpacePartners``: each node alone."""
        return csr_array(eye(len(self.x)))

    @property
    def M(self) -> csr_array:
        """See ``SpacePartners``: no master nodes."""
        return csr_array((len(self.x), 0))

    def derivative_by_motions(self, o: ObstacleOperators) -> Array:
        """Derivative of the slip by the motions of the obstacle, shape (slave nodes, 3, 6) [1]."""
        found, spin = self.at(o), inverse_jacobians(self.turns_past(o))
        return np.concatenate([-found.by_vector, found.by_relative @ spin / o.arm], axis=2)

    def pairs(self, o: ObstacleOperators) -> tuple[Indices, Indices]:
        """No master nodes, (0,) each."""
        return np.empty(0, np.int64), np.empty(0, np.int64)


def _both(here: Any, there: Any, name: str) -> tuple[Any, Any]:
    """An attribute of two partners."""
    return getattr(here, name), getattr(there, name)


def _by_led(led: Led | None, o: Any, along: Array) -> Iterator[Block]:
    """Block of along_j . dV_j of this rank: along . (w x dx) = (along x w) . dx."""
    if led is not None:
        own = o.slave.owned[led.new[o.slave.owned]]
        values = 0.5 * np.cross(along[own], led.turn[own])
        yield Block(own[:, None], o.slave.dofs[own], values[:, None])


def _turned(before: tuple[Array, ...], now: tuple[Array, ...]) -> list[Array]:
    """Known rotation vectors of both sides between two results of ``Contact.turns`` (local)."""
    return [turns_between(*ends) for ends in zip(before, now, strict=True)]


def find_obstacle_partners(
    o: ObstacleOperators, least: Array, *, mirrored: tuple[Flags, Flags] | None
) -> ObstaclePartners:
    """Partners on an obstacle in space at the state of ``o`` (local); see ``SpacePartners``."""
    feet, place = o.obstacle.to_own_frame(o.nearest_points()), o.obstacle.place.copy()
    return ObstaclePartners(feet=feet, place=place, mirrored=mirrored, **at_start(o, least))


def find_space_partners(
    o: SpaceOperators,
    faces: Flags,
    measure: Measure,
    *,
    least: Array,
    mirrored: tuple[Flags, Flags] | None,
) -> SpacePartners:
    """Partners at the state of ``o`` (collective).

    Args:
        o: Operators of the accepted state.
        faces: Slave nodes with rows in D and M, shape (slave nodes,), bool.
        measure: "operators", or "partners" for constant D and M.
        least: See ``AtStart``.
        mirrored: See ``SpacePartners``.
    """
    per_weight = per_weight_of(o, faces)
    D, M = weights_of_partners(o, per_weight)
    present = per_weight if measure == "operators" else np.zeros(len(o.x))
    start = np.where(present[:, None] > 0.0, 0.0, D @ o.x - M @ o.m)
    given = at_start(o, least) | {"mirrored": mirrored, "weight": np.where(faces, o.weight, 0.0)}
    return SpacePartners(D=D, M=M, start=start, present=present, **given)
