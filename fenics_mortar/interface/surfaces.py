# SPDX-License-Identifier: MIT
"""Contact surfaces: facets with given tags as curves, replicated on every rank.

A curve has O(sqrt(N)) nodes if the bulk has N, so every rank stores all of it: the contact
evaluation does not depend on the ownership of facets. Nodes are numbered along the curves. Start
and order of the curves follow from coordinates alone; the numbering does not depend on the
partition of the mesh.

Communication per rank and Newton iteration, with S slave nodes, M master nodes and B nodes on the
outlines of their bodies, for any number of ranks:

======================================================  =================
quantity                                                bytes
======================================================  =================
positions (slave of a rigid obstacle: 16 S)             16 B
sums of D, gap and cover                                32 S
contact forces                                          16 (S + M)
forces on slave nodes, from which multipliers follow    16 S
weights in multigrid                                    8 S
sum                                                     72 S + 16 M + 16 B
======================================================  =================

The work on all nodes (normals, tree of boxes) is repeated on each rank. With the solver
"iterative", the strip along the interface costs more: its right-hand side is sent to all ranks in
each linear iteration, and each rank factorizes the whole strip. The README of
`demos.studies.performance` has measurements and a simulation of up to 1000 ranks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from fenics_mortar.interface.curves import number_nodes, order_curves, turn_between
from fenics_mortar.interface.measures import facet_measures
from fenics_mortar.interface.roles import Roles
from fenics_mortar.interface.tagged_facets import local_facets
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.mesh.thickness import NodalThickness
from fenics_mortar.utils.arrays import Array, Indices

# Fraction of the whole integral [1] below which a node carries no multiplier, for two integrals.
# (1) Shape function times thickness, over the nodal area, which may become zero or negative after
# slight motions: it is 0.05 at a vertex of quadratic facets at 1/40 of a facet from the axis of
# revolution, and at least 2/3 for linear facets. (2) Cover: the multiplier function is handed over
# to a neighbour with twice the cover. Of two nodes with equal small covers either could carry the
# force, and rounding would decide.
MIN_SHARE = 0.05


@dataclass(frozen=True)
class Surface:
    """Facets of some boundary tags; equal on all ranks except ``owned`` and ``local_dofs``.

    Attributes:
        name: Name used in messages.
        X: Reference positions, shape (n, 2) [length]. The tip of a crack is there twice, as the end
            of each face; see ``curves``.
        facets: Nodes of each facet in order along its curve, the body on the left; shape (m, 2),
            with quadratic displacements (m, 3).
        previous: Node before each node along its curve, -1 at an end, shape (n,).
        following: Node after each node, -1 at an end, shape (n,).
        nodes: Global number of each node in the displacement's space, shape (n,).
        owners: Rank that owns each node, shape (n,).
        owned: Indices in these arrays of the nodes owned by this rank, shape (owned nodes,).
        dofs: Global dofs of each node, shape (n, 2).
        local_dofs: Local dofs of the nodes owned by this rank, shape (owned nodes, 2).
        comm: Communicator of the mesh.
        thickness: Out-of-plane thickness; ``None`` if it is one.
        roles: Which facets are masters of which, of a surface that may touch itself.
    """

    name: str
    X: Array
    facets: Indices
    previous: Indices
    following: Indices
    nodes: Indices
    owners: Indices
    owned: Indices
    dofs: Indices
    local_dofs: Indices
    comm: MPI.Comm
    thickness: NodalThickness | None = None
    roles: Roles | None = None

    @cached_property
    def num_nodes(self) -> int:
        """Number of nodes of the surface."""
        return self.X.shape[0]

    @cached_property
    def extent(self) -> float:
        """Diagonal of the bounding box in the reference state [length]."""
        return float(np.hypot(*np.ptp(self.X, axis=0)))

    @cached_property
    def degree(self) -> int:
        """Polynomial degree of the facets."""
        return self.facets.shape[1] - 1

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
    def nodal_areas(self) -> Array:
        """Nodal lengths times mean thickness, (n,) [area]; positive even if a weight is not."""
        return self.nodal_lengths * self.mean_thickness

    @cached_property
    def weightless(self) -> npt.NDArray[np.bool_]:
        """Nodes whose shape function has no positive integral with the thickness, shape (n,).

        The vertex of a quadratic facet on the axis of revolution: int (1 - s) (1 - 2 s) s ds = 0.
        """
        return self.full_cover < MIN_SHARE * self.nodal_areas

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

    def gather(self, values: Array) -> Array:
        """Gather nodal values of a function of the space on all ranks (collective).

        Args:
            values: Local array of all dofs, owned ones first, shape (local dofs,).

        Returns:
            Values at the nodes of the surface, shape (n, 2) [their unit], equal on all ranks.
        """
        return replicate(values[self.local_dofs], self.owners, self.comm)

    def dofs_of(self, which: Indices) -> Indices:
        """Global dofs of nodes of the surface (local).

        Args:
            which: Numbers of the nodes, -1 for none, shape (..., k).

        Returns:
            Dofs, -1 for none, shape (..., 2 k).
        """
        dofs = np.where(which[..., None] >= 0, self.dofs[which], -1)
        return dofs.reshape(*which.shape[:-1], 2 * which.shape[-1])

    def welded(self, welds: Indices) -> Surface:
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

    def scatter_add(self, values: Array, target: Array) -> None:
        """Add replicated nodal ``values`` (n, 2) to the owned dofs of a local array (local).

        Args:
            values: Shape (n, 2).
            target: Local array of dofs, shape (owned dofs,) or longer; changed in place.
        """
        np.add.at(target, self.local_dofs, values[self.owned])


def extract_surface(
    space: DisplacementSpace, facet_tags: Any, tags: Sequence[int], name: str
) -> Surface:
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
    nodes = nodes[order]
    begin, end = V.dofmap.index_map.local_range
    starts = np.array(comm.allgather(begin))
    owners = np.searchsorted(starts, nodes, side="right") - 1
    owned = np.flatnonzero((nodes >= begin) & (nodes < end))
    local_dofs = space.dofs[nodes[owned] - begin]
    thickness = space.thickness.at_nodes(X[order], comm) if space.thickness else None
    return Surface(
        name,
        X[order],
        facets,
        previous,
        following,
        nodes,
        owners,
        owned,
        replicate(local_dofs + space.first, owners, comm),
        local_dofs,
        comm,
        thickness,
    )


def replicate(mine: npt.NDArray[Any], owners: Indices, comm: MPI.Comm) -> npt.NDArray[Any]:
    """Gather the values of all ranks in the order of the nodes (collective).

    Args:
        mine: Values at the nodes owned by this rank, in order, shape (owned nodes, c).
        owners: Rank that owns each node, equal on all ranks, shape (nodes,).
        comm: Communicator.

    Returns:
        Values at all nodes, shape (nodes, c), equal on all ranks.
    """
    if comm.size == 1:
        return np.ascontiguousarray(mine)
    everything = np.empty((owners.size, mine.shape[1]), mine.dtype)
    counts = np.bincount(owners, minlength=comm.size)
    comm.Allgatherv(np.ascontiguousarray(mine), (everything, mine.shape[1] * counts))
    ordered = np.empty_like(everything)
    ordered[np.argsort(owners, kind="stable")] = everything
    return ordered
