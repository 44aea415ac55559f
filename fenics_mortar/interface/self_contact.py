# SPDX-License-Identifier: MIT
"""Slave and master roles of the facets of a surface that may touch itself.

All facets are put into one order. Of two facets that face each other, the first one is the slave. A
facet or node may be a slave of one facet and a master of another. Curves are ordered by mean facet
length, finest first, since a slave should be finer than its master; facets are ordered along each
curve. Facets whose nodes are all prescribed come last, since they carry no multipliers.

If a curve is folded, one side of the fold precedes the other along the curve. Roles change only at
the bend, and at the start of a closed curve. The order follows from the undeformed mesh. Roles
therefore do not change during a solve and do not depend on ranks or numbering.

Facets that are neighbours along the curve are not paired, see ``kernels.roles``. Like any other
facet in between, they hide facets behind them. Neither are facets that meet at a junction of cracks
but are not faces of one crack: they touch in a point, as parts opposite each other where two cracks
cross. Corners that overlap by rounding could be separated along either crack, and the gap along the
crack that slides would be minus the slip.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenics_mortar.interface.curve_surface import FOLD, Curve
from fenics_mortar.interface.roles import Roles
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.rounding import SAME_PLACE

# Digits to which the logarithm of the mean facet length is compared: curves with equal meshes are
# then ordered by their coordinates, not by rounding.
DIGITS = round(-np.log10(SAME_PLACE))


def in_contact_with_itself(surface: Curve, may_carry: Flags) -> Curve:
    """Copy of a surface with the roles of its facets (local).

    Args:
        surface: The surface.
        may_carry: Whether a node may carry a multiplier, shape (nodes,), bool.
    """
    curves = facets_by_curve(surface)
    mean = np.array([surface.lengths[facets].mean() for facets in curves])
    mean = np.round(np.log10(mean), DIGITS)
    keys = np.empty((len(surface.facets), 2), np.int64)
    arcs, order = np.empty((len(surface.facets), 3)), np.empty(len(surface.facets), np.int64)
    first = 0
    for curve in np.argsort(mean, kind="stable"):
        facets = curves[curve]
        along = np.concatenate([[0.0], np.cumsum(surface.lengths[facets])])
        closed = surface.facets[facets[0], 0] == surface.facets[facets[-1], -1]
        order[facets] = first + np.arange(facets.size)
        first += facets.size
        keys[facets, 1] = curve
        arcs[facets] = np.stack([along[:-1], along[1:], 0.0 * along[1:]], axis=1)
        arcs[facets, 2] = along[-1] if closed else np.inf
    fixed = ~may_carry[surface.facets].any(axis=1)
    keys[np.lexsort((order, fixed)), 0] = np.arange(order.size)
    return replace(surface, roles=Roles(keys, arcs, ends_at_junctions(surface)))


def ends_at_junctions(surface: Curve) -> Indices:
    """Junction of cracks at both ends of each facet and crack that leaves it, (f, 2, 2) (local).

    -1 where there is none. Faces are those of one crack if they fold back on each other at the
    junction, see ``curves.FOLD``. Tips count as junctions of one crack.
    """
    found = np.full((len(surface.facets), 2, 2), -1, np.int64)
    _, node, count = np.unique(surface.nodes, return_inverse=True, return_counts=True)
    facet, end = np.nonzero(count[node][surface.facets[:, [0, -1]]] > 1)
    X = surface.X[surface.facets[facet, -end]]
    along = surface.X[surface.facets[facet, np.where(end, -2, 1)]] - X
    along /= np.hypot(*along.T)[:, None]
    near = SAME_PLACE * surface.lengths[facet]
    for i in range(facet.size):
        here = np.hypot(*(X - X[i]).T) < near
        folded = here & (along @ along[i] > -np.cos(FOLD))
        found[facet[i], end[i]] = np.argmax(here), np.argmax(folded)
    return found


def facets_by_curve(surface: Curve) -> list[Indices]:
    """Numbers of the facets of each curve, in order along it, shape (facets,) each (local)."""
    begins = np.full(surface.num_nodes, -1)
    begins[surface.facets[:, 0]] = np.arange(len(surface.facets))
    starts = np.flatnonzero(surface.previous[surface.facets[:, 0]] < 0)
    visited, curves = np.zeros(len(surface.facets), bool), []
    for start in (*starts, *range(len(surface.facets))):
        facet, facets = int(start), []
        while facet >= 0 and not visited[facet]:
            visited[facet] = True
            facets.append(facet)
            facet = int(begins[surface.facets[facet, -1]])
        if facets:
            curves.append(np.array(facets))
    return curves


def starts_of_holes(surface: Curve) -> Indices:
    """First nodes of closed curves around empty holes, shape (k,) (local).

    At the start of such a curve roles change within a face that may touch the opposite face. With
    multipliers on both faces, the gap between two nodes that meet would be constrained twice.
    """
    found = []
    for facets in facets_by_curve(surface):
        first = surface.facets[facets, 0]
        if surface.facets[facets[-1], -1] != first[0]:
            continue
        x, y = surface.X[first].T
        area = 0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum()
        others = np.setdiff1d(surface.facets.ravel(), surface.facets[facets].ravel())
        if area < 0.0 and not _are_inside(surface.X[first], surface.X[others]).any():
            found.append(first[0])
    return np.array(found, np.int64)


def _are_inside(polygon: Array, points: Array) -> Flags:
    """Whether ``points`` (n, 2) are inside of a closed ``polygon`` (k, 2), shape (n,), bool."""
    a, b, p = polygon, np.roll(polygon, -1, axis=0), points[:, None]
    above = a[:, 1] > p[..., 1], b[:, 1] > p[..., 1]
    edge, arm = b - a, p - a
    on_left = edge[:, 0] * arm[..., 1] - edge[:, 1] * arm[..., 0] > 0.0
    crossings = ((above[0] != above[1]) & (on_left == above[1])).sum(axis=1)
    return np.asarray(crossings % 2 == 1)
