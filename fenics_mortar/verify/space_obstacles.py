# SPDX-License-Identifier: MIT
"""Rigid obstacles in space inside bodies, and passages of bodies and obstacles through each other.

**A state.** As in the plane, see ``overlap``, points of an obstacle are located in the bodies:
those nearest to the nodes of a body and to points of its facets near the obstacle, and the salient
points of the obstacle. So an obstacle is found between the nodes, at any side of a body, and inside
it. Of a body that the obstacle covers away from the pair when the problem is set up, only the slave
counts, as of one that hangs over the edge of a floor, which is given as a plane.

**A step.** Nodes of the bodies are followed through the obstacle, see ``passages``, and the points
of the obstacle through the bodies. The rotation of an obstacle about an axis is known, whatever its
angle; between rotations about different axes it turns on the shortest way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_mortar.obstacles.rigid_motion import at_place
from fenics_mortar.utils.arrays import TINY, Array, Flags, Indices, first_largest, norms
from fenics_mortar.utils.errors import call_together, format_point
from fenics_mortar.verify import space_admitted
from fenics_mortar.verify.finding import LIMITS, Crossing
from fenics_mortar.verify.obstacle_passages import nodes_off_pairs, nodes_through
from fenics_mortar.verify.overlap import OutlineNames, held_inside, obstacle_depths

if TYPE_CHECKING:
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.interface.outline import Hull
    from fenics_mortar.obstacles.obstacle import Fields, Obstacle


# Points of a triangle near an obstacle, weights of its corners: a grid of a quarter of its sides.
_PARTS = 4
WITHIN = np.array(
    [(i, j, _PARTS - i - j) for i in range(_PARTS + 1) for j in range(_PARTS + 1 - i)]
) / float(_PARTS)


# Length of the edges of facets over the radius of curvature of an obstacle [1] with which a node
# carries force before the obstacle has entered a facet by a tenth: measured with spheres.
OF_RADIUS = 0.5
# Radius over the size of a facet [1] below which an obstacle is a tip or an edge.
SHARP = 0.1
# The same above which it is flat [1], and what enters a facet is an edge beside this point.
FLAT = 1e6


class SpaceObstacle:
    """An obstacle, inside bodies that it touches, and passages; all methods are collective.

    Args:
        number: Number of the obstacle.
        obstacle: The obstacle.
        pairs: The pairs with it, and the numbers of the slave nodes of each in the hull.
        hull: The hulls of the bodies.
        names: Names of nodes and bodies.
        admitted: Depths that the discretization admits.
    """

    def __init__(
        self, number: int, obstacle: Obstacle, pairs: Sequence[tuple[Contact, Indices]], hull: Hull,
        names: OutlineNames, admitted: space_admitted.SpaceAdmitted,
    ) -> None:  # fmt: skip
        self.label, self.obstacle, self.hull = -1 - number, obstacle, hull
        self._pairs, self._names, self._admitted = pairs, names, admitted
        self._name = f"obstacle '{obstacle.name}'"
        self._slave = np.concatenate([np.empty(0, np.int64), *(nodes for _, nodes in pairs)])
        self.bodies = np.unique(hull.bodies[self._slave])
        self.near_slave: Flags = np.zeros(len(hull.segments), bool)
        self._on_slave = np.zeros_like(self.near_slave)
        for contact, _ in pairs:
            self.near_slave |= hull.near(contact.slave)
            self._on_slave |= hull.are_of(contact.slave)
        self.counted: Flags = np.isin(hull.bodies, self.bodies)
        self.counted &= nodes_off_pairs(obstacle, hull, self._slave)
        self.counted[self._slave] = True

    def _evaluate(self, x: Array) -> Fields:
        """``Obstacle.evaluate`` at points (k, 3); errors are raised on all ranks."""
        what = f"the distance of '{self.obstacle.name}'"
        return call_together(self.hull.comm, what, partial(self.obstacle.evaluate, x))

    def offset(self) -> Array:
        """Overlap of the nodes that pairs admit is -offset, shape (n,) [length]."""
        offset = np.zeros(len(self.hull.X))
        for contact, there in self._pairs:
            offset[there] = contact.now.offset
        return offset

    def points(self, x: Array, passed: Array | None = None) -> Array:
        """Points of the obstacle that may be inside a body with nodes at ``x``, (k, 3) [length].

        In a step salient ones are beside places that nodes ``passed`` (p, 3) [length], as seen from
        the obstacle.
        """
        sides = self.hull.segments[self.counted[self.hull.segments].all(axis=1)]
        at = np.concatenate([x[self.counted], self._points_near(x[sides])[0].reshape(-1, 3)])
        phi, gradient, _ = self._evaluate(at)
        nearest = at - (phi / (gradient**2).sum(axis=1))[:, None] * gradient
        own = self.obstacle.to_own_frame(x[self.counted] if passed is None else passed)
        salient = self.obstacle.to_space(self.obstacle.salient_points_near(own))
        return np.concatenate([nearest, salient])

    def _points_near(self, corners: Array) -> tuple[Array, Flags]:
        """Points of triangles that the obstacle may cross, (k, q, 3) [length], and which these are.

        ``corners``: of all triangles, shape (m, 3, 3) [length].
        """
        middles = corners.mean(axis=1)
        reach = norms((corners - middles[:, None]).reshape(-1, 3)).reshape(-1, 3).max(axis=1)
        near = self._evaluate(middles)[0] <= reach
        return np.einsum("qk,tkc->tqc", WITHIN, corners[near]), near

    def depths_in(
        self, x: Array, points: Array, body: int
    ) -> tuple[Array, space_admitted.Measured]:
        """Points of the obstacle in a body, (k, 3) [length], and their depths (collective).

        See ``obstacle_depths``, and ``below_marked`` with the triangles of the slave.
        """
        overlap = max(-float(self.offset().min(initial=0.0)), 0.0)
        at = self.hull, x, body, points, self.offset()
        depths, inside, nearest = obstacle_depths(*at, lambda p: np.abs(self._evaluate(p)[0]))
        first = space_admitted.Measured(depths + overlap, nearest, np.zeros(len(depths), bool))
        n = self._evaluate(inside)[1]
        found = space_admitted.below_marked(self.hull, x, inside, n, first, self._on_slave)
        return inside, found._replace(depths=found.depths - overlap)

    def needed(self, point: Array, size: float) -> str:
        """The facets that an obstacle needs at a point (3,), now of a size (collective).

        "" where it curves little, and the multipliers are to blame.
        """
        radius = 1.0 / max(float(np.linalg.eigvalsh(self._evaluate(point[None])[2][0])[-1]), TINY)
        if not SHARP * size < radius < FLAT * size:
            return space_admitted.TIP
        edges = f", to edges of at most {OF_RADIUS * radius:.2g}, half of the radius of the "
        return f"{edges}obstacle there" * (radius < size / OF_RADIUS)

    def comes_out(self, x: Array, body: int) -> tuple[float, Array, int]:
        """How far the obstacle comes out of a body, from within (collective).

        Returns:
            Largest depth of a point of the body's surface in the obstacle that comes from below it
            [length], zero without one; the point, shape (3,) [length]; and its triangle. The side
            of a pair does not count.
        """
        hull = self.hull
        mine = (hull.segment_bodies == body) & ~self.near_slave
        mine &= self.counted[hull.segments].all(axis=1)
        at = np.flatnonzero(mine)
        points, near = self._points_near(x[hull.segments[at]])
        at = at[near]
        phi, gradient, _ = self._evaluate(points.reshape(-1, 3))
        outward = np.einsum("tqc,tc->tq", gradient.reshape(points.shape), hull.normals(x)[at])
        depths = np.where(outward > space_admitted.AWAY, -phi.reshape(outward.shape), 0.0)
        t, q = np.unravel_index(depths.argmax(), depths.shape) if len(at) else (0, 0)
        if not depths.max(initial=0.0) > 0.0:
            return 0.0, np.zeros(3), 0
        return float(depths[t, q]), points[t, q], int(at[t])

    def find(self, x: Array, prescribed: Flags) -> Iterator[Crossing]:
        """The deepest point of the obstacle in each body, over its limit, for each kind.

        Args:
            x: Positions of the nodes, shape (n, 3) [length].
            prescribed: Whether a node is prescribed, shape (n,), bool.
        """
        points = self.points(x)
        pairs = [contact for contact, _ in self._pairs]
        admitted = self._admitted.at_obstacle(x, self.near_slave, pairs)
        for body in self.bodies.tolist():
            mine = np.flatnonzero(prescribed & self.counted & (self.hull.bodies == body))
            found = held_inside(self.obstacle, self.hull, x, mine, self.offset(), self._names)
            yield from found
            led = "".join(crossing.hint for crossing in found)
            measured = self.depths_in(x, points, body)
            yield from self._deepest(x, *measured, admitted, led)
            yield from self._coming_out(x, body, led)

    def _deepest(
        self, x: Array, at: Array, measured: space_admitted.Measured, admitted: Any, led: str
    ) -> Iterator[Crossing]:
        """The deepest of points ``at`` (k, 3), over its limit, for each kind (collective)."""
        (kinds, limits), (depths, triangles, across) = admitted, measured
        sizes = self.hull.lengths(x)
        facets, mine = depths / sizes[triangles], kinds[triangles]
        for kind in np.unique(mine).tolist():
            k = first_largest(np.where(mine == kind, facets / limits[triangles], 0.0))
            t, is_across = int(triangles[k]), bool(across[k])
            hint = self._admitted.hint(kind, self.needed(at[k], float(sizes[t])))
            hint = led * bool(facets[k] > limits[t]) or hint + space_admitted.ACROSS * is_across
            yield Crossing(
                self._sides(t), format_point(at[k]), float(depths[k]), float(facets[k]),
                float(limits[t]), kind != space_admitted.Kind.UNPAIRED or led == hint != "", hint,
                space_admitted.ALWAYS if is_across else space_admitted.remark_of(kind),
            )  # fmt: skip

    def _coming_out(self, x: Array, body: int, led: str) -> Iterator[Crossing]:
        """Where an obstacle has gone through a thin body (collective)."""
        depth, point, t = self.comes_out(x, body)
        if depth > 0.0:
            facets, hint = (
                depth / float(self.hull.lengths(x)[t]),
                led or space_admitted.HINTS[space_admitted.Kind.THROUGH],
            )
            at = self._sides(t), format_point(point), depth, facets, LIMITS.unpaired
            yield Crossing(*at, hint=hint)

    def _sides(self, triangle: int) -> tuple[str, str]:
        """Names of the surface of a triangle and of the obstacle (collective)."""
        return self._names.segment(triangle), self._name

    def passages(self, seen: Array, place: Array, x1: Array) -> list[str]:
        """Messages on nodes through the obstacle.

        Args:
            seen: Paths of the k counted nodes in its frame, shape (m + 1, k, 3) [length].
            place: Place of the obstacle at the start, shape (6,) [length, radian].
            x1: Positions of the nodes at the end, shape (n, 3) [length].
        """
        nodes = np.flatnonzero(self.counted)
        with at_place(self.obstacle, place):
            knots = self.obstacle.to_own_frame(seen)
        given = knots, self.offset()[nodes], self.hull.node_sizes(x1)[nodes]

        def name(first: int) -> str:
            return self._names.node(int(nodes[first]))

        return nodes_through(self.hull.comm, self.obstacle, given, x1[nodes], name)
