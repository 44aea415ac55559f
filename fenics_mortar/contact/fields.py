# SPDX-License-Identifier: MIT
"""Nodal fields of a contact: gap, slip, arguments and rows of its law.

Their directional derivatives are replicated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any, NamedTuple, Protocol

import numpy as np

from fenics_mortar.contact.interface_fields import InterfaceConstants, InterfaceFields, field
from fenics_mortar.contact.law import (
    BUILT_IN,
    KINK,
    STICK,
    Frictionless,
    Nodal,
    Row,
    VectorRow,
    chain_rule,
)
from fenics_mortar.contact.law_calls import LawCalls
from fenics_mortar.interface.mortar import Block, scaled
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.kernels import complementarity
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags
from fenics_mortar.utils.ranks import sum_over_ranks

# Attributes of the state on which the arguments of a law and its tangential row depend.
LAW_ATTRIBUTES = ("z", "multiplier_nodes", "partners", "c_n", "load_time", "start_instant")
RULED = (*LAW_ATTRIBUTES, "active", "branch", "redundant")
# Stiffness of elastic stick over that of the bulk [1]. Curvature causes a slip of second order in
# the strains e; the shear is then 1000 e times the pressure.
ELASTIC = 1e3
# Decrease of adhesion with the gap, over the diagonal stiffness of a node [1], above which it is
# left out of the tangent. A surface node is about twice as compliant as its diagonal stiffness.
MAX_SOFTENING = 0.5


class ContactInterface(InterfaceConstants, Protocol):
    """Constants of a contact that its fields depend on."""

    law_calls: LawCalls
    parameters: dict[str, Array]
    follows_law: Flags
    is_guided: Flags
    guides: Array
    plane_normals: Array
    set_aside: Flags


class Gaps(NamedTuple):
    """Covered nodes, and their mean gaps g_j / w_j, zero elsewhere, (slave nodes,) [length]."""

    covered: Flags
    mean: Array


class ContactFields(InterfaceFields):
    """Fields of a contact; see ``contact`` for the complementarity function and the rows.

    Attributes:
        closing: The gap that contact closes with its derivatives; ``None`` if it is the mean gap.
        covered, mean_gap: See ``Gaps``.
        covered_gap: ``closing_gap``, zero at uncovered nodes, (slave nodes,) [length].
        adhesion: Adhesion a at the gaps, and a', each (slave nodes,) [stress, stress / length].
    """

    interface: ContactInterface
    closing: Row | None = None
    covered: Any = property(attrgetter("gaps.covered"))
    mean_gap: Any = property(attrgetter("gaps.mean"))
    covered_gap: Any = property(attrgetter("gaps.mean"))
    adhesion: Any = property(attrgetter("pull.residual", "pull.by_gap"))

    @field("multiplier_nodes")
    def gaps(self) -> Gaps:
        """Covered nodes and mean gaps."""
        o, count = self.operators, len(self.state.z)
        gaps = Gaps(np.empty(count, bool), np.empty(count))
        complementarity.tabulate_gaps(
            o.gap, o.weight, o.diagonal, self.nodal_areas, self.state.multiplier_nodes, ROUNDING,
            *gaps,
        )  # fmt: skip
        return gaps

    @field("multiplier_nodes")
    def gap(self) -> Array:
        """Mean gap of every covered slave node, nan elsewhere, (slave nodes,) [length]."""
        return self.fill_inside(np.where(self.covered, self.mean_gap, np.nan))

    @field(*LAW_ATTRIBUTES)
    def pull(self) -> Row:
        """Adhesion of covered nodes, continued linearly to negative gaps, each (slave nodes,)."""
        law, none = self.interface.pair.law, np.zeros(len(self.state.z))
        if type(law) in BUILT_IN or not law.has_adhesion:
            return Row(none, none, none, none, none)
        node, x = self.nodal, self.operators.x
        opened = replace(node, gap=np.maximum(node.gap, 0.0))
        row = self.interface.law_calls.adhesion_at(law, opened, self.covered, x)
        row = self.without_slip_on_planes(row)
        row = row._replace(residual=row.residual + row.by_gap * np.minimum(node.gap, 0.0))
        return Row(*(np.where(self.covered, values, 0.0) for values in row))

    def without_slip_on_planes(self, row: Row) -> Row:
        """The row with zero slip on symmetry planes."""
        on_plane = np.isfinite(self.interface.plane_normals[:, 0])
        return row._replace(by_slip=np.where(on_plane, 0.0, row.by_slip))

    @field(*LAW_ATTRIBUTES, "active")
    def attracted(self) -> Flags:
        """Open nodes under adhesion, shape (slave nodes,), bool."""
        return (self.adhesion[0] > 0.0) & ~self.state.active

    @field(*LAW_ATTRIBUTES, "active")
    def acts(self) -> Flags:
        """See ``InterfaceFields``."""
        return self.state.active | self.attracted

    def friction_limit(self, pressure: Array) -> Array:
        """Friction limits at pressures (slave nodes,) [stress]."""
        law = self.interface.pair.law
        return self.interface.law_calls.friction_limit(law, pressure, self.operators.x)

    def closed_adhesion(self) -> Array:
        """Adhesion of closed gaps, shape (slave nodes,) [stress]."""
        law, node = self.interface.pair.law, replace(self.nodal, gap=np.zeros(len(self.state.z)))
        return self.interface.law_calls.adhesion_at(
            law, node, self.covered, self.operators.x
        ).residual

    @property
    def tension(self) -> Array:
        """Tension beyond the adhesion, -(z_n + a), shape (slave nodes,) [stress]."""
        return -(self.z_n + self.adhesion[0])

    @field("partners")
    def slip(self) -> Array:
        """See ``InterfaceFields``.

        Zero on symmetry planes, where the mesh has partners on one side only.
        """
        on_plane = np.isfinite(self.interface.plane_normals[:, 0])
        return np.where(on_plane, 0.0, self.state.partners.slip(self.operators))

    @property
    def counted_slip(self) -> Array:
        """Slip that a step may keep, (slave nodes,) [length]; in space its vectors."""
        return self.slip

    @field(*LAW_ATTRIBUTES)
    def nodal(self) -> Nodal:
        """Arguments of the contact law, arrays (slave nodes,); see ``Nodal``."""
        stiffness = self.interface.foundation
        c_n = self.state.c_n * stiffness
        needs_slip = type(self.interface.pair.law) is not Frictionless
        slip = self.slip if needs_slip else np.zeros(stiffness.size)
        X, time, start_instant = (
            self.interface.slave.X,
            self.state.load_time,
            self.state.start_instant,
        )
        step = time - start_instant.time if time > start_instant.time else start_instant.step
        return Nodal(
            self.mean_gap, slip, self.z_n, self.z_tau, stiffness, c_n, X, self.operators.x, time,
            step, start_instant.memory, self.interface.parameters,
        )  # fmt: skip

    @property
    def sticking(self) -> Flags:
        """See ``InterfaceFields``."""
        return self.state.active & (self.state.branch == STICK) & self.interface.follows_law

    @property
    def sliding(self) -> Flags:
        """Whether an active node slides against friction, shape (slave nodes,), bool."""
        follows_law = self.interface.follows_law & (self.friction_limit(self.pressure) > 0.0)
        return self.state.active & (self.state.branch != STICK) & follows_law

    @property
    def friction_work(self) -> float:
        """Work of friction in the step, with the shear at its end [stress length^2]."""
        return float(self.shear_force @ np.where(self.state.active, self.slip, 0.0))

    @field(*RULED)
    def tangential_row(self) -> Row:
        """Tangential row of all nodes, open ones as if active, each (slave nodes,).

        Redundant nodes stick elastically, z_tau = z_tau,old + (k / l) u; see ``redundancy``.
        """
        state, node, law = self.state, self.nodal, self.interface.pair.law
        row = Frictionless().tangential(node, state.branch)
        if type(law) is not Frictionless:
            follows_law = self.interface.follows_law
            if not law.bridges_gap:
                follows_law = follows_law & ~self.attracted
            x = self.operators.x
            given = self.interface.law_calls.tangential(law, node, state.branch, follows_law, x)
            row = Row(*(np.where(follows_law, a, b) for a, b in zip(given, row, strict=True)))
        zero = np.zeros(len(state.z))
        row = Row(*[part + zero for part in row])
        if not state.redundant.any():
            return row
        k = node.stiffness
        shear = self.shear_of_stick / ELASTIC
        elastic = Row(shear - k * self.slip, zero, -k, zero, zero + 1.0 / ELASTIC)
        return Row(*(np.where(state.redundant, a, b) for a, b in zip(elastic, row, strict=True)))

    @field(*RULED)
    def law_rows(self) -> tuple[Row, ...]:
        """Rows of the contact law along tau, and along n for open nodes, each (slave nodes,).

        With a closing gap of the law its row is the third.

        Where adhesion decreases with the gap faster than the elastic forces increase, its
        derivative is left out of the tangent. With it a Newton step would close the gap, and the
        node would open and close alternately. Without it the gap grows over the iterations up to
        the next equilibrium.
        """
        pull, closing = self.pull, self.closing
        by_gap = pull.by_gap
        if by_gap.any() and not self.operators.linearization.exact:
            by_gap = np.where(self.decreases_fast, 0.0, by_gap)
        opening = Row(
            self.z_n + pull.residual, by_gap, pull.by_slip, pull.by_z_n + 1.0, pull.by_z_tau
        )
        rows = [self.tangential_row, opening]
        if closing is not None:
            rows = [*(chain_rule(row, closing) for row in rows), closing]
        return tuple([self.at_gaps(row) if np.any(row.by_slip) else row for row in rows])

    @property
    def counted_shear(self) -> Array:
        """Shear from which redundant sticks start, (nodes,) [stress]; in space its vectors."""
        return self.z_tau

    @property
    def shear_of_stick(self) -> Array:
        """Shear of redundant sticks less that at the accepted state, (slave nodes,) [stress]."""
        return self.nodal.z_tau - self.state.partners.shear

    @property
    def tangents(self) -> tuple[Array, ...]:
        """Tangents that laws do not turn, one or two in space, (slave nodes, dim) each [1]."""
        return (self.operators.tau,)

    def along_tangents(self, vectors: Array) -> Array:
        """Components of vectors (slave nodes, dim) along ``tangents``.

        Shape (slave nodes,), in space (slave nodes, 2) [unit of the vectors].
        """
        return np.asarray(np.einsum("ja,ja->j", self.operators.tau, vectors))

    def at_gaps(self, row: Row) -> Row:
        """A row of the law with its whole derivative by the mean gap: slip depends on it."""
        return row._replace(by_gap=row.by_gap + row.by_slip * self.slip_by_gap)

    @field(*RULED)
    def vector_rows(self) -> tuple[VectorRow, ...]:
        """``law_rows`` with derivatives by vectors."""
        return tuple(self.by_vectors(row) for row in self.law_rows)

    def by_vectors(self, row: Row) -> VectorRow:
        """A row with its derivatives by the vectors of multiplier and normal."""
        o, z = self.operators, self.state.z
        residual, by_gap, by_slip, by_n, by_tau = (part + np.zeros(len(z)) for part in row)
        turned = np.stack([z[:, 1], -z[:, 0]], axis=1)  # z . dtau = turned . dn
        by_z = by_n[:, None] * o.n + by_tau[:, None] * o.tau
        return VectorRow(
            residual, by_z, by_slip, by_gap, by_n[:, None] * z + by_tau[:, None] * turned
        )

    def slip_derivative(self, along: Array) -> Iterator[Block]:
        """Blocks of along_j times the slip's derivative of this rank at constant mean gaps.

        Rows are slave nodes, columns displacement dofs; ``along`` has the shape (slave nodes,).
        """
        o, partners, own = self.operators, self.state.partners, self.interface.slave.owned
        turned = o.tangential_derivative(along[:, None] * partners.rotated(o))
        yield Block(own[:, None], o.normal_columns()[own], turned[own][:, None])
        for block in partners.derivative(o):
            yield scaled(block, along)

    @property
    def slip_by_gap(self) -> Array:
        """Derivative of the slip with respect to the mean gap, shape (slave nodes,) [1]."""
        partners, planes = self.state.partners, self.interface.plane_normals
        on = self.covered & np.isfinite(partners.least) & ~np.isfinite(planes[:, 0])
        return np.where(on, partners.arc(self.operators).by_gap, 0.0)

    @property
    def decreases_fast(self) -> Flags:
        """Nodes where adhesion drops faster than elastic forces grow, (slave nodes,), bool."""
        slope = self.operators.diagonal * np.abs(self.adhesion[1])
        return slope > MAX_SOFTENING * self.interface.stiffness

    @property
    def steepness(self) -> float:
        """See ``InterfaceFields``; zero for laws of the package."""
        if type(self.interface.pair.law) in BUILT_IN:
            return 0.0
        force = self.operators.diagonal * np.abs(self.tangential_row.by_slip)
        return float(force[self.state.active].max(initial=0.0))

    @property
    def on_obstacle(self) -> ObstacleOperators:
        """The operators of a pair with an obstacle."""
        assert isinstance(self.operators, ObstacleOperators)
        return self.operators

    def strength(self, pressure: float) -> tuple[Array, Array, Array]:
        """Admissible contact tractions near a pressure p [stress], each (slave nodes,).

        Returns:
            Slope mu and shear s_0 of the line |z_tau| <= s_0 + mu z_n through the friction limits
            at p and 2 p, an upper bound of a concave limit outside of [p, 2 p]; mu is inf without a
            limit. The third array is the adhesion of a closed gap [stress].
        """
        interface = self.interface
        follows_law = interface.follows_law
        ones = np.ones(len(self.state.z))
        at, beyond = (self.friction_limit(factor * pressure * ones) for factor in (1.0, 2.0))
        unlimited = np.isinf(at + beyond)
        at, beyond = (np.where(unlimited, 0.0, limit) for limit in (at, beyond))
        slope = (beyond - at) / pressure if pressure > 0.0 else np.zeros_like(at)
        shear = np.maximum(at - slope * pressure, 0.0)
        shear = np.where(follows_law & (shear > KINK * at), shear, 0.0)
        slope = np.where(follows_law, np.where(unlimited, np.inf, slope), 0.0)
        return slope, shear, self.closed_adhesion()


def change_along(
    f: InterfaceFields, blocks: Sequence[Block], on_slave: Array, on_master: Array
) -> Array:
    """Product of blocks, whose rows are slave nodes, and directions (collective).

    Args:
        f: Fields of the pair.
        blocks: Blocks of this rank.
        on_slave: Displacements of the slave nodes, shape (..., n, dim) [length].
        on_master: Displacements of the master nodes, shape (..., n, dim) [length].

    Returns:
        Shape (..., slave nodes), equal on all ranks.
    """
    sides = f.interface.slave, f.interface.master
    dofs = np.concatenate([side.dofs_of(np.arange(side.num_nodes)) for side in sides])
    several = on_slave.shape[:-2]
    both = [x.reshape(*several, x.shape[-2] * x.shape[-1]) for x in (on_slave, on_master)]
    values, order = np.concatenate(both, axis=-1), np.argsort(dofs)
    change = np.zeros((sides[0].num_nodes, *several))
    for block in blocks:
        index = order[np.searchsorted(dofs[order], np.maximum(block.columns, dofs.min()))]
        direction = np.where(block.columns >= 0, values[..., index], 0.0)
        rates = np.einsum("bjq,...bq->bj...", block.values, direction)
        np.add.at(change, block.rows, rates)
    return np.moveaxis(sum_over_ranks(sides[0].comm, change), 0, -1)


def gap_rate(f: ContactFields, on_slave: Array, on_master: Array) -> Array:
    """Change of the mean gaps, (..., slave nodes); zero where not covered; see ``change_along``."""
    change = change_along(f, f.operators.gap_derivative(), on_slave, on_master)
    return np.where(f.covered, change / np.where(f.covered, f.operators.weight, 1.0), 0.0)


def slip_rate(f: ContactFields, on_slave: Array, on_master: Array) -> Array:
    """Slip of the nodes along their partners (local); see ``change_along``.

    In space the components along two tangents, shape (slave nodes, 2).
    """
    partners = f.state.partners
    return f.along_tangents(partners.D @ on_slave - partners.M @ on_master)


def opening_rate(f: ContactFields, on_slave: Array, on_master: Array) -> Array:
    """Opening along n, against which the pressure does work (local); see ``change_along``.

    This differs from the rate of the gap where n is not normal to both sides, as at corners.
    """
    partners = f.state.partners
    relative = partners.D @ on_slave - partners.M @ on_master
    return -np.asarray(np.einsum("ja,ja->j", f.operators.n, relative))
