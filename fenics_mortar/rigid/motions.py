# SPDX-License-Identifier: MIT
"""Rigid obstacles of a problem, their motions and the forces along them.

Motions are x, y and turn, the angle times the ``arm`` of the pair, all in units of length. All
values are replicated.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.bulk.bodies import MINOR
from fenics_mortar.contact.contact import Contact
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import format_point


class ObstacleMotions:
    """Obstacles of a problem and their positions.

    Args:
        contacts: The contacts of the problem, and its ties.

    Attributes:
        contacts: The contacts and ties.
        obstacles: Obstacles of the contacts, without duplicates.
        pairs: Contacts with an obstacle, with the number of the obstacle.
        scales: Motions per (x, y, angle), shape (obstacles, 3) [1, 1, length].
    """

    def __init__(self, contacts: Sequence[Any]) -> None:
        self.contacts = contacts
        found = [c.obstacle for c in contacts if c.obstacle is not None]
        self.obstacles: list[Obstacle] = list(dict.fromkeys(found))
        for obstacle in self.obstacles:
            mine = [contact for contact in contacts if contact.obstacle is obstacle]
            for contact in mine:
                contact.set_arm(max(c.arm for c in mine))
        self.pairs: list[tuple[int, Contact]] = [
            (self.obstacles.index(c.obstacle), c) for c in contacts if c.obstacle is not None
        ]
        self.scales: Array = np.ones((len(self.obstacles), 3))
        self._none: Array = np.zeros((0, 3))
        for number, contact in self.pairs:
            self.scales[number, 2] = contact.arm

    @property
    def places(self) -> Array:
        """Places (x, y, angle) of obstacles, shape (obstacles, 3) [length, length, radian]."""
        return self._of_all("place")

    @places.setter
    def places(self, places: Array) -> None:
        for obstacle, where in zip(self.obstacles, places, strict=True):
            obstacle.place = where.copy()

    def motions_of(self, places: Array) -> Array:
        """Motions x, y, turn [length] of ``places``, shape (obstacles, 3)."""
        return places * self.scales

    def move(self, change: Array) -> None:
        """Add ``change`` to the motions, shape (obstacles, 3) [length] (local)."""
        if not self.obstacles:
            return
        self.places = self.places + change / self.scales

    def largest(self) -> float:
        """Largest motion since the obstacles were created [length]."""
        if not self.obstacles:
            return 0.0
        return float(np.abs(self.motions_of(self.places)).max(initial=0.0))

    @property
    def any_driven(self) -> bool:
        """Whether a force drives any obstacle (local)."""
        return bool(self.driven.any())

    @property
    def driven(self) -> npt.NDArray[np.bool_]:
        """Whether forces drive a motion, shape (obstacles, 3), bool."""
        return np.isfinite(self._of_all("load"))

    def push(self) -> Array:
        """Loads along driven motions, 0 for prescribed ones, (obstacles, 3) [stress length]."""
        return np.nan_to_num(self._of_all("load")) / self.scales

    def forces(self, multipliers: str = "z") -> Array:
        """f_q of the last evaluated state, shape (obstacles, 3) [stress length] (collective).

        Args:
            multipliers: Multipliers included: all ("z") or their tangential part ("shear").
        """
        total = np.zeros(self.scales.shape)
        for number, contact in self.pairs:
            total[number] += contact.on_obstacle.motion_force(getattr(contact, multipliers))
        return total

    def contact_forces(self) -> Array:
        """Integral of |pressure| on each obstacle, shape (obstacles,) [stress length]."""
        total = np.zeros(len(self.obstacles))
        for number, contact in self.pairs:
            total[number] += contact.operators.cover @ np.abs(contact.pressure)
        return total

    def record(self) -> list[str]:
        """Set the ``reaction`` of each obstacle; return a sentence for each (collective)."""
        lines, is_axial = [], self._is_axisymmetric()
        for obstacle, force in zip(self.obstacles, -self.forces() * self.scales, strict=True):
            obstacle.reaction = force * [0.0, 1.0, 0.0] if is_axial else force
            load = f"contact force {format_point(force)}, moment {force[2] + 0.0:.4g}"
            load = f"axial contact force {force[1] + 0.0:.4g}" if is_axial else load
            lines.append(f"obstacle '{obstacle.name}'{_moved(obstacle.place)}: {load}")
        return lines

    def _is_axisymmetric(self) -> bool:
        """Whether bodies are of revolution: radial forces and moments vanish around the axis."""
        thicknesses = [contact.slave.thickness for _, contact in self.pairs]
        return any(t is not None and t.by_x != 0.0 for t in thicknesses)

    def contacts_of(self, number: int) -> list[Contact]:
        """The contacts of one obstacle."""
        return [contact for i, contact in self.pairs if i == number]

    def shortest_facet(self) -> float:
        """Shortest slave facet of all pairs with obstacles, 1 if there are none [length]."""
        return min((float(c.slave.lengths.min()) for _, c in self.pairs), default=1.0)

    def _of_all(self, name: str) -> Array:
        """An attribute of all obstacles, shape (obstacles, 3)."""
        if not self.obstacles:
            return self._none
        return np.array([getattr(o, name) for o in self.obstacles]).reshape(-1, 3)


def slip_by_motions(contact: Contact, nodes: npt.NDArray[np.bool_]) -> Array:
    """Rate of slip of some nodes by obstacle motions at present, (n, 3) [1].

    This is not the derivative of the slip of a step, which also depends on motions along the normal
    if the obstacle has turned.
    """
    o = contact.on_obstacle
    return -np.einsum("jmc,jc->jm", o.obstacle.motions(o.x, o.arm), o.tau)[nodes]


def _moved(where: Array) -> str:
    """Description of an obstacle's position, shape (3,); "" at the initial position."""
    phrases = [f"moved by {format_point(where)}"] if where[:2].any() else []
    phrases += [f"turned by {where[2]:.4g}"] if where[2] else []
    return ", " + " and ".join(phrases) if phrases else ""


def describe_motion(motion: Array) -> str:
    """Description of a ``motion`` x, y, turn, shape (3,) [length] (local)."""
    x, y, turn = motion / np.abs(motion).max()
    if abs(turn) < MINOR:
        return f"move along {format_point((x + 0.0, y + 0.0))}"
    return "turn" if max(abs(x), abs(y)) < MINOR else f"move along {format_point((x, y))} and turn"
