# SPDX-License-Identifier: MIT
"""Bodies that prescribed values turn, and how far in a step.

The ends of a step tell the rotation of a body up to full turns: values that turn a shaft by 350
degrees are those that turn it back by 10. So are slip, the direction of friction, wear and the
bodies passed. Angles of rigid boundaries are known; of other prescribed values the shortest turn is
taken, and larger ones than ``TOLD_TURN`` are told. On a path loads are a function of the time,
evaluated within each step as well: see ``path.prescribed_turns``.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from itertools import product

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.hull import Hull
from fenics_mortar.interface.outline import Outline
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.obstacles.rotations import TURNS, polar_rotation, vector_of
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.rounding import ROUNDING

# Turn of a body by prescribed values in a step [radian], 5 degrees, above which its sense is told
# to be uncertain: 72 steps for a full turn are taken for what they look like.
TOLD_TURN = np.pi / 36
# Distance of prescribed nodes from a rigid motion over their motion [1], below which they turn: the
# ends of a beam that is bent do not. A stretch of 5 % beside a quarter of a turn.
STRETCHED = 0.05
# Extent of prescribed nodes, in space across a line, over their distance from the origin [1], below
# which they do not tell a rotation.
SLENDER = 1e-6

OTHERWISE = (
    "the ends of the step do not tell; if bodies turned otherwise, slip and friction are those of "
    "another motion: take smaller steps, follow_path with values as a function of the time, or a "
    "RigidBoundary, whose angle is known"
)

# Rotations by the number of the body: an angle, shape (1,), in space a vector (3,) [radian].
Turns = dict[int, Array]


class LedBodies:
    """Bodies with prescribed nodes and their turns.

    All methods are local but ``messages`` and the constructor.

    Args:
        bulk: The bodies.
        contacts: All pairs.
        floating: Bodies and their names.
        outline: Outlines or hulls of the bodies in contact.

    Attributes:
        sides: Bodies of each pair by their numbers in ``floating.labels``, slave and master, -1 for
            an obstacle, of which prescribed values lead at least one.
        may_turn: Whether values may be those of a rotation, not one constant for each body.
        examined: Whether loads were evaluated at times within the present step.
    """

    def __init__(
        self,
        bulk: Bulk,
        contacts: Sequence[Contact | Tie],
        floating: FloatingBodies,
        outline: Outline | Hull,
    ) -> None:
        self._bulk, self._contacts, self._floating = bulk, contacts, floating
        labels = outline.gather(bulk.space.spread(floating.labels))
        self.bodies = labels[:, 0].astype(np.int64)
        self._parts = outline.bodies
        free = outline.gather(1.0 - bulk.prescribed)
        self.prescribed = (free == 0.0).all(axis=1)
        led = set(self.bodies[self.prescribed].tolist())
        self._of_pairs = [
            {sides for sides in self._sides_of(contact) if not led.isdisjoint(sides)}
            for contact in contacts
        ]
        self.sides: set[tuple[int, int]] = set().union(*self._of_pairs)
        self.may_turn = bool(self.sides) and self._vary(len(led))
        known = np.isin(self._parts, list(floating.leaders))
        self._known = set(self.bodies[known].tolist())
        names = sorted(led - self._known) if self.may_turn else []
        self._names = {body: floating.name_of(body) for body in names}
        self.examined = False

    def _sides_of(self, contact: Contact | Tie) -> Iterable[tuple[int, int]]:
        """The bodies on both sides of a contact (collective the first time)."""
        if not isinstance(contact, Contact):
            return ()
        both = product(self._of(contact.slave), self._of(contact.master) or [-1])
        return [sides for sides in both if sides[0] != sides[1]]

    def _of(self, surface: Surface) -> list[int]:
        """Numbers of the bodies of a surface, none for an obstacle."""
        return sorted(set(self._floating.labels_of(surface).astype(np.int64).tolist()))

    def _vary(self, num_led: int) -> bool:
        """Whether values may be those of a rotation, not one constant for each body."""
        sizes = [compat.prescribed_value(bc).size for bc in self._bulk.bcs]
        return 0 in sizes or len(sizes) > num_led

    def turns(self, x0: Array, x1: Array, stretched: float = np.inf) -> Turns:
        """Rotations of the prescribed nodes of bodies between two positions; see ``turn_of``.

        Args:
            x0: Positions of the nodes of the outlines, shape (n, d) [length].
            x1: Positions later.
            stretched: See ``turn_of``.
        """
        led = self.prescribed
        bodies = np.unique(self.bodies[led]).tolist()
        marks = [led & (self.bodies == body) for body in bodies]
        found = (turn_of(x0[at], x1[at], stretched) for at in marks)
        return dict(zip(bodies, found, strict=True))

    def relative(self, sides: tuple[int, int], turns: Turns) -> Array:
        """Rotation of the slave less that of the master, as a vector [radian]."""
        still = np.zeros(len(TURNS[self._bulk.space.dim]))
        slave, master = (turns.get(side, still) for side in sides)
        return np.asarray(slave - master)

    def doubtful(self, x0: Array, x1: Array) -> Turns:
        """Turns by values that tell them up to full turns only, above ``TOLD_TURN``, in a step."""
        if self.examined or not self.may_turn or np.array_equal(x0, x1):
            return {}
        found = self.turns(x0, x1, STRETCHED).items()
        return {
            body: turn
            for body, turn in found
            if body in self._names and np.linalg.norm(turn) > TOLD_TURN
        }

    def parts(self, bodies: Iterable[int]) -> frozenset[int]:
        """Numbers in the outlines of some bodies."""
        return frozenset(self._parts[np.isin(self.bodies, list(bodies))].tolist())

    def messages(
        self, x0: Array, x1: Array, *, moved: bool, told: Collection[int] = ()
    ) -> list[str]:
        """Message on turns up to which slip is uncertain, or on a step in which nothing moved.

        Collective. With friction or wear only; none if the loads were examined.

        Args:
            x0: Positions of the nodes of the outlines at the start of the step, (n, d) [length].
            x1: Those at its end.
            moved: Whether obstacles moved.
            told: Numbers of pairs of which the turns at nodes are told.
        """
        pairs = enumerate(zip(self._contacts, self._of_pairs, strict=True))
        rubs = [sides for number, (c, sides) in pairs if _rubs(c) and number not in told]
        of_pairs = sorted(set().union(*rubs))
        if self.examined or not self.may_turn or not of_pairs:
            return []
        size = float(np.abs(x1).max(initial=0.0))
        if not moved and np.abs(x1 - x0).max(initial=0.0) <= ROUNDING * size:
            names = self._of_functions(of_pairs)
            text = "nothing moved in the step; prescribed values may have turned"
            return [f"{text} {name} by full turns: {OTHERWISE}" for name in names[:1]]
        turns, found = self.doubtful(x0, x1), list[str]()
        for sides in of_pairs:
            angle = float(np.degrees(np.linalg.norm(self.relative(sides, turns))))
            if angle > np.degrees(TOLD_TURN):
                sizes = {float(np.linalg.norm(turns[b])): b for b in sides if b in turns}
                found.append(
                    f"prescribed values turned {self._names[sizes[max(sizes)]]} by {angle:.0f} "
                    f"degrees in the step, if not by {360.0 - angle:.0f} the other way round: "
                    f"{OTHERWISE}"
                )
        return found[:1]

    def _of_functions(self, of_pairs: Sequence[tuple[int, int]]) -> list[str]:
        """Names of led bodies of pairs, if functions that are not zero prescribe values."""
        bcs = [bc for bc in self._bulk.bcs if bc.g is not None]
        functions = [bc for bc in bcs if not compat.prescribed_value(bc).size]
        given = any(compat.condition_numbers(bc).any() for bc in functions)
        if not self._bulk.comm.allreduce(given, MPI.LOR):
            return []
        return [self._names[body] for sides in of_pairs for body in sides if body in self._names]


def turn_of(x0: Array, x1: Array, stretched: float) -> Array:
    """Rotation of nodes, an angle (1,) or a vector (3,), of at most half a turn [radian] (local).

    Zero for nodes that do not tell a rotation.

    Args:
        x0: Their positions, shape (n, d) [length].
        x1: Their positions later.
        stretched: Distance from a rigid motion over the motion [1] above which they do not turn.
    """
    y0, y1 = x0 - x0.mean(axis=0), x1 - x1.mean(axis=0)
    dim, none = x0.shape[1], np.zeros(len(TURNS[x0.shape[1]]))
    extents = np.linalg.svd(y0, compute_uv=False)
    if len(extents) < dim or extents[dim - 2] <= SLENDER * float(np.linalg.norm(x0)):
        return none  # one point; in space points on a line
    R = polar_rotation(y1.T @ y0)
    apart, moved = (np.linalg.norm(y - y0 @ R.T) for y in (y1, y0))
    if apart / stretched > moved:
        return none
    return np.arctan2(R[1, :1], R[0, :1]) if dim == 2 else vector_of(R)


def _rubs(contact: Contact | Tie) -> bool:
    """Whether a contact is closed and depends on slip."""
    if not isinstance(contact, Contact) or contact.pair.sliding == "small":
        return False
    law = contact.pair.law
    return bool((law.has_friction or law.needs_nodal_state) and contact.active.any())
