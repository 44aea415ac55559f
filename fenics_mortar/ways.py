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

from fenics_mortar.obstacles import Obstacle
from fenics_mortar.surfaces import Array, Indices

# Bodies turn by this at the most in a part of a step, whose ways are straight [radian]: that
# shrinks them by 8 %.
LARGEST_TURN = np.pi / 4
# Normals at entry and exit with a cosine below this are opposed (more than 100 degrees apart): a
# way round a corner of a block is not through. Above the second, at start and end, nothing was
# passed.
OPPOSITE, ALIKE = -0.17, 0.7
# Points at the surface are so many facets apart, and there are so many of them at the most.
FINE, MOST_POINTS = 0.05, 400


def turning_ways(x0: Array, x1: Array, bodies: Indices, turn: float = 0.0) -> tuple[Array, Array]:
    """Ways of nodes that turn with their bodies (local).

    Args:
        x0: Positions at the start, shape (n, 2) [length].
        x1: Positions at the end, shape (n, 2) [length].
        bodies: Body of each node, shape (n,).
        turn: Largest turn of an obstacle, whose way is to be parted, too [radian].

    Returns:
        Positions at the start, at times between and at the end, shape (m + 1, n, 2), and those at
        the start, carried along as a rigid body, and at the end, shape (2, n, 2).
    """
    _, of_node = np.unique(bodies, return_inverse=True)
    counts = np.bincount(of_node)

    def total(values: Array) -> Array:
        return np.asarray(np.bincount(of_node, values), np.float64)

    def mean(values: Array) -> Array:
        return (np.stack([total(values[:, 0]), total(values[:, 1])], axis=1) / counts[:, None])[
            of_node
        ]

    centre_0, centre_1 = mean(x0), mean(x1)
    y0, y1 = x0 - centre_0, x1 - centre_1
    dot = total((y0 * y1).sum(axis=1))
    crossed = total(y0[:, 0] * y1[:, 1] - y0[:, 1] * y1[:, 0])
    angles = np.arctan2(crossed, dot)
    largest = max(float(np.abs(angles).max(initial=0.0)), turn)
    parts = max(int(np.ceil(largest / LARGEST_TURN)), 1)
    angle, back = angles[of_node], _turned(y1, -angles[of_node])
    along = [x0]
    for t in np.arange(1, parts) / parts:
        centre = centre_0 + t * (centre_1 - centre_0)
        along.append(centre + _turned(y0 + t * (back - y0), t * angle))
    return np.array([*along, x1]), np.array([centre_1 + _turned(y0, angle), x1])


def _turned(y: Array, angle: Array | npt.NDArray[np.float64]) -> Array:
    """Vectors (n, 2), each turned by its angle (n,)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * y[:, 0] - s * y[:, 1], s * y[:, 0] + c * y[:, 1]], axis=1)


def went_through(
    obstacle: Obstacle, x: Array, places: Array, offset: Array, lengths: Array
) -> Array:
    """How far beyond the surface of an obstacle nodes are that went through it, else 0 (local).

    Args:
        obstacle: The obstacle; where it is now does not matter.
        x: Positions of s nodes at the start, at times between and at the end, (m + 1, s, 2).
        places: Places (x, y, angle) of the obstacle at these times, shape (m + 1, 3).
        offset: Length that is taken off the distance of each node, shape (s,).
        lengths: Length of surface that belongs to each node, shape (s,).

    Returns:
        Shape (s,) [length].
    """
    knots = np.array([_own_frame(obstacle, *at) for at in zip(x, places, strict=True)])
    pieces = np.linalg.norm(np.diff(knots, axis=0), axis=2)
    far = np.concatenate([np.zeros((1, len(offset))), np.cumsum(pieces, axis=0)])
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


def _own_frame(obstacle: Obstacle, x: Array, place: Array) -> Array:
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
    piece = np.clip((far <= at).sum(axis=0) - 1, 0, len(far) - 2)
    every = np.arange(len(at))
    start, end = far[piece, every], far[piece + 1, every]
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.nan_to_num((at - start) / (end - start), posinf=0.0, neginf=0.0)
    return knots[piece, every] + part[:, None] * (knots[piece + 1, every] - knots[piece, every])
