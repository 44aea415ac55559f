# SPDX-License-Identifier: MIT
"""Crossings of an outline with itself at which the body is inverted, not overlapped.

The winding number of a closed outline, the body on its left, is the number of times that the body
covers a point, counted negative where det F < 0. Beside a crossing of two edges it is w + 1, w, w
and w - 1 in the four sectors: w is 1 where two parts of the body overlap, and 0 at a fold, beside
which det F < 0. With linear strains and small sliding a fold has no meaning, since the sign of
det F has none and the contact conditions are those of the undeformed surfaces. So below the tip of
a cone the surface of a linear elastic body moves across the axis.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.utils.arrays import Array, Indices


def slides_little(contact: Contact | Tie) -> bool:
    """Whether the conditions of a pair are those of the undeformed surfaces (local)."""
    return not isinstance(contact, Tie) and contact.pair.sliding == "small"


def are_folds(
    x: Array, segments: Indices, bodies: Indices, crossings: Array
) -> npt.NDArray[np.bool_]:
    """Whether crossings of outlines with themselves are folds, shape (k,), bool (local).

    Args:
        x: Positions of the nodes, shape (n, 2) [length].
        segments: Nodes of the segments of all outlines, shape (m, 2).
        bodies: Body of each segment, shape (m,).
        crossings: Rows of ``find_crossings``, shape (k, 6).
    """
    folds = np.empty(len(crossings), bool)
    for k, row in enumerate(crossings):
        crossed = row[:2].astype(np.int64)
        others = bodies == bodies[crossed[0]]
        others[crossed] = False
        folds[k] = _winding(x, segments[others], row[4:]) < 1
    return folds


def _winding(x: Array, segments: Indices, P: Array) -> int:
    """Mean winding number around the crossing P (2,) of two segments, which are left out.

    They pass straight through P, and on both sides of it contribute opposite angles.
    """
    a, b = np.moveaxis(x[segments] - P, 1, 0)
    angles = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1))
    return round(float(angles.sum()) / (2.0 * np.pi))
