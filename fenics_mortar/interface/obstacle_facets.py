# SPDX-License-Identifier: MIT
"""Points of facets that face a rigid obstacle, and integrals; see ``on_obstacle``."""

from __future__ import annotations

import numpy as np

from fenics_mortar.interface.options import MortarOptions
from fenics_mortar.kernels import facets
from fenics_mortar.kernels.shapes import lagrange
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arrays import Array


def integrate_facets(
    obstacle: Obstacle,
    arm: float,
    x: Array,
    weights: Array,
    rule: tuple[Array, Array],
    options: MortarOptions,
    thickness: tuple[Array, float] | None = None,
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Integrals over f whole facets of K nodes, with C = 2 K columns, its dofs (local).

    Args:
        obstacle: The other side.
        arm: Length by which angles are multiplied [length].
        x: Current positions of the nodes, shape (f, K, 2) [length].
        weights: H, shape (f, K, K).
        rule: Points and weights on [-1, 1], each (q,).
        options: Discretization, for basis and weights of the gap.
        thickness: Thickness at the nodes, shape (f, K) [length], and its derivative with respect to
            their first coordinate [1]; one by default.

    Returns:
        D (f, K, K) [length], dD (f, K, K, C) [1], g (f, K) [length^2], dg (f, K, C) [length], dg by
        the motions (f, K, 3) [length], d (f, K) [length].
    """
    count, size, _ = x.shape
    T = np.stack(shapes_at(rule[0], size)).transpose(2, 0, 1)
    values, rows = _points(obstacle, arm, x, rule, T, thickness)
    kind, columns = rows.dtype, rows.shape[3]
    D, g, d = np.zeros((count, size, size), kind), *np.zeros((2, count, size), kind)
    dD, dg = np.empty((count, size**2, columns), kind), np.empty((count, size, columns), kind)
    facets.integrate_whole_facets(
        (values, rows, np.ascontiguousarray(T)), weights, options.kinds, (D, g, d), (dD, dg)
    )
    dD = dD[..., :-3].reshape(count, size, size, columns - 3)
    return D, dD, g, np.ascontiguousarray(dg[..., :-3]), dg[..., -3:], d


def _points(
    obstacle: Obstacle,
    arm: float,
    x: Array,
    rule: tuple[Array, Array],
    T: Array,
    thickness: tuple[Array, float] | None,
) -> tuple[Array, Array]:
    """W and g at points of facets, (f, q, 2), and derivatives (local).

    The latter, of xi, W, eta and g as of two surfaces, (f, q, 4, 2 K + 3), have the nodes and the
    motions as columns; xi and eta are constant. ``T`` (q, 2, K): shape functions; other arguments:
    see ``integrate_facets``.
    """
    (N, dN), size = T.transpose(1, 2, 0), x.shape[1]
    tangent, at = np.einsum("kp,ekc->epc", dN, x), np.einsum("kp,ekc->epc", N, x)
    J = np.sqrt((tangent**2).sum(axis=2))
    W = rule[1] * J
    phi, gradient, _ = obstacle.evaluate(at.reshape(-1, 2))
    rows = np.zeros((*J.shape, 4, 2 * size + 3), np.result_type(x, phi))
    by_nodes = rows[..., :-3].reshape(*J.shape, 4, size, 2)
    V = obstacle.motions(at.reshape(-1, 2), arm).reshape(*J.shape, 3, 2)
    gradient = gradient.reshape(at.shape)
    dW = np.einsum("p,epc,kp->epkc", rule[1], tangent / J[:, :, None], dN)
    if thickness is not None:
        theta = thickness[0] @ N
        dW = dW * theta[:, :, None, None]
        dW[..., 0] += thickness[1] * W[:, :, None] * N.T
        W = W * theta
    by_nodes[:, :, 1] = dW
    by_nodes[:, :, 3] = np.einsum("epc,kp->epkc", gradient, N)
    rows[..., 3, -3:] = -np.einsum("epc,epmc->epm", gradient, V)
    values = np.stack([W, phi.reshape(J.shape)], axis=2).astype(rows.dtype)
    return values, rows


def points_of(x: Array, points: Array) -> Array:
    """Positions of points -1 ... 1, (q,), on facets ``x`` (f, K, 2): (f, q, 2) [length] (local)."""
    return np.einsum("kp,ekc->epc", shapes_at(points, x.shape[1])[0], x)


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
    (N, dN), (count, size, _), number = shapes_at(rule[0], x.shape[1]), x.shape, len(distances)
    values = np.zeros((count, rule[0].size, 2))
    values[..., 0] = rule[1] * np.linalg.norm(np.einsum("kp,ekc->epc", dN, x), axis=2)
    if thickness is not None:
        values[..., 0] *= thickness[0] @ N
    rows = np.zeros((count, rule[0].size, 4, number))
    rows[:, :, 3] = np.moveaxis(distances, 0, 2)
    T = np.ascontiguousarray(np.stack([N, dN]).transpose(2, 0, 1))
    D, g, d = np.zeros((count, size, size)), *np.zeros((2, count, size))
    dD, dg = np.empty((count, size**2, number)), np.empty((count, size, number))
    facets.integrate_whole_facets((values, rows, T), weights, options.kinds, (D, g, d), (dD, dg))
    return np.moveaxis(dg, 2, 0)


def shapes_at(points: Array, size: int) -> tuple[Array, Array]:
    """Shape functions of facets of ``size`` nodes and derivatives, each (size, points) [1]."""
    N, dN = lagrange(points, size - 1)
    return N.T, dN.T
