# SPDX-License-Identifier: MIT
"""Integrals over facets that face a rigid obstacle, and their derivatives; see ``on_obstacle``."""

from __future__ import annotations

import numpy as np

from fenics_mortar.interface.options import MortarOptions
from fenics_mortar.kernels.basis import BY_STANDARD, DUAL
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
    """Integrals over f whole facets of K nodes, with C = 6 K - 4 columns, see ``columns`` (local).

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
    (N, dN), (count, size, _) = shapes_at(rule[0], x.shape[1]), x.shape
    tangent, at = np.einsum("kp,ekc->epc", dN, x), np.einsum("kp,ekc->epc", N, x)
    J = np.sqrt((tangent**2).sum(axis=2))
    phi, gradient, _ = obstacle.evaluate(at.reshape(-1, 2))
    phi, gradient = phi.reshape(J.shape), gradient.reshape(at.shape)
    W = rule[1] * J
    dW = np.einsum("p,epc,kp->epkc", rule[1], tangent / J[:, :, None], dN)
    dW = dW.reshape(*J.shape, 2 * size)
    if thickness is not None:
        theta = thickness[0] @ N
        dW = dW * theta[:, :, None]
        dW[:, :, ::2] += thickness[1] * W[:, :, None] * N.T
        W = W * theta
    d, dd = np.einsum("ep,jp->ej", W, N), np.einsum("epq,jp->ejq", dW, N)
    mass = np.einsum("ep,jp,kp->ejk", W, N, N)
    dmass = np.einsum("epq,jp,kp->ejkq", dW, N, N)
    basis, gap_weights = options.kinds
    if basis == DUAL:
        inverse = np.linalg.inv(mass)
        A, D = d[:, :, None] * inverse, d[:, None, :] * weights
        dA = dd[:, :, None] * inverse[..., None]
        dA = dA - np.einsum("ejr,erlq,elk->ejkq", A, dmass, inverse)
        dD_own = weights[..., None] * dd[:, None]
    else:
        A, dA = np.broadcast_to(np.eye(size), mass.shape), np.zeros_like(dmass)
        D, dD_own = weights @ mass, np.einsum("ejl,elkq->ejkq", weights, dmass)
    if gap_weights == BY_STANDARD:
        A, dA = np.broadcast_to(np.eye(size), mass.shape), np.zeros_like(dmass)
    Psi = weights @ A @ N
    dPsi = np.einsum("ejl,elkq,kp->ejpq", weights, dA, N)
    g = np.einsum("ejp,ep,ep->ej", Psi, W, phi)
    own = slice(2 * (size - 1), 2 * (2 * size - 1))
    dD = np.zeros((count, size, size, 6 * size - 4), g.dtype)
    dg = np.zeros((count, size, 6 * size - 4), g.dtype)
    dD[..., own] = dD_own
    dg[..., own] = np.einsum("ejpq,ep,ep->ejq", dPsi, W, phi)
    dg[..., own] += np.einsum("ejp,epq,ep->ejq", Psi, dW, phi)
    along = np.einsum("ejp,ep,epc,kp->ejkc", Psi, W, gradient, N)
    dg[..., own] += along.reshape(count, size, 2 * size)
    V = obstacle.motions(at.reshape(-1, 2), arm).reshape(*J.shape, 3, 2)
    return D, dD, g, dg, -np.einsum("ejp,ep,epc,epmc->ejm", Psi, W, gradient, V), d


def gap_weights(
    x: Array,
    weights: Array,
    rule: tuple[Array, Array],
    options: MortarOptions,
    thickness: tuple[Array, float] | None = None,
) -> tuple[Array, Array]:
    """Weights of distances at q points of f facets in the weighted gaps (local).

    Args:
        x: See ``integrate_facets``.
        weights: See ``integrate_facets``.
        rule: See ``integrate_facets``.
        options: See ``integrate_facets``.
        thickness: See ``integrate_facets``.

    Returns:
        The points (f, q, 2) [length], and the weights (f, K, q) [length].
    """
    (N, dN), size = shapes_at(rule[0], x.shape[1]), x.shape[1]
    tangent, at = np.einsum("kp,ekc->epc", dN, x), np.einsum("kp,ekc->epc", N, x)
    W = rule[1] * np.sqrt((tangent**2).sum(axis=2))
    if thickness is not None:
        W = W * (thickness[0] @ N)
    A = np.broadcast_to(np.eye(size), (len(x), size, size))
    basis, by = options.kinds
    if basis == DUAL and by != BY_STANDARD:
        mass = np.einsum("ep,jp,kp->ejk", W, N, N)
        A = np.einsum("ep,jp->ej", W, N)[:, :, None] * np.linalg.inv(mass)
    return at, (weights @ A @ N) * W[:, None]


def shapes_at(points: Array, size: int) -> tuple[Array, Array]:
    """Shape functions of facets of ``size`` nodes and derivatives, each (size, points) [1]."""
    N, dN = lagrange(points, size - 1)
    return N.T, dN.T
