# SPDX-License-Identifier: MIT
"""Slip in a step as the length of the way along the surface, with rotations of any size.

``arc`` computes it in the plane, ``screw`` and ``past_obstacle`` in space. If a node comes into
contact in a step in which its body turns, the first part of the way is that of rigid motions of the
bodies, see ``Led``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from fenics_mortar.interface.integrals import evaluate_normals, share_of
from fenics_mortar.interface.mortar import Block, MortarOperators
from fenics_mortar.obstacles.rigid_motion import (
    TURNS,
    RigidMotion,
    crosses,
    inverse_factors,
    inverse_jacobians,
    polar,
    rotation_by,
)
from fenics_mortar.utils.arrays import ROUNDING, TINY, angles_between, cross_in_plane, norms

if TYPE_CHECKING:
    from fenics_mortar.interface.curve_surface import Curve
    from fenics_mortar.interface.surfaces import Surface
    from fenics_mortar.utils.arrays import Array, Flags, Indices

# Largest relative rotation of two bodies in a step [radian]: 135 degrees. Their positions are also
# those after a rotation in the other direction, of 225 degrees, which is no longer much larger.
MAX_ROTATION = 0.75 * np.pi
# Rotation of a surface in a step [radian], 20 degrees, up to which a body does not turn along
# with an obstacle that turns by more than half a turn: supported bodies tilt by less.
TILTED = np.pi / 9.0


class Arc(NamedTuple):
    """Slip of a step in the plane without the slip counted before, and its derivatives.

    At a slave node with the contact normal n and tangent tau, let r be the vector from a material
    point of the master to the node. If psi is the angle of the normal and phi that of the master's
    material, the rate of slip is, for any such point and any motion,

        u' = tau . r' - phi' n . r = (tau . r)' - (phi' - psi') n . r.

    The first form is tau times the velocity of the node relative to the material of the master at
    the same place. Of a step only both ends are known. The normal turns with the slave's material.
    With a constant rate of rotation, and a constant relative velocity r' in a frame in which the
    normal rotates by beta in the step, the integral is

        u = (1 + theta kappa) [tau . r] - theta (n . r + n_0 . r_0) / 2,
        kappa = (1 - h cot h) / (2 h),    h = beta / 2,

    with the change [tau . r] and the relative rotation theta = [phi] - [psi]. It vanishes for any
    rotation of the two bodies together, is exact for motions of a constant rate, and otherwise of
    second order in the step.

    Where contact transfers forces, its gap g along n is closed, or will be by the solution. So r
    ends at the master, n . r + g replaces n . r, unless a law acts at open gaps. Otherwise a gap of
    many facets couples the slip to the rotations of single facets within Newton's method: O-rings
    that a lid releases took two to seven times as many iterations.

    ============  ======================  ===================  =====================================
    master        r from                  r' is constant in    exact
    ============  ======================  ===================  =====================================
    an obstacle   its pivot, which may    space, beta = [psi]  translation; a wheel that turns in
                  lie anywhere                                 place, rolls on the slave, or is the
                                                               slave; a slide along an arc
    a surface     the partner, see        the master's frame,  translation; either side turns about
                  ``slip``                beta = -theta        any point, as a shaft in a ring
    ============  ======================  ===================  =====================================

    Angles of surfaces are those of their averaged normals at the material points, known up to full
    turns only; the angle of an obstacle is known. See ``Rotations``.

    Attributes:
        slip: u, shape (slave nodes,) [length].
        by_vector: du/dr, shape (slave nodes, 2) [1].
        by_start: du/dr_0, shape (slave nodes, 2) [1].
        by_normal: Derivative with respect to a rotation of n, shape (slave nodes,) [length].
        by_start_normal: Derivative with respect to a rotation of n_0, likewise.
        by_rotation: Derivative with respect to theta at constant beta, likewise.
        by_swept: Derivative with respect to beta, likewise.
        by_gap: Derivative with respect to the gap g, shape (slave nodes,) [1].
    """

    slip: Array
    by_vector: Array
    by_start: Array
    by_normal: Array
    by_start_normal: Array
    by_rotation: Array
    by_swept: Array
    by_gap: Array

    @property
    def by_angle(self) -> Array:
        """Derivative with respect to ``Orientation.angle``, (slave nodes,) [length]."""
        return self.by_rotation - self.by_swept

    @property
    def by_body(self) -> Array:
        """Derivative with respect to the rotation of a slave past an obstacle, (n,) [length]."""
        return self.by_swept - self.by_rotation - self.by_start_normal


def arc(
    now: tuple[Array, Array], start: tuple[Array, Array], theta: Array, beta: Array,
    gap: Array | float = 0.0,
) -> Arc:  # fmt: skip
    """Slip of a step in the plane, see ``Arc`` (local).

    Args:
        now: Vectors r and normals n at the end of the step, shape (..., 2) [length, 1].
        start: r_0 and n_0, those at its start.
        theta: Rotation of the master minus that of the normal, shape (...) [radian].
        beta: Rotation of the normal in the frame of constant velocity, likewise.
        gap: Gap g that contact closes, zero where a law acts at open gaps, likewise [length].
    """
    (r, n), (r_0, n_0) = now, start
    along, along_0 = cross_in_plane(n, r), cross_in_plane(n_0, r_0)
    across, across_0 = (n * r).sum(axis=-1), (n_0 * r_0).sum(axis=-1)
    moved, mean = along - along_0, 0.5 * (across + gap + across_0)
    b, slope = (each.reshape(beta.shape) for each in inverse_factors(beta.reshape(-1, 1)))
    factor, half = 1.0 + theta * b * beta, 0.5 * theta  # kappa = b beta
    return Arc(
        slip=factor * moved - theta * mean,
        by_vector=factor[..., None] * quarter_turn(n) - half[..., None] * n,
        by_start=-factor[..., None] * quarter_turn(n_0) - half[..., None] * n_0,
        by_normal=-factor * across - half * along,
        by_start_normal=factor * across_0 - half * along_0,
        by_rotation=b * beta * moved - mean,
        by_swept=theta * (b + slope * beta**2) * moved,
        by_gap=-half,
    )


class Orientation(NamedTuple):
    """Angle of the master's material at the partners relative to the slave's.

    Attributes:
        angle: Of the normal at the partners relative to that of the node, (slave nodes,) [radian].
        partners: Weighted sums of the master's normals, shape (slave nodes, 2).
        slave, d_slave: Averaged normals of the slave nodes, shape (slave nodes, 2), and their
            derivatives, see ``evaluate_normals``.
        master, d_master: Those of the master nodes.
    """

    angle: Array
    partners: Array
    slave: Array
    d_slave: Array
    master: Array
    d_master: Array

    @property
    def by_partners(self) -> Array:
        """Derivative of the angle with respect to ``partners``, (slave nodes, 2) [radian]."""
        square = (self.partners**2).sum(axis=1)[:, None]
        return quarter_turn(self.partners) / np.where(square > 0.0, square, 1.0)


def orientation(o: MortarOperators, M: csr_array, planes: Array) -> Orientation:
    """Angle between the materials of both surfaces at the positions of ``o`` (local).

    Normals are averaged over all facets of the surfaces, whatever the normals of contact are: only
    their rotations are used.

    Args:
        o: Operators.
        M: Weights of the partners, shape (slave nodes, master nodes) [1].
        planes: Normals of master nodes on symmetry planes, nan elsewhere, (master nodes, 2).
    """
    s, ds = evaluate_normals(o.slave, o.x, "opposite")
    n, dn = evaluate_normals(o.master, o.m, "opposite", planes=planes)
    v = np.asarray(M @ n)
    return Orientation(angles_between(s, v), v, s, ds, n, dn)


class Rotations(NamedTuple):
    """Rotations in a step at the slave nodes, arrays (slave nodes,) [radian].

    Attributes:
        theta, beta: Those of ``arc``.
        doubt: Size above which the direction of the relative rotation is uncertain, compared with
            ``MAX_ROTATION``.
    """

    theta: Array
    beta: Array
    doubt: Array


def rotation_of_surfaces(now: Array, before: Array) -> Rotations:
    """Relative rotation between two results of ``Orientation.angle``: at most half a turn."""
    theta = now - before
    theta = theta - 2.0 * np.pi * np.round(theta / (2.0 * np.pi))
    return Rotations(theta, -theta, np.abs(theta))


def rotation_past_obstacle(body: Array, angle: float) -> Rotations:
    """Rotation of an obstacle relative to the slave's material, and that of the material.

    Args:
        body: Rotations of the averaged normals, -pi ... pi, shape (slave nodes,) [radian].
        angle: Rotation of the obstacle in the step, of any size [radian].
    """
    f, doubt = _beside(np.full((body.size, 1), angle), body[:, None], np.abs(body))
    return Rotations(angle - f[:, 0], body, doubt)


def doubt_beside_known(relative: Array, apart: Array, kept: Flags) -> Array:
    """Doubt about a relative rotation beside a body whose turn is known, (n,) [radian].

    The other body is at rest or turns by less than half a turn, unless it turns along as in
    ``_beside``: then nodes remain in contact, but those of rollers do not.

    Args:
        relative: Sizes of the relative rotations, at most half a turn, shape (n,) [radian].
        apart: Their distances from the rotations that are known, shape (n,) [radian].
        kept: Nodes with pressure at both ends of the step, shape (n,), bool.
    """
    rides = (apart > TILTED) & (apart < np.pi) & (relative < 0.5 * apart)
    along = (rides & kept).any() & (kept | (relative < TILTED))
    return np.where(rides & along, relative, apart)


def surface_rotation(surface: Curve, x_0: Array, x: Array) -> Array:
    """Rotations of the averaged normals of nodes moved from ``x_0`` to ``x``, (n,) [radian]."""
    ends = (evaluate_normals(surface, positions, "opposite")[0] for positions in (x_0, x))
    return angles_between(*ends)


def rotated_by(v: Array, angle: Array) -> Array:
    """Vectors (..., 2) rotated counter-clockwise by angles (...) [radian] [their unit]."""
    return np.cos(angle)[..., None] * v + np.sin(angle)[..., None] * quarter_turn(v)


def quarter_turn(v: Array) -> Array:
    """Vectors (..., 2) rotated by a quarter of a turn counter-clockwise [their unit]."""
    return np.stack([-v[..., 1], v[..., 0]], axis=-1)


class Turned(NamedTuple):
    """Rotations of the material at nodes in a step, and their derivatives.

    In a step the material of the slave at a node turns by Q, that of the master by R, both found
    from the motion of the nodes around it, see ``Material``. Slip in space is measured in the frame
    of the slave's material and stated in that of the end of the step, so that the direction of
    friction turns with the slave.

    Derivatives are those by spins a: dQ = a x Q, exp(L) has dL = J(L)^-1 a, and the polar rotation
    of A = P Q = sum_k x_k d_k^T has (tr P - P) a = sum_k (Q d_k) x dx_k.

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
        return np.asarray(crosses(times(self.stiff, along)) @ self.Q)


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
        led: Points (n,), bool, and positions (nodes, 3) [length] to start from there instead.

    Attributes:
        surface: The surface.
    """

    def __init__(
        self, weights: csr_array, surface: Surface, x_0: Array, mirrored: Flags,
        led: tuple[Flags, Array] | None = None,
    ) -> None:  # fmt: skip
        self.surface, self._count = surface, weights.shape[0]
        self._weights, self._mirrored = weights, mirrored
        each, kept = weights.tocoo(), np.ones((1, 1, 1))
        ring = surface.stencil[each.col]
        entry, near = np.nonzero(ring >= 0)  # spokes of the node l at the point j to k beside it
        j, l, k = each.row[entry], each.col[entry], ring[entry, near]
        size = np.abs(each.data[entry])
        if mirrored.any():
            both = ~(mirrored[:, :, None] | mirrored[:, None]) | np.eye(3, dtype=bool)
            alone = (mirrored[l] & mirrored[k]).sum(axis=1)  # planes that hold both nodes
            kept = both[l] * 0.5 ** alone[:, None, None]
        start = x_0[k] - x_0[l]
        if led is not None:
            start = np.where(led[0][j][:, None], led[1][k] - led[1][l], start)
        spokes = (size[:, None] * start)[:, None] * kept
        pairs = np.concatenate([j, j]) * surface.num_nodes + np.concatenate([k, l])
        pairs, number = np.unique(pairs, return_inverse=True)
        both = np.concatenate([spokes, -spokes]).reshape(len(number), 3 * spokes.shape[1])
        sums = [np.bincount(number.ravel(), c, pairs.size) for c in both.T]
        self.pairs: tuple[Indices, Indices] = np.divmod(pairs, surface.num_nodes)
        self._spokes: Array = np.stack(sums, axis=1).astype(float).reshape(-1, *spokes.shape[1:])

    def starting_at(self, x: Array) -> Material:
        """The same nodes around the same points, with ``x`` (nodes, 3) [length] as ``x_0``."""
        return Material(self._weights, self.surface, x, self._mirrored)

    def products(self, x: Array) -> Array:
        """Sums A of dx dx_0^T at the material points, (n, 3, 3) [length^2]; ``x``: positions."""
        j, k = self.pairs
        products = (x[k][:, :, None] * self._spokes).reshape(-1, 9)
        sums = [np.bincount(j, c, self._count) for c in products.T]
        return np.stack(sums, axis=1).reshape(-1, 3, 3).astype(float)

    def turned(self, x: Array) -> Turned:
        """Rotations from ``x_0`` to the positions ``x`` (nodes, 3) [length]."""
        A = self.products(x)
        Q, _ = polar(A)
        P = A @ Q.swapaxes(1, 2)
        trace = np.trace(P, axis1=1, axis2=2)
        none = trace <= TINY  # no weights
        Q[none], P[none] = np.eye(3), np.eye(3)
        inner = np.where(none, 3.0, trace)[:, None, None] * np.eye(3) - P
        return Turned(Q, np.linalg.inv(inner))

    def rows(self, by_products: Array) -> Block:
        """Block of the products of ``by_products`` (n, 3, 3) and dA, of this rank."""
        mine = share_of(np.arange(len(self._spokes)), self.surface.comm)
        j, k = self.pairs[0][mine], self.pairs[1][mine]
        values = (by_products[j] * self._spokes[mine]).sum(axis=2)
        return Block(j[:, None], self.surface.dofs[k], values[:, None])


class Screw(NamedTuple):
    """Slip between two surfaces in a step in space; n nodes.

    Let r be the vector from the material points of the master that the node faced to the node, r_0
    that at the start. The relative motion is the screw motion of constant velocity that leads from
    start to end: with the relative rotation L of Q^T R = exp(L),

        u = Q J(-L)^-1 (R^T r - r_0),    J(L) = int_0^1 exp(t L) dt.

    It vanishes for any motion of the two bodies together, and is exact where either side turns
    about any axis at a constant rate. Of L only the ends of the step are known: |L| < pi. See
    ``Turned`` for Q and R.

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
        by_r, by_spin = (times(each.swapaxes(1, 2), along) for each in self[4:6])
        return by_r, np.cross(self.slip, along) - by_spin, by_spin - np.cross(self.vector, by_r)


