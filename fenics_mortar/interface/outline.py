# SPDX-License-Identifier: MIT
"""The outlines of bodies, all of their exterior facets, and the limits that they set to the search.

Outlines are curves, as contact surfaces, and those of bodies in space are hulls of triangles
(``Hull``). They are small compared with the bulk and replicated on every rank, see ``surfaces``.
``Sight`` limits the search behind a slave surface by the present outlines of a pair's bodies.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from dolfinx import mesh as dmesh

from fenics_mortar.interface import surfaces
from fenics_mortar.interface.mortar import BodiesBehind
from fenics_mortar.kernels import sight
from fenics_mortar.kernels.space import inside as space_sight
from fenics_mortar.kernels.space.normals import facets_around
from fenics_mortar.kernels.space.shapes import triangles_of
from fenics_mortar.kernels.tree import build_tree, spatial_order
from fenics_mortar.utils.arrays import HALF_FACET, ROUNDING, SAME_PLACE, TINY, Array, Indices, near

if TYPE_CHECKING:
    from fenics_mortar.interface.curve_surface import Curve
    from fenics_mortar.mesh.space import DisplacementSpace

# Factor of the steps to which coordinates are rounded [1]. With an odd factor no node of a regular
# mesh lies halfway between two steps, where the result would depend on the last digit.
STEP_FACTOR = 0.97312


@dataclass(frozen=True, kw_only=True)
class Outline(surfaces.SurfaceNodes):
    """Segments of the outlines of some bodies.

    Segments are straight lines between nodes: two for a quadratic facet.

    Nodes are ordered by their coordinates, segments along a space-filling curve, so that neighbours
    in space have similar numbers. Neither order depends on the partition of the mesh.

    Attributes:
        bodies: Body of each node, shape (n,).
        segments: Nodes of each segment, the body on the left, shape (m, 2).
        ends: End nodes of the facet that contains each segment, shape (m, 2).
    """

    bodies: Indices
    segments: Indices
    ends: Indices

    @property
    def segment_bodies(self) -> Indices:
        """Body of each segment, shape (m,)."""
        return self.bodies[self.segments[:, 0]]

    def positions(self, u: Array) -> Array:
        """Current positions at the displacement ``u``, an array (local dofs,) (collective).

        Returns an array of shape (n, 2) [length].
        """
        return self.X + self.gather(u)

    def lengths(self, x: Array) -> Array:
        """Chords of the facets that contain the segments, nodes at ``x`` (n, 2): (m,) [length]."""
        return np.hypot(*(x[self.ends[:, 1]] - x[self.ends[:, 0]]).T)

    def node_sizes(self, x: Array) -> Array:
        """Size of the largest facet at each node, shape (n,) [length]."""
        return self.largest_at_nodes(self.lengths(x))

    def largest_at_nodes(self, values: Array) -> Array:
        """Largest of the segments' nonnegative ``values`` (m,) at each node, (n,) [their unit]."""
        largest = np.zeros(len(self.X))
        np.maximum.at(largest, self.segments, values[:, None])
        return largest

    def normals(self, x: Array, facets: Any = slice(None)) -> Array:
        """Outward unit normals of some segments, nodes at ``x`` (n, 2), shape (..., 2) [1]."""
        a, b = np.moveaxis(x[self.segments[facets]], -2, 0)
        normals = np.stack([b[..., 1] - a[..., 1], a[..., 0] - b[..., 0]], axis=-1)
        return normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), TINY)

    def neighbours(self) -> tuple[Indices, Indices]:
        """Segments after and before each one, -1 for none, each (m,); one of several at a fork."""
        begins, ends = np.full((2, len(self.X)), -1)
        numbers = np.arange(len(self.segments))
        begins[self.segments[:, 0]], ends[self.segments[:, 1]] = numbers, numbers
        return begins[self.segments[:, 1]], ends[self.segments[:, 0]]

    def junctions(self) -> Indices:
        """Number of the junction of cracks at each node, -1 for none, shape (n,) (local).

        A junction is a place where a body has three or more nodes.
        """
        count, first = np.full((2, len(self.X)), len(self.X))
        if len(self.X):
            shortest = self.lengths(self.X).min()
            i, j = near(self.X, self.X, HALF_FACET * shortest)
            same = np.hypot(*(self.X[i] - self.X[j]).T) < SAME_PLACE * shortest
            same &= self.bodies[i] == self.bodies[j]
            count = np.bincount(i[same], minlength=len(self.X))
            np.minimum.at(first, i[same], j[same])
        return np.where(count > 2, first, -1)

    def indices_of(self, nodes: Indices) -> Indices:
        """Numbers in the outlines of global ``nodes`` (k,), shape (k,)."""
        order = np.argsort(self.nodes)
        return order[np.searchsorted(self.nodes[order], nodes)]

    def are_of(self, surface: Curve) -> npt.NDArray[np.bool_]:
        """Whether each segment belongs to a surface, shape (m,), bool."""
        at = self.indices_of(surface.nodes)[surface.facets]
        key = np.array([len(self.X), 1])
        segments = np.stack([at[:, :-1].ravel(), at[:, 1:].ravel()], axis=1)
        return np.isin(self.segments @ key, segments @ key)

    def near(self, surface: Any, marked: Any = None) -> Any:
        """Whether each segment has a node of a surface, shape (m,), bool.

        Args:
            surface: The surface.
            marked: The nodes that count, shape (nodes of the surface,), bool; all by default.
        """
        nodes = np.zeros(len(self.X), bool)
        nodes[self.indices_of(surface.nodes if marked is None else surface.nodes[marked])] = True
        return nodes[self.segments].any(axis=1)

    def bodies_of(self, surface: Curve) -> Indices:
        """Body of each facet of a surface, shape (f,)."""
        return self.bodies[self.indices_of(surface.nodes)[surface.facets[:, 0]]]

    def without(self, surface: Curve, nodes: Indices) -> Outline:
        """The outlines without the tied facets of a surface (local).

        Args:
            surface: The surface.
            nodes: Global numbers of tied nodes, shape (k,); a facet is tied if all its nodes are
                tied.
        """
        tied = np.isin(surface.nodes[surface.facets], nodes).all(axis=1)
        stays = ~self.are_of(replace(surface, facets=surface.facets[tied]))
        return replace(self, segments=self.segments[stays], ends=self.ends[stays])

    def of_bodies(self, bodies: Indices) -> Outline:
        """The outlines of the bodies with the given numbers (k,) only (local)."""
        used = np.isin(self.bodies, bodies)
        mine = used[self.segments[:, 0]]
        facets = {"segments": self.segments[mine], "ends": self.ends[mine]}
        return self.of_nodes(np.flatnonzero(used), **facets)


