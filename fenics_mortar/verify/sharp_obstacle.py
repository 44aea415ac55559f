# SPDX-License-Identifier: MIT
"""Errors of the contact direction where an obstacle is sharper than the facets of the slave.

The force on a slave node acts along the normal of the obstacle at its nearest point. Where a corner
of the obstacle presses between two nodes of a flat surface, the forces on both act along the sides
of the corner: they compress the facet and support the body sideways. The correct direction is that
of the facets, between the normals of the facets at the node.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.utils.errors import format_point
from fenics_mortar.verify.balance import positive_or_one
from fenics_mortar.verify.corners import facet_angles


def along_facets(contact: Contact) -> dict[str, Any]:
    """Fraction of an obstacle's normal forces along the slave's facets, and the position (local).

    Args:
        contact: The pair; without an obstacle the result is empty.

    Returns:
        ``sharp`` [1] and ``sharp_at`` of ``PairCertificate``.
    """
    if contact.obstacle is None:
        return {}
    o = contact.operators
    forces = np.abs(np.einsum("jc,jc->j", contact.now.forces[0], o.n))
    before, after = facet_angles(contact)
    off = np.maximum(np.minimum(before, after), -np.maximum(before, after))
    along = forces * np.sin(np.clip(off, 0.0, 0.5 * np.pi))
    return {
        "sharp": float(along.sum()) / positive_or_one(float(forces.sum())),
        "sharp_at": format_point(o.x[along.argmax()]),
    }
