# SPDX-License-Identifier: MIT
"""Rigid obstacles: a signed distance in the place of a meshed master, and what it does to a slave.

An obstacle is its signed distance phi, positive outside the solid, with gradient and Hessian; they
are evaluated in the obstacle's own frame and turned to its present place. With q = (x, y, turn) of
its rigid motion, turn = angle times a length ``arm``, and V = (e_x, e_y, e_z x r / arm), r counted
from the pivot, a point x of space sees

    d phi = grad phi . (dx - V dq),    d grad phi = H (dx - V dq) + e_z x grad phi dq_3 / arm.

The slave is integrated facet by facet, with the multiplier functions of a facet that is covered
altogether (the mean of a dual function's weight times phi), on Gauss points or on the nodes:

==========  ==========================================================================
symbol      meaning
==========  ==========================================================================
Phi         C N with C = H diag(d) mass^-1 (dual) or H (standard), where d_j = int N_j,
            mass_jk = int N_j N_k and H hands over the functions of nodes without one
D[j, k]     int Phi_j N_k: H[j, k] d_k of dual functions
g[j]        int Phi_j phi: the weighted gap
n           -grad phi / |grad phi| at the slave node
f_q         -sum_k F_k . V(x_k): what the nodal forces F = D^T z, added to the internal
            ones, ask of the obstacle; forces and moments balance exactly
==========  ==========================================================================
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Self

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from fenics_mortar.clock import clock
from fenics_mortar.errors import NotFiniteError, call_together, place
from fenics_mortar.kernels.basis import BY_STANDARD, DUAL
from fenics_mortar.kernels.curved import tabulate_shapes
from fenics_mortar.lines import cross, near_pairs
from fenics_mortar.mortar import (
    Linearization,
    MortarOperators,
    MortarOptions,
    hand_over,
    share_of,
    sum_over_facets,
)
from fenics_mortar.options import check_flag, check_kind, check_number
from fenics_mortar.segments import Segments, facet_rule
from fenics_mortar.surfaces import Array, Indices, Surface

Fields = tuple[Array, Array, Array]
# Samples of a spline per piece, from the nearest of which Newton's method starts.
SAMPLES = 16
# Of these every so manieth is looked at for where the curve meets itself.
DRAWN = 4
NEWTON_STEPS = 30
# What is left after a step below this part of the curve is its square, rounding.
LAST_STEP = 1e-9
# The motions of an obstacle, as users name them.
MOTIONS = ("x", "y", "angle")
EPSILON = float(np.finfo(float).eps)


class Obstacle(ABC):
    """A rigid solid; the user says where it is, or what drives it.

    Attributes:
        name: Name used in messages and tables.
        pivot: Point that rotations turn about, moves with the obstacle, shape (2,) [length].
        place: Present translation from where it was made, and rotation about the pivot,
            counter-clockwise: (x, y, angle) [length, length, radian].
        load: Force (x, y) and moment about the pivot that drive it, nan where its motion is
            prescribed, shape (3,) [stress length, stress length^2].
        reaction: Force and moment of the contact on it after the last solve, shape (3,).
    """

    def __init__(self, name: str, pivot: npt.ArrayLike = (0.0, 0.0)) -> None:
        """Put the obstacle where it was made."""
        check_kind("name", name, str, "a text")
        self.name = name
        self.pivot = _vector("pivot", pivot)
        self.place: Array = np.zeros(3)
        self.load: Array = np.full(3, np.nan)
        self.reaction: Array = np.zeros(3)

    def __str__(self) -> str:
        """The name."""
        return self.name

    def move(
        self, *, x: float | None = None, y: float | None = None, angle: float | None = None
    ) -> None:
        """Prescribe the place, counted from where it was made: the same call has the same effect.

        Args:
            x: Translation; what is not given stays as it is [length].
            y: Translation [length].
            angle: Rotation about the pivot, counter-clockwise [radian].
        """
        for i, (name, value) in enumerate(zip(MOTIONS, (x, y, angle), strict=True)):
            if value is not None:
                self.place[i], self.load[i] = _number(name, value), np.nan

    def push(
        self, *, x: float | None = None, y: float | None = None, moment: float | None = None
    ) -> None:
        """Let forces drive motions: they are unknown then, and a solve finds the place.

        Args:
            x: Force, 0 to let it move freely; what is not given stays as it is, prescribed or
                driven [stress length].
            y: Force [stress length].
            moment: Moment about the pivot; frees the rotation [stress length^2].
        """
        for i, (name, value) in enumerate(zip(("x", "y", "moment"), (x, y, moment), strict=True)):
            if value is not None:
                self.load[i] = _number(name, value)

    def evaluate(self, x: Array) -> Fields:
        """Phi (n,), gradient (n, 2) and Hessian (n, 2, 2) at the points ``x`` (n, 2)."""
        own = self.to_own_frame(x)
        phi, gradient, hessian = self._checked(self.local(own), own)
        turn = self.turn
        return phi, gradient @ turn.T, turn @ hessian @ turn.T

    def _checked(self, fields: Fields, x: Array) -> Fields:
        """What ``local`` returned at ``x`` (n, 2), if that is a distance and its derivatives."""
        if not isinstance(fields, (tuple, list)) or len(fields) != 3:
            raise ValueError(
                f"the distance of '{self.name}' returned {type(fields).__name__}; right are three "
                "arrays: phi, gradient and Hessian"
            )
        shapes, right = [np.shape(field) for field in fields], [x.shape[:1], x.shape, (*x.shape, 2)]
        if shapes != right:
            raise ValueError(f"'{self.name}' returned shapes {shapes}; right are {right}")
        phi, gradient, hessian = map(np.array, fields)  # copies: a function may use them again
        kinds = {field.dtype.kind for field in (phi, gradient, hessian)}
        if not kinds <= set("iufc" if np.iscomplexobj(x) else "iuf"):
            raise ValueError(f"the distance of '{self.name}' returned no real numbers")
        total = phi + gradient.sum(axis=1) + hessian.sum(axis=(1, 2))  # nan and inf stay
        bad = ~np.isfinite(total) & np.isfinite(x).all(axis=1)
        if bad.any():
            raise NotFiniteError(
                f"the distance of '{self.name}', or a derivative of it, is not finite at "
                f"{bad.sum()} points, one at {self._where(x, bad)}"
            )
        flat = ~gradient.any(axis=1)
        if flat.any():
            raise NotFiniteError(
                f"the distance of '{self.name}' has no gradient at {flat.sum()} points, one at "
                f"{self._where(x, flat)}; right is one of length 1, about"
            )
        return phi, gradient, hessian

    def _where(self, x: Array, marked: npt.NDArray[np.bool_]) -> str:
        """The first of the marked points of the obstacle's own frame, in words."""
        first = int(np.argmax(marked))
        return place(np.real(self.to_space(x[first : first + 1])[0]))

    @property
    def turn(self) -> Array:
        """Present rotation, shape (2, 2)."""
        c, s = np.cos(self.place[2]), np.sin(self.place[2])
        return np.array([[c, -s], [s, c]])

    def to_own_frame(self, x: Array) -> Array:
        """Where the points ``x`` (n, 2) of space are in the obstacle's own frame."""
        return (x - self.pivot - self.place[:2]) @ self.turn + self.pivot

    def to_space(self, x: Array) -> Array:
        """Where the points ``x`` (n, 2) of the obstacle's own frame are in space."""
        return (x - self.pivot) @ self.turn.T + self.pivot + self.place[:2]

    def motions(self, x: Array, arm: float) -> Array:
        """V at the points ``x`` (n, 2): shape (n, 3, 2)."""
        r = (x - self.pivot - self.place[:2]) / arm
        one, zero = np.ones_like(r[:, 0]), np.zeros_like(r[:, 0])
        rows = ((one, zero), (zero, one), (-r[:, 1], r[:, 0]))
        return np.stack([np.stack(row, axis=1) for row in rows], axis=1)

    @abstractmethod
    def local(self, x: Array) -> Fields:
        """Phi, gradient and Hessian in the obstacle's own frame."""


