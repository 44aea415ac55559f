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
functions do whose integrals with hat functions are given. Results therefore show, in place of q_c,
the heat of a carrier over its area, sum_j A_jc w_j q_j / sum_j A_jc w_j, as without A: totals stay.

Where conduction is perfect, and the slave's field is prescribed at a node, its equation is left to
the carriers beside it, as in ``tied_rows``.

On a rigid obstacle its given value replaces the master's, and the master's load leaves the system.

The loads depend on displacements and T, and by h and P on the multipliers z. Sources: Hueber &
Wohlmuth (2009); Seitz, Wall & Popp (2018); Nocedal & Wright (2006), section 17.3.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array, diags, hstack

from dolfinx import fem

from fenics_mortar.contact.conductance import Conductance, ConductanceValue, NodalFlux
from fenics_mortar.contact.law import Row, VectorRow
from fenics_mortar.contact.rows import change_along, row_by_displacements, row_by_motions
from fenics_mortar.interface.mortar import Block, NumberedColumns, as_block, compressed
from fenics_mortar.interface.traces import FieldTraces
from fenics_mortar.utils.arrays import EPSILON, TINY, Array, Flags, summed
from fenics_mortar.utils.ranks import from_all_ranks, largest_over_ranks

if TYPE_CHECKING:
    from fenics_mortar.contact.fields import ContactFields
    from fenics_mortar.mesh.space import DisplacementSpace


# e_max over the conduction of the cells beside a node [1]. Jumps decrease by this factor in an
# iteration, to which rounding in the factors of the linear system adds 1e-10 of them.
STIFFEST = 1e6
# The same in solves with the tangent that are repeated for derivatives [1]: rounding in the factors
# adds 1e-13 of jumps, in place of 1e-10; ``equations.linearized`` has the number of solves. Finite
# conductances above it, too, are solved for exactly, see ``Flux.remainder``.
SOFT = 1e3


