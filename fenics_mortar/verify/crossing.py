# SPDX-License-Identifier: MIT
"""Crossed surfaces: bodies that overlap in a state, and passages of nodes in a step.

After each solve all exterior facets of the bodies in pairs are checked, against other bodies and
their own body, independently of the search for partners; in the plane by ``Crossings``, in space by
``SpaceCrossings``.

**State**: depth of two outlines in each other where they cross, in facets. Faceted curves in
contact overlap by their sagitta, and between nodes dual multipliers admit overlaps of this size;
the limits are those of the penetration of a pair, and smaller without a pair: ``overlap``.

**Step**: paths from the last accepted state, or the present one if free dofs of ``u`` were set; see
``passages``.

Cost on two blocks (``demos.studies.performance.crossing``): 0.9 ms with 10,500 unknowns (1.9 % of a
Newton iteration), 2.6 ms with 161,000 (0.4 %), and about as much for the step. Many bodies cost
more: 30 bricks with 1,200 segments 10 ms.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_mortar.bulk.bodies import label_bodies
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.outline import extract_hull, extract_outline
from fenics_mortar.kernels.crossing import find_crossings
from fenics_mortar.kernels.passage import depths_inside
from fenics_mortar.utils.arrays import HALF_FACET, at_rows, descending, first_largest
from fenics_mortar.utils.errors import MeshError, format_point
from fenics_mortar.verify import overlap, space_admitted
from fenics_mortar.verify.finding import LIMITS, Crossing, paired_nodes
from fenics_mortar.verify.node_paths import AcceptedPositions, LedBodies, StepEnds
from fenics_mortar.verify.obstacle_passages import pairs_of_obstacles
from fenics_mortar.verify.passages import Passages, SpacePassages
from fenics_mortar.verify.space_obstacles import SpaceObstacle

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.interface.curve_surface import Curve
    from fenics_mortar.rigid.body_motions import BodyMotions
    from fenics_mortar.utils.arrays import Array, Flags, Indices


# What a body without a pair with an obstacle needs.
NO_PAIR = "; the body has no pair with this obstacle, which does not stop it: add a ContactPair"
GOES_ON = ", or an obstacle in the place of this one that ends where its solid does"
# What is wrong where boundary conditions hold both sides of a crossing.
BOTH_HELD = (
    "; boundary conditions prescribe nodes of both sides there, which no contact can keep apart: "
    "end the motion before"
)


class Crossings:
    """Detection of crossings and passages; all methods are collective.

    Args:
        bulk: The bulk equations.
        contacts: All pairs.
        floating: Bodies and their names.
        others: For those without a pair alone: the bodies in pairs, shape (k,), whose overlaps with
            each other do not count.

    Attributes:
        accepted: Positions at the start of the step.
        in_step: Detection of passages.
        led: Bodies that prescribed values turn.
    """

    extract: Callable[..., Any] = staticmethod(extract_outline)

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Interface], floating: BodyMotions,
        others: Indices | None = None,
    ) -> None:  # fmt: skip
        self._bulk, self._contacts, self._others = bulk, contacts, others
        self._labels, count = label_bodies(bulk.V)
        sides = [[self._bodies_of(side) for side in (c.slave, c.master)] for c in contacts]
        self._in_contact = {
            (min(one, other), max(one, other))
            for contact, (slave, master) in zip(contacts, sides, strict=True)
            for one, other in product(slave, master)
            if not isinstance(contact, Tie)
        }
        self._of_pairs = [sorted(slave | master) for slave, master in sides]
        bodies = np.array(sorted({body for pair in self._of_pairs for body in pair}), np.int64)
        without_pair = others is None and bodies.size < count > 1
        self._rest = type(self)(bulk, [], floating, bodies) if without_pair else None
        bodies = bodies if others is None else np.arange(count)
        self.outline: Any = self.extract(bulk.space, self._labels, bodies)
        self._slaves = [self.outline.indices_of(contact.slave.nodes) for contact in contacts]
        self._free: Array = 1.0 - self.outline.gather(bulk.prescribed.astype(float))
        self._prescribed = (self._free == 0.0).all(axis=1)
        name_of_body = partial(floating.name_of, labels=self._labels)
        self._names = overlap.OutlineNames(self.outline, contacts, name_of_body)
        of_bodies = floating.labels, floating.leaders, floating.name_of
        self.led = LedBodies(bulk, contacts, self.outline, *of_bodies)
        self._prepare()
        self.accepted = AcceptedPositions(self._positions(), np.zeros((0, 3)), self.led.places)
        self._left: Array = self.accepted.x
        self._restored: Array | None = None

    def _prepare(self) -> None:
        """Find which overlaps the mesh has, and which the discretization admits."""
        pairs = list(zip(self._contacts, self._of_pairs, strict=True))
        little = [
            body for contact, pair in pairs if overlap.slides_little(contact) for body in pair
        ]
        finite = [
            body for contact, pair in pairs if not overlap.slides_little(contact) for body in pair
        ]
        self._slide_little = np.setdiff1d(little, finite)
        self._links = self.outline.neighbours()
        self._segment_bodies = self.outline.segment_bodies
        self._admitted = overlap.AdmittedDepth(self.outline, self._contacts)
        self._excused = self._as_meshed()
        given = self.outline, self._contacts, self._slaves, self._names, self._excused
        self.in_step = Passages(*given)

    # A state

    def find(self) -> list[Crossing]:
        """Deepest crossings of each pair of outlines, or outline and obstacle, at present.

        Of two outlines up to two: one between the sides of a pair, and one elsewhere; in space one
        for each ``Kind``.
        """
        x = self._positions()
        found = [*self._between_bodies(x), *self._at_obstacles(x), *self._without_pair(x)]
        if self._rest is not None:
            found += [each.in_no_pair() for each in self._rest.find()]
        return [found[k] for k in descending([crossing.facets for crossing in found])]

    def _at_obstacles(self, x: Array) -> Iterator[Crossing]:
        """The deepest point of the obstacle of each pair in bodies with nodes at ``x`` (n, 2)."""
        for pair, contact in enumerate(self._contacts):
            if not isinstance(contact, Contact) or contact.obstacle is None:
                continue
            slaves, obstacle = self._slaves[pair], contact.operators.obstacle
            given = slaves[self._prescribed[slaves]], contact.now.offset, self._names
            yield from overlap.held_inside(obstacle, self.outline, x, *given)
            depths, at, segments = overlap.depths_of_obstacle(contact, self.outline, slaves, x)
            facets = depths / self.outline.lengths(x)[segments]
            if facets.size:
                k = first_largest(facets)
                sides = self._names.segment(segments[k]), f"obstacle '{contact.obstacle.name}'"
                admitted = self._admitted.at_obstacle(x, segments[k], pair)
                measures = float(depths[k]), float(facets[k])
                yield Crossing(sides, format_point(at[k]), *measures, *admitted)

    def _without_pair(self, x: Array) -> Iterator[Crossing]:
        """Bodies with nodes at ``x`` (n, dim) inside obstacles that they have no pair with."""
        for obstacle, body in self.in_step.without_pair:
            depth, facets, point = overlap.deepest_in_obstacle(obstacle, self.outline, x, body)
            if facets > 0.0:
                ends = len(obstacle.salient_points()) > 0  # a plane goes on beyond its solid
                sides = self._names.body(body), f"obstacle '{obstacle.name}'"
                limit, hint = LIMITS.unpaired if ends else math.inf, NO_PAIR + GOES_ON * (not ends)
                measures = depth, facets, limit
                where = format_point(point)
                yield Crossing(sides, where, *measures, hint=hint, remark=LIMITS.unpaired)

    def wrong_at_start(self) -> list[str]:
        """Crossings of bodies, deeper than admitted, in the last accepted state, as text."""
        found = self._between_bodies(self.accepted.x)
        return [str(crossing) for crossing in found if crossing.facets > crossing.admitted]

    def _between_bodies(self, x: Array) -> Iterator[Crossing]:
        """Crossings of outlines with nodes at ``x`` (n, 2), see ``find``."""
        rows = self._crossings(x, self._allowed(x))
        rows = rows[~self._are_meaningless(x, rows) & self._count(rows)]
        paired, in_contact = self._admitted.are_paired(rows), self._admitted.are_in_contact(rows)
        limits, bodies = self._admitted.of(x, rows, paired), self._bodies_in(rows)
        for k, facets in self._deepest(~paired, bodies, rows[:, 2], limits, in_contact):
            first, second = (self._names.segment(int(segment)) for segment in rows[k, :2])
            held = all(self._prescribed[self.outline.segments[int(e)]].any() for e in rows[k, :2])
            measures = float(rows[k, 3]), facets, float(limits[k]), held or bool(paired[k])
            yield Crossing((first, second), format_point(rows[k, 4:]), *measures, BOTH_HELD * held)

    def _deepest(
        self, kinds: Any, bodies: Indices, facets: Array, limits: Array, in_contact: Flags
    ) -> Iterator[tuple[int, float]]:
        """Deepest overlap of each kind of each two bodies, over its limit.

        Args:
            kinds: Kind of each overlap, those of pairs first, shape (k,).
            bodies: The two bodies of each one, ascending, shape (k, 2).
            facets: Depths, shape (k,) [facets].
            limits: Admitted depths, shape (k,) [facets].
            in_contact: Whether they are between surfaces in contact, shape (k,), bool; of others
                those of the mesh are subtracted.

        Yields:
            Number, and a positive depth [facets].
        """
        for kind in np.unique(kinds):
            at = np.flatnonzero(kinds == kind)
            for pair, first in _firsts(bodies[at], (facets / limits)[at]).items():
                k = int(at[first])
                depth = float(facets[k]) - (0.0 if in_contact[k] else self._excused.get(pair, 0.0))
                if depth > 0.0:
                    yield k, depth

    def _count(self, overlaps: Any) -> Flags:
        """Whether overlaps count: all, or those of a body without a pair and another one, (k,)."""
        bodies = self._bodies_in(overlaps)
        if self._others is None:
            return np.ones(len(bodies), bool)
        both = np.isin(bodies, self._others).all(axis=1)
        return np.asarray((bodies[:, 0] != bodies[:, 1]) & ~both)

    def _are_meaningless(self, x: Array, rows: Array) -> Flags:
        """Folds of bodies with linear strains and small sliding, see ``overlap``, (k,), bool."""
        bodies = self._bodies_in(rows)
        marks = (bodies[:, 0] == bodies[:, 1]) & np.isin(bodies[:, 0], self._slide_little)
        if marks.any() and not self._bulk.form_points.any:
            marks[marks] = overlap.are_folds(
                x, self.outline.segments, self._segment_bodies, rows[marks]
            )
            return marks
        return np.zeros(len(rows), bool)

    def _crossings(self, x: Array, allowed: Array) -> Array:
        """Rows of ``find_crossings`` with the nodes at ``x`` and their admitted overlaps."""
        o = self.outline
        return find_crossings(
            x, o.segments, *self._links, o.lengths(x), self._segment_bodies, allowed
        )

    def _bodies_in(self, rows: Any) -> Indices:
        """The two bodies of each row (k, 6), ascending, shape (k, 2)."""
        return np.sort(self._segment_bodies[rows[:, :2].astype(np.int64)], axis=1)

    def _as_meshed(self) -> dict[Bodies, float]:
        """Overlaps that the mesh has, see ``_excuse``."""
        X = self.outline.X
        rows = self._crossings(X, np.zeros(len(X)))
        rows = rows[~self._admitted.are_in_contact(rows)]
        return self._excuse(self._bodies_in(rows), rows[:, 2])

    def _excuse(self, bodies: Indices, facets: Array) -> dict[Bodies, float]:
        """Overlap of bodies in the mesh outside contact pairs [facets], inf if it is deep.

        Offsets are zero at this time. The overlap of a body with itself, such as a closed ring, is
        its value in the mesh. Deep overlaps of bodies in contact are not excused.

        Args:
            bodies: The two bodies of each overlap, ascending, shape (k, 2).
            facets: Its depth, shape (k,) [facets].
        """
        found = dict[Bodies, float]()
        for pair, k in _firsts(bodies, facets).items():
            if pair[0] == pair[1] or facets[k] <= HALF_FACET:
                found[pair] = float(facets[k])
            elif pair not in self._in_contact:
                found[pair] = np.inf
        return found

    def _allowed(self, x: Array) -> Array:
        """Overlap of nodes admitted by offsets, soft layers and jumps of ties, (n,) [length].

        The admitted overlap of a slave node applies to all nodes within this length plus the nodal
        length: to nodes of the master, and of its own body beside an end of the surface.

        Args:
            x: Positions of the nodes, shape (n, 2) [length].
        """
        allowed = np.zeros(len(x))
        for contact, there in zip(self._contacts, self._slaves, strict=True):
            depth = np.maximum(-contact.now.offset, 0.0)
            if isinstance(contact, Tie):
                depth = depth + math.hypot(*contact.pair.present_jump())
            admits = depth.nonzero()[0]
            if not admits.size:
                continue
            from scipy.spatial import cKDTree  # not imported by problems without overlaps

            radii = depth[admits] + contact.slave.nodal_lengths[admits]
            circles = cKDTree(x).query_ball_point(x[there[admits]], radii)
            counts = [len(nodes) for nodes in circles]
            nodes = np.concatenate(circles).astype(np.int64)
            np.maximum.at(allowed, nodes, np.repeat(depth[admits], counts))
        return allowed

    def nodes_inside(self) -> list[Indices]:
        """Nodes of both surfaces of each pair inside another body of it, global numbers.

        Only of nodes without partner in any pair; tied bodies are one body.
        """
        o, x, bodies, found = self.outline, self._positions(), self.led.bodies, []
        of_segments = bodies[o.segments[:, 0]]
        alone = ~np.isin(
            o.nodes, np.concatenate([np.empty(0, int), *map(paired_nodes, self._contacts)])
        )
        for contact, slaves in zip(self._contacts, self._slaves, strict=True):
            at = np.concatenate([slaves, o.indices_of(contact.master.nodes)])
            inside = np.zeros(at.size, bool)
            for body in np.unique(bodies[at]):
                mine = of_segments == body
                ends = x[o.segments[mine]].reshape(-1, 2)
                near = ((x[at] >= ends.min(axis=0)) & (x[at] <= ends.max(axis=0))).all(axis=1)
                others = np.flatnonzero(near & alone[at] & (bodies[at] != body))
                inside[others] |= depths_inside(x, o.segments[mine], x[at[others]])[:, 0] > 0.0
            found.append(np.unique(o.nodes[at[inside]]))
        return found

    def _bodies_of(self, surface: Curve) -> set[int]:
        """Bodies of a surface; tied bodies count separately."""
        bodies = surface.gather(self._bulk.space.spread(self._labels))[:, 0]
        return set(bodies.astype(np.int64).tolist())

    def _positions(self) -> Array:
        return self.outline.positions(self._bulk.u.x.array)

    # A step

    def accept(self, places: Array) -> None:
        """Start the next step at the present state.

        Args:
            places: Positions of the obstacles, shape (obstacles, 3).
        """
        self.accepted = AcceptedPositions(self._positions(), places.copy(), self.led.places)
        self._left, self._restored = self.accepted.x, None

    def restore(self, accepted: AcceptedPositions, u: Array) -> None:
        """Restore the start of a step at the displacement ``u``, shape (local dofs,) [length]."""
        self.accepted, self._restored = accepted, u

    def leave(self) -> None:
        """Store the displacement after a failed solve."""
        self._left, self._restored = self._positions(), None

    def begin(self, places: Array) -> None:
        """Start a step at the accepted state, or at the present one if free dofs of ``u`` were set.

        Args:
            places: Positions of the obstacles, shape (obstacles, 3).
        """
        if self._restored is not None:
            self._left, self._restored = self.outline.positions(self._restored), None
        if (self._free * (self._left - self._positions())).any():
            self.accept(places)

    def passages(self, places: Array) -> tuple[list[str], list[str]]:
        """Messages on passages, and if there are none on possible ones.

        The latter depend on motions that positions at the start and the end do not determine.

        Args:
            places: Present positions of the obstacles, shape (obstacles, 3).
        """
        x0, x1, before = self.accepted.x, self._positions(), self.accepted.places
        doubtful = self.led.parts(self.led.doubtful(x0, x1))
        known = self.led.leading(self.accepted)
        ends = StepEnds(x0, x1, self._prescribed, before, places, known, doubtful)
        return self.in_step.find(ends, self._allowed)


# Two bodies that overlap, ascending.
Bodies = tuple[int, int]


def _firsts(bodies: Indices, sizes: Array) -> dict[Bodies, int]:
    """Number of the largest of ``sizes`` (k,) of each two ``bodies``, ascending (k, 2) (local)."""
    pairs, found = bodies.tolist(), dict[Bodies, int]()
    for k in descending(sizes).tolist():
        found.setdefault(tuple(pairs[k]), k)
    return found


# A further remedy where nodes of the slave carry no force: the nodes of the other side may.
_OTHER_ROLES = f"{space_admitted.TIP}, or exchange slave and master"


class SpaceCrossings(Crossings):
    """Detection of crossings and passages in space, of the hulls of bodies; see ``Crossings``.

    Depths and limits have the same meaning. ``space_admitted`` finds the points inside bodies and
    the depths that the discretization admits, ``space_obstacles`` obstacles.
    """

    extract = staticmethod(extract_hull)

    def _prepare(self) -> None:
        self._in_space = space_admitted.SpaceAdmitted(self.outline, self._contacts)
        self._found_at: tuple[Array, space_admitted.Overlaps] | None = None
        self._excused = self._as_meshed()
        of_pairs = self._contacts, self._slaves
        self._obstacles = [
            SpaceObstacle(number, *each, self.outline, self._names, self._in_space)
            for number, each in enumerate(pairs_of_obstacles(*of_pairs).items())
        ]
        given = self.outline, *of_pairs, self._names, self._excused
        self.in_step = SpacePassages(*given, obstacles=self._obstacles)

    def _at_obstacles(self, x: Array) -> Iterator[Crossing]:
        """The deepest point of each obstacle in each body, over its limit, for each ``Kind``."""
        for obstacle in self._obstacles:
            yield from obstacle.find(x, self._prescribed)

    def _between_bodies(self, x: Array) -> Iterator[Crossing]:
        overlaps = self._overlaps(x)
        overlaps, across = self._in_space.measured(x, at_rows(overlaps, self._count(overlaps)))
        facets = self._facets(x, overlaps, self._allowed(x))
        kinds = self._in_space.kinds(x, overlaps, facets)
        through = (kinds == space_admitted.Kind.UNPAIRED) & self._in_space.are_through(x, overlaps)
        kinds[through] = space_admitted.Kind.THROUGH
        limits = self._in_space.of(x, overlaps, kinds)
        bodies, in_contact = self._bodies_in(overlaps), self._in_space.are_in_contact(overlaps)
        for k, depth in self._deepest(kinds, bodies, facets, limits, in_contact):
            kind, node, triangle = (
                space_admitted.Kind(kinds[k]),
                overlaps.nodes[k, 0],
                overlaps.triangles[k],
            )
            sides = self._names.node(int(node)), self._names.segment(int(triangle))
            held = self._prescribed[overlaps.nodes[k]].any()
            held = bool(held and self._prescribed[self.outline.segments[triangle]].any())
            is_paired = held or kind != space_admitted.Kind.UNPAIRED
            measures = float(overlaps.depths[k]), depth, float(limits[k]), is_paired
            hint = self._in_space.hint(kind, _OTHER_ROLES) + space_admitted.ACROSS * bool(across[k])
            hint = BOTH_HELD if held else hint
            remark = space_admitted.ALWAYS if across[k] else space_admitted.remark_of(kind)
            yield Crossing(sides, format_point(overlaps.points[k]), *measures, hint, remark)

    def _overlaps(self, x: Array) -> space_admitted.Overlaps:
        """``find_overlaps`` at positions ``x`` (n, 3), kept for the next call."""
        if self._found_at is None or not np.array_equal(self._found_at[0], x):
            self._found_at = x, space_admitted.find_overlaps(self.outline, x)
        return self._found_at[1]

    def _facets(self, x: Array, overlaps: space_admitted.Overlaps, allowed: Array) -> Array:
        """Depths over the larger facet, without overlaps ``allowed`` (n,) [length], (k,) [1]."""
        hull, (nodes, triangles, depths, _) = self.outline, overlaps
        sizes = hull.node_sizes(x)[nodes].max(axis=1, initial=0.0)
        sizes = np.maximum(sizes, hull.lengths(x)[triangles])
        slack = np.maximum(
            allowed[nodes].max(axis=1), allowed[hull.segments[triangles]].max(axis=1)
        )
        return np.asarray((depths - slack) / sizes)

    def _bodies_in(self, overlaps: Any) -> Indices:
        """The two bodies of each overlap, ascending, shape (k, 2)."""
        nodes, triangles, _, _ = overlaps
        both = self.outline.bodies[nodes[:, 0]], self.outline.segment_bodies[triangles]
        return np.sort(np.stack(both, axis=1), axis=1)

    def _as_meshed(self) -> dict[Bodies, float]:
        """Overlap of bodies in the mesh [facets]."""
        hull = self.outline
        overlaps = space_admitted.find_overlaps(hull, hull.X)
        if self._others is None:
            self._refuse_double_cover(overlaps)
        overlaps = at_rows(overlaps, ~self._in_space.are_in_contact(overlaps))
        facets = self._facets(hull.X, overlaps, np.zeros(len(hull.X)))
        return self._excuse(self._bodies_in(overlaps), facets)

    def _refuse_double_cover(self, overlaps: space_admitted.Overlaps) -> None:
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
        limits = self._in_space.of(
            hull.X, overlaps, np.full(len(nodes), int(space_admitted.Kind.UNPAIRED))
        )
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
        nodes, bodies = overlaps.nodes[:, 0], self._bodies_in(overlaps)
        return [
            np.unique(self.outline.nodes[nodes[is_node & np.isin(bodies, pair).all(axis=1)]])
            for pair in self._of_pairs
        ]