def screw(r: Array, r_0: Array, slave: Turned, master: Turned) -> Screw:
    """Slip between two surfaces in space, see ``Screw`` (local).

    Args:
        r: Vectors from the partners to the nodes, shape (n, 3) [length].
        r_0: Those at the start of the step.
        slave: Rotation of the slave's material.
        master: Rotation of the master's material.
    """
    back, ahead = slave.Q.swapaxes(1, 2), master.Q.swapaxes(1, 2)
    L, angle = vectors_of(back @ master.Q)
    v = times(ahead, r) - r_0
    C, by_L = inverse_jacobians(-L), _by_vector(L, v)
    by_relative = slave.Q @ by_L @ inverse_jacobians(L) @ back
    return Screw(times(slave.Q @ C, v), angle, slave, master, slave.Q @ C @ ahead, by_relative, r)


class PastObstacle(NamedTuple):
    """Slip past an obstacle in a step in space; n nodes.

    The rotation w of an obstacle is known whatever its size, and r leads from its pivot to the
    node. With the velocity of the node past the pivot constant in the frame of the slave, and with
    exp(f) = Q,

        u = r - Q r_0 - (a + a_0) / 2 - b(f) f x (a - a_0),    a = l x r,    a_0 = Q (l x r_0),

    with l = w - f and J(f)^-1 = 1 - F / 2 + b F^2, J as in ``Screw``. As in the plane, it is exact
    for translations, for a wheel that turns in place, whichever side it is, and for its rolling,
    wherever the pivot lies.

    A body that turns along with an obstacle by more than half a turn has the same Q: there f is the
    vector of Q that is next to w in l, see ``_beside``.

    Attributes:
        slip, slave: See ``Screw``.
        doubt: Size above which the direction of the relative rotation is uncertain, (n,) [radian].
        by_vector: du/dr, shape (n, 3, 3) [1].
        by_vector_then: du/dr_0, shape (n, 3, 3) [1].
        by_start: du by the spin of Q at constant l, shape (n, 3, 3) [length].
        by_relative: du/dl, shape (n, 3, 3) [length].
        by_spin: dl by the spin of Q, shape (n, 3, 3) [1].
        of_slave: f, the rotation vector of the slave's material, shape (n, 3) [radian].
    """

    slip: Array
    doubt: Array
    slave: Turned
    by_vector: Array
    by_vector_then: Array
    by_start: Array
    by_relative: Array
    by_spin: Array
    of_slave: Array

    def weights(self, along: Array) -> tuple[Array, Array]:
        """Factors of dr and of the spin of the slave in along . du, (n, 3) [1, length]."""
        by_spin = self.by_start + self.by_relative @ self.by_spin
        by_r, of_slave = (times(a.swapaxes(1, 2), along) for a in (self.by_vector, by_spin))
        return by_r, of_slave


