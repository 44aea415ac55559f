# SPDX-License-Identifier: MIT
"""Nodal fields of a contact: gap, slip, arguments and rows of its law.

Their directional derivatives are replicated.

Nodal fields of a contact in space, and the rows of its law with two tangential components.

A law relates a shear and a slip along one direction. In space this is the direction e of

    w = z_t + c_t (k / l) s,    z_t = P z,   s = P s^,   P = I - n n^T,

with the vector of slip s^ since the accepted state: z_tau = e . z and u = e . s^ are the arguments
of the law, whose row rho = 0 determines the shear T = z_tau - rho along e. The other tangent,
t = n x e, has the row t . z = 0: shear and slip have the same direction (radial return; Gitterle,
Popp, Gee & Wall 2010). Both are components of the vector

    R = rho e + (t . z) t.

With b = |w| and de = t (t . dw) / b its derivatives are

    e . dR = rho_u e . ds + rho_tau e . dz_t + [rho_u (t . s) + (rho_tau - 1) (t . z)] t . dw / b
    t . dR = t . dz_t - (T / b) t . dw.

The matrix in dz is positive definite for T < b; T / b is limited to ``MAX_RATIO`` in the tangent.
Where a law is linear and isotropic, with stick or without friction, R = rho_u s + rho_tau z_t. On
symmetry planes e is in the plane and the law is that of the plane. At w = 0, where e may be any
tangent, the law resists equally in all directions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fenics_mortar.contact.interface_fields import (
    InterfaceFields,
    Parts,
    field,
    normal_parts,
    tangential,
)
from fenics_mortar.contact.law import (
    BUILT_IN,
    STICK,
    Friction,
    Frictionless,
    Nodal,
    Row,
    Stick,
    VectorRow,
    chain_rule,
)
from fenics_mortar.contact.law_calls import in_components, summed_slip_of
from fenics_mortar.interface.space_mortar import SpaceOperators
from fenics_mortar.utils.arrays import ASSEMBLY_ROUNDING, ROUNDING, Array, Flags

if TYPE_CHECKING:
    from fenics_mortar.interface.mortar import Block

# Attributes of the state on which the arguments of a law and its tangential row depend.
LAW_ATTRIBUTES = ("z", "multiplier_nodes", "partners", "c_n", "load_time", "start_instant")
RULED = (*LAW_ATTRIBUTES, "active", "branch", "redundant")
# Stiffness of elastic stick over that of the bulk [1]. Curvature causes a slip of second order in
# the strains e; the shear is then 1000 e times the pressure.
ELASTIC = 1e3
# Decrease of adhesion with the gap, over the diagonal stiffness of a node [1], above which it is
# left out of the tangent. A surface node is about twice as compliant as its diagonal stiffness.
MAX_SOFTENING = 0.5


class Gaps(NamedTuple):
    """Covered nodes with their mean gaps; arrays of the slave nodes, zero where not covered.

    Attributes:
        covered: Whether a node is covered, shape (slave nodes,), bool.
        mean: Mean gaps g_j / w_j, shape (slave nodes,) [length].
        per_weight: 1 / w_j, shape (slave nodes,) [1 / length], in space [1 / area].
    """

    covered: Flags
    mean: Array
    per_weight: Array


class Arguments(NamedTuple):
    """Arguments of the law with the gap that contact closes, and this gap with its derivatives.

    The gap is ``None`` if it is the mean gap.
    """

    nodal: Nodal
    closing: Row | None


class ContactFields(InterfaceFields):
    """Fields of a contact; see ``contact`` for the complementarity function and the rows.

    Attributes:
        covered, mean_gap, per_weight: See ``Gaps``.
        nodal, closing: See ``Arguments``.
        row_tangents: Direction of the tangential row, (slave nodes, 2), in space of two [1].
        counted_slip: Slip that a step may keep, (slave nodes,) [length]; in space its vectors.
        memory_of_law: Memory at the start of the step as the law has it, in space along e.
    """

    covered: Any = property(attrgetter("gaps.covered"))
    mean_gap: Any = property(attrgetter("gaps.mean"))
    per_weight: Any = property(attrgetter("gaps.per_weight"))
    nodal: Any = property(attrgetter("arguments.nodal"))
    closing: Any = property(attrgetter("arguments.closing"))
    row_tangents: Any = property(attrgetter("operators.tau"))
    counted_slip: Any = property(attrgetter("slip"))
    surface_slip: Any = property(attrgetter("slip"))
    memory_of_law: Any = property(attrgetter("state.start_instant.memory"))

    @field("multiplier_nodes")
    def gaps(self) -> Gaps:
        """Covered nodes and mean gaps."""
        o = self.operators
        covered = self.state.multiplier_nodes & (o.diagonal > ROUNDING * self.nodal_areas)
        weight = np.where(covered, o.weight, 1.0)
        return Gaps(covered, np.where(covered, o.gap, 0.0) / weight, covered / weight)

    @field("multiplier_nodes")
    def gap(self) -> Array:
        """Mean gap of every covered slave node, nan elsewhere, (slave nodes,) [length]."""
        return self.fill_inside(np.where(self.covered, self.mean_gap, np.nan))

    @field(*LAW_ATTRIBUTES)
    def pull(self) -> Row:
        """Adhesion a of covered nodes, continued linearly to negative gaps, (slave nodes,) each."""
        law, none = self.interface.pair.law, np.zeros(len(self.state.z))
        if type(law) in BUILT_IN or not law.has_adhesion:
            return Row(none, none, none, none, none)
        node = self.nodal
        opened = replace(node, gap=np.maximum(node.gap, 0.0))
        row = self.interface.law_calls.row("adhesion_at", opened, self.covered)
        row = self.without_slip_on_planes(row)
        row = row._replace(residual=row.residual + row.by_gap * np.minimum(node.gap, 0.0))
        return Row(*(np.where(self.covered, values, 0.0) for values in row))

    def without_slip_on_planes(self, row: Row) -> Row:
        """The row with zero slip on symmetry planes."""
        on_plane = np.isfinite(self.interface.plane_normals[:, 0])
        return row._replace(by_slip=np.where(on_plane, 0.0, row.by_slip))

    @field(*LAW_ATTRIBUTES, "active")
    def attracted(self) -> Flags:
        """Open nodes under adhesion, shape (slave nodes,), bool.

        An elastic bond does not pull yet at a closed gap, but its row has the derivative.
        """
        pull = self.pull
        return ((pull.residual > 0.0) | (pull.by_gap > 0.0)) & ~self.state.active

    @field(*LAW_ATTRIBUTES, "active")
    def acts(self) -> Flags:
        """Whether the multiplier of a node may be nonzero, shape (slave nodes,), bool."""
        return self.state.active | self.attracted

    def friction_limit(self, pressure: Array) -> Array:
        """Friction limits at pressures (slave nodes,) and closed gaps [stress]."""
        node = replace(self.nodal, z_n=pressure, gap=np.zeros_like(pressure))
        return self.interface.law_calls.friction_limit(node)

    @property
    def tension(self) -> Array:
        """Tension beyond the adhesion, -(z_n + a), shape (slave nodes,) [stress]."""
        return -(self.z_n + self.pull.residual)

    @field("partners")
    def slip(self) -> Array:
        """See ``InterfaceFields``.

        Zero on symmetry planes, where the mesh has partners on one side only.
        """
        on_plane = np.isfinite(self.interface.plane_normals[:, 0])
        return np.where(on_plane, 0.0, self.state.partners.slip(self.operators))

    def remembered(self, memory: Mapping[str, Array]) -> Mapping[str, Array]:
        """Memory of the law at the end of the step, as it is stored [its units]."""
        return memory

    def slip_derivative(self, along: Array, *, summed: bool = True) -> Iterator[Block]:
        """Blocks of ``along`` times the derivative of the slip of the law, of this rank."""
        return self.state.partners.derivative(self.operators, along)

    @field(*LAW_ATTRIBUTES)
    def arguments(self) -> Arguments:
        """Arguments of the law, and its closing gap: the mean gap where no node is covered."""
        interface, time, start = self.interface, self.state.load_time, self.state.start_instant
        law, stiffness, on = interface.pair.law, interface.foundation, self.covered
        needs_slip = type(law) is not Frictionless
        slip = self.slip if needs_slip else np.zeros(stiffness.size)
        node = Nodal(
            self.mean_gap, slip, self.z_n, self.z_tau, stiffness, self.state.c_n * stiffness,
            interface.slave.X, self.operators.x, time,
            time - start.time if time > start.time else start.step, self.memory_of_law,
            interface.parameters,
        )  # fmt: skip
        if not law.has_closing_gap:
            return Arguments(node, None)
        row = interface.law_calls.row("closing_gap", node, on)
        row = self.without_slip_on_planes(row)
        plain = Row(node.gap, 1.0, 0.0, 0.0, 0.0)
        closing = Row(*(np.where(on, a, b) for a, b in zip(row, plain, strict=True)))
        return Arguments(replace(node, gap=closing.residual), closing)

    @property
    def closing_gap(self) -> Array:
        """Gap that contact closes, nan at uncovered nodes, (slave nodes,) [length]."""
        if not self.interface.pair.law.has_closing_gap:
            return self.gap
        return self.fill_inside(np.where(self.covered, self.nodal.gap, np.nan))

    @property
    def offset(self) -> Array:
        """Length subtracted from the pointwise gap: minus that of the law's layer [length]."""
        if not self.interface.pair.law.has_closing_gap:
            return np.asarray(self.state.offset)
        return np.asarray(self.state.offset - (self.nodal.gap - self.mean_gap))

    @property
    def sticking(self) -> Flags:
        """Whether an active node sticks, shape (slave nodes,), bool."""
        return self.state.active & (self.state.branch == STICK) & self.interface.follows_law

    @property
    def sliding(self) -> Flags:
        """Whether an active node slides against friction, shape (slave nodes,), bool."""
        follows_law = self.interface.follows_law & (self.friction_limit(self.pressure) > 0.0)
        return self.state.active & (self.state.branch != STICK) & follows_law

    @field(*RULED)
    def tangential_row(self) -> Row:
        """Tangential row of all nodes, open ones as if active, each (slave nodes,).

        Redundant nodes stick elastically, z_tau = z_tau,old + (k / l) u; see
        ``linearized_contact``.
        """
        state, node, law = self.state, self.nodal, self.interface.pair.law
        row = Frictionless().tangential(node, state.branch)
        if type(law) is not Frictionless:
            follows_law = self.interface.follows_law
            if not law.bridges_gap:
                follows_law = follows_law & ~self.attracted
            calls = self.interface.law_calls
            given = calls.row("tangential", node, follows_law, state.branch)
            row = Row(*(np.where(follows_law, a, b) for a, b in zip(given, row, strict=True)))
        zero = np.zeros(len(state.z))
        row = Row(*np.broadcast_arrays(*row, zero)[:-1])
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
    def shear_of_stick(self) -> Array:
        """Shear of redundant sticks less that at the accepted state, (slave nodes,) [stress]."""
        return self.nodal.z_tau - self.state.partners.shear

    @property
    def tangents(self) -> tuple[Array, ...]:
        """Tangents that laws do not turn, one or two in space, (slave nodes, dim) each [1]."""
        return (self.operators.tau,)

    def along_tangents(self, vectors: Array) -> Array:
        """Components of vectors (..., slave nodes, dim) along ``tangents``.

        Shape (..., slave nodes), in space (..., slave nodes, 2) [unit of the vectors].
        """
        return normal_parts(self.operators.tau, vectors)

    def at_gaps(self, row: Row) -> Row:
        """A row of the law with its whole derivative by the mean gap: slip depends on it."""
        return row._replace(by_gap=row.by_gap + row.by_slip * self.slip_by_gap)

    @field(*RULED)
    def vector_rows(self) -> tuple[VectorRow, ...]:
        """``law_rows`` with derivatives by vectors; in space along two tangents, then along n."""
        return tuple(map(self.by_vectors, self.law_rows))

    def by_vectors(self, row: Row) -> VectorRow:
        """A row with its derivatives by the vectors of multiplier and normal."""
        o, z, none = self.operators, self.state.z, np.zeros(len(self.z_n))
        by_n, by_tau = np.reshape(row.by_z_n, (-1, 1)), np.reshape(row.by_z_tau, (-1, 1))
        turned = z[:, ::-1] * (1.0, -1.0)  # z . dtau = turned . dn
        return VectorRow(
            row.residual + none, by_n * o.n + by_tau * o.tau, row.by_slip + none, row.by_gap + none,
            by_n * z + by_tau * turned,
        )  # fmt: skip

    @property
    def slip_by_gap(self) -> Array:
        """Derivative of the slip with respect to the mean gap, shape (slave nodes,) [1]."""
        partners, planes = self.state.partners, self.interface.plane_normals
        on = self.covered & np.isfinite(partners.least) & ~np.isfinite(planes[:, 0])
        return np.where(on, partners.at(self.operators).arc.by_gap, 0.0)

    @property
    def decreases_fast(self) -> Flags:
        """Nodes where adhesion drops faster than elastic forces grow, (slave nodes,), bool."""
        slope = -self.operators.diagonal * self.pull.by_gap
        return slope > self.interface.max_softening * self.interface.stiffness

    @property
    def steepness(self) -> float:
        """Largest d(nodal force)/d(slip), where it may exceed the bulk's stiffness [stress].

        Zero for laws of the package.
        """
        if type(self.interface.pair.law) in BUILT_IN:
            return 0.0
        force = self.operators.diagonal * np.abs(self.tangential_row.by_slip)
        return float(force[self.state.active].max(initial=0.0))


