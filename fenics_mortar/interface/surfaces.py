# SPDX-License-Identifier: MIT
"""Contact surfaces: the facets of a tag as curves, replicated on every rank.

A curve is small, O(sqrt(N)) nodes beside a bulk of N: so every rank holds all of it, and nothing
in the contact evaluation depends on who owns a facet. Nodes are numbered along the curves, from
ends and in an order that follow from the coordinates alone, so the numbering does not depend on how
the mesh is distributed.

What that costs each rank: with S slave and M master nodes, and B nodes on the outlines of their
bodies, a Newton iteration collects positions, 16 B bytes (of a rigid obstacle's slave 16 S), sums
of D, gap and cover, 32 S, contact forces, 16 (S + M), and forces on slave nodes to recover the
multipliers, 16 S; multigrid weighs what these follow, 8 S. Together that is 72 S + 16 M + 16 B,
however many ranks there are. `demos.studies.performance.ranks` counts it:
21,744 bytes in 6 calls, the formula
says 21,736, with 41,000 unknowns. On two ranks each has 49.7 to 50.3 % of the segments.
An iteration at 161,000 unknowns takes 0.55 s on one rank and 0.35 s on
two, one at 322,000 on two ranks 0.81 s, on a machine of two cores.

What limits many ranks is simulated there, not run: an interface like that of two blocks, bodies cut
into squares. With 1e9 unknowns on 1e3 ranks S = 12,911 and M = 25,821; each rank holds 5.8 MB and
is handed 3.4 MB in an iteration, as much as on 10 ranks. That is little beside a million unknowns
of its own; but it does not shrink, nor does the work on all nodes that every rank repeats (normals,
the sorted boxes of the search). With solver "iterative" the strip along the interface costs more:
its right-hand side, 1.9 MB, goes to all ranks in every linear iteration, and each makes all of its
factors. What would lift the limit: each rank keeps its own slave facets and the master facets whose
boxes touch theirs. The busiest then holds 1.8 MB and is handed 21 kB in 12 messages. But only 18
ranks have slave facets, so that their share of the integrals is 1 / 18 and not 1 / 1000; and the
strip comes first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import mesh as dmesh

from fenics_mortar.kernels.shapes import lagrange
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import SurfaceError, count_places, place


@dataclass(frozen=True)
class Surface:
    """The facets of one boundary tag, equal on all ranks except for what this rank owns.

    Attributes:
        name: Name used in messages.
        X: Reference positions, shape (n, 2) [length].
        facets: Nodes of each facet in order along its curve, the body on the left; shape (m, 2),
            with quadratic displacements (m, 3).
        previous: Node before each node along its curve, -1 at an end, shape (n,).
        following: Node after each node, -1 at an end, shape (n,).
        nodes: Global number of each node in the displacement's space, shape (n,).
        owners: Rank that owns each node, shape (n,).
        owned: Positions in these arrays of the nodes this rank owns.
        dofs: Global dofs of each node, shape (n, 2).
        local_dofs: Local dofs of the nodes this rank owns, shape (owned nodes, 2).
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

    @cached_property
    def num_nodes(self) -> int:
        """Number of nodes of the surface."""
        return self.X.shape[0]

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
        return _measures(self.X[self.facets]).sum(axis=1)

    @cached_property
    def nodal_lengths(self) -> Array:
        """Integral of each nodal shape function over the reference surface, shape (n,) [length]."""
        measures = _measures(self.X[self.facets])
        nodal = np.bincount(self.facets.ravel(), measures.ravel(), self.num_nodes)
        return nodal.astype(np.float64)

    @cached_property
    def turns(self) -> Array:
        """Turn of the curve to the left at each node, undeformed, 0 at ends, (n,) [radian]."""
        inside = (self.previous >= 0) & (self.following >= 0) & ~self.inner
        j, turns = np.flatnonzero(inside), np.zeros(self.num_nodes)
        a, b = self.chords(self.X, j)
        turns[j] = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1))
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
        """Nodes so many ``steps`` along the curve from ``nodes`` (k,): (k, steps); -1 is beyond."""
        columns = []
        for step in steps:
            table = np.append(self.following if step > 0 else self.previous, -1)
            node = nodes
            for _ in range(abs(step)):
                node = table[node]
            columns.append(node)
        return np.stack(columns, axis=1)

    def gather(self, values: Array) -> Array:
        """Collect nodal values of a function of the space on all ranks (collective).

        Args:
            values: Local array of all dofs, owned ones first.

        Returns:
            Values at the nodes of the surface, shape (n, 2), equal on all ranks.
        """
        return replicate(values[self.local_dofs], self.owners, self.comm)

    def dofs_of(self, which: Indices) -> Indices:
        """Global dofs (..., 2 k) of the nodes ``which`` (..., k) of the surface; -1 stays -1."""
        dofs = np.where(which[..., None] >= 0, self.dofs[which], -1)
        return dofs.reshape(*which.shape[:-1], 2 * which.shape[-1])

    def welded(self, welds: Indices) -> Surface:
        """The surface with curves joined where nodes are one (local).

        Args:
            welds: Pairs of global nodes, equal on all ranks, shape (k, 2): the second one stands
                for both. Pairs that are not the end of a curve and the start of one are left.
        """
        previous, following = self.previous.copy(), self.following.copy()
        stands_for = np.arange(self.num_nodes)
        for pair in welds:
            at = [np.flatnonzero(self.nodes == node) for node in pair]
            for before, after in ((following, previous), (previous, following)):
                if all(place.size for place in at):
                    gone, kept = (int(place[0]) for place in at)
                    if stands_for[gone] == gone and before[gone] < 0 and after[kept] < 0:
                        after[kept], before[after[gone]] = after[gone], kept
                        stands_for[gone] = kept
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
        )

    def scatter_add(self, values: Array, target: Array) -> None:
        """Add replicated nodal ``values`` (n, 2) to the owned part of a local array (local)."""
        target[self.local_dofs] += values[self.owned]