def past_obstacle(r: Array, r_0: Array, slave: Turned, w: Array) -> PastObstacle:
    """Slip past an obstacle in space, see ``PastObstacle`` (local).

    Args:
        r: Vectors from the pivot to the nodes, shape (n, 3) [length].
        r_0: Those at the start of the step.
        slave: Rotation of the slave's material.
        w: Rotation vectors of the obstacle in the step, of any size, shape (n, 3) [radian].
    """
    own, angle = vectors_of(slave.Q)
    f, doubt = _beside(w, own, angle)
    l, start = w - f, times(slave.Q, r_0)
    a, a_0 = np.cross(l, r), times(slave.Q, np.cross(l, r_0))
    b, slope = (each[:, None] for each in inverse_factors(own))
    across = np.cross(own, a - a_0)
    slip = r - start - 0.5 * (a + a_0) - b * across
    F, L, arms = b[:, None] * crosses(own), crosses(l), (crosses(r), slave.Q @ crosses(r_0))
    by_own = b[:, None] * crosses(a - a_0) - (slope * across)[:, :, None] * own[:, None]
    by_own = by_own @ inverse_jacobians(own)
    return PastObstacle(
        slip,
        doubt,
        slave,
        by_vector=np.eye(3) - 0.5 * L - F @ L,
        by_vector_then=-slave.Q - (0.5 * np.eye(3) - F) @ slave.Q @ L,
        by_start=crosses(start + 0.5 * a_0) - F @ crosses(a_0) + by_own,
        by_relative=0.5 * (arms[0] + arms[1]) + F @ (arms[0] - arms[1]),
        by_spin=-inverse_jacobians(f),
        of_slave=f,
    )


