# SPDX-License-Identifier: MIT
"""Plane rigid motions, prescribed or driven by forces: of obstacles, and of boundaries.

The motion q = (x, y, angle arm), with a length ``arm``, has the velocities V dq at points x, with
V = (e_x, e_y, e_z x r / arm) and r from the pivot, which moves along.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fenics_mortar.obstacles.points import check_finite, check_vector
from fenics_mortar.utils.arguments import check_kind
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import format_point

# Names of the motions in the interface.
MOTIONS = ("x", "y", "angle")


class RigidMotion:
    """A plane rigid motion and its loads (all methods are local).

    ``move`` prescribes motions, ``push`` prescribes forces. Set both equally on all ranks.

    Attributes:
        kind: What moves, used in messages.
        name: Name used in messages and tables.
        pivot: Initial centre of rotations, moves along, shape (2,) [length]. It may be set as long
            as there is no rotation.
        place: Present translation from the initial position and counter-clockwise rotation about
            the pivot: (x, y, angle) [length, length, radian].
        load: Driving force (x, y) and moment about the pivot, nan for prescribed motions, shape
            (3,) [stress length, stress length, stress length^2].
        reaction: Force and moment about the pivot after the last solve, shape (3,), units as
            ``load``.

    Raises:
        ValueError: If name or pivot is of another type, or the pivot is not finite.
    """

    kind = "rigid motion"

    def __init__(self, name: str, pivot: npt.ArrayLike = (0.0, 0.0)) -> None:
        """Start at the initial position."""
        check_kind("name", name, str, "a text")
        self.name = name
        self.pivot = check_vector("pivot", pivot)
        self.place: Array = np.zeros(3)
        self.load: Array = np.full(3, np.nan)
        self.reaction: Array = np.zeros(3)

    def move(
        self, *, x: float | None = None, y: float | None = None, angle: float | None = None
    ) -> None:
        """Prescribe motions; values are absolute, not increments.

        Args:
            x: Translation from the initial position; ``None`` leaves it unchanged [length].
            y: Translation along y, likewise [length].
            angle: Counter-clockwise rotation about the pivot, by any number of turns; ``None``
                leaves it unchanged [radian].

        Raises:
            ValueError: If a value is not a finite number.
        """
        for i, (name, value) in enumerate(zip(MOTIONS, (x, y, angle), strict=True)):
            if value is not None:
                self.place[i], self.load[i] = check_finite(name, value), np.nan

    def push(
        self, *, x: float | None = None, y: float | None = None, moment: float | None = None
    ) -> None:
        """Prescribe forces; the motions in these directions are unknowns of the next solve.

        Args:
            x: Force, 0 for a free motion; ``None`` leaves the direction unchanged [stress length].
            y: Force along y, likewise [stress length].
            moment: Moment about the pivot; ``None`` leaves the rotation unchanged
                [stress length^2].

        Raises:
            ValueError: If a value is not a finite number.
        """
        for i, (name, value) in enumerate(zip(("x", "y", "moment"), (x, y, moment), strict=True)):
            if value is not None:
                self.load[i] = check_finite(name, value)

    @property
    def rotation(self) -> Array:
        """Present rotation matrix, shape (2, 2) [1]."""
        c, s = np.cos(self.place[2]), np.sin(self.place[2])
        return np.array([[c, -s], [s, c]])

    def to_own_frame(self, x: Array) -> Array:
        """Points ``x`` (n, 2) [length] in space, in the obstacle's frame."""
        return (x - self.pivot - self.place[:2]) @ self.rotation + self.pivot

    def to_space(self, x: Array) -> Array:
        """Points ``x`` (n, 2) [length] of the obstacle's frame, in space."""
        return (x - self.pivot) @ self.rotation.T + self.pivot + self.place[:2]

    def displacement(self, X: Array) -> Array:
        """Displacements of points ``X`` (n, 2) [length], without cancellation, (n, 2) [length]."""
        angle = self.place[2]
        c, s = -2.0 * np.sin(0.5 * angle) ** 2, np.sin(angle)
        return (X - self.pivot) @ np.array([[c, s], [-s, c]]) + self.place[:2]

    def motions(self, x: Array, arm: float) -> Array:
        """V at the points ``x`` (n, 2) [length] for a length ``arm``, shape (n, 3, 2) [1]."""
        r = (x - self.pivot - self.place[:2]) / arm
        one, zero = np.ones_like(r[:, 0]), np.zeros_like(r[:, 0])
        rows = ((one, zero), (zero, one), (-r[:, 1], r[:, 0]))
        return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def describe_place(where: Array) -> str:
    """Description of a place, shape (3,); "" at the initial position (local)."""
    phrases = [f"moved by {format_point(where)}"] if where[:2].any() else []
    phrases += [f"turned by {where[2]:.4g}"] if where[2] else []
    return ", " + " and ".join(phrases) if phrases else ""
