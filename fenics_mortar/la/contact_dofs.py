# SPDX-License-Identifier: MIT
"""Dofs of all contact surfaces with consecutive numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.interface import Interface
from fenics_mortar.la.sparse import SomeRows
from fenics_mortar.utils.arrays import Array, Indices


class ContactDofs(SomeRows):
    """Dofs of all contact surfaces with consecutive numbers, replicated.

    Attributes:
        size: Number of contact dofs.
        free: Whether a dof is not prescribed, shape (size,), bool.
        free_globals: Global numbers of the dofs, -1 for prescribed ones, shape (size,).
    """

    def __init__(self, contacts: Sequence[Interface], bulk: Bulk) -> None:
        self._surfaces = [side for contact in contacts for side in (contact.slave, contact.master)]
        dofs = np.concatenate([surface.dofs for surface in self._surfaces])
        super().__init__(dofs, bulk.first, bulk.num_owned)
        self.size = self.rows.size
        self.free = self.gather(bulk.prescribed.astype(float)) == 0.0
        self.free_globals: Indices = np.where(self.free, self.rows, -1)

    def gather(self, values: Array) -> Array:
        """``values`` (local dofs,) [any unit] at the contact dofs, shape (size,) (collective)."""
        result = np.zeros(self.size)
        for surface in self._surfaces:
            result[self.number(surface.dofs)] = surface.gather(values)
        return result

    def put(self, values: Array, target: Array) -> None:
        """Write ``values`` (size,) into ``target`` (local dofs,) (local)."""
        for surface in self._surfaces:
            target[surface.local_dofs] = values[self.number(surface.dofs[surface.owned])]