class Flux(FieldTraces):
    """A ``Conductance`` bound to a contact.

    Args:
        law: The conductance.
        column: Number of its column of ``conduction`` in the state.
        space: The displacement's nodes, and the mixed space.
        contact: The contact; its surfaces are those of the traces.
        prescribed: Whether a local dof has a Dirichlet value, shape (local dofs,), bool.

    Attributes:
        law, column: See the arguments.
        is_separate: Whether the field is solved for in another problem.
        traces: Traces of the field on the slave and, unless it is an obstacle, on the master.
        T: The field at the dofs of the traces, shape (d,), replicated.
        spreads: Matrices A without and with perfect conduction, shape (slave nodes, slave nodes).
        cells: Conduction of the cells beside the nodes per area, shape (slave nodes,) [flux /
            field]; inf for a separate field.
        stiffest: e_max over the conduction of the cells [1].
        to_force: Factor that turns loads into forces of Newton's residual [stress / flux].

    Raises:
        ValueError: On all ranks, if the space has no such field, or an obstacle no temperature, or
            a separate field is conducted perfectly.
    """

    def __init__(
        self, law: Conductance, column: int, space: DisplacementSpace, contact: Any,
        prescribed: Flags,
    ) -> None:  # fmt: skip
        self.law, self.column, self._contact = law, column, contact
        rigid = contact.obstacle is not None
        if rigid == (law.temperature is None):
            cure = "give temperature=" if rigid else "omit temperature="
            raise ValueError(
                f"{law!r} of {contact.pair!r}: the master is {'an' if rigid else 'no'} obstacle; "
                f"{cure}"
            )
        sides = (contact.slave,) if rigid else (contact.slave, contact.master)
        super().__init__(space, law.field, sides)
        self.is_separate = isinstance(law.field, fem.Function)
        if self.is_separate and law.is_perfect:
            raise ValueError(
                f"{law!r}: perfect conduction of a field with a problem of its own is not "
                "possible, since its flux is an unknown of one system; expected a finite "
                "conductance, or the number of a sub-space of a mixed function"
            )
        if isinstance(law.field, fem.Function):  # its conditions are not known
            prescribed = np.zeros(law.field.x.array.size, bool)
        self.T, self.to_force = np.zeros(self.dofs.size), 1.0
        free = self.interpolations[0] @ self.gathered(prescribed) < 1.0
        self.spreads = self.traces[0].spreads(free, at_vertices=contact.at_vertices)
        self.cells = np.full(contact.slave.num_nodes, np.inf)
        self.stiffest = STIFFEST
        self._kept: tuple[Any, Any, FluxValues] | None = None

    def evaluate(self, u: Array) -> None:
        """Gather the field, from all unknowns ``u``, shape (local dofs,), unless separate.

        Collective.
        """
        field: Any = self.law.field
        self.T = self.gathered(field.x.array if self.is_separate else u)

    def set_conduction(self, to_force: Array, own: Array) -> None:
        """Set the conduction of the cells (collective).

        Args:
            to_force: Factors that turn loads into forces, shape (owned dofs,).
            own: Load of a dof by a unit of its own field, shape (owned dofs,).
        """
        comm, areas = self._contact.slave.comm, self._contact.slave.nodal_areas
        self.to_force = float(largest_over_ranks(comm, to_force[self._mine].max(initial=0.0)))
        at_nodes = self.interpolations[0] @ self.gathered(own)
        self.cells = np.where(areas > 0.0, at_nodes / np.maximum(areas, TINY), 0.0)

    @property
    def rounding(self) -> float:
        """Rounding of the largest source of a node by friction [flux length] (collective).

        Where nodes stick, all of it: slips are differences of positions.
        """
        if self.law.heating != "friction" or not self._contact.pair.law.has_friction:
            return 0.0
        now = self.now
        largest = np.abs(now.weight * now.source.by_slip).max(initial=0.0)
        return EPSILON * float(largest * np.abs(now.o.x).max(initial=0.0))

    # Values

    @property
    def now(self) -> FluxValues:
        """Values and derivatives at the present fields of the contact; collective.

        Kept until fields, values, law or what its functions return change.
        """
        law = self.law
        given = self._contact.now, self.T, self.cells, law.h, law.heating
        numbers = self.stiffest, law.scale, law.share, law.on_obstacle
        if self._kept is not None:
            of, by, now = self._kept
            same = numbers == by and all(a is b for a, b in zip(given, of, strict=True))
            if same and now.is_current:
                return now
        now = FluxValues(self, self._contact.now)
        self._kept = given, numbers, now
        return now

    @contextmanager
    def softened(self) -> Iterator[None]:
        """Context in which e_max is that of repeated solves, see ``SOFT`` (local)."""
        self.stiffest, before = min(SOFT, self.stiffest), self.stiffest
        try:
            yield
        finally:
            self.stiffest = before

    def _put(self, q: Array) -> None:
        """Set the conduction of the carriers in the state, shape (slave nodes,) [flux] (local)."""
        conduction = self._contact.state.conduction.copy()
        conduction[:, self.column] = q
        self._contact.change(conduction=conduction)

    def settle(self) -> None:
        """Set q to h [T] where h is not too large for it (collective)."""
        now = self.now
        self._put(np.where(now.is_exact, now.next_q, now.q))

    def move(self, z: Array, fraction: float, step: Array, motion: Array) -> None:
        """Apply a fraction of the increment of q, before that of other unknowns (collective).

        Args:
            z: Multipliers of the linear system, shape (slave nodes, dim) [stress].
            fraction: Fraction of the increment [1].
            step: Full increment of the unknowns of the bodies, shape (owned dofs,).
            motion: Full increment of the obstacle's motions, shape (m,), or (0,) [length].
        """
        now = self.now
        q = now.next_q + self._change(step, z - self._contact.z, motion)
        self._put(now.q + fraction * (q - now.q))

    def _change(self, u: Array, z: Array, motion: Array) -> Array:
        """Change of q' by those of all unknowns, see ``move``; (slave nodes,) (collective)."""
        now, sides = self.now, [s.gather(u) for s in (self._contact.slave, self._contact.master)]
        jump, h, weight = (change_along(now.f, part, *sides) for part in now.by_displacements[:3])
        row, _ = now.rows
        h += np.einsum("jc,jc->j", row.by_z, z)
        if motion.size:
            h += row_by_motions(now.f, row) @ motion
        jump += now.jumps @ self.gathered(u)
        return np.asarray(now.q_by_quantities @ np.concatenate([jump, h, weight]))

    @property
    def coupled(self) -> csr_array:
        """Slave nodes whose conductions depend on each other: entries of A A^T (local)."""
        return sum(abs(spread) @ abs(spread).T for spread in self.spreads)

    def nodal(self) -> NodalFlux:
        """The flux at the present state (collective); filled inside of facets as the pressure."""
        if self.is_separate:  # it may have changed since
            self.evaluate(np.empty(0))
        now = self.now
        slave, master = (float(now.o.weight @ of_side) for of_side in now.of_sides(now.q))
        perfect = np.isinf(now.conductance)
        h = np.where(perfect, 0.0, now.conductance)
        jump = np.divide(now.means(h * now.jump), h, out=now.jump, where=h > 0.0)
        jump, h, perfect, conduction, heating = (
            now.f.fill_inside(values.astype(float))
            for values in (jump, h, perfect, now.means(now.conduction), now.source.residual)
        )
        h[perfect > 0.0] = np.inf
        return NodalFlux(jump, h, conduction, heating, -slave, master)

    def loads(self) -> list[Array]:
        """Loads of the dofs by each side, (d,) [flux length], replicated (collective)."""
        now = self.now
        return now.loads(now.q)

    def add_loads(self, target: Array) -> None:
        """Add the loads to ``target``, shape (owned dofs,) or longer (collective)."""
        self.add(np.sum(self.loads(), axis=0), target)

    def add_newton_loads(self, target: Array) -> None:
        """Subtract f(z) - f'(z) z, the part of the loads that multipliers leave (collective).

        Args:
            target: Right-hand side of a Newton step, shape (owned dofs,); changed in place.
        """
        now, z = self.now, self._contact.z
        h, source = (np.einsum("jc,jc->j", row.by_z, z) for row in now.rows)
        linear = now.by_quantities @ np.concatenate([0.0 * h, h, 0.0 * h, source])
        self.add(linear - np.sum(now.loads(now.next_q), axis=0), target)

    # Derivatives

    @property
    def conducts(self) -> Flags:
        """Slave nodes with a partner, which may conduct, shape (slave nodes,), bool."""
        return np.asarray(self._contact.now.covered)

    def derivative(self) -> list[Block]:
        """Blocks of the loads' derivatives by all unknowns of the bodies (collective)."""
        now = self.now
        blocks = [now.derivative(now.by_unknowns)]
        if now.o.linearization.frozen:
            return blocks
        # d(D^T q)/dd and -d(M^T q)/dd at fixed fluxes
        of_matrices = now.o.slave_force_derivative, now.o.master_force_derivative
        sides = zip(self.traces, of_matrices, now.of_sides(now.q), strict=False)
        for trace, differentiate, flux in sides:
            nodes = np.arange(trace.surface.num_nodes)[:, None]
            blocks.append(trace.rows(differentiate(flux[:, None], nodes)))
        return blocks

    # Solves with the tangent, which has e_max in place of larger conductances

    @property
    def exceeds(self) -> bool:
        """Whether a conductance exceeds e_max (collective)."""
        return not self.now.is_exact.all()

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
        now, loads = self.now, np.zeros_like(u)
        d[:] = self._change(u, z, motion) + now.kept * d
        self.add(now.by_conduction(-now.kept * d), loads)
        return loads

    def transposed_remainder(self, u: Array, d: Array) -> tuple[Array, Array, Array]:
        """As ``remainder``, with changes of the transposed equations, zero at prescribed dofs.

        E and Q change places: d, of the multiplier of q' [field], is that of E u.

        Returns:
            Parts of unknowns, multipliers and motions [their units], shaped as ``remainder``.
        """
        contact, now = self._contact, self.now
        d[:] = now.of_carriers(now.jumps @ self.gathered(u)) + now.kept * d
        by_jump, by_h, by_weight = np.split(now.q_by_quantities.T @ (-now.kept * d), 3)
        numbers, change = now.stacked(now.by_unknowns)
        values = change.T @ np.concatenate([by_jump, by_h, by_weight, np.zeros_like(by_h)])
        (first, end), (row, _), motion = self.owned, now.rows, np.zeros(0)
        dofs, values = from_all_ranks(contact.slave.comm, (numbers, values))
        mine = (dofs >= first) & (dofs < end)
        on_bodies = summed(values[mine], dofs[mine] - first, u.size)
        if contact.obstacle is not None:
            motion = by_h @ row_by_motions(now.f, row)
        return on_bodies, by_h[:, None] * row.by_z, motion

    def by_multipliers(self) -> Block:
        """Derivatives of the loads by multipliers; columns index z.ravel() (collective)."""
        own, dim = self._contact.slave.owned, self._contact.slave.dim
        columns = dim * own[:, None] + np.arange(dim)
        now = self.now
        h, source = ([Block(own[:, None], columns, row.by_z[own][:, None])] for row in now.rows)
        return now.derivative([[], h, [], source])

    def add_by_motions(self, columns: Array) -> None:
        """Add the loads' derivatives by the motions of the obstacle (collective).

        Args:
            columns: Shape (m, owned dofs) or longer [load / length]; changed in place.
        """
        now = self.now
        h, source = (row_by_motions(now.f, row) for row in now.rows)
        self.add(now.by_quantities @ np.concatenate([0.0 * h, h, 0.0 * h, source]), columns.T)


