# SPDX-License-Identifier: MIT
"""Outlines of obstacles in a box around the bodies, for files and pictures."""

from __future__ import annotations

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.ranks import largest_over_ranks

# Number of points per direction of the grid on which outlines of obstacles are searched: its cells
# are narrower than the lines of a picture.
GRID = 400


def bounding_box(bulk: Bulk) -> tuple[Array, Array]:
    """Lower and upper corner of a box around deformed bodies, (2,) [length] (collective)."""
    x = bulk.positions()
    ends = np.concatenate([-x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)])
    ends = largest_over_ranks(bulk.comm, ends)
    return with_margin(-ends[:2], ends[2:])


def with_margin(low: Array, high: Array) -> tuple[Array, Array]:
    """A box with a margin of 15 % of its longer side, where obstacles are drawn (local).

    Args:
        low: Lower corner of a box, shape (2,) [length].
        high: Upper corner, shape (2,) [length].
    """
    margin = 0.15 * (high - low).max()
    return low - margin, high + margin


def outline(obstacle: Obstacle, low: Array, high: Array) -> tuple[Array, Indices, Array]:
    """Outline phi = 0 of an obstacle in a box, as line segments (local).

    For an obstacle outside the box it is a line of zero length at the pivot, since files without
    points are unreadable.

    Args:
        obstacle: The obstacle.
        low: Lower corner of the box, shape (2,) [length].
        high: Upper corner, shape (2,) [length].

    Returns:
        Points in the obstacle's frame (n, 2) [length], ends of the segments (m, 2), and
        displacements of the points (n, 2) [length].
    """
    lines = _zeros(obstacle, low, high) or [np.tile(obstacle.pivot + obstacle.place[:2], (2, 1))]
    points = np.concatenate(lines)
    first = np.setdiff1d(np.arange(len(points)), np.cumsum([len(line) for line in lines]) - 1)
    own = obstacle.to_own_frame(points)
    return own, np.stack([first, first + 1], axis=1), points - own


def _zeros(obstacle: Obstacle, low: Array, high: Array) -> list[Array]:
    """Polylines phi = 0 in a box, each (n, 2) [length] (local)."""
    from matplotlib.figure import Figure

    x, y, points = grid(low, high)
    phi = obstacle.evaluate(points)[0].reshape(GRID, GRID)
    if not phi.min() < 0.0 < phi.max():
        return []
    lines = Figure().add_subplot().contour(x, y, phi, [0.0]).allsegs[0]
    for _ in range(2):  # Newton steps from the chords of the grid to the curve
        fields = [obstacle.evaluate(line) for line in lines]
        lines = [
            line - (phi / (gradient**2).sum(axis=1))[:, None] * gradient
            for line, (phi, gradient, _) in zip(lines, fields, strict=True)
        ]
    return lines


def grid(low: Array, high: Array) -> tuple[Array, Array, Array]:
    """Grid in the box from ``low`` to ``high``, each (2,) [length] (local).

    Returns:
        Coordinates x and y, each (GRID,), and points (GRID^2, 2) [length].
    """
    x, y = (np.linspace(a, b, GRID) for a, b in zip(low, high, strict=True))
    return x, y, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
