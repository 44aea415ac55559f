# SPDX-License-Identifier: MIT
"""Linearized balance of driven obstacles: the border of the system of u and z.

The equations of displacement and multipliers, in either form, are extended by the columns C_q of
the contact law and by a row of balance for each motion,

    E_d du + M_q z + E_q dq = push,    M_q z = f_q,

where E are the derivatives of f_q at fixed z. D does not depend on q, so the rows of the bodies
have no entries in the new columns.
"""

from __future__ import annotations

import numpy as np

from fenics_mortar.la.system import LinearSystem
from fenics_mortar.rigid.bordered import Border
from fenics_mortar.rigid.motions import ObstacleMotions


def linearize_balance(motions: ObstacleMotions, system: LinearSystem) -> Border:
    """C_q, [E_d, M_q] and E_q of all motions, driven or not (collective).

    Args:
        motions: The obstacles.
        system: System of displacement and multipliers; columns and rows are its vectors.
    """
    count, size = motions.scales.size, system.bulk.num_owned
    columns = np.zeros((count, size + system.num_z_dofs))
    rows, corner = np.zeros_like(columns), np.zeros((count, count))
    for contact, z_dofs in zip(motions.contacts, system.z_dofs, strict=True):
        if contact.obstacle is None:
            continue
        first = 3 * motions.obstacles.index(contact.obstacle)
        own = slice(first, first + 3)
        E_d, M_q, E_q = contact.on_obstacle.motion_force_derivatives(contact.z)
        acting = M_q * contact.acts[:, None]
        multipliers = size + system.local(contact, z_dofs)
        mine = contact.slave.owned
        columns[own, multipliers] += np.moveaxis(contact.rows.by_motions()[mine], 2, 0)
        rows[own, multipliers] += acting[:, mine]
        for flux in contact.fluxes:
            flux.add_by_motions(columns[own])
        for row, forces in zip(rows[own], E_d, strict=True):
            contact.slave.scatter_add(forces, row)
        corner[own, own] += E_q
    return Border(columns, rows, corner)