def extract_outline(space: DisplacementSpace, labels: Indices, bodies: Indices) -> Outline:
    """Extract the exterior facets of bodies (collective).

    Args:
        space: Nodes and dofs of the displacement.
        labels: Body of each local node, shape (local nodes,).
        bodies: Numbers of the bodies, equal on all ranks, shape (k,).
    """
    at, facets = exterior_facets(space, labels, bodies)
    segments = np.concatenate([facets[:, k : k + 2] for k in range(facets.shape[1] - 1)])
    ends = np.tile(facets[:, [0, -1]], (facets.shape[1] - 1, 1))
    order = np.lexsort(segments.T[::-1])
    along = order[spatial_order(at["X"][segments[order]].mean(axis=1))]
    return Outline(segments=segments[along], ends=ends[along], **at)


def exterior_facets(
    space: DisplacementSpace, labels: Indices, bodies: Indices
) -> tuple[dict[str, Any], Indices]:
    """The exterior facets of bodies with nodes ordered by their coordinates (collective).

    Args:
        space: See ``extract_outline``, as ``labels`` and ``bodies``.
        labels: Body of each local node, shape (local nodes,).
        bodies: Numbers of the bodies, shape (k,).

    Returns:
        Arguments of ``Outline`` for the nodes; nodes of the facets, shape (m, K).
    """
    V, topology, dim = space.V, space.V.mesh.topology, space.dim
    topology.create_connectivity(dim - 1, dim)
    topology.create_connectivity(dim, dim - 1)
    facets = surfaces.outward_nodes(V, dmesh.exterior_facet_indices(topology))
    facets = facets[np.isin(labels[facets[:, 0]], bodies)]
    nodes, X, of_bodies, facets = surfaces.facets_of_all_ranks(V, facets, labels)
    extent = max(float(np.ptp(X, axis=0).max(initial=0.0)) if len(X) else 0.0, TINY)
    order = np.lexsort(np.rint(X / (STEP_FACTOR * ROUNDING * extent)).T[::-1])
    number = np.empty_like(order)
    number[order] = np.arange(order.size)
    place = surfaces.place_of_nodes(space, nodes[order])
    return {"X": X[order], "bodies": of_bodies[order], **place}, number[facets]


# Safe depth over the undeformed thickness behind a facet [1]; the depth is at most the facet's
# length. Bodies are not compressed to a smaller fraction, nor bent within a shorter length.
SAFE = 0.25


