# SPDX-License-Identifier: MIT
"""Depth of crossing outlines that the discretization admits, with and without a pair.

Between the two sides of a pair, contact is enforced at the nodes: facets overlap between them, by
less than half a facet. Elsewhere nothing keeps bodies apart, and any overlap is an error, beyond
the sagittas of both curves with straight facets: L a / 8 for facets of the length L at an angle a.

A crossing is one of a pair if each of its segments touches one of the two sides: a corner at the
end of a surface overlaps with it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.outline import Outline
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.utils.arrays import Array, Flags
from fenics_mortar.verify.limits import LIMITS


class AdmittedDepth:
    """Classification of crossings by pairs, and the depths admitted for them; all are local.

    Args:
        outline: The outlines of the bodies.
        contacts: All pairs.
    """

    def __init__(self, outline: Outline, contacts: Sequence[Contact | Tie]) -> None:
        self._outline = outline
        self._after, self._before = outline.neighbours()
        self._sides = [(self._touching(c.slave), self._touching(c.master)) for c in contacts]
        self._are_ties = [isinstance(contact, Tie) for contact in contacts]

    def _touching(self, surface: Surface) -> Flags:
        """Whether each segment has a node of a surface, shape (m,), bool."""
        nodes = np.zeros(len(self._outline.X), bool)
        nodes[self._outline.indices_of(surface.nodes)] = True
        return np.asarray(nodes[self._outline.segments].any(axis=1))

    def are_paired(self, rows: Array, *, ties: bool = True) -> Flags:
        """Whether rows (k, 6) of ``find_crossings`` are between the sides of a pair, (k,), bool.

        ``ties``: whether tied pairs count.
        """
        e, f = rows[:, :2].astype(np.int64).T
        paired = np.zeros(len(rows), bool)
        for (slave, master), is_tie in zip(self._sides, self._are_ties, strict=True):
            if ties or not is_tie:
                paired |= (slave[e] & master[f]) | (slave[f] & master[e])
        return paired

    def of(self, x: Array, rows: Array) -> Array:
        """Admitted depths of rows (k, 6) of ``find_crossings``, shape (k,) [facet lengths].

        Args:
            x: Positions of the nodes, shape (n, 2) [length].
            rows: The crossings.
        """
        unpaired = self._sagittas(x)[rows[:, :2].astype(np.int64)].sum(axis=1)
        unpaired = np.maximum(unpaired, LIMITS.unpaired)
        return np.where(self.are_paired(rows), LIMITS.penetration, unpaired)

    def at_obstacle(self, x: Array, segment: int, pair: int) -> tuple[float, bool]:
        """Admitted depth of an obstacle below a segment, and whether the pair includes the latter.

        Args:
            x: Positions of the nodes, shape (n, 2) [length].
            segment: The segment.
            pair: Number of the pair with the obstacle.

        Returns:
            Depth [facet lengths], flag.
        """
        if self._sides[pair][0][segment]:
            return LIMITS.penetration, True
        return max(float(self._sagittas(x)[segment]), LIMITS.unpaired), False

    def _sagittas(self, x: Array) -> Array:
        """Sagittas of curves through the segments, (m,) [facet lengths]; zero at corners."""
        segments = self._outline.segments
        t = x[segments[:, 1]] - x[segments[:, 0]]
        t, sizes = t[:, 0] + 1j * t[:, 1], np.hypot(*t.T)
        turns = np.zeros(len(segments))
        for beside in (self._after, self._before):
            angles = np.abs(np.angle(t * t[beside].conj()))
            is_curve = (beside >= 0) & (angles < LIMITS.sharp_corner)
            turns = np.where(is_curve, np.maximum(turns, angles), turns)
        return np.asarray(turns * sizes / (8.0 * self._outline.lengths(x)))
