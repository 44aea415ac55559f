# SPDX-License-Identifier: MIT
"""Ways of nodes in a step: with their bodies as these turn, and through rigid obstacles.

An obstacle is passed where its signed distance says so: points are taken along the way as far apart
as the distance allows, since nothing is nearer (sphere tracing, Hart 1996), and at the surface by a
small part of a facet. The way is followed in the obstacle's own frame. It went through where the
gradient at its exit is opposed to that at its entry, and the obstacle goes on a facet to either
side; else it went round an edge.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arrays import Array, Indices

# Bodies turn by this at the most in a part of a step, whose ways are straight [radian]: that
# shrinks them by 8 %. What slides by L along one that turns by the second goes astray by less than
# L / 200.
LARGEST_TURN, SMALL_TURN = np.pi / 4, 0.02
# Normals at entry and exit with a cosine below this are opposed (more than 100 degrees apart): a
# way round a corner of a block is not through. Above the second, at start and end, nothing was
# passed.
OPPOSITE, ALIKE = -0.17, 0.7
# Points at the surface are so many facets apart, and there are so many of them at the most.
FINE, MOST_POINTS = 0.05, 400


class Motions:
    """Rigid motions of bodies in a step, those closest to the motions of their nodes (local).

    Args:
        x0: Positions of the nodes at the start, shape (n, 2) [length].
        x1: Positions at the end, shape (n, 2) [length].
        bodies: Body of each node, shape (n,).

    Attributes:
        labels: The bodies, shape (b,).
        angles: Their turns, shape (b,) [radian].
    """

    def __init__(self, x0: Array, x1: Array, bodies: Indices) -> None:
        self._x0, self._x1 = x0, x1
        self.labels, self._of_node = np.unique(bodies, return_inverse=True)
        counts = np.bincount(self._of_node)[:, None]
        self._start, self._end = self._sums(x0) / counts, self._sums(x1) / counts
        y0, y1 = x0 - self._start[self._of_node], x1 - self._end[self._of_node]
        products = np.stack([(y0 * y1).sum(axis=1), y0[:, 0] * y1[:, 1] - y0[:, 1] * y1[:, 0]], 1)
        dot, cross = self._sums(products).T
        self.angles: Array = np.arctan2(cross, dot)

    def _sums(self, values: Array) -> Array:
        """Sums of values (n, 2) over the nodes of each body, shape (b, 2)."""
        return np.stack([np.bincount(self._of_node, column) for column in values.T], axis=1)

    @property
    def are_small(self) -> bool:
        """Whether no body turns so far that ways have to be seen from each."""
        return float(np.abs(self.angles).max(initial=0.0)) <= SMALL_TURN

    def carried(self) -> Array:
        """Nodes at the start, each carried along with its own body, shape (n, 2) [length]."""
        i = self._of_node
        return self._end[i] + _turned(self._x0 - self._start[i], self.angles[i])

    def seen_from(self, body: int) -> Array:
        """Nodes at the start, all carried along with one of the bodies, shape (n, 2) [length]."""
        return self._end[body] + _turned(self._x0 - self._start[body], self.angles[body])

    def ways(self) -> Array:
        """Positions at the start, at times between and at the end, shape (m + 1, n, 2) [length].

        The bodies' centres go straight, and bodies turn about them. Two that move as one only do so
        here as seen from one of them.
        """
        i, largest = self._of_node, float(np.abs(self.angles).max(initial=0.0))
        parts = max(int(np.ceil(largest / LARGEST_TURN)), 1)
        y0 = self._x0 - self._start[i]
        y1 = _turned(self._x1 - self._end[i], -self.angles[i])
        along = [self._x0]
        for t in np.arange(1, parts) / parts:
            centre = self._start + t * (self._end - self._start)
            along.append(centre[i] + _turned(y0 + t * (y1 - y0), t * self.angles[i]))
        return np.array([*along, self._x1])


def _turned(y: Array, angle: Array | float) -> Array:
    """Vectors (n, 2), each turned by its angle (n,), or all by one."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * y[:, 0] - s * y[:, 1], s * y[:, 0] + c * y[:, 1]], axis=1)


