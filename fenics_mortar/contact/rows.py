# SPDX-License-Identifier: MIT
"""Rows of the multipliers of a contact: gap and contact law.

Rows of gaps are weighted by k_j / D_jj, rows of the law by D_jj, and rows of a closing gap by k_j,
so that all have the units of the bulk rows. They are combined into Cartesian components: n
(row of the gap) - tau (tangential row), or for an open node - n (normal row) - tau
(tangential row).

In space the law has rows along two tangents, with the weights e D and t D.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.law import VectorRow
from fenics_mortar.contact.space_fields import SpaceFields
from fenics_mortar.interface.mortar import Block, scaled
from fenics_mortar.interface.space_mortar import SpaceOperators
from fenics_mortar.kernels.blocks import expand_rows, linearize_law
from fenics_mortar.kernels.complementarity import measure_rows, tabulate_frame
from fenics_mortar.utils.arrays import Array

# Weights of the rows: n k / D of gaps, nodal areas of multipliers that do not act, tau D and n D of
# the law; with a closing gap of the law, weights of gaps are zero, and the weight -n k of the
# closing gap follows. Weights are zero at nodes without such a row. Shapes (slave nodes, 2), the
# second (slave nodes,). Ties have other weights, see ``tied_rows``.
Frame = tuple[Array, ...]


@dataclass(frozen=True)
class Rows:
    """The rows of the multipliers: blocks . dd + A_z z = rhs, in the units of the bulk's rows.

    Attributes:
        blocks: Blocks with rows that index z.ravel(), and dofs as columns.
        A_z: Shape (slave nodes, c, c) [length].
        rhs: Shape (slave nodes, c) [stress length].
        frame: Weights of the rows.
    """

    blocks: list[Block]
    A_z: Array
    rhs: Array
    frame: Frame


class InterfaceRows(ABC):
    """Rows of the multipliers of an interface, in the units of the bulk's rows (local).

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
        """Rows weighted by ``frame``, zero at a solution, (slave nodes, c) [stress length]."""


class ContactRows(InterfaceRows):
    """Rows of a contact: gap and contact law; the frame is that of ``Frame``."""

    def linearized(self) -> Rows:
        """See ``InterfaceRows``."""
        f: ContactFields = self._interface.now
        o = f.operators
        normal, idle, *weights = frame = self.frame()
        blocks: list[Block] = []
        rhs, by_gap = -normal * o.gap[:, None], np.zeros(normal.shape)
        A_z = np.zeros((*normal.shape, 2))
        A_z[:, 0, 0] = A_z[:, 1, 1] = -idle
        for weight, row in zip(weights, f.law_rows, strict=True):
            if not weight.any():
                continue
            slips, change = row.by_slip.any(), np.empty_like(o.dn)
            rotated = f.state.partners.rotated(o) if slips else np.zeros(normal.shape)
            linearize_law(weight, *row, o.n, o.dn, f.state.z, rotated, A_z, rhs, by_gap, change)
            j = f.interface.slave.owned[f.acts[f.interface.slave.owned]]
            rows = 2 * j[:, None] + np.arange(2)
            blocks.append(Block(rows, o.normal_columns()[j], change[j]))
            if slips:
                along = -weight * row.by_slip[:, None]
                blocks += [normal_rows(block, along) for block in f.state.partners.derivative(o)]
        return Rows([*gap_rows(f, normal, by_gap), *blocks], A_z, rhs, frame)

    def measure(self) -> tuple[float, float]:
        """See ``InterfaceRows``."""
        f: ContactFields = self._interface.now
        tangential, opening, *_ = f.law_rows
        squares, gap = measure_rows(
            f.covered_gap, f.nodal_lengths, f.interface.stiffness, f.operators.diagonal,
            opening.residual, tangential.residual, f.state.active, f.attracted,
        )  # fmt: skip
        return squares, gap

    def followed(self) -> Array:
        """See ``InterfaceRows``: the normal row of an active node has -k n_j . dd_j."""
        f: ContactFields = self._interface.now
        n = f.operators.n * f.state.active[:, None]
        return -np.einsum("ja,jb->jab", n, n)

    def frame(self) -> Frame:
        """See ``Frame``."""
        f: ContactFields = self._interface.now
        o = f.operators
        count, k = len(o.n), f.interface.stiffness
        (normal, along, opening), idle = np.empty((3, count, 2)), np.empty(count)
        tabulate_frame(
            o.n, o.diagonal, f.nodal_areas, k, f.state.active, f.attracted, normal, idle, along,
            opening,
        )  # fmt: skip
        if f.closing is None:
            return normal, idle, along, opening
        by_law = np.where(f.state.active, k, 0.0)
        return np.zeros_like(normal), idle, along, opening, -o.n * by_law[:, None]

    def weighted(self, frame: Frame) -> Array:
        """See ``InterfaceRows``."""
        f: ContactFields = self._interface.now
        normal, idle, *weights = frame
        rows = normal * f.operators.gap[:, None] - idle[:, None] * f.state.z
        for weight, row in zip(weights, f.law_rows, strict=True):
            rows = rows - weight * row.residual[:, None]
        return rows

    def by_motions(self) -> Array:
        """Derivative of the rows by obstacle motions, (slave nodes, dim, m) [stress]."""
        f: ContactFields = self._interface.now
        normal, _, *weights = self.frame()
        rows = np.einsum("ja,jm->jam", normal, f.on_obstacle.dgap_dq)
        for weight, row in zip(weights, f.vector_rows, strict=True):
            rows = rows - np.einsum("ja,jm->jam", weight, row_by_motions(f, row))
        return rows


