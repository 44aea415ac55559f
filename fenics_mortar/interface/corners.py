# SPDX-License-Identifier: MIT
"""Normals at corners inside a slave surface: of one facet where that facet faces the master.

The averaged normal of a corner, as of a plate whose whole outline is the slave, is oblique to both
of its facets. Where the plate lies on a flat, the force on the corner would act along this normal,
but the gap changes along that of the flat: the linear complementarity problem of the sets is not
symmetric and may have no solution, so that the corner opens and closes in turns. Also the facet
round the corner would find partners on the flat along the normals between, at positive gaps, and
the nodal gap could only close by an overlap.

Therefore a corner takes the normal of the one of its two facets that faces the nearest part of the
master, and the other facet has no partner, as at the end of a surface. Where the master is oblique
to both facets, as below a wedge, the averaged normal stays. Which of the three normals is nearest
to that of the master depends on the present positions only: a piecewise constant choice, and the
derivatives are those of the normal chosen.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.utils.arrays import Array, Flags, Indices

# A node is a corner if the undeformed outline turns there by more than this angle [radian], that of
# a regular hexagon; curves are meshed finer.
TURN = np.pi / 3.0
# Master facets count as equally near to a corner if their distances differ by less than this
# fraction of the corner's shorter facet [1]; their mean direction is taken.
EQUALLY_NEAR = 0.1


def links_at_corners(
    surface: Surface, x: Array, master: Array
) -> tuple[tuple[Indices, Indices], npt.NDArray[np.bool_]]:
    """Links along a slave that end at corners with the normal of one facet (local).

    Args:
        surface: The slave.
        x: Positions of its nodes, shape (slave nodes, 2) [length].
        master: Ends of the master's facets, the body on their left, shape (m, 2, 2) [length].

    Returns:
        Nodes before and after each one, (slave nodes,) each, and marks of the facets round a
        corner, which have no partner, (facets,), bool.
    """
    corners = corners_of(surface)
    if not corners.size:
        return (surface.previous, surface.following), np.zeros(len(surface.facets), bool)
    roles = surface.roles
    candidates = None if roles is None else roles.masters_of_nodes(surface.facets, corners)
    facets = choose_facets(surface, corners, x, master, candidates)
    return one_sided(surface, corners, facets)


def corners_of(surface: Surface) -> Indices:
    """Nodes at which the outline of a body turns left by more than ``TURN``, shape (k,) (local)."""
    return np.flatnonzero(surface.turns > TURN)


def choose_facets(
    surface: Surface, corners: Indices, x: Array, master: Array, candidates: Flags | None = None
) -> Indices:
    """Facet whose normal each corner takes: -1 that before it, 1 that after it, 0 both (local).

    Args:
        surface: The slave.
        corners: Nodes, shape (k,).
        x: Positions of the slave's nodes, shape (slave nodes, 2) [length].
        master: Ends of the master's facets, the body on their left, shape (m, 2, 2) [length].
        candidates: Facets that are masters at each corner, shape (k, m), bool; by default all.

    Returns:
        Shape (k,).
    """
    before, after = surface.chords(x, corners)
    tangents = np.stack([_unit(before), _unit(_unit(before) + _unit(after)), _unit(after)])
    normals = np.stack([tangents[..., 1], -tangents[..., 0]], axis=-1)
    reach = EQUALLY_NEAR * np.minimum(np.hypot(*before.T), np.hypot(*after.T))
    towards = np.array([
        _facing(x[j], n, reach[k], master if candidates is None else master[candidates[k]])
        for k, (j, n) in enumerate(zip(corners, normals[1], strict=True))
    ])  # fmt: skip
    return np.argmax(np.einsum("ikc,kc->ik", normals, towards), axis=0) - 1


def _facing(point: Array, n: Array, reach: float, master: Array) -> Array:
    """Reversed normal of the master's facets nearest to a corner that face ``n``, shape (2,).

    ``n`` where none do.
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
    near = away <= away.min() + reach
    return _unit(reversed_normals[near].sum(axis=0))


def one_sided(
    surface: Surface, corners: Indices, facets: Indices
) -> tuple[tuple[Indices, Indices], npt.NDArray[np.bool_]]:
    """Links along the curve that end at corners, and the facets that have no partner (local).

    Args:
        surface: The slave.
        corners: Nodes, shape (k,).
        facets: The result of ``choose_facets``, shape (k,).

    Returns:
        Nodes before and after each one, (slave nodes,), and marks (facets,), bool. A facet between
        two corners of which one takes its normal keeps its partner.
    """
    previous, following = surface.previous.copy(), surface.following.copy()
    previous[corners[facets > 0]] = -1
    following[corners[facets < 0]] = -1
    first, last = surface.facets[:, 0], surface.facets[:, -1]
    taken = np.isin(first, corners[facets > 0]) | np.isin(last, corners[facets < 0])
    left = np.isin(first, corners[facets < 0]) | np.isin(last, corners[facets > 0])
    return (previous, following), left & ~taken


def _unit(vectors: Array) -> Array:
    """Vectors (..., 2) over their lengths."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
