# SPDX-License-Identifier: MIT
"""Rigid obstacles: signed distances, their place, shape and the forces that drive them.

An obstacle is given by its signed distance phi, positive outside the solid, with gradient and
Hessian H in the obstacle's frame. An obstacle has as many coordinates as its pivot, d = 2 in the
plane and d = 3 in space. The rigid motion q and its velocities V are those of ``rigid_motion``,
with turns, angles times a length ``arm``, about axes e_i. The derivatives at a point x are

    d phi = grad phi . (dx - V dq),
    d grad phi = H (dx - V dq) + sum_i e_i x grad phi dq_i / arm.

Shapes are subclasses of ``Obstacle``: a user's ``SignedDistance``, and those of ``shapes`` and
``revolved``. Derivatives by parameters of the shape are exact or difference quotients, see
``differentiate_shape``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from copy import copy
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.obstacles.rigid_motion import RigidMotion
from fenics_mortar.utils.arrays import Array, Flags
from fenics_mortar.utils.errors import NotFiniteError, format_point, is_function

# Step of central differences of distances, over the size of the parameter or the length of a facet
# [1]: on a spline of nine points the truncation error is 1e-11, the rounding over the step 1e-12.
DIFFERENCE = 2e-4


def differentiate_shape(
    obstacle: Any, x: Array, name: str, direction: Array
) -> tuple[Array, Array]:
    """Derivatives of phi (n,) and of its gradient (n, d) along a direction (local).

    Central quotients with steps h and h / 2 are extrapolated, (4 d(h / 2) - d(h)) / 3: the error is
    of the order of h^4 and of the rounding of distances over h.

    Args:
        obstacle: The obstacle; it is not changed.
        x: Points in its own frame, shape (n, d) [length].
        name: Name of the parameter.
        direction: Shape of the parameter.
    """
    value, count = np.asarray(obstacle.shape()[name]), len(x)
    if not direction.any():
        return np.zeros(count), np.zeros_like(x)
    size = np.ptp(value) if value.size > 1 else np.abs(value).max()
    h = DIFFERENCE * (size or 1.0) / np.abs(direction).max()

    def quotient(step: float) -> Array:
        fields = []
        for sign in (1.0, -1.0):
            other = copy(obstacle)
            other.set_shape(name, value + sign * step * direction)
            phi, gradient, _ = other.local(x)
            fields.append(np.column_stack([phi, gradient]))
        return (fields[0] - fields[1]) / (2.0 * step)

    change = (4.0 * quotient(0.5 * h) - quotient(h)) / 3.0
    return change[:, 0], change[:, 1:]


Fields = tuple[Array, Array, Array]


class Obstacle(RigidMotion, ABC):
    """Base class of rigid solids with prescribed or driven motion (all methods are local).

    ``move`` prescribes motions, ``push`` prescribes forces. Set both equally on all ranks.

    Attributes:
        name, dim, pivot, place, load: See ``RigidMotion``. The surface in its initial position does
            not depend on the pivot.
        reaction: Contact force and moment on the obstacle after the last solve, shape (m,), units
            as ``load``; with axisymmetry the axial force [force] alone.

    Raises:
        ValueError: If name or pivot is of another type, or the pivot is not finite.
    """

    kind = "obstacle"

    def __str__(self) -> str:
        """The name."""
        return self.name

    def evaluate(self, x: Array) -> Fields:
        """Signed distance and its derivatives at points of space.

        Args:
            x: Points, shape (n, d) [length].

        Returns:
            phi (n,) [length], gradient (n, d) [1] and Hessian (n, d, d) [1 / length].

        Raises:
            ValueError: If a user's function returns another number of arrays or other shapes.
            NotFiniteError: If it returns nan or infinity.
        """
        own = self.to_own_frame(x)
        phi, gradient, hessian = self._checked(self.local(own), own)
        rotation = self.rotation
        return phi, gradient @ rotation.T, rotation @ hessian @ rotation.T

    def _checked(self, fields: Fields, x: Array) -> Fields:
        """The result of ``local`` at ``x`` (n, d), checked."""
        if not isinstance(fields, (tuple, list)) or len(fields) != 3:
            raise ValueError(
                f"the distance of '{self.name}' returned {type(fields).__name__}; expected three "
                "arrays: phi, gradient and Hessian"
            )
        shapes = [np.shape(field) for field in fields]
        expected = [x.shape[:1], x.shape, (*x.shape, self.dim)]
        if shapes != expected:
            raise ValueError(
                f"the distance of '{self.name}' returned shapes {shapes}; expected {expected}"
            )
        phi, gradient, hessian = map(np.array, fields)  # copies: the function may reuse its arrays
        kinds = {field.dtype.kind for field in (phi, gradient, hessian)}
        if not kinds <= set("iufc" if np.iscomplexobj(x) else "iuf"):
            raise ValueError(f"the distance of '{self.name}' is not real; expected real numbers")
        total = phi + gradient.sum(axis=1) + hessian.sum(axis=(1, 2))  # nan and inf propagate
        bad = ~np.isfinite(total) & np.isfinite(x).all(axis=1)
        if bad.any():
            raise NotFiniteError(
                f"the distance of '{self.name}' or one of its derivatives is not finite at "
                f"{bad.sum()} points, one at {self._where(x, bad)}"
            )
        flat = ~gradient.any(axis=1)
        if flat.any():
            raise NotFiniteError(
                f"the distance of '{self.name}' has zero gradient at {flat.sum()} points, one at "
                f"{self._where(x, flat)}; expected a length of about 1"
            )
        return phi, gradient, hessian

    def _where(self, x: Array, marked: Flags) -> str:
        """Position in space of the first marked point, as text for messages."""
        first = int(np.argmax(marked))
        return format_point(np.real(self.to_space(x[first : first + 1])[0]))

    def salient_points(self) -> Array:
        """Points of the surface that may be the deepest in a body, own frame, (k, d) [length].

        Such as tips; none by default. The points nearest to the nodes of a body are known anyway.
        """
        return np.empty((0, self.dim))

    def salient_points_near(self, x: Array) -> Array:
        """As ``salient_points``; of shapes without ends those beside some points only.

        Args:
            x: Points in the own frame of the obstacle, shape (n, d) [length].

        Returns:
            Points of the surface, own frame, shape (k, d) [length].
        """
        return self.salient_points()

    # Shape, for sensitivities

    def shape(self) -> dict[str, Array]:
        """Parameters of the shape by name, arrays of any shape [units of the obstacle].

        Empty by default.
        """
        return {}

    def set_shape(self, name: str, values: Array) -> None:
        """Set a parameter of the shape; pivot and place stay.

        Args:
            name: Name of the parameter.
            values: New value, of the shape of the parameter [its unit].

        Raises:
            ValueError: If there is no such parameter, or its value is not allowed.
        """
        raise ValueError(f"'{self.name}' has no parameter '{name}' of its shape")

    def local_by_shapes(self, x: Array, name: str, directions: Array) -> tuple[Array, Array]:
        """Derivatives of ``local`` along m directions of a parameter of the shape.

        By default extrapolated difference quotients of a copy, see ``differentiate_shape``.

        Args:
            x: Points of the own frame, shape (n, d) [length].
            name: Name of the parameter.
            directions: Directions, shape ``(m, *shape)`` with that of the parameter [its unit].

        Returns:
            Derivatives of phi (m, n) [length] and of the gradient (m, n, d) [1], both over the
            unit of the direction's factor.
        """
        each = [differentiate_shape(self, x, name, direction) for direction in directions]
        phi, gradient = zip(*each, strict=True)
        return np.array(phi), np.array(gradient)

    @abstractmethod
    def local(self, x: Array) -> Fields:
        """Signed distance and derivatives at points of the own frame.

        Args:
            x: Points, shape (n, d) [length].

        Returns:
            phi (n,) [length], gradient (n, d) [1] and Hessian (n, d, d) [1 / length].
        """


class SignedDistance(Obstacle):
    """Solid phi < 0 given by a user's function.

    Args:
        function: Maps points (n, d) [length] to phi (n,) [length], its gradient (n, d) [1] and
            Hessian (n, d, d) [1 / length]. Near the surface phi must be approximately a distance,
            |grad phi| = 1.
        pivot: Centre of rotations; three numbers for an obstacle in space, shape (d,) [length].
        name: Name used in messages.

    Raises:
        ValueError: If ``function`` is not a function.
    """

    def __init__(
        self,
        function: Callable[[Array], Fields],
        *,
        pivot: npt.ArrayLike = (0.0, 0.0),
        name: str = "obstacle",
    ) -> None:
        """Keep the function."""
        super().__init__(name, pivot)
        if not is_function(function):
            raise ValueError(
                f"function={function!r}: expected a function of points (n, {self.dim})"
            )
        self._function = function

    def local(self, x: Array) -> Fields:
        """Result of the user's function: see ``Obstacle.local``."""
        if not len(x):
            return np.zeros(0), np.zeros((0, self.dim)), np.zeros((0, self.dim, self.dim))
        return self._function(x)


