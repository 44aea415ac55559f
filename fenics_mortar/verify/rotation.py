# SPDX-License-Identifier: MIT
"""Rotation of contact surfaces with small sliding, whose forces keep their undeformed direction."""

from __future__ import annotations

from functools import partial

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.integrals import evaluate_normals
from fenics_mortar.utils.errors import call_together
from fenics_mortar.utils.rounding import TINY


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
