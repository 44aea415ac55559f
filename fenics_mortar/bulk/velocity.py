# SPDX-License-Identifier: MIT
"""Velocity of a displacement in UFL forms, for viscous materials and damping."""

from __future__ import annotations

from typing import Any

from dolfinx import fem

from fenics_mortar.utils.arrays import Array


class Origin(fem.Function):
    """Displacement at which a ``Velocity`` is zero; its type identifies it in a residual."""


class Velocity:
    """Velocity at the end of a time step, linear in the displacement u there; methods are local.

    Its ``expression`` may be used in a residual like u, for instance Rayleigh's damping
    ``alpha * rho * inner(v, w) * dx + beta * inner(stress(v), grad(w)) * dx``. Its derivative is
    part of the tangent. The velocity is zero until ``Dynamics(..., velocity=...)`` sets it.

    Args:
        u: Displacement, alone or in a mixed function.

    Attributes:
        expression: factor (u - origin), a UFL expression [length / time].
        u: The displacement, or the mixed function.
        factor: Constant of dolfinx [1 / time].
        origin: Function of the space of ``u``, its values have the shape (local dofs,) [length].
    """

    def __init__(self, u: Any) -> None:
        self.u = u
        self.factor = fem.Constant(u.function_space.mesh, 0.0)
        self.origin = Origin(u.function_space, name="velocity_origin")
        self.expression = self.factor * (u - self.origin)

    def set(self, factor: float, origin: Array) -> None:
        """Set ``factor`` [1 / time] and ``origin``, shape (local dofs,) [length] (local)."""
        self.factor.value = factor
        self.origin.x.array[:] = origin
