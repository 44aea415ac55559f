# SPDX-License-Identifier: MIT
"""Normals of an obstacle at the slave nodes, and the facets that face it; see ``on_obstacle``."""

from __future__ import annotations

import numpy as np

from fenics_mortar.interface.faces import CORNERS
from fenics_mortar.interface.obstacle_facets import points_of
from fenics_mortar.interface.segments import MortarOptions
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.obstacles.rotations import TURNS
from fenics_mortar.utils.arrays import Array, Flags


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
