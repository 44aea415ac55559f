# SPDX-License-Identifier: MIT
"""Partners of slave points on the master: quadrature points of segments, and nearest points.

``both_sides`` and ``face`` give the quadrature points of slave facets and their partners as
material points. Segments in the plane have a Gauss rule each; points on pairs of facets in space,
which are those of the cells of their common parts, are listed one by one, as segments with q = 1.
The reference facet is the interval [-1, 1], in space that of ``kernels.space.shapes``.

``nearest_on_master`` and ``nearest_points`` give points of a surface nearest to given points, in
the plane on the chords of facets, in space on triangles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fenics_mortar.interface import reference
from fenics_mortar.interface.faces import Faces, FacetPairs
from fenics_mortar.kernels.projection import lagrange
from fenics_mortar.kernels.space.integrals import listed_points
from fenics_mortar.kernels.space.normals import facets_around
from fenics_mortar.kernels.space.shapes import LINEAR, QUADRATIC, pieces_of, reference_nodes
from fenics_mortar.utils.arrays import Array, Flags, Indices

if TYPE_CHECKING:
    from fenics_mortar.interface.curve_surface import Curve
    from fenics_mortar.interface.integrals import PlaneOperators, Segments

Rule = tuple[Array, Array]
# Gauss points on a segment, and its ends
GAUSS: Rule = reference.gauss_rule(4)
ENDS: Rule = (np.array([-1.0, 1.0]), np.ones(2))
# Number of points whose nearest facets are searched at a time, to limit memory.
BATCH = 2000
# Number of Newton steps for the coordinate of a point on a curved facet: errors are below 1e-12 on
# quarters of circles whose middle nodes are displaced by a tenth of the half.
NEWTON_STEPS = 4


@dataclass(frozen=True)
class Points:
    """Quadrature points of segments on the facets of one side (all methods are local).

    Attributes:
        facet: Facet of each segment, shape (n,).
        slave: Nodes of these facets, shape (n, K).
        s: Coordinates on the reference facets, shape (n, q), in space (n, q, 2).
        weights: Quadrature weights in s, shape (n, q) [1].
        shape: Shape functions at the points, shape (n, q, K).
        slopes: Their derivatives by the coordinates, shape (n, q, dim - 1, K).
    """

    facet: Indices
    slave: Indices
    s: Array
    weights: Array
    shape: Array
    slopes: Array

    def of(self, nodal: Array) -> Array:
        """Interpolate nodal values (nodes, ...) of this side, (n, q, ...) [their unit]."""
        return np.einsum("nqk,nk...->nq...", self.shape, nodal[self.slave])

    def direction(self, nodal: Array) -> Array:
        """Interpolate nodal vectors (nodes, dim) and normalize them: (n, q, dim) [1]."""
        v = self.of(nodal)
        return np.asarray(v / np.linalg.norm(v, axis=2, keepdims=True))

    def dual_moments(self, w: Array, values: Array) -> tuple[Array, Array]:
        """Integrals of values times the dual functions, and of the dual functions themselves.

        Args:
            w: Weights of the points, as by ``measure``, shape (n, q) [length].
            values: Values at the points, shape (n, q) [unit]; each segment is a whole facet.

        Returns:
            Integrals [unit length] and [length], each (n, K).
        """
        N = self.shape
        mass = np.einsum("nq,nqj,nqk->njk", w, N, N)
        sizes, moments = np.einsum("nq,nqj->nj", w, N), np.einsum("nq,nqj,nq->nj", w, N, values)
        return sizes * np.linalg.solve(mass, moments[..., None])[..., 0], sizes

    def measure(self, x: Array) -> Array:
        """Tributary lengths or areas (n, q) [area] of the points, for nodes at ``x``."""
        tangents = np.einsum("nqak,nkc->nqac", self.slopes, x[self.slave])
        across = tangents[:, :, 0]
        if tangents.shape[2] == 2:
            across = np.cross(across, tangents[:, :, 1])
        return np.asarray(self.weights * np.linalg.norm(across, axis=2))


@dataclass(frozen=True)
class Facing(Points):
    """Quadrature points of the slave and their partners on the master (all methods are local).

    Attributes:
        master: Master nodes of each segment, shape (n, K').
        on_master: Shape functions of these at the partners, shape (n, q, K').
        start: Initial vectors from the partners to the points, shape (n, q, dim) [length].
        normals: Initial normals at the points, shape (n, q, dim).
    """

    master: Indices
    on_master: Array
    start: Array
    normals: Array

    def difference(self, v: Array, w: Array) -> Array:
        """Values v (slave nodes, dim) minus w (master nodes, dim), (n, q, dim) [as v]."""
        return self.of(v) - np.einsum("nqk,nkc->nqc", self.on_master, w[self.master])


def points_between(facet: Indices, nodes: Indices, ends: Array, rule: Rule = GAUSS) -> Points:
    """Quadrature points between ``ends`` (n, 2) on facets (n,) with ``nodes`` (n, K) (local)."""
    middle, half = ends.mean(axis=1)[:, None], np.diff(ends) / 2
    s = middle + half * rule[0]
    shape, slopes = lagrange(s, nodes.shape[1] - 1)
    return Points(facet, nodes, s, half * rule[1], shape, slopes[:, :, None])


def rule_of(segments: Segments) -> Rule:
    """Points and weights on each segment, in space on each whole facet [1] (local)."""
    if segments.points.ndim == 2:
        size = segments.slave.shape[1]
        return reference.face_rule(size, LINEAR if size < 6 else QUADRATIC)
    return GAUSS


def points_of(segments: Segments, rule: Rule = GAUSS) -> Points:
    """Quadrature points of segments, or of whole facets in space with their own rule (local)."""
    if segments.points.ndim == 2:
        count, size = segments.slave.shape
        points, weights = rule_of(segments)
        table = np.tile(reference.tabulate(points, size), (count, 1, 1, 1))
        coordinates, w = np.tile(points, (count, 1, 1)), np.tile(weights, (count, 1))
        at = segments.facets, segments.slave, coordinates, w
        return Points(*at, table[:, :, 0], table[:, :, 1:])
    return points_between(segments.facets[segments.owner], segments.slave, segments.ends, rule)


def with_weight(points: Points, *, at_vertices: bool) -> Points:
    """Points with functions of positive integrals, to which multipliers are dual (local).

    On triangles with six nodes, where shape functions of corners have no positive integral, they
    are ``positive_functions``, or linear ones if multipliers are ``at_vertices`` only.
    """
    if points.slave.shape[1] != 6:
        return points
    if not at_vertices:
        return replace(points, shape=points.shape @ reference.positive_functions().T)
    linear = reference.linear_values(6)
    return replace(points, slave=points.slave[:, : linear.shape[1]], shape=points.shape @ linear)


def both_sides(o: Any, segments: Segments | FacetPairs) -> tuple[Facing, Points]:
    """Points of the parts of slave and master that face each other at the state of ``o`` (local).

    In the plane the points of the master are not the partners of those of the slave.
    """
    if isinstance(segments, FacetPairs):
        return both_faces(o, segments)
    return face(o, segments), points_behind(o, segments)


def points_behind(o: PlaneOperators, segments: Segments) -> Points:
    """Gauss points on the parts of master facets that face the segments, at ``o`` (local)."""
    on_master = face(o, segments, ENDS).on_master
    ends = np.sort(on_master @ np.linspace(-1.0, 1.0, on_master.shape[2]), axis=1)
    of_first_node = np.zeros(o.master.num_nodes, np.int64)
    of_first_node[o.master.facets[:, 0]] = np.arange(len(o.master.facets))
    facet = of_first_node[segments.master[:, 0]]
    return points_between(facet, segments.master, np.clip(ends, -1.0, 1.0))


def face(o: PlaneOperators, segments: Segments, rule: Rule = GAUSS) -> Facing:
    """Quadrature points of segments and their partners at the state of ``o`` (local)."""
    here, gap = points_of(segments, rule), o.sample_gaps(o.x, segments, rule[0])
    y = here.of(o.x) + gap[..., None] * here.direction(o.n)
    master = segments.master
    on_master, _ = lagrange(_coordinates_on(o.m[master], y), o.master.degree)
    return _facing(o, here, master, on_master)


def both_faces(o: Any, pairs: FacetPairs) -> tuple[Facing, Points]:
    """``both_sides`` for faces, with the rule of ``o`` (local).

    Any other rule would integrate tractions on distorted quadrilaterals differently from D and M.
    """
    pair, (weights, *shapes) = listed_points(
        (o.x, o.m), o.slave.facets[pairs.facets], pairs.master, pairs.offsets, o.rule
    )
    facets = pairs.facets[pairs.owner[pair]], pairs.numbers[pair]
    here, behind = (
        Points(
            facet, side[pair], (N[:, :1] @ reference_nodes(N.shape[2])), w[:, None], N[:, :1],
            N[:, None, 1:],
        )
        for facet, side, N, w in zip(facets, (pairs.slave, pairs.master), shapes, weights.T)
    )  # fmt: skip
    return _facing(o, here, behind.slave, behind.shape), behind


def _facing(o: Any, here: Points, master: Indices, on_master: Array) -> Facing:
    """``here`` with partners on the master, at the state of ``o`` (local)."""
    found = Facing(
        **vars(here), master=master, on_master=on_master, start=0.0 * here.of(o.x),
        normals=here.direction(o.n),
    )  # fmt: skip
    return replace(found, start=found.difference(o.x, o.m))


def nearest_facets(
    x: Array, m: Array, surface: Curve, candidates: Flags | None = None
) -> tuple[Indices, Array]:
    """Facet nearest to each point, and coordinate along its chord (local).

    Args:
        x: Points, shape (k, 2) [length].
        m: Positions of the nodes of the surface, shape (nodes, 2) [length].
        surface: The surface.
        candidates: Admissible facets of each point, shape (k, facets), bool; by default all.

    Returns:
        End nodes of the facets, shape (k, 2), and coordinates, shape (k,): 0 to 1 along the chord,
        less or more for points beyond the ends of the surface.
    """
    ends = surface.facets[:, [0, -1]]
    chord = m[ends[:, 1]] - m[ends[:, 0]]
    away = x[:, None] - m[ends[:, 0]]
    fraction = (away * chord).sum(axis=2) / (chord**2).sum(axis=1)
    rest = away - np.clip(fraction, 0.0, 1.0)[:, :, None] * chord
    square = (rest**2).sum(axis=2)
    if candidates is not None:
        square[~candidates] = np.inf
    facet = np.argmin(square, axis=1)
    return ends[facet], fraction[np.arange(len(x)), facet]


def nearest_on_chords(x: Array, m: Array, surface: Curve) -> tuple[Indices, Array]:
    """Points of a curve nearest to many points, on the chords of its facets (local).

    Args:
        x: Points, shape (k, 2) [length].
        m: Positions of the nodes of the curve, shape (nodes, 2) [length].
        surface: The curve.

    Returns:
        End nodes of the facets, shape (k, 2), and their weights at the nearest points, (k, 2) [1].
    """
    batches = np.array_split(x, len(x) // BATCH + 1)
    nearest = [nearest_facets(batch, m, surface) for batch in batches]
    ends, parts = (np.concatenate(found) for found in zip(*nearest, strict=True))
    on_facet = np.clip(parts, 0.0, 1.0)
    return ends, np.stack([1.0 - on_facet, on_facet], axis=1)


def _coordinates_on(m: Array, y: Array) -> Array:
    """Coordinates s (n, q) of points ``y`` (n, q, 2) on facets with nodes at ``m`` (n, K, 2)."""
    degree = m.shape[1] - 1
    s = np.zeros(y.shape[:2])
    for _ in range(NEWTON_STEPS if degree > 1 else 1):
        shape, slope = lagrange(s, degree)
        off = y - np.einsum("nqk,nkc->nqc", shape, m)
        along = np.einsum("nqk,nkc->nqc", slope, m)
        s = s + (off * along).sum(axis=2) / (along**2).sum(axis=2)
    return s


# Numbers of the nearest nodes among which that of another part is looked for, one after the other,
# on a surface in contact with itself [1]: the last are those within 16 facets on a node's own part.
# Beyond there is no contact in one step.
TRIED = 32, 128, 1024


class LinearFacets(NamedTuple):
    """Triangles or quadrilaterals with their corners alone, in the plane or in space.

    Attributes:
        facets: Nodes of each, shape (m, K).
        around: See ``Surface.around``.
    """

    facets: Indices
    around: tuple[Indices, Indices, Indices]


def linear_facets(facets: Indices, num_nodes: int) -> LinearFacets:
    """Linear facets between all nodes of facets (m, K), ordered as those of ``Faces`` (local)."""
    pieces = pieces_of(facets.shape[1])
    facets = facets[:, pieces].reshape(-1, pieces.shape[1])
    return LinearFacets(facets, facets_around(facets, num_nodes))


def nearest_on_master(o: Any, nodes: Indices) -> tuple[Indices, Array]:
    """Points of the master nearest to slave nodes at the state of ``o``; see ``nearest_points``.

    On a surface in contact with itself they belong to a part that faces the node and is its master;
    where no such part is near, the point is the node itself. In the plane, with nodes (k, 2) and
    weights (k, 2), a point may lie on the line of a facet beyond an end of the surface.
    """
    if o.slave.dim == 2:
        roles = o.slave.roles
        candidates = None if roles is None else roles.masters_of_nodes(o.slave.facets, nodes)
        ends, fraction = nearest_facets(o.x[nodes], o.m, o.master, candidates)
        return ends, np.stack([1.0 - fraction, fraction], axis=1)
    near = _nodes_of_masters(o, nodes) if o.slave.roles is not None else None
    return nearest_points(o.x[nodes], o.m, o.master, near)


def _nodes_of_masters(o: Any, nodes: Indices) -> Indices:
    """Nearest node of another part of a surface in contact with itself, or itself, (k,)."""
    from scipy.spatial import cKDTree

    surface, roles, found = o.slave, o.slave.roles, nodes.copy()
    count = surface.num_nodes
    earliest, latest = roles.of_nodes(surface.facets, count)
    facet, column = np.nonzero(roles.near >= 0)
    others = surface.facets[roles.near[facet, column]]
    beside = np.unique(surface.facets[facet][:, :, None] * count + others[:, None])
    tree, missing = cKDTree(o.x), np.arange(nodes.size)
    for number in np.minimum(TRIED, count):
        j = nodes[missing, None]
        l = tree.query(o.x[j[:, 0]], number)[1].reshape(missing.size, number)
        faces = np.einsum("jkc,jlc->jl", o.n[j], o.n[l]) < 0.0
        faces &= (earliest[j] < latest[l]) & ~np.isin(j * count + l, beside)
        at = faces.any(axis=1)
        found[missing[at]] = l[at, faces[at].argmax(axis=1)]
        missing = missing[~at]
    return found


def nearest_points(
    x: Array, m: Array, surface: Faces | LinearFacets, node: Indices | None = None
) -> tuple[Indices, Array]:
    """Points of the facets around the nearest node that are nearest to given points (local).

    Facets are taken as triangles between their corners.

    Args:
        x: The points, shape (k, dim) [length].
        m: Positions of the surface's nodes, shape (n, dim) [length].
        surface: The surface, or triangles in the plane.
        node: The nearest node of each point, shape (k,); looked for by default.

    Returns:
        Corners of the triangle that has the nearest point, shape (k, 3), and their weights there,
        shape (k, 3) [1].
    """
    if not len(x):
        return np.empty((0, 3), np.int64), np.empty((0, 3))
    from scipy.spatial import cKDTree  # 50 ms, for solids only

    corners = surface.facets[:, : reference.CORNERS[surface.facets.shape[1]]]
    if node is None:
        used = np.unique(corners)
        node = used[cKDTree(m[used]).query(x)[1]]
    starts, facet, _ = surface.around
    counts = starts[node + 1] - starts[node]
    point = np.repeat(np.arange(len(x)), counts)
    at = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    near = corners[facet[starts[node[point]] + at]]
    fans = [near[:, [0, i, i + 1]] for i in range(1, corners.shape[1] - 1)]
    triangles, point = np.concatenate(fans), np.tile(point, len(fans))
    weights = _weights(x[point], m[triangles])
    distances = np.linalg.norm(np.einsum("tk,tkc->tc", weights, m[triangles]) - x[point], axis=1)
    order = np.lexsort((distances, point))
    first = order[np.searchsorted(point[order], np.arange(len(x)))]
    return triangles[first], weights[first]


def _weights(x: Array, corners: Array) -> Array:
    """Barycentric coordinates of the points of triangles nearest to ``x`` (t, dim), (t, 3)."""
    a, b, c = (corners[:, k] for k in range(3))
    u, v, w = b - a, c - a, x - a
    uu, uv, vv, wu, wv = (np.einsum("tc,tc->t", p, q) for p, q in
                          ((u, u), (u, v), (v, v), (w, u), (w, v)))  # fmt: skip
    det = uu * vv - uv * uv
    s, t = (wu * vv - wv * uv) / det, (wv * uu - wu * uv) / det
    inside = np.stack([1.0 - s - t, s, t], axis=1)
    best, least = inside, np.where((inside >= 0.0).all(axis=1), 0.0, np.inf)
    for i, j in ((0, 1), (1, 2), (2, 0)):  # the edges
        p, q = corners[:, i], corners[:, j]
        r = np.einsum("tc,tc->t", x - p, q - p) / np.einsum("tc,tc->t", q - p, q - p)
        r = np.clip(r, 0.0, 1.0)
        distance = np.linalg.norm(p + r[:, None] * (q - p) - x, axis=1)
        on_edge = np.zeros_like(inside)
        on_edge[:, i], on_edge[:, j] = 1.0 - r, r
        nearer = distance < least
        best, least = np.where(nearer[:, None], on_edge, best), np.where(nearer, distance, least)
    return best
