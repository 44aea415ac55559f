# SPDX-License-Identifier: MIT
"""Reference facets: corners, shape functions, quadrature rules, bases of the multipliers on them.

Facets in the plane are intervals [-1, 1] of 2 or 3 nodes; for those in space see
``kernels.space.shapes``.
"""

from __future__ import annotations

from functools import cache
from typing import Literal

import numpy as np

from fenics_mortar.kernels.projection import lagrange
from fenics_mortar.kernels.space import shapes
from fenics_mortar.utils.arrays import Array, Flags, read_only_view

# Nodes and corners of the facets: tri3, quad4, tri6, quad9.
CORNERS = {3: 3, 4: 4, 6: 3, 9: 4}
Basis = Literal["dual", "standard", "vertices", "linear", "quadratic"]
# Bases without multipliers at the inner nodes of quadratic facets.
AT_VERTICES = ("vertices", "linear")
# Bases in space whose functions are given combinations of shape functions.
COMBINED = (*AT_VERTICES, "quadratic")
# Fraction a of both functions beside a corner that is added to the corner's [1]: integrals over a
# straight triangle are 2/15 at corners and 1/5 at middles, closest to each other in the source.
OF_MIDDLES = 0.2


def corner_places(size: int, dim: int) -> list[int]:
    """Places of the corners among the ``size`` nodes of a facet, in the plane of its ends."""
    return [0, size - 1] if dim == 2 else list(range(CORNERS[size]))


@cache
def linear_values(size: int, dim: int = 3) -> Array:
    """Values of the linear functions of the corners at a facet's nodes, (size, corners) [1]."""
    nodes = np.linspace(-1.0, 1.0, size) if dim == 2 else shapes.reference_nodes(size)
    return tabulate(nodes, len(corner_places(size, dim)))[:, 0].copy()


@cache
def rule_of_triangles(size: int) -> tuple[Array, Array]:
    """Points (q, 2) and weights (q,) of the triangles of a facet with ``size`` nodes [1]."""
    bary, weights = shapes.triangle_rule(shapes.QUADRATIC)
    corners = shapes.reference_nodes(size)[: CORNERS[size]]
    triangles = [corners[[0, i, i + 1]] for i in range(1, len(corners) - 1)]
    points = np.concatenate([bary @ triangle for triangle in triangles])
    area = 0.5 if len(triangles) == 1 else 2.0
    return points, area * np.tile(weights, len(triangles))


def tabulate(points: Array, size: int) -> Array:
    """Shape functions of facets of ``size`` nodes, and their derivatives (local).

    Args:
        points: Points on [-1, 1], shape (q,), in space on the reference facet, (q, 2).
        size: K, the number of nodes.

    Returns:
        Shape (q, dim, K) [1].
    """
    if points.ndim == 1:
        return np.stack(lagrange(points, size - 1), axis=1)
    T = np.empty((len(points), 3, size))
    for point, values in zip(points, T, strict=True):
        shapes.tabulate_shapes(point[0], point[1], values)
    return T


def gauss_points(corners: int) -> tuple[Array, Array]:
    """Points (q,), in space (q, 2), and weights (q,) of a facet, exact to degree 5 [1] (local)."""
    return np.polynomial.legendre.leggauss(3) if corners == 2 else face_rule(corners, shapes.LINEAR)


def sample_points(size: int) -> Array:
    """Nodes of a reference facet in space, and points of a rule, shape (q, 2) [1] (local)."""
    rule = face_rule(size, shapes.LINEAR if size < 6 else shapes.QUADRATIC)
    return np.concatenate([shapes.reference_nodes(size), rule[0]])


@cache
def face_rule(size: int, points: int) -> tuple[Array, Array]:
    """Points (q, 2) and weights (q,) of a facet in space with ``size`` nodes [1] (local).

    Args:
        size: Number of nodes.
        points: Points of the rule of a triangle; on quadrilaterals there are products of Gauss
            rules with at least as many points.
    """
    if size in (3, 6):
        bary, weights = shapes.triangle_rule(points)
        return np.ascontiguousarray(bary[:, 1:]), 0.5 * weights
    gauss, weights = np.polynomial.legendre.leggauss(int(np.ceil(np.sqrt(points))))
    a, b = np.meshgrid(gauss, gauss, indexing="ij")
    return np.stack([a.ravel(), b.ravel()], axis=1), np.outer(weights, weights).ravel()


@cache
def gauss_rule(points: int) -> tuple[Array, Array]:
    """Gauss points and weights on [-1, 1], each (points,)."""
    return np.polynomial.legendre.leggauss(points)


def facet_rule(integration: str, size: int, points: int, dim: int = 2) -> tuple[Array, Array]:
    """Points and weights on a whole facet of ``size`` nodes, each (points,) [1].

    Gauss, or for "nodes" Lobatto, whose points are the nodes: trapezoidal or Simpson's rule. In
    space those of ``face_rule``.
    """
    if dim == 3:
        return face_rule(size, points)
    if integration != "nodes":
        return gauss_rule(points)
    weights = {2: [1.0, 1.0], 3: [1.0 / 3.0, 4.0 / 3.0, 1.0 / 3.0]}
    return np.linspace(-1.0, 1.0, size), np.array(weights[size])


