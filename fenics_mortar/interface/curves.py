# SPDX-License-Identifier: MIT
"""Ordering of facets along the curves that they form, by coordinates alone."""

from __future__ import annotations

import numpy as np

from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import SurfaceError, format_point
from fenics_mortar.utils.rounding import ROUNDING


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
        Old number of each node, shape (n,); then, in new numbers, the facets, shape (m, K), and the
        nodes before and after each one, -1 at an end, shapes (n,).

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
    return permutation, np.stack(nodes, axis=1), previous, following


def _branching(name: str, X: Array) -> SurfaceError:
    return SurfaceError(
        f"surface '{name}' branches at {format_point(X)}: more than two of its facets, or two of "
        "opposite direction, meet there; split it into two surfaces"
    )