def went_through(obstacle: Obstacle, knots: Array, offset: Array, lengths: Array) -> Array:
    """How far beyond the surface of an obstacle nodes are that went through it, else 0 (local).

    Args:
        obstacle: The obstacle; where it is does not matter.
        knots: Positions of s nodes in its own frame at the start, at times between and at the end,
            shape (m + 1, s, 2).
        offset: Length that is taken off the distance of each node, shape (s,).
        lengths: Length of surface that belongs to each node, shape (s,).

    Returns:
        Shape (s,) [length].
    """
    branches = np.linalg.norm(np.diff(knots, axis=0), axis=2)
    far = np.concatenate([np.zeros((1, len(offset))), np.cumsum(branches, axis=0)])
    (start, start_slope), (end, end_slope) = (
        _distance(obstacle, knots[k], offset) for k in (0, -1)
    )
    reaches = np.maximum(start, 0.0) + np.maximum(end, 0.0) <= far[-1]
    turned = (start_slope * end_slope).sum(axis=1) < ALIKE
    which = np.flatnonzero(reaches & turned & (far[-1] > 0.0))
    through = np.zeros(len(offset))
    if which.size:
        passed = _trace(obstacle, knots[:, which], far[:, which], offset[which], lengths[which])
        through[which] = np.where(passed, np.maximum(end[which], np.finfo(float).tiny), 0.0)
    return through


def own_frame(obstacle: Obstacle, x: Array, place: Array) -> Array:
    """Where points ``x`` of space are in the frame of an obstacle at a place."""
    c, s = np.cos(place[2]), np.sin(place[2])
    return (x - obstacle.pivot - place[:2]) @ np.array([[c, -s], [s, c]]) + obstacle.pivot


def _distance(obstacle: Obstacle, x: Array, offset: Array) -> tuple[Array, Array]:
    """Distances (s,) less the offset, no more than the nearest surface, and unit gradients."""
    phi, gradient, _ = obstacle.local(x)
    size = np.maximum(np.hypot(*gradient.T), np.finfo(float).tiny)
    return (phi - offset) / np.maximum(size, 1.0), gradient / size[:, None]


def _trace(
    obstacle: Obstacle, knots: Array, far: Array, offset: Array, lengths: Array
) -> npt.NDArray[np.bool_]:
    """Whether ways with ``knots`` (m + 1, s, 2), ``far`` (m + 1, s) along them, went through."""
    total = far[-1]
    least = np.maximum(FINE * lengths, total / MOST_POINTS)
    at, passed = np.zeros(len(total)), np.zeros(len(total), bool)
    before = _at(knots, far, at)
    distance, slope = _distance(obstacle, before, offset)
    entry, entry_slope, inside = before.copy(), slope.copy(), distance < 0.0
    for _ in range(2 * MOST_POINTS):
        if (at >= total).all():
            break
        at = np.minimum(at + np.maximum(np.abs(distance), least), total)
        here = _at(knots, far, at)
        distance, now = _distance(obstacle, here, offset)
        enters, leaves = ~inside & (distance < 0.0), inside & (distance >= 0.0)
        entry = np.where(enters[:, None], before, entry)
        entry_slope = np.where(enters[:, None], slope, entry_slope)
        step = here - before
        skips = ~inside & (distance >= 0.0)  # a sheet thinner than the distance of two points
        skips &= ((step * slope).sum(axis=1) < 0.0) & ((step * now).sum(axis=1) > 0.0)
        first = np.where(leaves[:, None], entry_slope, slope)
        middle = np.where(leaves[:, None], 0.5 * (entry + here), 0.5 * (before + here))
        opposed = (leaves | skips) & ((first * now).sum(axis=1) < OPPOSITE)
        if opposed.any():
            opposed[opposed] = _goes_on(
                obstacle, middle[opposed], first[opposed], lengths[opposed],
                offset[opposed] + 2.0 * least[opposed],
            )  # fmt: skip
        passed |= opposed
        before, slope, inside = here, now, distance < 0.0
    return passed


def _goes_on(
    obstacle: Obstacle, x: Array, normal: Array, lengths: Array, offset: Array
) -> npt.NDArray[np.bool_]:
    """Whether an obstacle is there a facet to either side of points on their way through."""
    along = lengths[:, None] * np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    sides = [_distance(obstacle, x + sign * along, offset)[0] <= 0.0 for sign in (1.0, -1.0)]
    return np.asarray(sides[0] & sides[1])


def _at(knots: Array, far: Array, at: Array) -> Array:
    """Points ``at`` (s,) along ways with ``knots`` (m + 1, s, 2) at ``far`` (m + 1, s)."""
    branch = np.clip((far <= at).sum(axis=0) - 1, 0, len(far) - 2)
    every = np.arange(len(at))
    start, end = far[branch, every], far[branch + 1, every]
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.nan_to_num((at - start) / (end - start), posinf=0.0, neginf=0.0)
    return knots[branch, every] + part[:, None] * (knots[branch + 1, every] - knots[branch, every])