def _beside(w: Array, f: Array, angle: Array) -> tuple[Array, Array]:
    """Rotations of the slave for a rotation w of an obstacle, and ``doubt``.

    The slave's material turns by less than half a turn in the step, unless the body turns along
    with an obstacle that turns by more: if it turned by more than ``TILTED``, and by much more than
    relative to the obstacle.

    Args:
        w: Angles or rotation vectors of the obstacle, shape (n, 1 or 3) [radian].
        f: Those of the slave, less than half a turn, shape (n, 1 or 3) [radian].
        angle: Their sizes, shape (n,) [radian].
    """
    axis = f / np.maximum(angle, TINY)[:, None]
    full = 2.0 * np.pi * np.round(((axis * w).sum(axis=1) - angle) / (2.0 * np.pi))
    other = f + full[:, None] * axis
    nearest = norms(w - other)
    rides = (angle > TILTED) & (nearest < 0.5 * angle)
    doubt = np.where(full == 0.0, 1.0, 2.0) * np.minimum(angle, nearest)
    return np.where(rides[:, None], other, f), doubt


def vectors_of(R: Array) -> tuple[Array, Array]:
    """Rotation vectors (n, 3) and angles (n,) of rotations (n, 3, 3) [radian] (local).

    Close to half a turn the vectors are inaccurate, the angles are not.
    """
    spins = [R[:, i, j] - R[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))]
    axial = 0.5 * np.stack(spins, axis=1)
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


