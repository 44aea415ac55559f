# SPDX-License-Identifier: MIT
"""Rigid motions in the plane and in space, prescribed or driven: of obstacles, and of boundaries.

The motion q has translations and turns, the angles times a length ``arm``: q = (x, y, turn) in the
plane, q = (x, y, z, three turns) in space. The velocities at points x are V dq with
V = (e_x, e_y, ..., e_i x r / arm), r from the pivot, which moves along; e_i are the fixed axes e_z
in the plane and e_x, e_y, e_z in space. The place has translations and the angle, in space the
rotation vector (axis times angle); turns add to angles in the plane only.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.obstacles.rotations import (
    TURNS,
    rotation_by,
    rotation_less_one,
    turn_between,
    vector_of,
)
from fenics_mortar.utils.arguments import check_kind, check_number
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.dimensions import refuse_in_space
from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.lines import lines_cross, near_pairs


def edges_of(corners: Array) -> Array:
    """Vectors from each corner of a polygon (k, 2) to the next one, (k, 2) [length] (local)."""
    return np.roll(corners, -1, axis=0) - corners


def check_chain(points: npt.ArrayLike) -> Array:
    """Copy of three or more points of the plane, shape (k, 2) [length] (local).

    Raises:
        ValueError: For other values.
    """
    chain = check_floats("points", points)
    if chain.ndim != 2 or chain.shape[1] != 2 or len(chain) < 3 or not np.isfinite(chain).all():
        raise ValueError(
            f"points of shape {chain.shape}: expected at least three finite points (k, 2)"
        )
    return chain


def check_simple(what: str, chain: Array, *, closed: bool) -> None:
    """Raise an error if the chain of points (k, 2) intersects itself (local).

    Raises:
        ValueError: If two edges that are not neighbours intersect.
    """
    start, end = (chain, np.roll(chain, -1, axis=0)) if closed else (chain[:-1], chain[1:])
    pairs = near_pairs(start, end)
    after = (pairs[:, 1] - pairs[:, 0]) % (len(start) if closed else len(start) + 1)
    pairs = pairs[(after > 1) & (after < len(start) - 1 if closed else after > 1)]
    meets = lines_cross(start, end, pairs, touching=True)
    if meets.any():
        i, j = pairs[np.argmax(meets)]
        raise ValueError(
            f"the {what} intersects itself: edges from {format_point(start[i])} to "
            f"{format_point(end[i])} and from {format_point(start[j])} to {format_point(end[j])}; "
            "list the points in order along the curve"
        )


def check_floats(name: str, values: Any) -> Array:
    """Copy of an array of real numbers, of any shape [any unit] (local).

    Raises:
        ValueError: If the values are not real numbers.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name}={values!r}: expected real numbers")
    return np.array(array, float)


def check_finite(name: str, value: Any) -> float:
    """A finite number [any unit] (local).

    Raises:
        ValueError: For other values.
    """
    check_number(name, value, "a finite number", np.isfinite)
    return float(value)


def check_vector(name: str, value: npt.ArrayLike, *dims: int) -> Array:
    """Copy of a finite vector [any unit] (local).

    Args:
        name: Name of the option.
        value: Its value.
        dims: Allowed numbers of components; 2 by default.

    Raises:
        ValueError: For other values.
    """
    vector, sizes = check_floats(name, value), dims or (2,)
    if vector.ndim != 1 or vector.size not in sizes or not np.isfinite(vector).all():
        words = " or ".join({2: "two", 3: "three"}[size] for size in sizes)
        raise ValueError(f"{name}={value!r}: expected {words} finite numbers")
    return vector


def check_direction(name: str, value: npt.ArrayLike) -> Array:
    """The unit vector along a vector in space that is not zero, shape (3,) [1] (local).

    Args:
        name: Name of the option.
        value: Its value, of any length.

    Raises:
        ValueError: For other values.
    """
    vector = check_vector(name, value, 3)
    if not np.linalg.norm(vector) > 0.0:
        raise ValueError(f"{name}={value!r}: expected a direction, not zero")
    return np.asarray(vector / np.linalg.norm(vector))


# Names of the translations.
AXES = "xyz"
# Number of coordinates by the number of motions.
DIMENSIONS = {3: 2, 6: 3}


