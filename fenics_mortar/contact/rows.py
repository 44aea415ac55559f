# SPDX-License-Identifier: MIT
"""Rows of the multipliers of a contact: gap and contact law.

Rows of gaps are weighted by k_j / D_jj, rows of the law by D_jj, and rows of a closing gap by k_j,
so that all have the units of the bulk rows. They are combined into Cartesian components: n
(row of the gap) - tau (tangential row), or for an open node - n (normal row) - tau
(tangential row).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.laws import Row
from fenics_mortar.interface.mortar import Block
from fenics_mortar.kernels.complementarity import measure_rows
from fenics_mortar.utils.arrays import Array

# Weights of the rows: n k / D of gaps, nodal areas of multipliers that do not act, tau D and n D of
# the law; with a closing gap of the law, weights of gaps are zero, and the weight -n k of the
# closing gap follows. Weights are zero at nodes without such a row. Shapes (slave nodes, 2), the
# second (slave nodes,). Ties have other weights, see ``tied_rows``.
Frame = tuple[Array, ...]


@dataclass(frozen=True)
class Rows:
    """The rows of the multipliers: blocks . dd + A_z z = rhs, in force units.

    Attributes:
        blocks: Blocks with rows 2 j + component and displacement dofs as columns.
        A_z: Shape (slave nodes, 2, 2) [length].
        rhs: Shape (slave nodes, 2) [stress length].
    """

    blocks: list[Block]
    A_z: Array
    rhs: Array


class InterfaceRows(ABC):
    """Rows of the multipliers of an interface, in force units (local).

    Args:
        interface: The interface; its present fields ``now`` are used.
    """

    def __init__(self, interface: Any) -> None:
        self._interface = interface

    @abstractmethod
    def linearized(self) -> Rows:
        """The linearized rows; shapes and units are those of ``Rows``."""

    @abstractmethod
    def measure(self) -> tuple[float, float]:
        """Size of the nonlinear rows.

        Returns:
            Sum of squares of their left sides as forces [stress^2 length^2], and the largest mean
            gap of an active node over its length [1].
        """

    @abstractmethod
    def followed(self) -> Array:
        """Diagonal blocks of the rows of active nodes, divided by their stiffness.

        Plus or minus the dyads of the constrained directions, shape (slave nodes, 2, 2) [1].
        """

    @abstractmethod
    def frame(self) -> Frame:
        """Weights of the rows at the present state."""

    @abstractmethod
    def weighted(self, frame: Frame) -> Array:
        """Nonlinear rows weighted by ``frame``, zero at a solution, shape (slave nodes, 2)."""


class ContactRows(InterfaceRows):
    """Rows of a contact: gap and contact law; the frame is that of ``Frame``."""

    def linearized(self) -> Rows:
        """See ``InterfaceRows``."""
        f: ContactFields = self._interface.now
        o = f.operators
        normal, idle, *laws = self.frame()
        blocks: list[Block] = []
        rhs, by_gap = -normal * o.gap[:, None], np.zeros_like(normal)
        A_z = -idle[:, None, None] * np.eye(2)
        for scaled, row in zip(laws, f.law_rows, strict=True):
            if not scaled.any():
                continue
            by_z = row.by_z_tau[:, None] * o.tau + row.by_z_n[:, None] * o.n
            A_z = A_z - scaled[:, :, None] * by_z[:, None, :]
            rhs = rhs + scaled * (row.residual - np.einsum("ja,ja->j", by_z, f.state.z))[:, None]
            blocks += _nodal_rows(f, scaled, row)
            by_gap = by_gap + scaled * row.by_gap[:, None]
        return Rows([*_gap_rows(f, normal, by_gap), *blocks], A_z, rhs)

    def measure(self) -> tuple[float, float]:
        """See ``InterfaceRows``."""
        f: ContactFields = self._interface.now
        tangential, opening, *_ = f.law_rows
        return measure_rows(
            f.covered_gap, f.nodal_lengths, f.sides.stiffness, f.operators.diagonal,
            opening.residual, tangential.residual, f.state.active, f.attracted,
        )  # fmt: skip

    def followed(self) -> Array:
        """See ``InterfaceRows``: the normal row of an active node has -k n_j . dd_j."""
        f: ContactFields = self._interface.now
        n = f.operators.n * f.state.active[:, None]
        return -np.einsum("ja,jb->jab", n, n)

    def frame(self) -> Frame:
        """See ``Frame``."""
        f: ContactFields = self._interface.now
        o = f.operators
        diagonal = np.where(f.acts, o.diagonal, f.nodal_areas)
        closing = np.where(f.state.active, f.sides.stiffness / diagonal, 0.0)
        idle = np.where(f.acts, 0.0, diagonal)
        along, opening = diagonal * f.acts, diagonal * f.attracted
        of_law = o.tau * along[:, None], o.n * opening[:, None]
        if f.closing is None:
            return o.n * closing[:, None], idle, *of_law
        by_law = np.where(f.state.active, f.sides.stiffness, 0.0)
        return np.zeros_like(o.n), idle, *of_law, -o.n * by_law[:, None]

    def weighted(self, frame: Frame) -> Array:
        """See ``InterfaceRows``."""
        f: ContactFields = self._interface.now
        normal, idle, *laws = frame
        rows = normal * f.operators.gap[:, None] - idle[:, None] * f.state.z
        for scaled, row in zip(laws, f.law_rows, strict=True):
            rows = rows - scaled * row.residual[:, None]
        return rows

    def by_motions(self) -> Array:
        """Derivative of the rows with respect to obstacle motions, (slave nodes, 2, 3)."""
        f: ContactFields = self._interface.now
        o, z = f.on_obstacle, f.state.z
        normal, _, *laws = self.frame()
        shear = z[:, 1:] * o.dn_dq[:, 0] - z[:, :1] * o.dn_dq[:, 1]
        pressure = np.einsum("ja,jam->jm", z, o.dn_dq)
        slip = f.state.partners.derivative_by_motions(o)
        rows = np.einsum("ja,jm->jam", normal, o.dgap_dq)
        for scaled, row in zip(laws, f.law_rows, strict=True):
            change = (
                row.by_z_tau[:, None] * shear
                + row.by_z_n[:, None] * pressure
                + row.by_slip[:, None] * slip
                + row.by_gap[:, None] * gap_by_motions(f)
            )
            rows = rows - np.einsum("ja,jm->jam", scaled, change)
        return rows


def gap_by_motions(f: ContactFields) -> Array:
    """d(mean gaps)/d(obstacle motions), (slave nodes, 3); zero at uncovered nodes."""
    o, on = f.on_obstacle, f.covered[:, None]
    return np.where(on, o.dgap_dq / np.where(on, o.weight[:, None], 1.0), 0.0)


def _gap_rows(f: ContactFields, normal: Array, scaled_tau: Array) -> list[Block]:
    """Rows ``normal`` (slave nodes, 2) dg - ``scaled_tau`` d(g / w)."""
    o = f.operators
    per_weight = np.where(f.covered, 1.0 / np.where(f.covered, o.weight, 1.0), 0.0)
    along = scaled_tau * per_weight[:, None]
    blocks = [_normal_rows(block, normal - along) for block in o.gap_derivative()]
    if along.any():
        mean = along * (o.gap * per_weight)[:, None]
        blocks += [_normal_rows(block, mean) for block in o.weight_derivative()]
    return blocks


def _nodal_rows(f: ContactFields, scaled: Array, row: Row) -> list[Block]:
    """Rows -``scaled`` (slave nodes, 2) d(rho), without the derivative with respect to gaps.

    Terms with the change of n and tau are included for the nodes owned by this rank.
    """
    o, slave, z, partners = f.operators, f.sides.slave, f.state.z, f.state.partners
    j = slave.owned[f.acts[slave.owned]]
    by_slip = scaled * row.by_slip[:, None]
    change = row.by_z_tau[:, None] * o.tangential_derivative(z)
    if row.by_z_n.any():
        change = change + row.by_z_n[:, None] * o.normal_derivative(z)
    if row.by_slip.any():
        apart = partners.apart(o)
        change = change + row.by_slip[:, None] * o.tangential_derivative(apart)
    rows = 2 * j[:, None] + np.arange(2)
    columns = o.normal_columns()[j]
    blocks = [Block(rows, columns, -scaled[j][:, :, None] * change[j][:, None, :])]
    if by_slip.any():
        blocks += [_normal_rows(block, -by_slip) for block in partners.derivative(o)]
    return blocks


def _normal_rows(block: Block, direction: Array) -> Block:
    """Expand nodal rows to two rows per node along ``direction`` (slave nodes, 2)."""
    values = np.einsum("bja,bjq->bjaq", direction[block.rows], block.values)
    shape = len(block.rows), 2 * block.rows.shape[1]
    rows = (2 * block.rows[:, :, None] + np.arange(2)).reshape(shape)
    return Block(rows, block.columns, values.reshape(*shape, block.columns.shape[1]))