def times(matrices: Array, vectors: Array) -> Array:
    """Products (..., a) of matrices (..., a, b) and vectors (..., b) [their units] (local)."""
    return np.einsum("...ab,...b->...a", matrices, vectors)


# Turn of a led body in a step [radian], 0.6 degrees, up to which no node is carried along before
# slip is counted: slip is then at most 2e-5 too small.
LEADS = 0.01
# Mean normal of a contact [1], below which its turn is not known, as around a shaft in a ring.
FACING = 0.5


class Carried(NamedTuple):
    """Nodes carried along by the motions that lead their bodies; arrays of n nodes.

    Attributes:
        x: Positions x_0 after these motions, of other bodies those at the start, (n, dim) [length].
        turn: Angles or rotation vectors, of any size, zero for other bodies, (n, 1 or 3) [radian].
        start, end: Pivots at both ends, shape (n, dim) [length].
        straight: Whether pivots are known to move on straight lines, as those of rigid boundaries
            and obstacles, shape (n, 1), 1 or 0.
    """

    x: Array
    turn: Array
    start: Array
    end: Array
    straight: Array

    def velocity(self) -> Array:
        """Motions at ``x`` by the rates of the start of the step, (n, dim) [length]."""
        return self.end - self.start + moved_by(self.turn, self.x - self.start)


