# SPDX-License-Identifier: MIT
"""Flux of a scalar field T across a contact: loads on both sides, with all derivatives.

With D and M of the contact, mean gaps g_j and weights w_j, slave node j has

    jump           [T]_j = (sum_k D_jk T_k - sum_l M_jl T_l) / w_j
    conduction       q_j = h(p_j, g_j) [T]_j          p = max(z_n, 0), g = 0 where closed
    friction         P_j = z_tau,j u_j / step         u the slip of the step; or P(p, X)

where T_k, T_l are the values at the nodes, see ``traces``. With the share s of the slave,
D^T (q - s P) leaves the slave and M^T (q + (1 - s) P) enters the master. Since M reproduces
constants, the loads of both sides and the source are in balance to rounding for any mesh.

A field of degree 1 beside a displacement of degree 2 has fewer dofs than there are nodes: with a
large h, jumps of zero at all nodes would leave it no freedom where facets do not match. Carriers c
are therefore the nodes with dofs, and q is linear between them, with the means over their part of
the surface: A has the linear values at the nodes, A_jc = 1 at carriers, and

    q_j = sum_c A_jc h_c [T]_c,    ([T]_c, h_c) = sum_j A_jc w_j ([T]_j, h_j) / sum_j A_jc w_j.

Where conduction is perfect, and the slave's field is prescribed at a node, its equation is left to
the carriers beside it, as in ``tied_rows``.

On a rigid obstacle its given value replaces the master's, and the master's load leaves the system.

The loads depend on displacements and T, and by p and P on the multipliers. Sources: Hueber &
Wohlmuth (2009); Seitz, Wall & Popp (2018).

In an iterate whose D, M and T do not fit, jumps are of second order, and with a large h their
fluxes may exceed those of the bodies by many orders. The flux in derivatives of D, M and h is then
reduced to the size of the latter, see ``expect``, as if it were an unknown: iterations do not
depend on h, up to perfect conduction. At a solution derivatives are exact.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csr_array, diags, eye, hstack

from dolfinx import fem

from fenics_mortar.contact.conductance import Conductance
from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.law import Row, VectorRow
from fenics_mortar.contact.rows import row_by_displacements, row_by_motions
from fenics_mortar.interface.mortar import Block, MortarOperators
from fenics_mortar.interface.traces import Trace, trace_of
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import TINY, Array, Flags, Indices
from fenics_mortar.utils.ranks import largest_over_ranks, sum_over_ranks


class FluxValues:
    """Fluxes of both sides at the slave nodes, and their derivatives.

    Args:
        law: The conductance.
        f: Fields of the contact.
        T, T_master: The field at the nodes of both sides.
        perfect: Conductance of perfect conduction, shape (slave nodes,) [flux / field].
        largest: Bound of the total conduction in derivatives at fixed jumps [flux length].
        spread: The matrix A, shape (slave nodes, slave nodes) [1].
    """

    def __init__(
        self,
        law: Conductance,
        f: ContactFields,
        T: Array,
        T_master: Array,
        perfect: Array,
        largest: float,
        spread: csr_array,
    ) -> None:
        self._law, self.f, self.T, self.T_master = law, f, T, T_master
        self.o: MortarOperators = f.operators
        self.on, self._spread = f.covered, spread
        self.weight: Array = np.where(self.on, self.o.weight, 0.0)
        of_carriers = self._spread.T @ self.weight
        on = of_carriers > 0.0
        self._per_weight = np.where(on, 1.0 / np.where(on, of_carriers, 1.0), 0.0)
        D, M = self.o.matrices
        self._reference = 0.0 if law.temperature is None else law.on_obstacle
        jump = D @ (T - self._reference) - M @ (T_master - self._reference)
        closed = f.state.active
        self.h = law.evaluate(
            np.where(closed, np.maximum(f.z_n, 0.0), 0.0),
            np.where(closed, 0.0, np.maximum(f.mean_gap, 0.0)),
            perfect,
        )
        self._jump = self._mean(np.where(self.on, jump, 0.0))
        self._h = self._mean(self.weight * self.h.h)
        self.jump, self.conductance, self.conduction = (
            np.where(self.on, self._spread @ values, 0.0)
            for values in (self._jump, self._h, self._h * self._jump)
        )
        self._largest = largest

    def _mean(self, weighted: Array) -> Array:
        """Means at the carriers of values at the nodes times their weights, (slave nodes,)."""
        return np.asarray(self._per_weight * (self._spread.T @ weighted))

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
        total = float(self.weight @ np.abs(self.conduction))
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

    # Derivatives of both fluxes are sums over four quantities of the nodes: weighted jumps,
    # weighted conductances, weights and the source.

    def stacked(self, parts: Sequence[Iterable[Block]]) -> _Numbered:
        """Derivatives of the four quantities from their blocks, whose rows are slave nodes."""
        count = len(self.T)
        blocks = [
            block._replace(rows=block.rows + number * count)
            for number, part in enumerate(parts)
            for block in part
        ]
        return _sparse(blocks, 4 * count)

    @cached_property
    def by_quantities(self) -> list[csr_array]:
        """Derivatives of the fluxes of slave and master, (slave nodes, 4 slave nodes)."""
        to_carriers = self._spread.T @ diags(self.on.astype(float))
        jump = self._per_weight * self._jump
        nodal = diags(np.where(self.on, self.h.h, 0.0))
        twice = diags(2.0 * jump * self._h) @ to_carriers
        conduction = [
            self._on_nodes(part)
            for part in (
                diags(self._per_weight * self._h) @ to_carriers,
                diags(self._admitted * jump) @ to_carriers,
                diags(jump) @ to_carriers @ nodal - twice,
            )
        ]
        one, share = eye(len(self.T)), self._law.share
        return [csr_array(hstack([*conduction, part * one])) for part in (-share, 1.0 - share)]

    def _on_nodes(self, of_carriers: csr_array) -> csr_array:
        return diags(self.on.astype(float)) @ self._spread @ of_carriers

    @cached_property
    def rows(self) -> tuple[VectorRow, VectorRow]:
        """Derivatives of weighted conductances at fixed weights, and of the source."""
        closed = self.f.state.active
        pressed, apart = closed & (self.f.z_n > 0.0), ~closed & (self.f.mean_gap > 0.0)
        h = Row(
            self.weight * self.h.h,
            np.where(apart, self.weight * self.h.by_gap, 0.0),
            0.0,
            np.where(pressed, self.weight * self.h.by_pressure, 0.0),
        )
        return self.f.by_vectors(h), self.f.by_vectors(self._heating)

    def by_displacements(self) -> list[Iterable[Block]]:
        """Blocks of the four quantities' derivatives by displacements."""
        o, (h, source) = self.o, self.rows
        apart = (T - self._reference for T in (self.T, self.T_master))
        return [
            o.matrix_derivative(*apart),
            row_by_displacements(self.f, h),
            o.weight_derivative(),
            row_by_displacements(self.f, source),
        ]

    def by_field(self, traces: list[Trace]) -> Iterator[Block]:
        """Blocks of the weighted jumps' derivative by the field's dofs; rows are slave nodes."""
        o, s = self.o, self.o.segments
        yield Block(o.facet_nodes, *traces[0].columns(o.facet_nodes, o.D))
        if len(traces) > 1:
            yield Block(s.slave, *traces[1].columns(s.master, -o.M))


