# SPDX-License-Identifier: MIT
"""Circles and spheres, from outside or inside."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fenics_mortar.obstacles.obstacle import Fields, Obstacle
from fenics_mortar.obstacles.rigid_motion import check_vector
from fenics_mortar.utils.arguments import check_flag, check_number
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.rounding import EPSILON


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
        self._centre = check_vector("centre", centre, self._dim)
        super().__init__(name or self._name, self._centre if pivot is None else pivot)
        check_flag("inside", inside)
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
        check_number("radius", radius, "a positive length", lambda r: 0.0 < r < np.inf)
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
        upward[1] = EPSILON * self._radius
        d = np.where(np.abs(d).max(axis=1, keepdims=True) > 0.0, d, upward)
        r = np.sqrt((d * d).sum(axis=1))
        e = d / r[:, None]
        across = np.eye(self.dim) - np.einsum("ia,ib->iab", e, e)
        sign = self._sign
        return sign * (r - self._radius), sign * e, sign * across / r[:, None, None]

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
