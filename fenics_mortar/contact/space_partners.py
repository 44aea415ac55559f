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

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from scipy.sparse import csr_array, eye

from fenics_mortar.contact import arcs
from fenics_mortar.contact.slip import AtStart, Pairing, accepted
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.obstacles.rigid_motion import inverse_jacobians, turns_between
from fenics_mortar.utils.arrays import Array, Flags, Indices, norms

if TYPE_CHECKING:
    from fenics_mortar.contact.pair import Measure
    from fenics_mortar.interface.mortar import Block
    from fenics_mortar.interface.space_mortar import SpaceOperators


@dataclass(frozen=True, kw_only=True)
class _Accepted(AtStart):
    """An accepted state in space, equal on all ranks.

    Attributes:
        mirrored: Components of slave and master nodes across symmetry planes, shapes (nodes, 3),
            bool; ``None`` if surfaces do not rotate, with small sliding.
    """

    mirrored: tuple[Flags, Flags] | None

    def slip(self, o: Any) -> Array:
        """Slip since that state, shape (slave nodes, 3) [length]; collective as ``at``."""
        return self.at(o).slip + self.counted + (0.0 if self.led is None else self.led.way_at(o.x))

    def materials(self, o: Any) -> list[arcs.Material]:
        """Materials of the slave at its nodes, and of a master surface at the partners (local).

        Without rotations if ``mirrored`` is ``None``.
        """
        return self.pairing.once("materials", lambda: self._materials(o.slave, o.master))

    def _materials(self, *surfaces: Any) -> list[arcs.Material]:
        weights, starts = [csr_array(eye(len(self.x))), self.M], (self.x, self.m)
        mirrored: Any = self.mirrored
        if mirrored is None:
            weights = [csr_array(each.shape) for each in weights]
            mirrored = [np.zeros(x.shape, bool) for x in starts]
        led = self.led
        after = (None, None) if led is None else ((led.new, led.x), (led.new, led.m))
        sides = zip(weights, surfaces, starts, mirrored, after, strict=True)
        return [arcs.Material(*side) for side in sides if side[1].num_nodes]

    def derivative(self, o: Any, along: Array) -> Iterator[Block]:
        """Blocks of along_j . ds_j of this rank, for vectors ``along`` (slave nodes, 3).

        Rows are slave nodes, columns displacement dofs.
        """
        found = self.at(o)
        sides = (
            (found.slave,) if isinstance(found, arcs.PastObstacle) else (found.slave, found.master)
        )
        by_vector, *by_spins = found.weights(along)
        yield from self.by_vectors(o, by_vector, along)
        if self.mirrored is not None and o.linearization.normals:
            turned = zip(self.materials(o), sides, by_spins, strict=True)
            yield from (material.rows(at, spin) for material, at, spin in turned)

    def pairs(self, o: Any) -> tuple[Indices, Indices]:
        """Slave nodes and the master nodes coupled to them, each (k,)."""
        turns = self.mirrored is not None and o.master.num_nodes
        return self.materials(o)[1].pairs if turns else self.entries[1][:2]

    def unled(self) -> Self:
        """These partners without motions that lead bodies; rotations are those of the step."""
        return replace(self, led=None, pairing=Pairing(lambda: self.pairing.built))


@dataclass(frozen=True, kw_only=True)
class SpacePartners(_Accepted):
    """Partners of all slave nodes at an accepted state, equal on all ranks.

    Attributes:
        weight: w_j at that state, zero without rows, shape (slave nodes,) [area].
    """

    weight: Array

    def doubt(self, o: SpaceOperators, turns: tuple[Array, ...], active: Flags) -> Array:
        """See ``slip.Partners`` (n,) [radian].

        Collective at the first access to ``o.vectors``.
        """
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

    def _evaluate(self, o: SpaceOperators) -> arcs.Screw:
        sides = zip(self.materials(o), (o.x, o.m), strict=True)
        return arcs.screw(self.vectors(o), self.start, *(side.turned(x) for side, x in sides))

    def rotation_of_slave(self, o: SpaceOperators) -> Array:
        """Rotations of the slave's material since that state, led or not, (n, 3, 3) [1] (local)."""
        if self.led is None:
            return self.at(o).slave.Q
        return self.unled().materials(o)[0].turned(o.x).Q


@dataclass(frozen=True, kw_only=True)
class ObstaclePartners(_Accepted):
    """Partners on an obstacle in space at an accepted state, equal on all ranks."""

    def doubt(self, o: ObstacleOperators, turns: tuple[Array, ...], active: Flags) -> Array:
        """Difference between the rotations of ``arc`` and those that are known, (n,) [radian]."""
        found = (self if self.led is None else self.unled()).at(o)
        if not turns:
            return found.doubt
        known, _ = _turned(self.turns, turns)
        return np.where(np.isnan(known[:, 0]), found.doubt, norms(found.of_slave - known))

    def _evaluate(self, o: ObstacleOperators) -> arcs.PastObstacle:
        slave = self.materials(o)[0].turned(o.x)
        return arcs.past_obstacle(self.vectors(o), self.start, slave, self.turns_past(o))

    def turns_past(self, o: ObstacleOperators) -> Array:
        """``turn`` at each node, of led ones since the motions, (slave nodes, 3) [radian]."""
        places = [self.place] if self.led is None else [self.place, self.led.place]
        turns = [np.tile(o.obstacle.turn_since(at), (len(self.x), 1)) for at in places]
        return turns[0] if self.led is None else self.led.origin(*turns)

    def turn(self, o: ObstacleOperators) -> Array:
        """Rotation vector of the obstacle since that state, shape (3,) [radian]."""
        return o.obstacle.turn_since(self.place)

    def derivative_by_motions(self, o: ObstacleOperators) -> Array:
        """Derivative of the slip by the motions of the obstacle, shape (slave nodes, 3, 6) [1]."""
        found, spin = self.at(o), inverse_jacobians(self.turns_past(o))
        return np.concatenate([-found.by_vector, found.by_relative @ spin / o.arm], axis=2)


def _turned(before: tuple[Array, ...], now: tuple[Array, ...]) -> list[Array]:
    """Known rotation vectors of both sides between two results of ``Contact.turns`` (local)."""
    return [turns_between(*ends) for ends in zip(before, now, strict=True)]


def find_space_partners(
    o: Any,
    per_weight: Array,
    measure: Measure,
    *,
    least: Array,
    mirrored: tuple[Flags, Flags] | None,
) -> SpacePartners | ObstaclePartners:
    """Partners in space at the state of ``o`` (collective).

    Args:
        o: Operators of the accepted state.
        per_weight: See ``accepted``.
        measure: "operators", or "partners" for constant D and M, and on obstacles.
        least: See ``AtStart``.
        mirrored: See ``SpacePartners``.
    """
    given = accepted(o, per_weight, measure, least, lambda M: np.zeros(len(o.x)))
    if isinstance(o, ObstacleOperators):
        return ObstaclePartners(mirrored=mirrored, **given)
    _ = given["pairing"].built  # the operators are large, and are not kept
    return SpacePartners(
        mirrored=mirrored, weight=np.where(per_weight > 0.0, o.weight, 0.0), **given
    )