def gap_by_motions(f: ContactFields) -> Array:
    """d(mean gaps)/d(obstacle motions), (slave nodes, m) [1]; zero at uncovered nodes."""
    o, on = f.on_obstacle, f.covered[:, None]
    return np.where(on, o.dgap_dq / np.where(on, o.weight[:, None], 1.0), 0.0)


def row_by_displacements(f: ContactFields, row: VectorRow) -> Iterator[Block]:
    """Blocks of the derivative of a row by displacements, rows are slave nodes, of this rank."""
    o, own = f.operators, f.interface.slave.owned
    turned = o.normal_derivative(row.by_normal)[own]
    yield Block(own[:, None], o.normal_columns()[own], turned[:, None])
    if row.by_gap.any():
        per_weight = np.where(f.covered, row.by_gap / np.where(f.covered, o.weight, 1.0), 0.0)
        for block in o.gap_derivative():
            yield scaled(block, per_weight)
        for block in o.weight_derivative():
            yield scaled(block, -per_weight * f.mean_gap)
    if row.by_slip.any():
        yield from f.slip_derivative(row.by_slip)


def row_by_motions(f: ContactFields, row: VectorRow) -> Array:
    """Derivative of a row by motions of an obstacle, (slave nodes, m) [row / length] (local)."""
    o = f.on_obstacle
    change = np.einsum("ja,jam->jm", row.by_normal, o.dn_dq)
    if row.by_gap.any():
        change = change + row.by_gap[:, None] * gap_by_motions(f)
    if row.by_slip.any():
        slip, (count, motions) = f.state.partners.derivative_by_motions(o), change.shape
        parts = row.by_slip.reshape(count, -1), slip.reshape(count, -1, motions)
        change = change + np.einsum("ja,jam->jm", *parts)
    return np.asarray(change)


def gap_rows(f: ContactFields, normal: Array, scaled_tau: Array) -> list[Block]:
    """Rows ``normal`` (slave nodes, dim) dg - ``scaled_tau`` d(g / w) (local).

    Both are zero where no multiplier acts.
    """
    o = f.acting
    if not scaled_tau.any():
        return [normal_rows(block, normal) for block in o.gap_derivative()]
    per_weight = np.where(f.covered, 1.0 / np.where(f.covered, o.weight, 1.0), 0.0)
    along = scaled_tau * per_weight[:, None]
    blocks = [normal_rows(block, normal - along) for block in o.gap_derivative()]
    mean = along * (o.gap * per_weight)[:, None]
    return blocks + [normal_rows(block, mean) for block in o.weight_derivative()]


def normal_rows(block: Block, direction: Array) -> Block:
    """Expand nodal rows to the components of ``direction`` (slave nodes, dim) (local)."""
    count, size = block.rows.shape
    dim = direction.shape[1]
    rows = np.empty((count, dim * size), np.int64)
    values = np.empty((count, dim * size, block.columns.shape[1]))
    expand_rows(direction, *map(np.ascontiguousarray, (block.rows, block.values)), rows, values)
    return Block(rows, block.columns, values)


class SpaceRows(ContactRows):
    """Rows of a contact in space."""

    def linearized(self) -> Rows:
        """See ``InterfaceRows``."""
        f: SpaceFields = self._interface.now
        o, z, own = f.operators, f.z_u, f.interface.slave.owned
        if isinstance(o, SpaceOperators):
            f.acting.linearize_at(z)  # with the forces, which are differentiated next
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
