# SPDX-License-Identifier: MIT
"""Segments, the intersections of slave and master facets, and their quadrature points.

============  =========================================================================
integration   segments of a slave facet
============  =========================================================================
"segments"    its intersections with master facets, each with a Gauss rule
"elements"    runs of points with the same partner; the points are one Gauss rule for the
              whole facet. Segment ends are fixed, such that each point has a length
              equal to its weight
"nodes"       as "elements", with the Lobatto rule, whose points are the nodes
============  =========================================================================

The last two do not resolve the kinks at ends of master facets inside a slave facet: forces balance,
but the patch test is not satisfied (Farah, Popp & Wall 2015). "nodes" is node-to-segment contact.

Discretization of a pair: basis, normals, weights of the gap, quadrature, search.

Averaged unit normals of the nodes of a surface, and their derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from fenics_mortar.interface.behind import BodiesBehind, nothing_behind
from fenics_mortar.interface.curve_surface import Curve
from fenics_mortar.kernels import basis, normals, search
from fenics_mortar.kernels.space import normals as space_normals
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.rounding import ROUNDING

Integration = Literal["segments", "elements", "nodes"]


@dataclass(frozen=True)
class Segments:
    """Segments of some slave facets, found at given positions.

    Attributes:
        facets: Slave facets that were searched, shape (f,).
        partial: Whether the multiplier functions of a facet vary with its segments, shape (f,),
            bool: it is curved, its thickness varies with its position, or it is partly covered by
            segments with moving ends.
        offsets: Segments of facet i are offsets[i]:offsets[i + 1], shape (f + 1,).
        pair_offsets: Pairs of segments coupled by these functions: those of facet i are
            pair_offsets[i]:pair_offsets[i + 1], shape (f + 1,).
        slave: Slave nodes of each segment, shape (n, K).
        master: Master nodes, shape (n, K).
        ends: Ends on the slave facet, -1 ... 1, shape (n, 2).
        end_is_fixed: Whether an end is a fixed point of the slave facet, shape (n, 2); else the
            lower / upper end is the partner of the last / first master node.
        points: Quadrature points of all segments between their ends, -1 ... 1, shape (p,).
        weights: Their weights, whose sum is 2 for each segment, shape (p,).
        spans: Segment i has the points spans[i, 0]:spans[i, 1], shape (n, 2).
        pairs: Segments (i, k) of which M of i depends on the nodes of k, shape (p, 2).
    """

    facets: Indices
    partial: Flags
    offsets: Indices
    pair_offsets: Indices
    slave: Indices
    master: Indices
    ends: Array
    end_is_fixed: Flags
    points: Array
    weights: Array
    spans: Indices
    pairs: Indices

    @cached_property
    def num_segments(self) -> int:
        """Number of segments."""
        return self.slave.shape[0]

    @property
    def rule(self) -> tuple[Array, Array, Indices]:
        """Points (p,), weights (p,) and spans (n, 2), the arguments of the kernels [1]."""
        return self.points, self.weights, self.spans


@clock("search")
def find_segments(
    slave: Curve, master: Curve, x: Array, n: Array, m: Array, facets: Indices,
    options: MortarOptions, behind: BodiesBehind | None = None,
) -> Segments:  # fmt: skip
    """Find the segments of the given slave facets.

    Args:
        slave: The side that carries the multiplier.
        master: The side projected to.
        x: Current positions of the slave nodes, shape (slave nodes, 2) [length].
        n: Unit normals of the slave nodes, shape (slave nodes, 2).
        m: Current positions of the master nodes, shape (master nodes, 2) [length].
        facets: Slave facets to search, shape (f,).
        options: Kind of segments, see above, quadrature and limits of the search.
        behind: Limits of the search behind the slave facets; none by default.

    Returns:
        The segments. Of overlapping segments only the nearest is kept. With "elements" a facet with
        fewer partners than nodes has no segments, since its dual basis would not exist. Lengths in
        xi below ``ROUNDING`` are ignored: covered and missing lengths of facets, overlaps of
        segments, distances of fixed points from master nodes.

    Note:
        Local: no communication.
    """
    geometry, nodes = (x, n, m), slave.facets[facets]
    behind = nothing_behind(facets.size) if behind is None else behind.of(facets)
    search_for, limits = (
        (geometry, nodes, master.facets, options.radius),
        (options.min_cosine, ROUNDING),
    )
    integration, points = options.integration, options.points
    if integration == "segments":
        roles = slave.roles.of(facets) if slave.roles else None
        sight = (behind[:3], behind.outline, ROUNDING)
        arguments = *search_for, *sight, limits, roles, slave.functions_move
        (offsets, masters, fixed, ends), couples = search.find_segments_within(*arguments)
        rules = _same_rule(ends, fixed, points)
    else:
        rule = facet_rule(integration, nodes.shape[1], points)
        min_points = nodes.shape[1] if integration == "elements" else 1
        offsets, masters, rules = _runs(
            (*search_for, (*behind, ROUNDING), limits), *rule, min_points=min_points
        )
        couples = search.couple_segments(offsets, *rules[:2], slave.functions_move)
    owner, partial, pair_offsets, pairs = couples
    on_slave, on_master = nodes[owner], master.facets[masters]
    return Segments(facets, partial, offsets, pair_offsets, on_slave, on_master, *rules, pairs)


class _Rules(NamedTuple):
    """Ends and quadrature of segments on their slave facets; see ``Segments``."""

    ends: Array
    end_is_fixed: Flags
    points: Array
    weights: Array
    spans: Indices


def _same_rule(ends: Array, fixed: Flags, points: int) -> _Rules:
    """The same Gauss rule for all segments, with these ``ends`` (n, 2), whether fixed (n, 2)."""
    spans = np.empty(ends.shape, np.int64)
    spans[:] = 0, points
    return _Rules(ends, fixed, *gauss_rule(points), spans)


def _runs(
    search_for: tuple[Any, ...], xi: Array, w: Array, *, min_points: int
) -> tuple[Indices, Indices, _Rules]:
    """Offsets, master facets and quadrature of runs of points of the rule ``xi``, ``w``."""
    offsets, masters, runs = search.find_points(*search_for, xi, min_points)
    cuts = np.concatenate([[-1.0], np.cumsum(w)[:-1] - 1.0, [1.0]])
    ends, lengths = cuts[runs], np.diff(runs, axis=1)[:, 0]
    stops = np.cumsum(lengths)
    owner, starts = np.repeat(np.arange(len(runs)), lengths), stops - lengths
    which = runs[owner, 0] + np.arange(owner.size) - starts[owner]
    centres, halves = ends.mean(axis=1), (ends[:, 1] - ends[:, 0]) / 2.0
    s, weights = (xi[which] - centres[owner]) / halves[owner], w[which] / halves[owner]
    spans = np.stack([starts, stops], axis=1)
    return offsets, masters, _Rules(ends, np.ones(ends.shape, bool), s, weights, spans)


@cache
def gauss_rule(points: int) -> tuple[Array, Array]:
    """Gauss points and weights on [-1, 1], each (points,)."""
    return np.polynomial.legendre.leggauss(points)


def facet_rule(integration: Integration, size: int, points: int) -> tuple[Array, Array]:
    """Points and weights on a whole facet of ``size`` nodes, each (points,) [1].

    Gauss, or for "nodes" Lobatto, whose points are the nodes: trapezoidal or Simpson's rule.
    """
    if integration != "nodes":
        return gauss_rule(points)
    weights = {2: [1.0, 1.0], 3: [1.0 / 3.0, 4.0 / 3.0, 1.0 / 3.0]}
    return np.linspace(-1.0, 1.0, size), np.array(weights[size])


Basis = Literal["dual", "standard", "vertices", "linear", "quadratic"]
Weighting = Literal["opposite", "unit", "own"]
GapWeights = Literal["cover", "basis", "standard"]
BASES = {
    "dual": basis.DUAL,
    "standard": basis.STANDARD,
    "vertices": basis.DUAL,
    "linear": basis.STANDARD,
    "quadratic": basis.STANDARD,
}
# Bases without multipliers at the inner nodes of quadratic facets.
AT_VERTICES = ("vertices", "linear")
# Bases in space whose functions are given combinations of shape functions.
COMBINED = (*AT_VERTICES, "quadratic")
GAP_WEIGHTS = {
    "basis": basis.BY_BASIS,
    "cover": basis.BY_COVER,
    "standard": basis.BY_STANDARD,
}
WEIGHTINGS = {"opposite": normals.OPPOSITE, "unit": normals.UNIT, "own": normals.OWN}


def basis_on(surface: Any, basis: Basis) -> Basis:
    """Basis of the multipliers on a surface (local).

    Triangles with six nodes have "linear" functions at their corners: there the integral of the
    quadratic function is zero, and a dual one does not exist. With "quadratic" they have those of
    ``space_mortar.functions_of``; on other facets these are dual.
    """
    if surface.dim == 3 and surface.facets.shape[1] == 6:
        return basis if basis == "quadratic" else "linear"
    return "dual" if basis == "quadratic" else basis


@dataclass(frozen=True)
class MortarOptions:
    """Discretization of one pair.

    Attributes:
        basis: "dual" (D is diagonal), "standard" or, at vertices only, "vertices" and "linear";
            on triangles with six nodes "quadratic".
        weighting: Weights of the facet normals at a node: "opposite", "unit" or "own".
        gap_weights: Weights of the gap: "basis", "cover" or "standard"; see ``kernels.basis``.
        integration: "segments", "elements" or "nodes"; see ``segments``.
        points: Gauss points per segment, with "elements" per slave facet.
        radius: Search radius along the normal [length]; see ``sight`` for limits behind the slave.
        min_cosine: Smallest cosine between the slave's normal and the reversed master's [1].
        corners: Whether corners inside the slave take the normal of one facet; see ``corners``.
    """

    basis: Basis
    weighting: Weighting
    gap_weights: GapWeights
    integration: Integration
    points: int
    radius: float
    min_cosine: float
    corners: bool = False

    @cached_property
    def kinds(self) -> tuple[int, int]:
        """Basis and weights of the gap as integers, the arguments of the kernels.

        If the quadrature points are the nodes, standard and dual functions are equal for any cover.
        """
        if self.integration == "nodes":
            return basis.STANDARD, basis.BY_BASIS
        return BASES[self.basis], GAP_WEIGHTS[self.gap_weights]


def evaluate_normals(
    surface: Any,
    x: Array,
    weighting: Weighting,
    links: tuple[Indices, ...] | None = None,
    projectors: Array | None = None,
) -> tuple[Array, Array]:
    """Averaged unit normals of nodes, and their derivatives (local).

    Args:
        surface: The surface.
        x: Current positions of its n nodes, shape (n, dim) [length].
        weighting: Weights of the facet normals at a node.
        links: Nodes before and after each node of a curve, (n,) each, or in space the facets around
            each node, see ``Faces.around``, if not those of the surface.
        projectors: Matrices that remove the components along symmetry planes' normals, in space
            only, shape (n, 3, 3).

    Returns:
        Normals (n, dim) and derivatives by the nodes of the stencil, (n, dim, dim s) [1 / length];
        see ``kernels.normals`` and ``kernels.space.normals``.
    """
    n, dn = np.empty_like(x), np.zeros((*x.shape, surface.stencil_dofs.shape[1]))
    choice = WEIGHTINGS[weighting]
    if surface.dim == 2:
        links = (surface.previous, surface.following) if links is None else links
        normals.tabulate_normals(x, *links, surface.inner, choice, n, dn)
    else:
        space_normals.tabulate_normals(
            x, surface.facets, links or surface.around, surface.stencil, choice, projectors, n, dn
        )
    return n, dn