def distance_fields(
    rest: Array, normal: Array, at_corner: Flags, inside: Flags, radius: float
) -> Fields:
    """Fields of the distance to the nearest points of a solid of straight sides, rounded (local).

    Args:
        rest: Points minus the nearest ones of the sides and corners, shape (n, d) [length].
        normal: Normals of the nearest sides, shape (n, d) or (d,).
        at_corner: Whether the nearest point is a corner, shape (n,), bool.
        inside: Whether the distance from a corner is negative, shape (n,), bool.
        radius: Radius of the rounding, subtracted from the distance [length].
    """
    sizes = np.where(inside, -1.0, 1.0) * np.sqrt((rest**2).sum(axis=1))
    size = np.where(at_corner, sizes, 1.0)
    gradient = np.where(at_corner[:, None], rest / size[:, None], normal)
    phi = np.where(at_corner, size, (rest * normal).sum(axis=1)) - radius
    across = np.eye(rest.shape[1]) - np.einsum("ia,ib->iab", gradient, gradient)
    return phi, gradient, np.where(at_corner[:, None, None], across / size[:, None, None], 0.0)


def is_of_package(obstacle: Obstacle) -> bool:
    """Whether the distance is one of the package's shapes, not a user's."""
    package = SignedDistance.__module__.partition(".")[0]
    kind = type(obstacle)
    return kind is not SignedDistance and kind.__module__.partition(".")[0] == package
