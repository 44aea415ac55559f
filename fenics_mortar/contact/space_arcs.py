# SPDX-License-Identifier: MIT
"""Slip of a step in space as the length of the way along the surface, with rotations of any size.

The counterpart of ``arcs``. In a step the material of the slave at a node turns by Q, that of the
master by R, both found from the motion of the nodes around it, see ``Material``. Slip is measured
in the frame of the slave's material and stated in that of the end of the step, so that the
direction of friction turns with the slave.

**Two surfaces.** Let r be the vector from the material points of the master that the node faced to
the node, r_0 that at the start. The relative motion is the screw motion of constant velocity that
leads from start to end: with the relative rotation L of Q^T R = exp(L),

    u = Q J(-L)^-1 (R^T r - r_0),    J(L) = int_0^1 exp(t L) dt.

It vanishes for any motion of the two bodies together, and is exact where either side turns about
any axis at a constant rate. Of L only the ends of the step are known: |L| < pi.

**Obstacles.** The rotation w of an obstacle is known whatever its size, and r leads from its pivot,
r_0 to the point that the node faced. With the velocity of the node past the pivot constant in the
frame of the slave, and with exp(f) = Q,

    u = r - Q r_0 - (l x r + Q (l x r_0)) / 2,    l = w - f.

A body that turns along with an obstacle by more than half a turn has the same Q: there f is the
vector of Q that is next to w, see ``rotation_past_obstacle`` in ``arcs``.

Derivatives are those by spins a: dQ = a x Q, exp(L) has dL = J(L)^-1 a, and the polar rotation of
A = P Q = sum_k x_k d_k^T has (tr P - P) a = sum_k (Q d_k) x dx_k.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from fenics_mortar.contact.arcs import TILTED
from fenics_mortar.interface.integrals import share_of
from fenics_mortar.interface.mortar import Block
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.obstacles.rotations import (
    crosses,
    inverse_factors,
    inverse_jacobians,
)
from fenics_mortar.utils.arrays import Array, Flags, Indices, norms
from fenics_mortar.utils.rounding import TINY


class Turned(NamedTuple):
    """Rotations of the material at nodes in a step, and their derivatives.

    Attributes:
        Q: Rotations, shape (n, 3, 3) [1].
        stiff: Inverse of tr P - P, shape (n, 3, 3) [1 / length^2].
    """

    Q: Array
    stiff: Array

    def by_products(self, along: Array) -> Array:
        """Derivative of along . a by A, with the spins a, (n, 3, 3) [1 / length^2] (local).

        Args:
            along: Vectors, shape (n, 3) [1].
        """
        return np.asarray(crosses(_times(self.stiff, along)) @ self.Q)


class Material:
    """Nodes around material points of a surface, and the rotations that these show (local).

    On a symmetry plane the nodes around a node are half of those of the whole body; their mirror
    images remove the products x_a d_b of components across and along the plane. Nodes on the plane
    have no image, and count half.

    Args:
        weights: Weights of the nodes of the surface at n material points, (n, nodes) [1].
        surface: The surface.
        x_0: Positions of its nodes at the start of the step, shape (nodes, 3) [length].
        mirrored: Components of a node across symmetry planes, shape (nodes, 3), bool.

    Attributes:
        surface: The surface.
    """

    def __init__(self, weights: csr_array, surface: Surface, x_0: Array, mirrored: Flags) -> None:
        self.surface, self._count = surface, weights.shape[0]
        self._of_spokes = weights, surface, mirrored
        j, l, k, size, kept = self.spokes
        spokes = (size[:, None] * (x_0[k] - x_0[l]))[:, None] * kept
        pairs = np.concatenate([j, j]) * surface.num_nodes + np.concatenate([k, l])
        pairs, number = np.unique(pairs, return_inverse=True)
        both = np.concatenate([spokes, -spokes]).reshape(len(number), 3 * spokes.shape[1])
        sums = [np.bincount(number.ravel(), c, pairs.size) for c in both.T]
        self.pairs: tuple[Indices, Indices] = np.divmod(pairs, surface.num_nodes)
        self._spokes: Array = np.stack(sums, axis=1).astype(float).reshape(-1, *spokes.shape[1:])

    @property
    def spokes(self) -> Spokes:
        """The nodes around each node, for all material points."""
        return spokes_of(*self._of_spokes)

    def turned(self, x: Array) -> Turned:
        """Rotations from ``x_0`` to the positions ``x`` (nodes, 3) [length]."""
        j, k = self.pairs
        products = (x[k][:, :, None] * self._spokes).reshape(-1, 9)
        sums = [np.bincount(j, c, self._count) for c in products.T]
        A = np.stack(sums, axis=1).reshape(-1, 3, 3).astype(float)
        left, _, right = np.linalg.svd(A)
        left[:, :, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
        Q = left @ right
        P = A @ Q.swapaxes(1, 2)
        trace = np.trace(P, axis1=1, axis2=2)
        none = trace <= TINY  # no weights
        Q[none], P[none] = np.eye(3), np.eye(3)
        inner = np.where(none, 3.0, trace)[:, None, None] * np.eye(3) - P
        return Turned(Q, np.linalg.inv(inner))

    def rows(self, at: Turned, along: Array) -> Block:
        """Block of along_j . a_j of this rank, with the spins a of ``at``, for ``along`` (n, 3)."""
        mine = share_of(np.arange(len(self._spokes)), self.surface.comm)
        j, k = self.pairs[0][mine], self.pairs[1][mine]
        values = (at.by_products(along)[j] * self._spokes[mine]).sum(axis=2)
        return Block(j[:, None], self.surface.dofs[k], values[:, None])


class Spokes(NamedTuple):
    """Nodes around the nodes at material points: each spoke adds size dx dx_0^T kept to A.

    Attributes:
        point, node, end: Material point, node, and the node beside it, shape (s,) each.
        size: Size of the node's weight, shape (s,) [1].
        kept: Factors of the products of components, shape (s, 3, 3) or (1, 1, 1) [1].
    """

    point: Indices
    node: Indices
    end: Indices
    size: Array
    kept: Array


def spokes_of(weights: csr_array, surface: Surface, mirrored: Flags) -> Spokes:
    """The spokes at material points (local); arguments as of ``Material``."""
    each = weights.tocoo()
    ring = surface.stencil[each.col]
    point, near = np.nonzero(ring >= 0)
    l, k, kept = each.col[point], ring[point, near], np.ones((1, 1, 1))
    if mirrored.any():
        both = ~(mirrored[:, :, None] | mirrored[:, None]) | np.eye(3, dtype=bool)
        alone = (mirrored[l] & mirrored[k]).sum(axis=1)  # planes that hold both nodes
        kept = both[l] * 0.5 ** alone[:, None, None]
    return Spokes(each.row[point], l, k, np.abs(each.data[point]), kept)


class Screw(NamedTuple):
    """Slip between two surfaces in a step, see above; n nodes.

    Attributes:
        slip: u, shape (n, 3) [length].
        doubt: Angle of the relative rotation, shape (n,) [radian].
        slave, master: Rotations of both materials.
        by_vector: du/dr, shape (n, 3, 3) [1].
        by_relative: Derivative by the spin of the master past the slave, (n, 3, 3) [length].
        vector: r, shape (n, 3) [length].
    """

    slip: Array
    doubt: Array
    slave: Turned
    master: Turned
    by_vector: Array
    by_relative: Array
    vector: Array

    def weights(self, along: Array) -> tuple[Array, Array, Array]:
        """Factors of dr and of spins of slave and master in along . du, (n, 3) [1, length]."""
        by_r, by_spin = (_times(each.swapaxes(1, 2), along) for each in self[4:6])
        return by_r, np.cross(self.slip, along) - by_spin, by_spin - np.cross(self.vector, by_r)


def screw(r: Array, r_0: Array, slave: Turned, master: Turned) -> Screw:
    """Slip between two surfaces (local).

    Args:
        r: Vectors from the partners to the nodes, shape (n, 3) [length].
        r_0: Those at the start of the step.
        slave: Rotation of the slave's material.
        master: Rotation of the master's material.
    """
    back, ahead = slave.Q.swapaxes(1, 2), master.Q.swapaxes(1, 2)
    L, angle = vectors_of(back @ master.Q)
    v = _times(ahead, r) - r_0
    C, by_L = inverse_jacobians(-L), _by_vector(L, v)
    by_relative = slave.Q @ by_L @ inverse_jacobians(L) @ back
    return Screw(_times(slave.Q @ C, v), angle, slave, master, slave.Q @ C @ ahead, by_relative, r)


class PastObstacle(NamedTuple):
    """Slip past an obstacle in a step, see above; n nodes.

    Attributes:
        slip, slave: See ``Screw``.
        doubt: Size above which the direction of the relative rotation is uncertain, (n,) [radian].
        by_vector: du/dr, shape (n, 3, 3) [1].
        by_start: du by the spin of Q at constant l, shape (n, 3, 3) [length].
        by_relative: du/dl, shape (n, 3, 3) [length].
        by_spin: dl by the spin of Q, shape (n, 3, 3) [1].
    """

    slip: Array
    doubt: Array
    slave: Turned
    by_vector: Array
    by_start: Array
    by_relative: Array
    by_spin: Array

    def weights(self, along: Array) -> tuple[Array, Array]:
        """Factors of dr and of the spin of the slave in along . du, (n, 3) [1, length]."""
        by_spin = self.by_start + self.by_relative @ self.by_spin
        by_r, of_slave = (_times(a.swapaxes(1, 2), along) for a in (self.by_vector, by_spin))
        return by_r, of_slave


def past_obstacle(r: Array, r_0: Array, slave: Turned, w: Array) -> PastObstacle:
    """Slip past an obstacle (local).

    Args:
        r: Vectors from the pivot to the nodes, shape (n, 3) [length].
        r_0: Those at the start of the step to the points faced.
        slave: Rotation of the slave's material.
        w: Rotation vector of the obstacle in the step, of any size, shape (3,) [radian].
    """
    f, doubt = _beside(w, *vectors_of(slave.Q))
    l = w - f
    turned = np.cross(l, r_0)
    start = _times(slave.Q, r_0 + 0.5 * turned)
    slip = r - 0.5 * np.cross(l, r) - start
    by_relative = 0.5 * (crosses(r) + slave.Q @ crosses(r_0))
    by_vector = np.eye(3) - 0.5 * crosses(l)
    return PastObstacle(
        slip, doubt, slave, by_vector, crosses(start), by_relative, -inverse_jacobians(f)
    )


def _beside(w: Array, f: Array, angle: Array) -> tuple[Array, Array]:
    """Rotation vectors of the slave for a rotation w of an obstacle, and ``doubt``.

    Args:
        w: Rotation vector of the obstacle, shape (3,) [radian].
        f: Rotation vectors of the slave, less than half a turn, shape (n, 3) [radian].
        angle: Their sizes, shape (n,) [radian].
    """
    axis = f / np.maximum(angle, TINY)[:, None]
    full = 2.0 * np.pi * np.round((axis @ w - angle) / (2.0 * np.pi))
    other = f + full[:, None] * axis
    nearest = norms(w - other)
    rides = (angle > TILTED) & (nearest < 0.5 * angle)
    doubt = np.where(full == 0.0, 1.0, 2.0) * np.minimum(angle, nearest)
    return np.where(rides[:, None], other, f), doubt


def vectors_of(R: Array) -> tuple[Array, Array]:
    """Rotation vectors (n, 3) and angles (n,) of rotations (n, 3, 3) [radian] (local).

    Close to half a turn the vectors are inaccurate, the angles are not.
    """
    axial = 0.5 * np.stack(
        [R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1
    )
    angle = np.arctan2(norms(axial), 0.5 * (np.trace(R, axis1=1, axis2=2) - 1.0))
    return np.asarray(axial / np.maximum(np.sinc(angle / np.pi), TINY)[:, None]), angle


def _by_vector(L: Array, v: Array) -> Array:
    """Derivative of J(-L)^-1 v by L, shape (n, 3, 3), for vectors (n, 3) each."""
    b, slope = inverse_factors(L)
    twice = np.cross(L, np.cross(L, v))
    along = (L * v).sum(axis=1)[:, None, None] * np.eye(3)
    quadratic = along + L[:, :, None] * v[:, None] - 2.0 * v[:, :, None] * L[:, None]
    change = slope[:, None, None] * (twice[:, :, None] * L[:, None])
    return -0.5 * crosses(v) + b[:, None, None] * quadratic + change


def _times(matrices: Array, vectors: Array) -> Array:
    """Products of matrices (n, 3, 3) and vectors (n, 3), shape (n, 3)."""
    return np.einsum("nab,nb->na", matrices, vectors)
