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

from fenics_mortar.obstacles.rotations import TURNS, rotation_by, rotation_less_one, turn_between
from fenics_mortar.utils.arguments import check_kind, check_number
from fenics_mortar.utils.arrays import Array
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
# Numbers of axes in space about which forces may turn a body: rotations about two fixed axes, but
# not about the third one, would depend on the way.
DRIVEN_TURNS = (0, 1, 3)


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
            (m,) [stress length, stress length, stress length^2]; in space three forces and the
            moments about the fixed axes, of which none, one or all drive
            [stress length^2, stress length^3].
        reaction: Force and moment about the pivot after the last solve, shape (m,), units as
            ``load``.

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
        z: float | None = None,
        moment: npt.ArrayLike | None = None,
    ) -> None:
        """Prescribe forces; the motions in these directions are unknowns of the next solve.

        Args:
            x: Force, 0 for a free motion; ``None`` leaves the direction unchanged [stress length,
                in space stress length^2].
            y: Force along y, likewise [stress length, in space stress length^2].
            z: Force along z, likewise, in space only [stress length^2].
            moment: Moment about the pivot; ``None`` leaves the rotation unchanged
                [stress length^2]. In space the moments about the three axes through the pivot,
                whose directions are fixed, shape (3,); or a moment about one of them and ``None``
                for the others, about which it then does not turn, as on an axle
                [stress length^3].

        Raises:
            ValueError: If a value is not a finite number, z is given in the plane, or moments about
                two axes.
        """
        for i, value in self._along_axes(x, y, z):
            self.load[i] = value
        if moment is not None:
            self.load[self.dim :] = self._checked_moment(moment)

    def _checked_turn(self, angle: Any) -> float | Array:
        """The angle, in space a copy of the rotation vector, checked."""
        return check_finite("angle", angle) if self.dim == 2 else check_turn(angle)

    def _checked_moment(self, moment: Any) -> float | Array:
        """The moment, in space those about three axes, nan for ``None``, checked."""
        return check_finite("moment", moment) if self.dim == 2 else check_moments(moment)

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

    def scales(self, arm: float) -> Array:
        """Motions per component of the place for a length ``arm``, shape (m,) [1, length]."""
        return np.append(np.ones(self.dim), np.full(self.place.size - self.dim, arm))

    @property
    def turn(self) -> Array:
        """The angle of the place, shape (1,), in space the rotation vector, (3,) [radian]."""
        return self.place[self.dim :]

    @property
    def rotation(self) -> Array:
        """Present rotation matrix, shape (d, d) [1]."""
        return rotation_by(self.turn)

    def turn_since(self, place: Array) -> Array:
        """Angle or rotation vector from an earlier place (m,) to the present one, (k,) [radian].

        Rotations about one axis have any size, others, and those free to take any axis, that of the
        shortest way.
        """
        if self.dim == 2:
            return self.turn - place[2:]
        free = np.isfinite(self.load[3:]).all()
        return turn_between(place[3:], self.turn, shortest=bool(free))

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


def check_moments(moment: Any) -> Array:
    """Moments about the three axes, nan for ``None``, shape (3,) [stress length^3] (local).

    Raises:
        ValueError: For other values, and for moments about two axes.
    """
    if np.shape(moment) != (3,):
        raise ValueError(f"moment={moment!r}: expected in space moments about three axes")
    given = [np.nan if one is None else check_finite("moment", one) for one in moment]
    if np.isfinite(given).sum() not in DRIVEN_TURNS:
        raise ValueError(
            f"moment={moment!r}: expected moments about all three axes, or about one of them, "
            "which is then an axle; turns about two fixed axes alone would depend on the way"
        )
    return np.array(given)
