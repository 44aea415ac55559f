# SPDX-License-Identifier: MIT
"""Components of a tie's multipliers: those of the displacement, one of each tied field.

A displacement of one causes forces of the stiffness k, and so do an amount ``unit`` of the field
and its residual times ``to_force``. With fluxes scaled by k / (D to_force) and rows of jumps
weighted by k / (D unit to_force), all entries have the size of those of the bulk in these rows.
"""

from __future__ import annotations

from operator import attrgetter
from typing import Any

import numpy as np

from fenics_mortar.contact.components import Components
from fenics_mortar.utils.arrays import Array, Flags


class TiedComponents(Components):
    """Components of a tie; constant, arrays have the shape of z (local).

    Attributes:
        dofs: Global dofs of the slave whose equations yield the components.
        acts: Whether a component carries load, bool.
        free: One: only free dofs carry multipliers.
        diagonal: D_jj where a component acts, else the nodal area [length].
        weight: Row sum of D where a component acts, else infinite [length].
        units, to_force: See ``bulk.units``; one for displacements.
    """

    dofs: Any = property(attrgetter("_dofs"))
    acts: Any = property(attrgetter("_acts"))
    free: Any = property(attrgetter("_free"))

    def __init__(self, tie: Any) -> None:
        super().__init__(tie)
        self.units, self.to_force = np.ones((2, *tie.z.shape))

    def read(self) -> None:
        """Read the operators of displacement and fields, after each integration (local)."""
        tie = self._interface
        o, shape = tie.operators, tie.z.shape
        areas, active, dim = tie.slave.nodal_areas, tie.active, tie.slave.dim
        self._dofs, self._acts = np.empty(shape, np.int64), np.zeros(shape, bool)
        self.diagonal, self.weight = np.empty(shape), np.full(shape, np.inf)
        self._free = np.ones(shape)
        self._dofs[:, :dim], self._dofs[:, dim:] = tie.slave.dofs, tie.slave.dofs[:, :1]
        self._acts[:, :dim] = active[:, None]
        self.diagonal[:] = areas[:, None]
        self.diagonal[active, :dim] = o.diagonal[active, None]
        self.weight[active, :dim] = o.weight[active, None]
        for c, field in enumerate(tie.fluxes, dim):
            on, of_field = field.carriers, field.operators
            self._dofs[field.at, c] = field.traces[0].dofs[:, 0]
            self._acts[on, c] = True
            self.diagonal[on, c] = of_field.diagonal[field.active]
            self.weight[on, c] = of_field.weight[field.active]

    def set_units(self, units: Array, to_force: Array, diagonal: Array) -> None:
        """See ``Components``."""
        for c, field in enumerate(self._interface.fluxes, self._interface.slave.dim):
            self.units[field.at, c] = field.traces[0].gather(units)
            self.to_force[field.at, c] = field.traces[0].gather(to_force)

    @property
    def inverse(self) -> Array:
        """See ``Components``."""
        return np.where(self.acts, 1.0 / self.diagonal, 0.0)

    @property
    def scale(self) -> Array:
        """See ``Components``."""
        return self._interface.stiffness[:, None] / (self.diagonal * self.to_force)

    @property
    def row_weight(self) -> Array:
        """Factor of the rows of jumps, zero where no component acts [row / length / unit]."""
        weight = self._interface.stiffness[:, None] / (self.diagonal * self.units * self.to_force)
        return np.where(self.acts, weight, 0.0)

    @property
    def idle(self) -> Array:
        """Factor of components that do not act in their own rows, else zero [length]."""
        return np.where(self.acts, 0.0, self.diagonal)

    @property
    def some_carry(self) -> Flags:
        """See ``Components``."""
        return self.acts.any(axis=1)

    @property
    def all_carry(self) -> Flags:
        """See ``Components``."""
        return self.acts.all(axis=1)
