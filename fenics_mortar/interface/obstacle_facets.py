# SPDX-License-Identifier: MIT
"""Facets that face a rigid obstacle, its normals, points and integrals; see ``on_obstacle``."""

from __future__ import annotations

from functools import cache

import numpy as np

from fenics_mortar.interface.faces import CORNERS
from fenics_mortar.interface.segments import MortarOptions, facet_rule
from fenics_mortar.kernels import facets
from fenics_mortar.kernels.projection import lagrange
from fenics_mortar.kernels.space.shapes import (
    LINEAR,
    QUADRATIC,
    reference_nodes,
    tabulate_shapes,
    triangle_rule,
)
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.obstacles.rotations import TURNS
from fenics_mortar.utils.arrays import Array, Flags


def integrate_facets(
    obstacle: Obstacle,
    arm: float,
    x: Array,
    weights: Array,
    rule: tuple[Array, Array],
    options: MortarOptions,
    thickness: tuple[Array, float] | None = None,
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Integrals over f whole facets of K nodes, with C = dim K columns, its dofs (local).

    Args:
        obstacle: The other side.
        arm: Length by which angles are multiplied [length].
        x: Current positions of the nodes, shape (f, K, dim) [length].
        weights: H, shape (f, K, K).
        rule: Points on [-1, 1], (q,), in space on the reference facet, (q, 2), and weights (q,).
        options: Discretization, for basis and weights of the gap.
        thickness: Thickness at the nodes, shape (f, K) [length], and its derivative with respect to
            their first coordinate [1]; one by default.

    Returns:
        D (f, K, K) [length], dD (f, K, K, C) [1], g (f, K) [length^2], dg (f, K, C) [length], dg by
        the m motions (f, K, m) [length], d (f, K) [length]; in space of areas instead of lengths.
    """
    count, size, _ = x.shape
    T = tabulate(rule[0], size)
    values, rows = _points(obstacle, arm, x, rule, T, thickness)
    kind, columns = rows.dtype, rows.shape[3]
    D, g, d = np.zeros((count, size, size), kind), *np.zeros((2, count, size), kind)
    dD, dg = np.empty((count, size**2, columns), kind), np.empty((count, size, columns), kind)
    facets.integrate_whole_facets((values, rows, T), weights, options.kinds, (D, g, d), (dD, dg))
    own = size * x.shape[2]
    dD = dD[..., :own].reshape(count, size, size, own)
    return D, dD, g, np.ascontiguousarray(dg[..., :own]), dg[..., own:], d


def _points(
    obstacle: Obstacle,
    arm: float,
    x: Array,
    rule: tuple[Array, Array],
    T: Array,
    thickness: tuple[Array, float] | None,
) -> tuple[Array, Array]:
    """W and g at points of facets, (f, q, 2), and derivatives (local).

    The latter, of xi, W, eta and g as of two surfaces, (f, q, s, dim K + m), have the nodes and the
    m motions as columns; xi and eta are constant. ``T`` (q, dim, K): shape functions; other
    arguments: see ``integrate_facets``.
    """
    N, size, dim = T[:, 0].T, x.shape[1], x.shape[2]
    at = np.einsum("kp,ekc->epc", N, x)
    J, slopes = measures(x, T)
    W = rule[1] * J
    phi, gradient, _ = obstacle.evaluate(at.reshape(-1, dim))
    V = obstacle.motions(at.reshape(-1, dim), arm).reshape(*J.shape, obstacle.place.size, dim)
    shape = *J.shape, 2 * dim, dim * size + V.shape[2]
    rows = np.zeros(shape, np.result_type(x, phi))
    by_nodes = rows[..., : dim * size].reshape(*J.shape, 2 * dim, size, dim)
    gradient = gradient.reshape(at.shape)
    dW = sum(
        np.einsum("p,epc,kp->epkc", rule[1], slope, T[:, 1 + a].T) for a, slope in enumerate(slopes)
    )
    if thickness is not None:
        theta = thickness[0] @ N
        dW = dW * theta[:, :, None, None]
        dW[..., 0] += thickness[1] * W[:, :, None] * N.T
        W = W * theta
    by_nodes[:, :, dim - 1] = dW
    by_nodes[:, :, -1] = np.einsum("epc,kp->epkc", gradient, N)
    rows[..., -1, dim * size :] = -np.einsum("epc,epmc->epm", gradient, V)
    values = np.stack([W, phi.reshape(J.shape)], axis=2).astype(rows.dtype)
    return values, rows


def measures(x: Array, T: Array) -> tuple[Array, list[Array]]:
    """Lengths or areas J of points over those of the reference facet, and derivatives (local).

    Args:
        x: Positions of the nodes, shape (f, K, dim) [length].
        T: See ``tabulate``.

    Returns:
        J, shape (f, q), and its derivatives by the tangents a_1, and in space a_2, (f, q, dim)
        each: a_1 / J, in space a_2 x n and n x a_1 with the normal n = a_1 x a_2 / J.
    """
    tangents = [np.einsum("kp,ekc->epc", T[:, 1 + a].T, x) for a in range(T.shape[1] - 1)]
    if len(tangents) == 1:
        J = np.sqrt((tangents[0] ** 2).sum(axis=2))
        return J, [tangents[0] / J[:, :, None]]
    normal = np.cross(*tangents)
    J = np.sqrt((normal**2).sum(axis=2))
    normal = normal / J[:, :, None]
    return J, [np.cross(tangents[1], normal), np.cross(normal, tangents[0])]


def points_of(x: Array, points: Array) -> Array:
    """Positions of points of facets ``x`` (f, K, dim): (f, q, dim) [length] (local).

    ``points``: as those of the rule of ``integrate_facets``.
    """
    return np.einsum("kp,ekc->epc", tabulate(points, x.shape[1])[:, 0].T, x)


def gaps_along(
    x: Array,
    weights: Array,
    rule: tuple[Array, Array],
    options: MortarOptions,
    thickness: tuple[Array, float] | None,
    distances: Array,
) -> Array:
    """Change of the weighted gaps with the distances at q points of f facets (local).

    The directions are the columns of the points' derivatives.

    Args:
        x: See ``integrate_facets``.
        weights: See ``integrate_facets``.
        rule: See ``integrate_facets``.
        options: See ``integrate_facets``.
        thickness: See ``integrate_facets``.
        distances: Changes of the distances in m directions, shape (m, f, q) [length].

    Returns:
        Shape (m, f, K) [length^2].
    """
    (count, size, dim), number, points = x.shape, len(distances), len(rule[1])
    T = tabulate(rule[0], size)
    values = np.zeros((count, points, 2))
    values[..., 0] = rule[1] * measures(x, T)[0]
    if thickness is not None:
        values[..., 0] *= thickness[0] @ T[:, 0].T
    rows = np.zeros((count, points, 2 * dim, number))
    rows[:, :, -1] = np.moveaxis(distances, 0, 2)
    D, g, d = np.zeros((count, size, size)), *np.zeros((2, count, size))
    dD, dg = np.empty((count, size**2, number)), np.empty((count, size, number))
    facets.integrate_whole_facets((values, rows, T), weights, options.kinds, (D, g, d), (dD, dg))
    return np.moveaxis(dg, 2, 0)


def shapes_at(points: Array, size: int) -> tuple[Array, Array]:
    """Shape functions of facets of ``size`` nodes and derivatives, each (size, points) [1]."""
    N, dN = lagrange(points, size - 1)
    return N.T, dN.T


def tabulate(points: Array, size: int) -> Array:
    """Shape functions of facets of ``size`` nodes, and their derivatives (local).

    Args:
        points: Points on [-1, 1], shape (q,), in space on the reference facet, (q, 2).
        size: K, the number of nodes.

    Returns:
        Shape (q, dim, K) [1].
    """
    if points.ndim == 1:
        return np.ascontiguousarray(np.stack(shapes_at(points, size)).transpose(2, 0, 1))
    T = np.empty((len(points), 3, size))
    for point, values in zip(points, T, strict=True):
        tabulate_shapes(point[0], point[1], values)
    return T


def whole_rule(options: MortarOptions, degree: int, size: int) -> tuple[Array, Array]:
    """Points and weights of whole facets of ``size`` nodes; see ``integrate_facets`` (local)."""
    if size == degree + 1:  # in the plane
        return facet_rule(options.integration, size, options.points)
    return face_rule(size, options.points)


def gauss_points(corners: int) -> tuple[Array, Array]:
    """Points (q,), in space (q, 2), and weights (q,) of a facet, exact to degree 5 [1] (local)."""
    return np.polynomial.legendre.leggauss(3) if corners == 2 else face_rule(corners, LINEAR)


def sample_points(size: int) -> Array:
    """Nodes of a reference facet in space, and points of a rule, shape (q, 2) [1] (local)."""
    rule = face_rule(size, LINEAR if size < 6 else QUADRATIC)
    return np.concatenate([reference_nodes(size), rule[0]])


@cache
def face_rule(size: int, points: int) -> tuple[Array, Array]:
    """Points (q, 2) and weights (q,) of a facet in space with ``size`` nodes [1] (local).

    Args:
        size: Number of nodes.
        points: Points of the rule of a triangle; on quadrilaterals there are products of Gauss
            rules with at least as many points.
    """
    if size in (3, 6):
        bary, weights = triangle_rule(points)
        return np.ascontiguousarray(bary[:, 1:]), 0.5 * weights
    gauss, weights = np.polynomial.legendre.leggauss(int(np.ceil(np.sqrt(points))))
    a, b = np.meshgrid(gauss, gauss, indexing="ij")
    return np.stack([a.ravel(), b.ravel()], axis=1), np.outer(weights, weights).ravel()


def obstacle_normals(
    obstacle: Obstacle, arm: float, x: Array, degree: int, projectors: Array | None = None
) -> tuple[Array, Array, Array, Array]:
    """Signed distance and normals of the slave nodes, with derivatives of the normals (local).

    Args:
        obstacle: The obstacle.
        arm: Length by which angles are multiplied [length].
        x: Current positions of the slave nodes, shape (n, d) [length].
        degree: Degree of the facets.
        projectors: Matrices that remove components of the normals, shape (n, d, d) [1].

    Returns:
        phi (n,) [length], normals (n, d), and their derivatives with respect to nodes,
        (n, 2, 4 degree + 2), as ``MortarOperators.dn``, in space with respect to the node itself,
        (n, 3, 3), and by motions, (n, d, m), all [1 / length].
    """
    phi, gradient, hessian = obstacle.evaluate(x)
    dim = obstacle.dim
    change = -hessian @ np.swapaxes(obstacle.motions(x, arm), 1, 2)
    change[:, :, dim:] += np.einsum("iab,nb->nai", TURNS[dim], gradient) / arm
    if projectors is not None:
        gradient = np.einsum("nab,nb->na", projectors, gradient)
        hessian, change = projectors @ hessian, projectors @ change
    size = np.sqrt((gradient**2).sum(axis=1))[:, None]
    n = -gradient / size
    across = (np.eye(dim) - np.einsum("ja,jb->jab", n, n)) / size[:, :, None]
    by_node = -across @ hessian
    if dim == 3:
        return phi, n, by_node, -across @ change
    dn = np.zeros((len(x), 2, 4 * degree + 2), n.dtype)
    dn[:, :, 2 * degree : 2 * degree + 2] = by_node
    return phi, n, dn, -across @ change


def facing_facets(obstacle: Obstacle, x: Array, points: Array, options: MortarOptions) -> Flags:
    """Whether facets face the obstacle within the search radius, shape (f,), bool (local).

    Args:
        obstacle: The obstacle.
        x: Positions of the facets' nodes, shape (f, K, d) [length].
        points: Points at which the distance is evaluated, see ``points_of``.
        options: Discretization.
    """
    at = points_of(x, points)
    phi, gradient, _ = obstacle.evaluate(at.reshape(-1, at.shape[2]))
    near = np.abs(phi).reshape(at.shape[:2]).min(axis=1, initial=np.inf) <= options.radius
    normal, towards = outward_normals(x), -gradient.reshape(at.shape).sum(axis=1)
    sizes = np.linalg.norm(normal, axis=1) * np.linalg.norm(towards, axis=1)
    return near & ((normal * towards).sum(axis=1) >= options.min_cosine * sizes)


def outward_normals(x: Array) -> Array:
    """Outward normals of chords or corners of facets at ``x`` (f, K, d), (f, d) [length, area].

    Their lengths are those of the chords, in space twice the areas (local).
    """
    if x.shape[2] == 2:
        chord = x[:, -1] - x[:, 0]
        return np.stack([chord[:, 1], -chord[:, 0]], axis=1)
    last = CORNERS[x.shape[1]] - 1
    return np.cross(x[:, last - 1] - x[:, 0], x[:, last] - x[:, last - 2])
