# SPDX-License-Identifier: MIT
"""Loose motions of obstacles: driven motions that active contact does not resist.

Tangent springs regularize them, see ``springs``.
"""

from __future__ import annotations

import numpy as np

from fenics_mortar.contact.rows import gap_by_motions
from fenics_mortar.rigid.motions import RigidMotions, describe_motion
from fenics_mortar.rigid.springs import tangent_stiffness, unresisted
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.rounding import SUM_ROUNDING


def loose_motions(motions: RigidMotions) -> list[Array]:
    """Loose motions of each obstacle, an orthonormal basis (n, motions) [1] each (local)."""
    found = []
    for number, driven in enumerate(motions.driven_obstacles):
        basis = np.eye(driven.size)[driven]
        closing = [gap_by_motions(c.now)[c.active] for c in motions.contacts_of(number)]
        found.append(
            unresisted(basis @ np.concatenate([*closing, np.zeros((0, driven.size))]).T) @ basis
        )
    return found


def tangent_springs(
    motions: RigidMotions, residual: Array, stiffness: float, force: float
) -> Array:
    """Stiffness of springs on loose motions, in proportion to the driving force (local).

    Args:
        motions: The rigid motions.
        residual: Residual of the balance, shape (m, 3) [stress length].
        stiffness: Stiffness of the bulk [stress].
        force: Size of all forces [stress length].

    Returns:
        Addition to E_q, shape (3 m, 3 m) [stress].
    """
    total, each = np.zeros((motions.scales.size,) * 2), motions.scales.shape[1]
    for number, loose in enumerate(loose_motions(motions)):
        own = slice(each * number, each * (number + 1))
        relative = tangent_stiffness(loose @ residual[number], force)
        total[own, own] = stiffness * relative * (loose.T @ loose)
    return total


def describe_loose(motions: RigidMotions, residual: Array, force: float) -> str:
    """Description of loose motions driven by forces; "" if there are none (local).

    Args:
        motions: The rigid motions.
        residual: Residual of the balance, shape (m, 3) [stress length].
        force: Size of all forces [stress length].
    """
    found = []
    for obstacle, loose, rest in zip(
        motions.obstacles, loose_motions(motions), residual[: len(motions.obstacles)], strict=True
    ):
        drive = loose @ rest
        if np.linalg.norm(drive) > SUM_ROUNDING * force:
            found.append(f"obstacle '{obstacle.name}' can {describe_motion(drive @ loose)}")
    return ", ".join(found)