class Plane(Obstacle):
    """Half plane, solid on the side that ``normal`` points away from.

    Args:
        point: A point of its surface, also the pivot [length].
        normal: Outward normal of the solid, of any length.
        name: Name used in messages.
    """

    def __init__(self, point: npt.ArrayLike, normal: npt.ArrayLike, *, name: str = "plane") -> None:
        """Normalise the normal."""
        super().__init__(name, _vector("point", point))
        normal = _vector("normal", normal)
        if not np.linalg.norm(normal) > 0.0:
            raise ValueError("normal=(0, 0): the outward normal of the solid has a length")
        self._normal = normal / np.linalg.norm(normal)

    def local(self, x: Array) -> Fields:
        """Distance to a straight line."""
        gradient = np.broadcast_to(self._normal, x.shape)
        return (x - self.pivot) @ self._normal, gradient, np.zeros((len(x), 2, 2))


class Circle(Obstacle):
    """Disk, or with ``inside`` a solid with a round hole.

    Args:
        centre: Centre, also the pivot [length].
        radius: Radius [length].
        inside: Whether contact is on the inside: the solid is what lies outside the circle.
        name: Name used in messages.
    """

    def __init__(
        self,
        centre: npt.ArrayLike,
        radius: float,
        *,
        inside: bool = False,
        name: str = "circle",
    ) -> None:
        """Check the radius."""
        super().__init__(name, _vector("centre", centre))
        check_number("radius", radius, "a positive length", lambda r: 0.0 < r < np.inf)
        check_flag("inside", inside)
        self._radius, self._sign = float(radius), -1.0 if inside else 1.0

    def local(self, x: Array) -> Fields:
        """Distance to a circle; its centre has no direction, and gets one."""
        d = x - self.pivot
        d = np.where(np.abs(d).max(axis=1, keepdims=True) > 0.0, d, [0.0, EPSILON * self._radius])
        r = np.sqrt((d * d).sum(axis=1))
        e = d / r[:, None]
        across = np.eye(2) - np.einsum("ia,ib->iab", e, e)
        sign = self._sign
        return sign * (r - self._radius), sign * e, sign * across / r[:, None, None]