# Largest ratio of shear and |w| in the tangent [1], which is singular at 1: the node is about to
# stick. Derivatives of a solution have the ratio itself. With 1 - 1e-4 systems of bodies that
# friction alone holds are singular.
MAX_RATIO = 0.999
# Slip of rounding over the extent of the surface [1], with a shear that corresponds to it: w has no
# direction.
AT_REST = ASSEMBLY_ROUNDING


class Directions(NamedTuple):
    """Tangents e and t of the slave nodes, shapes (slave nodes, 3) [1].

    Attributes:
        along: Direction e.
        across: Direction t = n x e.
        size: |w| where e is the direction of w; zero where it is fixed, shape (slave nodes,)
            [stress].
    """

    along: Array
    across: Array
    size: Array


class SpaceFields(ContactFields):
    """Fields of a contact in space; slip and z_tau are the components along e, see above."""

    counted_slip: Any = property(attrgetter("slip_vector"))
    surface_slip: Any = property(attrgetter("tangential_slip"))

    @field("partners")
    def slip_vector(self) -> Array:
        """Vector s^ of slip since the accepted state, shape (slave nodes, 3) [length].

        Zero before there is an accepted state.
        """
        partners = self.state.partners
        return np.zeros_like(self.z_u) if partners is None else partners.slip(self.operators)

    @property
    def acting(self) -> Any:
        """Operators with derivatives of the facets whose multipliers act or are not zero."""
        return self.operators.near(self.acts | self.state.z.any(axis=1))

    @property
    def _has_slip(self) -> bool:
        return type(self.interface.pair.law) is not Frictionless

    @field(*LAW_ATTRIBUTES)
    def tangential_slip(self) -> Array:
        """Tangential part s of the slip, shape (slave nodes, 3) [length]; zero without friction."""
        n, zero = self.operators.n, np.zeros_like(self.operators.n)
        return tangential(self.slip_vector, n) if self._has_slip else zero

    @field(*LAW_ATTRIBUTES)
    def carried(self) -> Array:
        """Summed slip until the start of the step, turned with the slave, (n, 3) [length]."""
        law, partners = self.interface.pair.law, self.state.partners
        if not law.summed_slip or partners is None:
            return np.zeros_like(self.z_u)
        before = summed_slip_of(law, self.state.start_instant.memory)
        return np.einsum("jab,jb->ja", partners.rotation_of_slave(self.operators), before)

    @field(*LAW_ATTRIBUTES)
    def total_slip(self) -> Array:
        """Tangential part of the slip on which the law depends, (slave nodes, 3) [length]."""
        if not self.interface.pair.law.summed_slip:
            return self.tangential_slip
        return self.tangential_slip + tangential(self.carried, self.operators.n)

    @property
    def memory_of_law(self) -> Mapping[str, Array]:
        """Memory at the start of the step as the law has it, in space along e [its units]."""
        law, memory = self.interface.pair.law, self.state.start_instant.memory
        if not law.summed_slip:
            return memory
        along = normal_parts(self.directions.along, self.carried)
        return {name: memory.get(name, along) for name in law.memory}

    def remembered(self, memory: Mapping[str, Array]) -> Mapping[str, Array]:
        """Memory of the law at the end of the step, as it is stored [its units]."""
        law = self.interface.pair.law
        return in_components(law, memory, self.total_slip) if law.summed_slip else memory

    def slip_derivative(self, along: Array, *, summed: bool = True) -> Iterator[Block]:
        """Blocks of ``along`` times the derivative of the slip of the law, of this rank.

        ``summed``: with the summed slip of former steps, which turns with the slave.
        """
        o, partners = self.operators, self.state.partners
        yield from partners.derivative(o, along)
        if summed and self.interface.pair.law.summed_slip:
            yield from partners.carried_derivative(o, self.carried, along)

    @property
    def rubbing(self) -> VectorRow:
        """Power z_t . s of the shear along the slip of the step, with its derivatives."""
        n, z, s = self.operators.n, self.z_u, self.slip_vector
        z_n, s_n = normal_parts(n, z)[:, None], normal_parts(n, s)[:, None]
        z_t, s_t = z - z_n * n, s - s_n * n
        power, none = np.einsum("ja,ja->j", z_t, s_t), np.zeros(len(z))
        return VectorRow(power, s_t, z_t, none, -s_n * z - z_n * s)

    @field(*LAW_ATTRIBUTES)
    def directions(self) -> Directions:
        """Direction of w; fixed tangents without friction, and where w is zero."""
        n, guided = self.operators.n, self.interface.is_guided
        along, none = self.fixed_tangents, np.zeros(len(n))
        if not self._has_slip:
            return Directions(along, np.cross(n, along), none)
        w = tangential(self.z_u, n) + self.slip_weight[:, None] * self.total_slip
        size = np.linalg.norm(w, axis=1)
        free = (size > AT_REST * self.slip_weight * self.interface.slave.extent) & ~guided
        size = np.where(free, size, 1.0)
        along = np.where(free[:, None], w / size[:, None], along)
        return Directions(along, np.cross(n, along), np.where(free, size, 0.0))

    @cached_property
    def fixed_tangents(self) -> Array:
        """Tangents by the axis least aligned with n, or in the symmetry plane, (nodes, 3) [1]."""
        n, guided = self.operators.n, self.interface.is_guided
        tangents = tangential(np.eye(3)[np.abs(n).argmin(axis=1)], n)
        tangents[guided] = np.cross(n[guided], self.interface.guides[guided])
        return tangents / np.linalg.norm(tangents, axis=1)[:, None]

    @property
    def slip_weight(self) -> Array:
        """Weight c_t k / l of the slip in w, shape (slave nodes,) [stress / length]."""
        return getattr(self.interface.pair.law, "c_t", Friction.c_t) * self.interface.foundation

    @field(*LAW_ATTRIBUTES)
    def parts(self) -> Parts:
        """Normal part of the multipliers, and their part along e."""
        z_n = normal_parts(self.operators.n, self.z_u)
        return Parts(z_n, normal_parts(self.directions.along, self.z_u))

    @property
    def steepness(self) -> float:
        """See ``ContactFields``; collective. The mean square of d(nodal force)/d(slip), too.

        Each is multiplied by the rounding of the slip over that of a position: functions on a small
        part of a facet with nine nodes may be 1e4 times their mean.
        """
        o, steepest = self.operators, super().steepness
        if not (isinstance(o, SpaceOperators) and self._has_slip):
            return steepest
        forces = o.rounding_of_vectors() * self.interface.foundation * self.state.active
        return max(steepest, float(np.sqrt((forces**2).mean())))

    @field(*LAW_ATTRIBUTES)
    def slip(self) -> Array:
        """Component along e of the slip since the last accepted step, (slave nodes,) [length]."""
        return np.einsum("ja,ja->j", self.directions.along, self.tangential_slip)

    @property
    def shear_of_stick(self) -> Array:
        """Component along e of the shear of redundant sticks since the accepted state [stress]."""
        return normal_parts(self.directions.along, self.z_u - self.state.partners.shear)

    @property
    def tangents(self) -> tuple[Array, Array]:
        """Tangents that laws do not turn, one or two in space, (slave nodes, dim) each [1]."""
        return self.fixed_tangents, np.cross(self.operators.n, self.fixed_tangents)

    def along_tangents(self, vectors: Array) -> Array:
        """Components of vectors (..., slave nodes, dim) along ``tangents`` [their unit]."""
        return np.stack([normal_parts(tangent, vectors) for tangent in self.tangents], axis=-1)

    @field(*RULED)
    def vector_rows(self) -> tuple[VectorRow, ...]:
        """``law_rows`` with derivatives by vectors; in space along two tangents, then along n."""
        tangential, *others = self.law_rows
        return *self._tangential_rows(tangential), *(self.by_vectors(row) for row in others)

    @field(*RULED)
    def row_tangents(self) -> tuple[Array, Array]:
        """Directions e and t of the tangential rows, (slave nodes, 3) each [1]: see the module."""
        fixed = (self.is_isotropic & ~self.interface.is_guided)[:, None]
        along = np.where(fixed, self.fixed_tangents, self.directions.along)
        return along, np.cross(self.operators.n, along)

    def _tangential_rows(self, row: Row) -> tuple[VectorRow, VectorRow]:
        """Rows along e and t, given that of the law; see the module."""
        (e, t), none = self.row_tangents, np.zeros(len(self.z_n))
        rho, by_gap, by_u, by_n, by_tau, _ = np.broadcast_arrays(*row, none)
        size, weight = self.directions.size, self.slip_weight
        as_law = self.is_isotropic & ~self.interface.is_guided
        per_size = np.where((size > 0.0) & ~as_law, 1.0 / np.where(size > 0.0, size, 1.0), 0.0)
        redundant, z = self.state.redundant, self.z_u
        if redundant.any():
            z = np.where(redundant[:, None], z - self.state.partners.shear, z)
        (e_z, t_z), (e_s, t_s) = (
            [np.einsum("ja,ja->j", a, v) for a in (e, t)] for v in (z, self.total_slip)
        )
        turn = (by_u * t_s + (by_tau - 1.0) * t_z) * per_size
        along = self._row(
            np.where(as_law, by_tau * e_z + by_u * e_s, rho), by_gap, by_n,
            ((by_tau, e), (turn, t)), ((by_u, e), (turn * weight, t)),
        )  # fmt: skip
        ratio = (e_z - rho) * per_size
        if not self.operators.linearization.exact:
            ratio = np.clip(ratio, 0.0, MAX_RATIO)
        isotropic = (as_law | (size == 0.0)) & ~self.interface.is_guided
        of_z = np.where(isotropic, by_tau, 1.0 - ratio)
        of_s = np.where(isotropic, by_u, -ratio * weight)
        residual = np.where(isotropic, by_tau * t_z + by_u * t_s, t_z)
        return along, self._row(residual, none, none, ((of_z, t),), ((of_s, t),))

    @property
    def slip_by_gap(self) -> Array:
        """Derivative of the slip with respect to the mean gap [1]: zero."""
        return np.zeros(len(self.z_u))

    @property
    def is_isotropic(self) -> Flags:
        """Nodes whose law is linear in shear and slip: both rows are the law's, (slave nodes,)."""
        law, interface = self.interface.pair.law, self.interface
        sticks = isinstance(law, (Friction, Stick)) & (self.state.branch == STICK)
        elastic = self.state.redundant  # see ``linearized_contact``
        return sticks | elastic | ~interface.follows_law | (type(law) is Frictionless)

    def by_vectors(self, row: Row) -> VectorRow:
        """A row that is one number, as that of open nodes, a closing gap or a power of friction.

        Slip and shear along e are those of the law: d(e . a) = e . da + (t . a) t . dw / b.
        """
        residual, by_gap, by_u, by_n, by_tau, _ = np.broadcast_arrays(*row, self.z_n)
        e, t, size = self.directions
        of_turn = by_u * normal_parts(t, self.total_slip) + by_tau * normal_parts(t, self.z_u)
        turn = np.where(size > 0.0, of_turn / np.where(size > 0.0, size, 1.0), 0.0)
        return self._row(
            residual, by_gap, by_n, ((by_tau, e), (turn, t)),
            ((by_u, e), (turn * self.slip_weight, t)),
        )  # fmt: skip

    def _row(
        self,
        residual: Array,
        by_gap: Array,
        by_z_n: Array,
        by_shear: tuple[tuple[Array, Array], ...],
        by_slip: tuple[tuple[Array, Array], ...],
    ) -> VectorRow:
        """A row by its derivatives: of a . z_t and a . s for tangents a, and by z_n.

        d(a . z_t) = a . dz - z_n a . dn, d(a . s) = a . ds^ - (n . s^) a . dn.
        """
        n, z = self.operators.n, self.z_u
        by_z, by_normal = by_z_n[:, None] * n, by_z_n[:, None] * z
        of_slip = np.zeros_like(n)
        for factor, a in by_shear:
            by_z = by_z + factor[:, None] * a
            by_normal = by_normal - (factor * self.z_n)[:, None] * a
        for factor, a in by_slip:
            if not factor.any():
                continue
            of_slip = of_slip + factor[:, None] * a
            normal_slip = np.einsum("ja,ja->j", n, self.slip_vector + self.carried)
            by_normal = by_normal - (factor * normal_slip)[:, None] * a
        return VectorRow(residual, by_z, of_slip, by_gap, by_normal)
