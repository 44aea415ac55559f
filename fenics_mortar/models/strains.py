# SPDX-License-Identifier: MIT
"""Strains and rotations of a state in the plane or in space, from polar decompositions F = R U."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.ranks import largest_over_ranks


def largest_strain(problem: ContactProblem) -> tuple[float, float]:
    """Largest rotation [radian] and principal strain of F = R U, cell means (collective)."""
    bulk = problem.equations.bulk
    R, stretches = polar(bulk.cells.deformation_gradients(bulk.positions()))
    strains = np.abs(stretches - 1.0).max(axis=1)
    if bulk.space.is_axisymmetric:
        strains = np.maximum(strains, np.abs(bulk.cells.hoop_strains(bulk.positions())))
    mine = np.array([np.abs(values).max(initial=0.0) for values in (angles_of(R), strains)])
    rotation, strain = largest_over_ranks(problem.equations.comm, mine)
    return float(rotation), float(strain)


def strained(problem: ContactProblem, u: Array) -> Array:
    """Subtract from a displacement the closest rigid motion of each body (collective).

    Otherwise a finite rotation would contribute strain to the energy of a tangent. The only rigid
    motion of a body of revolution is along the axis, for which the tangent is exact.

    Args:
        problem: The problem with its bodies.
        u: Displacement, shape (owned dofs,) [length].

    Returns:
        The remainder, shape (owned dofs,) [length].
    """
    space, rest = problem.equations.bulk.space, u.copy()
    if space.is_axisymmetric:
        return rest
    comm, dim = problem.equations.comm, space.dim
    X = space.V.tabulate_dof_coordinates()[: space.num_nodes, :dim]
    labels = problem.equations.floating.labels[: space.num_nodes]
    x = X + u[space.owned_dofs]
    for label in range(comm.allreduce(int(labels.max(initial=0)), MPI.MAX) + 1):
        mine = labels == label
        sums = np.concatenate([[mine.sum()], X[mine].sum(axis=0), x[mine].sum(axis=0)])
        count, *means = comm.allreduce(sums)
        before, now = np.split(np.array(means) / max(count, 1), 2)
        dX, dx = X[mine] - before, x[mine] - now
        rotation, _ = polar(comm.allreduce(dx.T @ dX))
        rest[space.owned_dofs[mine]] = dx - dX @ rotation.T
    return rest


def polar(F: Array) -> tuple[Array, Array]:
    """The rotations R and principal stretches of F = R U (local).

    Args:
        F: Matrices, shape (..., d, d), in the plane or in space [any unit].

    Returns:
        R, shape (..., d, d) [1], a rotation for det F < 0, too: the last one of the stretches,
        shape (..., d) [unit of F], in descending order of their sizes, is then negative.
    """
    left, stretches, right = np.linalg.svd(F)
    sign = np.where(np.linalg.det(left @ right) < 0.0, -1.0, 1.0)
    left[..., -1] *= sign[..., None]
    stretches[..., -1] *= sign
    return left @ right, stretches


def angles_of(R: Array) -> Array:
    """Angles of rotations ``R`` (..., d, d) in the plane or in space, (...,) [radian] (local)."""
    dim = R.shape[-1]
    sine = np.linalg.norm(R - np.swapaxes(R, -1, -2), axis=(-2, -1)) / np.sqrt(8.0)
    return np.arctan2(sine, 0.5 * (np.trace(R, axis1=-2, axis2=-1) + 2.0 - dim))
