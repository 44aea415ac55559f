# SPDX-License-Identifier: MIT
"""Operators, fields and rows of a tied pair.

The row of a multiplier node is the jump of the displacement, D u_s - M u_m, in all components; a
prescribed jump is included in u_m. Rows of tied fields are their jumps, see ``tied_field``.

A tie's multipliers have the components of the displacement, and one of each tied field.

A displacement of one causes forces of the stiffness k, and so do an amount ``unit`` of the field
and its residual times ``to_force``. With fluxes scaled by k / (D to_force) and rows of jumps
weighted by k / (D unit to_force), all entries have the size of those of the bulk in these rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np

from fenics_mortar.contact.components import Components
from fenics_mortar.contact.interface_fields import InterfaceFields, field
from fenics_mortar.contact.rows import Frame, InterfaceRows, Rows
from fenics_mortar.interface.mortar import Block
from fenics_mortar.interface.plane_mortar import PlaneOperators
from fenics_mortar.interface.space_mortar import SpaceOperators
from fenics_mortar.utils.arrays import Array, Flags


@dataclass(frozen=True, kw_only=True)
class TiedCurves(PlaneOperators):
    """D and M of the reference configuration; positions and normals are the current ones.

    Attributes:
        weighted_jump: D u_s - M u_m [length^2], and the jumps of the tied fields [field length],
            shape (slave nodes, c).
    """

    weighted_jump: Array

    def gap_derivative(self) -> list[Block]:
        """Empty: there is no weighted gap."""
        return []


@dataclass(frozen=True, kw_only=True)
class TiedFaces(SpaceOperators):
    """As ``TiedCurves``, in space."""

    weighted_jump: Array

    def gap_derivative(self) -> list[Block]:
        """Empty: there is no weighted gap."""
        return []


TiedOperators = TiedCurves | TiedFaces


class TiedFields(InterfaceFields):
    """Fields of a tie.

    Attributes:
        jump: D u_s - M u_m at the evaluated displacement, shape (slave nodes, dim) [length^2].
    """

    operators: TiedOperators

    @property
    def jumps(self) -> Array:
        """Jumps of displacement and fields, shape (slave nodes, c) [length^2, field length]."""
        return self.operators.weighted_jump

    @property
    def jump(self) -> Array:
        """D u_s - M u_m, shape (slave nodes, dim) [length^2]."""
        return self.jumps[:, : self.operators.slave.dim]

    @field("z")
    def z_u(self) -> Array:
        """Multipliers of the displacement, shape (slave nodes, dim) [stress]."""
        return np.ascontiguousarray(self.state.z[:, : self.operators.slave.dim])

    @property
    def gap(self) -> Array:
        """Mean relative displacement, (slave nodes,), nan without multiplier [length]."""
        on = self.state.active
        weight = np.where(on, self.operators.weight, 1.0)
        return np.where(on, np.linalg.norm(self.jump, axis=1) / weight, np.nan)


class TiedRows(InterfaceRows):
    """Rows of a tie: transposed force blocks, so that the system is symmetric.

    The frame consists of ``TiedComponents.idle`` and ``row_weight``. Rows of fields have the
    unit of their equations, those of displacements are symmetric to the forces.
    """

    def linearized(self) -> Rows:
        """See ``InterfaceRows``."""
        f: TiedFields = self._interface.now
        idle, weight = frame = self.frame()
        weights = weight.ravel()
        blocks = [
            Block(columns, rows, values * weights[columns[:, :, None]])
            for rows, columns, values in self._interface.load_blocks()
        ]
        A_z = -idle[:, :, None] * np.eye(idle.shape[1])
        return Rows(blocks, A_z, -weight * f.jumps, frame)

    def measure(self) -> tuple[float, float]:
        """See ``InterfaceRows``: the jump of active nodes."""
        f: TiedFields = self._interface.now
        of = self._interface.components
        rows = (f.interface.stiffness[:, None] / (of.weight * of.units)) * f.jumps
        gaps = np.where(f.state.active, f.gap, 0.0) / f.nodal_lengths
        return float((rows**2).sum()), float(gaps.max(initial=0.0))

    def followed(self) -> Array:
        """See ``InterfaceRows``; all directions are constrained."""
        return np.tile(np.eye(self._interface.slave.dim), (len(self._interface.z), 1, 1))

    def frame(self) -> Frame:
        """See ``InterfaceRows``."""
        of = self._interface.components
        return of.idle, of.row_weight

    def weighted(self, frame: Frame) -> Array:
        """See ``InterfaceRows``."""
        f: TiedFields = self._interface.now
        idle, weight = frame
        return weight * f.jumps - idle * f.state.z


class TiedComponents(Components):
    """Components of a tie; constant, arrays have the shape of z (local).

    Attributes:
        dofs: Global dofs of the slave whose equations yield the components.
        acts: Whether a component carries load, bool.
        free: One: only free dofs carry multipliers.
        diagonal: D_jj where a component acts, else the nodal area [length].
        weight: Row sum of D where a component acts, else infinite [length].
        units, to_force: See ``bulk.residual``; one for displacements.
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
        for c, flux in enumerate(tie.fluxes, dim):
            on, of_flux = flux.carriers, flux.operators
            self._dofs[flux.at, c] = flux.traces[0].dofs[:, 0]
            self._acts[on, c] = True
            self.diagonal[on, c] = of_flux.diagonal[flux.active]
            self.weight[on, c] = of_flux.weight[flux.active]

    def set_units(self, units: Array, to_force: Array, diagonal: Array) -> None:
        """See ``Components``."""
        for c, flux in enumerate(self._interface.fluxes, self._interface.slave.dim):
            self.units[flux.at, c] = flux.traces[0].gather(units)
            self.to_force[flux.at, c] = flux.traces[0].gather(to_force)

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