class Place(NamedTuple):
    """Motion of the place of contact that slave nodes come into; arrays of n slave nodes.

    It is not known without contact at both ends of the step, or if contact is all around; there
    supports alone lead.

    Attributes:
        start, end: Mean positions of the contact at both ends of the step, (n, dim) [length].
        turn: Rotation of its normal, less than half a turn, shape (n, 1 or 3) [radian].
    """

    start: Array
    end: Array
    turn: Array


class Led(NamedTuple):
    """Nodes of a slave whose slip is counted from where motions carry them, n slave nodes.

    Supports lead bodies by a known motion: a turn w, and the straight path d of a pivot that ends
    at p. A node that such a motion brings into contact was elsewhere at the start of the step, and
    the point that it faced there may never meet it. Where two bodies turn, contact stays in place
    while material passes through it, and slip is what passes on one side less what passes on the
    other. So the step is divided. First both bodies move as rigid ones, at constant rates; slave
    and master slip by

        u = tau . V(x'),    V(x) = d_s + w_s x (x - p_s) - d_m - w_m x (x - p_m).

    From there slip is counted as from an accepted state, see ``slip``: bodies deform, and turn and
    move by what supports do not determine. Both parts take place together, at the mean
    x' = (x + x_0) / 2 of the node's positions x, where it is, and x_0, to which the motion carries
    it; the point of the master likewise. Bodies that roll on each other do not slip, for any angle.
    If all nodes slide, the work of friction is that of the moments,
    F . (w_s x (x - p_s)) - F . (w_m x (x - p_m)) with the forces F on the slave: two tyres of
    radius R, pressed by 0.04 R on a fine mesh, to 0.3 %; with x in place of x' to 1.3 %. Motions
    that lead are found before a solve, and are fixed within it, see ``way_of``; those that are part
    of the solution are known after a solve, see ``way_past``.

    Nodes that carry force at the start of the step keep their partners: their contact moves along.
    Pairs with small sliding have no turns.

    Attributes:
        new: The nodes, shape (n,), bool.
        x, m: Positions of all slave and master nodes there, shape (nodes, dim) [length].
        place: Place of the obstacle there, shape (m,).
        turns: ``Contact.turns`` there.
        turn: Turn of the slave less that of the master, zero at other nodes, (n, 1 or 3) [radian].
        way: V at the origin of space, zero at other nodes, shape (n, dim) [length].
    """

    new: Flags
    x: Array
    m: Array
    place: Array
    turns: tuple[Array, ...]
    turn: Array
    way: Array

    def way_at(self, x: Array) -> Array:
        """V of slave nodes at ``x``, zero at other nodes, (n, dim) [length]."""
        return self.way + 0.5 * moved_by(self.turn, x)

    def origin(self, x: Array, x_led: Array) -> Array:
        """Rows of ``x_led`` at ``new``, others of ``x``, (n, ...) each, of the slave [length]."""
        return np.where(self.new.reshape(-1, *[1] * (x.ndim - 1)), x_led, x)


