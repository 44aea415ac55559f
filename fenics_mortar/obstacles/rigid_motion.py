# SPDX-License-Identifier: MIT
"""Rigid motions in the plane and in space, prescribed or driven: of obstacles, and of boundaries.

The motion q has translations and turns, the angles times a length ``arm``: q = (x, y, turn) in the
plane, q = (x, y, z, three turns) in space. The velocities at points x are V dq with
V = (e_x, e_y, ..., e_i x r / arm), r from the pivot, which moves along; e_i are the fixed axes e_z
in the plane and e_x, e_y, e_z in space. The place has translations and the angle, in space the
rotation vector (axis times angle); turns add to angles in the plane only.

Motions are composed by ``place_after``, ``motion_between`` and other functions of places, rotations
by ``rotation_by`` and ``vector_of``. ``RigidMotion`` is the motion of an obstacle or a boundary,
with its loads; ``path_of`` fits a rigid motion, a ``RigidPath``, to nodes at the ends of a step.
The other functions check and describe what users give of a motion. ``RIGID`` has the thresholds for
rigid motions of bodies and obstacles.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fenics_mortar.utils.arrays import ASSEMBLY_ROUNDING, ROUNDING, SMALL_ANGLE, TINY, Array, norms
from fenics_mortar.utils.errors import check_finite, check_kind, check_vector, format_point

# Square of an angle [radian^2] below which the functions of ``inverse_factors`` are sums of their
# series, with terms up to the rounding of the first one: B_2k / (2k)! of Bernoulli's numbers.
FULL_SERIES_BELOW = 0.25
BERNOULLI = (1 / 6, 1 / 30, 1 / 42, 1 / 30, 5 / 66, 691 / 2730, 7 / 6, 3617 / 510)
SERIES = np.array([b / math.factorial(2 * k) for k, b in enumerate(BERNOULLI, start=1)])
# Matrices of the products e x r with the axes of rotation e: of the plane, of space.
TURNS = {
    2: np.array([[[0.0, -1.0], [1.0, 0.0]]]),
    3: np.array(
        [
            [[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
            [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]],
            [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
        ]
    ),
}


def turned(r: Array) -> Array:
    """Products e x r of the axes of rotation and ``r`` (n, dim), (axes, n, dim) [its unit] (local).

    Velocities of points at ``r`` that turn by one per time about each axis.
    """
    return np.einsum("iab,nb->ina", TURNS[r.shape[1]], r)


def rigid_motions(X: Array, centre: Array, size: float) -> Array:
    """Translations and rotations about ``centre`` over ``size`` at ``X`` (n, dim) [1] (local).

    Returns:
        Shape (3, n, 2) in the plane: two translations and the rotation; (6, n, 3) in space: three
        translations and the rotations about the three axes.
    """
    moved = np.repeat(np.eye(X.shape[1])[:, None], len(X), axis=1)
    return np.concatenate([moved, turned((X - centre) / size)])


def moments_of(x: Array, p: Array) -> Array:
    """Moments x cross ``p`` about the origin, (axes, n) [length times the unit of p] (local).

    Args:
        x: Positions, shape (n, dim) [length].
        p: Forces or momenta there, shape (n, dim) [any unit].
    """
    return np.einsum("ina,na->in", turned(x), p)


def rotation_by(turn: Array) -> Array:
    """Rotation matrix of an angle, shape (1,), or a rotation vector (3,) [radian] (local)."""
    change = rotation_less_one(turn)
    return np.eye(len(change)) + change


def rotation_less_one(turn: Array) -> Array:
    """The rotation matrix minus one, without cancellation, (d, d) [1] (local).

    With the quaternion q = sin(t / 2) w / t, q_0 = cos(t / 2), t = |w|, and Q v = q x v, the
    rotation by w is R = 1 + 2 (q_0 Q + Q^2) / (q_0^2 + q^2), in the plane with w along e_z. The
    divisor is one but for rounding, which thus does not stretch; with Q^2 = q q^T - q^2, whose
    diagonal has one common rounding of q^2, R R^T is one to 1e-15 (matrix product: 1.3e-15).
    """
    half = 0.5 * np.sqrt(turn @ turn) + TINY
    q, q_0 = np.sin(half) / (2.0 * half) * turn, np.cos(half)
    Q = np.tensordot(q, TURNS[2 if turn.size == 1 else 3], 1)
    along = np.outer(q, q) if turn.size == 3 else 0.0
    square = along - (q @ q) * np.eye(len(Q))
    return 2.0 / (q @ q + q_0**2) * (q_0 * Q + square)


def vector_of(R: Array) -> Array:
    """The rotation vector (3,) of a matrix, the angle (1,) of one of the plane [radian] (local).

    Of at most half a turn.
    """
    if len(R) == 2:
        return np.arctan2(R[1, :1], R[0, :1])
    from scipy.spatial.transform import Rotation  # not imported by problems in the plane

    return np.asarray(Rotation.from_matrix(R).as_rotvec())


def vector_beside(R: Array, near: Array) -> Array:
    """The rotation vector or angle (n,) [radian] of a matrix that is next to ``near`` (n,) (local).

    Those of a matrix, (2, 2) or (3, 3), differ by full turns about its axis.
    """
    return _beside(vector_of(R), near)


def _beside(least: Array, near: Array) -> Array:
    """The rotation vector that differs by full turns from one and is next to another."""
    angle = float(np.linalg.norm(least))
    axis = least if angle > 0.0 else near  # no rotation has any axis
    size = float(np.linalg.norm(axis))
    if size == 0.0:
        return least
    full = 2.0 * np.pi * np.round((axis @ near / size - angle) / (2.0 * np.pi))
    return least + full / size * axis


def polar(F: Array) -> tuple[Array, Array]:
    """The rotations R and principal stretches of F = R U (local).

    Args:
        F: Matrices, shape (..., d, d), in the plane or in space [any unit].

    Returns:
        R, shape (..., d, d) [1], a rotation for det F < 0, too: the last one of the stretches,
        shape (..., d) [unit of F], in descending order of their sizes, is then negative.
    """
    left, stretches, right = np.linalg.svd(F)
    sign = np.where(np.linalg.det(left @ right) < 0.0, -1.0, 1.0)
    left[..., -1] *= sign[..., None]
    stretches[..., -1] *= sign
    return left @ right, stretches


def turn_between(first: Array, last: Array, *, shortest: bool = False) -> Array:
    """The rotation vector (3,) [radian] that leads from one rotation vector to another (local).

    About one axis it is the difference, of any size, unless the shortest way is asked for; also of
    angles of the plane, (1,).
    """
    if first.size == 1:
        return last - first
    size = np.linalg.norm(first) * np.linalg.norm(last)
    if not shortest and np.linalg.norm(np.cross(first, last)) <= ROUNDING * size:
        return last - first
    return vector_of(rotation_by(last) @ rotation_by(first).T)


def turns_between(first: Array, last: Array, *, own: bool = False) -> Array:
    """``turn_between`` of rows, nan where one is unknown, (n, 3) [radian] (local).

    Args:
        first: Rotation vectors, shape (n, 3) [radian].
        last: Likewise.
        own: Whether turns are those seen by the first one, next to the differences of the vectors.
    """
    rows, number = np.unique(np.hstack([first, last]), axis=0, return_inverse=True)
    turns = np.full((len(rows), 3), np.nan)
    for k in np.flatnonzero(np.isfinite(rows).all(axis=1)):
        w_0, w = np.split(rows[k], 2)
        turns[k] = turn = turn_between(w_0, w)
        if own:
            turns[k] = _beside(rotation_by(w_0).T @ turn, w - w_0)
    return turns[number.ravel()]


def inverse_factors(v: Array) -> tuple[Array, Array]:
    """Functions b and b' / |v| of J(v)^-1 = 1 - V / 2 + b V^2, of vectors [radian], each (n,).

    Local. J(v) = int_0^1 exp(t V) dt with the matrix V of the product v x; b = (1 - h cot h) / t^2
    with t = |v| and h = t / 2.
    """
    t2: Array = (v * v).sum(axis=1)
    small = t2 < FULL_SERIES_BELOW
    powers = t2[:, None] ** np.arange(len(SERIES))
    of_slope = 2.0 * np.arange(1, len(SERIES)) * SERIES[1:]
    t: Array = np.sqrt(np.where(small, 1.0, t2))
    cot, sine = 1.0 / np.tan(0.5 * t), np.sin(0.5 * t)
    b = (1.0 - 0.5 * t * cot) / t**2
    slope = 0.5 * (0.5 * t / sine**2 - cot) / t**3 - 2.0 * b / t**2
    b[small], slope[small] = (powers @ SERIES)[small], (powers[:, :-1] @ of_slope)[small]
    return b, slope


def inverse_jacobians(v: Array) -> Array:
    """J(v)^-1 of rotation vectors (n, 3) [radian]: change by a spin, (n, 3, 3) (local)."""
    V, (b, _) = crosses(v), inverse_factors(v)
    return np.asarray(np.eye(3) - 0.5 * V + b[:, None, None] * (V @ V), float)


def crosses(v: Array) -> Array:
    """Matrices (..., 3, 3) of the products v x, for vectors (..., 3) [any unit] (local)."""
    return np.einsum("...i,iab->...ab", v, TURNS[3])


# Number of coordinates by the number of motions.
DIMENSIONS = {3: 2, 6: 3}


def place_after(place: Array, motion: Array, arm: float) -> Array:
    """The place after a further motion, shape (m,) [length, radian] (local).

    In space the turns of a motion are a rotation vector, too: the place after it has the rotation
    exp(turn / arm) R. The vector of this rotation is the one next to that before, so that a body
    may turn any number of times.

    Args:
        place: The place before, shape (m,) [length, radian].
        motion: The motion q, shape (m,) [length].
        arm: Length by which angles are multiplied [length].
    """
    if place.size == 3:
        return place + motion / [1.0, 1.0, arm]
    after = rotation_by(motion[3:] / arm) @ rotation_by(place[3:])
    return np.append(place[:3] + motion[:3], vector_beside(after, place[3:]))


def motion_between(before: Array, after: Array, arm: float) -> Array:
    """The motion q that leads from one place to another, shape (m,) [length] (local).

    In space rotations about one axis have any size, others that of the shortest way.
    """
    dim = DIMENSIONS[before.size]
    return np.append(after[:dim] - before[:dim], arm * turn_between(before[dim:], after[dim:]))


def by_further_motion(motion: Array, arm: float) -> Array:
    """Derivative of ``motion_between`` by a further motion after it, shape (m, m) [1] (local)."""
    derivative = np.eye(motion.size)
    if motion.size == 6:
        derivative[3:, 3:] = inverse_jacobians(motion[None, 3:] / arm)[0]
    return derivative


def places_towards(places: Array, others: Array, fraction: float) -> Array:
    """Places of m bodies part of the way to others, both (m, 3) or (m, 6) (local).

    Args:
        places: The places at the fraction 0 [length, radian].
        others: Those at the fraction 1.
        fraction: Part of the way [1]; extrapolation below 0 and above 1.
    """
    ends = zip(places, others, strict=True)
    found = [place_after(a, fraction * motion_between(a, b, 1.0), 1.0) for a, b in ends]
    return np.reshape(found, places.shape)


def describe_place(where: Array) -> str:
    """Description of a place, shape (m,); "" at the initial position (local)."""
    dim = DIMENSIONS[where.size]
    moved, turn = where[:dim], where[dim:]
    phrases = [f"moved by {format_point(moved)}"] if moved.any() else []
    by = f"{turn[0]:.4g}" if dim == 2 else format_point(turn)
    phrases += [f"turned by {by}"] if turn.any() else []
    return ", " + " and ".join(phrases) if phrases else ""


def describe_load(load: Array, force: str = "force", *, is_axial: bool = False) -> str:
    """Description of a ``force`` and a moment, shape (m,) as places; of the axial force (local)."""
    dim = DIMENSIONS[load.size]
    if is_axial:
        return f"axial {force} {load[1] + 0.0:.4g}"
    moment = f"{load[2] + 0.0:.4g}" if dim == 2 else format_point(load[3:])
    return f"{force} {format_point(load[:dim])}, moment {moment}"


# Extent of prescribed nodes, in space across a line, over their distance from the origin [1], below
# which they do not tell a rotation.
SLENDER = 1e-6
# Distance of prescribed nodes from a rigid motion over their motion [1], below which they turn: the
# ends of a beam that is bent do not. A stretch of 5 % beside a quarter of a turn.
STRETCHED = 0.05


def turn_of(x0: Array, x1: Array, stretched: float) -> Array:
    """Rotation of nodes, an angle (1,) or a vector (3,), of at most half a turn [radian] (local).

    Zero for nodes that do not determine a rotation.

    Args:
        x0: Their positions, shape (n, d) [length].
        x1: Their positions later.
        stretched: Distance from a rigid motion over the motion [1] above which they do not turn.
    """
    y0, y1 = x0 - x0.mean(axis=0), x1 - x1.mean(axis=0)
    none = np.zeros(len(TURNS[x0.shape[1]]))
    if not tells_turn(x0):
        return none
    R, _ = polar(y1.T @ y0)
    if stretched < np.inf:
        apart, moved = (np.linalg.norm(y - y0 @ R.T) for y in (y1, y0))
        if apart > stretched * moved:
            return none
    return vector_of(R)


def tells_turn(x0: Array) -> bool:
    """Whether nodes (n, d) determine a rotation: not one point; in space not points on a line."""
    dim = x0.shape[1]
    if len(x0) < dim:
        return False
    extents = np.linalg.svd(x0 - x0.mean(axis=0), compute_uv=False)
    return bool(extents[dim - 2] > SLENDER * float(np.linalg.norm(x0)))


class RigidPath(NamedTuple):
    """Motion of a rigid frame in a step: a point on a straight line, and a rotation about it.

    Attributes:
        start: The point at the start, shape (dim,) [length].
        end: The point at the end, shape (dim,) [length].
        turn: Angle of the rotation, shape (1,), in space its vector, (3,), of any size [radian].
    """

    start: Array
    end: Array
    turn: Array

    @property
    def angle(self) -> float:
        """Angle of the rotation, in space without sign [radian]."""
        return float(self.turn[0] if self.turn.size == 1 else np.linalg.norm(self.turn))

    def turned(self, vectors: Array, t: float) -> Array:
        """Vectors (n, dim) [any unit] turned by the rotation up to ``t``, negative: back."""
        return vectors @ rotation_by(t * self.turn).T

    def carry(self, x: Array, t: float) -> Array:
        """Positions at ``t``, 0 to 1, of points at ``x`` (n, dim) at the start [length]."""
        return self._centre(t) + self.turned(x - self.start, t)

    def back(self, x: Array, t: float) -> Array:
        """Positions at the start of points that are at ``x`` (n, dim) at ``t`` [length]."""
        return self.start + self.turned(x - self._centre(t), -t)

    def is_followed(self, x0: Array, x1: Array) -> bool:
        """Whether nodes (n, dim) [length], one or more, follow the motion from ``x0`` to ``x1``.

        Not if they were not where a rigid boundary was at the start.
        """
        apart = norms(self.carry(x0, 1.0) - x1).max(initial=0.0)
        return bool(apart <= SMALL_ANGLE * norms(x0 - self.start).max(initial=0.0))

    def turns_as(self, other: RigidPath) -> bool:
        """Whether another motion has the same rotation, up to full turns."""
        apart = rotation_by(self.turn) @ rotation_by(other.turn).T
        return bool(np.linalg.norm(vector_of(apart)) <= SMALL_ANGLE)

    def _centre(self, t: float) -> Array:
        return self.start + t * (self.end - self.start)

    def backwards(self) -> RigidPath:
        """The motion to the same positions with the other sense of rotation."""
        factor = 1.0 - 2.0 * np.pi / abs(self.angle) if self.angle else 0.0
        return self._replace(turn=factor * self.turn)

    def about_fixed_point(self, body: Array, *, inside: bool = True) -> RigidPath:
        """The motion about a fixed point, in space along an axis, to the same positions.

        Args:
            body: Nodes of the body at the start, shape (n, dim) [length]. The point is inside the
                body if it is nearer to ``start`` than the farthest one.
            inside: Whether the point has to be inside the body, or outside.

        Returns:
            The motion itself if the point is elsewhere, or if nothing turns.
        """
        angle, dim = abs(self.angle), self.start.size
        if angle <= SMALL_ANGLE:
            return self
        axis = np.pad(self.turn, (3 - self.turn.size, 0)) / angle
        shift = np.pad(self.end - self.start, (0, 3 - dim))
        across = shift - (axis @ shift) * axis
        to_axis = 0.5 * (across + np.cross(axis, across) / np.tan(0.5 * angle))
        if (np.linalg.norm(to_axis) < norms(body - self.start).max()) != inside:
            return self
        fixed = self.start + to_axis[:dim]
        return RigidPath(fixed, fixed + (shift - across)[:dim], self.turn)


def path_of(x0: Array, x1: Array, stretched: float = np.inf) -> RigidPath:
    """Rigid motion that fits that of nodes (n, d) from ``x0`` to ``x1`` best (Kabsch 1976) (local).

    The mean of the nodes moves on a straight line; for ``stretched`` see ``turn_of``.
    """
    return RigidPath(x0.mean(axis=0), x1.mean(axis=0), turn_of(x0, x1, stretched))


def motion_of(mover: RigidMotion, before: Array, after: Array) -> RigidPath:
    """Motion of an obstacle or a boundary between places (m,) [length, radian] (local).

    In space ``after`` is its present place.
    """
    dim = mover.dim
    turn = after[2:] - before[2:] if dim == 2 else mover.turn_since(before)
    return RigidPath(mover.pivot + before[:dim], mover.pivot + after[:dim], turn)


# Names of the translations.
AXES = "xyz"
# What an angle or a moment in the plane is expected to be.
ABOUT_Z = "a finite number, in the plane the one about z"
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
            plane = self.dim == 2
            turn = check_finite("angle", angle, ABOUT_Z) if plane else check_turn(angle)
            self.place[self.dim :], self.load[self.dim :] = turn, np.nan

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
            plane = self.dim == 2
            about = check_finite("moment", moment, ABOUT_Z) if plane else check_moments(moment)
            self.load[self.dim :] = about

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
    def present_pivot(self) -> Array:
        """Present position of the pivot, shape (d,) [length]."""
        return np.asarray(self.pivot + self.place[: self.dim])

    @property
    def rotation(self) -> Array:
        """Present rotation matrix, shape (d, d) [1]."""
        return rotation_by(self.turn)

    def turn_since(self, place: Array) -> Array:
        """Angle or rotation vector from an earlier place (m,) to the present one, (k,) [radian].

        Rotations about one axis have any size, others, and those free to take any axis, that of the
        shortest way.
        """
        free = np.isfinite(self.load[self.dim :]).all()
        return turn_between(place[self.dim :], self.turn, shortest=bool(free))

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
        return np.moveaxis(rigid_motions(x, self.present_pivot, arm), 0, 1)


@contextmanager
def at_place(motion: RigidMotion | None, place: Array) -> Iterator[None]:
    """Context in which an obstacle, if there is one, is at another place, shape (m,) (local)."""
    if motion is None:
        yield
        return
    present, motion.place = motion.place, place.copy()
    try:
        yield
    finally:
        motion.place = present


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
        raise ValueError(
            f"moment={moment!r}: expected in space moments about x, y and z, or about one of them "
            "as on an axle, (None, None, 2.0), with None for those about which it does not turn"
        )
    given = [np.nan if one is None else check_finite("moment", one) for one in moment]
    if np.isfinite(given).sum() not in DRIVEN_TURNS:
        raise ValueError(
            f"moment={moment!r}: expected moments about all three axes, or about one of them and "
            "None for the others, as on an axle; turns about two fixed axes would depend on the way"
        )
    return np.array(given)


@dataclass(frozen=True)
class RigidOptions:
    """Thresholds for rigid motions, common to floating bodies and driven obstacles.

    Attributes:
        resisted: Contact resists a motion if it changes gaps, or the slip of sticking nodes, by
            more than this fraction of its size [1].
        weakest_spring: Smallest stiffness of a spring over the largest diagonal entry of K [1]:
            enough for a regular matrix.
        weakest_anchor: Smallest stiffness of an anchored spring that forces determine [1]: a weight
            of a millionth of the stiffness moves a body. Smaller forces are rounding.
        stiffness_rounding: Resultants over stiffness times size that are roundoff of the bulk
            residual [1].
        negligible: Resultants below this fraction of the forces are within the error of the
            discretization [1]: 0.5 %. Springs may carry them. Obstacles, whose normals are exact,
            are subject to such an error of the slave's facets.
        slight: Resultants below this fraction of the forces are small compared with the error of
            contact forces along averaged normals, and with ``negligible`` [1]. Springs may not
            carry more on a body that slides at its friction limit, since they alone would stop it;
            on others a larger force has a remark.
        normals_err: Error of contact forces along averaged normals of two meshes [1].
        overlap: Overlap of nodes over their length at the end of motions before a solve [1], so
            that the nodes are active. Bodies that move by less are considered at rest, also with
            springs.
        largest_move: Largest motion in one move over the size of the body [1]: gaps are linear in
            smaller motions.
        max_moves: Largest number of moves before a solve.
        max_creeping: Number of successive moves, all shorter than ``overlap``, after which the
            bodies are considered stopped. A remaining creep, such as that of a disk in a ring, is
            left to Newton's method.
        followed: Relative singular-value cutoff of the least-squares fit to nodes that stick [1]:
            combinations of motions with small slip, such as rolling, are left to the solve.
        elongation: Elongation of anchored springs per solve [shortest facets].
        recovery: Factor by which a smaller elongation grows after a solve [1]; after a failure it
            shrinks by the cube of this factor.
        max_solves: Largest number of solves with springs.
        steady: Number of solves with springs in a row after which a slide is endless: their forces
            are equal, to ``overlap``, and no node is open that could stop it.
        max_readmissions: Number of times that an idle body is squeezed in a solve after which it
            takes part in contact to the end: Newton's method overestimates forces once or twice.
        narrowest: Slope of a wedge [1] below which it is squeezed between its neighbours, not out
            of the way: the smallest friction of dry contact. With more friction, its coefficient.
        one_sided: Force of springs over the contact force on an idle body [1] above which contact
            presses it against the springs alone: 1 if it touches one plane, sin(a) between two that
            include the angle 2 a.
        max_failures: Number of failures in a row after which the solve fails: the elongation is
            below 1e-4 facets then.
        max_toppling: Number of successive solves with springs by which a body tips over, each with
            larger forces of springs: round bodies roll onto the next node in one or two.
        repeats: Number of solves with springs that remain: contact forces then are as large as
            possible.
        sliver: Length over the shortest facet that is considered zero [1]: the advance of an
            obstacle in a move, or the overlap of surfaces that slip off each other.
    """

    resisted: float = 1e-3
    weakest_spring: float = 1e-6
    weakest_anchor: float = 1e-9
    stiffness_rounding: float = ASSEMBLY_ROUNDING
    negligible: float = 0.005
    slight: float = 1e-5
    normals_err: float = 0.05
    overlap: float = 0.01
    largest_move: float = 0.2
    max_moves: int = 200
    max_creeping: int = 10
    followed: float = 0.5
    elongation: float = 0.25
    recovery: float = 2.0
    max_solves: int = 24
    steady: int = 4
    max_readmissions: int = 3
    narrowest: float = 0.1
    one_sided: float = 0.5
    max_failures: int = 5
    max_toppling: int = 3
    repeats: int = 3
    sliver: float = 1e-3


RIGID = RigidOptions()