# Conduction over the fluxes of ``Flux.expect`` above which derivatives take less [1]. At a solution
# the ratio is at most 1, unless fluxes of two pairs cancel at nodes.
BEYOND_FLUXES = 10.0
# Conductance of perfect conduction over the conduction of the cells beside it [1]: it decides on
# seven digits of the flux, and leaves nine for rounding of the jump.
PERFECT = 1e7


@dataclass(frozen=True)
class NodalFlux:
    """Flux at the slave nodes of a pair, read-only values; each array has shape (slave nodes,).

    Attributes:
        jump: Mean jump T_slave - T_master, zero at nodes without partner [field].
        conductance: h, zero at nodes without partner [flux / field].
        conduction: Flux by conduction from slave to master [flux].
        heating: Source by friction, power per area [flux].
        into_slave: Total that enters the slave [flux length].
        into_master: Total that enters the master or obstacle [flux length].
    """

    jump: Array
    conductance: Array
    conduction: Array
    heating: Array
    into_slave: float
    into_master: float


class Flux:
    """A ``Conductance`` bound to a contact.

    Args:
        law: The conductance.
        space: The displacement's nodes, and the mixed space.
        contact: The contact; its surfaces are those of the traces.
        prescribed: Whether a local dof has a Dirichlet value, shape (local dofs,), bool.

    Attributes:
        law: The conductance.
        is_separate: Whether the field is solved for in another problem.
        traces: Traces of the field on the slave and, unless it is an obstacle, on the master.
        dofs: All dofs of the traces, shape (d,), replicated.
        perfect: Conductance of perfect conduction, shape (slave nodes,) [flux / field]; inf for a
            separate field.

    Raises:
        ValueError: On all ranks, if the space has no such field, or an obstacle no temperature.
    """

    def __init__(
        self, law: Conductance, space: DisplacementSpace, contact: Any, prescribed: Flags
    ) -> None:
        self.law, self._contact = law, contact
        rigid = contact.obstacle is not None
        if rigid == (law.temperature is None):
            cure = "give temperature=" if rigid else "omit temperature="
            raise ValueError(
                f"{law!r} of {contact.pair!r}: the master is {'an' if rigid else 'no'} obstacle; "
                f"{cure}"
            )
        sides = (contact.slave,) if rigid else (contact.slave, contact.master)
        self.traces: list[Trace] = [trace_of(space, law.field, side) for side in sides]
        self.dofs: Indices = np.unique(np.concatenate([t.dofs.ravel() for t in self.traces]))
        self.dofs = self.dofs[self.dofs >= 0]
        self.is_separate = isinstance(law.field, fem.Function)
        self._owned = space.first, space.first + space.num_owned
        if isinstance(law.field, fem.Function):
            self._owned = law.field.function_space.dofmap.index_map.local_range
        self._values: tuple[Array, Array] = np.zeros(contact.slave.num_nodes), np.zeros(0)
        self._largest, self._to_force = np.inf, 1.0
        if isinstance(law.field, fem.Function):  # its conditions are not known
            prescribed = np.zeros(law.field.x.array.size, bool)
        self._spreads = _spreads(contact, self.traces[0], prescribed)
        self.perfect = np.full(contact.slave.num_nodes, np.inf)

    def evaluate(self, u: Array) -> None:
        """Gather the field, from all unknowns ``u``, shape (local dofs,), unless separate.

        Collective.
        """
        field: Any = self.law.field
        values = [trace.gather(field.x.array if self.is_separate else u) for trace in self.traces]
        master = values[1] if len(values) > 1 else np.zeros(0)
        self._values, self._largest = (values[0], master), np.inf

    def set_conduction(self, to_force: Array, own: Array) -> None:
        """Set the conductance of perfect conduction (collective).

        Args:
            to_force: Factors that turn loads into forces, shape (owned dofs,).
            own: Load of a dof by a unit of its own field, shape (owned dofs,).
        """
        mine, comm = self.conducting_dofs, self._contact.slave.comm
        self._to_force = float(largest_over_ranks(comm, to_force[mine].max(initial=0.0)))
        conduction, areas = np.zeros(self.dofs.size), self._contact.slave.nodal_areas
        at = np.searchsorted(self.dofs, mine + self._owned[0])
        conduction[at] = own[mine]
        at_nodes = self._interpolation(self.traces[0]) @ sum_over_ranks(comm, conduction)
        self.perfect = PERFECT * np.where(areas > 0.0, at_nodes / np.maximum(areas, TINY), 0.0)

    def expect(self, r: Array) -> None:
        """Bound the conduction in derivatives by fluxes of the bodies (collective).

        Those of the residual ``r`` (owned dofs,) of the bodies at the last evaluated state, and
        those that jumps would cause in the cells beside them.
        """
        slave, jump = self._contact.slave, self.at(self._contact.now).jump
        fluxes = sum_over_ranks(slave.comm, [np.abs(r[self.conducting_dofs]).sum()])[0]
        in_cells = (self.perfect / PERFECT * slave.nodal_areas) @ np.abs(jump)
        self._largest = BEYOND_FLUXES * (fluxes + in_cells)

    @property
    def conducting_dofs(self) -> Indices:
        """Local numbers of the owned dofs, shape (k,) (local)."""
        first, end = self._owned
        return self.dofs[(self.dofs >= first) & (self.dofs < end)] - first

    def over_cells(self) -> float:
        """Largest conductance of a node over the conduction of the cells beside it [1] (local)."""
        on = self.perfect > 0.0
        h = self.at(self._contact.now).h.h[on]
        return float((PERFECT * h / self.perfect[on]).max(initial=0.0))

    def rounding(self) -> float:
        """Size of the loads whose difference is a jump, as a force [stress length] (local)."""
        now = self.at(self._contact.now)
        largest = max(float(np.abs(values).max(initial=0.0)) for values in self._values)
        return self._to_force * float((now.o.weight * now.h.h).max(initial=0.0)) * largest

    def refresh(self) -> None:
        """Gather a separate field again, which may have changed since (collective)."""
        if self.is_separate:
            self.evaluate(np.empty(0))

    # Values

    def at(self, f: ContactFields) -> FluxValues:
        """Values and derivatives by nodal quantities at the fields of the contact (collective)."""
        spread = self._spreads[self.law.is_perfect]
        return FluxValues(self.law, f, *self._values, self.perfect, self._largest, spread)

    @property
    def coupled(self) -> csr_array:
        """Slave nodes whose conductions depend on each other: entries of A A^T (local)."""
        return sum(abs(spread) @ abs(spread).T for spread in self._spreads)

    def nodal(self) -> NodalFlux:
        """The flux at the present state (collective); filled inside of facets as the pressure."""
        self.refresh()
        now = self.at(self._contact.now)
        weight = now.o.weight
        slave, master = (float(weight @ of_side) for of_side in (now.on_slave, now.on_master))
        jump, h, conduction, heating = (
            now.f.fill_inside(values.copy())
            for values in (now.jump, now.conductance, now.conduction, now.friction)
        )
        return NodalFlux(jump, h, conduction, heating, -slave, master)

    def loads(self) -> list[Array]:
        """Loads of the nodes of each trace, (nodes,) [flux length], replicated (collective)."""
        now = self.at(self._contact.now)
        return self._loads_by(now.o, now.on_slave, now.on_master)

    def _loads_by(self, o: MortarOperators, on_slave: Array, on_master: Array) -> list[Array]:
        """D^T of one flux and -M^T of the other, for the traces (collective)."""
        sides = o.force(on_slave[:, None])[0], o.force(on_master[:, None])[1]
        return [side[:, 0] for side, _ in zip(sides, self.traces, strict=False)]

    def add_loads(self, target: Array) -> None:
        """Add the loads to ``target``, shape (owned dofs,) or longer (collective)."""
        for trace, loads in zip(self.traces, self.loads(), strict=True):
            trace.scatter_add(loads, target)

    def add_by_scale(self, target: Array) -> None:
        """Add the loads' derivative by the law's ``scale``: those of conduction (collective).

        Args:
            target: Shape (owned dofs,); changed in place [flux length].
        """
        now = self.at(self._contact.now)
        conduction = now.conduction / self.law.scale
        for trace, loads in zip(
            self.traces, self._loads_by(now.o, conduction, conduction), strict=True
        ):
            trace.scatter_add(loads, target)

    def add_newton_loads(self, target: Array) -> None:
        """Subtract f(z) - f'(z) z, the part of the loads that multipliers leave (collective).

        Args:
            target: Right-hand side of a Newton step, shape (owned dofs,); changed in place.
        """
        loads, z = np.zeros_like(target), self._contact.z
        self.add_loads(loads)
        target -= loads
        self._add(self._linear_part(self.at(self._contact.now), z), target)

    # Derivatives

    @property
    def conducts(self) -> Flags:
        """Slave nodes with a partner, which may conduct, shape (slave nodes,), bool."""
        return np.asarray(self._contact.now.covered)

    def derivative(self) -> list[Block]:
        """Blocks of the loads' derivatives by all unknowns of the bodies (collective)."""
        now = self.at(self._contact.now)
        blocks = [] if now.o.linearization.frozen else list(self._of_matrices(now))
        by_jump, *others = now.by_displacements()
        parts = [[*now.by_field(self.traces), *by_jump], *others]
        return [*blocks, self._loads(now, *now.stacked(parts))]

    def field_derivative(self) -> Block:
        """Derivatives of the loads by the field alone (collective)."""
        now = self.at(self._contact.now)
        return self._loads(now, *now.stacked([now.by_field(self.traces)]))

    def by_multipliers(self) -> Block:
        """Derivatives of the loads by multipliers; columns index z.ravel() (collective)."""
        now = self.at(self._contact.now)
        own, dim = self._contact.slave.owned, self._contact.slave.dim
        columns = dim * own[:, None] + np.arange(dim)
        h, source = ([Block(own[:, None], columns, row.by_z[own][:, None])] for row in now.rows)
        return self._loads(now, *now.stacked([[], h, [], source]))

    def add_by_motions(self, columns: Array) -> None:
        """Add the loads' derivatives by the motions of the obstacle (collective).

        Args:
            columns: Shape (m, owned dofs) or longer [load / length]; changed in place.
        """
        now = self.at(self._contact.now)
        h, source = (row_by_motions(now.f, row) for row in now.rows)
        change = np.concatenate([0.0 * h, h, 0.0 * h, source])
        self._add(self._by_quantities(now) @ change, columns.T)

    def _add(self, values: Array, target: Array) -> None:
        """Add ``values`` (d, ...) at the dofs to those that this rank owns in ``target``."""
        mine = (self.dofs >= self._owned[0]) & (self.dofs < self._owned[1])
        target[self.dofs[mine] - self._owned[0]] += values[mine]

    def _linear_part(self, now: FluxValues, z: Array) -> Array:
        """Derivatives of the loads by multipliers times ``z`` (slave nodes, dim): (d,) [load]."""
        h, source = (np.einsum("jc,jc->j", row.by_z, z) for row in now.rows)
        return self._by_quantities(now) @ np.concatenate([0.0 * h, h, 0.0 * h, source])

    def _of_matrices(self, now: FluxValues) -> Iterator[Block]:
        """Blocks of d(D^T q)/dd and -d(M^T q)/dd at fixed fluxes."""
        numbers = np.arange(len(now.o.x))[:, None]
        on_slave, on_master = now.expected
        yield self.traces[0].rows(now.o.slave_force_derivative(on_slave[:, None], numbers))
        if len(self.traces) > 1:
            nodes = np.arange(len(now.o.m))[:, None]
            yield self.traces[1].rows(now.o.master_force_derivative(on_master[:, None], nodes))

    def _loads(self, now: FluxValues, numbers: Indices, change: csr_array) -> Block:
        """Derivatives of the loads, from those of the four quantities by unknowns of ``numbers``.

        Collective.
        """
        return _as_block(csr_array(self._by_quantities(now) @ change), self.dofs, numbers)

    def _by_quantities(self, now: FluxValues) -> csr_array:
        """Derivatives of the loads by the four quantities, E^T (D^T - M^T), (d, 4 n)."""
        sides = zip(self._to_loads(now), (1.0, -1.0), now.by_quantities, strict=False)
        return sum(sign * (matrix.T @ of_flux) for matrix, sign, of_flux in sides)

    def _to_loads(self, now: FluxValues) -> list[csr_array]:
        """D E and M E with columns in the order of ``dofs`` (collective)."""
        return [
            matrix @ self._interpolation(trace)
            for matrix, trace in zip(now.o.matrices, self.traces, strict=False)
        ]

    def _interpolation(self, trace: Trace) -> csr_array:
        """E of a trace, columns in the order of ``dofs``."""
        node, part = np.nonzero(trace.dofs >= 0)
        column = np.searchsorted(self.dofs, trace.dofs[node, part])
        shape = len(trace.dofs), self.dofs.size
        return coo_array((trace.weights[node, part], (node, column)), shape=shape).tocsr()


