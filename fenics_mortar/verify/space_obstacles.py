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
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arrays import Array, Flags, Indices, norms
from fenics_mortar.utils.errors import call_together, format_point
from fenics_mortar.utils.rounding import ROUNDING
from fenics_mortar.verify.crossing import Crossing
from fenics_mortar.verify.finding import LIMITS
from fenics_mortar.verify.node_paths import RigidPath, motion_of
from fenics_mortar.verify.overlap import OutlineNames, obstacle_depths
from fenics_mortar.verify.space_admitted import HINTS, Kind, SpaceAdmitted, remark_of
from fenics_mortar.verify.space_passages import SpacePassages, SpacePaths
from fenics_mortar.verify.through_obstacles import nodes_through, own_frame

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

    def depths_in(self, x: Array, points: Array, body: int) -> tuple[Array, Array, Indices]:
        """Depths of the obstacle in a body, see ``obstacle_depths`` (collective)."""
        at = self.hull, x, body, points, self.offset()
        return obstacle_depths(*at, lambda points: self._evaluate(points)[0])

    @property
    def contacts(self) -> list[Contact]:
        """The pairs with the obstacle."""
        return [contact for contact, _ in self._pairs]


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
        """The deepest point of each obstacle in each body by kinds, with nodes at ``x`` (n, 3)."""
        sizes = self._hull.lengths(x)
        for each in self._each:
            points = each.points(x)
            kinds, limits = self._admitted.at_obstacle(x, each.near_slave, each.contacts)
            for body in each.bodies.tolist():
                depths, at, triangles = each.depths_in(x, points, body)
                for kind in np.unique(kinds[triangles]).tolist():
                    facets = np.where(kinds[triangles] == kind, depths / sizes[triangles], 0.0)
                    k = int(facets.argmax())
                    t = int(triangles[k])
                    sides = self._names.segment(t), f"obstacle '{each.obstacle.name}'"
                    measures = float(depths[k]), float(facets[k]), float(limits[t])
                    told = kind != Kind.UNPAIRED, HINTS.get(kind, ""), remark_of(kind)
                    yield Crossing(sides, format_point(at[k]), *measures, *told)

    def motions(self, before: Array, after: Array) -> dict[int, RigidPath]:
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
        knots = own_frame(obstacle, paths.seen_from(each.label)[:, nodes], place)
        x1 = paths.along[-1]
        given = knots, each.offset()[nodes], self._hull.node_sizes(x1)[nodes]

        def name(first: int) -> str:
            return self._names.node(int(nodes[first]))

        return nodes_through(self._hull.comm, obstacle, given, x1[nodes], name)

    def _points_through(
        self, each: SpaceObstacle, paths: SpacePaths, through: SpacePassages
    ) -> Iterator[str]:
        """Messages on points of an obstacle that went through bodies."""
        motion = paths.motions[each.label]
        begin = motion.back(each.points(paths.along[-1]), 1.0)
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
