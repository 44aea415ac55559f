# SPDX-License-Identifier: MIT
"""Rigid obstacles in space inside bodies, and passages of bodies and obstacles through each other.

**A state.** As in the plane, see ``overlap``, points of an obstacle are located in the bodies:
those nearest to the nodes of a body and to points of its facets near the obstacle, and the salient
points of the obstacle. So an obstacle is found between the nodes, at any side of a body, and inside
it.
Of a body that the obstacle covers away from the pair when the problem is set up, only the slave
counts, as of one that hangs over the edge of a floor, which is given as a plane.

**A step.** Nodes of the bodies are followed through the obstacle, see ``through_obstacles``, and
the points of the obstacle through the bodies, see ``space_passages``. The rotation of an obstacle
about an axis is known, whatever its angle; between rotations about different axes it turns on the
shortest way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.hull import Hull
from fenics_mortar.kernels.space.inside import depths_inside
from fenics_mortar.kernels.tree import build_tree
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.obstacles.rigid_motion import RigidMotion as Mover
from fenics_mortar.obstacles.rotations import rotation_by
from fenics_mortar.utils.arrays import Array, Flags, Indices, norms
from fenics_mortar.utils.errors import call_together, format_point
from fenics_mortar.utils.rounding import ROUNDING
from fenics_mortar.verify.crossing import Crossing
from fenics_mortar.verify.finding import LIMITS
from fenics_mortar.verify.overlap import OutlineNames
from fenics_mortar.verify.passages import ADVICE
from fenics_mortar.verify.space_admitted import SpaceAdmitted
from fenics_mortar.verify.space_passages import RigidMotion, SpacePassages, SpacePaths
from fenics_mortar.verify.through_obstacles import passed_through

# Points of a triangle near an obstacle, weights of its corners: a grid of a quarter of its sides.
_PARTS = 4
WITHIN = np.array(
    [(i, j, _PARTS - i - j) for i in range(_PARTS + 1) for j in range(_PARTS + 1 - i)]
) / float(_PARTS)


class SpaceObstacle:
    """An obstacle, the bodies that it touches, and where these may be inside it.

    Args:
        number: Number of the obstacle.
        obstacle: The obstacle.
        pairs: The pairs with it, and the numbers of the slave nodes of each in the hull.
        hull: The hulls of the bodies.
    """

    def __init__(
        self,
        number: int,
        obstacle: Obstacle,
        pairs: Sequence[tuple[Contact, Indices]],
        hull: Hull,
    ) -> None:
        self.label, self.obstacle, self.hull = -1 - number, obstacle, hull
        self._pairs = pairs
        self._slave = np.concatenate([np.empty(0, np.int64), *(nodes for _, nodes in pairs)])
        self.bodies = np.unique(hull.bodies[self._slave])
        self.near_slave: Flags = np.zeros(len(hull.segments), bool)
        for contact, _ in pairs:
            self.near_slave |= hull.near(contact.slave)
        self.counted: Flags = np.isin(hull.bodies, self.bodies)
        self._leave_out_covered()

    def _leave_out_covered(self) -> None:
        """Count the slave only, of bodies with other nodes inside the obstacle at set-up."""
        hull, on_slave = self.hull, np.zeros(len(self.hull.X), bool)
        on_slave[hull.segments[self.near_slave]] = True
        at = np.flatnonzero(self.counted & ~on_slave)
        depth = -self._evaluate(hull.X[at])[0]
        covered = at[depth > LIMITS.unpaired * hull.node_sizes(hull.X)[at]]
        on_slave[:] = False
        on_slave[self._slave] = True
        self.counted &= on_slave | ~np.isin(hull.bodies, hull.bodies[covered])

    def _evaluate(self, x: Array) -> tuple[Array, Array]:
        """Distances (k,) and gradients (k, 3) at points; an error is one on all ranks."""
        what = f"the distance of '{self.obstacle.name}'"
        call = partial(self.obstacle.evaluate, x)
        return call_together(self.hull.comm, what, call)[:2]

    def offset(self) -> Array:
        """Overlap of the nodes that pairs admit is -offset, shape (n,) [length]."""
        offset = np.zeros(len(self.hull.X))
        for contact, there in self._pairs:
            offset[there] = contact.now.offset
        return offset

    def points(self, x: Array) -> Array:
        """Points of the obstacle that may be inside a body with nodes at ``x``, (k, 3) [length]."""
        at = np.concatenate([x[self.counted], self._points_near(x)])
        phi, gradient = self._evaluate(at)
        nearest = at - (phi / (gradient**2).sum(axis=1))[:, None] * gradient
        own = self.obstacle.to_own_frame(x[self.counted])
        salient = self.obstacle.to_space(self.obstacle.salient_points_near(own))
        return np.concatenate([nearest, salient])

    def _points_near(self, x: Array) -> Array:
        """Points of triangles that the obstacle may cross, shape (k, 3) [length]."""
        corners = x[self.hull.segments[self.counted[self.hull.segments].all(axis=1)]]
        middles = corners.mean(axis=1)
        reach = norms((corners - middles[:, None]).reshape(-1, 3)).reshape(-1, 3).max(axis=1)
        near = self._evaluate(middles)[0] <= reach
        return np.einsum("qk,tkc->tqc", WITHIN, corners[near]).reshape(-1, 3)

    def deepest_in(self, x: Array, points: Array, body: int) -> tuple[float, float, Array, int]:
        """The point deepest in a body: depth [length], [facet sizes], the point, its triangle.

        The overlap admitted by offsets is left out. Points that are not on the obstacle, since a
        user's function is no distance, do not count.
        """
        hull, mine = self.hull, np.flatnonzero(self.hull.segment_bodies == body)
        triangles, sizes = hull.segments[mine], hull.lengths(x)[mine]
        boxes = build_tree(x, triangles)
        at = points[((points > boxes[1, :3]) & (points < boxes[1, 3:])).all(axis=1)]
        depths, nearest = depths_inside(x, triangles, boxes, at, float(np.median(sizes)))
        at, depths, nearest = at[nearest >= 0], depths[nearest >= 0], nearest[nearest >= 0]
        depths = depths - max(-float(self.offset().min(initial=0.0)), 0.0)
        facets = depths / sizes[nearest]
        facets[np.abs(self._evaluate(at)[0]) > LIMITS.coarse_distance * sizes[nearest]] = 0.0
        if not (facets > 0.0).any():
            return 0.0, 0.0, np.zeros(3), -1
        first = int(np.argmax(facets))
        return float(depths[first]), float(facets[first]), at[first], int(mine[nearest[first]])


class SpaceObstacles:
    """Detection of obstacles inside bodies and of passages; all methods are collective.

    Args:
        hull: The hulls of the bodies.
        contacts: All pairs.
        slaves: Numbers of the slave nodes of each pair in the hulls.
        names: Names of nodes and bodies.
        admitted: Depths that the discretization admits.
    """

    def __init__(
        self,
        hull: Hull,
        contacts: Sequence[Contact | Tie],
        slaves: Sequence[Indices],
        names: OutlineNames,
        admitted: SpaceAdmitted,
    ) -> None:
        self._hull, self._names, self._admitted = hull, names, admitted
        pairs = dict[Obstacle, list[tuple[Contact, Indices]]]()
        for contact, there in zip(contacts, slaves, strict=True):
            if isinstance(contact, Contact) and contact.obstacle is not None:
                pairs.setdefault(contact.obstacle, []).append((contact, there))
        self._each = [
            SpaceObstacle(number, obstacle, mine, hull)
            for number, (obstacle, mine) in enumerate(pairs.items())
        ]

    def find(self, x: Array) -> Iterator[Crossing]:
        """The deepest point of each obstacle in each body, with nodes at ``x`` (n, 3)."""
        for each in self._each:
            points = each.points(x)
            for body in each.bodies.tolist():
                depth, facets, where, triangle = each.deepest_in(x, points, body)
                if triangle < 0:
                    continue
                paired = bool(each.near_slave[triangle])
                limit = self._admitted.at_obstacle(x, triangle, paired=paired)
                sides = self._names.segment(triangle), f"obstacle '{each.obstacle.name}'"
                yield Crossing(sides, format_point(where), depth, facets, limit, paired)

    def motions(self, before: Array, after: Array) -> dict[int, RigidMotion]:
        """Motions of the obstacles in a step, by label.

        Args:
            before: Places at the start, shape (obstacles, 6) [length, radian].
            after: Places at the end.
        """
        return {
            each.label: motion_of(each.obstacle, *places)
            for each, *places in zip(self._each, before, after, strict=True)
        }

    def passages(self, paths: SpacePaths, through: SpacePassages, before: Array) -> list[str]:
        """Messages on nodes through obstacles, and on obstacles through bodies.

        Args:
            paths: Paths of the nodes and the obstacles.
            through: Detection of passages through bodies.
            before: Places of the obstacles at the start, shape (obstacles, 6) [length, radian].
        """
        messages = list[str]()
        for each, place in zip(self._each, before, strict=True):
            found = self._nodes_through(each, paths, place)
            messages += found or self._points_through(each, paths, through)
        return messages

    def _nodes_through(self, each: SpaceObstacle, paths: SpacePaths, place: Array) -> list[str]:
        """Message on nodes of bodies that went through an obstacle, which began at ``place``."""
        obstacle, nodes = each.obstacle, np.flatnonzero(each.counted)
        knots = paths.seen_from(each.label)[:, nodes] @ rotation_by(place[3:]) + obstacle.pivot
        x1 = paths.along[-1]
        given = knots, each.offset()[nodes], self._hull.node_sizes(x1)[nodes]
        what, call = f"the distance of '{obstacle.name}'", partial(passed_through, obstacle, *given)
        depth = call_together(self._hull.comm, what, call)
        count = int((depth > 0.0).sum())
        if not count:
            return []
        first = nodes[np.argmax(depth)]
        return [
            f"{count} nodes of {self._names.node(int(first))} went through obstacle "
            f"'{obstacle.name}', and one at {format_point(x1[first])} ended {depth.max():.3g} "
            f"beyond its surface, {ADVICE}"
        ]

    def _points_through(
        self, each: SpaceObstacle, paths: SpacePaths, through: SpacePassages
    ) -> Iterator[str]:
        """Messages on points of an obstacle that went through bodies."""
        motion = paths.motions[each.label]
        there = each.points(paths.along[-1])
        begin = motion.start + motion.turned(there - motion.end, -1.0)
        for body in each.bodies.tolist():
            of_points = paths.seen_from(body, paths.carried(motion, begin))
            along = np.concatenate([paths.seen_from(body), of_points], axis=1)
            moved = np.abs(of_points - of_points[0]).max(axis=(0, 2))
            marked = np.arange(along.shape[1]) >= len(self._hull.X)
            marked[marked] = moved > ROUNDING * np.abs(of_points).max(initial=0.0)
            passed = through.nodes_through(along, body, marked)
            if len(passed.ends):
                who = f"{len(passed.ends)} points of obstacle '{each.obstacle.name}'"
                yield through.message(who, passed, along[-1], body)


def motion_of(mover: Mover, before: Array, after: Array) -> RigidMotion:
    """Motion of an obstacle or a boundary to its present place, (6,) [length, radian] (local)."""
    pivot = mover.pivot
    return RigidMotion(pivot + before[:3], pivot + after[:3], mover.turn_since(before))
