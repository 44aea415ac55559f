# SPDX-License-Identifier: MIT
"""Mortar operators of a slave surface on a rigid obstacle, with their derivatives.

The slave is integrated facet by facet, on Gauss points or nodes, with the multiplier functions of
fully covered facets and the out-of-plane thickness. For phi, V, arm, and the numbers d of
coordinates and m of motions see ``obstacles.obstacle``. In space integrals are over areas.
``facing_facets`` chooses the facets, ``obstacle_normals`` and ``integrate_facets`` evaluate them;
``evaluate_obstacle`` does all of it.

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
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from fenics_mortar.interface import reference
from fenics_mortar.interface.integrals import PlaneOperators, Segments, share_of, sum_over_facets
from fenics_mortar.interface.surfaces import outward_normals
from fenics_mortar.kernels import facets
from fenics_mortar.obstacles.rigid_motion import TURNS, by_further_motion, motion_between
from fenics_mortar.utils import errors, ranks

if TYPE_CHECKING:
    from fenics_mortar.interface.integrals import MortarInput
    from fenics_mortar.interface.mortar import MortarOptions
    from fenics_mortar.obstacles.obstacle import Obstacle
    from fenics_mortar.utils.arrays import Array, Flags, Indices


class OnFacets(NamedTuple):
    """Whole facets of K nodes, with q points of each, and the functions on them.

    Attributes:
        x: Current positions of the nodes, shape (f, K, dim) [length].
        functions: H, shape (f, K, K).
        T: Shape functions at the points and their derivatives, see ``tabulate``, (q, dim, K).
        weights: Weights of the points, shape (q,).
        kinds: Basis and weights of the gap, see ``MortarOptions``.
        thickness: Thickness at the nodes, shape (f, K) [length], and its derivative with respect to
            their first coordinate [1]; one by default.
    """

    x: Array
    functions: Array
    T: Array
    weights: Array
    kinds: tuple[int, int]
    thickness: tuple[Array, float] | None = None

    def integrate(self, values: Array, rows: Array) -> tuple[Array, ...]:
        """D, g, d, dD (f, K K, C) and dg (f, K, C), see ``integrate_facets`` (local).

        Args:
            values: W and g at the points, shape (f, q, 2).
            rows: Derivatives of xi, W, eta and g as of two surfaces, shape (f, q, 2 dim, C).
        """
        (count, size, _), kind, columns = self.x.shape, rows.dtype, rows.shape[3]
        D, g, d = np.zeros((count, size, size), kind), *np.zeros((2, count, size), kind)
        dD, dg = np.empty((count, size**2, columns), kind), np.empty((count, size, columns), kind)
        facets.integrate_whole_facets(
            (values, rows, self.T), self.functions, self.kinds, (D, g, d), (dD, dg)
        )
        return D, g, d, dD, dg


def on_facets(given: Any, x: Array, nodes: Indices, rule: tuple[Array, Array]) -> OnFacets:
    """Facets of a slave, with multipliers and options of a contact (local).

    Args:
        given: The contact, or a ``MortarInput``.
        x: Positions of the slave nodes, shape (slave nodes, dim) [length].
        nodes: Nodes of the facets, shape (f, K).
        rule: Points and weights, see ``facet_rule``.
    """
    slave, options, thickness = given.slave, given.options, None
    if slave.thickness is not None:
        thickness = slave.thickness.at(x)[nodes], slave.thickness.by_x
    functions = reference.hand_over(given.multiplier_nodes[nodes], slave.dim, options.basis)
    T = reference.tabulate(rule[0], nodes.shape[1])
    return OnFacets(x[nodes], functions, T, rule[1], options.kinds, thickness)


def integrate_facets(given: OnFacets, obstacle: Obstacle, arm: float) -> tuple[Array, ...]:
    """Integrals over f whole facets of K nodes, with C = dim K columns, its dofs (local).

    Args:
        given: The facets.
        obstacle: The other side.
        arm: Length by which angles are multiplied [length].

    Returns:
        D (f, K, K) [length], dD (f, K, K, C) [1], g (f, K) [length^2], dg (f, K, C) [length], dg by
        the m motions (f, K, m) [length], d (f, K) [length]; in space of areas instead of lengths.
    """
    count, size, dim = given.x.shape
    own = size * dim
    D, g, d, dD, dg = given.integrate(*_points(given, obstacle, arm))
    dD = dD[..., :own].reshape(count, size, size, own)
    return D, dD, g, np.ascontiguousarray(dg[..., :own]), dg[..., own:], d


def _points(given: OnFacets, obstacle: Obstacle, arm: float) -> tuple[Array, Array]:
    """W and g at points of facets, (f, q, 2), and derivatives (local).

    The latter, of xi, W, eta and g as of two surfaces, (f, q, s, dim K + m), have the nodes and the
    m motions as columns; xi and eta are constant. For the arguments see ``integrate_facets``.
    """
    x, _, T, weights, _, thickness = given
    N, size, dim = T[:, 0].T, x.shape[1], x.shape[2]
    at = np.einsum("kp,ekc->epc", N, x)
    J, slopes = measures(x, T)
    W = weights * J
    phi, gradient, _ = obstacle.evaluate(at.reshape(-1, dim))
    V = obstacle.motions(at.reshape(-1, dim), arm).reshape(*J.shape, obstacle.place.size, dim)
    rows = np.zeros((*J.shape, 2 * dim, dim * size + V.shape[2]), np.result_type(x, phi))
    by_nodes = rows[..., : dim * size].reshape(*J.shape, 2 * dim, size, dim)
    gradient = gradient.reshape(at.shape)
    dW = sum(np.einsum("p,epc,kp->epkc", weights, v, T[:, 1 + a].T) for a, v in enumerate(slopes))
    if thickness is not None:
        theta = thickness[0] @ N
        dW = dW * theta[:, :, None, None]
        dW[..., 0] += thickness[1] * W[:, :, None] * N.T
        W = W * theta
    by_nodes[:, :, dim - 1] = dW
    by_nodes[:, :, -1] = np.einsum("epc,kp->epkc", gradient, N)
    rows[..., -1, dim * size :] = -np.einsum("epc,epmc->epm", gradient, V)
    return np.stack([W, phi.reshape(J.shape)], axis=2).astype(rows.dtype), rows


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

    ``points``: as those of ``facet_rule``.
    """
    return np.einsum("kp,ekc->epc", reference.tabulate(points, x.shape[1])[:, 0].T, x)