def way_of(slave: Carried, master: Carried) -> Array:
    """``Led.way`` of slave nodes, by those and the points they face, (n, dim) [length] (local).

    Rates are constant in a frame that turns with the place of contact, by the part g that is common
    to the turns of both bodies and to that of the vector r between their pivots, from r_0 to r_1:
    there d_s - d_m = r_1 - exp(g) r_0, and the turns are less by g. So the bodies and their pivots
    may turn together by up to half a turn.
    """
    r_0, r_1 = slave.start - master.start, slave.end - master.end
    size = norms(slave.x - slave.end) + norms(master.x - master.end)
    common = _common(slave.turn, master.turn, r_0, r_1, size)
    drift = r_1 - times(_rotations(common), r_0)
    of_slave, of_master = (
        moved_by(side.turn - common, 0.5 * side.x - side.end) for side in (slave, master)
    )
    return np.asarray(drift + of_slave - of_master)


def way_past(place: Place, slave: Carried, master: Carried) -> Array:
    """``Led.way`` by rates that are constant in the frame of the place of contact (local).

    Motions that are not prescribed are part of the solution: of rollers, driven hubs, bodies that
    ride on others. They are known after a solve, a fixed point of rigid motions that are fixed
    within each. The ends of a step are consistent with rates that are constant in any frame. The
    natural one is that of the place of contact: it moves from X_0 to X, the mean positions of the
    contact at both ends, weighted by its forces, and turns by g with its normal. Seen from there
    each body turns by a = w - g, about a pole if the motion of its pivot is not known to be
    straight, and slave and master pass by

        V(x) = a x (x - p) + J(-a)^-1 (p - X - exp(g) (p_0 - X_0)).

    It is exact for wheels that turn in place, roll on anything, orbit as in a bearing, or slip as
    they do so, whichever of their points is p, and for whole scenes that turn. Nan where the place
    is not known, see ``Place``.

    Args:
        place: The place of contact.
        slave: Slave nodes.
        master: The points that they face.

    Returns:
        Shape (n, dim) [length].
    """
    of_slave, of_master = (_passing(place, side) for side in (slave, master))
    return of_slave - of_master


def _passing(place: Place, side: Carried) -> Array:
    """Velocity of a side in the frame of a place, less half of that by a turn of x (local)."""
    turn = side.turn - place.turn
    before = times(_rotations(place.turn), side.start - place.start)
    moved = side.end - place.end - before
    vectors = _in_space(-turn)
    bent = (side.straight[:, 0] == 0.0) & (norms(vectors) < np.pi)  # about a pole
    J = inverse_jacobians(np.where(bent[:, None], vectors, 0.0))[:, : moved.shape[1]]
    moved = times(J[:, :, : moved.shape[1]], moved)
    return np.asarray(moved + moved_by(turn, 0.5 * side.x - side.end))


class LoadedNodes(NamedTuple):
    """Contact at one end of a step; arrays of n slave nodes.

    Attributes:
        x: Positions, shape (n, dim) [length].
        normals: Averaged normals, shape (n, dim) [1].
        loads: Normal forces, shape (n,) [stress length^(dim - 1)].
        pairs: Numbers of the two bodies that touch, shape (n,).
    """

    x: Array
    normals: Array
    loads: Array
    pairs: Array


