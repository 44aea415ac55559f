# SPDX-License-Identifier: MIT
"""Shapes of rigid obstacles: plane, spline, rounded polygon; in space extruded and revolved ones.

The pivot is the centre of rotations only: a shape does not depend on it. Shapes of the plane become
obstacles in space by ``Extruded``, along an axis, and ``Revolved``, about one; ``Cylinder``,
``Cone`` and ``Torus`` are such shapes.
"""

from __future__ import annotations

from copy import deepcopy
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from fenics_mortar.obstacles.obstacle import Circle, Fields, Obstacle, distance_fields
from fenics_mortar.obstacles.rigid_motion import check_chain, check_simple, edges_of
from fenics_mortar.utils.arrays import EPSILON, MAX_STEPS, ROUNDING, cross_in_plane
from fenics_mortar.utils.errors import (
    check_direction,
    check_flag,
    check_kind,
    check_number,
    check_vector,
    format_point,
)

if TYPE_CHECKING:
    from fenics_mortar.utils.arrays import Array, Indices


# Complex step of the points of a spline, over 1j [length]: too small for a rounding.
SPLINE_STEP = 1e-30


def spline_at(points: Array, i: Indices, s: Array, *, closed: bool) -> Array:
    """Points of the spline through ``points``, and their derivatives by s, (2, n, 2) (local).

    With chords h_i of the points P_i and second derivatives M_i at them, the curve between two
    points is, at the fraction s of the parameter, r = 1 - s,

        c = r P_i + s P_{i+1} + h_i^2 / 6 [(r^3 - r) M_i + (s^3 - s) M_{i+1}],

    where M solves the equations of continuous slopes, a linear system of the h_i. All of it is
    differentiated at fixed s, by a complex step of the points.

    Args:
        points: Points, real or complex, shape (k, 2) [length].
        i: Numbers of intervals, shape (n,).
        s: Fractions of these, shape (n,).
        closed: Whether the curve is closed; it has zero curvature at its ends otherwise.
    """
    P = np.vstack([points, points[:1]]) if closed else points
    chords = np.diff(P, axis=0)
    h = np.sqrt((chords**2).sum(axis=1))
    slopes, rows = chords / h[:, None], np.arange(1, len(P) - 1)
    A, jumps = np.eye(len(P), dtype=P.dtype), np.zeros_like(P)
    A[rows, rows - 1], A[rows, rows + 1] = h[:-1] / 6.0, h[1:] / 6.0
    A[rows, rows], jumps[rows] = (h[:-1] + h[1:]) / 3.0, np.diff(slopes, axis=0)
    if closed:  # the last point is the first one
        A[0, [-2, 0, 1]] = h[-1] / 6.0, (h[-1] + h[0]) / 3.0, h[0] / 6.0
        A[-1, 0], jumps[0] = -1.0, slopes[0] - slopes[-1]
    M = np.linalg.solve(A, jumps)
    s, bend = s[:, None], h[i, None] ** 2 / 6.0
    r = 1.0 - s
    c = r * P[i] + s * P[i + 1] + bend * ((r**3 - r) * M[i] + (s**3 - s) * M[i + 1])
    slope = (1.0 - 3.0 * r**2) * M[i] + (3.0 * s**2 - 1.0) * M[i + 1]
    return np.stack([c, chords[i] + bend * slope])


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
        self._point = check_vector("point", point, 2, 3)
        super().__init__(name, self._point if pivot is None else pivot)
        self._normal = check_direction("normal", normal, self.dim)

    def local(self, x: Array) -> Fields:
        """Distance to a straight line or a plane; see ``Obstacle.local``."""
        gradient = np.broadcast_to(self._normal, x.shape)
        return (x - self._point) @ self._normal, gradient, np.zeros((*x.shape, self.dim))


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
        knots = np.concatenate([[0.0], np.cumsum(chords)])
        from scipy.interpolate import CubicSpline

        self._curve = CubicSpline(knots, chain, bc_type="periodic" if closed else "natural")
        self._end = float(knots[-1])
        fractions = np.linspace(0.0, 1.0, SAMPLES, endpoint=False)
        starts = (knots[:-1, None] + chords[:, None] * fractions).ravel()
        self._samples = np.append(starts, self._end)
        drawn = self._curve(self._samples)
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
        knots = self._curve.x
        on = t % self._end if self._closed else np.clip(t, 0.0, self._end)
        i = np.clip(np.searchsorted(knots, on, side="right") - 1, 0, len(knots) - 2)
        h = np.diff(knots)[i]
        moved = [
            spline_at(
                self._chain + SPLINE_STEP * 1j * way, i, (on - knots[i]) / h, closed=self._closed
            )
            for way in directions
        ]
        dc, dd = np.moveaxis(np.imag(moved) / SPLINE_STEP, 1, 0)
        dd = dd / h[:, None]
        beyond = 0.0 if self._closed else (t - on)[:, None]
        return dc + beyond * dd, dd

    def _feet(self, x: Array) -> Array:
        """Parameters of the nearest points of the curve, shape (n,) [length]."""
        t = self._samples[
            np.argmin(self._squares - 2.0 * (x - self._origin) @ self._points.T, axis=1)
        ]
        for end, sign in () if self._closed else ((0.0, -1.0), (self._end, 1.0)):
            c, d = self._curve(end), self._curve(end, 1)
            beyond = (x - c) @ d / (d @ d)  # of points beyond an end, to their feet on its line
            t = np.where((t == end) & (sign * beyond > 0.0), end + beyond, t)
        longest = np.diff(self._samples).max()
        for _ in range(MAX_STEPS):
            c, d, dd = self._jet(t)
            slope = np.einsum("ia,ia->i", c - x, d)
            square = np.einsum("ia,ia->i", d, d)
            bend = square + np.einsum("ia,ia->i", c - x, dd)
            step = np.clip(slope / np.where(bend > 0.0, bend, square), -longest, longest)
            t = t - step
            if np.abs(step).max(initial=0.0) < ROUNDING * self._end:
                break  # the error of the last step is quadratic in the step
        return t

    def _distance_from_foot(self, x: Array, t: Array) -> tuple[Array, Array, Array, Array]:
        """Distance (n,), normal (n, 2), curvature (n,) and speed (n,) at the feet ``t``."""
        c, d, dd = self._jet(t)
        speed = np.linalg.norm(d, axis=1)
        tangent = d / speed[:, None]
        normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
        phi = np.einsum("ia,ia->i", x - c, normal)
        curvature = cross_in_plane(d, dd) / speed**3
        return phi, normal, curvature, speed

    def _jet(self, t: Array) -> Fields:
        """Point and two derivatives; an open curve is straight beyond its ends."""
        if self._closed:
            t = t % self._end
        on = np.clip(t, 0.0, self._end)
        beyond = (t - on)[:, None]
        d = self._curve(on, 1)
        return self._curve(on) + beyond * d, d, np.where(beyond == 0.0, self._curve(on, 2), 0.0)


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
        check_number("rounding", rounding, "a positive length", lambda r: 0.0 < r < np.inf)
        check_simple("polygon", corners, closed=True)
        after = np.roll(corners, -1, axis=0)
        if cross_in_plane(corners, after).sum() < 0.0:
            corners = corners[::-1]
        edges = edges_of(corners)
        lengths = np.linalg.norm(edges, axis=1)[:, None]
        if not lengths.min() > 0.0:
            raise ValueError("two successive corners of the polygon coincide")
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / lengths
        before = np.roll(normals, 1, axis=0)
        half = 1.0 + (normals * before).sum(axis=1)
        back = int(np.argmin(half))
        if half[back] <= EPSILON:
            raise ValueError(f"two edges of the polygon overlap at {format_point(corners[back])}")
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
        size = np.linalg.norm(towards, axis=1)[:, None]
        return self._corners + self._radius * towards / size