def gaps_along(given: OnFacets, distances: Array) -> Array:
    """Change of the weighted gaps with the distances at q points of f facets (local).

    The directions are the columns of the points' derivatives.

    Args:
        given: The facets.
        distances: Changes of the distances in m directions, shape (m, f, q) [length].

    Returns:
        Shape (m, f, K) [length^2].
    """
    number, *shape = distances.shape
    values, rows = np.zeros((*shape, 2)), np.zeros((*shape, 2 * given.x.shape[2], number))
    values[..., 0] = given.weights * measures(given.x, given.T)[0]
    if given.thickness is not None:
        values[..., 0] *= given.thickness[0] @ given.T[:, 0].T
    rows[:, :, -1] = np.moveaxis(distances, 0, 2)
    return np.moveaxis(given.integrate(values, rows)[4], 2, 0)


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


@dataclass(frozen=True, kw_only=True)
class ObstacleOperators(PlaneOperators):
    """Operators of a slave surface and an obstacle: segments are facets, the master has no nodes.

    In space ``dn`` has the columns of the node itself alone.

    Attributes:
        obstacle: The obstacle, at the place of the evaluation.
        arm: Length by which angles are multiplied [length].
        phi: Signed distance of the slave nodes, shape (slave nodes,) [length].
        V: Motions at the slave nodes, shape (slave nodes, m, d).
        dn_dq: Derivative of the normals with respect to the motions, shape (slave nodes, d, m)
            [1 / length].
        dgap_dq: Derivative of the weighted gap with respect to the motions, shape (slave nodes, m)
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
        """Displacement dofs of the nodes of each facet, shape (f, d K)."""
        return np.asarray(self.slave.dofs_of(self.facet_nodes))

    def normal_columns(self) -> Indices:
        """Displacement dofs of the columns of ``dn``, shape (slave nodes, c)."""
        return super().normal_columns() if self.slave.dim == 2 else np.asarray(self.slave.dofs)

    def freeze(self) -> Self:
        """Copy with constant D and n; the gap keeps its derivative with respect to the motions."""
        return replace(super().freeze(), dn_dq=np.zeros_like(self.dn_dq))

    def after_small_motion(self, x: Array, m: Array, place: Array | None = None) -> Self:
        """Frozen operators after small motions of the nodes and of the obstacle (collective).

        Args:
            x: New positions of the slave nodes, shape (slave nodes, d) [length].
            m: Positions of master nodes, shape (0, d).
            place: Place of the obstacle of these operators, shape (m,) [length, radian]; that of
                the obstacle by default.
        """
        place = self.obstacle.place if place is None else place
        dq = motion_between(place, self.obstacle.place, self.arm)
        moved = super().after_small_motion(x, m)
        change = np.einsum("kmc,m->kc", self.V, dq) - (x - self.x)
        phi = self.phi + np.einsum("kc,kc->k", self.n, change)
        by_motion = by_further_motion(dq, self.arm)
        gap, dgap_dq = moved.gap + self.dgap_dq @ dq, self.dgap_dq @ by_motion
        return replace(moved, gap=gap, dgap_dq=dgap_dq, phi=phi)

    def motion_force(self, z: Array) -> Array:
        """f_q for multipliers ``z`` (slave nodes, d): shape (m,) [stress length] (collective)."""
        return -np.einsum("kc,kmc->m", self.force(z)[0], self.V)

    def motion_force_derivatives(self, z: Array) -> tuple[Array, Array, Array]:
        """Derivatives of f_q with respect to slave nodes, multipliers and q (collective).

        Args:
            z: Multipliers, shape (slave nodes, d) [stress].

        Returns:
            Arrays (m, slave nodes, d) [stress], (m, slave nodes, d) [length] and (m, m) [stress]. D
            depends on the nodes, V on nodes and motions.
        """
        nodes, (_, count, dim) = self.facet_nodes, self.V.shape
        sums = np.zeros((3, self.slave.num_nodes, count, dim))
        change = -np.einsum("ejkq,ejc,ekmc->emq", self.dD, z[nodes], self.V[nodes])
        change = np.swapaxes(change.reshape(len(nodes), count, nodes.shape[1], dim), 1, 2)
        np.add.at(sums[0], nodes, change)
        np.add.at(sums[1], nodes, -np.einsum("ejk,ekmc->ejmc", self.D, self.V[nodes]))
        np.add.at(sums[2, :, 0], nodes, np.einsum("ejk,ejc->ekc", self.D, z[nodes]))
        sums = ranks.sum_over_ranks(self.slave.comm, sums)
        by_nodes, by_multipliers, forces = sums[0], sums[1], sums[2, :, 0]
        turned = -np.einsum("iab,kb->kia", TURNS[dim], forces) / self.arm
        by_nodes[:, dim:] -= turned
        by_motions = np.zeros((count, count))
        by_motions[dim:, :dim] = turned.sum(axis=0)
        moves = 0.0 if self.linearization.frozen else 1.0
        E_d, M_q = np.swapaxes(by_nodes, 0, 1), np.swapaxes(by_multipliers, 0, 1)
        return moves * E_d, M_q, moves * by_motions

    def reaction(self, z: Array) -> tuple[Array, Array]:
        """Nearest points of the obstacle and forces there, each (slave nodes, d) (collective).

        Units [length] and [stress length].
        """
        return self.nearest_points(), -self.force(z)[0]

    def nearest_points(self) -> Array:
        """Points of the obstacle nearest to the slave nodes, shape (slave nodes, d) [length]."""
        return self.x + self.phi[:, None] * self.n

    def sample_gaps(self, x: Array, s: Any, points: Array) -> Array:
        """Signed distances at points of each facet of this share (collective).

        Args:
            x: Positions of the slave nodes, shape (slave nodes, d) [length].
            s: Segments, one per facet.
            points: Coordinates on the facets, -1 ... 1, shape (q,), in space (q, 2).

        Returns:
            phi, shape (f, q) [length].
        """
        at = points_of(x[s.slave], points)
        distance = f"the distance of '{self.obstacle.name}'"
        evaluate = partial(self.obstacle.evaluate, at.reshape(-1, at.shape[2]))
        return errors.call_together(self.slave.comm, distance, evaluate)[0].reshape(at.shape[:2])

    def smallest_gaps(self, offset: Array) -> tuple[Array, Array]:
        """Smallest distance of each facet in space at nodes and points, and its place (collective).

        Args:
            offset: Subtracted from the distances, shape (slave nodes,) [length].

        Returns:
            Distances (f,) and places on the slave (f, 3), both [length].
        """
        s, x = self.segments, self.x + offset[:, None] * self.n
        points = reference.sample_points(s.slave.shape[1])
        gaps = self.sample_gaps(x, s, points)
        deepest = np.arange(len(gaps)), gaps.argmin(axis=1)
        return gaps[deepest], points_of(x[s.slave], points)[deepest]


def evaluate_obstacle(given: MortarInput, obstacle: Obstacle, arm: float) -> ObstacleOperators:
    """Evaluate the operators of an obstacle at current positions (collective).

    Args:
        given: The slave, and a master without nodes.
        obstacle: The other side.
        arm: Length by which angles are multiplied [length].
    """
    slave, master, x, _, multiplier_nodes, planes, options, linearization, *_ = given
    distance = f"the distance of '{obstacle.name}'"  # each rank evaluates other points
    size, dim = slave.facets.shape[1], slave.dim
    rule = reference.facet_rule(options.integration, size, options.points, dim)

    def of_share():
        normals = obstacle_normals(obstacle, arm, x, slave.degree, None if dim == 2 else planes)
        facets = share_of(np.flatnonzero(multiplier_nodes[slave.facets].any(axis=1)), slave.comm)
        facets = facets[facing_facets(obstacle, x[slave.facets[facets]], rule[0], options)]
        nodes = slave.facets[facets]
        return normals, facets, integrate_facets(on_facets(given, x, nodes, rule), obstacle, arm)

    normals, facets, of_facets = errors.call_together(slave.comm, distance, of_share)
    phi, n, dn, dn_dq = normals
    if dim == 2:
        fixed = np.isfinite(planes[:, 0])
        n[fixed], dn[fixed], dn_dq[fixed] = planes[fixed], 0.0, 0.0
    if not linearization.normals:
        dn, dn_dq = np.zeros_like(dn), np.zeros_like(dn_dq)
    D, dD, gap, dgap, by_motions, cover = of_facets
    cover = cover if dim == 2 else reference.covers(cover)
    nodes, V = slave.facets[facets], obstacle.motions(x, arm)
    if linearization.frozen:
        by_motions = np.einsum("ejk,ejc,ekmc->ejm", D, n[nodes], V[nodes])
    sums = sum_over_facets(slave, nodes, D, gap, cover)
    if dim == 3 and options.basis in reference.COMBINED:  # see ``space_mortar``
        sums["diagonal"] = sums["weight"]
    dgap_dq = np.zeros(V.shape[:2])
    np.add.at(dgap_dq, nodes, by_motions)
    dgap_dq = ranks.sum_over_ranks(slave.comm, dgap_dq)
    count, size, columns = dgap.shape
    return ObstacleOperators(
        slave=slave, master=master, x=x, m=master.X, n=n, dn=dn,
        segments=_as_segments(facets, nodes, rule), D=D, M=np.zeros((count, size, 0)), dD=dD,
        dM=np.zeros((0, size, 0, columns)), dgap=dgap, **sums,
        num_segments=slave.comm.allreduce(count), linearization=linearization, obstacle=obstacle,
        arm=arm, phi=phi, V=V, dn_dq=dn_dq, dgap_dq=dgap_dq,
    )  # fmt: skip


def _as_segments(facets: Indices, nodes: Indices, rule: tuple[Array, Array]) -> Segments:
    """One segment per facet, which covers it entirely, without master nodes."""
    count, offsets = facets.size, np.arange(facets.size + 1)
    return Segments(
        facets=facets, partial=np.zeros(count, bool), offsets=offsets,
        pair_offsets=np.zeros(count + 1, np.int64), slave=nodes,
        master=np.empty((count, 0), np.int64), ends=np.tile([-1.0, 1.0], (count, 1)),
        end_is_fixed=np.ones((count, 2), bool), points=rule[0], weights=rule[1],
        spans=np.tile([0, rule[1].size], (count, 1)), pairs=np.empty((0, 2), np.int64),
    )  # fmt: skip
