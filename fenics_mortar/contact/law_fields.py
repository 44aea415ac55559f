# SPDX-License-Identifier: MIT
"""Fields of a contact whose law has a closing gap, memory, or parameters that vary in space."""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter
from typing import Any

import numpy as np

from fenics_mortar.contact.fields import LAW_ATTRIBUTES, RULED, ContactFields
from fenics_mortar.contact.interface_fields import field
from fenics_mortar.contact.nodal import Nodal, Row, chain_rule
from fenics_mortar.utils.arrays import Array, Flags


class LawFields(ContactFields):
    """Fields for laws of more than gap, slip and multiplier; see ``Law.needs_nodal_state``.

    In ``nodal`` the closing gap replaces the mean gap.
    """

    covered_gap: Any = property(attrgetter("nodal.gap"))

    @field(*LAW_ATTRIBUTES)
    def of_geometry(self) -> Nodal:
        """Arguments of the law with the mean gap."""
        return ContactFields.nodal.func(self)

    @field(*LAW_ATTRIBUTES)
    def closing(self) -> Row | None:
        """See ``ContactFields``; the mean gap at uncovered nodes, no slip on symmetry planes."""
        law, node = self.interface.pair.law, self.of_geometry
        if not law.has_closing_gap:
            return None
        on, x = self.covered, self.operators.x
        row = self._without_slip_on_planes(self.interface.law_calls.closing_gap(law, node, on, x))
        plain = Row(node.gap, 1.0, 0.0, 0.0, 0.0)
        return Row(*(np.where(on, a, b) for a, b in zip(row, plain, strict=True)))

    def _without_slip_on_planes(self, row: Row) -> Row:
        """The row with zero slip on symmetry planes."""
        on_plane = np.isfinite(self.interface.plane_normals[:, 0])
        return row._replace(by_slip=np.where(on_plane, 0.0, row.by_slip))

    @field(*LAW_ATTRIBUTES)
    def nodal(self) -> Nodal:
        """See ``ContactFields``; with the closing gap."""
        row = self.closing
        return self.of_geometry if row is None else replace(self.of_geometry, gap=row.residual)

    @field(*LAW_ATTRIBUTES)
    def closing_gap(self) -> Array:
        """See ``InterfaceFields``."""
        return self.fill_inside(np.where(self.covered, self.nodal.gap, np.nan))

    @property
    def offset(self) -> Array:
        """See ``InterfaceFields``; minus the thickness of the law's layer."""
        return np.asarray(self.state.offset - (self.nodal.gap - self.of_geometry.gap))

    @field(*LAW_ATTRIBUTES)
    def pull(self) -> Row:
        """Adhesion at closing gaps, extrapolated linearly to negative ones, each (slave nodes,)."""
        law, node, none = self.interface.pair.law, self.nodal, np.zeros(len(self.state.z))
        if not law.has_adhesion:
            return Row(none, none, none, none, none)
        opened = replace(node, gap=np.maximum(node.gap, 0.0))
        row = self.interface.law_calls.adhesion_at(law, opened, self.covered, self.operators.x)
        row = self._without_slip_on_planes(row)
        row = row._replace(residual=row.residual + row.by_gap * np.minimum(node.gap, 0.0))
        return Row(*(np.where(self.covered, values, 0.0) for values in row))

    @field(*LAW_ATTRIBUTES)
    def adhesion(self) -> tuple[Array, Array]:
        """See ``ContactFields``."""
        return self.pull.residual, self.pull.by_gap

    @field(*LAW_ATTRIBUTES, "active")
    def attracted(self) -> Flags:
        """See ``ContactFields``."""
        return (self.adhesion[0] > 0.0) & ~self.state.active

    @field(*LAW_ATTRIBUTES, "active")
    def acts(self) -> Flags:
        """See ``ContactFields``."""
        return self.state.active | self.attracted

    @field(*RULED)
    def law_rows(self) -> tuple[Row, ...]:
        """See ``ContactFields``; with a closing gap of the law its row is the third."""
        _, opening = ContactFields.law_rows.func(self)
        tangential = self.tangential_row
        by_z_n = opening.by_z_n + self.pull.by_z_n
        opening = opening._replace(
            by_slip=self.pull.by_slip, by_z_n=by_z_n, by_z_tau=self.pull.by_z_tau
        )
        closing = self.closing
        rows = [tangential, opening]
        if closing is not None:
            rows = [chain_rule(tangential, closing), chain_rule(opening, closing), closing]
        return tuple(self.at_gaps(row) for row in rows)

    def friction_limit(self, pressure: Array) -> Array:
        """See ``ContactFields``; at closed gaps."""
        node = replace(self.nodal, z_n=pressure, gap=np.zeros_like(pressure))
        return self.interface.law_calls.friction_limit_at(
            self.interface.pair.law, node, self.operators.x
        )

    def closed_adhesion(self) -> Array:
        """See ``ContactFields``."""
        law, none = self.interface.pair.law, np.zeros(len(self.state.z))
        if not law.has_adhesion:
            return none
        node, x = replace(self.nodal, gap=none), self.operators.x
        return self.interface.law_calls.adhesion_at(law, node, self.covered, x).residual
