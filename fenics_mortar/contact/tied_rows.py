# SPDX-License-Identifier: MIT
"""Operators, fields and rows of a tied pair.

The row of a multiplier node is the jump of the displacement, D u_s - M u_m, in all components; a
prescribed jump is included in u_m. Rows of tied fields are their jumps, see ``tied_field``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_mortar.contact.interface_fields import InterfaceFields, field
from fenics_mortar.contact.rows import Frame, InterfaceRows, Rows
from fenics_mortar.interface.linearization import Block
from fenics_mortar.interface.plane_mortar import PlaneOperators
from fenics_mortar.interface.space_mortar import SpaceOperators
from fenics_mortar.utils.arrays import Array


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
