# SPDX-License-Identifier: MIT
"""Flux of a scalar field at the slave nodes of a contact, and its derivatives; see ``fluxes``."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from fenics_mortar.contact.conductance import Conductance
from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.nodal import Row, VectorRow
from fenics_mortar.contact.rows import row_by_displacements
from fenics_mortar.interface.linearization import Block, scaled
from fenics_mortar.interface.mortar import MortarOperators
from fenics_mortar.interface.traces import Trace
from fenics_mortar.utils.arrays import Array


class FluxValues:
    """Fluxes of both sides at the slave nodes, and their derivatives.

    Args:
        law: The conductance.
        f: Fields of the contact.
        T, T_master: The field at the nodes of both sides.
        perfect: Conductance of perfect conduction, shape (slave nodes,) [flux / field].
        largest: Bound of the total conduction in derivatives at fixed jumps [flux length].
    """

    def __init__(
        self,
        law: Conductance,
        f: ContactFields,
        T: Array,
        T_master: Array,
        perfect: Array,
        largest: float,
    ) -> None:
        self._law, self.f, self.T, self.T_master = law, f, T, T_master
        self.o: MortarOperators = f.operators
        self.on = f.covered
        self._per_weight = np.where(self.on, 1.0 / np.where(self.on, self.o.weight, 1.0), 0.0)
        D, M = self.o.matrices
        self._reference = 0.0 if law.temperature is None else law.on_obstacle
        jump = D @ (T - self._reference) - M @ (T_master - self._reference)
        self.jump = self._per_weight * jump
        closed = f.state.active
        self.h = law.evaluate(
            np.where(closed, np.maximum(f.z_n, 0.0), 0.0),
            np.where(closed, 0.0, np.maximum(f.mean_gap, 0.0)),
            perfect,
        )
        self.conduction = np.where(self.on, self.h.h * self.jump, 0.0)
        self._largest = largest

    @cached_property
    def _heating(self) -> Row:
        """The source and its derivatives, zero where open."""
        f, law = self.f, self._law
        closed = f.state.active & self.on
        if callable(law.heating):
            power, slope = law.power(np.where(closed, np.maximum(f.z_n, 0.0), 0.0), self.o.slave.X)
            pressed = closed & (f.z_n > 0.0)
            return Row(np.where(closed, power, 0.0), by_z_n=np.where(pressed, slope, 0.0))
        if law.heating is None or not f.interface.pair.law.has_friction:
            return Row(np.zeros(len(self.T)))
        node = f.nodal
        rubs = np.where(closed & f.interface.follows_law, 1.0 / node.step, 0.0)
        row = Row(rubs * f.z_tau * f.slip, by_slip=rubs * f.z_tau, by_z_tau=rubs * f.slip)
        return f.at_gaps(row)

    @property
    def friction(self) -> Array:
        """Source, power per area, (slave nodes,) [flux]."""
        return np.asarray(self._heating.residual)

    @cached_property
    def _admitted(self) -> float:
        """Fraction of the conduction that derivatives take as flux, 1 at a solution [1]."""
        total = float(self.o.weight @ np.abs(self.conduction))
        return min(1.0, self._largest / total) if total > 0.0 else 1.0

    @property
    def expected(self) -> tuple[Array, Array]:
        """Fluxes that leave the slave and enter the master in derivatives of D and M [flux]."""
        beyond = (self._admitted - 1.0) * self.conduction
        return self.on_slave + beyond, self.on_master + beyond

    @property
    def on_slave(self) -> Array:
        """Flux that leaves the slave, (slave nodes,) [flux]."""
        return self.conduction - self._law.share * self.friction

    @property
    def on_master(self) -> Array:
        """Flux that enters the master, (slave nodes,) [flux]."""
        return self.on_slave + self.friction

    @cached_property
    def sides(self) -> list[VectorRow]:
        """Derivatives of both fluxes at fixed jumps [flux]."""
        closed, heating = self.f.state.active, self._heating
        pressed = closed & (self.f.z_n > 0.0)
        jump = self._admitted * self.jump
        by_gap = np.where(self.on & ~closed & (self.f.mean_gap > 0.0), jump, 0.0)
        by_pressure = np.where(self.on & pressed, jump * self.h.by_pressure, 0.0)
        own = Row(self.conduction, by_gap * self.h.by_gap, 0.0, by_pressure)
        share = self._law.share
        rows = [
            Row(*(a + factor * b for a, b in zip(own, heating, strict=True)))
            for factor in (-share, 1.0 - share)
        ]
        return [self.f.by_vectors(row) for row in rows]

    def moved(self, side: VectorRow) -> Iterator[Block]:
        """Blocks of a flux's derivative by displacements at fixed jumps; rows are slave nodes."""
        return row_by_displacements(self.f, side)

    @cached_property
    def _factor(self) -> Array:
        """Derivative of the conduction by the weighted jump [1 / length]."""
        return np.asarray(self._per_weight * np.where(self.on, self.h.h, 0.0))

    def by_field(self, traces: list[Trace]) -> Iterator[Block]:
        """Blocks of the conduction's derivative by the field's dofs; rows are slave nodes."""
        o, s, factor = self.o, self.o.segments, self._factor
        nodes = o.facet_nodes
        yield Block(nodes, *traces[0].columns(nodes, factor[nodes][:, :, None] * o.D))
        if len(traces) > 1:
            values = -factor[s.slave][:, :, None] * o.M
            yield Block(s.slave, *traces[1].columns(s.master, values))

    def by_matrices(self) -> Iterator[Block]:
        """Blocks of the conduction's derivative by D, M and w; rows are slave nodes."""
        o, factor = self.o, self._factor
        for block in o.matrix_derivative(*(T - self._reference for T in (self.T, self.T_master))):
            yield scaled(block, factor)
        for block in o.weight_derivative():
            yield scaled(block, -factor * self.jump)