def place_between(start: LoadedNodes, end: LoadedNodes) -> Place:
    """The place of contact of each node's two bodies at the end (local).

    Positions are nan if these do not touch at both ends, or touch all around.
    """
    shape = end.x.shape
    ends, turn = np.full((2, *shape), np.nan), np.zeros((shape[0], len(TURNS[shape[1]])))
    for pair in np.unique(end.pairs):
        means = [_mean_of(each, pair) for each in (start, end)]
        if min(np.linalg.norm(normal) for _, normal in means) > FACING:
            at = end.pairs == pair
            ends[:, at] = [[x] for x, _ in means]
            turn[at] = turns_of_normals(*(n[None] / np.linalg.norm(n) for _, n in means))
    return Place(ends[0], ends[1], turn)


def _mean_of(touching: LoadedNodes, pair: float) -> tuple[Array, Array]:
    """Mean position and normal of a contact, (dim,) each, weighted by loads; zero without any."""
    loads = np.where(touching.pairs == pair, touching.loads, 0.0)
    share = loads / max(float(loads.sum()), TINY)
    return share @ touching.x, share @ touching.normals


def turns_of_normals(n_0: Array, n: Array) -> Array:
    """Smallest rotations from unit normals n_0 to n, (k, dim) each, (k, 1 or 3) [radian]."""
    if n.shape[1] == 2:
        return angles_between(n_0, n)[:, None]
    axis = np.cross(n_0, n)
    sine = norms(axis)
    angle = np.arctan2(sine, (n_0 * n).sum(axis=1))
    return axis * (angle / np.where(sine > 0.0, sine, 1.0))[:, None]


def carried_by(obstacle: RigidMotion, place: Array, points: Array) -> Carried:
    """Points (n, dim) of an obstacle's own frame, moved here from a ``place`` (m,) (local)."""
    dim, shape = obstacle.dim, (len(points), 1)
    start, end = (obstacle.pivot + at[:dim] for at in (place, obstacle.place))
    motion = (np.tile(each, shape) for each in (obstacle.turn_since(place), start, end, 1.0))
    return Carried(obstacle.to_space(points), *motion)


def _common(of_slave: Array, of_master: Array, r_0: Array, r_1: Array, size: Array) -> Array:
    """Turns g that both bodies and the vector between their pivots have in common (local).

    Zero if these are not about one axis and in one sense. If the pivots coincide, beside the
    ``size`` (n,) [length] of their distances from the nodes, the turns of the bodies decide.
    """
    axes, across = _in_space(of_slave), [_in_space(r) for r in (r_0, r_1)]
    angle = norms(axes)
    axes = axes / np.where(angle > 0.0, angle, 1.0)[:, None]
    other = _in_space(of_master)
    along = (axes * other).sum(axis=1)
    parallel = norms(other - along[:, None] * axes) <= ROUNDING * norms(other)
    a, b = (r - (axes * r).sum(axis=1)[:, None] * axes for r in across)
    ends = np.stack([norms(a), norms(b)]) > ROUNDING * size
    third = np.arctan2((axes * np.cross(a, b)).sum(axis=1), (a * b).sum(axis=1))
    third = np.where(ends.all(axis=0), third, np.where(ends.any(axis=0), 0.0, np.inf))
    least = np.minimum(np.minimum(angle, along), third)
    common = np.where(parallel & (least > 0.0), least, 0.0)[:, None] * axes
    return common if of_slave.shape[1] == 3 else common[:, 2:]


def _in_space(v: Array) -> Array:
    """Angles (n, 1), or vectors in the plane (n, 2), as vectors in space, (n, 3)."""
    before = {1: 2, 2: 0, 3: 0}[v.shape[1]]
    return np.pad(v, ((0, 0), (before, 3 - v.shape[1] - before)))


def moved_by(turn: Array, v: Array) -> Array:
    """Products of turns (..., 1 or 3) and vectors (n, dim), (n, dim) [their unit] (local)."""
    if v.shape[1] == 3:
        return np.cross(turn, v)
    return turn * np.stack([-v[:, 1], v[:, 0]], axis=1)


def _rotations(turns: Array) -> Array:
    """Rotations by turns (n, 1 or 3), shape (n, dim, dim) [1]."""
    rows, number = np.unique(turns, axis=0, return_inverse=True)
    return np.array([rotation_by(row) for row in rows])[number.ravel()]