# Directions around the axis in which salient points of a shape are repeated.
AROUND = 8
# Places along the extrusion at which they are repeated: also few facets of a body have some below.
ALONG = 33
# Difference of phi_r and r phi_rr [1] below which phi_r / r is phi_rr: the error of this is r^2,
# that of the quotient is rounding over r.
SMOOTH = 4.0 * EPSILON


def directions_across(axis: npt.ArrayLike, first: npt.ArrayLike) -> Array:
    """Directions of the two coordinates of a shape that is extruded, (2, 3) [1] (local).

    Args:
        axis: Direction of extrusion, of any length, shape (3,).
        first: Direction of the first coordinate; the part across the axis counts, shape (3,). The
            second one is along axis x first.

    Raises:
        ValueError: If a direction is zero, or the first one along the axis.
    """
    along, given = check_direction("axis", axis), check_direction("first", first)
    across = given - (given @ along) * along
    if not np.linalg.norm(across) > np.sqrt(EPSILON):
        raise ValueError(f"first={first!r}: expected a direction that is not along the axis")
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(along, across)])


class Extruded(Obstacle):
    """Shape of the plane, extruded along a direction without ends.

    Args:
        shape: Obstacle in the plane, at its present place; later changes of it have no effect.
        axis: Direction of extrusion, of any length, shape (3,).
        first: Direction of the first coordinate of the shape; the part across the axis counts. The
            second one is along axis x first, shape (3,).
        origin: Point where both coordinates are zero, shape (3,) [length].
        pivot: Centre of rotations; the origin by default [length].
        name: Name used in messages; that of the shape by default.

    Raises:
        ValueError: If the shape is no obstacle of the plane, or a direction is zero or along the
            axis.

    Example:
        A roller along y in the coordinates x, z::

            fm.Extruded(fm.Circle((0.0, 2.0), 1.0), axis=(0, -1, 0), first=(1, 0, 0))
    """

    def __init__(
        self,
        shape: Obstacle,
        *,
        axis: npt.ArrayLike = (0.0, 0.0, 1.0),
        first: npt.ArrayLike = (1.0, 0.0, 0.0),
        origin: npt.ArrayLike = (0.0, 0.0, 0.0),
        pivot: npt.ArrayLike | None = None,
        name: str | None = None,
    ) -> None:
        """Find the directions of the coordinates."""
        self._shape = _copy_of(shape)
        self._origin = check_vector("origin", origin, 3)
        super().__init__(name or shape.name, self._origin if pivot is None else pivot)
        self._directions = directions_across(axis, first)

    def local(self, x: Array) -> Fields:
        """Fields of the shape; see ``Obstacle.local``.

        With the fields phi, phi_a, phi_ab of the shape in its coordinates and the directions e_1,
        e_2 of these, the extruded body has

            grad phi = phi_a e_a,    H = phi_ab e_a e_b.
        """
        e = self._directions
        phi, gradient, hessian = self._shape.evaluate((x - self._origin) @ e.T)
        return phi, gradient @ e, e.T @ hessian @ e

    def salient_points_near(self, x: Array) -> Array:
        """Those of the shape, along the axis between points; see ``Obstacle``."""
        axis = np.cross(*self._directions)
        along = (x - self._origin) @ axis
        if not len(x):
            return np.empty((0, 3))
        across = self._shape.to_space(self._shape.salient_points()) @ self._directions
        places = np.linspace(along.min(), along.max(), ALONG)
        found = self._origin + across[:, None] + places[:, None] * axis
        return np.asarray(found.reshape(-1, 3))