def extract_surface(space: DisplacementSpace, facet_tags: Any, tag: int, name: str) -> Surface:
    """Collect the facets of ``tag`` as curves (collective).

    Args:
        space: The displacement's nodes and dofs, degree 1 or 2.
        facet_tags: Facet tags of the mesh.
        tag: Tag of the surface.
        name: Name used in messages.

    Returns:
        The surface, the same on all ranks.

    Raises:
        SurfaceError: If no facet has the tag, or a facet is not on the boundary of the mesh or has
            zero length, or if more than two facets meet in a node. Raised on all ranks.
    """
    V = space.V
    comm = V.mesh.comm
    branches = comm.allgather(_local_facets(V, facet_tags, tag, name))
    ends, coordinates, given = (np.concatenate(branch) for branch in zip(*branches, strict=True))
    nodes, X, facets = _number_nodes(ends, coordinates, given, name)
    order, facets, previous, following = _order_curves(facets, X, name)
    nodes = nodes[order]
    begin, end = V.dofmap.index_map.local_range
    starts = np.array(comm.allgather(begin))
    owners = np.searchsorted(starts, nodes, side="right") - 1
    owned = np.flatnonzero((nodes >= begin) & (nodes < end))
    local_dofs = space.dofs[nodes[owned] - begin]
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
    )


def replicate(mine: npt.NDArray[Any], owners: Indices, comm: MPI.Comm) -> npt.NDArray[Any]:
    """Values (owned nodes, 2) of all ranks in the order of nodes, (nodes, 2) (collective)."""
    everything = np.empty((owners.size, 2), mine.dtype)
    counts = np.bincount(owners, minlength=comm.size)
    comm.Allgatherv(np.ascontiguousarray(mine), (everything, 2 * counts))
    ordered = np.empty_like(everything)
    ordered[np.argsort(owners, kind="stable")] = everything
    return ordered


def _local_facets(V: Any, facet_tags: Any, tag: int, name: str) -> tuple[Indices, Array, Indices]:
    """Nodes of the facets owned here, shape (m, K); their positions, (m, K, 2), and input numbers.

    Collective. A facet counts if any rank that has it gave it the tag. Nodes inside facets have the
    input number -1.
    """
    mesh = V.mesh
    mesh.topology.create_connectivity(1, 2)
    mesh.topology.create_connectivity(2, 1)
    facet_map = mesh.topology.index_map(1)
    begin, end = facet_map.local_range
    tagged = facet_map.local_to_global(facet_tags.find(tag).astype(np.int32))
    tagged = np.unique(np.concatenate(mesh.comm.allgather(tagged)))
    tagged = (tagged[(tagged >= begin) & (tagged < end)] - begin).astype(np.int32)
    inside = np.setdiff1d(tagged, dmesh.exterior_facet_indices(mesh.topology)).astype(np.int32)
    count, where = count_places(mesh.comm, dmesh.compute_midpoints(mesh, 1, inside)[:, :2])
    if count:
        raise SurfaceError(
            f"surface '{name}': {count} of its facets are not on the boundary of the mesh, "
            f"one at {where}; a contact surface is part of the outline of one body"
        )
    ends = facet_nodes(V, tagged)
    names = compat.input_nodes(V)
    given = np.where((names[:, 1:] < 0).all(axis=1), names[:, 0], -1)
    to_global = V.dofmap.index_map.local_to_global(ends.ravel().astype(np.int32))
    x = V.tabulate_dof_coordinates()[:, :2]
    return np.asarray(to_global, np.int64).reshape(ends.shape), x[ends], given[ends]


