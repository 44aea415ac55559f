# SPDX-License-Identifier: MIT
"""Normals at corners inside a slave surface: normal of the one facet that faces the master.

The averaged normal at a corner, for example of a plate whose whole outline is the slave, is oblique
to both facets. If the plate lies on a flat surface, the force on the corner would act along this
normal, while the gap changes along the normal of the flat. The linear complementarity problem of
the active sets is then not symmetric and may have no solution: the corner opens and closes
alternately. Also, the facet round the corner would find partners on the flat along interpolated
normals, at positive gaps, and the nodal gap could close only with an overlap.

Therefore the normal at a corner is that of the facet that faces the nearest part of the master, and
the other facet has no partner, as at the end of a surface. If the master is oblique to both facets,
as below a wedge, the averaged normal is used. The choice among the three normals depends on the
present positions only and is piecewise constant; derivatives are those of the chosen normal.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fenics_mortar.interface.curve_surface import TURN, Curve
from fenics_mortar.utils.arrays import Array, Flags, Indices

# Master facets are equally near to a corner if their distances differ by less than this fraction of
# the shorter facet at the corner [1]; their mean normal is used.
EQUALLY_NEAR = 0.1


def links_at_corners(
    surface: Curve, x: Array, master: Curve, m: Array
) -> tuple[tuple[Indices, Indices], npt.NDArray[np.bool_]]:
    """Links along a slave, cut at corners that take the normal of one facet (local).

    Args:
        surface: The slave.
        x: Positions of its nodes, shape (slave nodes, 2) [length].
        master: The master, with the body on the left of its facets.
        m: Positions of its nodes, shape (master nodes, 2) [length].

    Returns:
        Nodes before and after each one, (slave nodes,) each, and marks of the facets round a
        corner, which have no partner, (facets,), bool.
    """
    if surface.turns.max(initial=0.0) <= TURN:
        return (surface.previous, surface.following), np.zeros(len(surface.facets), bool)
    corners = corners_of(surface)
    roles = surface.roles
    candidates = None if roles is None else roles.masters_of_nodes(surface.facets, corners)
    ends = m[master.facets[:, [0, -1]]]
    facets = choose_facets(surface, corners, x, ends, candidates)
    return one_sided(surface, corners, facets)


def corners_of(surface: Curve) -> Indices:
    """Nodes at which the outline of a body turns left by more than ``TURN``, shape (k,) (local)."""
    return np.flatnonzero(surface.turns > TURN)


def choose_facets(
    surface: Curve, corners: Indices, x: Array, master: Array, candidates: Flags | None = None
) -> Indices:
    """Facet whose normal is used at each corner: -1 before it, 1 after it, 0 both (local).

    Args:
        surface: The slave.
        corners: Nodes, shape (k,).
        x: Positions of the slave's nodes, shape (slave nodes, 2) [length].
        master: Ends of the master's facets, the body on their left, shape (m, 2, 2) [length].
        candidates: Facets that may be masters at each corner, shape (k, m), bool; by default all.

    Returns:
        Shape (k,).
    """
    before, after = surface.chords(x, corners)
    tangents = np.stack([_unit(before), _unit(_unit(before) + _unit(after)), _unit(after)])
    normals = np.stack([tangents[..., 1], -tangents[..., 0]], axis=-1)
    radius = EQUALLY_NEAR * np.minimum(np.hypot(*before.T), np.hypot(*after.T))
    towards = np.array([
        _facing(x[j], n, radius[k], master if candidates is None else master[candidates[k]])
        for k, (j, n) in enumerate(zip(corners, normals[1], strict=True))
    ])  # fmt: skip
    return np.argmax(np.einsum("ikc,kc->ik", normals, towards), axis=0) - 1


def _facing(point: Array, n: Array, radius: float, master: Array) -> Array:
    """Reversed normal of the master's facets nearest to a corner that face ``n``, shape (2,).

    ``n`` if no facet does.
    """
    chord = master[:, 1] - master[:, 0]
    square = (chord**2).sum(axis=1)
    reversed_normals = np.stack([-chord[:, 1], chord[:, 0]], axis=1) / np.sqrt(square)[:, None]
    faces = reversed_normals @ n > 0.0
    if not faces.any():
        return n
    arm = point - master[:, 0]
    s = np.clip((arm * chord).sum(axis=1) / square, 0.0, 1.0)
    away = np.where(faces, np.hypot(*(arm - s[:, None] * chord).T), np.inf)
    near = away <= away.min() + radius
    return _unit(reversed_normals[near].sum(axis=0))


def one_sided(
    surface: Curve, corners: Indices, facets: Indices
) -> tuple[tuple[Indices, Indices], npt.NDArray[np.bool_]]:
    """Links along the curve, cut at corners, and facets that have no partner (local).

    Args:
        surface: The slave.
        corners: Nodes, shape (k,).
        facets: The result of ``choose_facets``, shape (k,).

    Returns:
        Nodes before and after each one, (slave nodes,), and marks (facets,), bool. A facet between
        two corners keeps its partner if its normal is used at one of them.
    """
    previous, following = surface.previous.copy(), surface.following.copy()
    previous[corners[facets > 0]] = -1
    following[corners[facets < 0]] = -1
    first, last = surface.facets[:, 0], surface.facets[:, -1]
    taken = np.isin(first, corners[facets > 0]) | np.isin(last, corners[facets < 0])
    left = np.isin(first, corners[facets < 0]) | np.isin(last, corners[facets > 0])
    return (previous, following), left & ~taken


def _unit(vectors: Array) -> Array:
    """Unit vectors along the given vectors (..., 2)."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
