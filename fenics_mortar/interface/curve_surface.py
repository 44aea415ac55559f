# SPDX-License-Identifier: MIT
"""Contact surfaces in the plane: curves of facets.

Nodes are numbered along the curves. Start and order of the curves follow from coordinates alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.interface.curves import number_nodes, order_curves, turn_between
from fenics_mortar.interface.measures import facet_measures
from fenics_mortar.interface.roles import Roles
from fenics_mortar.interface.surfaces import Surface, place_of_nodes
from fenics_mortar.interface.tagged_facets import local_facets
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array, Indices, norms


@dataclass(frozen=True, kw_only=True)
class Curve(Surface):
    """Facets of some boundary tags as curves, in order along them, with the body on the left.

    Facets have two nodes, with quadratic displacements three. The tip of a crack is there twice, as
    the end of each face; see ``curves``.

    Attributes:
        previous: Node before each node along its curve, -1 at an end, shape (n,).
        following: Node after each node, -1 at an end, shape (n,).
        roles: Which facets are masters of which, of a surface that may touch itself.
    """

    previous: Indices
    following: Indices
    roles: Roles | None = None

    @cached_property
    def degree(self) -> int:
        """Polynomial degree of the facets."""
        return self.facets.shape[1] - 1

    @property
    def corners(self) -> Indices:
        """See ``Surface``."""
        return self.facets[:, [0, -1]]

    @cached_property
    def inner(self) -> npt.NDArray[np.bool_]:
        """Whether a node lies inside a facet, shape (n,)."""
        inner = np.zeros(self.num_nodes, bool)
        inner[self.facets[:, 1:-1]] = True
        return inner

    @cached_property
    def lengths(self) -> Array:
        """Reference lengths of the facets, shape (m,) [length]."""
        return facet_measures(self.X[self.facets]).sum(axis=1)

    @cached_property
    def between_corners(self) -> tuple[Indices, Indices, Array]:
        """See ``Surface``: the ends of a facet have the same weight."""
        inner = self.facets[:, 1:-1].ravel()
        ends = self.corners[: inner.size]  # none if facets have two nodes
        return inner, ends, np.full((inner.size, 1), 0.5)

    @property
    def facet_sizes(self) -> Array:
        """See ``Surface``: lengths."""
        return self.lengths

    def distortions(self, u: Array) -> Array:
        """See ``Surface``: of both ends."""
        change = u[self.facets[:, -1]] - u[self.facets[:, 0]]
        return np.asarray(norms(change) / self.lengths)

    @cached_property
    def nodal_lengths(self) -> Array:
        """Integral of each nodal shape function over the reference surface, shape (n,) [length]."""
        measures = facet_measures(self.X[self.facets])
        nodal = np.bincount(self.facets.ravel(), measures.ravel(), self.num_nodes)
        return nodal.astype(np.float64)

    @cached_property
    def near_dofs(self) -> Indices:
        """Global dofs of the nodes before each node, of the node itself and of two facets after it.

        At the first node of a facet these are the dofs of the facet before, of the facet and of the
        facet after. Shape (n, 6 K - 4) for facets of K nodes; -1 beyond an end.
        """
        degree, own = self.degree, np.arange(self.num_nodes)
        return self.dofs_of(self.along(own, range(-degree, 2 * degree + 1)))

    @cached_property
    def stencil(self) -> Indices:
        """Nodes of the two facets at each node, shape (n, 2 K - 1); see ``Surface``."""
        return self.along(np.arange(self.num_nodes), range(-self.degree, self.degree + 1))

    @cached_property
    def _areas(self) -> Array:
        """Integrals of the shape functions times the thickness over the facets, (m, K)."""
        assert self.thickness is not None
        return facet_measures(self.X[self.facets], self.thickness.at(self.X)[self.facets])

    @cached_property
    def full_cover(self) -> Array:
        """Integral of each nodal shape function times the thickness, undeformed, (n,) [area]."""
        if self.thickness is None:
            return self.nodal_lengths
        nodal = np.bincount(self.facets.ravel(), self._areas.ravel(), self.num_nodes)
        return nodal.astype(np.float64)

    @cached_property
    def mean_thickness(self) -> Array | float:
        """Mean thickness of the facets at each node, undeformed, (n,) [length]; 1.0 without one."""
        if self.thickness is None:
            return 1.0
        sums = np.zeros((2, self.num_nodes))
        for total, of_facets in zip(sums, (self._areas.sum(axis=1), self.lengths), strict=True):
            np.add.at(total, self.facets, of_facets[:, None])
        return np.asarray(sums[0] / sums[1])

    @cached_property
    def functions_move(self) -> bool:
        """Whether multiplier functions change with the positions of wholly covered facets."""
        return self.degree > 1 or (self.thickness is not None and self.thickness.by_x != 0.0)

    @cached_property
    def turns(self) -> Array:
        """Turn of the curve to the left at each node, undeformed, 0 at ends, (n,) [radian]."""
        inside = (self.previous >= 0) & (self.following >= 0) & ~self.inner
        j, turns = np.flatnonzero(inside), np.zeros(self.num_nodes)
        turns[j] = turn_between(*self.chords(self.X, j))
        return turns

    def chords(self, x: Array, nodes: Indices) -> tuple[Array, Array]:
        """Chords of the facets that end and begin at ``nodes`` (k,), (k, 2) each [length].

        Args:
            x: Positions of all nodes, shape (n, 2) [length].
            nodes: Ends of two facets each.
        """
        near = self.along(nodes, range(-self.degree, self.degree + 1, self.degree))
        return x[near[:, 1]] - x[near[:, 0]], x[near[:, 2]] - x[near[:, 1]]

    def along(self, nodes: Indices, steps: range) -> Indices:
        """Nodes at ``steps`` (s) along the curve from ``nodes`` (k,): (k, s); -1 beyond an end."""
        columns = []
        for step in steps:
            table = np.append(self.following if step > 0 else self.previous, -1)
            node = nodes
            for _ in range(abs(step)):
                node = table[node]
            columns.append(node)
        return np.stack(columns, axis=1)

    def welded(self, welds: Indices) -> Curve:
        """Surface with curves joined at welded nodes (local).

        Args:
            welds: Pairs of global nodes, equal on all ranks, shape (k, 2): the second one replaces
                the first. Pairs other than the end of one curve and the start of one are ignored.
        """
        previous, following = self.previous.copy(), self.following.copy()
        stands_for = np.arange(self.num_nodes)
        for pair in welds:
            at = [np.flatnonzero(self.nodes == node) for node in pair]
            for before, after in ((following, previous), (previous, following)):
                if all(position.size for position in at):
                    merged, kept = (int(position[0]) for position in at)
                    if stands_for[merged] == merged and before[merged] < 0 and after[kept] < 0:
                        after[kept], before[after[merged]] = after[merged], kept
                        stands_for[merged] = kept
        keep = np.flatnonzero(stands_for == np.arange(self.num_nodes))
        number = np.full(self.num_nodes + 1, -1)
        number[keep] = np.arange(keep.size)
        mine = np.isin(self.owned, keep)
        return replace(
            self,
            X=self.X[keep],
            facets=number[stands_for[self.facets]],
            previous=number[previous[keep]],
            following=number[following[keep]],
            nodes=self.nodes[keep],
            owners=self.owners[keep],
            owned=number[self.owned[mine]],
            dofs=self.dofs[keep],
            local_dofs=self.local_dofs[mine],
            thickness=self.thickness.of(keep) if self.thickness else None,
        )


def extract_curve(
    space: DisplacementSpace, facet_tags: Any, tags: Sequence[int], name: str
) -> Curve:
    """Extract the facets of some tags as curves (collective).

    Args:
        space: Nodes and dofs of the displacement, degree 1 or 2.
        facet_tags: Facet tags of the mesh.
        tags: Tags of the surface.
        name: Name used in messages.

    Returns:
        The surface.

    Raises:
        SurfaceError: If no facet has one of the tags, if a facet is not on the boundary of the mesh
            or has zero length, or if more than two facets meet at a node. Raised on all ranks.
    """
    V = space.V
    comm = V.mesh.comm
    branches = comm.allgather(local_facets(V, facet_tags, tags, name))
    ends, coordinates, given = (np.concatenate(branch) for branch in zip(*branches, strict=True))
    nodes, X, facets = number_nodes(ends, coordinates, given, name)
    order, facets, previous, following = order_curves(facets, X, name)
    thickness = space.thickness.at_nodes(X[order], comm) if space.thickness else None
    return Curve(
        name=name,
        X=X[order],
        facets=facets,
        previous=previous,
        following=following,
        thickness=thickness,
        **place_of_nodes(space, nodes[order]),
    )
