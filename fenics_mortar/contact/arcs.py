# SPDX-License-Identifier: MIT
"""Slip in a step as the length of the way along the surface, with rotations of any size.

At a slave node with the contact normal n and tangent tau, let r be the vector from a material point
of the master to the node. If psi is the angle of the normal and phi that of the master's material,
the rate of slip is, for any such point and any motion,

    u' = tau . r' - phi' n . r = (tau . r)' - (phi' - psi') n . r.

The first form is tau times the velocity of the node relative to the material of the master at the
same place. Of a step only both ends are known. The normal turns with the slave's material. With a
constant rate of rotation, and a constant relative velocity r' in a frame in which the normal
rotates by beta in the step, the integral is

    u = (1 + theta kappa) [tau . r] - theta (n . r + n_0 . r_0) / 2,
    kappa = (1 - h cot h) / (2 h),    h = beta / 2,

with the change [tau . r] and the relative rotation theta = [phi] - [psi]. It vanishes for any
rotation of the two bodies together, is exact for motions of a constant rate, and otherwise of
second order in the step.

Where contact transfers forces, its gap g along n is closed, or will be by the solution. So r ends
at the master, n . r + g replaces n . r, unless a law acts at open gaps. Otherwise a gap of many
facets couples the slip to the rotations of single facets within Newton's method: O-rings that a lid
releases took two to seven times as many iterations.

============  ======================  ========================  ====================================
master        r from                  r' is constant in         exact
============  ======================  ========================  ====================================
an obstacle   its pivot, which may    space, beta = [psi]       translation; a wheel that turns in
              lie anywhere                                      place, rolls on the slave, or is the
                                                                slave; a slide along an arc
a surface     the partner, see        the master's frame,       translation; either side turns about
              ``slip``                beta = -theta             any point, as a shaft in a ring
============  ======================  ========================  ====================================

Angles of surfaces are those of their averaged normals at the material points, known up to full
turns only; the angle of an obstacle is known. See ``Rotations``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from fenics_mortar.interface.curve_surface import Curve
from fenics_mortar.interface.mortar import MortarOperators
from fenics_mortar.interface.segments import evaluate_normals
from fenics_mortar.kernels.arcs import tabulate_arcs
from fenics_mortar.utils.arrays import Array, read_only_view

# Largest relative rotation of two bodies in a step [radian]: 135 degrees. Their positions are also
# those after a rotation in the other direction, of 225 degrees, which is no longer much larger.
MAX_ROTATION = 0.75 * np.pi
# Rotation of a surface in a step [radian], 20 degrees, up to which a body does not turn along
# with an obstacle that turns by more than half a turn: supported bodies tilt by less.
TILTED = np.pi / 9.0


class Arc(NamedTuple):
    """Slip of a step without the slip counted before, and its derivatives, see above.

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
    now: tuple[Array, Array],
    start: tuple[Array, Array],
    theta: Array,
    beta: Array,
    gap: Array | float = 0.0,
) -> Arc:
    """Slip of a step (local).

    Args:
        now: Vectors r and normals n at the end of the step, shape (..., 2) [length, 1].
        start: r_0 and n_0, those at its start.
        theta: Rotation of the master minus that of the normal, shape (...) [radian].
        beta: Rotation of the normal in the frame of constant velocity, likewise.
        gap: Gap g that contact closes, zero where a law acts at open gaps, likewise [length].
    """
    shape, ends = theta.shape, [np.stack(end).reshape(2, -1, 2) for end in (now, start)]
    slip, by_vectors = np.empty(theta.size), np.empty_like(ends[0])
    by_angles = np.empty((4, theta.size))
    closed = np.broadcast_to(gap, shape)
    given = (read_only_view(np.ravel(values)) for values in (theta, beta, closed))
    tabulate_arcs(*ends, *given, slip, by_vectors, by_angles)
    vectors, others = by_vectors.reshape(2, *shape, 2), by_angles.reshape(4, *shape)
    return Arc(*(slip.reshape(shape), *vectors, *others, -0.5 * theta))


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
    n, dn = evaluate_normals(o.master, o.m, "opposite")
    fixed = np.isfinite(planes[:, 0])
    if fixed.any():
        n[fixed], dn[fixed] = planes[fixed], 0.0
    v = np.asarray(M @ n)
    return Orientation(normal_rotation(s, v), v, s, ds, n, dn)


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
    theta = _wrapped(now - before)
    return Rotations(theta, -theta, np.abs(theta))


def rotation_past_obstacle(body: Array, angle: float) -> Rotations:
    """Rotation of an obstacle relative to the slave's material, and that of the material.

    The material turns by less than half a turn in the step, unless the body turns along with an
    obstacle that turns by more: if it turned by more than ``TILTED``, and by much more than
    relative to the obstacle.

    Args:
        body: Rotations of the averaged normals, -pi ... pi, shape (slave nodes,) [radian].
        angle: Rotation of the obstacle in the step, of any size [radian].
    """
    theta = angle - body
    nearest = _wrapped(theta)
    rides = (np.abs(body) > TILTED) & (np.abs(nearest) < 0.5 * np.abs(body))
    choices = np.where(nearest == theta, 1.0, 2.0)
    doubt = choices * np.minimum(np.abs(body), np.abs(nearest))
    return Rotations(np.where(rides, nearest, theta), body, doubt)


def surface_rotation(surface: Curve, x_0: Array, x: Array) -> Array:
    """Rotations of the averaged normals of nodes moved from ``x_0`` to ``x``, (n,) [radian]."""
    ends = (evaluate_normals(surface, positions, "opposite")[0] for positions in (x_0, x))
    return normal_rotation(*ends)


def normal_rotation(n_0: Array, n: Array) -> Array:
    """Angles from normals ``n_0`` to ``n``, (..., 2) each, -pi ... pi [radian]."""
    return np.arctan2(_dot(quarter_turn(n_0), n), _dot(n_0, n))


def rotated_by(v: Array, angle: Array) -> Array:
    """Vectors (n, 2) rotated counter-clockwise by angles (n,) [radian] [their unit]."""
    return np.cos(angle)[:, None] * v + np.sin(angle)[:, None] * quarter_turn(v)


def quarter_turn(v: Array) -> Array:
    """Vectors (..., 2) rotated by a quarter of a turn counter-clockwise [their unit]."""
    return np.stack([-v[..., 1], v[..., 0]], axis=-1)


def _wrapped(angle: Array) -> Array:
    """Angles minus full turns, -pi ... pi [radian]."""
    full = np.round(angle / (2.0 * np.pi))
    return np.where(full == 0.0, angle, angle - 2.0 * np.pi * full)


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...c,...c->...", a, b)
