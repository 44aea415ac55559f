# SPDX-License-Identifier: MIT
"""Shapes of rigid obstacles: plane, circle, sphere, spline, rounded polygon.

The pivot is the centre of rotations only: a shape does not depend on it. Shapes of the plane become
obstacles in space by ``revolved``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.sparse import eye
from scipy.sparse.linalg import spsolve

from fenics_mortar.obstacles.obstacle import Fields, Obstacle, distance_fields
from fenics_mortar.utils import arrays, errors

if TYPE_CHECKING:
    from fenics_mortar.utils.arrays import Array, Indices


def edges_of(corners: Array) -> Array:
    """Vectors from each corner of a polygon (k, 2) to the next one, (k, 2) [length] (local)."""
    return np.roll(corners, -1, axis=0) - corners


def check_chain(points: npt.ArrayLike) -> Array:
    """Copy of three or more points of the plane, shape (k, 2) [length] (local).

    Raises:
        ValueError: For other values.
    """
    chain = errors.check_floats("points", points)
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
    pairs = arrays.near_pairs(start, end)
    after = (pairs[:, 1] - pairs[:, 0]) % (len(start) if closed else len(start) + 1)
    pairs = pairs[(after > 1) & (after < len(start) - 1 if closed else after > 1)]
    meets = arrays.lines_cross(start, end, pairs, touching=True)
    if meets.any():
        i, j = pairs[np.argmax(meets)]
        raise ValueError(
            f"the {what} intersects itself: edges from {errors.format_point(start[i])} to "
            f"{errors.format_point(end[i])} and from {errors.format_point(start[j])} to "
            f"{errors.format_point(end[j])}; list the points in order along the curve"
        )


# Complex step of the points of a spline, over 1j [length]: too small for a rounding.
SPLINE_STEP = 1e-30


def bends_of(P: Array, *, closed: bool) -> Array:
    """Second derivatives by arc length M of the spline through points, (k, 2) [1 / length] (local).

    They solve the equations of continuous slopes, a linear system of the chords.

    Args:
        P: Points, real or complex, shape (k, 2) [length]; of a closed curve the last is the first.
        closed: Whether the curve is closed; it has zero curvature at its ends otherwise.
    """
    chords = np.diff(P, axis=0)
    h = np.sqrt((chords**2).sum(axis=1))
    slopes, rows = chords / h[:, None], np.arange(1, len(P) - 1)
    A, jumps = eye(len(P), dtype=P.dtype, format="lil"), np.zeros_like(P)
    A[rows, rows - 1], A[rows, rows + 1] = h[:-1] / 6.0, h[1:] / 6.0
    A[rows, rows], jumps[rows] = (h[:-1] + h[1:]) / 3.0, np.diff(slopes, axis=0)
    if closed:
        A[0, [-2, 0, 1]] = h[-1] / 6.0, (h[-1] + h[0]) / 3.0, h[0] / 6.0
        A[-1, 0], jumps[0] = -1.0, slopes[0] - slopes[-1]
    return np.asarray(spsolve(A.tocsc(), jumps))


def spline_at(P: Array, M: Array, i: Indices, s: Array) -> Array:
    """Points of a spline, and their first and second derivatives by s, (3, n, 2) (local).

    With chords h_i of the points P_i and second derivatives M_i at them, see ``bends_of``, the
    curve between two points is, at the fraction s of the parameter, r = 1 - s,

        c = r P_i + s P_{i+1} + h_i^2 / 6 [(r^3 - r) M_i + (s^3 - s) M_{i+1}].

    Args:
        P: Points, shape (k, 2) [length].
        M: Second derivatives, shape (k, 2) [1 / length].
        i: Numbers of intervals, shape (n,).
        s: Fractions of these, shape (n,).
    """
    chord, s = P[i + 1] - P[i], s[:, None]
    r, bend = 1.0 - s, (chord**2).sum(axis=1)[:, None] / 6.0
    c = r * P[i] + s * P[i + 1] + bend * ((r**3 - r) * M[i] + (s**3 - s) * M[i + 1])
    slope = (1.0 - 3.0 * r**2) * M[i] + (3.0 * s**2 - 1.0) * M[i + 1]
    return np.stack([c, chord + bend * slope, 6.0 * bend * (r * M[i] + s * M[i + 1])])


# Samples of a spline per interval; Newton's method starts from the nearest one.
SAMPLES = 16


class Plane(Obstacle):
    """Half plane, or half space; ``normal`` points out of the solid.

    Args:
        point: Point of the surface, shape (2,), in space (3,) [length].
        normal: Outward normal of the solid, of any length, of the shape of the point.
        pivot: Centre of rotations; the point by default [length].
        name: Name used in messages.

    Raises:
        ValueError: If an argument is not finite, or the normal is zero.
    """

    def __init__(
        self,
        point: npt.ArrayLike,
        normal: npt.ArrayLike,
        *,
        pivot: npt.ArrayLike | None = None,
        name: str = "plane",
    ) -> None:
        """Normalise the normal."""
        self._point = errors.check_vector("point", point, 2, 3)
        super().__init__(name, self._point if pivot is None else pivot)
        self._normal = errors.check_direction("normal", normal, self.dim)

    def local(self, x: Array) -> Fields:
        """Distance to a straight line or a plane; see ``Obstacle.local``."""
        gradient = np.broadcast_to(self._normal, x.shape)
        return (x - self._point) @ self._normal, gradient, np.zeros((*x.shape, self.dim))


class _Ball(Obstacle):
    """Solid disk or ball, or with ``inside`` a solid with a round hole."""

    _dim: int
    _name: str

    def __init__(
        self,
        centre: npt.ArrayLike,
        radius: float,
        *,
        inside: bool = False,
        pivot: npt.ArrayLike | None = None,
        name: str | None = None,
    ) -> None:
        """Check the radius."""
        self._centre = errors.check_vector("centre", centre, self._dim)
        super().__init__(name or self._name, self._centre if pivot is None else pivot)
        errors.check_flag("inside", inside)
        self.set_shape("radius", np.asarray(radius))
        self._sign = -1.0 if inside else 1.0

    def shape(self) -> dict[str, Array]:
        """The radius [length]; see ``Obstacle.shape``."""
        return {"radius": np.asarray(self._radius)}

    def set_shape(self, name: str, values: Array) -> None:
        """Set the radius; see ``Obstacle.set_shape``."""
        if name != "radius":
            super().set_shape(name, values)
        radius = np.asarray(values).item()
        errors.check_number("radius", radius, "a positive length", lambda r: 0.0 < r < np.inf)
        self._radius = float(radius)

    def local_by_shapes(self, x: Array, name: str, directions: Array) -> tuple[Array, Array]:
        """The distance decreases by the change of the radius; see ``Obstacle.local_by_shapes``."""
        phi = np.tile(-self._sign * np.reshape(directions, (-1, 1)), len(x))
        return phi, np.zeros((len(phi), *x.shape))

    def local(self, x: Array) -> Fields:
        """Distance to a circle or a sphere; see ``Obstacle.local``.

        At the centre the gradient is set to the y direction.
        """
        d, upward = x - self._centre, np.zeros(self.dim)
        upward[1] = arrays.EPSILON * self._radius
        d = np.where(np.abs(d).max(axis=1, keepdims=True) > 0.0, d, upward)
        every, sign = np.ones(len(x), bool), self._sign
        phi, gradient, hessian = distance_fields(d, d, every, ~every, self._radius)
        return sign * phi, sign * gradient, sign * hessian

    def salient_points(self) -> Array:
        """Points of the surface all around; see ``Obstacle.salient_points``."""
        steps = np.stack(np.meshgrid(*[(-1.0, 0.0, 1.0)] * self.dim, indexing="ij"), axis=-1)
        around = steps.reshape(-1, self.dim)
        around = around[around.any(axis=1)]
        return self._centre + self._radius * around / np.linalg.norm(around, axis=1)[:, None]


class Circle(_Ball):
    """Disk, or with ``inside`` a solid with a round hole.

    Args:
        centre: Centre, shape (2,) [length].
        radius: Radius [length].
        inside: Contact on the inside: the solid lies outside the circle.
        pivot: Centre of rotations; the centre of the circle by default [length].
        name: Name used in messages; "circle" by default.

    Raises:
        ValueError: If an argument has a value that is not allowed.
    """

    _dim = 2
    _name = "circle"


class Sphere(_Ball):
    """Ball, or with ``inside`` a solid with a spherical hole.

    Args:
        centre: Centre, shape (3,) [length].
        radius: Radius [length].
        inside: Contact on the inside: the solid lies outside the sphere.
        pivot: Centre of rotations; the centre of the sphere by default [length].
        name: Name used in messages; "sphere" by default.

    Raises:
        ValueError: If an argument has a value that is not allowed.
    """

    _dim = 3
    _name = "sphere"


class Spline(Obstacle):
    """Cubic spline through a chain of points, with the solid on its left.

    An open curve has zero curvature at its ends and is continued by straight lines.

    Args:
        points: Points in order along the curve, shape (k, 2), at least three [length].
        closed: Whether the last point is joined to the first; do not repeat it.
        pivot: Centre of rotations; the mean of the points by default [length].
        name: Name used in messages.

    Raises:
        ValueError: If two successive points coincide, or the curve intersects itself.
    """

    def __init__(
        self,
        points: npt.ArrayLike,
        *,
        closed: bool = False,
        pivot: npt.ArrayLike | None = None,
        name: str = "spline",
    ) -> None:
        chain = check_chain(points)
        super().__init__(name, chain.mean(axis=0) if pivot is None else pivot)
        self._closed = closed
        self._interpolate(chain)

    def shape(self) -> dict[str, Array]:
        """The points, shape (k, 2) [length]; see ``Obstacle.shape``."""
        return {"points": self._chain.copy()}

    def set_shape(self, name: str, values: Array) -> None:
        """Set the points; see ``Obstacle.set_shape``."""
        if name != "points":
            super().set_shape(name, values)
        self._interpolate(check_chain(values))

    def _interpolate(self, points: Array) -> None:
        """Interpolate points (k, 2) by chord length."""
        closed, self._chain = self._closed, points
        chain = np.vstack([points, points[:1]]) if closed else points
        chords = np.linalg.norm(np.diff(chain, axis=0), axis=1)
        if not chords.min() > 0.0:
            raise ValueError("two successive points of the spline coincide")
        self._knots = np.concatenate([[0.0], np.cumsum(chords)])
        self._curve, self._end = (chain, bends_of(chain, closed=closed)), float(self._knots[-1])
        fractions = np.linspace(0.0, 1.0, SAMPLES, endpoint=False)
        starts = (self._knots[:-1, None] + chords[:, None] * fractions).ravel()
        self._samples = np.append(starts, self._end)
        drawn = self._jet(self._samples)[0]
        check_simple("spline", drawn[:-1] if closed else drawn, closed=closed)
        self._origin = points.mean(axis=0)
        self._points = drawn - self._origin
        self._squares = (self._points**2).sum(axis=1)

    def local(self, x: Array) -> Fields:
        """Distance to the nearest point of the curve; see ``Obstacle.local``.

        Newton's method from the nearest sample, or from the foot on the line beyond an end.
        """
        phi, normal, curvature, _ = self._distance_from_foot(x, self._feet(x))
        bend = curvature / (1.0 + curvature * phi)
        tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        return phi, normal, bend[:, None, None] * np.einsum("ia,ib->iab", tangent, tangent)

    def salient_points(self) -> Array:
        """The samples; see ``Obstacle.salient_points``."""
        return self._points + self._origin

    def local_by_shapes(self, x: Array, name: str, directions: Array) -> tuple[Array, Array]:
        """By differentiating the spline; see ``Obstacle.local_by_shapes``.

        The distance phi of a point with the foot c changes by -n . dc, n the normal; this is
        constant along n, so that its gradient is along the tangent.
        """
        t = self._feet(x)
        phi, normal, curvature, speed = self._distance_from_foot(x, t)
        dc, dd = self._changes(t, directions)
        tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        along = curvature * np.einsum("nc,mnc->mn", tangent, dc)
        change = -(along + np.einsum("nc,mnc->mn", normal, dd) / speed) / (1.0 + curvature * phi)
        return -np.einsum("nc,mnc->mn", normal, dc), change[..., None] * tangent

    def _changes(self, t: Array, directions: Array) -> tuple[Array, Array]:
        """Changes dc [length] and d(dc/dt) [1] at fixed fractions of the intervals, (m, n, 2) each.

        Args:
            t: Parameters, shape (n,) [length].
            directions: Changes of the points, shape (m, k, 2) [length].
        """
        on, i, s, h = self._place(t)
        moved = []
        for way in directions:
            P = self._chain + SPLINE_STEP * 1j * way
            P = np.vstack([P, P[:1]]) if self._closed else P
            moved.append(spline_at(P, bends_of(P, closed=self._closed), i, s)[:2])
        dc, dd = np.moveaxis(np.imag(moved) / SPLINE_STEP, 1, 0)
        dd = dd / h
        return dc + (t - on)[:, None] * dd, dd

    def _place(self, t: Array) -> tuple[Array, Indices, Array, Array]:
        """Parameters on the curve, their intervals, the fractions and (n, 1) lengths of these."""
        knots = self._knots
        on = np.clip(t, 0.0, self._end)
        i = np.clip(np.searchsorted(knots, on, side="right") - 1, 0, len(knots) - 2)
        h = np.diff(knots)[i]
        return on, i, (on - knots[i]) / h, h[:, None]

    def _feet(self, x: Array) -> Array:
        """Parameters of the nearest points of the curve, shape (n,) [length]."""
        squares = self._squares - 2.0 * (x - self._origin) @ self._points.T
        t = self._samples[np.argmin(squares, axis=1)]
        for end, sign in () if self._closed else ((0.0, -1.0), (self._end, 1.0)):
            (c,), (d,), _ = self._jet(np.array([end]))
            beyond = (x - c) @ d / (d @ d)  # of points beyond an end, to their feet on its line
            t = np.where((t == end) & (sign * beyond > 0.0), end + beyond, t)
        longest = np.diff(self._samples).max()
        for _ in range(arrays.MAX_STEPS):
            c, d, dd = self._jet(t)
            slope = np.einsum("ia,ia->i", c - x, d)
            square = np.einsum("ia,ia->i", d, d)
            bend = square + np.einsum("ia,ia->i", c - x, dd)
            step = np.clip(slope / np.where(bend > 0.0, bend, square), -longest, longest)
            t = (t - step) % self._end if self._closed else t - step
            if np.abs(step).max(initial=0.0) < arrays.ROUNDING * self._end:
                break  # the error of the last step is quadratic in the step
        return t

    def _distance_from_foot(self, x: Array, t: Array) -> tuple[Array, Array, Array, Array]:
        """Distance (n,), normal (n, 2), curvature (n,) and speed (n,) at the feet ``t``."""
        c, d, dd = self._jet(t)
        speed = np.linalg.norm(d, axis=1)
        tangent = d / speed[:, None]
        normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
        phi = np.einsum("ia,ia->i", x - c, normal)
        return phi, normal, arrays.cross_in_plane(d, dd) / speed**3, speed

    def _jet(self, t: Array) -> Fields:
        """Point and two derivatives; an open curve is straight beyond its ends."""
        on, i, s, h = self._place(t)
        c, d, dd = spline_at(*self._curve, i, s)
        beyond = (t - on)[:, None]
        return c + beyond * d / h, d / h, np.where(beyond == 0.0, dd / h**2, 0.0)


class Polygon(Obstacle):
    """Solid polygon whose convex corners are rounded by arcs.

    phi is the distance to an inner polygon less the radius; concave corners stay sharp.

    Args:
        points: Corners in order, shape (k, 2), at least three [length].
        rounding: Radius of the arcs, positive [length].
        pivot: Centre of rotations; the mean of the corners by default [length].
        name: Name used in messages.

    Raises:
        ValueError: If two successive corners coincide, the polygon intersects itself, or the radius
            is too large for its edges.
    """

    def __init__(
        self,
        points: npt.ArrayLike,
        rounding: float,
        *,
        pivot: npt.ArrayLike | None = None,
        name: str = "polygon",
    ) -> None:
        """Move the edges inwards by the radius."""
        corners = check_chain(points)
        super().__init__(name, corners.mean(axis=0) if pivot is None else pivot)
        errors.check_number("rounding", rounding, "a positive length", lambda r: 0.0 < r < np.inf)
        check_simple("polygon", corners, closed=True)
        if arrays.cross_in_plane(corners, np.roll(corners, -1, axis=0)).sum() < 0.0:
            corners = corners[::-1]
        edges = edges_of(corners)
        lengths = np.linalg.norm(edges, axis=1)[:, None]
        if not lengths.min() > 0.0:
            raise ValueError("two successive corners of the polygon coincide")
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / lengths
        before = np.roll(normals, 1, axis=0)
        half = 1.0 + (normals * before).sum(axis=1)
        back = int(np.argmin(half))
        if half[back] <= arrays.EPSILON:
            raise ValueError(
                f"two edges of the polygon overlap at {errors.format_point(corners[back])}"
            )
        inwards = (normals + before) / half[:, None]
        inner = corners - rounding * inwards
        if not ((edges_of(inner) * edges).sum(axis=1) > 0.0).all():
            shorter = (edges_of(inwards) * edges).sum(axis=1) / lengths[:, 0] ** 2
            raise ValueError(
                f"rounding={rounding}: expected less than {1.0 / shorter.max():g}, which leaves "
                "nothing of an edge of the polygon"
            )
        check_simple(f"polygon reduced by rounding={rounding:g}", inner, closed=True)
        self._corners, self._normals, self._radius = inner, normals, float(rounding)

    def local(self, x: Array) -> Fields:
        """Distance to the nearest edge or corner of the inner polygon; see ``Obstacle.local``."""
        edges = edges_of(self._corners)
        away = x[:, None] - self._corners
        along = np.clip((away * edges).sum(axis=2) / (edges**2).sum(axis=1), 0.0, 1.0)
        rest = away - along[:, :, None] * edges
        nearest = np.argmin((rest**2).sum(axis=2), axis=1)
        every = np.arange(len(x))
        rest, along, n = rest[every, nearest], along[every, nearest], self._normals[nearest]
        beside = np.where(along == 1.0, nearest + 1, nearest - 1) % len(edges)
        inside = np.real((rest * (n + self._normals[beside])).sum(axis=1)) < 0.0
        at_corner = ((along == 0.0) | (along == 1.0)) & rest.any(axis=1)
        return distance_fields(rest, n, at_corner, inside, self._radius)

    def salient_points(self) -> Array:
        """The tips of the rounded corners; see ``Obstacle.salient_points``."""
        towards = self._normals + np.roll(self._normals, 1, axis=0)
        return self._corners + self._radius * towards / np.linalg.norm(towards, axis=1)[:, None]
