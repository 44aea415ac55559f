# SPDX-License-Identifier: MIT
"""Flux of a scalar field T across a contact: loads on both sides, with all derivatives.

With D and M of the contact, mean gaps g_j and weights w_j, slave node j has

    jump           [T]_j = (sum_k D_jk T_k - sum_l M_jl T_l) / w_j
    conduction       q_j = h(p_j, g_j) [T]_j          p = max(z_n, 0), g = 0 where closed
    friction         P_j = z_tau,j u_j / step         u the slip of the step; or P(p, X)

where T_k, T_l are the values at the nodes, see ``traces``. With the share s of the slave,
D^T (q - s P) leaves the slave and M^T (q + (1 - s) P) enters the master. Since M reproduces
constants, the loads of both sides and the source are in balance to rounding for any mesh.

q is a multiplier of one component, part of the state, with the row [T] - q / h = 0: jumps are zero
where conduction is perfect, h = inf, and q is zero where h is. The row of a node yields its q,
in both linear systems, since q / h is in no other row,

    q' = e ([T] + d[T]) + (1 - e / h) q + (e / h) (q / h) dh,      e = min(h, e_max),

with D and M in d(D^T q) at the present q. Where h exceeds e_max, a multiple of the conduction of
the cells, q' is that of an augmented Lagrangian: jumps decrease by e_max over this conduction in an
iteration, below quadratic convergence, and rounding of T does not enter q. Where h is below that of
the cells, [T] replaces q / h, which may be 0 / 0.

A field of degree 1 beside a displacement of degree 2 has fewer dofs than there are nodes: jumps of
zero at all nodes would leave it no freedom where facets do not match. Carriers c are therefore the
nodes with dofs. The jump is linear between them, with means over their part of the surface in which
nodes count by their conductance: A has the linear values at the nodes, A_jc = 1 at carriers, and

    q_j = h_j sum_c A_jc [T]_c,       [T]_c = sum_j A_jc h_j w_j [T]_j / sum_j A_jc h_j w_j.

Nodes that do not conduct have no part in either, and loads are the transpose of the jumps. State
and rows are those of q_c = h_c [T]_c, h_c = sum_j A_jc w_j h_j / sum_j A_jc w_j. At the nodes it is
q_j = sum_c B_jc q_c with B_jc = A_jc h_j / h_c. If h is infinite at a node of a carrier, its nodes
of finite h do not count: this is the limit. Fluxes q_j alternate about a sudden change, as linear
functions do whose integrals with hat functions are given. Shown are therefore, in place of q_c, the
heat of a carrier over its area, sum_j A_jc w_j q_j / sum_j A_jc w_j, as without A: totals stay.

Where conduction is perfect, and the slave's field is prescribed at a node, its equation is left to
the carriers beside it, as in ``tied_rows``.

On a rigid obstacle its given value replaces the master's, and the master's load leaves the system.

The loads depend on displacements and T, and by h and P on the multipliers z. Sources: Hueber &
Wohlmuth (2009); Seitz, Wall & Popp (2018); Nocedal & Wright (2006), section 17.3.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array, diags, eye, hstack

from dolfinx import fem

from fenics_mortar.contact.fields import ContactFields, change_along
from fenics_mortar.contact.law import Row, VectorRow
from fenics_mortar.contact.rows import row_by_displacements, row_by_motions
from fenics_mortar.interface.mortar import Block, as_block, compressed
from fenics_mortar.interface.traces import Trace, trace_of
from fenics_mortar.utils.arrays import EPSILON, TINY, Array, Flags, Indices
from fenics_mortar.utils.ranks import largest_over_ranks, sum_over_ranks

if TYPE_CHECKING:
    from fenics_mortar.contact.law_calls import Conductance, ConductanceValue
    from fenics_mortar.interface.mortar import MortarOperators, NumberedColumns
    from fenics_mortar.mesh.space import DisplacementSpace


class FluxValues:
    """Fluxes of both sides at the slave nodes, and their derivatives.

    Args:
        law: The conductance.
        f: Fields of the contact.
        T, T_master: The field at the nodes of both sides.
        cells: Conduction of the cells beside the nodes per area, (slave nodes,) [flux / field].
        spread: The matrix A, shape (slave nodes, slave nodes) [1].
        q: Conduction of the carriers in the state, (slave nodes,) [flux]; ``None``: h [T].
        stiffest: e_max over the conduction of the cells [1].

    Attributes:
        q: Conduction of the carriers, shape (slave nodes,) [flux].
        next_q: That of a Newton step without increments, shape (slave nodes,) [flux].
        row: min(h, conduction of the cells) times the row of q, shape (slave nodes,) [flux].
    """

    def __init__(
        self,
        law: Conductance,
        f: ContactFields,
        T: Array,
        T_master: Array,
        cells: Array,
        spread: csr_array,
        q: Array | None,
        stiffest: float,
    ) -> None:
        self._law, self.f, self.T, self.T_master = law, f, T, T_master
        self.o: MortarOperators = f.operators
        self.on, self._spread = f.covered, spread
        self.weight: Array = np.where(self.on, self.o.weight, 0.0)
        D, M = self.o.matrices
        self._reference = 0.0 if law.temperature is None else law.on_obstacle
        jump = D @ (T - self._reference) - M @ (T_master - self._reference)
        self._is_finite = q is None
        self.h, self._power = self._of_law()
        self.conductance = np.where(self.on & (self.weight > 0.0), self.h.h, 0.0)
        self._set_means(np.where(self.on, jump, 0.0))
        self.e, stiff = np.minimum(self._h, stiffest * cells), self._h > cells
        self.is_exact: Flags = self.e == self._h  # q' does not depend on q
        self.q = self._h * self._jump if q is None else q
        self._per_h = np.where(stiff, self.q / np.where(stiff, self._h, 1.0), self._jump)
        self._ratio = np.where(self.is_exact, 1.0, self.e / np.where(self._h > 0.0, self._h, 1.0))
        self.next_q = self.e * self._jump + self.kept * self.q
        least = np.where(stiff, cells, self.e) / np.where(self.e > 0.0, self.e, 1.0)
        self.row = (self.next_q - self.q) * np.where(self.e > 0.0, least, 1.0)
        self.conduction = self.at_nodes(self.q)

    def _of_law(self) -> tuple[ConductanceValue, tuple[Array, ...]]:
        """Conductance, and power with its slope if ``heating`` is a function, else () (local).

        An open node has the conductance of open contact, continued linearly to negative gaps.
        """
        law, closed = self._law, self.f.state.active
        pressure = np.where(closed, np.maximum(self.f.z_n, 0.0), 0.0)
        gap = np.where(closed | ~self.on, 0.0, self.f.mean_gap)
        least = max(EPSILON * float(np.abs(self.o.x).max(initial=0.0)), TINY)  # known of a gap
        opened = np.where(closed | ~self.on, 0.0, np.maximum(gap, least))
        h = law.evaluate(pressure, opened, finite=self._is_finite)
        h = h._replace(h=h.h + h.by_gap * np.minimum(gap, 0.0))
        if not callable(law.heating):
            return h, ()
        return h, law.power(np.where(self.on, pressure, 0.0), self.o.slave.X)

    @property
    def is_current(self) -> bool:
        """Whether functions of a user, which may read other values, return the same (local)."""
        h, power = self._of_law()
        return all(map(np.array_equal, (*self.h, *self._power), (*h, *power)))

    def _set_means(self, jump: Array) -> None:
        """Means at the carriers of weighted jumps, and of conductances, with the matrix B."""
        A, w, h = self._spread.tocoo(), self.weight, self.conductance
        self._is_plain = A.nnz == len(w) and bool((A.row == A.col).all())  # each node carries q
        perfect = np.isinf(h)
        self._is_inf: Flags = self._spread.T @ perfect.astype(float) > 0.0
        self._finite_h = np.where(perfect, 0.0, h)
        profile = np.where(self._is_inf[A.col], perfect[A.row], self._finite_h[A.row])
        of_carriers = self._spread.T @ w
        conducts = np.bincount(A.col, A.data * profile * w[A.row], len(w)) > 0.0
        profile = np.where(conducts[A.col], profile, self.on[A.row])
        self._varies = conducts & ~self._is_inf
        self._R = csr_array((A.data * profile, (A.row, A.col)), shape=A.shape)
        P = self._R.T @ w
        self._per_weight, self._per_P = (
            np.where(sums > 0.0, 1.0 / np.where(sums > 0.0, sums, 1.0), 0.0)
            for sums in (of_carriers, P)
        )
        self._to_nodes = csr_array(self._R @ diags(of_carriers * self._per_P))
        self._jump = self._per_P * (self._R.T @ jump)
        self._h = np.where(self._is_inf, np.inf, np.where(conducts, P * self._per_weight, 0.0))
        self._nodal_jump = np.divide(jump, w, out=np.zeros_like(w), where=w > 0.0)

    @property
    def jump(self) -> Array:
        """Jumps of conducting nodes between those of the carriers, else the own ones (n,) [K]."""
        return np.where(self.conductance > 0.0, self._spread @ self._jump, self._nodal_jump)

    def of_carriers(self, nodal: Array) -> Array:
        """Sums at carriers of values at covered nodes [their unit], transpose of ``at_nodes``."""
        return np.asarray(self._to_nodes.T @ np.where(self.on, nodal, 0.0))

    def means(self, q: Array) -> Array:
        """Heat of the carriers over their areas, at the nodes, for fluxes ``q`` (n,) [flux]."""
        return self.at_nodes(self._per_weight * (self._spread.T @ (self.weight * q)))

    @property
    def kept(self) -> Array:
        """Part of q that q' keeps, 1 - e / h, (slave nodes,) [1]."""
        return np.asarray(1.0 - self._ratio)

    def at_nodes(self, of_carriers: Array) -> Array:
        """Values at covered nodes, else 0, of values at carriers, (slave nodes,) [their unit]."""
        return np.where(self.on, self._to_nodes @ of_carriers, 0.0)

    @cached_property
    def _heating(self) -> Row:
        """The source and its derivatives, zero where open."""
        f, law = self.f, self._law
        closed = f.state.active & self.on
        if callable(law.heating):
            power, slope = self._power
            pressed = closed & (f.z_n > 0.0)
            return Row(np.where(closed, power, 0.0), by_z_n=np.where(pressed, slope, 0.0))
        if law.heating is None or not f.interface.pair.law.has_friction:
            return Row(np.zeros(len(self.T)))
        node = f.nodal
        rubs = np.where(closed & f.interface.follows_law, 1.0 / node.step, 0.0)
        row = Row(rubs * f.z_tau * f.slip, by_slip=rubs * f.z_tau, by_z_tau=rubs * f.slip)
        return f.at_gaps(row)

    @property
    def largest_source(self) -> float:
        """Largest source of a node by friction with a slip of one [flux] (local)."""
        by_slip = np.abs(np.zeros_like(self.weight) + self._heating.by_slip)
        return float((self.weight * by_slip).max(initial=0.0))

    @property
    def friction(self) -> Array:
        """Source, power per area, (slave nodes,) [flux]."""
        return np.asarray(self._heating.residual)

    def of_sides(self, q: Array) -> tuple[Array, Array]:
        """Fluxes that leave the slave and enter the master, for ``q`` of carriers (slave nodes,).

        Shape (slave nodes,) each [flux].
        """
        on_slave = self.at_nodes(q) - self._law.share * self.friction
        return on_slave, on_slave + self.friction

    # Derivatives of both fluxes are sums over four quantities of the nodes: weighted jumps,
    # weighted conductances, weights and the source.

    def stacked(self, parts: Sequence[Iterable[Block]]) -> NumberedColumns:
        """Derivatives of the four quantities from their blocks, whose rows are slave nodes."""
        count = len(self.T)
        blocks = [
            block._replace(rows=block.rows + number * count)
            for number, part in enumerate(parts)
            for block in part
        ]
        return compressed(blocks, 4 * count)

    @cached_property
    def q_by_quantities(self) -> csr_array:
        """Derivatives of q' of the carriers by all quantities but the source, (n, 3 n)."""
        A_T, R_T = self._spread.T, self._R.T
        h = np.where(np.isfinite(self._h), self._h, 0.0)
        by_h = diags(self._per_weight * self._ratio * self._per_h)
        by_jump = diags(self.e * self._per_P)
        of_h = by_h @ A_T
        if not self._is_plain:
            apart = A_T @ diags(self._nodal_jump) - diags(self._jump) @ A_T
            of_h = of_h + by_jump @ diags(self._varies.astype(float)) @ apart
        parts = [
            by_jump @ R_T,
            of_h,
            by_h @ (A_T @ diags(self._finite_h) - diags(h) @ A_T)
            - diags(self.e * self._per_P * self._per_h) @ R_T,
        ]
        return csr_array(hstack(parts) @ diags(np.tile(self.on.astype(float), 3)))

    @cached_property
    def _spread_by_quantities(self) -> csr_array:
        """Derivatives of B q at fixed q, by all quantities but the source, (n, 3 n)."""
        A, R, varies = self._spread, self._R, self._varies.astype(float)
        s = np.where(self._varies, self._per_h, self.q * self._per_P * (A.T @ self.weight))
        per_w = np.divide(1.0, self.weight, out=np.zeros_like(s), where=self.weight > 0.0)
        by_P = R @ diags(s * self._per_P)
        parts = [
            csr_array(A.shape),
            diags(per_w * (A @ (varies * s))) - by_P @ diags(varies) @ A.T,
            R @ diags(self.q * self._per_P) @ A.T - by_P @ R.T,
        ]
        return csr_array(hstack(parts) @ diags(np.tile(self.on.astype(float), 3)))

    @cached_property
    def by_quantities(self) -> list[csr_array]:
        """Derivatives of the fluxes of slave and master, (slave nodes, 4 slave nodes)."""
        conduction = self._to_nodes @ self.q_by_quantities
        if not self._is_plain:
            conduction = conduction + self._spread_by_quantities
        conduction = diags(self.on.astype(float)) @ conduction
        one, share = eye(len(self.T)), self._law.share
        return [csr_array(hstack([conduction, part * one])) for part in (-share, 1.0 - share)]

    @property
    def by_scale(self) -> Array:
        """Derivative of h [T] by the law's ``scale``, zero where conduction is perfect [flux]."""
        h = np.where(np.isfinite(self._h), self._h, 0.0)
        return np.asarray(self._per_h * h / self._law.scale)

    @cached_property
    def rows(self) -> tuple[VectorRow, VectorRow]:
        """Derivatives of weighted conductances at fixed weights, and of the source."""
        closed = self.f.state.active
        pressed = closed & (self.f.z_n > 0.0)
        by_gap = np.where(closed, 0.0, self.weight * self.h.by_gap)
        by_z_n = np.where(pressed, self.weight * self.h.by_pressure, 0.0)
        h = Row(np.zeros_like(self.weight), by_gap=by_gap, by_z_n=by_z_n)
        return self.f.by_vectors(h), self.f.by_vectors(self._heating)

    @cached_property
    def by_displacements(self) -> list[list[Block]]:
        """Blocks of the four quantities' derivatives by displacements."""
        o, (h, source) = self.o, self.rows
        apart = (T - self._reference for T in (self.T, self.T_master))
        return [
            list(o.matrix_derivative(*apart)),
            list(row_by_displacements(self.f, h)),
            list(o.weight_derivative()),
            list(row_by_displacements(self.f, source)),
        ]

    def by_field(self, traces: list[Trace]) -> Iterator[Block]:
        """Blocks of the weighted jumps' derivative by the field's dofs; rows are slave nodes."""
        o, s = self.o, self.o.segments
        yield Block(o.facet_nodes, *traces[0].columns(o.facet_nodes, o.D))
        if len(traces) > 1:
            yield Block(s.slave, *traces[1].columns(s.master, -o.M))


