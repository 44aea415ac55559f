# SPDX-License-Identifier: MIT
"""Rigid obstacles inside bodies: points of an obstacle below the outlines of bodies.

A small obstacle inside a body need not contain any node of the mesh. Therefore points of the
obstacle are located in the bodies: the points nearest to the slave nodes and its salient points.
If a user's function is not a distance, x + phi n may miss the obstacle; such points are left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.outline import Outline
from fenics_mortar.kernels.passage import depths_inside
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.verify.limits import LIMITS


class Deepest(NamedTuple):
    """The point of an obstacle that is deepest in a body.

    Attributes:
        depth: Depth less the overlap admitted by the offset [length]; zero if no point is inside.
        facets: The same over the length of the nearest facet [1].
        point: Position, shape (2,) [length].
        segment: Nearest segment of the outlines.
    """

    depth: float
    facets: float
    point: Array
    segment: int


def deepest_point(contact: Contact, outline: Outline, slave: Indices, x: Array) -> Deepest:
    """Find the point of an obstacle that is deepest in a body of the slave (local).

    Args:
        contact: A pair with an obstacle, evaluated at the present state.
        outline: Outlines of the bodies.
        slave: Numbers of the slave nodes in the outlines, shape (slave nodes,).
        x: Positions of the outlines' nodes, shape (n, 2) [length].
    """
    o = contact.now.on_obstacle
    points = np.concatenate([o.nearest_points(), o.obstacle.to_space(o.obstacle.salient_points())])
    lengths, bodies = outline.lengths(x), outline.segment_bodies
    deepest = Deepest(0.0, 0.0, np.zeros(2), -1)
    admitted = max(-float(contact.now.offset.min(initial=0.0)), 0.0)
    for body in np.unique(outline.bodies[slave]):
        mine = x[outline.bodies == body]
        near = points[((points > mine.min(axis=0)) & (points < mine.max(axis=0))).all(axis=1)]
        rows = depths_inside(x, outline.segments, bodies, body, near)
        rows[:, 0] -= admitted
        inside = rows[:, 0] > 0.0
        if not inside.any():
            continue
        near, depths, nearest = near[inside], rows[inside, 0], rows[inside, 1].astype(np.int64)
        facets = depths / lengths[nearest]
        facets[o.obstacle.evaluate(near)[0] > LIMITS.coarse_distance * lengths[nearest]] = 0.0
        first = int(np.argmax(facets))
        if facets[first] > deepest.facets:
            depth, segment = float(depths[first]), int(nearest[first])
            deepest = Deepest(depth, float(facets[first]), near[first], segment)
    return deepest
