# SPDX-License-Identifier: MIT
"""The dofs of the displacement: all unknowns, or one sub-space of a mixed space."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.mesh.thickness import Thickness
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices, values_at


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
        block_size: Dofs per node of ``whole``; 1 in a mixed space.
        dofs: Local dofs in ``whole`` of the local nodes, ghosts included, shape (n, 2).
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
        """Local dofs of the nodes owned by this rank, shape (``num_nodes``, 2) (local)."""
        return self.dofs[: self.num_nodes]

    def positions(self) -> Array:
        """Positions of the nodes, shape (local dofs,) [length]; zero for other unknowns (local)."""
        values = np.zeros(int(self.dofs.max(initial=-1)) + 1)
        values[self.dofs] = self.V.tabulate_dof_coordinates()[:, :2]
        return values

    def spread(self, nodal: npt.NDArray[Any]) -> Array:
        """Return values (n,) of the local nodes as an array of all local dofs [their unit] (local).

        Both components have the value of the node; other unknowns are zero.
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
            X: New positions, shape (k, 2) [length].
        """
        index_map, mesh = self.V.dofmap.index_map, self.V.mesh
        count = index_map.size_local + index_map.num_ghosts
        here = index_map.local_to_global(np.arange(count, dtype=np.int32))
        own, geometry = compat.dofmap(self.V), compat.geometry_dofmap(mesh)
        index = np.full(count, -1)
        index[own[:, : geometry.shape[1]]] = geometry
        at = values_at(here, nodes, np.arange(nodes.size), -1)
        found = (at >= 0) & (index >= 0)
        mesh.geometry.x[index[found], :2] = X[at[found]]