def facet_nodes(V: Any, facets: npt.NDArray[np.int32]) -> Indices:
    """Local nodes (m, K) of facets in order, the cell on the left (local).

    The connectivities between facets and cells have to be there.
    """
    topology = V.mesh.topology
    facet_cells, cell_facets = topology.connectivity(1, 2), topology.connectivity(2, 1)
    dofmap, x = compat.dofmap(V), V.tabulate_dof_coordinates()[:, :2]
    layout = V.dofmap.dof_layout
    ends = np.empty((facets.size, len(layout.entity_closure_dofs(1, 0))), np.int64)
    for i, facet in enumerate(facets):
        cell = facet_cells.links(facet)[0]
        local = int(np.flatnonzero(cell_facets.links(cell) == facet)[0])
        a, b, *inside = dofmap[cell][layout.entity_closure_dofs(1, local)]
        inward = x[dofmap[cell]].mean(axis=0) - x[a]
        edge = x[b] - x[a]
        on_left = edge[0] * inward[1] - edge[1] * inward[0] > 0.0
        ends[i] = (a, *inside, b) if on_left else (b, *inside, a)
    return ends


def _number_nodes(
    ends: Indices, coordinates: Array, given: Indices, name: str
) -> tuple[Indices, Array, Indices]:
    """Number the nodes of the gathered facets and check the facets."""
    if not ends.size:
        raise SurfaceError(f"surface '{name}' has no facets")
    nodes, first, inverse = np.unique(ends.ravel(), return_index=True, return_inverse=True)
    X = coordinates.reshape(-1, 2)[first]
    facets = inverse.reshape(ends.shape).astype(np.int64)
    numbers = given.ravel()[first]
    order = np.argsort(numbers, kind="stable")
    twice = order[:-1][(np.diff(numbers[order]) == 0) & (numbers[order[:-1]] >= 0)]
    if twice.size:  # dolfinx does not join cells of two ranks that meet in a corner only
        raise _branching(name, X[twice[0]])
    lengths = np.linalg.norm(X[facets[:, -1]] - X[facets[:, 0]], axis=1)
    shortest = int(np.argmin(lengths))
    if lengths[shortest] <= 1e-12 * lengths.max():
        raise SurfaceError(
            f"surface '{name}': the facet at {place(X[facets[shortest, 0]])} has zero length; "
            "merge its two nodes"
        )
    return nodes, X, facets


def _branching(name: str, X: Array) -> SurfaceError:
    return SurfaceError(
        f"surface '{name}' branches at {place(X)}: more than two of its facets, or two that do not "
        "continue each other, meet there; split it into two surfaces"
    )


def _order_curves(
    facets: Indices, X: Array, name: str
) -> tuple[Indices, Indices, Indices, Indices]:
    """Walk along the curves: order of the nodes, renumbered facets, neighbours of each node."""
    count = X.shape[0]
    following, previous = np.full(count, -1), np.full(count, -1)
    for a, b in np.concatenate([facets[:, k : k + 2] for k in range(facets.shape[1] - 1)]):
        for table, node, other in ((following, a, b), (previous, b, a)):
            if table[node] >= 0:
                raise _branching(name, X[node])
            table[node] = other
    by_place = np.lexsort((X[:, 1], X[:, 0]))
    by_place = by_place[np.isin(by_place, facets[:, 0])]
    ends_first = np.concatenate([by_place[previous[by_place] < 0], by_place])
    order: list[int] = []
    seen = np.zeros(count, bool)
    for start in ends_first:
        node = int(start)
        while node >= 0 and not seen[node]:
            seen[node] = True
            order.append(node)
            node = int(following[node])
    permutation = np.array(order)
    position = np.empty(count + 1, np.int64)
    position[permutation] = np.arange(count)
    position[-1] = -1
    previous, following = position[previous[permutation]], position[following[permutation]]
    nodes = [np.flatnonzero(np.isin(permutation, facets[:, 0]))]
    for _ in range(facets.shape[1] - 1):
        nodes.append(following[nodes[-1]])
    return permutation, np.stack(nodes, axis=1), previous, following


def _measures(X: Array) -> Array:
    """Integrals of the shape functions over facets ``X`` (m, K, 2): shape (m, K) [length]."""
    if X.shape[1] == 2:
        return np.repeat(np.linalg.norm(X[:, 1] - X[:, 0], axis=1)[:, None] / 2, 2, axis=1)
    points, weights = np.polynomial.legendre.leggauss(5)
    N, dN = lagrange(points, X.shape[1] - 1)
    J = np.linalg.norm(np.einsum("pk,mkc->mpc", dN, X), axis=2)
    return np.einsum("pk,mp,p->mk", N, J, weights)