# Signs of slave and master in jumps and loads.
SIGNS = (1.0, -1.0)


class FluxValues:
    """Fluxes of both sides at the slave nodes, and their derivatives.

    The constructor is collective.

    Args:
        flux: The flux, with the present field.
        f: Fields of the contact.

    Attributes:
        f, o: Fields and operators of the contact.
        weight: Weights w_j of covered nodes, else 0, shape (slave nodes,) [length].
        jumps: D E - M E, derivative of the weighted jumps by the field, (slave nodes, d) [length].
        conductance: h at the nodes, shape (slave nodes,) [flux / field].
        q: Conduction of the carriers, shape (slave nodes,) [flux].
        next_q: That of a Newton step without increments, shape (slave nodes,) [flux].
        kept: Part of q that ``next_q`` keeps, 1 - e / h, shape (slave nodes,) [1].
        is_exact: Whether ``next_q`` does not depend on q, shape (slave nodes,), bool.
        row: min(h, conduction of the cells) times the row of q, shape (slave nodes,) [flux].
        conduction: Flux by conduction at the nodes, shape (slave nodes,) [flux].
    """

    def __init__(self, flux: Any, f: ContactFields) -> None:
        law, cells = flux.law, flux.cells
        self._flux, self._law, self._spread = flux, law, flux.spreads[law.is_perfect]
        self.f, self.o, self.on = f, f.operators, f.covered
        self.weight: Array = np.where(self.on, self.o.weight, 0.0)
        field = flux.T - law.on_obstacle  # on both sides
        self._fields = [E @ field for E in flux.interpolations]
        self._sides = [A @ E for A, E in zip(self.o.matrices, flux.interpolations, strict=False)]
        signed = (sign * side for sign, side in zip(SIGNS, self._sides, strict=False))
        self.jumps = csr_array(sum(signed))
        self.h, self._power = self._of_law()
        self.conductance = np.where(self.on & (self.weight > 0.0), self.h.h, 0.0)
        self._set_means(np.where(self.on, self.jumps @ field, 0.0))
        self.e, stiff = np.minimum(self._h, flux.stiffest * cells), self._h > cells
        self.is_exact: Flags = self.e == self._h
        self.q = self._h * self._jump if flux.is_separate else f.state.conduction[:, flux.column]
        self._per_h = np.where(stiff, self.q / np.where(stiff, self._h, 1.0), self._jump)
        self._ratio = np.where(self.is_exact, 1.0, self.e / np.where(self._h > 0.0, self._h, 1.0))
        self.kept = 1.0 - self._ratio
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
        h = law.evaluate(pressure, opened, finite=self._flux.is_separate)
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

    def at_nodes(self, of_carriers: Array) -> Array:
        """Values at covered nodes, else 0, of values at carriers, (slave nodes,) [their unit]."""
        return np.where(self.on, self._to_nodes @ of_carriers, 0.0)

    @cached_property
    def source(self) -> Row:
        """The source, power per area, and its derivatives, zero where open [flux]."""
        f, law, rubbing = self.f, self._law, self._rubbing
        closed = f.state.active & self.on
        if callable(law.heating):
            power, slope = self._power
            pressed = closed & (f.z_n > 0.0)
            return Row(np.where(closed, power, 0.0), by_z_n=np.where(pressed, slope, 0.0))
        if law.heating is None or not f.interface.pair.law.has_friction:
            return Row(np.zeros_like(self.weight))
        rubs, power = self._rubs, f.z_tau * f.slip if rubbing is None else rubbing.residual
        return f.at_gaps(Row(rubs * power, by_slip=rubs * f.z_tau, by_z_tau=rubs * f.slip))

    @cached_property
    def _rubs(self) -> Array:
        """One over the step at closed nodes that follow the law, zero at others [1 / time]."""
        closed = self.f.state.active & self.on & self.f.interface.follows_law
        return np.where(closed, 1.0 / self.f.nodal.step, 0.0)

    @cached_property
    def _rubbing(self) -> VectorRow | None:
        """Power of elastic bonds in space, whose shear is not along the slip of the step."""
        f: Any = self.f
        return f.rubbing if f.interface.pair.law.summed_slip and self.o.slave.dim == 3 else None

    def of_sides(self, q: Array) -> tuple[Array, Array]:
        """Fluxes that leave the slave and enter the master, for ``q`` of carriers (slave nodes,).

        Shape (slave nodes,) each [flux].
        """
        on_slave = self.at_nodes(q) - self._law.share * self.source.residual
        return on_slave, on_slave + self.source.residual

    def loads(self, q: Array) -> list[Array]:
        """Loads of the field's dofs by the fluxes of each side, see ``of_sides`` (d,) [load]."""
        sides = zip(SIGNS, self._sides, self.of_sides(q), strict=False)
        return [sign * (side.T @ flux) for sign, side, flux in sides]

    def by_conduction(self, q: Array) -> Array:
        """Loads by ``q`` of carriers (slave nodes,) without sources, shape (d,) [load]."""
        return np.asarray(self.jumps.T @ self.at_nodes(q))

    # Derivatives of both fluxes are sums over four quantities of the nodes: weighted jumps,
    # weighted conductances, weights and the source.

    def stacked(self, parts: Sequence[Iterable[Block]]) -> NumberedColumns:
        """Derivatives of the four quantities from their blocks, whose rows are slave nodes."""
        count = len(self.weight)
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
        of_w = by_h @ (A_T @ diags(self._finite_h) - diags(h) @ A_T)
        of_w = of_w - diags(self.e * self._per_P * self._per_h) @ R_T
        parts = [by_jump @ R_T, of_h, of_w]
        return csr_array(hstack(parts) @ diags(np.tile(self.on.astype(float), 3)))

    @cached_property
    def _spread_by_quantities(self) -> csr_array:
        """Derivatives of B q at fixed q, by all quantities but the source, (n, 3 n)."""
        A, R, varies = self._spread, self._R, self._varies.astype(float)
        s = np.where(self._varies, self._per_h, self.q * self._per_P * (A.T @ self.weight))
        per_w = np.divide(1.0, self.weight, out=np.zeros_like(s), where=self.weight > 0.0)
        by_P = R @ diags(s * self._per_P)
        of_h = diags(per_w * (A @ (varies * s))) - by_P @ diags(varies) @ A.T
        parts = [csr_array(A.shape), of_h, R @ diags(self.q * self._per_P) @ A.T - by_P @ R.T]
        return csr_array(hstack(parts) @ diags(np.tile(self.on.astype(float), 3)))

    @cached_property
    def by_quantities(self) -> csr_array:
        """Derivatives of the loads by the four quantities, (d, 4 slave nodes)."""
        conduction = self._to_nodes @ self.q_by_quantities
        if not self._is_plain:
            conduction = conduction + self._spread_by_quantities
        conduction = diags(self.on.astype(float)) @ conduction
        shares = -self._law.share, self._law.share - 1.0
        sources = sum(share * side.T for share, side in zip(shares, self._sides, strict=False))
        return csr_array(hstack([self.jumps.T @ conduction, sources]))

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
        source = self.f.by_vectors(self.source)
        if self._rubbing is not None and np.any(self.source.by_slip):
            source = VectorRow(*((self._rubs * part.T).T for part in self._rubbing))
        return self.f.by_vectors(h), source

    @cached_property
    def by_displacements(self) -> list[list[Block]]:
        """Blocks of the four quantities' derivatives by displacements."""
        o, (h, source) = self.o, self.rows
        on_slave, *on_master = self._fields
        return [
            list(o.matrix_derivative(on_slave, *(on_master or [np.zeros(0)]))),
            list(row_by_displacements(self.f, h)),
            list(o.weight_derivative()),
            list(row_by_displacements(self.f, source, summed=False)),
        ]

    def by_field(self) -> Iterator[Block]:
        """Blocks of the weighted jumps' derivative by the field's dofs; rows are slave nodes."""
        o, s, (slave, *masters) = self.o, self.o.segments, self._flux.traces
        yield Block(o.facet_nodes, *slave.columns(o.facet_nodes, o.D))
        for master in masters:
            yield Block(s.slave, *master.columns(s.master, -o.M))

    @property
    def by_unknowns(self) -> list[list[Block]]:
        """Blocks of the four quantities' derivatives by all unknowns of the bodies."""
        by_jump, *others = self.by_displacements
        return [[*self.by_field(), *by_jump], *others]

    def derivative(self, parts: Sequence[Iterable[Block]]) -> Block:
        """Derivatives of the loads by unknowns, from ``parts`` of the four quantities."""
        numbers, change = self.stacked(parts)
        return as_block(csr_array(self.by_quantities @ change), self._flux.dofs, numbers)
