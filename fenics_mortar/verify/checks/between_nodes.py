# SPDX-License-Identifier: MIT
"""Penetration and distance of the two sides between the nodes, relative to the facet length."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import format_point
from fenics_mortar.verify.finding import Finding
from fenics_mortar.verify.limits import CURVED, LIMITS
from fenics_mortar.verify.measured import Measured


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Penetration and distance of the sides between the nodes (collective).

    Yields:
        ``penetration``: largest penetration of a segment over the length of its facet, admitted by
        the discretization between the nodes, of second order in the facet length; ``distance``:
        smallest distance of slave and master over the facet length if a force acts.
    """
    smallest, where = _smallest_gap(measured.contact)
    penetration = max(-smallest, 0.0)
    distance = max(smallest, 0.0) if measured.contact.active.any() else 0.0
    yield Finding(
        "penetration",
        "penetration between the nodes",
        penetration,
        f"penetration of {penetration:.2f} facets between the nodes, at {where}; finer facets, or "
        f"{CURVED}, reduce it",
        limit=LIMITS.penetration,
        remark=LIMITS.coarse_penetration,
        unit="facet lengths",
        where=where,
    )
    yield Finding(
        "distance",
        "distance of sides with contact forces",
        distance,
        f"a force acts, but the sides are {distance:.2f} facets apart; finer facets of the slave, "
        f"or {CURVED}, reduce the distance",
        limit=LIMITS.penetration,
        remark=LIMITS.coarse_distance,
        unit="facet lengths",
    )


def _smallest_gap(contact: Contact) -> tuple[float, str]:
    """Smallest gap over the length of its facet, inf without segments, and where (collective)."""
    o, s = contact.operators, contact.intersections()
    ends = o.x[s.slave[:, [0, -1]]]
    gaps = o.sample_gaps(o.x + contact.now.offset[:, None] * o.n, s, _samples())
    gaps /= np.hypot(*(ends[:, 1] - ends[:, 0]).T)[:, None]
    smallest, where = np.inf, ""
    if gaps.size:
        deepest = gaps.min(axis=1).argmin()
        smallest, where = float(gaps[deepest].min()), format_point(0.5 * ends[deepest].sum(axis=0))
    return min(contact.slave.comm.allgather((smallest, where)))


@cache
def _samples() -> Array:
    """Points of a segment at which the gap is measured, -1 ... 1, ends included (local)."""
    return np.linspace(-1.0, 1.0, LIMITS.samples)
