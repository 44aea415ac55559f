# SPDX-License-Identifier: MIT
"""Rows of the multipliers of a contact in space: gap, and the law along two tangents.

See ``rows`` for units and weights; the rows along both tangents have the weights e D and t D.
"""

from __future__ import annotations

import numpy as np

from fenics_mortar.contact.rows import ContactRows, Frame, Rows, gap_rows, normal_rows
from fenics_mortar.contact.space_fields import SpaceFields
from fenics_mortar.interface.linearization import Block
from fenics_mortar.interface.space_mortar import SpaceOperators
from fenics_mortar.kernels.complementarity import measure_rows
from fenics_mortar.utils.arrays import Array


class SpaceRows(ContactRows):
    """Rows of a contact in space."""

    def linearized(self) -> Rows:
        """See ``InterfaceRows``."""
        f: SpaceFields = self._interface.now
        o, z, own = f.operators, f.z_u, f.interface.slave.owned
        if isinstance(o, SpaceOperators):
            o.linearize_at(z)  # with the forces, which are differentiated next
        normal, idle, *weights = frame = self.frame()
        rhs, by_gap = -normal * o.gap[:, None], np.zeros(normal.shape)
        A_z, blocks = -idle[:, None, None] * np.eye(3), list[Block]()
        j = own[f.acts[own]]
        numbers, columns = 3 * j[:, None] + np.arange(3), o.normal_columns()[j]
        for weight, row in zip(weights, f.vector_rows, strict=True):
            if not weight.any():
                continue
            A_z = A_z - weight[:, :, None] * row.by_z[:, None]
            constant = row.residual - np.einsum("ja,ja->j", row.by_z, z)
            rhs += weight * constant[:, None]
            by_gap += weight * row.by_gap[:, None]
            turned = np.einsum("ja,jaq->jq", row.by_normal[j], o.dn[j])
            blocks.append(Block(numbers, columns, -weight[j][:, :, None] * turned[:, None]))
            if row.by_slip.any():
                of_slip = f.state.partners.derivative(o, row.by_slip)
                blocks += [normal_rows(block, -weight) for block in of_slip]
        return Rows([*gap_rows(f, normal, by_gap), *blocks], A_z, rhs, frame)

    def measure(self) -> tuple[float, float]:
        """See ``InterfaceRows``."""
        f: SpaceFields = self._interface.now
        along, across, opening, *_ = f.vector_rows
        return measure_rows(
            f.covered_gap, f.nodal_lengths, f.interface.stiffness, f.operators.diagonal,
            opening.residual, np.hypot(along.residual, across.residual), f.state.active,
            f.attracted,
        )  # fmt: skip

    def frame(self) -> Frame:
        """See ``Frame``: weights of gap, idle multipliers, both tangents and open nodes."""
        f: SpaceFields = self._interface.now
        o, k, (e, t) = f.operators, f.interface.stiffness, f.row_tangents
        active, acts = f.state.active, f.acts
        per_gap = np.where(active, k / np.where(active, o.diagonal, 1.0), 0.0)
        of_law = np.where(acts, o.diagonal, 0.0)[:, None]
        opening = np.where(f.attracted, o.diagonal, 0.0)[:, None] * o.n
        idle = np.where(acts, 0.0, f.nodal_areas)
        weights = per_gap[:, None] * o.n, idle, of_law * e, of_law * t, opening
        if f.closing is None:
            return weights
        by_law = np.where(active, k, 0.0)
        return np.zeros_like(o.n), *weights[1:], -o.n * by_law[:, None]

    def weighted(self, frame: Frame) -> Array:
        """See ``InterfaceRows``; the tangential rows are components of one vector."""
        f: SpaceFields = self._interface.now
        normal, idle, *along, opening = frame[:5]
        rows = normal * f.operators.gap[:, None] - idle[:, None] * f.state.z
        tangential, others = f.vector_rows[:2], f.vector_rows[2:]
        R = sum(
            row.residual[:, None] * a for row, a in zip(tangential, f.row_tangents, strict=True)
        )
        for weight in along:  # D e or D t, zero where no multiplier acts
            size = np.linalg.norm(weight, axis=1)
            component = np.einsum("ja,ja->j", weight, R) / np.where(size > 0.0, size, 1.0)
            rows = rows - weight * component[:, None]
        for weight, row in zip((opening, *frame[5:]), others, strict=True):
            rows = rows - weight * row.residual[:, None]
        return rows