class Revolved(Obstacle):
    """Shape of the half plane x >= 0, revolved about the axis x = 0.

    Args:
        shape: Obstacle in the plane of x, the distance from the axis, and y along it, at its
            present place; later changes of it have no effect. A shape across the axis is symmetric
            to it.
        axis: Direction of the axis, of any length, shape (3,).
        origin: Point of the axis at y = 0, shape (3,) [length].
        pivot: Centre of rotations; the origin by default [length].
        name: Name used in messages; that of the shape by default.

    Raises:
        ValueError: If the shape is no obstacle of the plane, or the axis has no direction.

    Example:
        A punch of radius 1 with rounded edges, its base at z = 0::

            profile = [(-1, 0), (1, 0), (1, 2), (-1, 2)]
            fm.Revolved(fm.Polygon(profile, rounding=0.05), axis=(0, 0, 1))
    """

    def __init__(
        self,
        shape: Obstacle,
        *,
        axis: npt.ArrayLike = (0.0, 0.0, 1.0),
        origin: npt.ArrayLike = (0.0, 0.0, 0.0),
        pivot: npt.ArrayLike | None = None,
        name: str | None = None,
    ) -> None:
        """Check the axis."""
        self._shape = _copy_of(shape)
        self._origin = check_vector("origin", origin, 3)
        super().__init__(name or shape.name, self._origin if pivot is None else pivot)
        self._axis = check_direction("axis", axis)
        aside = np.eye(3)[np.abs(self._axis).argmin()]
        self._aside = np.cross(self._axis, aside) / np.linalg.norm(np.cross(self._axis, aside))

    def local(self, x: Array) -> Fields:
        """Fields of the shape; see ``Obstacle.local``.

        They are those of ``Extruded`` with the coordinates r, the distance from the axis, and h
        along it, e_1 = e_r, e_2 the axis, and in addition phi_r / r e_c e_c in H along the
        circumference. phi_r vanishes on the axis where the surface is smooth; phi_r / r is phi_rr
        there.

        On the axis the gradient is along it, unless it is across, as at the centre of a torus.
        """
        axis, d = self._axis, x - self._origin
        h = d @ axis
        across = d - h[:, None] * axis
        across = across - (across @ axis)[:, None] * axis  # without the rounding of the first one
        r = np.sqrt((across**2).sum(axis=1))
        phi, by, hessian = self._shape.evaluate(np.stack([r, h], axis=1))
        off = np.real(r) > EPSILON * np.abs(h) + np.finfo(float).tiny
        size = np.where(off, r, 1.0)
        e_r = np.where(off[:, None], across / size[:, None], self._aside)
        by_r = np.where(off | (np.abs(by[:, 1]) < np.sqrt(EPSILON)), by[:, 0], 0.0)
        gradient = by_r[:, None] * e_r + by[:, 1:] * axis
        smooth = np.abs(by[:, 0] - r * hessian[:, 0, 0]) < SMOOTH
        around = np.where(off & ~smooth, by[:, 0] / size, hessian[:, 0, 0])
        e = np.stack([e_r, np.broadcast_to(axis, e_r.shape)], axis=1)
        e_c = np.cross(axis, e_r)
        H = np.einsum("nab,nai,nbj->nij", hessian, e, e)
        return phi, gradient, H + around[:, None, None] * np.einsum("ni,nj->nij", e_c, e_c)

    def salient_points(self) -> Array:
        """Those of the shape, around the axis; see ``Obstacle.salient_points``."""
        points = self._shape.to_space(self._shape.salient_points())
        points = points[points[:, 0] >= 0.0]
        angles = 2.0 * np.pi * np.arange(AROUND) / AROUND
        other = np.cross(self._axis, self._aside)
        e_r = np.outer(np.cos(angles), self._aside) + np.outer(np.sin(angles), other)
        across = points[:, 0, None, None] * e_r
        found = self._origin + across + points[:, 1, None, None] * self._axis
        return np.asarray(found.reshape(-1, 3))


