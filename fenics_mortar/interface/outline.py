# SPDX-License-Identifier: MIT
"""The outlines of bodies, all of their exterior facets, replicated on every rank.

As contact surfaces, see ``surfaces``, outlines are curves: small beside the bulk. They are drawn by
straight segments between the nodes, so that a quadratic facet is two.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import mesh as dmesh

from fenics_mortar.interface.surfaces import Surface, facet_nodes, replicate
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.rounding import ROUNDING, TINY

# Factor of the steps to which coordinates are rounded [1]: no node of a regular mesh lies between
# two steps, where the result would depend on the last digit.
ODD = 0.97312


@dataclass(frozen=True)
class Outline:
    """Segments of the outlines of some bodies, equal on all ranks but for what this one owns.

    Nodes are in an order that follows from their places, segments in one in which neighbours in
    space are near each other: neither depends on the ranks.

    Attributes:
        X: Reference positions of the nodes, shape (n, 2) [length].
        nodes: Their global numbers in the displacement's space, shape (n,).
        bodies: Body of each node, shape (n,).
        segments: Nodes of each segment, the body on the left, shape (m, 2).
        ends: Nodes at the ends of the facet that each segment is a part of, shape (m, 2).
        owners: Rank that owns each node, shape (n,).
        local_dofs: Local dofs of the nodes this rank owns, shape (owned nodes, 2).
    """

    X: Array
    nodes: Indices
    bodies: Indices
    segments: Indices
    ends: Indices
    owners: Indices
    local_dofs: Indices
    comm: MPI.Comm

    @property
    def segment_bodies(self) -> Indices:
        """Body of each segment, shape (m,)."""
        return self.bodies[self.segments[:, 0]]

    def positions(self, u: Array) -> Array:
        """Current positions at the displacement ``u``, a local array: (n, 2) (collective)."""
        return self.X + self.gather(u)

    def gather(self, values: Array) -> Array:
        """Collect nodal values (n, 2) of a local array of all dofs (collective)."""
        return replicate(values[self.local_dofs], self.owners, self.comm)

    def lengths(self, x: Array) -> Array:
        """Chords of the facets that segments are parts of, with nodes at ``x``, shape (m,)."""
        return np.hypot(*(x[self.ends[:, 1]] - x[self.ends[:, 0]]).T)

    def neighbours(self) -> tuple[Indices, Indices]:
        """Segments after and before each one, -1 for none, each (m,); in forks one of them."""
        begins, ends = np.full((2, len(self.X)), -1)
        numbers = np.arange(len(self.segments))
        begins[self.segments[:, 0]], ends[self.segments[:, 1]] = numbers, numbers
        return begins[self.segments[:, 1]], ends[self.segments[:, 0]]

    def places_of(self, nodes: Indices) -> Indices:
        """Where global ``nodes`` are among those of the outlines, shape as ``nodes``."""
        order = np.argsort(self.nodes)
        return order[np.searchsorted(self.nodes[order], nodes)]

    def segments_of(self, surface: Surface) -> Indices:
        """Ends of the segments of a surface's facets, facet by facet, shape (k, 2)."""
        at = self.places_of(surface.nodes)[surface.facets]
        return np.stack([at[:, :-1].ravel(), at[:, 1:].ravel()], axis=1)

    def are_of(self, surface: Surface) -> npt.NDArray[np.bool_]:
        """Whether each segment is one of a surface, shape (m,)."""
        key = np.array([len(self.X), 1])
        return np.isin(self.segments @ key, self.segments_of(surface) @ key)

    def bodies_of(self, surface: Surface) -> Indices:
        """Body of each facet of a surface, shape (f,)."""
        return self.bodies[self.places_of(surface.nodes)[surface.facets[:, 0]]]

    def without(self, surface: Surface, nodes: Indices) -> Outline:
        """The outlines less those facets of a surface whose nodes are all among ``nodes``.

        Where bodies are tied to each other they go on.
        """
        tied = np.isin(surface.nodes[surface.facets], nodes).all(axis=1)
        stays = ~self.are_of(replace(surface, facets=surface.facets[tied]))
        return replace(self, segments=self.segments[stays], ends=self.ends[stays])

    def of_bodies(self, bodies: Indices) -> Outline:
        """The outlines of some bodies only (local)."""
        used = np.isin(self.bodies, bodies)
        number = np.cumsum(used) - 1
        mine = used[self.segments[:, 0]]
        owned = self.owners == self.comm.rank
        return replace(
            self,
            X=self.X[used],
            nodes=self.nodes[used],
            bodies=self.bodies[used],
            segments=number[self.segments[mine]],
            ends=number[self.ends[mine]],
            owners=self.owners[used],
            local_dofs=self.local_dofs[used[owned]],
        )


