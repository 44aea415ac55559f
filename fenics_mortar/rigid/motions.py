# SPDX-License-Identifier: MIT
"""The rigid obstacles of a problem, their motions, and the forces along these.

Motions are x, y and turn, the angle times the ``arm`` of the pair, all of them lengths. All is
equal on all ranks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.contact import Contact
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import place


class ObstacleMotions:
    """The obstacles of a problem and where they are.

    Args:
        contacts: The contacts of the problem, and its ties.

    Attributes:
        contacts: The same.
        obstacles: Obstacles of the contacts, each once.
        pairs: The contacts that have an obstacle, with its number.
        scales: Motions over (x, y, angle), shape (obstacles, 3).
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
        """Places (x, y, angle) of all obstacles, shape (obstacles, 3)."""
        return self._of_all("place")

    @places.setter
    def places(self, places: Array) -> None:
        for obstacle, where in zip(self.obstacles, places, strict=True):
            obstacle.place = where.copy()

    def motions_of(self, places: Array) -> Array:
        """Motions x, y, turn of (x, y, angle), shape (obstacles, 3) [length]."""
        return places * self.scales

    def move(self, change: Array) -> None:
        """Add motions, shape (obstacles, 3) [length]."""
        if not self.obstacles:
            return
        self.places = self.places + change / self.scales

    def largest(self) -> float:
        """Largest motion since the obstacles were created [length]."""
        if not self.obstacles:
            return 0.0
        return float(np.abs(self.motions_of(self.places)).max(initial=0.0))

    @property
    def driven(self) -> npt.NDArray[np.bool_]:
        """Which motions forces drive, shape (obstacles, 3)."""
        return np.isfinite(self._of_all("load"))

    def push(self) -> Array:
        """Loads along the motions, 0 where these are prescribed, (obstacles, 3) [stress length]."""
        return np.nan_to_num(self._of_all("load")) / self.scales

    def forces(self, part: str = "z") -> Array:
        """f_q of the last evaluated state, shape (obstacles, 3) [stress length] (collective).

        Args:
            part: Which multipliers of the contacts count: all ("z") or their "shear" only.
        """
        total = np.zeros(self.scales.shape)
        for number, contact in self.pairs:
            total[number] += contact.on_obstacle.motion_force(getattr(contact, part))
        return total

    def contact_forces(self) -> Array:
        """Integral of the size of the pressure on each obstacle, (obstacles,) [stress length]."""
        total = np.zeros(len(self.obstacles))
        for number, contact in self.pairs:
            total[number] += contact.operators.cover @ np.abs(contact.pressure)
        return total

    def record(self) -> list[str]:
        """Note the force and moment of contact on each obstacle; say it in words (collective)."""
        lines = []
        for obstacle, force in zip(self.obstacles, -self.forces() * self.scales, strict=True):
            obstacle.reaction = force
            lines.append(
                f"obstacle '{obstacle.name}', moved by {place(obstacle.place)} and turned by "
                f"{obstacle.place[2]:.4g}: contact force {place(force)}, moment {force[2]:.4g}"
            )
        return lines

    def contacts_of(self, number: int) -> list[Contact]:
        """The contacts of one obstacle."""
        return [contact for i, contact in self.pairs if i == number]

    def shortest_facet(self) -> float:
        """Shortest slave facet of all obstacles' pairs, 1 without any [length]."""
        return min((float(c.slave.lengths.min()) for _, c in self.pairs), default=1.0)

    def _of_all(self, name: str) -> Array:
        """An attribute of all obstacles, shape (obstacles, 3)."""
        if not self.obstacles:
            return self._none
        return np.array([getattr(o, name) for o in self.obstacles]).reshape(-1, 3)


def slip_by_motions(contact: Contact, nodes: npt.NDArray[np.bool_]) -> Array:
    """Derivative of the slip of some nodes by the motions of their obstacle, (n, 3)."""
    return contact.partners.derivative_by_motions(contact.on_obstacle)[nodes]


def in_words(motion: Array) -> str:
    """A motion x, y, turn in words."""
    x, y, turn = motion / np.abs(motion).max()
    if abs(turn) < 0.1:
        return f"move along {place((x + 0.0, y + 0.0))}"
    return "turn" if max(abs(x), abs(y)) < 0.1 else f"move along {place((x, y))} and turn"