def _spreads(contact: Any, trace: Trace, prescribed: Flags) -> tuple[csr_array, csr_array]:
    """The matrices A of a field, and of one that is conducted perfectly (collective).

    Args:
        contact: The contact.
        trace: The field on its slave.
        prescribed: Whether a local dof has a Dirichlet value, shape (local dofs,), bool.
    """
    slave, count = contact.slave, contact.slave.num_nodes
    at_carriers = csr_array(eye(count))
    if trace.dofs.shape[1] > 1:
        inner, corners, weights = slave.between_corners
        first = np.unique(inner, return_index=True)[1]
        rows = np.repeat(inner[first], corners.shape[1])
        values = np.broadcast_to(weights[first], corners[first].shape).ravel()
        linear = coo_array((values, (rows, corners[first].ravel())), shape=(count, count))
        at_carriers = csr_array(diags((~slave.inner).astype(float)) + linear)
    at_corners = contact.at_vertices or trace.dofs.shape[1] > 1
    facets = slave.corners if at_corners else slave.facets
    of_facets = np.repeat(np.arange(len(facets)), facets.shape[1]), facets.ravel()
    beside = coo_array((np.ones(facets.size), of_facets), shape=(len(facets), count)).tocsr()
    free = trace.gather(prescribed.astype(float)) < 1.0
    others = (beside.T @ beside) @ diags(free.astype(float))
    sums = others.sum(axis=1)
    kept = free | (sums == 0.0)
    shares = np.where(kept, 0.0, 1.0 / np.where(sums > 0.0, sums, 1.0))
    handed = diags(kept.astype(float)) + diags(shares) @ others
    return at_carriers, csr_array(at_carriers @ handed)


# Numbers of the columns of a matrix, and the matrix.
_Numbered = tuple[Indices, csr_array]


def _sparse(blocks: Iterable[Block], count: int) -> _Numbered:
    """Sum of blocks with ``count`` rows and few columns of many, without columns of -1."""
    i, j, v = (np.concatenate(parts) for parts in zip(*map(_entries, blocks), strict=True))
    used = (j >= 0) & (v != 0.0)
    numbers, at = np.unique(j[used], return_inverse=True)
    return numbers, coo_array((v[used], (i[used], at)), shape=(count, numbers.size)).tocsr()


def _entries(block: Block) -> tuple[Indices, Indices, Array]:
    """Rows, columns and values of a block's entries."""
    rows = np.broadcast_to(block.rows[:, :, None], block.values.shape)
    columns = np.broadcast_to(block.columns[:, None, :], block.values.shape)
    return rows.ravel(), columns.ravel(), block.values.ravel()


def _as_block(matrix: csr_array, rows: Indices, columns: Indices) -> Block:
    """A sparse matrix as a block per entry, with the numbers of its rows and columns."""
    found = matrix.tocoo()
    return Block(
        rows[found.row][:, None], columns[found.col][:, None], found.data.reshape(-1, 1, 1)
    )
