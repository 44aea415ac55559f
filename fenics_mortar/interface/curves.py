# SPDX-License-Identifier: MIT
"""Ordering of facets along the curves that they form, by coordinates alone.

Curves end at two kinds of nodes of cracks. At a tip the outline folds back on itself, and the
average of the normals of the two faces would be zero or along the crack. At a junction, where
cracks branch or cross each other, the corner of each part meets two others, and no single normal
belongs to both. The node is then in the surface twice, as the end of both faces, with the same
dofs.
"""

from __future__ import annotations

import numpy as np

from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import SurfaceError, format_point
from fenics_mortar.utils.rounding import ROUNDING, SAME_PLACE

# A node is a corner if the undeformed outline turns there by more than this angle [radian], that of
# a regular hexagon; curves are meshed finer.
TURN = np.pi / 3.0
# Turn of the outline to the right from which on it folds back, as round the tip of a crack
# [radian]: the faces enclose an angle below 30 degrees and face each other; the average of their
# normals has a quarter of their length.
FOLD = 5.0 * np.pi / 6.0
# Turn to the left from which on a node where three or more nodes of a surface meet is the corner of
# a part at a junction of cracks [radian]: 10 degrees. A crack that goes straight on has none.
BRANCH = np.pi / 18.0


def number_nodes(
    ends: Indices, coordinates: Array, given: Indices, name: str
) -> tuple[Indices, Array, Indices]:
    """Number the nodes of facets, and check the facets (local).

    Args:
        ends: Global nodes of the facets of all ranks, shape (m, K).
        coordinates: Reference positions of these nodes, shape (m, K, 2) [length].
        given: Numbers of these nodes in the input mesh, -1 for none, shape (m, K).
        name: Name of the surface, used in messages.

    Returns:
        Global nodes in increasing order, shape (n,), their positions, shape (n, 2), and the facets
        in terms of them, shape (m, K).

    Raises:
        SurfaceError: If there are no facets, one has zero length, or two ranks have different nodes
            for one node of the input mesh.
    """
    if not ends.size:
        raise SurfaceError(f"surface '{name}' has no facets")
    nodes, first, inverse = np.unique(ends.ravel(), return_index=True, return_inverse=True)
    X = coordinates.reshape(-1, 2)[first]
    facets = inverse.reshape(ends.shape).astype(np.int64)
    numbers = given.ravel()[first]
    order = np.argsort(numbers, kind="stable")
    twice = order[:-1][(np.diff(numbers[order]) == 0) & (numbers[order[:-1]] >= 0)]
    if twice.size:  # dolfinx stores two nodes if cells of two ranks share only a corner
        raise _branching(name, X[twice[0]])
    lengths = np.linalg.norm(X[facets[:, -1]] - X[facets[:, 0]], axis=1)
    shortest = int(np.argmin(lengths))
    if lengths[shortest] <= ROUNDING * lengths.max():
        raise SurfaceError(
            f"surface '{name}': the facet at {format_point(X[facets[shortest, 0]])} has zero "
            "length; merge its two nodes"
        )
    return nodes, X, facets


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
    order: list[int] = []
    visited = np.zeros(count, bool)
    for start in ends_first:
        node = int(start)
        while node >= 0 and not visited[node]:
            visited[node] = True
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
    return old[permutation], np.stack(nodes, axis=1), previous, following


def ends_of_faces(X: Array, previous: Indices, following: Indices) -> Indices:
    """Nodes at tips and junctions of cracks, inside of curves, shape (k,) (local).

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
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn = np.arctan2(cross, (before * after).sum(axis=1))
    return np.asarray(np.where(turn > np.pi - SAME_PLACE, -np.pi, turn))


def _branching(name: str, X: Array) -> SurfaceError:
    return SurfaceError(
        f"surface '{name}' branches at {format_point(X)}: more than two of its facets, or two of "
        "opposite direction, meet there; split it into two surfaces, or, inside of a crack, use "
        "different nodes for its two faces"
    )
