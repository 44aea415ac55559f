# SPDX-License-Identifier: MIT
"""Rotation of contact surfaces with small sliding, whose forces keep their undeformed direction."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.integrals import evaluate_normals
from fenics_mortar.utils.errors import call_together
from fenics_mortar.utils.rounding import SMALL_ANGLE, TINY
from fenics_mortar.verify.finding import Finding
from fenics_mortar.verify.measured import Measured


def of_contact(measured: Measured) -> Iterator[Finding]:
    """With small sliding, mean rotation of the normals, by which the resultant is misdirected."""
    if measured.contact.pair.sliding != "small":
        return
    degrees = float(np.degrees(abs(rotation_since_reference(measured.contact))))
    yield Finding(
        "surface_rotation",
        "rotation of the surface, with small sliding",
        degrees,
        f"the contact surface has rotated by {degrees:.1f} degrees, but sliding='small' keeps the "
        "directions of the undeformed mesh: contact forces are misdirected by this angle; use "
        "sliding='finite'",
        remark=float(np.degrees(SMALL_ANGLE)),
        unit="degrees",
    )


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
