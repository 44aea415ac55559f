# SPDX-License-Identifier: MIT
"""Quadrature points of slave facets and their partners on the master, as material points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fenics_mortar.interface.curve_surface import Curve
from fenics_mortar.interface.plane_mortar import PlaneOperators
from fenics_mortar.interface.segments import Segments, gauss_rule
from fenics_mortar.kernels.shapes import lagrange
from fenics_mortar.utils.arrays import Array, Flags, Indices

Rule = tuple[Array, Array]
# Gauss points on a segment, and its ends
GAUSS: Rule = gauss_rule(4)
ENDS: Rule = (np.array([-1.0, 1.0]), np.ones(2))
# Number of Newton steps for the coordinate of a point on a curved facet: errors are below 1e-12 on
# quarters of circles whose middle nodes are displaced by a tenth of the half.
NEWTON_STEPS = 4


@dataclass(frozen=True)
class Points:
    """Quadrature points of segments on the facets of one side (all methods are local).

    Attributes:
        facet: Facet of each segment, shape (n,).
        slave: Nodes of these facets, shape (n, K).
        s: Coordinates on the facets, -1 ... 1, shape (n, q).
        weights: Quadrature weights in s, shape (n, q) [1].
        shape: Shape functions at the points, shape (n, q, K).
    """

    facet: Indices
    slave: Indices
    s: Array
    weights: Array
    shape: Array

    def of(self, nodal: Array) -> Array:
        """Interpolate nodal values (nodes, ...) of this side, (n, q, ...) [their unit]."""
        return np.einsum("nqk,nk...->nq...", self.shape, nodal[self.slave])

    def direction(self, nodal: Array) -> Array:
        """Interpolate nodal vectors (nodes, 2) and normalize them: (n, q, 2) [1]."""
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
        """Tributary lengths (n, q) [length] of the points for nodes at ``x`` (nodes, 2)."""
        _, slope = lagrange(self.s, self.shape.shape[2] - 1)
        along = np.einsum("nqk,nkc->nqc", slope, x[self.slave])
        return self.weights * np.linalg.norm(along, axis=2)


@dataclass(frozen=True)
class Facing(Points):
    """Quadrature points of the slave and their partners on the master (all methods are local).

    Attributes:
        master: Master nodes of each segment, shape (n, K).
        on_master: Shape functions of these at the partners, shape (n, q, K).
        start: Initial vectors from the partners to the points, shape (n, q, 2) [length].
        normals: Initial normals at the points, shape (n, q, 2).
    """

    master: Indices
    on_master: Array
    start: Array
    normals: Array

    def difference(self, v: Array, w: Array) -> Array:
        """Values v (slave nodes, 2) minus w (master nodes, 2) at the points, (n, q, 2) [as v]."""
        return self.of(v) - np.einsum("nqk,nkc->nqc", self.on_master, w[self.master])


def points_between(facet: Indices, nodes: Indices, ends: Array, rule: Rule = GAUSS) -> Points:
    """Quadrature points between ``ends`` (n, 2) on facets (n,) with ``nodes`` (n, K) (local)."""
    middle, half = ends.mean(axis=1)[:, None], np.diff(ends) / 2
    s = middle + half * rule[0]
    return Points(facet, nodes, s, half * rule[1], lagrange(s, nodes.shape[1] - 1)[0])


def points_of(segments: Segments, rule: Rule = GAUSS) -> Points:
    """Quadrature points of the segments on the slave (local)."""
    facet = np.repeat(segments.facets, np.diff(segments.offsets))
    return points_between(facet, segments.slave, segments.ends, rule)


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
    on_both = {"master": master, "on_master": on_master}
    found = Facing(**vars(here), **on_both, start=0.0 * y, normals=here.direction(o.n))
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
