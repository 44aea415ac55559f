# SPDX-License-Identifier: MIT
"""Errors of the contact direction where an obstacle is sharper than the facets of the slave.

The force on a slave node acts along the normal of the obstacle at its nearest point. Where a corner
of the obstacle presses between two nodes of a flat surface, the forces on both act along the sides
of the corner: they compress the facet and support the body sideways. The correct direction is that
of the facets, between the normals of the facets at the node.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fenics_mortar.utils.errors import format_point
from fenics_mortar.verify.checks.balance import positive_or_one
from fenics_mortar.verify.checks.corners import facet_angles
from fenics_mortar.verify.finding import Finding
from fenics_mortar.verify.limits import LIMITS
from fenics_mortar.verify.measured import Measured


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Fraction of an obstacle's normal forces along the slave's facets (local)."""
    contact = measured.contact
    if contact.obstacle is None:
        return
    o = contact.operators
    forces = np.abs(np.einsum("jc,jc->j", contact.now.forces[0], o.n))
    before, after = facet_angles(contact)
    off = np.maximum(np.minimum(before, after), -np.maximum(before, after))
    along = forces * np.sin(np.clip(off, 0.0, 0.5 * np.pi))
    part = float(along.sum()) / positive_or_one(float(forces.sum()))
    where = format_point(o.x[along.argmax()])
    yield Finding(
        "obstacle_angle",
        "angle between obstacle and facets",
        part,
        f"{part:.0%} of the normal forces act along the facets of the slave, most of them at "
        f"{where}, where the obstacle is sharper than they are: refine the facets there, or round "
        "the obstacle",
        remark=LIMITS.at_corners,
        unit="sine",
        where=where,
    )