class Sight:
    """Limits of the search behind a slave surface, from the outlines of a pair's bodies.

    Without a limit, the back of a plate would find partners through the plate. Such a partner is
    farther behind the slave surface than half the thickness of both bodies together, see
    ``kernels.sight`` and, of faces, ``kernels.space.triangles``. Thicknesses are measured in the
    present state, since bodies bend and are compressed.

    Up to a safe depth the limit is not evaluated. The cost per iteration is therefore that of
    gathering the outlines, which include the positions of both surfaces.

    Args:
        outline: Outlines of the bodies of all pairs; tied bodies have a common number.
        slave, master: The surfaces, ``Curve`` or ``Faces``.
        normals: Normals of the slave nodes in the undeformed mesh, shape (slave nodes, dim).

    Attributes:
        outline: Outlines of the bodies of the two surfaces.
    """

    def __init__(self, outline: Outline, slave: Any, master: Any, normals: Array) -> None:
        bodies = [outline.bodies_of(side) for side in (slave, master)]
        self.outline = outline = outline.of_bodies(np.unique(np.concatenate(bodies)))
        self._slave_bodies, self._master_bodies = bodies
        self._of_slave, self._of_master = map(outline.indices_of, (slave.nodes, master.nodes))
        self._segment_bodies = outline.segment_bodies
        lengths = np.empty(len(slave.facets))
        at = slave.X, normals, slave.facets, bodies[0], self._arrays(outline.X), ROUNDING, lengths
        (sight if slave.dim == 2 else space_sight).tabulate_lengths(*at)
        self._safe = np.minimum(SAFE * lengths, slave.facet_sizes)

    def _arrays(self, x: Array) -> tuple[Any, ...]:
        """Argument ``outline`` of the kernels for outlines with nodes at ``x`` (b, dim)."""
        segments = self.outline.segments
        arrays = x, segments, self._segment_bodies
        if x.shape[1] == 2:
            return arrays
        boxes = build_tree(x, segments)
        return *arrays, boxes, np.empty(len(boxes) // 2, np.int64)

    def behind_at(self, u: Array | None) -> tuple[BodiesBehind, Array, Array]:
        """The bodies behind the slave at a displacement (collective).

        Args:
            u: Displacement, shape (local dofs,) [length]; None for the undeformed state.

        Returns:
            The bodies, and displacements of slave and master nodes, each (nodes, dim) [length].
        """
        X = self.outline.X
        moved = np.zeros_like(X) if u is None else self.outline.gather(u)
        return self.behind(X + moved), moved[self._of_slave], moved[self._of_master]

    def behind(self, x: Array) -> BodiesBehind:
        """The bodies behind the slave with nodes of ``outline`` at ``x`` (n, dim) (local)."""
        return BodiesBehind(self._safe, self._slave_bodies, self._master_bodies, self._arrays(x))


@dataclass(frozen=True, kw_only=True)
class Hull(Outline):
    """Triangles of the hulls of some bodies; equal on all ranks, as an ``Outline``.

    Quadrilaterals and facets of order 2 are divided into flat triangles between their nodes.

    Attributes:
        segments: Nodes of each triangle, counter-clockwise seen from outside, shape (m, 3). The
            triangles follow a space-filling curve.
        ends: Facet of each triangle, shape (m, 1), numbers from 0 on.
    """

    numbers = surfaces.SurfaceNodes.numbers - {"ends"}

    def lengths(self, x: Array) -> Array:
        """Sizes of the triangles' facets, nodes at ``x`` (n, 3): roots of areas, (m,) [length]."""
        a, b, c = np.moveaxis(x[self.segments], 1, 0)
        areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return np.sqrt(np.bincount(self.ends[:, 0], areas))[self.ends[:, 0]]

    def normals(self, x: Array, facets: Any = slice(None)) -> Array:
        """Outward unit normals of some triangles, nodes at ``x`` (n, 3), shape (..., 3) [1]."""
        a, b, c = np.moveaxis(x[self.segments[facets]], -2, 0)
        normals = np.cross(b - a, c - a)
        return normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), TINY)

    @cached_property
    def around(self) -> tuple[Indices, Indices, Indices]:
        """Triangles at each node, see ``Surface.around``."""
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

    def are_of(self, surface: Any) -> Any:
        """Whether each triangle belongs to a surface, shape (m,), bool."""
        triangles = triangles_of(self.indices_of(surface.nodes)[surface.facets])[0]
        ours, theirs = (_keys(t, len(self.X)) for t in (self.segments, triangles))
        return np.isin(ours, theirs)


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
    at, facets = exterior_facets(space, labels, bodies)
    triangles, owner = triangles_of(facets[np.lexsort(np.sort(facets, axis=1).T[::-1])])
    along = spatial_order(at["X"][triangles[:, 0]])
    triangles = np.ascontiguousarray(triangles[along])
    return Hull(segments=triangles, ends=owner[along][:, None], **at)
