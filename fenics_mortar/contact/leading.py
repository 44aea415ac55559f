# SPDX-License-Identifier: MIT
"""Slip of nodes that come into contact in a step in which supports turn their bodies.

Supports lead bodies by a known motion: a turn w, and the straight path d of a pivot that ends at p.
A node that such a motion brings into contact was elsewhere at the start of the step, and the point
that it faced there may never meet it. Where two bodies turn, contact stays in place while material
passes through it, and slip is what passes on one side less what passes on the other. So the step is
divided. First both bodies move as rigid ones, at constant rates; slave and master slip by

    u = tau . V(x'),    V(x) = d_s + w_s x (x - p_s) - d_m - w_m x (x - p_m).

From there slip is counted as from an accepted state, see ``slip``: bodies deform, and turn and move
by what supports do not tell. Both parts take place together, at the mean x' = (x + x_0) / 2 of the
node's positions x, where it is, and x_0, to which the motion carries it; the point of the master
likewise. Bodies that roll on each other do not slip, for any angle. If all nodes slide, the work of
friction is that of the moments, F . (w_s x (x - p_s)) - F . (w_m x (x - p_m)) with the forces F on
the slave: two tyres of radius R, pressed by 0.04 R on a fine mesh, to 0.3 %; with x in place of x'
to 1.3 %. Motions that lead are found before a solve, and are fixed within it.

Rates are constant in a frame that turns with the place of contact, by the part g that is common to
the turns of both bodies and to that of the vector r between their pivots, from r_0 to r_1: there
d_s - d_m = r_1 - exp(g) r_0, and the turns are less by g. So the bodies and their pivots may turn
together by up to half a turn.

Nodes that carry force at the start of the step keep their partners: their contact moves along.
Pairs with small sliding have no turns.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fenics_mortar.obstacles.rigid_motion import RigidMotion, rotation_by
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags, norms

# Turn of a led body in a step [radian], 0.6 degrees, up to which no node is carried along before
# slip is counted: slip is then at most 2e-5 too small.
LEADS = 0.01


class Carried(NamedTuple):
    """Nodes carried along by the motions that lead their bodies; arrays of n nodes.

    Attributes:
        x: Positions x_0 after these motions, of other bodies those at the start, (n, dim) [length].
        turn: Angles or rotation vectors, of any size, zero for other bodies, (n, 1 or 3) [radian].
        start, end: Pivots at both ends, shape (n, dim) [length].
    """

    x: Array
    turn: Array
    start: Array
    end: Array


class Led(NamedTuple):
    """Nodes of a slave whose slip is counted from where motions carry them, n slave nodes.

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
        return self.way + 0.5 * _cross(self.turn, x)

    def origin(self, x: Array, x_led: Array) -> Array:
        """Rows of ``x_led`` at ``new``, others of ``x``, (n, ...) each, of the slave [length]."""
        return np.where(self.new.reshape(-1, *[1] * (x.ndim - 1)), x_led, x)


def way_of(slave: Carried, master: Carried) -> Array:
    """``Led.way`` of slave nodes, by those and the points they face, (n, dim) [length] (local)."""
    r_0, r_1 = slave.start - master.start, slave.end - master.end
    common = _common(slave.turn, master.turn, r_0, r_1)
    drift = r_1 - np.einsum("nab,nb->na", _rotations(common), r_0)
    of_slave, of_master = (
        _cross(side.turn - common, 0.5 * side.x - side.end) for side in (slave, master)
    )
    return np.asarray(drift + of_slave - of_master)


def carried_by(obstacle: RigidMotion, place: Array, points: Array) -> Carried:
    """Points (n, dim) of an obstacle's own frame, moved here from a ``place`` (m,) (local)."""
    dim, shape = obstacle.dim, (len(points), 1)
    start, end = (obstacle.pivot + at[:dim] for at in (place, obstacle.place))
    motion = (np.tile(each, shape) for each in (obstacle.turn_since(place), start, end))
    return Carried(obstacle.to_space(points), *motion)


def _common(of_slave: Array, of_master: Array, r_0: Array, r_1: Array) -> Array:
    """Turns g that both bodies and the vector between their pivots have in common (local).

    None if these are not about one axis and in one sense, or if the pivots coincide.
    """
    axes, across = _in_space(of_slave), [_in_space(r) for r in (r_0, r_1)]
    size = norms(axes)
    axes = axes / np.where(size > 0.0, size, 1.0)[:, None]
    other = _in_space(of_master)
    along = (axes * other).sum(axis=1)
    parallel = norms(other - along[:, None] * axes) <= ROUNDING * norms(other)
    a, b = (r - (axes * r).sum(axis=1)[:, None] * axes for r in across)
    apart = norms(a) * norms(b) > (ROUNDING * norms(across[0])) ** 2
    third = np.arctan2((axes * np.cross(a, b)).sum(axis=1), (a * b).sum(axis=1))
    least = np.minimum(np.minimum(size, along), third)
    common = np.where(parallel & apart & (least > 0.0), least, 0.0)[:, None] * axes
    return common if of_slave.shape[1] == 3 else common[:, 2:]


def _in_space(v: Array) -> Array:
    """Angles (n, 1), or vectors in the plane (n, 2), as vectors in space, (n, 3)."""
    before = {1: 2, 2: 0, 3: 0}[v.shape[1]]
    return np.pad(v, ((0, 0), (before, 3 - v.shape[1] - before)))


def _cross(turn: Array, v: Array) -> Array:
    """Products of turns (n, 1 or 3) and vectors (n, dim), shape (n, dim)."""
    if v.shape[1] == 3:
        return np.cross(turn, v)
    return turn * np.stack([-v[:, 1], v[:, 0]], axis=1)


def _rotations(turns: Array) -> Array:
    """Rotations by turns (n, 1 or 3), shape (n, dim, dim) [1]."""
    rows, number = np.unique(turns, axis=0, return_inverse=True)
    return np.array([rotation_by(row) for row in rows])[number.ravel()]


def weighted(weights: Array, carried: Carried) -> Carried:
    """The motions at material points, by ``weights`` (points, nodes) of nodes (local)."""
    return Carried(*(np.asarray(weights @ values) for values in carried))
