# SPDX-License-Identifier: MIT
"""Position of the resultant of the pressures.

The resultant of the pressure lies on the covered part of the surface. By balance of forces and
moments, a node at the uncovered end of a partly covered facet carries a fraction of the force on
the covered part. If such a facet is the only active one, as under a body about to tip over an edge,
the whole force may be carried by that node, beyond the edge. The limit load is then larger than in
the limit of fine meshes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.ranks import largest_over_ranks, sum_over_ranks
from fenics_mortar.verify.checks.balance import positive_or_one
from fenics_mortar.verify.checks.corners import runs_of
from fenics_mortar.verify.finding import LIMITS, Finding, Measured

if TYPE_CHECKING:
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.utils.arrays import Array, Indices

IN_PLANE_ONLY = True


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Largest distance of a resultant beyond the cover, over the longest facet (collective).

    Runs with tensile nodes are excluded, since their resultant may lie anywhere; so are obstacles,
    which have no ends.
    """
    contact = measured.contact
    if contact.obstacle is not None:
        return
    o, runs = contact.operators, runs_of(contact)
    forces = np.einsum("jc,jc->j", contact.now.forces[0], o.n)
    found = [
        _beyond(contact, np.flatnonzero(contact.active & (runs == run)), forces)
        for run in np.unique(runs[contact.active])
    ]
    beyond, where = max(found, default=(0.0, ""))
    yield Finding(
        "resultant_outside", "resultant of pressures beyond the covered surface", beyond,
        f"the resultant of the pressures acts at {where}, {beyond:.2f} facets outside of the part "
        "of the slave that the master covers: the limit load of this mesh may be above that of a "
        "finer one",
        remark=LIMITS.coarse_distance, unit="facet lengths", where=where,
    )  # fmt: skip


def _beyond(contact: Contact, nodes: Indices, forces: Array) -> tuple[float, str]:
    """Distance of the resultant beyond the cover in facets, and its position (collective)."""
    o, s = contact.operators, contact.intersections()
    marked = np.zeros(len(o.x), bool)
    marked[nodes] = True
    touched = marked[s.slave].any(axis=1)
    first, last = o.x[s.slave[touched, 0]], o.x[s.slave[touched, -1]]
    along = sum_over_ranks(contact.slave.comm, (last - first).sum(axis=0))
    size = float(np.linalg.norm(along))
    along = along / positive_or_one(size)
    fractions = 0.5 * (1.0 + s.ends[touched])
    covered = (first @ along)[:, None] + ((last - first) @ along)[:, None] * fractions
    longest = float(np.linalg.norm(last - first, axis=1).max(initial=0.0))
    bounds = np.array([covered.max(initial=-np.inf), -covered.min(initial=np.inf), longest])
    bounds = largest_over_ranks(contact.slave.comm, bounds)
    pulls = bool((forces[nodes] < 0.0).any()) or not forces[nodes].any()
    if pulls or size == 0.0:
        return 0.0, ""
    centre = forces[nodes] @ o.x[nodes] / forces[nodes].sum()
    at = float(centre @ along)
    return max(at - bounds[0], -at - bounds[1], 0.0) / float(bounds[2]), format_point(centre)
