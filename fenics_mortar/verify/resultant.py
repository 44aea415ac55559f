# SPDX-License-Identifier: MIT
"""Where the normal force of a run of slave nodes acts, and whether the sides meet there.

Pressures act where the sides meet, and so does their resultant. A node at the far end of a slave
facet that the master covers in part carries a share of what acts on the covered part; in sum that
is right for forces and moments. But if such a facet alone presses, as under a body about to tip
over the edge of another, all its force may move to that node, out beyond the edge. The body then
bears more than its like with infinitely fine facets.
"""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import place


def beyond_cover(contact: Contact, runs: Indices) -> dict[str, Any]:
    """Farthest a run's resultant lies beyond what is covered, over its longest facet (collective).

    Runs in which a node pulls are left out: the resultant of pull and pressure may be anywhere. So
    are obstacles, which have no ends.

    Args:
        contact: The pair.
        runs: Number of the run of active nodes that each slave node is in, shape (slave nodes,).

    Returns:
        "outside" and "outside_at" of ``PairCertificate``; nothing if no resultant lies beyond.
    """
    if contact.obstacle is not None:
        return {}
    o = contact.operators
    forces = np.einsum("jc,jc->j", o.force(contact.z)[0], o.n)
    found = [
        _beyond(contact, np.flatnonzero(contact.active & (runs == run)), forces)
        for run in np.unique(runs[contact.active])
    ]
    beyond, where = max(found, default=(0.0, ""))
    return {"outside": beyond, "outside_at": where} if beyond > 0.0 else {}


def _beyond(contact: Contact, nodes: Indices, forces: Array) -> tuple[float, str]:
    """How far the resultant of one run lies beyond its covered part, and where (collective)."""
    o, s = contact.operators, contact.intersections()
    touched = np.isin(s.slave, nodes).any(axis=1)
    first, last = o.x[s.slave[touched, 0]], o.x[s.slave[touched, -1]]
    along = contact.slave.comm.allreduce((last - first).sum(axis=0))
    size = float(np.linalg.norm(along))
    pulls = bool((forces[nodes] < 0.0).any()) or not forces[nodes].any()
    if pulls or size == 0.0:
        return 0.0, ""
    along = along / size
    parts = 0.5 * (1.0 + s.ends[touched])
    covered = (first @ along)[:, None] + ((last - first) @ along)[:, None] * parts
    longest = float(np.linalg.norm(last - first, axis=1).max(initial=0.0))
    most = np.array([covered.max(initial=-np.inf), -covered.min(initial=np.inf), longest])
    contact.slave.comm.Allreduce(MPI.IN_PLACE, most, MPI.MAX)
    centre = forces[nodes] @ o.x[nodes] / forces[nodes].sum()
    place_along = float(centre @ along)
    return max(place_along - most[0], -place_along - most[1], 0.0) / float(most[2]), place(centre)