class Spline(Obstacle):
    """Smooth curve through a chain of points, solid on its left: a cubic spline.

    An open curve goes on straight beyond its ends, where it has no curvature.

    Args:
        points: Shape (k, 2), at least three [length].
        closed: Whether the last point is joined to the first; do not repeat it.
        pivot: Point that rotations turn about; the mean of the points by default.
        name: Name used in messages.
    """

    def __init__(
        self,
        points: npt.ArrayLike,
        *,
        closed: bool = False,
        pivot: npt.ArrayLike | None = None,
        name: str = "spline",
    ) -> None:
        """Interpolate by chord length."""
        chain = _chain(points)
        super().__init__(name, chain.mean(axis=0) if pivot is None else pivot)
        chain = np.vstack([chain, chain[:1]]) if closed else chain
        chords = np.linalg.norm(np.diff(chain, axis=0), axis=1)
        if not chords.min() > 0.0:
            raise ValueError("two successive points of the spline are at the same place")
        knots = np.concatenate([[0.0], np.cumsum(chords)])
        self._curve = CubicSpline(knots, chain, bc_type="periodic" if closed else "natural")
        self._closed, self._end = closed, float(knots[-1])
        parts = np.linspace(0.0, 1.0, SAMPLES, endpoint=False)
        starts = (knots[:-1, None] + chords[:, None] * parts).ravel()
        self._samples = np.append(starts, self._end)
        drawn = self._curve(self._samples)
        some = drawn[::DRAWN]
        _check_simple("spline", some[:-1] if closed else some, closed=closed)
        self._points = drawn - self.pivot
        self._squares = (self._points**2).sum(axis=1)

    def local(self, x: Array) -> Fields:
        """Distance to the nearest point of the curve, by Newton's method from the best sample."""
        t = self._samples[
            np.argmin(self._squares - 2.0 * (x - self.pivot) @ self._points.T, axis=1)
        ]
        longest = np.diff(self._samples).max()
        for _ in range(NEWTON_STEPS):
            c, d, dd = self._jet(t)
            slope = np.einsum("ia,ia->i", c - x, d)
            square = np.einsum("ia,ia->i", d, d)
            bend = square + np.einsum("ia,ia->i", c - x, dd)
            step = np.clip(slope / np.where(bend > 0.0, bend, square), -longest, longest)
            t = t - step
            if np.abs(step).max(initial=0.0) < LAST_STEP * self._end:
                break
        c, d, dd = self._jet(t)
        speed = np.linalg.norm(d, axis=1)
        tangent = d / speed[:, None]
        normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
        phi = np.einsum("ia,ia->i", x - c, normal)
        curvature = (d[:, 0] * dd[:, 1] - d[:, 1] * dd[:, 0]) / speed**3
        bend = curvature / (1.0 + curvature * phi)
        return phi, normal, bend[:, None, None] * np.einsum("ia,ib->iab", tangent, tangent)

    def _jet(self, t: Array) -> Fields:
        """Point and two derivatives; straight on beyond the ends of an open curve."""
        if self._closed:
            t = t % self._end
        on = np.clip(t, 0.0, self._end)
        beyond = (t - on)[:, None]
        d = self._curve(on, 1)
        return self._curve(on) + beyond * d, d, np.where(beyond == 0.0, self._curve(on, 2), 0.0)


