# SPDX-License-Identifier: MIT
"""The state of a pair as checks of the certificate see it, with quantities that several need."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.verify.limits import LIMITS


@dataclass(frozen=True)
class Measured:
    """An evaluated pair; all properties are local.

    Attributes:
        contact: The pair.
        bulk: The bodies.
        labels: Body of each local node, shape (local nodes,).
        paired: Global numbers of the nodes with a partner in any pair, ascending.
    """

    contact: Contact
    bulk: Bulk
    labels: Indices
    paired: Indices

    @cached_property
    def pressure(self) -> Array:
        """Normal multipliers, shape (slave nodes,) [stress]."""
        return np.asarray(np.einsum("jc,jc->j", self.contact.operators.n, self.contact.z))

    @cached_property
    def friction_limit(self) -> Array:
        """Largest shears, zero at nodes without contact, shape (slave nodes,) [stress]."""
        contact = self.contact
        may_transfer = contact.acts if contact.pair.law.bridges_gap else contact.active
        return np.where(may_transfer, contact.now.friction_limit(self.pressure), 0.0)

    @cached_property
    def largest_pressure(self) -> float:
        """Reference of pressures [stress]; above rounding."""
        smallest = LIMITS.min_pressure * float(self.contact.modulus.max())
        return max(float(np.abs(self.pressure).max()), smallest)

    @cached_property
    def friction(self) -> float:
        """Sum of friction limits over sum of pressures, of nodes under pressure [1]."""
        return mean_friction(self.friction_limit, self.pressure)

    @property
    def other_roles(self) -> str:
        """Advice to exchange slave and master; "" for a surface in contact with itself."""
        slave, master = self.contact.slave.name, self.contact.master.name
        return f"take '{master}' as slave and '{slave}' as master, or " * (slave != master)


def mean_friction(limit: Array, pressure: Array) -> float:
    """Sum of friction limits over sum of pressures, of nodes under pressure [1] (local).

    Args:
        limit: Friction limit of each node, shape (slave nodes,) [stress].
        pressure: Normal multipliers, shape (slave nodes,) [stress].
    """
    presses = (pressure > 0.0) & (limit > 0.0)
    return float(limit[presses].sum() / pressure[presses].sum()) if presses.any() else 0.0
