# SPDX-License-Identifier: MIT
"""The space of the displacement, and the out-of-plane thickness of the bodies.

**Out-of-plane thickness of the bodies, by which all integrals over the interface are weighted.**

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

from fenics_mortar.utils import compat
from fenics_mortar.utils.arguments import check_choice, check_number
from fenics_mortar.utils.arrays import Array, Indices, values_at
from fenics_mortar.utils.errors import MortarError, call_together, check_same

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


class DisplacementSpace:
    """The displacement's nodes, and their dofs in the space of all unknowns.

    The constructor is collective.

    Args:
        whole: Space of the unknowns: that of the displacement itself, or a mixed one.
        part: Number of the displacement's sub-space in a mixed space.
        thickness: Out-of-plane thickness of the bodies; ``None`` if it is one.

    Attributes:
        whole, part, thickness: The arguments.
        V: The space of the displacement alone, which numbers the nodes.
        dim: Number of components of the displacement, 2 or 3.
        block_size: Dofs per node of ``whole``; 1 in a mixed space.
        dofs: Local dofs in ``whole`` of the local nodes, ghosts included, shape (n, dim).
        num_nodes: Number of nodes owned by this rank, the first ones.
        num_owned: Number of dofs of ``whole`` owned by this rank, the first ones.
        first: Global number of the first of these dofs.

    Raises:
        ValueError: If the space has no such sub-space.
    """

    def __init__(self, whole: Any, part: int = 0, thickness: Thickness | None = None) -> None:
        self.whole, self.V, self.part = whole, whole, part
        self.thickness = thickness
        self.block_size: int = whole.dofmap.index_map_bs
        if self.is_mixed:
            if part not in range(whole.num_sub_spaces):
                raise ValueError(
                    f"displacement={part!r}: the space of u has the sub-spaces 0 to "
                    f"{whole.num_sub_spaces - 1}"
                )
            self.V, dofs = whole.sub(part).collapse()
        elif part:
            raise ValueError(f"displacement={part!r}: the function u is not mixed")
        else:
            index_map = whole.dofmap.index_map
            dofs = np.arange(self.block_size * (index_map.size_local + index_map.num_ghosts))
        self.dim: int = whole.mesh.geometry.dim
        self.dofs: Indices = np.asarray(dofs, np.int64).reshape(-1, self.V.dofmap.index_map_bs)
        self.num_nodes: int = self.V.dofmap.index_map.size_local
        self.num_owned: int = self.block_size * whole.dofmap.index_map.size_local
        self.first: int = self.block_size * whole.dofmap.index_map.local_range[0]

    @property
    def is_mixed(self) -> bool:
        """Whether there are unknowns other than the displacement (local)."""
        return self.block_size == 1 and self.whole.num_sub_spaces > 0

    @property
    def is_axisymmetric(self) -> bool:
        """Whether the mesh is the meridian half plane of bodies of revolution (local)."""
        return self.thickness is not None and self.thickness.by_x != 0.0

    @property
    def owned_dofs(self) -> Indices:
        """Local dofs of the nodes owned by this rank, shape (``num_nodes``, dim) (local)."""
        return self.dofs[: self.num_nodes]

    def positions(self) -> Array:
        """Positions of the nodes, shape (local dofs,) [length]; zero for other unknowns (local)."""
        values = np.zeros(int(self.dofs.max(initial=-1)) + 1)
        values[self.dofs] = self.V.tabulate_dof_coordinates()[:, : self.dim]
        return values

    def spread(self, nodal: npt.NDArray[Any]) -> Array:
        """Return values (n,) of the local nodes as an array of all local dofs [their unit] (local).

        All components have the value of the node; other unknowns are zero.
        """
        index_map = self.whole.dofmap.index_map
        values = np.zeros(self.block_size * (index_map.size_local + index_map.num_ghosts))
        values[self.dofs] = nodal[:, None]
        return values

    def move_nodes(self, nodes: Indices, X: Array) -> None:
        """Move nodes of the mesh (collective, but without communication).

        Displacement nodes inside straight edges, which are not nodes of the geometry, move with the
        edge.

        Args:
            nodes: Global numbers of nodes of ``V``, equal on all ranks, shape (k,).
            X: New positions, shape (k, dim) [length].
        """
        index_map, mesh = self.V.dofmap.index_map, self.V.mesh
        count = index_map.size_local + index_map.num_ghosts
        here = index_map.local_to_global(np.arange(count, dtype=np.int32))
        own, geometry = compat.dofmap(self.V), compat.geometry_dofmap(mesh)
        index = np.full(count, -1)
        index[own[:, : geometry.shape[1]]] = geometry
        at = values_at(here, nodes, np.arange(nodes.size), -1)
        found = (at >= 0) & (index >= 0)
        mesh.geometry.x[index[found], : self.dim] = X[at[found]]