class Polygon(Obstacle):
    """Solid inside a polygon, whose outward corners are rounded by arcs.

    It is the distance to a polygon further inside, less the radius; inward corners stay sharp.

    Args:
        points: Its corners one after the other, shape (k, 2), at least three [length].
        rounding: Radius of the arcs [length]; a normal needs one, so it is positive.
        pivot: Point that rotations turn about; the mean of the corners by default.
        name: Name used in messages.
    """

    def __init__(
        self,
        points: npt.ArrayLike,
        rounding: float,
        *,
        pivot: npt.ArrayLike | None = None,
        name: str = "polygon",
    ) -> None:
        """Move the edges inwards by the radius."""
        corners = _chain(points)
        super().__init__(name, corners.mean(axis=0) if pivot is None else pivot)
        check_number("rounding", rounding, "a positive length", lambda r: 0.0 < r < np.inf)
        _check_simple("polygon", corners, closed=True)
        after = np.roll(corners, -1, axis=0)
        if (corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]).sum() < 0.0:
            corners = corners[::-1]
        edges = _edges(corners)
        lengths = np.linalg.norm(edges, axis=1)[:, None]
        if not lengths.min() > 0.0:
            raise ValueError("two successive corners of the polygon are at the same place")
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / lengths
        before = np.roll(normals, 1, axis=0)
        half = 1.0 + (normals * before).sum(axis=1)
        back = int(np.argmin(half))
        if half[back] <= EPSILON:
            raise ValueError(f"the polygon goes back on itself at {place(corners[back])}")
        inner = corners - rounding * (normals + before) / half[:, None]
        if not ((_edges(inner) * edges).sum(axis=1) > 0.0).all():
            raise ValueError(f"rounding={rounding}: less than the edges of the polygon bear")
        _check_simple(f"polygon less its rounding={rounding:g}", inner, closed=True)
        self._corners, self._normals, self._radius = inner, normals, float(rounding)

    def local(self, x: Array) -> Fields:
        """Distance to the nearest edge of the inner polygon, or to its nearest corner."""
        edges = _edges(self._corners)
        away = x[:, None] - self._corners
        along = np.clip((away * edges).sum(axis=2) / (edges**2).sum(axis=1), 0.0, 1.0)
        rest = away - along[:, :, None] * edges
        nearest = np.argmin((rest**2).sum(axis=2), axis=1)
        every = np.arange(len(x))
        rest, along, n = rest[every, nearest], along[every, nearest], self._normals[nearest]
        distance = np.sqrt((rest**2).sum(axis=1))
        round_ = ((along == 0.0) | (along == 1.0)) & (distance > 0.0)
        sign = np.where(self._is_inside(x), -1.0, 1.0)
        size = np.where(round_, sign * distance, 1.0)[:, None]
        gradient = np.where(round_[:, None], rest / size, n)
        phi = np.where(round_, size[:, 0], (rest * n).sum(axis=1)) - self._radius
        across = np.eye(2) - np.einsum("ia,ib->iab", gradient, gradient)
        return phi, gradient, np.where(round_[:, None, None], across / size[:, :, None], 0.0)

    def _is_inside(self, x: Array) -> npt.NDArray[np.bool_]:
        """Whether a ray from each point meets the inner polygon an odd number of times."""
        start = self._corners - x[:, None]
        end = np.roll(start, -1, axis=1)
        meets = (start[..., 1] > 0.0) != (end[..., 1] > 0.0)
        turn = start[..., 0] * end[..., 1] - start[..., 1] * end[..., 0]
        ahead = (turn > 0.0) == (end[..., 1] > start[..., 1])
        return (meets & ahead).sum(axis=1) % 2 == 1


