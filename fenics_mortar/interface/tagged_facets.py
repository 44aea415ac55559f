# SPDX-License-Identifier: MIT
"""Facets with given tags, with their nodes in order and the body on the left."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx import mesh as dmesh

from fenics_mortar.mesh.numbering import input_nodes
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import SurfaceError, count_points


def tagged_facets(
    mesh: Any, facet_tags: Any, tags: Sequence[int], name: str
) -> npt.NDArray[np.int32]:
    """Local facets of some tags that this rank owns, shape (m,) (collective).

    A facet is included if any rank tags it, whether that rank owns the facet or not.

    Args:
        mesh: The mesh.
        facet_tags: Its facet tags.
        tags: The tags.
        name: Name of the surface, used in messages.

    Raises:
        SurfaceError: On all ranks, if a facet is not on the boundary of the mesh.
    """
    dim = mesh.topology.dim
    mesh.topology.create_connectivity(dim - 1, dim)
    mesh.topology.create_connectivity(dim, dim - 1)
    facet_map = mesh.topology.index_map(dim - 1)
    begin, end = facet_map.local_range
    tagged = np.concatenate([facet_tags.find(tag) for tag in tags])
    tagged = facet_map.local_to_global(tagged.astype(np.int32))
    tagged = np.unique(np.concatenate(mesh.comm.allgather(tagged)))
    tagged = (tagged[(tagged >= begin) & (tagged < end)] - begin).astype(np.int32)
    inside = np.setdiff1d(tagged, dmesh.exterior_facet_indices(mesh.topology)).astype(np.int32)
    midpoints = dmesh.compute_midpoints(mesh, dim - 1, inside)[:, :dim]
    count, where = count_points(mesh.comm, midpoints)
    if count:
        raise SurfaceError(
            f"surface '{name}': {count} of its facets are not on the boundary of the mesh, "
            f"one at {where}; expected facets of the outline of one body"
        )
    return tagged


def local_facets(
    V: Any, facet_tags: Any, tags: Sequence[int], name: str
) -> tuple[Indices, Array, Indices]:
    """Facets of some tags that this rank owns (collective).

    Args:
        V: Space of the displacement.
        facet_tags: Facet tags of the mesh.
        tags: The tags.
        name: Name of the surface, used in messages.

    Returns:
        Global nodes, shape (m, K), their reference positions, shape (m, K, 2) [length], and their
        numbers in the mesh input, -1 for nodes inside facets, shape (m, K).

    Raises:
        SurfaceError: On all ranks, if a facet is not on the boundary of the mesh.
    """
    ends = facet_nodes(V, tagged_facets(V.mesh, facet_tags, tags, name))
    names = input_nodes(V)
    given = np.where((names[:, 1:] < 0).all(axis=1), names[:, 0], -1)
    to_global = V.dofmap.index_map.local_to_global(ends.ravel().astype(np.int32))
    x = V.tabulate_dof_coordinates()[:, :2]
    return np.asarray(to_global, np.int64).reshape(ends.shape), x[ends], given[ends]


def facet_nodes(V: Any, facets: npt.NDArray[np.int32]) -> Indices:
    """Local nodes (m, K) of facets in order, with the cell on the left (local).

    The side is determined by the cell's corners: all nodes of a thin bent cell may lie on the other
    side of its facet's chord.

    Requires the connectivities facets -> cells and cells -> facets.

    Args:
        V: Space of the displacement.
        facets: Local facets, shape (m,).
    """
    topology = V.mesh.topology
    facet_cells, cell_facets = topology.connectivity(1, 2), topology.connectivity(2, 1)
    dofmap, x = compat.dofmap(V), V.tabulate_dof_coordinates()[:, :2]
    layout = V.dofmap.dof_layout
    ends = np.empty((facets.size, len(layout.entity_closure_dofs(1, 0))), np.int64)
    for i, facet in enumerate(facets):
        cell = facet_cells.links(facet)[0]
        of_cell = cell_facets.links(cell)
        local = int(np.flatnonzero(of_cell == facet)[0])
        corners = [layout.entity_dofs(0, k)[0] for k in range(of_cell.size)]
        a, b, *inside = dofmap[cell][layout.entity_closure_dofs(1, local)]
        inward = x[dofmap[cell][corners]].mean(axis=0) - x[a]
        edge = x[b] - x[a]
        on_left = edge[0] * inward[1] - edge[1] * inward[0] > 0.0
        ends[i] = (a, *inside, b) if on_left else (b, *inside, a)
    return ends