def extract_outline(space: DisplacementSpace, labels: Indices, bodies: Indices) -> Outline:
    """Collect the exterior facets of bodies (collective).

    Args:
        space: The displacement's nodes and dofs.
        labels: Body of each local node.
        bodies: The bodies, equal on all ranks.
    """
    V, comm = space.V, space.V.mesh.comm
    topology, index_map = V.mesh.topology, V.dofmap.index_map
    topology.create_connectivity(1, 2)
    topology.create_connectivity(2, 1)
    facets = facet_nodes(V, dmesh.exterior_facet_indices(topology))
    facets = facets[np.isin(labels[facets[:, 0]], bodies)]
    X = V.tabulate_dof_coordinates()[:, :2]
    to_global = index_map.local_to_global(facets.ravel().astype(np.int32))
    mine = np.asarray(to_global, np.int64).reshape(facets.shape), X[facets], labels[facets]
    numbers, places, of_bodies = (
        np.concatenate(part) for part in zip(*comm.allgather(mine), strict=True)
    )
    nodes, first, inverse = np.unique(numbers.ravel(), return_index=True, return_inverse=True)
    X = places.reshape(-1, 2)[first]
    extent = max(float(np.ptp(X, axis=0).max(initial=0.0)) if len(X) else 0.0, TINY)
    steps = np.rint(X / (ODD * ROUNDING * extent))
    order = np.lexsort((steps[:, 1], steps[:, 0]))
    rank_of = np.empty_like(order)
    rank_of[order] = np.arange(order.size)
    facets = rank_of[inverse.ravel()].reshape(numbers.shape)
    X, nodes, of_bodies = X[order], nodes[order], of_bodies.ravel()[first][order]
    begin, end = index_map.local_range
    starts = np.array(comm.allgather(begin))
    owners = np.asarray(np.searchsorted(starts, nodes, side="right"), np.int64) - 1
    owned = nodes[(nodes >= begin) & (nodes < end)]
    segments = np.concatenate([facets[:, k : k + 2] for k in range(facets.shape[1] - 1)])
    ends = np.tile(facets[:, [0, -1]], (facets.shape[1] - 1, 1))
    along = _along_a_curve(X, segments)
    segments, ends = segments[along], ends[along]
    dofs = space.dofs[owned - begin]
    return Outline(X, nodes, of_bodies, segments, ends, owners, dofs, comm)


def _along_a_curve(X: Array, segments: Indices) -> Indices:
    """Order of segments along a curve that fills the plane (Morton), by their middles."""
    if not len(segments):
        return np.empty(0, np.int64)
    middles = X[segments].mean(axis=1)
    low = middles.min(axis=0)
    bits = np.iinfo(np.int64).bits // 2 - 1
    scale = ODD * (2**bits - 1) / max(float(np.ptp(middles, axis=0).max()), TINY)
    place = np.rint((middles - low) * scale).astype(np.int64)
    key = np.zeros(len(segments), np.int64)
    for bit in range(bits):
        for d in range(2):
            key |= ((place[:, d] >> bit) & 1) << (2 * bit + d)
    return np.lexsort((segments[:, 1], segments[:, 0], key))