class RigidMotion:
    """A rigid motion and its loads (all methods are local).

    ``move`` prescribes motions, ``push`` prescribes forces. Set both equally on all ranks. Shapes
    have d = 2 coordinates and m = 3 motions in the plane, d = 3 and m = 6 in space.

    Attributes:
        kind: What moves, used in messages.
        name: Name used in messages and tables.
        dim: d, the number of coordinates of the pivot.
        pivot: Initial centre of rotations, moves along, shape (d,) [length]. It may be set as long
            as there is no rotation.
        place: Present translation from the initial position, then in the plane the
            counter-clockwise rotation about the pivot, (x, y, angle), in space the rotation vector,
            axis times angle, (x, y, z, three numbers), shape (m,) [length, radian].
        load: Driving force (x, y) and moment about the pivot, nan for prescribed motions, shape
            (m,) [stress length, stress length, stress length^2].
        reaction: Force and moment about the pivot after the last solve, shape (m,), units as
            ``load``; in space with three more and force and moments [stress length^2,
            stress length^3].

    Raises:
        ValueError: If name or pivot is of another type, or the pivot is not finite.
    """

    kind = "rigid motion"

    def __init__(self, name: str, pivot: npt.ArrayLike = (0.0, 0.0)) -> None:
        """Start at the initial position."""
        check_kind("name", name, str, "a text")
        self.name = name
        self.pivot = check_vector("pivot", pivot, 2, 3)
        self.dim: int = self.pivot.size
        count = self.dim + len(TURNS[self.dim])
        self.place: Array = np.zeros(count)
        self.load: Array = np.full(count, np.nan)
        self.reaction: Array = np.zeros(count)

    def move(
        self,
        *,
        x: float | None = None,
        y: float | None = None,
        z: float | None = None,
        angle: npt.ArrayLike | None = None,
    ) -> None:
        """Prescribe motions; values are absolute, not increments.

        Args:
            x: Translation from the initial position; ``None`` leaves it unchanged [length].
            y: Translation along y, likewise [length].
            z: Translation along z, likewise, in space only [length].
            angle: Counter-clockwise rotation about the pivot, by any number of turns; in space the
                rotation vector, the axis times the angle, shape (3,); ``None`` leaves it unchanged
                [radian].

        Raises:
            ValueError: If a value is not a finite number, or z is given in the plane.
        """
        for i, value in self._along_axes(x, y, z):
            self.place[i], self.load[i] = value, np.nan
        if angle is not None:
            self.place[self.dim :], self.load[self.dim :] = self._checked_turn(angle), np.nan

    def push(
        self,
        *,
        x: float | None = None,
        y: float | None = None,
        moment: float | None = None,
    ) -> None:
        """Prescribe forces; the motions in these directions are unknowns of the next solve.

        In the plane only.

        Args:
            x: Force, 0 for a free motion; ``None`` leaves the direction unchanged [stress length].
            y: Force along y, likewise [stress length].
            moment: Moment about the pivot; ``None`` leaves the rotation unchanged
                [stress length^2].

        Raises:
            ValueError: If a value is not a finite number.
            NotImplementedError: In space.
        """
        if self.dim == 3:
            refuse_in_space("driven", f"{self.kind} '{self.name}'")
        for i, value in self._along_axes(x, y, None):
            self.load[i] = value
        if moment is not None:
            self.load[2] = check_finite("moment", moment)

    def _checked_turn(self, angle: Any) -> float | Array:
        """The angle, in space a copy of the rotation vector, checked."""
        return check_finite("angle", angle) if self.dim == 2 else check_turn(angle)

    def _along_axes(self, *values: float | None) -> list[tuple[int, float]]:
        """Numbers of the axes along which values are given, and the values, checked."""
        given = [(i, value) for i, value in enumerate(values) if value is not None]
        for i, value in given:
            if i >= self.dim:
                raise ValueError(
                    f"{AXES[i]}={value!r}: {self.kind} '{self.name}' is in the plane; one in space "
                    "has a pivot of three numbers"
                )
        return [(i, check_finite(AXES[i], value)) for i, value in given]

    @property
    def turn(self) -> Array:
        """The angle of the place, shape (1,), in space the rotation vector, (3,) [radian]."""
        return self.place[self.dim :]

    @property
    def rotation(self) -> Array:
        """Present rotation matrix, shape (d, d) [1]."""
        return rotation_by(self.turn)

    def turn_since(self, place: Array) -> Array:
        """Rotation vector in space from an earlier place (6,) to the present one, (3,) [radian].

        Prescribed rotations about one axis have any size, others that of the shortest way.
        """
        free = not np.isnan(self.load[3:]).all()
        return turn_between(place[3:], self.turn, shortest=free)

    def to_own_frame(self, x: Array) -> Array:
        """Points ``x`` (n, d) [length] in space, in the obstacle's frame."""
        return (x - self.pivot - self.place[: self.dim]) @ self.rotation + self.pivot

    def to_space(self, x: Array) -> Array:
        """Points ``x`` (n, d) [length] of the obstacle's frame, in space."""
        return (x - self.pivot) @ self.rotation.T + self.pivot + self.place[: self.dim]

    def displacement(self, X: Array) -> Array:
        """Displacements of points ``X`` (n, d) [length], without cancellation, (n, d) [length]."""
        return (X - self.pivot) @ rotation_less_one(self.turn).T + self.place[: self.dim]

    def motions(self, x: Array, arm: float) -> Array:
        """V at the points ``x`` (n, d) [length] for a length ``arm``, shape (n, m, d) [1]."""
        r = (x - self.pivot - self.place[: self.dim]) / arm
        V = np.empty((len(x), self.place.size, self.dim), r.dtype)
        V[:, : self.dim] = np.eye(self.dim)
        V[:, self.dim :] = np.einsum("iab,nb->nia", TURNS[self.dim], r)
        return V


def place_after(mover: RigidMotion, motion: Array, arm: float) -> Array:
    """The place of a mover after a further motion q (local).

    Args:
        mover: It is not changed.
        motion: Shape (m,) [length]; its turns, over the arm, are in space a rotation vector about
            fixed axes.
        arm: Length by which angles are multiplied [length].
    """
    if mover.dim == 2:
        return mover.place + motion / [1.0, 1.0, arm]
    after = rotation_by(motion[3:] / arm) @ mover.rotation
    return np.append(mover.place[:3] + motion[:3], vector_of(after))


def check_turn(angle: npt.ArrayLike) -> Array:
    """Copy of a rotation vector, shape (3,) [radian] (local).

    Raises:
        ValueError: For other values.
    """
    if np.shape(angle) != (3,):
        raise ValueError(
            f"angle={angle!r}: expected in space a rotation vector of three numbers, the axis "
            "times the angle"
        )
    return check_vector("angle", angle, 3)


def describe_place(where: Array) -> str:
    """Description of a place, shape (m,); "" at the initial position (local)."""
    dim = DIMENSIONS[where.size]
    moved, turn = where[:dim], where[dim:]
    phrases = [f"moved by {format_point(moved)}"] if moved.any() else []
    by = f"{turn[0]:.4g}" if dim == 2 else format_point(turn)
    phrases += [f"turned by {by}"] if turn.any() else []
    return ", " + " and ".join(phrases) if phrases else ""