class SignedDistance(Obstacle):
    """Any solid phi < 0.

    Args:
        function: Maps points (n, 2) to phi (n,), its gradient (n, 2) and Hessian (n, 2, 2). Where
            there is contact phi has to be a distance, about: |grad phi| = 1.
        pivot: Point that rotations turn about [length].
        name: Name used in messages.
    """

    def __init__(
        self,
        function: Callable[[Array], Fields],
        *,
        pivot: npt.ArrayLike = (0.0, 0.0),
        name: str = "obstacle",
    ) -> None:
        """Keep the function."""
        super().__init__(name, pivot)
        if not callable(function):
            raise ValueError(f"function={function!r}: a function of points (n, 2)")
        self._function = function

    def local(self, x: Array) -> Fields:
        """What the user's function says, if it has the right shape."""
        if not len(x):
            return np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2, 2))
        return self._function(x)


@dataclass(frozen=True)
class ObstacleOperators(MortarOperators):
    """Operators of a slave surface and an obstacle: a segment is a facet, its master has no nodes.

    Attributes:
        obstacle: The obstacle, where it was at the evaluation.
        arm: What an angle is multiplied by to be a turn [length].
        phi: Signed distance of the slave nodes, shape (slave nodes,) [length].
        V: Motions at the slave nodes, shape (slave nodes, 3, 2).
        dn_dq: Derivative of the normals by the motions, shape (slave nodes, 2, 3) [1 / length].
        dgap_dq: The same of the weighted gap, shape (slave nodes, 3) [length].
    """

    obstacle: Obstacle
    arm: float
    phi: Array
    V: Array
    dn_dq: Array
    dgap_dq: Array

    def freeze(self) -> Self:
        """The same without derivatives, but for that of the gap by the motions."""
        return replace(super().freeze(), dn_dq=np.zeros_like(self.dn_dq))

    def after_small_motion(self, x: Array, m: Array, dq: Array | None = None) -> Self:
        """Frozen operators after small motions of the nodes and of the obstacle, ``dq`` (3,)."""
        dq = np.zeros(3) if dq is None else dq
        moved = super().after_small_motion(x, m)
        apart = np.einsum("kmc,m->kc", self.V, dq) - (x - self.x)
        phi = self.phi + np.einsum("kc,kc->k", self.n, apart)
        return replace(moved, gap=moved.gap + self.dgap_dq @ dq, phi=phi)

    def motion_force(self, z: Array) -> Array:
        """f_q for multipliers ``z``, shape (3,) [stress length] (collective)."""
        return -np.einsum("kc,kmc->m", self.force(z)[0], self.V)

    def motion_force_derivatives(self, z: Array) -> tuple[Array, Array, Array]:
        """Derivatives of f_q by the slave nodes, the multipliers and q (collective).

        The first two of shape (3, slave nodes, 2), the last (3, 3). D and V change with nodes, V
        with the motions.
        """
        nodes, degree = self.facet_nodes, self.slave.degree
        near = self.slave.along(nodes[:, 0], range(-degree, 2 * degree + 1))
        there = near >= 0
        sums = np.zeros((3, self.slave.num_nodes, 3, 2))
        by_nodes, by_multipliers, forces = sums[0], sums[1], sums[2, :, 0]
        change = -np.einsum("ejkq,ejc,ekmc->emq", self.dD, z[nodes], self.V[nodes])
        change = np.swapaxes(change.reshape(len(nodes), 3, near.shape[1], 2), 1, 2)
        np.add.at(by_nodes, near[there], change[there])
        np.add.at(by_multipliers, nodes, -np.einsum("ejk,ekmc->ejmc", self.D, self.V[nodes]))
        np.add.at(forces, nodes, np.einsum("ejk,ejc->ekc", self.D, z[nodes]))
        self.slave.comm.Allreduce(MPI.IN_PLACE, sums)
        turned = forces[:, ::-1] * [1.0, -1.0] / self.arm
        by_nodes[:, 2] -= turned
        by_motions = np.zeros((3, 3))
        by_motions[2, :2] = turned.sum(axis=0)
        moves = 0.0 if self.linearization.frozen else 1.0
        E_d, M_q = np.swapaxes(by_nodes, 0, 1), np.swapaxes(by_multipliers, 0, 1)
        return moves * E_d, M_q, moves * by_motions

    def reaction(self, z: Array) -> tuple[Array, Array]:
        """Feet of the slave nodes on the obstacle, and the forces there."""
        return self.x + self.phi[:, None] * self.n, -self.force(z)[0]

    def sample_gaps(self, x: Array, s: Segments, points: Array) -> Array:
        """Phi at the points -1..1 of each facet of this share, (f, points) (collective)."""
        at = np.einsum("kp,ekc->epc", _shapes(points, s.slave.shape[1])[0], x[s.slave])
        distance = f"the distance of '{self.obstacle.name}'"
        evaluate = partial(self.obstacle.evaluate, at.reshape(-1, 2))
        return call_together(self.slave.comm, distance, evaluate)[0].reshape(at.shape[:2])


