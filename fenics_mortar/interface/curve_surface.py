# SPDX-License-Identifier: MIT
"""Contact surfaces in the plane: curves of facets.

``order_curves`` numbers the nodes along the curves; their start and order follow from coordinates
alone. Curves end where the surface ends, and at tips and junctions of cracks, see
``ends_of_faces``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_mortar.interface import surfaces
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.mesh.space import DisplacementSpace, input_nodes
from fenics_mortar.utils.arrays import ROUNDING, SAME_PLACE, Array, Indices, Numbers, angles_between
from fenics_mortar.utils.errors import SurfaceError, format_point

# Turn of the outline to the right from which on it folds back, as round the tip of a crack
# [radian]: the faces enclose an angle below 30 degrees and face each other; the average of their
# normals has a quarter of their length.
FOLD = 5.0 * np.pi / 6.0
# Turn to the left from which on a node where three or more nodes of a surface meet is the corner of
# a part at a junction of cracks [radian]: 10 degrees. A crack that goes straight on has none.
BRANCH = np.pi / 18.0


def _check_facets(facets: Indices, X: Array, given: Indices, name: str) -> None:
    """Reject facets without length, and nodes of the input mesh that are there twice (local).

    Args:
        facets: Nodes of the facets, shape (m, K).
        X: Reference positions of the nodes, shape (n, 2) [length].
        given: Numbers of the nodes in the input mesh, -1 for none, shape (n,).
        name: Name of the surface, used in messages.

    Raises:
        SurfaceError: If there are no facets, one has zero length, or two ranks have different nodes
            for one node of the input mesh.
    """
    if not facets.size:
        raise SurfaceError(f"surface '{name}' has no facets")
    order = np.argsort(given, kind="stable")
    twice = order[:-1][(np.diff(given[order]) == 0) & (given[order[:-1]] >= 0)]
    if twice.size:  # dolfinx stores two nodes if cells of two ranks share only a corner
        raise _branching(name, X[twice[0]])
    lengths = np.linalg.norm(X[facets[:, -1]] - X[facets[:, 0]], axis=1)
    shortest = int(np.argmin(lengths))
    if lengths[shortest] <= ROUNDING * lengths.max():
        raise SurfaceError(
            f"surface '{name}': the facet at {format_point(X[facets[shortest, 0]])} has zero "
            "length; merge its two nodes"
        )


def order_curves(facets: Indices, X: Array, name: str) -> tuple[Indices, Indices, Indices, Indices]:
    """Order nodes and facets along curves; start and order of the curves follow from coordinates.

    Args:
        facets: Nodes of the facets, shape (m, K).
        X: Reference positions of the nodes, shape (n, 2) [length].
        name: Name of the surface, used in messages.

    Returns:
        Old number of each node, shape (k,), twice for tips and junctions of cracks; then, in new
        numbers, the facets, shape (m, K), and the nodes before and after each one, -1 at an
        end, shapes (k,).

    Raises:
        SurfaceError: If more than two facets, or two of opposite direction, meet at a node.
    """
    count = X.shape[0]
    following, previous = np.full(count, -1), np.full(count, -1)
    for a, b in np.concatenate([facets[:, k : k + 2] for k in range(facets.shape[1] - 1)]):
        for table, node, other in ((following, a, b), (previous, b, a)):
            if table[node] >= 0:
                raise _branching(name, X[node])
            table[node] = other
    twice = ends_of_faces(X, previous, following)
    old = np.append(np.arange(count), twice)
    if twice.size:
        X, facets = X[old], facets.copy()
        starts = np.arange(count)
        starts[twice] = np.arange(count, old.size)
        facets[:, 0] = starts[facets[:, 0]]
        previous[following[twice]] = starts[twice]
        previous = np.append(previous, np.full(twice.size, -1))
        following = np.append(following, following[twice])
        following[twice] = -1
        count = old.size
    by_place = np.lexsort((X[:, 1], X[:, 0]))
    by_place = by_place[np.isin(by_place, facets[:, 0])]
    ends_first = np.concatenate([by_place[previous[by_place] < 0], by_place])
    permutation = np.concatenate(chains(following, ends_first))
    position = np.empty(count + 1, np.int64)
    position[permutation] = np.arange(count)
    position[-1] = -1
    previous, following = position[previous[permutation]], position[following[permutation]]
    nodes = [np.flatnonzero(np.isin(permutation, facets[:, 0]))]
    for _ in range(facets.shape[1] - 1):
        nodes.append(following[nodes[-1]])
    return old[permutation], np.stack(nodes, axis=1), previous, following


def chains(following: Indices, starts: Sequence[int] | Indices) -> list[Indices]:
    """Numbers in the order of each chain, shape (k,) each (local).

    Args:
        following: The next number of each one, -1 for none, shape (n,).
        starts: First numbers of chains; one that another chain has reached begins none.
    """
    visited, found = np.zeros(following.size, bool), []
    for start in starts:
        at, chain = int(start), list[int]()
        while at >= 0 and not visited[at]:
            visited[at] = True
            chain.append(at)
            at = int(following[at])
        if chain:
            found.append(np.array(chain))
    return found


def ends_of_faces(X: Array, previous: Indices, following: Indices) -> Indices:
    """Nodes at tips and junctions of cracks, inside of curves, shape (k,) (local).

    At a tip the outline folds back on itself, and the average of the normals of the two faces would
    be zero or along the crack. At a junction, where cracks branch or cross each other, the corner
    of each part meets two others, and no single normal belongs to both. The node is then in the
    surface twice, as the end of both faces, with the same dofs.

    Args:
        X: Reference positions of the nodes, shape (n, 2) [length].
        previous: Node before each node, -1 at an end, shape (n,).
        following: Node after each node, -1 at an end, shape (n,).
    """
    inside = np.flatnonzero((previous >= 0) & (following >= 0))
    before, after = X[inside] - X[previous[inside]], X[following[inside]] - X[inside]
    turn = turn_between(before, after)
    at_end = turn < -FOLD
    for k in np.flatnonzero(turn > BRANCH):
        same = np.hypot(*(X - X[inside[k]]).T) < SAME_PLACE * np.hypot(*before[k])
        at_end[k] = same.sum() > 2
    return inside[at_end]


def turn_between(before: Array, after: Array) -> Array:
    """Turns to the left from edges ``before`` (k, 2) to those after, (k,) [radian] (local).

    The body is on the left: turns are between -pi, at the tip of a crack, and less than pi.
    """
    turn = angles_between(before, after)
    return np.asarray(np.where(turn > np.pi - SAME_PLACE, -np.pi, turn))


def _branching(name: str, X: Array) -> SurfaceError:
    return SurfaceError(
        f"surface '{name}' branches at {format_point(X)}: more than two of its facets, or two of "
        "opposite direction, meet there; split it into two surfaces, or, inside of a crack, use "
        "different nodes for its two faces"
    )


@dataclass(frozen=True, kw_only=True)
class Curve(Surface):
    """Facets of some boundary tags as curves, in order along them, with the body on the left.

    Facets have two nodes, with quadratic displacements three. The tip of a crack is there twice, as
    the end of each face.

    Attributes:
        previous: Node before each node along its curve, -1 at an end, shape (n,).
        following: Node after each node, -1 at an end, shape (n,).
    """

    previous: Indices
    following: Indices

    @cached_property
    def nodal_lengths(self) -> Array:
        """Integral of each nodal shape function over the reference surface, shape (n,) [length]."""
        return self.on_nodes(self.measures)

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
    def mean_thickness(self) -> Array | float:
        """Mean thickness of the facets at each node, undeformed, (n,) [length]; 1.0 without one."""
        if self.thickness is None:
            return 1.0
        sums = np.zeros((2, self.num_nodes))
        for total, of_facets in zip(sums, (self.areas, self.measures), strict=True):
            np.add.at(total, self.facets, of_facets.sum(axis=1)[:, None])
        return np.asarray(sums[0] / sums[1])

    @cached_property
    def turns(self) -> Array:
        """Turn of the curve to the left at each node, undeformed, 0 at ends, (n,) [radian]."""
        inside = (self.previous >= 0) & (self.following >= 0) & ~self.inner
        j, turns = np.flatnonzero(inside), np.zeros(self.num_nodes)
        near = self.along(j, range(-self.degree, self.degree + 1, self.degree))
        turns[j] = turn_between(*np.moveaxis(np.diff(self.X[near], axis=1), 1, 0))
        return turns

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
        new = {"facets": stands_for[self.facets], "previous": previous, "following": following}
        return self.of_nodes(keep, **new)


def extract_curve(space: DisplacementSpace, facets: Numbers, name: str) -> Curve:
    """Extract facets as curves (collective).

    Args:
        space: Nodes and dofs of the displacement, degree 1 or 2.
        facets: Local facets that this rank owns, shape (m,).
        name: Name used in messages.

    Returns:
        The surface.

    Raises:
        SurfaceError: On all ranks, if there are no facets, if one has zero length, or if more than
            two meet at a node.
    """
    V, names = space.V, input_nodes(space.V)
    given = np.where((names[:, 1:] < 0).all(axis=1), names[:, 0], -1)
    mine = surfaces.outward_nodes(V, facets)
    nodes, X, given, of_facets = surfaces.facets_of_all_ranks(V, mine, given)
    _check_facets(of_facets, X, given, name)
    order, of_facets, previous, following = order_curves(of_facets, X, name)
    thickness = space.thickness.at_nodes(X[order], V.mesh.comm) if space.thickness else None
    place = surfaces.place_of_nodes(space, nodes[order]) | {"X": X[order], "thickness": thickness}
    return Curve(name=name, facets=of_facets, previous=previous, following=following, **place)
