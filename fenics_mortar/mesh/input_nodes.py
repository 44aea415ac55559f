# SPDX-License-Identifier: MIT
"""Dofs and values at the nodes of the mesh input: arrays, files and models of gmsh."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices


def node_dofs(V: Any, nodes: npt.ArrayLike) -> Indices:
    """Local dofs of nodes of the mesh input, shape (k,); see ``MeshData.node_dofs`` (local)."""
    dofs, numbers = numbered_dofs(V)
    requested = np.asarray(nodes, np.int64)
    order = np.argsort(numbers, kind="stable")
    if not order.size:
        return np.full(requested.shape, -1, np.int64)
    at = order[np.minimum(np.searchsorted(numbers[order], requested), order.size - 1)]
    return np.where(numbers[at] == requested, dofs[at], -1)


def nodal_values(u: Any, nodes: npt.ArrayLike) -> Array:
    """Nodal values, shape (k, components); see ``MeshData.nodal_values`` (collective)."""
    V = u.function_space
    size, owned = V.dofmap.index_map_bs, V.dofmap.index_map.size_local
    dofs = node_dofs(V, nodes)
    mine = np.flatnonzero((dofs >= 0) & (dofs < owned))
    values = u.x.array.reshape(-1, size)[dofs[mine]]
    found = np.full((dofs.size, size), np.nan)
    for indices, there in V.mesh.comm.allgather((mine, values)):
        found[indices] = there
    return found


def numbered_dofs(V: Any) -> tuple[Indices, Indices]:
    """Local blocked dofs at nodes of the mesh input, and the numbers of these, each (n,)."""
    layout = V.dofmap.dof_layout
    if len(layout.entity_dofs(0, 0)) != 1:
        raise ValueError("expected a Lagrange space that is not mixed: one node at each vertex")
    dofs, geometry = compat.dofmap(V), compat.geometry_dofmap(V.mesh)
    corners = compat.num_corners(V.mesh)
    common = geometry.shape[1] if geometry.shape == dofs.shape else corners
    numbers = np.asarray(V.mesh.geometry.input_global_indices, np.int64)
    own, first = np.unique(dofs[:, :common], return_index=True)
    return own.astype(np.int64), numbers[geometry[:, :common].ravel()[first]]
