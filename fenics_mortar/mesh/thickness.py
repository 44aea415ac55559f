# SPDX-License-Identifier: MIT
"""Out-of-plane thickness of the bodies, by which all integrals over the interface are weighted.

==============  ==========================================================================
geometry        thickness at a point of current position x and reference position X
==============  ==========================================================================
"plane"         one, without a unit; or a given t(X) > 0 [length]
"axisymmetric"  2 pi x_0: the mesh is the meridian half plane, the axis is x_0 = 0
==============  ==========================================================================

Tractions and multipliers are always stresses. With a thickness, D, M and weights are areas, and
forces act on the whole body. Both sides of a contact take the thickness of the slave's point, as
the virtual work int z . (dx_s - dx_m) t dgamma demands, so that forces and moments of the two sides
cancel.

The residual is the user's: its measures need the thickness of the reference configuration, 2 pi X_0
with axisymmetry, and its strains the hoop stretch, F_33 = 1 + u_0 / X_0. Quadrature points inside
the cells avoid division by zero.

A body of revolution has one rigid motion, the translation along the axis: a radial translation
strains it. Only the axial forces must balance; radial forces are balanced by hoop stresses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, get_args

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from fenics_mortar.utils.arguments import check_choice, check_number
from fenics_mortar.utils.errors import MortarError, call_together, check_same

Array = npt.NDArray[np.float64]
Geometry = Literal["plane", "axisymmetric"]
Given = float | Callable[[Array], Any] | None


def check_geometry(geometry: Any, thickness: Any) -> None:
    """Raise an error for an invalid geometry or thickness (local).

    Raises:
        ValueError: If a value is invalid.
    """
    check_choice("geometry", geometry, get_args(Geometry))
    if geometry != "plane" and thickness is not None:
        raise ValueError(
            "thickness with geometry='axisymmetric': the thickness of a body of revolution is "
            "2 pi r; expected None"
        )
    if thickness is not None and not callable(thickness):
        expected = "a positive length, or a function of reference positions (n, 2)"
        check_number("thickness", thickness, expected, lambda t: 0.0 < t < np.inf)


@dataclass(frozen=True)
class Thickness:
    """Thickness of all bodies: a constant part, and its derivative with respect to the current x_0.

    Attributes:
        constant: A length, or a function of reference positions (n, 2); 0 with axisymmetry.
        by_x: Derivative with respect to the first coordinate of the current position [1]: 2 pi or
            0.
    """

    constant: float | Callable[[Array], Any]
    by_x: float

    def at_nodes(self, X: Array, comm: MPI.Comm) -> NodalThickness:
        """Thickness at nodes ``X`` (n, 2) of a surface, equal on all ranks (collective).

        Raises:
            MortarError: On all ranks, if the user's function does not return positive lengths, or
                or returns different values on different ranks.
        """
        constant = call_together(comm, "thickness", partial(self._constant_at, X))
        check_same(comm, [("thickness", constant)])
        return NodalThickness(constant, self.by_x)

    def _constant_at(self, X: Array) -> Array:
        if not callable(self.constant):
            return np.full(len(X), self.constant)
        found = np.asarray(self.constant(X.copy()))
        if found.shape != (len(X),) or found.dtype.kind not in "iuf":
            raise MortarError(
                f"thickness returned an array of shape {found.shape} and type {found.dtype} for "
                f"{len(X)} points; expected real numbers of shape ({len(X)},)"
            )
        if not (np.isfinite(found) & (found > 0.0)).all():
            raise MortarError("thickness returned values that are not positive lengths")
        return found.astype(np.float64)


@dataclass(frozen=True)
class NodalThickness:
    """Thickness at the nodes of a surface, linear in their current first coordinates.

    Attributes:
        constant: Constant part, shape (nodes,) [length].
        by_x: Derivative with respect to the first coordinate [1].
    """

    constant: Array
    by_x: float

    def at(self, x: Array) -> Array:
        """Thickness with the nodes at ``x`` (nodes, 2), shape (nodes,) [length]."""
        return self.constant + self.by_x * x[:, 0]

    def of(self, nodes: npt.NDArray[np.int64]) -> NodalThickness:
        """Thickness of some of the nodes (k,)."""
        return NodalThickness(self.constant[nodes], self.by_x)

    @property
    def for_kernels(self) -> tuple[Array, float]:
        """Constant part (nodes,) [length] and derivative [1], for the kernels."""
        return self.constant, self.by_x


def thickness_of(geometry: Geometry, thickness: Given) -> Thickness | None:
    """Thickness of a problem; ``None`` if it is one everywhere (local)."""
    if geometry == "axisymmetric":
        return Thickness(0.0, 2.0 * np.pi)
    return None if thickness is None else Thickness(thickness, 0.0)
