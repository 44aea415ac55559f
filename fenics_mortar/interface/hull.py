# SPDX-License-Identifier: MIT
"""The hulls of bodies in space, all of their exterior facets as triangles, on every rank.

The counterpart of ``outline``: hulls are small compared with the bulk. Quadrilaterals and facets of
order 2 are divided into flat triangles between their nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fenics_mortar.interface.faces import Faces, outward_nodes
from fenics_mortar.interface.outline import Outline, exterior_facets
from fenics_mortar.kernels.space.normals import facets_around
from fenics_mortar.kernels.space.pairs import spatial_order
from fenics_mortar.kernels.space.shapes import triangles_of
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.rounding import TINY


@dataclass(frozen=True)
class Hull(Outline):
    """Triangles of the hulls of some bodies; see ``Outline``, equal on all ranks likewise.

    Attributes:
        segments: Nodes of each triangle, counter-clockwise seen from outside, shape (m, 3). The
            triangles follow a space-filling curve.
        ends: Facet of each triangle, shape (m, 1), numbers from 0 on.
    """

    def lengths(self, x: Array) -> Array:
        """Sizes of the triangles' facets, nodes at ``x`` (n, 3): roots of areas, (m,) [length]."""
        a, b, c = np.moveaxis(x[self.segments], 1, 0)
        areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return np.sqrt(np.bincount(self.ends[:, 0], areas))[self.ends[:, 0]]

    def node_sizes(self, x: Array) -> Array:
        """Size of the largest facet at each node, shape (n,) [length]."""
        return self.largest_at_nodes(self.lengths(x))

    def largest_at_nodes(self, values: Array) -> Array:
        """Largest of the triangles' nonnegative ``values`` (m,) at each node, (n,) [their unit]."""
        largest = np.zeros(len(self.X))
        np.maximum.at(largest, self.segments, values[:, None])
        return largest

    def normals(self, x: Array) -> Array:
        """Outward unit normals of the triangles, nodes at ``x`` (n, 3), shape (m, 3) [1]."""
        a, b, c = np.moveaxis(x[self.segments], 1, 0)
        normals = np.cross(b - a, c - a)
        return normals / np.maximum(np.linalg.norm(normals, axis=1), TINY)[:, None]

    @cached_property
    def around(self) -> tuple[Indices, Indices, Indices]:
        """Triangles at each node, see ``Faces.around``."""
        return facets_around(self.segments, len(self.X))

    @cached_property
    def edges(self) -> tuple[Indices, Indices]:
        """Nodes of each edge, ascending, and its two triangles, both (k, 2).

        An edge on which more than two triangles meet has the first and the last of them.
        """
        ends = np.stack([self.segments, np.roll(self.segments, -1, axis=1)], axis=2).reshape(-1, 2)
        owner = np.repeat(np.arange(len(self.segments)), 3)
        edges, number = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
        number = number.ravel()
        beside = np.stack([np.full(len(edges), len(owner)), np.full(len(edges), -1)], axis=1)
        np.minimum.at(beside[:, 0], number, owner)
        np.maximum.at(beside[:, 1], number, owner)
        return edges, beside

    def turns(self, x: Array) -> Array:
        """Angles between the triangles at the edges, nodes at ``x`` (n, 3), (k,) [radian]."""
        one, other = np.moveaxis(self.normals(x)[self.edges[1]], 1, 0)
        across = np.linalg.norm(np.cross(one, other), axis=1)
        return np.arctan2(across, np.einsum("ec,ec->e", one, other))

    def ends_among(self, number: Indices, mine: Any) -> Indices:
        """See ``Outline``: numbers of facets stay."""
        return self.ends[mine]

    def are_of(self, surface: Any) -> Any:
        """Whether each triangle belongs to a surface, shape (m,), bool."""
        triangles = triangles_of(self.indices_of(surface.nodes)[surface.facets])[0]
        ours, theirs = (_keys(t, len(self.X)) for t in (self.segments, triangles))
        return np.isin(ours, theirs)

    def near(self, surface: Faces, marked: Any = None) -> Any:
        """Whether each triangle has a node of a surface, shape (m,), bool.

        Args:
            surface: The surface.
            marked: The nodes that count, shape (nodes of the surface,), bool; all by default.
        """
        nodes = np.zeros(len(self.X), bool)
        nodes[self.indices_of(surface.nodes if marked is None else surface.nodes[marked])] = True
        return nodes[self.segments].any(axis=1)


def _keys(triangles: Indices, num_nodes: int) -> Indices:
    """One number for the nodes of triangles (m, 3), in any order (m,)."""
    low, middle, high = np.sort(triangles, axis=1).T
    return np.asarray((low * num_nodes + middle) * num_nodes + high)


def extract_hull(space: DisplacementSpace, labels: Indices, bodies: Indices) -> Hull:
    """Extract the exterior facets of bodies in space (collective).

    Args:
        space: Nodes and dofs of the displacement, degree 1 or 2.
        labels: Body of each local node, shape (local nodes,).
        bodies: Numbers of the bodies, equal on all ranks, shape (k,).
    """
    at, facets, of_ranks = exterior_facets(space, labels, bodies, outward_nodes)
    triangles, owner = triangles_of(facets[np.lexsort(np.sort(facets, axis=1).T[::-1])])
    along = spatial_order(at[0], triangles)
    parts = np.ascontiguousarray(triangles[along]), owner[along][:, None]
    return Hull(*at, *parts, *of_ranks, space.V.mesh.comm)
