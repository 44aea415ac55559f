# SPDX-License-Identifier: MIT
"""Loaded nodes that are away from an obstacle in space, at edges between its nodes.

Gaps are zero in the mean, weighted by multiplier functions. Dual functions are negative at the
other nodes of a facet: where it reaches beyond the edge of a flat punch, the distance of that part
presses the inner node, and the force may be several times too large.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fenics_mortar.contact.interface import or_other_weights
from fenics_mortar.utils.errors import format_point
from fenics_mortar.verify.checks.balance import positive_or_one
from fenics_mortar.verify.finding import LIMITS, Finding, Measured


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Mean distance of nodes from the obstacle, weighted by their forces (local)."""
    contact = measured.contact
    if contact.slave.dim == 2 or contact.obstacle is None or contact.now.closing is not None:
        return
    o = contact.on_obstacle
    forces = np.abs(np.einsum("jc,jc->j", contact.now.forces[0], o.n))
    away = forces * np.abs(o.phi - contact.now.offset) / contact.slave.nodal_lengths
    part = float(away.sum()) / positive_or_one(float(forces.sum()))
    where = format_point(o.x[away.argmax()])
    yield Finding(
        "obstacle_edges",
        "mean distance of loaded nodes from the obstacle",
        part,
        f"loaded nodes are {part:.2f} facets away from the obstacle, that with the largest product "
        f"at {where}: facets reach beyond an edge of the obstacle, and the force may be several "
        "times too large; refine them until they are smaller than the rounding of the edge"
        f"{or_other_weights(contact)}",
        limit=LIMITS.penetration,
        remark=LIMITS.coarse_distance,
        unit="facet lengths",
        where=where,
    )
