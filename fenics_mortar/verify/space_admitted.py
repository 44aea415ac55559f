# SPDX-License-Identifier: MIT
"""Depths of overlaps in space that the discretization admits, as ``admitted_depth`` in the plane.

Between the two sides of a pair, contact is enforced at the nodes: facets overlap between them, by
less than half a facet. Elsewhere any overlap is an error, beyond the sagittas of both surfaces with
flat triangles: L a / 8 for facets of the size L at an angle a. So is one of the sides of a pair
where no facets of the pair face each other: edges that cross, a corner beside a face.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.hull import Hull
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.verify.checks.contact_conditions import paired_nodes
from fenics_mortar.verify.finding import LIMITS
from fenics_mortar.verify.overlaps import Overlaps


class Kind(IntEnum):
    """What keeps the surfaces of an overlap apart."""

    PAIRED, UNPAIRED, WITHOUT_AREA = range(3)


class SpaceAdmitted:
    """Kinds of overlaps by pairs, and the depths admitted for them.

    Args:
        hull: The hulls of the bodies.
        contacts: All pairs.
    """

    def __init__(self, hull: Hull, contacts: Sequence[Contact | Tie]) -> None:
        self._hull, self._contacts = hull, contacts
        self._sides = [(hull.near(c.slave), hull.near(c.master)) for c in contacts]

    def _between(self, number: int, overlaps: Overlaps) -> Flags:
        """Whether overlaps are between the two sides of a pair, shape (k,), bool (local)."""
        slave, master = self._sides[number]
        return (self._on(slave, overlaps) & master[overlaps.triangles]) | (
            self._on(master, overlaps) & slave[overlaps.triangles]
        )

    def _on(self, marked: Flags, overlaps: Overlaps) -> Flags:
        """Whether the points are on marked triangles (m,), or beside them, shape (k,), bool."""
        nodes = np.zeros(len(self._hull.X), bool)
        nodes[self._hull.segments[marked]] = True
        return np.asarray(nodes[overlaps.nodes].any(axis=1))

    def are_in_contact(self, overlaps: Overlaps) -> Flags:
        """Whether overlaps are between the sides of a contact pair, shape (k,), bool (local)."""
        marks = np.zeros(len(overlaps.depths), bool)
        for number, contact in enumerate(self._contacts):
            if not isinstance(contact, Tie):
                marks |= self._between(number, overlaps)
        return marks

    def kinds(self, overlaps: Overlaps) -> Indices:
        """``Kind`` of each overlap, shape (k,) (collective)."""
        kinds = np.full(len(overlaps.depths), int(Kind.UNPAIRED))
        for number, contact in enumerate(self._contacts):
            between = self._between(number, overlaps)
            nodes = np.zeros(len(self._hull.X), bool)
            nodes[self._hull.indices_of(paired_nodes(contact))] = True
            paired = nodes[self._hull.segments].any(axis=1)
            has_area = self._on(paired, overlaps) | paired[overlaps.triangles]
            unknown = between & (kinds == Kind.UNPAIRED)
            kinds[unknown & ~has_area] = Kind.WITHOUT_AREA
            kinds[between & has_area] = Kind.PAIRED
        return kinds

    def of(self, x: Array, overlaps: Overlaps, kinds: Indices) -> Array:
        """Admitted depths, shape (k,) [facet sizes] (local).

        Args:
            x: Positions of the nodes, shape (n, 3) [length].
            overlaps: The overlaps.
            kinds: Their kinds, shape (k,).
        """
        sagittas = self._sagittas(x)
        at_nodes = self._hull.largest_at_nodes(sagittas)[overlaps.nodes].max(axis=1)
        both = at_nodes + sagittas[overlaps.triangles]
        return np.where(kinds == Kind.PAIRED, LIMITS.penetration, np.maximum(both, LIMITS.unpaired))

    def at_obstacle(self, x: Array, triangle: int, *, paired: bool) -> float:
        """Admitted depth of an obstacle below a triangle [facet sizes] (local).

        Args:
            x: Positions of the nodes, shape (n, 3) [length].
            triangle: The triangle.
            paired: Whether a pair keeps the obstacle apart from it.
        """
        if paired:
            return LIMITS.penetration
        return max(float(self._sagittas(x)[triangle]), LIMITS.unpaired)

    def _sagittas(self, x: Array) -> Array:
        """Sagittas of surfaces through the triangles, (m,) [facet sizes]; zero at sharp edges."""
        _, beside = self._hull.edges
        turns = self._hull.turns(x)
        turns = np.where(turns < LIMITS.sharp_corner, turns, 0.0)
        largest = np.zeros(len(self._hull.segments))
        np.maximum.at(largest, beside, turns[:, None])
        return largest / 8.0
