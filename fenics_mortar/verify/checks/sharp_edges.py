# SPDX-License-Identifier: MIT
"""Direction of the forces on sharp edges of the slave in space; in the plane see ``corners``.

The force on a node acts along its normal. At a sharp edge that is oblique to the master on both
sides, as that of a knife, it is an average that depends on the facets beside the edge, not the
normal of the surface on which the edge presses.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.ranks import sum_over_ranks
from fenics_mortar.verify.checks.balance import positive_or_one
from fenics_mortar.verify.checks.corners import OF_FRICTION
from fenics_mortar.verify.finding import LIMITS, Finding, Measured

if TYPE_CHECKING:
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.utils.arrays import Array

IN_SPACE_ONLY = True


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Fraction of the normal forces that acts along the master at sharp edges (collective)."""
    contact, limit = measured.contact, LIMITS.at_corners
    if contact.obstacle is not None or not contact.evaluation.sharp_edges.nodes.size:
        return
    forces, along = _forces_along_master(contact, measured.pressure)
    sharp = contact.evaluation.sharp_edges.nodes
    shear = float(along[sharp].sum()) / positive_or_one(float(forces.sum()))
    compared, where = "", format_point(contact.operators.x[sharp[along[sharp].argmax()]])
    if contact.pair.law.has_friction and measured.friction > 0.0:
        limit = min(limit, max(OF_FRICTION * measured.friction, LIMITS.negligible))
        compared = f", compared with a friction of {measured.friction:.2g}"
    yield Finding(
        "corner_shear", "force along the surface due to sharp edges / normal force", shear,
        f"{shear:.1%} of the normal forces act along '{contact.master.name}'{compared}: a sharp "
        f"edge of the slave presses at {where}, along the normal of a facet beside it, or their "
        "average; "
        f"{measured.other_roles}round the edge",
        remark=limit, where=where,
    )  # fmt: skip


def _forces_along_master(contact: Contact, pressure: Array) -> tuple[Array, Array]:
    """Normal forces and their components along the master's facets, (slave nodes,) (collective).

    Args:
        contact: The pair.
        pressure: Normal multipliers, shape (slave nodes,) [stress].

    Returns:
        Two arrays of norms, each (slave nodes,) [stress length^2].
    """
    o, s = contact.operators, contact.operators.segments
    nodes, corners = o.facet_nodes[s.owner], o.m[s.master[:, : contact.master.corners.shape[1]]]
    ends = corners[:, -2] - corners[:, 0], corners[:, -1] - corners[:, -3]  # diagonals or edges
    normals = np.cross(*ends)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    forces = (o.M.sum(axis=2) * pressure[nodes])[..., None] * o.n[nodes]
    across = np.einsum("pkc,pc->pk", forces, normals)
    nodal = np.zeros((2, len(o.x), 3))
    np.add.at(nodal[0], nodes, forces)
    np.add.at(nodal[1], nodes, forces - across[..., None] * normals[:, None])
    total, along = np.linalg.norm(sum_over_ranks(contact.slave.comm, nodal), axis=2)
    return total, along