@cache
def functions_of(size: int, basis: Basis) -> Array:
    """Coefficients of multiplier functions in the shape functions, (K, K) [1] (local).

    The unit matrix for dual and standard functions. "linear": those of the corners. "quadratic", of
    triangles with six nodes: diag(int N~) (int N~ N~^T)^-1 N~ is dual to N~ = T N, see
    ``positive_functions``, on straight, fully covered facets. These combinations are taken on all
    facets: D need not be diagonal.

    Args:
        size: Number of nodes of a facet.
        basis: Basis of the multipliers on such facets.
    """
    if basis in AT_VERTICES:
        functions = np.zeros((size, size))
        functions[: CORNERS[size]] = linear_values(size).T
        return functions
    if basis != "quadratic" or size == 3:  # linear fields of a tie with quadratic displacements
        return np.eye(size)
    (points, weights), T = rule_of_triangles(size), positive_functions()
    given = T @ tabulate(points, size)[:, 0].T
    gram = (given * weights) @ given.T
    return np.asarray(np.diag(given @ weights) @ np.linalg.solve(gram, T))


def positive_functions() -> Array:
    """Coefficients T of functions of triangles with six nodes, (6, 6) [1] (local).

    With N~ = T N, N~_corner = N_corner + a (N of the two middles beside it) and N~_middle =
    (1 - 2 a) N_middle, all integrals of N~ are positive (Wohlmuth, Popp, Gee & Wall 2012).
    """
    T = np.diag([1.0, 1.0, 1.0, *np.full(3, 1.0 - 2.0 * OF_MIDDLES)])
    for corner, beside in enumerate(((3, 5), (3, 4), (4, 5))):
        T[corner, beside] = OF_MIDDLES
    return T


def covers(integrals: Array) -> Array:
    """Positive integrals [area] at the nodes of facets, from those of their shape functions (f, K).

    At the corners of triangles with six nodes, where these are zero, they are those of the linear
    functions.
    """
    size = integrals.shape[1]
    if size != 6:
        return integrals
    positive = integrals.copy()
    positive[:, :3] = integrals @ linear_values(size)
    return positive


def hand_over(multiplier_nodes: Flags, dim: int = 2, basis: Basis = "dual") -> Array:
    """Fraction of node k's function that is added to node j's, per facet, shape (f, K, K) [1].

    Multiplier nodes keep their own function; other functions are split equally among the nearest
    multiplier nodes of the facet, in space among all of them. There ``functions_of`` the basis are
    those that are handed over.

    Args:
        multiplier_nodes: Whether a node of a facet carries a multiplier, shape (f, K), bool.
        dim: Dimension of space.
        basis: Basis of the multipliers.
    """
    size = multiplier_nodes.shape[1]
    H = _hand_overs(size, dim).take(multiplier_nodes.dot(1 << np.arange(size)), axis=0)
    return H if dim == 2 else H @ functions_of(size, basis)


@cache
def _hand_overs(size: int, dim: int) -> Array:
    """``hand_over`` of all sets of multiplier nodes on a facet, (2**K, K, K) [1]."""
    index = np.arange(size)
    carries = (np.arange(1 << size)[:, None] >> index & 1 == 1)[:, :, None]
    apart = np.minimum(np.abs(index[:, None] - index).astype(float), np.inf if dim == 2 else 1.0)
    distance = np.where(carries, apart, np.inf)
    nearest = (distance == distance.min(axis=1, keepdims=True)) & carries
    return read_only_view(nearest / np.maximum(nearest.sum(axis=1, keepdims=True), 1))


# Least eigenvalue of a scaled mass matrix over its largest [1] whose functions are independent:
# rounding then changes its inverse by 2e-6, and the forces of a narrow cover by less than 1e-11 of
# those of the surface. Covers of 1e-3 of a facet of nine nodes have 1e-12 and less.
NARROW_COVER = 1e-10


def inverse_of(Me: Array) -> Array:
    """Inverses of mass matrices (f, K, K), [1 / area], zero without cover.

    They are scaled by the diagonals: integrals of quadratic functions over a small cover may be
    negative, the diagonals are not. Functions of nine nodes over a narrow cover, as along edges of
    both sides that nearly coincide, depend on each other within rounding: these have the
    generalized inverse. With the inverse dual functions would change at random between iterations,
    and their sum would not be one; with the other it is one to 1e-12.
    """
    diagonal = np.einsum("fkk->fk", Me)
    inverse, covered = np.zeros_like(Me), (diagonal > 0.0).all(axis=1)
    root = np.sqrt(diagonal[covered])
    scaled = Me[covered] / (root[:, :, None] * root[:, None])
    try:
        inverted = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        inverted = np.full_like(scaled, np.inf)
    narrow = ~(np.abs(inverted).max(axis=(1, 2), initial=0.0) < 1.0 / NARROW_COVER)
    inverted[narrow] = np.linalg.pinv(scaled[narrow], rcond=NARROW_COVER, hermitian=True)
    inverse[covered] = inverted / (root[:, :, None] * root[:, None])
    return inverse
