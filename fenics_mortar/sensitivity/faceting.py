# SPDX-License-Identifier: MIT
"""Offsets by which straight facets change the gap between curved surfaces.

Facets of length l are chords of the surface that was meshed. If it turns to the left by the angle t
between two of them, its curvature is t / l, and it bulges out of the body by l^2 (t / l) / 12 in
the mean of a facet, so that the gap of the mesh is too wide by this length. For facets with a
middle node their own bulge is subtracted. Corners have no curvature. Positions are those of the
undeformed mesh.
"""

from __future__ import annotations

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.corners import TURN
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.utils.arrays import Array


def offset_by_faceting(contact: Contact) -> Array:
    """Nodal offsets that reduce the gap by the bulges of both surfaces, (slave nodes,) (local).

    The bulge of the master is that at its node nearest to the slave node; obstacles have none
    [length].
    """
    offset, master = mean_bulges(contact.slave), contact.master
    if master.num_nodes:
        o = contact.operators
        distance = np.linalg.norm(o.x[:, None] - o.m[None], axis=2)
        offset = offset + mean_bulges(master)[distance.argmin(axis=1)]
    return offset


def mean_bulges(surface: Surface) -> Array:
    """Mean height of the meshed surface over the facets at each node, (nodes,) [length] (local).

    Positive where the body is convex.
    """
    lengths = surface.lengths
    bulges = _curvatures(surface) * lengths**2 / 12.0
    if surface.degree > 1:
        bulges -= 2.0 / 3.0 * _heights(surface)
    sums = np.zeros((2, surface.num_nodes))
    for total, values in zip(sums, (lengths * bulges, lengths), strict=True):
        np.add.at(total, surface.facets, values[:, None])
    return sums[0] / sums[1]


def _curvatures(surface: Surface) -> Array:
    """Curvature of each facet, the mean of those defined at its ends, (facets,) [1 / length]."""
    inside = (surface.previous >= 0) & (surface.following >= 0) & ~surface.inner
    smooth = np.flatnonzero(inside & (np.abs(surface.turns) <= TURN))
    before, after = surface.chords(surface.X, smooth)
    chords = 0.5 * (np.linalg.norm(before, axis=1) + np.linalg.norm(after, axis=1))
    curvature, counts = np.zeros((2, surface.num_nodes))
    curvature[smooth], counts[smooth] = surface.turns[smooth] / chords, 1.0
    ends = surface.facets[:, [0, -1]]
    return curvature[ends].sum(axis=1) / np.maximum(counts[ends].sum(axis=1), 1.0)


def _heights(surface: Surface) -> Array:
    """Outward height of the middle node of each facet over its chord, (facets,) [length]."""
    a, middle, b = surface.X[surface.facets].swapaxes(0, 1)
    chord = b - a
    outward = np.stack([chord[:, 1], -chord[:, 0]], axis=1) / np.linalg.norm(chord, axis=1)[:, None]
    return np.einsum("fc,fc->f", middle - 0.5 * (a + b), outward)