# e_max over the conduction of the cells beside a node [1]. Jumps decrease by this factor in an
# iteration, to which rounding in the factors of the linear system adds 1e-10 of them.
STIFFEST = 1e6
# The same in solves with the tangent that are repeated for derivatives [1]: rounding in the factors
# adds 1e-13 of jumps, in place of 1e-10; ``equations.linearized`` has the number of solves. Finite
# conductances above it, too, are solved for exactly, see ``Flux.remainder``.
SOFT = 1e3


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
        column: Number of its column of ``conduction`` in the state.
        space: The displacement's nodes, and the mixed space.
        contact: The contact; its surfaces are those of the traces.
        prescribed: Whether a local dof has a Dirichlet value, shape (local dofs,), bool.

    Attributes:
        law: The conductance.
        is_separate: Whether the field is solved for in another problem.
        traces: Traces of the field on the slave and, unless it is an obstacle, on the master.
        dofs: All dofs of the traces, shape (d,), replicated.
        cells: Conduction of the cells beside the nodes per area, shape (slave nodes,) [flux /
            field]; inf for a separate field.
        to_force: Factor that turns loads into forces of Newton's residual [stress / flux].
        jumps: Whether the conductance may jump where contact closes.

    Raises:
        ValueError: On all ranks, if the space has no such field, or an obstacle no temperature, or
            a separate field is conducted perfectly.
    """

    jumps: Any = property(attrgetter("law.jumps"))

    def __init__(
        self,
        law: Conductance,
        column: int,
        space: DisplacementSpace,
        contact: Any,
        prescribed: Flags,
    ) -> None:
        self.law, self._column, self._contact = law, column, contact
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
        if self.is_separate and law.is_perfect:
            raise ValueError(
                f"{law!r}: perfect conduction of a field with a problem of its own is not "
                "possible, since its flux is an unknown of one system; expected a finite "
                "conductance, or the number of a sub-space of a mixed function"
            )
        self._owned = space.first, space.first + space.num_owned
        if isinstance(law.field, fem.Function):  # its conditions are not known
            self._owned = law.field.function_space.dofmap.index_map.local_range
            prescribed = np.zeros(law.field.x.array.size, bool)
        self._values: tuple[Array, Array] = np.zeros(contact.slave.num_nodes), np.zeros(0)
        self.to_force = 1.0
        self._spreads = self.traces[0].spreads(prescribed, at_vertices=contact.at_vertices)
        self.cells = np.full(contact.slave.num_nodes, np.inf)
        self._stiffest = STIFFEST
        self._kept: tuple[Any, Any, FluxValues] | None = None
        self._products: tuple[FluxValues | None, Any] = None, None
        self._interpolations = [trace.interpolation(self.dofs) for trace in self.traces]

    def evaluate(self, u: Array) -> None:
        """Gather the field, from all unknowns ``u``, shape (local dofs,), unless separate.

        Collective.
        """
        field: Any = self.law.field
        values = [trace.gather(field.x.array if self.is_separate else u) for trace in self.traces]
        master = values[1] if len(values) > 1 else np.zeros(0)
        self._values = values[0], master

    def set_conduction(self, to_force: Array, own: Array) -> None:
        """Set the conduction of the cells (collective).

        Args:
            to_force: Factors that turn loads into forces, shape (owned dofs,).
            own: Load of a dof by a unit of its own field, shape (owned dofs,).
        """
        mine, _ = self._mine
        comm, areas = self._contact.slave.comm, self._contact.slave.nodal_areas
        self.to_force = float(largest_over_ranks(comm, to_force[mine].max(initial=0.0)))
        at_nodes = self._interpolations[0] @ self._gathered(own)
        self.cells = np.where(areas > 0.0, at_nodes / np.maximum(areas, TINY), 0.0)

    @property
    def largest(self) -> float:
        """Largest magnitude of the field on both sides [field] (local, replicated)."""
        return max(float(np.abs(values).max(initial=0.0)) for values in self._values)

    @property
    def rubs(self) -> bool:
        """Whether friction is a source (local)."""
        return bool(self.law.heating == "friction" and self._contact.pair.law.has_friction)

    @property
    def rounding(self) -> float:
        """Rounding of the largest source of a node by friction [flux length] (collective).

        Where nodes stick, all of it: slips are differences of positions.
        """
        now = self.at(self._contact.now)
        return EPSILON * now.largest_source * float(np.abs(now.o.x).max(initial=0.0))

    @property
    def _mine(self) -> tuple[Indices, Indices]:
        """Local numbers of the owned dofs, and their positions in ``dofs``, (k,) each (local)."""
        first, end = self._owned
        at = np.flatnonzero((self.dofs >= first) & (self.dofs < end))
        return self.dofs[at] - first, at

    def _gathered(self, values: Array) -> Array:
        """Values (owned dofs,) at ``dofs`` on all ranks, shape (d,) (collective)."""
        found, (mine, at) = np.zeros(self.dofs.size), self._mine
        found[at] = values[mine]
        return sum_over_ranks(self._contact.slave.comm, found)

    def row_squares(self) -> float:
        """Sum of squares of the rows of q as forces [stress^2 length^2] (collective)."""
        now = self.at(self._contact.now)
        return float(((self.to_force * now.weight * now.row) ** 2).sum())

    def refresh(self) -> None:
        """Gather a separate field again, which may have changed since (collective)."""
        if self.is_separate:
            self.evaluate(np.empty(0))

    # Values

    def at(self, f: ContactFields) -> FluxValues:
        """Values and derivatives by nodal quantities at the fields of the contact (collective).

        Kept until fields, values, law or what its functions return change.
        """
        law = self.law
        reference = 0.0 if law.temperature is None else law.on_obstacle
        given = f, self._values, self.cells, law.h, law.heating
        numbers = self._stiffest, law.scale, law.share, reference
        if self._kept is not None:
            of, by, now = self._kept
            same = numbers == by and all(a is b for a, b in zip(given, of, strict=True))
            if same and now.is_current:
                return now
        spread = self._spreads[law.is_perfect]
        q = None if self.is_separate else f.state.conduction[:, self._column]
        now = FluxValues(law, f, *self._values, self.cells, spread, q, self._stiffest)
        self._kept = given, numbers, now
        return now

    @contextmanager
    def softened(self) -> Iterator[None]:
        """Within, e_max is that of solves that are repeated, see ``SOFT`` (local)."""
        self._stiffest, before = min(SOFT, self._stiffest), self._stiffest
        try:
            yield
        finally:
            self._stiffest = before

    def _put(self, q: Array) -> None:
        """Set the conduction of the carriers in the state, shape (slave nodes,) [flux] (local)."""
        conduction = self._contact.state.conduction.copy()
        conduction[:, self._column] = q
        self._contact.change(conduction=conduction)

    def settle(self) -> None:
        """Set q to h [T] where h is not too large for it (collective)."""
        now = self.at(self._contact.now)
        self._put(np.where(now.is_exact, now.next_q, now.q))

    def move(self, z: Array, fraction: float, step: Array, motion: Array) -> None:
        """Apply a fraction of the increment of q, before that of other unknowns (collective).

        Args:
            z: Multipliers of the linear system, shape (slave nodes, dim) [stress].
            fraction: Fraction of the increment [1].
            step: Full increment of the unknowns of the bodies, shape (owned dofs,).
            motion: Full increment of the obstacle's motions, shape (m,), or (0,) [length].
        """
        now = self.at(self._contact.now)
        q = now.next_q + self._change(now, step, z - self._contact.z, motion)
        self._put(now.q + fraction * (q - now.q))

    def _change(self, now: FluxValues, u: Array, z: Array, motion: Array) -> Array:
        """Change of q' by those of all unknowns, see ``move``; (slave nodes,) (collective)."""
        sides = [side.gather(u) for side in (self._contact.slave, self._contact.master)]
        jump, h, weight = (
            change_along(now.f, blocks, *sides) for blocks in now.by_displacements[:3]
        )
        row, _ = now.rows
        h += np.einsum("jc,jc->j", row.by_z, z)
        if motion.size:
            h += row_by_motions(now.f, row) @ motion
        change = np.concatenate([jump + self._jump_of(now, u), h, weight])
        return np.asarray(now.q_by_quantities @ change)

    def _jump_of(self, now: FluxValues, u: Array) -> Array:
        """Weighted jumps of the field in ``u``, shape (slave nodes,) (collective)."""
        at_dofs, signs = self._gathered(u), (1.0, -1.0)
        sides = zip(signs, self._to_loads(now), strict=False)
        return np.asarray(sum(sign * (matrix @ at_dofs) for sign, matrix in sides))

    @property
    def coupled(self) -> csr_array:
        """Slave nodes whose conductions depend on each other: entries of A A^T (local)."""
        return sum(abs(spread) @ abs(spread).T for spread in self._spreads)

    def nodal(self) -> NodalFlux:
        """The flux at the present state (collective); filled inside of facets as the pressure."""
        self.refresh()
        now = self.at(self._contact.now)
        slave, master = (float(now.o.weight @ of_side) for of_side in now.of_sides(now.q))
        perfect = np.isinf(now.conductance)
        h = np.where(perfect, 0.0, now.conductance)
        jump = np.divide(now.means(h * now.jump), h, out=now.jump, where=h > 0.0)
        jump, h, perfect, conduction, heating = (
            now.f.fill_inside(values.astype(float))
            for values in (jump, h, perfect, now.means(now.conduction), now.friction)
        )
        h[perfect > 0.0] = np.inf
        return NodalFlux(jump, h, conduction, heating, -slave, master)

    def loads(self) -> list[Array]:
        """Loads of the nodes of each trace, (nodes,) [flux length], replicated (collective)."""
        now = self.at(self._contact.now)
        return self._loads_by(now.o, *now.of_sides(now.q))

    def _loads_by(self, o: MortarOperators, on_slave: Array, on_master: Array) -> list[Array]:
        """D^T of one flux and -M^T of the other, for the traces (collective)."""
        sides = o.force(on_slave[:, None])[0], o.force(on_master[:, None])[1]
        return [side[:, 0] for side, _ in zip(sides, self.traces, strict=False)]

    def _add_conduction(self, now: FluxValues, q: Array, target: Array) -> None:
        """Add the loads by ``q`` of carriers (slave nodes,), without sources (collective)."""
        sides = self._loads_by(now.o, *2 * [now.at_nodes(q)])
        for trace, loads in zip(self.traces, sides, strict=True):
            trace.scatter_add(loads, target)

    def add_loads(self, target: Array) -> None:
        """Add the loads to ``target``, shape (owned dofs,) or longer (collective)."""
        for trace, loads in zip(self.traces, self.loads(), strict=True):
            trace.scatter_add(loads, target)

    def add_row_loads(self, target: Array) -> None:
        """Add the loads by which the rows of q change those of the state (collective).

        Args:
            target: Shape (owned dofs,); changed in place [flux length].
        """
        now = self.at(self._contact.now)
        self._add_conduction(now, now.next_q - now.q, target)

    def add_by_scale(self, target: Array) -> None:
        """Add the loads' derivative by the law's ``scale``: those of conduction (collective).

        Args:
            target: Shape (owned dofs,); changed in place [flux length].
        """
        now = self.at(self._contact.now)
        self._add_conduction(now, now.by_scale, target)

    def add_newton_loads(self, target: Array) -> None:
        """Subtract f(z) - f'(z) z, the part of the loads that multipliers leave (collective).

        Args:
            target: Right-hand side of a Newton step, shape (owned dofs,); changed in place.
        """
        loads, z = np.zeros_like(target), self._contact.z
        self.add_loads(loads)
        self.add_row_loads(loads)
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
        return [*blocks, self._loads(now, *self._stacked(now))]

    def _stacked(self, now: FluxValues) -> NumberedColumns:
        """Derivatives of the four quantities by all unknowns of the bodies, of this rank."""
        by_jump, *others = now.by_displacements
        return now.stacked([[*now.by_field(self.traces), *by_jump], *others])

    # Solves with the tangent, which has e_max in place of larger conductances

    @property
    def exceeds(self) -> bool:
        """Whether a conductance exceeds e_max (collective)."""
        return not self.at(self._contact.now).is_exact.all()

    def remainder(self, u: Array, z: Array, motion: Array, d: Array) -> Array:
        """Right-hand side of the next change of a solution of the tangent (collective).

        With loads E^T q, and dq' = Q x of the tangent, the equations K x + E^T dq = b and
        dq = Q x + (1 - e / h) dq are solved with dq of the solve before on the right: changes are

            (K + E^T Q) x_k = -E^T (1 - e / h) d_(k-1),      d_k = Q x_k + (1 - e / h) d_(k-1).

        Args:
            u: The last change x_k, shape (owned dofs,).
            z: Its multipliers, shape (slave nodes, dim) [stress].
            motion: Its motions of the obstacle, shape (m,), or (0,) [length].
            d: That of dq in the solve before, d_(k-1), at first zero, shape (slave nodes,) [flux];
                changed in place to d_k.

        Returns:
            Shape (owned dofs,) [load].
        """
        now, loads = self.at(self._contact.now), np.zeros_like(u)
        d[:] = self._change(now, u, z, motion) + now.kept * d
        self._add_conduction(now, -now.kept * d, loads)
        return loads

    def transposed_remainder(self, u: Array, d: Array) -> tuple[Array, Array, Array]:
        """As ``remainder``, with changes of the transposed equations, zero at prescribed dofs.

        E and Q change places: d, of the multiplier of q' [field], is that of E u.

        Returns:
            Parts of unknowns, multipliers and motions [their units], shaped as ``remainder``.
        """
        contact, now = self._contact, self.at(self._contact.now)
        d[:] = now.of_carriers(self._jump_of(now, u)) + now.kept * d
        q = -now.kept * d
        by_jump, by_h, by_weight = np.split(now.q_by_quantities.T @ q, 3)
        numbers, change = self._stacked(now)
        values = change.T @ np.concatenate([by_jump, by_h, by_weight, np.zeros_like(by_h)])
        first, end = self._owned
        on_bodies, motion = np.zeros_like(u), np.zeros(0)
        for dofs, of_rank in contact.slave.comm.allgather((numbers, values)):
            mine = (dofs >= first) & (dofs < end)
            on_bodies[dofs[mine] - first] += of_rank[mine]
        row, _ = now.rows
        if contact.obstacle is not None:
            motion = by_h @ row_by_motions(now.f, row)
        return on_bodies, by_h[:, None] * row.by_z, motion

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
        mine, at = self._mine
        target[mine] += values[at]

    def _linear_part(self, now: FluxValues, z: Array) -> Array:
        """Derivatives of the loads by multipliers times ``z`` (slave nodes, dim): (d,) [load]."""
        h, source = (np.einsum("jc,jc->j", row.by_z, z) for row in now.rows)
        return self._by_quantities(now) @ np.concatenate([0.0 * h, h, 0.0 * h, source])

    def _of_matrices(self, now: FluxValues) -> Iterator[Block]:
        """Blocks of d(D^T q)/dd and -d(M^T q)/dd at fixed fluxes."""
        numbers = np.arange(len(now.o.x))[:, None]
        on_slave, on_master = now.of_sides(now.q)
        yield self.traces[0].rows(now.o.slave_force_derivative(on_slave[:, None], numbers))
        if len(self.traces) > 1:
            nodes = np.arange(len(now.o.m))[:, None]
            yield self.traces[1].rows(now.o.master_force_derivative(on_master[:, None], nodes))

    def _loads(self, now: FluxValues, numbers: Indices, change: csr_array) -> Block:
        """Derivatives of the loads, from those of the four quantities by unknowns of ``numbers``.

        Collective.
        """
        return as_block(csr_array(self._by_quantities(now) @ change), self.dofs, numbers)

    def _by_quantities(self, now: FluxValues) -> csr_array:
        """Derivatives of the loads by the four quantities, E^T (D^T - M^T), (d, 4 n)."""
        if self._products[0] is not now:
            sides = zip(self._to_loads(now), (1.0, -1.0), now.by_quantities, strict=False)
            found = sum(sign * (matrix.T @ of_flux) for matrix, sign, of_flux in sides)
            self._products = now, found
        return self._products[1]

    def _to_loads(self, now: FluxValues) -> list[csr_array]:
        """D E and M E with columns in the order of ``dofs`` (collective)."""
        return [
            matrix @ interpolation
            for matrix, interpolation in zip(now.o.matrices, self._interpolations, strict=False)
        ]
