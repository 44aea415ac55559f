# SPDX-License-Identifier: MIT
"""Obstacles in space by shapes of the plane: ``Extruded`` along an axis, ``Revolved`` about one.

``Cylinder``, ``Cone`` and ``Torus`` are revolved.
"""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import numpy.typing as npt

from fenics_mortar.obstacles.obstacle import Fields, Obstacle, distance_fields
from fenics_mortar.obstacles.shapes import Circle, Plane
from fenics_mortar.utils.arrays import EPSILON, Array
from fenics_mortar.utils.errors import (
    check_direction,
    check_flag,
    check_kind,
    check_number,
    check_vector,
)

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
        return np.asarray((self._origin + across[:, None] + places[:, None] * axis).reshape(-1, 3))


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
        check_number("section", section, "a length between 0 and radius", lambda s: 0 < s < radius)
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
