# SPDX-License-Identifier: MIT
"""Operators, fields and rows of a tied pair.

The row of a multiplier node is the jump of the displacement, D u_s - M u_m, in both components; a
prescribed jump is included in u_m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_mortar.contact.interface_fields import InterfaceFields
from fenics_mortar.contact.rows import Frame, InterfaceRows, Rows
from fenics_mortar.interface.mortar import Block, MortarOperators
from fenics_mortar.utils.arrays import Array


@dataclass(frozen=True)
class TiedOperators(MortarOperators):
    """D and M of the reference configuration; positions and normals are the current ones.

    Attributes:
        weighted_jump: D u_s - M u_m, shape (slave nodes, 2) [length^2].
    """

    weighted_jump: Array

    def gap_derivative(self) -> list[Block]:
        """Empty: there is no weighted gap."""
        return []


class TiedFields(InterfaceFields):
    """Fields of a tie.

    Attributes:
        jump: D u_s - M u_m at the evaluated displacement, shape (slave nodes, 2) [length^2].
    """

    operators: TiedOperators

    @property
    def jump(self) -> Array:
        """D u_s - M u_m, shape (slave nodes, 2) [length^2]."""
        return self.operators.weighted_jump

    @property
    def gap(self) -> Array:
        """Mean relative displacement, (slave nodes,), nan without multiplier [length]."""
        on = self.state.active
        weight = np.where(on, self.operators.weight, 1.0)
        return np.where(on, np.linalg.norm(self.jump, axis=1) / weight, np.nan)


class TiedRows(InterfaceRows):
    """Rows of a tie: transposed force blocks, so that the system is symmetric.

    The frame is the diagonal of D [length], and the stiffness over it where active, each of shape
    (slave nodes,).
    """

    def linearized(self) -> Rows:
        """See ``InterfaceRows``."""
        f: TiedFields = self._interface.now
        diagonal, weight = frame = self.frame()
        blocks = [
            Block(block.columns, block.rows, block.values * weight[block.columns[:, :1, None] // 2])
            for block in self._interface.force_blocks()
        ]
        inactive = np.where(f.state.active, 0.0, -diagonal)
        A_z = inactive[:, None, None] * np.eye(2)
        return Rows(blocks, A_z, -weight[:, None] * f.jump, frame)

    def measure(self) -> tuple[float, float]:
        """See ``InterfaceRows``: the jump of active nodes."""
        f: TiedFields = self._interface.now
        length = np.where(f.state.active, f.operators.weight, np.inf)
        rows = (f.interface.stiffness / length)[:, None] * f.jump
        gaps = np.where(f.state.active, f.gap, 0.0) / f.nodal_lengths
        return float((rows**2).sum()), float(gaps.max(initial=0.0))

    def followed(self) -> Array:
        """See ``InterfaceRows``; both directions are constrained."""
        return np.tile(np.eye(2), (len(self._interface.z), 1, 1))

    def frame(self) -> Frame:
        """See ``InterfaceRows``."""
        f: TiedFields = self._interface.now
        diagonal = np.where(f.state.active, f.operators.diagonal, f.nodal_areas)
        return diagonal, np.where(f.state.active, f.interface.stiffness / diagonal, 0.0)

    def weighted(self, frame: Frame) -> Array:
        """See ``InterfaceRows``."""
        f: TiedFields = self._interface.now
        diagonal, weight = frame
        inactive = np.where(f.state.active, 0.0, diagonal)
        return weight[:, None] * f.jump - inactive[:, None] * f.state.z
