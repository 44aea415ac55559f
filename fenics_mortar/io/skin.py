# SPDX-License-Identifier: MIT
"""The outer facets of solids, for pictures: each of them once, on the rank that owns its cell."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

import basix
from dolfinx import mesh as dmesh

from fenics_mortar.mesh.kinds import KINDS, Kind
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Indices


class Skin(NamedTuple):
    """Facets of one cell only.

    Attributes:
        cells: Local cells of the facets, shape (f,).
        rings: Local nodes along the outlines of the facets, with those in the middle of edges of
            order 2, shape (f, k).
    """

    cells: Indices
    rings: Indices


def skin_of(V: Any) -> Skin:
    """The outer facets of the mesh of a Lagrange space of degree 1 or 2 in space (collective)."""
    topology, dofs = V.mesh.topology, compat.dofmap(V)
    topology.create_connectivity(2, 3)
    topology.create_connectivity(3, 2)
    to_cells, to_facets = topology.connectivity(2, 3), topology.connectivity(3, 2)
    outer = dmesh.exterior_facet_indices(topology)
    cells = np.array([to_cells.links(facet)[0] for facet in outer], np.int64)
    kind = KINDS[3, dofs.shape[1]]
    local = [
        int(np.flatnonzero(to_facets.links(cell) == facet)[0])
        for cell, facet in zip(cells, outer, strict=True)
    ]
    nodes = dofs[cells][:, np.argsort(kind.order)]
    numbers = _numbers(kind)[np.array(local, np.int64)]
    rings = np.take_along_axis(nodes, _rings(kind)[numbers], axis=1)
    return Skin(cells, rings.astype(np.int64))


def _numbers(kind: Kind) -> Indices:
    """Numbers in ``kind`` of the facets of the reference cell, in the order of basix."""
    corners = [set(facet) for facet in kind.facets]
    facets = basix.topology(getattr(basix.CellType, kind.name))[2]
    return np.array([corners.index({kind.vertices[v] for v in facet}) for facet in facets])


def _rings(kind: Kind) -> Indices:
    """Corners of each facet, one after the other, with the middles of edges between them."""
    corners = np.array(kind.facets)
    if kind.degree == 1:
        return corners
    middle_of = {frozenset(edge): kind.corners + i for i, edge in enumerate(kind.edges)}
    pairs = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)
    middles = [[middle_of[frozenset(pair)] for pair in ring] for ring in pairs.tolist()]
    return np.stack([corners, middles], axis=2).reshape(len(corners), -1)
