# SPDX-License-Identifier: MIT
"""Crossed surfaces in space: bodies that overlap in a state, and passages in a step.

The counterpart of ``crossing``, with the same meaning of depths and limits: after each solve the
hulls of all bodies in pairs are checked, independently of the search for partners; ``overlaps``
finds the points inside bodies, ``space_admitted`` the depths that the discretization admits,
``space_passages`` the passages.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from fenics_mortar.interface.outline import extract_hull
from fenics_mortar.utils.arrays import HALF_FACET, SMALL_ANGLE, Array, Flags, Indices
from fenics_mortar.utils.errors import MeshError, format_point
from fenics_mortar.verify.crossing import Crossings
from fenics_mortar.verify.finding import LIMITS, Crossing
from fenics_mortar.verify.node_paths import RigidPath, motion_of
from fenics_mortar.verify.passages import found_either_way
from fenics_mortar.verify.space_admitted import (
    ACROSS,
    ALWAYS,
    HINTS,
    TIP,
    Kind,
    Overlaps,
    SpaceAdmitted,
    find_overlaps,
    remark_of,
)
from fenics_mortar.verify.space_passages import SpaceObstacles, SpacePassages, SpacePaths

# Bodies of a point and of the triangle above it, ascending.
Bodies = tuple[int, int]

# A further remedy where nodes of the slave carry no force: the nodes of the other side may.
_OTHER_ROLES = f"{TIP}, or exchange slave and master"


class SpaceCrossings(Crossings):
    """Detection of crossings and passages in space; see ``Crossings``."""

    extract = staticmethod(extract_hull)

    def _prepare(self) -> None:
        """See ``Crossings``."""
        self._in_space = SpaceAdmitted(self.outline, self._contacts)
        self._found_at: tuple[Array, Overlaps] | None = None
        self._excused = self._overlaps_as_meshed()
        self._through = SpacePassages(self.outline, self._names, self._excused)
        self._obstacles = SpaceObstacles(
            self.outline, self._contacts, self._slaves, self._names, self._in_space
        )

    def find(self) -> list[Crossing]:
        """See ``Crossings``: of two bodies up to one for each ``Kind``."""
        x = self._positions()
        overlaps, across = self._in_space.measured(x, self._overlaps(x))
        kinds = self._in_space.kinds(overlaps)
        through = (kinds == Kind.UNPAIRED) & self._in_space.are_through(x, overlaps)
        kinds[through] = Kind.THROUGH
        limits = self._in_space.of(x, overlaps, kinds)
        facets = self._facets(x, overlaps, self._allowed(x))
        found = list[Crossing]()
        for kind in Kind:
            at = np.flatnonzero((kinds == kind) & (facets > 0.0))
            found += self._deepest_of(overlaps.select(at), facets[at], limits[at], across[at], kind)
        found += self._obstacles.find(x, self._prescribed)
        return sorted(found, key=lambda crossing: -crossing.facets)

    def _overlaps(self, x: Array) -> Overlaps:
        """``find_overlaps`` at positions ``x`` (n, 3), kept for the next call."""
        if self._found_at is None or not np.array_equal(self._found_at[0], x):
            self._found_at = x, find_overlaps(self.outline, x)
        return self._found_at[1]

    def _facets(self, x: Array, overlaps: Overlaps, allowed: Array) -> Array:
        """Depths over the larger facet, without overlaps ``allowed`` (n,) [length], (k,) [1]."""
        hull, (nodes, triangles, depths, _) = self.outline, overlaps
        sizes = hull.node_sizes(x)[nodes].max(axis=1, initial=0.0)
        sizes = np.maximum(sizes, hull.lengths(x)[triangles])
        slack = np.maximum(
            allowed[nodes].max(axis=1), allowed[hull.segments[triangles]].max(axis=1)
        )
        return np.asarray((depths - slack) / sizes)

    def _bodies_of_overlaps(self, overlaps: Overlaps) -> Indices:
        """The two bodies of each overlap, ascending, shape (k, 2)."""
        nodes, triangles, _, _ = overlaps
        both = self.outline.bodies[nodes[:, 0]], self.outline.segment_bodies[triangles]
        return np.sort(np.stack(both, axis=1), axis=1)

    def _firsts(self, overlaps: Overlaps, sizes: Array) -> dict[Bodies, int]:
        """The overlap with the largest of ``sizes`` (k,) of each two bodies."""
        bodies, found = self._bodies_of_overlaps(overlaps).tolist(), dict[Bodies, int]()
        for k in np.argsort(-sizes, kind="stable").tolist():
            found.setdefault((bodies[k][0], bodies[k][1]), k)
        return found

    def _deepest_of(
        self, overlaps: Overlaps, facets: Array, limits: Array, across: Flags, kind: Kind
    ) -> Iterator[Crossing]:
        """The deepest of the overlaps of each two bodies, over their ``limits`` (k,)."""
        in_contact = self._in_space.are_in_contact(overlaps)
        for bodies, k in self._firsts(overlaps, facets / limits).items():
            excused = 0.0 if in_contact[k] else self._excused.get(bodies, 0.0)
            depth = float(facets[k]) - excused
            if depth > 0.0:
                sides = (
                    self._names.node(int(overlaps.nodes[k, 0])),
                    self._names.segment(int(overlaps.triangles[k])),
                )
                where = format_point(overlaps.points[k])
                measures = float(overlaps.depths[k]), depth, float(limits[k])
                hint = HINTS.get(kind, "") + _OTHER_ROLES * (kind == Kind.UNLOADED)
                is_across = bool(across[k])
                told = hint + ACROSS * is_across, ALWAYS if is_across else remark_of(kind)
                yield Crossing(sides, where, *measures, kind != Kind.UNPAIRED, *told)

    def _overlaps_as_meshed(self) -> dict[Bodies, float]:
        """See ``Crossings``: overlap of bodies in the mesh [facets]."""
        hull, found = self.outline, dict[Bodies, float]()
        overlaps = find_overlaps(hull, hull.X)
        self._refuse_double_cover(overlaps)
        overlaps = overlaps.select(~self._in_space.are_in_contact(overlaps))
        facets = self._facets(hull.X, overlaps, np.zeros(len(hull.X)))
        for bodies, k in self._firsts(overlaps, facets).items():
            if bodies[0] == bodies[1] or facets[k] <= HALF_FACET:
                found[bodies] = float(facets[k])
            elif bodies not in self._in_contact:
                found[bodies] = np.inf
        return found

    def _refuse_double_cover(self, overlaps: Overlaps) -> None:
        """Refuse a body inside another one or itself, as ``bulk.bodies`` in the plane.

        Args:
            overlaps: Those of the mesh.

        Raises:
            MeshError: On all ranks; the message has a position.
        """
        hull, (nodes, triangles, _, points) = self.outline, overlaps
        is_node = nodes[:, 0] == nodes[:, 1]
        inner, outer = hull.bodies[nodes[:, 0]], hull.segment_bodies[triangles]
        at_same = hull.bodies[nodes[:, 0]] == outer
        for one, other in np.unique(np.stack([inner, outer])[:, is_node & ~at_same], axis=1).T:
            mine = is_node & (inner == one) & (outer == other)
            if mine.sum() == (hull.bodies == one).sum():
                raise MeshError(
                    f"the body around {format_point(points[mine].mean(axis=0))} lies inside "
                    f"another one, which has no hole there: cut {self._names.body(int(other))}"
                )
        limits = self._in_space.of(hull.X, overlaps, np.full(len(nodes), int(Kind.UNPAIRED)))
        depths = self._facets(hull.X, overlaps, np.zeros(len(hull.X)))
        itself = at_same & (depths > limits) & ~self._in_space.are_in_contact(overlaps)
        if itself.any():
            where = format_point(points[np.argmax(itself)])
            raise MeshError(f"a body overlaps itself at {where}; correct the mesh")

    def nodes_inside(self) -> list[Indices]:
        """Nodes of the bodies of each pair inside another body of it, global numbers."""
        x = self._positions()
        overlaps = self._overlaps(x)
        is_node = overlaps.nodes[:, 0] == overlaps.nodes[:, 1]
        is_node &= self._facets(x, overlaps, self._allowed(x)) > LIMITS.unpaired
        nodes, bodies = overlaps.nodes[:, 0], self._bodies_of_overlaps(overlaps)
        return [
            np.unique(self.outline.nodes[nodes[is_node & np.isin(bodies, pair).all(axis=1)]])
            for pair in self._of_pairs
        ]

    def passages_of_step(self, places: Array) -> tuple[list[str], list[str]]:
        """See ``Crossings``; of bodies that values turn in space the other sense is examined."""
        (x0, before), x1 = (self.accepted.x, self.accepted.places), self._positions()
        known = self._known()
        turns = any(motion.angle for motion in known.values())
        bodies_rest = np.array_equal(x0, x1) and not turns
        if not len(x0) or (bodies_rest and np.array_equal(before, places)):
            return [], []
        resolution = LIMITS.coarse_distance * float(self.outline.lengths(x1).min())
        motions = self._obstacles.motions(before, places)

        def messages(backwards: Collection[int]) -> list[str]:
            given = self.outline.bodies, motions, resolution, known, backwards
            paths = SpacePaths(x0, x1, *given)
            found = [] if bodies_rest else self._through.find(paths)
            return found + self._obstacles.passages(paths, self._through, before)

        doubtful, found = self.led.parts(self.led.doubtful(x0, x1)), messages(())
        return found_either_way(found, "sense", messages(doubtful)) if doubtful else (found, [])

    def _known(self) -> dict[int, RigidPath]:
        """Motions of bodies by rigid boundaries that their prescribed nodes followed."""
        (x0, x1), found = (self.accepted.x, self._positions()), dict[int, RigidPath]()
        led = zip(self._leaders.items(), self.accepted.leaders, self._led(), strict=True)
        for (body, leader), *ends in led:
            motion = motion_of(leader, *ends)
            mine = self._prescribed & (self.outline.bodies == body)
            apart = motion.carry(x0[mine], 1.0) - x1[mine]
            size = float(np.abs(x0[mine] - motion.start).max(initial=0.0))
            if np.abs(apart).max(initial=0.0) <= SMALL_ANGLE * size:
                found[body] = motion
        return found