class Cylinder(Revolved):
    """Round bar without ends, or with ``inside`` a solid with a bore.

    With ends it is ``Revolved(Polygon(...))``.

    Args:
        point: Point of the axis, shape (3,) [length].
        axis: Direction of the axis, of any length, shape (3,).
        radius: Radius [length].
        inside: Contact on the inside: the solid lies outside the cylinder.
        pivot: Centre of rotations; the point by default [length].
        name: Name used in messages.

    Raises:
        ValueError: If an argument has a value that is not allowed.
    """

    def __init__(
        self,
        point: npt.ArrayLike,
        axis: npt.ArrayLike,
        radius: float,
        *,
        inside: bool = False,
        pivot: npt.ArrayLike | None = None,
        name: str = "cylinder",
    ) -> None:
        check_number("radius", radius, "a positive length", lambda r: 0.0 < r < np.inf)
        check_flag("inside", inside)
        shape = Plane((radius, 0.0), (-1.0 if inside else 1.0, 0.0))
        super().__init__(shape, axis=axis, origin=point, pivot=pivot, name=name)


class Cone(Revolved):
    """Solid cone without base, with a spherical tip.

    Args:
        apex: Apex of the sharp cone, shape (3,) [length].
        axis: Direction of the axis from the apex into the solid, of any length, shape (3,).
        half_angle: Angle between the axis and the surface [radian].
        rounding: Radius of the sphere that replaces the tip, tangent to the cone; 0 for a sharp tip
            [length].
        pivot: Centre of rotations; the apex by default [length].
        name: Name used in messages.

    Raises:
        ValueError: If an argument has a value that is not allowed.
    """

    def __init__(
        self,
        apex: npt.ArrayLike,
        axis: npt.ArrayLike,
        half_angle: float,
        *,
        rounding: float = 0.0,
        pivot: npt.ArrayLike | None = None,
        name: str = "cone",
    ) -> None:
        check_number(
            "half_angle", half_angle, "an angle between 0 and pi / 2", lambda a: 0.0 < a < np.pi / 2
        )
        check_number("rounding", rounding, "a length, 0 or more", lambda r: 0.0 <= r < np.inf)
        shape = _Wedge(half_angle, rounding)
        super().__init__(shape, axis=axis, origin=apex, pivot=pivot, name=name)


