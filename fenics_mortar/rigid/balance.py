# SPDX-License-Identifier: MIT
"""Linearized balance of driven motions: the border of the system of u and z.

The equations of displacement and multipliers, in either form, are extended by columns C_q and by a
row of balance for each motion,

    E_d du + M_q z + E_q dq = push - f_0,    M_q z = f_q - f_0,

where E are the derivatives of f_q at fixed z, and f_0 is the part of f_q that does not depend on z.

Of obstacles, C_q is in the rows of the contact law, and f_0 = 0. D does not depend on q, so the
rows of the bodies have no entries in the new columns. Of rigid boundaries, C_q is in the rows of
the prescribed dofs, du - V dq, and [E_d, M_q] are the sums of the equations of these dofs, which
the rows of the prescribed dofs replace, with the weights V.

Spread loads have two more unknowns each, in space six, on which their forces depend; see
``spread``.
"""

from __future__ import annotations

import numpy as np

from fenics_mortar.la.system import LinearSystem
from fenics_mortar.rigid.bordered import Border
from fenics_mortar.rigid.motions import RigidMotions
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.ranks import sum_over_ranks


def border_of(motions: RigidMotions, system: LinearSystem) -> Border:
    """Border of all motions, driven or not, and of spread loads, see ``linearize_balance``."""
    motion = border = linearize_balance(motions, system)
    for load in motions.spread:
        spread = load.linearize(system)
        coupling = by_spread(motion, spread, system)
        spread.columns[:, system.bulk.prescribed_dofs] = 0.0
        border = border.joined(spread)
        border.corner[: len(coupling), -len(spread.corner) :] = coupling
    return border


def by_spread(motion: Border, spread: Border, system: LinearSystem) -> Array:
    """Derivatives of f_q by the unknowns of a spread load, (3 m, 2) [stress length] (collective).

    Its forces act on nodes that a rigid boundary prescribes, whose columns are -V.
    """
    return -sum_over_ranks(system.comm, motion.columns @ spread.columns.T)


def linearize_balance(motions: RigidMotions, system: LinearSystem) -> Border:
    """C_q, [E_d, M_q] and E_q of all motions, driven or not (collective).

    Args:
        motions: The rigid motions; their ``take_bulk_rows`` was called at this state.
        system: System of displacement and multipliers; columns and rows are its vectors.
    """
    count, size, each = motions.scales.size, system.bulk.num_owned, motions.scales.shape[1]
    columns = np.zeros((count, size + system.num_z_dofs))
    rows, corner = np.zeros_like(columns), np.zeros((count, count))
    for contact, z_dofs in zip(motions.contacts, system.z_dofs, strict=True):
        if contact.obstacle is None:
            continue
        first = each * motions.obstacles.index(contact.obstacle)
        own = slice(first, first + each)
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
    for number, load in enumerate(motions.remote, len(motions.obstacles)):
        own = slice(each * number, each * (number + 1))
        border = load.linearize(system)
        columns[own], rows[own], corner[own, own] = border.columns, border.rows, border.corner
    return Border(columns, rows, corner)
