# SPDX-License-Identifier: MIT
"""Position and direction of the resultant of the pressures.

The resultant of the pressure lies on the covered part of the surface. By balance of forces and
moments, a node at the uncovered end of a partly covered facet carries a fraction of the force on
the covered part. If such a facet is the only active one, as under a body about to tip over an edge,
the whole force may be carried by that node, beyond the edge. The limit load is then larger than in
the limit of fine meshes.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.nodal_normals import evaluate_normals
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import call_together, format_point
from fenics_mortar.utils.ranks import largest_over_ranks, sum_over_ranks
from fenics_mortar.utils.rounding import SMALL_ANGLE, TINY
from fenics_mortar.verify.checks.balance import positive_or_one
from fenics_mortar.verify.checks.corners import runs_of
from fenics_mortar.verify.finding import LIMITS, Finding, Measured

IN_PLANE_ONLY = True


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Position and direction of the resultant of the pressures (collective)."""
    yield from _position(measured)
    yield from _direction(measured)


def _position(measured: Measured) -> Iterator[Finding]:
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


def _direction(measured: Measured) -> Iterator[Finding]:
    """With small sliding, mean rotation of the normals, by which the resultant is misdirected."""
    if measured.contact.pair.sliding != "small":
        return
    degrees = float(np.degrees(abs(rotation_since_reference(measured.contact))))
    yield Finding(
        "surface_rotation", "rotation of the surface, with small sliding", degrees,
        f"the contact surface has rotated by {degrees:.1f} degrees, but sliding='small' keeps the "
        "directions of the undeformed mesh: contact forces are misdirected by this angle; use "
        "sliding='finite'",
        remark=float(np.degrees(SMALL_ANGLE)), unit="degrees",
    )  # fmt: skip


def rotation_since_reference(contact: Contact) -> float:
    """Mean angle from the normals of the contact forces to the present ones [radian] (collective).

    Weighted by the normal forces; 0.0 with finite sliding. The resultant is misdirected by this
    angle, while opposite rotations, as at both edges of an indented zone, cancel.
    """
    if contact.pair.sliding != "small" or not contact.active.any():
        return 0.0
    o, on, weighting = contact.operators, contact.active, contact.options.weighting
    if contact.obstacle is not None:
        obstacle, given = contact.obstacle, -o.n
        what = f"the distance of '{obstacle.name}'"
        _, now, _ = call_together(contact.slave.comm, what, partial(obstacle.evaluate, o.x))
    else:
        given, _ = evaluate_normals(contact.slave, contact.slave.X, weighting)
        now, _ = evaluate_normals(contact.slave, o.x, weighting)
    across = given[:, 0] * now[:, 1] - given[:, 1] * now[:, 0]
    angles = np.arctan2(across, (given * now).sum(axis=1))[on]
    forces = np.abs(o.weight * contact.pressure)[on]
    return float(forces @ angles) / max(float(forces.sum()), TINY)