class Torus(Revolved):
    """Ring with a round section.

    Args:
        centre: Centre, shape (3,) [length].
        axis: Direction of the axis, of any length, shape (3,).
        radius: Radius of the circle of the sections' centres [length].
        section: Radius of the sections, less than ``radius`` [length].
        pivot: Centre of rotations; the centre by default [length].
        name: Name used in messages.

    Raises:
        ValueError: If an argument has a value that is not allowed.
    """

    def __init__(
        self,
        centre: npt.ArrayLike,
        axis: npt.ArrayLike,
        radius: float,
        section: float,
        *,
        pivot: npt.ArrayLike | None = None,
        name: str = "torus",
    ) -> None:
        check_number("radius", radius, "a positive length", lambda r: 0.0 < r < np.inf)
        check_number(
            "section", section, "a length between 0 and radius", lambda r: 0.0 < r < radius
        )
        shape = Circle((radius, 0.0), section)
        super().__init__(shape, axis=axis, origin=centre, pivot=pivot, name=name)


class _Wedge(Obstacle):
    """Half of a wedge, x >= 0, with the apex at the origin and the axis along y.

    phi is the distance to a sharp wedge with the apex at the centre of the tip, less the radius.
    """

    def __init__(self, half_angle: float, rounding: float) -> None:
        super().__init__("wedge")
        self._normal = np.array([np.cos(half_angle), -np.sin(half_angle)])
        self._radius = rounding
        self._tip = np.array([0.0, rounding / np.sin(half_angle)])

    def local(self, x: Array) -> Fields:
        """Distance to the side, beyond the tip to the apex; see ``Obstacle.local``."""
        d, n = x - self._tip, self._normal
        beyond = np.real(d @ np.array([-n[1], n[0]])) < 0.0
        return distance_fields(d, n, beyond, np.zeros_like(beyond), self._radius)

    def salient_points(self) -> Array:
        """The tip; see ``Obstacle.salient_points``."""
        return np.array([[0.0, self._tip[1] - self._radius]])


def _copy_of(shape: Obstacle) -> Obstacle:
    """Copy of an obstacle of the plane.

    Raises:
        ValueError: For other values.
    """
    check_kind("shape", shape, Obstacle, "an obstacle in the plane, such as Circle or Polygon")
    if shape.dim != 2:
        raise ValueError(
            f"shape='{shape.name}' is in space: expected one in the plane, as Circle or Polygon"
        )
    return deepcopy(shape)
