# SPDX-License-Identifier: MIT
"""Mortar operators of a slave surface on a rigid obstacle, with their derivatives.

The slave is integrated facet by facet, on Gauss points or nodes, with the multiplier functions of
fully covered facets and the out-of-plane thickness. For phi, V, arm see ``obstacles.obstacle``.

==========  ==========================================================================
symbol      meaning
==========  ==========================================================================
Phi         C N with C = H diag(d) mass^-1 (dual) or H (standard), where d_j = int N_j,
            mass_jk = int N_j N_k and H adds functions without multiplier to neighbours
D[j, k]     int Phi_j N_k: H[j, k] d_k of dual functions
g[j]        int Phi_j phi: the weighted gap
n           -grad phi / |grad phi| at the slave node
f_q         -sum_k F_k . V(x_k): generalized force on the obstacle by the nodal forces
            F = D^T z; forces and moments balance exactly
==========  ==========================================================================
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Self

import numpy as np
import numpy.typing as npt

from fenics_mortar.interface.integrals import hand_over, share_of, sum_over_facets
from fenics_mortar.interface.mortar import Linearization, MortarOperators
from fenics_mortar.interface.obstacle_facets import integrate_facets, points_of
from fenics_mortar.interface.options import MortarOptions
from fenics_mortar.interface.segments import Segments, facet_rule
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.errors import call_together
from fenics_mortar.utils.ranks import sum_over_ranks


@dataclass(frozen=True)
class ObstacleOperators(MortarOperators):
    """Operators of a slave surface and an obstacle: segments are facets, the master has no nodes.

    Attributes:
        obstacle: The obstacle, at the place of the evaluation.
        arm: Length by which angles are multiplied [length].
        phi: Signed distance of the slave nodes, shape (slave nodes,) [length].
        V: Motions at the slave nodes, shape (slave nodes, 3, 2).
        dn_dq: Derivative of the normals with respect to the motions, shape (slave nodes, 2, 3)
            [1 / length].
        dgap_dq: Derivative of the weighted gap with respect to the motions, shape (slave nodes, 3)
            [length].
    """

    obstacle: Obstacle
    arm: float
    phi: Array
    V: Array
    dn_dq: Array
    dgap_dq: Array

    @cached_property
    def columns(self) -> Indices:
        """Displacement dofs of the nodes of each facet, shape (f, 2 K)."""
        return self.slave.dofs_of(self.facet_nodes)

    def freeze(self) -> Self:
        """Copy with constant D and n; the gap keeps its derivative with respect to the motions."""
        return replace(super().freeze(), dn_dq=np.zeros_like(self.dn_dq))

    def after_small_motion(self, x: Array, m: Array, dq: Array | None = None) -> Self:
        """Frozen operators after small motions of the nodes and of the obstacle (collective).

        Args:
            x: New positions of the slave nodes, shape (slave nodes, 2) [length].
            m: Positions of master nodes, shape (0, 2).
            dq: Change of the motions, shape (3,) [length].
        """
        dq = np.zeros(3) if dq is None else dq
        moved = super().after_small_motion(x, m)
        change = np.einsum("kmc,m->kc", self.V, dq) - (x - self.x)
        phi = self.phi + np.einsum("kc,kc->k", self.n, change)
        return replace(moved, gap=moved.gap + self.dgap_dq @ dq, phi=phi)

    def motion_force(self, z: Array) -> Array:
        """f_q for multipliers ``z`` (slave nodes, 2): shape (3,) [stress length] (collective)."""
        return -np.einsum("kc,kmc->m", self.force(z)[0], self.V)

    def motion_force_derivatives(self, z: Array) -> tuple[Array, Array, Array]:
        """Derivatives of f_q with respect to slave nodes, multipliers and q (collective).

        Args:
            z: Multipliers, shape (slave nodes, 2) [stress].

        Returns:
            Arrays (3, slave nodes, 2) [stress], (3, slave nodes, 2) [length] and (3, 3) [stress]. D
            depends on the nodes, V on nodes and motions.
        """
        nodes = self.facet_nodes
        sums = np.zeros((3, self.slave.num_nodes, 3, 2))
        change = -np.einsum("ejkq,ejc,ekmc->emq", self.dD, z[nodes], self.V[nodes])
        change = np.swapaxes(change.reshape(len(nodes), 3, nodes.shape[1], 2), 1, 2)
        np.add.at(sums[0], nodes, change)
        np.add.at(sums[1], nodes, -np.einsum("ejk,ekmc->ejmc", self.D, self.V[nodes]))
        np.add.at(sums[2, :, 0], nodes, np.einsum("ejk,ejc->ekc", self.D, z[nodes]))
        sums = sum_over_ranks(self.slave.comm, sums)
        by_nodes, by_multipliers, forces = sums[0], sums[1], sums[2, :, 0]
        turned = forces[:, ::-1] * [1.0, -1.0] / self.arm
        by_nodes[:, 2] -= turned
        by_motions = np.zeros((3, 3))
        by_motions[2, :2] = turned.sum(axis=0)
        moves = 0.0 if self.linearization.frozen else 1.0
        E_d, M_q = np.swapaxes(by_nodes, 0, 1), np.swapaxes(by_multipliers, 0, 1)
        return moves * E_d, M_q, moves * by_motions

    def reaction(self, z: Array) -> tuple[Array, Array]:
        """Nearest points of the obstacle and forces there, each (slave nodes, 2) (collective).

        Units [length] and [stress length].
        """
        return self.nearest_points(), -self.force(z)[0]

    def nearest_points(self) -> Array:
        """Points of the obstacle nearest to the slave nodes, shape (slave nodes, 2) [length]."""
        return self.x + self.phi[:, None] * self.n

    def sample_gaps(self, x: Array, s: Segments, points: Array) -> Array:
        """Signed distances at points of each facet of this share (collective).

        Args:
            x: Positions of the slave nodes, shape (slave nodes, 2) [length].
            s: Segments, one per facet.
            points: Coordinates on the facets, -1 ... 1, shape (q,).

        Returns:
            phi, shape (f, q) [length].
        """
        at = points_of(x[s.slave], points)
        distance = f"the distance of '{self.obstacle.name}'"
        evaluate = partial(self.obstacle.evaluate, at.reshape(-1, 2))
        return call_together(self.slave.comm, distance, evaluate)[0].reshape(at.shape[:2])


def surface_without_nodes(slave: Surface, name: str) -> Surface:
    """Master surface without nodes, for a pair with an obstacle (local)."""
    none, dofs, facets = np.empty(0, np.int64), np.empty((0, 2), np.int64), slave.facets[:0]
    nodes = none, none, none, none, none
    return Surface(name, slave.X[:0], facets, *nodes, dofs, dofs, slave.comm)


@clock("integrals")
def evaluate_obstacle(
    slave: Surface,
    master: Surface,
    obstacle: Obstacle,
    arm: float,
    x: Array,
    multiplier_nodes: npt.NDArray[np.bool_],
    prescribed_normals: Array,
    options: MortarOptions,
    linearization: Linearization,
) -> ObstacleOperators:
    """Evaluate the operators of an obstacle at current positions (collective).

    Args:
        slave: The side that carries the multiplier.
        master: Surface without nodes.
        obstacle: The other side.
        arm: Length by which angles are multiplied [length].
        x: Current positions of the slave nodes, shape (slave nodes, 2) [length].
        multiplier_nodes: Whether a slave node carries a multiplier, shape (slave nodes,), bool.
        prescribed_normals: Normals that replace the obstacle's, shape (slave nodes, 2); nan where
            none is prescribed.
        options: Discretization.
        linearization: Derivatives to evaluate; the others are zero.

    Returns:
        The operators.
    """
    distance = f"the distance of '{obstacle.name}'"  # each rank evaluates other points
    rule = facet_rule(options.integration, slave.degree + 1, options.points)

    def of_share():
        normals = obstacle_normals(obstacle, arm, x, slave.degree)
        facets = share_of(np.flatnonzero(multiplier_nodes[slave.facets].any(axis=1)), slave.comm)
        facets = facets[_faces(obstacle, x[slave.facets[facets]], rule[0], options)]
        nodes = slave.facets[facets]
        weights = hand_over(multiplier_nodes[nodes])
        thickness = facet_thickness(slave, x, nodes)
        of_facets = integrate_facets(obstacle, arm, x[nodes], weights, rule, options, thickness)
        return normals, facets, of_facets

    normals, facets, integrals = call_together(slave.comm, distance, of_share)
    phi, n, dn, dn_dq = normals
    given = np.isfinite(prescribed_normals[:, 0])
    n[given], dn[given], dn_dq[given] = prescribed_normals[given], 0.0, 0.0
    if not linearization.normals:
        dn, dn_dq = np.zeros_like(dn), np.zeros_like(dn_dq)
    D, dD, gap, dgap, by_motions, cover = integrals
    nodes, V = slave.facets[facets], obstacle.motions(x, arm)
    if linearization.frozen:
        by_motions = np.einsum("ejk,ejc,ekmc->ejm", D, n[nodes], V[nodes])
    nodal = sum_over_facets(slave, nodes, D, gap, cover)
    dgap_dq = np.zeros((len(x), 3))
    np.add.at(dgap_dq, nodes, by_motions)
    dgap_dq = sum_over_ranks(slave.comm, dgap_dq)
    count, size, columns = dgap.shape
    return ObstacleOperators(
        slave, master, x, master.X, n, dn, _as_segments(facets, nodes, rule), D,
        np.zeros((count, size, 0)), dD, np.zeros((0, size, 0, columns)), dgap, *nodal,
        slave.comm.allreduce(count), linearization, obstacle, arm, phi, V, dn_dq, dgap_dq,
    )  # fmt: skip


def obstacle_normals(
    obstacle: Obstacle, arm: float, x: Array, degree: int
) -> tuple[Array, Array, Array, Array]:
    """Signed distance and normals of the slave nodes, with derivatives of the normals (local).

    Args:
        obstacle: The obstacle.
        arm: Length by which angles are multiplied [length].
        x: Current positions of the slave nodes, shape (n, 2) [length].
        degree: Degree of the facets.

    Returns:
        phi (n,) [length], normals (n, 2), and their derivatives with respect to nodes,
        (n, 2, 4 degree + 2), as ``MortarOperators.dn``, and by motions, (n, 2, 3), both
        [1 / length].
    """
    phi, gradient, hessian = obstacle.evaluate(x)
    size = np.sqrt((gradient**2).sum(axis=1))[:, None]
    n = -gradient / size
    across = (np.eye(2) - np.einsum("ja,jb->jab", n, n)) / size[:, :, None]
    change = -hessian @ np.swapaxes(obstacle.motions(x, arm), 1, 2)
    change[:, 0, 2] -= gradient[:, 1] / arm
    change[:, 1, 2] += gradient[:, 0] / arm
    dn = np.zeros((len(x), 2, 4 * degree + 2), n.dtype)
    dn[:, :, 2 * degree : 2 * degree + 2] = -across @ hessian
    return phi, n, dn, -across @ change


def _faces(
    obstacle: Obstacle, x: Array, points: Array, options: MortarOptions
) -> npt.NDArray[np.bool_]:
    """Whether facets at ``x`` (f, K, 2) face the obstacle within the search radius, (f,)."""
    at = points_of(x, points)
    phi, gradient, _ = obstacle.evaluate(at.reshape(-1, 2))
    near = np.abs(phi).reshape(at.shape[:2]).min(axis=1, initial=np.inf) <= options.radius
    chord, towards = x[:, -1] - x[:, 0], -gradient.reshape(at.shape).sum(axis=1)
    normal = np.stack([chord[:, 1], -chord[:, 0]], axis=1)
    sizes = np.linalg.norm(normal, axis=1) * np.linalg.norm(towards, axis=1)
    return near & ((normal * towards).sum(axis=1) >= options.min_cosine * sizes)


def facet_thickness(slave: Surface, x: Array, nodes: Indices) -> tuple[Array, float] | None:
    """Thickness at ``nodes`` (f, K) [length], and its derivative [1]; ``None`` without one."""
    if slave.thickness is None:
        return None
    return slave.thickness.at(x)[nodes], slave.thickness.by_x


def _as_segments(facets: Indices, nodes: Indices, rule: tuple[Array, Array]) -> Segments:
    """One segment per facet, which covers it entirely, without master nodes."""
    count, offsets = facets.size, np.arange(facets.size + 1)
    return Segments(
        facets=facets,
        partial=np.zeros(count, bool),
        offsets=offsets,
        pair_offsets=np.zeros(count + 1, np.int64),
        slave=nodes,
        master=np.empty((count, 0), np.int64),
        ends=np.tile([-1.0, 1.0], (count, 1)),
        end_is_fixed=np.ones((count, 2), bool),
        points=rule[0],
        weights=rule[1],
        spans=np.tile([0, rule[0].size], (count, 1)),
        pairs=np.empty((0, 2), np.int64),
    )
