# SPDX-License-Identifier: MIT
"""Depth of crossing outlines that the discretization admits, with and without a pair.

Between the two sides of a pair, contact is enforced at the nodes: facets overlap between them, by
less than half a facet. Elsewhere nothing keeps bodies apart, and any overlap is an error, beyond
the sagittas of both curves with straight facets: L a / 8 for facets of the length L at an angle a.

A crossing is one of a pair if each of its segments touches one of the two sides: a corner at the
end of a surface overlaps with it. Two such corners alone, as at the junction of cracks, overlap as
the sides of pairs: contact of the sides beside them keeps them where they are. Then the outlines
cross an even number of times beside these two nodes; if they go on inside each other, an odd one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import product

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
        self._ends = np.zeros(len(outline.X), bool)
        for surface in (side for c in contacts for side in (c.slave, c.master)):
            ends = surface.nodes[(surface.previous < 0) | (surface.following < 0)]
            self._ends[outline.indices_of(ends)] = True

    def _touching(self, surface: Surface) -> Flags:
        """Whether each segment has a node of a surface, shape (m,), bool."""
        nodes = np.zeros(len(self._outline.X), bool)
        nodes[self._outline.indices_of(surface.nodes)] = True
        return np.asarray(nodes[self._outline.segments].any(axis=1))

    def are_paired(self, rows: Array) -> Flags:
        """Whether rows (k, 6) of ``find_crossings``, all, are between sides of pairs, (k,), bool.

        Tied pairs count, and corners that overlap alone.
        """
        return self._between(rows, ties=True) | self._corners(rows)

    def are_in_contact(self, rows: Array) -> Flags:
        """Whether rows (k, 6) are between the two sides of a contact pair, shape (k,), bool."""
        return self._between(rows, ties=False)

    def _between(self, rows: Array, *, ties: bool) -> Flags:
        e, f = rows[:, :2].astype(np.int64).T
        paired = np.zeros(len(rows), bool)
        for (slave, master), is_tie in zip(self._sides, self._are_ties, strict=True):
            if ties or not is_tie:
                paired |= (slave[e] & master[f]) | (slave[f] & master[e])
        return paired

    def _corners(self, rows: Array) -> Flags:
        """Whether rows (k, 6) are crossings of two corners at ends of surfaces, (k,), bool."""
        corners = list[set[tuple[int, int]]]()
        for e, f in self._outline.segments[rows[:, :2].astype(np.int64)]:
            mine, others = e[self._ends[e]].tolist(), f[self._ends[f]].tolist()
            corners.append({(min(a, b), max(a, b)) for a, b in product(mine, others)})
        count = Counter(pair for pairs in corners for pair in pairs)
        return np.array([any(count[pair] % 2 == 0 for pair in pairs) for pairs in corners], bool)

    def of(self, x: Array, rows: Array, paired: Flags) -> Array:
        """Admitted depths of rows (k, 6) of ``find_crossings``, shape (k,) [facet lengths].

        Args:
            x: Positions of the nodes, shape (n, 2) [length].
            rows: The crossings.
            paired: Whether they are between sides of pairs, shape (k,), bool.
        """
        unpaired = self._sagittas(x)[rows[:, :2].astype(np.int64)].sum(axis=1)
        unpaired = np.maximum(unpaired, LIMITS.unpaired)
        return np.where(paired, LIMITS.penetration, unpaired)

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