def surface_without_nodes(slave: Surface, name: str) -> Surface:
    """The master side of a pair with an obstacle."""
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
    carries: npt.NDArray[np.bool_],
    prescribed_normals: Array,
    options: MortarOptions,
    linearization: Linearization,
) -> ObstacleOperators:
    """Evaluate the operators of an obstacle at current positions (collective).

    Args:
        slave: The side that carries the multiplier.
        master: Surface without nodes.
        obstacle: The other side.
        arm: What an angle is multiplied by to be a turn [length].
        x: Current positions of the slave nodes, shape (slave nodes, 2) [length].
        carries: Whether a slave node carries a multiplier, shape (slave nodes,), bool.
        prescribed_normals: Normals to use instead, shape (slave nodes, 2); nan where the obstacle's
            is right.
        options: How to integrate.
        linearization: Which derivatives to fill.

    Returns:
        The operators.
    """
    distance = f"the distance of '{obstacle.name}'"  # of each rank at points of its own
    rule = facet_rule(options.integration, slave.degree + 1, options.points)

    def of_share():
        normals = obstacle_normals(obstacle, arm, x, slave.degree)
        facets = share_of(np.flatnonzero(carries[slave.facets].any(axis=1)), slave.comm)
        facets = facets[_faces(obstacle, x[slave.facets[facets]], rule[0], options)]
        nodes = slave.facets[facets]
        weights = hand_over(carries[nodes])
        return normals, facets, integrate_facets(obstacle, arm, x[nodes], weights, rule, options)

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
    slave.comm.Allreduce(MPI.IN_PLACE, dgap_dq)
    count, size, columns = dgap.shape
    return ObstacleOperators(
        slave, master, x, master.X, n, dn, _as_segments(facets, nodes, rule), D,
        np.zeros((count, size, 0)), dD, np.zeros((0, size, 0, columns)), dgap, *nodal,
        slave.comm.allreduce(count), linearization, obstacle, arm, phi, V, dn_dq, dgap_dq,
    )  # fmt: skip


def obstacle_normals(
    obstacle: Obstacle, arm: float, x: Array, degree: int
) -> tuple[Array, Array, Array, Array]:
    """Phi, normals (n, 2) of the slave nodes, derivatives by nodes and motions; see ``dn``."""
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
    """Which facets ``x`` (f, K, 2) face the obstacle and are within reach of it."""
    at = np.einsum("kp,ekc->epc", _shapes(points, x.shape[1])[0], x)
    phi, gradient, _ = obstacle.evaluate(at.reshape(-1, 2))
    near = np.abs(phi).reshape(at.shape[:2]).min(axis=1, initial=np.inf) <= options.radius
    chord, towards = x[:, -1] - x[:, 0], -gradient.reshape(at.shape).sum(axis=1)
    normal = np.stack([chord[:, 1], -chord[:, 0]], axis=1)
    sizes = np.linalg.norm(normal, axis=1) * np.linalg.norm(towards, axis=1)
    return near & ((normal * towards).sum(axis=1) >= options.least_cosine * sizes)


