# SPDX-License-Identifier: MIT
"""Roundoff of the residual, and check that contact rows are equal on all ranks."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.interface import Interface
from fenics_mortar.utils.errors import MortarError
from fenics_mortar.utils.rounding import EPSILON, SOLVED


def roundoff_of(
    bulk: Bulk, contacts: Sequence[Interface], displacement: float, stiffness: float
) -> float:
    """Attainable accuracy of the residual, limited by roundoff [stress length] (collective).

    Args:
        bulk: The bodies.
        contacts: All pairs.
        displacement: Largest displacement of bodies and obstacles [length].
        stiffness: Largest diagonal entry of the bulk tangent [stress].
    """
    roundoff = stiffness * math.sqrt(bulk.num_dofs) * displacement
    for c in contacts:
        steepest = max(stiffness, c.now.steepness)
        largest = float(np.abs(c.slave.X).max())
        loads = sum([flux.rounding() for flux in c.fluxes])
        roundoff += (steepest * largest + loads) * math.sqrt(c.slave.num_nodes)
    return 4.0 * EPSILON * roundoff


def check_equal_on_ranks(total: float, squares: float, force2: float, num_ranks: int) -> None:
    """Check that replicated contact rows are equal on all ranks (local).

    Args:
        total: Sum over the ranks of the squared norm of the rows.
        squares: Sum over the ranks of the squared norm to the power of two.
        force2: Square of the reference force.
        num_ranks: Number of ranks.

    Raises:
        MortarError: On all ranks, if the rows differ.
    """
    mean = total / num_ranks
    spread = math.sqrt(max(squares / num_ranks - mean**2, 0.0))
    if spread > SOLVED * max(mean, force2):  # roundoff of the spread is sqrt(EPSILON) = 1.5e-8
        raise MortarError(
            "the equations of contact differ between ranks: expected the same law, distance and "
            "attributes of contacts and obstacles on all ranks"
        )