def integrate_facets(
    obstacle: Obstacle,
    arm: float,
    x: Array,
    weights: Array,
    rule: tuple[Array, Array],
    options: MortarOptions,
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Integrals of whole facets; f facets of K nodes, C = 6 K - 4 columns (see ``columns``).

    Args:
        obstacle: The other side.
        arm: What an angle is multiplied by to be a turn [length].
        x: Current positions of their nodes, shape (f, K, 2) [length].
        weights: H, shape (f, K, K).
        rule: Points and weights on -1 ... 1.
        options: Basis and what weighs the gap.

    Returns:
        D (f, K, K), dD (f, K, K, C), g (f, K), dg (f, K, C), dg by the motions (f, K, 3), d (f, K).
    """
    (N, dN), (count, size, _) = _shapes(rule[0], x.shape[1]), x.shape
    tangent, at = np.einsum("kp,ekc->epc", dN, x), np.einsum("kp,ekc->epc", N, x)
    J = np.sqrt((tangent**2).sum(axis=2))
    phi, gradient, _ = obstacle.evaluate(at.reshape(-1, 2))
    phi, gradient = phi.reshape(J.shape), gradient.reshape(at.shape)
    W = rule[1] * J
    dW = np.einsum("p,epc,kp->epkc", rule[1], tangent / J[:, :, None], dN)
    dW = dW.reshape(*J.shape, 2 * size)
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


def _shapes(points: Array, size: int) -> tuple[Array, Array]:
    """Shape functions of facets of ``size`` nodes and derivatives, each (size, points)."""
    table = np.empty((points.size, 3, size))
    for xi, row in zip(points, table, strict=True):
        tabulate_shapes(xi, row)
    return table[:, 0].T, table[:, 1].T


def _as_segments(facets: Indices, nodes: Indices, rule: tuple[Array, Array]) -> Segments:
    """One segment a facet, covered altogether, without master nodes."""
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
        spread=np.tile([0.0, rule[1] @ rule[0] ** 2 / 2.0], (count, 1)),
        pairs=np.empty((0, 2), np.int64),
    )


def _edges(corners: Array) -> Array:
    """Vectors from each corner of a polygon to the next."""
    return np.roll(corners, -1, axis=0) - corners


def _chain(points: npt.ArrayLike) -> Array:
    """Three or more points of the plane."""
    chain = _floats("points", points)
    if chain.ndim != 2 or chain.shape[1] != 2 or len(chain) < 3 or not np.isfinite(chain).all():
        raise ValueError(f"points of shape {chain.shape}: at least three finite points (k, 2)")
    return chain


def _check_simple(what: str, chain: Array, *, closed: bool) -> None:
    """Refuse a chain of points (k, 2) of which two edges that are no neighbours meet."""
    start, end = (chain, np.roll(chain, -1, axis=0)) if closed else (chain[:-1], chain[1:])
    pairs = near_pairs(start, end)
    after = (pairs[:, 1] - pairs[:, 0]) % (len(start) if closed else len(start) + 1)
    pairs = pairs[(after > 1) & (after < len(start) - 1 if closed else after > 1)]
    meets = cross(start, end, pairs, touching=True)
    if meets.any():
        i, j = pairs[np.argmax(meets)]
        raise ValueError(
            f"the {what} meets itself: its edges from {place(start[i])} to {place(end[i])} and "
            f"from {place(start[j])} to {place(end[j])}; give the points in their order along it"
        )


def _floats(name: str, values: Any) -> Array:
    """Real numbers, as a copy."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name}={values!r}: real numbers")
    return np.array(array, float)


def _number(name: str, value: float) -> float:
    """A finite number."""
    check_number(name, value, "a finite number", np.isfinite)
    return float(value)


def _vector(name: str, value: npt.ArrayLike) -> Array:
    """A finite vector of the plane, as a copy."""
    vector = _floats(name, value)
    if vector.shape != (2,) or not np.isfinite(vector).all():
        raise ValueError(f"{name}={value!r}: two finite numbers")
    return vector
